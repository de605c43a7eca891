//! Packages without BC formats: the same picture on every kind of device.

use cairn_bake::Silent;
use cairn_bake::encode::{Quality, Target};
use cairn_format::{Package, TextureFormat};
use cairn_player::camera::Camera;
use cairn_player::gpu::{AllowedBlocks, GpuOptions};
use cairn_player::headless::{HeadlessOptions, render};
use cairn_player::settings::Settings;
use cairn_tests::{Rgb, bounds, options, require_vulkan};

const SIZE: [u32; 2] = [160, 90];

fn baked_for(target: Target, scene: &str) -> Package {
    let folder = tempfile::tempdir().expect("a folder");
    let output = folder.path().join("out.cairn");
    let mut options = options(scene, None, &output);
    options.textures.target = target;
    options.textures.effort = Quality::Fast.into();
    cairn_bake::bake(&options, &Silent).expect("a bake");
    let bytes = std::fs::read(output).expect("the package");
    Package::from_bytes(&bytes).expect("a good package")
}

fn picture(package: &Package, blocks: AllowedBlocks) -> Rgb {
    let options = HeadlessOptions {
        size: SIZE,
        camera: Camera::framing(bounds(package), SIZE[0] as f32 / SIZE[1] as f32),
        settings: Settings::default(),
        frames: 1,
        hdr: false,
        gpu: GpuOptions {
            validation: true,
            blocks,
            ..GpuOptions::default()
        },
    };
    let image = render(package, &options).expect("a picture");
    assert_eq!(image.validation, Vec::<String>::new());
    Rgb::from_rgba(image.width, image.height, &image.rgba8)
}

#[test]
fn portable_packages_look_alike_on_every_device() {
    if !require_vulkan("portable_packages_look_alike_on_every_device") {
        return;
    }
    let scene = "hall/hall.gltf";
    let package = baked_for(Target::Portable, scene);
    let universal = [TextureFormat::UastcUnorm, TextureFormat::UastcSrgb];
    let mut count = 0;
    for image in package.scene().images.iter() {
        let format = image.format.native();
        count += usize::from(universal.contains(&format));
        assert!(
            universal.contains(&format) || format == TextureFormat::Rgba16Float,
            "{}: {format:?}",
            image.name
        );
    }
    assert!(count > 2, "{count} textures");
    let settings = &package.scene().provenance.settings;
    assert!(settings.iter().any(|setting| setting.value == "portable"));
    let desktop = picture(&baked_for(Target::Desktop, scene), AllowedBlocks::All);
    for blocks in [AllowedBlocks::All, AllowedBlocks::Astc, AllowedBlocks::None] {
        let portable = picture(&package, blocks);
        let difference = portable.difference(&desktop).expect("equal sizes");
        assert!(
            difference.mean < 0.5 && difference.p99 <= 6,
            "{blocks:?}: {difference:?}"
        );
    }
}

#[test]
fn uncompressed_packages_look_alike_without_any_block() {
    if !require_vulkan("uncompressed_packages_look_alike_without_any_block") {
        return;
    }
    let scene = "hall/hall.gltf";
    let package = baked_for(Target::Uncompressed, scene);
    for image in package.scene().images.iter() {
        let format = image.format.native();
        assert_eq!(format.block_extent(), 1, "{}: {format:?}", image.name);
    }
    let textures = |row: &&cairn_format::scene::ArchivedReportRow| row.metric == "psnr dB";
    let rows: Vec<f64> = package
        .scene()
        .report
        .iter()
        .filter(textures)
        .map(|row| row.error.to_native())
        .collect();
    assert!(
        rows.len() > 2 && rows.iter().all(|db| *db > 55.0),
        "{rows:?}"
    );
    let desktop = picture(&baked_for(Target::Desktop, scene), AllowedBlocks::All);
    let plain = picture(&package, AllowedBlocks::None);
    let difference = plain.difference(&desktop).expect("equal sizes");
    assert!(
        difference.mean < 0.5 && difference.p99 <= 6,
        "{difference:?}"
    );
}
