//! `docs/format.md` and `include/cairn.h` are those of the code, and a C program reads a package by them.
//!
//! `UPDATE_GOLDEN=1 cargo test -p cairn-format --test reference` writes both anew.

use std::path::{Path, PathBuf};
use std::process::Command;

use cairn_format::scene::natives;
use cairn_format::{Package, c_header, reference};

fn root(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join(name)
}

fn golden() -> PathBuf {
    root("tests/golden/tiny.cairn")
}

#[track_caller]
fn fresh(path: &Path, expected: &str) {
    if std::env::var_os("UPDATE_GOLDEN").is_some() {
        std::fs::write(path, expected).expect("the file is written");
    }
    let text = std::fs::read_to_string(path).unwrap_or_default();
    let differing = text.lines().zip(expected.lines()).position(|(a, b)| a != b);
    assert!(
        text == expected,
        "{} is stale from line {:?} on: accept with UPDATE_GOLDEN=1",
        path.display(),
        differing.map(|line| line + 1)
    );
}

/// The text with the body of every block `<!-- generated: NAME -->` ... `<!-- end -->` put in anew.
fn regenerated(text: &str, blocks: &[(&str, String)]) -> String {
    let mut out = String::new();
    let mut rest = text;
    let mut seen = Vec::new();
    while let Some((before, after)) = rest.split_once("<!-- generated: ") {
        let (name, body) = after.split_once(" -->\n").expect("an end of the mark");
        let (_, behind) = body
            .split_once("<!-- end -->")
            .expect("an end of the block");
        let block = blocks.iter().find(|(known, _)| *known == name);
        let (_, block) = block.unwrap_or_else(|| panic!("no block {name}"));
        out += &format!("{before}<!-- generated: {name} -->\n{block}<!-- end -->");
        seen.push(name);
        rest = behind;
    }
    for (name, _) in blocks {
        assert!(seen.contains(name), "docs/format.md has no block {name}");
    }
    out + rest
}

#[test]
fn the_reference_is_that_of_the_code() {
    let path = root("../docs/format.md");
    let text = std::fs::read_to_string(&path).expect("docs/format.md");
    let bytes = std::fs::read(golden()).expect("the golden package");
    let package = Package::from_bytes(&bytes).expect("a good package");
    let header = package.header();
    let mut blocks = reference::blocks();
    let head = (header.root_offset + header.root_length) as usize;
    blocks.push((
        "hexdump",
        format!("```text\n{}```\n", reference::hexdump(&bytes[..head])),
    ));
    fresh(&path, &regenerated(&text, &blocks));
}

#[test]
fn the_header_is_that_of_the_code() {
    fresh(&root("include/cairn.h"), &c_header::cairn_h());
}

/// Compiles a program that includes cairn.h; `None`, loudly, where there is no compiler.
fn compile(compiler: &str, arguments: &[&str], output: &Path) -> Option<()> {
    let include = tempfile::tempdir().expect("a folder");
    std::fs::write(include.path().join("cairn.h"), c_header::cairn_h()).expect("a file");
    let done = Command::new(compiler)
        .args(arguments)
        .args(["-Wall", "-Wextra", "-Werror", "-I"])
        .arg(include.path())
        .arg("-o")
        .arg(output)
        .output();
    let Ok(done) = done else {
        eprintln!("SKIPPED: cairn.h is not compiled: no `{compiler}`");
        return None;
    };
    assert!(
        done.status.success(),
        "{}",
        String::from_utf8_lossy(&done.stderr)
    );
    Some(())
}

#[test]
fn a_c_program_reads_a_package() {
    let folder = tempfile::tempdir().expect("a folder");
    let program = folder.path().join("read");
    let source = root("tests/c/read.c");
    let source = source.to_str().expect("a UTF-8 path");
    if compile("cc", &["-std=c11", "-pedantic", source], &program).is_none() {
        return;
    }
    let done = Command::new(&program)
        .arg(golden())
        .output()
        .expect("the program runs");
    assert!(done.status.success());
    let printed = String::from_utf8(done.stdout).expect("UTF-8");

    let package = Package::open(&golden()).expect("the golden package");
    let scene = package.scene();
    let mut expected: Vec<String> = package
        .table()
        .iter()
        .map(|row| {
            format!(
                "section {} {} {} {}",
                row.kind, row.stride, row.offset, row.count
            )
        })
        .collect();
    expected.push(format!("scene {}", scene.name));
    let [x, y, z] = natives(&scene.bounds.max);
    expected.push(format!("bounds {x} {y} {z}"));
    expected.extend(
        scene
            .meshes
            .iter()
            .map(|mesh| format!("mesh {}", mesh.name)),
    );
    for image in scene.images.iter() {
        let last = image.levels[image.levels.len() - 1].offset.to_native();
        expected.push(format!("image {}", image.name));
        expected.push(format!(
            "size {} {} format {} role {} levels {} last {last}",
            image.width,
            image.height,
            image.format.native() as u8,
            image.role as u8,
            image.levels.len()
        ));
    }
    expected.push("environment 0".into());
    let last = package
        .vertices()
        .expect("vertices")
        .last()
        .expect("a vertex")
        .position;
    expected.push(format!("last vertex {} {} {}", last[0], last[1], last[2]));
    let material = package.materials().expect("materials")[0];
    expected.push(format!("cutoff {} normal map 0", material.alpha_cutoff));
    expected.push("lights none".into());
    assert_eq!(printed.lines().collect::<Vec<_>>(), expected);

    let damaged = folder.path().join("damaged.cairn");
    let mut bytes = std::fs::read(golden()).expect("the package");
    bytes[8] ^= 1;
    std::fs::write(&damaged, bytes).expect("a file");
    let refused = Command::new(&program)
        .arg(&damaged)
        .status()
        .expect("the program runs");
    assert_eq!(refused.code(), Some(1));
}

/// Texts of all lengths about the border between those that lie in the field and those outside.
#[test]
fn a_c_program_reads_every_text() {
    let folder = tempfile::tempdir().expect("a folder");
    let program = folder.path().join("read");
    let source = root("tests/c/read.c");
    let source = source.to_str().expect("a UTF-8 path");
    if compile("cc", &["-std=c11", source], &program).is_none() {
        return;
    }
    for length in [0, 1, 15, 16, 17, 63, 64, 65, 255, 256, 300] {
        let name = "n".repeat(length);
        let bytes = cairn_format::Writer::new()
            .to_vec(&cairn_format::scene::Scene::empty(&name), "0")
            .expect("a package");
        let file = folder.path().join("named.cairn");
        std::fs::write(&file, bytes).expect("a file");
        let done = Command::new(&program)
            .arg(&file)
            .output()
            .expect("the program runs");
        let printed = String::from_utf8(done.stdout).expect("UTF-8");
        assert_eq!(
            printed.lines().next(),
            Some(format!("scene {name}").as_str())
        );
    }
}

#[test]
fn the_header_is_also_cpp() {
    let folder = tempfile::tempdir().expect("a folder");
    let source = folder.path().join("empty.cpp");
    std::fs::write(&source, "#include \"cairn.h\"\nint main() { return 0; }\n").expect("a file");
    let source = source.to_str().expect("a UTF-8 path");
    let _ = compile("c++", &["-std=c++11", source], &folder.path().join("empty"));
}

/// The example, where cargo built it beside this test.
#[test]
fn the_example_lists_what_is_drawn() {
    let test = std::env::current_exe().expect("this test");
    let name = format!("read{}", std::env::consts::EXE_SUFFIX);
    let example = test
        .ancestors()
        .nth(2)
        .map(|folder| folder.join("examples").join(name));
    let Some(example) = example.filter(|file| file.is_file()) else {
        eprintln!("SKIPPED: the example is not built");
        return;
    };
    let done = Command::new(&example)
        .arg(golden())
        .output()
        .expect("the example runs");
    let printed = String::from_utf8(done.stdout).expect("UTF-8");
    assert!(done.status.success());
    for line in [
        "upload vertices: 168 bytes",
        "upload two texels level 1: 4 bytes of Rgba8Srgb",
        "draw 1 triangles from index 0, vertex offset 0, 1 instances, base colour [1.0, 1.0, 1.0, 1.0], two texels",
    ] {
        assert!(
            printed.lines().any(|printed| printed == line),
            "`{line}` in {printed}"
        );
    }
    let refused = Command::new(&example)
        .arg(root("Cargo.toml"))
        .output()
        .expect("the example runs");
    assert_eq!(refused.status.code(), Some(2));
}
