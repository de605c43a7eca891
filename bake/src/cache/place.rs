//! Where the cache lies when nobody says.

use std::env::var_os;
use std::path::PathBuf;

/// Names the cache's folder, or `off`.
pub const VARIABLE: &str = "CAIRN_CACHE";

/// A folder for the cache, or none.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Place {
    Off,
    Folder(PathBuf),
}

impl Place {
    /// Reads `DIR` or `off`.
    pub fn parse(text: &str) -> Self {
        match text {
            "off" => Self::Off,
            folder => Self::Folder(folder.into()),
        }
    }

    /// What [`VARIABLE`] says, else the user's cache folder, else none.
    pub fn default_of_user() -> Self {
        match var_os(VARIABLE).filter(|text| !text.is_empty()) {
            Some(text) if text == "off" => Self::Off,
            Some(text) => Self::Folder(text.into()),
            None => users_folder().map_or(Self::Off, Self::Folder),
        }
    }

    /// The folder, where there is one.
    pub fn folder(self) -> Option<PathBuf> {
        match self {
            Self::Off => None,
            Self::Folder(folder) => Some(folder),
        }
    }
}

/// By the XDG base directory specification on Unix, the usual places elsewhere; relative paths are ignored, as it
/// says.
fn users_folder() -> Option<PathBuf> {
    let absolute = |name: &str| {
        var_os(name)
            .map(PathBuf::from)
            .filter(|path| path.is_absolute())
    };
    let base = if cfg!(windows) {
        absolute("LOCALAPPDATA")
    } else if cfg!(target_os = "macos") {
        absolute("HOME").map(|home| home.join("Library/Caches"))
    } else {
        absolute("XDG_CACHE_HOME").or_else(|| absolute("HOME").map(|home| home.join(".cache")))
    };
    base.map(|base| base.join("cairn").join("bake"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_folder_may_be_named_off_with_its_path() {
        assert_eq!(Place::parse("off").folder(), None);
        assert_eq!(Place::parse("./off").folder(), Some("./off".into()));
        assert_eq!(Place::parse("a b").folder(), Some("a b".into()));
    }
}
