//! Reads punctual lights (`KHR_lights_punctual`) and places them in the world.

use std::f32::consts::{FRAC_PI_2, FRAC_PI_4};

use glam::{DMat4, DVec3, Vec3};
use gltf::json;
use gltf::json::extensions::scene::khr_lights_punctual::{Light as LightJson, Type};
use gltf::json::validation::Checked;

use crate::diagnostic::Result;
use crate::scene::{Light, LightKind};

use super::context::Context;

/// The light of a node, where it has one.
///
/// # Errors
/// A missing light or an unknown light type.
pub(super) fn read(
    context: &Context,
    index: usize,
    node: &json::Node,
    world: &DMat4,
) -> Result<Option<Light>> {
    let extension = node.extensions.as_ref();
    let Some(reference) = extension.and_then(|e| e.khr_lights_punctual.as_ref()) else {
        return Ok(None);
    };
    let number = reference.light.value();
    let lights = context.document.lights();
    let Some(light) = lights.get(number) else {
        let pointer = format!("/nodes/{index}/extensions/KHR_lights_punctual/light");
        return Err(context.absent(pointer, "light", number, lights.len()));
    };
    let pointer = format!("/extensions/KHR_lights_punctual/lights/{number}");
    let forward = world.transform_vector3(DVec3::NEG_Z).try_normalize();
    let direction = forward.unwrap_or_else(|| {
        let message = "the node's scale is zero along the light's direction; -Z is used";
        context.warn("light-direction", format!("/nodes/{index}"), message);
        DVec3::NEG_Z
    });
    let name = light.name.clone().or_else(|| node.name.clone());
    Ok(Some(Light {
        name: name.unwrap_or_else(|| format!("light {number}")),
        kind: kind(context, light, &pointer)?,
        color: Vec3::from_array(
            light
                .color
                .map(|value| at_least_zero(context, value, &pointer)),
        ),
        intensity: at_least_zero(context, light.intensity, &pointer),
        position: world.w_axis.truncate(),
        direction,
    }))
}

fn kind(context: &Context, light: &LightJson, pointer: &str) -> Result<LightKind> {
    let range = match light.range {
        None => f32::INFINITY,
        Some(range) if range > 0.0 => range,
        Some(range) => {
            let message = format!("range {range} is not positive; the light is taken as unbounded");
            context.warn("light-range", pointer, message);
            f32::INFINITY
        }
    };
    match light.type_ {
        Checked::Valid(Type::Directional) => Ok(LightKind::Directional),
        Checked::Valid(Type::Point) => Ok(LightKind::Point { range }),
        Checked::Valid(Type::Spot) => {
            let (inner, outer) = cone(context, light, pointer);
            Ok(LightKind::Spot {
                range,
                inner,
                outer,
            })
        }
        Checked::Invalid => {
            let message = "the light's type is none of directional, point, spot; export again";
            Err(context.error("light-type", pointer, message))
        }
    }
}

/// Cone half-angles with 0 <= inner < outer <= pi/2.
fn cone(context: &Context, light: &LightJson, pointer: &str) -> (f32, f32) {
    let (inner, outer) = match &light.spot {
        Some(spot) => (spot.inner_cone_angle, spot.outer_cone_angle),
        None => {
            let message = "the spot light has no `spot` property; the default cone is used";
            context.warn("light-cone", pointer, message);
            (0.0, FRAC_PI_4)
        }
    };
    let valid_outer = if outer > 0.0 {
        outer.min(FRAC_PI_2)
    } else {
        FRAC_PI_4
    };
    let valid_inner = inner.clamp(0.0, valid_outer.next_down());
    if (valid_inner, valid_outer) != (inner, outer) {
        let message = format!(
            "cone angles {inner} and {outer} break 0 <= inner < outer <= pi/2; \
             {valid_inner} and {valid_outer} are used"
        );
        context.warn("light-cone", pointer, message);
    }
    (valid_inner, valid_outer)
}

fn at_least_zero(context: &Context, value: f32, pointer: &str) -> f32 {
    let clamped = value.clamp(0.0, f32::MAX);
    if clamped != value {
        let message = format!("the light's colour or intensity {value} is taken as {clamped}");
        context.warn("light-value", pointer, message);
    }
    clamped
}
