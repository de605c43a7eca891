//! The path tracer against theory: what is known of an image in closed form or by quadrature.

mod analytic;
mod denoise;
mod faults;
mod lights;
mod planes;
mod robustness;
mod sampling;

use cairn_format::gpu::Material;
use glam::{Mat4, Vec3};

use super::fixture::{Fixture, Object, colored, quad, sphere, unlit};
use super::{device, options, plain, towards_origin};
use crate::camera::Camera;
use crate::gpu::Gpu;
use crate::headless::HeadlessImage;
use crate::headless::trace::{TraceOptions, trace_on};
use crate::settings::{Brdf, Mode, Settings};

fn traced() -> Settings {
    Settings {
        mode: Mode::PathTrace,
        ..plain()
    }
}

fn trace(
    gpu: &Gpu,
    fixture: &Fixture,
    size: [u32; 2],
    camera: Camera,
    settings: Settings,
    limits: &TraceOptions,
) -> HeadlessImage {
    let image = trace_on(
        gpu,
        &fixture.package(),
        &options(size, camera, settings),
        limits,
    );
    let image = image.expect("traces");
    assert_eq!(image.validation, Vec::<String>::new());
    assert_eq!(image.non_finite(), Some(0));
    let stats = image.trace.as_ref().expect("traced");
    assert_eq!(stats.counters.non_finite, 0);
    image
}

fn samples(samples: u32) -> TraceOptions {
    TraceOptions {
        samples: Some(samples),
        ..TraceOptions::default()
    }
}

/// Mean of an image's channel.
fn mean(image: &HeadlessImage, channel: usize) -> f64 {
    let hdr = image.hdr.as_ref().expect("read back");
    let sum: f64 = hdr.iter().map(|texel| f64::from(texel[channel])).sum();
    sum / hdr.len() as f64
}

#[track_caller]
fn assert_close(found: f64, expected: f64, relative: f64) {
    assert!(
        (found - expected).abs() <= expected.abs() * relative,
        "found {found}, expected {expected} +- {:.3} %",
        relative * 100.0
    );
}

fn white(metallic: f32, roughness: f32) -> Material {
    Material {
        metallic_factor: metallic,
        roughness_factor: roughness,
        ..Material::default()
    }
}

/// A square of half-extent `half` whose normal is turned from +Z by `turn`.
fn wide(material: u32, half: f32) -> Object {
    quad(material, vec![Mat4::from_scale(Vec3::splat(half))])
}

/// Looking at the origin in the XZ plane, `degrees` from +Z.
fn at_angle(degrees: f32) -> Camera {
    let angle = degrees.to_radians();
    towards_origin(Vec3::new(angle.sin(), 0.0, angle.cos()) * 4.0)
}

#[test]
fn a_white_furnace_closes() {
    let Some(gpu) = device() else { return };
    for metallic in [0.0, 0.5, 1.0] {
        for roughness in [0.0, 0.4, 0.95] {
            let fixture = Fixture {
                objects: vec![wide(0, 1e3)],
                materials: vec![white(metallic, roughness)],
                environment: Some([[1.0; 3]; 6]),
                lut: true,
                ..Fixture::default()
            };
            let image = trace(
                &gpu,
                &fixture,
                [8, 8],
                at_angle(50.0),
                traced(),
                &samples(512),
            );
            assert_close(mean(&image, 0), 1.0, 0.003);
        }
    }
    assert_eq!(gpu.close(), Vec::<String>::new());
}

/// L = 1 + y: a diffuse plane with the normal `n` reflects albedo times 1 + 2/3 n.y.
#[test]
fn a_gradient_sky_lights_by_its_integral() {
    let Some(gpu) = device() else { return };
    let settings = Settings {
        brdf: Brdf::GltfCore,
        ..traced()
    };
    for degrees in [40.0, 180.0] {
        let turn = Mat4::from_rotation_x(f32::to_radians(-degrees));
        let normal = turn.transform_vector3(Vec3::Z);
        let fixture = Fixture {
            objects: vec![quad(0, vec![turn * Mat4::from_scale(Vec3::splat(1e3))])],
            materials: vec![rough_black_core()],
            environment: Some([[1.0; 3]; 6]),
            gradient: Some(|d| [1.0 + d.y; 3]),
            lut: true,
            ..Fixture::default()
        };
        let eye = normal * 3.0 + turn.transform_vector3(Vec3::X) * 0.1;
        let mut camera = towards_origin(eye);
        camera.znear = 0.01;
        let image = trace(
            &gpu,
            &fixture,
            [16, 16],
            camera,
            settings.clone(),
            &samples(256),
        );
        let expected = diffuse_and_rim(&|d| 1.0 + d.y, normal, eye.normalize());
        assert_close(mean(&image, 0), expected, 0.004);
    }
    assert_eq!(gpu.close(), Vec::<String>::new());
}

/// Dielectric of base colour 0.6 at roughness 1.
fn rough_black_core() -> Material {
    Material {
        base_color_factor: [0.6, 0.6, 0.6, 1.0],
        ..white(0.0, 1.0)
    }
}

/// Radiance of [`rough_black_core`] towards `view` under a sky, by quadrature of the twin BRDF.
fn diffuse_and_rim(sky: &dyn Fn(glam::DVec3) -> f64, normal: Vec3, view: Vec3) -> f64 {
    let (normal, view) = (normal.as_dvec3(), view.as_dvec3());
    let side = normal.any_orthonormal_vector();
    let up = normal.cross(side);
    const RINGS: u32 = 96;
    const SPOKES: u32 = 192;
    let mut sum = 0.0;
    for ring in 0..RINGS {
        let cosine = (f64::from(ring) + 0.5) / f64::from(RINGS);
        let sine = (1.0 - cosine * cosine).sqrt();
        for spoke in 0..SPOKES {
            let phi = (f64::from(spoke) + 0.5) / f64::from(SPOKES) * std::f64::consts::TAU;
            let l = side * (sine * phi.cos()) + up * (sine * phi.sin()) + normal * cosine;
            let shading = super::twin::Shading {
                normal,
                view,
                light: l,
                base: glam::DVec3::splat(0.6),
                metallic: 0.0,
                roughness: 1.0,
                lobes: Default::default(),
            };
            sum += shading.reflected(false).x * sky(l);
        }
    }
    sum * std::f64::consts::TAU / f64::from(RINGS * SPOKES)
}

/// A smooth sphere under a constant sky, for its mean over the visible disc: every point reflects its albedo.
#[test]
fn a_sphere_under_a_constant_sky_is_even() {
    let Some(gpu) = device() else { return };
    let fixture = Fixture {
        objects: vec![sphere(0, vec![Mat4::IDENTITY])],
        materials: vec![white(0.0, 1.0)],
        environment: Some([[1.0; 3]; 6]),
        lut: true,
        ..Fixture::default()
    };
    let image = trace(
        &gpu,
        &fixture,
        [24, 24],
        towards_origin(Vec3::new(0.0, 0.4, 2.6)),
        traced(),
        &samples(64),
    );
    assert_close(mean(&image, 0), 1.0, 0.003);
    assert_eq!(gpu.close(), Vec::<String>::new());
}

#[test]
fn vertex_colours_tint_all_channels_alike() {
    let Some(gpu) = device() else { return };
    let color = [0.9, 0.5, 0.3, 1.0];
    let fixture = Fixture {
        objects: vec![
            quad(0, vec![Mat4::from_translation(Vec3::new(0.0, 0.0, -5.0))]),
            colored(wide(0, 1e3), color),
        ],
        materials: vec![unlit([1.0; 4])],
        ..Fixture::default()
    };
    let camera = towards_origin(Vec3::new(0.0, 0.0, 3.0));
    let image = trace(&gpu, &fixture, [4, 4], camera, traced(), &samples(1));
    for (channel, expected) in color[..3].iter().enumerate() {
        assert_close(mean(&image, channel), f64::from(*expected), 1e-4);
    }
}
