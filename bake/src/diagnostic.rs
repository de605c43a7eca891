//! Errors and warnings about input: where, what is wrong, and what to do.

use std::collections::BTreeSet;
use std::fmt;
use std::path::{Path, PathBuf};

use crate::codes;
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
    /// Kind and name of the object there, such as "mesh `Wheel`"; empty where it has none.
    #[serde(default)]
    pub object: String,
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
            object: String::new(),
            message: message.into(),
        }
    }

    pub fn error(code: &'static str, origin: &Origin, message: impl Into<String>) -> Self {
        Self {
            severity: Severity::Error,
            ..Self::warning(code, origin, message)
        }
    }

    /// Names the object at the place.
    #[must_use]
    pub fn about(mut self, object: String) -> Self {
        self.object = object;
        self
    }

    /// The message, why it matters and what to do: three lines.
    pub fn explained(&self) -> String {
        format!("{self}{}", footnote(self.code))
    }
}

/// Why a code matters and what to do, as lines under its message; empty where nothing is known.
fn footnote(code: &str) -> String {
    codes::find(code).map_or(String::new(), |code| {
        format!("\n  why: {}\n  fix: {}", code.why, code.fix)
    })
}

/// Messages as a terminal shows them: what stands behind a code is told once.
pub fn listing(diagnostics: &[Diagnostic]) -> String {
    let mut told = BTreeSet::new();
    let mut text = String::new();
    for diagnostic in diagnostics {
        text += &diagnostic.to_string();
        if told.insert(diagnostic.code) {
            text += &footnote(diagnostic.code);
        }
        text.push('\n');
    }
    text
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
        if !self.object.is_empty() {
            write!(f, " ({})", self.object)?;
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

    /// The code of the message.
    pub fn code(&self) -> &'static str {
        match self {
            Self::Input(diagnostic) => diagnostic.code,
            Self::Io { .. } => "io",
            Self::Package(_) => "package",
        }
    }

    /// The message, why it matters and what to do: three lines.
    pub fn explained(&self) -> String {
        format!("{self}{}", footnote(self.code()))
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

#[cfg(test)]
mod tests {
    use super::*;

    fn warning(code: &'static str, pointer: &str) -> Diagnostic {
        let origin = Origin {
            file: "hall.gltf".into(),
            pointer: pointer.into(),
        };
        Diagnostic::warning(code, &origin, "it is odd")
    }

    #[test]
    fn a_message_has_its_place_object_reason_and_remedy() {
        let light = warning("light-range", "/lights/3").about("light `Lamp`".into());
        let lines: Vec<String> = light.explained().lines().map(str::to_owned).collect();
        let code = codes::find("light-range").expect("a code");
        assert_eq!(
            lines[0],
            "warning[light-range]: hall.gltf at /lights/3 (light `Lamp`): it is odd"
        );
        assert_eq!(lines[1], format!("  why: {}", code.why));
        assert_eq!(lines[2], format!("  fix: {}", code.fix));
        let error = BakeError::io(Path::new("a.bin"), std::io::Error::other("gone"));
        assert!(
            error
                .explained()
                .starts_with("error[io]: a.bin: gone\n  why: ")
        );
    }

    #[test]
    fn what_stands_behind_a_code_is_told_once() {
        let text = listing(&[
            warning("light-range", "/lights/0"),
            warning("light-range", "/lights/1"),
            warning("light-cone", "/lights/2"),
        ]);
        assert_eq!(text.lines().count(), 3 + 2 * 2);
        assert_eq!(text.matches("  why: ").count(), 2);
    }
}
