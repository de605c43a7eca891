//! BC7 blocks from 8-bit texels, with the same bytes on every machine.
//!
//! Format: Khronos Data Format Specification 1.3, section 20.1. The squared error of the stored values is made
//! small, all channels alike. Several blocks are searched side by side, one in each lane of the processor's registers;
//! a block's bytes depend neither on the lanes beside it nor on how many there are. Only additions, products,
//! divisions, square roots and roundings, each in a fixed order: no fused or approximate instruction, which
//! processors do differently.

#![allow(
    clippy::needless_range_loop,
    reason = "several arrays of channels, texels and subsets share an index"
)]

mod estimate;
mod fit;
mod grid;
mod jobs;
mod measure;
mod modes;
mod preset;
mod round;
mod search;
mod solid;
mod stages;
mod texels;

use pulp::{Simd, WithSimd};

use super::{Quality, partition, wide};
use jobs::Alpha;
use preset::{Preset, preset};
use search::Search;
use texels::Packed;

/// Compresses blocks of 16 RGBA texels, rows of four. Blocks of one colour are exact, and opaque ones stay opaque,
/// unless `alpha_is_read` is false: then alpha is to be 255, and 254 may be stored.
///
/// # Panics
/// If the slices differ in length.
pub(super) fn compress(
    blocks: &[[[u8; 4]; 16]],
    quality: Quality,
    alpha_is_read: bool,
    out: &mut [[u8; 16]],
) {
    pulp::Arch::new().dispatch(Compress {
        blocks,
        alpha_is_read,
        preset: preset(quality),
        out,
    });
}

struct Compress<'a> {
    blocks: &'a [[[u8; 4]; 16]],
    alpha_is_read: bool,
    preset: &'a Preset,
    out: &'a mut [[u8; 16]],
}

impl WithSimd for Compress<'_> {
    type Output = ();
    #[inline(always)]
    fn with_simd<S: Simd>(mut self, simd: S) {
        assert_eq!(self.blocks.len(), self.out.len());
        // Opaque blocks and others try different modes: lanes are filled with one kind.
        let mut kinds = [Vec::new(), Vec::new()];
        for (at, block) in self.blocks.iter().enumerate() {
            if block[1..].iter().all(|texel| *texel == block[0]) {
                self.out[at] = solid::solid(block[0]);
            } else {
                let opaque = block.iter().all(|texel| texel[3] == 255);
                kinds[usize::from(opaque)].push(at);
            }
        }
        let opaque = if self.alpha_is_read {
            Alpha::Opaque
        } else {
            Alpha::Ignored
        };
        for (slots, alpha) in kinds.iter().zip([Alpha::Varies, opaque]) {
            for slots in slots.chunks(TOGETHER) {
                self.kind(simd, slots, alpha);
            }
        }
    }
}

/// Most blocks searched together: what is known of them fits into the caches.
const TOGETHER: usize = 1024;

impl Compress<'_> {
    /// Compresses the blocks of `slots`, which are of one kind.
    #[inline(always)]
    fn kind<S: Simd>(&mut self, simd: S, slots: &[usize], alpha: Alpha) {
        let packed = slots.iter().map(|&slot| Packed::new(&self.blocks[slot]));
        let packed: Vec<Packed> = packed.collect();
        let search = Search {
            simd,
            blocks: &packed,
            alpha,
            preset: self.preset,
        };
        let mut found = search.find();
        if self.preset.polishes() {
            search.polish(&mut found);
        }
        search.pack(&found, |slot, block| {
            self.out[slots[slot as usize]] = block;
        });
    }
}

#[cfg(test)]
mod tests;
