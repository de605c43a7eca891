//! Writes the asset set into a directory, by default the crate's own.

use std::path::PathBuf;
use std::process::ExitCode;

fn main() -> ExitCode {
    let mut arguments = std::env::args_os().skip(1);
    let root = arguments
        .next()
        .map_or_else(|| PathBuf::from(env!("CARGO_MANIFEST_DIR")), PathBuf::from);
    if arguments.next().is_some() || root.as_os_str().to_string_lossy().starts_with('-') {
        eprintln!("usage: cairn-assets [OUTDIR]");
        return ExitCode::from(2);
    }
    let files = cairn_assets::generate();
    if let Err(error) = cairn_assets::write_all(&root, &files) {
        eprintln!("cairn-assets: {}: {error}", root.display());
        return ExitCode::FAILURE;
    }
    let mut total = 0;
    for file in &files {
        println!("{:>8}  {}", file.bytes.len(), file.path);
        total += file.bytes.len();
    }
    println!("{total:>8}  total, in {}", root.display());
    ExitCode::SUCCESS
}
