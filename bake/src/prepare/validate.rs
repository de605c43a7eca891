//! Checks what the rest of the preparation takes for granted.

use crate::diagnostic::Result;
use crate::scene::{Primitive, Scene};

use super::fault;

/// References in range, attributes of one length, every number finite.
pub(super) fn scene(scene: &Scene) -> Result<()> {
    for mesh in &scene.meshes {
        for (ordinal, found) in mesh.primitives.iter().enumerate() {
            if let Some(what) = primitive(found, scene.materials.len()) {
                let message = format!("primitive {ordinal} of mesh `{}`: {what}", mesh.name);
                return Err(fault(scene, "invalid-primitive", message));
            }
        }
    }
    for instance in &scene.instances {
        if instance.mesh as usize >= scene.meshes.len() {
            let message = format!(
                "node `{}` names mesh {} of {}",
                instance.name,
                instance.mesh,
                scene.meshes.len()
            );
            return Err(fault(scene, "invalid-node", message));
        }
        if !instance.world.is_finite() {
            let message = format!(
                "the world transform of node `{}` is not finite",
                instance.name
            );
            return Err(fault(scene, "non-finite-transform", message));
        }
    }
    Ok(())
}

/// What is wrong with a primitive.
fn primitive(primitive: &Primitive, materials: usize) -> Option<String> {
    let count = primitive.positions.len();
    attribute("POSITION", Some(&primitive.positions), count)
        .or_else(|| attribute("NORMAL", primitive.normals.as_ref(), count))
        .or_else(|| attribute("TANGENT", primitive.tangents.as_ref(), count))
        .or_else(|| attribute("TEXCOORD_0", primitive.uv0.as_ref(), count))
        .or_else(|| attribute("TEXCOORD_1", primitive.uv1.as_ref(), count))
        .or_else(|| attribute("COLOR_0", primitive.colors.as_ref(), count))
        .or_else(|| indices(&primitive.indices, count))
        .or_else(|| {
            let bad = primitive
                .material
                .filter(|index| *index as usize >= materials)?;
            Some(format!("material {bad} of {materials}"))
        })
}

fn attribute<const N: usize>(
    name: &str,
    values: Option<&Vec<[f32; N]>>,
    count: usize,
) -> Option<String> {
    let values = values?;
    if values.len() != count {
        return Some(format!(
            "{} elements of {name} for {count} positions",
            values.len()
        ));
    }
    let finite = |value: &[f32; N]| value.iter().all(|component| component.is_finite());
    let bad = values.iter().position(|value| !finite(value))?;
    Some(format!("{name} {bad} is not finite: {:?}", values[bad]))
}

fn indices(indices: &[u32], vertices: usize) -> Option<String> {
    if !indices.len().is_multiple_of(3) || u32::try_from(indices.len()).is_err() {
        return Some(format!("{} indices", indices.len()));
    }
    let bad = indices.iter().find(|index| **index as usize >= vertices)?;
    Some(format!("index {bad} for {vertices} vertices"))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::prepare::testing::{grid, one_mesh};

    #[test]
    fn broken_primitives_are_refused() {
        let breakers: [fn(&mut Primitive); 9] = [
            |p| p.colors = Some(vec![[1.0; 4]; 2]),
            |p| p.colors = Some(vec![[f32::NAN; 4]; p.positions.len()]),
            |p| p.positions[1][2] = f32::NAN,
            |p| p.uv0.as_mut().expect("grid has uv0")[0][0] = f32::INFINITY,
            |p| p.normals.as_mut().expect("grid has normals").truncate(1),
            |p| p.indices[0] = u32::MAX,
            |p| p.indices.truncate(4),
            |p| p.material = Some(7),
            |p| p.positions.clear(),
        ];
        assert!(scene(&one_mesh(grid(2))).is_ok());
        for breaker in breakers {
            let mut broken = grid(2);
            breaker(&mut broken);
            let error = scene(&one_mesh(broken)).expect_err("the primitive is broken");
            assert!(error.to_string().contains("invalid-primitive"), "{error}");
        }
    }

    #[test]
    fn broken_nodes_are_refused() {
        let mut broken = one_mesh(grid(1));
        broken.instances[0].mesh = 1;
        assert!(scene(&broken).is_err());
        broken.instances[0].mesh = 0;
        broken.instances[0].world.x_axis.y = f64::NAN;
        assert!(scene(&broken).is_err());
    }
}
