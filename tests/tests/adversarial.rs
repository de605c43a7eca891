//! Every hostile file ends in a clear error or in a package that renders, soon and in little memory.

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::{Path, PathBuf};
use std::sync::mpsc;
use std::time::{Duration, Instant};

use cairn_bake::{BakeError, Options, Silent};
use cairn_format::Package;
use cairn_player::camera::Camera;
use cairn_player::gpu::{Gpu, GpuOptions};
use cairn_player::headless::{HeadlessOptions, render_on};
use cairn_player::settings::Settings;
use cairn_tests::{bounds, files, quick_options, require_vulkan, shared_assets};

/// A bake that takes longer hangs.
const TIME_LIMIT: Duration = Duration::from_secs(10);
/// Largest resident set while all files are baked.
const MEMORY_LIMIT: u64 = 1 << 30;

#[test]
fn hostile_files_end_in_errors_or_packages() {
    let test = "hostile_files_end_in_errors_or_packages";
    let Some(assets) = shared_assets(test) else {
        return;
    };
    let hostile = assets.join("adversarial");
    let packages = tempfile::tempdir().expect("a temporary folder");
    let (mut failures, mut baked, mut slowest) = (Vec::new(), Vec::new(), 0.0_f64);
    let inputs = files(&hostile);
    for (index, input) in inputs.iter().enumerate() {
        let start = Instant::now();
        let output = packages.path().join(format!("{index}.cairn"));
        match guarded(&hostile, input, &output) {
            Ok(true) => baked.push((input, output)),
            Ok(false) => {}
            Err(failure) => failures.push(format!("{}: {failure}", input.display())),
        }
        slowest = slowest.max(start.elapsed().as_secs_f64());
    }
    let peak = cairn_bake::peak::peak_memory();
    println!(
        "{} hostile files: {} bake, {} are refused, {} fail; slowest {slowest:.3} s, peak {} MB",
        inputs.len(),
        baked.len(),
        inputs.len() - baked.len() - failures.len(),
        failures.len(),
        peak.map_or(0, |bytes| bytes / 1_000_000)
    );
    assert!(failures.is_empty(), "{}", failures.join("\n"));
    assert!(!baked.is_empty() && baked.len() < inputs.len());
    assert!(peak.is_none_or(|bytes| bytes < MEMORY_LIMIT), "{peak:?}");
    if require_vulkan(test) {
        render_all(&baked);
    }
}

/// Bakes on a thread of its own, so that a hang is noticed. `false` where the file is refused.
fn guarded(hostile: &Path, input: &Path, output: &Path) -> Result<bool, String> {
    let (send, receive) = mpsc::channel();
    let (hostile, input, output) = (hostile.to_owned(), input.to_owned(), output.to_owned());
    std::thread::spawn(move || {
        let end = catch_unwind(AssertUnwindSafe(|| bake(&hostile, &input, &output)));
        let _ = send.send(end.unwrap_or_else(|_| Err("panics".into())));
    });
    receive
        .recv_timeout(TIME_LIMIT)
        .unwrap_or_else(|_| Err(format!("takes longer than {TIME_LIMIT:?}")))
}

/// Any file may be given as a scene; panoramas are given as environments too.
fn bake(hostile: &Path, input: &Path, output: &Path) -> Result<bool, String> {
    let options = quick_options(input, output);
    let extension = input.extension().and_then(|extension| extension.to_str());
    if matches!(extension, Some("hdr" | "exr")) {
        let environment = Options {
            input: hostile.join("cgltf-fuzz-seeds/Box.glb"),
            environment: Some(input.to_owned()),
            ..options.clone()
        };
        end(&environment)?;
    }
    end(&options)
}

fn end(options: &Options) -> Result<bool, String> {
    match cairn_bake::bake(options, &Silent) {
        Ok(_) => {
            let package = Package::open(&options.output).map_err(|error| error.to_string())?;
            package.verify().map_err(|error| error.to_string())?;
            Ok(true)
        }
        // The bake made something that it does not accept itself.
        Err(error @ BakeError::Package(_)) => Err(error.to_string()),
        Err(error) if options.output.exists() => Err(format!("{error}, yet a package was written")),
        Err(_) => Ok(false),
    }
}

/// Asserts that what was baked can be shown.
fn render_all(baked: &[(&PathBuf, PathBuf)]) {
    let options = HeadlessOptions {
        size: [16, 16],
        camera: Camera::default(),
        settings: Settings::default(),
        frames: 1,
        hdr: true,
        gpu: GpuOptions {
            validation: true,
            device: None,
            ..GpuOptions::default()
        },
    };
    let gpu = Gpu::new(&options.gpu).expect("a device");
    for (input, output) in baked {
        let package = Package::open(output).expect("opened before");
        let options = HeadlessOptions {
            camera: Camera::framing(bounds(&package), 1.0),
            ..options.clone()
        };
        let image = match render_on(&gpu, &package, &options) {
            Ok(image) => image,
            Err(error) => panic!("{}: {error}", input.display()),
        };
        assert_eq!(image.validation, [""; 0], "{}", input.display());
        assert_eq!(image.non_finite(), Some(0), "{}", input.display());
    }
    assert_eq!(gpu.close(), [""; 0]);
}
