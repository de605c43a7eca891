//! The command line of `cairn-bake`: outputs, exit codes, messages, untouched files.

use std::path::{Path, PathBuf};
use std::process::{Command, Output};

fn assets() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../assets")
}

fn bake(arguments: &[&str]) -> Output {
    let program = env!("CARGO_BIN_EXE_cairn-bake");
    Command::new(program)
        .env("CAIRN_CACHE", "off")
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

#[test]
fn a_bake_reports_as_text_and_as_json() {
    let folder = tempfile::tempdir().expect("a folder");
    let output = folder.path().join("box with spaces.cairn");
    let input = assets().join("box/box.gltf");
    let done = bake(&[path(&input), "-o", path(&output)]);
    assert!(done.status.success(), "{}", text(&done.stderr));
    assert!(
        text(&done.stdout).contains("12 triangles"),
        "{}",
        text(&done.stdout)
    );
    let first = std::fs::read(&output).expect("the package");

    let done = bake(&[path(&input), "-o", path(&output), "--json"]);
    let json: serde_json::Value = serde_json::from_slice(&done.stdout).expect("one JSON object");
    assert_eq!(json["triangles"], 12);
    assert_eq!(json["package_bytes"], first.len());
    assert!(
        json["stages"]
            .as_array()
            .is_some_and(|stages| stages.len() == 7),
        "{json}"
    );
    assert_eq!(
        std::fs::read(&output).expect("the package"),
        first,
        "a second bake gives the same bytes"
    );

    let done = bake(&[path(&input), "-o", path(&output), "--quiet"]);
    assert!(done.status.success() && done.stdout.is_empty() && done.stderr.is_empty());
}

#[test]
fn bad_input_exits_with_two_and_touches_nothing() {
    let folder = tempfile::tempdir().expect("a folder");
    let output = folder.path().join("out.cairn");
    std::fs::write(&output, b"precious").expect("an old output");
    let broken = folder.path().join("broken.gltf");
    let cases: [(&[u8], &str); 4] = [
        (b"{\"asset\": {\"version\": \"2.0\"},\n  oops}", "line 2"),
        (b"{\"asset\": {\"version\": \"1.0\"}}", "version"),
        (
            br#"{"asset": {"version": "2.0"}, "extensionsRequired": ["EXT_unknown_thing"], "extensionsUsed": ["EXT_unknown_thing"]}"#,
            "EXT_unknown_thing",
        ),
        (
            br#"{"asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0]}], "nodes": [{"mesh": 0}],
                "meshes": [{"primitives": [{"attributes": {"POSITION": 7}}]}]}"#,
            "/meshes/0/primitives/0",
        ),
    ];
    for (content, expected) in cases {
        std::fs::write(&broken, content).expect("a broken scene");
        let done = bake(&[path(&broken), "-o", path(&output)]);
        let message = text(&done.stderr);
        assert_eq!(done.status.code(), Some(2), "{message}");
        assert!(
            message.contains("broken.gltf") && message.contains(expected),
            "`{expected}` in {message}"
        );
        assert_eq!(std::fs::read(&output).expect("the old output"), b"precious");
    }
    let names: Vec<_> = std::fs::read_dir(folder.path())
        .expect("the folder")
        .flatten()
        .map(|entry| entry.file_name())
        .collect();
    assert_eq!(names.len(), 2, "nothing half-written: {names:?}");
}

#[test]
fn missing_files_and_folders_are_named() {
    let folder = tempfile::tempdir().expect("a folder");
    let input = assets().join("box/box.gltf");
    let output = folder.path().join("none/out.cairn");
    let done = bake(&[path(&input), "-o", path(&output)]);
    assert_eq!(done.status.code(), Some(2));
    assert!(
        text(&done.stderr).contains("none/out.cairn"),
        "{}",
        text(&done.stderr)
    );

    let output = folder.path().join("out.cairn");
    let done = bake(&[path(&folder.path().join("no.gltf")), "-o", path(&output)]);
    assert!(done.status.code() == Some(2) && text(&done.stderr).contains("no.gltf"));

    let done = bake(&[path(&input), "--env", path(&input), "-o", path(&output)]);
    assert!(
        done.status.code() == Some(2) && text(&done.stderr).contains("box.gltf"),
        "{}",
        text(&done.stderr)
    );
    assert!(!output.exists());
}

#[test]
fn an_input_is_never_overwritten() {
    let folder = tempfile::tempdir().expect("a folder");
    let scene = folder.path().join("box.gltf");
    std::fs::copy(assets().join("box/box.gltf"), &scene).expect("a copy");
    let before = std::fs::read(&scene).expect("the scene");
    let done = bake(&[path(&scene), "-o", path(&scene)]);
    assert_eq!(done.status.code(), Some(2));
    assert!(
        text(&done.stderr).contains("overwrite"),
        "{}",
        text(&done.stderr)
    );
    assert_eq!(std::fs::read(&scene).expect("the scene"), before);
}

#[test]
fn help_has_examples() {
    let done = bake(&["--help"]);
    assert!(done.status.success() && text(&done.stdout).contains("Examples:"));
}

#[test]
fn completions_and_manual_pages_come_from_the_command_line() {
    for (shell, expected) in [
        ("bash", "complete"),
        ("zsh", "#compdef cairn-bake"),
        ("fish", "complete -c cairn-bake"),
    ] {
        let done = bake(&["completions", shell]);
        let script = text(&done.stdout);
        assert!(
            done.status.success() && script.contains(expected),
            "{script}"
        );
        assert!(script.contains("sky-format"), "{shell} completes flags");
    }
    let folder = tempfile::tempdir().expect("a folder");
    let pages = folder.path().join("man 1");
    let done = bake(&["man", path(&pages)]);
    assert!(done.status.success(), "{}", text(&done.stderr));
    let page = std::fs::read_to_string(pages.join("cairn-bake.1")).expect("the page");
    assert!(
        page.contains(".TH cairn-bake") && page.contains("Exit codes"),
        "{page}"
    );
    assert!(pages.join("cairn-bake-completions.1").exists());
}

/// Name and value of the settings in a package's provenance.
fn settings(package: &Path) -> Vec<(String, String)> {
    let package = cairn_format::Package::open(package).expect("a package");
    let settings = package.scene().provenance.settings.iter();
    settings
        .map(|setting| (setting.name.to_string(), setting.value.to_string()))
        .collect()
}

#[test]
fn native_encoders_are_marked_and_others_do_not_depend_on_threads() {
    let folder = tempfile::tempdir().expect("a folder");
    let input = assets().join("materials/materials.gltf");
    let baked = |name: &str, flags: &[&str]| {
        let output = folder.path().join(name);
        let arguments = [&[path(&input), "-o", path(&output), "-q"], flags].concat();
        let done = bake(&arguments);
        assert!(done.status.success(), "{}", text(&done.stderr));
        output
    };
    let one = baked("one.cairn", &["--threads", "1"]);
    let bytes = std::fs::read(&one).expect("the package");
    for threads in ["2", "5"] {
        let other = baked("other.cairn", &["--threads", threads]);
        assert!(
            bytes == std::fs::read(&other).expect("the package"),
            "{threads} threads"
        );
    }
    assert!(settings(&one).iter().all(|(name, _)| name != "native-isa"));
    let native = baked("native.cairn", &["--native-isa"]);
    assert!(
        settings(&native)
            .iter()
            .any(|(name, _)| name == "native-isa")
    );
    let target = baked(
        "target.cairn",
        &["--texture-quality", "30dB", "--mip-filter", "box"],
    );
    let expected = [("texture-quality", "30dB"), ("mip-filter", "box")];
    for (name, value) in expected {
        assert!(
            settings(&target).contains(&(name.into(), value.into())),
            "{name}"
        );
    }
}

#[test]
fn images_that_miss_the_quality_asked_for_are_named() {
    let folder = tempfile::tempdir().expect("a folder");
    let input = assets().join("hall/hall.gltf");
    let output = folder.path().join("hall.cairn");
    let done = bake(&[
        path(&input),
        "-o",
        path(&output),
        "--texture-quality",
        "58dB",
        "--json",
    ]);
    assert!(done.status.success(), "{}", text(&done.stderr));
    let json: serde_json::Value = serde_json::from_slice(&done.stdout).expect("one JSON object");
    let rows = json["report"].as_array().expect("rows");
    let of = |metric: &str| {
        let rows = rows.iter().filter(|row| row["metric"] == metric);
        rows.map(|row| row["error"].as_f64().expect("a number"))
            .collect::<Vec<_>>()
    };
    // Every image meets the target, or says by how much it does not.
    let (psnr, missed) = (of("psnr dB"), of("psnr dB less the target"));
    assert_eq!(
        psnr.iter().filter(|psnr| **psnr < 58.0).count(),
        missed.len()
    );
    assert!(!missed.is_empty() && missed.iter().all(|missed| *missed < 0.0));
    let warnings = json["diagnostics"].as_array().expect("diagnostics");
    let named = warnings
        .iter()
        .filter(|one| one["code"] == "texture-quality-missed");
    assert_eq!(named.count(), missed.len());
    // Presets differ from image to image.
    let presets: std::collections::BTreeSet<&str> = rows
        .iter()
        .filter(|row| row["stage"] == "texture")
        .filter_map(|row| row["setting"].as_str())
        .collect();
    assert!(
        presets.contains("Bc7Srgb best") && presets.len() > 2,
        "{presets:?}"
    );
}

#[test]
fn files_elsewhere_need_trust() {
    let folder = tempfile::tempdir().expect("a folder");
    let path_of = |name: &str| folder.path().join(name);
    for name in ["scene", "elsewhere"] {
        std::fs::create_dir(path_of(name)).expect("a folder");
    }
    let source = assets().join("lobes");
    let bin = path_of("elsewhere/lobes.bin");
    std::fs::copy(source.join("lobes.bin"), &bin).expect("a copy");
    let scene = std::fs::read_to_string(source.join("lobes.gltf")).expect("the scene");
    let output = path_of("out.cairn");
    let absolute = format!("file://{}", path(&bin));
    let mut packages = Vec::new();
    for (uri, code) in [
        ("../elsewhere/lobes.bin", "uri-outside"),
        (absolute.as_str(), "uri-scheme"),
        (path(&bin), "uri-absolute"),
    ] {
        let named = path_of("scene/lobes.gltf");
        let text_of = scene.replace("\"lobes.bin\"", &format!("\"{uri}\""));
        assert_ne!(text_of, scene);
        std::fs::write(&named, text_of).expect("written");
        let done = bake(&[path(&named), "-o", path(&output)]);
        assert_eq!(done.status.code(), Some(2), "{uri}");
        assert!(text(&done.stderr).contains(code), "{}", text(&done.stderr));
        let done = bake(&[path(&named), "-o", path(&output), "--allow-external"]);
        assert!(done.status.success(), "{}", text(&done.stderr));
        packages.push(std::fs::read(&output).expect("the package"));
    }
    // Where the folder lies is in no package.
    let needle = path(folder.path()).as_bytes();
    for package in packages {
        assert!(!package.windows(needle.len()).any(|window| window == needle));
    }
}

#[test]
fn a_scene_may_have_too_many_triangles() {
    let folder = tempfile::tempdir().expect("a folder");
    let output = folder.path().join("out.cairn");
    let scene = assets().join("box/box.gltf");
    let with = |limit: &str| {
        bake(&[
            path(&scene),
            "-o",
            path(&output),
            "--limit-triangles",
            limit,
        ])
    };
    let done = with("11");
    assert_eq!(done.status.code(), Some(2));
    let message = text(&done.stderr);
    assert!(
        message.contains("/meshes/0/primitives/0") && message.contains("--limit-triangles"),
        "{message}"
    );
    assert!(!output.exists() && with("12").status.success());
}

#[test]
fn warnings_stop_a_strict_bake() {
    let folder = tempfile::tempdir().expect("a folder");
    let scene = folder.path().join("odd.gltf");
    let json = r#"{"asset":{"version":"2.0"},"animations":[{}],"nodes":[{"name":"Hall","rotation":[0,2,0,0]}],
        "scenes":[{"nodes":[0]}],"scene":0}"#;
    std::fs::write(&scene, json).expect("a scene");
    let output = folder.path().join("odd.cairn");
    let run = |flags: &[&str]| {
        let arguments = [&[path(&scene), "-o", path(&output)], flags].concat();
        bake(&arguments)
    };
    for flags in [&["--strict"][..], &["--strict=quaternion-not-unit"]] {
        let done = run(flags);
        assert_eq!(done.status.code(), Some(2), "{}", text(&done.stderr));
        assert!(text(&done.stderr).contains("by --strict") && !output.exists());
    }
    let done = run(&["--strict=light-range"]);
    let message = text(&done.stderr);
    assert!(done.status.success() && output.exists(), "{message}");
    let named = "warning[quaternion-not-unit]: ";
    assert!(
        message.contains(named) && message.contains("(node `Hall`)"),
        "{message}"
    );
    assert!(
        message.contains("  why: ") && message.contains("  fix: "),
        "{message}"
    );
    // A bake that is not needed is held to the same.
    let cache = folder.path().join("cache");
    let kept = |flags: &[&str]| run(&[&["--cache", path(&cache), "--json"], flags].concat());
    assert!(kept(&[]).status.success());
    assert!(text(&kept(&[]).stdout).contains("\"unchanged\":true"));
    let allowed = kept(&["--strict=light-range"]);
    assert!(text(&allowed.stdout).contains("\"unchanged\":true"));
    let done = kept(&["--strict"]);
    assert_eq!(done.status.code(), Some(2), "{}", text(&done.stdout));
    let done = run(&["--strict=no-such-code"]);
    assert!(done.status.code() == Some(2) && text(&done.stderr).contains("docs/diagnostics.md"));
}

#[test]
fn memory_may_be_limited() {
    let folder = tempfile::tempdir().expect("a folder");
    let scene = assets().join("hall/hall.gltf");
    let [free, tight] = ["free.cairn", "tight.cairn"].map(|name| folder.path().join(name));
    let run = |output: &Path, limit: &str| {
        let flags = [
            "--cache",
            "off",
            "--texture-quality",
            "fast",
            "--limit-memory",
            limit,
        ];
        bake(&[&[path(&scene), "-o", path(output)], &flags[..]].concat())
    };
    let done = run(&free, "16G");
    assert!(done.status.success(), "{}", text(&done.stderr));
    // One image of 512 x 512 at a time beside the geometry, and no byte of the package changes.
    let done = run(&tight, "34M");
    assert!(done.status.success(), "{}", text(&done.stderr));
    let read = |path: &Path| std::fs::read(path).expect("a package");
    assert!(read(&free) == read(&tight));
    for (limit, named) in [("1M", "the geometry"), ("24M", "image `")] {
        std::fs::remove_file(&tight).unwrap_or_default();
        let done = run(&tight, limit);
        let message = text(&done.stderr);
        assert_eq!(done.status.code(), Some(2), "{limit}: {message}");
        assert!(
            message.contains("error[limit-memory]") && message.contains(named),
            "{message}"
        );
        assert!(!tight.exists());
    }
    // A panorama counts before it is decoded: 512 x 256 of 48 bytes.
    let sky = assets().join("hall/sky.hdr");
    let scene = assets().join("box/box.gltf");
    for (limit, code) in [("6M", 2), ("7M", 0)] {
        let flags = [
            "--cache",
            "off",
            "--limit-memory",
            limit,
            "--env",
            path(&sky),
        ];
        let done = bake(&[&[path(&scene), "-o", path(&tight)], &flags[..]].concat());
        let message = text(&done.stderr);
        assert_eq!(done.status.code(), Some(code), "{limit}: {message}");
        assert_eq!(message.contains("the environment takes"), code == 2);
    }
}

#[test]
fn encoders_are_compared_on_what_is_given() {
    let image = assets().join("materials/textures/checker.png");
    let sky = assets().join("hall/sky.hdr");
    let run = |inputs: &[&Path]| {
        let inputs: Vec<&str> = inputs.iter().map(|input| path(input)).collect();
        let flags = ["--crop", "16", "--face", "0", "--seconds", "0.001"];
        let done = bake(&[&["bench", "textures"], &inputs[..], &flags[..]].concat());
        assert!(done.status.success(), "{}", text(&done.stderr));
        text(&done.stdout)
    };
    for (inputs, images, panoramas) in [
        (&[&*image][..], true, false),
        (&[&*sky][..], false, true),
        (&[&*image, &*sky][..], true, true),
    ] {
        let table = run(inputs);
        let has = |heading: &str| table.lines().any(|line| line.starts_with(heading));
        assert_eq!(has("| encoder"), images, "{table}");
        assert_eq!(has("| BC6H encoder"), panoramas, "{table}");
        assert!(!table.contains("NaN"), "{table}");
        for encoder in ["Cairn", "Intel"] {
            assert!(table.contains(encoder), "{table}");
        }
        assert_eq!(table.contains("bc7e"), images, "{table}");
    }
}
