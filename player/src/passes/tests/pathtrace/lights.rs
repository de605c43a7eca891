//! Lights: what is sampled agrees with what paths meet, and both with theory.

use cairn_format::TextureFormat;
use cairn_format::gpu::{ALPHA_BLEND, ALPHA_MASK, MATERIAL_DOUBLE_SIDED, Material};
use glam::{DVec3, Mat4, Vec3};

use super::super::fixture::{Fixture, light, quad, row};
use super::super::{device, towards_origin};
use super::{assert_close, mean, rough_black_core, samples, trace, traced, wide};
use crate::headless::trace::TraceOptions;
use crate::settings::{Brdf, Settings};

/// Direct light alone.
pub(super) fn core() -> Settings {
    let mut settings = Settings {
        brdf: Brdf::GltfCore,
        ..traced()
    };
    settings.path.bounces = 0;
    settings
}

fn lamp(radiance: f32) -> Material {
    Material {
        base_color_factor: [0.0, 0.0, 0.0, 1.0],
        emissive_factor: [radiance, radiance, radiance, 0.0],
        metallic_factor: 0.0,
        ..Material::default()
    }
}

/// A floor in the XY plane and a square lamp of half-extent 0.5 above it, facing it.
pub(super) fn lit_floor(mirrored: bool) -> Fixture {
    let down = Mat4::from_rotation_x(std::f32::consts::PI);
    let flip = if mirrored {
        Mat4::from_scale(Vec3::new(-1.0, 1.0, 1.0))
    } else {
        Mat4::IDENTITY
    };
    let place = Mat4::from_translation(Vec3::new(0.0, 0.0, 1.5));
    let lamp_model = place * down * flip * Mat4::from_scale(Vec3::splat(0.5));
    Fixture {
        objects: vec![wide(0, 10.0), quad(1, vec![lamp_model])],
        materials: vec![rough_black_core(), lamp(5.0)],
        environment: Some([[0.0; 3]; 6]),
        lut: true,
        ..Fixture::default()
    }
}

/// Radiance at the origin towards `view`, by quadrature over the lamp.
pub(super) fn floor_radiance(view: Vec3) -> f64 {
    lamp_radiance(view, &|_| 5.0)
}

/// The same of a lamp whose radiance differs along X.
fn lamp_radiance(view: Vec3, radiance: &dyn Fn(f64) -> f64) -> f64 {
    const CELLS: u32 = 64;
    let mut sum = 0.0;
    for cell in 0..CELLS * CELLS {
        let at = |index: u32| (f64::from(index) + 0.5) / f64::from(CELLS) - 0.5;
        let to_light = DVec3::new(at(cell % CELLS), at(cell / CELLS), 1.5);
        let distance2 = to_light.length_squared();
        let l = to_light.normalize();
        let shading = super::super::twin::Shading {
            normal: DVec3::Z,
            view: view.as_dvec3(),
            light: l,
            base: DVec3::splat(0.6),
            metallic: 0.0,
            roughness: 1.0,
            lobes: Default::default(),
        };
        sum += shading.reflected(false).x * radiance(to_light.x) * l.z / distance2;
    }
    sum / f64::from(CELLS * CELLS)
}

/// A few pixels around the origin, from the side.
pub(super) fn glance() -> (crate::camera::Camera, Vec3) {
    let eye = Vec3::new(1.6, 0.0, 0.6);
    let mut camera = towards_origin(eye);
    camera.projection = crate::camera::Projection::Perspective { yfov: 0.02 };
    (camera, eye.normalize())
}

#[test]
fn an_area_light_by_sampling_by_chance_and_by_both() {
    let Some(gpu) = device() else { return };
    let (camera, view) = glance();
    let expected = floor_radiance(view);
    for mirrored in [false, true] {
        let fixture = lit_floor(mirrored);
        let sampled_only = TraceOptions {
            sampled_only: true,
            ..samples(256)
        };
        let mut by_chance = core();
        by_chance.path.sample_emitters = false;
        for (settings, limits, tolerance) in [
            (core(), samples(256), 0.004),
            (core(), sampled_only, 0.004),
            (by_chance, samples(2048), 0.02),
        ] {
            let image = trace(&gpu, &fixture, [6, 6], camera, settings, &limits);
            assert_close(mean(&image, 0), expected, tolerance);
        }
    }
    assert_eq!(gpu.close(), Vec::<String>::new());
}

/// A lamp that shines in one half of its texture alone, and there twice as bright: what is drawn by the lamp's power, what
/// is met by chance, and both together agree with the quadrature.
#[test]
fn a_textured_lamp_by_sampling_by_chance_and_by_both() {
    let Some(gpu) = device() else { return };
    let (camera, view) = glance();
    let mut fixture = lit_floor(false);
    fixture.materials[1].emissive_tex = 0;
    let texels = vec![[255; 4], [0, 0, 0, 255]];
    fixture.textures = vec![row(TextureFormat::Rgba8Unorm, texels)];
    for vertex in &mut fixture.objects[1].vertices {
        vertex.uv0 = [vertex.position[0] * 0.5 + 0.5, 0.5];
    }
    let expected = lamp_radiance(view, &|x| if x < 0.0 { 5.0 } else { 0.0 });
    let sampled_only = TraceOptions {
        sampled_only: true,
        ..samples(1024)
    };
    let mut by_chance = core();
    by_chance.path.sample_emitters = false;
    for (settings, limits, tolerance) in [
        (core(), samples(1024), 0.006),
        (core(), sampled_only, 0.006),
        (by_chance, samples(1024), 0.04),
    ] {
        let image = trace(&gpu, &fixture, [6, 6], camera, settings, &limits);
        assert_close(mean(&image, 0), expected, tolerance);
    }
    assert_eq!(gpu.close(), Vec::<String>::new());
}

/// A single-sided lamp sends nothing backwards; a wall's back hides what is behind it from every ray but the camera's.
#[test]
fn sides_count() {
    let Some(gpu) = device() else { return };
    let (camera, _) = glance();
    let mut fixture = lit_floor(false);
    let up = Mat4::from_translation(Vec3::new(0.0, 0.0, 1.5)) * Mat4::from_scale(Vec3::splat(0.5));
    fixture.objects[1].models = vec![up];
    let image = trace(&gpu, &fixture, [4, 4], camera, core(), &samples(16));
    assert_eq!(mean(&image, 0), 0.0);
    fixture.materials[1].double_sided = MATERIAL_DOUBLE_SIDED;
    let image = trace(&gpu, &fixture, [4, 4], camera, core(), &samples(256));
    assert_close(mean(&image, 0), floor_radiance(glance().1), 0.01);

    // From behind, the lamp shows through a single-sided wall.
    let wall = Fixture {
        objects: vec![
            quad(0, vec![Mat4::from_scale(Vec3::splat(9.0))]),
            quad(
                1,
                vec![
                    Mat4::from_translation(Vec3::Z * 2.0)
                        * Mat4::from_rotation_x(std::f32::consts::PI)
                        * Mat4::from_scale(Vec3::splat(50.0)),
                ],
            ),
        ],
        ..lit_floor(false)
    };
    let behind = towards_origin(Vec3::new(0.0, 0.1, -3.0));
    let image = trace(&gpu, &wall, [4, 4], behind, core(), &samples(4));
    assert_close(mean(&image, 0), 5.0, 1e-5);
    // Or not, where backs are walls.
    let mut walls = core();
    walls.path.see_through = false;
    let image = trace(&gpu, &wall, [4, 4], behind, walls, &samples(4));
    assert_eq!(mean(&image, 0), 0.0);
    assert_eq!(gpu.close(), Vec::<String>::new());
}

/// A directional light on a diffuse plane.
#[test]
fn a_directional_light_has_its_cosine() {
    let Some(gpu) = device() else { return };
    let direction = Vec3::new(0.3, -0.2, -1.0).normalize();
    let fixture = Fixture {
        objects: vec![wide(0, 10.0)],
        materials: vec![rough_black_core()],
        lights: vec![light(direction, [1.0, 0.5, 0.25], 3.0)],
        environment: Some([[0.0; 3]; 6]),
        lut: true,
        ..Fixture::default()
    };
    let (camera, view) = glance();
    let image = trace(&gpu, &fixture, [4, 4], camera, core(), &samples(8));
    let shading = super::super::twin::Shading {
        normal: DVec3::Z,
        view: view.as_dvec3(),
        light: -direction.as_dvec3(),
        base: DVec3::splat(0.6),
        metallic: 0.0,
        roughness: 1.0,
        lobes: Default::default(),
    };
    let expected = shading.reflected(false).x * 3.0;
    assert_close(mean(&image, 0), expected, 0.002);
    assert_close(mean(&image, 1), expected * 0.5, 0.002);
    assert_eq!(gpu.close(), Vec::<String>::new());
}

/// Layers of alpha 0.5 over white light: each halves what passes, for the camera and for shadows alike.
#[test]
fn stacked_layers_multiply() {
    let Some(gpu) = device() else { return };
    let blend = Material {
        base_color_factor: [0.0, 0.0, 0.0, 0.5],
        alpha_mode: ALPHA_BLEND,
        double_sided: MATERIAL_DOUBLE_SIDED,
        metallic_factor: 1.0,
        ..Material::default()
    };
    let layer = |z: f32| Mat4::from_translation(Vec3::Z * z) * Mat4::from_scale(Vec3::splat(50.0));
    let fixture = Fixture {
        objects: vec![quad(0, vec![layer(0.0), layer(0.3), layer(0.6)])],
        materials: vec![blend],
        environment: Some([[1.0; 3]; 6]),
        lut: true,
        ..Fixture::default()
    };
    // Black metal with F0 = 0 reflects at grazing angles alone, and the view is head on.
    let camera = towards_origin(Vec3::new(0.0, 0.0, 3.0));
    let image = trace(&gpu, &fixture, [24, 24], camera, core(), &samples(128));
    assert_close(mean(&image, 0), 0.125, 0.04);
    assert_eq!(gpu.close(), Vec::<String>::new());
}

/// A mask's holes let everything pass, its rest nothing: alpha exactly at the cutoff is solid.
#[test]
fn masks_cut_at_their_cutoff() {
    let Some(gpu) = device() else { return };
    for (alpha, open) in [(127u8, true), (128, false)] {
        let mask = Material {
            base_color_factor: [0.0, 0.0, 0.0, 1.0],
            base_color_tex: 0,
            alpha_mode: ALPHA_MASK,
            alpha_cutoff: 128.0 / 255.0,
            metallic_factor: 1.0,
            ..Material::default()
        };
        let fixture = Fixture {
            objects: vec![wide(0, 50.0)],
            materials: vec![mask],
            textures: vec![row(TextureFormat::Rgba8Unorm, vec![[0, 0, 0, alpha]])],
            environment: Some([[1.0; 3]; 6]),
            lut: true,
            ..Fixture::default()
        };
        let camera = towards_origin(Vec3::new(0.0, 0.0, 3.0));
        let image = trace(&gpu, &fixture, [8, 8], camera, core(), &samples(16));
        assert_eq!(mean(&image, 0) > 0.9, open, "alpha {alpha}");
    }
    assert_eq!(gpu.close(), Vec::<String>::new());
}
