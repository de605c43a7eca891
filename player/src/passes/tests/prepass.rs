//! A prepass and multisampling change what a frame costs, and no surface.

use cairn_format::TextureFormat;
use cairn_format::gpu::{ALPHA_BLEND, ALPHA_MASK, Material};
use glam::{Mat4, Vec3};

use super::fixture::{Fixture, light, quad, row, sphere, unlit};
use super::{along, assert_near, device, plain, shoot, texel, towards_origin};
use crate::camera::Projection;
use crate::settings::{Prepass, Settings};

/// Opaque, cut, blended, mirrored and overlapping.
fn busy() -> Fixture {
    let leaf = Material {
        base_color_tex: 0,
        alpha_mode: ALPHA_MASK,
        alpha_cutoff: 0.5,
        double_sided: 1,
        ..Material::default()
    };
    let glass = Material {
        base_color_factor: [0.2, 0.9, 0.4, 0.5],
        alpha_mode: ALPHA_BLEND,
        ..Material::default()
    };
    let mut cut = quad(1, vec![Mat4::from_rotation_y(0.7)]);
    for vertex in &mut cut.vertices {
        vertex.uv0 = [vertex.position[0] * 3.0, 0.5];
    }
    let mirrored = Mat4::from_scale(Vec3::new(-0.7, 0.7, 0.7));
    Fixture {
        objects: vec![
            sphere(0, vec![Mat4::IDENTITY, mirrored]),
            cut,
            quad(2, vec![Mat4::from_translation(Vec3::Z)]),
        ],
        materials: vec![Material::default(), leaf, glass],
        textures: vec![row(
            TextureFormat::Rgba8Unorm,
            vec![[200, 100, 50, 255], [0, 90, 0, 0]],
        )],
        lights: vec![light(Vec3::new(0.3, -1.0, -0.5), [1.0; 3], 2.0)],
        environment: Some([[0.5, 0.6, 0.7]; 6]),
        lut: true,
        ..Fixture::default()
    }
}

#[test]
fn a_prepass_changes_no_bit() {
    let Some(gpu) = device() else { return };
    for msaa in [1, 4] {
        let settings = |prepass| Settings {
            prepass,
            msaa,
            ..plain()
        };
        let shot = |settings| {
            let camera = towards_origin(Vec3::new(0.5, 0.4, 3.0));
            shoot(&gpu, &busy(), [61, 43], camera, settings)
        };
        let without = shot(settings(Prepass::Off));
        let with = shot(settings(Prepass::On));
        assert!(without.passes.iter().all(|pass| pass.name != "depth"));
        assert!(with.passes.iter().any(|pass| pass.name == "depth"));
        assert_eq!(with.hdr, without.hdr, "{msaa} samples");
    }
}

#[test]
fn one_colour_stays_itself_under_multisampling() {
    let Some(gpu) = device() else { return };
    let fixture = Fixture {
        objects: vec![quad(0, vec![Mat4::from_translation(-Vec3::Z)])],
        materials: vec![unlit([0.25, 0.5, 0.125, 1.0])],
        ..Fixture::default()
    };
    let camera = along(-Vec3::Z, Projection::Perspective { yfov: 0.5 });
    let settings = Settings { msaa: 4, ..plain() };
    let image = shoot(&gpu, &fixture, [8, 8], camera, settings);
    assert_near(texel(&image, 4, 4), [0.25, 0.5, 0.125], 0.0);
}

/// W-21: a silhouette against the sky mixes surface and sky, and never the black behind both.
#[test]
fn silhouettes_have_no_dark_outline() {
    let Some(gpu) = device() else { return };
    let fixture = Fixture {
        objects: vec![sphere(0, vec![Mat4::IDENTITY])],
        materials: vec![unlit([0.5, 0.5, 0.5, 1.0])],
        environment: Some([[0.5; 3]; 6]),
        lut: true,
        ..Fixture::default()
    };
    let settings = Settings { msaa: 4, ..plain() };
    let camera = towards_origin(Vec3::new(0.0, 0.0, 3.0));
    let image = shoot(&gpu, &fixture, [64, 64], camera, settings);
    for y in 0..64 {
        for x in 0..64 {
            assert_near(texel(&image, x, y), [0.5; 3], 1e-3);
        }
    }
}

/// A lamp of 1000 beside a wall of 0.1: behind the tone curve its edge has a value between the two.
#[test]
fn bright_edges_are_resolved_behind_the_curve() {
    let Some(gpu) = device() else { return };
    let lamp = Material {
        emissive_factor: [1000.0, 1000.0, 1000.0, 0.0],
        base_color_factor: [0.0, 0.0, 0.0, 1.0],
        ..Material::default()
    };
    let fixture = Fixture {
        objects: vec![
            quad(0, vec![Mat4::from_scale(Vec3::splat(9.0))]),
            quad(
                1,
                vec![Mat4::from_translation(Vec3::new(0.0, 0.0, 0.1)) * Mat4::from_rotation_z(0.1)],
            ),
        ],
        materials: vec![unlit([0.1, 0.1, 0.1, 1.0]), lamp],
        ..Fixture::default()
    };
    let settings = Settings { msaa: 4, ..plain() };
    let camera = towards_origin(Vec3::new(0.0, 0.0, 6.0));
    let image = shoot(&gpu, &fixture, [64, 64], camera, settings);
    let hdr = image.hdr.as_ref().expect("read back");
    let between = hdr.iter().filter(|texel| texel[0] > 0.11 && texel[0] < 5.0);
    assert!(between.count() > 20, "edge texels that a display can show");
}
