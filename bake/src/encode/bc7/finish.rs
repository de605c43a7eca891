//! Descent from ways that were found, several of one mode side by side.

use pulp::{Simd, WithSimd};

use super::choice::{Choice, GRIDS, OPAQUE_WHOLE, rotated_grids};
use super::estimate::SCALARS;
use super::fit::{Fit, FitSubset, Grid, Measure, Polish, Subset};
use super::modes::MODES;
use super::partition;
use super::preset::Preset;
use super::search::{Alpha, MOST_LANES};
use super::wide::Wide;

/// A way of storing one block, to be made better.
#[derive(Clone, Copy, Debug)]
pub(super) struct Job {
    /// Of the block.
    pub slot: usize,
    /// Among the ways of its block when they were found.
    pub rank: usize,
    pub choice: Choice,
}

/// Improves ways of one mode and index selection, `MOST_LANES` at most and no more than there are lanes.
pub(super) struct Finish<'a> {
    pub blocks: &'a [[[u8; 4]; 16]],
    pub alpha: Alpha,
    pub preset: &'a Preset,
    pub jobs: &'a mut [Job],
}

impl Finish<'_> {
    #[inline(always)]
    fn finish<S: Simd>(&mut self, simd: S) {
        let Choice {
            mode,
            swapped_indices,
            ..
        } = self.jobs[0].choice;
        let mut values = [[Wide::zero(simd); 16]; 4];
        for channel in 0..4 {
            for texel in 0..16 {
                let mut lanes = [0.0; MOST_LANES];
                for (lane, job) in lanes.iter_mut().zip(&*self.jobs) {
                    let alone = SCALARS[job.choice.rotation];
                    let channel = match channel {
                        3 => alone,
                        _ if channel == alone => 3,
                        _ => channel,
                    };
                    *lane = f32::from(self.blocks[job.slot][texel][channel]);
                }
                values[channel][texel] = Wide::load(simd, &lanes[..S::F32_LANES]);
            }
        }
        let whole = Subset::whole(simd, &values);
        let mut error = Wide::zero(simd);
        if MODES[mode].scalar_index_bits > 0 {
            let [grid, scalar_grid] = rotated_grids(mode, swapped_indices);
            error += self.subset::<S, 3>(&whole, grid, 0);
            let mut scalars = values;
            scalars[0] = values[3];
            let alone = Subset::whole(simd, &scalars);
            for job in &mut *self.jobs {
                job.choice.ends[1] = job.choice.scalar.map(|end| [end, 0.0, 0.0, 0.0]);
                job.choice.parity[1] = [0.0; 2];
            }
            error += self.subset::<S, 1>(&alone, scalar_grid, 1);
            for job in &mut *self.jobs {
                job.choice.scalar = job.choice.ends[1].map(|end| end[0]);
            }
        } else {
            for at in 0..MODES[mode].subsets {
                let mut words = [1_u32; MOST_LANES];
                for (word, job) in words.iter_mut().zip(&*self.jobs) {
                    let masks = partition::masks(MODES[mode].subsets, job.choice.partition);
                    *word = u32::from(masks[at]);
                }
                let mut subset = whole;
                subset.choose(&words[..S::F32_LANES]);
                error += match (mode, self.alpha) {
                    (6 | 7, Alpha::Varies) => self.subset::<S, 4>(&subset, &GRIDS[mode], at),
                    (6, Alpha::Opaque) => self.subset::<S, 3>(&subset, &OPAQUE_WHOLE, at),
                    _ => self.subset::<S, 3>(&subset, &GRIDS[mode], at),
                };
            }
        }
        for (lane, job) in self.jobs.iter_mut().enumerate() {
            job.choice.error = error.lane(lane);
        }
    }

    /// The endpoints of one subset; their error.
    #[inline(always)]
    fn subset<S: Simd, const C: usize>(
        &mut self,
        subset: &Subset<S>,
        grid: &Grid,
        at: usize,
    ) -> Wide<S> {
        let simd = subset.simd;
        let mut best = Fit::none(simd);
        for end in 0..2 {
            let mut lanes = [[0.0; MOST_LANES]; 5];
            for (lane, job) in self.jobs.iter().enumerate() {
                for channel in 0..4 {
                    lanes[channel][lane] = job.choice.ends[at][end][channel];
                }
                lanes[4][lane] = job.choice.parity[at][end];
            }
            for channel in 0..4 {
                best.ends.stored[end][channel] = Wide::load(simd, &lanes[channel][..S::F32_LANES]);
            }
            best.ends.parity[end] = Wide::load(simd, &lanes[4][..S::F32_LANES]);
        }
        best.error = Measure::<S, C> {
            subset,
            grid,
            ends: &best.ends,
            weights: &mut best.weights,
        }
        .run();
        if let Some(effort) = self.preset.again {
            let other = FitSubset::<S, C> {
                subset,
                grid,
                effort,
            }
            .run();
            best.improve(&other.ends, &other.weights, other.error);
        }
        Polish::<S, C> {
            subset,
            grid,
            rounds: self.preset.polish,
            // Where alpha is a colour channel, it has to stay full.
            together: self.alpha != Alpha::Opaque
                || MODES[self.jobs[0].choice.mode].scalar_index_bits == 0,
            best: &mut best,
        }
        .run();
        for (lane, job) in self.jobs.iter_mut().enumerate() {
            job.choice = job.choice.subset(at, &best, lane);
        }
        best.error
    }
}

impl WithSimd for Finish<'_> {
    type Output = ();
    #[inline(always)]
    fn with_simd<S: Simd>(mut self, simd: S) {
        self.finish(simd);
    }
}
