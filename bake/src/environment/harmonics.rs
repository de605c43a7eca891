//! Diffuse light as nine coefficients: projection, window, error.

use cairn_format::harmonics::{basis, evaluate};
use glam::DVec3;

use super::cells::CellLevel;
use super::cubemap::{Cube, face_solid_angles, texel_direction, to_f32, to_f64};

/// Directions per face side at which negative light is looked for.
const SEARCH_SIZE: u32 = 16;
/// Halvings of the interval that holds the window's strength.
const BISECTIONS: usize = 40;

/// Coefficients of [`evaluate`] for `E / pi` under the sky, and the window that keeps them from ringing.
pub(super) struct Harmonics {
    pub coefficients: [[f32; 3]; 9],
    /// Strength of the window: bands 1 and 2 are divided by `1 + 4 w` and `1 + 36 w`.
    pub window: f64,
}

/// Projects the sky onto degree 2 and attenuates the bands just so much that no direction is negative.
///
/// Window: P.-P. Sloan, "Stupid Spherical Harmonics (SH) Tricks", GDC 2008 (squared Laplacian).
pub(super) fn project(sky: &CellLevel<'_>) -> Harmonics {
    let raw = moments(sky);
    let negative = |window: f64| {
        let windowed = attenuate(&raw, window);
        (0..6 * (SEARCH_SIZE * SEARCH_SIZE) as usize).any(|index| {
            let [x, y, z] = texel_direction(index, SEARCH_SIZE).to_array();
            let terms = basis(x, y, z);
            let sum: DVec3 = windowed.iter().zip(terms).map(|(c, term)| *c * term).sum();
            sum.min_element() < 0.0
        })
    };
    let mut window = 0.0;
    if negative(0.0) {
        let (mut low, mut high) = (0.0, 1.0);
        while negative(high) && high < 1e6 {
            high *= 4.0;
        }
        for _ in 0..BISECTIONS {
            let middle = 0.5 * (low + high);
            if negative(middle) {
                low = middle;
            } else {
                high = middle;
            }
        }
        window = high;
    }
    Harmonics {
        coefficients: attenuate(&raw, window).map(to_f32),
        window,
    }
}

/// Relative RMS difference of the coefficients from an irradiance cube, texels weighted by solid angle.
pub(super) fn relative_rms(coefficients: &[[f32; 3]; 9], cube: &Cube) -> f64 {
    let angles = face_solid_angles(cube.size);
    let (mut error, mut scale) = (0.0, 0.0);
    for (index, texel) in cube.levels[0].iter().enumerate() {
        let normal = to_f32(texel_direction(index, cube.size));
        let exact = to_f64(*texel);
        let angle = angles[index % angles.len()];
        error += (to_f64(evaluate(coefficients, normal)) - exact).length_squared() * angle;
        scale += exact.length_squared() * angle;
    }
    if scale > 0.0 {
        (error / scale).sqrt()
    } else {
        error.sqrt()
    }
}

/// Integrals of radiance times basis, times basis norm and cosine lobe over pi (1, 2/3, 1/4).
fn moments(sky: &CellLevel<'_>) -> [DVec3; 9] {
    let mut sums = [DVec3::ZERO; 9];
    for index in 0..sky.len() {
        let (cell, angle) = (sky.cell(index), sky.solid_angle(index));
        let light = to_f64(cell.radiance) * angle;
        let [x, y, z] = to_f64(cell.centroid).normalize().to_array();
        for (sum, term) in sums.iter_mut().zip(basis(x, y, z)) {
            *sum += light * term;
        }
    }
    // Squares of the real basis' norms (1, 3, 15, 5/4, 15/4 over 4 pi) times the lobe's band.
    let factors = [1.0, 2.0, 2.0, 2.0, 3.75, 3.75, 3.75, 0.3125, 0.9375];
    let mut at = 0;
    sums.map(|sum| {
        at += 1;
        sum * (factors[at - 1] / (4.0 * std::f64::consts::PI))
    })
}

fn attenuate(raw: &[DVec3; 9], window: f64) -> [DVec3; 9] {
    let bands = [1.0, 1.0 / (1.0 + 4.0 * window), 1.0 / (1.0 + 36.0 * window)];
    std::array::from_fn(|k| {
        raw[k]
            * bands[match k {
                0 => 0,
                1..4 => 1,
                _ => 2,
            }]
    })
}

#[cfg(test)]
mod tests {
    use super::super::cells;
    use super::*;

    fn sky(radiance: impl Fn(DVec3) -> [f32; 3]) -> Cube {
        let texels = (0..6 * 64 * 64).map(|index| radiance(texel_direction(index, 64)));
        Cube::single(64, texels.collect())
    }

    fn projected(sky: &Cube) -> Harmonics {
        project(&cells::build(sky, 0, 64)[0])
    }

    fn worst(coefficients: &[[f32; 3]; 9], exact: impl Fn(DVec3) -> f64) -> f64 {
        let texels = 0..6 * 16 * 16;
        let error = |index| {
            let normal = texel_direction(index, 16);
            (f64::from(evaluate(coefficients, to_f32(normal))[0]) - exact(normal)).abs()
        };
        texels.map(error).fold(0.0, f64::max)
    }

    #[test]
    fn skies_of_degree_two_are_exact() {
        let levels = sky(|_| [3.0; 3]);
        let constant = projected(&levels);
        assert_eq!(constant.window, 0.0);
        assert!(worst(&constant.coefficients, |_| 3.0) < 1e-5);
        // E / pi of 2 + d.a is 2 + 2/3 n.a; of d.x d.y it is n.x n.y / 4.
        let axis = DVec3::new(0.3, -0.8, 0.5);
        let levels = sky(|d| [(2.0 + d.dot(axis) + d.x * d.y + 0.5 * d.y * d.y) as f32; 3]);
        let got = projected(&levels);
        let exact = |n: DVec3| {
            let zonal = 1.0 / 3.0 + (n.y * n.y - 1.0 / 3.0) / 4.0;
            2.0 + n.dot(axis) * 2.0 / 3.0 + n.x * n.y / 4.0 + 0.5 * zonal
        };
        assert_eq!(got.window, 0.0);
        assert!(worst(&got.coefficients, exact) < 1e-3);
    }

    #[test]
    fn a_lone_lamp_never_gives_negative_light() {
        let lamp = DVec3::new(0.2, 0.9, -0.4).normalize();
        let levels = sky(|d| {
            if d.dot(lamp) > 0.995 {
                [1e4; 3]
            } else {
                [0.0; 3]
            }
        });
        let got = projected(&levels);
        assert!(got.window > 0.0 && got.window < 1.0, "{}", got.window);
        let least = (0..6 * 32 * 32).map(|index| {
            let [x, y, z] = texel_direction(index, 32).to_array();
            let terms = basis(x, y, z);
            let sum = |k: usize| f64::from(got.coefficients[k][1]) * terms[k];
            (0..9).map(sum).sum::<f64>()
        });
        let peak = evaluate(&got.coefficients, to_f32(lamp))[1];
        assert!(least.fold(f64::MAX, f64::min) > -1e-3 * f64::from(peak));
    }
}
