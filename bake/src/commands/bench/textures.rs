//! `bench textures`: tables, JSON, and a plot of the BC7 encoders, and of the BC6H encoders on panoramas.

use std::path::{Path, PathBuf};

use crate::bench::plot;
use crate::bench::radiance;
use crate::bench::textures::{self, Mean, Options, run};
use crate::commands::{SUCCESS, print_json, print_text};
use crate::diagnostic::BakeError;
use crate::pipeline::DEFAULT_LIMIT_PIXELS;
use crate::progress::{Bar, Progress};
use crate::write;

/// Compare the BC7 encoders on images, and the BC6H encoders on panoramas: Mpix/s of one thread against PSNR.
#[derive(clap::Args, Debug)]
pub struct Textures {
    /// PNG or JPEG files; panoramas as .hdr or .exr.
    #[arg(required = true)]
    images: Vec<PathBuf>,
    /// Most texels in each axis, about the centre.
    #[arg(long, value_name = "TEXELS", default_value_t = 512, value_parser = clap::value_parser!(u32).range(4..))]
    crop: u32,
    /// Least CPU seconds of each measurement; short ones are repeated.
    #[arg(long, default_value_t = 0.3)]
    seconds: f64,
    /// Texels of a side of the sky's faces that panoramas are measured as too; 0 for none.
    #[arg(long, value_name = "TEXELS", default_value_t = 256)]
    face: u32,
    /// Basis Universal's program, to compare with UASTC transcoded to BC7.
    #[arg(long, value_name = "PROGRAM")]
    basisu: Option<PathBuf>,
    /// Write a plot: of the images, or of the panoramas where there are no images.
    #[arg(long, value_name = "OUT.svg")]
    plot: Option<PathBuf>,
    /// Print one JSON object in place of the table.
    #[arg(long)]
    json: bool,
}

impl Textures {
    pub(in crate::commands) fn run(self) -> Result<u8, BakeError> {
        let (panoramas, images): (Vec<_>, Vec<_>) =
            self.images.into_iter().partition(|path| is_panorama(path));
        let options = Options {
            images,
            crop: self.crop,
            seconds: self.seconds,
            basisu: self.basisu,
            limit_pixels: DEFAULT_LIMIT_PIXELS,
        };
        let half_options = radiance::Options {
            images: panoramas,
            crop: self.crop,
            face: self.face,
            seconds: self.seconds,
        };
        let bar = Bar::new();
        let report = run(&options, &|fraction| bar.update("encoders", fraction));
        let radiance = radiance::run(&half_options, &|fraction| bar.update("encoders", fraction));
        bar.clear();
        let all = Reports {
            textures: report?,
            radiance: radiance?,
        };
        if let Some(path) = &self.plot {
            write::bytes(path, plot::svg(&all.points()).as_bytes())?;
        }
        if self.json {
            print_json(&all)?;
        } else {
            print_text(&all.table())?;
        }
        Ok(SUCCESS)
    }
}

/// Of images, and of panoramas.
#[derive(serde::Serialize)]
struct Reports {
    #[serde(flatten)]
    textures: textures::Report,
    radiance: radiance::Report,
}

impl Reports {
    /// Of the images, or of the panoramas where there are no images.
    fn points(&self) -> Vec<Mean> {
        if !self.textures.means.is_empty() {
            return self.textures.means.clone();
        }
        let means = self.radiance.means.iter();
        let point = |mean: &radiance::Figures| Mean {
            encoder: mean.encoder,
            preset: mean.preset,
            megapixels_per_second: mean.megapixels_per_second,
            psnr_db: mean.log2_psnr_db,
            p99_block_rmse: 0.0,
        };
        means.map(point).collect()
    }

    /// A table of each kind that was measured.
    fn table(&self) -> String {
        let mut text = String::new();
        if !self.textures.means.is_empty() {
            text += "| encoder | preset | Mpix/s, one thread | PSNR dB | p99 block RMSE /255 |\n|---|---|--:|--:|--:|\n";
        }
        for mean in &self.textures.means {
            text += &format!(
                "| {} | {} | {:.2} | {:.2} | {:.2} |\n",
                mean.encoder,
                mean.preset,
                mean.megapixels_per_second,
                mean.psnr_db,
                mean.p99_block_rmse
            );
        }
        if !self.radiance.means.is_empty() {
            text += "| BC6H encoder | preset | image | Mpix/s, one thread | log2-PSNR dB | mean relative error | relative RMS |\n\
                     |---|---|---|--:|--:|--:|--:|\n";
        }
        let each = self.radiance.measurements.iter();
        let each = each.map(|one| (one.image.as_str(), &one.figures));
        let means = self.radiance.means.iter().map(|mean| ("mean", mean));
        for (image, figures) in each.chain(means) {
            text += &format!(
                "| {} | {} | {image} | {:.2} | {:.2} | {:.2e} | {:.2e} |\n",
                figures.encoder,
                figures.preset,
                figures.megapixels_per_second,
                figures.log2_psnr_db,
                figures.mean_relative,
                figures.relative_rms
            );
        }
        text
    }
}

/// By its name.
fn is_panorama(path: &Path) -> bool {
    let extension = path.extension().unwrap_or_default().to_string_lossy();
    ["hdr", "exr"].contains(&extension.to_lowercase().as_str())
}
