//! Camera files: JSON with named look-at cameras.
//!
//! `{"cameras": {"NAME": {"eye": [x, y, z], "target": [x, y, z], "up": [x, y, z], "yfov": radians}}}`; other
//! members are ignored, `up` may be left out.

use std::collections::BTreeMap;
use std::path::Path;

use glam::Vec3;

use crate::camera::{Camera, Projection};
use crate::error::PlayerError;

#[derive(serde::Deserialize, serde::Serialize)]
struct File {
    cameras: BTreeMap<String, Entry>,
}

#[derive(serde::Deserialize, serde::Serialize)]
struct Entry {
    eye: [f32; 3],
    target: [f32; 3],
    #[serde(default = "y_up")]
    up: [f32; 3],
    yfov: f32,
}

fn y_up() -> [f32; 3] {
    [0.0, 1.0, 0.0]
}

/// Reads camera `name` of the file.
///
/// # Errors
/// [`PlayerError::Input`] naming the file, the camera, and the cameras there are.
pub fn load(path: &Path, name: &str) -> Result<Camera, PlayerError> {
    with_text(path, |text| {
        let file = parse_file(text)?;
        let Some(entry) = file.cameras.get(name) else {
            let names: Vec<&str> = file.cameras.keys().map(String::as_str).collect();
            return Err(format!(
                "no camera `{name}`; there are: {}",
                names.join(", ")
            ));
        };
        entry.camera(name)
    })
}

/// Reads all cameras of the file, by name.
///
/// # Errors
/// [`PlayerError::Input`] naming the file, and the camera that is none.
pub fn load_all(path: &Path) -> Result<Vec<(String, Camera)>, PlayerError> {
    with_text(path, |text| {
        let cameras = parse_file(text)?.cameras.into_iter();
        let camera = |(name, entry): (String, Entry)| Ok((name.clone(), entry.camera(&name)?));
        cameras.map(camera).collect()
    })
}

/// The cameras as the text of a file. Orthographic ones, which the format does not have, are left out.
pub fn to_text(cameras: &[(String, Camera)]) -> String {
    let entry = |(name, camera): &(String, Camera)| match camera.projection {
        Projection::Perspective { yfov } => Some((
            name.clone(),
            Entry {
                eye: camera.position.to_array(),
                target: (camera.position + camera.forward).to_array(),
                up: camera.up.to_array(),
                yfov,
            },
        )),
        Projection::Orthographic { .. } => None,
    };
    let file = File {
        cameras: cameras.iter().filter_map(entry).collect(),
    };
    // Names and finite numbers always become JSON.
    serde_json::to_string_pretty(&file).unwrap_or_default()
}

fn with_text<T>(
    path: &Path,
    read: impl FnOnce(&str) -> Result<T, String>,
) -> Result<T, PlayerError> {
    let fail = |what: String| PlayerError::Input(format!("{}: {what}", path.display()));
    let text = std::fs::read_to_string(path).map_err(|error| fail(error.to_string()))?;
    read(&text).map_err(fail)
}

fn parse_file(text: &str) -> Result<File, String> {
    serde_json::from_str(text).map_err(|error| format!("no camera file: {error}"))
}

impl Entry {
    fn camera(&self, name: &str) -> Result<Camera, String> {
        let vectors = [self.eye, self.target, self.up].map(Vec3::from);
        let sane = self.yfov > 0.0 && self.yfov < 3.1;
        if !sane || !vectors.iter().all(|vector| vector.is_finite()) {
            return Err(format!(
                "camera `{name}`: a vector is not finite, or yfov is not in (0, 3.1)"
            ));
        }
        Camera::look_at(vectors[0], vectors[1], vectors[2], self.yfov)
            .ok_or_else(|| format!("camera `{name}`: eye, target and up give no direction"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const FILE: &str =
        r#"{"cameras": {"a": {"eye": [0, 0, 2], "target": [0, 0, 0], "yfov": 0.75, "env": "x"}}}"#;

    fn file(text: &str) -> tempfile::NamedTempFile {
        let file = tempfile::NamedTempFile::new().expect("a file");
        std::fs::write(file.path(), text).expect("written");
        file
    }

    #[test]
    fn reads_a_camera_by_name() {
        let camera = load(file(FILE).path(), "a").expect("camera a");
        assert_eq!(camera.forward, Vec3::NEG_Z);
        assert_eq!(camera.up, Vec3::Y);
    }

    #[test]
    fn names_what_there_is() {
        let error = |text: &str, name| load(file(text).path(), name).expect_err(text).to_string();
        assert!(error(FILE, "b").contains("there are: a"));
        assert!(error("[]", "a").contains("no camera file"));
        let same = FILE.replace("[0, 0, 2]", "[0, 0, 0]");
        assert!(error(&same, "a").contains("direction"));
        assert!(load_all(file(&same).path()).is_err());
    }

    #[test]
    fn what_is_written_is_read_back() {
        let eye = Vec3::new(1.5, -2.25, 8.0);
        let camera = Camera::look_at(eye, Vec3::new(0.3, 0.0, -0.7), Vec3::Y, 0.8).expect("a view");
        let cameras = vec![
            ("one".to_owned(), camera),
            ("a".to_owned(), Camera::default()),
        ];
        let read = load_all(file(&to_text(&cameras)).path()).expect("cameras");
        assert_eq!(read.len(), 2);
        let (name, back) = &read[1];
        assert_eq!((name.as_str(), back.position), ("one", eye));
        assert!((back.forward - camera.forward).length() < 1e-6);
        assert_eq!(back.projection, camera.projection);
    }
}
