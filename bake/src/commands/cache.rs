//! What the cache of earlier bakes holds, and how it gets smaller.

use std::io;
use std::path::Path;

use serde::Serialize;

use super::{SUCCESS, print_json, print_text};
use crate::args::size;
use crate::cache::{Place, Store};
use crate::diagnostic::{BakeError, Result};
use crate::scene::Origin;

/// `cairn-bake cache`.
#[derive(clap::Args, Debug)]
pub struct Cache {
    #[command(subcommand)]
    action: Action,
    /// The folder; by default $CAIRN_CACHE, or else one in the user's cache folder.
    #[arg(long, value_name = "DIR", global = true)]
    cache: Option<std::path::PathBuf>,
    /// Print one JSON object on standard output.
    #[arg(long, global = true)]
    json: bool,
    /// Print nothing but errors.
    #[arg(long, short, global = true, conflicts_with = "json")]
    quiet: bool,
}

#[derive(clap::Subcommand, Debug)]
enum Action {
    /// Count what is there.
    Status,
    /// Remove what was used longest ago, and what killed bakes left behind.
    #[command(after_help = "Example: cairn-bake cache gc --max-size 2G")]
    Gc {
        /// Bytes that may stay, with K, M, G or T for powers of 1000.
        #[arg(long, value_name = "SIZE", value_parser = size)]
        max_size: u64,
    },
    /// Read every entry, and remove damaged ones.
    Check,
}

impl Cache {
    pub(super) fn run(&self) -> Result<u8> {
        let folder = match &self.cache {
            Some(folder) => Some(folder.clone()),
            None => Place::default_of_user().folder(),
        };
        let Some(folder) = folder else {
            let message = "there is no cache: CAIRN_CACHE is `off`, or the system names no folder; use --cache DIR";
            return Err(BakeError::input("cache-off", &Origin::default(), message));
        };
        let failed = |error: io::Error| BakeError::io(&folder, error);
        let store = Store::new(&folder);
        match self.action {
            Action::Status => {
                let found = store.status().map_err(failed)?;
                let text = format!(
                    "{} entries, {}; {} bakes remembered, {}",
                    found.entries,
                    megabytes(found.entry_bytes),
                    found.bakes,
                    megabytes(found.bake_bytes)
                );
                self.print(&folder, &found, &text)
            }
            Action::Gc { max_size } => {
                let gone = store.collect(max_size).map_err(failed)?;
                let text = format!(
                    "removed {} files, {}; {} that killed bakes had left",
                    gone.files,
                    megabytes(gone.bytes),
                    gone.temporary
                );
                self.print(&folder, &gone, &text)
            }
            Action::Check => {
                let [sound, damaged] = store.check().map_err(failed)?;
                let found = Checked { sound, damaged };
                self.print(
                    &folder,
                    &found,
                    &format!("{sound} entries are sound, {damaged} were not and are removed"),
                )
            }
        }
    }

    fn print<T: Serialize>(&self, folder: &Path, found: &T, text: &str) -> Result<u8> {
        if self.json {
            print_json(&WithFolder { folder, found })?;
        } else if !self.quiet {
            print_text(&format!("{}: {text}\n", folder.display()))?;
        }
        Ok(SUCCESS)
    }
}

#[derive(Serialize)]
struct Checked {
    sound: u64,
    damaged: u64,
}

#[derive(Serialize)]
struct WithFolder<'a, T> {
    folder: &'a Path,
    #[serde(flatten)]
    found: &'a T,
}

fn megabytes(bytes: u64) -> String {
    format!("{:.1} MB", bytes as f64 / 1e6)
}
