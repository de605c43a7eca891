//! Primitives that are built, and kept in the cache, together: a mesh each, and all small meshes as one.

use std::sync::atomic::{AtomicU64, Ordering};

use cairn_format::gpu::VertexColor;
use cairn_format::{Aabb, Vertex};
use glam::Vec3;
use rayon::prelude::*;
use rkyv::util::AlignedVec;

use crate::cache::{Inputs, Kind, Product, Session};
use crate::diagnostic::Result;
use crate::label::{Interned, Label};
use crate::scene::{Primitive, Scene};

use super::GeometryStats;
use super::materials::{self, MaterialUse};
use super::order::Policy;
use super::primitive::{self, Built};
use super::steps::Steps;

/// A mesh of fewer triangles is built in less time than a file takes.
const SMALL: usize = 1024;

/// A primitive to build.
pub(super) struct Job {
    /// Index into the scene's meshes.
    pub(super) mesh: usize,
    pub(super) material: Option<u32>,
    pub(super) policy: Policy,
    pub(super) primitive: Primitive,
}

/// Jobs with their places in the list of all.
struct Group {
    name: String,
    jobs: Vec<(usize, Job)>,
}

/// Builds all primitives; those of one mesh must come one behind the other. Progress gets 0..=1.
pub(super) fn build_all(
    scene: &Scene,
    session: &Session,
    jobs: Vec<Job>,
    progress: &(dyn Fn(f32) + Sync),
) -> Result<Vec<Built>> {
    let corners = |job: &Job| job.primitive.indices.len() as u64;
    let total: u64 = jobs.iter().map(corners).sum();
    let done = AtomicU64::new(0);
    let count = |corners: u64| {
        let before = done.fetch_add(corners, Ordering::Relaxed);
        progress(((before + corners) as f64 / total as f64) as f32);
    };
    let built: Result<Vec<Vec<(usize, Built)>>> = groups(scene, jobs)
        .into_par_iter()
        .map(|group| {
            let share = group.jobs.iter().map(|(_, job)| corners(job)).sum();
            let places: Vec<usize> = group.jobs.iter().map(|(place, _)| *place).collect();
            let uses = uses(scene, &group);
            let inputs = inputs(session, &group, &uses);
            let mut made = false;
            let built = session.fetch(
                || inputs,
                || {
                    made = true;
                    Ok(make(group, &uses, &count))
                },
            )?;
            if !made {
                count(share);
            }
            Ok(places.into_iter().zip(built.0).collect())
        })
        .collect();
    let mut built: Vec<(usize, Built)> = built?.into_iter().flatten().collect();
    built.sort_by_key(|(place, _)| *place);
    Ok(built.into_iter().map(|(_, built)| built).collect())
}

fn groups(scene: &Scene, jobs: Vec<Job>) -> Vec<Group> {
    let mut groups = Vec::new();
    let mut small = Vec::new();
    let mut jobs = jobs.into_iter().enumerate().peekable();
    while let Some(first) = jobs.next() {
        let mesh = first.1.mesh;
        let mut same = vec![first];
        while let Some(next) = jobs.next_if(|(_, job)| job.mesh == mesh) {
            same.push(next);
        }
        let indices: usize = same
            .iter()
            .map(|(_, job)| job.primitive.indices.len())
            .sum();
        if indices / 3 < SMALL {
            small.extend(same);
        } else {
            let name = format!("mesh `{}`", scene.meshes[mesh].name);
            groups.push(Group { name, jobs: same });
        }
    }
    if !small.is_empty() {
        let name = format!("meshes below {SMALL} triangles");
        groups.push(Group { name, jobs: small });
    }
    groups
}

fn uses(scene: &Scene, group: &Group) -> Vec<MaterialUse> {
    let jobs = group.jobs.iter();
    jobs.map(|(_, job)| MaterialUse::of(materials::get(scene, job.material)))
        .collect()
}

/// Builds a group; `done` hears of each job's corners, which its primitive takes along.
fn make(group: Group, uses: &[MaterialUse], done: &(dyn Fn(u64) + Sync)) -> BuiltGroup {
    let jobs = group.jobs.into_par_iter().zip(uses);
    BuiltGroup(
        jobs.map(|((_, job), uses)| {
            let corners = job.primitive.indices.len() as u64;
            let built = primitive::build(job.primitive, uses, job.policy);
            done(corners);
            built
        })
        .collect(),
    )
}

/// What decides the bytes of a group: attributes, what materials read of them, and how triangles may be ordered.
fn inputs(session: &Session, group: &Group, uses: &[MaterialUse]) -> Inputs {
    let inputs = Inputs::new(Kind::Geometry, module_path!(), &group.name);
    if !session.keeps() {
        return inputs;
    }
    let mut hasher = blake3::Hasher::new();
    for (_, job) in &group.jobs {
        hash_attributes(&mut hasher, &job.primitive);
    }
    let policies: Vec<Policy> = group.jobs.iter().map(|(_, job)| job.policy).collect();
    inputs
        .hash("attributes or indices", hasher.finalize().as_bytes())
        .settings("material", &uses)
        .settings("order", &policies)
}

fn hash_attributes(hasher: &mut blake3::Hasher, primitive: &Primitive) {
    // Every field by name: a new one does not compile until it is hashed. What the material decides is in its use.
    let Primitive {
        positions,
        normals,
        tangents,
        uv0,
        uv1,
        colors,
        indices,
        material: _,
    } = primitive;
    let mut hash = |values: Option<&[u8]>| {
        let length = values.map_or(u64::MAX, |bytes| bytes.len() as u64);
        hasher.update(&length.to_le_bytes());
        if let Some(bytes) = values {
            if bytes.len() >= 1 << 20 {
                hasher.update_rayon(bytes);
            } else {
                hasher.update(bytes);
            }
        }
    };
    hash(Some(bytemuck::cast_slice(positions)));
    hash(normals.as_deref().map(bytemuck::cast_slice));
    hash(tangents.as_deref().map(bytemuck::cast_slice));
    hash(uv0.as_deref().map(bytemuck::cast_slice));
    hash(uv1.as_deref().map(bytemuck::cast_slice));
    hash(colors.as_deref().map(bytemuck::cast_slice));
    hash(Some(bytemuck::cast_slice(indices)));
}

/// The primitives of a group, in its order.
struct BuiltGroup(Vec<Built>);

/// A primitive as the cache keeps it.
#[derive(rkyv::Archive, rkyv::Serialize, rkyv::Deserialize)]
struct Kept {
    vertices: Vec<u8>,
    colors: Vec<u8>,
    indices: Vec<u8>,
    traced: u64,
    bounds: [[f32; 3]; 2],
    stats: GeometryStats,
    steps: Steps,
    warning: Option<Warning>,
}

#[derive(rkyv::Archive, rkyv::Serialize, rkyv::Deserialize)]
struct Warning(#[rkyv(with = Interned)] Label);

impl Product for BuiltGroup {
    fn to_bytes(&self) -> Option<AlignedVec> {
        let keep = |built: &Built| {
            // Every field by name: a new one does not compile until it is kept.
            let Built {
                vertices,
                colors,
                indices,
                traced,
                bounds,
                stats,
                steps,
                warning,
            } = built;
            Kept {
                vertices: bytemuck::cast_slice(vertices).to_vec(),
                colors: bytemuck::cast_slice(colors).to_vec(),
                indices: bytemuck::cast_slice(indices).to_vec(),
                traced: *traced as u64,
                bounds: [bounds.min.to_array(), bounds.max.to_array()],
                stats: *stats,
                steps: *steps,
                warning: warning.map(Warning),
            }
        };
        let kept: Vec<Kept> = self.0.iter().map(keep).collect();
        kept.to_bytes()
    }

    fn from_bytes(bytes: &[u8]) -> Option<Self> {
        let kept =
            rkyv::access::<rkyv::Archived<Vec<Kept>>, rkyv::rancor::BoxedError>(bytes).ok()?;
        kept.iter().map(built).collect::<Option<_>>().map(Self)
    }
}

fn built(kept: &ArchivedKept) -> Option<Built> {
    let [min, max] = kept
        .bounds
        .each_ref()
        .map(|corner| Vec3::from(corner.each_ref().map(|value| value.to_native())));
    let deserialize =
        |stats| rkyv::deserialize::<GeometryStats, rkyv::rancor::BoxedError>(stats).ok();
    let steps = |steps| rkyv::deserialize::<Steps, rkyv::rancor::BoxedError>(steps).ok();
    let warning = kept.warning.as_ref();
    Some(Built {
        vertices: records::<Vertex>(&kept.vertices)?,
        colors: records::<VertexColor>(&kept.colors)?,
        indices: records::<u32>(&kept.indices)?,
        traced: usize::try_from(kept.traced.to_native()).ok()?,
        bounds: Aabb { min, max },
        stats: deserialize(&kept.stats)?,
        steps: steps(&kept.steps)?,
        warning: warning.map(|warning| crate::label::intern(&warning.0)),
    })
}

/// Records out of bytes of any alignment; `None` where they are not whole.
fn records<T: bytemuck::Pod>(bytes: &[u8]) -> Option<Vec<T>> {
    bytes
        .len()
        .is_multiple_of(size_of::<T>())
        .then(|| bytemuck::pod_collect_to_vec(bytes))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::prepare::testing::{grid, node, one_mesh};
    use crate::prepare::{Prepared, prepare_cached};
    use crate::scene::Mesh;
    use glam::DMat4;

    fn scene() -> Scene {
        let mut scene = one_mesh(grid(30));
        scene.meshes[0].name = "large".into();
        for (name, size) in [("small", 2), ("tiny", 1)] {
            scene.meshes.push(Mesh {
                name: name.into(),
                primitives: vec![grid(size)],
            });
        }
        scene
            .instances
            .extend([node(2, DMat4::IDENTITY), node(1, DMat4::IDENTITY)]);
        scene
    }

    fn prepared(scene: &Scene, session: &Session) -> Prepared {
        let mut prepared = prepare_cached(&mut scene.clone(), session, &|_| ()).expect("valid");
        prepared.steps.clear();
        prepared
    }

    #[test]
    fn kept_meshes_are_what_was_built() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = |name: &str| folder.path().join(name);
        let session = || Session::open(&path("cache"), &path("scene"), &path("out"));
        let mut scene = scene();
        let text = |prepared: &Prepared| format!("{prepared:?}");
        let cold = text(&prepared(&scene, &Session::off()));
        for hits in [[false, false], [true, true]] {
            let session = session();
            assert!(text(&prepared(&scene, &session)) == cold);
            assert_eq!(session.hits(), hits);
        }
        // A change of a small mesh leaves the large one, and that of a name all.
        scene.meshes[2].primitives[0].positions[0][1] += 1.0;
        scene.meshes[0].name = "renamed".into();
        let changed = session();
        let warm = text(&prepared(&scene, &changed));
        assert!(warm != cold && warm == text(&prepared(&scene, &Session::off())));
        assert_eq!(changed.hits(), [true, false]);
    }

    #[test]
    fn absent_attributes_differ_from_empty_ones() {
        let hash = |primitive: &Primitive| {
            let mut hasher = blake3::Hasher::new();
            hash_attributes(&mut hasher, primitive);
            hasher.finalize()
        };
        let plain = grid(1);
        let mut moved = plain.clone();
        (moved.uv0, moved.uv1) = (plain.uv1.clone(), plain.uv0.clone());
        assert!(plain.uv0 != plain.uv1 && hash(&plain) != hash(&moved));
    }
}
