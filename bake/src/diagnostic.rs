//! Errors and warnings about input: where, what is wrong, and what to do.

use std::fmt;
use std::path::{Path, PathBuf};

use crate::label::{Interned, Label};
use crate::scene::Origin;

/// How much a diagnostic matters.
#[derive(
    rkyv::Archive,
    rkyv::Serialize,
    rkyv::Deserialize,
    Clone,
    Copy,
    Debug,
    PartialEq,
    Eq,
    PartialOrd,
    Ord,
    serde::Serialize,
    serde::Deserialize,
)]
#[serde(rename_all = "lowercase")]
pub enum Severity {
    Warning,
    Error,
}

/// One message about one place in the input.
#[derive(
    rkyv::Archive,
    rkyv::Serialize,
    rkyv::Deserialize,
    Clone,
    Debug,
    PartialEq,
    Eq,
    serde::Serialize,
    serde::Deserialize,
)]
pub struct Diagnostic {
    pub severity: Severity,
    /// Stable name such as `accessor-out-of-range`.
    #[serde(deserialize_with = "crate::label::read")]
    #[rkyv(with = Interned)]
    pub code: Label,
    /// File as the user named it, or relative to the scene.
    pub file: String,
    /// JSON pointer (`/meshes/0/primitives/1`), byte offset (`byte 1234`) or empty.
    pub place: String,
    /// What is wrong, and the remedy.
    pub message: String,
}

impl Diagnostic {
    pub fn warning(code: &'static str, origin: &Origin, message: impl Into<String>) -> Self {
        Self {
            severity: Severity::Warning,
            code,
            file: origin.file.clone(),
            place: origin.pointer.clone(),
            message: message.into(),
        }
    }

    pub fn error(code: &'static str, origin: &Origin, message: impl Into<String>) -> Self {
        Self {
            severity: Severity::Error,
            ..Self::warning(code, origin, message)
        }
    }
}

impl fmt::Display for Diagnostic {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let severity = match self.severity {
            Severity::Warning => "warning",
            Severity::Error => "error",
        };
        write!(f, "{severity}[{}]: {}", self.code, self.file)?;
        if !self.place.is_empty() {
            write!(f, " at {}", self.place)?;
        }
        write!(f, ": {}", self.message)
    }
}

/// Why a bake stopped. Every variant names the file.
#[derive(Debug, thiserror::Error)]
pub enum BakeError {
    /// The input breaks a rule, or is not supported.
    #[error("{0}")]
    Input(Diagnostic),
    /// A file could not be read or written.
    #[error("error[io]: {}: {source}", path.display())]
    Io {
        path: PathBuf,
        source: std::io::Error,
    },
    /// The finished package broke its own rules: a bug in the bake, reported instead of written.
    #[error("error[package]: {0}")]
    Package(#[from] cairn_format::Error),
}

impl BakeError {
    pub fn input(code: &'static str, origin: &Origin, message: impl Into<String>) -> Self {
        Self::Input(Diagnostic::error(code, origin, message))
    }

    pub fn io(path: &Path, source: std::io::Error) -> Self {
        Self::Io {
            path: path.to_owned(),
            source,
        }
    }
}

/// Shorthand of the bake's fallible functions.
pub type Result<T, E = BakeError> = std::result::Result<T, E>;
