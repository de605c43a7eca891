//! The split-sum BRDF table for specular and the Fresnel loss of diffuse.

use std::f64::consts::PI;

use cairn_format::brdf_table::brdf_table_point;
use rayon::prelude::*;

use super::ggx::schlick;
use super::quadrature::Rule;
use super::sheen;

/// Below this `alpha` the specular lobe is a mirror to better than 1e-5.
const SMALLEST_ALPHA: f64 = 1e-6;
/// Cosine of the first column, whose own would be 0.
const SMALLEST_COSINE: f64 = 1e-4;

/// Table of `size * size` texels `[A, B, C, E]`, rows of constant perceptual roughness, at the points of
/// [`brdf_table_point`].
///
/// - Specular albedo of the height-correlated Smith GGX BRDF is `F0 * A + B`.
/// - `C`, the same in every row, is the integral of `(1 - V.H)^5 N.L / pi` over the hemisphere, so
///   glTF's diffuse term `(1 - F) / pi` integrates to `(1 - F0) (1 - C)`.
/// - `E` is the directional albedo of white sheen (see `sheen.rs`) where `sheen` asks for it, else 0.
///
/// Split sum: Karis, "Real Shading in Unreal Engine 4", 2013; visibility: Heitz, JCGT 2014.
/// Absolute error below 1e-4.
pub fn brdf_lut(size: u32, sheen: bool) -> Vec<[f32; 4]> {
    let side = size as usize;
    let at = |column: usize, row: usize| {
        let [x, roughness] = brdf_table_point(column as u32, row as u32, size);
        [x.max(SMALLEST_COSINE), roughness]
    };
    let integrator = Integrator::new();
    let rules = sheen::rules();
    let diffuse: Vec<f64> = (0..side)
        .into_par_iter()
        .map(|column| integrator.diffuse_fresnel(at(column, 0)[0]))
        .collect();
    (0..side * side)
        .into_par_iter()
        .map(|index| {
            let (column, row) = (index % side, index / side);
            let [n_dot_v, roughness] = at(column, row);
            let (scale, bias) = integrator.split_sum(n_dot_v, roughness);
            let albedo = if sheen {
                sheen::albedo(&rules, n_dot_v, roughness)
            } else {
                0.0
            };
            [scale, bias, diffuse[column], albedo].map(|value| value as f32)
        })
        .collect()
}

struct Integrator {
    outer: Rule,
    inner: Rule,
    /// Cosines of whole turns, with shares of the turn.
    turns: Vec<(f64, f64)>,
    diffuse: Rule,
    /// Cosines of the azimuths of `diffuse`.
    azimuths: Vec<(f64, f64)>,
}

impl Integrator {
    fn new() -> Self {
        let turns = |rule: &Rule| {
            let nodes = rule.nodes.iter();
            nodes
                .map(|&(at, share)| (libm::cos(PI * at), share))
                .collect()
        };
        let diffuse = Rule::gauss_legendre(32);
        Self {
            outer: Rule::gauss_legendre(10),
            inner: Rule::gauss_legendre(10),
            turns: turns(&Rule::gauss_legendre(12)),
            azimuths: turns(&diffuse),
            diffuse,
        }
    }

    /// `(A, B)` at the given cosine and perceptual roughness: the mean of `F G2 / G1` over the normals that the
    /// viewer sees.
    ///
    /// Those are, in the space where the surface is a sphere, the directions halfway between the viewer and a
    /// spherical cap (Dupuy and Benyoub, "Sampling Visible GGX Normals with Spherical Caps", 2023), so that the mean is
    /// over the cap's height and azimuth with no density to divide by, whatever the roughness. The rule is cut where
    /// light sets below the horizon: at heights where it does so at every azimuth and at none, and in between at
    /// the azimuth where it does, which is known in closed form.
    fn split_sum(&self, n_dot_v: f64, roughness: f64) -> (f64, f64) {
        let cap = Cap::new(n_dot_v, (roughness * roughness).max(SMALLEST_ALPHA));
        let (some, all) = cap.horizon();
        let mut total = (0.0, 0.0);
        for &(node, weight) in &self.outer.nodes {
            // Clusters nodes at the lower end, where the azimuths that count vanish.
            let (at, slope) = (node * node, 2.0 * node);
            let height = some + (all - some) * at;
            let share = weight * slope * (all - some);
            self.partial_turn(&cap, height, share, &mut total);
            let height = all + (1.0 - all) * at;
            let share = weight * slope * (1.0 - all);
            let slice = cap.slice(height);
            for &(cosine, turn) in &self.turns {
                slice.add(cosine, share * turn, &mut total);
            }
        }
        (total.0 / cap.extent(), total.1 / cap.extent())
    }

    /// Adds the azimuths of a height at which the light is up.
    fn partial_turn(&self, cap: &Cap, height: f64, share: f64, total: &mut (f64, f64)) {
        let slice = cap.slice(height);
        let (from, span) = slice.lit();
        for &(node, weight) in &self.inner.nodes {
            // Clusters nodes at the horizon, the span's end.
            let rest = 1.0 - node;
            let azimuth = from + span * (1.0 - rest * rest);
            let turn = 2.0 * rest * weight * span.abs() / PI;
            slice.add(libm::cos(azimuth), share * turn, total);
        }
    }

    /// `C` at the given cosine.
    fn diffuse_fresnel(&self, n_dot_v: f64) -> f64 {
        let sine_v = (1.0 - n_dot_v * n_dot_v).max(0.0).sqrt();
        let mut total = 0.0;
        for &(node, weight) in &self.diffuse.nodes {
            // n.l = sqrt(node) makes the cosine-weighted measure uniform.
            let (n_dot_l, sine_l) = (node.sqrt(), (1.0 - node).sqrt());
            for &(cosine, share) in &self.azimuths {
                let v_dot_l = n_dot_v * n_dot_l + sine_v * sine_l * cosine;
                let v_dot_h = (0.5 + 0.5 * v_dot_l).max(0.0).sqrt();
                total += weight * share * schlick(v_dot_h);
            }
        }
        total
    }
}

/// The spherical cap of a viewer at azimuth 0.
struct Cap {
    n_dot_v: f64,
    sine_v: f64,
    alpha: f64,
    /// The viewer's direction where the surface is a sphere, and its length there before it was made a unit.
    sine: f64,
    cosine: f64,
    length: f64,
    /// `1 + Lambda(v)` of Smith's shadowing.
    masking: f64,
}

impl Cap {
    fn new(n_dot_v: f64, alpha: f64) -> Self {
        let sine_v = (1.0 - n_dot_v * n_dot_v).max(0.0).sqrt();
        let length = (alpha * alpha * sine_v * sine_v + n_dot_v * n_dot_v).sqrt();
        Self {
            n_dot_v,
            sine_v,
            alpha,
            sine: alpha * sine_v / length,
            cosine: n_dot_v / length,
            length,
            masking: 1.0 + smith_lambda(n_dot_v, alpha),
        }
    }

    /// Heights run from `-cosine` to 1.
    fn extent(&self) -> f64 {
        1.0 + self.cosine
    }

    /// Heights above which light is up at some azimuth, and at every one.
    fn horizon(&self) -> (f64, f64) {
        // The cap's point whose light is at the horizon, before or behind the viewer.
        let height = |light: f64| {
            let half = ((self.sine_v + light) / self.alpha, self.n_dot_v);
            let length_squared = half.0 * half.0 + half.1 * half.1;
            let along = self.sine * half.0 + self.cosine * half.1;
            (2.0 * along * half.1 / length_squared - self.cosine).clamp(-self.cosine, 1.0)
        };
        let (before, behind) = (height(-1.0), height(1.0));
        (before.min(behind), before.max(behind))
    }

    fn slice(&self, height: f64) -> Slice<'_> {
        Slice {
            cap: self,
            height,
            radius: (1.0 - height * height).max(0.0).sqrt(),
            half_height: height + self.cosine,
        }
    }
}

/// The points of a cap at one height.
struct Slice<'a> {
    cap: &'a Cap,
    height: f64,
    radius: f64,
    half_height: f64,
}

impl Slice<'_> {
    /// First azimuth and span, which may be negative, of the azimuths within `0..=pi` whose light is up; the span's end
    /// is at the horizon, if any.
    fn lit(&self) -> (f64, f64) {
        let cap = self.cap;
        let alpha_squared = cap.alpha * cap.alpha;
        // The light is up where slope * cosine(azimuth) > least.
        let slope = 2.0
            * cap.sine
            * self.radius
            * (cap.length * self.half_height - cap.n_dot_v * alpha_squared);
        let flat = self.radius * self.radius + cap.sine * cap.sine;
        let least = cap.n_dot_v * (alpha_squared * flat + self.half_height * self.half_height)
            - 2.0 * cap.length * (1.0 + cap.cosine * self.height) * self.half_height;
        if slope == 0.0 {
            return (0.0, if least < 0.0 { PI } else { 0.0 });
        }
        let limit = libm::acos((least / slope).clamp(-1.0, 1.0));
        if slope > 0.0 {
            (0.0, limit)
        } else {
            (PI, limit - PI)
        }
    }

    /// Adds `F G2 / G1` at an azimuth, times the share.
    fn add(&self, cosine: f64, share: f64, total: &mut (f64, f64)) {
        let cap = self.cap;
        let flat = cap.sine * self.radius * cosine;
        let across = self.radius * self.radius + cap.sine * cap.sine + 2.0 * flat;
        let length_squared = cap.alpha * cap.alpha * across + self.half_height * self.half_height;
        let v_dot_h = cap.length * (1.0 + flat + cap.cosine * self.height);
        let n_dot_l = 2.0 * v_dot_h * self.half_height / length_squared - cap.n_dot_v;
        if n_dot_l <= 0.0 {
            return;
        }
        let shadowing = cap.masking / (cap.masking + smith_lambda(n_dot_l.min(1.0), cap.alpha));
        let fresnel = schlick((v_dot_h / length_squared.sqrt()).min(1.0));
        total.0 += share * shadowing * (1.0 - fresnel);
        total.1 += share * shadowing * fresnel;
    }
}

/// Smith's Lambda of GGX.
fn smith_lambda(cosine: f64, alpha: f64) -> f64 {
    let squared = cosine * cosine;
    0.5 * ((1.0 + alpha * alpha * (1.0 - squared) / squared).sqrt() - 1.0)
}

#[cfg(test)]
mod tests {
    use cairn_format::brdf_table::{BRDF_TABLE_SIZE, brdf_table_uv};
    use glam::DVec3;

    use super::super::ggx::smith_visibility;
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
    fn albedos_are_within_their_range() {
        for [a, b, c, zero] in brdf_lut(BRDF_TABLE_SIZE, false) {
            assert!((0.3..1.0 + 1e-5).contains(&(a + b)), "{a} {b}");
            assert!(a >= 0.0 && b >= 0.0 && c > 0.0 && c < 1.0 && zero == 0.0);
        }
    }

    /// `[A, B, C]` as the player reads them: halves, bilinear, at the coordinates that shaders use.
    fn read(table: &[[f32; 4]], n_dot_v: f64, roughness: f64) -> [f64; 3] {
        const SIDE: usize = BRDF_TABLE_SIZE as usize;
        let [x, y] = brdf_table_uv(n_dot_v, roughness)
            .map(|at| (at * SIDE as f64 - 0.5).clamp(0.0, (SIDE - 1) as f64));
        let (column, row) = ((x as usize).min(SIDE - 2), (y as usize).min(SIDE - 2));
        let (fx, fy) = (x - column as f64, y - row as f64);
        let at =
            |i: usize, j: usize, k: usize| half::f16::from_f32(table[j * SIDE + i][k]).to_f64();
        [0, 1, 2].map(|k| {
            let upper = at(column, row, k) * (1.0 - fx) + at(column + 1, row, k) * fx;
            let lower = at(column, row + 1, k) * (1.0 - fx) + at(column + 1, row + 1, k) * fx;
            upper * (1.0 - fy) + lower * fy
        })
    }

    /// Worst errors of the table as it is read: of `[A, B, C]` for `N.V` from 1e-4 and from 0.05, and relative of
    /// `A + B`, which is what a white furnace is off by.
    fn reading_errors() -> [f64; 3] {
        let table = brdf_lut(BRDF_TABLE_SIZE, false);
        let integrator = Integrator::new();
        let steps = 120;
        let at = |i: usize| (i as f64 + 0.37) / steps as f64;
        let errors = (0..steps * steps).into_par_iter().map(|index| {
            // Even and squared steps, to look closer where the table bends most.
            let (x, y) = (at(index % steps), at(index / steps));
            let n_dot_v = if index % 2 == 0 { x } else { x * x * x }.max(1e-4);
            let roughness = 0.045 + 0.955 * if index % 3 == 0 { y } else { y * y };
            let (a, b) = integrator.split_sum(n_dot_v, roughness);
            let found = read(&table, n_dot_v, roughness);
            let diffuse = (found[2] - integrator.diffuse_fresnel(n_dot_v)).abs();
            let error = (found[0] - a).abs().max((found[1] - b).abs()).max(diffuse);
            let furnace = ((found[0] + found[1]) / (a + b) - 1.0).abs();
            let near = if n_dot_v < 0.05 { 0.0 } else { error };
            [error, near, furnace]
        });
        errors.reduce(|| [0.0; 3], |a, b| std::array::from_fn(|k| a[k].max(b[k])))
    }

    #[test]
    fn the_player_reads_albedos_that_close_a_furnace() {
        let [everywhere, facing, furnace] = reading_errors();
        eprintln!(
            "A, B, C within {everywhere:.1e}, {facing:.1e} from N.V 0.05 on; furnace {furnace:.1e}"
        );
        assert!(everywhere < 2e-3 && facing < 8e-4 && furnace < 2.5e-3);
    }
}
