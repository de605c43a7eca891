//! Imports every scene of the shared asset collection: nothing may panic, hang or be wrongly refused.

mod validator;

use std::collections::BTreeMap;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use cairn_bake::import::{decode_image, import, load_environment};
use cairn_bake::scene::{Material, Mesh, Scene, UvTransform};
use cairn_bake::{BakeError, Diagnostic};
use validator::{join, split};

const LIMIT_PIXELS: u64 = 1 << 26;

/// Scenes whose files are legal glTF 2.0.
const CONFORMING: [&str; 11] = [
    "asset-generator-0.6",
    "khronos",
    "babylon",
    "folio-2025",
    "gltf-transform",
    "renderling",
    "webxr-samples",
    "blender-io-roundtrip",
    "derived",
    "3d-demo-data",
    "realism-effects",
];

fn assets() -> Option<PathBuf> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../shared/assets");
    if folder.is_dir() {
        return Some(folder);
    }
    eprintln!("SKIPPED: {} is absent", folder.display());
    None
}

/// Every file below `folder` with one of the extensions, sorted.
fn files(folder: &Path, extensions: &[&str]) -> Vec<PathBuf> {
    let mut found = Vec::new();
    let mut folders = vec![folder.to_owned()];
    while let Some(folder) = folders.pop() {
        let Ok(entries) = std::fs::read_dir(&folder) else {
            eprintln!("SKIPPED: {} is absent", folder.display());
            continue;
        };
        for path in entries.map(|entry| entry.expect("readable folder").path()) {
            if path.is_dir() {
                folders.push(path);
            } else if path
                .extension()
                .is_some_and(|e| extensions.iter().any(|x| e.eq_ignore_ascii_case(x)))
            {
                found.push(path);
            }
        }
    }
    found.sort();
    found
}

/// Imports one scene and decodes its images, guarding against panics and slowness.
fn import_whole(path: &Path) -> Result<Scene, BakeError> {
    let start = Instant::now();
    let result = catch_unwind(AssertUnwindSafe(|| {
        let scene = import(path)?;
        for image in &scene.images {
            decode_image(image, LIMIT_PIXELS)?;
        }
        Ok(scene)
    }))
    .unwrap_or_else(|_| panic!("{} panicked", path.display()));
    let elapsed = start.elapsed();
    assert!(
        elapsed < Duration::from_secs(60),
        "{} took {elapsed:?}",
        path.display()
    );
    if let Ok(scene) = &result {
        check_invariants(path, scene);
    }
    result
}

/// What `cairn_bake::scene` promises.
fn check_invariants(path: &Path, scene: &Scene) {
    let place = path.display();
    for primitive in scene.meshes.iter().flat_map(|mesh| &mesh.primitives) {
        let vertices = primitive.positions.len();
        assert!(primitive.indices.len().is_multiple_of(3), "{place}");
        assert!(
            primitive.indices.iter().all(|&i| (i as usize) < vertices),
            "{place}"
        );
        assert!(
            primitive
                .positions
                .as_flattened()
                .iter()
                .all(|v| v.is_finite()),
            "{place}"
        );
        let lengths = [
            primitive.normals.as_ref().map(Vec::len),
            primitive.tangents.as_ref().map(Vec::len),
            primitive.uv0.as_ref().map(Vec::len),
            primitive.uv1.as_ref().map(Vec::len),
            primitive.colors.as_ref().map(Vec::len),
        ];
        assert!(
            lengths
                .into_iter()
                .flatten()
                .all(|length| length == vertices),
            "{place}"
        );
        let material = primitive.material.map_or(0, |index| index as usize + 1);
        assert!(material <= scene.materials.len(), "{place}");
    }
    for instance in &scene.instances {
        assert!((instance.mesh as usize) < scene.meshes.len(), "{place}");
        assert!(instance.world.is_finite(), "{place}");
    }
    for material in &scene.materials {
        for slot in [
            material.base_color_texture,
            material.metallic_roughness_texture,
            material.normal_texture,
            material.occlusion_texture,
            material.emissive_texture,
            material.lobes.clearcoat_texture,
            material.lobes.clearcoat_roughness_texture,
            material.lobes.clearcoat_normal_texture,
            material.lobes.specular_texture,
            material.lobes.specular_color_texture,
            material.lobes.sheen_color_texture,
            material.lobes.sheen_roughness_texture,
        ] {
            assert!(
                slot.is_none_or(|s| (s.texture as usize) < scene.textures.len()),
                "{place}"
            );
        }
    }
    for texture in &scene.textures {
        assert!((texture.image as usize) < scene.images.len(), "{place}");
        assert!(
            texture
                .sampler
                .is_none_or(|s| (s as usize) < scene.samplers.len()),
            "{place}"
        );
    }
    assert_eq!(
        scene.sources[0].path,
        path.file_name().unwrap().to_string_lossy()
    );
}

fn diagnostic(error: &BakeError) -> Diagnostic {
    match error {
        BakeError::Input(diagnostic) => diagnostic.clone(),
        other => panic!("{other}"),
    }
}

/// Conforming scenes that are refused, with the code and a word of the message.
const REFUSED: [(&str, &str, &str); 2] = [
    ("Compatibility_04.gltf", "gltf-version", "2.1"),
    (
        "Compatibility_05.gltf",
        "extension-required",
        "FAKE_materials_quantumRendering",
    ),
];

#[test]
fn conforming_scenes_import_or_are_refused_for_a_listed_reason() {
    let Some(assets) = assets() else { return };
    let (mut imported, mut wrong) = (0, Vec::new());
    println!("verdict              meshes instances triangles    ms  scene: warnings");
    for folder in CONFORMING {
        for path in files(&assets.join(folder), &["gltf", "glb"]) {
            let relative = path.strip_prefix(&assets).unwrap_or(&path);
            let start = Instant::now();
            let result = import_whole(&path);
            let ms = start.elapsed().as_millis();
            let listed = REFUSED.iter().find(|(name, ..)| relative.ends_with(name));
            match (&result, listed) {
                (Ok(scene), None) => {
                    imported += 1;
                    println!("{} {ms:5}  {}", counts(scene), row(relative, scene));
                }
                (Err(error), Some((_, code, word)))
                    if diagnostic(error).code == *code && error.to_string().contains(word) =>
                {
                    println!("{code:20} {word}: {}", relative.display());
                }
                (Ok(_), Some(_)) => wrong.push(format!("{} imported", relative.display())),
                (Err(error), _) => wrong.push(error.to_string()),
            }
        }
    }
    println!("{imported} imported, {} refused as listed", REFUSED.len());
    assert!(wrong.is_empty(), "{wrong:#?}");
    assert!(imported > 80, "{imported}");
}

fn triangles(scene: &Scene) -> usize {
    let of = |mesh: &Mesh| {
        mesh.primitives
            .iter()
            .map(|p| p.indices.len() / 3)
            .sum::<usize>()
    };
    let instances = scene.instances.iter();
    instances
        .map(|instance| of(&scene.meshes[instance.mesh as usize]))
        .sum()
}

fn counts(scene: &Scene) -> String {
    format!(
        "imported             {:6} {:9} {:9}",
        scene.meshes.len(),
        scene.instances.len(),
        triangles(scene)
    )
}

fn row(path: &Path, scene: &Scene) -> String {
    let codes: Vec<&str> = scene.diagnostics.iter().map(|d| d.code).collect();
    format!("{}: {}", path.display(), codes.join(" "))
}

/// Imports a shared scene of which a table of counts is known.
fn shared(assets: &Path, path: &str) -> Scene {
    let start = Instant::now();
    let scene = import(&assets.join(path)).unwrap_or_else(|error| panic!("{error}"));
    println!("{path}: {:?}", start.elapsed());
    scene
}

#[test]
fn extensions_are_decoded_to_the_known_counts() {
    let Some(assets) = assets() else { return };
    let check = |path: &str, instances: usize, expected: usize| {
        let scene = shared(&assets, path);
        assert_eq!(scene.instances.len(), instances, "{path}");
        assert_eq!(triangles(&scene), expected, "{path}");
        scene
    };
    check(
        "3d-demo-data/dream-apartment/dream-apartment.glb",
        1,
        177_934,
    );
    check("khronos/SimpleInstancing/simple-instancing.glb", 125, 1500);
    check("babylon/TeapotsGalore/TeapotsGalore.gltf", 1900, 7_656_770);
    check("khronos/AnimatedMorphCube/AnimatedMorphCube.gltf", 1, 12);
    let plain = check("khronos/Box/Box.gltf", 1, 12);
    for path in [
        "khronos/BoxMeshopt/BoxMeshopt.glb",
        "khronos/BoxDraco/BoxDraco.gltf",
    ] {
        let scene = check(path, 1, 12);
        assert_eq!(bounds(&scene), bounds(&plain), "{path}");
    }
    let colors = shared(&assets, "khronos/VertexColorTest/VertexColorTest.glb");
    let primitives = || colors.meshes.iter().flat_map(|mesh| &mesh.primitives);
    assert!(primitives().any(|primitive| primitive.colors.is_some()));
    let transforms = shared(
        &assets,
        "khronos/TextureTransformTest/TextureTransformTest.gltf",
    );
    let moved = |m: &Material| {
        let texture = m.base_color_texture.expect("textured");
        texture.transform != UvTransform::IDENTITY
    };
    assert_eq!(transforms.materials.iter().filter(|m| moved(m)).count(), 6);
    let uvs = shared(&assets, "khronos/MultiUVTest/MultiUVTest.gltf");
    assert!(uvs.meshes[0].primitives[0].uv1.is_some());
}

/// World bounds of all vertices, rounded to a thousandth.
fn bounds(scene: &Scene) -> [[i64; 3]; 2] {
    let mut bounds = [[i64::MAX; 3], [i64::MIN; 3]];
    for instance in &scene.instances {
        for primitive in &scene.meshes[instance.mesh as usize].primitives {
            for position in &primitive.positions {
                let local = position.map(f64::from);
                let world = instance.world.transform_point3(local.into()).to_array();
                for (axis, value) in world.into_iter().enumerate() {
                    let value = (value * 1000.0).round() as i64;
                    bounds[0][axis] = bounds[0][axis].min(value);
                    bounds[1][axis] = bounds[1][axis].max(value);
                }
            }
        }
    }
    bounds
}

#[test]
fn strips_and_fans_cover_the_same_square_as_lists() {
    let Some(assets) = assets() else { return };
    for number in [4, 5, 6, 11, 12, 13, 14, 15] {
        let path =
            format!("asset-generator-0.6/Mesh_PrimitiveMode/Mesh_PrimitiveMode_{number:02}.gltf");
        let scene = shared(&assets, &path);
        assert_eq!(triangles(&scene), 2, "{path}");
        let primitive = &scene.meshes[0].primitives[0];
        for triangle in primitive.indices.chunks(3) {
            let [a, b, c] = [0, 1, 2].map(|i| primitive.positions[triangle[i] as usize]);
            let area = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]);
            assert!(area > 0.0, "{path}");
        }
    }
}

/// Imports a `.glb` as if none of its extensions were required: without its textures.
fn geometry_of(path: &Path) -> Scene {
    let bytes = std::fs::read(path).expect("readable scene");
    let (json, rest) = split(&bytes);
    let text = std::str::from_utf8(json).expect("imported before");
    let optional = text.replace("\"extensionsRequired\"", "\"extensionsRemarked\"");
    let folder = tempfile::tempdir().expect("a temporary folder");
    let copy = folder.path().join("optional.glb");
    std::fs::write(&copy, join(optional, rest)).expect("written");
    let start = Instant::now();
    let scene = import(&copy).unwrap_or_else(|error| panic!("{}: {error}", path.display()));
    println!("{}: {:?}", path.display(), start.elapsed());
    check_invariants(&copy, &scene);
    scene
}

#[test]
fn draco_geometry_equals_the_plain_export() {
    let Some(assets) = assets() else { return };
    let draco = geometry_of(&assets.join("realism-effects/chevrolet/chevrolet.optimized.glb"));
    let plain = shared(&assets, "derived/chevrolet-plain-png/chevrolet.glb");
    assert_eq!(draco.meshes.len(), plain.meshes.len());
    for (draco, plain) in draco.meshes.iter().zip(&plain.meshes) {
        assert_eq!(draco.name, plain.name);
        assert_eq!(draco.primitives.len(), plain.primitives.len());
        for (a, b) in draco.primitives.iter().zip(&plain.primitives) {
            // The plain export holds what Google's decoder made of the same data.
            assert_eq!(a.positions, b.positions, "{}", draco.name);
            assert_eq!(a.normals, b.normals, "{}", draco.name);
            assert_eq!((&a.uv0, &a.uv1), (&b.uv0, &b.uv1), "{}", draco.name);
            assert_eq!(a.indices, b.indices, "{}", draco.name);
        }
    }
    assert_eq!(triangles(&draco), 263_683);
}

#[test]
fn draco_meshes_of_a_whole_scene_cover_what_the_plain_ones_do() {
    let Some(assets) = assets() else { return };
    let draco = geometry_of(&assets.join("folio-2025/areas-draco-ktx2/areas-compressed.glb"));
    let plain = shared(&assets, "folio-2025/areas/areas.glb");
    println!("{} and {} triangles", triangles(&draco), triangles(&plain));
    // Draco's quantisation and its dropping of degenerate triangles.
    assert!(triangles(&draco).abs_diff(triangles(&plain)) < 100);
    let [found, expected] = [bounds(&draco), bounds(&plain)];
    for (found, expected) in found.as_flattened().iter().zip(expected.as_flattened()) {
        assert!((found - expected).abs() < 30, "{found} {expected}");
    }
    assert_eq!(draco.meshes.len(), plain.meshes.len());
    assert_eq!(draco.instances.len(), plain.instances.len());
}

#[test]
fn adversarial_scenes_never_panic() {
    let Some(assets) = assets() else { return };
    let mut verdicts = BTreeMap::new();
    for path in files(&assets.join("adversarial"), &["gltf", "glb"]) {
        let verdict = match import_whole(&path) {
            Ok(_) => "imported",
            Err(error) => {
                let fault = diagnostic(&error);
                assert!(!fault.file.is_empty() && !fault.message.is_empty());
                fault.code
            }
        };
        *verdicts.entry(verdict).or_insert(0) += 1;
        let relative = path.strip_prefix(&assets).unwrap_or(&path);
        eprintln!("{verdict:26} {}", relative.display());
    }
    eprintln!("{verdicts:#?}");
    // The other tests of this process share the figure, so it is an upper bound.
    if let Some(peak) = cairn_bake::peak::peak_memory() {
        println!("peak memory {} MiB", peak >> 20);
        assert!(peak < 1 << 30, "{peak} bytes");
    }
}

#[test]
fn environments_load() {
    let Some(assets) = assets() else { return };
    let mut loaded = 0;
    for path in files(&assets, &["hdr", "exr"]) {
        match load_environment(&path) {
            Ok(image) => {
                assert_eq!(
                    image.texels.len() as u64,
                    u64::from(image.width) * u64::from(image.height)
                );
                let values = image.texels.as_flattened();
                let largest = values.iter().copied().fold(0.0, f32::max);
                let luminance = |t: &[f32; 3]| {
                    0.2126 * f64::from(t[0]) + 0.7152 * f64::from(t[1]) + 0.0722 * f64::from(t[2])
                };
                // Weighted by the solid angle of each row.
                let (mut sum, mut weights) = (0.0, 0.0);
                for (row, texels) in image.texels.chunks(image.width as usize).enumerate() {
                    let polar = (row as f64 + 0.5) / f64::from(image.height) * std::f64::consts::PI;
                    sum += polar.sin() * texels.iter().map(luminance).sum::<f64>();
                    weights += polar.sin() * f64::from(image.width);
                }
                let mean = sum / weights;
                eprintln!(
                    "{}: {}x{} largest {largest} mean luminance {mean:.3} {:?}",
                    path.display(),
                    image.width,
                    image.height,
                    image.diagnostics
                );
                loaded += 1;
            }
            Err(error) => eprintln!("{error}"),
        }
    }
    assert!(loaded >= 7, "{loaded}");
}

#[test]
#[ignore = "prints figures of the real scenes; run with --ignored --nocapture"]
fn figures_of_real_scenes() {
    let Some(assets) = assets() else { return };
    for name in [
        "khronos/FlightHelmet/FlightHelmet.gltf",
        "khronos/BoomBox-jpg/BoomBox.gltf",
        "folio-2025/areas/areas.glb",
        "derived/chevrolet-plain-png/chevrolet.glb",
        "renderling/marble_bust_1k/marble_bust_1k.glb",
        "babylon/cornellBox/cornellBox.glb",
        "khronos/AlphaBlendModeTest/AlphaBlendModeTest.gltf",
        "khronos/NormalTangentTest/NormalTangentTest.glb",
        "khronos/OrientationTest/OrientationTest.glb",
        "khronos/BoxInterleaved/BoxInterleaved.glb",
        "khronos/TextureSettingsTest/TextureSettingsTest.gltf",
        "gltf-transform/many-cubes/many-cubes.gltf",
    ] {
        let start = Instant::now();
        let scene = import(&assets.join(name)).unwrap_or_else(|error| panic!("{error}"));
        let elapsed = start.elapsed();
        let primitives = || scene.meshes.iter().flat_map(|mesh| &mesh.primitives);
        let triangles: usize = primitives().map(|p| p.indices.len() / 3).sum();
        println!(
            "{name}: {triangles} triangles, {} meshes, {} primitives, {} instances, {} materials, \
             {} textures, {} images, {} warnings, {elapsed:.1?}",
            scene.meshes.len(),
            primitives().count(),
            scene.instances.len(),
            scene.materials.len(),
            scene.textures.len(),
            scene.images.len(),
            scene.diagnostics.len(),
        );
        for warning in &scene.diagnostics {
            println!("    {warning}");
        }
    }
}
