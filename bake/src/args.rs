//! The command line of `cairn-bake`.

use std::path::PathBuf;

use crate::encode::Quality;

/// Bake a glTF 2.0 scene, and an environment, into one Cairn package.
#[derive(clap::Parser, Debug)]
#[command(name = "cairn-bake", version, after_help = EXAMPLES)]
pub struct Args {
    /// The scene: .gltf or .glb.
    pub input: PathBuf,
    /// The environment: an equirectangular panorama, .hdr or .exr.
    #[arg(long, value_name = "SKY")]
    pub env: Option<PathBuf>,
    /// The package to write.
    #[arg(long, short, value_name = "OUT.cairn")]
    pub output: PathBuf,
    /// Effort of the texture encoders.
    #[arg(long, value_enum, default_value = "default")]
    pub texture_quality: TextureQuality,
    /// Images of more texels than this are refused.
    #[arg(long, value_name = "TEXELS", default_value_t = 1 << 28)]
    pub limit_pixels: u64,
    /// Threads to use; the bytes are the same for any number.
    #[arg(long, value_parser = clap::value_parser!(u16).range(1..))]
    pub threads: Option<u16>,
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

/// Encoder presets.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub enum TextureQuality {
    Fast,
    Default,
    Best,
}

impl From<TextureQuality> for Quality {
    fn from(quality: TextureQuality) -> Self {
        match quality {
            TextureQuality::Fast => Self::Fast,
            TextureQuality::Default => Self::Default,
            TextureQuality::Best => Self::Best,
        }
    }
}

const EXAMPLES: &str = "Examples:
  cairn-bake helmet.gltf --env park.hdr -o helmet.cairn
  cairn-bake hall.glb -o hall.cairn --json > report.json
  cairn-bake hall.glb -o hall.cairn --texture-quality best -v

Exit codes: 0 success, 2 bad input or unwritable output; then no output file was touched.";

#[cfg(test)]
mod tests {
    #[test]
    fn the_command_line_is_consistent() {
        use clap::CommandFactory;
        super::Args::command().debug_assert();
    }
}
