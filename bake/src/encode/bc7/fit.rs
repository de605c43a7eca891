//! Endpoints of one subset of several blocks: the principal axis first, then least squares at the indices found.

use pulp::{Simd, WithSimd};

use super::modes::Parity;
use super::wide::{Mask, Wide, round};

/// Texels of one subset, 8-bit values, and sums over them.
#[derive(Clone, Copy)]
pub(super) struct Subset<'a, S: Simd> {
    pub simd: S,
    /// `[channel][texel]`.
    pub values: &'a [[Wide<S>; 16]; 4],
    /// 1 for the texels of the subset, 0 for others.
    pub inside: [Wide<S>; 16],
    pub count: Wide<S>,
    pub sum: [Wide<S>; 4],
}

impl<'a, S: Simd> Subset<'a, S> {
    /// All texels of blocks.
    #[inline(always)]
    pub fn whole(simd: S, values: &'a [[Wide<S>; 16]; 4]) -> Self {
        let mut sum = [Wide::zero(simd); 4];
        for channel in 0..4 {
            for texel in 0..16 {
                sum[channel] += values[channel][texel];
            }
        }
        Self {
            simd,
            values,
            inside: [Wide::splat(simd, 1.0); 16],
            count: Wide::splat(simd, 16.0),
            sum,
        }
    }

    /// The texels whose bits are set in the word of each lane. Words are never 0.
    #[inline(always)]
    pub fn choose(&mut self, words: &[u32]) {
        let (one, zero) = (Wide::splat(self.simd, 1.0), Wide::zero(self.simd));
        self.count = zero;
        self.sum = [zero; 4];
        for texel in 0..16 {
            let inside = Mask::bit(self.simd, words, texel as u32).select(one, zero);
            self.inside[texel] = inside;
            self.count += inside;
            for channel in 0..4 {
                self.sum[channel] += inside * self.values[channel][texel];
            }
        }
    }
}

/// What endpoints and indices may be.
#[derive(Clone, Copy, Debug)]
pub(super) struct Grid {
    /// The highest stored value.
    pub top: f32,
    /// Of stored values, in codes with the parity bit.
    stride: f32,
    /// Codes a unit of 8-bit values.
    scale: f32,
    up: f32,
    down: f32,
    /// The highest index.
    pub steps: f32,
    pub parities: &'static [[f32; 2]],
}

impl Grid {
    pub const fn new(bits: u32, parity: Parity, index_bits: u32) -> Self {
        let all = bits + (!matches!(parity, Parity::None)) as u32;
        Self {
            top: ((1_u32 << bits) - 1) as f32,
            stride: (1_u32 << (all - bits)) as f32,
            scale: ((1_u32 << all) - 1) as f32 / 255.0,
            up: (1_u32 << (8 - all)) as f32,
            down: 1.0 / (1_u32 << (2 * all - 8)) as f32,
            steps: ((1_u32 << index_bits) - 1) as f32,
            parities: match parity {
                Parity::None => &[[0.0, 0.0]],
                Parity::Shared => &[[0.0, 0.0], [1.0, 1.0]],
                Parity::Each => &[[0.0, 0.0], [1.0, 1.0], [0.0, 1.0], [1.0, 0.0]],
            },
        }
    }

    /// With both parity bits set, as opaque alpha needs them.
    pub const fn odd(mut self) -> Self {
        self.parities = &[[1.0, 1.0]];
        self
    }

    #[inline(always)]
    fn store<S: Simd>(&self, value: Wide<S>, parity: f32) -> Wide<S> {
        let code = value * self.scale - value.of(parity);
        (code * (1.0 / self.stride)).round().clamp(0.0, self.top)
    }

    /// The 8-bit value that the decoder makes of a stored one.
    #[inline(always)]
    fn expand<S: Simd>(&self, stored: Wide<S>, parity: Wide<S>) -> Wide<S> {
        let code = stored * self.stride + parity;
        // Rounded down: half a step of the quotient keeps it off the halves.
        let low = (code * self.down + code.of(0.5 * self.down - 0.5)).round();
        code * self.up + low
    }
}

/// How hard a fit tries.
#[derive(Clone, Copy, Debug)]
pub(super) struct Effort {
    /// Most rounds of least squares.
    pub rounds: u32,
    /// Whether every choice of parity bits is measured; else the one nearest to the endpoints.
    pub parities: bool,
    /// Further starts: shares of the extent by which the extremes are moved inwards.
    pub insets: &'static [f32],
}

/// Stored endpoints.
#[derive(Clone, Copy, Debug)]
pub(super) struct Ends<S: Simd> {
    /// `[end][channel]`.
    pub stored: [[Wide<S>; 4]; 2],
    pub parity: [Wide<S>; 2],
}

/// The best endpoints found for a subset.
#[derive(Clone, Copy, Debug)]
pub(super) struct Fit<S: Simd> {
    pub ends: Ends<S>,
    /// Of the second endpoint at each texel, 0 to 64.
    pub weights: [Wide<S>; 16],
    pub error: Wide<S>,
}

impl<S: Simd> Fit<S> {
    #[inline(always)]
    pub fn none(simd: S) -> Self {
        let zero = Wide::zero(simd);
        Self {
            ends: Ends {
                stored: [[zero; 4]; 2],
                parity: [zero; 2],
            },
            weights: [zero; 16],
            error: Wide::splat(simd, f32::INFINITY),
        }
    }

    /// Takes the lanes in which the other's error is less; whether there are any.
    #[inline(always)]
    pub fn improve(&mut self, ends: &Ends<S>, weights: &[Wide<S>; 16], error: Wide<S>) -> bool {
        let better = error.less(self.error);
        if !better.any() {
            return false;
        }
        self.error = better.select(error, self.error);
        for end in 0..2 {
            for channel in 0..4 {
                let stored = &mut self.ends.stored[end][channel];
                *stored = better.select(ends.stored[end][channel], *stored);
            }
            self.ends.parity[end] = better.select(ends.parity[end], self.ends.parity[end]);
        }
        for texel in 0..16 {
            self.weights[texel] = better.select(weights[texel], self.weights[texel]);
        }
        true
    }
}

/// Fits the first `C` channels of a subset, then descends over single steps of the endpoints, `polish` rounds at most.
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

    #[inline(always)]
    fn fit(self) -> Fit<S> {
        let search = Search::<S, C> {
            subset: self.subset,
            grid: self.grid,
        };
        let mut best = Fit::none(self.subset.simd);
        let (ends, scatter) = principal_ends::<S, C>(self.subset);
        search.quantise(&ends, self.effort.parities, &mut best);
        for _ in 0..self.effort.rounds {
            let ends = search.least_squares(&best.weights);
            if !search.quantise(&ends, self.effort.parities, &mut best) {
                break;
            }
        }
        for &inset in self.effort.insets {
            let mut other = Fit::none(self.subset.simd);
            let mut moved = ends;
            for channel in 0..C {
                let [low, high] = [ends[0][channel], ends[1][channel]];
                let step = (high - low) * inset;
                moved[0][channel] = (low + step).clamp(0.0, 255.0);
                moved[1][channel] = (high - step).clamp(0.0, 255.0);
            }
            search.quantise(&moved, self.effort.parities, &mut other);
            for _ in 0..self.effort.rounds {
                let ends = search.least_squares(&other.weights);
                if !search.quantise(&ends, self.effort.parities, &mut other) {
                    break;
                }
            }
            best.improve(&other.ends, &other.weights, other.error);
        }
        if scatter.less(best.error).any() {
            search.one_level(scatter, &mut best);
        }
        best
    }
}

impl<S: Simd, const C: usize> WithSimd for FitSubset<'_, S, C> {
    type Output = Fit<S>;
    #[inline(always)]
    fn with_simd<T: Simd>(self, _: T) -> Fit<S> {
        self.fit()
    }
}

/// Descends over single steps of the endpoints of `best`, `rounds` at most.
pub(super) struct Polish<'a, S: Simd, const C: usize> {
    pub subset: &'a Subset<'a, S>,
    pub grid: &'a Grid,
    pub rounds: u32,
    /// Whether all channels of an end may move at once.
    pub together: bool,
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
        let search = Search::<S, C> {
            subset: self.subset,
            grid: self.grid,
        };
        for _ in 0..self.rounds {
            let ends = search.least_squares(&self.best.weights);
            let fitted = search.quantise(&ends, true, self.best);
            if !search.descend(self.together, self.best) && !fitted {
                return;
            }
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
}

impl<S: Simd, const C: usize> Search<'_, S, C> {
    /// Measures endpoints with one choice of parity or all of them; whether any is better.
    #[inline(always)]
    fn quantise(&self, ends: &[[Wide<S>; 4]; 2], all: bool, best: &mut Fit<S>) -> bool {
        let mut better = false;
        let mut nearest: Option<(Wide<S>, Ends<S>)> = None;
        for &parity in self.grid.parities {
            let mut choice = Fit::none(self.subset.simd).ends;
            let mut distance = Wide::zero(self.subset.simd);
            for end in 0..2 {
                choice.parity[end] = Wide::splat(self.subset.simd, parity[end]);
                for channel in 0..C {
                    let stored = self.grid.store(ends[end][channel], parity[end]);
                    choice.stored[end][channel] = stored;
                    let off = self.grid.expand(stored, choice.parity[end]) - ends[end][channel];
                    distance += off * off;
                }
            }
            if all {
                better |= self.measure(&choice, best);
                continue;
            }
            nearest = Some(match nearest {
                None => (distance, choice),
                Some((least, mut kept)) => {
                    let less = distance.less(least);
                    for end in 0..2 {
                        kept.parity[end] = less.select(choice.parity[end], kept.parity[end]);
                        for channel in 0..C {
                            let stored = &mut kept.stored[end][channel];
                            *stored = less.select(choice.stored[end][channel], *stored);
                        }
                    }
                    (distance.min(least), kept)
                }
            });
        }
        match nearest {
            Some((_, choice)) => self.measure(&choice, best),
            None => better,
        }
    }

    /// Tries endpoints that have the mean at one of the levels between them, where it can be nearer than any
    /// endpoint; lanes whose scatter is not below their error gain nothing from it.
    #[inline(always)]
    fn one_level(&self, scatter: Wide<S>, best: &mut Fit<S>) {
        let (grid, simd) = (self.grid, self.subset.simd);
        let inverse = self.subset.count.recip();
        let share = round((grid.steps / 3.0).floor() * 64.0 / grid.steps) / 64.0;
        let wanted = scatter.less(best.error);
        for &parity in grid.parities {
            let mut ends = Fit::none(simd).ends;
            let low_parity = Wide::splat(simd, parity[0]);
            let high_parity = Wide::splat(simd, parity[1]);
            ends.parity = [low_parity, high_parity];
            for channel in 0..C {
                let mean = self.subset.sum[channel] * inverse;
                let middle = grid.store(mean, parity[0]);
                let mut least = Wide::splat(simd, f32::INFINITY);
                for step in [0.0, -1.0, 1.0, -2.0, 2.0] {
                    let low = (middle + Wide::splat(simd, step)).clamp(0.0, grid.top);
                    let from = grid.expand(low, low_parity);
                    let high = grid.store(from + (mean - from) * (1.0 / share), parity[1]);
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
            let mut tried = *best;
            if self.measure(&ends, &mut tried) {
                let taken = wanted.select(tried.error, best.error);
                best.improve(&tried.ends, &tried.weights, taken);
            }
        }
    }

    /// The squared error of endpoints at the nearest indices; kept where it is less than the best.
    #[inline(always)]
    fn measure(&self, ends: &Ends<S>, best: &mut Fit<S>) -> bool {
        let mut weights = [Wide::zero(self.subset.simd); 16];
        let error = Measure::<S, C> {
            subset: self.subset,
            grid: self.grid,
            ends,
            weights: &mut weights,
        }
        .run();
        best.improve(ends, &weights, error)
    }

    /// The endpoints with the least squared error at given weights; both the mean where all weights are one.
    #[inline(always)]
    fn least_squares(&self, weights: &[Wide<S>; 16]) -> [[Wide<S>; 4]; 2] {
        let (subset, simd) = (self.subset, self.subset.simd);
        let zero = Wide::zero(simd);
        let (mut b, mut bb, mut right) = (zero, zero, [zero; 4]);
        for texel in 0..16 {
            let weight = weights[texel] * subset.inside[texel] * (1.0 / 64.0);
            b += weight;
            bb += weight * weight;
            for channel in 0..C {
                right[channel] += weight * subset.values[channel][texel];
            }
        }
        let (aa, ab) = (subset.count - b * 2.0 + bb, b - bb);
        let determinant = aa * bb - ab * ab;
        let solvable = Wide::splat(simd, 1e-3).less(determinant);
        let inverse = solvable.select(determinant, Wide::splat(simd, 1.0)).recip();
        let mean = subset.count.recip();
        let mut ends = [[zero; 4]; 2];
        for channel in 0..C {
            let sum = subset.sum[channel];
            let left = sum - right[channel];
            let low = (left * bb - right[channel] * ab) * inverse;
            let high = (right[channel] * aa - left * ab) * inverse;
            ends[0][channel] = solvable.select(low, sum * mean).clamp(0.0, 255.0);
            ends[1][channel] = solvable.select(high, sum * mean).clamp(0.0, 255.0);
        }
        ends
    }

    /// Tries a step up and down of every stored component, and of all of an end `together`; whether any is better.
    #[inline(always)]
    fn descend(&self, together: bool, best: &mut Fit<S>) -> bool {
        let mut better = false;
        let ways = if C > 1 && together { C + 1 } else { C };
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
                    better |= self.measure(&ends, best);
                }
            }
        }
        better
    }
}

/// Measures endpoints: the error, and the weight of each texel.
pub(super) struct Measure<'a, S: Simd, const C: usize> {
    pub subset: &'a Subset<'a, S>,
    pub grid: &'a Grid,
    pub ends: &'a Ends<S>,
    pub weights: &'a mut [Wide<S>; 16],
}

impl<S: Simd, const C: usize> Measure<'_, S, C> {
    /// Out of line.
    #[inline(always)]
    pub fn run(self) -> Wide<S> {
        self.subset.simd.vectorize(self)
    }

    /// Interpolates as the decoder does: `((64 - w) low + w high + 32) >> 6`.
    #[inline(always)]
    fn error(self) -> Wide<S> {
        let (subset, simd) = (self.subset, self.subset.simd);
        let zero = Wide::zero(simd);
        let steps = self.grid.steps;
        let (mut low, mut along) = ([zero; C], [zero; C]);
        let (mut square, mut offset) = (zero, zero);
        for channel in 0..C {
            let Ends { stored, parity } = self.ends;
            let from = self.grid.expand(stored[0][channel], parity[0]);
            let to = self.grid.expand(stored[1][channel], parity[1]);
            low[channel] = from;
            along[channel] = to - from;
            square += along[channel] * along[channel];
            offset += along[channel] * from;
        }
        let apart = zero.less(square);
        let scale = apart.select(square, Wide::splat(simd, 1.0)).recip() * steps;
        let offset = zero - offset * scale;
        let mut direction = [zero; C];
        let mut unit = [zero; C];
        for channel in 0..C {
            direction[channel] = along[channel] * scale;
            unit[channel] = along[channel] * (1.0 / 64.0);
            // Sums are multiples of 1/64, so that a quarter of that makes halves round up.
            low[channel] += Wide::splat(simd, 1.0 / 256.0);
        }
        let spacing = Wide::splat(simd, 64.0 / steps);
        let mut total = zero;
        for texel in 0..16 {
            let mut position = offset;
            for channel in 0..C {
                position += subset.values[channel][texel] * direction[channel];
            }
            // The weights of the specification are those of even spacing, rounded.
            let weight = (position.clamp(0.0, steps).round() * spacing).round();
            let mut error = zero;
            for channel in 0..C {
                let level = low[channel] + weight * unit[channel];
                let off = level.round() - subset.values[channel][texel];
                error += off * off;
            }
            self.weights[texel] = weight;
            total += error * subset.inside[texel];
        }
        total
    }
}

impl<S: Simd, const C: usize> WithSimd for Measure<'_, S, C> {
    type Output = Wide<S>;
    #[inline(always)]
    fn with_simd<T: Simd>(self, _: T) -> Wide<S> {
        self.error()
    }
}

/// The extremes of the texels along their principal axis, and their squared distances from the mean.
#[inline(always)]
fn principal_ends<S: Simd, const C: usize>(subset: &Subset<'_, S>) -> ([[Wide<S>; 4]; 2], Wide<S>) {
    let simd = subset.simd;
    let zero = Wide::zero(simd);
    let inverse = subset.count.recip();
    let mut mean = [zero; C];
    for channel in 0..C {
        mean[channel] = subset.sum[channel] * inverse;
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
    let (far, near) = (Wide::splat(simd, 1e9), Wide::splat(simd, 0.5));
    let (mut least, mut most) = (far, zero - far);
    for texel in 0..16 {
        let mut position = zero;
        for channel in 0..C {
            let off = subset.values[channel][texel] - mean[channel];
            position += off * (axis[channel] * scale);
        }
        let inside = near.less(subset.inside[texel]);
        least = least.min(inside.select(position, far));
        most = most.max(inside.select(position, zero - far));
    }
    let mut ends = [[zero; 4]; 2];
    for channel in 0..C {
        ends[0][channel] = (mean[channel] + axis[channel] * least).clamp(0.0, 255.0);
        ends[1][channel] = (mean[channel] + axis[channel] * most).clamp(0.0, 255.0);
    }
    (ends, scatter)
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
