//! Directional albedo of the sheen lobe (`KHR_materials_sheen`).
//!
//! Estevez and Kulla, "Production Friendly Microfacet Sheen BRDF", 2017: an exponentiated sine as distribution, a
//! fitted shadowing term. As in the player, alpha is the square of the perceptual roughness, which is at least
//! [`MIN_ROUGHNESS`], and the visibility term is at most 1.

use std::f64::consts::PI;

use super::quadrature::Rule;

/// Below it the lobe is a line at the horizon.
const MIN_ROUGHNESS: f64 = 0.045;

/// Nodes over the cosine of the half vector's polar angle, and over half of its azimuth.
const NODES: [usize; 2] = [48, 48];

/// The quadrature of [`albedo`].
pub(super) fn rules() -> [Rule; 2] {
    NODES.map(Rule::gauss_legendre)
}

/// Directional albedo of white sheen, at most 1. Integrates over half vectors, `dl = 4 v.h dh`, in whose sine the
/// distribution is a power: with `u = sin^(1/alpha + 2)` its mass is spread evenly. Absolute error below 2e-3.
pub(super) fn albedo([outer, inner]: &[Rule; 2], n_dot_v: f64, roughness: f64) -> f64 {
    let alpha = roughness.max(MIN_ROUGHNESS).powi(2);
    let power = 1.0 / alpha + 2.0;
    let sine_v = (1.0 - n_dot_v * n_dot_v).max(0.0).sqrt();
    let masking = lambda(n_dot_v, alpha);
    let mut total = 0.0;
    for &(node, weight) in &outer.nodes {
        // D(h) sin dsin dphi / cos = dnode dphi / (2 pi cos): the cosine is integrable at the horizon, and the
        // substitution node = 1 - t^2 takes it away.
        let log_sine = libm::log1p(-node * node) / power;
        let sine_h = libm::exp(log_sine);
        let cosine_h = (-libm::expm1(2.0 * log_sine)).max(1e-15).sqrt();
        let measure = 2.0 * node * weight / cosine_h;
        for &(turn, share) in &inner.nodes {
            let v_dot_h = sine_v * sine_h * libm::cos(PI * turn) + n_dot_v * cosine_h;
            let n_dot_l = 2.0 * v_dot_h * cosine_h - n_dot_v;
            if v_dot_h <= 0.0 || n_dot_l <= 0.0 {
                continue;
            }
            let light = visibility(n_dot_v, n_dot_l, masking, alpha) * n_dot_l * 4.0 * v_dot_h;
            total += measure * share * light;
        }
    }
    total.min(1.0)
}

/// `masking` is that of the viewer's cosine.
fn visibility(n_dot_v: f64, n_dot_l: f64, masking: f64, alpha: f64) -> f64 {
    let shadowing = 1.0 + masking + lambda(n_dot_l, alpha);
    (1.0 / (shadowing * 4.0 * n_dot_v * n_dot_l)).min(1.0)
}

fn lambda(cosine: f64, alpha: f64) -> f64 {
    let curve = |x: f64| {
        let t = (1.0 - alpha) * (1.0 - alpha);
        let mix = |from: f64, to: f64| from + (to - from) * t;
        let [a, b, c] = [
            mix(21.5473, 25.3245),
            mix(3.82987, 3.32435),
            mix(0.19823, 0.16801),
        ];
        let [d, e] = [mix(-1.97760, -1.27393), mix(-4.32054, -4.85967)];
        a / (1.0 + b * libm::pow(x.max(1e-6), c)) + d * x + e
    };
    libm::exp(if cosine < 0.5 {
        curve(cosine)
    } else {
        2.0 * curve(0.5) - curve(1.0 - cosine)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Brute force over light directions on a fine grid.
    fn summed(n_dot_v: f64, roughness: f64) -> f64 {
        const ROWS: usize = 300;
        const COLUMNS: usize = 300;
        let alpha = roughness.max(MIN_ROUGHNESS).powi(2);
        let sine_v = (1.0 - n_dot_v * n_dot_v).sqrt();
        let mut total = 0.0;
        for row in 0..ROWS {
            // Squares put more rows near the horizon.
            let step = (row as f64 + 0.5) / ROWS as f64;
            let (n_dot_l, width) = (step * step, 2.0 * step / ROWS as f64);
            let sine_l = (1.0 - n_dot_l * n_dot_l).sqrt();
            for column in 0..COLUMNS {
                let phi = PI * (column as f64 + 0.5) / COLUMNS as f64;
                let v_dot_l = sine_v * sine_l * phi.cos() + n_dot_v * n_dot_l;
                let n_dot_h = (n_dot_v + n_dot_l) / (2.0 + 2.0 * v_dot_l).sqrt();
                let sine2 = (1.0 - n_dot_h * n_dot_h).max(0.0);
                let d = (2.0 + 1.0 / alpha) * sine2.powf(0.5 / alpha) / (2.0 * PI);
                total += d
                    * visibility(n_dot_v, n_dot_l, lambda(n_dot_v, alpha), alpha)
                    * n_dot_l
                    * width;
            }
        }
        (total * 2.0 * PI / COLUMNS as f64).min(1.0)
    }

    #[test]
    fn half_vectors_and_light_directions_agree() {
        let rules = rules();
        for roughness in [0.0, 0.2, 0.4, 0.7, 1.0] {
            for n_dot_v in [0.02, 0.1, 0.3, 0.6, 0.95, 1.0] {
                let (found, expected) = (
                    albedo(&rules, n_dot_v, roughness),
                    summed(n_dot_v, roughness),
                );
                let error = (found - expected).abs();
                assert!(error < 2e-3, "{n_dot_v} {roughness}: {found} {expected}");
            }
        }
    }

    #[test]
    fn sheen_is_seen_at_grazing() {
        let rules = rules();
        assert!(albedo(&rules, 0.1, 0.4) > 3.0 * albedo(&rules, 1.0, 0.4));
        assert!(albedo(&rules, 1.0, 0.1) < 1e-3);
    }
}
