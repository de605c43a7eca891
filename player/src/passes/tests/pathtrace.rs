//! The path tracer against theory.

use cairn_format::gpu::Material;
use glam::{Mat4, Vec3};

use super::fixture::{Fixture, quad};
use super::{device, options, plain, towards_origin};
use crate::camera::Camera;
use crate::gpu::Gpu;
use crate::headless::HeadlessImage;
use crate::headless::trace::{TraceOptions, trace_on};
use crate::settings::{Mode, Settings};

fn traced() -> Settings {
    Settings {
        mode: Mode::PathTrace,
        ..plain()
    }
}

fn shoot(
    gpu: &Gpu,
    fixture: &Fixture,
    size: [u32; 2],
    camera: Camera,
    settings: Settings,
    samples: u32,
) -> HeadlessImage {
    let limits = TraceOptions {
        samples: Some(samples),
        ..TraceOptions::default()
    };
    let package = fixture.package();
    let image = trace_on(gpu, &package, &options(size, camera, settings), &limits);
    let image = image.expect("traces");
    assert_eq!(image.validation, Vec::<String>::new());
    let stats = image.trace.as_ref().expect("traced");
    assert_eq!(stats.counters.non_finite, 0);
    image
}

#[test]
fn smoke() {
    let Some(gpu) = device() else { return };
    let fixture = Fixture {
        objects: vec![quad(0, vec![Mat4::from_scale(Vec3::splat(100.0))])],
        materials: vec![Material {
            base_color_factor: [0.5, 0.5, 0.5, 1.0],
            metallic_factor: 0.0,
            ..Material::default()
        }],
        environment: Some([[1.0; 3]; 6]),
        lut: true,
        ..Fixture::default()
    };
    let image = shoot(
        &gpu,
        &fixture,
        [8, 8],
        towards_origin(Vec3::new(0.0, 0.0, 3.0)),
        traced(),
        64,
    );
    println!(
        "{:?} {:?}",
        image.trace,
        &image.hdr.as_ref().expect("hdr")[..8]
    );
    assert_eq!(gpu.close(), Vec::<String>::new());
}
