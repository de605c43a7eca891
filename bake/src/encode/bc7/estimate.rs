//! Cheap estimates of what a way of splitting a block would cost, to choose those worth a fit.
//!
//! The error of a subset is taken as what is off its principal axis, and a share of what is along it that
//! the spacing of the indices leaves: with evenly spread values, `1 / steps^2`.

use pulp::{Simd, WithSimd};

use super::partition;
use super::wide::Wide;

/// Sums over texels: of the values, and of their products in the order 00 10 11 20 21 22 30 31 32 33.
#[derive(Clone, Copy)]
struct Sums<S: Simd> {
    count: Wide<S>,
    first: [Wide<S>; 4],
    second: [Wide<S>; 10],
}

/// Scatter of a subset, or of all subsets of a partition.
#[derive(Clone, Copy)]
struct Spread<S: Simd> {
    /// Off the principal axes.
    off: Wide<S>,
    /// Along them, less the share of the two texels that the endpoints meet.
    between: Wide<S>,
}

/// Ways and their estimated errors, best first, `K` at most; ways as numbers in lanes.
#[derive(Clone, Copy)]
pub(super) struct Ranking<S: Simd> {
    pub errors: [Wide<S>; MOST],
    pub ways: [Wide<S>; MOST],
    pub count: usize,
}

/// Most ways that are ranked.
pub(super) const MOST: usize = 32;

impl<S: Simd> Ranking<S> {
    #[inline(always)]
    pub fn new(simd: S, count: usize) -> Self {
        Self {
            errors: [Wide::splat(simd, f32::INFINITY); MOST],
            ways: [Wide::zero(simd); MOST],
            count: count.min(MOST),
        }
    }

    /// Earlier ways stay before later ones of the same error.
    #[inline(always)]
    pub fn add(&mut self, error: Wide<S>, way: Wide<S>) {
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

/// The texels of blocks relative to their first, and their products.
pub(super) struct Products<S: Simd> {
    simd: S,
    first: [[Wide<S>; 16]; 4],
    second: [[Wide<S>; 16]; 10],
}

impl<S: Simd> Products<S> {
    #[inline(always)]
    pub fn new(simd: S, values: &[[Wide<S>; 16]; 4]) -> Self {
        let zero = Wide::zero(simd);
        let mut products = Self {
            simd,
            first: [[zero; 16]; 4],
            second: [[zero; 16]; 10],
        };
        for texel in 0..16 {
            let mut at = 0;
            for a in 0..4 {
                products.first[a][texel] = values[a][texel] - values[a][0];
                for b in 0..=a {
                    products.second[at][texel] =
                        products.first[a][texel] * products.first[b][texel];
                    at += 1;
                }
            }
        }
        products
    }

    /// The sums over the texels of a mask, by the first `C` channels.
    #[inline(always)]
    fn masked<const C: usize>(&self, mask: u16) -> Sums<S> {
        let zero = Wide::zero(self.simd);
        let mut sums = Sums {
            count: Wide::splat(self.simd, mask.count_ones() as f32),
            first: [zero; 4],
            second: [zero; 10],
        };
        let mut rest = mask;
        while rest != 0 {
            let texel = (rest.trailing_zeros() & 15) as usize;
            rest &= rest - 1;
            for channel in 0..C {
                sums.first[channel] += self.first[channel][texel];
            }
            for at in 0..C * (C + 1) / 2 {
                sums.second[at] += self.second[at][texel];
            }
        }
        sums
    }

    /// Estimated error of modes 4 and 5 for each rotation, given the highest colour and scalar index.
    #[inline(always)]
    pub fn rotations(&self, steps: f32, scalar_steps: f32, count: usize) -> Ranking<S> {
        let total = self.masked::<4>(0xffff);
        let mut ranking = Ranking::new(self.simd, count);
        for rotation in 0..4 {
            let channels = VECTORS[rotation];
            let alone = SCALARS[rotation];
            let mut sums = total;
            for a in 0..3 {
                sums.first[a] = total.first[channels[a]];
                for b in 0..=a {
                    let from = product(channels[a], channels[b]);
                    sums.second[product(a, b)] = total.second[from];
                }
            }
            let mean = total.first[alone] * (1.0 / 16.0);
            let scalar = total.second[product(alone, alone)] - mean * total.first[alone];
            let vector = sums.spread::<3>().error(steps);
            let error = vector + scalar * (1.0 / (scalar_steps * scalar_steps));
            ranking.add(error, error.of(rotation as f32));
        }
        ranking
    }
}

/// Where the product of two channels is.
#[inline(always)]
fn product(a: usize, b: usize) -> usize {
    let (a, b) = if a < b { (b, a) } else { (a, b) };
    a * (a + 1) / 2 + b
}

/// The colour channels of each rotation.
const VECTORS: [[usize; 3]; 4] = [[0, 1, 2], [3, 1, 2], [0, 3, 2], [0, 1, 3]];
/// The channel that has its own indices.
pub(super) const SCALARS: [usize; 4] = [3, 0, 1, 2];

/// Ranks the first `partitions` partitions into `subsets` subsets by the first `C` channels, for two highest indices
/// and counts at once: the sums are the same.
pub(super) struct RankPartitions<'a, S: Simd, const C: usize> {
    pub products: &'a Products<S>,
    pub subsets: usize,
    pub partitions: [usize; 2],
    pub steps: [f32; 2],
    pub counts: [usize; 2],
}

impl<S: Simd, const C: usize> RankPartitions<'_, S, C> {
    /// Out of line.
    #[inline(always)]
    pub fn run(self) -> [Ranking<S>; 2] {
        self.products.simd.vectorize(self)
    }

    #[inline(always)]
    fn rank(self) -> [Ranking<S>; 2] {
        let products = self.products;
        let total = products.masked::<C>(0xffff);
        let mut rankings = [
            Ranking::new(products.simd, self.counts[0]),
            Ranking::new(products.simd, self.counts[1]),
        ];
        let most = if self.counts[1] == 0 {
            self.partitions[0]
        } else {
            self.partitions[0].max(self.partitions[1])
        };
        for way in 0..most {
            let [_, second, third] = partition::masks(self.subsets, way);
            let second = products.masked::<C>(second);
            let mut first = total.less(&second);
            let mut spread = second.spread::<C>();
            if self.subsets == 3 {
                let third = products.masked::<C>(third);
                first = first.less(&third);
                spread = spread.plus(third.spread::<C>());
            }
            spread = spread.plus(first.spread::<C>());
            for at in 0..2 {
                if rankings[at].count > 0 && way < self.partitions[at] {
                    let error = spread.error(self.steps[at]);
                    rankings[at].add(error, error.of(way as f32));
                }
            }
        }
        rankings
    }
}

impl<S: Simd, const C: usize> WithSimd for RankPartitions<'_, S, C> {
    type Output = [Ranking<S>; 2];
    #[inline(always)]
    fn with_simd<T: Simd>(self, _: T) -> [Ranking<S>; 2] {
        self.rank()
    }
}

impl<S: Simd> Sums<S> {
    /// The sums over the texels of `self` that are not of `part`; exact, for all are integers.
    #[inline(always)]
    fn less(&self, part: &Self) -> Self {
        let mut rest = *self;
        rest.count = rest.count - part.count;
        for at in 0..4 {
            rest.first[at] = rest.first[at] - part.first[at];
        }
        for at in 0..10 {
            rest.second[at] = rest.second[at] - part.second[at];
        }
        rest
    }

    /// The largest eigenvalue is the fourth root of the trace of the fourth power, nearly: from above, and
    /// the more exact the more it dominates.
    #[inline(always)]
    fn spread<const C: usize>(&self) -> Spread<S> {
        let zero = self.count.of(0.0);
        let inverse = self.count.recip();
        let mut scatter = [[zero; C]; C];
        let mut at = 0;
        let mut all = zero.of(1e-6);
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
        for a in 0..C {
            for b in 0..C {
                scatter[a][b] = scatter[a][b] * scale;
            }
        }
        let mut fourth = zero;
        for a in 0..C {
            for b in 0..=a {
                let mut square = zero;
                for k in 0..C {
                    square += scatter[a][k] * scatter[k][b];
                }
                let square = square * square;
                fourth += if a == b { square } else { square + square };
            }
        }
        let along = fourth.sqrt().sqrt().min(zero.of(1.0)) * all;
        let between = along * (zero.of(1.0) - inverse * 2.0);
        Spread {
            off: all - along,
            between,
        }
    }
}

impl<S: Simd> Spread<S> {
    #[inline(always)]
    fn plus(self, other: Self) -> Self {
        Self {
            off: self.off + other.off,
            between: self.between + other.between,
        }
    }

    #[inline(always)]
    fn error(&self, steps: f32) -> Wide<S> {
        self.off + self.between * (1.0 / (steps * steps))
    }
}
