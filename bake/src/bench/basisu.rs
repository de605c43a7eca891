//! Basis Universal's UASTC by its own program, transcoded to BC7 by it.

use std::fs::File;
use std::io::BufWriter;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use ::image::codecs::png::PngEncoder;
use ::image::{ExtendedColorType, ImageEncoder};

use super::clock::Clock;
use super::textures::{Picture, load};
use crate::diagnostic::{BakeError, Result};

/// The program's levels, and their names in its documentation.
pub const LEVELS: [(u32, &str); 3] = [(0, "fastest"), (1, "faster"), (2, "default")];
/// Its number of BC7 with alpha.
const BC7: &str = "6";

/// CPU seconds of one encoding on one thread, reading the file included, and the texels of its BC7.
///
/// # Errors
/// The program is absent, fails, or leaves no picture.
pub fn measure(program: &Path, level: u32, picture: &Picture) -> Result<(f64, Vec<[u8; 4]>)> {
    let folder = tempfile::tempdir().map_err(|error| BakeError::io(program, error))?;
    let source = folder.path().join("picture.png");
    write(&source, picture)?;
    let level = level.to_string();
    let encode = [
        "-uastc",
        "-uastc_level",
        &level,
        "-linear",
        "-no_multithreading",
        "picture.png",
    ];
    let clock = Clock::start();
    call(program, folder.path(), &encode)?;
    let seconds = clock.stop().cpu_seconds;
    let unpack = ["-unpack", "-no_ktx", "-format_only", BC7, "picture.basis"];
    call(program, folder.path(), &unpack)?;
    let channels = if picture.alpha { "rgba" } else { "rgb" };
    let unpacked = folder
        .path()
        .join(format!("picture_unpacked_{channels}_BC7_RGBA_0000.png"));
    let decoded = load(&unpacked, picture.texels.len() as u64)?;
    let texels = decoded.texels.iter();
    Ok((
        seconds,
        texels
            .map(|texel| texel.map(|code| (code / 257) as u8))
            .collect(),
    ))
}

fn write(path: &Path, picture: &Picture) -> Result<()> {
    let file = File::create(path).map_err(|error| BakeError::io(path, error))?;
    let encoder = PngEncoder::new(BufWriter::new(file));
    let bytes = picture.texels.as_flattened();
    encoder
        .write_image(
            bytes,
            picture.width,
            picture.height,
            ExtendedColorType::Rgba8,
        )
        .map_err(|error| BakeError::io(path, std::io::Error::other(error)))
}

fn call(program: &Path, folder: &Path, arguments: &[&str]) -> Result<Output> {
    let failed = |error| BakeError::io(program, error);
    let program_path: PathBuf = program.canonicalize().map_err(failed)?;
    let output = Command::new(program_path)
        .args(arguments)
        .current_dir(folder)
        .output()
        .map_err(failed)?;
    if output.status.success() {
        return Ok(output);
    }
    let text = String::from_utf8_lossy(&output.stdout);
    let last = text.lines().last().unwrap_or("no message").to_owned();
    let message = format!("basisu {}: {last}; leave --basisu out", arguments.join(" "));
    Err(BakeError::io(program, std::io::Error::other(message)))
}
