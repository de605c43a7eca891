//! Cheap estimates of what a way of storing a block would cost, to choose those worth a fit.
//!
//! The error of a subset is taken as what is off its principal axis, a share of what is along it that the spacing of
//! the indices leaves (with many evenly spread values, `1 / steps^2`), and what the rounding of the endpoints adds.

use pulp::{Simd, WithSimd};

use super::grid::{GRIDS, Grid, rotated_grids};
use super::jobs::Way;
use super::modes::MODES;
use super::partition;
use super::preset::Preset;
use super::texels::{Gather, MOST_LANES, Packed, Values};
use super::wide::Wide;

/// Sums over texels: of the values, and of their products in the order 00 10 11 20 21 22 30 31 32 33.
#[derive(Clone, Copy)]
struct Sums<S: Simd> {
    count: f32,
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

/// Ways and their estimated errors, best first; ways as numbers in lanes.
struct Ranking<S: Simd> {
    errors: [Wide<S>; MOST],
    ways: [Wide<S>; MOST],
    count: usize,
}

/// Most ways that are ranked of one mode.
const MOST: usize = 32;

impl<S: Simd> Ranking<S> {
    #[inline(always)]
    fn new(simd: S, count: usize) -> Self {
        Self {
            errors: [Wide::splat(simd, f32::INFINITY); MOST],
            ways: [Wide::zero(simd); MOST],
            count: count.min(MOST),
        }
    }

    /// Earlier ways stay before later ones of the same error.
    #[inline(always)]
    fn add(&mut self, error: Wide<S>, way: f32) {
        if self.count == 0 || !error.less(self.errors[self.count - 1]).any() {
            return;
        }
        let (mut error, mut way) = (error, error.of(way));
        for at in 0..self.count {
            let (kept, other) = (self.errors[at], self.ways[at]);
            let less = error.less(kept);
            self.errors[at] = error.min(kept);
            self.ways[at] = less.select(way, other);
            error = less.select(kept, error);
            way = less.select(other, way);
        }
    }
}

/// The ways of least estimated error of several blocks.
pub(super) struct Ranked {
    entries: Vec<Entry>,
    order: Vec<(f32, Way)>,
}

struct Entry {
    errors: [f32; MOST_LANES],
    ways: [f32; MOST_LANES],
    list: List,
}

#[derive(Clone, Copy)]
enum List {
    /// Partitions of a mode.
    Partitions(u8),
    /// Modes 4 and 5: the place in `APART`, times four, and the rotation.
    Apart,
}

/// Modes that store one channel apart, and whether their indices are swapped.
const APART: [(u8, bool); 3] = [(5, false), (4, false), (4, true)];

impl List {
    fn way(self, number: f32) -> Way {
        let number = number as u8;
        match self {
            Self::Partitions(mode) => Way::new(mode, number),
            Self::Apart => {
                let (mode, swapped_indices) = APART[usize::from(number / 4)];
                Way {
                    mode,
                    partition: number % 4,
                    swapped_indices,
                }
            }
        }
    }
}

impl Ranked {
    pub fn new() -> Self {
        Self {
            entries: Vec::new(),
            order: Vec::new(),
        }
    }

    #[inline(always)]
    fn extend<S: Simd>(&mut self, list: List, ranking: &Ranking<S>) {
        for at in 0..ranking.count {
            let mut entry = Entry {
                errors: [0.0; MOST_LANES],
                ways: [0.0; MOST_LANES],
                list,
            };
            entry.errors[..S::F32_LANES].copy_from_slice(ranking.errors[at].lanes());
            entry.ways[..S::F32_LANES].copy_from_slice(ranking.ways[at].lanes());
            self.entries.push(entry);
        }
    }

    /// The ways of one block whose estimated error is no more than `most`, best first, `count` at most.
    pub fn best(&mut self, lane: usize, most: f32, count: usize) -> impl Iterator<Item = Way> {
        self.order.clear();
        for entry in &self.entries {
            let error = entry.errors[lane];
            if error <= most && error.is_finite() {
                self.order.push((error, entry.list.way(entry.ways[lane])));
            }
        }
        self.order.sort_by(|a, b| a.0.total_cmp(&b.0));
        self.order.iter().take(count).map(|(_, way)| *way)
    }
}

/// Ranks the ways of blocks, one in each lane, into `ranked`.
pub(super) struct Estimate<'a> {
    pub blocks: &'a [Packed],
    pub slots: [u32; MOST_LANES],
    pub opaque: bool,
    pub preset: &'a Preset,
    pub ranked: &'a mut Ranked,
}

impl WithSimd for Estimate<'_> {
    type Output = ();
    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let mut values = [[Wide::zero(simd); 16]; 4];
        simd.vectorize(Gather {
            simd,
            blocks: self.blocks,
            slots: self.slots,
            values: &mut values,
        });
        let products = Products::new(simd, &values);
        let ranked = self.ranked;
        ranked.entries.clear();
        let [zero, one, two, three, seven] = self.preset.partitions;
        if self.opaque {
            products.ranked::<3>(ranked, 2, [(1, one), (3, three)]);
            if zero + two > 0 {
                products.ranked::<3>(ranked, 3, [(0, zero), (2, two)]);
            }
        } else {
            products.ranked::<4>(ranked, 2, [(7, seven), (7, 0)]);
        }
        let counts = self.preset.rotated[usize::from(self.opaque)];
        if counts != [0; 2] {
            for ranking in &products.rotations(counts) {
                ranked.extend(List::Apart, ranking);
            }
        }
    }
}

/// The texels of blocks relative to their first, and their products.
struct Products<S: Simd> {
    simd: S,
    first: [[Wide<S>; 16]; 4],
    second: [[Wide<S>; 16]; 10],
}

impl<S: Simd> Products<S> {
    #[inline(always)]
    fn new(simd: S, values: &Values<S>) -> Self {
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
            count: 0.0,
            first: [zero; 4],
            second: [zero; 10],
        };
        self.change::<C>(&mut sums, 0, mask);
        sums
    }

    /// Makes the sums over the texels of one mask those of another; exact, for all are integers.
    #[inline(always)]
    fn change<const C: usize>(&self, sums: &mut Sums<S>, from: u16, to: u16) {
        sums.count = to.count_ones() as f32;
        let mut more = to & !from;
        while more != 0 {
            let texel = (more.trailing_zeros() & 15) as usize;
            more &= more - 1;
            for channel in 0..C {
                sums.first[channel] += self.first[channel][texel];
            }
            for at in 0..C * (C + 1) / 2 {
                sums.second[at] += self.second[at][texel];
            }
        }
        let mut fewer = from & !to;
        while fewer != 0 {
            let texel = (fewer.trailing_zeros() & 15) as usize;
            fewer &= fewer - 1;
            for channel in 0..C {
                sums.first[channel] = sums.first[channel] - self.first[channel][texel];
            }
            for at in 0..C * (C + 1) / 2 {
                sums.second[at] = sums.second[at] - self.second[at][texel];
            }
        }
    }

    #[inline(always)]
    fn ranked<const C: usize>(&self, ranked: &mut Ranked, subsets: usize, modes: [(u8, usize); 2]) {
        let rankings = RankPartitions::<S, C> {
            products: self,
            subsets,
            modes,
        }
        .run();
        for (ranking, (mode, _)) in rankings.iter().zip(modes) {
            ranked.extend(List::Partitions(mode), ranking);
        }
    }

    /// Ranks the ways of modes 4 and 5.
    #[inline(always)]
    fn rotations(&self, [four, five]: [usize; 2]) -> [Ranking<S>; 2] {
        let total = self.masked::<4>(0xffff);
        let mut rankings = [Ranking::new(self.simd, four), Ranking::new(self.simd, five)];
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
            let scatter = total.second[product(alone, alone)] - mean * total.first[alone];
            let scalar = Spread {
                off: mean.of(0.0),
                between: scatter,
            };
            let vector = sums.spread::<3>();
            for (at, (mode, swapped_indices)) in APART.into_iter().enumerate() {
                let [grid, scalar_grid] = rotated_grids(usize::from(mode), swapped_indices);
                let error = vector.error(grid, 3) + scalar.error(scalar_grid, 1);
                rankings[usize::from(mode - 4)].add(error, (4 * at + rotation) as f32);
            }
        }
        rankings
    }
}

/// The partitions into two and three subsets, each next to one that differs in few texels.
static TOURS: [[u8; 64]; 2] = [tour(2), tour(3)];

const fn tour(subsets: usize) -> [u8; 64] {
    let mut tour = [0; 64];
    let mut seen = [false; 64];
    seen[0] = true;
    let mut at = 1;
    while at < 64 {
        let here = partition::masks(subsets, tour[at - 1] as usize);
        let (mut least, mut next) = (u32::MAX, 0);
        let mut way = 1;
        while way < 64 {
            let there = partition::masks(subsets, way);
            let changes = (here[1] ^ there[1]).count_ones() + (here[2] ^ there[2]).count_ones();
            if !seen[way] && changes < least {
                (least, next) = (changes, way);
            }
            way += 1;
        }
        seen[next] = true;
        tour[at] = next as u8;
        at += 1;
    }
    tour
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
const SCALARS: [usize; 4] = [3, 0, 1, 2];

/// Ranks the partitions of two modes of as many subsets by the first `C` channels; the sums are the same. Modes come
/// with how many are wanted.
struct RankPartitions<'a, S: Simd, const C: usize> {
    products: &'a Products<S>,
    subsets: usize,
    modes: [(u8, usize); 2],
}

impl<S: Simd, const C: usize> RankPartitions<'_, S, C> {
    /// Out of line.
    #[inline(always)]
    fn run(self) -> [Ranking<S>; 2] {
        self.products.simd.vectorize(self)
    }

    #[inline(always)]
    fn rank(self) -> [Ranking<S>; 2] {
        let products = self.products;
        let total = products.masked::<C>(0xffff);
        let [(_, first), (_, second)] = self.modes;
        let mut rankings = [
            Ranking::new(products.simd, first),
            Ranking::new(products.simd, second),
        ];
        let ways = self.modes.map(|(mode, count)| match count {
            0 => 0,
            _ => 1 << MODES[usize::from(mode)].partition_bits,
        });
        let mut masks = [0; 3];
        let [mut second, mut third] = [products.masked::<C>(0); 2];
        for &way in &TOURS[self.subsets - 2] {
            let way = usize::from(way);
            if way >= ways[0].max(ways[1]) {
                continue;
            }
            let [_, from, other] = masks;
            masks = partition::masks(self.subsets, way);
            products.change::<C>(&mut second, from, masks[1]);
            let mut first = total.less::<C>(&second);
            let mut spread = second.spread::<C>();
            if self.subsets == 3 {
                products.change::<C>(&mut third, other, masks[2]);
                first = first.less::<C>(&third);
                spread = spread.plus(third.spread::<C>());
            }
            spread = spread.plus(first.spread::<C>());
            for at in 0..2 {
                if way < ways[at] {
                    let grid = &GRIDS[usize::from(self.modes[at].0)];
                    rankings[at].add(spread.error(grid, C), way as f32);
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
    fn less<const C: usize>(&self, part: &Self) -> Self {
        let mut rest = *self;
        rest.count -= part.count;
        for at in 0..C {
            rest.first[at] = rest.first[at] - part.first[at];
        }
        for at in 0..C * (C + 1) / 2 {
            rest.second[at] = rest.second[at] - part.second[at];
        }
        rest
    }

    /// The largest eigenvalue of the scatter is taken as it is where all others are equal; then it follows from the
    /// traces of the scatter and of its square.
    #[inline(always)]
    fn spread<const C: usize>(&self) -> Spread<S> {
        let zero = self.first[0].of(0.0);
        let inverse = 1.0 / self.count;
        let (mut diagonal, mut beside, mut all) = (zero, zero, zero);
        let mut at = 0;
        for a in 0..C {
            let mean = self.first[a] * inverse;
            for b in 0..=a {
                let value = self.second[at] - self.first[b] * mean;
                if a == b {
                    all += value;
                    diagonal += value * value;
                } else {
                    beside += value * value;
                }
                at += 1;
            }
        }
        let dimensions = C as f32;
        let square = diagonal + beside + beside;
        let rest = (square * dimensions - all * all) * (dimensions - 1.0);
        let along = (all + rest.max(zero).sqrt()) * (1.0 / dimensions);
        let along = along.min(all);
        Spread {
            off: all - along,
            between: along * (1.0 - 2.0 * inverse),
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

    /// On a grid of some channels.
    #[inline(always)]
    fn error(&self, grid: &Grid, channels: usize) -> Wide<S> {
        let spacing = self.between * (grid.clustering / (grid.steps * grid.steps));
        self.off + spacing + spacing.of(grid.noise * (16 * channels) as f32)
    }
}
