//! The command line of a bake.

use std::convert::Infallible;
use std::path::{Path, PathBuf};

use crate::cache::Place;
use crate::encode::{Effort, EncodeOptions, Kernels, MipFilter, SkyFormat, Target};
use crate::environment::{EnvironmentOptions, SunMode};
use crate::import::{DEFAULT_LIMIT_TRIANGLES, Rules};
use crate::pipeline::{DEFAULT_LIMIT_PIXELS, Options};
use crate::strict::Strict;

/// What to bake, and what to print.
#[derive(clap::Args, Debug)]
pub struct Args {
    /// The scene: .gltf or .glb.
    pub input: PathBuf,
    /// The package to write.
    #[arg(long, short, value_name = "OUT.cairn")]
    pub output: PathBuf,
    /// Folder of the products of earlier bakes, or `off`; by default $CAIRN_CACHE, or else the user's cache folder.
    #[arg(long, value_name = "DIR|off", value_parser = |text: &str| Ok::<_, Infallible>(Place::parse(text)))]
    pub cache: Option<Place>,
    /// Say of every product whether it was reused, and why not.
    #[arg(long)]
    pub explain: bool,
    /// Take warnings for errors: those of these codes, or all.
    #[arg(long, value_name = "CODE,...", num_args = 0..=1, require_equals = true, default_missing_value = "all")]
    pub strict: Option<Strict>,
    /// Print the summary as one JSON object on standard output.
    #[arg(long)]
    pub json: bool,
    /// Print nothing but errors.
    #[arg(long, short, conflicts_with = "json")]
    pub quiet: bool,
    /// Print every row of the speed and error report.
    #[arg(long, short)]
    pub verbose: bool,
}

/// All that decides what a bake makes of its input.
#[derive(clap::Args, Clone, Debug, PartialEq)]
pub struct Settings {
    /// The environment: an equirectangular panorama, .hdr or .exr.
    #[arg(long, value_name = "SKY")]
    pub env: Option<PathBuf>,
    /// Effort of the texture encoders: fast, default, best, or the least PSNR of level 0, such as 42dB, for which
    /// each texture gets the cheapest preset that reaches it; the sky then gets the default.
    #[arg(long, value_name = "EFFORT", default_value_t)]
    pub texture_quality: Effort,
    /// What the package is for: GPUs that read BC textures, or any GPU.
    #[arg(long, value_enum, default_value = "desktop")]
    pub target: Target,
    /// How mips are made.
    #[arg(long, value_enum, default_value = "kaiser")]
    pub mip_filter: MipFilter,
    /// Only filter the alpha of masked textures: what they cover is not kept over the mips.
    #[arg(long)]
    pub plain_alpha: bool,
    /// Turn the length that averaged normals lose in mips into roughness, so that bumps too far away to be seen still dull
    /// reflections; materials with a normal map get a roughness texture of their own.
    #[arg(long)]
    pub toksvig: bool,
    /// Encode with this machine's instruction set; the bytes then depend on the machine, and the package says so.
    #[arg(long)]
    pub native_isa: bool,
    /// What becomes of the environment's sun.
    #[arg(long, value_enum, default_value = "auto")]
    pub sun: Sun,
    /// Work spent on image-based light.
    #[arg(long, value_enum, default_value = "default")]
    pub ibl_quality: IblQuality,
    /// Bound of the relative RMS error of every prefiltered level, in place of that of --ibl-quality.
    #[arg(long, value_name = "PERCENT", value_parser = percent)]
    pub ibl_error: Option<f64>,
    /// Storage of the sky and of the prefiltered cube: bc6h, or rgb9e5 where --target is portable.
    #[arg(long, value_enum)]
    pub sky_format: Option<SkyFormat>,
    /// Side of the sky cube's faces, rounded up to a power of two; by default it follows the panorama's resolution.
    #[arg(long, value_name = "TEXELS", value_parser = clap::value_parser!(u32).range(8..=4096))]
    pub sky_size: Option<u32>,
    /// Images of more texels than this are refused.
    #[arg(long, value_name = "TEXELS", default_value_t = DEFAULT_LIMIT_PIXELS)]
    pub limit_pixels: u64,
    /// Memory for the scene and its images, with K, M, G or T for powers of 1000: fewer images are decoded at a time to
    /// stay within, and what cannot is refused.
    #[arg(long, value_name = "SIZE", default_value = "16G", value_parser = size)]
    pub limit_memory: u64,
    /// Scenes of more triangles than this, each mesh counted once, are refused.
    #[arg(long, value_name = "TRIANGLES", default_value_t = DEFAULT_LIMIT_TRIANGLES)]
    pub limit_triangles: u64,
    /// Read files outside the scene's folder where it names them; for scenes you trust.
    #[arg(long)]
    pub allow_external: bool,
    /// Threads to use; the bytes are the same for any number.
    #[arg(long, value_parser = clap::value_parser!(u16).range(1..))]
    pub threads: Option<u16>,
}

/// What becomes of the sun.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub enum Sun {
    /// Taken out of the cubes where there is one, and stored as a light.
    Auto,
    /// Left in the cubes.
    Keep,
    /// Taken out of the cubes, and dropped.
    Off,
}

/// Presets of image-based light.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub enum IblQuality {
    /// Within 1 %.
    Draft,
    /// Within 0.2 %.
    Default,
    /// Within 0.02 %.
    Reference,
}

impl IblQuality {
    /// Bound of the relative RMS error of every prefiltered level.
    pub fn error(self) -> f64 {
        match self {
            Self::Draft => 1e-2,
            Self::Default => 2e-3,
            Self::Reference => 2e-4,
        }
    }
}

impl Settings {
    /// A bake with these settings, without a cache.
    pub fn options(&self, input: &Path, output: &Path) -> Options {
        Options {
            environment: self.env.clone(),
            textures: self.textures(),
            light: self.light(),
            sky_format: self.sky_format(),
            limit_pixels: self.limit_pixels,
            limit_memory: self.limit_memory,
            rules: Rules {
                allow_external: self.allow_external,
                limit_triangles: self.limit_triangles,
            },
            ..Options::new(input, output)
        }
    }

    /// Options of the texture encoders.
    pub fn textures(&self) -> EncodeOptions {
        EncodeOptions {
            effort: self.texture_quality,
            filter: self.mip_filter,
            plain_alpha: self.plain_alpha,
            toksvig: self.toksvig,
            kernels: if self.native_isa {
                Kernels::Native
            } else {
                Kernels::Reproducible
            },
            target: self.target,
        }
    }

    /// Storage of the sky.
    pub fn sky_format(&self) -> SkyFormat {
        self.sky_format.unwrap_or(match self.target {
            Target::Desktop => SkyFormat::default(),
            Target::Uncompressed => SkyFormat::Rgba16f,
            Target::Portable => SkyFormat::Rgb9e5,
        })
    }

    /// Options of image-based light.
    pub fn light(&self) -> EnvironmentOptions {
        EnvironmentOptions {
            sun: match self.sun {
                Sun::Auto => SunMode::Auto,
                Sun::Keep => SunMode::Keep,
                Sun::Off => SunMode::Off,
            },
            sky_size: self.sky_size,
            sky_limit: self
                .sky_size
                .unwrap_or(EnvironmentOptions::default().sky_limit),
            error: self.ibl_error.unwrap_or(self.ibl_quality.error()),
            ..EnvironmentOptions::default()
        }
    }
}

/// A fraction out of `0.2` or `0.2%`.
fn percent(text: &str) -> Result<f64, String> {
    let number: f64 = text
        .trim_end_matches('%')
        .parse()
        .map_err(|_| format!("`{text}` is no number of percent"))?;
    if number > 0.0 && number <= 100.0 {
        Ok(number / 100.0)
    } else {
        Err("must be above 0 and at most 100".into())
    }
}

/// Bytes out of `500M`.
pub fn size(text: &str) -> Result<u64, String> {
    let digits = text.trim_end_matches(['B', 'b']);
    let units = [
        ("K", 1_000),
        ("M", 1_000_000),
        ("G", 1_000_000_000),
        ("T", 1_000_000_000_000),
    ];
    let upper = digits.to_ascii_uppercase();
    let (number, unit) = units
        .iter()
        .find_map(|(name, unit)| Some((upper.strip_suffix(name)?, *unit)))
        .unwrap_or((&upper, 1));
    let number: u64 = number
        .trim()
        .parse()
        .map_err(|_| format!("`{text}` is no size; write 500M or 2G"))?;
    number
        .checked_mul(unit)
        .ok_or_else(|| format!("`{text}` is more than can be counted"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sizes_have_units() {
        for (text, bytes) in [
            ("0", 0),
            ("17", 17),
            ("2k", 2000),
            ("500M", 500_000_000),
            ("3GB", 3_000_000_000),
        ] {
            assert_eq!(size(text), Ok(bytes), "{text}");
        }
        for text in ["", "M", "-1", "1.5G", "20000000T", "12 apples"] {
            assert!(size(text).is_err(), "{text}");
        }
    }
}
