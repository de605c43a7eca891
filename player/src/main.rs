//! The `cairn-player` program.

use std::path::Path;
use std::process::ExitCode;
use std::time::Instant;

use cairn_format::Package;
use cairn_player::PlayerError;
use cairn_player::args::{BenchArgs, Cli, Command, CompareArgs, ConvergeArgs, SweepArgs, ViewArgs};
use cairn_player::bench::BenchOptions;
use cairn_player::compare::CompareOptions;
use cairn_player::converge::ConvergeOptions;
use cairn_player::gpu::Gpu;
use cairn_player::headless::{self, HeadlessImage, HeadlessOptions};
use cairn_player::metrics::Picture;
use cairn_player::settings::Settings;
use cairn_player::sweep::SweepOptions;
use cairn_player::{exr, png};
use clap::Parser;

/// Exit code of a run that the validation layer had something to say about.
const VALIDATION_MESSAGES: u8 = 3;

fn main() -> ExitCode {
    let cli = Cli::parse();
    let (package, done) = match &cli {
        Cli::Command(Command::Bench(args)) => (&args.scene.package, bench(args)),
        Cli::Command(Command::Sweep(args)) => (&args.scene.package, sweep(args)),
        Cli::Command(Command::Compare(args)) => (&args.scene.package, compare(args)),
        Cli::Command(Command::Converge(args)) => (&args.scene.package, converge(args)),
        Cli::View(args) => (&args.scene.package, view(args)),
    };
    match done {
        Ok(messages) if messages.is_empty() => ExitCode::SUCCESS,
        Ok(_) => ExitCode::from(VALIDATION_MESSAGES),
        Err(error) => {
            match &error {
                PlayerError::Package(inner) => eprintln!("error: {}: {inner}", package.display()),
                other => eprintln!("error: {other}"),
            }
            ExitCode::from(error.exit_code())
        }
    }
}

/// Messages of the validation layer.
type Outcome = Result<Vec<String>, PlayerError>;

fn bench(args: &BenchArgs) -> Outcome {
    let package = args.scene.open()?;
    let options = BenchOptions {
        size: [args.scene.size.0, args.scene.size.1],
        camera: args.scene.camera(&package)?,
        path: args.path.clone(),
        settings: args.scene.measured_settings()?,
        frames: args.frames,
    };
    let gpu = Gpu::new(&args.scene.gpu())?;
    let report = cairn_player::bench::run(&gpu, &package, &options)?;
    println!("{}", serde_json::json!(report));
    Ok(gpu.close())
}

fn sweep(args: &SweepArgs) -> Outcome {
    let package = args.scene.open()?;
    let options = SweepOptions {
        size: [args.scene.size.0, args.scene.size.1],
        camera: args.scene.camera(&package)?,
        settings: args.scene.measured_settings()?,
        frames: args.frames,
        reference: args.reference.clone(),
        samples: args.spp,
    };
    let gpu = Gpu::new(&args.scene.gpu())?;
    let report = cairn_player::sweep::run(&gpu, &package, &options)?;
    let plot = cairn_player::sweep::plot::svg(&report);
    let json = serde_json::json!(report).to_string();
    write_all(
        &args.out,
        &[
            ("sweep.svg".into(), plot.into()),
            ("sweep.json".into(), json.into()),
        ],
    )?;
    print!("{}", report.table());
    Ok(gpu.close())
}

fn compare(args: &CompareArgs) -> Outcome {
    let package = args.scene.open()?;
    let options = CompareOptions {
        size: [args.scene.size.0, args.scene.size.1],
        camera: args.scene.camera(&package)?,
        settings: args.scene.measured_settings()?,
        frames: args.frames,
        samples: args.spp,
    };
    let gpu = Gpu::new(&args.scene.gpu())?;
    let report = cairn_player::compare::run(&gpu, &package, &options)?;
    let title = format!("{}: raster against reference", package.scene().name);
    let mut files = cairn_player::compare::page::files(&report)?;
    files.push((
        "compare.html".into(),
        cairn_player::compare::page::html(&report, &title)?.into(),
    ));
    files.push((
        "compare.json".into(),
        serde_json::json!(report).to_string().into(),
    ));
    write_all(&args.out, &files)?;
    print!("{}", report.table());
    Ok(gpu.close())
}

fn converge(args: &ConvergeArgs) -> Outcome {
    let package = args.scene.open()?;
    let options = ConvergeOptions {
        size: [args.scene.size.0, args.scene.size.1],
        camera: args.scene.camera(&package)?,
        settings: args.scene.measured_settings()?,
        samples: args.spp,
        reference_samples: args.reference_spp,
    };
    let gpu = Gpu::new(&args.scene.gpu())?;
    let report = cairn_player::converge::run(&gpu, &package, &options)?;
    let plot = cairn_player::converge::plot::svg(&report);
    let json = serde_json::json!(report).to_string();
    write_all(
        &args.out,
        &[
            ("converge.svg".into(), plot.into()),
            ("converge.json".into(), json.into()),
        ],
    )?;
    print!("{}", report.table());
    Ok(gpu.close())
}

/// Writes files into a folder, which is made where it is missing.
fn write_all(folder: &Path, files: &[(String, Vec<u8>)]) -> Result<(), PlayerError> {
    let fail = |path: &Path, error: std::io::Error| {
        PlayerError::Input(format!("{}: {error}", path.display()))
    };
    std::fs::create_dir_all(folder).map_err(|error| fail(folder, error))?;
    for (name, bytes) in files {
        let path = folder.join(name);
        png::write_whole(&path, bytes).map_err(|error| fail(&path, error))?;
    }
    Ok(())
}

fn view(args: &ViewArgs) -> Outcome {
    let start = Instant::now();
    let package = args.scene.open()?;
    let open_ms = start.elapsed().as_secs_f64() * 1e3;
    if !args.headless {
        return show(args, &package);
    }
    let options = HeadlessOptions {
        size: [args.scene.size.0, args.scene.size.1],
        camera: args.scene.camera(&package)?,
        settings: args.scene.settings(Settings::default())?,
        frames: args.frames.unwrap_or(1),
        hdr: args.json || args.out.as_deref().is_some_and(is_exr),
        gpu: args.scene.gpu(),
    };
    let image = headless::render_traced(&package, &options, &args.trace())?;
    if let Some(path) = &args.out {
        match &image.hdr {
            Some(hdr) if is_exr(path) => {
                let picture = Picture::from_rgba(image.width as usize, image.height as usize, hdr);
                png::write_whole(path, &exr::encode(&picture))
                    .map_err(|error| PlayerError::Input(format!("{}: {error}", path.display())))?;
            }
            _ => png::write(path, image.width, image.height, &image.rgba8)?,
        }
    }
    if args.json {
        println!("{}", json(args, &package, &options, &image, open_ms));
    } else {
        print!("{}", text(args, &image, open_ms));
    }
    Ok(image.validation)
}

/// Whether a picture goes into a file of linear floats.
fn is_exr(path: &Path) -> bool {
    path.extension().is_some_and(|extension| extension == "exr")
}

fn json(
    args: &ViewArgs,
    package: &Package,
    options: &HeadlessOptions,
    image: &HeadlessImage,
    open_ms: f64,
) -> serde_json::Value {
    serde_json::json!({
        "schema": 1,
        "tool": concat!("cairn-player ", env!("CARGO_PKG_VERSION")),
        "package": args.scene.package,
        "package_bytes": package.header().file_length,
        "device": image.device,
        "driver": image.driver,
        "size": options.size,
        "camera": args.scene.camera,
        "settings": options.settings,
        "frames": options.frames,
        "open_ms": open_ms,
        "upload": image.scene,
        "draws": image.draws,
        "passes": image.passes,
        "trace": image.trace,
        "denoised": image.denoise_ms.is_some(),
        "denoise_ms": image.denoise_ms,
        "non_finite_texels": image.non_finite(),
        "validation_messages": image.validation,
    })
}

fn text(args: &ViewArgs, image: &HeadlessImage, open_ms: f64) -> String {
    use std::fmt::Write;
    let mut text = String::new();
    let upload = &image.scene;
    let draws = &image.draws;
    let _ = writeln!(text, "{} on {}", args.scene.package.display(), image.device);
    let _ = writeln!(text, "  open {open_ms:.3} ms, upload {upload}");
    let _ = writeln!(
        text,
        "  {} draws, {} instances, {} triangles",
        draws.draws, draws.visible_instances, draws.triangles
    );
    if let Some(trace) = &image.trace {
        let _ = writeln!(
            text,
            "  {} samples in {:.3} s: {:.2} Msamples/s, estimated relative error {}, {} samples not finite",
            trace.samples,
            trace.seconds,
            trace.megasamples_per_second,
            trace
                .relative_error
                .map_or("unknown".into(), |error| format!("{error:.4}")),
            trace.counters.non_finite
        );
        if let Some(split) = &trace.split {
            let _ = writeln!(
                text,
                "  rays take {:.0} % of the time, shading the rest",
                split.ray_share * 100.0
            );
        }
    }
    if let Some(milliseconds) = image.denoise_ms {
        let _ = writeln!(text, "  denoised in {milliseconds:.1} ms");
    }
    for pass in &image.passes {
        let _ = writeln!(text, "  {:<16}{:>10.3} ms", pass.name, pass.milliseconds);
    }
    if let Some(path) = &args.out {
        let _ = writeln!(
            text,
            "  {}x{} -> {}",
            image.width,
            image.height,
            path.display()
        );
    }
    text
}

#[cfg(feature = "window")]
fn show(args: &ViewArgs, package: &Package) -> Outcome {
    use cairn_player::window::state::{State, file_of};
    let file = file_of(&args.scene.package);
    // What was kept is a convenience: damage to it must not keep a scene from being shown.
    let kept = file.as_deref().map_or(Ok(State::default()), State::load);
    let kept = kept.unwrap_or_else(|error| {
        eprintln!("warning: {error}; starting with defaults");
        State::default()
    });
    let options = cairn_player::window::WindowOptions {
        size: [args.scene.size.0, args.scene.size.1],
        camera: args.scene.camera(package)?,
        settings: args.scene.settings(kept.settings)?,
        frames: args.frames,
        gpu: args.scene.gpu(),
        cameras: kept.cameras,
        state: file,
        panel: !args.no_panel,
    };
    cairn_player::window::run(package, &options)
}

#[cfg(not(feature = "window"))]
fn show(_args: &ViewArgs, _package: &Package) -> Outcome {
    Err(PlayerError::Input(
        "this build has no window (feature `window`): render with --headless --out FILE.png".into(),
    ))
}
