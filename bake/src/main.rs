//! The `cairn-bake` program.

use std::process::ExitCode;

use cairn_bake::commands::Cli;
use clap::Parser;

fn main() -> ExitCode {
    let cli = Cli::parse();
    cairn_bake::interrupt::listen();
    cli.run()
}
