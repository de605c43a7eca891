//! What is done to jobs side by side: fit, polish, pack.

use pulp::{Simd, WithSimd};

use super::fit::{Effort, Fit, FitSubset, Polish};
use super::grid::Grid;
use super::jobs::{Alpha, Job, Part, Visit, get_ends, put_ends, walk};
use super::measure::Indices;
use super::modes::{Fields, MODES};
use super::preset::Preset;
use super::texels::{MOST_LANES, Packed, Subset};
use super::wide::Wide;

/// Jobs of one kind, no more than there are lanes, and what they are of.
pub(super) struct Batch<'a> {
    pub blocks: &'a [Packed],
    pub alpha: Alpha,
    pub jobs: &'a mut [Job],
}

impl Batch<'_> {
    #[inline(always)]
    fn walk<S: Simd>(&mut self, simd: S, visitor: &mut impl Visit<S>) {
        walk(simd, self.blocks, self.alpha, self.jobs, visitor);
    }

    /// Gives the jobs the errors of their lanes.
    #[inline(always)]
    fn put_errors<S: Simd>(&mut self, error: Wide<S>) {
        for (job, error) in self.jobs.iter_mut().zip(error.lanes()) {
            job.error = *error;
        }
    }
}

/// Fits endpoints. Jobs whose error is not below their limit may be left unfinished, with an error no less.
pub(super) struct FitJobs<'a> {
    pub batch: Batch<'a>,
    pub effort: Effort,
    pub limits: [f32; MOST_LANES],
}

struct Fitting<S: Simd> {
    effort: Effort,
    limit: Wide<S>,
    error: Wide<S>,
}

impl<S: Simd> Visit<S> for Fitting<S> {
    #[inline(always)]
    fn visit<const C: usize>(
        &mut self,
        part: Part,
        subset: &Subset<'_, S>,
        grid: &Grid,
        jobs: &mut [Job],
    ) -> bool {
        let fit = FitSubset::<S, C> {
            subset,
            grid,
            effort: self.effort,
        }
        .run();
        put_ends::<S, C>(jobs, part, &fit.ends);
        self.error += fit.error;
        self.error.less(self.limit).any()
    }
}

impl WithSimd for FitJobs<'_> {
    type Output = ();
    #[inline(always)]
    fn with_simd<S: Simd>(mut self, simd: S) {
        let mut fitting = Fitting {
            effort: self.effort,
            limit: Wide::load(simd, &self.limits),
            error: Wide::zero(simd),
        };
        self.batch.walk(simd, &mut fitting);
        self.batch.put_errors(fitting.error);
    }
}

/// Improves the endpoints of jobs.
pub(super) struct PolishJobs<'a> {
    pub batch: Batch<'a>,
    pub preset: &'a Preset,
}

struct Polishing<'a, S: Simd> {
    preset: &'a Preset,
    error: Wide<S>,
}

impl<S: Simd> Visit<S> for Polishing<'_, S> {
    #[inline(always)]
    fn visit<const C: usize>(
        &mut self,
        part: Part,
        subset: &Subset<'_, S>,
        grid: &Grid,
        jobs: &mut [Job],
    ) -> bool {
        let mut best = Fit::none(subset.simd);
        best.ends = get_ends(subset.simd, jobs, part);
        Polish::<S, C> {
            subset,
            grid,
            again: self.preset.again,
            rounds: self.preset.rounds,
            descents: self.preset.descents,
            pairs: self.preset.pairs,
            best: &mut best,
        }
        .run();
        put_ends::<S, C>(jobs, part, &best.ends);
        self.error += best.error;
        true
    }
}

impl WithSimd for PolishJobs<'_> {
    type Output = ();
    #[inline(always)]
    fn with_simd<S: Simd>(mut self, simd: S) {
        let mut polishing = Polishing {
            preset: self.preset,
            error: Wide::zero(simd),
        };
        self.batch.walk(simd, &mut polishing);
        self.batch.put_errors(polishing.error);
    }
}

/// Makes the blocks of jobs, in their order.
pub(super) struct PackJobs<'a> {
    pub batch: Batch<'a>,
    pub out: &'a mut [[u8; 16]; MOST_LANES],
}

struct Packing {
    /// Of the vector, then of the scalar.
    indices: [[u64; MOST_LANES]; 2],
}

impl<S: Simd> Visit<S> for Packing {
    #[inline(always)]
    fn visit<const C: usize>(
        &mut self,
        part: Part,
        subset: &Subset<'_, S>,
        grid: &Grid,
        jobs: &mut [Job],
    ) -> bool {
        let rows = Indices::<S, C> {
            subset,
            grid,
            ends: &get_ends(subset.simd, jobs, part),
        }
        .run();
        let indices = &mut self.indices[usize::from(part == Part::Scalar)];
        for (row, values) in rows.into_iter().enumerate() {
            for (indices, value) in indices.iter_mut().zip(values.lanes()) {
                *indices |= u64::from(*value as u32) << (16 * row);
            }
        }
        true
    }
}

impl WithSimd for PackJobs<'_> {
    type Output = ();
    #[inline(always)]
    fn with_simd<S: Simd>(mut self, simd: S) {
        let mut packing = Packing {
            indices: [[0; MOST_LANES]; 2],
        };
        self.batch.walk(simd, &mut packing);
        let Batch { alpha, jobs, .. } = self.batch;
        let [indices, scalar_indices] = &packing.indices;
        for (lane, (job, out)) in jobs.iter().zip(self.out).enumerate() {
            let mode = &MODES[usize::from(job.way.mode)];
            let apart = mode.scalar_index_bits > 0;
            let mut ends = job.ends;
            if alpha != Alpha::Varies && mode.alpha_bits > 0 && !apart {
                // With its parity bit 255, or 254.
                for end in &mut ends[0] {
                    end[3] = 127;
                }
            }
            let fields = Fields {
                mode: usize::from(job.way.mode),
                partition: if apart {
                    0
                } else {
                    usize::from(job.way.partition)
                },
                rotation: if apart {
                    u32::from(job.way.partition)
                } else {
                    0
                },
                swapped_indices: job.way.swapped_indices,
                ends,
                parity: job.parity,
                indices: indices[lane],
                scalar_indices: scalar_indices[lane],
            };
            *out = fields.pack();
        }
    }
}
