//! Ways of storing each of several blocks, side by side.

use pulp::{Simd, WithSimd};

use super::choice::{Choice, GRIDS, OPAQUE_WHOLE, rotated_grids};
use super::estimate::{Products, RankPartitions, Ranking};
use super::fit::{Effort, Fit, FitSubset, Grid, Subset};
use super::modes::MODES;
use super::partition;
use super::preset::Preset;
use super::wide::Wide;

/// Most blocks side by side.
pub(super) const MOST_LANES: usize = 16;
/// Most ways of a block that are kept.
pub(super) const MOST_KEPT: usize = 4;

/// The ways kept of each block, best first; those beyond the preset's number have an infinite error.
pub(super) type Found = [[Choice; MOST_KEPT]; MOST_LANES];

/// Of the fits that only rank partitions.
const SHORT: Effort = Effort {
    rounds: 0,
    parities: false,
    insets: &[],
};

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

/// Finds a choice for each block, `MOST_LANES` at most and no more than there are lanes.
pub(super) struct Blocks<'a> {
    pub texels: &'a [[[u8; 4]; 16]],
    pub alpha: Alpha,
    pub preset: &'a Preset,
}

impl Blocks<'_> {
    #[inline(always)]
    pub fn search<S: Simd>(self, simd: S) -> Found {
        let mut values = [[Wide::zero(simd); 16]; 4];
        for (channel, values) in values.iter_mut().enumerate() {
            for (texel, value) in values.iter_mut().enumerate() {
                let mut lanes = [0.0; MOST_LANES];
                for (lane, block) in lanes.iter_mut().zip(self.texels) {
                    *lane = f32::from(block[texel][channel]);
                }
                *value = Wide::load(simd, &lanes[..S::F32_LANES]);
            }
        }
        let mut search = Search {
            simd,
            whole: Subset::whole(simd, &values),
            alpha: self.alpha,
            opaque: self.alpha != Alpha::Varies,
            preset: self.preset,
            limit: Wide::splat(simd, f32::INFINITY),
            error: Wide::splat(simd, f32::INFINITY),
            best: [[Choice::NONE; MOST_KEPT]; MOST_LANES],
        };
        search.search();
        search.best
    }
}

struct Search<'a, S: Simd> {
    simd: S,
    whole: Subset<'a, S>,
    alpha: Alpha,
    opaque: bool,
    preset: &'a Preset,
    /// Of the last of the ways kept.
    limit: Wide<S>,
    /// Of the first.
    error: Wide<S>,
    best: Found,
}

impl<'a, S: Simd> Search<'a, S> {
    /// All modes that the preset has for such blocks; alpha excludes modes 0 to 3, opacity mode 7.
    #[inline(always)]
    fn search(&mut self) {
        match self.alpha {
            Alpha::Varies => self.whole::<4>(&GRIDS[6]),
            Alpha::Opaque => self.whole::<3>(&OPAQUE_WHOLE),
            Alpha::Ignored => self.whole::<3>(&GRIDS[6]),
        }
        let [zero, one, two, three, seven] = self.preset.partitions;
        let rotations = self.preset.rotations[usize::from(self.opaque)];
        let unsolved = Wide::zero(self.simd).less(self.error);
        if !unsolved.any() || zero + one + two + three + seven + rotations == 0 {
            return;
        }
        let products = Products::new(self.simd, self.whole.values);
        if self.opaque {
            let [for_one, for_three] = RankPartitions::<S, 3> {
                products: &products,
                subsets: 2,
                partitions: [64, 64],
                steps: [7.0, 3.0],
                counts: [one, three],
            }
            .run();
            self.partitioned::<3>(1, &for_one);
            self.partitioned::<3>(3, &for_three);
        }
        self.rotated(&products, rotations);
        if self.opaque && zero + two > 0 {
            let [for_zero, for_two] = RankPartitions::<S, 3> {
                products: &products,
                subsets: 3,
                partitions: [16, 64],
                steps: [7.0, 3.0],
                counts: [zero, two],
            }
            .run();
            self.partitioned::<3>(0, &for_zero);
            self.partitioned::<3>(2, &for_two);
        }
        if !self.opaque && seven > 0 {
            let [ranking, _] = RankPartitions::<S, 4> {
                products: &products,
                subsets: 2,
                partitions: [64, 64],
                steps: [3.0, 3.0],
                counts: [seven, 0],
            }
            .run();
            self.partitioned::<4>(7, &ranking);
        }
    }

    /// Mode 6.
    #[inline(always)]
    fn whole<const C: usize>(&mut self, grid: &Grid) {
        let fit = self.fit::<C>(&self.whole, grid, self.preset.whole);
        self.take(fit.error, |lane| Choice::NONE.subset(0, &fit, lane));
    }

    #[inline(always)]
    fn fit<const C: usize>(&self, subset: &Subset<'_, S>, grid: &Grid, effort: Effort) -> Fit<S> {
        FitSubset::<S, C> {
            subset,
            grid,
            effort,
        }
        .run()
    }

    /// Keeps ways whose error is less than that of the last one kept.
    #[inline(always)]
    fn take(&mut self, error: Wide<S>, choice: impl Fn(usize) -> Choice) {
        if !error.less(self.limit).any() {
            return;
        }
        let kept = self.preset.kept;
        let mut limits = [0.0; MOST_LANES];
        for lane in 0..S::F32_LANES {
            let (error, best) = (error.lane(lane), &mut self.best[lane]);
            if error < best[kept - 1].error {
                let mut at = kept - 1;
                while at > 0 && error < best[at - 1].error {
                    best[at] = best[at - 1];
                    at -= 1;
                }
                best[at] = choice(lane);
                best[at].error = error;
            }
            limits[lane] = best[kept - 1].error;
        }
        self.limit = Wide::load(self.simd, &limits[..S::F32_LANES]);
        self.error = error.min(self.error);
    }

    /// Modes 0 to 3 and 7: the partitions of least estimated error are fitted in short, the best of those in full.
    /// Estimates are of evenly spread values, so that none is too bad to be tried: few values may fit exactly.
    #[inline(always)]
    fn partitioned<const C: usize>(&mut self, mode: usize, ranking: &Ranking<S>) {
        let most = self.preset.finished.min(ranking.count);
        let mut finished = *ranking;
        if most < ranking.count {
            finished = Ranking::new(self.simd, most);
            for at in 0..ranking.count {
                let (subsets, _) = self.subsets(mode, ranking.ways[at]);
                let mut error = Wide::zero(self.simd);
                for subset in &subsets[..MODES[mode].subsets] {
                    error += self.fit::<C>(subset, &GRIDS[mode], SHORT).error;
                }
                finished.add(error, ranking.ways[at]);
            }
        }
        for at in 0..finished.count {
            self.partition::<C>(mode, finished.ways[at]);
        }
    }

    /// The subsets of each lane's partition, and its number.
    #[inline(always)]
    fn subsets(&self, mode: usize, ways: Wide<S>) -> ([Subset<'a, S>; 3], [usize; MOST_LANES]) {
        let count = MODES[mode].subsets;
        let mut partitions = [0_usize; MOST_LANES];
        let mut words = [[1_u32; MOST_LANES]; 3];
        for lane in 0..S::F32_LANES {
            partitions[lane] = ways.lane(lane) as usize;
            let masks = partition::masks(count, partitions[lane]);
            for subset in 0..count {
                words[subset][lane] = u32::from(masks[subset]);
            }
        }
        let mut subsets = [self.whole; 3];
        for subset in 0..count {
            subsets[subset].choose(&words[subset][..S::F32_LANES]);
        }
        (subsets, partitions)
    }

    /// One partition a lane. What a lane gets does not depend on its neighbours.
    #[inline(always)]
    fn partition<const C: usize>(&mut self, mode: usize, ways: Wide<S>) {
        let count = MODES[mode].subsets;
        let (subsets, partitions) = self.subsets(mode, ways);
        let mut fits = [Fit::none(self.simd); 3];
        let mut error = Wide::zero(self.simd);
        for at in 0..count {
            fits[at] = self.fit::<C>(&subsets[at], &GRIDS[mode], self.preset.parts);
            error += fits[at].error;
            if !error.less(self.limit).any() {
                return;
            }
        }
        self.take(error, |lane| {
            let mut choice = Choice {
                mode,
                partition: partitions[lane],
                ..Choice::NONE
            };
            for at in 0..count {
                choice = choice.subset(at, &fits[at], lane);
            }
            choice
        });
    }

    /// Modes 5 and 4, for the rotations of least estimated error.
    #[inline(always)]
    fn rotated(&mut self, products: &Products<S>, most: usize) {
        if most == 0 {
            return;
        }
        self.rotations(5, false, products, most);
        if self.preset.fourth[usize::from(self.opaque)] {
            self.rotations(4, false, products, most);
            self.rotations(4, true, products, most);
        }
    }

    #[inline(always)]
    fn rotations(
        &mut self,
        mode: usize,
        swapped_indices: bool,
        products: &Products<S>,
        most: usize,
    ) {
        let [grid, scalar_grid] = rotated_grids(mode, swapped_indices);
        let ranking = products.rotations(grid.steps, scalar_grid.steps, most);
        for at in 0..ranking.count.min(4) {
            let rotation = ranking.ways[at];
            let mut values = *self.whole.values;
            for channel in 0..3 {
                let half = rotation.of(0.25);
                let number = rotation.of(channel as f32 + 1.0);
                let off = (rotation - number) * (rotation - number);
                let swapped = off.less(half);
                for texel in 0..16 {
                    let (own, alpha) = (values[channel][texel], values[3][texel]);
                    values[channel][texel] = swapped.select(alpha, own);
                    values[3][texel] = swapped.select(own, alpha);
                }
            }
            let mut scalars = values;
            scalars[0] = values[3];
            let texels = Subset::whole(self.simd, &values);
            let alone = Subset::whole(self.simd, &scalars);
            let scalar = self.fit::<1>(&alone, scalar_grid, self.preset.parts);
            if !scalar.error.less(self.limit).any() {
                continue;
            }
            let vector = self.fit::<3>(&texels, grid, self.preset.parts);
            let error = vector.error + scalar.error;
            self.take(error, |lane| {
                let [low, high] = &scalar.ends.stored;
                let choice = Choice {
                    mode,
                    rotation: rotation.lane(lane) as usize,
                    swapped_indices,
                    scalar: [low[0].lane(lane), high[0].lane(lane)],
                    ..Choice::NONE
                };
                choice.subset(0, &vector, lane)
            });
        }
    }
}

impl WithSimd for Blocks<'_> {
    type Output = Found;
    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> Found {
        self.search(simd)
    }
}
