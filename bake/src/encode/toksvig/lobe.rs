//! Lobes of reflection over half vectors, and how far two of them differ.

use std::f64::consts::PI;
use std::sync::OnceLock;

/// Half vectors along the polar angle and about the axis.
const RINGS: usize = 24;
const SECTORS: usize = 48;
/// Most normals of a footprint that are summed.
const NORMALS: usize = 64;
/// Lobes are judged under a light that widens them to at least this alpha, about three degrees, which the rings resolve.
const LIGHT_ALPHA: f64 = 0.05;

/// GGX over half vectors: the share of a surface's area that reflects at each, weighted by their projected solid angle,
/// as sums over the directions of [`directions`].
pub(super) struct Lobe(Vec<f64>);

/// A half vector and its projected solid angle.
struct Direction {
    half: [f64; 3],
    weight: f64,
}

/// Half vectors of the hemisphere, dense about the pole.
fn directions() -> &'static [Direction] {
    static DIRECTIONS: OnceLock<Vec<Direction>> = OnceLock::new();
    DIRECTIONS.get_or_init(|| {
        let step = 1.0 / RINGS as f64;
        let all = (0..RINGS * SECTORS).map(|index| {
            let along = ((index / SECTORS) as f64 + 0.5) * step;
            let about = ((index % SECTORS) as f64 + 0.5) * 2.0 * PI / SECTORS as f64;
            let (sine, cosine) = libm::sincos(0.5 * PI * along * along);
            let (y, x) = libm::sincos(about);
            Direction {
                half: [sine * x, sine * y, cosine],
                weight: sine * cosine * PI * along * step * 2.0 * PI / SECTORS as f64,
            }
        });
        all.collect()
    })
}

/// GGX at `half` over its height at the normal; `alpha_squared` above 0.
pub(super) fn relative_height(normal: [f64; 3], half: [f64; 3], alpha_squared: f64) -> f64 {
    let apart: [f64; 3] = std::array::from_fn(|k| normal[k] - half[k]);
    let difference = apart[0] * apart[0] + apart[1] * apart[1] + apart[2] * apart[2];
    // The sine from the chord: near the peak the cosine has no digits left.
    let sine_squared = difference * (1.0 - 0.25 * difference);
    if difference >= 2.0 {
        return 0.0;
    }
    let root = 1.0 - sine_squared + sine_squared / alpha_squared;
    1.0 / (root * root)
}

impl Lobe {
    /// That of one normal.
    pub fn of(normal: [f64; 3], roughness: f64) -> Self {
        Self::mean_of(&[normal], roughness)
    }

    /// That of a surface of many normals, which count alike.
    pub fn mean_of(normals: &[[f64; 3]], roughness: f64) -> Self {
        let alpha = roughness * roughness;
        let alpha_squared = alpha * alpha + LIGHT_ALPHA * LIGHT_ALPHA;
        // Odd, so that it does not follow a column of the footprint.
        let stride = normals.len().div_ceil(NORMALS) | 1;
        let values = directions().iter().map(|direction| {
            let heights = normals.iter().step_by(stride);
            heights
                .map(|normal| relative_height(*normal, direction.half, alpha_squared))
                .sum::<f64>()
                * direction.weight
        });
        let values: Vec<f64> = values.collect();
        // Half vectors below the horizon are lost to both sides alike.
        let total: f64 = values.iter().sum();
        Self(
            values
                .iter()
                .map(|value| value / total.max(1e-300))
                .collect(),
        )
    }

    /// The share of light that the other lobe sends elsewhere, 0 to 1: the total variation distance.
    pub fn difference(&self, other: &Self) -> f64 {
        let apart = self.0.iter().zip(&other.0).map(|(a, b)| (a - b).abs());
        0.5 * apart.sum::<f64>()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn directions_cover_the_hemisphere() {
        let total: f64 = directions().iter().map(|one| one.weight).sum();
        assert!((total - PI).abs() < 1e-2, "{total}");
        for one in directions() {
            let length: f64 = one.half.iter().map(|v| v * v).sum();
            assert!((length - 1.0).abs() < 1e-12);
        }
    }

    /// GGX holds the area of the surface: its integral over projected solid angle is 1.
    #[test]
    fn heights_are_those_of_ggx() {
        for alpha in [0.05_f64, 0.2, 0.6, 1.0] {
            let squared = alpha * alpha;
            let total: f64 = directions()
                .iter()
                .map(|one| {
                    let height = relative_height([0.0, 0.0, 1.0], one.half, squared);
                    height / (PI * squared) * one.weight
                })
                .sum();
            assert!((total - 1.0).abs() < 2e-2, "{alpha}: {total}");
        }
        // The textbook form, away from the peak.
        let half = [0.6, 0.0, 0.8];
        let expected = (0.04 / (0.64 * (0.04 - 1.0) + 1.0_f64)).powi(2);
        let got = relative_height([0.0, 0.0, 1.0], half, 0.04);
        assert!(
            (got - expected).abs() < 1e-12 * expected,
            "{got} {expected}"
        );
        assert_eq!(relative_height([0.0, 0.0, 1.0], [1.0, 0.0, 0.0], 0.04), 0.0);
    }

    #[test]
    fn equal_lobes_do_not_differ_and_far_ones_do_wholly() {
        let tilted = |x: f64| [x, 0.0, (1.0 - x * x).sqrt()];
        let lobe = Lobe::of(tilted(0.1), 0.4);
        assert!(lobe.difference(&Lobe::of(tilted(0.1), 0.4)) < 1e-12);
        let far = Lobe::of(tilted(0.9), 0.0).difference(&Lobe::of(tilted(-0.9), 0.0));
        assert!(far > 0.95, "{far}");
        let near = lobe.difference(&Lobe::of(tilted(0.1), 0.5));
        assert!(near > 0.05 && near < 0.5, "{near}");
    }
}
