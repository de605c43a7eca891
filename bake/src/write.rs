//! Writes a package file whole or not at all, checked before it takes its name.

use std::io::BufWriter;
use std::path::Path;

use cairn_format::scene::Scene;
use cairn_format::{Error, Package, Writer};
use tempfile::NamedTempFile;

use crate::diagnostic::{BakeError, Result};

/// Writes to a temporary neighbour of `path`, syncs, opens and verifies it, then renames it. Returns the
/// file's length and content hash.
///
/// # Errors
/// [`BakeError::Io`] where the folder cannot be written; nothing is left behind.
pub fn write(path: &Path, writer: &Writer, scene: &Scene) -> Result<(u64, [u8; 32])> {
    let io = |source| BakeError::io(path, source);
    let temporary = neighbour(path).map_err(io)?;
    let mut buffered = BufWriter::with_capacity(1 << 20, temporary.as_file());
    let written = writer.write(scene, env!("CARGO_PKG_VERSION"), &mut buffered);
    written.map_err(|error| match error {
        Error::Io { source, .. } => io(source),
        other => BakeError::Package(other),
    })?;
    drop(buffered);
    temporary.as_file().sync_all().map_err(io)?;
    let package = Package::open(temporary.path())?;
    package.verify()?;
    let (length, hash) = (package.header().file_length, package.header().content_hash);
    drop(package);
    publish(temporary, path).map_err(io)?;
    Ok((length, hash))
}

/// Writes a file whole or not at all.
///
/// # Errors
/// [`BakeError::Io`] where the folder cannot be written; nothing is left behind.
pub fn bytes(path: &Path, bytes: &[u8]) -> Result<()> {
    use std::io::Write;
    let written = neighbour(path).and_then(|mut temporary| {
        temporary.write_all(bytes)?;
        temporary.as_file().sync_all()?;
        publish(temporary, path)
    });
    written.map_err(|source| BakeError::io(path, source))
}

fn folder(path: &Path) -> &Path {
    let folder = path.parent();
    folder
        .filter(|folder| !folder.as_os_str().is_empty())
        .unwrap_or(Path::new("."))
}

/// A temporary file on the same volume.
fn neighbour(path: &Path) -> std::io::Result<NamedTempFile> {
    tempfile::Builder::new()
        .prefix(".cairn-")
        .suffix(".tmp")
        .tempfile_in(folder(path))
}

/// Gives a synced file its name.
fn publish(temporary: NamedTempFile, path: &Path) -> std::io::Result<()> {
    let file = temporary.persist(path).map_err(|error| error.error)?;
    make_readable(&file)?;
    sync_folder(folder(path))
}

/// Temporary files are private; a package is as readable as any other output.
#[cfg(unix)]
fn make_readable(file: &std::fs::File) -> std::io::Result<()> {
    use std::os::unix::fs::PermissionsExt;
    file.set_permissions(std::fs::Permissions::from_mode(0o644))
}

#[cfg(not(unix))]
fn make_readable(_file: &std::fs::File) -> std::io::Result<()> {
    Ok(())
}

/// The rename itself survives a crash once the folder is synced.
#[cfg(unix)]
fn sync_folder(folder: &Path) -> std::io::Result<()> {
    std::fs::File::open(folder)?.sync_all()
}

#[cfg(not(unix))]
fn sync_folder(_folder: &Path) -> std::io::Result<()> {
    Ok(())
}
