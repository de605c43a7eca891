//! Applies the default pose to a primitive: morph weights (glTF 2.0 section 3.7.2.2), then the skin.

use glam::{DMat3, DMat4, DVec3};
use gltf::json;
use gltf::json::accessor::ComponentType;
use gltf::json::mesh::Semantic;
use gltf::json::validation::Checked;

use crate::diagnostic::Result;
use crate::import::accessor::{
    self, ANY_SMALL, IntegerTypes, SIGNED_NORMALIZED, UNSIGNED_NORMALIZED,
};
use crate::scene::Primitive;

use super::{Reader, is_finite};

/// Component types of `JOINTS_n`.
const JOINTS: IntegerTypes = &[(ComponentType::U8, false), (ComponentType::U16, false)];

/// The default pose of a mesh.
#[derive(Debug, Default)]
pub(in crate::import) struct Pose {
    /// Weights of the morph targets; missing ones are zero.
    pub weights: Vec<f32>,
    /// For each joint of the skin the matrix from the mesh to the world.
    pub joints: Option<Vec<DMat4>>,
}

/// Whether every primitive of a mesh says which joints move it.
pub(in crate::import) fn is_skinnable(mesh: &json::Mesh) -> bool {
    let names = |primitive: &json::mesh::Primitive, semantic| {
        primitive.attributes.contains_key(&Checked::Valid(semantic))
    };
    let both =
        |primitive| names(primitive, Semantic::Joints(0)) && names(primitive, Semantic::Weights(0));
    mesh.primitives.iter().all(both)
}

impl Reader<'_> {
    /// Moves the vertices of a primitive as the pose demands.
    pub(super) fn pose(&self, primitive: &mut Primitive, pose: &Pose) -> Result<()> {
        if pose.weights.is_empty() && pose.joints.is_none() {
            return Ok(());
        }
        self.morph(primitive, &pose.weights)?;
        if let Some(joints) = &pose.joints {
            self.skin(primitive, joints)?;
        }
        match primitive.positions.iter().position(|p| !is_finite(p)) {
            None => Ok(()),
            Some(vertex) => {
                let message = format!("position {vertex} is not finite in the default pose");
                let code = "non-finite-position";
                Err(self.context.error(code, &self.pointer, message))
            }
        }
    }

    fn morph(&self, primitive: &mut Primitive, weights: &[f32]) -> Result<()> {
        let targets = self.primitive.targets.iter().flatten();
        let weighted: Vec<_> = targets
            .zip(weights)
            .enumerate()
            .filter(|(_, (_, weight))| **weight != 0.0)
            .collect();
        if weighted.is_empty() {
            return Ok(());
        }
        let mut positions = widened(&primitive.positions);
        let mut normals = primitive.normals.as_deref().map(widened);
        let tangents = primitive.tangents.as_ref();
        let mut tangents: Option<Vec<DVec3>> =
            tangents.map(|t| t.iter().map(|&[x, y, z, _]| vector([x, y, z])).collect());
        for (ordinal, (target, &weight)) in weighted {
            let weight = f64::from(weight);
            let add = |values: Option<&mut Vec<DVec3>>, index, name, types| {
                let (Some(values), Some(index)) = (values, index) else {
                    return Ok(());
                };
                self.displace(
                    values,
                    index,
                    &format!("targets/{ordinal}/{name}"),
                    weight,
                    types,
                )
            };
            add(
                Some(&mut positions),
                target.positions.as_ref(),
                "POSITION",
                ANY_SMALL,
            )?;
            add(
                normals.as_mut(),
                target.normals.as_ref(),
                "NORMAL",
                SIGNED_NORMALIZED,
            )?;
            add(
                tangents.as_mut(),
                target.tangents.as_ref(),
                "TANGENT",
                SIGNED_NORMALIZED,
            )?;
        }
        primitive.positions = positions.iter().map(narrow).collect();
        primitive.normals = normals.map(|n| n.iter().map(|n| narrow(&unit(*n))).collect());
        if let (Some(old), Some(new)) = (&mut primitive.tangents, tangents) {
            for (old, new) in old.iter_mut().zip(new) {
                let [x, y, z] = narrow(&unit(new));
                *old = [x, y, z, old[3]];
            }
        }
        Ok(())
    }

    /// Adds the weighted displacements of one attribute of one target.
    fn displace(
        &self,
        values: &mut [DVec3],
        index: &json::Index<json::Accessor>,
        name: &str,
        weight: f64,
        types: IntegerTypes,
    ) -> Result<()> {
        let referrer = format!("{}/{name}", self.pointer);
        let index = index.value();
        self.check_count(index, values.len(), &referrer)?;
        let types = self.quantized(types, &[]);
        let displacements = accessor::floats::<3>(self.context, index, &referrer, types)?;
        for (value, displacement) in values.iter_mut().zip(displacements) {
            *value += weight * vector(displacement);
        }
        Ok(())
    }

    fn skin(&self, primitive: &mut Primitive, joints: &[DMat4]) -> Result<()> {
        let blended = self.blended(primitive.positions.len(), joints)?;
        for (vertex, matrix) in blended.iter().enumerate() {
            let position = &mut primitive.positions[vertex];
            *position = narrow(&matrix.transform_point3(vector(*position)));
            let linear = DMat3::from_mat4(*matrix);
            if let Some(normals) = &mut primitive.normals {
                // Cofactors: the inverse transpose without the division, so singular ones survive.
                let cofactor = DMat3::from_cols(
                    linear.y_axis.cross(linear.z_axis),
                    linear.z_axis.cross(linear.x_axis),
                    linear.x_axis.cross(linear.y_axis),
                );
                let sign = linear.determinant().signum();
                normals[vertex] = narrow(&unit(cofactor * vector(normals[vertex]) * sign));
            }
            if let Some(tangents) = &mut primitive.tangents {
                let [x, y, z, w] = tangents[vertex];
                let [x, y, z] = narrow(&unit(linear * vector([x, y, z])));
                let mirrored = linear.determinant() < 0.0;
                tangents[vertex] = [x, y, z, if mirrored { -w } else { w }];
            }
        }
        Ok(())
    }

    /// The weighted matrix of each vertex; the identity where all weights are zero.
    fn blended(&self, vertices: usize, joints: &[DMat4]) -> Result<Vec<DMat4>> {
        let mut sums = vec![(DMat4::ZERO, 0.0f64); vertices];
        for set in 0.. {
            let indices = self.optional::<4>(&Semantic::Joints(set), vertices, JOINTS)?;
            let weights =
                self.optional::<4>(&Semantic::Weights(set), vertices, UNSIGNED_NORMALIZED)?;
            let (Some(indices), Some(weights)) = (indices, weights) else {
                break;
            };
            for ((matrix, total), (indices, weights)) in
                sums.iter_mut().zip(indices.iter().zip(weights))
            {
                for (joint, weight) in indices.iter().zip(weights) {
                    if weight == 0.0 {
                        continue;
                    }
                    let Some(joint) = joints.get(*joint as usize) else {
                        let message = format!(
                            "a vertex names joint {joint}, the skin has {}; export again",
                            joints.len()
                        );
                        let code = "skin-joint";
                        return Err(self.context.error(code, &self.pointer, message));
                    };
                    *matrix += *joint * f64::from(weight);
                    *total += f64::from(weight);
                }
            }
        }
        let blend = |(matrix, total): (DMat4, f64)| match total {
            0.0 => DMat4::IDENTITY,
            _ => matrix * total.recip(),
        };
        Ok(sums.into_iter().map(blend).collect())
    }
}

fn vector(values: [f32; 3]) -> DVec3 {
    DVec3::from_array(values.map(f64::from))
}

fn widened(values: &[[f32; 3]]) -> Vec<DVec3> {
    values.iter().copied().map(vector).collect()
}

fn narrow(value: &DVec3) -> [f32; 3] {
    value.to_array().map(|value| value as f32)
}

/// The direction of a vector; zero and non-finite ones become zero, which later steps repair.
fn unit(value: DVec3) -> DVec3 {
    value.normalize_or_zero()
}
