//! Warnings that a caller takes for errors.

use std::collections::BTreeSet;
use std::str::FromStr;

use crate::codes::{self, Level};
use crate::diagnostic::{BakeError, Diagnostic, Result, Severity};
use crate::label::Label;

/// Which warnings stop a bake. It decides no bytes.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub enum Strict {
    /// None.
    #[default]
    No,
    /// All of them.
    All,
    /// Those of these codes.
    Codes(BTreeSet<Label>),
}

impl FromStr for Strict {
    type Err = String;

    /// `all`, or codes separated by commas.
    fn from_str(text: &str) -> Result<Self, String> {
        if text == "all" {
            return Ok(Self::All);
        }
        text.split(',')
            .map(|name| match codes::find(name) {
                Some(code) if code.level != Level::Error => Ok(code.name),
                Some(_) => Err(format!("`{name}` is an error in any case")),
                None => Err(format!(
                    "there is no code `{name}`: see docs/diagnostics.md"
                )),
            })
            .collect::<Result<_, _>>()
            .map(Self::Codes)
    }
}

impl Strict {
    fn names(&self, code: &str) -> bool {
        match self {
            Self::No => false,
            Self::All => true,
            Self::Codes(codes) => codes.contains(code),
        }
    }

    /// Refuses the first of the warnings that are errors here.
    ///
    /// # Errors
    /// That warning as an error.
    pub fn check<'a>(&self, diagnostics: impl IntoIterator<Item = &'a Diagnostic>) -> Result<()> {
        let mut errors = diagnostics
            .into_iter()
            .filter(|diagnostic| self.names(diagnostic.code));
        let Some(first) = errors.next() else {
            return Ok(());
        };
        let others = errors.count();
        let mut error = first.clone();
        error.severity = Severity::Error;
        error.message += &format!(" (an error by --strict, with {others} more)");
        Err(BakeError::Input(error))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::Origin;

    #[test]
    fn only_warnings_are_named() {
        assert_eq!("all".parse(), Ok(Strict::All));
        let two = "light-range,glb".parse::<Strict>().expect("two codes");
        assert!(two.names("glb") && two.names("light-range") && !two.names("light-cone"));
        for text in ["", "no-such-code", "not-gltf", "glb,", "all,glb"] {
            assert!(text.parse::<Strict>().is_err(), "{text}");
        }
    }

    #[test]
    fn the_first_named_warning_is_the_error() {
        let warning = |code| Diagnostic::warning(code, &Origin::default(), "odd");
        let found = [
            warning("light-range"),
            warning("light-cone"),
            warning("light-cone"),
        ];
        assert!(Strict::No.check(&found).is_ok());
        let only: Strict = "glb".parse().expect("a code");
        assert!(only.check(&found).is_ok());
        let cones: Strict = "light-cone".parse().expect("a code");
        let error = cones.check(&found).expect_err("two warnings");
        assert_eq!(error.code(), "light-cone");
        assert!(error.to_string().starts_with("error[light-cone]"));
        assert!(error.to_string().ends_with("with 1 more)"), "{error}");
        assert!(Strict::All.check(&found).is_err());
    }
}
