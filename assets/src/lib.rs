//! Makes Cairn's own scenes and sky as glTF 2.0, PNG and Radiance HDR files, byte for byte the same on every machine.

pub mod boxes;
pub mod bumps;
pub mod gltf;
pub mod hall;
pub mod hdr;
pub mod lights;
pub mod lobes;
pub mod materials;
pub mod mesh;
pub mod noise;
pub mod sky;
pub mod texture;

#[cfg(test)]
mod checks;

use std::io;
use std::path::Path;

/// One file to write, by its path below the output directory ('/' separated).
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct OutputFile {
    pub path: String,
    pub bytes: Vec<u8>,
}

impl OutputFile {
    pub fn new(path: impl Into<String>, bytes: Vec<u8>) -> Self {
        Self {
            path: path.into(),
            bytes,
        }
    }
}

/// Every file of the asset set, in a fixed order.
pub fn generate() -> Vec<OutputFile> {
    let mut files = hall::generate();
    files.push(OutputFile::new("hall/sky.hdr", sky::sky_hdr()));
    files.extend(materials::generate());
    files.extend(lights::generate());
    files.extend(lobes::generate());
    files.extend(boxes::generate());
    files.extend(bumps::generate());
    files
}

/// Writes `files` below `root`, making the directories they need.
pub fn write_all(root: &Path, files: &[OutputFile]) -> io::Result<()> {
    for file in files {
        let path = root.join(&file.path);
        if let Some(parent) = path.parent() {
            std::fs::create_dir_all(parent)?;
        }
        std::fs::write(path, &file.bytes)?;
    }
    Ok(())
}
