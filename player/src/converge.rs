//! `cairn-player converge`: the path tracer's error against samples and against seconds, one curve for each sampler.

pub mod plot;

use cairn_format::Package;
use serde::Serialize;

use crate::PlayerError;
use crate::bench;
use crate::camera::Camera;
use crate::gpu::{Gpu, GpuOptions};
use crate::headless::HeadlessOptions;
use crate::headless::trace::{TraceOptions, trace_on, trace_series};
use crate::metrics::{Picture, difference};
use crate::ruler::average;
use crate::settings::{Mode, PathSampler, Settings};

/// Side of the squares over which errors are also averaged: what is left of them from afar.
const BLOCK: usize = 4;
/// Samples from which the slope is measured.
const SLOPE_FROM: u32 = 4;
/// What sets the reference's seed apart.
const OTHER_SEED: u32 = 0x2545_f491;

/// What to measure.
#[derive(Clone, Debug)]
pub struct ConvergeOptions {
    /// Pixels.
    pub size: [u32; 2],
    /// Viewpoint.
    pub camera: Camera,
    /// Look; the sampler is that of each curve.
    pub settings: Settings,
    /// Most samples per pixel.
    pub samples: u32,
    /// Samples per pixel of the reference, which has another seed.
    pub reference_samples: u32,
}

/// One picture.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Point {
    /// Samples per pixel.
    pub samples: u32,
    /// Wall time of tracing them, with one copy of the picture.
    pub seconds: f64,
    /// Root mean square error of linear radiance, over pixels and channels.
    pub rmse: f64,
    /// The same of means over 4x4 pixels.
    pub rmse_4x4: f64,
}

/// All pictures of one sampler.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Curve {
    /// As the setting has it.
    pub sampler: &'static str,
    pub points: Vec<Point>,
    /// Exponent of the fitted power law of `rmse` over samples, from 4 samples on; `None` of fewer than two points.
    pub slope: Option<f64>,
}

/// All curves, and what they depend on.
#[derive(Clone, Debug, Serialize)]
pub struct ConvergeReport {
    #[serde(flatten)]
    pub origin: bench::Origin,
    /// Samples per pixel of the reference. Its own error is in every point.
    pub reference_samples: u32,
    pub curves: Vec<Curve>,
}

/// Traces and measures every sampler at 1, 2, 4 .. samples.
///
/// # Errors
/// [`PlayerError::Input`] where the device cannot trace rays, or for a size that it cannot render; a bad package;
/// failures of Vulkan.
pub fn run(
    gpu: &Gpu,
    package: &Package,
    options: &ConvergeOptions,
) -> Result<ConvergeReport, PlayerError> {
    let reference = reference(gpu, package, options)?;
    let counts: Vec<u32> = (0..)
        .map(|power| 1 << power)
        .take_while(|count| *count <= options.samples)
        .collect();
    let mut curves = Vec::new();
    for sampler in [
        PathSampler::Independent,
        PathSampler::Owen,
        PathSampler::BlueNoise,
    ] {
        let headless = headless(options, options.settings.path.seed, sampler);
        let mut points = Vec::new();
        for stage in trace_series(gpu, package, &headless, &counts)? {
            let picture = picture(options.size, &stage.radiance);
            points.push(Point {
                samples: stage.samples,
                seconds: stage.seconds,
                rmse: rmse(&picture, &reference),
                rmse_4x4: rmse(&average(&picture, BLOCK), &average(&reference, BLOCK)),
            });
        }
        curves.push(Curve {
            sampler: sampler.name(),
            slope: slope(&points),
            points,
        });
    }
    Ok(ConvergeReport {
        origin: bench::Origin::new(gpu, package, options.size, &options.settings),
        reference_samples: options.reference_samples,
        curves,
    })
}

fn headless(options: &ConvergeOptions, seed: u32, sampler: PathSampler) -> HeadlessOptions {
    let mut settings = Settings {
        mode: Mode::PathTrace,
        ..options.settings.clone()
    };
    settings.path.seed = seed;
    settings.path.sampler = sampler;
    HeadlessOptions {
        size: options.size,
        camera: options.camera,
        settings,
        frames: 1,
        hdr: true,
        gpu: GpuOptions::default(),
    }
}

fn reference(
    gpu: &Gpu,
    package: &Package,
    options: &ConvergeOptions,
) -> Result<Picture, PlayerError> {
    let seed = options.settings.path.seed ^ OTHER_SEED;
    let headless = headless(options, seed, PathSampler::Owen);
    let limits = TraceOptions {
        samples: Some(options.reference_samples),
        ..TraceOptions::default()
    };
    let image = trace_on(gpu, package, &headless, &limits)?;
    let Some(radiance) = image.hdr else {
        panic!("radiance was asked for")
    };
    Ok(picture(options.size, &radiance))
}

fn picture(size: [u32; 2], radiance: &[[f32; 4]]) -> Picture {
    Picture::from_rgba(size[0] as usize, size[1] as usize, radiance)
}

fn rmse(test: &Picture, reference: &Picture) -> f64 {
    match difference(test, reference) {
        Ok(difference) => difference.rmse,
        Err(mismatch) => panic!("{mismatch}"),
    }
}

/// Least squares over logarithms.
fn slope(points: &[Point]) -> Option<f64> {
    let logs: Vec<(f64, f64)> = points
        .iter()
        .filter(|point| point.samples >= SLOPE_FROM && point.rmse > 0.0)
        .map(|point| (f64::from(point.samples).ln(), point.rmse.ln()))
        .collect();
    if logs.len() < 2 {
        return None;
    }
    let count = logs.len() as f64;
    let (x, y) = logs.iter().fold((0.0, 0.0), |sum, log| {
        (sum.0 + log.0 / count, sum.1 + log.1 / count)
    });
    let (above, below) = logs.iter().fold((0.0, 0.0), |sum, log| {
        let step = log.0 - x;
        (sum.0 + step * (log.1 - y), sum.1 + step * step)
    });
    Some(above / below)
}

impl ConvergeReport {
    /// A table for people.
    pub fn table(&self) -> String {
        use std::fmt::Write;
        let mut text = format!(
            "{} against {} samples\n{:>10}",
            self.origin.device, self.reference_samples, "samples"
        );
        for curve in &self.curves {
            let _ = write!(text, "{:>14}{:>10}{:>10}", curve.sampler, "4x4", "s");
        }
        text.push('\n');
        let rows = self.curves.first().map_or(0, |curve| curve.points.len());
        for row in 0..rows {
            let _ = write!(text, "{:>10}", self.curves[0].points[row].samples);
            for point in self.curves.iter().map(|curve| &curve.points[row]) {
                let _ = write!(
                    text,
                    "{:>14.6}{:>10.6}{:>10.4}",
                    point.rmse, point.rmse_4x4, point.seconds
                );
            }
            text.push('\n');
        }
        let _ = write!(text, "{:>10}", "slope");
        for curve in &self.curves {
            let slope = curve
                .slope
                .map_or("-".into(), |slope| format!("{slope:.3}"));
            let _ = write!(text, "{slope:>14}{:>20}", "");
        }
        text.push('\n');
        text
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_slope_is_that_of_the_power_law() {
        let point = |samples: u32| Point {
            samples,
            seconds: 0.0,
            // A first point off the line, which is left out.
            rmse: if samples == 1 {
                9.0
            } else {
                3.0 * f64::from(samples).powf(-0.75)
            },
            rmse_4x4: 0.0,
        };
        let points: Vec<Point> = [1, 4, 8, 64].map(point).into();
        assert!((slope(&points).expect("three points") + 0.75).abs() < 1e-9);
        assert_eq!(slope(&points[..2]), None);
    }
}
