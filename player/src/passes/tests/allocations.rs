//! A frame allocates nothing once everything has its size.

use glam::{Mat4, Vec3};

use super::fixture::{Fixture, light, quad, sphere, unlit};
use super::{device, towards_origin};
use crate::gpu::test_support::allocations;
use crate::headless::Session;
use crate::settings::Settings;

#[test]
fn frames_allocate_nothing_after_the_first() {
    let Some(gpu) = device() else { return };
    let places: Vec<Mat4> = (0..400)
        .map(|index| {
            Mat4::from_translation(Vec3::new((index % 20) as f32, 0.0, -(index / 20) as f32))
        })
        .collect();
    let fixture = Fixture {
        objects: vec![
            sphere(0, places),
            quad(1, vec![Mat4::IDENTITY, Mat4::from_scale(Vec3::splat(2.0))]),
        ],
        materials: vec![Default::default(), unlit([1.0, 0.5, 0.25, 0.5])],
        lights: vec![light(Vec3::NEG_Y, [1.0; 3], 2.0)],
        ..Fixture::default()
    };
    let package = fixture.package();
    let settings = Settings::default();
    let mut session = Session::new(&gpu, &package, [64, 48], &settings, false).expect("a session");
    // The eye wanders, so that what is visible changes; it sees most at first.
    let camera = |frame: u32| {
        towards_origin(Vec3::new(
            1.0 + 0.1 * frame as f32,
            2.0,
            12.0 - 0.2 * frame as f32,
        ))
    };
    for frame in 0..6 {
        session
            .frame(&camera(frame), &settings, false)
            .expect("a frame");
    }
    let before = allocations();
    for frame in 6..30 {
        session
            .frame(&camera(frame), &settings, false)
            .expect("a frame");
    }
    assert_eq!(allocations() - before, 0, "allocations in 24 frames");
    assert!(session.draw_stats().draws > 0);
    session.finish().expect("the last frame");
}
