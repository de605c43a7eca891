//! The command line of `cairn-player`, as typed and as meant.

use std::path::PathBuf;

use crate::camera::Camera;
use crate::camera_file;
use crate::error::PlayerError;
use crate::settings::{Brdf, Settings, Tonemap};
use cairn_format::{Aabb, Package};

/// Render a Cairn package: in a window, or headless into a PNG.
#[derive(clap::Parser, Debug)]
#[command(version, after_help = EXAMPLES)]
pub struct Args {
    /// The package that cairn-bake wrote.
    pub package: PathBuf,
    /// Render without a window.
    #[arg(long)]
    pub headless: bool,
    /// Width and height of the image or window in pixels.
    #[arg(long, default_value = "1280x720", value_parser = parse_size)]
    pub size: (u32, u32),
    /// `auto`, the name of a camera of the scene, or FILE.json:NAME.
    #[arg(long, default_value = "auto")]
    pub camera: String,
    /// Frames to render; headless keeps the last one, a window closes after them.
    #[arg(long, value_parser = clap::value_parser!(u32).range(1..))]
    pub frames: Option<u32>,
    /// Where the PNG goes (headless).
    #[arg(long, short)]
    pub out: Option<PathBuf>,
    /// Print one JSON line with device, times and counts.
    #[arg(long)]
    pub json: bool,
    /// Energy-compensated BRDF, or exactly glTF's core one.
    #[arg(long, value_enum, default_value_t)]
    pub brdf: Brdf,
    /// Display curve.
    #[arg(long, value_enum, default_value_t)]
    pub tonemap: Tonemap,
    /// Exposure value: the image is multiplied by 2^EV.
    #[arg(long, default_value_t = 0.0, value_parser = parse_finite, allow_hyphen_values = true)]
    pub ev: f32,
    /// Multiplier of image-based light.
    #[arg(long, default_value_t = 1.0, value_parser = parse_finite)]
    pub ibl_intensity: f32,
    /// Yaw of the environment in degrees.
    #[arg(long, default_value_t = 0.0, value_parser = parse_finite, allow_hyphen_values = true)]
    pub ibl_yaw: f32,
    /// Do not draw the environment behind the scene.
    #[arg(long)]
    pub no_skybox: bool,
    /// Debug view: 1 diffuse, 2 specular, 3 indirect, 4 normal, 5 metallic, 6 roughness, 7 occlusion.
    #[arg(long, default_value_t = 0)]
    pub debug_view: u32,
    /// Part of the name of the GPU to use.
    #[arg(long)]
    pub device: Option<String>,
    /// Turn on the Khronos validation layer; any message of it makes the exit code 3.
    #[arg(long)]
    pub validation: bool,
}

const EXAMPLES: &str = "Examples:
  cairn-player hall.cairn
  cairn-player hall.cairn --camera hero --ev 0.5
  cairn-player hall.cairn --headless --size 1920x1080 --out hall.png --json
  cairn-player helmet.cairn --headless --camera cameras.json:helmet --tonemap linear --brdf gltf-core -o a.png

Exit codes: 0 success, 1 GPU or driver failure, 2 bad input, 3 validation messages.";

impl Args {
    /// The frame settings that the flags stand for.
    pub fn settings(&self) -> Settings {
        Settings {
            brdf: self.brdf,
            tonemap: self.tonemap,
            ev: self.ev,
            ibl_intensity: self.ibl_intensity,
            ibl_yaw: self.ibl_yaw.to_radians(),
            skybox: !self.no_skybox,
            debug_view: self.debug_view,
            ..Settings::default()
        }
    }

    /// The camera that `--camera` stands for.
    ///
    /// # Errors
    /// [`PlayerError::Input`] naming the cameras there are.
    pub fn camera(&self, package: &Package) -> Result<Camera, PlayerError> {
        let scene = package.scene();
        let bounds = Aabb {
            min: cairn_format::scene::natives(&scene.bounds.min).into(),
            max: cairn_format::scene::natives(&scene.bounds.max).into(),
        };
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

fn parse_finite(text: &str) -> Result<f32, String> {
    match text.parse::<f32>() {
        Ok(value) if value.is_finite() => Ok(value),
        _ => Err("expected a finite number".into()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use clap::Parser;

    #[test]
    fn the_command_line_is_consistent() {
        use clap::CommandFactory;
        Args::command().debug_assert();
    }

    #[test]
    fn flags_become_settings() {
        let args = Args::parse_from([
            "p",
            "a.cairn",
            "--ev",
            "-1",
            "--ibl-yaw",
            "-90",
            "--brdf",
            "gltf-core",
        ]);
        let settings = args.settings();
        assert_eq!(settings.ev, -1.0);
        assert_eq!(settings.brdf, Brdf::GltfCore);
        assert!((settings.ibl_yaw + std::f32::consts::FRAC_PI_2).abs() < 1e-6);
    }

    #[test]
    fn sizes_are_bounded() {
        assert_eq!(parse_size("1x16384"), Ok((1, 16384)));
        for bad in ["0x1", "1", "1x", "99999x1", "-1x5", "axb"] {
            assert!(parse_size(bad).is_err(), "{bad}");
        }
    }
}
