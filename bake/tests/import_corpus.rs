//! Imports every scene of the shared asset collection: nothing may panic, hang or be wrongly refused.

use std::collections::BTreeMap;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use cairn_bake::import::{decode_image, import, load_environment};
use cairn_bake::scene::Scene;
use cairn_bake::{BakeError, Diagnostic};

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

#[test]
fn conforming_scenes_import_or_name_a_required_extension() {
    let Some(assets) = assets() else { return };
    let mut imported = 0;
    for folder in CONFORMING {
        for path in files(&assets.join(folder), &["gltf", "glb"]) {
            match import_whole(&path) {
                Ok(_) => imported += 1,
                Err(error) => {
                    let code = diagnostic(&error).code;
                    let named =
                        ["extension-required", "gltf-version", "draco-only"].contains(&code);
                    assert!(named, "{}: {error}", path.display());
                    eprintln!("{}: {error}", path.display());
                }
            }
        }
    }
    eprintln!("{imported} conforming scenes imported");
    assert!(imported > 80, "{imported}");
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
}

/// Validator errors after which a renderer would follow a bad reference.
const SEVERE: [&str; 14] = [
    "ACCESSOR_TOO_LONG",
    "ACCESSOR_SMALL_BYTESTRIDE",
    "ACCESSOR_INDEX_OOB",
    "ACCESSOR_INDEX_PRIMITIVE_RESTART",
    "ACCESSOR_SPARSE_INDEX_OOB",
    "ACCESSOR_SPARSE_COUNT_OUT_OF_RANGE",
    "ACCESSOR_SPARSE_INDICES_NON_INCREASING",
    "BUFFER_VIEW_TOO_LONG",
    "BUFFER_BYTE_LENGTH_MISMATCH",
    "BUFFER_GLB_CHUNK_TOO_BIG",
    "MESH_PRIMITIVE_UNEQUAL_ACCESSOR_COUNT",
    "NODE_LOOP",
    "NODE_PARENT_OVERRIDE",
    "UNRESOLVED_REFERENCE",
];

/// Scenes whose severe error sits in data that import never follows.
const HARMLESS: [&str; 2] = [
    // Only COLOR_0, which is not read, has another count.
    "mesh/accessor_unequal_count.gltf",
    // The texture has no image, so its sampler is not looked at.
    "texture/unresolved_sampler.gltf",
];

#[test]
fn what_the_khronos_validator_finds_severe_is_refused() {
    let Some(assets) = assets() else { return };
    let mut tally: BTreeMap<String, (u32, u32)> = BTreeMap::new();
    let mut wrong = Vec::new();
    for path in files(
        &assets.join("adversarial/khronos-validator"),
        &["gltf", "glb"],
    ) {
        let codes = validator_errors(&path);
        let accepted = import_whole(&path).is_ok() && import_exposed(&path);
        for code in &codes {
            let (accept, refuse) = tally.entry(code.clone()).or_default();
            *(if accepted { accept } else { refuse }) += 1;
        }
        let severe = codes.iter().find(|code| SEVERE.contains(&code.as_str()));
        let harmless = HARMLESS.iter().any(|name| path.ends_with(name));
        if let (true, false, Some(code)) = (accepted, harmless, severe) {
            wrong.push(format!("{code}: {}", path.display()));
        }
    }
    for (code, (accepted, refused)) in &tally {
        eprintln!("{accepted:4} accepted {refused:4} refused  {code}");
    }
    for line in &wrong {
        eprintln!("{line}");
    }
    assert!(
        wrong.is_empty(),
        "{} severely broken scenes accepted",
        wrong.len()
    );
}

/// Whether a scene still imports once every mesh, material, texture, image and accessor of it is
/// reachable from its nodes; most of the validator's cases are not.
fn import_exposed(path: &Path) -> bool {
    let bytes = std::fs::read(path).expect("readable scene");
    let (json, rest) = split(&bytes);
    let mut root: serde_json::Value = serde_json::from_slice(json).expect("imported before");
    expose(&mut root);
    let folder = tempfile::tempdir().expect("a temporary folder");
    for entry in std::fs::read_dir(path.parent().expect("a folder")).expect("readable") {
        let entry = entry.expect("readable").path();
        let name = entry.file_name().expect("named");
        if entry.is_file() && entry.extension().is_none_or(|e| e != "gltf" && e != "json") {
            std::fs::copy(&entry, folder.path().join(name)).expect("copied");
        }
    }
    let exposed = folder.path().join("exposed");
    std::fs::write(&exposed, join(root.to_string(), rest)).expect("written");
    match catch_unwind(AssertUnwindSafe(|| import(&exposed))) {
        Ok(result) => result.is_ok(),
        Err(_) => panic!("{} panicked when exposed", path.display()),
    }
}

/// The JSON of a scene that imports, with the chunks after it where it is a `.glb`.
fn split(bytes: &[u8]) -> (&[u8], Option<&[u8]>) {
    if !bytes.starts_with(b"glTF") {
        return (bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(bytes), None);
    }
    let length = u32::from_le_bytes(bytes[12..16].try_into().expect("four bytes"));
    let (json, rest) = bytes[20..].split_at(length as usize);
    (
        json.strip_prefix(b"\xef\xbb\xbf").unwrap_or(json),
        Some(rest),
    )
}

/// The reverse of `split`.
fn join(mut json: String, rest: Option<&[u8]>) -> Vec<u8> {
    let Some(rest) = rest else {
        return json.into_bytes();
    };
    while !json.len().is_multiple_of(4) {
        json.push(' ');
    }
    let total = (20 + json.len() + rest.len()) as u32;
    let mut bytes = b"glTF\x02\0\0\0".to_vec();
    bytes.extend(total.to_le_bytes());
    bytes.extend((json.len() as u32).to_le_bytes());
    bytes.extend(b"JSON");
    bytes.extend(json.as_bytes());
    bytes.extend(rest);
    bytes
}

/// Adds nodes, meshes, materials, textures, images and views until everything is used.
fn expose(root: &mut serde_json::Value) {
    for part in ["scene", "scenes", "nodes"] {
        root.as_object_mut().expect("an object").remove(part);
    }
    let count = |root: &serde_json::Value, name: &str| root[name].as_array().map_or(0, Vec::len);
    let push = |root: &mut serde_json::Value, name: &str, value| {
        let members = root.as_object_mut().expect("an object");
        let list = members.entry(name).or_insert_with(|| serde_json::json!([]));
        list.as_array_mut().expect("an array").push(value);
    };
    for buffer in 0..count(root, "buffers") {
        let view = serde_json::json!({"buffer": buffer, "byteLength": 0});
        push(root, "bufferViews", view);
    }
    for view in 0..count(root, "bufferViews") {
        push(root, "images", serde_json::json!({"bufferView": view}));
    }
    for image in 0..count(root, "images") {
        push(root, "textures", serde_json::json!({"source": image}));
    }
    for texture in 0..count(root, "textures") {
        let slot = serde_json::json!({"index": texture});
        push(
            root,
            "materials",
            serde_json::json!({"emissiveTexture": slot}),
        );
    }
    let accessors = count(root, "accessors");
    if accessors == 0 && count(root, "materials") == 0 {
        // A new accessor would make a dangling reference good.
        return expose_meshes(root);
    }
    let zeros = serde_json::json!({"componentType": 5126, "type": "VEC3", "count": 3});
    push(root, "accessors", zeros);
    for material in 0..count(root, "materials") {
        let primitive =
            serde_json::json!({"attributes": {"POSITION": accessors}, "material": material});
        push(
            root,
            "meshes",
            serde_json::json!({"primitives": [primitive]}),
        );
    }
    let indices = serde_json::json!({"componentType": 5121, "type": "SCALAR", "count": 3});
    push(root, "accessors", indices);
    for accessor in 0..accessors {
        // Any other type is refused for that reason alone, which would prove nothing.
        let mut copy = root["accessors"][accessor].clone();
        copy["type"] = "VEC3".into();
        copy["componentType"] = 5126.into();
        let attributes = serde_json::json!({"POSITION": count(root, "accessors")});
        push(root, "accessors", copy);
        let primitive = serde_json::json!({"attributes": attributes, "indices": accessors + 1});
        push(
            root,
            "meshes",
            serde_json::json!({"primitives": [primitive]}),
        );
    }
    expose_meshes(root);
}

/// Adds a node for every mesh.
fn expose_meshes(root: &mut serde_json::Value) {
    let meshes = root["meshes"].as_array().map_or(0, Vec::len);
    let nodes: Vec<serde_json::Value> = (0..meshes)
        .map(|mesh| serde_json::json!({"mesh": mesh}))
        .collect();
    root["nodes"] = nodes.into();
}

/// Error codes of the validator's report beside a scene.
fn validator_errors(path: &Path) -> Vec<String> {
    let report = PathBuf::from(format!("{}.report.json", path.display()));
    let Ok(text) = std::fs::read(&report) else {
        return Vec::new();
    };
    let json: serde_json::Value = serde_json::from_slice(&text).expect("a report is JSON");
    let messages = json["issues"]["messages"]
        .as_array()
        .cloned()
        .unwrap_or_default();
    let errors = messages.iter().filter(|message| {
        let pointer = message["pointer"].as_str().unwrap_or_default();
        message["severity"] == 0 && !is_ignored(pointer)
    });
    let mut codes: Vec<String> = errors
        .filter_map(|message| message["code"].as_str().map(str::to_owned))
        .collect();
    codes.sort();
    codes.dedup();
    codes
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

/// Parts of a file that import does not read: animation, skinning and morph targets.
fn is_ignored(pointer: &str) -> bool {
    pointer.starts_with("/animations")
        || pointer.starts_with("/skins")
        || pointer.ends_with("/skin")
        || pointer.contains("/targets/")
}
