//! Writes a package file whole or not at all, checked before it takes its name.

use std::io::BufWriter;
use std::path::Path;

use cairn_format::scene::Scene;
use cairn_format::{Error, Package, Writer};

use crate::diagnostic::{BakeError, Result};
use crate::temporary::{self, Temporary};

/// Writes to a temporary neighbour of `path`, opens and verifies it, syncs, then renames it. Returns the
/// file's length and content hash.
///
/// # Errors
/// [`BakeError::Io`] where the folder cannot be written; nothing is left behind.
pub fn write(path: &Path, writer: &Writer, scene: &Scene) -> Result<(u64, [u8; 32])> {
    let io = |source| BakeError::io(path, source);
    let folder = temporary::folder_of(path);
    temporary::sweep(folder);
    let temporary = Temporary::create(folder).map_err(io)?;
    let mut buffered = BufWriter::with_capacity(1 << 20, temporary.file());
    let written = writer.write(scene, env!("CARGO_PKG_VERSION"), &mut buffered);
    written.map_err(|error| match error {
        Error::Io { source, .. } => io(source),
        other => BakeError::Package(other),
    })?;
    drop(buffered);
    let package = Package::open(temporary.path())?;
    package.verify()?;
    let (length, hash) = (package.header().file_length, package.header().content_hash);
    drop(package);
    temporary.publish(path).map_err(io)?;
    Ok((length, hash))
}
