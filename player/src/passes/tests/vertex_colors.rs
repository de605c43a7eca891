//! Vertex colours multiply base colour and alpha.

use cairn_format::gpu::{ALPHA_BLEND, ALPHA_MASK, Material};
use glam::{Mat4, Vec3};

use super::fixture::{Fixture, Object, colored, light, quad, sphere, unlit};
use super::{assert_near, device, middle, plain, shoot, texel, towards_origin};
use crate::gpu::Gpu;

const EYE: Vec3 = Vec3::new(0.0, 0.0, 3.0);
const SIZE: [u32; 2] = [31, 15];

fn at(z: f32) -> Vec<Mat4> {
    vec![Mat4::from_translation(Vec3::new(0.0, 0.0, z))]
}

/// Colours `left` at x = -1 and `right` at x = 1.
fn graded(object: Object, left: [f32; 4], right: [f32; 4]) -> Object {
    let side = |x: f32| if x < 0.0 { left } else { right };
    Object {
        colors: object
            .vertices
            .iter()
            .map(|vertex| side(vertex.position[0]))
            .collect(),
        ..object
    }
}

/// World x in the plane z = 0 of each pixel of a row.
fn world_x(column: u32) -> f32 {
    let [width, height] = SIZE.map(|side| side as f32);
    (column as f32 + 0.5 - width / 2.0) / (height / 2.0) * EYE.z * 0.5_f32.tan()
}

fn seen(gpu: &Gpu, fixture: &Fixture) -> [f32; 3] {
    middle(&shoot(gpu, fixture, SIZE, towards_origin(EYE), plain()))
}

#[test]
fn vertex_colors_multiply_an_unlit_color() {
    let Some(gpu) = device() else { return };
    let fixture = Fixture {
        // The plain object comes first, so that the coloured one has a vertex offset.
        objects: vec![
            quad(0, at(-1.0)),
            colored(quad(1, at(0.0)), [0.5, 0.25, 0.75, 1.0]),
        ],
        materials: vec![unlit([0.9, 0.8, 0.7, 1.0]), unlit([0.8, 1.0, 0.5, 1.0])],
        ..Fixture::default()
    };
    assert_near(seen(&gpu, &fixture), [0.4, 0.25, 0.375], 1e-3);
    let behind = Fixture {
        objects: vec![quad(0, at(0.0)), colored(quad(1, at(-1.0)), [0.5; 4])],
        ..fixture
    };
    assert_near(seen(&gpu, &behind), [0.9, 0.8, 0.7], 1e-3);
}

#[test]
fn a_colored_sphere_is_lit_as_one_of_that_factor() {
    let Some(gpu) = device() else { return };
    let (factor, color) = ([0.9, 0.6, 0.8, 1.0], [0.5, 0.75, 0.25, 1.0]);
    let fixture = |object: Object, base_color_factor: [f32; 4]| Fixture {
        objects: vec![object],
        materials: vec![Material {
            base_color_factor,
            metallic_factor: 0.5,
            roughness_factor: 0.4,
            ..Material::default()
        }],
        lights: vec![light(Vec3::new(0.3, -1.0, -0.5), [1.0; 3], 2.0)],
        ..Fixture::default()
    };
    let camera = || towards_origin(EYE);
    let product = std::array::from_fn(|channel| factor[channel] * color[channel]);
    let expected = fixture(sphere(0, at(0.0)), product);
    let found = fixture(colored(sphere(0, at(0.0)), color), factor);
    let expected = shoot(&gpu, &expected, SIZE, camera(), plain());
    let found = shoot(&gpu, &found, SIZE, camera(), plain());
    assert!(middle(&expected)[1] > 0.05);
    for (x, y) in (0..SIZE[0] * SIZE[1]).map(|index| (index % SIZE[0], index / SIZE[0])) {
        assert_near(texel(&found, x, y), texel(&expected, x, y), 2e-3);
    }
}

#[test]
fn vertex_colors_interpolate_linearly() {
    let Some(gpu) = device() else { return };
    let (left, right) = ([0.0, 1.0, 0.25, 1.0], [1.0, 0.0, 0.5, 1.0]);
    let fixture = Fixture {
        objects: vec![graded(quad(0, at(0.0)), left, right)],
        materials: vec![unlit([1.0; 4])],
        ..Fixture::default()
    };
    let image = shoot(&gpu, &fixture, SIZE, towards_origin(EYE), plain());
    let mut inside = 0;
    for column in 0..SIZE[0] {
        let x = world_x(column);
        if x.abs() < 0.95 {
            let share = (x + 1.0) / 2.0;
            let mixed = |channel| left[channel] * (1.0 - share) + right[channel] * share;
            let expected = std::array::from_fn(mixed);
            assert_near(texel(&image, column, SIZE[1] / 2), expected, 1e-3);
            inside += 1;
        }
    }
    assert!(inside >= 7, "{inside} pixels");
}

#[test]
fn vertex_alpha_is_cut_by_the_mask() {
    let Some(gpu) = device() else { return };
    let clear = |alpha: f32| [1.0, 1.0, 1.0, alpha];
    let fixture = Fixture {
        objects: vec![graded(quad(0, at(0.0)), clear(0.0), clear(1.0))],
        materials: vec![Material {
            alpha_mode: ALPHA_MASK,
            alpha_cutoff: 0.3,
            ..unlit([0.5, 0.75, 1.0, 0.6])
        }],
        ..Fixture::default()
    };
    let image = shoot(&gpu, &fixture, SIZE, towards_origin(EYE), plain());
    // 0.6 of the vertex's alpha reaches 0.3 in the middle.
    for column in 0..SIZE[0] {
        let x = world_x(column);
        if x.abs() > 0.02 && (x.abs() - 1.0).abs() > 0.02 {
            let kept = x > 0.0 && x < 1.0;
            let expected = if kept { [0.5, 0.75, 1.0] } else { [0.0; 3] };
            assert_near(texel(&image, column, SIZE[1] / 2), expected, 1e-3);
        }
    }
}

#[test]
fn vertex_alpha_blends() {
    let Some(gpu) = device() else { return };
    let fixture = Fixture {
        objects: vec![
            quad(0, at(-0.5)),
            colored(quad(1, at(0.0)), [0.5, 1.0, 1.0, 0.5]),
        ],
        materials: vec![
            unlit([1.0; 4]),
            Material {
                alpha_mode: ALPHA_BLEND,
                ..unlit([1.0, 0.5, 0.0, 0.5])
            },
        ],
        ..Fixture::default()
    };
    // 0.25 of (0.5, 0.5, 0) over white.
    assert_near(seen(&gpu, &fixture), [0.875, 0.875, 0.75], 1e-3);
}
