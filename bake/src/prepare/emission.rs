//! The triangles that emit light, in world space.

use cairn_format::Vertex;
use cairn_format::gpu::{EmissiveTriangle, MeshInstance, NO_EMISSION};
use glam::{DMat4, DVec3, Mat4};
use rayon::prelude::*;

use crate::diagnostic::Diagnostic;
use crate::scene::{Scene, TextureRef};

use super::geometry::Stored;
use super::instances::Placed;
use super::materials::{self, MaterialUse};
use super::matrix::cross;

/// Longest list: 400 MB. A longer one is left out, and said so.
const MAX_TRIANGLES: u64 = 1 << 22;

/// A primitive of a node that emits.
struct Emitter<'a> {
    model: DMat4,
    vertices: &'a [Vertex],
    indices: &'a [u32],
    material: u32,
    emission: [f32; 3],
    texture: Option<TextureRef>,
}

/// What a scene lists of its emitters.
pub(super) struct Listed {
    /// In the order of mesh instances, their primitives and the triangles traced; one that the transform leaves
    /// without area is listed too, so that a triangle's number follows from its place. Powers are zero yet. Both
    /// sides of a triangle are one.
    pub(super) triangles: Vec<EmissiveTriangle>,
    /// Number of each mesh instance's first triangle, or [`NO_EMISSION`].
    pub(super) firsts: Vec<u32>,
}

/// The triangles of opaque materials that emit. Where alpha decides, paths find the light by chance: a sampled point
/// may be a hole. A list that would be too long is empty, with a warning.
pub(super) fn list(
    scene: &Scene,
    geometry: &Stored,
    placed: &Placed,
) -> (Listed, Option<Diagnostic>) {
    let nodes: Vec<Vec<Emitter>> = placed
        .mesh_instances
        .iter()
        .map(|node| emitters(scene, geometry, node))
        .collect();
    let size = |emitters: &[Emitter]| -> u64 {
        let sizes = emitters.iter().map(|emitter| emitter.indices.len() as u64);
        sizes.sum::<u64>() / 3
    };
    let sizes: Vec<u64> = nodes.iter().map(|emitters| size(emitters)).collect();
    let count = sizes.iter().copied().fold(0u64, u64::saturating_add);
    if count > MAX_TRIANGLES {
        let listed = Listed {
            triangles: Vec::new(),
            firsts: vec![NO_EMISSION; nodes.len()],
        };
        return (listed, Some(too_many(scene, count)));
    }
    let mut next = 0;
    let firsts = sizes.iter().map(|size| {
        let first = next;
        next += *size as u32;
        if *size > 0 { first } else { NO_EMISSION }
    });
    let firsts = firsts.collect();
    let lists: Vec<Vec<EmissiveTriangle>> =
        nodes.par_iter().flatten().map(Emitter::triangles).collect();
    let triangles = lists.concat();
    (Listed { triangles, firsts }, None)
}

fn too_many(scene: &Scene, count: u64) -> Diagnostic {
    let message = format!(
        "{count} triangles emit light, and {MAX_TRIANGLES} can be sampled: none is listed, and paths find them \
         by chance alone; simplify the emissive meshes"
    );
    Diagnostic::warning("emissive-triangles", &scene.origin(""), message)
}

fn emitters<'a>(scene: &Scene, geometry: &'a Stored, node: &MeshInstance) -> Vec<Emitter<'a>> {
    let mut emitters = Vec::new();
    let mesh = &geometry.meshes[node.mesh as usize];
    let first = mesh.first_primitive as usize;
    for primitive in &geometry.primitives[first..first + mesh.primitive_count as usize] {
        let source = geometry.materials[primitive.material as usize];
        let Some(material) = materials::get(scene, source) else {
            continue;
        };
        let uses = MaterialUse::of(Some(material));
        if !uses.emits || !primitive.opaque {
            continue;
        }
        let (vertex, index) = (
            primitive.first_vertex as usize,
            primitive.first_index as usize,
        );
        emitters.push(Emitter {
            model: model(&node.transform),
            vertices: &geometry.vertices[vertex..vertex + primitive.vertex_count as usize],
            indices: &geometry.indices[index..index + primitive.traced_index_count as usize],
            material: primitive.material,
            emission: material.emissive.to_array(),
            texture: uses.emissive,
        });
    }
    emitters
}

fn model(&[x, y, z]: &[[f32; 4]; 3]) -> DMat4 {
    Mat4::from_cols_array_2d(&[x, y, z, [0.0, 0.0, 0.0, 1.0]])
        .transpose()
        .as_dmat4()
}

impl Emitter<'_> {
    fn triangles(&self) -> Vec<EmissiveTriangle> {
        let triangles = self.indices.chunks_exact(3);
        triangles
            .map(|triangle| self.triangle([triangle[0], triangle[1], triangle[2]]))
            .collect()
    }

    /// Corners run counter-clockwise seen from the front: a mirroring transform turns them round.
    fn triangle(&self, [first, second, third]: [u32; 3]) -> EmissiveTriangle {
        let corners = if self.model.determinant() < 0.0 {
            [first, third, second]
        } else {
            [first, second, third]
        };
        let vertices = corners.map(|index| &self.vertices[index as usize]);
        let [a, b, c] = vertices.map(|vertex| {
            let position = DVec3::from(vertex.position.map(f64::from));
            self.model.transform_point3(position)
        });
        let area = (cross(b - a, c - a).length() * 0.5) as f32;
        let [v0, v1, v2] = [a, b, c].map(|corner| corner.as_vec3().to_array());
        let [uv0, uv1, uv2] = vertices.map(|vertex| self.uv(vertex));
        EmissiveTriangle {
            v0,
            pad_12: 0,
            v1,
            pad_28: 0,
            v2,
            pad_44: 0,
            emission: self.emission,
            area: area.min(f32::MAX),
            material_index: self.material,
            power: 0.0,
            uv0,
            uv1,
            uv2,
        }
    }

    /// Coordinates of the emissive texture, transformed; zero without one.
    fn uv(&self, vertex: &Vertex) -> [f32; 2] {
        self.texture.map_or([0.0; 2], |texture| {
            let uv = match texture.uv_set {
                0 => vertex.uv0,
                _ => vertex.uv1,
            };
            texture.transform.apply(uv)
        })
    }
}

#[cfg(test)]
#[path = "emission_tests.rs"]
mod tests;
