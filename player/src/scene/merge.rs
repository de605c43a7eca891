//! Which meshes share one bottom level in world space, and the tables that name what a ray hit there.
//!
//! Boxes of separate objects overlap, and a ray enters the structure of each. In one structure over all triangles it
//! enters none twice: merging costs memory where a mesh is placed several times, and nothing where it is placed once.

use cairn_format::Package;
use cairn_format::gpu::{GeometryInfo, MeshInstance};

/// Triangles of meshes placed several times that are copied into the merged structure, in all.
const COPIED_TRIANGLES: u64 = 1 << 20;

/// Tables in the order in which hits are numbered: merged geometries, then those of meshes with instances.
pub(super) struct Plan {
    /// Whether a mesh is merged.
    pub(super) merged: Vec<bool>,
    /// Records of the geometry table.
    pub(super) infos: Vec<GeometryInfo>,
    /// One for each merged geometry, then the other instances.
    pub(super) instances: Vec<MeshInstance>,
    /// Merged geometries.
    pub(super) merged_count: u32,
}

/// A mesh's primitives in the root, its triangles, and how often it is placed.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
struct Use {
    first: usize,
    count: usize,
    triangles: u64,
    placed: u64,
}

impl Plan {
    /// Plans structures of `instances`, which are those of the package; `infos` has a record for each primitive of the
    /// root. Without `merge` every mesh has a structure of its own.
    pub(super) fn new(
        package: &Package,
        infos: &[GeometryInfo],
        instances: &[MeshInstance],
        merge: bool,
    ) -> Self {
        let uses = uses(package, instances);
        let merged = if merge {
            choose(&uses, COPIED_TRIANGLES)
        } else {
            vec![false; uses.len()]
        };
        let mut plan = Self {
            merged,
            infos: Vec::new(),
            instances: Vec::new(),
            merged_count: 0,
        };
        for instance in instances {
            let mesh = instance.mesh as usize;
            if plan.merged[mesh] {
                let Use { first, count, .. } = uses[mesh];
                plan.infos.extend_from_slice(&infos[first..first + count]);
                plan.instances.extend(std::iter::repeat_n(*instance, count));
            }
        }
        plan.merged_count = plan.infos.len() as u32;
        plan.infos.extend_from_slice(infos);
        let others = instances
            .iter()
            .filter(|instance| !plan.merged[instance.mesh as usize]);
        plan.instances.extend(others);
        plan
    }
}

fn uses(package: &Package, instances: &[MeshInstance]) -> Vec<Use> {
    let scene = package.scene();
    let mut uses: Vec<Use> = scene
        .meshes
        .iter()
        .map(|mesh| {
            let first = mesh.first_primitive.to_native() as usize;
            let count = mesh.primitive_count.to_native() as usize;
            let triangles = scene.primitives[first..first + count]
                .iter()
                .map(|primitive| u64::from(primitive.traced_index_count.to_native() / 3));
            Use {
                first,
                count,
                triangles: triangles.sum(),
                placed: 0,
            }
        })
        .collect();
    for instance in instances {
        uses[instance.mesh as usize].placed += 1;
    }
    uses
}

/// Meshes placed once; then those that copy the fewest triangles, as long as all fit into `room`.
fn choose(uses: &[Use], room: u64) -> Vec<bool> {
    let copied = |one: &Use| one.triangles * one.placed.saturating_sub(1);
    let mut order: Vec<usize> = (0..uses.len())
        .filter(|mesh| uses[*mesh].placed > 0)
        .collect();
    order.sort_by_key(|mesh| (copied(&uses[*mesh]), *mesh));
    let mut merged = vec![false; uses.len()];
    let mut sum = 0;
    for mesh in order {
        sum += copied(&uses[mesh]);
        if sum > room {
            break;
        }
        merged[mesh] = true;
    }
    // One structure alone gains nothing by a copy of its tables.
    if merged.iter().filter(|merged| **merged).count() == 1 && uses.iter().all(|one| one.placed < 2)
    {
        merged.fill(false);
    }
    merged
}

#[cfg(test)]
mod tests {
    use super::*;

    fn mesh(triangles: u64, placed: u64) -> Use {
        Use {
            triangles,
            placed,
            ..Use::default()
        }
    }

    #[test]
    fn what_is_placed_once_is_merged_and_copies_are_bounded() {
        let uses = [
            mesh(1_000_000, 1),
            mesh(10, 11),
            mesh(50, 3),
            mesh(1, 0),
            mesh(7, 1_000_000),
        ];
        assert_eq!(choose(&uses, 0), [true, false, false, false, false]);
        assert_eq!(choose(&uses, 100), [true, true, false, false, false]);
        assert_eq!(choose(&uses, 200), [true, true, true, false, false]);
        assert_eq!(choose(&uses, u64::MAX), [true, true, true, false, true]);
    }

    #[test]
    fn one_structure_stays_as_it_is() {
        assert_eq!(choose(&[mesh(12, 1), mesh(3, 0)], 100), [false, false]);
        assert_eq!(choose(&[mesh(12, 2)], 100), [true]);
        assert_eq!(choose(&[], 100), [false; 0]);
    }
}
