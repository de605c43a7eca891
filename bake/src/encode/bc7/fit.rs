//! Endpoints of one subset of several blocks: the principal axis first, then least squares at the indices found.

use pulp::{Simd, WithSimd};

use super::grid::Grid;
use super::measure::{Ends, Measure, Shares, measure, shares};
use super::round::best_ends;
use super::texels::Subset;
use super::wide::{Wide, round};

/// How hard a fit tries.
#[derive(Clone, Copy, Debug)]
pub(super) struct Effort {
    /// Most rounds of least squares, at least one.
    pub rounds: u32,
    /// Whether every choice of parity bits is measured, not only the one that promises most.
    pub parities: bool,
    /// Further starts: shares of the extent by which the extremes are moved inwards.
    pub insets: &'static [f32],
    /// Whether subsets of nearly one colour are tried at a level between the endpoints.
    pub level: bool,
}

/// The best endpoints found for a subset.
#[derive(Clone, Copy, Debug)]
pub(super) struct Fit<S: Simd> {
    pub ends: Ends<S>,
    pub error: Wide<S>,
    shares: Shares<S>,
}

impl<S: Simd> Fit<S> {
    #[inline(always)]
    pub fn none(simd: S) -> Self {
        Self {
            ends: Ends::none(simd),
            error: Wide::splat(simd, f32::INFINITY),
            shares: Shares::none(simd),
        }
    }

    /// Takes the lanes in which the other's error is less; whether there are any.
    #[inline(always)]
    fn improve<const C: usize>(&mut self, ends: &Ends<S>, error: Wide<S>) -> bool {
        let better = error.less(self.error);
        if !better.any() {
            return false;
        }
        self.error = error.min(self.error);
        for end in 0..2 {
            for channel in 0..C {
                let stored = &mut self.ends.stored[end][channel];
                *stored = better.select(ends.stored[end][channel], *stored);
            }
            self.ends.parity[end] = better.select(ends.parity[end], self.ends.parity[end]);
        }
        true
    }

    #[inline(always)]
    fn improve_all<const C: usize>(&mut self, other: &Self) -> bool {
        let better = other.error.less(self.error);
        if !self.improve::<C>(&other.ends, other.error) {
            return false;
        }
        let (own, shares) = (&mut self.shares, &other.shares);
        own.first = better.select(shares.first, own.first);
        own.second = better.select(shares.second, own.second);
        for channel in 0..C {
            own.values[channel] = better.select(shares.values[channel], own.values[channel]);
        }
        true
    }
}

/// Fits the first `C` channels of a subset.
pub(super) struct FitSubset<'a, S: Simd, const C: usize> {
    pub subset: &'a Subset<'a, S>,
    pub grid: &'a Grid,
    pub effort: Effort,
}

impl<S: Simd, const C: usize> FitSubset<'_, S, C> {
    /// The best found, out of line.
    #[inline(always)]
    pub fn run(self) -> Fit<S> {
        self.subset.simd.vectorize(self)
    }
}

impl<S: Simd, const C: usize> WithSimd for FitSubset<'_, S, C> {
    type Output = Fit<S>;
    #[inline(always)]
    fn with_simd<T: Simd>(self, _: T) -> Fit<S> {
        Search::<S, C>::new(self.subset, self.grid).fit(self.effort)
    }
}

/// Descends from the endpoints of `best`, which are measured first.
pub(super) struct Polish<'a, S: Simd, const C: usize> {
    pub subset: &'a Subset<'a, S>,
    pub grid: &'a Grid,
    /// Another fit.
    pub again: Option<Effort>,
    /// Most rounds of least squares.
    pub rounds: u32,
    /// Most rounds over single steps of the endpoints.
    pub descents: u32,
    /// Whether both ends of a channel are stepped at once, too.
    pub pairs: bool,
    pub best: &'a mut Fit<S>,
}

impl<S: Simd, const C: usize> Polish<'_, S, C> {
    /// Out of line.
    #[inline(always)]
    pub fn run(self) {
        self.subset.simd.vectorize(self);
    }

    #[inline(always)]
    fn polish(self) {
        let search = Search::<S, C>::new(self.subset, self.grid);
        let ends = self.best.ends.expand::<C>(self.grid);
        (self.best.error, self.best.shares) = measure(self.subset, &ends, self.grid.steps, true);
        search.refine(self.rounds, self.best);
        if let Some(effort) = self.again {
            self.best.improve_all::<C>(&search.fit(effort));
        }
        if self.descents > 0 {
            search.each_parity(self.best);
        }
        for _ in 0..self.descents {
            // All rounds, for a lane must not get more of them where its neighbours need them.
            search.descend(self.best);
            if self.pairs {
                search.descend_pairs(self.best);
            }
            let ends = self.best.ends.expand::<C>(self.grid);
            self.best.shares = measure(self.subset, &ends, self.grid.steps, true).1;
            search.each_parity(self.best);
        }
    }
}

impl<S: Simd, const C: usize> WithSimd for Polish<'_, S, C> {
    type Output = ();
    #[inline(always)]
    fn with_simd<T: Simd>(self, _: T) {
        self.polish();
    }
}

struct Search<'a, S: Simd, const C: usize> {
    subset: &'a Subset<'a, S>,
    grid: &'a Grid,
    sum: [Wide<S>; C],
}

impl<'a, S: Simd, const C: usize> Search<'a, S, C> {
    #[inline(always)]
    fn new(subset: &'a Subset<'a, S>, grid: &'a Grid) -> Self {
        let mut sum = [Wide::zero(subset.simd); C];
        for texel in 0..16 {
            for channel in 0..C {
                sum[channel] += subset.values[channel][texel] * subset.inside[texel];
            }
        }
        Self { subset, grid, sum }
    }

    #[inline(always)]
    fn fit(&self, effort: Effort) -> Fit<S> {
        let (ends, scatter) = self.principal_ends();
        let mut best = self.start(&ends, effort);
        for &inset in effort.insets {
            let mut moved = ends;
            for channel in 0..C {
                let [low, high] = [ends[0][channel], ends[1][channel]];
                let step = (high - low) * inset;
                moved[0][channel] = low + step;
                moved[1][channel] = high - step;
            }
            let other = self.start(&moved, effort);
            best.improve_all::<C>(&other);
        }
        if effort.level && scatter.less(best.error).any() {
            self.one_level(scatter, &mut best);
        }
        best
    }

    /// The best of some rounds from endpoints that need not be stored ones.
    #[inline(always)]
    fn start(&self, ends: &[[Wide<S>; C]; 2], effort: Effort) -> Fit<S> {
        let mut best = Fit::none(self.subset.simd);
        best.shares = shares(self.subset, ends, self.grid.steps);
        if effort.parities {
            self.each_parity(&mut best);
        }
        self.refine(effort.rounds, &mut best);
        best
    }

    /// Least squares at the indices of the best, again and again while that helps.
    #[inline(always)]
    fn refine(&self, rounds: u32, best: &mut Fit<S>) {
        for round in 1..=rounds {
            let ends = self.best_ends(self.grid.parities, best);
            let expanded = ends.expand::<C>(self.grid);
            let again = round < rounds;
            let (error, shares) = measure(self.subset, &expanded, self.grid.steps, again);
            let better = match again {
                true => best.improve_all::<C>(&Fit {
                    ends,
                    error,
                    shares,
                }),
                false => best.improve::<C>(&ends, error),
            };
            if !better {
                return;
            }
        }
    }

    #[inline(always)]
    fn best_ends(&self, parities: &[[usize; 2]], best: &Fit<S>) -> Ends<S> {
        let count = self.subset.count;
        best_ends(self.grid, parities, count, &self.sum, &best.shares)
    }

    /// Least squares at the indices of the best with each choice of parity bits.
    #[inline(always)]
    fn each_parity(&self, best: &mut Fit<S>) {
        for parity in self.grid.parities {
            let ends = self.best_ends(std::slice::from_ref(parity), best);
            let expanded = ends.expand::<C>(self.grid);
            let (error, shares) = measure(self.subset, &expanded, self.grid.steps, true);
            best.improve_all::<C>(&Fit {
                ends,
                error,
                shares,
            });
        }
    }

    #[inline(always)]
    fn measure(&self, ends: &Ends<S>) -> Wide<S> {
        Measure::<S, C> {
            subset: self.subset,
            grid: self.grid,
            ends,
        }
        .run()
    }

    /// Tries endpoints that have the mean at one of the levels between them, where it can be nearer than any
    /// endpoint; lanes whose scatter is not below their error gain nothing from it.
    #[inline(always)]
    fn one_level(&self, scatter: Wide<S>, best: &mut Fit<S>) {
        let (grid, simd) = (self.grid, self.subset.simd);
        let inverse = self.subset.count.recip();
        let share = round((grid.steps / 3.0).floor() * 64.0 / grid.steps) / 64.0;
        for &parity in grid.parities {
            let mut ends = Ends::none(simd);
            let [low_bit, high_bit] = parity.map(|bit| bit as f32);
            let low_parity = Wide::splat(simd, low_bit);
            let high_parity = Wide::splat(simd, high_bit);
            ends.parity = [low_parity, high_parity];
            for channel in 0..C {
                let mean = self.sum[channel] * inverse;
                let middle = grid.store(mean, low_bit);
                let mut least = Wide::splat(simd, f32::INFINITY);
                for step in [0.0, -1.0, 1.0, -2.0, 2.0] {
                    let low = (middle + Wide::splat(simd, step)).clamp(0.0, grid.top);
                    let from = grid.expand(low, low_parity);
                    let high = grid.store(from + (mean - from) * (1.0 / share), high_bit);
                    let along = grid.expand(high, high_parity) - from;
                    let level = (from + along * share + Wide::splat(simd, 1.0 / 256.0)).round();
                    let off = (level - mean) * (level - mean);
                    let nearer = off.less(least);
                    let [from, to] = &mut ends.stored;
                    from[channel] = nearer.select(low, from[channel]);
                    to[channel] = nearer.select(high, to[channel]);
                    least = off.min(least);
                }
            }
            let error = self.measure(&ends);
            // Whatever the neighbours made this lane try, it takes only what it would have tried alone.
            let wanted = scatter.less(best.error);
            best.improve::<C>(&ends, wanted.select(error, best.error));
        }
    }

    /// Tries a step up and down of every stored component, and of all of an end.
    #[inline(always)]
    fn descend(&self, best: &mut Fit<S>) {
        let ways = if C > 1 { C + 1 } else { C };
        for end in 0..2 {
            for way in 0..ways {
                let from = best.ends;
                for step in [-1.0, 1.0] {
                    let mut ends = from;
                    for channel in 0..C {
                        if way == channel || way == C {
                            let stored = &mut ends.stored[end][channel];
                            *stored = (*stored + stored.of(step)).clamp(0.0, self.grid.top);
                        }
                    }
                    let error = self.measure(&ends);
                    best.improve::<C>(&ends, error);
                }
            }
        }
    }

    /// Tries steps of both ends of a channel at once.
    #[inline(always)]
    fn descend_pairs(&self, best: &mut Fit<S>) {
        for channel in 0..C {
            let from = best.ends;
            for steps in [[-1.0, -1.0], [1.0, 1.0], [-1.0, 1.0], [1.0, -1.0]] {
                let mut ends = from;
                for end in 0..2 {
                    let stored = &mut ends.stored[end][channel];
                    *stored = (*stored + stored.of(steps[end])).clamp(0.0, self.grid.top);
                }
                let error = self.measure(&ends);
                best.improve::<C>(&ends, error);
            }
        }
    }

    /// The extremes of the texels along their principal axis, and their squared distances from the mean.
    #[inline(always)]
    fn principal_ends(&self) -> ([[Wide<S>; C]; 2], Wide<S>) {
        let (subset, simd) = (self.subset, self.subset.simd);
        let zero = Wide::zero(simd);
        let inverse = subset.count.recip();
        let mut mean = self.sum;
        for value in &mut mean {
            *value = *value * inverse;
        }
        let mut rows = [[zero; C]; C];
        for texel in 0..16 {
            let mut off = [zero; C];
            for channel in 0..C {
                off[channel] = subset.values[channel][texel] - mean[channel];
            }
            for a in 0..C {
                let weighted = off[a] * subset.inside[texel];
                for b in 0..=a {
                    rows[a][b] += weighted * off[b];
                }
            }
        }
        let mut scatter = zero;
        for a in 0..C {
            for b in 0..a {
                rows[b][a] = rows[a][b];
            }
            scatter += rows[a][a];
        }
        let axis = principal_axis::<S, C>(&rows, scatter);
        let mut square = zero;
        for value in axis {
            square += value * value;
        }
        let apart = zero.less(square);
        let scale = apart.select(square, Wide::splat(simd, 1.0)).recip();
        let mut direction = axis;
        for value in &mut direction {
            *value = *value * scale;
        }
        // Texels outside of the subset count as the mean.
        let (mut least, mut most) = (zero, zero);
        for texel in 0..16 {
            let mut position = zero;
            for channel in 0..C {
                let off = subset.values[channel][texel] - mean[channel];
                position += off * direction[channel];
            }
            let position = position * subset.inside[texel];
            least = least.min(position);
            most = most.max(position);
        }
        let mut ends = [[zero; C]; 2];
        for channel in 0..C {
            ends[0][channel] = mean[channel] + axis[channel] * least;
            ends[1][channel] = mean[channel] + axis[channel] * most;
        }
        (ends, scatter)
    }
}

/// Powers of the scatter applied to its row of largest variance.
#[inline(always)]
fn principal_axis<S: Simd, const C: usize>(
    rows: &[[Wide<S>; C]; C],
    trace: Wide<S>,
) -> [Wide<S>; C] {
    let zero = trace.of(0.0);
    let mut axis = rows[0];
    let mut peak = rows[0][0];
    for a in 1..C {
        let larger = peak.less(rows[a][a]);
        for channel in 0..C {
            axis[channel] = larger.select(rows[a][channel], axis[channel]);
        }
        peak = peak.max(rows[a][a]);
    }
    let some = zero.less(trace);
    let scale = some.select(trace, trace.of(1.0)).recip();
    for value in &mut axis {
        *value = *value * scale;
    }
    if C == 1 {
        return axis;
    }
    for _ in 0..4 {
        let mut next = [zero; C];
        for a in 0..C {
            for channel in 0..C {
                next[channel] += rows[a][channel] * (axis[a] * scale);
            }
        }
        axis = next;
    }
    axis
}
