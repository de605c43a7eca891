//! `cairn-player bench`: what each pass of a frame costs along a fixed path of the camera.

use std::path::PathBuf;

use cairn_format::Package;
use glam::{Mat3, Vec3};
use serde::Serialize;

use crate::camera::Camera;
use crate::draw::DrawStats;
use crate::gpu::{Gpu, PassTime};
use crate::headless::Session;
use crate::scene;
use crate::settings::Settings;
use crate::{PlayerError, camera_file};

/// Frames before the measured ones: caches, clocks and histories settle.
pub const DROPPED: u32 = 16;

/// The commit that this program was built from, or `unknown`.
pub const COMMIT: &str = env!("CAIRN_COMMIT");

/// How the camera moves.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Path {
    /// Once around the scene's centre, about the vertical, from `--camera` on.
    Orbit,
    /// Stays.
    Still,
    /// The cameras of the package, each for an equal part of the frames.
    Cameras,
    /// Those of a camera file, likewise in the order of their names.
    File(PathBuf),
}

impl std::str::FromStr for Path {
    type Err = std::convert::Infallible;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        Ok(match text {
            "orbit" => Self::Orbit,
            "still" => Self::Still,
            "cameras" => Self::Cameras,
            file => Self::File(file.into()),
        })
    }
}

/// What to measure.
#[derive(Clone, Debug)]
pub struct BenchOptions {
    /// Pixels.
    pub size: [u32; 2],
    /// Where the path begins.
    pub camera: Camera,
    /// How it goes on.
    pub path: Path,
    /// Look of every frame.
    pub settings: Settings,
    /// Measured frames, at least 1; [`DROPPED`] more are drawn before.
    pub frames: u32,
}

/// Median and 95th percentile.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Percentiles {
    pub p50: f64,
    pub p95: f64,
}

/// A pass and its GPU milliseconds.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct PassCost {
    pub name: String,
    #[serde(flatten)]
    pub ms: Percentiles,
}

/// What any measurement depends on.
#[derive(Clone, Debug, Serialize)]
pub struct Origin {
    pub schema: u32,
    pub tool: &'static str,
    pub commit: &'static str,
    pub device: String,
    pub driver: String,
    /// BLAKE3 of the package, hexadecimal.
    pub scene: String,
    pub size: [u32; 2],
    pub settings: Settings,
}

impl Origin {
    /// Of measurements taken with these.
    pub fn new(gpu: &Gpu, package: &Package, size: [u32; 2], settings: &Settings) -> Self {
        Self {
            schema: 1,
            tool: concat!("cairn-player ", env!("CARGO_PKG_VERSION")),
            commit: COMMIT,
            device: gpu.device_name().into(),
            driver: gpu.driver().into(),
            scene: scene_hash(package),
            size,
            settings: settings.clone(),
        }
    }
}

/// Times of a run, and all that they depend on.
#[derive(Clone, Debug, Serialize)]
pub struct BenchReport {
    #[serde(flatten)]
    pub origin: Origin,
    pub path: String,
    pub frames: u32,
    pub dropped: u32,
    /// Sum of the passes of a frame; `None` where the queue has no timestamps.
    pub gpu_ms: Option<Percentiles>,
    /// Culling, grouping and recording on one core.
    pub record_ms: Percentiles,
    /// In the order of the frame.
    pub passes: Vec<PassCost>,
    /// Of the last frame.
    pub draws: DrawStats,
}

/// Draws the path and measures.
///
/// # Errors
/// [`PlayerError::Input`] for a path without cameras or a bad size; a bad package; failures of Vulkan.
pub fn run(
    gpu: &Gpu,
    package: &Package,
    options: &BenchOptions,
) -> Result<BenchReport, PlayerError> {
    let stops = stops(package, options)?;
    let mut session = Session::new(gpu, package, options.size, &options.settings, false)?;
    let mut samples = Samples::default();
    let total = DROPPED + options.frames.max(1);
    for index in 0..total {
        let measured = index.saturating_sub(DROPPED);
        let camera = stops.at(measured, options.frames);
        let seconds = session.frame(&camera, &options.settings, false)?;
        if index >= DROPPED {
            samples.record.push(seconds * 1e3);
        }
        // The times at hand are those of the frame before.
        if index > DROPPED {
            samples.add(session.timings());
        }
    }
    session.finish()?;
    samples.add(session.timings());
    Ok(BenchReport {
        origin: Origin::new(gpu, package, options.size, &options.settings),
        path: format!("{:?}", options.path).to_lowercase(),
        frames: options.frames,
        dropped: DROPPED,
        gpu_ms: samples.gpu(),
        record_ms: percentiles(&mut samples.record.clone()),
        passes: samples.passes(),
        draws: session.draw_stats(),
    })
}

/// The package's own hash of its contents, hexadecimal.
fn scene_hash(package: &Package) -> String {
    let hash = package.header().content_hash;
    hash.iter().map(|byte| format!("{byte:02x}")).collect()
}

/// Cameras to stop at, or the one to go around with.
enum Stops {
    Orbit(Camera, Vec3),
    Each(Vec<Camera>),
}

fn stops(package: &Package, options: &BenchOptions) -> Result<Stops, PlayerError> {
    let bounds = scene::bounds(package);
    let center = if bounds.is_empty() {
        Vec3::ZERO
    } else {
        bounds.center()
    };
    let cameras = match &options.path {
        Path::Orbit => return Ok(Stops::Orbit(options.camera, center)),
        Path::Still => vec![options.camera],
        Path::Cameras => package
            .scene()
            .cameras
            .iter()
            .filter_map(Camera::from_package)
            .collect(),
        Path::File(file) => {
            let near = |(_, camera): (String, Camera)| camera.with_near_for(bounds);
            camera_file::load_all(file)?.into_iter().map(near).collect()
        }
    };
    if cameras.is_empty() {
        return Err(PlayerError::Input(
            "the path has no camera: use --path orbit or still".into(),
        ));
    }
    Ok(Stops::Each(cameras))
}

impl Stops {
    fn at(&self, frame: u32, frames: u32) -> Camera {
        let part = f64::from(frame) / f64::from(frames.max(1));
        match self {
            Self::Orbit(camera, center) => {
                let turn = Mat3::from_rotation_y((part * std::f64::consts::TAU) as f32);
                Camera {
                    position: *center + turn * (camera.position - *center),
                    forward: turn * camera.forward,
                    up: turn * camera.up,
                    ..*camera
                }
            }
            Self::Each(cameras) => {
                let index = (part * cameras.len() as f64) as usize;
                cameras[index.min(cameras.len() - 1)]
            }
        }
    }
}

/// Milliseconds of every measured frame.
#[derive(Default)]
struct Samples {
    record: Vec<f64>,
    total: Vec<f64>,
    passes: Vec<(String, Vec<f64>)>,
}

impl Samples {
    fn add(&mut self, frame: &[PassTime]) {
        if frame.is_empty() {
            return;
        }
        self.total
            .push(frame.iter().map(|pass| pass.milliseconds).sum());
        for pass in frame {
            let name = pass.name.to_string_lossy();
            match self.passes.iter_mut().find(|(known, _)| *known == name) {
                Some((_, times)) => times.push(pass.milliseconds),
                None => self
                    .passes
                    .push((name.into_owned(), vec![pass.milliseconds])),
            }
        }
    }

    fn gpu(&self) -> Option<Percentiles> {
        (!self.total.is_empty()).then(|| percentiles(&mut self.total.clone()))
    }

    fn passes(self) -> Vec<PassCost> {
        let cost = |(name, mut times): (String, Vec<f64>)| PassCost {
            name,
            ms: percentiles(&mut times),
        };
        self.passes.into_iter().map(cost).collect()
    }
}

/// Nearest-rank percentiles, which are measured values.
///
/// # Panics
/// Where there are no times.
fn percentiles(times: &mut [f64]) -> Percentiles {
    times.sort_unstable_by(f64::total_cmp);
    let rank = |percent: usize| times[(times.len() * percent).div_ceil(100).max(1) - 1];
    Percentiles {
        p50: rank(50),
        p95: rank(95),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn percentiles_are_measured_values() {
        let mut times: Vec<f64> = (1..=100).rev().map(f64::from).collect();
        assert_eq!(
            percentiles(&mut times),
            Percentiles {
                p50: 50.0,
                p95: 95.0
            }
        );
        assert_eq!(percentiles(&mut [3.0]), Percentiles { p50: 3.0, p95: 3.0 });
        assert_eq!(
            percentiles(&mut [1.0, 2.0]),
            Percentiles { p50: 1.0, p95: 2.0 }
        );
    }

    #[test]
    fn an_orbit_keeps_its_distance_and_its_view() {
        let camera =
            Camera::look_at(Vec3::new(3.0, 1.0, 0.0), Vec3::ZERO, Vec3::Y, 1.0).expect("a view");
        let orbit = Stops::Orbit(camera, Vec3::ZERO);
        assert_eq!(orbit.at(0, 8), camera);
        let quarter = orbit.at(2, 8);
        assert!((quarter.position - Vec3::new(0.0, 1.0, -3.0)).length() < 1e-5);
        assert!(quarter.forward.dot(-quarter.position.normalize()) > 0.99999);
    }

    #[test]
    fn cameras_take_turns() {
        let cameras: Vec<Camera> = (0..3)
            .map(|x| Camera {
                position: Vec3::X * x as f32,
                ..Camera::default()
            })
            .collect();
        let stops = Stops::Each(cameras);
        let at: Vec<f32> = (0..6).map(|frame| stops.at(frame, 6).position.x).collect();
        assert_eq!(at, [0.0, 0.0, 1.0, 1.0, 2.0, 2.0]);
    }
}
