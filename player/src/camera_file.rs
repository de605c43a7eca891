//! Camera files: JSON with named look-at cameras.
//!
//! `{"cameras": {"NAME": {"eye": [x, y, z], "target": [x, y, z], "up": [x, y, z], "yfov": radians}}}`; other
//! members are ignored, `up` may be left out.

use std::collections::BTreeMap;
use std::path::Path;

use glam::Vec3;

use crate::camera::Camera;
use crate::error::PlayerError;

#[derive(serde::Deserialize)]
struct File {
    cameras: BTreeMap<String, Entry>,
}

#[derive(serde::Deserialize)]
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
    let fail = |what: String| PlayerError::Input(format!("{}: {what}", path.display()));
    let text = std::fs::read_to_string(path).map_err(|error| fail(error.to_string()))?;
    parse(&text, name).map_err(fail)
}

fn parse(text: &str, name: &str) -> Result<Camera, String> {
    let file: File =
        serde_json::from_str(text).map_err(|error| format!("no camera file: {error}"))?;
    let Some(entry) = file.cameras.get(name) else {
        let names: Vec<&str> = file.cameras.keys().map(String::as_str).collect();
        return Err(format!(
            "no camera `{name}`; there are: {}",
            names.join(", ")
        ));
    };
    let vectors = [entry.eye, entry.target, entry.up].map(Vec3::from);
    let sane = entry.yfov > 0.0 && entry.yfov < 3.1;
    if !sane || !vectors.iter().all(|vector| vector.is_finite()) {
        return Err(format!(
            "camera `{name}`: a vector is not finite, or yfov is not in (0, 3.1)"
        ));
    }
    Camera::look_at(vectors[0], vectors[1], vectors[2], entry.yfov)
        .ok_or_else(|| format!("camera `{name}`: eye, target and up give no direction"))
}

#[cfg(test)]
mod tests {
    use super::*;

    const FILE: &str =
        r#"{"cameras": {"a": {"eye": [0, 0, 2], "target": [0, 0, 0], "yfov": 0.75, "env": "x"}}}"#;

    #[test]
    fn reads_a_camera_by_name() {
        let camera = parse(FILE, "a").expect("camera a");
        assert_eq!(camera.forward, Vec3::NEG_Z);
        assert_eq!(camera.up, Vec3::Y);
    }

    #[test]
    fn names_what_there_is() {
        assert!(parse(FILE, "b").expect_err("no b").contains("there are: a"));
        assert!(parse("[]", "a").is_err());
        let same = FILE.replace("[0, 0, 2]", "[0, 0, 0]");
        assert!(
            parse(&same, "a")
                .expect_err("no direction")
                .contains("direction")
        );
    }
}
