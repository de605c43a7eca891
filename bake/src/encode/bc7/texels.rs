//! Texels of several blocks side by side.

use pulp::{Simd, WithSimd};

use super::partition;
pub(super) use super::wide::MOST_LANES;
use super::wide::{Mask, Wide, Words};

/// One block: of each texel red and green, then blue and alpha, in the low bytes.
#[derive(Clone, Copy)]
pub(super) struct Packed([u32; 32]);

impl Packed {
    pub fn new(texels: &[[u8; 4]; 16]) -> Self {
        let mut words = [0; 32];
        for (pair, [red, green, blue, alpha]) in words.chunks_exact_mut(2).zip(texels) {
            pair[0] = u32::from(*red) | u32::from(*green) << 8;
            pair[1] = u32::from(*blue) | u32::from(*alpha) << 8;
        }
        Self(words)
    }
}

/// Values of a block in each lane, `[channel][texel]`.
pub(super) type Values<S> = [[Wide<S>; 16]; 4];

/// Spreads blocks over the lanes, one each; lanes without one repeat the first.
pub(super) struct Gather<'a, S: Simd> {
    pub simd: S,
    pub blocks: &'a [Packed],
    /// Indices into `blocks`, as many as there are lanes.
    pub slots: [u32; MOST_LANES],
    pub values: &'a mut Values<S>,
}

impl<S: Simd> WithSimd for Gather<'_, S> {
    type Output = ();
    #[inline(always)]
    fn with_simd<T: Simd>(self, _: T) {
        let mut rows = [Words::ZERO; 32];
        for lane in 0..S::F32_LANES {
            let block = &self.blocks[self.slots[lane] as usize];
            for (row, word) in rows.iter_mut().zip(&block.0) {
                row.0[lane] = *word;
            }
        }
        for texel in 0..16 {
            for half in 0..2 {
                let [low, high] = rows[2 * texel + half].bytes(self.simd);
                self.values[2 * half][texel] = low;
                self.values[2 * half + 1][texel] = high;
            }
        }
    }
}

/// Puts alpha in the place of the channel that each lane stores apart, given as its rotation.
#[inline(always)]
pub(super) fn rotate<S: Simd>(values: &mut Values<S>, rotation: Wide<S>) {
    for channel in 0..3 {
        let off = rotation - rotation.of(channel as f32 + 1.0);
        let swapped = (off * off).less(rotation.of(0.25));
        if !swapped.any() {
            continue;
        }
        for texel in 0..16 {
            let (own, alpha) = (values[channel][texel], values[3][texel]);
            values[channel][texel] = swapped.select(alpha, own);
            values[3][texel] = swapped.select(own, alpha);
        }
    }
}

/// Texels of one subset.
#[derive(Clone, Copy)]
pub(super) struct Subset<'a, S: Simd> {
    pub simd: S,
    /// `[channel][texel]`, no fewer channels than are fitted.
    pub values: &'a [[Wide<S>; 16]],
    /// 1 for the texels of the subset, 0 for others.
    pub inside: [Wide<S>; 16],
    pub count: Wide<S>,
}

impl<'a, S: Simd> Subset<'a, S> {
    /// All texels of blocks.
    #[inline(always)]
    pub fn whole(simd: S, values: &'a [[Wide<S>; 16]]) -> Self {
        Self {
            simd,
            values,
            inside: [Wide::splat(simd, 1.0); 16],
            count: Wide::splat(simd, 16.0),
        }
    }

    /// Takes the texels whose bits are set in the word of each lane. Words are never 0.
    #[inline(always)]
    pub fn choose(&mut self, words: &Words) {
        let (one, zero) = (Wide::splat(self.simd, 1.0), Wide::zero(self.simd));
        self.count = zero;
        for texel in 0..16 {
            let inside = Mask::bit(self.simd, &words.0, texel as u32).select(one, zero);
            self.inside[texel] = inside;
            self.count += inside;
        }
    }
}

/// The masks of the subsets of a partition in each lane.
#[inline(always)]
pub(super) fn subset_masks(subsets: usize, partitions: impl Iterator<Item = usize>) -> [Words; 3] {
    // Whole blocks in lanes without one.
    let mut words = [Words([0xffff; MOST_LANES]); 3];
    for (lane, partition) in partitions.enumerate() {
        let masks = partition::masks(subsets, partition);
        for (words, mask) in words.iter_mut().zip(masks) {
            words.0[lane] = u32::from(mask);
        }
    }
    words
}
