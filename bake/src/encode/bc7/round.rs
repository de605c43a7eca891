//! Least squares over the lattice of endpoints that can be stored.

use pulp::Simd;

use super::grid::Grid;
use super::measure::{Ends, Shares};
use super::wide::Wide;

/// The squared error that endpoints add to the least, of one channel: `low^2 aa + 2 low high ab + high^2 bb` of their
/// distances from the optimum.
struct Form<S: Simd> {
    aa: Wide<S>,
    ab: Wide<S>,
    bb: Wide<S>,
}

/// Values that can be stored, near the optimum, of one end at one parity.
#[derive(Clone, Copy)]
struct Near<S: Simd> {
    stored: [Wide<S>; 2],
    off: [Wide<S>; 2],
}

/// The stored endpoints of least squared error at the indices of `shares`, nearly: of those just below and above the
/// optimum, and of all `parities`. The optimum is the mean where all indices are one.
#[inline(always)]
pub(super) fn best_ends<S: Simd, const C: usize>(
    grid: &Grid,
    parities: &[[usize; 2]],
    count: Wide<S>,
    sum: &[Wide<S>; C],
    shares: &Shares<S>,
) -> Ends<S> {
    let zero = count.of(0.0);
    let (form, optima) = solve::<S, C>(count, sum, shares);
    let none = Near {
        stored: [zero; 2],
        off: [zero; 2],
    };
    let mut near = [[[none; 2]; 2]; C];
    for channel in 0..C {
        for end in 0..2 {
            for parity in 0..2 {
                if grid.occurs[parity] {
                    near[channel][end][parity] = neighbours(grid, optima[channel][end], parity);
                }
            }
        }
    }
    let mut best = Ends::none(zero.simd());
    let mut least = zero.of(f32::INFINITY);
    for pair in parities {
        let mut cost = zero;
        let mut stored = [[zero; C]; 2];
        for channel in 0..C {
            let [lows, highs] = &near[channel];
            let (error, ends) = form.least(&lows[pair[0]], &highs[pair[1]]);
            cost += error;
            stored[0][channel] = ends[0];
            stored[1][channel] = ends[1];
        }
        let less = cost.less(least);
        least = cost.min(least);
        for end in 0..2 {
            for channel in 0..C {
                let kept = &mut best.stored[end][channel];
                *kept = less.select(stored[end][channel], *kept);
            }
            let parity = zero.of(pair[end] as f32);
            best.parity[end] = less.select(parity, best.parity[end]);
        }
    }
    best
}

#[inline(always)]
fn solve<S: Simd, const C: usize>(
    count: Wide<S>,
    sum: &[Wide<S>; C],
    shares: &Shares<S>,
) -> (Form<S>, [[Wide<S>; 2]; C]) {
    let (b, bb) = (shares.first, shares.second);
    let (aa, ab) = (count - b * 2.0 + bb, b - bb);
    let determinant = aa * bb - ab * ab;
    let solvable = count.of(1e-3).less(determinant);
    let inverse = solvable.select(determinant, count.of(1.0)).recip();
    let mean = count.recip();
    let mut optima = [[mean; 2]; C];
    for channel in 0..C {
        let right = shares.values[channel];
        let left = sum[channel] - right;
        let low = (left * bb - right * ab) * inverse;
        let high = (right * aa - left * ab) * inverse;
        let middle = sum[channel] * mean;
        optima[channel][0] = solvable.select(low, middle);
        optima[channel][1] = solvable.select(high, middle);
    }
    (Form { aa, ab, bb }, optima)
}

#[inline(always)]
fn neighbours<S: Simd>(grid: &Grid, value: Wide<S>, parity: usize) -> Near<S> {
    let bit = parity as f32;
    let position = grid.position(value.clamp(0.0, 255.0), bit);
    let below = (position - value.of(0.5)).round();
    let low = below.clamp(0.0, grid.top);
    let high = (below + value.of(1.0)).clamp(0.0, grid.top);
    let bit = value.of(bit);
    Near {
        stored: [low, high],
        off: [
            grid.expand(low, bit) - value,
            grid.expand(high, bit) - value,
        ],
    }
}

impl<S: Simd> Form<S> {
    /// The least of the four pairs, and that pair.
    #[inline(always)]
    fn least(&self, lows: &Near<S>, highs: &Near<S>) -> (Wide<S>, [Wide<S>; 2]) {
        let mut least = self.aa.of(f32::INFINITY);
        let mut kept = [lows.stored[0], highs.stored[0]];
        for low in 0..2 {
            let off = lows.off[low];
            let (own, mixed) = (off * off * self.aa, off * self.ab * 2.0);
            for high in 0..2 {
                let off = highs.off[high];
                let error = own + (mixed + off * self.bb) * off;
                let less = error.less(least);
                least = error.min(least);
                kept[0] = less.select(lows.stored[low], kept[0]);
                kept[1] = less.select(highs.stored[high], kept[1]);
            }
        }
        (least, kept)
    }
}
