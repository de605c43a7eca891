//! What `extract` writes is read back by readers of other projects, and is what the package holds.

use std::path::{Path, PathBuf};

use cairn_bake::{Options, Silent, bake, look};
use cairn_format::{Package, TextureFormat};

use super::{asset, json, materials, path, run, text};

/// Writes something out, and gives its bytes.
#[track_caller]
fn extracted(package: &Path, what: &[&str], file: &str) -> Vec<u8> {
    let output = package.with_file_name(file);
    let arguments = [&["extract", path(package), "-o", path(&output)], what].concat();
    let done = run(&arguments);
    assert!(done.status.success(), "{}", text(&done.stderr));
    assert!(done.stdout.is_empty(), "silent on success");
    std::fs::read(output).expect("the file")
}

/// The bytes of all levels of one layer of an image.
fn stored(package: &Package, index: usize, layer: u64) -> Vec<u8> {
    let image = &package.scene().images[index];
    let texels = package.texels().expect("texels");
    let layers = u64::from(image.layers.to_native());
    let levels = image.levels.iter().map(|level| {
        let length = level.length.to_native() / layers;
        let start = level.offset.to_native() + layer * length;
        &texels[start as usize..(start + length) as usize]
    });
    levels.collect::<Vec<_>>().concat()
}

fn lit() -> (tempfile::TempDir, PathBuf) {
    let folder = tempfile::tempdir().expect("a folder");
    let output = folder.path().join("lit.cairn");
    let mut options = Options::new(asset("box/box.gltf"), &output);
    options.environment = Some(asset("hall/sky.hdr"));
    options.light.error = 1e-2;
    bake(&options, &Silent).expect("a bake");
    (folder, output)
}

#[test]
fn pictures_show_what_shaders_read() {
    let (_folder, file) = materials();
    let package = Package::open(&file).expect("the package");
    let png = image::load_from_memory(&extracted(&file, &["--texture", "leaf"], "leaf.png"));
    let png = png.expect("a PNG").to_rgba8();
    let source = image::open(asset("materials/textures/leaf.png"))
        .expect("the source")
        .to_rgba8();
    assert_eq!(png.dimensions(), source.dimensions());
    // Colour that nobody sees may differ: it is taken from its surroundings.
    let seen = png
        .pixels()
        .zip(source.pixels())
        .filter(|(_, source)| source.0[3] > 0);
    let differences: Vec<f64> = seen
        .flat_map(|(a, b)| [0, 1, 2, 3].map(|c| f64::from(a.0[c]) - f64::from(b.0[c])))
        .collect();
    let squares: f64 = differences
        .iter()
        .map(|difference| difference * difference)
        .sum();
    let psnr = 10.0 * (255.0 * 255.0 * differences.len() as f64 / squares).log10();
    assert!(
        differences.len() > 4000 && psnr > 36.0,
        "{psnr} dB of {}",
        differences.len()
    );
    let plane = look::layer(
        &package.scene().images[0],
        package.texels().expect("texels"),
        0,
        0,
    );
    let codes = plane
        .texels
        .as_flattened()
        .iter()
        .map(|value| (value * 255.0).round() as u8);
    assert!(codes.eq(png.as_raw().iter().copied()));

    let small = extracted(&file, &["--texture", "#0", "--level", "3"], "small.png");
    let small = image::load_from_memory(&small).expect("a PNG");
    assert_eq!(
        (small.width(), small.height()),
        (png.width() / 8, png.height() / 8)
    );
}

#[test]
fn surfaces_hold_the_stored_blocks() {
    let (_folder, file) = materials();
    let package = Package::open(&file).expect("the package");
    for (index, image) in package.scene().images.iter().enumerate() {
        let place = format!("#{index}");
        let bytes = extracted(&file, &["--texture", &place], "image.dds");
        let dds = ddsfile::Dds::read(bytes.as_slice()).expect("a DDS");
        let header = dds.header10.as_ref().expect("a DXT10 header");
        let expected = match image.format.native() {
            TextureFormat::Bc7Srgb => ddsfile::DxgiFormat::BC7_UNorm_sRGB,
            TextureFormat::Bc7Unorm => ddsfile::DxgiFormat::BC7_UNorm,
            TextureFormat::Bc4Unorm => ddsfile::DxgiFormat::BC4_UNorm,
            TextureFormat::Bc5Unorm => ddsfile::DxgiFormat::BC5_UNorm,
            TextureFormat::Rgba16Float => ddsfile::DxgiFormat::R16G16B16A16_Float,
            other => panic!("{other:?} in this scene"),
        };
        assert_eq!(header.dxgi_format, expected);
        assert_eq!(
            (dds.get_width(), dds.get_height()),
            (image.width.to_native(), image.height.to_native())
        );
        assert_eq!(dds.get_num_mipmap_levels() as usize, image.levels.len());
        assert!(
            dds.get_data(0).expect("the layer") == stored(&package, index, 0),
            "{place}"
        );

        let bytes = extracted(&file, &["--texture", &place], "image.ktx2");
        let ktx2 = ktx2::Reader::new(bytes).expect("a KTX2");
        let levels: Vec<u8> = ktx2
            .levels()
            .flat_map(|level| level.data.to_vec())
            .collect();
        assert!(levels == stored(&package, index, 0), "{place}");
        let (header, srgb) = (ktx2.header(), image.format.native().is_srgb());
        assert_eq!(
            (header.pixel_width, header.face_count),
            (image.width.to_native(), 1)
        );
        let transfer = if srgb {
            ktx2::TransferFunction::SRGB
        } else {
            ktx2::TransferFunction::Linear
        };
        assert_eq!(ktx2.transfer_function(), Some(transfer));
        let (format, model) = match image.format.native() {
            TextureFormat::Bc7Srgb => (ktx2::Format::BC7_SRGB_BLOCK, ktx2::ColorModel::BC7),
            TextureFormat::Bc7Unorm => (ktx2::Format::BC7_UNORM_BLOCK, ktx2::ColorModel::BC7),
            TextureFormat::Rgba16Float => {
                (ktx2::Format::R16G16B16A16_SFLOAT, ktx2::ColorModel::RGBSDA)
            }
            TextureFormat::Bc4Unorm => (ktx2::Format::BC4_UNORM_BLOCK, ktx2::ColorModel::BC4),
            _ => (ktx2::Format::BC5_UNORM_BLOCK, ktx2::ColorModel::BC5),
        };
        assert_eq!(
            (header.format, ktx2.color_model()),
            (Some(format), Some(model))
        );
        assert!(
            ktx2.writer()
                .is_some_and(|writer| writer.starts_with("cairn-bake"))
        );
    }
}

#[test]
fn cubes_keep_their_faces() {
    let (_folder, file) = lit();
    let package = Package::open(&file).expect("the package");
    let images = &package.scene().images;
    let sky = images
        .iter()
        .position(|image| image.name == "sky")
        .expect("a sky");
    let dds = ddsfile::Dds::read(extracted(&file, &["--texture", "sky"], "sky.dds").as_slice())
        .expect("a DDS");
    assert_eq!(
        dds.header10.as_ref().map(|header| header.dxgi_format),
        Some(ddsfile::DxgiFormat::BC6H_UF16)
    );
    let faces: Vec<u8> = (0..6)
        .flat_map(|face| stored(&package, sky, face))
        .collect();
    assert!(dds.data == faces);

    let ktx2 =
        ktx2::Reader::new(extracted(&file, &["--texture", "sky"], "sky.ktx2")).expect("a KTX2");
    assert_eq!(
        (ktx2.header().face_count, ktx2.color_model()),
        (6, Some(ktx2::ColorModel::BC6H))
    );
    let image = &images[sky];
    let texels = package.texels().expect("texels");
    for (level, stored) in ktx2.levels().zip(image.levels.iter()) {
        let start = stored.offset.to_native() as usize;
        assert!(level.data == &texels[start..start + stored.length.to_native() as usize]);
    }

    let lut = ktx2::Reader::new(extracted(&file, &["--texture", "brdf-lut"], "lut.ktx2"))
        .expect("a KTX2");
    assert_eq!(lut.header().format, Some(ktx2::Format::R16G16B16A16_SFLOAT));
    let refused = run(&["extract", path(&file), "--texture", "sky", "-o", "sky.png"]);
    assert_eq!(refused.status.code(), Some(2));
    assert!(
        text(&refused.stderr).contains(".exr"),
        "{}",
        text(&refused.stderr)
    );
}

#[test]
fn meshes_keep_every_vertex() {
    use ply_rs_bw::ply::Property;
    let (_folder, file) = materials();
    let package = Package::open(&file).expect("the package");
    let bytes = extracted(&file, &["--mesh", "studs"], "studs.ply");
    let parser = ply_rs_bw::parser::Parser::<ply_rs_bw::ply::DefaultElement>::new();
    let ply = parser.read_ply(&mut bytes.as_slice()).expect("a PLY");
    let index = package
        .scene()
        .meshes
        .iter()
        .position(|mesh| mesh.name == "studs")
        .expect("the mesh");
    let mesh = look::mesh(&package, index).expect("the mesh");
    let vertices = &ply.payload["vertex"];
    assert_eq!(vertices.len(), mesh.primitives[0].vertices.len());
    for (read, vertex) in vertices.iter().zip(mesh.primitives[0].vertices) {
        let float = |name: &str| match read[name] {
            Property::Float(value) => value,
            ref other => panic!("{other:?}"),
        };
        assert_eq!(["x", "y", "z"].map(float), vertex.position);
        assert_eq!(["nx", "ny", "nz"].map(float), vertex.normal);
        assert_eq!(["tx", "ty", "tz", "tw"].map(float), vertex.tangent);
        assert_eq!(["s", "t"].map(float), vertex.uv0);
    }
    let faces = &ply.payload["face"];
    let indices: Vec<u32> = faces
        .iter()
        .flat_map(|face| match &face["vertex_indices"] {
            Property::ListUInt(list) => list.clone(),
            other => panic!("{other:?}"),
        })
        .collect();
    assert_eq!(indices, mesh.primitives[0].indices);
}

#[test]
fn what_is_not_there_is_named() {
    let (folder, file) = materials();
    let output = folder.path().join("out.png");
    let refuse = |what: &[&str], expected: &str| {
        let done = run(&[&["extract", path(&file), "-o", path(&output)], what].concat());
        let message = text(&done.stderr);
        assert_eq!(done.status.code(), Some(2), "{message}");
        assert!(message.contains(expected), "`{expected}` in {message}");
        assert!(!output.exists(), "nothing half-written");
    };
    refuse(&["--texture", "moss"], "leaf, studs_normal, checker");
    refuse(&["--texture", "#9"], "no image `#9`");
    refuse(&["--texture", "leaf", "--level", "99"], "level 99 of 8");
    refuse(&["--mesh", "studs"], ".ply");
    // Stored for colour, for data, and for colour under other coordinates' occlusion.
    refuse(&["--texture", "checker"], "by its place, #");
    refuse(&[], "--texture");
    let done = run(&[
        "extract",
        path(&file),
        "--texture",
        "leaf",
        "-o",
        path(&file),
    ]);
    assert_eq!(done.status.code(), Some(2));
    let done = run(&[
        "extract",
        path(&file),
        "--texture",
        "leaf",
        "-o",
        path(&output),
        "--json",
    ]);
    assert_eq!(
        json(&done)["bytes"],
        std::fs::metadata(&output).expect("a file").len()
    );
}
