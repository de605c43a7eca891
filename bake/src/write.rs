//! Writes a package file whole or not at all, checked before it takes its name.

use std::io::{BufWriter, Write};
use std::path::Path;

use cairn_format::scene::Scene;
use cairn_format::{Error, Package, SectionKind, Writer};

use crate::diagnostic::{BakeError, Result};
use crate::pipeline::hex;
use crate::report::Section;
use crate::temporary::{self, Temporary};

/// The package that was written.
pub struct Written {
    pub bytes: u64,
    /// Of header, section table and root.
    pub content_hash: [u8; 32],
    /// In file order.
    pub sections: Vec<Section>,
}

/// Writes to a temporary neighbour of `path`, opens and verifies it, syncs, then renames it.
///
/// # Errors
/// [`BakeError::Io`] where the folder cannot be written; nothing is left behind.
pub fn write(path: &Path, writer: &Writer, scene: &Scene) -> Result<Written> {
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
    let written = describe(&package);
    drop(package);
    temporary.publish(path).map_err(io)?;
    Ok(written)
}

/// Writes a file whole or not at all.
///
/// # Errors
/// [`BakeError::Io`] where the folder cannot be written; nothing is left behind.
pub fn bytes(path: &Path, bytes: &[u8]) -> Result<()> {
    let folder = temporary::folder_of(path);
    temporary::sweep(folder);
    let written = Temporary::create(folder).and_then(|temporary| {
        temporary.file().write_all(bytes)?;
        temporary.publish(path)
    });
    written.map_err(|source| BakeError::io(path, source))
}

fn describe(package: &Package) -> Written {
    let sections = package.table().iter().map(|entry| Section {
        name: SectionKind::from_u32(entry.kind).map_or("unknown", SectionKind::name),
        bytes: entry.length,
        hash: hex(&entry.hash),
    });
    Written {
        bytes: package.header().file_length,
        content_hash: package.header().content_hash,
        sections: sections.collect(),
    }
}
