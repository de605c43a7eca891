//! The split-sum BRDF table for specular and the Fresnel loss of diffuse.

use std::f64::consts::{FRAC_PI_2, PI};

use rayon::prelude::*;

use super::ggx::{schlick, smith_visibility};
use super::quadrature::Rule;
use super::sheen;

/// Smallest power of two whose bilinear interpolation error stays below 1e-3 for `N.V >= 0.05`: it is 3e-4 there, and
/// 1.1e-3 from 0.01 on.
pub const DEFAULT_LUT_SIZE: u32 = 128;

/// The least `N.V`, as shading has it.
const SMALLEST_COSINE: f64 = 1e-4;

/// Below this `alpha` the specular lobe is a mirror to better than 1e-5.
const SMALLEST_ALPHA: f64 = 1e-6;

/// Range of `ln tan(theta_h)` about the peak, outside which lie less than 1e-7 of the lobe.
const LOWEST: f64 = 9.0;
const HIGHEST: f64 = 12.0;
/// Widest panel of the outer rule in that variable.
const PANEL: f64 = 1.5;

/// Table of `size * size` texels `[A, B, C, E]`, rows of constant perceptual roughness.
///
/// Texel `(i, j)` is at `N.V = (i / (size - 1))^2`, `roughness = j / (size - 1)`: the first and the last row and
/// column are the ends of the range, where a lookup finds them exactly; the square is finer towards grazing views.
/// - Specular albedo of the height-correlated Smith GGX BRDF is `F0 * A + B`.
/// - `C`, the same in every row, is the integral of `(1 - V.H)^5 N.L / pi` over the hemisphere, so
///   glTF's diffuse term `(1 - F) / pi` integrates to `(1 - F0) (1 - C)`.
/// - `E` is the directional albedo of white sheen (see `sheen.rs`) where `sheen` asks for it, else 0.
///
/// Split sum: Karis, "Real Shading in Unreal Engine 4", 2013; visibility: Heitz, JCGT 2014.
/// Absolute error below 1e-4.
pub fn brdf_lut(size: u32, sheen: bool) -> Vec<[f32; 4]> {
    let side = size as usize;
    let at = |index: usize| index as f64 / f64::from(size.max(2) - 1);
    let cosine = |index: usize| (at(index) * at(index)).max(SMALLEST_COSINE);
    let integrator = Integrator::new();
    let rules = sheen::rules();
    let diffuse: Vec<f64> = (0..side)
        .into_par_iter()
        .map(|x| integrator.diffuse_fresnel(cosine(x)))
        .collect();
    (0..side * side)
        .into_par_iter()
        .map(|index| {
            let (x, y) = (index % side, index / side);
            let (scale, bias) = integrator.split_sum(cosine(x), at(y));
            let albedo = if sheen {
                sheen::albedo(&rules, cosine(x), at(y))
            } else {
                0.0
            };
            [scale as f32, bias as f32, diffuse[x] as f32, albedo as f32]
        })
        .collect()
}

struct Integrator {
    outer: Rule,
    inner: Rule,
    diffuse: Rule,
}

impl Integrator {
    fn new() -> Self {
        Self {
            outer: Rule::gauss_legendre(12),
            inner: Rule::gauss_legendre(24),
            diffuse: Rule::gauss_legendre(64),
        }
    }

    /// `(A, B)` at the given cosine and perceptual roughness.
    ///
    /// Integrates over half vectors, `dl = 4 v.h dh`, in `x = ln tan(theta_h)` where the
    /// normal distribution is smooth for every roughness, and in azimuth up to the angle where
    /// the light sets below the horizon.
    fn split_sum(&self, n_dot_v: f64, roughness: f64) -> (f64, f64) {
        let alpha = (roughness * roughness).max(SMALLEST_ALPHA);
        let view = libm::acos(n_dot_v);
        let peak = libm::log(alpha);
        let start = peak - LOWEST;
        // Half vectors up to here keep the light up at every azimuth, up to `end` at some.
        let full = libm::log(libm::tan(0.5 * (FRAC_PI_2 - view)).max(1e-30));
        let steepest = (0.5 * (FRAC_PI_2 + view)).min(FRAC_PI_2 - 1e-9);
        let end = libm::log(libm::tan(steepest)).min(peak + HIGHEST);
        let mut total = (0.0, 0.0);
        let mut segment = |from: f64, to: f64| {
            let panels = libm::ceil(((to - from) / PANEL).max(1.0));
            let width = (to - from) / panels;
            for panel in 0..panels as usize {
                for &(node, weight) in &self.outer.nodes {
                    // Clusters nodes at the panel's ends, where the azimuth limit has a root.
                    let eased = node * node * (3.0 - 2.0 * node);
                    let slope = 6.0 * node * (1.0 - node);
                    let x = from + (panel as f64 + eased) * width;
                    let (a, b) = self.azimuth(n_dot_v, alpha, x);
                    total.0 += weight * slope * width * a;
                    total.1 += weight * slope * width * b;
                }
            }
        };
        if full > start && full < end {
            segment(start, full);
            segment(full, end);
        } else if end > start {
            segment(start, end);
        }
        total
    }

    /// Integrand of [`Self::split_sum`] at `x = ln tan(theta_h)`.
    fn azimuth(&self, n_dot_v: f64, alpha: f64, x: f64) -> (f64, f64) {
        let tangent_squared = libm::exp(2.0 * x);
        let n_dot_h = 1.0 / (1.0 + tangent_squared).sqrt();
        let sine_h = (tangent_squared / (1.0 + tangent_squared)).sqrt();
        // D n.h dh = dxi dphi / 2 pi with xi = tan^2 / (alpha^2 + tan^2).
        let xi = tangent_squared / (alpha * alpha + tangent_squared);
        let density = 2.0 * xi * (1.0 - xi);
        let sine_v = (1.0 - n_dot_v * n_dot_v).max(0.0).sqrt();
        let product = sine_v * sine_h;
        let limit = 0.5 * n_dot_v / n_dot_h - n_dot_v * n_dot_h;
        let last = if limit <= -product {
            PI
        } else if limit >= product {
            return (0.0, 0.0);
        } else {
            libm::acos(limit / product)
        };
        let (mut a, mut b) = (0.0, 0.0);
        for &(node, weight) in &self.inner.nodes {
            // Clusters nodes at the horizon, where visibility falls within an angle of alpha.
            let rest = 1.0 - node;
            let phi = last * (1.0 - rest * rest * rest);
            let slope = 3.0 * rest * rest * last / PI;
            let v_dot_h = product * libm::cos(phi) + n_dot_v * n_dot_h;
            let n_dot_l = 2.0 * v_dot_h * n_dot_h - n_dot_v;
            if n_dot_l <= 0.0 || v_dot_h <= 0.0 {
                continue;
            }
            let reflect =
                smith_visibility(n_dot_l, n_dot_v, alpha) * n_dot_l * 4.0 * v_dot_h / n_dot_h;
            let fresnel = schlick(v_dot_h.min(1.0));
            a += weight * slope * reflect * (1.0 - fresnel);
            b += weight * slope * reflect * fresnel;
        }
        (a * density, b * density)
    }

    /// `C` at the given cosine.
    fn diffuse_fresnel(&self, n_dot_v: f64) -> f64 {
        let sine_v = (1.0 - n_dot_v * n_dot_v).max(0.0).sqrt();
        let mut total = 0.0;
        for &(node, weight) in &self.diffuse.nodes {
            // n.l = sqrt(node) makes the cosine-weighted measure uniform.
            let (n_dot_l, sine_l) = (node.sqrt(), (1.0 - node).sqrt());
            for &(turn, share) in &self.diffuse.nodes {
                let v_dot_l = n_dot_v * n_dot_l + sine_v * sine_l * libm::cos(PI * turn);
                let v_dot_h = (0.5 + 0.5 * v_dot_l).max(0.0).sqrt();
                total += weight * share * schlick(v_dot_h);
            }
        }
        total
    }
}

#[cfg(test)]
mod tests {
    use glam::DVec3;

    use super::*;

    const ANGLES: [f64; 8] = [1e-4, 0.0039, 0.03, 0.1, 0.3, 0.6, 0.9, 1.0];

    fn hammersley(index: u32, count: u32) -> (f64, f64) {
        let reversed = f64::from(index.reverse_bits()) / 4_294_967_296.0;
        ((f64::from(index) + 0.5) / f64::from(count), reversed)
    }

    /// Independent oracle: visible-normal sampling (Heitz, JCGT 2018), weight `F G2 / G1`.
    fn sampled(n_dot_v: f64, roughness: f64, count: u32) -> (f64, f64) {
        let alpha = roughness * roughness;
        let view = DVec3::new((1.0 - n_dot_v * n_dot_v).sqrt(), 0.0, n_dot_v);
        let stretched = DVec3::new(alpha * view.x, 0.0, view.z).normalize();
        let tangent = DVec3::Y;
        let bitangent = stretched.cross(tangent);
        let lambda = |cosine: f64| {
            let tangent_squared = (1.0 - cosine * cosine) / (cosine * cosine);
            0.5 * ((1.0 + alpha * alpha * tangent_squared).sqrt() - 1.0)
        };
        let (mut a, mut b) = (0.0, 0.0);
        for index in 0..count {
            let (u, v) = hammersley(index, count);
            let (radius, phi) = (u.sqrt(), 2.0 * PI * v);
            let first = radius * phi.cos();
            let blend = 0.5 * (1.0 + stretched.z);
            let second = (1.0 - blend) * (1.0 - first * first).sqrt() + blend * radius * phi.sin();
            let third = (1.0 - first * first - second * second).max(0.0).sqrt();
            let normal = tangent * first + bitangent * second + stretched * third;
            let half =
                DVec3::new(alpha * normal.x, alpha * normal.y, normal.z.max(0.0)).normalize();
            let v_dot_h = view.dot(half);
            let light = half * (2.0 * v_dot_h) - view;
            if light.z > 0.0 {
                let ratio = (1.0 + lambda(n_dot_v)) / (1.0 + lambda(n_dot_v) + lambda(light.z));
                let fresnel = (1.0 - v_dot_h).powi(5);
                a += ratio * (1.0 - fresnel);
                b += ratio * fresnel;
            }
        }
        (a / f64::from(count), b / f64::from(count))
    }

    #[test]
    fn split_sum_matches_visible_normal_sampling() {
        let integrator = Integrator::new();
        let mut worst: f64 = 0.0;
        for n_dot_v in ANGLES {
            for roughness in [0.002, 0.01, 0.03, 0.0625, 0.1, 0.2, 0.4, 0.7, 0.9, 1.0] {
                let (a, b) = integrator.split_sum(n_dot_v, roughness);
                let (c, d) = sampled(n_dot_v, roughness, 1 << 17);
                let error = (a - c).abs().max((b - d).abs());
                worst = worst.max(error);
                assert!(
                    error < 1e-4,
                    "{n_dot_v} {roughness}: {a} {b}, sampled {c} {d}"
                );
            }
        }
        eprintln!("worst split-sum difference: {worst:.1e}");
    }

    #[test]
    fn split_sum_matches_a_light_space_grid() {
        let integrator = Integrator::new();
        let steps = 1500;
        for (n_dot_v, roughness) in [(0.2, 0.5), (0.7, 0.8), (0.05, 1.0), (1.0, 0.45)] {
            let alpha: f64 = roughness * roughness;
            let view = DVec3::new((1.0_f64 - n_dot_v * n_dot_v).sqrt(), 0.0, n_dot_v);
            let (mut a, mut b) = (0.0, 0.0);
            for i in 0..steps {
                let z = (f64::from(i) + 0.5) / f64::from(steps);
                for j in 0..steps {
                    let phi = PI * (f64::from(j) + 0.5) / f64::from(steps);
                    let radius = (1.0 - z * z).sqrt();
                    let light = DVec3::new(radius * phi.cos(), radius * phi.sin(), z);
                    let half = (light + view).normalize();
                    let base = half.z * half.z * (alpha * alpha - 1.0) + 1.0;
                    let density = alpha * alpha / (PI * base * base);
                    let value = density * smith_visibility(z, n_dot_v, alpha) * z;
                    let fresnel = (1.0 - view.dot(half)).powi(5);
                    a += value * (1.0 - fresnel);
                    b += value * fresnel;
                }
            }
            let measure = 2.0 * PI / f64::from(steps * steps);
            let (c, d) = integrator.split_sum(n_dot_v, roughness);
            assert!((a * measure - c).abs() < 1e-4, "{n_dot_v} {roughness}");
            assert!((b * measure - d).abs() < 1e-4, "{n_dot_v} {roughness}");
        }
    }

    #[test]
    fn diffuse_loss_matches_a_light_space_grid() {
        let integrator = Integrator::new();
        let steps = 800;
        for n_dot_v in [1e-4_f64, 0.1, 0.5, 1.0] {
            let view = DVec3::new((1.0 - n_dot_v * n_dot_v).sqrt(), 0.0, n_dot_v);
            let mut sum = 0.0;
            for i in 0..steps {
                let z = (f64::from(i) + 0.5) / f64::from(steps);
                for j in 0..steps {
                    let phi = PI * (f64::from(j) + 0.5) / f64::from(steps);
                    let radius = (1.0 - z * z).sqrt();
                    let light = DVec3::new(radius * phi.cos(), radius * phi.sin(), z);
                    let half = (light + view).normalize();
                    sum += (1.0 - view.dot(half)).powi(5) * z * 2.0;
                }
            }
            let exact = sum / f64::from(steps * steps);
            assert!((integrator.diffuse_fresnel(n_dot_v) - exact).abs() < 1e-5);
        }
    }

    #[test]
    fn furnace_closes_with_energy_compensation() {
        for [a, b, c, zero] in brdf_lut(32, false) {
            let single = a + b;
            assert!(single > 0.3 && single < 1.0 + 1e-5, "{single}");
            assert!(a >= 0.0 && b >= 0.0 && c > 0.0 && c < 1.0 && zero == 0.0);
            let compensated = single * (1.0 + (1.0 / single - 1.0));
            assert!((compensated - 1.0).abs() < 1e-6);
        }
    }

    fn bilinear(table: &[[f32; 4]], size: u32, x: f64, y: f64) -> [f64; 3] {
        let last = f64::from(size) - 1.0;
        let (px, py) = (x.sqrt() * last, y * last);
        let (ix, iy) = (px as usize, py as usize);
        let next = |i: usize| (i + 1).min(size as usize - 1);
        let at = |i: usize, j: usize, k: usize| f64::from(table[j * size as usize + i][k]);
        let (fx, fy) = (px - ix as f64, py - iy as f64);
        [0, 1, 2].map(|k| {
            let upper = at(ix, iy, k) * (1.0 - fx) + at(next(ix), iy, k) * fx;
            let lower = at(ix, next(iy), k) * (1.0 - fx) + at(next(ix), next(iy), k) * fx;
            upper * (1.0 - fy) + lower * fy
        })
    }

    /// Worst bilinear error of `[A, B, C]` for `N.V` up from `least`, all roughnesses, 1 among them.
    fn interpolation_error(table: &[[f32; 4]], size: u32, least: f64) -> f64 {
        let integrator = Integrator::new();
        let steps = 80;
        (0..(steps + 1) * (steps + 1))
            .into_par_iter()
            .map(|index| {
                let at = |i: usize| ((i as f64 + 0.37) / steps as f64).min(1.0);
                // Squared, to look closer where the table bends most.
                let x = least + (1.0 - least) * at(index % (steps + 1)) * at(index % (steps + 1));
                let y = at(index / (steps + 1));
                let (a, b) = integrator.split_sum(x, y);
                let read = bilinear(table, size, x, y);
                let diffuse = (read[2] - integrator.diffuse_fresnel(x)).abs();
                (read[0] - a).abs().max((read[1] - b).abs()).max(diffuse)
            })
            .reduce(|| 0.0, f64::max)
    }

    #[test]
    fn default_size_is_the_smallest_that_interpolates_within_a_thousandth() {
        let table = brdf_lut(DEFAULT_LUT_SIZE, false);
        assert!(interpolation_error(&table, DEFAULT_LUT_SIZE, 0.05) < 5e-4);
        assert!(interpolation_error(&table, DEFAULT_LUT_SIZE, 0.01) < 1.5e-3);
        let half = DEFAULT_LUT_SIZE / 2;
        assert!(interpolation_error(&brdf_lut(half, false), half, 0.05) > 1e-3);
    }
}
