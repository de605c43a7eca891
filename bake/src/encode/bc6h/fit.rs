//! Stored endpoints of several blocks: from lines, by least squares at the indices found, and by single steps.

use pulp::{Simd, WithSimd};

use super::super::wide::Wide;
use super::grid::Grid;
use super::texels::{Lines, Split, Texels};

/// Endpoints as stored, of the mode that each lane has.
#[derive(Clone, Copy)]
pub(super) struct Ends<S: Simd> {
    pub stored: Lines<S>,
    pub grid: Grid<S>,
}

/// The best way found for each lane.
#[derive(Clone, Copy)]
pub(super) struct Fit<S: Simd> {
    pub ends: Ends<S>,
    pub partition: Wide<S>,
    /// Of the second endpoint at each texel, 0 to 64.
    pub weights: [Wide<S>; 16],
    pub error: Wide<S>,
}

impl<S: Simd> Fit<S> {
    #[inline(always)]
    pub fn none<const R: usize>(simd: S) -> Self {
        let zero = Wide::zero(simd);
        let stored = [[[zero; 3]; 2]; 2];
        Self {
            ends: Ends {
                stored,
                grid: Grid::finest::<R>(simd, &stored),
            },
            partition: zero,
            weights: [zero; 16],
            error: Wide::splat(simd, f32::INFINITY),
        }
    }

    /// Takes the lanes in which another way's error is less; whether there are any.
    #[inline(always)]
    pub fn improve<const R: usize>(
        &mut self,
        ends: &Ends<S>,
        partition: Wide<S>,
        weights: &[Wide<S>; 16],
        error: Wide<S>,
    ) -> bool {
        let better = error.less(self.error);
        if !better.any() {
            return false;
        }
        self.error = better.select(error, self.error);
        self.partition = better.select(partition, self.partition);
        self.ends.grid = Grid::choose(better, &ends.grid, &self.ends.grid);
        for region in 0..R {
            for end in 0..2 {
                let stored = &mut self.ends.stored[region][end];
                *stored = better.select_all(ends.stored[region][end], *stored);
            }
        }
        for texel in 0..16 {
            self.weights[texel] = better.select(weights[texel], self.weights[texel]);
        }
        true
    }
}

/// Finds endpoints for `R` regions.
pub(super) struct FitRegions<'a, S: Simd, const R: usize> {
    pub texels: &'a Texels<S>,
    pub split: &'a Split<S>,
    /// Most rounds of least squares.
    pub rounds: u32,
    /// Most rounds of descent.
    pub polish: u32,
}

impl<S: Simd, const R: usize> FitRegions<'_, S, R> {
    /// The best found, out of line.
    #[inline(always)]
    pub fn run(self) -> Fit<S> {
        self.texels.simd.vectorize(self)
    }

    #[inline(always)]
    fn fit(&self) -> Fit<S> {
        let mut best = Fit::none::<R>(self.texels.simd);
        let lines = self.split.principal::<R>(self.texels);
        self.lines(lines, &mut best);
        for _ in 0..self.rounds {
            let lines = self.split.least_squares::<R>(self.texels, &best.weights);
            if !self.lines(lines, &mut best) {
                break;
            }
        }
        for _ in 0..self.polish {
            let lines = self.split.least_squares::<R>(self.texels, &best.weights);
            let fitted = self.lines(lines, &mut best);
            if !self.descend(&mut best) && !fitted {
                break;
            }
        }
        best
    }

    /// Measures lines, in the finest mode that holds them; whether any is better.
    #[inline(always)]
    fn lines(&self, lines: Lines<S>, best: &mut Fit<S>) -> bool {
        let mut points = lines;
        self.split.orient::<R>(self.texels, &mut points);
        let grid = Grid::finest::<R>(self.texels.simd, &points);
        for region in 0..R {
            for end in 0..2 {
                for channel in 0..3 {
                    points[region][end][channel] += self.texels.mean[channel];
                }
            }
        }
        let stored = grid.store::<R>(&points);
        self.measure(&Ends { stored, grid }, best)
    }

    /// Tries a step up and down of every stored component; whether any is better.
    #[inline(always)]
    fn descend(&self, best: &mut Fit<S>) -> bool {
        let mut better = false;
        for at in 0..6 * R {
            let from = best.ends;
            for step in [-1.0, 1.0] {
                let mut ends = from;
                let stored = &mut ends.stored[at / 6][at / 3 % 2][at % 3];
                *stored += stored.of(step);
                ends.grid.bound::<R>(&mut ends.stored);
                better |= self.measure(&ends, best);
            }
        }
        better
    }

    /// The squared error of endpoints at the nearest indices; kept where it is less than the best.
    #[inline(always)]
    fn measure(&self, ends: &Ends<S>, best: &mut Fit<S>) -> bool {
        let mut weights = [Wide::zero(self.texels.simd); 16];
        let error = Measure::<S, R> {
            texels: self.texels,
            split: self.split,
            ends,
            weights: &mut weights,
        }
        .run();
        best.improve::<R>(ends, self.split.partition, &weights, error)
    }
}

impl<S: Simd, const R: usize> WithSimd for FitRegions<'_, S, R> {
    type Output = Fit<S>;
    #[inline(always)]
    fn with_simd<T: Simd>(self, _: T) -> Fit<S> {
        self.fit()
    }
}

/// Measures endpoints: the error, and the weight of each texel.
pub(super) struct Measure<'a, S: Simd, const R: usize> {
    pub texels: &'a Texels<S>,
    pub split: &'a Split<S>,
    pub ends: &'a Ends<S>,
    pub weights: &'a mut [Wide<S>; 16],
}

impl<S: Simd, const R: usize> Measure<'_, S, R> {
    /// Out of line.
    #[inline(always)]
    pub fn run(self) -> Wide<S> {
        self.texels.simd.vectorize(self)
    }

    /// The decoder rounds to whole steps twice; that is left out, but for the mean of it.
    #[inline(always)]
    fn error(self) -> Wide<S> {
        let (texels, split) = (self.texels, self.split);
        let zero = Wide::zero(texels.simd);
        let steps = if R == 1 { 15.0 } else { 7.0 };
        // Of each region: first point, direction and offset of positions, and the way to the other point over 64.
        let (mut low, mut direction, mut unit) = ([[zero; 3]; 2], [[zero; 3]; 2], [[zero; 3]; 2]);
        let mut offset = [zero; 2];
        for region in 0..R {
            let mut square = zero;
            for channel in 0..3 {
                let [first, second] = self.ends.stored[region];
                let from = self.ends.grid.expand(first[channel]) - texels.mean[channel];
                let to = self.ends.grid.expand(second[channel]) - texels.mean[channel];
                low[region][channel] = from;
                direction[region][channel] = to - from;
                square += direction[region][channel] * direction[region][channel];
                offset[region] += direction[region][channel] * from;
            }
            let apart = zero.less(square);
            let scale = apart.select(square, square.of(1.0)).recip() * steps;
            offset[region] = zero - offset[region] * scale;
            for channel in 0..3 {
                unit[region][channel] = direction[region][channel] * (1.0 / 64.0);
                direction[region][channel] = direction[region][channel] * scale;
            }
        }
        let mut total = zero;
        for texel in 0..16 {
            let mut position = split.of::<R>(texel, offset);
            for channel in 0..3 {
                let along = split.of::<R>(texel, [direction[0][channel], direction[1][channel]]);
                position += texels.values[channel][texel] * along;
            }
            let limit = split.limit::<R>(texels.simd, texel);
            let index = position.max(zero).min(limit).round();
            // The weights of the specification are those of even spacing, rounded.
            let weight = (index * (64.0 / steps)).round();
            for channel in 0..3 {
                let from = split.of::<R>(texel, [low[0][channel], low[1][channel]]);
                let along = split.of::<R>(texel, [unit[0][channel], unit[1][channel]]);
                let off = from + weight * along - texels.values[channel][texel];
                total += off * off;
            }
            self.weights[texel] = weight;
        }
        total
    }
}

impl<S: Simd, const R: usize> WithSimd for Measure<'_, S, R> {
    type Output = Wide<S>;
    #[inline(always)]
    fn with_simd<T: Simd>(self, _: T) -> Wide<S> {
        self.error()
    }
}
