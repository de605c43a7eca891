//! The command line of `cairn-player`, as typed and as meant.

use std::path::PathBuf;

use crate::camera::Camera;
use crate::camera_file;
use crate::error::PlayerError;
use crate::gpu::{AllowedBlocks, GpuOptions};
use crate::headless::trace::TraceOptions;
use crate::settings::Settings;
use crate::settings::flags::SettingFlags;
use cairn_format::Package;

/// The command line: a command, or a package to look at.
#[derive(Debug)]
pub enum Cli {
    /// A command.
    Command(Command),
    /// The plain form.
    View(Box<ViewArgs>),
}

/// By hand: clap derives no optional group of arguments whose own groups hold what is required.
impl clap::CommandFactory for Cli {
    fn command() -> clap::Command {
        let command = clap::Command::new("cairn-player")
            .version(env!("CARGO_PKG_VERSION"))
            .about("Render a Cairn package: in a window, or headless into a PNG")
            .after_help(EXAMPLES)
            .subcommand_negates_reqs(true)
            .args_conflicts_with_subcommands(true);
        <Command as clap::Subcommand>::augment_subcommands(
            <ViewArgs as clap::Args>::augment_args(command).subcommand_required(false),
        )
        .subcommand_required(false)
        .arg_required_else_help(false)
    }

    fn command_for_update() -> clap::Command {
        Self::command()
    }
}

impl clap::FromArgMatches for Cli {
    fn from_arg_matches(matches: &clap::ArgMatches) -> Result<Self, clap::Error> {
        Ok(match matches.subcommand_name() {
            Some(_) => Self::Command(Command::from_arg_matches(matches)?),
            None => Self::View(Box::new(ViewArgs::from_arg_matches(matches)?)),
        })
    }

    fn update_from_arg_matches(&mut self, matches: &clap::ArgMatches) -> Result<(), clap::Error> {
        *self = Self::from_arg_matches(matches)?;
        Ok(())
    }
}

impl clap::Parser for Cli {}

/// What else the player does.
#[derive(clap::Subcommand, Debug)]
pub enum Command {
    /// Measure each pass along a fixed path of the camera; print one JSON line.
    Bench(Box<BenchArgs>),
    /// Measure time and error of each feature and quality level; write sweep.json and sweep.svg.
    Sweep(Box<SweepArgs>),
    /// Render raster and reference from one camera; write pictures, compare.json and compare.html.
    Compare(Box<CompareArgs>),
    /// Trace with every sampler; write error against samples and seconds as converge.json and converge.svg.
    Converge(Box<ConvergeArgs>),
}

/// `cairn-player sweep`.
#[derive(clap::Args, Debug)]
pub struct SweepArgs {
    #[command(flatten)]
    pub scene: SceneArgs,
    /// Frames to measure of each level; 16 more are drawn before.
    #[arg(long, default_value_t = 64, value_parser = clap::value_parser!(u32).range(1..=100_000))]
    pub frames: u32,
    /// Picture to measure against: an uncompressed EXR of linear radiance, or a PNG. Where absent, the path
    /// tracer's, or supersampled raster.
    #[arg(long)]
    pub reference: Option<PathBuf>,
    /// Samples per pixel of that.
    #[arg(long, default_value_t = 64, value_parser = clap::value_parser!(u32).range(1..=65_536))]
    pub spp: u32,
    /// Folder of the results.
    #[arg(long, short)]
    pub out: PathBuf,
}

/// `cairn-player compare`.
#[derive(clap::Args, Debug)]
pub struct CompareArgs {
    #[command(flatten)]
    pub scene: SceneArgs,
    /// Frames to measure of each feature; 16 more are drawn before.
    #[arg(long, default_value_t = 64, value_parser = clap::value_parser!(u32).range(1..=100_000))]
    pub frames: u32,
    /// Samples per pixel of the reference.
    #[arg(long, default_value_t = 64, value_parser = clap::value_parser!(u32).range(1..=65_536))]
    pub spp: u32,
    /// Folder of the results.
    #[arg(long, short)]
    pub out: PathBuf,
}

/// `cairn-player converge`.
#[derive(clap::Args, Debug)]
pub struct ConvergeArgs {
    #[command(flatten)]
    pub scene: SceneArgs,
    /// Most samples per pixel; pictures are measured at each power of two up to it.
    #[arg(long, default_value_t = 1024, value_parser = clap::value_parser!(u32).range(1..=65_536))]
    pub spp: u32,
    /// Samples per pixel of the reference.
    #[arg(long, default_value_t = 8192, value_parser = clap::value_parser!(u32).range(1..=1_048_576))]
    pub reference_spp: u32,
    /// Folder of the results.
    #[arg(long, short)]
    pub out: PathBuf,
}

/// `cairn-player bench`.
#[derive(clap::Args, Debug)]
pub struct BenchArgs {
    #[command(flatten)]
    pub scene: SceneArgs,
    /// Frames to measure; 16 more are drawn before.
    #[arg(long, default_value_t = 200, value_parser = clap::value_parser!(u32).range(1..=100_000))]
    pub frames: u32,
    /// `orbit` around the scene's centre from --camera on, `still`, `cameras` of the package in turn, or those of
    /// a camera file.
    #[arg(long, default_value = "orbit")]
    pub path: crate::bench::Path,
}

/// A package, how to look at it, and on which device.
#[derive(clap::Args, Debug)]
pub struct SceneArgs {
    /// The package that cairn-bake wrote.
    pub package: PathBuf,
    /// Width and height of the image or window in pixels.
    #[arg(long, default_value = "1280x720", value_parser = parse_size)]
    pub size: (u32, u32),
    /// `auto`, the name of a camera of the scene, or FILE.json:NAME.
    #[arg(long, default_value = "auto")]
    pub camera: String,
    /// Part of the name of the GPU to use.
    #[arg(long)]
    pub device: Option<String>,
    /// Block-compressed formats to use, of those that the device has.
    #[arg(long, value_enum, default_value = "all")]
    pub texture_blocks: AllowedBlocks,
    /// Turn on the Khronos validation layer; any message of it makes the exit code 3.
    #[arg(long)]
    pub validation: bool,
    /// JSON object of settings, such as {"ev": 1, "shadow": {"cascades": 3}}; flags override it.
    #[arg(long = "settings", value_name = "FILE")]
    pub settings_file: Option<PathBuf>,
    #[command(flatten)]
    pub settings: SettingFlags,
}

/// The plain command: look at a package.
#[derive(clap::Args, Debug)]
pub struct ViewArgs {
    #[command(flatten)]
    pub scene: SceneArgs,
    /// Open the window without its panel; F1 shows it.
    #[arg(long)]
    pub no_panel: bool,
    /// Render without a window.
    #[arg(long)]
    pub headless: bool,
    /// Frames to render; headless keeps the last one, a window closes after them.
    #[arg(long, value_parser = clap::value_parser!(u32).range(1..))]
    pub frames: Option<u32>,
    /// Where the PNG goes (headless).
    #[arg(long, short)]
    pub out: Option<PathBuf>,
    /// Print one JSON line with device, times and counts.
    #[arg(long)]
    pub json: bool,
    /// Path tracing (headless): samples per pixel.
    #[arg(long, value_parser = clap::value_parser!(u32).range(1..))]
    pub spp: Option<u32>,
    /// Path tracing (headless): seconds.
    #[arg(long, value_name = "SECONDS")]
    pub time: Option<f64>,
    /// Path tracing (headless): stop at this estimated relative error, such as 0.01.
    #[arg(long, value_name = "ERROR")]
    pub target_error: Option<f64>,
    /// Path tracing (headless): count rays.
    #[arg(long)]
    pub count_rays: bool,
    /// Path tracing (headless): measure afterwards which share of the time rays take, by tracing each ray twice.
    #[arg(long)]
    pub trace_split: bool,
}

impl ViewArgs {
    /// When path tracing ends.
    pub fn trace(&self) -> TraceOptions {
        TraceOptions {
            samples: self.spp,
            seconds: self.time,
            target_error: self.target_error,
            count_rays: self.count_rays,
            split: self.trace_split,
            ..TraceOptions::default()
        }
    }
}

const EXAMPLES: &str = "Examples:
  cairn-player hall.cairn
  cairn-player hall.cairn --camera hero --ev 0.5
  cairn-player hall.cairn --headless --size 1920x1080 --out hall.png --json
  cairn-player bench hall.cairn --size 1920x1080 --path cameras
  cairn-player sweep hall.cairn --reference hall.exr -o sweep
  cairn-player compare hall.cairn --camera hero -o compare
  cairn-player converge hall.cairn --camera hero --size 640x360 -o converge
  cairn-player helmet.cairn --headless --camera cameras.json:helmet --tonemap linear --brdf gltf-core -o a.png

Exit codes: 0 success, 1 GPU or driver failure, 2 bad input, 3 validation messages.";

impl SceneArgs {
    /// Opens the package.
    ///
    /// # Errors
    /// [`PlayerError::Package`].
    pub fn open(&self) -> Result<Package, PlayerError> {
        Ok(Package::open(&self.package)?)
    }

    /// Device and validation.
    pub fn gpu(&self) -> GpuOptions {
        GpuOptions {
            validation: self.validation,
            device: self.device.clone(),
            cache: crate::user::cache_folder(),
            blocks: self.texture_blocks,
        }
    }

    /// `base` with what the file and then the flags say.
    ///
    /// # Errors
    /// [`PlayerError::Input`] naming the file and the setting.
    pub fn settings(&self, base: Settings) -> Result<Settings, PlayerError> {
        let mut settings = base;
        if let Some(file) = &self.settings_file {
            settings.merge_file(file)?;
        }
        self.settings.apply(&mut settings);
        Ok(settings)
    }

    /// As [`Self::settings`] of the defaults, for what is measured: a denoised picture is no reference, and its time
    /// not the path tracer's.
    ///
    /// # Errors
    /// As [`Self::settings`]; [`PlayerError::Input`] where they denoise.
    pub fn measured_settings(&self) -> Result<Settings, PlayerError> {
        let settings = self.settings(Settings::default())?;
        if settings.path.denoise {
            return Err(PlayerError::Input(
                "--path-denoise (`path.denoise`): what is measured is never denoised; leave it out"
                    .into(),
            ));
        }
        Ok(settings)
    }

    /// The camera that `--camera` stands for.
    ///
    /// # Errors
    /// [`PlayerError::Input`] naming the cameras there are.
    pub fn camera(&self, package: &Package) -> Result<Camera, PlayerError> {
        let scene = package.scene();
        let bounds = crate::scene::bounds(package);
        let aspect = self.size.0 as f32 / self.size.1 as f32;
        if self.camera == "auto" {
            return Ok(Camera::framing(bounds, aspect));
        }
        if let Some(camera) = scene
            .cameras
            .iter()
            .find(|camera| camera.name == self.camera)
        {
            let camera = Camera::from_package(camera);
            return camera.ok_or_else(|| {
                PlayerError::Input(format!("camera `{}` has no view", self.camera))
            });
        }
        if let Some((file, name)) = self.camera.rsplit_once(':') {
            return Ok(camera_file::load(file.as_ref(), name)?.with_near_for(bounds));
        }
        let names: Vec<&str> = scene
            .cameras
            .iter()
            .map(|camera| camera.name.as_str())
            .collect();
        Err(PlayerError::Input(format!(
            "no camera `{}` in the package; there are: auto{}{}",
            self.camera,
            if names.is_empty() { "" } else { ", " },
            names.join(", ")
        )))
    }
}

fn parse_size(text: &str) -> Result<(u32, u32), String> {
    let parts = text
        .split_once('x')
        .and_then(|(w, h)| Some((w.parse().ok()?, h.parse().ok()?)));
    match parts {
        Some((width, height)) if (1..=16384).contains(&width) && (1..=16384).contains(&height) => {
            Ok((width, height))
        }
        _ => Err("expected WIDTHxHEIGHT, each 1..=16384, such as 1280x720".into()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use clap::Parser;

    #[test]
    fn the_command_line_is_consistent() {
        use clap::CommandFactory;
        Cli::command().debug_assert();
    }

    #[test]
    fn flags_override_the_file_and_the_file_the_base() {
        let file = tempfile::NamedTempFile::new().expect("a file");
        std::fs::write(file.path(), r#"{"ev": 2, "msaa": 4}"#).expect("written");
        let path = file.path().to_str().expect("UTF-8");
        let cli = Cli::parse_from(["p", "a.cairn", "--ev", "-1", "--settings", path]);
        let Cli::View(view) = cli else {
            panic!("a command")
        };
        let base = Settings {
            ev: 7.0,
            msaa: 8,
            debug_view: 3,
            ..Settings::default()
        };
        let settings = view.scene.settings(base).expect("allowed");
        assert_eq!(
            (settings.ev, settings.msaa, settings.debug_view),
            (-1.0, 4, 3)
        );
    }

    #[test]
    fn a_package_is_needed() {
        assert!(Cli::try_parse_from(["p"]).is_err());
        assert!(Cli::try_parse_from(["p", "bench"]).is_err());
        let cli = Cli::parse_from(["p", "bench", "a.cairn", "--ev", "1"]);
        assert!(matches!(cli, Cli::Command(Command::Bench(_))));
        let Cli::View(view) = Cli::parse_from(["p", "a.cairn"]) else {
            panic!("a command")
        };
        assert_eq!(view.scene.size, (1280, 720));
    }

    #[test]
    fn sizes_are_bounded() {
        assert_eq!(parse_size("1x16384"), Ok((1, 16384)));
        for bad in ["0x1", "1", "1x", "99999x1", "-1x5", "axb"] {
            assert!(parse_size(bad).is_err(), "{bad}");
        }
    }
}
