//! Contact shadows: nothing shadows itself, what stands on a surface shadows it, and nothing crawls.

use cairn_format::gpu::Material;
use glam::{Mat4, Vec3};

use super::fixture::{Fixture, light, quad, sphere};
use super::{device, options, plain, shoot, texel};
use crate::camera::Camera;
use crate::headless::render_on;
use crate::settings::Settings;

const SIZE: [u32; 2] = [96, 96];

fn settings() -> Settings {
    let mut settings = plain();
    settings.contact.enabled = true;
    settings.contact.distance = 2.0;
    settings.contact.thickness = 1.0;
    settings.debug_view = 10;
    settings
}

fn floor(direction: Vec3) -> Fixture {
    let flat =
        Mat4::from_rotation_x(-std::f32::consts::FRAC_PI_2) * Mat4::from_scale(Vec3::splat(50.0));
    Fixture {
        objects: vec![quad(0, vec![flat])],
        materials: vec![Material::default()],
        lights: vec![light(direction, [1.0; 3], 1.0)],
        ..Fixture::default()
    }
}

fn camera(eye: Vec3) -> Camera {
    Camera::look_at(eye, Vec3::ZERO, Vec3::Y, 1.0).expect("apart")
}

#[test]
fn a_plane_does_not_shadow_itself_at_any_tilt() {
    let Some(gpu) = device() else { return };
    for eye in [
        Vec3::new(0.0, 4.0, 0.1),
        Vec3::new(0.0, 1.0, 4.0),
        Vec3::new(3.0, 0.1, 1.0),
    ] {
        for direction in [
            Vec3::new(0.2, -1.0, 0.1),
            Vec3::new(1.0, -0.05, 0.3),
            Vec3::new(-0.2, -0.1, -1.0),
        ] {
            let image = shoot(&gpu, &floor(direction), SIZE, camera(eye), settings());
            for y in 48..SIZE[1] {
                for x in 0..SIZE[0] {
                    assert_eq!(texel(&image, x, y), [1.0; 3], "{x} {y} {eye} {direction}");
                }
            }
        }
    }
    assert_eq!(gpu.close(), Vec::<String>::new());
}

#[test]
fn a_ball_shadows_the_floor_beside_it() {
    let Some(gpu) = device() else { return };
    let mut fixture = floor(Vec3::new(1.0, -1.0, 0.0));
    let ball = Mat4::from_translation(Vec3::Y * 0.5) * Mat4::from_scale(Vec3::splat(0.5));
    fixture.objects.push(sphere(0, vec![ball]));
    let camera = camera(Vec3::new(0.0, 3.0, 3.0));
    let project = |point: Vec3| {
        let ndc = (camera.projection(1.0) * camera.view()).project_point3(point);
        let at = |v: f32, n: u32| ((v * 0.5 + 0.5) * n as f32) as u32;
        (at(ndc.x, SIZE[0]), at(-ndc.y, SIZE[1]))
    };
    let image = shoot(&gpu, &fixture, SIZE, camera, settings());
    let at = |point: Vec3| {
        let (x, y) = project(point);
        texel(&image, x, y)[0]
    };
    assert!(at(Vec3::new(0.62, 0.0, 0.0)) < 0.1);
    assert!(at(Vec3::new(0.9, 0.0, 0.0)) < 0.5);
    assert_eq!(at(Vec3::new(-0.8, 0.0, 0.0)), 1.0);
    assert_eq!(at(Vec3::new(1.0, 0.0, 1.2)), 1.0);
    // However many frames were drawn: the noise stands still.
    let mut later = options(SIZE, camera, settings());
    later.frames += 1;
    let later = render_on(&gpu, &fixture.package(), &later).expect("renders");
    assert_eq!(image.hdr, later.hdr);
    // A ray that is shorter than a pixel meets nothing.
    let mut short = settings();
    short.contact.distance = 1e-4;
    let image = shoot(&gpu, &fixture, SIZE, camera, short);
    let (x, y) = project(Vec3::new(0.62, 0.0, 0.0));
    assert_eq!(texel(&image, x, y), [1.0; 3]);
    assert_eq!(gpu.close(), Vec::<String>::new());
}

#[test]
fn without_lights_the_mask_is_neutral() {
    let Some(gpu) = device() else { return };
    let fixture = Fixture {
        lights: Vec::new(),
        ..floor(Vec3::NEG_Y)
    };
    let mut settings = settings();
    settings.light.source = crate::settings::LightSource::Scene;
    let image = shoot(
        &gpu,
        &fixture,
        SIZE,
        camera(Vec3::new(0.0, 4.0, 0.1)),
        settings,
    );
    assert_eq!(texel(&image, 48, 48), [1.0; 3]);
    assert_eq!(gpu.close(), Vec::<String>::new());
}
