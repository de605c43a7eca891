//! Packages round trip, and damaged ones are refused.

mod common;
mod environment;
mod examine;
mod rules;

use cairn_format::header::{ALIGNMENT, FORMAT_VERSION, HEADER_BYTES, PAGE};
use cairn_format::{Error, Package, SectionKind, Writer, scene::Scene};
use common::{tiny, tiny_bytes};

#[test]
fn what_is_written_is_read() {
    let (scene, content) = tiny();
    let package = Package::from_bytes(&tiny_bytes()).expect("a good package");
    package.verify().expect("a sound package");
    assert_eq!(package.vertices().expect("vertices"), content.vertices);
    assert_eq!(package.indices().expect("indices"), content.indices);
    assert_eq!(package.instances().expect("instances"), content.instances);
    assert_eq!(package.materials().expect("materials"), content.materials);
    assert_eq!(
        package.draw_groups().expect("draw groups"),
        content.draw_groups
    );
    assert_eq!(
        package.mesh_instances().expect("mesh instances"),
        content.mesh_instances
    );
    assert_eq!(package.texels().expect("texels"), content.texels);
    let read: Scene =
        rkyv::deserialize::<Scene, rkyv::rancor::BoxedError>(package.scene()).expect("the root");
    assert_eq!(read, scene);
}

#[test]
fn the_same_content_gives_the_same_bytes() {
    assert_eq!(tiny_bytes(), tiny_bytes());
}

/// `UPDATE_GOLDEN=1 cargo test -p cairn-format` accepts new bytes; a change needs a new format version.
#[test]
fn golden_bytes_hold() {
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/golden/tiny.cairn");
    if std::env::var_os("UPDATE_GOLDEN").is_some() {
        std::fs::write(path, tiny_bytes()).expect("the golden file is written");
    }
    let golden = std::fs::read(path).expect("the golden file");
    assert_eq!(
        tiny_bytes(),
        golden,
        "the layout changed: raise FORMAT_VERSION and accept with UPDATE_GOLDEN=1"
    );
}

#[test]
fn files_are_mapped_like_bytes() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("tiny.cairn");
    std::fs::write(&path, tiny_bytes()).expect("a file");
    let package = Package::open(&path).expect("a good file");
    package.verify().expect("a sound file");
    assert_eq!(package.vertices().expect("vertices"), tiny().1.vertices);

    std::fs::OpenOptions::new()
        .write(true)
        .open(&path)
        .and_then(|file| file.set_len(5000))
        .expect("the file is cut");
    assert!(matches!(
        package.vertices(),
        Err(Error::Changed { actual: 5000, .. })
    ));
    assert!(matches!(
        Package::open(&path),
        Err(Error::Length { actual: 5000, .. })
    ));
    assert!(matches!(
        Package::open(&folder.path().join("none")),
        Err(Error::Io { .. })
    ));
}

#[test]
fn every_truncation_is_refused() {
    let bytes = tiny_bytes();
    for length in 0..bytes.len() {
        let error = Package::from_bytes(&bytes[..length]).expect_err("a cut package");
        let expected = matches!(error, Error::Length { .. } | Error::NotAPackage);
        assert!(expected, "{length} bytes: {error}");
    }
    let longer = [bytes.as_slice(), &[0]].concat();
    assert!(matches!(
        Package::from_bytes(&longer),
        Err(Error::Length { .. })
    ));
}

#[test]
fn every_byte_flip_is_refused() {
    let mut bytes = tiny_bytes();
    for position in 0..bytes.len() {
        for mask in [0x01, 0x80, 0xff] {
            bytes[position] ^= mask;
            let accepted = Package::from_bytes(&bytes)
                .and_then(|package| package.verify())
                .is_ok();
            assert!(
                !accepted,
                "byte {position} flipped by {mask:#x} was not noticed"
            );
            bytes[position] ^= mask;
        }
    }
}

#[test]
fn errors_name_section_and_place() {
    let bytes = tiny_bytes();
    let package = Package::from_bytes(&bytes).expect("a good package");
    let row = package.entry(SectionKind::Instances).expect("instances");
    let mut damaged = bytes.clone();
    damaged[row.offset as usize + 5] ^= 1;
    let package = Package::from_bytes(&damaged).expect("open reads no bulk data");
    let error = package.verify().expect_err("damage").to_string();
    assert!(error.contains("section instances"), "{error}");

    let mut newer = bytes;
    let version = FORMAT_VERSION + 1;
    newer[8..12].copy_from_slice(&version.to_le_bytes());
    let error = Package::from_bytes(&newer)
        .expect_err("a newer version")
        .to_string();
    assert!(
        error.contains(&format!("version {version}")) && error.contains("bake the scene again"),
        "{error}"
    );
}

#[test]
fn sections_lie_on_pages_and_levels_on_sixteens() {
    let package = Package::from_bytes(&tiny_bytes()).expect("a good package");
    assert_eq!(package.header().root_offset % ALIGNMENT, 0);
    for entry in package.table() {
        assert_eq!(entry.offset % PAGE, 0);
        let kind = SectionKind::from_u32(entry.kind).expect("a known kind");
        assert_eq!(
            package.section(kind).expect("bytes").as_ptr() as usize % 16,
            0
        );
    }
    for image in package.scene().images.iter() {
        assert!(
            image
                .levels
                .iter()
                .all(|level| level.offset.to_native() % ALIGNMENT == 0)
        );
    }
}

#[test]
fn a_shifted_buffer_is_no_misuse() {
    let bytes = tiny_bytes();
    for shift in 0..17 {
        let mut shifted = vec![0; shift];
        shifted.extend_from_slice(&bytes);
        let package =
            Package::from_bytes(&shifted[shift..]).expect("a good package at any address");
        assert_eq!(package.vertices().expect("vertices"), tiny().1.vertices);
        if shift > 0 {
            assert!(matches!(
                Package::from_bytes(&shifted),
                Err(Error::NotAPackage)
            ));
        }
    }
}

#[test]
fn an_empty_scene_is_only_a_head() {
    let bytes = Writer::new()
        .to_vec(&Scene::empty("nothing"), "0")
        .expect("a package");
    let package = Package::from_bytes(&bytes).expect("a good package");
    package.verify().expect("a sound package");
    assert!(package.table().is_empty() && package.vertices().expect("none").is_empty());
    assert!(bytes.len() < PAGE as usize && bytes.len() as u64 > HEADER_BYTES);
    assert!(package.instance_bounds().expect("no bounds").is_empty());
}
