//! Reads cameras and places them in the world.

use std::collections::BTreeMap;

use glam::{DMat4, DVec3};
use gltf::json;
use gltf::json::camera::Type;
use gltf::json::validation::Checked;

use crate::diagnostic::Result;
use crate::scene::{Camera, Projection};

use super::context::Context;

/// Hands out each camera name once.
#[derive(Default)]
pub(super) struct CameraNames(BTreeMap<String, u32>);

impl CameraNames {
    /// `wanted`, or `wanted (2)`, `wanted (3)`... where it is taken.
    fn unique(&mut self, wanted: String) -> String {
        let mut name = wanted.clone();
        while self.0.contains_key(&name) {
            let uses = self.0.entry(wanted.clone()).or_insert(1);
            *uses += 1;
            name = format!("{wanted} ({uses})");
        }
        self.0.insert(name.clone(), 1);
        name
    }
}

/// The camera of a node, where it has a usable one.
///
/// # Errors
/// A missing camera or an unknown camera type.
pub(super) fn read(
    context: &Context,
    index: usize,
    node: &json::Node,
    world: &DMat4,
    names: &mut CameraNames,
) -> Result<Option<Camera>> {
    let Some(number) = node.camera.map(|camera| camera.value()) else {
        return Ok(None);
    };
    let cameras = &context.document.cameras;
    let Some(camera) = cameras.get(number) else {
        let pointer = format!("/nodes/{index}/camera");
        return Err(context.absent(pointer, "camera", number, cameras.len()));
    };
    let pointer = format!("/cameras/{number}");
    let Some(projection) = projection(context, camera, &pointer)? else {
        return Ok(None);
    };
    let axis = |axis: DVec3| world.transform_vector3(axis).try_normalize();
    let (Some(forward), Some(up)) = (axis(DVec3::NEG_Z), axis(DVec3::Y)) else {
        let message = "a camera on a node of zero scale is left out";
        context.warn("camera-invalid", format!("/nodes/{index}"), message);
        return Ok(None);
    };
    let name = camera.name.clone().or_else(|| node.name.clone());
    Ok(Some(Camera {
        name: names.unique(name.unwrap_or_else(|| format!("camera {number}"))),
        projection,
        position: world.w_axis.truncate(),
        forward,
        up,
    }))
}

fn projection(
    context: &Context,
    camera: &json::Camera,
    pointer: &str,
) -> Result<Option<Projection>> {
    let projection = match (&camera.type_, &camera.perspective, &camera.orthographic) {
        (Checked::Valid(Type::Perspective), Some(perspective), _) => perspective_of(perspective),
        (Checked::Valid(Type::Orthographic), _, Some(orthographic)) => {
            orthographic_of(orthographic)
        }
        (Checked::Valid(_), _, _) => {
            let message = "the camera lacks the projection that its type names; export again";
            return Err(context.error("camera-type", pointer, message));
        }
        (Checked::Invalid, _, _) => {
            let message = "the camera's type is neither perspective nor orthographic; export again";
            return Err(context.error("camera-type", pointer, message));
        }
    };
    if projection.is_none() {
        let message =
            "a camera with an impossible projection (angle, extent or distances) is left out";
        context.warn("camera-invalid", pointer, message);
    }
    Ok(projection)
}

fn perspective_of(camera: &json::camera::Perspective) -> Option<Projection> {
    let angle = camera.yfov > 0.0 && camera.yfov < std::f32::consts::PI;
    let near = camera.znear > 0.0 && camera.znear.is_finite();
    let far = camera
        .zfar
        .is_none_or(|zfar| zfar > camera.znear && zfar.is_finite());
    (angle && near && far).then_some(Projection::Perspective {
        yfov: camera.yfov,
        znear: camera.znear,
        zfar: camera.zfar,
    })
}

/// A negative extent mirrors the image, which the specification discourages; its size is kept.
fn orthographic_of(camera: &json::camera::Orthographic) -> Option<Projection> {
    let extent = |value: f32| value != 0.0 && value.is_finite();
    let depth = camera.znear >= 0.0 && camera.zfar > camera.znear && camera.zfar.is_finite();
    (extent(camera.xmag) && extent(camera.ymag) && depth).then_some(Projection::Orthographic {
        xmag: camera.xmag.abs(),
        ymag: camera.ymag.abs(),
        znear: camera.znear,
        zfar: camera.zfar,
    })
}
