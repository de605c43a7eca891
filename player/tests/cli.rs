//! The command line of `cairn-player`: pictures, JSON, exit codes, messages.

use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use cairn_format::Writer;
use cairn_format::scene::Scene;

fn player(arguments: &[&str]) -> Output {
    let program = env!("CARGO_BIN_EXE_cairn-player");
    Command::new(program)
        .args(arguments)
        .output()
        .expect("cairn-player runs")
}

fn text(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}

fn path(path: &Path) -> &str {
    path.to_str().expect("a UTF-8 path")
}

/// A package of an empty scene: what the command line does with it is the same for any other.
fn empty_package(folder: &Path) -> PathBuf {
    let file = folder.join("empty scene.cairn");
    let bytes = Writer::new()
        .to_vec(&Scene::empty("empty"), "0")
        .expect("a package");
    std::fs::write(&file, bytes).expect("a file");
    file
}

fn has_vulkan(test: &str) -> bool {
    let gpu = cairn_player::gpu::Gpu::new(&cairn_player::gpu::GpuOptions::default());
    let required = std::env::var_os("CAIRN_REQUIRE_VULKAN").is_some();
    match gpu {
        Ok(_) => true,
        Err(error) => {
            assert!(!required, "CAIRN_REQUIRE_VULKAN is set, but: {error}");
            eprintln!("SKIPPED: {test}: {error}");
            false
        }
    }
}

#[test]
fn an_empty_scene_is_a_picture_of_nothing() {
    if !has_vulkan("an_empty_scene_is_a_picture_of_nothing") {
        return;
    }
    let folder = tempfile::tempdir().expect("a folder");
    let package = empty_package(folder.path());
    let picture = folder.path().join("out.png");
    for size in ["1x1", "33x7"] {
        let done = player(&[
            path(&package),
            "--headless",
            "--size",
            size,
            "-o",
            path(&picture),
            "--json",
            "--validation",
        ]);
        assert!(done.status.success(), "{}", text(&done.stderr));
        let json: serde_json::Value =
            serde_json::from_slice(&done.stdout).expect("one JSON object");
        assert_eq!(json["non_finite_texels"], 0);
        assert_eq!(json["draws"]["draws"], 0);
        assert_eq!(
            json["validation_messages"].as_array().map(Vec::len),
            Some(0)
        );
        let file = std::fs::File::open(&picture).expect("the picture");
        let decoder = png::Decoder::new(std::io::BufReader::new(file));
        let info = decoder.read_info().expect("a PNG").info().size();
        assert_eq!(format!("{}x{}", info.0, info.1), size);
    }
}

#[test]
fn bad_packages_exit_with_two() {
    let folder = tempfile::tempdir().expect("a folder");
    let file = folder.path().join("bad.cairn");
    let picture = folder.path().join("out.png");
    let mut cut = std::fs::read(empty_package(folder.path())).expect("a package");
    cut.pop();
    for (bytes, expected) in [
        (
            b"glTF nonsense, not a package".to_vec(),
            "not a Cairn package",
        ),
        (cut, "bytes long"),
    ] {
        std::fs::write(&file, bytes).expect("a file");
        let done = player(&[path(&file), "--headless", "-o", path(&picture)]);
        let message = text(&done.stderr);
        assert_eq!(done.status.code(), Some(2), "{message}");
        assert!(
            message.contains("bad.cairn") && message.contains(expected),
            "{message}"
        );
    }
    let done = player(&[path(&folder.path().join("none.cairn")), "--headless"]);
    assert!(done.status.code() == Some(2) && text(&done.stderr).contains("none.cairn"));
    assert!(!picture.exists());
}

#[test]
fn unknown_cameras_name_the_known_ones() {
    let folder = tempfile::tempdir().expect("a folder");
    let package = empty_package(folder.path());
    let cameras = folder.path().join("cameras.json");
    let content = r#"{"cameras": {"front": {"eye": [0, 0, 1], "target": [0, 0, 0], "yfov": 1}}}"#;
    std::fs::write(&cameras, content).expect("a camera file");
    for (camera, expected) in [
        ("nobody", "auto".to_owned()),
        (&format!("{}:back", path(&cameras)), "front".to_owned()),
    ] {
        let done = player(&[path(&package), "--headless", "--camera", camera]);
        assert_eq!(done.status.code(), Some(2));
        assert!(
            text(&done.stderr).contains(&expected),
            "{}",
            text(&done.stderr)
        );
    }
}

#[test]
fn bad_settings_exit_with_two_and_name_the_range() {
    let folder = tempfile::tempdir().expect("a folder");
    let package = empty_package(folder.path());
    let file = folder.path().join("look.json");
    for (content, expected) in [
        (r#"{"shadow": {"cascades": 9}}"#, "1 to 4"),
        (r#"{"shadows": {}}"#, "no setting `shadows`"),
        (r#"{"ev": 1"#, "not JSON"),
    ] {
        std::fs::write(&file, content).expect("a file");
        let done = player(&[path(&package), "--headless", "--settings", path(&file)]);
        let message = text(&done.stderr);
        assert_eq!(done.status.code(), Some(2), "{message}");
        assert!(
            message.contains("look.json") && message.contains(expected),
            "{message}"
        );
    }
    let done = player(&[path(&package), "--headless", "--shadow-cascades", "9"]);
    let message = text(&done.stderr);
    assert_eq!(done.status.code(), Some(2), "{message}");
    assert!(
        message.contains("--shadow-cascades") && message.contains("1 to 4"),
        "{message}"
    );
}

#[test]
fn flags_override_the_settings_file_and_reports_say_so() {
    if !has_vulkan("flags_override_the_settings_file_and_reports_say_so") {
        return;
    }
    let folder = tempfile::tempdir().expect("a folder");
    let package = empty_package(folder.path());
    let file = folder.path().join("look.json");
    std::fs::write(&file, r#"{"ev": 1.5, "ao": {"steps": 7}}"#).expect("a file");
    let done = player(&[
        path(&package),
        "--headless",
        "--size",
        "4x4",
        "--json",
        "--settings",
        path(&file),
        "--ao-steps",
        "9",
    ]);
    assert!(done.status.success(), "{}", text(&done.stderr));
    let json: serde_json::Value = serde_json::from_slice(&done.stdout).expect("one JSON object");
    assert_eq!(json["settings"]["ev"], 1.5);
    assert_eq!(json["settings"]["ao"]["steps"], 9);
    assert_eq!(json["settings"]["ao"]["temporal"], 0.9);
}

#[test]
fn a_missing_device_is_named() {
    if !has_vulkan("a_missing_device_is_named") {
        return;
    }
    let folder = tempfile::tempdir().expect("a folder");
    let package = empty_package(folder.path());
    let done = player(&[path(&package), "--headless", "--device", "no such GPU"]);
    assert_eq!(done.status.code(), Some(1));
    assert!(
        text(&done.stderr).contains("no such GPU"),
        "{}",
        text(&done.stderr)
    );
}

#[cfg(all(target_os = "linux", feature = "window"))]
#[test]
fn without_a_display_the_remedy_is_named() {
    let folder = tempfile::tempdir().expect("a folder");
    let package = empty_package(folder.path());
    let program = env!("CARGO_BIN_EXE_cairn-player");
    let done = Command::new(program)
        .arg(&package)
        .env_remove("DISPLAY")
        .env_remove("WAYLAND_DISPLAY")
        .env_remove("WAYLAND_SOCKET")
        .output()
        .expect("cairn-player runs");
    assert_eq!(done.status.code(), Some(1), "{}", text(&done.stderr));
    assert!(
        text(&done.stderr).contains("--headless"),
        "{}",
        text(&done.stderr)
    );
}

#[test]
fn bench_prints_one_line_of_percentiles() {
    if !has_vulkan("bench_prints_one_line_of_percentiles") {
        return;
    }
    let folder = tempfile::tempdir().expect("a folder");
    let package = empty_package(folder.path());
    let bench = |more: &[&str]| {
        let fixed = ["bench", path(&package), "--size", "16x16", "--frames", "5"];
        player(&[&fixed[..], more].concat())
    };
    let done = bench(&["--no-skybox", "--validation"]);
    assert!(done.status.success(), "{}", text(&done.stderr));
    assert_eq!(text(&done.stdout).lines().count(), 1);
    let json: serde_json::Value = serde_json::from_slice(&done.stdout).expect("one JSON object");
    assert_eq!(json["scene"].as_str().map(str::len), Some(64));
    assert!(
        json["commit"]
            .as_str()
            .is_some_and(|commit| !commit.is_empty())
    );
    assert_eq!((&json["frames"], &json["dropped"]), (&5.into(), &16.into()));
    assert_eq!(json["settings"]["skybox"], false);
    let times = [&json["gpu_ms"], &json["record_ms"], &json["passes"][0]];
    for time in times {
        let [p50, p95] = ["p50", "p95"].map(|name| time[name].as_f64().expect("a time"));
        assert!(0.0 < p50 && p50 <= p95, "{time}");
    }
    let done = bench(&["--path", "cameras"]);
    assert_eq!(done.status.code(), Some(2));
    assert!(text(&done.stderr).contains("no camera"));
}

#[test]
fn compare_and_sweep_write_whole_reports() {
    if !has_vulkan("compare_and_sweep_write_whole_reports") {
        return;
    }
    let folder = tempfile::tempdir().expect("a folder");
    let package = empty_package(folder.path());
    let out = folder.path().join("compare");
    let common = [
        path(&package),
        "--size",
        "24x16",
        "--frames",
        "2",
        "--spp",
        "4",
    ];
    let done = player(&[&["compare"], &common[..], &["-o", path(&out)]].concat());
    assert!(done.status.success(), "{}", text(&done.stderr));
    let page = std::fs::read_to_string(out.join("compare.html")).expect("a page");
    assert!(page.matches("data:image/png;base64,").count() >= 4 && !page.contains("http"));
    let json = std::fs::read(out.join("compare.json")).expect("a report");
    let json: serde_json::Value = serde_json::from_slice(&json).expect("JSON");
    assert_eq!(
        json["rows"].as_array().map(Vec::len),
        Some(1),
        "an empty scene has no lights to compare"
    );
    let traces = cairn_player::gpu::Gpu::new(&cairn_player::gpu::GpuOptions::default())
        .is_ok_and(|gpu| gpu.traces_rays());
    let reference = if traces {
        "path tracer"
    } else {
        "supersampled"
    };
    assert!(
        json["reference"]
            .as_str()
            .is_some_and(|name| name.starts_with(reference))
    );
    assert_eq!(json["note"].is_null(), traces);
    // Nothing is black in every way of drawing it.
    assert_eq!(
        (&json["rows"][0]["rmse"], &json["rows"][0]["flip"]),
        (&0.0.into(), &0.0.into())
    );

    let reference = out.join("all-reference.exr");
    let out = folder.path().join("sweep");
    let sweep =
        |more: &[&str]| player(&[&["sweep"], &common[..], &["-o", path(&out)], more].concat());
    let done = sweep(&["--reference", path(&reference)]);
    assert!(done.status.success(), "{}", text(&done.stderr));
    let json = std::fs::read(out.join("sweep.json")).expect("a report");
    let json: serde_json::Value = serde_json::from_slice(&json).expect("JSON");
    assert!(
        json["levels"]
            .as_array()
            .is_some_and(|levels| levels.len() > 30)
    );
    assert!(
        std::fs::read_to_string(out.join("sweep.svg")).is_ok_and(|svg| svg.starts_with("<svg"))
    );
    let done = sweep(&["--reference", path(&package)]);
    assert_eq!(done.status.code(), Some(2));
    assert!(
        text(&done.stderr).contains("not an OpenEXR file"),
        "{}",
        text(&done.stderr)
    );
}

#[test]
fn what_is_measured_is_never_denoised() {
    let folder = tempfile::tempdir().expect("a folder");
    let package = empty_package(folder.path());
    let out = folder.path().join("out");
    let settings = folder.path().join("settings.json");
    std::fs::write(&settings, r#"{"path": {"denoise": true}}"#).expect("settings");
    for arguments in [
        vec![
            "compare",
            path(&package),
            "-o",
            path(&out),
            "--path-denoise",
        ],
        vec!["sweep", path(&package), "-o", path(&out), "--path-denoise"],
        vec![
            "sweep",
            path(&package),
            "-o",
            path(&out),
            "--settings",
            path(&settings),
        ],
        vec!["bench", path(&package), "--path-denoise"],
    ] {
        let done = player(&arguments);
        let message = text(&done.stderr);
        assert_eq!(done.status.code(), Some(2), "{arguments:?}: {message}");
        assert!(message.contains("--path-denoise"), "{message}");
    }
    assert!(!out.exists());
}

#[test]
fn a_missing_denoiser_is_said_before_anything_is_rendered() {
    let folder = tempfile::tempdir().expect("a folder");
    let package = empty_package(folder.path());
    let picture = folder.path().join("out.png");
    let done = Command::new(env!("CARGO_BIN_EXE_cairn-player"))
        .args([path(&package), "--headless", "--mode", "path-trace"])
        .args(["--path-denoise", "-o", path(&picture)])
        .env("CAIRN_OIDN", "/nowhere/libOpenImageDenoise.so.2")
        .output()
        .expect("cairn-player runs");
    let message = text(&done.stderr);
    let (code, remedy) = if cfg!(feature = "oidn") {
        (1, "CAIRN_OIDN")
    } else {
        (2, "--features oidn")
    };
    assert_eq!(done.status.code(), Some(code), "{message}");
    assert!(message.contains(remedy), "{message}");
    assert!(!picture.exists());
}

#[test]
fn converge_writes_its_curves() {
    let test = "converge_writes_its_curves";
    let gpu = cairn_player::gpu::Gpu::new(&cairn_player::gpu::GpuOptions::default());
    if !has_vulkan(test) || !gpu.is_ok_and(|gpu| gpu.traces_rays()) {
        return;
    }
    let folder = tempfile::tempdir().expect("a folder");
    let package = empty_package(folder.path());
    let out = folder.path().join("converge");
    let done = player(&[
        "converge",
        path(&package),
        "--size",
        "8x6",
        "--spp",
        "4",
        "--reference-spp",
        "8",
        "-o",
        path(&out),
    ]);
    assert!(done.status.success(), "{}", text(&done.stderr));
    let plot = std::fs::read_to_string(out.join("converge.svg")).expect("a plot");
    assert!(plot.matches("<polyline").count() == 12 && plot.ends_with("</svg>\n"));
    let json = std::fs::read(out.join("converge.json")).expect("a report");
    let json: serde_json::Value = serde_json::from_slice(&json).expect("JSON");
    let curves = json["curves"].as_array().expect("curves");
    let names: Vec<_> = curves
        .iter()
        .map(|curve| curve["sampler"].as_str())
        .collect();
    assert_eq!(names, ["independent", "owen", "blue-noise"].map(Some));
    for curve in curves {
        let points = curve["points"].as_array().expect("points");
        let samples: Vec<_> = points
            .iter()
            .map(|point| point["samples"].as_u64())
            .collect();
        assert_eq!(samples, [1, 2, 4].map(Some));
        assert!(points.iter().all(|point| point["rmse"] == 0.0));
        assert!(curve["slope"].is_null(), "nothing falls");
    }

    let traced = player(&[
        path(&package),
        "--headless",
        "--mode",
        "path-trace",
        "--size",
        "8x6",
        "--spp",
        "8",
        "--count-rays",
        "--trace-split",
        "--json",
    ]);
    assert!(traced.status.success(), "{}", text(&traced.stderr));
    let json: serde_json::Value = serde_json::from_slice(&traced.stdout).expect("JSON");
    let trace = &json["trace"];
    assert_eq!(trace["samples"], 8);
    assert_eq!(
        trace["counters"]["rays"],
        8 * 8 * 6,
        "a ray a sample meets nothing"
    );
    assert!(trace["split"]["seconds"].as_f64() > Some(0.0));
    assert!(trace["split"]["twice_seconds"].as_f64() > Some(0.0));
}
