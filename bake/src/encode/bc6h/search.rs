//! Ways of storing each of several blocks: one region first, then two where that leaves much.

use pulp::{Simd, WithSimd};

use super::super::partition;
use super::super::wide::Wide;
use super::MOST_LANES;
use super::fit::{Fit, FitRegions};
use super::modes::{Fields, PARTITIONS};
use super::preset::Preset;
use super::texels::{Split, Sums, Texels};

/// One way of storing a block.
#[derive(Clone, Copy, Debug)]
pub(super) struct Choice {
    pub fields: Fields,
    /// Squared, over all texels and channels, in steps of half floats.
    pub error: f32,
}

impl Choice {
    pub const NONE: Self = Self {
        fields: Fields::NONE,
        error: f32::INFINITY,
    };
}

pub(super) type Found = [Choice; MOST_LANES];

/// What a lane of a fit found.
#[inline(always)]
fn choices<S: Simd, const R: usize>(fit: &Fit<S>) -> Found {
    let mut found = [Choice::NONE; MOST_LANES];
    for (lane, choice) in found.iter_mut().enumerate().take(S::F32_LANES) {
        choice.error = fit.error.lane(lane);
        let fields = &mut choice.fields;
        fields.mode = fit.ends.grid.mode.lane(lane) as usize;
        fields.partition = fit.partition.lane(lane) as usize;
        for region in 0..R {
            for end in 0..2 {
                for channel in 0..3 {
                    let stored = fit.ends.stored[region][end][channel].lane(lane);
                    fields.ends[region][end][channel] = stored as i32;
                }
            }
        }
        let steps = if R == 1 { 15.0 } else { 7.0 };
        for texel in 0..16 {
            let index = fit.weights[texel].lane(lane) * (steps / 64.0) + 0.5;
            fields.indices[texel] = index as u8;
        }
    }
    found
}

/// Blocks in one region, no more than there are lanes.
pub(super) struct Whole<'a> {
    pub blocks: &'a [[[u16; 3]; 16]],
    pub preset: &'a Preset,
}

impl WithSimd for Whole<'_> {
    type Output = Found;
    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> Found {
        let texels = Texels::load(simd, self.blocks.iter());
        let fit = FitRegions::<S, 1> {
            texels: &texels,
            split: &Split::whole(simd),
            rounds: self.preset.whole,
            polish: self.preset.polish,
        };
        choices::<S, 1>(&fit.run())
    }
}

/// Blocks in two regions, no more than there are lanes.
pub(super) struct Parts<'a> {
    pub blocks: &'a [[[u16; 3]; 16]],
    pub slots: &'a [usize],
    pub preset: &'a Preset,
}

impl WithSimd for Parts<'_> {
    type Output = Found;
    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> Found {
        let texels = Texels::load(simd, self.slots.iter().map(|slot| &self.blocks[*slot]));
        let mut ways = Rank {
            texels: &texels,
            count: self.preset.partitions,
        }
        .run();
        if self.preset.finished < ways.count {
            let mut finished = Ranking::new(simd, self.preset.finished);
            for at in 0..ways.count {
                let way = ways.ways[at];
                finished.add(in_two(&texels, way, 0, 0).error, way);
            }
            ways = finished;
        }
        let mut best = Fit::none::<2>(simd);
        for at in 0..ways.count {
            let found = in_two(
                &texels,
                ways.ways[at],
                self.preset.parts,
                self.preset.polish,
            );
            best.improve::<2>(&found.ends, found.partition, &found.weights, found.error);
        }
        choices::<S, 2>(&best)
    }
}

/// Fits two regions, by a partition a lane.
#[inline(always)]
fn in_two<S: Simd>(texels: &Texels<S>, way: Wide<S>, rounds: u32, polish: u32) -> Fit<S> {
    FitRegions::<S, 2> {
        texels,
        split: &Split::new(texels.simd, way),
        rounds,
        polish,
    }
    .run()
}

/// Ways and their errors, best first, in lanes.
#[derive(Clone, Copy)]
struct Ranking<S: Simd> {
    errors: [Wide<S>; PARTITIONS],
    ways: [Wide<S>; PARTITIONS],
    count: usize,
}

impl<S: Simd> Ranking<S> {
    #[inline(always)]
    fn new(simd: S, count: usize) -> Self {
        Self {
            errors: [Wide::splat(simd, f32::INFINITY); PARTITIONS],
            ways: [Wide::zero(simd); PARTITIONS],
            count: count.min(PARTITIONS),
        }
    }

    /// Earlier ways stay before later ones of the same error.
    #[inline(always)]
    fn add(&mut self, error: Wide<S>, way: Wide<S>) {
        let (mut error, mut way) = (error, way);
        for at in 0..self.count {
            let (kept, other) = (self.errors[at], self.ways[at]);
            let less = error.less(kept);
            self.errors[at] = less.select(error, kept);
            self.ways[at] = less.select(way, other);
            error = less.select(kept, error);
            way = less.select(other, way);
        }
    }
}

/// Ranks the partitions by what is off the principal axes of their regions, and the share of what is along them
/// that the spacing of the indices leaves: with evenly spread values, `1 / 7^2`.
struct Rank<'a, S: Simd> {
    texels: &'a Texels<S>,
    count: usize,
}

impl<S: Simd> Rank<'_, S> {
    /// Out of line.
    #[inline(always)]
    fn run(self) -> Ranking<S> {
        self.texels.simd.vectorize(self)
    }
}

impl<S: Simd> WithSimd for Rank<'_, S> {
    type Output = Ranking<S>;
    #[inline(always)]
    fn with_simd<T: Simd>(self, _: T) -> Ranking<S> {
        let texels = self.texels;
        let mut ranking = Ranking::new(texels.simd, self.count);
        for way in 0..PARTITIONS {
            let mask = partition::masks(2, way)[1];
            let mut second = Sums::none(texels.simd);
            second.count = second.count.of(mask.count_ones() as f32);
            let mut rest = mask;
            while rest != 0 {
                let texel = (rest.trailing_zeros() & 15) as usize;
                rest &= rest - 1;
                for at in 0..3 {
                    second.first[at] += texels.values[at][texel];
                }
                for at in 0..6 {
                    second.second[at] += texels.products[at][texel];
                }
            }
            let first = texels.total.less(&second);
            let error = estimate(&first) + estimate(&second);
            ranking.add(error, error.of(way as f32));
        }
        ranking
    }
}

/// The largest eigenvalue of the scatter is the fourth root of the trace of its fourth power, nearly: from above, and
/// the more exact the more it dominates.
#[inline(always)]
fn estimate<S: Simd>(sums: &Sums<S>) -> Wide<S> {
    let (scatter, trace) = sums.scatter();
    let zero = trace.of(0.0);
    let all = trace + trace.of(1e-3);
    let scale = all.recip();
    let mut fourth = zero;
    for a in 0..3 {
        for b in 0..=a {
            let mut square = zero;
            for k in 0..3 {
                square += scatter[a][k] * scale * (scatter[k][b] * scale);
            }
            let square = square * square;
            fourth += if a == b { square } else { square + square };
        }
    }
    let along = fourth.sqrt().sqrt().min(zero.of(1.0)) * all;
    // The endpoints meet two texels.
    let between = along * (zero.of(1.0) - sums.count.recip() * 2.0);
    all - along + between * (1.0 / 49.0)
}
