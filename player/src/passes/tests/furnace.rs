//! White furnace: in light that is the same from everywhere, a white object cannot be seen.

use cairn_format::gpu::{LOBE_CLEARCOAT, LOBE_SHEEN, Material, MaterialExtension};
use glam::{Mat4, Vec3};

use super::fixture::{Fixture, light, quad, sphere};
use super::{assert_near, device, middle, plain, shoot, texel, towards_origin};
use crate::settings::{Brdf, Settings};

const ROUGHNESSES: [f32; 5] = [0.0, 0.2, 0.5, 0.8, 1.0];
const METALLICS: [f32; 3] = [0.0, 0.5, 1.0];

/// Rows of white spheres of rising roughness; more metallic ones above.
fn spheres() -> Fixture {
    let mut fixture = Fixture {
        lut: true,
        environment: Some([[1.0; 3]; 6]),
        ..Fixture::default()
    };
    for metallic in METALLICS {
        for (column, roughness) in ROUGHNESSES.iter().enumerate() {
            let center = Vec3::new(column as f32 - 2.0, metallic * 2.0 - 1.0, 0.0);
            let model = Mat4::from_translation(center) * Mat4::from_scale(Vec3::splat(0.45));
            let material = fixture.materials.len() as u32;
            fixture.objects.push(sphere(material, vec![model]));
            fixture.materials.push(Material {
                metallic_factor: metallic,
                roughness_factor: *roughness,
                ..Material::default()
            });
        }
    }
    fixture
}

#[test]
fn energy_mode_closes_for_white_metals_and_dielectrics() {
    let Some(gpu) = device() else { return };
    let camera = towards_origin(Vec3::new(0.0, 0.0, 3.0));
    let image = shoot(&gpu, &spheres(), [160, 80], camera, plain());
    assert_eq!(image.draws.draws, 15);
    for texel in image.hdr.iter().flatten() {
        let worst = texel[..3]
            .iter()
            .fold(0.0_f32, |m, c| m.max((c - 1.0).abs()));
        assert!(worst <= 0.01, "{texel:?} in a furnace of 1");
    }
}

/// White sheen and coats take from what lies beneath exactly what they reflect.
#[test]
fn energy_mode_closes_under_sheen_and_coats() {
    let Some(gpu) = device() else { return };
    let camera = towards_origin(Vec3::new(0.0, 0.0, 3.0));
    for (coat, sheen) in [(1.0, 0.0), (0.5, 1.0), (0.0, 0.7)] {
        let mut fixture = spheres();
        let materials = fixture.materials.iter();
        fixture.lobes = materials
            .map(|material| MaterialExtension {
                clearcoat_factor: coat,
                clearcoat_roughness: 1.0 - material.roughness_factor,
                sheen_color: [sheen; 3],
                sheen_roughness: material.roughness_factor,
                lobes: LOBE_CLEARCOAT | LOBE_SHEEN,
                ..MaterialExtension::default()
            })
            .collect();
        let image = shoot(&gpu, &fixture, [160, 80], camera, plain());
        for texel in image.hdr.iter().flatten() {
            let worst = texel[..3]
                .iter()
                .fold(0.0_f32, |m, c| m.max((c - 1.0).abs()));
            assert!(
                worst <= 0.01,
                "{texel:?} under a coat of {coat}, sheen of {sheen}"
            );
        }
    }
}

#[test]
fn gltf_core_loses_what_single_scattering_loses() {
    let Some(gpu) = device() else { return };
    let camera = towards_origin(Vec3::new(0.0, 0.0, 3.0));
    let settings = Settings {
        brdf: Brdf::GltfCore,
        ..plain()
    };
    for (fixture, radiance) in [(spheres(), 1.0), (without_table(), 0.1)] {
        let image = shoot(&gpu, &fixture, [161, 81], camera, settings.clone());
        // The middle of the roughest metal, where N.V is about 0.9.
        let x = 80.5 + 2.0 / 3.0 / (0.5_f32).tan() * 40.5;
        let y = 40.5 - 1.0 / 3.0 / (0.5_f32).tan() * 40.5;
        let [red, ..] = texel(&image, x as u32, y as u32);
        let [a, b, _] = super::twin::table(0.9, 1.0);
        let found = f64::from(red) / radiance;
        assert!((found - (a + b)).abs() < 0.03, "{found} for {}", a + b);
    }
}

/// The spheres under the constant ambient radiance, with a light that is off.
fn without_table() -> Fixture {
    Fixture {
        lut: false,
        environment: None,
        lights: vec![light(Vec3::NEG_Z, [1.0; 3], 0.0)],
        ..spheres()
    }
}

#[test]
fn without_a_table_the_fit_closes_too() {
    let Some(gpu) = device() else { return };
    let camera = towards_origin(Vec3::new(0.0, 0.0, 3.0));
    let image = shoot(&gpu, &without_table(), [160, 80], camera, plain());
    let mut lit = 0;
    for texel in image.hdr.iter().flatten().filter(|texel| texel[0] > 0.0) {
        let worst = texel[..3]
            .iter()
            .fold(0.0_f32, |m, c| m.max((c - 0.1).abs()));
        assert!(worst <= 0.001, "{texel:?} under an ambient of 0.1");
        lit += 1;
    }
    assert!(lit > 1000, "{lit} pixels show a sphere");
}

#[test]
fn gltf_core_dielectrics_keep_what_fresnel_leaves() {
    let Some(gpu) = device() else { return };
    let (n_dot_v, roughness) = (0.515_625_f32, 0.515_625_f32);
    let tilt = Mat4::from_rotation_y(n_dot_v.acos());
    let fixture = Fixture {
        objects: vec![quad(0, vec![tilt])],
        materials: vec![Material {
            metallic_factor: 0.0,
            roughness_factor: roughness,
            ..Material::default()
        }],
        ..spheres()
    };
    let settings = Settings {
        brdf: Brdf::GltfCore,
        ..plain()
    };
    let camera = towards_origin(Vec3::new(0.0, 0.0, 3.0));
    let found = middle(&shoot(&gpu, &fixture, [33, 33], camera, settings));
    let [a, b, c] = super::twin::table(f64::from(n_dot_v), f64::from(roughness));
    let expected = 0.96 * (1.0 - c) + 0.04 * a + b;
    assert_near(found, [expected as f32; 3], 1e-3);
}

#[test]
fn roughness_chooses_the_prefiltered_level() {
    let Some(gpu) = device() else { return };
    for (roughness, expected) in [(0.0, 1.0), (0.25, 2.0), (0.5, 3.0), (1.0, 7.0)] {
        let fixture = Fixture {
            objects: vec![quad(0, vec![Mat4::IDENTITY])],
            materials: vec![Material {
                roughness_factor: roughness,
                ..Material::default()
            }],
            prefiltered: vec![[1.0; 3], [3.0; 3], [7.0; 3]],
            ..spheres()
        };
        let camera = towards_origin(Vec3::new(0.0, 0.0, 3.0));
        let found = middle(&shoot(&gpu, &fixture, [9, 9], camera, plain()));
        assert_near(found, [expected; 3], 0.02);
    }
}
