//! Packages without BC formats: the same picture on every kind of device, and the blocks of UASTC files as they are.

use std::path::Path;

use cairn_bake::Silent;
use cairn_bake::encode::{Quality, SkyFormat, Target};
use cairn_bake::look::export;
use cairn_format::scene::{ArchivedImage, ArchivedImageRole};
use cairn_format::{Package, TextureFormat};
use cairn_player::camera::Camera;
use cairn_player::gpu::{AllowedBlocks, GpuOptions};
use cairn_player::headless::{HeadlessOptions, render};
use cairn_player::settings::Settings;
use cairn_tests::{Rgb, bounds, options, repository, require_vulkan, shared_assets};
use serde_json::json;

const SIZE: [u32; 2] = [160, 90];

fn baked_for(target: Target, scene: &str) -> Package {
    let folder = tempfile::tempdir().expect("a folder");
    let output = folder.path().join("out.cairn");
    finished(target, options(scene, None, &output))
}

fn finished(target: Target, mut options: cairn_bake::Options) -> Package {
    options.textures.target = target;
    options.textures.effort = Quality::Fast.into();
    let output = options.output.clone();
    cairn_bake::bake(&options, &Silent).expect("a bake");
    let bytes = std::fs::read(output).expect("the package");
    Package::from_bytes(&bytes).expect("a good package")
}

fn picture(package: &Package, blocks: AllowedBlocks) -> Rgb {
    picture_of(package, blocks, SIZE)
}

fn picture_of(package: &Package, blocks: AllowedBlocks, size: [u32; 2]) -> Rgb {
    let options = HeadlessOptions {
        size,
        camera: Camera::framing(bounds(package), size[0] as f32 / size[1] as f32),
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
    // A device without ASTC, as software Vulkan is, takes plain texels for it; `transcode/astc_tests.rs` tests those blocks.
    for blocks in [AllowedBlocks::All, AllowedBlocks::Astc, AllowedBlocks::None] {
        let portable = picture(&package, blocks);
        let difference = portable.difference(&desktop).expect("equal sizes");
        assert!(
            difference.mean < 0.5 && difference.p99 <= 6,
            "{blocks:?}: {difference:?}"
        );
    }
}

fn levels<'a>(package: &'a Package, image: &'a ArchivedImage) -> Vec<&'a [u8]> {
    let texels = package.texels().expect("texels");
    let level = |level: &cairn_format::scene::ArchivedLevel| {
        let start = level.offset.to_native() as usize;
        &texels[start..start + level.length.to_native() as usize]
    };
    image.levels.iter().map(level).collect()
}

/// A triangle for each image of a package, whose material reads the image as a KTX2 file.
fn scene_of_images(package: &Package, folder: &Path) -> std::path::PathBuf {
    let floats: [f32; 15] = [0., 0., 0., 1., 0., 0., 0., 1., 0., 0., 0., 1., 0., 0., 1.];
    std::fs::write(
        folder.join("data.bin"),
        floats.map(f32::to_le_bytes).concat(),
    )
    .expect("data");
    let texels = package.texels().expect("texels");
    let stored = package.scene().images.iter();
    let universal = stored.filter(|image| image.format.native().is_universal());
    let [
        mut images,
        mut textures,
        mut materials,
        mut meshes,
        mut nodes,
    ] = [const { vec![] }; 5];
    for (index, image) in universal.enumerate() {
        let file = format!("{index}.ktx2");
        std::fs::write(folder.join(&file), export::ktx2(image, texels)).expect("a file");
        images.push(json!({"uri": file}));
        textures.push(json!({"extensions": {"KHR_texture_basisu": {"source": index}}}));
        let texture = json!({"index": index});
        materials.push(match image.role {
            ArchivedImageRole::Color => {
                json!({"emissiveTexture": texture, "emissiveFactor": [1, 1, 1]})
            }
            ArchivedImageRole::Normal => json!({"normalTexture": texture}),
            _ => json!({"pbrMetallicRoughness": {"metallicRoughnessTexture": texture}}),
        });
        meshes.push(json!({"primitives": [
            {"attributes": {"POSITION": 0, "TEXCOORD_0": 1}, "material": index}
        ]}));
        nodes.push(json!({"mesh": index}));
    }
    let all: Vec<usize> = (0..nodes.len()).collect();
    let scene = json!({
        "asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": all}],
        "extensionsUsed": ["KHR_texture_basisu"], "extensionsRequired": ["KHR_texture_basisu"],
        "buffers": [{"uri": "data.bin", "byteLength": 60}],
        "bufferViews": [
            {"buffer": 0, "byteLength": 36}, {"buffer": 0, "byteOffset": 36, "byteLength": 24}
        ],
        "accessors": [
            {"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3",
             "min": [0, 0, 0], "max": [1, 1, 0]},
            {"bufferView": 1, "componentType": 5126, "count": 3, "type": "VEC2"}
        ],
        "images": images, "textures": textures, "materials": materials, "meshes": meshes,
        "nodes": nodes
    });
    let path = folder.join("images.gltf");
    std::fs::write(&path, scene.to_string()).expect("a scene");
    path
}

/// What a portable package holds goes out as KTX2 and into another as it is.
#[test]
fn extracted_blocks_are_stored_bit_for_bit() {
    let first = baked_for(Target::Portable, "hall/hall.gltf");
    let folder = tempfile::tempdir().expect("a folder");
    let scene = scene_of_images(&first, folder.path());
    let output = folder.path().join("out.cairn");
    let second = finished(Target::Portable, cairn_bake::Options::new(scene, &output));
    let find = |levels_of: &[&[u8]]| {
        let images = second.scene().images.iter();
        images
            .filter(|image| levels(&second, image) == levels_of)
            .count()
    };
    let mut count = 0;
    for image in first.scene().images.iter() {
        if image.format.native().is_universal() {
            count += 1;
            assert_eq!(find(&levels(&first, image)), 1, "{}", image.name);
        }
    }
    assert!(count > 2, "{count} textures");
    let rows = second
        .scene()
        .report
        .iter()
        .filter(|row| row.metric == "psnr dB");
    let passed: Vec<_> = rows
        .map(|row| {
            (
                row.setting.ends_with("passed through"),
                row.error.to_native(),
            )
        })
        .collect();
    assert_eq!(passed, vec![(true, 999.0); count]);
}

/// The fish of Khronos, whose sources are ETC1S and UASTC, under our sky.
#[test]
fn universal_sources_look_alike_on_every_target() {
    let test = "universal_sources_look_alike_on_every_target";
    let Some(assets) = shared_assets(test).filter(|_| require_vulkan(test)) else {
        return;
    };
    let scene = assets.join("khronos/BarramundiFish-basisu/BarramundiFish.mixed.glb");
    let baked = |target| {
        let folder = tempfile::tempdir().expect("a folder");
        let mut options = cairn_bake::Options::new(&scene, folder.path().join("out.cairn"));
        options.environment = Some(repository().join("assets/hall/sky.hdr"));
        options.light.error = 1e-2;
        options.sky_format = SkyFormat::Rgba16f;
        finished(target, options)
    };
    let show = |package: &Package, blocks| picture_of(package, blocks, [256, 256]);
    let plain = show(&baked(Target::Uncompressed), AllowedBlocks::None);
    let portable = baked(Target::Portable);
    for (name, picture) in [
        ("desktop", show(&baked(Target::Desktop), AllowedBlocks::All)),
        ("portable", show(&portable, AllowedBlocks::All)),
        (
            "portable without blocks",
            show(&portable, AllowedBlocks::None),
        ),
    ] {
        let difference = picture.difference(&plain).expect("equal sizes");
        assert!(
            difference.mean < 0.2 && difference.p99 <= 4,
            "{name}: {difference:?}"
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
