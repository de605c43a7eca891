//! Packages without vertex colours or texture transforms build pipelines without them.

use cairn_format::TextureFormat;
use cairn_format::gpu::{Material, TextureTransform};
use glam::{Mat4, Vec3};

use super::fixture::{Fixture, colored, light, row, sphere};
use super::{device, plain, shoot, towards_origin};
use crate::frame::Renderer;
use crate::gpu::{Gpu, vk};
use crate::passes::{Alpha, Variant};
use crate::scene::GpuScene;

const SIZE: [u32; 2] = [31, 15];
const IDENTITY: TextureTransform = TextureTransform {
    matrix: [1.0, 0.0, 0.0, 1.0],
    offset: [0.0; 2],
    pad_24: 0,
    pad_28: 0,
};

/// A lit, textured sphere with neither; the BRDF table's slot lies behind the package's textures.
fn bare() -> Fixture {
    Fixture {
        objects: vec![sphere(0, vec![Mat4::IDENTITY])],
        materials: vec![Material {
            base_color_tex: 0,
            roughness_factor: 0.6,
            ..Material::default()
        }],
        textures: vec![row(TextureFormat::Rgba8Unorm, vec![[200, 100, 50, 255]])],
        lights: vec![light(Vec3::new(0.3, -1.0, -0.5), [1.0; 3], 2.0)],
        environment: Some([[0.5, 0.6, 0.7]; 6]),
        lut: true,
        ..Fixture::default()
    }
}

fn with_colors(fixture: Fixture) -> Fixture {
    let objects = fixture.objects.into_iter();
    Fixture {
        objects: objects.map(|object| colored(object, [1.0; 4])).collect(),
        ..fixture
    }
}

fn with_transforms(fixture: Fixture) -> Fixture {
    Fixture {
        transforms: vec![IDENTITY; fixture.textures.len()],
        ..fixture
    }
}

/// What is compiled into the pipelines of a package.
fn variant(gpu: &Gpu, fixture: &Fixture) -> Variant {
    let package = fixture.package();
    let scene = GpuScene::upload(gpu, &package).expect("uploads");
    let format = vk::Format::R8G8B8A8_SRGB;
    let renderer = Renderer::new(gpu, &scene, &package, format, SIZE, &plain());
    let variant = renderer.expect("builds").plan().variant;
    assert_eq!(scene.vertex_colors.is_some(), variant.vertex_colors);
    assert_eq!(
        scene.texture_transforms.is_some(),
        variant.texture_transforms
    );
    variant
}

#[test]
fn constants_follow_the_sections() {
    let Some(gpu) = device() else { return };
    for (fixture, expected) in [
        (bare(), [0; 10]),
        (with_colors(bare()), [1, 0, 0, 0, 0, 0, 0, 0, 0, 0]),
        (with_transforms(bare()), [0, 1, 0, 0, 0, 0, 0, 0, 0, 0]),
    ] {
        let variant = variant(&gpu, &fixture);
        for alpha in [Alpha::Ignored, Alpha::Cut, Alpha::Blended] {
            let values = variant.constants(alpha).map(|(_, value)| value);
            assert_eq!(values[6..], expected);
        }
    }
    assert_eq!(gpu.close(), Vec::<String>::new());
}

#[test]
fn white_and_the_identity_change_no_pixel() {
    let Some(gpu) = device() else { return };
    let camera = || towards_origin(Vec3::new(0.0, 0.0, 3.0));
    let expected = shoot(&gpu, &bare(), SIZE, camera(), plain());
    let full = with_transforms(with_colors(bare()));
    let found = shoot(&gpu, &full, SIZE, camera(), plain());
    assert_eq!(found.hdr, expected.hdr);
    assert_eq!(found.scene.vertex_color_bytes, 33 * 17 * 8);
    assert_eq!(found.scene.texture_transform_bytes, 32);
}
