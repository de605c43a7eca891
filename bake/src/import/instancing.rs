//! Reads the instance transforms of `EXT_mesh_gpu_instancing`.

use std::collections::BTreeMap;

use glam::{DMat4, DVec3};
use gltf::json;
use serde::Deserialize;

use crate::diagnostic::Result;

use super::accessor::SIGNED_NORMALIZED;
use super::context::Context;
use super::{accessor, extension, node};

const NAME: &str = "EXT_mesh_gpu_instancing";

#[derive(Debug, Deserialize)]
struct Extension {
    #[serde(default)]
    attributes: BTreeMap<String, usize>,
}

/// The transforms of a node's instances relative to the node, where it has the extension. The
/// total of instances stays within `limit`.
///
/// # Errors
/// A malformed extension, attributes that disagree in number or have the wrong type, too many
/// instances.
pub(super) fn read(
    context: &Context,
    index: usize,
    node: &json::Node,
    limit: usize,
) -> Result<Option<Vec<DMat4>>> {
    let extensions = node.extensions.as_ref();
    let Some(value) = extensions.and_then(|extensions| extensions.others.get(NAME)) else {
        return Ok(None);
    };
    let pointer = format!("/nodes/{index}/extensions/{NAME}");
    let extension: Extension = extension::parse(context, value, &pointer)?;
    let count = count(context, &extension, &pointer)?;
    let Some(count) = count else {
        let message = "the instances have no attributes; the mesh is placed once";
        context.warn("instancing-empty", pointer, message);
        return Ok(None);
    };
    if count > limit as u64 {
        let message = format!("{count} more instances pass the limit of a scene; split the scene");
        return Err(context.error("scene-too-large", pointer, message));
    }
    let referrer = |name: &str| format!("{pointer}/attributes/{name}");
    let attribute = |name: &str| extension.attributes.get(name).copied();
    let vectors = |name: &str| {
        let read = |index| accessor::floats::<3>(context, index, &referrer(name), &[]);
        attribute(name).map(read).transpose()
    };
    let translations = vectors("TRANSLATION")?;
    let scales = vectors("SCALE")?;
    let rotations = attribute("ROTATION")
        .map(|index| {
            accessor::floats::<4>(context, index, &referrer("ROTATION"), SIGNED_NORMALIZED)
        })
        .transpose()?;
    let vector = |values: &Option<Vec<[f32; 3]>>, instance: usize, default| {
        let values = values.as_ref();
        values.map_or(default, |v| DVec3::from_array(v[instance].map(f64::from)))
    };
    let transform = |instance: usize| {
        let rotation = rotations
            .as_ref()
            .map_or([0.0, 0.0, 0.0, 1.0], |r| r[instance]);
        DMat4::from_scale_rotation_translation(
            vector(&scales, instance, DVec3::ONE),
            node::unit_quaternion(context, rotation, || referrer("ROTATION")),
            vector(&translations, instance, DVec3::ZERO),
        )
    };
    Ok(Some((0..count as usize).map(transform).collect()))
}

/// The number of instances, on which all attributes agree; `None` without attributes.
fn count(context: &Context, extension: &Extension, pointer: &str) -> Result<Option<u64>> {
    let mut count = None;
    for (name, &index) in &extension.attributes {
        let referrer = format!("{pointer}/attributes/{name}");
        let found = accessor::count(context, index, &referrer)?;
        match count {
            Some(count) if count != found => {
                let message = format!("{found} elements for {count} instances; export again");
                return Err(context.error("attribute-count", referrer, message));
            }
            _ => count = Some(found),
        }
    }
    Ok(count)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::import::testing::{context, data_uri, fault};
    use glam::DVec4;

    /// A node of two instances with the given attributes: accessor 0 holds vectors, 1 holds
    /// normalised rotations, 2 holds a single vector.
    fn instances(attributes: &str, limit: usize) -> (Context, Result<Option<Vec<DMat4>>>) {
        let mut bytes: Vec<u8> = [1.0f32, 2.0, 3.0, -4.0, 5.0, 6.0]
            .iter()
            .flat_map(|v| v.to_le_bytes())
            .collect();
        let rotations: [i16; 8] = [0, 32767, 0, 0, 0, 0, 0, 0];
        bytes.extend(rotations.iter().flat_map(|v| v.to_le_bytes()));
        let context = context(&format!(
            r#""buffers":[{{"byteLength":40,"uri":"{}"}}],
            "bufferViews":[{{"buffer":0,"byteLength":24}},{{"buffer":0,"byteOffset":24,"byteLength":16}}],
            "accessors":[{{"bufferView":0,"componentType":5126,"type":"VEC3","count":2}},
                {{"bufferView":1,"componentType":5122,"type":"VEC4","count":2,"normalized":true}},
                {{"bufferView":0,"componentType":5126,"type":"VEC3","count":1}}],
            "nodes":[{{"extensions":{{"EXT_mesh_gpu_instancing":{{"attributes":{attributes}}}}}}}]"#,
            data_uri(&bytes)
        ));
        let read = read(&context, 0, &context.document.nodes[0], limit);
        (context, read)
    }

    #[test]
    fn transforms_are_composed() {
        let all = r#"{"TRANSLATION":0,"ROTATION":1,"SCALE":0,"_ID":0}"#;
        let (context, read) = instances(all, 2);
        let transforms = read.unwrap().unwrap();
        assert_eq!(transforms.len(), 2);
        assert_eq!(transforms[0].w_axis, DVec4::new(1.0, 2.0, 3.0, 1.0));
        assert_eq!(transforms[0].x_axis.x, -1.0);
        assert_eq!(transforms[1].y_axis.y, 5.0);
        assert_eq!(context.finish().1[0].code, "quaternion-zero");
        let (_, read) = instances(r#"{"TRANSLATION":0}"#, 2);
        let moved = DMat4::from_translation(DVec3::new(-4.0, 5.0, 6.0));
        assert_eq!(read.unwrap().unwrap()[1], moved);
    }

    #[test]
    fn faults_are_refused() {
        let code = |attributes: &str, limit| {
            let (_, read) = instances(attributes, limit);
            fault(read).code
        };
        assert_eq!(code(r#"{"TRANSLATION":0}"#, 1), "scene-too-large");
        assert_eq!(code(r#"{"TRANSLATION":0,"SCALE":2}"#, 9), "attribute-count");
        assert_eq!(code(r#"{"TRANSLATION":1}"#, 9), "accessor-type");
        assert_eq!(code(r#"{"TRANSLATION":3}"#, 9), "index-out-of-range");
        assert_eq!(code(r#"{"TRANSLATION":-1}"#, 9), "extension-schema");
    }

    #[test]
    fn instances_without_attributes_are_one() {
        let (context, read) = instances("{}", 9);
        assert!(read.unwrap().is_none());
        assert_eq!(context.finish().1[0].code, "instancing-empty");
    }
}
