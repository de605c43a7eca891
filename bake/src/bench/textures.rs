//! The BC7 encoders side by side: texels a second of one thread, and the error of what they store.

use std::path::{Path, PathBuf};

use serde::Serialize;

use super::{basisu, clock, middle};
use crate::diagnostic::{BakeError, Result};
use crate::encode::peers::{self, Blocks, Encoder};
use crate::import::{DecodedImage, decode_image};
use crate::scene::{Image, Origin};

/// What to measure.
#[derive(Clone, Debug)]
pub struct Options {
    pub images: Vec<PathBuf>,
    /// Most texels in each axis: larger images are cropped about their centre.
    pub crop: u32,
    /// Least CPU seconds of each measurement; short ones are repeated.
    pub seconds: f64,
    /// The `basisu` program; left out where absent.
    pub basisu: Option<PathBuf>,
    /// Largest number of texels of one image.
    pub limit_pixels: u64,
}

/// One encoder on one image.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Measurement {
    pub encoder: &'static str,
    pub preset: &'static str,
    pub image: String,
    /// Of one thread, by CPU seconds.
    pub megapixels_per_second: f64,
    /// Over RGB, or RGBA where alpha is below 1 somewhere; 8-bit codes as stored. 999 where nothing was lost.
    pub psnr_db: f64,
    /// 99th percentile over blocks of the RMS error, in steps of 1/255.
    pub p99_block_rmse: f64,
}

/// One encoder over all images.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Mean {
    pub encoder: &'static str,
    pub preset: &'static str,
    /// All texels over all seconds.
    pub megapixels_per_second: f64,
    /// Means of the images' figures.
    pub psnr_db: f64,
    pub p99_block_rmse: f64,
}

/// The whole comparison.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Report {
    pub measurements: Vec<Measurement>,
    pub means: Vec<Mean>,
}

/// Texels to encode, whole blocks.
pub struct Picture {
    pub name: String,
    pub width: u32,
    pub height: u32,
    /// Rows top to bottom.
    pub texels: Vec<[u8; 4]>,
    /// Whether alpha is below 1 somewhere.
    pub alpha: bool,
}

/// Measures every encoder on every image, on the calling thread.
///
/// # Errors
/// An image that cannot be read, or `basisu` where it is given and fails.
pub fn run(options: &Options, progress: &dyn Fn(f32)) -> Result<Report> {
    let encoders = peers::all();
    let mut report = Report::default();
    let mut seconds: Vec<(&str, &str, f64, f64)> = Vec::new();
    for (at, path) in options.images.iter().enumerate() {
        let picture = read(path, options)?;
        let megapixels = picture.texels.len() as f64 / 1e6;
        let mut add = |encoder, preset, time: f64, errors: [f64; 2]| {
            report.measurements.push(Measurement {
                encoder,
                preset,
                image: picture.name.clone(),
                megapixels_per_second: megapixels / time.max(1e-9),
                psnr_db: errors[0],
                p99_block_rmse: errors[1],
            });
            match seconds
                .iter_mut()
                .find(|sum| (sum.0, sum.1) == (encoder, preset))
            {
                Some(sum) => (sum.2, sum.3) = (sum.2 + time, sum.3 + megapixels),
                None => seconds.push((encoder, preset, time, megapixels)),
            }
        };
        for encoder in &encoders {
            let (time, errors) = measure(encoder, &picture, options.seconds);
            add(encoder.name, encoder.preset, time, errors);
        }
        if let Some(program) = &options.basisu {
            for (level, preset) in basisu::LEVELS {
                let (time, decoded) = basisu::measure(program, level, &picture)?;
                add("Basis UASTC", preset, time, errors(&picture, &decoded));
            }
        }
        progress((at + 1) as f32 / options.images.len() as f32);
    }
    report.means = seconds
        .into_iter()
        .map(|(encoder, preset, time, megapixels)| {
            let of = |one: &&Measurement| (one.encoder, one.preset) == (encoder, preset);
            let all: Vec<&Measurement> = report.measurements.iter().filter(of).collect();
            let mean = |value: fn(&Measurement) -> f64| {
                all.iter().map(|one| value(one)).sum::<f64>() / all.len() as f64
            };
            Mean {
                encoder,
                preset,
                megapixels_per_second: megapixels / time.max(1e-9),
                psnr_db: mean(|one| one.psnr_db),
                p99_block_rmse: mean(|one| one.p99_block_rmse),
            }
        })
        .collect();
    Ok(report)
}

/// Reads and decodes one file.
///
/// # Errors
/// It is absent, broken, or larger than `limit_pixels`.
pub fn load(path: &Path, limit_pixels: u64) -> Result<DecodedImage> {
    let bytes = std::fs::read(path).map_err(|error| BakeError::io(path, error))?;
    let image = Image {
        name: path
            .file_stem()
            .unwrap_or_default()
            .to_string_lossy()
            .into_owned(),
        bytes,
        origin: Origin {
            file: path.display().to_string(),
            pointer: String::new(),
        },
        ..Image::default()
    };
    decode_image(&image, limit_pixels)
}

fn read(path: &Path, options: &Options) -> Result<Picture> {
    let image = load(path, options.limit_pixels)?;
    let (width, height) = (image.width as usize, image.height as usize);
    let [(left, across), (top, down)] = [width, height].map(|extent| middle(extent, options.crop));
    let texels: Vec<[u8; 4]> = (0..across * down)
        .map(|index| {
            let x = (left + index % across).min(width - 1);
            let y = (top + index / across).min(height - 1);
            image.texels[y * width + x]
                .map(|code| (u32::from(code) * 255 + 32767).div_euclid(65535) as u8)
        })
        .collect();
    Ok(Picture {
        name: path
            .file_stem()
            .unwrap_or_default()
            .to_string_lossy()
            .into_owned(),
        width: across as u32,
        height: down as u32,
        alpha: texels.iter().any(|texel| texel[3] < 255),
        texels,
    })
}

fn measure(encoder: &Encoder, picture: &Picture, least: f64) -> (f64, [f64; 2]) {
    let source = Blocks::new(blocks(picture));
    let mut out = vec![[0_u8; 16]; source.blocks.len()];
    let seconds = clock::of_one(least, || encoder.compress(&source, picture.alpha, &mut out));
    let decoded: Vec<[[u8; 4]; 16]> = out.iter().map(peers::decode).collect();
    let errors = block_errors(&source.blocks, &decoded, picture.alpha);
    (seconds, errors)
}

fn blocks(picture: &Picture) -> Vec<[[u8; 4]; 16]> {
    cut(&picture.texels, picture.width as usize)
}

fn cut(texels: &[[u8; 4]], width: usize) -> Vec<[[u8; 4]; 16]> {
    let across = width / 4;
    (0..texels.len() / 16)
        .map(|block| {
            std::array::from_fn(|texel| {
                let x = block % across * 4 + texel % 4;
                texels[(block / across * 4 + texel / 4) * width + x]
            })
        })
        .collect()
}

/// PSNR and p99 block RMSE of decoded texels of the picture's size.
fn errors(picture: &Picture, decoded: &[[u8; 4]]) -> [f64; 2] {
    let width = picture.width as usize;
    block_errors(&blocks(picture), &cut(decoded, width), picture.alpha)
}

fn block_errors(exact: &[[[u8; 4]; 16]], decoded: &[[[u8; 4]; 16]], alpha: bool) -> [f64; 2] {
    let channels = if alpha { 4 } else { 3 };
    let mut means: Vec<f64> = exact
        .iter()
        .zip(decoded)
        .map(|(exact, decoded)| {
            let texels = exact.iter().zip(decoded);
            let squares = texels.flat_map(|(a, b)| {
                a.iter()
                    .zip(b)
                    .take(channels)
                    .map(|(a, b)| f64::from(a.abs_diff(*b)).powi(2))
            });
            squares.sum::<f64>() / (16 * channels) as f64
        })
        .collect();
    let mean = means.iter().sum::<f64>() / means.len() as f64;
    means.sort_by(f64::total_cmp);
    let rank = (means.len() as f64 * 0.99).ceil() as usize;
    let psnr = if mean > 0.0 {
        10.0 * (255.0 * 255.0 / mean).log10()
    } else {
        999.0
    };
    [psnr, means[rank.clamp(1, means.len()) - 1].sqrt()]
}

#[cfg(test)]
mod tests {
    use super::*;

    fn picture(alpha: u8) -> Picture {
        Picture {
            name: "ramp".into(),
            width: 8,
            height: 4,
            texels: (0..32)
                .map(|index| [index * 7, 200 - index, 40, alpha])
                .collect(),
            alpha: alpha < 255,
        }
    }

    #[test]
    fn errors_are_those_of_the_texels() {
        let exact = picture(255);
        assert_eq!(errors(&exact, &exact.texels), [999.0, 0.0]);
        // One block of two is off by two in one channel: a mean of 4/3 there, half of it over both.
        let mut off = exact.texels.clone();
        for (index, texel) in off.iter_mut().enumerate() {
            if index % 8 < 4 {
                texel[0] += 2;
            }
            texel[3] = 0;
        }
        let [psnr, p99] = errors(&exact, &off);
        assert!(
            (psnr - 10.0 * (65025.0 * 1.5_f64).log10()).abs() < 1e-9,
            "{psnr}"
        );
        assert!((p99 - (4.0_f64 / 3.0).sqrt()).abs() < 1e-9);
        // Alpha counts where it is used.
        let [with_alpha, _] = errors(&picture(128), &off);
        assert!(with_alpha < 13.0, "{with_alpha}");
    }

    #[test]
    fn every_encoder_is_measured_on_every_image() {
        let assets = Path::new(env!("CARGO_MANIFEST_DIR")).join("../assets/hall/textures");
        let options = Options {
            images: vec![assets.join("leaf.png"), assets.join("cloth_color.png")],
            crop: 32,
            seconds: 0.0,
            basisu: None,
            limit_pixels: 1 << 20,
        };
        let report = run(&options, &|_| {}).expect("our own images are read");
        assert_eq!(report.measurements.len(), 2 * peers::all().len());
        assert_eq!(report.means.len(), peers::all().len());
        let of = |preset| {
            let found = report
                .means
                .iter()
                .find(|mean| (mean.encoder, mean.preset) == ("Cairn", preset));
            found.expect("our presets are there").psnr_db
        };
        assert!(of("fast") > 30.0 && of("fast") <= of("default") && of("default") <= of("best"));
        let missing = Options {
            images: vec!["absent.png".into()],
            ..options
        };
        assert!(run(&missing, &|_| {}).is_err());
    }
}
