//! Ambient occlusion against closed forms, quadrature, and itself from frame to frame.

use std::f64::consts::{FRAC_PI_2, PI};

use cairn_format::gpu::Material;
use glam::{Mat4, Quat, Vec3};

use super::fixture::{Fixture, light, quad, sphere};
use super::screen::{Screen, Texel};
use super::{along, device, plain};
use crate::camera::{Camera, Projection};
use crate::gpu::Gpu;
use crate::scene::GpuScene;
use crate::settings::Settings;

const SIZE: [u32; 2] = [64, 64];

/// f64 twin of `hidden()` in `gtao.comp`, as what is visible: share, and bent normal along tangent and view.
fn visible(h1: f64, h2: f64, n: f64) -> [f64; 3] {
    let arc = |h: f64, n: f64| 0.25 * (n.cos() - (2.0 * h - n).cos() + 2.0 * h * n.sin());
    let tangent = (6.0 * (h1 - n).sin() - (3.0 * h1 - n).sin() - 6.0 * (h2 + n).sin()
        + (3.0 * h2 + n).sin()
        + 16.0 * n.sin()
        - 3.0 * (h1 + n).sin()
        + 3.0 * (h2 - n).sin())
        / 12.0;
    let along = (8.0 * n.cos()
        - (3.0 * h1 - n).cos()
        - (3.0 * h2 + n).cos()
        - 3.0 * ((h1 + n).cos() + (h2 - n).cos()))
        / 12.0;
    [arc(h1, n) + arc(h2, -n), tangent, along]
}

/// The same integrals by the midpoint rule.
fn quadrature(h1: f64, h2: f64, n: f64) -> [f64; 3] {
    const STEPS: usize = 20_000;
    let mut sum = [0.0; 3];
    let width = (h1 + h2) / STEPS as f64;
    for step in 0..STEPS {
        let angle = (step as f64 + 0.5) * width - h2;
        let weight = (angle - n).cos() * angle.sin().abs() * width;
        sum[0] += weight;
        sum[1] += weight * angle.sin();
        sum[2] += weight * angle.cos();
    }
    sum
}

#[test]
fn slice_integrals_equal_quadrature() {
    for n in [-1.3, -0.6, 0.0, 0.2, 0.9, 1.5] {
        for open in [0.1, 0.5, 1.0] {
            for other in [0.0, 0.3, 1.0] {
                let (h1, h2) = ((n + FRAC_PI_2) * open, (FRAC_PI_2 - n) * other);
                let (found, expected) = (visible(h1, h2, n), quadrature(h1, h2, n));
                for (a, b) in found.iter().zip(expected) {
                    assert!(
                        (a - b).abs() < 1e-6,
                        "{found:?} {expected:?} at {h1} {h2} {n}"
                    );
                }
            }
        }
    }
}

#[test]
fn an_open_slice_has_the_closed_form_that_the_shader_subtracts_from() {
    for n in [-1.5, -0.4, 0.0, 0.7, 1.5_f64] {
        let found = visible(n + FRAC_PI_2, FRAC_PI_2 - n, n);
        let expected = [
            n.cos() + n * n.sin(),
            4.0 / 3.0 * n.sin(),
            2.0 / 3.0 * n.cos(),
        ];
        for (a, b) in found.iter().zip(expected) {
            assert!((a - b).abs() < 1e-12, "{found:?} {expected:?}");
        }
    }
    // Over all azimuths the open hemisphere is 1 at every tilt: the shader's estimate of it needs no noise.
    for tilt in [0.0, 0.5, 1.2_f64] {
        let sum: f64 = (0..1000)
            .map(|i| {
                let phi = (f64::from(i) + 0.5) / 1000.0 * PI;
                let (t, v) = (tilt.sin() * phi.cos(), tilt.cos());
                let n = t.atan2(v);
                t.hypot(v) * (n.cos() + n * n.sin())
            })
            .sum();
        assert!((sum / 1000.0 - 1.0).abs() < 1e-9);
    }
}

fn ambient(radius: f32, directions: u32, steps: u32, temporal: f32) -> Settings {
    let mut settings = plain();
    settings.ao.enabled = true;
    settings.ao.radius = radius;
    settings.ao.directions = directions;
    settings.ao.steps = steps;
    settings.ao.temporal = temporal;
    settings.ao.thin_compensation = 0.0;
    settings
}

/// Draws the last frame of each sequence with one renderer.
fn run<T>(
    gpu: &Gpu,
    fixture: &Fixture,
    size: [u32; 2],
    settings: &Settings,
    body: impl FnOnce(&mut Screen<'_>) -> T,
) -> T {
    let package = fixture.package();
    let scene = GpuScene::upload(gpu, &package).expect("uploads");
    let mut screen = Screen::new(gpu, &scene, &package, size, settings);
    body(&mut screen)
}

fn closes(gpu: Gpu) {
    assert_eq!(gpu.close(), Vec::<String>::new());
}

fn objects(objects: Vec<super::fixture::Object>) -> Fixture {
    Fixture {
        objects,
        materials: vec![Material::default()],
        ..Fixture::default()
    }
}

/// Floor at y = 0 and, at z = 0, a wall that is `height` high; both reach far to the sides.
fn corner(height: f32) -> Fixture {
    let floor =
        Mat4::from_rotation_x(-std::f32::consts::FRAC_PI_2) * Mat4::from_scale(Vec3::splat(400.0));
    let wall = Mat4::from_translation(Vec3::Y * (height * 0.5))
        * Mat4::from_scale(Vec3::new(400.0, height * 0.5, 1.0));
    objects(vec![quad(0, vec![floor, wall])])
}

fn looking(eye: Vec3, target: Vec3) -> Camera {
    Camera::look_at(eye, target, Vec3::Y, 1.0).expect("apart")
}

/// World position on the plane y = 0 behind each pixel.
fn floor_points(camera: &Camera, size: [u32; 2]) -> Vec<Option<Vec3>> {
    let inverse = (camera.projection(size[0] as f32 / size[1] as f32) * camera.view()).inverse();
    let mut points = Vec::new();
    for y in 0..size[1] {
        for x in 0..size[0] {
            let ndc = |v: u32, n: u32| (v as f32 + 0.5) / n as f32 * 2.0 - 1.0;
            let at = inverse.project_point3(Vec3::new(ndc(x, size[0]), -ndc(y, size[1]), 0.5));
            let way = at - camera.position;
            let t = -camera.position.y / way.y;
            points.push((t > 0.0).then(|| camera.position + way * t));
        }
    }
    points
}

#[test]
fn an_open_plane_is_open_at_every_tilt_up_to_the_border() {
    let Some(gpu) = device() else { return };
    // One slice and one step are the noisiest there is.
    for (directions, steps) in [(1, 1), (4, 4)] {
        let settings = ambient(2.0, directions, steps, 0.0);
        let plane = |tilt: f32| {
            let turn = Quat::from_rotation_y(0.4) * Quat::from_rotation_x(-tilt);
            objects(vec![quad(
                0,
                vec![Mat4::from_scale_rotation_translation(
                    Vec3::splat(300.0),
                    turn,
                    Vec3::new(0.0, 0.0, -5.0),
                )],
            )])
        };
        for degrees in [0.0_f32, 30.0, 60.0, 80.0, 85.0] {
            let tilt = degrees.to_radians();
            let normal = Quat::from_rotation_y(0.4) * Quat::from_rotation_x(-tilt) * Vec3::Z;
            for projection in [
                Projection::Perspective { yfov: 1.6 },
                Projection::Orthographic { half_height: 3.0 },
            ] {
                let camera = Camera {
                    znear: 0.01,
                    zfar: 1000.0,
                    ..along(Vec3::NEG_Z, projection)
                };
                let texels = run(&gpu, &plane(tilt), SIZE, &settings, |screen| {
                    screen.frame(&camera, &settings)
                });
                assert!(texels.iter().any(|texel| !texel.sky));
                for texel in texels.iter() {
                    assert!((texel.visibility - 1.0).abs() < 0.01, "{degrees} {texel:?}");
                    // Ten bits a component, and twelve.
                    let angle = texel.bent.angle_between(normal).to_degrees();
                    assert!(texel.sky || angle < 1.0, "{degrees}: {angle} {texel:?}");
                }
            }
        }
    }
    closes(gpu);
}

#[test]
fn a_corner_is_as_dark_as_its_form_factor() {
    let Some(gpu) = device() else { return };
    // Full weight up to 0.385 radii: beyond everything that the wall can hide.
    let settings = ambient(200.0, 8, 24, 0.9);
    let camera = looking(Vec3::new(0.0, 3.0, 5.0), Vec3::new(0.0, 0.5, 0.0));
    let height = 1.0;
    let texels = run(&gpu, &corner(height), SIZE, &settings, |screen| {
        screen.settle(&camera, &settings, 16)
    });
    let (mut worst, mut sum, mut count, mut lean) = (0.0_f32, 0.0, 0, 0.0_f32);
    for (texel, point) in texels.iter().zip(floor_points(&camera, SIZE)) {
        // In the middle of the image, so that the wall's ends, and what lies outside, do not matter.
        let Some(point) = point.filter(|p| p.z > 0.08 && p.z < 1.5 && p.x.abs() < 0.7) else {
            continue;
        };
        let wall = (height / point.z).atan();
        let expected = 0.5 * (1.0 + wall.cos());
        let error = (texel.visibility - expected).abs();
        worst = worst.max(error);
        sum += error;
        count += 1;
        // Mean open direction of a wedge from the wall's top edge to the floor's horizon, about the wall's edge line.
        let (a, b) = (f64::from(wall), PI);
        let moment = |f: &dyn Fn(f64) -> f64| -> f64 {
            (0..2000)
                .map(|i| f(a + (f64::from(i) + 0.5) / 2000.0 * (b - a)) * (b - a) / 2000.0)
                .sum()
        };
        let up = moment(&|t| t.sin() * t.sin());
        let out = moment(&|t| -t.sin() * t.cos());
        let bent = Vec3::new(0.0, up as f32, out as f32).normalize();
        lean = lean.max(bent.angle_between(texel.bent).to_degrees());
    }
    let mean = sum / count as f32;
    println!(
        "corner: {count} pixels, mean error {mean}, worst {worst}, bent normal {lean} degrees"
    );
    assert!(count > 100 && mean < 0.02 && worst < 0.08 && lean < 10.0);
    closes(gpu);
}

#[test]
fn a_sphere_darkens_the_plane_that_it_lies_on() {
    let Some(gpu) = device() else { return };
    let settings = ambient(100.0, 8, 16, 0.9);
    let floor =
        Mat4::from_rotation_x(-std::f32::consts::FRAC_PI_2) * Mat4::from_scale(Vec3::splat(400.0));
    let ball = Mat4::from_translation(Vec3::Y);
    let fixture = objects(vec![quad(0, vec![floor]), sphere(0, vec![ball])]);
    let camera = looking(Vec3::new(0.0, 6.0, 6.0), Vec3::ZERO);
    let texels = run(&gpu, &fixture, SIZE, &settings, |screen| {
        screen.settle(&camera, &settings, 16)
    });
    let (mut sum, mut count, mut bias) = (0.0_f32, 0, 0.0_f32);
    for (texel, point) in texels.iter().zip(floor_points(&camera, SIZE)) {
        // In front of the sphere, where the image shows its occluding half.
        let Some(point) = point.filter(|p| p.z > 1.2 && p.z < 3.0 && p.x.abs() < 0.5) else {
            continue;
        };
        let expected = 1.0 - (point.length_squared() + 1.0).powf(-1.5);
        sum += (texel.visibility - expected).abs();
        bias += texel.visibility - expected;
        count += 1;
    }
    let (mean, bias) = (sum / count as f32, bias / count as f32);
    println!("sphere: {count} pixels, mean error {mean}, bias {bias}");
    // A depth image fills the gap under the sphere: darker, never brighter.
    assert!(count > 50 && mean < 0.08 && bias < 0.01);
    closes(gpu);
}

fn room() -> Fixture {
    let mut fixture = corner(2.0);
    let ball = |x: f32| {
        Mat4::from_translation(Vec3::new(x, 0.4, 0.6)) * Mat4::from_scale(Vec3::splat(0.4))
    };
    fixture
        .objects
        .push(sphere(0, vec![ball(-1.0), ball(0.2), ball(1.3)]));
    fixture
}

fn difference(a: &[Texel], b: &[Texel]) -> (f32, f32) {
    let errors = a
        .iter()
        .zip(b)
        .map(|(a, b)| (a.visibility - b.visibility).abs());
    let (mut sum, mut worst) = (0.0, 0.0_f32);
    for error in errors {
        sum += error;
        worst = worst.max(error);
    }
    (sum / a.len() as f32, worst)
}

#[test]
fn history_converges_to_half_a_level_after_a_step() {
    let Some(gpu) = device() else { return };
    let size = [32, 32];
    let camera = looking(Vec3::new(0.0, 2.0, 4.0), Vec3::new(0.0, 0.4, 0.0));
    let flat = |intensity: f32| {
        let mut settings = ambient(1.0, 2, 2, 0.98);
        settings.ao.intensity = intensity;
        settings
    };
    // An exponent of 0 makes everything 1: the exact target of the history.
    let (dark, open) = (flat(2.0), flat(0.0));
    run(&gpu, &room(), size, &dark, |screen| {
        let before = screen.settle(&camera, &dark, 4);
        assert!(before.iter().any(|texel| texel.visibility < 0.7));
        let after = screen.settle(&camera, &open, 300);
        assert!(
            after
                .iter()
                .all(|texel| texel.visibility > 1.0 - 0.5 / 255.0)
        );
    });
    closes(gpu);
}

#[test]
fn a_moving_camera_sees_what_a_resting_one_sees() {
    let Some(gpu) = device() else { return };
    let settings = ambient(1.0, 2, 3, 0.9);
    let at = |step: u32| {
        let x = step as f32 * 0.05 - 0.8;
        looking(Vec3::new(x, 1.5, 4.0), Vec3::new(x * 1.3, 0.4, 0.0))
    };
    run(&gpu, &room(), SIZE, &settings, |screen| {
        let mut moving = Vec::new();
        for step in 0..24 {
            moving = screen.frame(&at(step), &settings);
        }
        // No history at all, and all of it.
        let reused = moving.iter().filter(|texel| texel.frames > 2).count();
        let seen = moving.iter().filter(|texel| !texel.sky).count();
        let resting = screen.settle(&at(23), &settings, 64);
        let (mean, worst) = difference(&moving, &resting);
        let stray = moving
            .iter()
            .zip(&resting)
            .map(|(a, b)| a.bent.angle_between(b.bent).to_degrees())
            .sum::<f32>()
            / moving.len() as f32;
        println!(
            "moving: mean {mean}, worst {worst}, bent {stray} degrees, {reused} of {seen} reused"
        );
        assert!(mean < 0.02 && worst < 0.3 && stray < 4.0);
        assert!(reused * 10 > seen * 8);
    });
    closes(gpu);
}

#[test]
fn what_was_not_in_view_has_no_history() {
    let Some(gpu) = device() else { return };
    let settings = ambient(1.0, 2, 2, 0.9);
    let camera = looking(Vec3::new(0.0, 1.5, 4.0), Vec3::new(0.0, 0.4, 0.0));
    let back = looking(Vec3::new(0.0, 1.5, 4.0), Vec3::new(0.0, 0.4, 8.0));
    run(&gpu, &room(), SIZE, &settings, |screen| {
        let settled = screen.settle(&camera, &settings, 5);
        assert!(settled.iter().all(|texel| texel.sky || texel.frames == 4));
        let turned = screen.frame(&back, &settings);
        assert!(turned.iter().any(|texel| !texel.sky));
        assert!(turned.iter().all(|texel| texel.frames == 0));
        // The balls stood in front of most of the wall: from close above, what they hid is new.
        screen.settle(&camera, &settings, 5);
        let closer = looking(Vec3::new(2.5, 1.5, 3.0), Vec3::new(0.0, 0.4, 0.0));
        let moved = screen.frame(&closer, &settings);
        let fresh = moved
            .iter()
            .filter(|texel| !texel.sky && texel.frames == 0)
            .count();
        assert!(fresh > 20, "{fresh}");
    });
    closes(gpu);
}

/// Frames without ambient occlusion write no history: what came before them does not count after them.
#[test]
fn frames_without_occlusion_end_the_history() {
    let Some(gpu) = device() else { return };
    let settings = ambient(1.0, 2, 2, 0.9);
    let mut off = settings.clone();
    off.ao.enabled = false;
    let camera = looking(Vec3::new(0.0, 1.5, 4.0), Vec3::new(0.0, 0.4, 0.0));
    run(&gpu, &room(), SIZE, &settings, |screen| {
        let settled = screen.settle(&camera, &settings, 5);
        assert!(settled.iter().all(|texel| texel.sky || texel.frames == 4));
        for _ in 0..3 {
            screen.draw(&camera, &off);
        }
        let again = screen.frame(&camera, &settings);
        assert!(again.iter().any(|texel| !texel.sky));
        assert!(again.iter().all(|texel| texel.frames == 0));
    });
    closes(gpu);
}

#[test]
fn without_history_nothing_crawls_and_the_sky_is_open() {
    let Some(gpu) = device() else { return };
    let settings = ambient(1.0, 2, 2, 0.0);
    let camera = looking(Vec3::new(0.0, 1.0, 4.0), Vec3::new(0.0, 2.0, 0.0));
    run(&gpu, &room(), SIZE, &settings, |screen| {
        let first = screen.frame(&camera, &settings);
        assert_eq!(first, screen.settle(&camera, &settings, 3));
        assert!(first.iter().any(|texel| texel.sky));
        assert!(
            first
                .iter()
                .all(|texel| !texel.sky || texel.visibility == 1.0)
        );
        assert!(first.iter().any(|texel| texel.visibility < 0.8));
    });
    closes(gpu);
}

#[test]
fn what_is_off_is_not_there() {
    let Some(gpu) = device() else { return };
    let lit = Fixture {
        lights: vec![light(Vec3::NEG_Y, [1.0; 3], 1.0)],
        ..room()
    };
    for (fixture, ao, contact, expected) in [
        (&lit, false, false, [false; 4]),
        (&lit, true, true, [true; 4]),
        (&room(), true, true, [true, true, true, false]),
        (&lit, false, true, [false, false, false, true]),
    ] {
        let mut settings = plain();
        settings.ao.enabled = ao;
        settings.contact.enabled = contact;
        settings.light.source = crate::settings::LightSource::Scene;
        run(&gpu, fixture, [8, 8], &settings, |screen| {
            let passes = &screen.renderer.passes;
            let found = [
                &passes.gtao,
                &passes.ao_spatial,
                &passes.ao_temporal,
                &passes.contact,
            ];
            assert_eq!(found.map(Option::is_some), expected);
        });
    }
    closes(gpu);
}
