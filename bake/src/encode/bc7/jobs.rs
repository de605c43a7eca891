//! Ways of storing blocks, and walks over the subsets of those of one mode side by side.

use pulp::Simd;

use super::grid::{GRIDS, Grid, OPAQUE_WHOLE, rotated_grids};
use super::measure::Ends;
use super::modes::MODES;
use super::texels::{Gather, MOST_LANES, Packed, Subset, rotate, subset_masks};
use super::wide::{Wide, Words};

/// What the blocks searched together have in common.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Alpha {
    /// It varies, or is below 255.
    Varies,
    /// It is 255 and stays so.
    Opaque,
    /// Nobody reads it: it may be stored as 254 where that serves colour.
    Ignored,
}

/// What is chosen before endpoints are fitted.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Way {
    pub mode: u8,
    /// Of modes 4 and 5 the rotation.
    pub partition: u8,
    /// Mode 4: whether colour has the 3-bit indices and the scalar the 2-bit ones.
    pub swapped_indices: bool,
}

impl Way {
    pub const WHOLE: Self = Self::new(6, 0);

    pub const fn new(mode: u8, partition: u8) -> Self {
        Self {
            mode,
            partition,
            swapped_indices: false,
        }
    }

    /// Those of equal kind are fitted side by side.
    fn kind(self) -> usize {
        usize::from(self.mode) + usize::from(self.swapped_indices) * 8
    }
}

/// A way of storing one block, with its endpoints.
#[derive(Clone, Copy, Debug)]
pub(super) struct Job {
    /// Of the block, among those searched together.
    pub slot: u32,
    pub way: Way,
    /// Stored values, `[subset][end][channel]`; of modes 4 and 5 the fourth channel is the scalar.
    pub ends: [[[u8; 4]; 2]; 3],
    /// `[subset][end]`.
    pub parity: [[u8; 2]; 3],
    pub error: f32,
}

impl Job {
    pub const fn new(slot: u32, way: Way) -> Self {
        Self {
            slot,
            way,
            ends: [[[0; 4]; 2]; 3],
            parity: [[0; 2]; 3],
            error: f32::INFINITY,
        }
    }
}

/// Jobs by the kind of their way, in the order in which they came.
#[derive(Default)]
pub(super) struct Queue {
    kinds: [Vec<Job>; 16],
}

impl Queue {
    pub fn push(&mut self, job: Job) {
        self.kinds[job.way.kind()].push(job);
    }

    /// The jobs of one kind after the other.
    pub fn kinds(&mut self) -> impl Iterator<Item = &mut Vec<Job>> {
        self.kinds.iter_mut().filter(|jobs| !jobs.is_empty())
    }
}

/// A part of a block that has endpoints of its own.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(super) enum Part {
    Subset(usize),
    /// The channel stored apart, in modes 4 and 5.
    Scalar,
}

/// What is done with each part of a job.
pub(super) trait Visit<S: Simd> {
    /// Whether to go on.
    fn visit<const C: usize>(
        &mut self,
        part: Part,
        subset: &Subset<'_, S>,
        grid: &Grid,
        jobs: &mut [Job],
    ) -> bool;
}

/// Visits the parts of jobs of one kind, no more than there are lanes.
#[inline(always)]
pub(super) fn walk<S: Simd>(
    simd: S,
    blocks: &[Packed],
    alpha: Alpha,
    jobs: &mut [Job],
    visitor: &mut impl Visit<S>,
) {
    let way = jobs[0].way;
    let mode = usize::from(way.mode);
    let mut slots = [jobs[0].slot; MOST_LANES];
    for (slot, job) in slots.iter_mut().zip(&*jobs) {
        *slot = job.slot;
    }
    let mut values = [[Wide::zero(simd); 16]; 4];
    simd.vectorize(Gather {
        simd,
        blocks,
        slots,
        values: &mut values,
    });
    if MODES[mode].scalar_index_bits > 0 {
        let mut rotation = [0.0; MOST_LANES];
        for (rotation, job) in rotation.iter_mut().zip(&*jobs) {
            *rotation = f32::from(job.way.partition);
        }
        rotate(&mut values, Wide::load(simd, &rotation));
        let [grid, scalar_grid] = rotated_grids(mode, way.swapped_indices);
        let alone = Subset::whole(simd, &values[3..]);
        if visitor.visit::<1>(Part::Scalar, &alone, scalar_grid, jobs) {
            let rest = Subset::whole(simd, &values[..3]);
            visitor.visit::<3>(Part::Subset(0), &rest, grid, jobs);
        }
        return;
    }
    let count = MODES[mode].subsets;
    let partitions = jobs.iter().map(|job| usize::from(job.way.partition));
    let masks = subset_masks(count, partitions);
    let mut subset = Subset::whole(simd, &values);
    for (at, masks) in masks[..count].iter().enumerate() {
        if count > 1 {
            subset.choose(masks);
        }
        let part = Part::Subset(at);
        let goes_on = match (mode, alpha) {
            (6 | 7, Alpha::Varies) => visitor.visit::<4>(part, &subset, &GRIDS[mode], jobs),
            (6, Alpha::Opaque) => visitor.visit::<3>(part, &subset, &OPAQUE_WHOLE, jobs),
            _ => visitor.visit::<3>(part, &subset, &GRIDS[mode], jobs),
        };
        if !goes_on {
            return;
        }
    }
}

/// Puts the endpoints of a part, a job in each lane, into the jobs.
#[inline(always)]
pub(super) fn put_ends<S: Simd, const C: usize>(jobs: &mut [Job], part: Part, ends: &Ends<S>) {
    for end in 0..2 {
        let stored = &ends.stored[end];
        if let Part::Subset(at) = part {
            // Whole numbers below 2^24 are exact.
            let colors = stored[0] + stored[1] * 256.0 + stored[2] * 65536.0;
            let others = stored[3] + ends.parity[end] * 256.0;
            for (lane, job) in jobs.iter_mut().enumerate() {
                let [red, green, blue, _] = (colors.lane(lane) as u32).to_le_bytes();
                let [alpha, parity, ..] = (others.lane(lane) as u32).to_le_bytes();
                let kept = &mut job.ends[at][end];
                *kept = [red, green, blue, if C > 3 { alpha } else { kept[3] }];
                job.parity[at][end] = parity;
            }
        } else {
            for (job, value) in jobs.iter_mut().zip(stored[0].lanes()) {
                job.ends[0][end][3] = *value as u8;
            }
        }
    }
}

/// The endpoints of a part, those of one job in each lane.
#[inline(always)]
pub(super) fn get_ends<S: Simd>(simd: S, jobs: &[Job], part: Part) -> Ends<S> {
    let mut ends = Ends::none(simd);
    for end in 0..2 {
        let mut rows = [Words::ZERO; 3];
        for (lane, job) in jobs.iter().enumerate() {
            let (stored, parity) = match part {
                Part::Subset(at) => (job.ends[at][end], job.parity[at][end]),
                Part::Scalar => ([job.ends[0][end][3], 0, 0, 0], 0),
            };
            let pair = |a, b| u32::from(u16::from_le_bytes([a, b]));
            rows[0].0[lane] = pair(stored[0], stored[1]);
            rows[1].0[lane] = pair(stored[2], stored[3]);
            rows[2].0[lane] = u32::from(parity);
        }
        let [red, green] = rows[0].bytes(simd);
        let [blue, alpha] = rows[1].bytes(simd);
        ends.stored[end] = [red, green, blue, alpha];
        ends.parity[end] = rows[2].bytes(simd)[0];
    }
    ends
}
