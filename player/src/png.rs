//! Writes 8-bit images as PNG files, whole or not at all.

use std::io::Write;
use std::path::Path;

use crate::error::PlayerError;

/// Writes `rgba8` (row-major, sRGB, 4 bytes a texel) as an opaque RGB PNG.
pub fn write(path: &Path, width: u32, height: u32, rgba8: &[u8]) -> Result<(), PlayerError> {
    let fail =
        |error: &dyn std::fmt::Display| PlayerError::Input(format!("{}: {error}", path.display()));
    let bytes = encode(width, height, rgba8).map_err(|error| fail(&error))?;
    write_whole(path, &bytes).map_err(|error| fail(&error))
}

/// The bytes of such a file.
///
/// # Errors
/// Those of the encoder: an empty picture, or too few bytes.
pub fn encode(width: u32, height: u32, rgba8: &[u8]) -> Result<Vec<u8>, png::EncodingError> {
    let rgb: Vec<u8> = rgba8
        .chunks_exact(4)
        .flat_map(|texel| [texel[0], texel[1], texel[2]])
        .collect();
    let mut bytes = Vec::new();
    let mut encoder = png::Encoder::new(&mut bytes, width, height);
    encoder.set_color(png::ColorType::Rgb);
    encoder.set_depth(png::BitDepth::Eight);
    encoder.set_source_srgb(png::SrgbRenderingIntent::RelativeColorimetric);
    let mut writer = encoder.write_header()?;
    writer.write_image_data(&rgb)?;
    writer.finish()?;
    Ok(bytes)
}

/// Writes a file by a temporary neighbour, fsync and rename.
pub fn write_whole(path: &Path, bytes: &[u8]) -> std::io::Result<()> {
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    let temporary = path.with_file_name(format!(".{name}.{}.tmp", std::process::id()));
    let write = || {
        let mut file = std::fs::File::create(&temporary)?;
        file.write_all(bytes)?;
        file.sync_all()?;
        std::fs::rename(&temporary, path)
    };
    write().inspect_err(|_| {
        let _ = std::fs::remove_file(&temporary);
    })
}
