//! Places primitives in the world, grouped into draws.

use cairn_format::gpu::{self, DRAW_DOUBLE_SIDED, DRAW_MIRRORED, DrawGroup, Instance};
use cairn_format::{Aabb, scene};
use rayon::prelude::*;

use crate::diagnostic::{BakeError, Result};
use crate::scene::{AlphaMode, Scene};

use super::bounds::{Cloud, WorldBounds};
use super::geometry::{Stored, limited};
use super::matrix::Placement;
use super::morton::Grid;
use super::{GeometryStats, fault, materials};

/// Everything that nodes place.
#[derive(Clone, Debug, Default)]
pub(super) struct Placed {
    /// Ordered by group.
    pub(super) instances: Vec<Instance>,
    /// One per instance.
    pub(super) bounds: Vec<Aabb>,
    pub(super) groups: Vec<DrawGroup>,
    pub(super) mesh_instances: Vec<gpu::MeshInstance>,
    pub(super) mirrored: bool,
    pub(super) stats: GeometryStats,
}

/// A node that draws a stored mesh.
struct Node {
    /// Index into the scene's instances.
    source: usize,
    mesh: u32,
    placement: Placement,
}

/// What a draw group has in common.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
struct GroupKey {
    alpha_mode: u32,
    double_sided: bool,
    mirrored: bool,
    primitive: u32,
}

/// An instance on its way to its place.
struct Draw {
    key: GroupKey,
    /// Index into the nodes.
    node: usize,
    bounds: Aabb,
}

/// Instances, bounds and draw groups of all nodes.
///
/// Groups are sorted by alpha mode, double-sided and mirrored. Among equals the order is that of the Morton codes of
/// their bounds, and so is the order of the instances of a group: instances in a row are near each other, and the
/// bounds of [`cairn_format::bounds::CLUSTER`] of them are small.
pub(super) fn place(scene: &Scene, geometry: &Stored) -> Result<Placed> {
    let nodes = nodes(scene, geometry)?;
    let draws = draws(scene, geometry, &nodes)?;
    let mut placed = Placed {
        mesh_instances: nodes
            .iter()
            .map(|node| mesh_instance(node, geometry))
            .collect(),
        mirrored: nodes.iter().any(|node| node.placement.mirrored),
        ..Placed::default()
    };
    let mut found = Vec::with_capacity(draws.len());
    for ((key, node), world) in draws.iter().zip(bounds(scene, geometry, &nodes, &draws)) {
        let world = world?;
        placed.stats.bounds_slack_ulp = placed.stats.bounds_slack_ulp.max(world.slack_ulp);
        found.push(Draw {
            key: *key,
            node: *node,
            bounds: world.aabb,
        });
    }
    for draw in in_space(found) {
        let primitive = &geometry.primitives[draw.key.primitive as usize];
        placed.append(&draw.key, primitive);
        placed.bounds.push(draw.bounds);
        let placement = &nodes[draw.node].placement;
        placed.instances.push(Instance {
            model: placement.model,
            normal_matrix: placement.normal,
            material_index: primitive.material,
            pad_116: 0,
            pad_120: 0,
            pad_124: 0,
        });
        placed.stats.drawn_triangles += u64::from(primitive.index_count / 3);
    }
    Ok(placed)
}

/// Sorts draws whose groups are contiguous, so that neighbours are near each other within what draws must share.
fn in_space(draws: Vec<Draw>) -> impl Iterator<Item = Draw> {
    let union = |draws: &[Draw]| {
        let boxes = draws.iter().map(|draw| draw.bounds);
        boxes.fold(Aabb::EMPTY, Aabb::union)
    };
    let grid = Grid::new(union(&draws));
    let mut order = Vec::with_capacity(draws.len());
    for group in draws.chunk_by(|a, b| a.key == b.key) {
        let place = grid.code(union(group));
        for draw in group {
            let GroupKey {
                alpha_mode,
                double_sided,
                mirrored,
                primitive,
            } = draw.key;
            let group = (alpha_mode, double_sided, mirrored, place, primitive);
            order.push((group, grid.code(draw.bounds), order.len()));
        }
    }
    order.sort_unstable();
    let mut draws: Vec<Option<Draw>> = draws.into_iter().map(Some).collect();
    order
        .into_iter()
        .filter_map(move |(_, _, index)| draws[index].take())
}

fn nodes(scene: &Scene, geometry: &Stored) -> Result<Vec<Node>> {
    let mut nodes = Vec::new();
    for (source, instance) in scene.instances.iter().enumerate() {
        let Some(mesh) = geometry.mesh_numbers[instance.mesh as usize] else {
            continue;
        };
        let Some(placement) = Placement::new(&instance.world) else {
            return Err(overflow(scene, source));
        };
        nodes.push(Node {
            source,
            mesh,
            placement,
        });
    }
    Ok(nodes)
}

fn overflow(scene: &Scene, source: usize) -> BakeError {
    let name = &scene.instances[source].name;
    let message = format!(
        "node `{name}` reaches beyond the range of 32-bit floats; correct its transform or its mesh"
    );
    fault(scene, "world-overflow", message)
}

/// Key and index into `nodes` of every instance, sorted by group; nodes keep their order within a group.
fn draws(scene: &Scene, geometry: &Stored, nodes: &[Node]) -> Result<Vec<(GroupKey, usize)>> {
    let mesh = |node: &Node| &geometry.meshes[node.mesh as usize];
    let total = nodes
        .iter()
        .map(|node| u64::from(mesh(node).primitive_count))
        .sum();
    let mut draws = Vec::with_capacity(limited(scene, "instances", total, u32::MAX.into())?);
    for (index, node) in nodes.iter().enumerate() {
        let first = mesh(node).first_primitive;
        for primitive in first..first + mesh(node).primitive_count {
            let record = geometry.primitives[primitive as usize].material;
            let material = materials::get(scene, geometry.materials[record as usize]);
            let alpha_mode = match material.map_or(AlphaMode::Opaque, |found| found.alpha_mode) {
                AlphaMode::Opaque => gpu::ALPHA_OPAQUE,
                AlphaMode::Mask => gpu::ALPHA_MASK,
                AlphaMode::Blend => gpu::ALPHA_BLEND,
            };
            let key = GroupKey {
                alpha_mode,
                double_sided: material.is_some_and(|material| material.double_sided),
                mirrored: node.placement.mirrored,
                primitive,
            };
            draws.push((key, index));
        }
    }
    draws.sort_by_key(|(key, _)| *key);
    Ok(draws)
}

fn bounds(
    scene: &Scene,
    geometry: &Stored,
    nodes: &[Node],
    draws: &[(GroupKey, usize)],
) -> Vec<Result<WorldBounds>> {
    let clouds: Vec<Cloud> = geometry
        .primitives
        .par_iter()
        .map(|primitive| {
            let first = primitive.first_vertex as usize;
            Cloud::new(&geometry.vertices[first..first + primitive.vertex_count as usize])
        })
        .collect();
    draws
        .par_iter()
        .map(|(key, node)| {
            let node = &nodes[*node];
            let found = clouds[key.primitive as usize].world_bounds(&node.placement.model);
            found.ok_or_else(|| overflow(scene, node.source))
        })
        .collect()
}

fn mesh_instance(node: &Node, geometry: &Stored) -> gpu::MeshInstance {
    gpu::MeshInstance {
        transform: node.placement.rows(),
        mesh: node.mesh,
        first_geometry: geometry.meshes[node.mesh as usize].first_primitive,
        flags: if node.placement.mirrored {
            DRAW_MIRRORED
        } else {
            0
        },
        first_emissive: gpu::NO_EMISSION,
    }
}

impl Placed {
    /// Counts the next instance into its group, which may be new.
    fn append(&mut self, key: &GroupKey, primitive: &scene::Primitive) {
        let flag = |condition: bool, bit: u32| if condition { bit } else { 0 };
        let flags = flag(key.double_sided, DRAW_DOUBLE_SIDED) | flag(key.mirrored, DRAW_MIRRORED);
        match self.groups.last_mut() {
            Some(last) if last.primitive == key.primitive && last.flags == flags => {
                last.instance_count += 1;
            }
            _ => self.groups.push(DrawGroup {
                first_index: primitive.first_index,
                index_count: primitive.index_count,
                vertex_offset: primitive.first_vertex,
                first_instance: self.instances.len() as u32,
                instance_count: 1,
                primitive: key.primitive,
                alpha_mode: key.alpha_mode,
                flags,
            }),
        }
    }
}

#[cfg(test)]
#[path = "instances_tests.rs"]
mod tests;
