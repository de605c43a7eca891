//! Debug views that count or look up: overdraw and mip level.

use cairn_format::TextureFormat;
use cairn_format::gpu::{ALPHA_BLEND, Material};
use glam::{Mat4, Vec3};

use super::fixture::{Fixture, Picture, quad};
use super::{assert_near, device, middle, plain, shoot, texel, towards_origin};
use crate::settings::{Prepass, Settings};

const FRONT: Vec3 = Vec3::new(0.0, 0.0, 3.0);

fn view(debug_view: u32) -> Settings {
    Settings {
        debug_view,
        ..plain()
    }
}

/// Squares at these heights, drawn in this order.
fn stack(heights: &[f32], material: Material) -> Fixture {
    let at = |z: &f32| {
        Mat4::from_translation(Vec3::new(0.0, 0.0, *z)) * Mat4::from_scale(Vec3::splat(0.5))
    };
    let squares = heights.iter().zip(0..);
    Fixture {
        objects: squares.map(|(z, index)| quad(index, vec![at(z)])).collect(),
        materials: vec![material; heights.len()],
        environment: Some([[1.0; 3]; 6]),
        lut: true,
        ..Fixture::default()
    }
}

#[test]
fn overdraw_counts_what_is_shaded() {
    let Some(gpu) = device() else { return };
    let opaque = Material::default();
    let blended = Material {
        alpha_mode: ALPHA_BLEND,
        ..Material::default()
    };
    for (heights, material, count) in [
        // From behind, each is shaded; from the front, only the first. Behind a prepass they would be alike.
        (vec![-1.0, -0.5, 0.0, 0.5], opaque, 4.0),
        (vec![0.5, 0.0, -0.5, -1.0], opaque, 1.0),
        (vec![0.5, 0.0, -0.5], blended, 3.0),
    ] {
        let settings = Settings {
            prepass: Prepass::On,
            ..view(11)
        };
        let fixture = stack(&heights, material);
        let image = shoot(&gpu, &fixture, [33, 33], towards_origin(FRONT), settings);
        assert_near(middle(&image), [count; 3], 0.0);
        assert_near(texel(&image, 0, 0), [0.0; 3], 0.0);
        assert!(image.passes.iter().all(|pass| pass.name != "skybox"));
    }
}

/// The fixture's textures have one level, which is white; a surface without a texture is grey.
#[test]
fn the_mip_view_names_the_level() {
    let Some(gpu) = device() else { return };
    let mut card = quad(0, vec![Mat4::IDENTITY]);
    for vertex in &mut card.vertices {
        vertex.uv0 = [
            vertex.position[0] * 0.5 + 0.5,
            0.5 - vertex.position[1] * 0.5,
        ];
    }
    let fixture = |reference: u32| Fixture {
        objects: vec![card.clone()],
        materials: vec![Material {
            base_color_tex: reference,
            ..Material::default()
        }],
        textures: vec![Picture {
            format: TextureFormat::Rgba8Unorm,
            width: 4,
            texels: vec![[255; 4]; 16],
        }],
        ..Fixture::default()
    };
    let camera = || towards_origin(Vec3::new(0.0, 0.0, 2.0));
    let image = shoot(&gpu, &fixture(0), [33, 33], camera(), view(12));
    assert_near(middle(&image), [1.0; 3], 1e-3);
    let image = shoot(&gpu, &fixture(u32::MAX), [33, 33], camera(), view(12));
    assert_near(middle(&image), [0.5; 3], 1e-3);
}
