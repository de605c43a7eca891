//! Shows what is inside a package: a tree for people, JSON for machines, the files that it was made of.

use std::io::IsTerminal;
use std::path::PathBuf;

use cairn_format::Package;

use super::{SUCCESS, print_json, print_text};
use crate::diagnostic::Result;
use crate::look::{self, Contents, Picture, refused};

mod tree;

/// `cairn-bake inspect PACKAGE`.
#[derive(clap::Args, Debug)]
pub struct Inspect {
    /// The package.
    path: PathBuf,
    /// Print one JSON object on standard output.
    #[arg(long)]
    json: bool,
    /// Print only the files that the package was made of: BLAKE3, bytes, path.
    #[arg(long)]
    deps: bool,
    /// Pictures of the images beside their rows.
    #[arg(long, value_enum, default_value = "auto", conflicts_with_all = ["json", "deps"])]
    thumbnails: Thumbnails,
    /// Rows of every list, before the others are only counted; 0 shows all.
    #[arg(long, value_name = "ROWS", default_value_t = 50)]
    rows: usize,
}

/// When pictures are drawn.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
enum Thumbnails {
    /// On a terminal that says COLORTERM=truecolor, and not NO_COLOR.
    Auto,
    /// Always, with 24-bit colours.
    Always,
    /// Never.
    Never,
}

/// Width of a picture, in characters.
const THUMBNAIL: u32 = 20;

impl Inspect {
    pub(super) fn run(&self) -> Result<u8> {
        let package = look::open(&self.path)?;
        let contents = Contents::of(&package).map_err(|error| refused(&self.path, error))?;
        if self.json {
            if self.deps {
                print_json(&contents.sources)?;
            } else {
                print_json(&contents)?;
            }
        } else if self.deps {
            print_text(&tree::sources(&contents))?;
        } else {
            let pictures = self.pictures(&package)?;
            let rows = if self.rows == 0 {
                usize::MAX
            } else {
                self.rows
            };
            print_text(&tree::write(&contents, &pictures, rows))?;
        }
        Ok(SUCCESS)
    }

    /// A picture of every image; none where they are not wanted.
    fn pictures(&self, package: &Package) -> Result<Vec<Picture>> {
        let wanted = match self.thumbnails {
            Thumbnails::Always => true,
            Thumbnails::Never => false,
            Thumbnails::Auto => {
                let depth = std::env::var("COLORTERM").unwrap_or_default();
                let deep = depth == "truecolor" || depth == "24bit";
                deep && std::env::var_os("NO_COLOR").is_none() && std::io::stdout().is_terminal()
            }
        };
        if !wanted {
            return Ok(Vec::new());
        }
        let texels = package
            .texels()
            .map_err(|error| refused(&self.path, error))?;
        let images = package.scene().images.iter();
        Ok(images
            .map(|image| look::thumbnail(image, texels, THUMBNAIL))
            .collect())
    }
}
