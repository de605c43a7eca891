//! Hard cases: long accumulation, repeated runs, the firefly clamp.

use glam::{Mat4, Vec3};

use super::super::fixture::{Fixture, quad, sphere};
use super::super::{device, towards_origin};
use super::{assert_close, mean, samples, trace, traced, white, wide};
use crate::settings::Settings;

#[test]
fn runs_repeat_to_the_bit() {
    let Some(gpu) = device() else { return };
    let fixture = Fixture {
        objects: vec![sphere(0, vec![Mat4::IDENTITY]), wide(0, 5.0)],
        materials: vec![white(0.3, 0.4)],
        environment: Some([
            [1.0, 0.2, 0.1],
            [0.3; 3],
            [2.0; 3],
            [0.0; 3],
            [0.5; 3],
            [0.9; 3],
        ]),
        lut: true,
        ..Fixture::default()
    };
    let camera = || towards_origin(Vec3::new(0.5, 0.6, 3.0));
    let shoot = |pace: u32, seed: u32| {
        let mut settings = traced();
        settings.path.samples_per_frame = pace;
        settings.path.seed = seed;
        trace(&gpu, &fixture, [16, 16], camera(), settings, &samples(24))
            .hdr
            .expect("read back")
    };
    assert_eq!(shoot(8, 0), shoot(8, 0));
    assert_ne!(shoot(8, 0), shoot(8, 1));
    // The same samples in other batches: only the sums' rounding differs.
    for (a, b) in shoot(8, 0).iter().zip(&shoot(3, 0)) {
        assert!(
            (a[0] - b[0]).abs() <= 1e-5 * a[0].abs().max(1.0),
            "{a:?} {b:?}"
        );
    }
    assert_eq!(gpu.close(), Vec::<String>::new());
}

/// The mean of 65,536 samples in dispatches of 64 still moves: it is that of the furnace.
#[test]
fn long_accumulation_does_not_stall() {
    let Some(gpu) = device() else { return };
    let fixture = Fixture {
        objects: vec![quad(0, vec![Mat4::from_scale(Vec3::splat(9.0))])],
        materials: vec![white(1.0, 0.7)],
        environment: Some([[1.0; 3]; 6]),
        lut: true,
        ..Fixture::default()
    };
    let mut settings = traced();
    settings.path.samples_per_frame = 64;
    let camera = towards_origin(Vec3::new(0.0, 1.0, 2.0));
    let image = trace(&gpu, &fixture, [2, 1], camera, settings, &samples(65_536));
    let stats = image.trace.as_ref().expect("traced");
    assert_eq!((stats.samples, stats.batches), (65_536, 1024));
    assert_close(mean(&image, 0), 1.0, 0.003);
    assert_eq!(gpu.close(), Vec::<String>::new());
}

/// The clamp takes indirect light alone, keeps its hue, and says how much it took.
#[test]
fn the_clamp_reports_what_it_takes() {
    let Some(gpu) = device() else { return };
    let fixture = Fixture {
        objects: vec![
            wide(0, 5.0),
            quad(
                0,
                vec![Mat4::from_translation(Vec3::new(0.0, 1.0, 0.5)) * Mat4::from_rotation_x(1.3)],
            ),
        ],
        materials: vec![white(0.0, 0.8)],
        environment: Some([[2.0, 1.0, 0.5]; 6]),
        lut: true,
        ..Fixture::default()
    };
    let camera = || towards_origin(Vec3::new(0.0, 0.3, 3.0));
    let shoot = |clamp: f32| {
        let mut settings: Settings = traced();
        settings.path.clamp = clamp;
        trace(&gpu, &fixture, [16, 16], camera(), settings, &samples(32))
    };
    let (free, clamped, loose) = (shoot(0.0), shoot(0.05), shoot(1e6));
    let taken = |image: &crate::headless::HeadlessImage| {
        image
            .trace
            .as_ref()
            .expect("traced")
            .counters
            .removed_luminance
    };
    assert_eq!(taken(&free), 0.0);
    assert_eq!(taken(&loose), 0.0);
    assert_eq!(free.hdr, loose.hdr);
    let luminance = |image: &crate::headless::HeadlessImage| {
        0.2126 * mean(image, 0) + 0.7152 * mean(image, 1) + 0.0722 * mean(image, 2)
    };
    let lost = (luminance(&free) - luminance(&clamped)) * 256.0 * 32.0;
    assert!(lost > 0.0);
    assert_close(taken(&clamped), lost, 0.01);
    assert_eq!(gpu.close(), Vec::<String>::new());
}
