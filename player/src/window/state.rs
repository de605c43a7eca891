//! What is kept of a package between runs: settings and bookmarks, in one JSON file.
//!
//! `{"settings": {..}, "cameras": {..}}`: the cameras are those of a camera file, so `--camera FILE:NAME` reads it.

use std::path::{Path, PathBuf};

use crate::PlayerError;
use crate::camera::Camera;
use crate::camera_file;
use crate::png::write_whole;
use crate::settings::Settings;
use crate::user;

/// The file of a package, by its place; `None` where the system names no folder.
pub fn file_of(package: &Path) -> Option<PathBuf> {
    let place = std::fs::canonicalize(package).unwrap_or_else(|_| package.to_owned());
    // FNV-1a: packages of one name in two folders are kept apart.
    let hash = place
        .to_string_lossy()
        .bytes()
        .fold(0xcbf2_9ce4_8422_2325_u64, |hash, byte| {
            (hash ^ u64::from(byte)).wrapping_mul(0x0100_0000_01b3)
        });
    let name = place
        .file_stem()
        .unwrap_or_default()
        .to_string_lossy()
        .into_owned();
    Some(
        user::state_folder()?
            .join("packages")
            .join(format!("{name}-{hash:016x}.json")),
    )
}

/// What is kept.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct State {
    /// Settings of the panel.
    pub settings: Settings,
    /// Bookmarks by name, in the order of their names.
    pub cameras: Vec<(String, Camera)>,
}

impl State {
    /// Reads a file; the default where there is none.
    ///
    /// # Errors
    /// [`PlayerError::Input`] naming the file and what is wrong.
    pub fn load(file: &Path) -> Result<Self, PlayerError> {
        let mut state = Self::default();
        if !file.exists() {
            return Ok(state);
        }
        let fail = |what: String| PlayerError::Input(format!("{}: {what}", file.display()));
        let text = std::fs::read_to_string(file).map_err(|error| fail(error.to_string()))?;
        let json: serde_json::Value =
            serde_json::from_str(&text).map_err(|error| fail(error.to_string()))?;
        if let Some(settings) = json.get("settings") {
            state
                .settings
                .merge_json(settings)
                .map_err(|error| fail(error.to_string()))?;
        }
        state.cameras = camera_file::load_all(file)?;
        Ok(state)
    }

    /// Writes the file, whole or not at all.
    ///
    /// # Errors
    /// [`PlayerError::Input`] naming the file.
    pub fn save(&self, file: &Path) -> Result<(), PlayerError> {
        let cameras: serde_json::Value =
            serde_json::from_str(&camera_file::to_text(&self.cameras)).unwrap_or_default();
        let json = serde_json::json!({"settings": self.settings, "cameras": cameras["cameras"]});
        let folder = file.parent().map_or(Ok(()), std::fs::create_dir_all);
        folder
            .and_then(|()| write_whole(file, format!("{json:#}\n").as_bytes()))
            .map_err(|error| PlayerError::Input(format!("{}: {error}", file.display())))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_kept_comes_back() {
        let folder = tempfile::tempdir().expect("a folder");
        let file = folder.path().join("deep/state.json");
        assert_eq!(State::load(&file).expect("nothing yet"), State::default());
        let mut state = State::default();
        state.settings.shadow.cascades = 2;
        state.cameras.push(("door".into(), Camera::default()));
        state.save(&file).expect("saved");
        let back = State::load(&file).expect("read");
        assert_eq!(back.settings, state.settings);
        assert_eq!(back.cameras[0].0, "door");
        std::fs::write(&file, r#"{"settings": {"msaa": 3}, "cameras": {}}"#).expect("written");
        let error = State::load(&file).expect_err("refused").to_string();
        assert!(
            error.contains("state.json") && error.contains("msaa"),
            "{error}"
        );
    }
}
