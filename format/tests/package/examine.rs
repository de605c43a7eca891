//! Examination finds every broken rule, goes on behind damage, and never panics.

use bytemuck::Zeroable;
use cairn_format::check::Flow;
use cairn_format::gpu::{DirectionalLight, EmissiveTriangle, Material, NO_EMISSION};
use cairn_format::header::{ENTRY_BYTES, HEADER_BYTES, Header};
use cairn_format::{Error, Package, Part, SectionKind, Writer, scene::Scene};

use crate::common::{package, tiny, tiny_bytes};

fn findings(bytes: &[u8]) -> Vec<Error> {
    let mut all = Vec::new();
    Package::examine_bytes(bytes, &mut |error| {
        all.push(error);
        Flow::Continue(())
    });
    all
}

fn parts(bytes: &[u8]) -> Vec<(Part, u64)> {
    let place = |error| match error {
        Error::Corrupt { part, offset, .. } => (part, offset),
        other => panic!("{other}"),
    };
    findings(bytes).into_iter().map(place).collect()
}

#[test]
fn a_sound_package_has_no_findings() {
    assert!(findings(&tiny_bytes()).is_empty());
}

#[test]
fn all_findings_come_with_section_and_offset() {
    let (scene, mut content) = tiny();
    content.vertices[0].position[1] = f32::NAN;
    content.vertices[2].uv1[0] = f32::INFINITY;
    content.indices = vec![0, 3, 9];
    content.instances[0].pad_120 = 7;
    content.mesh_instances[0].mesh = 4;
    content.mesh_instances[0].first_emissive = NO_EMISSION;
    let section = |kind, offset| (Part::Section(kind), offset);
    assert_eq!(
        parts(&package(&scene, &content)),
        [
            section(SectionKind::Vertices, 0),
            section(SectionKind::Vertices, 112),
            section(SectionKind::Instances, 120),
            section(SectionKind::Indices, 4),
            section(SectionKind::Indices, 8),
            section(SectionKind::MeshInstances, 0),
        ]
    );
}

#[test]
fn a_broken_root_hides_no_damage_of_the_sections() {
    let (mut scene, mut content) = tiny();
    scene.primitives[0].material = 9;
    scene.images[0].width = u32::MAX;
    scene.meshes[0].primitive_count = 2;
    content.vertices[1].normal[0] = f32::NAN;
    let found = parts(&package(&scene, &content));
    let roots = found.iter().filter(|(part, _)| *part == Part::Root);
    assert_eq!(roots.count(), 3, "{found:?}");
    assert!(
        found.contains(&(Part::Section(SectionKind::Vertices), 56)),
        "{found:?}"
    );
}

#[test]
fn every_row_of_the_table_is_checked() {
    let mut bytes = tiny_bytes();
    for row in [1, 3] {
        let stride = (HEADER_BYTES + row * ENTRY_BYTES + 4) as usize;
        bytes[stride] ^= 1;
    }
    let found = parts(&bytes);
    let expected = [(Part::Header, 64), (Part::Table, 68), (Part::Table, 196)];
    assert_eq!(found, expected);
}

#[test]
fn floats_of_every_record_are_finite() {
    let lights = [DirectionalLight {
        direction_and_intensity: [0.0, -1.0, 0.0, f32::INFINITY],
        color_and_shadow: [1.0; 4],
    }];
    let mut writer = Writer::new();
    writer.records(SectionKind::DirectionalLights, &lights);
    let bytes = writer
        .to_vec(&Scene::empty("light"), "0")
        .expect("a package");
    let found = findings(&bytes);
    assert_eq!(found.len(), 1);
    let text = found[0].to_string();
    assert!(
        text.contains("section directional-lights, byte 0")
            && text.contains("direction_and_intensity of DirectionalLight 0"),
        "{text}"
    );
}

/// Two emitters of power 1 and 3, drawn by a table with these probabilities and aliases.
fn emitters(table: [(f32, u32); 2]) -> Vec<u8> {
    let emitter = |power| EmissiveTriangle {
        power,
        area: 1.0,
        ..EmissiveTriangle::zeroed()
    };
    let [first, second] = table.map(|(prob, alias)| [prob.to_bits(), alias]);
    let words = [[2, 4.0_f32.to_bits()], first, second].concat();
    let scene = Scene {
        materials: tiny().0.materials,
        ..Scene::empty("lamps")
    };
    let (triangles, materials) = ([emitter(1.0), emitter(3.0)], [Material::default()]);
    let mut writer = Writer::new();
    writer
        .records(SectionKind::EmissiveTriangles, &triangles)
        .records(SectionKind::Materials, &materials)
        .bytes(
            SectionKind::EmissiveAlias,
            bytemuck::cast_slice::<_, u8>(&words),
        );
    writer.to_vec(&scene, "0").expect("a package")
}

#[test]
fn emitters_are_drawn_by_their_power() {
    assert!(findings(&emitters([(0.5, 1), (1.0, 1)])).is_empty());
    let alias = |offset| vec![(Part::Section(SectionKind::EmissiveAlias), offset)];
    assert_eq!(parts(&emitters([(1.0, 0), (1.0, 1)])), alias(4));
    assert_eq!(
        parts(&emitters([(0.5, 2), (1.5, 1)])),
        [alias(8), alias(16)].concat()
    );
}

#[test]
fn half_texels_are_finite() {
    let (mut scene, mut content) = tiny();
    let image = &mut scene.images[0];
    image.format = cairn_format::TextureFormat::Rgba16Float;
    image.levels[0].length = 16;
    image.levels[1].length = 8;
    content.texels = vec![0; 24];
    content.texels[15] = 0x7c;
    let found = findings(&package(&scene, &content));
    let text: Vec<String> = found.iter().map(Error::to_string).collect();
    assert!(
        matches!(text.as_slice(), [one] if one.contains("section texels, byte 14") && one.contains("texel 1,0")),
        "{text:?}"
    );
}

#[test]
fn every_flip_is_found_and_none_panics() {
    let mut bytes = tiny_bytes();
    for position in 0..bytes.len() {
        for mask in [0x01, 0x80, 0xff] {
            bytes[position] ^= mask;
            let found = findings(&bytes);
            assert!(!found.is_empty(), "byte {position} flipped by {mask:#x}");
            let first = Package::from_bytes(&bytes).and_then(|package| package.verify());
            assert_eq!(
                first.expect_err("damage").to_string(),
                found[0].to_string(),
                "the first finding is that of open and verify"
            );
            bytes[position] ^= mask;
        }
    }
}

#[test]
fn files_are_examined_like_bytes() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("tiny.cairn");
    let mut bytes = tiny_bytes();
    let end = bytes.len() - 1;
    bytes[end] ^= 1;
    std::fs::write(&path, &bytes).expect("a file");
    let mut count = 0;
    let mut found = |_| {
        count += 1;
        Flow::Continue(())
    };
    Package::examine(&path, &mut found).expect("a file that can be read");
    assert!(Package::examine(&folder.path().join("none"), &mut found).is_err());
    std::fs::write(&path, b"text").expect("a file");
    Package::examine(&path, &mut found).expect("a file that can be read");
    assert_eq!(count, 2);
    assert_eq!(size_of::<Header>() as u64, HEADER_BYTES);
}
