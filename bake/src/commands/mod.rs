//! What the program can do: one file a command; without a name it bakes.

mod bake;
mod bench;
mod cache;
mod diff;
mod extract;
mod inspect;
mod report;
mod shell;
mod twice;
mod verify;

use std::path::Path;
use std::process::ExitCode;

use crate::args::{Args, Settings};
use crate::diagnostic::BakeError;

/// Everything went as asked.
pub const SUCCESS: u8 = 0;
/// The answer is no: packages differ, a package is damaged.
pub const NEGATIVE: u8 = 1;
/// Bad input, an unwritable output or a bad command line; no output file was touched.
pub const FAILURE: u8 = 2;

/// The whole command line of `cairn-bake`.
#[derive(clap::Parser, Debug)]
#[command(
    name = "cairn-bake",
    version,
    about = "Bake a glTF 2.0 scene, and an environment, into one Cairn package",
    after_help = EXAMPLES,
    args_conflicts_with_subcommands = true,
    subcommand_negates_reqs = true
)]
pub struct Cli {
    #[command(subcommand)]
    pub command: Option<Command>,
    #[command(flatten)]
    pub bake: Option<Args>,
    // Not in `Args`: clap tells whether those are there only where they are flat.
    #[command(flatten)]
    pub settings: Settings,
}

/// What to do in place of a bake.
#[derive(clap::Subcommand, Debug)]
pub enum Command {
    /// Look after the products that earlier bakes left for later ones.
    Cache(cache::Cache),
    /// Show what is inside a package.
    Inspect(inspect::Inspect),
    /// Write a texture, a cube or a mesh of a package back out.
    Extract(extract::Extract),
    /// Tell two packages apart: sections, meshes, materials, textures, instances.
    Diff(diff::Diff),
    /// Write one page about a package: picture, sizes, times, errors, textures.
    Report(report::Report),
    /// Check a package: every hash, every range, every float.
    Verify(verify::Verify),
    /// Measure time against error of a stage, beside other tools.
    Bench(bench::Bench),
    /// Write a shell's completions to standard output.
    Completions(shell::Completions),
    /// Write the manual pages into a folder.
    Man(shell::Man),
}

impl Cli {
    /// Does what the command line asks for.
    pub fn run(self) -> ExitCode {
        let done = match (self.command, self.bake) {
            (Some(command), _) => command.run(),
            (None, Some(args)) => bake::run(&args, &self.settings),
            // The parser asks for a scene where there is no command.
            (None, None) => Ok(FAILURE),
        };
        match done {
            Ok(code) => ExitCode::from(code),
            Err(error) => {
                eprintln!("{}", error.explained());
                ExitCode::from(FAILURE)
            }
        }
    }
}

impl Command {
    /// The exit code: [`SUCCESS`] or [`NEGATIVE`].
    fn run(self) -> Result<u8, BakeError> {
        match self {
            Self::Cache(args) => args.run(),
            Self::Inspect(args) => args.run(),
            Self::Extract(args) => args.run(),
            Self::Diff(args) => args.run(),
            Self::Report(args) => args.run(),
            Self::Verify(args) => args.run(),
            Self::Bench(args) => args.run(),
            Self::Completions(args) => args.run(),
            Self::Man(args) => args.run(),
        }
    }
}

/// Writes text to standard output; a reader that has seen enough is no error.
fn print_text(text: &str) -> Result<(), BakeError> {
    use std::io::{ErrorKind, Write};
    match std::io::stdout().write_all(text.as_bytes()) {
        Err(error) if error.kind() != ErrorKind::BrokenPipe => {
            Err(BakeError::io(Path::new("standard output"), error))
        }
        _ => Ok(()),
    }
}

/// Writes a value as one line of JSON.
fn print_json(value: &impl serde::Serialize) -> Result<(), BakeError> {
    let text = serde_json::to_string(value)
        .map_err(|error| BakeError::io(Path::new("standard output"), error.into()))?;
    print_text(&(text + "\n"))
}

const EXAMPLES: &str = "Examples:
  cairn-bake helmet.gltf --env park.hdr -o helmet.cairn
  cairn-bake hall.glb -o hall.cairn --json > report.json
  cairn-bake hall.glb -o hall.cairn --texture-quality best -v
  cairn-bake hall.glb -o hall.cairn --explain
  cairn-bake verify --twice hall.glb
  cairn-bake completions bash > ~/.local/share/bash-completion/completions/cairn-bake

A scene that is named like a command is given with its folder: ./inspect

Exit codes: 0 success, 1 the answer is no (packages differ, a package is damaged),
2 bad input or unwritable output; then no output file was touched; 130 interrupted.";

#[cfg(test)]
mod tests {
    use clap::{CommandFactory, Parser};

    use super::*;

    #[test]
    fn the_command_line_is_consistent() {
        Cli::command().debug_assert();
    }

    #[test]
    fn a_scene_is_baked_and_a_command_is_obeyed() {
        let cli = Cli::try_parse_from(["cairn-bake", "a.gltf", "-o", "a.cairn"]).expect("a bake");
        assert!(cli.command.is_none() && cli.bake.is_some_and(|args| !args.json));
        let cli = Cli::try_parse_from(["cairn-bake", "completions", "bash"]).expect("a command");
        assert!(matches!(cli.command, Some(Command::Completions(_))) && cli.bake.is_none());
    }

    #[test]
    fn nothing_is_asked_for_by_halves() {
        for line in [
            &["cairn-bake"][..],
            &["cairn-bake", "a.gltf"],
            &["cairn-bake", "-o", "a.cairn"],
            &[
                "cairn-bake",
                "a.gltf",
                "-o",
                "a.cairn",
                "completions",
                "bash",
            ],
            &["cairn-bake", "completions", "no-shell"],
        ] {
            assert!(Cli::try_parse_from(line).is_err(), "{line:?}");
        }
    }
}
