//! The BRDF in f64, written from its textbook form, and its table by quadrature.

use glam::DVec3;
use std::f64::consts::PI;

/// Directional albedo terms A and B, and C, by sampling the GGX distribution at `SAMPLES` points.
pub fn table(n_dot_v: f64, roughness: f64) -> [f64; 3] {
    const SAMPLES: u32 = 512;
    let alpha = (roughness * roughness).max(1e-4);
    let v = DVec3::new((1.0 - n_dot_v * n_dot_v).max(0.0).sqrt(), 0.0, n_dot_v);
    let mut sum = [0.0; 3];
    for index in 0..SAMPLES {
        let u = (f64::from(index) + 0.5) / f64::from(SAMPLES);
        let phi = f64::from(index.reverse_bits()) / 2f64.powi(32) * 2.0 * PI;
        let cos2 = (1.0 - u) / (1.0 + (alpha * alpha - 1.0) * u);
        let (sin, cos) = ((1.0 - cos2).sqrt(), cos2.sqrt());
        let h = DVec3::new(sin * phi.cos(), sin * phi.sin(), cos);
        let v_dot_h = v.dot(h);
        let l = 2.0 * v_dot_h * h - v;
        if l.z > 0.0 && v_dot_h > 0.0 {
            let weight = 4.0 * visibility(n_dot_v, l.z, alpha) * l.z * v_dot_h / h.z;
            let fresnel = (1.0 - v_dot_h).powi(5);
            sum[0] += (1.0 - fresnel) * weight;
            sum[1] += fresnel * weight;
        }
        let diffuse = DVec3::new(u.sqrt() * phi.cos(), u.sqrt() * phi.sin(), (1.0 - u).sqrt());
        sum[2] += (1.0 - v.dot((v + diffuse).normalize()))
            .clamp(0.0, 1.0)
            .powi(5);
    }
    sum.map(|total| total / f64::from(SAMPLES))
}

/// Rows of the table: N.V along x, roughness along y, at texel centres.
pub fn table_texels(size: u32) -> Vec<[f32; 3]> {
    let center = |index: u32| (f64::from(index) + 0.5) / f64::from(size);
    let texels = (0..size * size).map(|index| table(center(index % size), center(index / size)));
    texels
        .map(|texel| texel.map(|value| value as f32))
        .collect()
}

/// A surface and one light's direction.
pub struct Shading {
    pub normal: DVec3,
    pub view: DVec3,
    pub light: DVec3,
    pub base: DVec3,
    pub metallic: f64,
    pub roughness: f64,
}

impl Shading {
    /// Reflected radiance per unit of irradiance perpendicular to the light, N.L included.
    pub fn reflected(&self, energy: bool) -> DVec3 {
        let n_dot_l = self.normal.dot(self.light);
        if n_dot_l <= 0.0 {
            return DVec3::ZERO;
        }
        let n_dot_v = self.normal.dot(self.view).clamp(1e-4, 1.0);
        let alpha = self.roughness.max(0.045).powi(2);
        let h = (self.view + self.light).normalize();
        let weight = (1.0 - self.view.dot(h)).powi(5);
        let lobe = distribution(self.normal.dot(h), alpha) * visibility(n_dot_v, n_dot_l, alpha);
        let [a, b, _] = table(n_dot_v, self.roughness);
        // The lobe of one Fresnel term, and its albedo.
        let specular = |f0: DVec3| {
            let fresnel = f0 + (1.0 - f0) * weight;
            let gain = if energy {
                1.0 + f0 * (1.0 / (a + b) - 1.0)
            } else {
                DVec3::ONE
            };
            (lobe * fresnel * gain, (f0 * a + b) * gain, fresnel)
        };
        let (metal, ..) = specular(self.base);
        let (coat, albedo, fresnel) = specular(DVec3::splat(0.04));
        let passed = 1.0 - if energy { albedo } else { fresnel };
        let dielectric = coat + passed * self.base / PI;
        dielectric.lerp(metal, self.metallic) * n_dot_l
    }
}

fn distribution(n_dot_h: f64, alpha: f64) -> f64 {
    let a2 = alpha * alpha;
    let denominator = n_dot_h * n_dot_h * (a2 - 1.0) + 1.0;
    a2 / (PI * denominator * denominator)
}

fn visibility(n_dot_v: f64, n_dot_l: f64, alpha: f64) -> f64 {
    let lambda = |cosine: f64| (cosine * cosine * (1.0 - alpha * alpha) + alpha * alpha).sqrt();
    0.5 / (n_dot_l * lambda(n_dot_v) + n_dot_v * lambda(n_dot_l))
}

#[test]
fn quadrature_has_known_limits() {
    let [a, b, _] = table(0.9, 0.01);
    assert!(
        (a + b - 1.0).abs() < 2e-3,
        "a mirror reflects all: {a} + {b}"
    );
    let [.., c] = table(1.0, 0.5);
    assert!(c < 2e-4, "head-on light meets no grazing half vectors: {c}");
    let [.., c] = table(0.0, 0.5);
    assert!((c - 0.02815).abs() < 1e-3, "grazing view: {c}");
    let [a, b, _] = table(1.0, 1.0);
    let exact = 1.0 - 2f64.ln();
    assert!(
        (a + b - exact).abs() < 1e-3,
        "roughness 1, head on: {}",
        a + b
    );
}
