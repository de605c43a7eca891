//! Turns an imported scene into the arrays of a package.

mod bounds;
mod geometry;
mod instances;
mod lights;
mod materials;
mod matrix;
mod normals;
mod primitive;
mod tangents;
#[cfg(test)]
mod testing;
mod validate;
mod weld;

use cairn_format::scene::{self, ReportRow};
use cairn_format::{Aabb, Vertex, features, gpu};

use crate::diagnostic::{BakeError, Diagnostic, Result};
use crate::scene::{Origin, Scene};

pub use materials::MaterialUse;

/// A scene as a package stores it; indices into each other's arrays are in range.
#[derive(Clone, Debug)]
pub struct Prepared {
    /// Vertex arena, object space, one run per primitive.
    pub vertices: Vec<Vertex>,
    /// Index arena, relative to the primitive's first vertex.
    pub indices: Vec<u32>,
    /// Meshes that some node draws and that have a triangle, in the order of the scene.
    pub meshes: Vec<scene::Mesh>,
    /// Primitives with triangles, contiguous per mesh.
    pub primitives: Vec<scene::Primitive>,
    /// One per drawn primitive of a node, ordered by draw group.
    pub instances: Vec<gpu::Instance>,
    /// World bounds, one per record of `instances`.
    pub instance_bounds: Vec<Aabb>,
    /// Sorted by alpha mode, double-sided, mirrored, primitive; they partition `instances`.
    pub draw_groups: Vec<gpu::DrawGroup>,
    /// One per node that carries a stored mesh, in the order of the scene.
    pub mesh_instances: Vec<gpu::MeshInstance>,
    /// The directional ones of `lights`.
    pub directional_lights: Vec<gpu::DirectionalLight>,
    /// Every light of the scene.
    pub lights: Vec<scene::Light>,
    /// Every camera of the scene.
    pub cameras: Vec<scene::Camera>,
    /// Union of `instance_bounds`; [`Aabb::EMPTY`] without instances.
    pub bounds: Aabb,
    /// Index into the scene's materials of each material record; `None` is glTF's default material.
    pub materials_used: Vec<Option<u32>>,
    /// Bits of [`cairn_format::features`] that geometry, materials and lights decide.
    pub features: u32,
    /// Counts.
    pub stats: GeometryStats,
    /// Accuracy of what was computed.
    pub report: Vec<ReportRow>,
    /// Warnings.
    pub diagnostics: Vec<Diagnostic>,
}

/// What happened to the geometry. Vertices and triangles count once per stored primitive.
#[derive(Clone, Copy, Debug, Default, PartialEq, serde::Serialize)]
pub struct GeometryStats {
    /// Stored triangles.
    pub triangles: u64,
    /// Triangles over all instances.
    pub drawn_triangles: u64,
    /// Vertices of the source primitives.
    pub vertices_in: u64,
    /// Vertices stored.
    pub vertices_out: u64,
    /// Triangles of zero area; they are kept.
    pub degenerate_triangles: u64,
    /// Primitives without normals.
    pub flat_primitives: u64,
    /// Corners whose tangent MikkTSpace gave.
    pub generated_tangents: u64,
    /// Authored tangents (per vertex) and generated ones (per corner) that were unusable, and were replaced.
    pub tangent_fallbacks: u64,
    /// Triangles whose corners have tangents of different handedness, which glTF leaves undefined.
    pub mixed_handedness: u64,
    /// Primitives with a normal map that lack the texture coordinates it needs.
    pub missing_normal_uvs: u64,
    /// Largest sine of the angle between a generated tangent and the plane of its normal.
    pub tangent_tilt: f64,
    /// Largest slack of an instance's bounds, in ulp of the largest coordinate of the axis.
    pub bounds_slack_ulp: f64,
}

impl GeometryStats {
    fn add(&mut self, other: &Self) {
        self.triangles += other.triangles;
        self.drawn_triangles += other.drawn_triangles;
        self.vertices_in += other.vertices_in;
        self.vertices_out += other.vertices_out;
        self.degenerate_triangles += other.degenerate_triangles;
        self.flat_primitives += other.flat_primitives;
        self.generated_tangents += other.generated_tangents;
        self.tangent_fallbacks += other.tangent_fallbacks;
        self.mixed_handedness += other.mixed_handedness;
        self.missing_normal_uvs += other.missing_normal_uvs;
        self.tangent_tilt = self.tangent_tilt.max(other.tangent_tilt);
        self.bounds_slack_ulp = self.bounds_slack_ulp.max(other.bounds_slack_ulp);
    }
}

/// Prepares `scene`. `progress` is called with the fraction done, from any thread, ending in 1.
///
/// The result does not depend on the number of threads.
///
/// # Errors
/// `BakeError::Input` where the scene breaks a promise of [`crate::scene`], an attribute is not finite,
/// an instance leaves the range of f32, or a count leaves that of the package.
pub fn prepare(scene: &Scene, progress: &(dyn Fn(f32) + Sync)) -> Result<Prepared> {
    validate::scene(scene)?;
    let geometry = geometry::build(scene, &|done| progress(done * 0.9))?;
    let placed = instances::place(scene, &geometry)?;
    let lights = lights::lights(scene)?;
    let directional_lights = lights::directional(scene);
    let cameras = lights::cameras(scene)?;

    let mut stats = geometry.stats;
    stats.add(&placed.stats);
    let mut features = materials::features(scene, &geometry.materials);
    if placed.mirrored {
        features |= features::MIRRORED;
    }
    if !directional_lights.is_empty() {
        features |= features::DIRECTIONAL_LIGHTS;
    }
    progress(1.0);
    Ok(Prepared {
        report: report(&stats, geometry.vertices.len(), placed.bounds.len()),
        vertices: geometry.vertices,
        indices: geometry.indices,
        meshes: geometry.meshes,
        primitives: geometry.primitives,
        bounds: placed.bounds.iter().copied().fold(Aabb::EMPTY, Aabb::union),
        instances: placed.instances,
        instance_bounds: placed.bounds,
        draw_groups: placed.groups,
        mesh_instances: placed.mesh_instances,
        directional_lights,
        lights,
        cameras,
        materials_used: geometry.materials,
        features,
        stats,
        diagnostics: geometry.diagnostics,
    })
}

fn report(stats: &GeometryStats, vertices: usize, instances: usize) -> Vec<ReportRow> {
    let row = |item: &str, setting: &str, metric: &str, error, bytes: usize| ReportRow {
        stage: "geometry".into(),
        item: item.into(),
        setting: setting.into(),
        metric: metric.into(),
        error,
        bytes: bytes as u64,
    };
    let mut rows = Vec::new();
    if stats.generated_tangents > 0 {
        rows.push(row(
            "tangents",
            "mikktspace",
            "largest sine of the angle to the normal's plane",
            stats.tangent_tilt,
            vertices * size_of::<[f32; 4]>(),
        ));
    }
    if instances > 0 {
        rows.push(row(
            "instance bounds",
            "all vertices",
            "largest slack ulp",
            stats.bounds_slack_ulp,
            instances * size_of::<Aabb>(),
        ));
    }
    rows
}

/// Where messages about `scene` point to.
fn origin(scene: &Scene) -> Origin {
    let file = scene
        .sources
        .first()
        .map_or(&scene.name, |source| &source.path);
    Origin {
        file: file.clone(),
        pointer: String::new(),
    }
}

fn fault(scene: &Scene, code: &'static str, message: impl Into<String>) -> BakeError {
    BakeError::input(code, &origin(scene), message)
}

#[cfg(test)]
mod tests;
