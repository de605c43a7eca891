//! The squared error of endpoints at the nearest indices, and the sums that better endpoints follow from.

use pulp::{Simd, WithSimd};

use super::grid::Grid;
use super::texels::Subset;
use super::wide::Wide;

/// Stored endpoints.
#[derive(Clone, Copy, Debug)]
pub(super) struct Ends<S: Simd> {
    /// `[end][channel]`.
    pub stored: [[Wide<S>; 4]; 2],
    pub parity: [Wide<S>; 2],
}

impl<S: Simd> Ends<S> {
    #[inline(always)]
    pub fn none(simd: S) -> Self {
        let zero = Wide::zero(simd);
        Self {
            stored: [[zero; 4]; 2],
            parity: [zero; 2],
        }
    }

    /// As the decoder has them.
    #[inline(always)]
    pub fn expand<const C: usize>(&self, grid: &Grid) -> [[Wide<S>; C]; 2] {
        let mut ends = [[self.parity[0]; C]; 2];
        for end in 0..2 {
            for channel in 0..C {
                ends[end][channel] = grid.expand(self.stored[end][channel], self.parity[end]);
            }
        }
        ends
    }
}

/// Sums over the texels of a subset, at their share `w` of the second endpoint: of `w`, `w^2`, and `w` times each value.
#[derive(Clone, Copy, Debug)]
pub(super) struct Shares<S: Simd> {
    pub first: Wide<S>,
    pub second: Wide<S>,
    pub values: [Wide<S>; 4],
}

impl<S: Simd> Shares<S> {
    #[inline(always)]
    pub fn none(simd: S) -> Self {
        let zero = Wide::zero(simd);
        Self {
            first: zero,
            second: zero,
            values: [zero; 4],
        }
    }

    #[inline(always)]
    fn add<const C: usize>(&mut self, subset: &Subset<'_, S>, texel: usize, weight: Wide<S>) {
        let share = weight * subset.inside[texel] * (1.0 / 64.0);
        self.first += share;
        self.second += share * share;
        for channel in 0..C {
            self.values[channel] += share * subset.values[channel][texel];
        }
    }
}

/// Where texels are along the line between two endpoints.
struct Line<S: Simd, const C: usize> {
    along: [Wide<S>; C],
    direction: [Wide<S>; C],
    offset: Wide<S>,
    steps: f32,
}

impl<S: Simd, const C: usize> Line<S, C> {
    #[inline(always)]
    fn new([low, high]: &[[Wide<S>; C]; 2], steps: f32) -> Self {
        let zero = low[0].of(0.0);
        let mut along = [zero; C];
        let (mut square, mut offset) = (zero, zero);
        for channel in 0..C {
            along[channel] = high[channel] - low[channel];
            square += along[channel] * along[channel];
            offset += along[channel] * low[channel];
        }
        let apart = zero.less(square);
        let scale = apart.select(square, zero.of(1.0)).recip() * steps;
        let mut direction = along;
        for value in &mut direction {
            *value = *value * scale;
        }
        Self {
            along,
            direction,
            offset: zero - offset * scale,
            steps,
        }
    }

    /// The nearest index.
    #[inline(always)]
    fn index(&self, subset: &Subset<'_, S>, texel: usize) -> Wide<S> {
        let mut position = self.offset;
        for channel in 0..C {
            position += subset.values[channel][texel] * self.direction[channel];
        }
        position.clamp(0.0, self.steps).round()
    }

    /// Its weight: those of the specification are of even spacing, rounded.
    #[inline(always)]
    fn weight(&self, index: Wide<S>) -> Wide<S> {
        (index * (64.0 / self.steps)).round()
    }
}

/// The sums at the indices nearest to endpoints that need not be stored ones.
#[inline(always)]
pub(super) fn shares<S: Simd, const C: usize>(
    subset: &Subset<'_, S>,
    ends: &[[Wide<S>; C]; 2],
    steps: f32,
) -> Shares<S> {
    let line = Line::new(ends, steps);
    let mut shares = Shares::none(subset.simd);
    for texel in 0..16 {
        let weight = line.weight(line.index(subset, texel));
        shares.add::<C>(subset, texel, weight);
    }
    shares
}

/// The error of endpoints, and their sums if they are `wanted`.
///
/// Interpolates as the decoder does: `((64 - w) low + w high + 32) >> 6`.
#[inline(always)]
pub(super) fn measure<S: Simd, const C: usize>(
    subset: &Subset<'_, S>,
    ends: &[[Wide<S>; C]; 2],
    steps: f32,
    wanted: bool,
) -> (Wide<S>, Shares<S>) {
    let simd = subset.simd;
    let line = Line::new(ends, steps);
    let (mut low, mut unit) = (ends[0], line.along);
    for channel in 0..C {
        // Sums are multiples of 1/64, so that a quarter of that makes halves round up.
        low[channel] += Wide::splat(simd, 1.0 / 256.0);
        unit[channel] = unit[channel] * (1.0 / 64.0);
    }
    let mut shares = Shares::none(simd);
    let mut total = Wide::zero(simd);
    for texel in 0..16 {
        let weight = line.weight(line.index(subset, texel));
        let mut error = Wide::zero(simd);
        for channel in 0..C {
            let level = low[channel] + weight * unit[channel];
            let off = level.round() - subset.values[channel][texel];
            error += off * off;
        }
        total += error * subset.inside[texel];
        if wanted {
            shares.add::<C>(subset, texel, weight);
        }
    }
    (total, shares)
}

/// Measures endpoints out of line: the error only.
pub(super) struct Measure<'a, S: Simd, const C: usize> {
    pub subset: &'a Subset<'a, S>,
    pub grid: &'a Grid,
    pub ends: &'a Ends<S>,
}

impl<S: Simd, const C: usize> Measure<'_, S, C> {
    #[inline(always)]
    pub fn run(self) -> Wide<S> {
        self.subset.simd.vectorize(self)
    }
}

impl<S: Simd, const C: usize> WithSimd for Measure<'_, S, C> {
    type Output = Wide<S>;
    #[inline(always)]
    fn with_simd<T: Simd>(self, _: T) -> Wide<S> {
        let ends = self.ends.expand::<C>(self.grid);
        measure(self.subset, &ends, self.grid.steps, false).0
    }
}

/// The indices of texels, four to a number: the first in the lowest four bits. 0 outside of the subset.
pub(super) struct Indices<'a, S: Simd, const C: usize> {
    pub subset: &'a Subset<'a, S>,
    pub grid: &'a Grid,
    pub ends: &'a Ends<S>,
}

impl<S: Simd, const C: usize> Indices<'_, S, C> {
    /// Out of line.
    #[inline(always)]
    pub fn run(self) -> [Wide<S>; 4] {
        self.subset.simd.vectorize(self)
    }
}

impl<S: Simd, const C: usize> WithSimd for Indices<'_, S, C> {
    type Output = [Wide<S>; 4];
    #[inline(always)]
    fn with_simd<T: Simd>(self, _: T) -> [Wide<S>; 4] {
        let line = Line::new(&self.ends.expand::<C>(self.grid), self.grid.steps);
        let mut rows = [Wide::zero(self.subset.simd); 4];
        for texel in (0..16).rev() {
            let index = line.index(self.subset, texel) * self.subset.inside[texel];
            rows[texel / 4] = rows[texel / 4] * 16.0 + index;
        }
        rows
    }
}
