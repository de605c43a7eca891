//! BC6H blocks from half floats, unsigned, with the same bytes on every machine.
//!
//! Format: Khronos Data Format Specification 1.3, section 20.2; all 14 modes. The squared error of the half floats' bits
//! is made small, which is close to that of the logarithm. Several blocks are searched side by side, one in each lane of
//! the processor's registers; a block's bytes depend neither on the lanes beside it nor on how many there are.

#![allow(
    clippy::needless_range_loop,
    reason = "several arrays of channels, texels and regions share an index"
)]

mod fit;
mod grid;
mod modes;
mod preset;
mod search;
mod texels;

use pulp::{Simd, WithSimd};

use super::Quality;
use preset::{Preset, preset};
use search::{Choice, Parts, Whole};

/// Most blocks side by side.
const MOST_LANES: usize = 16;
/// Largest finite half, as bits.
const LARGEST: u16 = 0x7bff;

/// Compresses blocks of 16 RGB texels of non-negative half bits, rows of four; bits above the largest finite half are
/// clamped to it. Blocks of one colour are exact.
///
/// # Panics
/// If the slices differ in length.
pub(super) fn compress(blocks: &[[[u16; 3]; 16]], quality: Quality, out: &mut [[u8; 16]]) {
    pulp::Arch::new().dispatch(Compress {
        blocks,
        preset: preset(quality),
        out,
    });
}

struct Compress<'a> {
    blocks: &'a [[[u16; 3]; 16]],
    preset: &'a Preset,
    out: &'a mut [[u8; 16]],
}

impl WithSimd for Compress<'_> {
    type Output = ();
    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        assert_eq!(self.blocks.len(), self.out.len());
        let found = self.find(simd);
        for (out, choice) in self.out.iter_mut().zip(&found) {
            *out = choice.fields.pack();
        }
    }
}

impl Compress<'_> {
    /// The best way found of each block.
    #[inline(always)]
    fn find<S: Simd>(&self, simd: S) -> Vec<Choice> {
        let preset = self.preset;
        let mut best = Vec::with_capacity(self.blocks.len());
        for blocks in self.blocks.chunks(S::F32_LANES) {
            let found = simd.vectorize(Whole { blocks, preset });
            best.extend_from_slice(&found[..blocks.len()]);
        }
        if preset.partitions == 0 {
            return best;
        }
        let limit = preset.enough * 48.0;
        let slots = (0..best.len()).filter(|&slot| best[slot].error > limit);
        let slots: Vec<usize> = slots.collect();
        for slots in slots.chunks(S::F32_LANES) {
            let found = simd.vectorize(Parts {
                blocks: self.blocks,
                slots,
                preset,
            });
            for (&slot, choice) in slots.iter().zip(found) {
                if choice.error < best[slot].error {
                    best[slot] = choice;
                }
            }
        }
        best
    }
}

/// The 16 texels of a block, as half bits.
pub(super) fn decompress_block(block: &[u8; 16]) -> [[u16; 3]; 16] {
    let mut texels = [[0_u16; 3]; 16];
    bcdec_rs::bc6h_half(block, texels.as_flattened_mut(), 12, false);
    texels
}

#[cfg(test)]
mod tests;
