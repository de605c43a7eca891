//! Renders packages of a few triangles and compares pixels with what theory says.

mod allocations;
mod ambient;
mod contact;
mod corners;
mod fixture;
mod furnace;
mod lighting;
mod output;
mod pathtrace;
mod prepass;
mod punctual;
#[cfg(feature = "hot-reload")]
mod reload;
mod renderer;
mod scatter;
mod screen;
mod shading;
mod shadows;
mod sky;
mod surfaces;
mod texture_transforms;
mod tonemap;
mod traced;
mod twin;
mod variants;
mod vertex_colors;
mod views;

use glam::Vec3;

use crate::PlayerError;
use crate::camera::{Camera, Projection};
use crate::gpu::test_support::gpu as device;
use crate::gpu::{Gpu, GpuOptions};
use crate::headless::{HeadlessImage, HeadlessOptions, render_on};
use crate::settings::{Settings, Tonemap};
use fixture::Fixture;

/// Linear output of the full image, of surfaces and lights alone.
fn plain() -> Settings {
    let mut settings = Settings {
        tonemap: Tonemap::Linear,
        ..Settings::default()
    };
    settings.shadow.enabled = false;
    settings.ao.enabled = false;
    settings.contact.enabled = false;
    settings
}

fn options(size: [u32; 2], camera: Camera, settings: Settings) -> HeadlessOptions {
    HeadlessOptions {
        size,
        camera,
        settings,
        frames: 3,
        hdr: true,
        gpu: GpuOptions::default(),
    }
}

/// Renders and asserts what holds for every image: validation is content, HDR texels are finite.
fn shoot(
    gpu: &Gpu,
    fixture: &Fixture,
    size: [u32; 2],
    camera: Camera,
    settings: Settings,
) -> HeadlessImage {
    let result: Result<HeadlessImage, PlayerError> =
        render_on(gpu, &fixture.package(), &options(size, camera, settings));
    let image = result.expect("renders");
    assert_eq!(image.validation, Vec::<String>::new());
    assert_eq!(image.non_finite(), Some(0));
    image
}

/// At `eye`, looking at the origin with a vertical field of view of 1 radian.
fn towards_origin(eye: Vec3) -> Camera {
    let up = if eye.x == 0.0 && eye.z == 0.0 {
        Vec3::X
    } else {
        Vec3::Y
    };
    Camera::look_at(eye, Vec3::ZERO, up, 1.0).expect("eye is not the origin")
}

/// Along `forward` from the origin.
fn along(forward: Vec3, projection: Projection) -> Camera {
    Camera {
        projection,
        ..Camera::look_at(
            Vec3::ZERO,
            forward,
            if forward.y == 0.0 { Vec3::Y } else { Vec3::X },
            1.0,
        )
        .expect("a direction")
    }
}

/// HDR radiance of a pixel.
fn texel(image: &HeadlessImage, x: u32, y: u32) -> [f32; 3] {
    let hdr = image.hdr.as_ref().expect("read back");
    let [r, g, b, _] = hdr[(y * image.width + x) as usize];
    [r, g, b]
}

/// HDR radiance in the middle.
fn middle(image: &HeadlessImage) -> [f32; 3] {
    texel(image, image.width / 2, image.height / 2)
}

#[track_caller]
fn assert_near(found: [f32; 3], expected: [f32; 3], tolerance: f32) {
    let near = found
        .iter()
        .zip(expected)
        .all(|(a, b)| (a - b).abs() <= tolerance);
    assert!(
        near,
        "found {found:?}, expected {expected:?} +- {tolerance}"
    );
}
