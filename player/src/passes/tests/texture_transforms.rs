//! Texture transforms move the coordinates of their slot.

use cairn_format::TextureFormat;
use cairn_format::gpu::{Material, TEXTURE_UV1, TextureTransform};
use glam::{Mat4, Vec3};

use super::fixture::{Fixture, Object, Picture, quad, unlit};
use super::{assert_near, device, middle, plain, shoot, towards_origin};
use crate::gpu::Gpu;
use crate::settings::Settings;

const EYE: Vec3 = Vec3::new(0.0, 0.0, 3.0);

fn seen(gpu: &Gpu, fixture: &Fixture, settings: Settings) -> [f32; 3] {
    middle(&shoot(gpu, fixture, [15, 9], towards_origin(EYE), settings))
}

/// Four by four texels, each with red and green of its own.
fn grid() -> Picture {
    let step = |index: u8| [index % 4 * 60, index / 4 * 60, 51, 255];
    Picture {
        format: TextureFormat::Rgba8Unorm,
        width: 4,
        texels: (0..16).map(step).collect(),
    }
}

/// Offset, rotation and scale of `KHR_texture_transform`: the angle is counter-clockwise where v points down.
type Parameters = ([f64; 2], f64, [f64; 2]);

/// The formula, in f64.
fn transformed([u, v]: [f64; 2], (offset, angle, scale): Parameters) -> [f64; 2] {
    let (u, v) = (u * scale[0], v * scale[1]);
    let (sine, cosine) = angle.sin_cos();
    [
        cosine * u + sine * v + offset[0],
        -sine * u + cosine * v + offset[1],
    ]
}

fn record((offset, angle, scale): Parameters) -> TextureTransform {
    let image = |uv| transformed(uv, ([0.0; 2], angle, scale)).map(|value| value as f32);
    let ([a, b], [c, d]) = (image([1.0, 0.0]), image([0.0, 1.0]));
    TextureTransform {
        matrix: [a, b, c, d],
        offset: offset.map(|value| value as f32),
        pad_24: 0,
        pad_28: 0,
    }
}

/// The texel of the grid under coordinates that wrap, as the shader sees it.
fn grid_texel(uv: [f64; 2]) -> [f32; 3] {
    let cell = uv.map(|value| value.rem_euclid(1.0) * 4.0);
    assert!(
        cell.iter().all(|at| (0.02..0.98).contains(&at.fract())),
        "{uv:?} is between texels"
    );
    let [column, row] = cell.map(|at| at.floor() as usize);
    let [r, g, b, _] = grid().texels[row * 4 + column];
    [r, g, b].map(|channel| f32::from(channel) / 255.0)
}

const UV0: [f64; 2] = [0.2, 0.35];
const UV1: [f64; 2] = [0.9, 0.6];

/// A square that shows one texel.
fn spot() -> Object {
    let mut square = quad(0, vec![Mat4::IDENTITY]);
    for vertex in &mut square.vertices {
        vertex.uv0 = UV0.map(|value| value as f32);
        vertex.uv1 = UV1.map(|value| value as f32);
    }
    square
}

const QUARTER_TURN: f64 = std::f64::consts::FRAC_PI_2;
const TRANSFORMS: [Parameters; 8] = [
    ([0.0; 2], 0.0, [1.0; 2]),
    ([0.25, 0.5], 0.0, [1.0; 2]),
    ([-0.5, -3.25], 0.0, [1.0; 2]),
    ([0.0; 2], QUARTER_TURN, [1.0; 2]),
    ([0.0; 2], -QUARTER_TURN, [1.0; 2]),
    ([0.0; 2], 0.0, [2.0, 0.5]),
    ([0.0; 2], 0.0, [-1.0, 3.0]),
    ([0.1, 0.7], 0.6, [1.5, -0.7]),
];

#[test]
fn transforms_find_the_texel_of_the_formula() {
    let Some(gpu) = device() else { return };
    for parameters in TRANSFORMS {
        for (reference, uv) in [(0, UV0), (TEXTURE_UV1, UV1)] {
            let fixture = Fixture {
                objects: vec![spot()],
                materials: vec![Material {
                    base_color_tex: reference,
                    ..unlit([1.0; 4])
                }],
                textures: vec![grid()],
                transforms: vec![record(parameters)],
                ..Fixture::default()
            };
            let expected = grid_texel(transformed(uv, parameters));
            assert_near(seen(&gpu, &fixture, plain()), expected, 1e-3);
        }
    }
}

#[test]
fn each_slot_has_its_own_transform() {
    let Some(gpu) = device() else { return };
    let (first, second) = (TRANSFORMS[1], TRANSFORMS[3]);
    let fixture = Fixture {
        objects: vec![spot()],
        materials: vec![Material {
            base_color_tex: 0,
            occlusion_tex: 1 | TEXTURE_UV1,
            ..unlit([1.0; 4])
        }],
        textures: vec![grid(), grid()],
        transforms: vec![record(first), record(second)],
        ..Fixture::default()
    };
    let base = grid_texel(transformed(UV0, first));
    assert_near(seen(&gpu, &fixture, plain()), base, 1e-3);
    let occlusion = Settings {
        debug_view: 7,
        ..plain()
    };
    let [red, ..] = grid_texel(transformed(UV1, second));
    assert_near(seen(&gpu, &fixture, occlusion), [red; 3], 1e-3);
}
