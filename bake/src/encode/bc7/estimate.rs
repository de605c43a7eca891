//! Cheap estimates of what a way of splitting a block would cost, to choose those worth a fit.
//!
//! The error of a subset is taken as what is off its principal axis, and a share of what is along it that
//! the spacing of the indices leaves: with evenly spread values, `1 / steps^2`.

use super::lanes::Lanes;
use super::partition::{LaneMasks, SECOND_OF_THREE, SECOND_OF_TWO, THIRD_OF_THREE};

/// Sums over texels, of four ways side by side: of the values, and of their products in the order 00 10 11 20 21 22 30 31 32 33.
#[derive(Clone, Copy)]
struct Sums {
    count: Lanes,
    first: [Lanes; 4],
    second: [Lanes; 10],
}

/// Scatter of four ways side by side.
#[derive(Clone, Copy)]
struct Spread {
    /// Off the principal axes.
    off: Lanes,
    /// Along them, less the share of the two texels that the endpoints meet.
    between: Lanes,
}

/// The scatter of every partition.
pub(super) struct Spreads([Spread; 16]);

/// The texels of a block relative to its first, and their products; each in every lane.
pub(super) struct Products {
    first: [[Lanes; 16]; 4],
    second: [[Lanes; 16]; 10],
}

impl Products {
    pub const ZERO: Self = Self {
        first: [[Lanes::ZERO; 16]; 4],
        second: [[Lanes::ZERO; 16]; 10],
    };

    /// Made in place: it is large.
    pub fn fill(&mut self, block: &[[f32; 16]; 4]) {
        for texel in 0..16 {
            let mut at = 0;
            for a in 0..4 {
                self.first[a][texel] = Lanes::splat(block[a][texel] - block[a][0]);
                for b in 0..=a {
                    self.second[at][texel] = self.first[a][texel] * self.first[b][texel];
                    at += 1;
                }
            }
        }
    }

    /// The sums over all texels.
    fn total(&self) -> Sums {
        let sum = |values: &[Lanes; 16]| {
            let mut sum = Lanes::ZERO;
            for value in values {
                sum += *value;
            }
            sum
        };
        Sums {
            count: Lanes::splat(16.0),
            first: std::array::from_fn(|at| sum(&self.first[at])),
            second: std::array::from_fn(|at| sum(&self.second[at])),
        }
    }

    /// The sums over one subset of four partitions.
    #[inline(always)]
    fn masked<const C: usize>(&self, masks: &[Lanes; 16]) -> Sums {
        let mut sums = Sums::ZERO;
        for texel in 0..16 {
            let mask = masks[texel];
            sums.count += mask;
            for channel in 0..C {
                sums.first[channel] += mask * self.first[channel][texel];
            }
            for at in 0..C * (C + 1) / 2 {
                sums.second[at] += mask * self.second[at][texel];
            }
        }
        sums
    }

    /// The scatter of every partition into two subsets, by the first `C` channels.
    pub fn two_subsets<const C: usize>(&self) -> Spreads {
        let total = self.total();
        Spreads(std::array::from_fn(|group| {
            let second = self.masked::<C>(&SECOND_OF_TWO[group]);
            second.spread::<C>() + total.less(&second).spread::<C>()
        }))
    }

    /// The same into three subsets.
    pub fn three_subsets<const C: usize>(&self) -> Spreads {
        let total = self.total();
        Spreads(std::array::from_fn(|group| {
            let subset = |masks: &LaneMasks| self.masked::<C>(&masks[group]);
            let (second, third) = (subset(&SECOND_OF_THREE), subset(&THIRD_OF_THREE));
            let first = total.less(&second).less(&third);
            first.spread::<C>() + second.spread::<C>() + third.spread::<C>()
        }))
    }

    /// Estimated error of modes 4 and 5 for each rotation, given the highest colour and scalar index.
    pub fn rotations(&self, steps: f32, scalar_steps: f32) -> [f32; 4] {
        let total = self.total();
        let at = |a: usize, b: usize| {
            let (a, b) = if a < b { (b, a) } else { (a, b) };
            a * (a + 1) / 2 + b
        };
        let mut sums = Sums::ZERO;
        sums.count = total.count;
        let mut scalar = Lanes::ZERO;
        for rotation in 0..4 {
            let channels = VECTORS[rotation];
            let alone = SCALARS[rotation];
            for (a, &from) in channels.iter().enumerate() {
                sums.first[a][rotation] = total.first[from][0];
                for (b, &other) in channels.iter().enumerate().take(a + 1) {
                    sums.second[at(a, b)][rotation] = total.second[at(from, other)][0];
                }
            }
            let mean = total.first[alone][0] * (1.0 / 16.0);
            scalar[rotation] = total.second[at(alone, alone)][0] - mean * total.first[alone][0];
        }
        let spread = sums.spread::<3>();
        let error = spread.error(steps) + scalar * (1.0 / (scalar_steps * scalar_steps));
        error.to_array()
    }
}

/// The colour channels of each rotation.
const VECTORS: [[usize; 3]; 4] = [[0, 1, 2], [3, 1, 2], [0, 3, 2], [0, 1, 3]];
/// The channel that has its own indices.
pub(super) const SCALARS: [usize; 4] = [3, 0, 1, 2];

impl Sums {
    const ZERO: Self = Self {
        count: Lanes::ZERO,
        first: [Lanes::ZERO; 4],
        second: [Lanes::ZERO; 10],
    };

    /// The sums over the texels of `self` that are not of `part`.
    #[inline(always)]
    fn less(&self, part: &Self) -> Self {
        let mut rest = *self;
        rest.count = rest.count - part.count;
        for (value, part) in rest.first.iter_mut().zip(&part.first) {
            *value = *value - *part;
        }
        for (value, part) in rest.second.iter_mut().zip(&part.second) {
            *value = *value - *part;
        }
        rest
    }

    /// The largest eigenvalue is the fourth root of the trace of the fourth power, nearly: from above, and
    /// the more exact the more it dominates.
    #[inline(always)]
    fn spread<const C: usize>(&self) -> Spread {
        let inverse = self.count.recip();
        let mut scatter = [[Lanes::ZERO; 4]; 4];
        let mut at = 0;
        let mut all = Lanes::splat(1e-6);
        for a in 0..C {
            for b in 0..=a {
                let value = self.second[at] - self.first[a] * self.first[b] * inverse;
                scatter[a][b] = value;
                scatter[b][a] = value;
                at += 1;
            }
            all += scatter[a][a];
        }
        let scale = all.recip();
        for row in &mut scatter {
            for value in row {
                *value = *value * scale;
            }
        }
        let mut fourth = Lanes::ZERO;
        for a in 0..C {
            for b in 0..=a {
                let mut square = Lanes::ZERO;
                for k in 0..C {
                    square += scatter[a][k] * scatter[k][b];
                }
                let twice = if a == b { 1.0 } else { 2.0 };
                fourth += square * square * twice;
            }
        }
        let along = fourth.sqrt().sqrt().min(Lanes::splat(1.0)) * all;
        let between = along * (Lanes::splat(1.0) - inverse * 2.0);
        Spread {
            off: all - along,
            between,
        }
    }
}

impl std::ops::Add for Spread {
    type Output = Self;
    #[inline(always)]
    fn add(self, other: Self) -> Self {
        Self {
            off: self.off + other.off,
            between: self.between + other.between,
        }
    }
}

impl Spread {
    #[inline(always)]
    fn error(&self, steps: f32) -> Lanes {
        self.off + self.between * (1.0 / (steps * steps))
    }
}

/// A way and its estimated error.
pub(super) type Guess = (f32, usize);

/// The `count` ways of least error, best first, the earlier where equal.
pub(super) fn rank<const N: usize>(errors: &[f32], count: usize) -> ([Guess; N], usize) {
    let mut guesses = [(f32::INFINITY, 0); N];
    let count = count.min(N).min(errors.len());
    if count == 0 {
        return (guesses, 0);
    }
    for (way, &error) in errors.iter().enumerate() {
        if error >= guesses[count - 1].0 {
            continue;
        }
        let mut at = count - 1;
        while at > 0 && guesses[at - 1].0 > error {
            guesses[at] = guesses[at - 1];
            at -= 1;
        }
        guesses[at] = (error, way);
    }
    (guesses, count)
}

impl Spreads {
    /// The estimated errors of the partitions for the highest index `steps`.
    pub fn errors(&self, steps: f32) -> [f32; 64] {
        let mut errors = [0.0; 64];
        for (errors, spread) in errors.as_chunks_mut::<4>().0.iter_mut().zip(&self.0) {
            *errors = spread.error(steps).to_array();
        }
        errors
    }
}
