//! `bench textures`: a table, JSON, and a plot of the BC7 encoders.

use std::path::PathBuf;

use crate::bench::plot;
use crate::bench::textures::{Options, Report, run};
use crate::commands::{SUCCESS, print_json, print_text};
use crate::diagnostic::BakeError;
use crate::pipeline::DEFAULT_LIMIT_PIXELS;
use crate::progress::{Bar, Progress};
use crate::write;

/// Compare the BC7 encoders on images: Mpix/s of one thread against PSNR.
#[derive(clap::Args, Debug)]
pub struct Textures {
    /// PNG or JPEG files.
    #[arg(required = true)]
    images: Vec<PathBuf>,
    /// Most texels in each axis, about the centre.
    #[arg(long, value_name = "TEXELS", default_value_t = 512, value_parser = clap::value_parser!(u32).range(4..))]
    crop: u32,
    /// Least CPU seconds of each measurement; short ones are repeated.
    #[arg(long, default_value_t = 0.3)]
    seconds: f64,
    /// Basis Universal's program, to compare with UASTC transcoded to BC7.
    #[arg(long, value_name = "PROGRAM")]
    basisu: Option<PathBuf>,
    /// Write a plot.
    #[arg(long, value_name = "OUT.svg")]
    plot: Option<PathBuf>,
    /// Print one JSON object in place of the table.
    #[arg(long)]
    json: bool,
}

impl Textures {
    pub(in crate::commands) fn run(self) -> Result<u8, BakeError> {
        let options = Options {
            images: self.images,
            crop: self.crop,
            seconds: self.seconds,
            basisu: self.basisu,
            limit_pixels: DEFAULT_LIMIT_PIXELS,
        };
        let bar = Bar::new();
        let report = run(&options, &|fraction| bar.update("encoders", fraction));
        bar.clear();
        let report = report?;
        if let Some(path) = &self.plot {
            write::bytes(path, plot::svg(&report.means).as_bytes())?;
        }
        if self.json {
            print_json(&report)?;
        } else {
            print_text(&table(&report))?;
        }
        Ok(SUCCESS)
    }
}

fn table(report: &Report) -> String {
    let mut text = String::from(
        "| encoder | preset | Mpix/s, one thread | PSNR dB | p99 block RMSE /255 |\n|---|---|--:|--:|--:|\n",
    );
    for mean in &report.means {
        text += &format!(
            "| {} | {} | {:.2} | {:.2} | {:.2} |\n",
            mean.encoder,
            mean.preset,
            mean.megapixels_per_second,
            mean.psnr_db,
            mean.p99_block_rmse
        );
    }
    text
}
