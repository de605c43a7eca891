//! What endpoints of each mode may be, and the finest mode that holds given ones.

use pulp::Simd;

use super::super::wide::{Mask, Wide};
use super::modes::{MODES, Mode, TWO_REGIONS};
use super::texels::Lines;

/// Half floats' bits that one unit of unquantised endpoints stands for.
pub(super) const UNIT: f32 = 31.0 / 64.0;

/// The endpoints of one mode; points in steps of half floats.
#[derive(Clone, Copy)]
struct Scale {
    step: f32,
    inverse: f32,
    /// Of a step, by which points lie above multiples of it.
    offset: f32,
    /// The highest stored value, which stands for 65535, as 0 stands for 0.
    top: f32,
    /// The largest difference from the first endpoint; the least is one less than its negative.
    reach: [f32; 3],
}

const fn scale(mode: &Mode) -> Scale {
    let step = (1_u32 << (16 - mode.bits)) as f32 * UNIT;
    let mut reach = [65536.0; 3];
    let mut channel = 0;
    while channel < 3 {
        if mode.deltas[channel] > 0 {
            reach[channel] = ((1 << (mode.deltas[channel] - 1)) - 1) as f32;
        }
        channel += 1;
    }
    Scale {
        step,
        inverse: 1.0 / step,
        offset: if mode.bits == 16 { 0.0 } else { 0.5 },
        top: ((1_u32 << mode.bits) - 1) as f32,
        reach,
    }
}

static SCALES: [Scale; 14] = {
    let mut scales = [scale(&MODES[0]); 14];
    let mut at = 0;
    while at < 14 {
        scales[at] = scale(&MODES[at]);
        at += 1;
    }
    scales
};

/// The scale of each lane's mode.
#[derive(Clone, Copy)]
pub(super) struct Grid<S: Simd> {
    pub mode: Wide<S>,
    step: Wide<S>,
    inverse: Wide<S>,
    offset: Wide<S>,
    top: Wide<S>,
    reach: [Wide<S>; 3],
}

impl<S: Simd> Grid<S> {
    #[inline(always)]
    fn of(simd: S, mode: usize) -> Self {
        let scale = &SCALES[mode];
        let [r, g, b] = scale.reach;
        Self {
            mode: Wide::splat(simd, mode as f32),
            step: Wide::splat(simd, scale.step),
            inverse: Wide::splat(simd, scale.inverse),
            offset: Wide::splat(simd, scale.offset),
            top: Wide::splat(simd, scale.top),
            reach: [
                Wide::splat(simd, r),
                Wide::splat(simd, g),
                Wide::splat(simd, b),
            ],
        }
    }

    /// The finest mode of `R` regions whose differences reach from the first point to the others.
    #[inline(always)]
    pub fn finest<const R: usize>(simd: S, points: &Lines<S>) -> Self {
        let zero = Wide::zero(simd);
        let mut farthest = [zero; 3];
        for region in 0..R {
            for end in 0..2 {
                for channel in 0..3 {
                    let off = points[region][end][channel] - points[0][0][channel];
                    farthest[channel] = farthest[channel].max(off.max(zero - off));
                }
            }
        }
        let modes = if R == 1 {
            TWO_REGIONS..14
        } else {
            0..TWO_REGIONS
        };
        let mut grid = Self::of(simd, modes.start);
        for mode in modes.skip(1) {
            let Scale { step, reach, .. } = SCALES[mode];
            let mut share = zero;
            for channel in 0..3 {
                share = share.max(farthest[channel] * (1.0 / (reach[channel] * step)));
            }
            let fits = share.less(Wide::splat(simd, 1.0));
            let finer = Self::of(simd, mode);
            grid = Self::choose(fits, &finer, &grid);
        }
        grid
    }

    /// `yes` where chosen, else `no`.
    #[inline(always)]
    pub fn choose(mask: Mask<S>, yes: &Self, no: &Self) -> Self {
        Self {
            mode: mask.select(yes.mode, no.mode),
            step: mask.select(yes.step, no.step),
            inverse: mask.select(yes.inverse, no.inverse),
            offset: mask.select(yes.offset, no.offset),
            top: mask.select(yes.top, no.top),
            reach: mask.select_all(yes.reach, no.reach),
        }
    }

    /// Nearest stored values of points.
    #[inline(always)]
    pub fn store<const R: usize>(&self, points: &Lines<S>) -> Lines<S> {
        let mut stored = *points;
        for region in 0..R {
            for end in 0..2 {
                for value in &mut stored[region][end] {
                    *value = (*value * self.inverse - self.offset).round();
                }
            }
        }
        self.bound::<R>(&mut stored);
        stored
    }

    /// Moves stored values to where the mode holds them.
    #[inline(always)]
    pub fn bound<const R: usize>(&self, stored: &mut Lines<S>) {
        let (zero, one) = (self.top.of(0.0), self.top.of(1.0));
        for channel in 0..3 {
            let base = stored[0][0][channel].max(zero).min(self.top);
            let least = (base - self.reach[channel] - one).max(zero);
            let most = (base + self.reach[channel]).min(self.top);
            for region in 0..R {
                for end in 0..2 {
                    let value = &mut stored[region][end][channel];
                    *value = value.max(least).min(most);
                }
            }
            stored[0][0][channel] = base;
        }
    }

    /// The point that a stored value stands for.
    #[inline(always)]
    pub fn expand(&self, stored: Wide<S>) -> Wide<S> {
        let zero = self.top.of(0.0);
        let inner = (stored + self.offset) * self.step;
        let positive = zero.less(stored).select(inner, zero);
        stored
            .less(self.top)
            .select(positive, self.top.of(65535.0 * UNIT))
    }
}
