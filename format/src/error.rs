//! Why a package was refused: typed errors with section and byte offset.

use std::path::PathBuf;

use crate::section::SectionKind;

/// The part of a package an error points at.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Part {
    /// The fixed header, file bytes 0..128.
    Header,
    /// The section table, right behind the header.
    Table,
    /// The rkyv root.
    Root,
    /// A raw section.
    Section(SectionKind),
}

impl std::fmt::Display for Part {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Header => f.write_str("header"),
            Self::Table => f.write_str("section table"),
            Self::Root => f.write_str("root"),
            Self::Section(kind) => write!(f, "section {}", kind.name()),
        }
    }
}

/// Why a package could not be opened, verified or written.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// The operating system refused.
    #[error("{}: {source}", path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// The system's error.
        source: std::io::Error,
    },
    /// The first eight bytes are not those of a package.
    #[error("not a Cairn package: the file does not begin with the CAIRN magic")]
    NotAPackage,
    /// Written in another format version.
    #[error(
        "format version {found}, written by cairn-bake {tool}; this program reads version {supported}: \
         bake the scene again with this program's cairn-bake"
    )]
    Version {
        /// Version in the file.
        found: u32,
        /// Version this crate reads.
        supported: u32,
        /// Tool version in the file.
        tool: String,
    },
    /// Same format version, other record layouts (a development build).
    #[error(
        "record layouts {found:016x} of cairn-bake {tool} differ from this program's {expected:016x}: \
         bake the scene again with this program's cairn-bake"
    )]
    Schema {
        /// Schema hash in the file.
        found: u64,
        /// Schema hash of this crate.
        expected: u64,
        /// Tool version in the file.
        tool: String,
    },
    /// The file is shorter or longer than its header says.
    #[error("{actual} bytes long, but the header says {expected}: the file was cut or appended to")]
    Length {
        /// Length in the header, or the least length of any package.
        expected: u64,
        /// Length of the file.
        actual: u64,
    },
    /// A rule of the format is broken.
    #[error("{part}, byte {offset}: {what}")]
    Corrupt {
        /// Where.
        part: Part,
        /// Byte offset from the beginning of the part.
        offset: u64,
        /// Which rule, with the offending values.
        what: String,
    },
    /// The file changed its length while it was mapped.
    #[error("the file was {expected} bytes long when it was opened and is {actual} now")]
    Changed {
        /// Length at open.
        expected: u64,
        /// Length now.
        actual: u64,
    },
}

impl Error {
    /// A broken rule at `offset` of `part`.
    pub fn corrupt(part: Part, offset: u64, what: impl Into<String>) -> Self {
        Self::Corrupt {
            part,
            offset,
            what: what.into(),
        }
    }
}

/// Shorthand of this crate's fallible functions.
pub type Result<T, E = Error> = std::result::Result<T, E>;
