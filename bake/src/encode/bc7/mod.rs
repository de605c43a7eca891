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

mod choice;
mod estimate;
mod finish;
mod fit;
mod modes;
mod preset;
mod search;
mod solid;

use pulp::{Simd, WithSimd};

use super::{Quality, partition, wide};
use finish::{Finish, Job};
use preset::{Preset, preset};
use search::{Alpha, Blocks, MOST_LANES};

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
            self.kind(simd, slots, alpha);
        }
    }
}

impl Compress<'_> {
    /// Compresses the blocks of `slots`, which are of one kind.
    #[inline(always)]
    fn kind<S: Simd>(&mut self, simd: S, slots: &[usize], alpha: Alpha) {
        let mut jobs = self.find(simd, slots, alpha);
        if self.preset.polish > 0 {
            self.finish(simd, &mut jobs, alpha);
        }
        let mut last = None;
        for Job { slot, choice, .. } in jobs {
            if last != Some(slot) {
                let fields = choice.fields(&self.blocks[slot], alpha != Alpha::Varies);
                self.out[slot] = fields.pack();
                last = Some(slot);
            }
        }
    }

    /// The ways kept of each block, best first.
    #[inline(always)]
    fn find<S: Simd>(&self, simd: S, slots: &[usize], alpha: Alpha) -> Vec<Job> {
        let mut jobs = Vec::with_capacity(slots.len() * self.preset.kept);
        for slots in slots.chunks(S::F32_LANES) {
            // Lanes without a block repeat the first.
            let mut texels = [self.blocks[slots[0]]; MOST_LANES];
            for (texels, slot) in texels.iter_mut().zip(slots) {
                *texels = self.blocks[*slot];
            }
            let found = simd.vectorize(Blocks {
                texels: &texels,
                alpha,
                preset: self.preset,
            });
            for (choices, &slot) in found.iter().zip(slots) {
                let kept = choices[..self.preset.kept].iter().enumerate();
                let kept = kept.filter(|(_, choice)| choice.error.is_finite());
                jobs.extend(kept.map(|(rank, &choice)| Job { slot, rank, choice }));
            }
        }
        jobs
    }

    /// Descends from the ways kept, and sorts those of each block by their error.
    #[inline(always)]
    fn finish<S: Simd>(&self, simd: S, jobs: &mut [Job], alpha: Alpha) {
        // Ways of one mode descend side by side.
        let key = |job: &Job| (job.choice.mode, job.choice.swapped_indices);
        jobs.sort_by_key(key);
        for jobs in jobs.chunk_by_mut(|a, b| key(a) == key(b)) {
            for jobs in jobs.chunks_mut(S::F32_LANES) {
                simd.vectorize(Finish {
                    blocks: self.blocks,
                    alpha,
                    preset: self.preset,
                    jobs,
                });
            }
        }
        // The first found of equals, which is there whatever the neighbours made the search go on to.
        jobs.sort_by(|a, b| {
            let errors = a.choice.error.total_cmp(&b.choice.error);
            a.slot.cmp(&b.slot).then(errors).then(a.rank.cmp(&b.rank))
        });
    }
}

#[cfg(test)]
mod tests;
