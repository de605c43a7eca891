//! Whole bakes: the same bytes every time, and nothing that a scene does not need.

use cairn_bake::Silent;
use cairn_format::{SectionKind, features};
use cairn_tests::{baked, options};

fn bytes_with(threads: usize, scene: &str, sky: Option<&str>) -> Vec<u8> {
    let folder = tempfile::tempdir().expect("a folder");
    let output = folder.path().join("out.cairn");
    let pool = rayon::ThreadPoolBuilder::new()
        .num_threads(threads)
        .build()
        .expect("a pool");
    pool.install(|| cairn_bake::bake(&options(scene, sky, &output), &Silent))
        .expect("a bake");
    std::fs::read(output).expect("the package")
}

#[test]
fn the_same_input_gives_the_same_bytes_at_any_thread_count() {
    for (scene, sky) in [
        ("hall/hall.gltf", None),
        ("materials/materials.gltf", Some("hall/sky.hdr")),
    ] {
        let one = bytes_with(1, scene, sky);
        let four = bytes_with(4, scene, sky);
        assert!(one == four, "{scene}: 1 and 4 threads differ");
    }
}

#[test]
fn an_untextured_box_holds_nothing_but_a_box() {
    let package = baked("box/box.gltf", None);
    let scene = package.scene();
    assert!(scene.images.is_empty() && scene.samplers.is_empty() && scene.textures.is_empty());
    assert!(scene.environment.is_none() && scene.brdf_lut.is_none());
    assert_eq!(scene.features.to_native(), 0);
    for kind in [
        SectionKind::Texels,
        SectionKind::DirectionalLights,
        SectionKind::EnvAlias,
        SectionKind::EmissiveTriangles,
        SectionKind::PunctualLights,
        SectionKind::MaterialExtensions,
    ] {
        assert!(package.entry(kind).is_none(), "section {}", kind.name());
    }
    let vertices = package.vertices().expect("vertices");
    assert_eq!(
        (vertices.len(), package.indices().expect("indices").len()),
        (24, 36)
    );
    assert!(
        vertices
            .iter()
            .all(|vertex| vertex.tangent == [0.0; 4] && vertex.uv1 == [0.0; 2])
    );
}

#[test]
fn lobes_and_lamps_have_sections_where_they_are() {
    let package = baked("lobes/lobes.gltf", None);
    let scene = package.scene();
    let wanted =
        features::CLEARCOAT | features::SPECULAR | features::SHEEN | features::PUNCTUAL_LIGHTS;
    assert_eq!(scene.features.to_native() & wanted, wanted);
    assert_eq!(package.punctual_lights().expect("lights").len(), 3);
    let lobes = package.material_extensions().expect("lobes");
    assert_eq!(lobes.len(), package.materials().expect("materials").len());
    // An index of 1.5 would be no lobe; the ground has none.
    assert_eq!(lobes.iter().filter(|record| record.lobes == 0).count(), 1);
    assert!(scene.brdf_lut.is_some());
    let hall = baked("hall/hall.gltf", None);
    assert_eq!(hall.scene().features.to_native() & wanted, 0);
    for kind in [SectionKind::MaterialExtensions, SectionKind::PunctualLights] {
        assert!(hall.entry(kind).is_none(), "section {}", kind.name());
    }
}

#[test]
fn the_hall_holds_all_that_it_shows() {
    let package = baked("hall/hall.gltf", Some("hall/sky.hdr"));
    let wanted = [
        features::MASK,
        features::BLEND,
        features::DOUBLE_SIDED,
        features::MIRRORED,
        features::NORMAL_MAPS,
        features::EMISSIVE,
        features::ENVIRONMENT,
        features::TEXTURES,
    ];
    let have = package.scene().features.to_native();
    for bit in wanted {
        assert!(
            have & bit != 0,
            "feature {:?} is missing",
            features::names(bit)
        );
    }
    package.verify().expect("a sound package");
    let sources: Vec<&str> = package
        .scene()
        .provenance
        .sources
        .iter()
        .map(|source| source.path.as_str())
        .collect();
    assert!(
        sources.contains(&"hall.gltf") && sources.contains(&"sky.hdr"),
        "{sources:?}"
    );
    assert!(
        sources.iter().all(|path| !path.starts_with('/')),
        "{sources:?}"
    );
    assert!(!package.scene().report.is_empty());
}

/// An extracted picture, read by the player's own reader of OpenEXR.
#[test]
fn extracted_radiance_is_that_of_the_package() {
    use cairn_bake::look::{export, layer};
    let package = baked("box/box.gltf", Some("hall/sky.hdr"));
    let image = &package.scene().images[0];
    let texels = package.texels().expect("texels");
    let bytes = export::exr(image, texels, 2).expect("an OpenEXR");
    let picture = cairn_player::exr::decode(&bytes).expect("a picture");
    let side = image.width.to_native() as usize / 4;
    assert_eq!((picture.width, picture.height), (side, 6 * side));
    for face in 0..6 {
        let plane = layer(image, texels, 2, face as u32);
        let rows = &picture.texels[face * side * side..][..side * side];
        let same = rows.iter().zip(&plane.texels).all(|(a, b)| a[..] == b[..3]);
        assert!(same, "face {face}");
    }
}
