//! The equirectangular input map, read as an energy-preserving bilinear function on the sphere.

use std::f64::consts::PI;

use glam::DVec3;

/// Linear radiance over the whole sphere, row 0 at the zenith (+Y), right-handed, Y up.
///
/// Texel `(i, j)` is centred at `u = (i + 0.5) / width`, `v = (j + 0.5) / height`, where
/// `u = 0.5 + atan2(z, x) / 2 pi` and `v = acos(y) / pi`. Longitude wraps. `texels` holds
/// `width * height` values in row order, finite and not negative (see [`Equirect::sanitize`]).
#[derive(Clone, Debug, PartialEq)]
pub struct Equirect {
    pub width: u32,
    pub height: u32,
    pub texels: Vec<[f32; 3]>,
}

impl Equirect {
    /// Replaces every NaN or negative channel by 0 and every positive infinity by the largest
    /// half, 65504; returns how many texels changed.
    pub fn sanitize(&mut self) -> u64 {
        let mut changed = 0;
        for texel in &mut self.texels {
            let before = *texel;
            for channel in texel.iter_mut() {
                if channel.is_nan() || *channel < 0.0 {
                    *channel = 0.0;
                } else if *channel == f32::INFINITY {
                    *channel = super::cubemap::HALF_MAX;
                }
            }
            changed += u64::from(before.map(f32::to_bits) != texel.map(f32::to_bits));
        }
        changed
    }

    pub(super) fn texel(&self, column: usize, row: usize) -> DVec3 {
        let [r, g, b] = self.texels[row * self.width as usize + column];
        DVec3::new(f64::from(r), f64::from(g), f64::from(b))
    }

    /// Solid angle times radiance summed over all texels, in f64 with exact solid angles.
    pub(super) fn energy(&self, rows: &Rows) -> DVec3 {
        let width = self.width as usize;
        let mut total = DVec3::ZERO;
        for row in 0..self.height as usize {
            let sum: DVec3 = (0..width).map(|column| self.texel(column, row)).sum();
            total += sum * (rows.thickness(row) * 2.0 * PI / width as f64);
        }
        total
    }
}

/// The map's latitude bands, measured in `y` (the sine of latitude, so that solid angle is
/// `dy dphi`).
///
/// Between neighbouring rows radiance is blended by a ramp that is linear in `y` and symmetric
/// about their common edge, as wide as the thinner row allows. Every row's blending function
/// therefore integrates to exactly that row's share of the sphere, and all of them sum to 1
/// everywhere: constants are reproduced and each texel keeps its energy, at the poles too,
/// where a blend linear in latitude would give the first row 8 % too much.
#[derive(Clone, Debug)]
pub(super) struct Rows {
    /// `y` of the upper edge of each row, then -1.
    edges: Vec<f64>,
    /// Half width of the ramp centred on each edge; 0 at the poles.
    ramps: Vec<f64>,
    /// Row at the upper end of each of equally thick slices of `y`, from the top.
    slices: Vec<u32>,
}

/// Slices per row: a row at the equator spans several, so that the search is short there.
const SLICES_PER_ROW: usize = 4;

impl Rows {
    pub fn new(height: u32) -> Self {
        let count = height as usize;
        let edges: Vec<f64> = (0..=count)
            .map(|j| match j {
                0 => 1.0,
                _ if j == count => -1.0,
                _ => libm::cos(PI * j as f64 / count as f64),
            })
            .collect();
        let mut ramps = vec![0.0; count + 1];
        for k in 1..count {
            let above = edges[k - 1] - edges[k];
            let below = edges[k] - edges[k + 1];
            ramps[k] = 0.5 * above.min(below);
        }
        let slices = SLICES_PER_ROW * count;
        let mut row = 0;
        let slices = (0..slices).map(|slice| {
            let y = 1.0 - 2.0 * slice as f64 / slices as f64;
            while row + 1 < count && y < edges[row + 1] {
                row += 1;
            }
            row as u32
        });
        let slices = slices.collect();
        Self {
            edges,
            ramps,
            slices,
        }
    }

    pub fn count(&self) -> usize {
        self.edges.len() - 1
    }

    /// Extent of a row in `y`.
    pub fn thickness(&self, row: usize) -> f64 {
        self.edges[row] - self.edges[row + 1]
    }

    /// `y` at the given fraction (0 at the top) of a row.
    pub fn y_within(&self, row: usize, fraction: f64) -> f64 {
        self.edges[row] - fraction * self.thickness(row)
    }

    /// Upper and lower `y` of the parts of a row in which every blending function is linear.
    pub fn linear_parts(&self, row: usize) -> impl Iterator<Item = (f64, f64)> {
        let (top, bottom) = (self.edges[row], self.edges[row + 1]);
        let (upper, lower) = (top - self.ramps[row], bottom + self.ramps[row + 1]);
        let parts = [(top, upper), (upper, lower), (lower, bottom)];
        parts.into_iter().filter(|(high, low)| high - low > 1e-12)
    }

    fn row_at(&self, y: f64) -> usize {
        let last = self.count() - 1;
        let slice = (0.5 - 0.5 * y).max(0.0) * self.slices.len() as f64;
        let mut row = self.slices[(slice as usize).min(self.slices.len() - 1)] as usize;
        while row > 0 && y > self.edges[row] {
            row -= 1;
        }
        while row < last && y < self.edges[row + 1] {
            row += 1;
        }
        row
    }

    /// Integral over `(-inf, x]` of the ramp at `edge`, which rises from 0 above to 1 below.
    fn below_edge(&self, edge: usize, y: f64) -> f64 {
        let depth = self.edges[edge] - y;
        let half_width = self.ramps[edge];
        if depth <= -half_width {
            0.0
        } else if depth < half_width {
            let rise = depth + half_width;
            rise * rise / (4.0 * half_width)
        } else {
            depth
        }
    }

    /// Calls `visit(row, weight)` with the integral of each row's blending function over
    /// `[low, high]`; the weights are positive and sum to `high - low`.
    pub fn integrate(&self, low: f64, high: f64, mut visit: impl FnMut(usize, f64)) {
        let first = self.row_at(high).saturating_sub(1);
        let mut remaining = high - low;
        for row in first..self.count() {
            let next = if row + 1 < self.count() {
                self.below_edge(row + 1, low) - self.below_edge(row + 1, high)
            } else {
                0.0
            };
            let weight = remaining - next;
            if weight > 0.0 {
                visit(row, weight);
            }
            if next <= 0.0 {
                break;
            }
            remaining = next;
        }
    }

    /// Calls `visit(row, weight)` with each row's blending function at `y`; weights sum to 1.
    pub fn blend(&self, y: f64, mut visit: impl FnMut(usize, f64)) {
        let row = self.row_at(y);
        let ramp = |edge: usize| {
            let half_width = self.ramps[edge];
            if half_width > 0.0 {
                ((self.edges[edge] - y) / (2.0 * half_width) + 0.5).clamp(0.0, 1.0)
            } else {
                f64::from(u8::from(edge == 0))
            }
        };
        let (upper, lower) = (ramp(row), ramp(row + 1));
        if row > 0 {
            visit(row - 1, 1.0 - upper);
        }
        visit(row, upper - lower);
        if row + 1 < self.count() {
            visit(row + 1, lower);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn blending_functions_keep_every_row_and_sum_to_one() {
        for height in [1_u32, 2, 3, 7, 64] {
            let rows = Rows::new(height);
            let mut shares = vec![0.0; height as usize];
            let steps = 997;
            for k in 0..steps {
                let high = 1.0 - 2.0 * f64::from(k) / f64::from(steps);
                let low = 1.0 - 2.0 * f64::from(k + 1) / f64::from(steps);
                let mut sum = 0.0;
                rows.integrate(low, high, |row, weight| {
                    shares[row] += weight;
                    sum += weight;
                });
                assert!((sum - (high - low)).abs() < 1e-14);
            }
            for (row, share) in shares.iter().enumerate() {
                assert!(
                    (share - rows.thickness(row)).abs() < 1e-13,
                    "{height}: {row}"
                );
            }
        }
    }

    #[test]
    fn integral_is_the_integral_of_the_blend() {
        let rows = Rows::new(9);
        let (low, high) = (0.31, 0.97);
        let mut exact = [0.0; 9];
        rows.integrate(low, high, |row, weight| exact[row] += weight);
        let mut summed = [0.0; 9];
        let steps = 200_000;
        for k in 0..steps {
            let y = low + (high - low) * (f64::from(k) + 0.5) / f64::from(steps);
            rows.blend(y, |row, weight| {
                summed[row] += weight * (high - low) / f64::from(steps);
            });
        }
        for row in 0..9 {
            assert!((exact[row] - summed[row]).abs() < 1e-9, "row {row}");
        }
    }

    #[test]
    fn parts_of_a_row_are_linear_and_make_it_up() {
        let rows = Rows::new(7);
        for row in 0..7 {
            let thickness: f64 = rows.linear_parts(row).map(|(high, low)| high - low).sum();
            assert!((thickness - rows.thickness(row)).abs() < 1e-12);
            for (high, low) in rows.linear_parts(row) {
                let own = |y: f64| {
                    let mut share = 0.0;
                    rows.blend(y, |at, weight| {
                        share += if at == row { weight } else { 0.0 }
                    });
                    share
                };
                let at = |t: f64| own(high + (low - high) * t);
                assert!((at(0.25) + at(0.75) - 2.0 * at(0.5)).abs() < 1e-9, "{row}");
            }
        }
    }

    #[test]
    fn sanitize_replaces_and_counts_bad_texels() {
        let mut map = Equirect {
            width: 5,
            height: 1,
            texels: vec![
                [1.0, 2.0, 3.0],
                [f32::NAN, 1.0, 1.0],
                [-1.0, f32::NEG_INFINITY, 0.5],
                [f32::INFINITY, 0.0, 0.0],
                [1e9, 0.0, 0.0],
            ],
        };
        assert_eq!(map.sanitize(), 3);
        assert_eq!(map.texels[1], [0.0, 1.0, 1.0]);
        assert_eq!(map.texels[2], [0.0, 0.0, 0.5]);
        assert_eq!(map.texels[3], [65504.0, 0.0, 0.0]);
        assert_eq!(map.texels[4], [1e9, 0.0, 0.0]);
    }
}
