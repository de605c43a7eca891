//! The `cairn-player` program.

use std::process::ExitCode;
use std::time::Instant;

use cairn_format::Package;
use cairn_player::PlayerError;
use cairn_player::args::{Cli, ViewArgs};
use cairn_player::headless::{self, HeadlessImage, HeadlessOptions};
use cairn_player::png;
use cairn_player::settings::Settings;
use clap::Parser;

/// Exit code of a run that the validation layer had something to say about.
const VALIDATION_MESSAGES: u8 = 3;

fn main() -> ExitCode {
    let args = Cli::parse().view;
    match run(&args) {
        Ok(code) => code,
        Err(error) => {
            match &error {
                PlayerError::Package(inner) => {
                    eprintln!("error: {}: {inner}", args.scene.package.display())
                }
                other => eprintln!("error: {other}"),
            }
            ExitCode::from(error.exit_code())
        }
    }
}

fn run(args: &ViewArgs) -> Result<ExitCode, PlayerError> {
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
        hdr: args.json,
        gpu: args.scene.gpu(),
    };
    let image = headless::render(&package, &options)?;
    if let Some(path) = &args.out {
        png::write(path, image.width, image.height, &image.rgba8)?;
    }
    if args.json {
        println!("{}", json(args, &package, &options, &image, open_ms));
    } else {
        print!("{}", text(args, &image, open_ms));
    }
    Ok(match image.validation.len() {
        0 => ExitCode::SUCCESS,
        _ => ExitCode::from(VALIDATION_MESSAGES),
    })
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
fn show(args: &ViewArgs, package: &Package) -> Result<ExitCode, PlayerError> {
    let options = cairn_player::window::WindowOptions {
        size: [args.scene.size.0, args.scene.size.1],
        camera: args.scene.camera(package)?,
        settings: args.scene.settings(Settings::default())?,
        frames: args.frames,
        gpu: args.scene.gpu(),
    };
    let messages = cairn_player::window::run(package, &options)?;
    Ok(if messages.is_empty() {
        ExitCode::SUCCESS
    } else {
        ExitCode::from(VALIDATION_MESSAGES)
    })
}

#[cfg(not(feature = "window"))]
fn show(_args: &ViewArgs, _package: &Package) -> Result<ExitCode, PlayerError> {
    Err(PlayerError::Input(
        "this build has no window (feature `window`): render with --headless --out FILE.png".into(),
    ))
}
