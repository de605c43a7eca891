//! Our own scenes, baked and rendered, look as they did when a person last accepted them.

use cairn_format::Package;
use cairn_player::camera::Camera;
use cairn_player::gpu::GpuOptions;
use cairn_player::headless::{self, HeadlessImage, HeadlessOptions};
use cairn_player::settings::{Brdf, Settings, Tonemap};
use cairn_tests::{Bounds, Rgb, assert_golden, baked, bounds, camera, require_vulkan};

/// Drivers may round differently; edges may fall on the other side of a pixel's centre.
const BOUNDS: Bounds = Bounds { mean: 0.35, p99: 4 };
const SIZE: [u32; 2] = [256, 144];

fn view(package: &Package, camera: Camera, settings: Settings) -> HeadlessImage {
    let options = HeadlessOptions {
        size: SIZE,
        camera,
        settings,
        frames: 2,
        hdr: true,
        gpu: GpuOptions {
            validation: true,
            device: None,
            ..GpuOptions::default()
        },
    };
    let image = headless::render(package, &options).expect("a rendered frame");
    assert!(
        image.validation.is_empty(),
        "validation: {:#?}",
        image.validation
    );
    assert_eq!(image.non_finite(), Some(0), "non-finite texels");
    image
}

fn golden(name: &str, package: &Package, camera: Camera, settings: Settings) {
    let image = view(package, camera, settings);
    assert_golden(
        name,
        &Rgb::from_rgba(image.width, image.height, &image.rgba8),
        BOUNDS,
    );
}

#[test]
fn golden_hall() {
    if !require_vulkan("golden_hall") {
        return;
    }
    let package = baked("hall/hall.gltf", Some("hall/sky.hdr"));
    for name in ["hero", "detail", "plant"] {
        golden(
            &format!("hall-{name}"),
            &package,
            camera(&package, name),
            Settings::default(),
        );
    }
    let turned = Settings {
        ibl_yaw: 2.0,
        ev: 1.0,
        tonemap: Tonemap::Linear,
        ..Settings::default()
    };
    golden(
        "hall-turned-linear",
        &package,
        camera(&package, "hero"),
        turned,
    );
}

#[test]
fn golden_materials() {
    if !require_vulkan("golden_materials") {
        return;
    }
    let package = baked("materials/materials.gltf", Some("hall/sky.hdr"));
    for (name, brdf) in [("energy", Brdf::Energy), ("gltf-core", Brdf::GltfCore)] {
        let settings = Settings {
            brdf,
            ..Settings::default()
        };
        golden(
            &format!("materials-{name}"),
            &package,
            camera(&package, "persp"),
            settings,
        );
    }
    golden(
        "materials-ortho",
        &package,
        camera(&package, "ortho"),
        Settings::default(),
    );
    for debug_view in 1..=12 {
        let settings = Settings {
            debug_view,
            ..Settings::default()
        };
        golden(
            &format!("materials-view-{debug_view}"),
            &package,
            camera(&package, "persp"),
            settings,
        );
    }
}

#[test]
fn golden_lobes() {
    if !require_vulkan("golden_lobes") {
        return;
    }
    let package = baked("lobes/lobes.gltf", Some("hall/sky.hdr"));
    for tonemap in [Tonemap::Aces, Tonemap::Agx, Tonemap::Neutral] {
        let settings = Settings {
            tonemap,
            ev: -1.0,
            ..Settings::default()
        };
        let name = format!("lobes-{tonemap:?}").to_lowercase();
        golden(&name, &package, camera(&package, "main"), settings);
    }
    let night = Settings {
        ibl_intensity: 0.0,
        ..Settings::default()
    };
    golden("lobes-night", &package, camera(&package, "main"), night);
}

#[test]
fn golden_lights() {
    if !require_vulkan("golden_lights") {
        return;
    }
    let package = baked("lights/lights.gltf", None);
    golden(
        "lights",
        &package,
        camera(&package, "main"),
        Settings::default(),
    );
}

#[test]
fn golden_box() {
    if !require_vulkan("golden_box") {
        return;
    }
    let package = baked("box/box.gltf", None);
    golden(
        "box",
        &package,
        Camera::framing(bounds(&package), 16.0 / 9.0),
        Settings::default(),
    );
}
