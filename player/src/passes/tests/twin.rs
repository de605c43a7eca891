//! The BRDF in f64, written from its textbook form, and its table by quadrature.

use cairn_format::brdf_table::{BRDF_TABLE_SIZE, brdf_table_point};
use glam::DVec3;
use std::f64::consts::PI;

/// Directional albedo terms A and B, and C, by sampling visible GGX normals (Dupuy and Benyoub 2023) at `SAMPLES` points.
pub fn table(n_dot_v: f64, roughness: f64) -> [f64; 3] {
    const SAMPLES: u32 = 512;
    let alpha = (roughness * roughness).max(1e-4);
    let v = DVec3::new((1.0 - n_dot_v * n_dot_v).max(0.0).sqrt(), 0.0, n_dot_v);
    let stretched = DVec3::new(alpha * v.x, 0.0, v.z).normalize();
    let a2 = alpha * alpha;
    let masking = 2.0 * n_dot_v / (n_dot_v + (n_dot_v * n_dot_v * (1.0 - a2) + a2).sqrt());
    let mut sum = [0.0; 3];
    for index in 0..SAMPLES {
        let u = (f64::from(index) + 0.5) / f64::from(SAMPLES);
        let phi = f64::from(index.reverse_bits()) / 2f64.powi(32) * 2.0 * PI;
        let z = (1.0 - u) * (1.0 + stretched.z) - stretched.z;
        let sine = (1.0 - z * z).max(0.0).sqrt();
        let cap = DVec3::new(sine * phi.cos(), sine * phi.sin(), z) + stretched;
        let h = DVec3::new(alpha * cap.x, alpha * cap.y, cap.z.max(1e-12)).normalize();
        let v_dot_h = v.dot(h);
        let l = 2.0 * v_dot_h * h - v;
        if l.z > 0.0 && v_dot_h > 0.0 {
            let weight = 4.0 * n_dot_v * l.z * visibility(n_dot_v, l.z, alpha) / masking;
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

/// The BRDF table; its last channel is sheen's albedo where `sheen` asks for it.
pub fn table_texels(sheen: bool) -> Vec<[f32; 4]> {
    const SIZE: u32 = BRDF_TABLE_SIZE;
    let texels = (0..SIZE * SIZE).map(|index| {
        let [x, roughness] = brdf_table_point(index % SIZE, index / SIZE, SIZE);
        let n_dot_v = x.max(1e-4);
        let [a, b, c] = table(n_dot_v, roughness);
        let sheen = if sheen {
            sheen_albedo(n_dot_v, roughness)
        } else {
            0.0
        };
        [a, b, c, sheen].map(|value| value as f32)
    });
    texels.collect()
}

/// Directional albedo of white sheen by a sum over light directions, more of them near the horizon.
pub fn sheen_albedo(n_dot_v: f64, roughness: f64) -> f64 {
    const SIDE: u32 = 48;
    let v = DVec3::new((1.0 - n_dot_v * n_dot_v).max(0.0).sqrt(), 0.0, n_dot_v);
    let center = |index: u32| (f64::from(index) + 0.5) / f64::from(SIDE);
    let mut total = 0.0;
    for (row, column) in (0..SIDE * SIDE).map(|index| (center(index / SIDE), center(index % SIDE)))
    {
        let (cosine, phi) = (row * row, column * PI);
        let sine = (1.0 - cosine * cosine).sqrt();
        let l = DVec3::new(sine * phi.cos(), sine * phi.sin(), cosine);
        total += sheen(DVec3::Z, v, l, roughness) * cosine * 2.0 * row;
    }
    (total * 2.0 * PI / f64::from(SIDE * SIDE)).min(1.0)
}

/// `KHR_materials_sheen` in white, without N.L.
pub fn sheen(n: DVec3, v: DVec3, l: DVec3, roughness: f64) -> f64 {
    let alpha = roughness.max(0.045).powi(2);
    let (n_dot_v, n_dot_l) = (n.dot(v).max(1e-4), n.dot(l));
    let n_dot_h = n.dot((v + l).normalize());
    let sine2 = (1.0 - n_dot_h * n_dot_h).max(0.0);
    let d = (2.0 + 1.0 / alpha) * sine2.powf(0.5 / alpha) / (2.0 * PI);
    let shadowing = 1.0 + sheen_lambda(n_dot_v, alpha) + sheen_lambda(n_dot_l, alpha);
    d * (1.0 / (shadowing * 4.0 * n_dot_v * n_dot_l)).min(1.0)
}

/// The fitted shadowing of Estevez and Kulla 2017.
fn sheen_lambda(cosine: f64, alpha: f64) -> f64 {
    let curve = |x: f64| {
        let t = (1.0 - alpha).powi(2);
        let mix = |from: f64, to: f64| from * (1.0 - t) + to * t;
        mix(21.5473, 25.3245)
            / (1.0 + mix(3.82987, 3.32435) * x.max(1e-6).powf(mix(0.19823, 0.16801)))
            + mix(-1.97760, -1.27393) * x
            + mix(-4.32054, -4.85967)
    };
    if cosine < 0.5 {
        curve(cosine).exp()
    } else {
        (2.0 * curve(0.5) - curve(1.0 - cosine)).exp()
    }
}

/// A surface and one light's direction.
#[derive(Clone, Copy, Debug)]
pub struct Shading {
    pub normal: DVec3,
    pub view: DVec3,
    pub light: DVec3,
    pub base: DVec3,
    pub metallic: f64,
    pub roughness: f64,
    pub lobes: Lobes,
}

/// The extensions' parameters, one factor each.
#[derive(Clone, Copy, Debug)]
pub struct Lobes {
    pub dielectric_f0: DVec3,
    pub specular: f64,
    pub sheen: DVec3,
    pub sheen_roughness: f64,
    pub coat: f64,
    pub coat_roughness: f64,
}

impl Default for Lobes {
    fn default() -> Self {
        Self {
            dielectric_f0: DVec3::splat(0.04),
            specular: 1.0,
            sheen: DVec3::ZERO,
            sheen_roughness: 0.0,
            coat: 0.0,
            coat_roughness: 0.0,
        }
    }
}

impl Shading {
    /// Reflected radiance per unit of irradiance perpendicular to the light, N.L included.
    pub fn reflected(&self, energy: bool) -> DVec3 {
        let n_dot_l = self.normal.dot(self.light);
        if n_dot_l <= 0.0 {
            return DVec3::ZERO;
        }
        let n_dot_v = self.normal.dot(self.view).clamp(1e-4, 1.0);
        let under_coat = self.base_lobes(energy, n_dot_v, n_dot_l);
        let lobes = &self.lobes;
        let under_coat = if lobes.sheen == DVec3::ZERO {
            under_coat
        } else {
            let largest = lobes.sheen.max_element();
            let taken = |cosine: f64| largest * sheen_albedo(cosine, lobes.sheen_roughness);
            let share = 1.0
                - if energy {
                    taken(n_dot_v)
                } else {
                    taken(n_dot_v).max(taken(n_dot_l))
                };
            let lobe = sheen(self.normal, self.view, self.light, lobes.sheen_roughness);
            under_coat * share + lobes.sheen * lobe
        };
        let weight = lobes.coat * (0.04 + 0.96 * (1.0 - n_dot_v).powi(5));
        let gain = if energy {
            let [a, b, _] = table(n_dot_v, lobes.coat_roughness);
            1.0 / (a + b)
        } else {
            1.0
        };
        let coat = self.ggx(lobes.coat_roughness, n_dot_v, n_dot_l) * gain;
        under_coat.lerp(DVec3::splat(coat), weight) * n_dot_l
    }

    /// The lobes of the specification, sheen apart.
    pub fn without_sheen(&self) -> DVec3 {
        let lobes = Lobes {
            sheen: DVec3::ZERO,
            ..self.lobes
        };
        Self { lobes, ..*self }.reflected(false)
    }

    fn ggx(&self, roughness: f64, n_dot_v: f64, n_dot_l: f64) -> f64 {
        let alpha = roughness.max(0.045).powi(2);
        let h = (self.view + self.light).normalize();
        distribution(self.normal.dot(h), alpha) * visibility(n_dot_v, n_dot_l, alpha)
    }

    /// glTF 2.0, appendix B: a dielectric and a metal, mixed.
    fn base_lobes(&self, energy: bool, n_dot_v: f64, n_dot_l: f64) -> DVec3 {
        let h = (self.view + self.light).normalize();
        let weight = (1.0 - self.view.dot(h)).powi(5);
        let lobe = self.ggx(self.roughness, n_dot_v, n_dot_l);
        let [a, b, _] = if energy {
            table(n_dot_v, self.roughness)
        } else {
            [1.0; 3]
        };
        // The lobe of one Fresnel term, its albedo, and the term.
        let specular = |f0: DVec3, f90: f64| {
            let fresnel = f0 + (f90 - f0) * weight;
            let gain = if energy {
                1.0 + f0 * (1.0 / (a + b) - 1.0)
            } else {
                DVec3::ONE
            };
            (lobe * fresnel * gain, (f0 * a + f90 * b) * gain, fresnel)
        };
        let (metal, ..) = specular(self.base, 1.0);
        let (top, albedo, fresnel) = specular(self.lobes.dielectric_f0, self.lobes.specular);
        let passed = 1.0
            - if energy {
                albedo.max_element()
            } else {
                fresnel.max_element()
            };
        let dielectric = top + passed * self.base / PI;
        dielectric.lerp(metal, self.metallic)
    }
}

/// Jimenez et al. 2016: visibility with the light that bounces between occluders of that albedo.
pub fn multi_bounce(visibility: f64, albedo: f64) -> f64 {
    let [a, b, c] = [
        2.0404 * albedo - 0.3324,
        -4.7951 * albedo + 0.6417,
        2.7552 * albedo + 0.6903,
    ];
    visibility.max(a * visibility.powi(3) + b * visibility.powi(2) + c * visibility)
}

/// Lagarde and de Rousiers 2014.
pub fn specular_occlusion_lagarde(n_dot_v: f64, visibility: f64, roughness: f64) -> f64 {
    let exponent = (-16.0 * roughness - 1.0).exp2();
    ((n_dot_v + visibility).powf(exponent) - 1.0 + visibility).clamp(0.0, 1.0)
}

/// The cone of open directions against that of the lobe, `between` apart.
pub fn specular_occlusion_cones(between: f64, visibility: f64, roughness: f64) -> f64 {
    let open = (1.0 - visibility).sqrt().acos();
    let lobe = 0.01_f64.powf(0.5 * roughness * roughness).acos().max(0.01);
    let t = ((open - between) / lobe).clamp(0.0, 1.0);
    let share = t * t * (3.0 - 2.0 * t);
    share + (1.0 - share) * visibility * visibility
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
