//! `cairn-player compare`: the raster picture beside a reference from the same camera, whole and feature by feature.

pub mod page;

use cairn_format::Package;
use serde::Serialize;

use crate::PlayerError;
use crate::bench::{self, BenchOptions};
use crate::camera::Camera;
use crate::gpu::Gpu;
use crate::metrics::{Difference, Picture, difference, display, flip, heatmap, signed_difference};
use crate::ruler::{Ruler, raster};
use crate::settings::{LightSource, Mode, Settings};

/// Frames before the compared one, in which temporal filters settle.
const SETTLING: u32 = 64;
/// Contrast of the difference pictures.
const GAIN: f32 = 2.0;

/// What to compare.
#[derive(Clone, Debug)]
pub struct CompareOptions {
    /// Pixels.
    pub size: [u32; 2],
    /// Viewpoint.
    pub camera: Camera,
    /// Look of both.
    pub settings: Settings,
    /// Measured frames of each feature.
    pub frames: u32,
    /// Samples per pixel of the reference.
    pub samples: u32,
}

/// One feature alone, or all of them.
#[derive(Clone, Debug, Serialize)]
pub struct Row {
    /// What is compared.
    pub feature: &'static str,
    /// Median GPU milliseconds of a raster frame; `None` without timestamps.
    pub gpu_ms: Option<f64>,
    /// Seconds that the reference took.
    pub reference_s: f64,
    #[serde(flatten)]
    pub error: Difference,
    /// Mean FLIP of the display values.
    pub flip: f64,
    /// Linear display values.
    #[serde(skip)]
    pub pictures: Pictures,
}

/// The pictures of a row, in linear display values, and radiance.
#[derive(Clone, Debug)]
pub struct Pictures {
    pub raster: Picture,
    pub reference: Picture,
    /// Raster minus reference around grey, twice.
    pub difference: Picture,
    pub flip: Picture,
    pub raster_radiance: Picture,
    pub reference_radiance: Picture,
}

/// All rows, and what they depend on.
#[derive(Clone, Debug, Serialize)]
pub struct CompareReport {
    #[serde(flatten)]
    pub origin: bench::Origin,
    pub reference: String,
    /// Why the reference is not path traced, where it is not.
    pub note: Option<&'static str>,
    pub rows: Vec<Row>,
}

/// The row of the whole picture.
const EVERYTHING: &str = "all";

/// What is compared, and how the settings isolate it.
pub fn features(base: &Settings) -> Vec<(&'static str, Settings)> {
    let with = |change: &dyn Fn(&mut Settings)| {
        let mut settings = base.clone();
        change(&mut settings);
        settings
    };
    vec![
        (EVERYTHING, base.clone()),
        (
            "direct light only",
            with(&|settings| settings.path.bounces = 0),
        ),
        (
            "shadows: sun and lights",
            with(&|settings| {
                settings.ibl_intensity = 0.0;
                settings.path.bounces = 0;
                settings.ao.enabled = false;
            }),
        ),
        (
            "image-based light: sky",
            with(&|settings| {
                settings.light.source = LightSource::None;
                settings.path.bounces = 0;
            }),
        ),
        (
            "ambient occlusion",
            with(&|settings| {
                settings.debug_view = 9;
                settings.skybox = false;
            }),
        ),
    ]
}

/// Renders and measures every row.
///
/// # Errors
/// A size that the device cannot render; a bad package; failures of Vulkan.
pub fn run(
    gpu: &Gpu,
    package: &Package,
    options: &CompareOptions,
) -> Result<CompareReport, PlayerError> {
    let ruler = Ruler::best(gpu, options.samples, options.size);
    let mut rows = Vec::new();
    for (feature, settings) in features(&options.settings) {
        let row = row(gpu, package, options, &ruler, feature, settings)?;
        // Two black pictures would claim to agree on a light that the scene does not have.
        if feature == EVERYTHING || !row.is_black() {
            rows.push(row);
        }
    }
    Ok(CompareReport {
        origin: bench::Origin::new(gpu, package, options.size, &options.settings),
        reference: ruler.name(),
        note: ruler.note(),
        rows,
    })
}

fn row(
    gpu: &Gpu,
    package: &Package,
    options: &CompareOptions,
    ruler: &Ruler,
    feature: &'static str,
    settings: Settings,
) -> Result<Row, PlayerError> {
    let settings = Settings {
        mode: Mode::Raster,
        ..settings
    };
    let (size, camera) = (options.size, &options.camera);
    let timed = bench::run(
        gpu,
        package,
        &BenchOptions {
            size,
            camera: options.camera,
            path: bench::Path::Still,
            settings: settings.clone(),
            frames: options.frames,
        },
    )?;
    let raster_radiance = raster(gpu, package, size, camera, &settings, SETTLING)?;
    let start = std::time::Instant::now();
    let reference_radiance = ruler.picture(gpu, package, size, camera, &settings)?;
    let reference_s = start.elapsed().as_secs_f64();
    let [shown, target] =
        [&raster_radiance, &reference_radiance].map(|picture| display::display(picture, &settings));
    let sized = "both pictures have the size that was asked for";
    let map = flip::ldr(&shown, &target, flip::PIXELS_PER_DEGREE).expect(sized);
    Ok(Row {
        feature,
        gpu_ms: timed.gpu_ms.map(|ms| ms.p50),
        reference_s,
        error: difference(&raster_radiance, &reference_radiance).expect(sized),
        flip: map.mean(),
        pictures: Pictures {
            difference: signed_difference(&shown, &target, GAIN).expect(sized),
            flip: heatmap::picture(&map),
            raster: shown,
            reference: target,
            raster_radiance,
            reference_radiance,
        },
    })
}

impl Row {
    fn is_black(&self) -> bool {
        let pictures = [
            &self.pictures.raster_radiance,
            &self.pictures.reference_radiance,
        ];
        let mut texels = pictures.into_iter().flat_map(|picture| &picture.texels);
        texels.all(|texel| texel[..3].iter().all(|channel| *channel == 0.0))
    }
}

impl CompareReport {
    /// A table for people.
    pub fn table(&self) -> String {
        use std::fmt::Write;
        let mut text = format!("{} against {}\n", self.origin.device, self.reference);
        if let Some(note) = self.note {
            let _ = writeln!(text, "note: {note}");
        }
        let _ = writeln!(
            text,
            "{:<26}{:>10}{:>10}{:>10}{:>10}{:>10}{:>12}",
            "", "GPU ms", "RMSE", "relative", "bias", "FLIP", "reference s"
        );
        for row in &self.rows {
            let gpu = row.gpu_ms.map_or("-".into(), |ms| format!("{ms:.3}"));
            let error = &row.error;
            let _ = writeln!(
                text,
                "{:<26}{gpu:>10}{:>10.5}{:>10.5}{:>10.5}{:>10.5}{:>12.2}",
                row.feature, error.rmse, error.relative, error.bias, row.flip, row.reference_s
            );
        }
        text
    }
}
