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

/// Weight of `D(h) n.l` at `V = R = N`, up to a constant factor: the lobe without its shadowing term.
pub(super) fn half_vector_weight(distance_squared: f64, alpha: f64) -> f64 {
    let alpha_squared = alpha * alpha;
    let cosine = (1.0 - 0.5 * distance_squared).max(0.0);
    let half_sine_squared = 0.25 * distance_squared;
    let base = half_sine_squared + alpha_squared * (1.0 - half_sine_squared);
    alpha_squared * cosine / (base * base)
}

/// Mean of [`lobe_weight`] over directions with the given mean, whose squared distance from the normal is given, and
/// variance `spread = 1 - |mean|^2`, taken to be even around the mean.
///
/// The lobe is a function of `1 - n.l`, whose mean is exact; the second derivative in it is that of the squared
/// denominator, beside which the rest of the lobe is flat.
#[inline(always)]
pub(super) fn mean_lobe_weight(distance_squared: f32, spread: f32, alpha_squared: f32) -> f32 {
    let versine = 0.5 * (distance_squared + spread);
    let cosine = (1.0 - versine).max(0.0);
    let half_sine_squared = 0.5 * versine;
    let base = half_sine_squared + alpha_squared * (1.0 - half_sine_squared);
    let smith = cosine + (cosine * cosine * (1.0 - alpha_squared) + alpha_squared).sqrt();
    let inverse = 1.0 / (base * base * smith);
    let sharpness = 1.0 - alpha_squared;
    let bend = 0.375 * sharpness * sharpness * spread * versine * (2.0 - versine) * smith * inverse;
    alpha_squared * cosine * inverse * (1.0 + bend)
}

/// Height-correlated Smith visibility `G2 / (4 n.l n.v)`.
#[cfg(test)]
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
                let single = mean_lobe_weight(distance_squared as f32, 0.0, (alpha * alpha) as f32);
                let double = lobe_weight(distance_squared, alpha);
                assert!((f64::from(single) / double - 1.0).abs() < 1e-4);
            }
        }
    }

    #[test]
    fn spread_cells_weigh_what_their_directions_do() {
        for alpha in [0.04_f64, 0.16, 0.36, 0.64] {
            for degrees in [0.0_f64, 0.5, 2.0, 5.0, 20.0, 60.0] {
                let angle = degrees.to_radians();
                // A square as wide as half the lobe where it is.
                let side = 0.5 * (angle * angle + 4.0 * alpha * alpha).sqrt().min(0.8);
                let (mut mean, mut exact) = (DVec3::ZERO, 0.0);
                let steps = 40;
                for k in 0..steps * steps {
                    let at = |k: usize| ((k as f64 + 0.5) / steps as f64 - 0.5) * side;
                    let (x, z) = (at(k % steps), at(k / steps));
                    let turned = angle + x;
                    let light = DVec3::new(turned.sin(), turned.cos(), z.tan()).normalize();
                    mean += light;
                    exact += lobe_weight((DVec3::Y - light).length_squared(), alpha);
                }
                let count = (steps * steps) as f64;
                mean /= count;
                exact /= count;
                let spread = 1.0 - mean.length_squared();
                let found = f64::from(mean_lobe_weight(
                    (DVec3::Y - mean).length_squared() as f32,
                    spread as f32,
                    (alpha * alpha) as f32,
                ));
                let flat = lobe_weight((DVec3::Y - mean.normalize()).length_squared(), alpha);
                let (error, before) = ((found / exact - 1.0).abs(), (flat / exact - 1.0).abs());
                assert!(error < 4e-2, "{alpha} {degrees}: {error}");
                assert!(
                    error < 0.6 * before + 3e-3,
                    "{alpha} {degrees}: {error}, {before}"
                );
            }
        }
    }
}
