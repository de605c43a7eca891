//! `inspect`, `verify`, `diff` and `extract` on packages of our own scenes: what they print, their exit codes.

mod diff;
mod extract;
mod report;

use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use cairn_bake::{Options, Silent, bake};
use serde_json::Value;

fn run(arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_cairn-bake"))
        .args(arguments)
        .output()
        .expect("cairn-bake runs")
}

fn text(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}

fn path(path: &Path) -> &str {
    path.to_str().expect("a UTF-8 path")
}

fn json(output: &Output) -> Value {
    serde_json::from_slice(&output.stdout)
        .unwrap_or_else(|error| panic!("{error}: {}{}", text(&output.stdout), text(&output.stderr)))
}

fn asset(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("../assets")
        .join(name)
}

/// A folder, and in it the package of a scene file.
fn baked(scene: &Path) -> (tempfile::TempDir, PathBuf) {
    let folder = tempfile::tempdir().expect("a folder");
    let output = folder.path().join("scene.cairn");
    bake(&Options::new(scene, &output), &Silent).expect("a bake");
    (folder, output)
}

fn materials() -> (tempfile::TempDir, PathBuf) {
    baked(&asset("materials/materials.gltf"))
}

#[test]
fn what_is_inside_is_shown() {
    let (_folder, package) = materials();
    let shown = run(&["inspect", path(&package)]);
    let tree = text(&shown.stdout);
    assert!(shown.status.success() && shown.stderr.is_empty());
    for part in [
        "meshes (20)",
        "materials (20)",
        "\u{2514}\u{2500} 2 triangles, 4 vertices, masked, not opaque",
        "base_color_tex          checker, second coordinates",
        "color Bc7Srgb, 128x128, 8 levels, 21.9 kB",
        "features: mask, blend",
        "materials.gltf",
    ] {
        assert!(tree.contains(part), "`{part}` in {tree}");
    }
    assert!(
        !tree.contains('\x1b'),
        "no colours where there is no terminal"
    );
    let pictures = text(&run(&["inspect", path(&package), "--thumbnails", "always"]).stdout);
    // 20 by 10 characters each of five images.
    assert_eq!(pictures.matches('\u{2580}').count(), 5 * 200);
    let few = text(&run(&["inspect", path(&package), "--rows", "2"]).stdout);
    assert!(few.contains("and 18 more"), "{few}");
}

#[test]
fn machines_read_the_same() {
    let (_folder, package) = materials();
    let contents = json(&run(&["inspect", path(&package), "--json"]));
    assert_eq!(contents["meshes"].as_array().map(Vec::len), Some(20));
    assert_eq!(contents["triangles"], 22_100);
    assert_eq!(
        contents["bytes"],
        std::fs::metadata(&package).expect("a file").len()
    );
    let leaf = &contents["images"][0];
    assert_eq!(
        (&leaf["name"], &leaf["levels"]),
        (&"leaf".into(), &8.into())
    );
    assert!(
        leaf["errors"]
            .as_array()
            .is_some_and(|rows| rows.iter().any(|row| row["metric"] == "psnr dB"))
    );

    let rows = text(&run(&["inspect", path(&package), "--deps"]).stdout);
    let listed = rows
        .lines()
        .find(|line| line.ends_with("  textures/leaf.png"))
        .expect("the leaf");
    let leaf = std::fs::read(asset("materials/textures/leaf.png")).expect("the file");
    assert!(
        listed.starts_with(blake3::hash(&leaf).to_hex().as_str()),
        "{listed}"
    );
    let sources = json(&run(&["inspect", path(&package), "--deps", "--json"]));
    assert_eq!(sources.as_array().map(Vec::len), Some(rows.lines().count()));
}

#[test]
fn damage_is_found_and_named() {
    let (folder, package) = materials();
    let sound = run(&["verify", path(&package)]);
    assert!(sound.status.success() && text(&sound.stdout).ends_with("sound\n"));

    let contents = json(&run(&["inspect", path(&package), "--json"]));
    let section = |name: &str| {
        let rows = contents["sections"].as_array().expect("sections");
        let row = rows
            .iter()
            .find(|row| row["name"] == name)
            .expect("the section");
        row["offset"].as_u64().expect("an offset") as usize
    };
    let mut bytes = std::fs::read(&package).expect("the package");
    let (vertices, indices) = (section("vertices"), section("indices"));
    bytes[vertices + 56..][..4].copy_from_slice(&f32::NAN.to_le_bytes());
    bytes[indices + 8..][..4].copy_from_slice(&u32::MAX.to_le_bytes());
    let damaged = folder.path().join("damaged.cairn");
    std::fs::write(&damaged, &bytes).expect("a file");

    let first = run(&["verify", path(&damaged)]);
    assert_eq!(first.status.code(), Some(1));
    assert_eq!(
        text(&first.stdout).lines().count(),
        1,
        "{}",
        text(&first.stdout)
    );
    let all = json(&run(&["verify", path(&damaged), "--all", "--json"]));
    assert_eq!(all["sound"], false);
    let findings = all["findings"].as_array().expect("findings");
    let place = |part: &str, offset: usize, start: usize| {
        findings.iter().any(|row| {
            row["part"] == part && row["offset"] == offset && row["file_offset"] == start + offset
        })
    };
    assert!(
        place("section vertices", 0, vertices) && place("section vertices", 56, vertices),
        "{all}"
    );
    assert!(place("section indices", 8, indices), "{all}");
    let cut = json(&run(&[
        "verify",
        path(&damaged),
        "--all",
        "--limit",
        "1",
        "--json",
    ]));
    assert_eq!(cut["omitted"], findings.len() - 1);
    assert!(
        run(&["verify", path(&damaged), "--quiet"])
            .stdout
            .is_empty()
    );
}

#[test]
fn what_is_no_package_is_an_error() {
    let folder = tempfile::tempdir().expect("a folder");
    let text_file = folder.path().join("text.cairn");
    std::fs::write(&text_file, "no package").expect("a file");
    for command in ["verify", "inspect"] {
        for file in [&text_file, &folder.path().join("none.cairn")] {
            let done = run(&[command, path(file)]);
            assert_eq!(done.status.code(), Some(2), "{command}");
            assert!(
                text(&done.stderr).contains(path(file)),
                "{}",
                text(&done.stderr)
            );
        }
    }
}

/// The example, where cargo built it beside this test.
#[test]
fn the_example_bakes_and_tells_its_progress() {
    let test = std::env::current_exe().expect("this test");
    let name = format!("bake{}", std::env::consts::EXE_SUFFIX);
    let example = test
        .ancestors()
        .nth(2)
        .map(|folder| folder.join("examples").join(name));
    let Some(example) = example.filter(|file| file.is_file()) else {
        eprintln!("SKIPPED: the example is not built");
        return;
    };
    let folder = tempfile::tempdir().expect("a folder");
    let package = folder.path().join("box.cairn");
    let done = Command::new(&example)
        .args([path(&asset("box/box.gltf")), path(&package)])
        .output()
        .expect("the example runs");
    let printed = text(&done.stdout);
    assert!(done.status.success(), "{}", text(&done.stderr));
    for part in ["import ...", "write ...", "12 triangles"] {
        assert!(printed.contains(part), "`{part}` in {printed}");
    }
    assert!(run(&["verify", path(&package), "--quiet"]).status.success());
}
