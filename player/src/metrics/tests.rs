//! The metrics against textbook values and a naive f64 twin of FLIP.

use std::f64::consts::PI;

use super::color::{self, RGB_TO_XYZ};
use super::flip::{self, PIXELS_PER_DEGREE};
use super::*;

fn flat(size: usize, rgb: [f32; 3]) -> Picture {
    Picture {
        width: size,
        height: size,
        texels: vec![rgb; size * size],
    }
}

/// Smooth colours with an edge, a dot and noise, from a hash.
fn scene(width: usize, height: usize, seed: u32) -> Picture {
    let texel = |index: usize| {
        let (x, y) = (index % width, index / width);
        std::array::from_fn(|channel| {
            let hash = (index as u32 * 3 + channel as u32 + seed).wrapping_mul(2_654_435_761) >> 16;
            let noise = hash as f32 / 65536.0 * 0.1;
            let edge = if x > width / 2 + seed as usize % 3 {
                0.4
            } else {
                0.0
            };
            let dot = if (x, y) == (3, 4 + seed as usize % 2) {
                0.4
            } else {
                0.0
            };
            let slope = 0.1 * (channel + 1) as f32 * y as f32 / height as f32;
            noise + edge + dot + slope
        })
    };
    Picture {
        width,
        height,
        texels: (0..width * height).map(texel).collect(),
    }
}

#[test]
fn colours_match_published_values() {
    // CIELAB of the sRGB primaries, D65.
    for (rgb, lab) in [
        ([1.0, 0.0, 0.0], [53.24, 80.09, 67.20]),
        ([0.0, 1.0, 0.0], [87.73, -86.18, 83.18]),
        ([0.0, 0.0, 1.0], [32.30, 79.19, -107.86]),
        ([1.0, 1.0, 1.0], [100.0, 0.0, 0.0]),
    ] {
        let found = color::rgb_to_lab(rgb);
        for channel in 0..3 {
            assert!(
                (found[channel] - lab[channel]).abs() < 0.02,
                "{rgb:?}: {found:?}"
            );
        }
        let back = color::ycxcz_to_rgb(color::rgb_to_ycxcz(rgb));
        for channel in 0..3 {
            assert!(
                (back[channel] - rgb[channel]).abs() < 1e-5,
                "{rgb:?}: {back:?}"
            );
        }
    }
    for byte in 0..=255u8 {
        let value = f32::from(byte) / 255.0;
        let back = color::linear_to_srgb(color::srgb_to_linear(value));
        assert!((back - value).abs() < 1e-6);
    }
    let bytes: Vec<u8> = (0..=255)
        .flat_map(|byte| [byte, 255 - byte, 7, 255])
        .collect();
    assert_eq!(Picture::from_srgb8(16, 16, &bytes).to_srgb8(), bytes);
}

#[test]
fn differences_are_those_of_the_definitions() {
    let found =
        difference(&flat(4, [0.5, 0.25, 1.0]), &flat(4, [0.25, 0.25, 0.0])).expect("one size");
    assert!((found.rmse - ((0.0625 + 1.0) / 3.0_f64).sqrt()).abs() < 1e-9);
    assert!((found.relative - (0.25 / 0.26 + 100.0) / 3.0).abs() < 1e-9);
    assert!((found.bias - 2.5).abs() < 1e-9);
    let wrong = difference(&flat(4, [0.0; 3]), &flat(5, [0.0; 3]));
    assert_eq!(wrong, Err(SizeMismatch(4, 4, 5, 5)));
}

#[test]
fn flip_of_flat_pictures_is_the_colour_difference_alone() {
    let mean = |a, b| {
        flip::ldr(&flat(24, a), &flat(24, b), PIXELS_PER_DEGREE)
            .expect("one size")
            .mean()
    };
    assert_eq!(mean([0.3, 0.2, 0.9], [0.3, 0.2, 0.9]), 0.0);
    // Lightness 0 against 100: 100^0.7 = 25.12, above the knee of 0.4 * 41.27.
    let white = mean([0.0; 3], [1.0; 3]);
    assert!((white - 0.967).abs() < 5e-4, "{white}");
    // The two colours that are defined to be 1 apart.
    let extreme = mean([0.0, 1.0, 0.0], [0.0, 0.0, 1.0]);
    assert!((extreme - 1.0).abs() < 1e-4, "{extreme}");
    assert!(
        (flip::largest_difference() - 41.27).abs() < 0.03,
        "{}",
        flip::largest_difference()
    );
}

#[test]
fn flip_agrees_with_a_naive_twin_in_f64() {
    let (a, b) = (scene(40, 31, 0), scene(40, 31, 1));
    for pixels_per_degree in [20.0, PIXELS_PER_DEGREE] {
        let found = flip::ldr(&a, &b, pixels_per_degree).expect("one size");
        let expected = twin::ldr(&a, &b, pixels_per_degree);
        let mut worst = 0.0f64;
        for (found, expected) in found.values.iter().zip(&expected) {
            worst = worst.max((f64::from(*found) - expected).abs());
        }
        assert!(worst < 2e-3, "{worst} at {pixels_per_degree}");
        let mean: f64 = expected.iter().sum::<f64>() / expected.len() as f64;
        assert!(
            (found.mean() - mean).abs() < 2e-5 && mean > 0.05,
            "{} {mean}",
            found.mean()
        );
    }
}

#[test]
fn flip_is_symmetric_and_grows_with_distance_to_the_viewer() {
    let (a, b) = (scene(48, 32, 0), scene(48, 32, 2));
    let mean = |a, b, ppd| flip::ldr(a, b, ppd).expect("one size").mean();
    assert!((mean(&a, &b, 67.0) - mean(&b, &a, 67.0)).abs() < 1e-9);
    // Noise is seen from nearby, and fuses from afar.
    assert!(mean(&a, &b, 20.0) > mean(&a, &b, 120.0));
}

#[test]
fn hdr_flip_sees_what_one_exposure_hides() {
    let mut bright = flat(32, [0.18; 3]);
    bright.texels[..64].fill([50.0; 3]);
    let mut brighter = bright.clone();
    brighter.texels[..64].fill([100.0; 3]);
    let clipped = flip::ldr(&brighter, &bright, PIXELS_PER_DEGREE).expect("one size");
    assert_eq!(clipped.mean(), 0.0);
    let seen = flip::hdr(&brighter, &bright, PIXELS_PER_DEGREE).expect("one size");
    assert!(
        seen.values[0] > 0.05 && seen.values[32 * 31] < 1e-3,
        "{}",
        seen.values[0]
    );
    let stops = flip::exposures(&bright);
    // From 50 to the median of 0.18: log2(277.8) = 8.1 stops.
    assert_eq!(stops.len(), 9);
    assert!((stops[8] - stops[0] - (50.0f32 / 0.18).log2()).abs() < 1e-4);
    assert_eq!(flip::exposures(&flat(2, [0.0; 3])), [0.0]);
}

#[test]
fn the_heatmap_gets_lighter_with_the_error() {
    let lightness = |step: u32| {
        let linear = heatmap::color(step as f32 / 64.0).map(color::srgb_to_linear);
        color::rgb_to_lab(linear)[0]
    };
    for step in 1..=64 {
        let (low, high) = (lightness(step - 1), lightness(step));
        assert!(high > low + 0.3 && high < low + 3.0, "{step}: {low} {high}");
    }
    assert_eq!(heatmap::color(f32::NAN.max(-1.0)), heatmap::color(0.0));
}

#[test]
fn empty_pictures_have_no_difference() {
    let empty = flat(0, [0.0; 3]);
    assert_eq!(
        flip::ldr(&empty, &empty, 67.0).expect("one size").mean(),
        0.0
    );
    assert_eq!(difference(&empty, &empty).expect("one size").rmse, 0.0);
}

/// FLIP as the paper has it: 2D kernels, f64, no shortcuts.
mod twin {
    use super::*;

    type Plane = Vec<f64>;

    fn xyz(rgb: [f64; 3]) -> [f64; 3] {
        std::array::from_fn(|row| {
            let white: f64 = RGB_TO_XYZ[row].iter().sum();
            (0..3)
                .map(|column| RGB_TO_XYZ[row][column] * rgb[column])
                .sum::<f64>()
                / white
        })
    }

    fn lab(rgb: [f64; 3]) -> [f64; 3] {
        let f = xyz(rgb).map(|t| {
            if t > 216.0 / 24389.0 {
                t.cbrt()
            } else {
                (24389.0 / 27.0 * t + 16.0) / 116.0
            }
        });
        let l = 116.0 * f[1] - 16.0;
        [
            l,
            0.01 * l * 500.0 * (f[0] - f[1]),
            0.01 * l * 200.0 * (f[1] - f[2]),
        ]
    }

    /// Solves `RGB_TO_XYZ rgb = xyz` by Cramer's rule.
    fn rgb(relative: [f64; 3]) -> [f64; 3] {
        let m = RGB_TO_XYZ;
        let v: [f64; 3] = std::array::from_fn(|row| relative[row] * m[row].iter().sum::<f64>());
        let det = |m: &[[f64; 3]; 3]| glam::DMat3::from_cols_array_2d(m).determinant();
        std::array::from_fn(|column| {
            let mut replaced = m;
            (0..3).for_each(|row| replaced[row][column] = v[row]);
            det(&replaced) / det(&m)
        })
    }

    fn convolve(
        plane: &Plane,
        (w, h): (i64, i64),
        radius: i64,
        kernel: &dyn Fn(f64, f64) -> f64,
    ) -> Plane {
        let at = |x: i64, y: i64| plane[(y.clamp(0, h - 1) * w + x.clamp(0, w - 1)) as usize];
        let texel = |index: i64| {
            let (x, y) = (index % w, index / w);
            let mut sum = 0.0;
            for dy in -radius..=radius {
                for dx in -radius..=radius {
                    sum += kernel(dx as f64, dy as f64) * at(x + dx, y + dy);
                }
            }
            sum
        };
        (0..w * h).map(texel).collect()
    }

    fn sum(radius: i64, kernel: &dyn Fn(f64, f64) -> f64) -> f64 {
        let taps = (-radius..=radius).flat_map(|y| (-radius..=radius).map(move |x| (x, y)));
        taps.map(|(x, y)| kernel(x as f64, y as f64)).sum()
    }

    fn seen(picture: &Picture, ppd: f64) -> (Vec<[f64; 3]>, Vec<[f64; 2]>) {
        let size = (picture.width as i64, picture.height as i64);
        let texels = picture
            .texels
            .iter()
            .map(|texel| xyz(texel.map(|v| f64::from(v).clamp(0.0, 1.0))));
        let opponent: Vec<[f64; 3]> = texels.map(|[x, y, z]| [y, x - y, y - z]).collect();
        let plane =
            |channel: usize| -> Plane { opponent.iter().map(|texel| texel[channel]).collect() };
        let radius = (3.0 * (0.04 / (2.0 * PI * PI)).sqrt() * ppd).ceil() as i64;
        let parameters = [
            [1.0, 0.0047, 0.0, 1e-5],
            [1.0, 0.0053, 0.0, 1e-5],
            [34.1, 0.04, 13.5, 0.025],
        ];
        let filtered: [Plane; 3] = std::array::from_fn(|channel| {
            let [a1, b1, a2, b2] = parameters[channel];
            let kernel = |x: f64, y: f64| {
                let z = (x * x + y * y) / (ppd * ppd);
                let part = |a: f64, b: f64| a * (PI / b).sqrt() * (-PI * PI * z / b).exp();
                part(a1, b1) + part(a2, b2)
            };
            let total = sum(radius, &kernel);
            convolve(&plane(channel), size, radius, &|x, y| kernel(x, y) / total)
        });
        let colors = (0..opponent.len()).map(|at| {
            let [y, cx, cz] = std::array::from_fn(|channel| filtered[channel][at]);
            lab(rgb([y + cx, y, y - cz]).map(|value| value.clamp(0.0, 1.0)))
        });
        (colors.collect(), features(&plane(0), size, ppd))
    }

    fn features(luminance: &Plane, size: (i64, i64), ppd: f64) -> Vec<[f64; 2]> {
        let s = 0.5 * 0.082 * ppd;
        let radius = (3.0 * s).ceil() as i64;
        let g = |x: f64, y: f64| (-(x * x + y * y) / (2.0 * s * s)).exp();
        let edge = |x: f64, y: f64| -x * g(x, y);
        let point = |x: f64, y: f64| (x * x / (s * s) - 1.0) * g(x, y);
        let strength = |kernel: &dyn Fn(f64, f64) -> f64| -> Plane {
            let positive = sum(radius, &|x, y| kernel(x, y).max(0.0));
            let negative = -sum(radius, &|x, y| kernel(x, y).min(0.0));
            let unit = |x: f64, y: f64| {
                let value = kernel(x, y);
                value / if value > 0.0 { positive } else { negative }
            };
            let across = convolve(luminance, size, radius, &unit);
            let down = convolve(luminance, size, radius, &|x, y| unit(y, x));
            across.iter().zip(&down).map(|(x, y)| x.hypot(*y)).collect()
        };
        let (edges, points) = (strength(&edge), strength(&point));
        edges
            .into_iter()
            .zip(points)
            .map(|(edge, point)| [edge, point])
            .collect()
    }

    fn hyab(a: [f64; 3], b: [f64; 3]) -> f64 {
        ((a[0] - b[0]).abs() + (a[1] - b[1]).hypot(a[2] - b[2])).powf(0.7)
    }

    pub fn ldr(test: &Picture, reference: &Picture, ppd: f64) -> Vec<f64> {
        let ((lab_a, features_a), (lab_b, features_b)) = (seen(test, ppd), seen(reference, ppd));
        let largest = hyab(lab([0.0, 1.0, 0.0]), lab([0.0, 0.0, 1.0]));
        let value = |at: usize| {
            let color = hyab(lab_a[at], lab_b[at]);
            let knee = 0.4 * largest;
            let color = if color < knee {
                color * 0.95 / knee
            } else {
                0.95 + (color - knee) / (largest - knee) * 0.05
            };
            let feature = |index: usize| (features_a[at][index] - features_b[at][index]).abs();
            let feature = (feature(0).max(feature(1)) / 2f64.sqrt()).sqrt();
            color.powf(1.0 - feature)
        };
        (0..lab_a.len()).map(value).collect()
    }
}
