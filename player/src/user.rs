//! Where the user's files of this program are: what can be lost (cache) and what is kept (state).

use std::env::var_os;
use std::path::PathBuf;

/// Pipeline caches. `None` where the system names no folder.
pub fn cache_folder() -> Option<PathBuf> {
    folder("XDG_CACHE_HOME", ".cache", "Library/Caches")
}

/// Settings and bookmarks per package. `None` where the system names no folder.
pub fn state_folder() -> Option<PathBuf> {
    folder(
        "XDG_STATE_HOME",
        ".local/state",
        "Library/Application Support",
    )
}

/// The XDG base directory specification on Unix, the usual places elsewhere; relative paths are ignored, as it says.
fn folder(variable: &str, unix: &str, macos: &str) -> Option<PathBuf> {
    let absolute = |name: &str| {
        var_os(name)
            .map(PathBuf::from)
            .filter(|path| path.is_absolute())
    };
    let base = if cfg!(windows) {
        absolute("LOCALAPPDATA")
    } else if cfg!(target_os = "macos") {
        absolute("HOME").map(|home| home.join(macos))
    } else {
        absolute(variable).or_else(|| absolute("HOME").map(|home| home.join(unix)))
    };
    base.map(|base| base.join("cairn"))
}
