//! Endpoints of one subset: the principal axis first, then least squares at the indices found.

use super::lanes::{Lanes, round};
use super::modes::Parity;

/// Texels of one subset, 8-bit values, four to a group; lanes without a texel repeat the first and weigh 0.
#[derive(Clone, Copy, Debug)]
pub(super) struct Texels {
    /// `[channel][group]`.
    pub values: [[Lanes; 4]; 4],
    pub weight: [Lanes; 4],
    pub groups: usize,
    pub count: f32,
    /// Of each channel, over the texels.
    pub sum: Lanes,
}

impl Texels {
    pub const NONE: Self = Self {
        values: [[Lanes::ZERO; 4]; 4],
        weight: [Lanes::ZERO; 4],
        groups: 0,
        count: 0.0,
        sum: Lanes::ZERO,
    };

    /// Takes the texels of a mask, in order.
    pub fn gather(&mut self, block: &[[f32; 16]; 4], mask: u16) {
        let count = mask.count_ones() as usize;
        let first = mask.trailing_zeros() as usize;
        let groups = count.div_ceil(4);
        let mut order = [first & 15; 16];
        let mut rest = mask;
        for slot in &mut order[..count] {
            *slot = (rest.trailing_zeros() & 15) as usize;
            rest &= rest.wrapping_sub(1);
        }
        self.groups = groups;
        self.count = count as f32;
        for group in 0..groups {
            let slots = [0, 1, 2, 3].map(|lane| group * 4 + lane);
            for channel in 0..4 {
                let values = slots.map(|slot| block[channel][order[slot]]);
                self.values[channel][group] = Lanes::new(values);
            }
            self.weight[group] = Lanes::new(slots.map(|slot| f32::from(slot < count)));
        }
        self.sum = self.weighted_sum(&self.weight);
    }

    /// The same texels with another channel first.
    pub fn only(&self, channel: usize) -> Self {
        let mut other = *self;
        other.values[0] = self.values[channel];
        other.sum[0] = self.sum[channel];
        other
    }

    /// The same texels with a channel in the place of alpha, alpha in its.
    pub fn swapped(&self, channel: usize) -> Self {
        let mut other = *self;
        other.values.swap(channel, 3);
        other.sum[channel] = self.sum[3];
        other.sum[3] = self.sum[channel];
        other
    }

    #[inline(always)]
    fn weighted_sum(&self, weights: &[Lanes; 4]) -> Lanes {
        let mut sums = [Lanes::ZERO; 4];
        for group in 0..self.groups {
            for (sum, values) in sums.iter_mut().zip(&self.values) {
                *sum += values[group] * weights[group];
            }
        }
        Lanes::new(sums.map(Lanes::sum))
    }
}

/// What endpoints and indices may be.
#[derive(Clone, Copy, Debug)]
pub(super) struct Grid {
    /// The highest stored value.
    top: f32,
    /// Stored value and parity to 8 bits: `stored * stride + parity` is the code, which is shifted up and
    /// repeats its highest bits below.
    stride: f32,
    scale: f32,
    up: f32,
    down: f32,
    /// The highest index.
    pub steps: f32,
    parities: &'static [[f32; 2]],
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
    fn store(&self, value: Lanes, parity: f32) -> Lanes {
        let code = value * self.scale - Lanes::splat(parity);
        (code * (1.0 / self.stride)).round().clamp(0.0, self.top)
    }

    /// The 8-bit value that the decoder makes of a stored one.
    #[inline(always)]
    fn expand(&self, stored: Lanes, parity: f32) -> Lanes {
        let code = stored * self.stride + Lanes::splat(parity);
        // Rounded down: half a step of the quotient keeps it off the halves.
        let low = (code * self.down + Lanes::splat(0.5 * self.down - 0.5)).round();
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
}

/// Stored endpoints.
#[derive(Clone, Copy, Debug)]
pub(super) struct Ends {
    pub stored: [Lanes; 2],
    pub parity: [f32; 2],
}

/// The best endpoints found for a subset.
#[derive(Clone, Copy, Debug)]
pub(super) struct Fit {
    pub ends: Ends,
    /// Of the second endpoint at each texel, 0 to 64, in the order of the subset.
    pub weights: [Lanes; 4],
    pub error: f32,
}

impl Fit {
    pub const NONE: Self = Self {
        ends: Ends {
            stored: [Lanes::ZERO; 2],
            parity: [0.0; 2],
        },
        weights: [Lanes::ZERO; 4],
        error: f32::INFINITY,
    };

    /// The index of each texel of the subset, in order, given the highest.
    pub fn indices(&self, steps: f32) -> impl Iterator<Item = u8> {
        let weights = self.weights.into_iter().flat_map(Lanes::to_array);
        weights.map(move |weight| round(weight * steps / 64.0) as u8)
    }
}

/// Fits the first `C` channels of a subset.
pub(super) fn fit<const C: usize>(texels: &Texels, grid: &Grid, effort: Effort) -> Fit {
    let search = Search::<C> { texels, grid };
    let mut best = Fit::NONE;
    let (ends, scatter) = principal_ends::<C>(texels);
    search.quantise(ends, effort.parities, &mut best);
    for _ in 0..effort.rounds {
        if best.error == 0.0 {
            return best;
        }
        let Some(ends) = search.least_squares(&best.weights) else {
            break;
        };
        if !search.quantise(ends, effort.parities, &mut best) {
            break;
        }
    }
    if scatter < best.error {
        search.one_level(&mut best);
    }
    best
}

/// Descends over single steps of the endpoints, `rounds` at most.
pub(super) fn polish<const C: usize>(texels: &Texels, grid: &Grid, rounds: u32, best: &mut Fit) {
    let search = Search::<C> { texels, grid };
    for _ in 0..rounds {
        if best.error == 0.0 {
            return;
        }
        let ends = search.least_squares(&best.weights);
        let fitted = ends.is_some_and(|ends| search.quantise(ends, true, best));
        if !search.descend(best) && !fitted {
            return;
        }
    }
}

struct Search<'a, const C: usize> {
    texels: &'a Texels,
    grid: &'a Grid,
}

impl<const C: usize> Search<'_, C> {
    /// Measures endpoints with one choice of parity or all of them; whether any is better.
    #[inline(always)]
    fn quantise(&self, ends: [Lanes; 2], all: bool, best: &mut Fit) -> bool {
        let choice = |parity: [f32; 2]| Ends {
            stored: [0, 1].map(|end| self.grid.store(ends[end], parity[end])),
            parity,
        };
        match self.grid.parities {
            &[a] => self.measure(&[choice(a)], best),
            &[a, b] if all => self.measure(&[choice(a), choice(b)], best),
            &[a, b, c, d] if all => {
                self.measure(&[choice(a), choice(b), choice(c), choice(d)], best)
            }
            parities => {
                let mut nearest = (f32::INFINITY, Fit::NONE.ends);
                for &parity in parities {
                    let choice = choice(parity);
                    let mut distance = 0.0;
                    for end in 0..2 {
                        let off = self.grid.expand(choice.stored[end], parity[end]) - ends[end];
                        let off = off * off;
                        for channel in 0..C {
                            distance += off[channel];
                        }
                    }
                    if distance < nearest.0 {
                        nearest = (distance, choice);
                    }
                }
                self.measure(&[nearest.1], best)
            }
        }
    }

    /// Tries endpoints that have the mean at one of the levels between them, where it can be nearer than any
    /// endpoint.
    #[inline(never)]
    fn one_level(&self, best: &mut Fit) {
        let grid = self.grid;
        let mean = self.texels.sum * (1.0 / self.texels.count);
        let share = round((grid.steps / 3.0).floor() * 64.0 / grid.steps) / 64.0;
        let mut nearest = (f32::INFINITY, Fit::NONE.ends);
        for &parity in grid.parities {
            let middle = grid.store(mean, parity[0]);
            let mut stored = [middle; 2];
            let mut least = Lanes::splat(f32::INFINITY);
            for step in [0.0, -1.0, 1.0, -2.0, 2.0] {
                let low = (middle + Lanes::splat(step)).clamp(0.0, grid.top);
                let from = grid.expand(low, parity[0]);
                let high = grid.store(from + (mean - from) * (1.0 / share), parity[1]);
                let along = grid.expand(high, parity[1]) - from;
                let level = (from + along * share + Lanes::splat(1.0 / 256.0)).round();
                let off = (level - mean) * (level - mean);
                stored = [
                    off.select_less(least, low, stored[0]),
                    off.select_less(least, high, stored[1]),
                ];
                least = off.min(least);
            }
            let mut distance = 0.0;
            for channel in 0..C {
                distance += least[channel];
            }
            if distance < nearest.0 {
                nearest = (distance, Ends { stored, parity });
            }
        }
        self.measure(&[nearest.1], best);
    }

    /// Squared errors of endpoints at the nearest indices; the least is kept where it is less than the best.
    /// They are computed side by side: one alone would wait for its own results.
    #[inline(always)]
    fn measure<const N: usize>(&self, choices: &[Ends; N], best: &mut Fit) -> bool {
        let mut weights = [[Lanes::ZERO; 4]; N];
        let mut errors = [0.0; N];
        for at in 0..N {
            let Ends { stored, parity } = choices[at];
            let [low, high] = [0, 1].map(|end| self.grid.expand(stored[end], parity[end]));
            errors[at] = self.error(low, high, &mut weights[at]);
        }
        let mut least = 0;
        for at in 1..N {
            if errors[at] < errors[least] {
                least = at;
            }
        }
        let better = errors[least] < best.error;
        if better {
            *best = Fit {
                ends: choices[least],
                weights: weights[least],
                error: errors[least],
            };
        }
        better
    }

    /// Interpolates as the decoder does: `((64 - w) low + w high + 32) >> 6`.
    #[inline(always)]
    fn error(&self, low: Lanes, high: Lanes, weights: &mut [Lanes; 4]) -> f32 {
        let steps = self.grid.steps;
        let along = high - low;
        let mut square = 0.0;
        let mut offset = 0.0;
        for channel in 0..C {
            square += along[channel] * along[channel];
            offset += along[channel] * low[channel];
        }
        let scale = if square > 0.0 { steps / square } else { 0.0 };
        let offset = Lanes::splat(-offset * scale);
        let direction = along * scale;
        let unit = along * (1.0 / 64.0);
        // Sums are multiples of 1/64, so that a quarter of that makes halves round up.
        let origin = low + Lanes::splat(1.0 / 256.0);
        let spacing = Lanes::splat(64.0 / steps);
        let mut total = Lanes::ZERO;
        for group in 0..self.texels.groups {
            let mut position = offset;
            for channel in 0..C {
                let value = self.texels.values[channel][group];
                position += value * Lanes::splat(direction[channel]);
            }
            // The weights of the specification are those of even spacing, rounded.
            let weight = (position.clamp(0.0, steps).round() * spacing).round();
            weights[group] = weight;
            let mut error = Lanes::ZERO;
            for channel in 0..C {
                let level = Lanes::splat(origin[channel]) + weight * Lanes::splat(unit[channel]);
                let off = level.round() - self.texels.values[channel][group];
                error += off * off;
            }
            total += error * self.texels.weight[group];
        }
        total.sum()
    }

    /// The endpoints with the least squared error at given weights; none where all weights are one.
    #[inline(always)]
    fn least_squares(&self, weights: &[Lanes; 4]) -> Option<[Lanes; 2]> {
        let texels = self.texels;
        let (mut b, mut bb) = (Lanes::ZERO, Lanes::ZERO);
        let mut scaled = [Lanes::ZERO; 4];
        for group in 0..texels.groups {
            let weight = weights[group] * texels.weight[group] * (1.0 / 64.0);
            scaled[group] = weight;
            b += weight;
            bb += weight * weight;
        }
        let (b, bb) = (b.sum(), bb.sum());
        let (aa, ab) = (texels.count - 2.0 * b + bb, b - bb);
        let determinant = aa * bb - ab * ab;
        if determinant < 1e-3 {
            return None;
        }
        let inverse = 1.0 / determinant;
        let right = texels.weighted_sum(&scaled);
        let left = texels.sum - right;
        let low = (left * bb - right * ab) * inverse;
        let high = (right * aa - left * ab) * inverse;
        Some([low.clamp(0.0, 255.0), high.clamp(0.0, 255.0)])
    }

    /// Tries a step up and down of every stored component; whether any is better.
    fn descend(&self, best: &mut Fit) -> bool {
        let mut better = false;
        for end in 0..2 {
            for channel in 0..C {
                let choices = [-1.0, 1.0].map(|step| {
                    let mut ends = best.ends;
                    let stored = &mut ends.stored[end][channel];
                    *stored = (*stored + step).clamp(0.0, self.grid.top);
                    ends
                });
                better |= self.measure(&choices, best);
            }
        }
        better
    }
}

/// The extremes of the texels along their principal axis, and their squared distances from the mean.
#[inline(always)]
fn principal_ends<const C: usize>(texels: &Texels) -> ([Lanes; 2], f32) {
    let mean = texels.sum * (1.0 / texels.count);
    let (axis, scatter) = principal_axis::<C>(texels, mean);
    let mut square = 0.0;
    for channel in 0..C {
        square += axis[channel] * axis[channel];
    }
    if square == 0.0 {
        return ([mean; 2], scatter);
    }
    let scaled = axis * (1.0 / square);
    let (mut least, mut most) = (Lanes::splat(f32::MAX), Lanes::splat(f32::MIN));
    for group in 0..texels.groups {
        let mut position = Lanes::ZERO;
        for channel in 0..C {
            let value = texels.values[channel][group] - Lanes::splat(mean[channel]);
            position += value * Lanes::splat(scaled[channel]);
        }
        least = least.min(position);
        most = most.max(position);
    }
    let least = least.to_array().into_iter().fold(f32::MAX, f32::min);
    let most = most.to_array().into_iter().fold(f32::MIN, f32::max);
    let ends = [least, most].map(|t| (mean + axis * t).clamp(0.0, 255.0));
    (ends, scatter)
}

/// Powers of the scatter applied to its largest row, and its trace.
#[inline(always)]
fn principal_axis<const C: usize>(texels: &Texels, mean: Lanes) -> (Lanes, f32) {
    let mut products = [[Lanes::ZERO; 4]; 4];
    for group in 0..texels.groups {
        for a in 0..C {
            let off = texels.values[a][group] - Lanes::splat(mean[a]);
            let off = off * texels.weight[group];
            for b in 0..=a {
                let other = texels.values[b][group] - Lanes::splat(mean[b]);
                products[a][b] += off * other;
            }
        }
    }
    let mut rows = [Lanes::ZERO; 4];
    let mut trace = 0.0;
    for a in 0..C {
        for b in 0..=a {
            let sum = products[a][b].sum();
            rows[a][b] = sum;
            rows[b][a] = sum;
        }
        trace += rows[a][a];
    }
    if trace == 0.0 {
        return (Lanes::ZERO, 0.0);
    }
    if C == 1 {
        return (Lanes::new([1.0, 0.0, 0.0, 0.0]), trace);
    }
    let mut axis = rows[0];
    for a in 1..C {
        if rows[a][a] > axis_peak(&rows, a) {
            axis = rows[a];
        }
    }
    let scale = 1.0 / trace;
    axis *= scale;
    for _ in 0..4 {
        let mut next = Lanes::ZERO;
        for a in 0..C {
            next += rows[a] * Lanes::splat(axis[a] * scale);
        }
        axis = next;
    }
    (axis, trace)
}

/// The largest variance of the channels before `until`.
#[inline(always)]
fn axis_peak(rows: &[Lanes; 4], until: usize) -> f32 {
    let mut peak = rows[0][0];
    for (a, row) in rows.iter().enumerate().take(until).skip(1) {
        if row[a] > peak {
            peak = row[a];
        }
    }
    peak
}
