//! Completions of shells, and manual pages, generated from the command line itself.

use std::path::PathBuf;

use clap::CommandFactory;

use super::{Cli, SUCCESS, print_text};
use crate::diagnostic::BakeError;

/// `cairn-bake completions SHELL`.
#[derive(clap::Args, Debug)]
pub struct Completions {
    /// bash, zsh, fish, elvish or powershell.
    #[arg(value_enum)]
    shell: clap_complete::Shell,
}

impl Completions {
    pub(super) fn run(&self) -> Result<u8, BakeError> {
        let mut script = Vec::new();
        clap_complete::generate(self.shell, &mut Cli::command(), "cairn-bake", &mut script);
        print_text(&String::from_utf8_lossy(&script))?;
        Ok(SUCCESS)
    }
}

/// `cairn-bake man FOLDER`.
#[derive(clap::Args, Debug)]
pub struct Man {
    /// Where the pages go: cairn-bake.1 and one for each command.
    folder: PathBuf,
}

impl Man {
    pub(super) fn run(&self) -> Result<u8, BakeError> {
        let folder = &self.folder;
        std::fs::create_dir_all(folder)
            .and_then(|()| clap_mangen::generate_to(Cli::command(), folder))
            .map_err(|error| BakeError::io(folder, error))?;
        Ok(SUCCESS)
    }
}
