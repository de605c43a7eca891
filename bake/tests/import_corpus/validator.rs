//! What the Khronos validator finds severe, import refuses.

use std::collections::BTreeMap;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::{Path, PathBuf};

use cairn_bake::import::import;

use crate::{assets, files, import_whole};

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
const HARMLESS: [&str; 1] = [
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
pub fn split(bytes: &[u8]) -> (&[u8], Option<&[u8]>) {
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
pub fn join(mut json: String, rest: Option<&[u8]>) -> Vec<u8> {
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

/// Parts of a file that import does not read: animation, skinning and morph targets.
fn is_ignored(pointer: &str) -> bool {
    pointer.starts_with("/animations")
        || pointer.starts_with("/skins")
        || pointer.ends_with("/skin")
        || pointer.contains("/targets/")
}
