//! FLIP, the perceived difference when one alternates between two pictures.
//!
//! Andersson, Nilsson, Akenine-Möller, Oskarsson, Åström, Fairchild: "FLIP: A Difference Evaluator for Alternating
//! Images", Proc. ACM Comput. Graph. Interact. Tech. 3(2), 2020. The HDR form: Andersson, Nilsson, Shirley,
//! Akenine-Möller: "Visualizing Errors in Rendered High Dynamic Range Images", Eurographics 2021.

use std::f64::consts::PI;

use super::color::{luminance, rgb_to_lab, rgb_to_ycxcz, ycxcz_to_rgb};
use super::{Picture, SizeMismatch, by_rows};

/// A 0.7 m wide monitor of 3840 pixels at 0.7 m: the paper's.
pub const PIXELS_PER_DEGREE: f64 = 67.0;

/// Exponent of the colour difference.
const QC: f32 = 0.7;
/// Exponent of the feature difference.
const QF: f32 = 0.5;
/// Fraction of the largest difference that is mapped to `PT`.
const PC: f32 = 0.4;
/// Part of the range for differences below that.
const PT: f32 = 0.95;
/// Width of the feature detectors, degrees.
const FEATURE_DEGREES: f64 = 0.082;

/// Contrast sensitivity as sums of Gaussians `a sqrt(pi / b) exp(-pi^2 x^2 / b)`: `(a, b)` of each.
const ACHROMATIC: &[(f64, f64)] = &[(1.0, 0.0047)];
const RED_GREEN: &[(f64, f64)] = &[(1.0, 0.0053)];
const BLUE_YELLOW: &[(f64, f64)] = &[(34.1, 0.04), (13.5, 0.025)];
/// The widest `b` of these: all filters have its radius.
const WIDEST: f64 = 0.04;

/// A map of differences in 0..=1.
#[derive(Clone, Debug, PartialEq)]
pub struct ErrorMap {
    /// Texels of a row.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Row-major.
    pub values: Vec<f32>,
}

impl ErrorMap {
    /// The mean, which is the usual single figure; 0 of an empty map.
    pub fn mean(&self) -> f64 {
        let sum: f64 = self.values.iter().map(|value| f64::from(*value)).sum();
        sum / self.values.len().max(1) as f64
    }
}

/// LDR-FLIP of two pictures in linear RGB, each channel clamped to 0..=1.
///
/// # Errors
/// [`SizeMismatch`].
pub fn ldr(
    test: &Picture,
    reference: &Picture,
    pixels_per_degree: f64,
) -> Result<ErrorMap, SizeMismatch> {
    test.check_size(reference)?;
    let seen = [test, reference].map(|picture| Seen::new(picture, pixels_per_degree));
    let largest = largest_difference();
    let mut values = vec![0.0; test.texels.len()];
    by_rows(&mut values, test.width.max(1), |y, row| {
        for (x, value) in row.iter_mut().enumerate() {
            let at = y * test.width + x;
            let color = redistribute(hyab(seen[0].lab[at], seen[1].lab[at]), largest);
            let feature =
                |index: usize| (seen[0].features[at][index] - seen[1].features[at][index]).abs();
            let feature = feature(0).max(feature(1)) * std::f32::consts::FRAC_1_SQRT_2;
            *value =
                libm::powf(color, 1.0 - libm::powf(feature.clamp(0.0, 1.0), QF)).clamp(0.0, 1.0);
        }
    });
    Ok(ErrorMap {
        width: test.width,
        height: test.height,
        values,
    })
}

/// HDR-FLIP of two pictures in linear radiance: the largest LDR-FLIP over the exposures in which the reference shows
/// anything, through the ACES curve.
///
/// # Errors
/// [`SizeMismatch`].
pub fn hdr(
    test: &Picture,
    reference: &Picture,
    pixels_per_degree: f64,
) -> Result<ErrorMap, SizeMismatch> {
    test.check_size(reference)?;
    let mut map = ErrorMap {
        width: test.width,
        height: test.height,
        values: vec![0.0; test.texels.len()],
    };
    for stop in exposures(reference) {
        let scale = stop.exp2();
        let shown = |picture: &Picture| {
            picture.map(|texel| texel.map(|value| curve(value.max(0.0) * scale)))
        };
        let at_stop = ldr(&shown(test), &shown(reference), pixels_per_degree)?;
        for (value, other) in map.values.iter_mut().zip(&at_stop.values) {
            *value = value.max(*other);
        }
    }
    Ok(map)
}

/// Narkowicz's ACES fit with the exposure of Hill's (0.6) in it: numerator and denominator by power of x.
const CURVE: [[f32; 3]; 2] = [
    [0.0, 0.6 * 0.03, 0.36 * 2.51],
    [0.14, 0.6 * 0.59, 0.36 * 2.43],
];

fn curve(x: f32) -> f32 {
    let [numerator, denominator] = CURVE.map(|c| c[0] + x * (c[1] + x * c[2]));
    (numerator / denominator).clamp(0.0, 1.0)
}

/// Exposures in stops: from the one that takes the brightest texel to 0.85 of white, to the one that takes the
/// median there.
pub(super) fn exposures(reference: &Picture) -> Vec<f32> {
    const TARGET: f32 = 0.85;
    let mut luminances: Vec<f32> = reference
        .texels
        .iter()
        .map(|texel| luminance(*texel))
        .collect();
    luminances.sort_unstable_by(f32::total_cmp);
    let Some(brightest) = luminances
        .last()
        .copied()
        .filter(|brightest| *brightest > 0.0)
    else {
        return vec![0.0];
    };
    let median = luminances[luminances.len() / 2].max(brightest * f32::EPSILON);
    let [c, b, a] = std::array::from_fn(|power| CURVE[0][power] - TARGET * CURVE[1][power]);
    let reach = (-b + (b * b - 4.0 * a * c).sqrt()) / (2.0 * a);
    let (start, stop) = ((reach / brightest).log2(), (reach / median).log2());
    let count = ((stop - start).ceil() as usize).max(2);
    let step = (stop - start) / (count - 1) as f32;
    (0..count)
        .map(|index| start + step * index as f32)
        .collect()
}

/// A picture as the eye has it at this distance.
struct Seen {
    /// CIELAB after contrast sensitivity, chroma scaled by lightness (the Hunt effect).
    lab: Vec<[f32; 3]>,
    /// Strength of edges and of points.
    features: Vec<[f32; 2]>,
}

impl Seen {
    fn new(picture: &Picture, pixels_per_degree: f64) -> Self {
        let mut opponent = vec![[0.0; 3]; picture.texels.len()];
        by_rows(&mut opponent, picture.width.max(1), |y, row| {
            for (x, texel) in row.iter_mut().enumerate() {
                let rgb = picture.texels[y * picture.width + x].map(|value| value.clamp(0.0, 1.0));
                *texel = rgb_to_ycxcz(rgb);
            }
        });
        let size = (picture.width, picture.height);
        Self {
            lab: filtered_lab(&opponent, size, pixels_per_degree),
            features: features(&opponent, size, pixels_per_degree),
        }
    }
}

fn filtered_lab(
    opponent: &[[f32; 3]],
    size: (usize, usize),
    pixels_per_degree: f64,
) -> Vec<[f32; 3]> {
    let filtered = [ACHROMATIC, RED_GREEN, BLUE_YELLOW].into_iter().enumerate();
    let filtered: Vec<Vec<f32>> = filtered
        .map(|(channel, gaussians)| {
            let plane: Vec<f32> = opponent.iter().map(|texel| texel[channel]).collect();
            sensitivity(&plane, size, gaussians, pixels_per_degree)
        })
        .collect();
    let mut lab = vec![[0.0; 3]; opponent.len()];
    by_rows(&mut lab, size.0.max(1), |y, row| {
        for (x, texel) in row.iter_mut().enumerate() {
            let at = y * size.0 + x;
            let rgb = ycxcz_to_rgb([filtered[0][at], filtered[1][at], filtered[2][at]]);
            *texel = hunt(rgb_to_lab(rgb.map(|value| value.clamp(0.0, 1.0))));
        }
    });
    lab
}

/// Convolves with a sum of Gaussians of total weight 1. Each is separable, their sum is not.
fn sensitivity(
    plane: &[f32],
    size: (usize, usize),
    gaussians: &[(f64, f64)],
    pixels_per_degree: f64,
) -> Vec<f32> {
    let radius = (3.0 * (WIDEST / (2.0 * PI * PI)).sqrt() * pixels_per_degree).ceil() as i64;
    let taps = |b: f64| -> Vec<f64> {
        let degrees = |tap: i64| tap as f64 / pixels_per_degree;
        (-radius..=radius)
            .map(|tap| libm::exp(-PI * PI * degrees(tap) * degrees(tap) / b))
            .collect()
    };
    let kernels: Vec<(f64, Vec<f64>)> = gaussians
        .iter()
        .map(|(a, b)| (a * (PI / b).sqrt(), taps(*b)))
        .collect();
    let total: f64 = kernels
        .iter()
        .map(|(weight, taps)| weight * taps.iter().sum::<f64>().powi(2))
        .sum();
    let mut sum = vec![0.0; plane.len()];
    for (weight, taps) in &kernels {
        let along: Vec<f32> = taps.iter().map(|tap| *tap as f32).collect();
        let across: Vec<f32> = taps
            .iter()
            .map(|tap| (tap * weight / total) as f32)
            .collect();
        let part = convolve(plane, size, &along, &across);
        sum.iter_mut()
            .zip(part)
            .for_each(|(sum, part)| *sum += part);
    }
    sum
}

/// Strength of edges (first derivative of a Gaussian) and points (second) of the luminance.
fn features(opponent: &[[f32; 3]], size: (usize, usize), pixels_per_degree: f64) -> Vec<[f32; 2]> {
    let plane: Vec<f32> = opponent
        .iter()
        .map(|texel| (texel[0] + 16.0) / 116.0)
        .collect();
    let deviation = 0.5 * FEATURE_DEGREES * pixels_per_degree;
    let radius = (3.0 * deviation).ceil() as i64;
    let gaussian = |x: f64| libm::exp(-x * x / (2.0 * deviation * deviation));
    let taps = |function: &dyn Fn(f64) -> f64| -> Vec<f64> {
        (-radius..=radius).map(|tap| function(tap as f64)).collect()
    };
    let smooth = taps(&gaussian);
    let smooth_sum: f64 = smooth.iter().sum();
    let smooth: Vec<f32> = smooth.iter().map(|tap| (tap / smooth_sum) as f32).collect();
    let edge = unit_halves(&taps(&|x| -x * gaussian(x)));
    let point = unit_halves(&taps(&|x| {
        (x * x / (deviation * deviation) - 1.0) * gaussian(x)
    }));
    let strength = |detector: &[f32]| -> Vec<f32> {
        let x = convolve(&plane, size, detector, &smooth);
        let y = convolve(&plane, size, &smooth, detector);
        x.iter()
            .zip(&y)
            .map(|(x, y)| libm::hypotf(*x, *y))
            .collect()
    };
    let (edges, points) = (strength(&edge), strength(&point));
    edges
        .into_iter()
        .zip(points)
        .map(|(edge, point)| [edge, point])
        .collect()
}

/// Scales positive taps to the sum 1 and negative ones to -1.
fn unit_halves(taps: &[f64]) -> Vec<f32> {
    let positive: f64 = taps.iter().filter(|tap| **tap > 0.0).sum();
    let negative: f64 = -taps.iter().filter(|tap| **tap < 0.0).sum::<f64>();
    let scaled = taps
        .iter()
        .map(|tap| tap / if *tap > 0.0 { positive } else { negative });
    scaled.map(|tap| tap as f32).collect()
}

/// Convolves rows with `along` and columns with `across`; the border is repeated. Kernels are applied unflipped,
/// which only changes the sign of odd ones.
fn convolve(
    plane: &[f32],
    (width, height): (usize, usize),
    along: &[f32],
    across: &[f32],
) -> Vec<f32> {
    let clamped = |at: usize, tap: usize, radius: usize, size: usize| {
        (at + tap).saturating_sub(radius).min(size - 1)
    };
    let mut rows = vec![0.0; plane.len()];
    by_rows(&mut rows, width.max(1), |y, output| {
        let input = &plane[y * width..][..width];
        let radius = along.len() / 2;
        for (x, value) in output.iter_mut().enumerate() {
            let tap = |(tap, weight): (usize, &f32)| weight * input[clamped(x, tap, radius, width)];
            *value = along.iter().enumerate().map(tap).sum();
        }
    });
    let mut columns = vec![0.0; plane.len()];
    by_rows(&mut columns, width.max(1), |y, output| {
        for (tap, weight) in across.iter().enumerate() {
            let input = &rows[clamped(y, tap, across.len() / 2, height) * width..][..width];
            output
                .iter_mut()
                .zip(input)
                .for_each(|(value, input)| *value += weight * input);
        }
    });
    columns
}

fn hunt([l, a, b]: [f32; 3]) -> [f32; 3] {
    [l, 0.01 * l * a, 0.01 * l * b]
}

/// HyAB (Abasi et al. 2020), raised to `QC`.
fn hyab(a: [f32; 3], b: [f32; 3]) -> f32 {
    libm::powf(
        (a[0] - b[0]).abs() + libm::hypotf(a[1] - b[1], a[2] - b[2]),
        QC,
    )
}

/// Between green and blue.
pub(super) fn largest_difference() -> f32 {
    let [green, blue] = [[0.0, 1.0, 0.0], [0.0, 0.0, 1.0]].map(|rgb| hunt(rgb_to_lab(rgb)));
    hyab(green, blue)
}

/// To 0..=1, most of the range for what is mostly seen.
fn redistribute(difference: f32, largest: f32) -> f32 {
    let knee = PC * largest;
    if difference < knee {
        PT / knee * difference
    } else {
        PT + (difference - knee) / (largest - knee) * (1.0 - PT)
    }
}
