//! Reads skins (glTF 2.0 section 3.7.3.3) as the joint matrices of the default pose.

use glam::DMat4;
use serde::Deserialize;

use crate::diagnostic::Result;

use super::context::Context;
use super::{accessor, extension};

#[derive(Debug, Deserialize)]
#[serde(rename_all = "camelCase")]
struct Skin {
    joints: Vec<usize>,
    inverse_bind_matrices: Option<usize>,
}

/// For each joint of skin `index` the matrix from the bind pose to the world. `worlds` has the
/// world transform of every node.
///
/// # Errors
/// A missing skin, joint or accessor, too few matrices, or a matrix that is not finite.
pub(super) fn joint_matrices(
    context: &Context,
    index: u32,
    worlds: &[DMat4],
) -> Result<Vec<DMat4>> {
    let skins = &context.document.skins;
    let Some(value) = skins.get(index as usize) else {
        return Err(context.absent("/nodes", "skin", index as usize, skins.len()));
    };
    let pointer = format!("/skins/{index}");
    let skin: Skin = extension::parse(context, value, &pointer)?;
    let inverse = inverse_bind_matrices(context, &skin, &pointer)?;
    let mut matrices = Vec::new();
    for (ordinal, &joint) in skin.joints.iter().enumerate() {
        let pointer = format!("{pointer}/joints/{ordinal}");
        let Some(world) = worlds.get(joint) else {
            return Err(context.absent(pointer, "node", joint, worlds.len()));
        };
        let inverse = inverse.as_ref().map_or(DMat4::IDENTITY, |m| m[ordinal]);
        let matrix = *world * inverse;
        if !matrix.is_finite() {
            let message = "the joint's transform is not finite; correct its node or bind matrix";
            return Err(context.error("non-finite-transform", pointer, message));
        }
        matrices.push(matrix);
    }
    Ok(matrices)
}

/// One matrix per joint, where the skin has any.
fn inverse_bind_matrices(
    context: &Context,
    skin: &Skin,
    pointer: &str,
) -> Result<Option<Vec<DMat4>>> {
    let Some(accessor) = skin.inverse_bind_matrices else {
        return Ok(None);
    };
    let pointer = format!("{pointer}/inverseBindMatrices");
    let count = accessor::count(context, accessor, &pointer)?;
    if count < skin.joints.len() as u64 {
        let message = format!(
            "{count} matrices for {} joints; export again",
            skin.joints.len()
        );
        return Err(context.error("skin-matrices", pointer, message));
    }
    let matrices = accessor::floats::<16>(context, accessor, &pointer, &[])?;
    let matrices = matrices
        .iter()
        .map(|m| DMat4::from_cols_array(&m.map(f64::from)));
    Ok(Some(matrices.collect()))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::import::testing::{context, data_uri, fault};
    use glam::DVec3;

    fn matrices(skin: &str, count: u32) -> Result<Vec<DMat4>> {
        let mut floats = [0.0f32; 32];
        for (index, value) in [(0, 2.0), (5, 2.0), (10, 2.0), (12, 1.0), (15, 1.0)] {
            floats[index] = value;
            floats[16 + index] = value;
        }
        floats[28] = f32::INFINITY;
        let bytes: Vec<u8> = floats.iter().flat_map(|v| v.to_le_bytes()).collect();
        let context = context(&format!(
            r#""buffers":[{{"byteLength":128,"uri":"{}"}}],
            "bufferViews":[{{"buffer":0,"byteLength":128}}],
            "accessors":[{{"bufferView":0,"componentType":5126,"type":"MAT4","count":{count}}}],
            "skins":[{skin}]"#,
            data_uri(&bytes)
        ));
        let world = DMat4::from_translation(DVec3::new(0.0, 5.0, 0.0));
        joint_matrices(&context, 0, &[DMat4::IDENTITY, world])
    }

    #[test]
    fn joints_move_from_their_bind_pose_to_the_world() {
        let plain = matrices(r#"{"joints":[1,0]}"#, 1).unwrap();
        assert_eq!(plain[0].w_axis.y, 5.0);
        assert_eq!(plain[1], DMat4::IDENTITY);
        let bound = matrices(r#"{"joints":[1],"inverseBindMatrices":0}"#, 1).unwrap();
        let moved = bound[0].transform_point3(DVec3::new(1.0, 0.0, 0.0));
        assert_eq!(moved, DVec3::new(3.0, 5.0, 0.0));
    }

    #[test]
    fn faults_are_refused() {
        let code = |skin: &str, count| fault(matrices(skin, count)).code;
        let two = r#"{"joints":[0,1],"inverseBindMatrices":0}"#;
        assert_eq!(code(two, 1), "skin-matrices");
        assert_eq!(code(two, 2), "non-finite-transform");
        assert_eq!(code(r#"{"joints":[2]}"#, 1), "index-out-of-range");
        assert_eq!(code(r#"{"joints":7}"#, 1), "extension-schema");
        let fault = fault(joint_matrices(&context(""), 3, &[]));
        assert_eq!(fault.code, "index-out-of-range");
    }
}
