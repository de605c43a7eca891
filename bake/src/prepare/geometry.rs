//! Fills the vertex and index arenas with what is drawn.

use std::cmp::Reverse;

use cairn_format::gpu::VertexColor;
use cairn_format::scene::{self, Bounds};
use cairn_format::{Aabb, Vertex};

use crate::cache::Session;
use crate::diagnostic::{Diagnostic, Result};
use crate::scene::{AlphaMode, Scene};

use super::group::{self, Job};
use super::materials;
use super::order::Policy;
use super::primitive::Built;
use super::steps::Steps;
use super::{GeometryStats, colors, fault};

/// Vulkan's vertex offset is signed.
const MAX_VERTICES: u64 = i32::MAX as u64;
const MAX_INDICES: u64 = u32::MAX as u64;
/// Primitives, the largest, whose overdraw is measured: measuring takes longer than ordering.
const OVERDRAW_SAMPLES: usize = 16;

/// The stored geometry.
#[derive(Clone, Debug, Default)]
pub(super) struct Stored {
    pub(super) vertices: Vec<Vertex>,
    /// One per vertex; empty where no primitive has colours.
    pub(super) colors: Vec<VertexColor>,
    pub(super) indices: Vec<u32>,
    pub(super) meshes: Vec<scene::Mesh>,
    pub(super) primitives: Vec<scene::Primitive>,
    /// Index into `meshes` of each mesh of the scene; `None` where it is not stored.
    pub(super) mesh_numbers: Vec<Option<u32>>,
    /// Material record to index into the scene's materials.
    pub(super) materials: Vec<Option<u32>>,
    pub(super) stats: GeometryStats,
    pub(super) steps: Steps,
    pub(super) diagnostics: Vec<Diagnostic>,
}

/// Stores every mesh that a node draws, in the order of the scene, and takes the primitives out of it.
/// `progress` gets 0..=1.
pub(super) fn build(
    scene: &mut Scene,
    session: &Session,
    progress: &(dyn Fn(f32) + Sync),
) -> Result<Stored> {
    let jobs = take_drawn(scene);
    let sources: Vec<_> = jobs.iter().map(|job| (job.mesh, job.material)).collect();
    let built = group::build_all(scene, session, jobs, progress)?;
    let mut stored = Stored {
        mesh_numbers: vec![None; scene.meshes.len()],
        ..Stored::default()
    };
    reserve(scene, &mut stored, &built)?;
    let mut records = Records::new(scene.materials.len());
    for ((mesh, material), built) in sources.into_iter().zip(built) {
        let mesh_number = stored.mesh(mesh, &scene.meshes[mesh].name);
        if let Some(why) = built.warning {
            let name = &scene.meshes[mesh].name;
            let message = format!(
                "mesh `{name}`: {why}; its normal map is lit with arbitrary tangents, \
                 export it with TANGENT"
            );
            let warning = Diagnostic::warning("tangents-arbitrary", &scene.origin(""), message);
            stored.diagnostics.push(warning);
        }
        let opaque = alpha_mode(scene, material) == AlphaMode::Opaque;
        let material = records.number(material);
        stored.append(mesh_number, built, material, opaque);
    }
    stored.materials = records.used;
    Ok(stored)
}

fn alpha_mode(scene: &Scene, material: Option<u32>) -> AlphaMode {
    materials::get(scene, material).map_or(AlphaMode::Opaque, |material| material.alpha_mode)
}

/// The primitives that are drawn and have triangles; the scene's meshes lose all of theirs.
fn take_drawn(scene: &mut Scene) -> Vec<Job> {
    let mut used = vec![false; scene.meshes.len()];
    for instance in &scene.instances {
        used[instance.mesh as usize] = true;
    }
    let mut jobs = Vec::new();
    for (mesh, used) in used.into_iter().enumerate() {
        let primitives = std::mem::take(&mut scene.meshes[mesh].primitives);
        let drawn = primitives
            .into_iter()
            .filter(|primitive| used && !primitive.indices.is_empty());
        jobs.extend(drawn.map(|primitive| Job {
            mesh,
            material: primitive.material,
            policy: Policy {
                keep: alpha_mode(scene, primitive.material) == AlphaMode::Blend,
                measure_overdraw: false,
            },
            primitive,
        }));
    }
    let mut largest: Vec<usize> = (0..jobs.len()).collect();
    largest.sort_by_key(|job| Reverse(jobs[*job].primitive.indices.len()));
    for job in largest.into_iter().take(OVERDRAW_SAMPLES) {
        jobs[job].policy.measure_overdraw = true;
    }
    jobs
}

fn reserve(scene: &Scene, stored: &mut Stored, built: &[Built]) -> Result<()> {
    let sum = |length: fn(&Built) -> usize| built.iter().map(|built| length(built) as u64).sum();
    let vertices = limited(
        scene,
        "vertices",
        sum(|built| built.vertices.len()),
        MAX_VERTICES,
    )?;
    let indices = limited(
        scene,
        "indices",
        sum(|built| built.indices.len()),
        MAX_INDICES,
    )?;
    // A single primitive becomes the arena as it is.
    if built.len() > 1 {
        stored.vertices.reserve_exact(vertices);
        stored.indices.reserve_exact(indices);
    }
    Ok(())
}

/// `count`, where a package can hold as many.
pub(super) fn limited(scene: &Scene, what: &str, count: u64, limit: u64) -> Result<usize> {
    match usize::try_from(count) {
        Ok(fits) if count <= limit => Ok(fits),
        _ => {
            let message = format!("{count} {what}; a package holds {limit}, split the scene");
            Err(fault(scene, "too-large", message))
        }
    }
}

impl Stored {
    /// The number of mesh `index` of the scene; its primitives must come one behind the other.
    fn mesh(&mut self, index: usize, name: &str) -> usize {
        let next = self.meshes.len() as u32;
        let number = *self.mesh_numbers[index].get_or_insert(next);
        if number == next {
            self.meshes.push(scene::Mesh {
                name: name.to_owned(),
                first_primitive: self.primitives.len() as u32,
                primitive_count: 0,
            });
        }
        number as usize
    }

    fn append(&mut self, mesh: usize, built: Built, material: u32, opaque: bool) {
        self.stats.add(&built.stats);
        self.steps.add(&built.steps);
        self.meshes[mesh].primitive_count += 1;
        self.primitives.push(scene::Primitive {
            first_index: self.indices.len() as u32,
            index_count: built.indices.len() as u32,
            traced_index_count: built.traced as u32,
            first_vertex: self.vertices.len() as u32,
            vertex_count: built.vertices.len() as u32,
            material,
            opaque,
            bounds: bounds(&built.bounds),
        });
        let before = self.vertices.len();
        append(&mut self.vertices, built.vertices);
        append(&mut self.indices, built.indices);
        if !built.colors.is_empty() {
            self.colors.resize(before, colors::WHITE);
            append(&mut self.colors, built.colors);
        }
        if !self.colors.is_empty() {
            self.colors.resize(self.vertices.len(), colors::WHITE);
        }
    }
}

fn append<T: Copy>(arena: &mut Vec<T>, values: Vec<T>) {
    if arena.capacity() == 0 {
        *arena = values;
    } else {
        arena.extend_from_slice(&values);
    }
}

fn bounds(aabb: &Aabb) -> Bounds {
    Bounds {
        min: aabb.min.to_array(),
        max: aabb.max.to_array(),
    }
}

/// Numbers materials in order of first use.
struct Records {
    used: Vec<Option<u32>>,
    /// Record of the default material, then of each material.
    numbers: Vec<Option<u32>>,
}

impl Records {
    fn new(materials: usize) -> Self {
        Self {
            used: Vec::new(),
            numbers: vec![None; materials + 1],
        }
    }

    fn number(&mut self, material: Option<u32>) -> u32 {
        let place = material.map_or(0, |index| index as usize + 1);
        *self.numbers[place].get_or_insert_with(|| {
            self.used.push(material);
            self.used.len() as u32 - 1
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::prepare::testing::{grid, node, normal_mapped, one_mesh};
    use crate::scene::{Mesh, Primitive};
    use glam::DMat4;

    fn mesh(name: &str, primitives: Vec<Primitive>) -> Mesh {
        Mesh {
            name: name.into(),
            primitives,
        }
    }

    fn with_material(material: Option<u32>) -> Primitive {
        Primitive {
            material,
            ..grid(2)
        }
    }

    #[test]
    fn only_drawn_triangles_are_stored() {
        let mut scene = Scene {
            meshes: vec![
                mesh("unused", vec![with_material(Some(0))]),
                mesh("empty", vec![Primitive::default()]),
                mesh(
                    "two",
                    vec![
                        with_material(Some(3)),
                        with_material(None),
                        Primitive::default(),
                    ],
                ),
                mesh("one", vec![with_material(Some(1)), with_material(Some(3))]),
            ],
            materials: vec![normal_mapped(0); 4],
            ..Scene::default()
        };
        scene.instances = [3, 2, 1, 2]
            .map(|mesh| node(mesh, DMat4::IDENTITY))
            .to_vec();
        let stored = build(&mut scene, &Session::off(), &|_| ()).expect("the scene is valid");
        let names: Vec<&str> = stored
            .meshes
            .iter()
            .map(|mesh| mesh.name.as_str())
            .collect();
        assert_eq!(names, ["two", "one"]);
        assert_eq!(stored.mesh_numbers, [None, None, Some(0), Some(1)]);
        assert_eq!(stored.materials, [Some(3), None, Some(1)]);
        let materials: Vec<u32> = stored.primitives.iter().map(|p| p.material).collect();
        assert_eq!(materials, [0, 1, 2, 0]);
        assert_eq!(
            (
                stored.meshes[1].first_primitive,
                stored.meshes[1].primitive_count
            ),
            (2, 2)
        );
        let (mut index, mut vertex) = (0, 0);
        for primitive in &stored.primitives {
            assert_eq!(
                (primitive.first_index, primitive.first_vertex),
                (index, vertex)
            );
            index += primitive.index_count;
            vertex += primitive.vertex_count;
        }
        assert_eq!(
            (stored.indices.len(), stored.vertices.len()),
            (index as usize, vertex as usize)
        );
    }

    #[test]
    fn absent_coordinates_of_a_normal_map_are_reported() {
        let mut scene = one_mesh(with_material(Some(0)));
        scene.materials = vec![normal_mapped(1)];
        assert!(
            build(&mut scene.clone(), &Session::off(), &|_| ())
                .expect("valid")
                .diagnostics
                .is_empty()
        );
        scene.meshes[0].primitives[0].uv1 = None;
        let stored = build(&mut scene, &Session::off(), &|_| ()).expect("valid");
        assert_eq!(stored.stats.missing_normal_uvs, 1);
        assert_eq!(stored.diagnostics.len(), 1);
        assert_eq!(stored.diagnostics[0].code, "tangents-arbitrary");
    }

    #[test]
    fn limits_give_typed_errors() {
        let scene = Scene::default();
        assert_eq!(
            limited(&scene, "vertices", MAX_VERTICES, MAX_VERTICES).ok(),
            Some(i32::MAX as usize)
        );
        let error =
            limited(&scene, "vertices", MAX_VERTICES + 1, MAX_VERTICES).expect_err("too many");
        assert!(error.to_string().contains("2147483648 vertices"), "{error}");
    }
}
