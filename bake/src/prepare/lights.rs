//! Lights and cameras of a scene as a package stores them.

use cairn_format::gpu;
use cairn_format::scene::{self, LightKind, ProjectionKind};
use glam::{DVec3, Vec3};

use crate::diagnostic::Result;
use crate::scene::{self as source, Projection, Scene};

use super::fault;

/// GPU records of the directional lights; they cast shadows.
pub(super) fn directional(scene: &Scene) -> Vec<gpu::DirectionalLight> {
    let directional = |light: &&source::Light| light.kind == source::LightKind::Directional;
    let lights = scene.lights.iter().filter(directional);
    lights
        .map(|light| gpu::DirectionalLight {
            direction_and_intensity: light.direction.as_vec3().extend(light.intensity).to_array(),
            color_and_shadow: light.color.extend(1.0).to_array(),
        })
        .collect()
}

/// GPU records of the point and spot lights; they cast shadows.
pub(super) fn punctual(scene: &Scene) -> Vec<gpu::PunctualLight> {
    scene.lights.iter().filter_map(punctual_light).collect()
}

fn punctual_light(light: &source::Light) -> Option<gpu::PunctualLight> {
    let (range, [scale, offset]) = match light.kind {
        source::LightKind::Directional => return None,
        source::LightKind::Point { range } => (range, [0.0, 1.0]),
        source::LightKind::Spot {
            range,
            inner,
            outer,
        } => (range, cone(inner, outer)),
    };
    let range = if range.is_finite() { range } else { 0.0 };
    Some(gpu::PunctualLight {
        position_and_range: light.position.as_vec3().extend(range).to_array(),
        direction_and_spot_scale: light.direction.as_vec3().extend(scale).to_array(),
        color_and_shadow: (light.color * light.intensity).extend(1.0).to_array(),
        spot_offset: offset,
        pad_52: 0,
        pad_56: 0,
        pad_60: 0,
    })
}

/// Scale and offset of the cosine: 1 inside the inner cone, 0 outside the outer one (`KHR_lights_punctual`).
fn cone(inner: f32, outer: f32) -> [f32; 2] {
    const NARROWEST: f64 = 0.001;
    let [inner, outer] = [inner, outer].map(|angle| libm::cos(f64::from(angle)));
    let scale = 1.0 / (inner - outer).max(NARROWEST);
    [scale as f32, (-outer * scale) as f32]
}

/// Every light.
///
/// # Errors
/// A position that leaves the range of f32, or numbers that are not finite.
pub(super) fn lights(scene: &Scene) -> Result<Vec<scene::Light>> {
    scene
        .lights
        .iter()
        .map(|light| self::light(scene, light))
        .collect()
}

fn light(scene: &Scene, light: &source::Light) -> Result<scene::Light> {
    let what = || format!("light `{}`", light.name);
    // Zero stands for an unlimited range.
    let limited = |range: f32| if range.is_finite() { range } else { 0.0 };
    let (kind, range, inner_angle, outer_angle) = match light.kind {
        source::LightKind::Directional => (LightKind::Directional, 0.0, 0.0, 0.0),
        source::LightKind::Point { range } => (LightKind::Point, limited(range), 0.0, 0.0),
        source::LightKind::Spot {
            range,
            inner,
            outer,
        } => (LightKind::Spot, limited(range), inner, outer),
    };
    let scalars = Vec3::new(light.intensity, inner_angle, outer_angle);
    if !scalars.is_finite() || !(light.color * light.intensity).is_finite() {
        let message = format!("{} has numbers that are not finite", what());
        return Err(fault(scene, "non-finite-light", message));
    }
    Ok(scene::Light {
        name: light.name.clone(),
        kind,
        color: light.color.to_array(),
        intensity: light.intensity,
        position: rounded(scene, light.position, what)?,
        direction: rounded(scene, light.direction, what)?,
        range,
        inner_angle,
        outer_angle,
    })
}

/// Every camera.
///
/// # Errors
/// A position that leaves the range of f32.
pub(super) fn cameras(scene: &Scene) -> Result<Vec<scene::Camera>> {
    scene
        .cameras
        .iter()
        .map(|camera| self::camera(scene, camera))
        .collect()
}

fn camera(scene: &Scene, camera: &source::Camera) -> Result<scene::Camera> {
    let what = || format!("camera `{}`", camera.name);
    let (projection, extent, znear, zfar) = match camera.projection {
        Projection::Perspective { yfov, znear, zfar } => (
            ProjectionKind::Perspective,
            yfov,
            znear,
            zfar.unwrap_or(0.0),
        ),
        Projection::Orthographic {
            ymag, znear, zfar, ..
        } => (ProjectionKind::Orthographic, ymag, znear, zfar),
    };
    if !Vec3::new(extent, znear, zfar).is_finite() {
        let message = format!("{} has numbers that are not finite", what());
        return Err(fault(scene, "non-finite-camera", message));
    }
    Ok(scene::Camera {
        name: camera.name.clone(),
        projection,
        extent,
        znear,
        zfar,
        position: rounded(scene, camera.position, what)?,
        forward: rounded(scene, camera.forward, what)?,
        up: rounded(scene, camera.up, what)?,
    })
}

fn rounded(scene: &Scene, vector: DVec3, what: impl Fn() -> String) -> Result<[f32; 3]> {
    let rounded = vector.as_vec3();
    if rounded.is_finite() {
        return Ok(rounded.to_array());
    }
    let message = format!(
        "{} lies beyond the range of 32-bit floats: {vector}",
        what()
    );
    Err(fault(scene, "world-overflow", message))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn lamp(kind: source::LightKind) -> source::Light {
        source::Light {
            name: "lamp".into(),
            kind,
            color: Vec3::new(1.0, 0.5, 0.25),
            intensity: 40.0,
            position: DVec3::new(1.0, 2.0, 3.0),
            direction: DVec3::NEG_Y,
        }
    }

    fn spot(range: f32) -> source::LightKind {
        source::LightKind::Spot {
            range,
            inner: 0.1,
            outer: 0.2,
        }
    }

    #[test]
    fn only_directional_lights_have_gpu_records() {
        let kinds = [
            source::LightKind::Point {
                range: f32::INFINITY,
            },
            source::LightKind::Directional,
            spot(9.0),
        ];
        let scene = Scene {
            lights: kinds.map(lamp).to_vec(),
            ..Scene::default()
        };
        let records = directional(&scene);
        assert_eq!(records.len(), 1);
        assert_eq!(records[0].direction_and_intensity, [0.0, -1.0, 0.0, 40.0]);
        assert_eq!(records[0].color_and_shadow, [1.0, 0.5, 0.25, 1.0]);
        let lights = lights(&scene).expect("in range");
        let kinds: Vec<LightKind> = lights.iter().map(|light| light.kind).collect();
        assert_eq!(
            kinds,
            [LightKind::Point, LightKind::Directional, LightKind::Spot]
        );
        let ranges: Vec<f32> = lights.iter().map(|light| light.range).collect();
        assert_eq!(ranges, [0.0, 0.0, 9.0]);
        assert_eq!((lights[2].inner_angle, lights[2].outer_angle), (0.1, 0.2));
        assert_eq!(lights[2].position, [1.0, 2.0, 3.0]);
    }

    #[test]
    fn point_and_spot_lights_have_records() {
        let kinds = [
            source::LightKind::Point {
                range: f32::INFINITY,
            },
            source::LightKind::Directional,
            spot(9.0),
        ];
        let scene = Scene {
            lights: kinds.map(lamp).to_vec(),
            ..Scene::default()
        };
        let [point, spot] = punctual(&scene).try_into().expect("two records");
        assert_eq!(point.position_and_range, [1.0, 2.0, 3.0, 0.0]);
        assert_eq!(point.color_and_shadow, [40.0, 20.0, 10.0, 1.0]);
        assert_eq!(
            (point.direction_and_spot_scale[3], point.spot_offset),
            (0.0, 1.0)
        );
        assert_eq!(spot.position_and_range[3], 9.0);
        let at = |angle: f32| spot.direction_and_spot_scale[3] * angle.cos() + spot.spot_offset;
        assert!((at(0.1) - 1.0).abs() < 1e-4, "the inner cone: {}", at(0.1));
        assert!(at(0.2).abs() < 1e-4, "the outer cone: {}", at(0.2));
        assert!(at(0.15) > 0.2 && at(0.15) < 0.8);
        assert_eq!(cone(0.3, 0.3)[0], 1000.0, "cones of one angle have an edge");
    }

    #[test]
    fn places_beyond_f32_are_errors() {
        let mut far = lamp(spot(1.0));
        far.position.x = 1e39;
        let scene = Scene {
            lights: vec![far],
            ..Scene::default()
        };
        let error = lights(&scene).expect_err("the position overflows");
        assert!(error.to_string().contains("light `lamp`"), "{error}");
        let mut bright = lamp(spot(1.0));
        (bright.intensity, bright.color.x) = (f32::MAX, 2.0);
        let scene = Scene {
            lights: vec![bright],
            ..Scene::default()
        };
        let error = lights(&scene).expect_err("the product overflows");
        assert!(error.to_string().contains("not finite"), "{error}");
    }

    #[test]
    fn cameras_keep_their_projection() {
        let camera = |projection| source::Camera {
            name: "camera".into(),
            projection,
            position: DVec3::X,
            forward: DVec3::NEG_Z,
            up: DVec3::Y,
        };
        let scene = Scene {
            cameras: vec![
                camera(Projection::Perspective {
                    yfov: 0.7,
                    znear: 0.01,
                    zfar: None,
                }),
                camera(Projection::Orthographic {
                    xmag: 2.0,
                    ymag: 3.0,
                    znear: 0.5,
                    zfar: 80.0,
                }),
            ],
            ..Scene::default()
        };
        let cameras = cameras(&scene).expect("in range");
        let numbers = |camera: &scene::Camera| [camera.extent, camera.znear, camera.zfar];
        assert_eq!(cameras[0].projection, ProjectionKind::Perspective);
        assert_eq!(numbers(&cameras[0]), [0.7, 0.01, 0.0]);
        assert_eq!(cameras[1].projection, ProjectionKind::Orthographic);
        assert_eq!(numbers(&cameras[1]), [3.0, 0.5, 80.0]);
        assert_eq!(cameras[1].forward, [0.0, 0.0, -1.0]);
    }
}
