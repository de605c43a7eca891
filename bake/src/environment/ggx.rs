//! The GGX lobe that prefiltering and the BRDF table share with direct light.

/// Relative weight of incoming radiance in the prefiltered lobe at `V = R = N`, per steradian.
///
/// `distance_squared` is `|n - l|^2` of unit vectors, `alpha` is roughness squared. Up to a
/// constant factor this is `D(h) Vis(n.l, 1) n.l` with the height-correlated Smith `Vis` of
/// direct light: the BRDF itself at normal incidence without Fresnel, so that
/// `prefiltered * (A + B)` is the exact reflection of any environment there. With
/// `h = normalize(n + l)`, `sin^2 = |n - l|^2 / 4`, which keeps precision at small `alpha`
/// where `1 - (n.h)^2` cancels.
macro_rules! lobe_weight {
    ($name:ident, $float:ty) => {
        #[inline(always)]
        pub(super) fn $name(distance_squared: $float, alpha: $float) -> $float {
            let alpha_squared = alpha * alpha;
            let cosine = (1.0 - 0.5 * distance_squared).max(0.0);
            let half_sine_squared = 0.25 * distance_squared;
            let base = half_sine_squared + alpha_squared * (1.0 - half_sine_squared);
            let smith = cosine + (cosine * cosine * (1.0 - alpha_squared) + alpha_squared).sqrt();
            alpha_squared * cosine / (base * base * smith)
        }
    };
}

lobe_weight!(lobe_weight, f64);
lobe_weight!(lobe_weight_f32, f32);

/// Height-correlated Smith visibility `G2 / (4 n.l n.v)`.
pub(super) fn smith_visibility(n_dot_l: f64, n_dot_v: f64, alpha: f64) -> f64 {
    let a2 = alpha * alpha;
    let view = n_dot_l * (n_dot_v * n_dot_v * (1.0 - a2) + a2).sqrt();
    let light = n_dot_v * (n_dot_l * n_dot_l * (1.0 - a2) + a2).sqrt();
    0.5 / (view + light)
}

/// Schlick's `(1 - v.h)^5`.
pub(super) fn schlick(v_dot_h: f64) -> f64 {
    let x = 1.0 - v_dot_h;
    let x2 = x * x;
    x2 * x2 * x
}

#[cfg(test)]
mod tests {
    use glam::DVec3;

    use super::*;

    #[test]
    fn lobe_is_the_brdf_at_normal_incidence() {
        for alpha in [0.03_f64, 0.2, 0.7, 1.0] {
            let mut ratio = None;
            for degrees in [0.5_f64, 2.0, 10.0, 40.0, 80.0, 89.0] {
                let angle = degrees.to_radians();
                let light = DVec3::new(angle.sin(), angle.cos(), 0.0);
                let n_dot_h = (light + DVec3::Y).normalize().y;
                let denominator = n_dot_h * n_dot_h * (alpha * alpha - 1.0) + 1.0;
                let textbook = alpha * alpha / (denominator * denominator)
                    * smith_visibility(light.y, 1.0, alpha)
                    * light.y;
                let distance_squared = (DVec3::Y - light).length_squared();
                let r = lobe_weight(distance_squared, alpha) / textbook;
                let expected = *ratio.get_or_insert(r);
                assert!((r / expected - 1.0).abs() < 1e-9, "{alpha} {degrees}");
                let single = lobe_weight_f32(distance_squared as f32, alpha as f32);
                let double = lobe_weight(distance_squared, alpha);
                assert!((f64::from(single) / double - 1.0).abs() < 1e-4);
            }
        }
    }
}
