//! Coverage of alpha-tested textures: the share of the surface that passes the test.

use rayon::prelude::*;

use super::mips::wrapped;
use super::role::unorm8;
use crate::scene::Wrap;

/// Fewest and most sample points of a texel in each axis, and how many an axis should have.
const FEWEST: usize = 4;
const MOST: usize = 64;
const AXIS: usize = 256;
/// Largest factor tried; an 8-bit alpha of 1 reaches any cutoff below it.
const LARGEST_SCALE: f32 = 256.0;
const BISECTIONS: usize = 12;
/// Relative distance from the target at which the search ends.
const NEAR_ENOUGH: f64 = 1e-3;

/// An alpha channel as the sampler sees it.
#[derive(Clone, Copy)]
pub(super) struct Grid {
    pub width: u32,
    pub height: u32,
    pub wrap: [Wrap; 2],
    /// Opaque where alpha >= cutoff (glTF 2.0, section 3.9.4).
    pub cutoff: f32,
}

impl Grid {
    /// Sample points of a texel in each axis: the fewer texels, the more.
    fn subsamples(&self) -> usize {
        let longest = self.width.max(self.height) as usize;
        (AXIS / longest.next_power_of_two()).clamp(FEWEST, MOST)
    }

    /// The share in [0,1] of a grid of sample points, at least 4x4 a texel, at which bilinearly filtered alpha
    /// passes. Bilinear, since that is what a shader tests, and since counting texels could not tell apart the
    /// few values that averages of 0 and 1 take.
    pub fn coverage(&self, alpha: &[u8]) -> f64 {
        let width = self.width as usize;
        let subsamples = self.subsamples();
        let threshold = Threshold::new(self.cutoff, subsamples);
        let columns: Vec<[usize; 2]> = neighbours(self.width, self.wrap[0]);
        let rows: Vec<[usize; 2]> = neighbours(self.height, self.wrap[1]);
        let passed: u64 = rows
            .par_iter()
            .enumerate()
            .map(|(y, row)| {
                let y_samples = samples(y, rows.len(), subsamples);
                let lines = row.map(|row| &alpha[row * width..][..width]);
                let mut passed = 0_u64;
                for (x, &column) in columns.iter().enumerate() {
                    let corners = lines.map(|line| column.map(|column| u32::from(line[column])));
                    let x_samples = samples(x, columns.len(), subsamples);
                    passed += threshold.passing(corners, x_samples, y_samples.clone());
                }
                passed
            })
            .sum();
        let total = (self.width as usize * self.height as usize * subsamples * subsamples) as f64;
        passed as f64 / total
    }

    /// The factor on `alpha` (clamped to 1, rounded to 8 bits) whose coverage comes nearest `target`:
    /// bisection, since coverage never falls as the factor grows. 1 where that is near enough.
    pub fn scale_to(&self, alpha: &[f32], target: f64) -> f32 {
        let distance = |coverage: f64| (coverage - target).abs();
        let near_enough = |coverage: f64| distance(coverage) <= NEAR_ENOUGH * target;
        let measure = |scale: f32| self.coverage(&scaled(alpha, scale));
        let mut best = (1.0, measure(1.0));
        let (mut low, mut high) = if best.1 < target {
            (1.0, LARGEST_SCALE)
        } else {
            (1.0 / LARGEST_SCALE, 1.0)
        };
        for _ in 0..BISECTIONS {
            if near_enough(best.1) {
                break;
            }
            let middle = (low * high).sqrt();
            let coverage = measure(middle);
            if distance(coverage) < distance(best.1) {
                best = (middle, coverage);
            }
            if coverage < target {
                low = middle;
            } else {
                high = middle;
            }
        }
        best.0
    }
}

/// `alpha * scale`, clamped, in 8 bits.
pub(super) fn scaled(alpha: &[f32], scale: f32) -> Vec<u8> {
    alpha.par_iter().map(|&a| unorm8(a * scale)).collect()
}

/// The texels to both sides of each of the `extent + 1` texel borders of an axis.
fn neighbours(extent: u32, wrap: Wrap) -> Vec<[usize; 2]> {
    (0..=i64::from(extent))
        .map(|border| [border - 1, border].map(|index| wrapped(index, extent, wrap)))
        .collect()
}

/// The sample points between the centres beside a border that lie inside the image: half of them at its ends.
fn samples(border: usize, borders: usize, subsamples: usize) -> std::ops::Range<usize> {
    if border == 0 {
        subsamples / 2..subsamples
    } else if border + 1 == borders {
        0..subsamples / 2
    } else {
        0..subsamples
    }
}

/// The cutoff in the scale of integer bilinear weights.
struct Threshold {
    value: u32,
    /// The weights of an axis sum to this: twice the sample points of a texel.
    axis: u32,
}

impl Threshold {
    fn new(cutoff: f32, subsamples: usize) -> Self {
        let axis = 2 * subsamples as u32;
        let scale = f64::from(axis) * f64::from(axis);
        Self {
            value: (f64::from(cutoff) * 255.0 * scale).ceil() as u32,
            axis,
        }
    }

    fn passing(
        &self,
        corners: [[u32; 2]; 2],
        x_samples: std::ops::Range<usize>,
        y_samples: std::ops::Range<usize>,
    ) -> u64 {
        let flat = corners.as_flattened();
        let (least, most) = flat.iter().fold((u32::MAX, 0), |(least, most), &a| {
            (least.min(a), most.max(a))
        });
        let scale = self.axis * self.axis;
        if most * scale < self.value {
            return 0;
        }
        if least * scale >= self.value {
            return (x_samples.len() * y_samples.len()) as u64;
        }
        let mut passed = 0;
        for j in y_samples {
            let v = 2 * j as u32 + 1;
            let left = corners[0][0] * (self.axis - v) + corners[1][0] * v;
            let right = corners[0][1] * (self.axis - v) + corners[1][1] * v;
            for i in x_samples.clone() {
                let u = 2 * i as u32 + 1;
                passed += u64::from(left * (self.axis - u) + right * u >= self.value);
            }
        }
        passed
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn grid(width: u32, height: u32, wrap: Wrap) -> Grid {
        Grid {
            width,
            height,
            wrap: [wrap; 2],
            cutoff: 0.5,
        }
    }

    #[test]
    fn extremes() {
        for wrap in [Wrap::Repeat, Wrap::MirroredRepeat, Wrap::ClampToEdge] {
            for (width, height) in [(1, 1), (1, 7), (5, 3)] {
                let grid = grid(width, height, wrap);
                let count = (width * height) as usize;
                assert_eq!(grid.coverage(&vec![255; count]), 1.0);
                assert_eq!(grid.coverage(&vec![127; count]), 0.0);
                // 128/255 is the first code at or above one half.
                assert_eq!(grid.coverage(&vec![128; count]), 1.0);
            }
        }
    }

    #[test]
    fn odd_cutoffs_neither_panic_nor_wrap() {
        for (cutoff, expected) in [
            (-1.0, 1.0),
            (0.0, 1.0),
            (1.0, 1.0),
            (1.5, 0.0),
            (f32::NAN, 1.0),
        ] {
            let grid = Grid {
                cutoff,
                ..grid(2, 2, Wrap::Repeat)
            };
            assert_eq!(grid.coverage(&[255; 4]), expected, "{cutoff}");
        }
    }

    #[test]
    fn half_plane_covers_half() {
        let alpha: Vec<u8> = (0..64)
            .map(|index| if index % 8 < 4 { 255 } else { 0 })
            .collect();
        assert_eq!(grid(8, 8, Wrap::Repeat).coverage(&alpha), 0.5);
        assert_eq!(grid(8, 8, Wrap::ClampToEdge).coverage(&alpha), 0.5);
    }

    proptest! {
        #[test]
        fn agrees_with_a_direct_evaluation(
            width in 1_u32..7, height in 1_u32..7, seed in any::<u64>(), wrap in 0..3_usize, cutoff in 0.01_f32..0.99,
        ) {
            let wrap = [Wrap::Repeat, Wrap::MirroredRepeat, Wrap::ClampToEdge][wrap];
            let alpha: Vec<u8> = (0..u64::from(width * height))
                .map(|i| (seed.wrapping_mul(2 * i + 1).wrapping_add(i << 7) >> 40) as u8)
                .collect();
            let grid = Grid { cutoff, ..grid(width, height, wrap) };
            let at = |x: i64, y: i64| {
                let index = wrapped(y, height, wrap) * width as usize + wrapped(x, width, wrap);
                f64::from(alpha[index])
            };
            let mut passed = 0;
            let side = grid.subsamples() as u32;
            let step = f64::from(side);
            for sy in 0..height * side {
                for sx in 0..width * side {
                    let u = (f64::from(sx) + 0.5) / step - 0.5;
                    let v = (f64::from(sy) + 0.5) / step - 0.5;
                    let (x, y) = (u.floor(), v.floor());
                    let (fx, fy) = (u - x, v - y);
                    let (x, y) = (x as i64, y as i64);
                    let value = (at(x, y) * (1.0 - fx) + at(x + 1, y) * fx) * (1.0 - fy)
                        + (at(x, y + 1) * (1.0 - fx) + at(x + 1, y + 1) * fx) * fy;
                    passed += u32::from(value >= f64::from(cutoff) * 255.0);
                }
            }
            let expected = f64::from(passed) / f64::from(width * height * side * side);
            prop_assert_eq!(grid.coverage(&alpha), expected);
        }
    }
}
