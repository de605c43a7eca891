//! `diff` names what was changed, how far, and nothing else.

use std::path::Path;

use serde_json::{Value, json};

use super::{asset, baked, json, materials, path, run, text};

/// A copy of the scene of many materials, changed, in a folder of its own.
fn changed(change: impl FnOnce(&mut Value, &Path)) -> (tempfile::TempDir, std::path::PathBuf) {
    let folder = tempfile::tempdir().expect("a folder");
    std::fs::create_dir(folder.path().join("textures")).expect("a folder");
    for name in [
        "materials.bin",
        "textures/leaf.png",
        "textures/studs_normal.png",
        "textures/checker.png",
    ] {
        let from = asset("materials").join(name);
        std::fs::copy(from, folder.path().join(name)).expect("a copy");
    }
    let source = std::fs::read(asset("materials/materials.gltf")).expect("the scene");
    let mut scene: Value = serde_json::from_slice(&source).expect("JSON");
    change(&mut scene, folder.path());
    let file = folder.path().join("materials.gltf");
    std::fs::write(&file, scene.to_string()).expect("a file");
    let (output, package) = baked(&file);
    (output, package)
}

fn names(value: &Value) -> Vec<&str> {
    let rows = value.as_array().expect("a list").iter();
    rows.map(|row| row.as_str().or(row["name"].as_str()).expect("a name"))
        .collect()
}

#[test]
fn equal_packages_are_equal() {
    let (_folder, package) = materials();
    let (_other_folder, other) = materials();
    let done = run(&["diff", path(&package), path(&other)]);
    assert_eq!(done.status.code(), Some(0), "{}", text(&done.stdout));
    assert!(text(&done.stdout).starts_with("equal"));
    assert_eq!(
        json(&run(&["diff", path(&package), path(&other), "--json"]))["equal"],
        true
    );
}

#[test]
fn a_changed_material_is_that_field_alone() {
    let (_folder, package) = materials();
    let (_other_folder, other) = changed(|scene, _| {
        scene["materials"][12]["pbrMetallicRoughness"]["roughnessFactor"] = json!(0.75);
    });
    let done = run(&["diff", path(&package), path(&other)]);
    assert_eq!(done.status.code(), Some(1));
    assert!(
        text(&done.stdout).contains("roughness_factor: 0.4 -> 0.75"),
        "{}",
        text(&done.stdout)
    );
    let found = json(&run(&["diff", path(&package), path(&other), "--json"]));
    assert_eq!(names(&found["materials"]["changed"]), ["studs"]);
    assert_eq!(names(&found["sections"]), ["materials"]);
    for kind in ["meshes", "images", "instances", "lights", "cameras"] {
        for change in ["added", "removed", "changed"] {
            assert!(
                names(&found[kind][change]).is_empty(),
                "{kind} {change}: {found}"
            );
        }
    }
    assert_eq!(names(&found["sources"]["changed"]), ["materials.gltf"]);
}

#[test]
fn moved_vertices_are_measured() {
    let (_folder, package) = materials();
    let (_other_folder, other) = changed(|scene, folder| {
        // The corners of the quad that six meshes share; its node moves too.
        let accessor = &scene["accessors"][4];
        let view = &scene["bufferViews"][accessor["bufferView"].as_u64().expect("a view") as usize];
        let start = |value: &Value| value["byteOffset"].as_u64().unwrap_or(0) as usize;
        let at = start(accessor) + start(view);
        let mut bytes = std::fs::read(folder.join("materials.bin")).expect("the buffer");
        let x = f32::from_le_bytes([bytes[at], bytes[at + 1], bytes[at + 2], bytes[at + 3]]);
        bytes[at..at + 4].copy_from_slice(&(x + x.signum() * 0.25).to_le_bytes());
        std::fs::write(folder.join("materials.bin"), bytes).expect("the buffer");
        scene["nodes"][12]["translation"] = json!([0.0, -0.55, 0.5]);
    });
    let found = json(&run(&["diff", path(&package), path(&other), "--json"]));
    let masked = found["meshes"]["changed"].as_array().expect("meshes");
    let masked = masked
        .iter()
        .find(|row| row["name"] == "masked")
        .expect("the masked quad");
    assert!(
        (masked["largest_move"].as_f64().expect("a move") - 0.25).abs() < 1e-6,
        "{masked}"
    );
    assert!(
        (masked["bounds_move"].as_f64().expect("a move") - 0.25).abs() < 1e-6,
        "{masked}"
    );
    assert_eq!(masked["vertices"], json!([4, 4]));
    let instances = &found["instances"]["changed"];
    assert_eq!(names(instances), ["studs"]);
    assert_eq!(instances[0]["largest_move"], 0.5);
    // Spheres keep their vertices.
    assert!(!names(&found["meshes"]["changed"]).contains(&"metallic 0 roughness 0"));
}

#[test]
fn textures_are_compared_by_their_texels() {
    let (_folder, package) = materials();
    let (_other_folder, other) = changed(|scene, folder| {
        let file = folder.join("textures/leaf.png");
        let mut leaf = image::open(&file).expect("the leaf").to_rgba8();
        leaf.get_pixel_mut(64, 64).0 = [255, 0, 255, 255];
        leaf.save(&file).expect("a picture");
        scene["images"][1]["name"] = json!("renamed");
    });
    let found = json(&run(&["diff", path(&package), path(&other), "--json"]));
    let images = &found["images"];
    assert_eq!(names(&images["added"]), ["renamed (normal)"]);
    assert_eq!(names(&images["removed"]), ["studs_normal (normal)"]);
    assert_eq!(names(&images["changed"]), ["leaf (color)"]);
    let psnr = images["changed"][0]["texels"]["psnr_db"]
        .as_f64()
        .expect("a PSNR");
    // One texel of 128 x 128, its block about it: more than nothing, less than a scratch.
    assert!((25.0..70.0).contains(&psnr), "{psnr}");
    assert_eq!(names(&found["materials"]["changed"]), ["studs"]);
    assert_eq!(
        found["materials"]["changed"][0]["fields"][0]["field"],
        "textures.0.image"
    );
}

#[test]
fn meshes_come_and_go() {
    let (_folder, package) = materials();
    let (_other_folder, other) = changed(|scene, _| {
        scene["meshes"][0]["name"] = json!("another sphere");
        let nodes = scene["nodes"].as_array_mut().expect("nodes");
        nodes[13].as_object_mut().expect("a node").remove("mesh");
    });
    let found = json(&run(&["diff", path(&package), path(&other), "--json"]));
    assert_eq!(names(&found["meshes"]["added"]), ["another sphere"]);
    assert_eq!(
        names(&found["meshes"]["removed"]),
        ["metallic 0 roughness 0"]
    );
    assert_eq!(
        names(&found["instances"]["removed"]),
        ["metallic 0 roughness 0", "studs (2)"]
    );
    let features = found["fields"].as_array().expect("fields").iter();
    assert!(
        features.clone().any(|row| row["field"] == "features"),
        "no mirrored instance is left"
    );
}

#[test]
fn what_cannot_be_compared_is_an_error() {
    let (folder, package) = materials();
    let damaged = folder.path().join("damaged.cairn");
    let mut bytes = std::fs::read(&package).expect("the package");
    *bytes.last_mut().expect("a byte") ^= 1;
    std::fs::write(&damaged, bytes).expect("a file");
    let done = run(&["diff", path(&package), path(&damaged)]);
    assert_eq!(done.status.code(), Some(2));
    assert!(
        text(&done.stderr).contains("damaged.cairn"),
        "{}",
        text(&done.stderr)
    );
}
