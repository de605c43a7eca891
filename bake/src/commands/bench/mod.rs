//! `bench`: measures single stages.

mod textures;

use crate::diagnostic::BakeError;

/// Measure a stage against other tools.
#[derive(clap::Args, Debug)]
pub struct Bench {
    #[command(subcommand)]
    what: What,
}

#[derive(clap::Subcommand, Debug)]
enum What {
    Textures(textures::Textures),
}

impl Bench {
    pub(super) fn run(self) -> Result<u8, BakeError> {
        match self.what {
            What::Textures(args) => args.run(),
        }
    }
}
