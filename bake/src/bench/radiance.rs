//! The BC6H encoders side by side: texels a second of one thread, and the error of what they store.

use std::path::{Path, PathBuf};

use half::f16;
use serde::Serialize;

use super::{clock, middle};
use crate::diagnostic::Result;
use crate::encode::peers::{self, HalfBlocks, HalfEncoder};
use crate::encode::{RadianceError, half_bits};
use crate::environment::{EnvironmentOptions, Equirect, SunMode, bake_environment};
use crate::import::load_environment;

/// What to measure.
#[derive(Clone, Debug)]
pub struct Options {
    /// Panoramas.
    pub images: Vec<PathBuf>,
    /// Most texels in each axis: larger images are cropped about their centre.
    pub crop: u32,
    /// Texels of a side of the faces that panoramas are also turned into; none where 0.
    pub face: u32,
    /// Least CPU seconds of each measurement; short ones are repeated.
    pub seconds: f64,
}

/// What one encoder reached.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Figures {
    pub encoder: &'static str,
    pub preset: &'static str,
    /// Of one thread, by CPU seconds; over several images, all texels over all seconds.
    pub megapixels_per_second: f64,
    /// Of base-2 logarithms: [`LogError::psnr_db`](crate::encode::LogError::psnr_db). Over several images their mean.
    pub log2_psnr_db: f64,
    /// Mean of |error| / radiance over channels above the smallest normal half.
    pub mean_relative: f64,
    /// Root of the squared error over the squared radiance.
    pub relative_rms: f64,
}

/// One encoder on one image.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Measurement {
    pub image: String,
    #[serde(flatten)]
    pub figures: Figures,
}

/// The whole comparison.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Report {
    pub measurements: Vec<Measurement>,
    pub means: Vec<Figures>,
}

/// Measures every encoder on every image, on the calling thread.
///
/// # Errors
/// An image that cannot be read.
pub fn run(options: &Options, progress: &dyn Fn(f32)) -> Result<Report> {
    let mut report = Report::default();
    if options.images.is_empty() {
        return Ok(report);
    }
    let encoders = peers::all_half();
    for (at, path) in options.images.iter().enumerate() {
        for (name, source) in pictures(path, options)? {
            for encoder in &encoders {
                report.measurements.push(Measurement {
                    image: name.clone(),
                    figures: measure(encoder, &source, options.seconds),
                });
            }
        }
        progress((at + 1) as f32 / options.images.len() as f32);
    }
    let means = encoders.iter().map(|encoder| {
        let of = |one: &&Measurement| {
            (one.figures.encoder, one.figures.preset) == (encoder.name, encoder.preset)
        };
        let all: Vec<&Measurement> = report.measurements.iter().filter(of).collect();
        let mean = |value: fn(&Figures) -> f64| {
            all.iter().map(|one| value(&one.figures)).sum::<f64>() / all.len() as f64
        };
        Figures {
            encoder: encoder.name,
            preset: encoder.preset,
            megapixels_per_second: 1.0 / mean(|one| 1.0 / one.megapixels_per_second),
            log2_psnr_db: mean(|one| one.log2_psnr_db),
            mean_relative: mean(|one| one.mean_relative),
            relative_rms: mean(|one| one.relative_rms),
        }
    });
    report.means = means.collect();
    Ok(report)
}

/// The centre of a panorama, and the faces of its cube.
fn pictures(path: &Path, options: &Options) -> Result<Vec<(String, HalfBlocks)>> {
    let image = load_environment(path)?;
    let name = path.file_stem().unwrap_or_default().to_string_lossy();
    let (width, height) = (image.width as usize, image.height as usize);
    let [(left, across), (top, down)] = [width, height].map(|extent| middle(extent, options.crop));
    let texel = |x: usize, y: usize| {
        image.texels[(top + y).min(height - 1) * width + (left + x).min(width - 1)]
    };
    let mut all = vec![(name.to_string(), cut(across, down, texel))];
    if options.face > 0 {
        let face = (options.face as usize / 4 * 4).max(4);
        let map = Equirect {
            width: image.width,
            height: image.height,
            texels: image.texels,
        };
        let light = EnvironmentOptions {
            sky_size: Some(face as u32),
            prefiltered_size: 16,
            probes: 0,
            sun: SunMode::Keep,
            ..EnvironmentOptions::default()
        };
        let sky = bake_environment(map, &light, &|_, _| {}).sky;
        let blocks = cut(face, 6 * face, |x, y| sky.levels[0][y * face + x]);
        all.push((format!("{name}, cube"), blocks));
    }
    Ok(all)
}

fn cut(across: usize, down: usize, texel: impl Fn(usize, usize) -> [f32; 3]) -> HalfBlocks {
    let blocks = (0..across / 4 * (down / 4)).map(|block| {
        let (left, top) = (block % (across / 4) * 4, block / (across / 4) * 4);
        std::array::from_fn(|at| {
            let radiance = texel(left + at % 4, top + at / 4);
            radiance.map(half_bits)
        })
    });
    HalfBlocks::new(blocks.collect())
}

fn measure(encoder: &HalfEncoder, source: &HalfBlocks, least: f64) -> Figures {
    let mut out = vec![[0_u8; 16]; source.blocks.len()];
    let seconds = clock::of_one(least, || encoder.compress(source, &mut out));
    let mut error = RadianceError::default();
    let (mut relative, mut count) = (0.0, 0_u64);
    let value = |texel: [u16; 3]| texel.map(|bits| f16::from_bits(bits).to_f32());
    for (exact, block) in source.blocks.iter().zip(&out) {
        for (&exact, stored) in exact.iter().zip(peers::decode_half(block)) {
            let [exact, stored] = [exact, stored].map(value);
            error.texel(exact, stored);
            for (exact, stored) in exact.into_iter().zip(stored) {
                if exact >= f16::MIN_POSITIVE.to_f32() {
                    let [exact, stored] = [exact, stored].map(f64::from);
                    relative += (exact - stored).abs() / exact;
                    count += 1;
                }
            }
        }
    }
    Figures {
        encoder: encoder.name,
        preset: encoder.preset,
        megapixels_per_second: 16e-6 * out.len() as f64 / seconds.max(1e-9),
        log2_psnr_db: error.log.psnr_db(),
        mean_relative: relative / count.max(1) as f64,
        relative_rms: error.relative_rms(),
    }
}
