//! The texels of several blocks, and the lines through their regions.

use pulp::Simd;

use super::super::partition;
use super::super::wide::{Mask, Wide};
use super::MOST_LANES;
use super::grid::UNIT;

/// Points of the two endpoints of each region: `[region][end][channel]`.
pub(super) type Lines<S> = [[[Wide<S>; 3]; 2]; 2];

/// Sums over texels: of the values, and of their products in the order 00 10 11 20 21 22.
#[derive(Clone, Copy)]
pub(super) struct Sums<S: Simd> {
    pub count: Wide<S>,
    pub first: [Wide<S>; 3],
    pub second: [Wide<S>; 6],
}

impl<S: Simd> Sums<S> {
    #[inline(always)]
    pub fn none(simd: S) -> Self {
        let zero = Wide::zero(simd);
        Self {
            count: zero,
            first: [zero; 3],
            second: [zero; 6],
        }
    }

    /// Those of the texels that `part` lacks.
    #[inline(always)]
    pub fn less(&self, part: &Self) -> Self {
        let mut rest = *self;
        rest.count = rest.count - part.count;
        for at in 0..3 {
            rest.first[at] = rest.first[at] - part.first[at];
        }
        for at in 0..6 {
            rest.second[at] = rest.second[at] - part.second[at];
        }
        rest
    }

    /// The scatter about the mean, and its trace.
    #[inline(always)]
    pub fn scatter(&self) -> ([[Wide<S>; 3]; 3], Wide<S>) {
        let zero = self.count.of(0.0);
        let inverse = self.count.recip();
        let mut scatter = [[zero; 3]; 3];
        let mut trace = zero;
        let mut at = 0;
        for a in 0..3 {
            let mean = self.first[a] * inverse;
            for b in 0..=a {
                let value = self.second[at] - self.first[b] * mean;
                scatter[a][b] = value;
                scatter[b][a] = value;
                at += 1;
            }
            scatter[a][a] = scatter[a][a].max(zero);
            trace += scatter[a][a];
        }
        (scatter, trace)
    }
}

/// Texels as bits of half floats, plus a half: the middle of what decodes to them, before it is rounded down.
pub(super) struct Texels<S: Simd> {
    pub simd: S,
    pub mean: [Wide<S>; 3],
    /// Less the mean: `[channel][texel]`.
    pub values: [[Wide<S>; 16]; 3],
    /// Of the values, in the order of [`Sums`].
    pub products: [[Wide<S>; 16]; 6],
    pub total: Sums<S>,
}

impl<S: Simd> Texels<S> {
    /// Blocks, one a lane.
    #[inline(always)]
    pub fn load<'a>(simd: S, blocks: impl Iterator<Item = &'a [[u16; 3]; 16]>) -> Self {
        let mut lanes = [[[0.0_f32; MOST_LANES]; 16]; 3];
        for (lane, block) in blocks.enumerate() {
            for (texel, bits) in block.iter().enumerate() {
                for channel in 0..3 {
                    lanes[channel][texel][lane] =
                        f32::from(bits[channel].min(super::LARGEST)) + 0.5;
                }
            }
        }
        let zero = Wide::zero(simd);
        let mut values = [[zero; 16]; 3];
        let mut mean = [zero; 3];
        let mut total = Sums::none(simd);
        total.count = Wide::splat(simd, 16.0);
        for channel in 0..3 {
            let mut sum = zero;
            for texel in 0..16 {
                let value = Wide::load(simd, &lanes[channel][texel][..S::F32_LANES]);
                values[channel][texel] = value;
                sum += value;
            }
            mean[channel] = sum * (1.0 / 16.0);
            for value in &mut values[channel] {
                *value = *value - mean[channel];
                total.first[channel] += *value;
            }
        }
        let mut products = [[zero; 16]; 6];
        for texel in 0..16 {
            let mut at = 0;
            for a in 0..3 {
                for b in 0..=a {
                    products[at][texel] = values[a][texel] * values[b][texel];
                    total.second[at] += products[at][texel];
                    at += 1;
                }
            }
        }
        Self {
            simd,
            mean,
            values,
            products,
            total,
        }
    }
}

/// How texels fall into regions: all into the first, or by each lane's partition.
#[derive(Clone, Copy)]
pub(super) struct Split<S: Simd> {
    pub partition: Wide<S>,
    /// Texels of the second region.
    pub second: [Mask<S>; 16],
    pub count: [Wide<S>; 2],
    /// Texels 2, 6, 8 and 15, of which one is the second region's anchor.
    anchors: [Mask<S>; 4],
}

/// Texels that may be the second region's anchor.
const ANCHORS: [usize; 4] = [2, 6, 8, 15];

impl<S: Simd> Split<S> {
    #[inline(always)]
    pub fn whole(simd: S) -> Self {
        let never = Mask::bit(simd, &[], 0);
        Self {
            partition: Wide::zero(simd),
            second: [never; 16],
            count: [Wide::splat(simd, 16.0), Wide::zero(simd)],
            anchors: [never; 4],
        }
    }

    #[inline(always)]
    pub fn new(simd: S, partition: Wide<S>) -> Self {
        let mut words = [0_u32; MOST_LANES];
        let mut anchors = [0_u32; MOST_LANES];
        let mut count = [0.0_f32; MOST_LANES];
        for (lane, way) in partition.lanes().iter().enumerate() {
            let way = *way as usize;
            words[lane] = u32::from(partition::masks(2, way)[1]);
            anchors[lane] = 1 << partition::anchors(2, way)[1];
            count[lane] = words[lane].count_ones() as f32;
        }
        let (words, anchors) = (&words[..S::F32_LANES], &anchors[..S::F32_LANES]);
        let mut split = Self::whole(simd);
        split.partition = partition;
        let second = Wide::load(simd, &count[..S::F32_LANES]);
        split.count = [second.of(16.0) - second, second];
        for texel in 0..16 {
            split.second[texel] = Mask::bit(simd, words, texel as u32);
        }
        for at in 0..4 {
            split.anchors[at] = Mask::bit(simd, anchors, ANCHORS[at] as u32);
        }
        split
    }

    /// The highest index of a texel: that of an anchor has one bit less.
    #[inline(always)]
    pub fn limit<const R: usize>(&self, simd: S, texel: usize) -> Wide<S> {
        let all = Wide::splat(simd, if R == 1 { 15.0 } else { 7.0 });
        let half = Wide::splat(simd, if R == 1 { 7.0 } else { 3.0 });
        if texel == 0 {
            return half;
        }
        if R == 2 {
            for at in 0..4 {
                if ANCHORS[at] == texel {
                    return self.anchors[at].select(half, all);
                }
            }
        }
        all
    }

    /// Of values of the regions, that of a texel's.
    #[inline(always)]
    pub fn of<const R: usize>(&self, texel: usize, regions: [Wide<S>; 2]) -> Wide<S> {
        if R == 1 {
            regions[0]
        } else {
            self.second[texel].select(regions[1], regions[0])
        }
    }

    /// The value of a region's anchor.
    #[inline(always)]
    fn anchor(&self, values: &[Wide<S>; 16], region: usize) -> Wide<S> {
        let mut value = values[0];
        if region == 1 {
            for (is_anchor, texel) in self.anchors.iter().zip(ANCHORS) {
                value = is_anchor.select(values[texel], value);
            }
        }
        value
    }

    /// Swaps the ends of lines whose anchors are nearer to the second.
    #[inline(always)]
    pub fn orient<const R: usize>(&self, texels: &Texels<S>, lines: &mut Lines<S>) {
        let zero = Wide::zero(texels.simd);
        for region in 0..R {
            let [low, high] = lines[region];
            let mut beyond = zero;
            for channel in 0..3 {
                let anchor = self.anchor(&texels.values[channel], region);
                let off = anchor + anchor - low[channel] - high[channel];
                beyond += off * (high[channel] - low[channel]);
            }
            let swapped = zero.less(beyond);
            for channel in 0..3 {
                lines[region][0][channel] = swapped.select(high[channel], low[channel]);
                lines[region][1][channel] = swapped.select(low[channel], high[channel]);
            }
        }
    }

    /// The sums of each region.
    #[inline(always)]
    fn sums<const R: usize>(&self, texels: &Texels<S>) -> [Sums<S>; 2] {
        let none = Sums::none(texels.simd);
        if R == 1 {
            return [texels.total, none];
        }
        let zero = Wide::zero(texels.simd);
        let mut second = none;
        second.count = self.count[1];
        for texel in 0..16 {
            let mask = self.second[texel];
            for at in 0..3 {
                second.first[at] += mask.select(texels.values[at][texel], zero);
            }
            for at in 0..6 {
                second.second[at] += mask.select(texels.products[at][texel], zero);
            }
        }
        [texels.total.less(&second), second]
    }

    /// The extremes of each region along its principal axis.
    #[inline(always)]
    pub fn principal<const R: usize>(&self, texels: &Texels<S>) -> Lines<S> {
        let simd = texels.simd;
        let zero = Wide::zero(simd);
        let sums = self.sums::<R>(texels);
        let mut axes = [[zero; 3]; 2];
        let mut scaled = [[zero; 3]; 2];
        let mut means = [[zero; 3]; 2];
        let mut offsets = [zero; 2];
        for region in 0..R {
            axes[region] = principal_axis(&sums[region]);
            let inverse = sums[region].count.recip();
            let mut square = zero;
            for value in axes[region] {
                square += value * value;
            }
            // Less is what rounding left of a region of one colour; its reciprocal may be infinite.
            let apart = square.of(1e-20).less(square);
            let scale = apart.select(square, square.of(1.0)).recip();
            for channel in 0..3 {
                means[region][channel] = sums[region].first[channel] * inverse;
                scaled[region][channel] = axes[region][channel] * scale;
                offsets[region] += means[region][channel] * scaled[region][channel];
            }
        }
        let far = Wide::splat(simd, 1e9);
        let (mut least, mut most) = ([far; 2], [zero - far; 2]);
        for texel in 0..16 {
            let mut position = zero - self.of::<R>(texel, offsets);
            for channel in 0..3 {
                let axis = self.of::<R>(texel, [scaled[0][channel], scaled[1][channel]]);
                position += texels.values[channel][texel] * axis;
            }
            if R == 1 {
                least[0] = least[0].min(position);
                most[0] = most[0].max(position);
            } else {
                let mask = self.second[texel];
                least[0] = least[0].min(mask.select(far, position));
                most[0] = most[0].max(mask.select(zero - far, position));
                least[1] = least[1].min(mask.select(position, far));
                most[1] = most[1].max(mask.select(position, zero - far));
            }
        }
        let mut lines = [[[zero; 3]; 2]; 2];
        for region in 0..R {
            for channel in 0..3 {
                let (mean, axis) = (means[region][channel], axes[region][channel]);
                lines[region][0][channel] = mean + axis * least[region];
                lines[region][1][channel] = mean + axis * most[region];
            }
        }
        clamp::<S, R>(texels, &mut lines);
        lines
    }

    /// The lines with the least squared error at given weights; both ends the mean where all weights are one.
    #[inline(always)]
    pub fn least_squares<const R: usize>(
        &self,
        texels: &Texels<S>,
        weights: &[Wide<S>; 16],
    ) -> Lines<S> {
        let simd = texels.simd;
        let zero = Wide::zero(simd);
        // Of the second end's weights, their squares, their products with the values, and the values.
        let mut sums = [[zero; 8]; 2];
        for texel in 0..16 {
            let weight = weights[texel] * (1.0 / 64.0);
            let mut terms = [weight, weight * weight, zero, zero, zero, zero, zero, zero];
            for channel in 0..3 {
                let value = texels.values[channel][texel];
                terms[2 + channel] = weight * value;
                terms[5 + channel] = value;
            }
            for at in 0..8 {
                if R == 2 {
                    sums[1][at] += self.second[texel].select(terms[at], zero);
                }
                sums[0][at] += terms[at];
            }
        }
        if R == 2 {
            for at in 0..8 {
                sums[0][at] = sums[0][at] - sums[1][at];
            }
        }
        let mut lines = [[[zero; 3]; 2]; 2];
        for region in 0..R {
            let [b, bb, ..] = sums[region];
            let (aa, ab) = (self.count[region] - b * 2.0 + bb, b - bb);
            let determinant = aa * bb - ab * ab;
            let solvable = Wide::splat(simd, 1e-3).less(determinant);
            let inverse = solvable.select(determinant, determinant.of(1.0)).recip();
            let share = self.count[region].recip();
            for channel in 0..3 {
                let (right, sum) = (sums[region][2 + channel], sums[region][5 + channel]);
                let left = sum - right;
                let low = (left * bb - right * ab) * inverse;
                let high = (right * aa - left * ab) * inverse;
                lines[region][0][channel] = solvable.select(low, sum * share);
                lines[region][1][channel] = solvable.select(high, sum * share);
            }
        }
        clamp::<S, R>(texels, &mut lines);
        lines
    }
}

/// Moves points to where endpoints may lie.
#[inline(always)]
fn clamp<S: Simd, const R: usize>(texels: &Texels<S>, lines: &mut Lines<S>) {
    let (zero, top) = (
        Wide::zero(texels.simd),
        Wide::splat(texels.simd, 65535.0 * UNIT),
    );
    for region in 0..R {
        for end in 0..2 {
            for channel in 0..3 {
                let mean = texels.mean[channel];
                let value = &mut lines[region][end][channel];
                *value = value.max(zero - mean).min(top - mean);
            }
        }
    }
}

/// Powers of the scatter applied to its row of largest variance.
#[inline(always)]
fn principal_axis<S: Simd>(sums: &Sums<S>) -> [Wide<S>; 3] {
    let (rows, trace) = sums.scatter();
    let zero = trace.of(0.0);
    let mut axis = rows[0];
    let mut peak = rows[0][0];
    for a in 1..3 {
        let larger = peak.less(rows[a][a]);
        for channel in 0..3 {
            axis[channel] = larger.select(rows[a][channel], axis[channel]);
        }
        peak = peak.max(rows[a][a]);
    }
    let some = zero.less(trace);
    let scale = some.select(trace, trace.of(1.0)).recip();
    for value in &mut axis {
        *value = *value * scale;
    }
    for _ in 0..4 {
        let mut next = [zero; 3];
        for a in 0..3 {
            let share = axis[a] * scale;
            for channel in 0..3 {
                next[channel] += rows[a][channel] * share;
            }
        }
        axis = next;
    }
    axis
}
