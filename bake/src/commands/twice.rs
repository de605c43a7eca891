//! `verify --twice`: bakes a scene twice and compares.

use std::num::NonZeroUsize;
use std::path::Path;

use clap::Parser;

use super::{NEGATIVE, SUCCESS, print_json, print_text};
use crate::args::Settings;
use crate::diagnostic::{BakeError, Result};
use crate::progress::{Bar, Progress, Silent};
use crate::scene::Origin;
use crate::twice::bake_twice;

/// What becomes of a scene in place of a package.
#[derive(clap::Args, Debug)]
pub(super) struct Twice {
    /// Take the file for a scene: bake it twice from nothing, at one thread and at --threads (by default all), and
    /// compare every section.
    #[arg(long, conflicts_with = "all")]
    pub(super) twice: bool,
    #[command(flatten, next_help_heading = "Settings of the bakes of --twice")]
    settings: Settings,
}

#[derive(clap::Parser)]
struct Defaults {
    #[command(flatten)]
    settings: Settings,
}

impl Twice {
    /// Refuses settings of a bake where there is none.
    pub(super) fn check(&self) -> Result<()> {
        if self.twice || self.settings == Defaults::parse_from(["verify"]).settings {
            return Ok(());
        }
        let message = "settings of a bake need --twice; a package is checked without any";
        Err(BakeError::input(
            "verify-settings",
            &Origin::default(),
            message,
        ))
    }

    /// Bakes twice and prints what differs.
    pub(super) fn run(&self, scene: &Path, json: bool, quiet: bool) -> Result<u8> {
        let all = std::thread::available_parallelism().unwrap_or(NonZeroUsize::MIN);
        let asked = self
            .settings
            .threads
            .and_then(|threads| NonZeroUsize::new(threads.into()));
        // At one thread twice, nothing would be proved.
        let threads = asked
            .unwrap_or(all)
            .max(NonZeroUsize::MIN.saturating_add(1));
        let options = self.settings.options(scene, Path::new(""));
        let verdict = if json || quiet {
            bake_twice(&options, threads, &Silent)?
        } else {
            let bar = Bar::new();
            let verdict = bake_twice(&options, threads, &bar as &dyn Progress);
            bar.clear();
            verdict?
        };
        if json {
            print_json(&verdict)?;
        } else if !quiet {
            print_text(&verdict.text())?;
        }
        Ok(if verdict.equal { SUCCESS } else { NEGATIVE })
    }
}
