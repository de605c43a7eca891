//! Turns an imported scene into the arrays of a package.

mod bounds;
mod colors;
mod emission;
mod geometry;
mod group;
mod instances;
mod lights;
mod materials;
mod matrix;
pub mod mikktspace;
mod morton;
mod normals;
mod order;
mod primitive;
mod steps;
mod tangents;
#[cfg(test)]
mod testing;
mod validate;
mod weld;

use std::time::Instant;

use cairn_format::bounds::{CLUSTER, clusters};
use cairn_format::scene::{self, ReportRow};
use cairn_format::{Aabb, Vertex, features, gpu};

use crate::cache::Session;
use crate::diagnostic::{BakeError, Diagnostic, Result};
use crate::scene::Scene;

use geometry::Stored;
use steps::Step;

pub use materials::MaterialUse;
pub use steps::StepTime;

/// Fewest instances for which bounds of clusters are worth their test.
pub const MIN_CLUSTERED: usize = 2 * CLUSTER;

/// A scene as a package stores it; indices into each other's arrays are in range.
#[derive(Clone, Debug)]
pub struct Prepared {
    /// Vertex arena, object space, one run per primitive.
    pub vertices: Vec<Vertex>,
    /// One per vertex; empty where no primitive has colours.
    pub colors: Vec<gpu::VertexColor>,
    /// Index arena, relative to the primitive's first vertex. The triangles of a primitive are those of its source,
    /// in another order, and their corners may be rotated.
    pub indices: Vec<u32>,
    /// Meshes that some node draws and that have a triangle, in the order of the scene.
    pub meshes: Vec<scene::Mesh>,
    /// Primitives with triangles, contiguous per mesh.
    pub primitives: Vec<scene::Primitive>,
    /// One per drawn primitive of a node, ordered by draw group; near each other in space within a group.
    pub instances: Vec<gpu::Instance>,
    /// World bounds, one per record of `instances`.
    pub instance_bounds: Vec<Aabb>,
    /// World bounds of every [`CLUSTER`] consecutive records of `instances`; empty below [`MIN_CLUSTERED`].
    pub cluster_bounds: Vec<Aabb>,
    /// Sorted by alpha mode, double-sided, mirrored, then place; they partition `instances`.
    pub draw_groups: Vec<gpu::DrawGroup>,
    /// One per node that carries a stored mesh, in the order of the scene.
    pub mesh_instances: Vec<gpu::MeshInstance>,
    /// Triangles that emit, in world space, their powers zero yet; see the warnings where there are too many.
    pub emissive_triangles: Vec<gpu::EmissiveTriangle>,
    /// The directional ones of `lights`.
    pub directional_lights: Vec<gpu::DirectionalLight>,
    /// The point and spot lights of `lights`.
    pub punctual_lights: Vec<gpu::PunctualLight>,
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
    /// Times of the steps that were run. They differ from run to run and belong into no package.
    pub steps: Vec<StepTime>,
    /// Warnings.
    pub diagnostics: Vec<Diagnostic>,
}

/// What happened to the geometry. Vertices and triangles count once per stored primitive.
#[derive(
    rkyv::Archive,
    rkyv::Serialize,
    rkyv::Deserialize,
    Clone,
    Copy,
    Debug,
    Default,
    PartialEq,
    serde::Serialize,
    serde::Deserialize,
)]
pub struct GeometryStats {
    /// Stored triangles.
    pub triangles: u64,
    /// Triangles over all instances.
    pub drawn_triangles: u64,
    /// Vertices of the source primitives.
    pub vertices_in: u64,
    /// Vertices stored.
    pub vertices_out: u64,
    /// Triangles of zero area; they are kept, behind the others, and no ray meets them.
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
    /// Vertices that a first-in-first-out cache of 16 transforms, in the order of the source.
    pub transformed_before: u64,
    /// The same in the order stored.
    pub transformed_after: u64,
    /// Pixels that the measured primitives cover from the six sides.
    pub pixels_covered: u64,
    /// Pixels shaded for it in the order of the source.
    pub pixels_shaded_before: u64,
    /// The same in the order stored.
    pub pixels_shaded_after: u64,
    /// Largest difference between a vertex colour's channel and its source.
    pub color_error: f64,
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
        self.transformed_before += other.transformed_before;
        self.transformed_after += other.transformed_after;
        self.pixels_covered += other.pixels_covered;
        self.pixels_shaded_before += other.pixels_shaded_before;
        self.pixels_shaded_after += other.pixels_shaded_after;
        self.color_error = self.color_error.max(other.color_error);
    }

    /// Vertices transformed per triangle, before and after reordering (ACMR): 0.5 at best, 3 at worst.
    pub fn acmr(&self) -> [f64; 2] {
        self.transformed().map(|count| ratio(count, self.triangles))
    }

    /// Vertices transformed per vertex stored, before and after reordering (ATVR): 1 at best.
    pub fn atvr(&self) -> [f64; 2] {
        self.transformed()
            .map(|count| ratio(count, self.vertices_out))
    }

    /// Pixels shaded per pixel covered, before and after reordering, over the primitives measured; 1 at best.
    pub fn overdraw(&self) -> [f64; 2] {
        [self.pixels_shaded_before, self.pixels_shaded_after]
            .map(|shaded| ratio(shaded, self.pixels_covered))
    }

    fn transformed(&self) -> [u64; 2] {
        [self.transformed_before, self.transformed_after]
    }
}

fn ratio(count: u64, of: u64) -> f64 {
    if of == 0 {
        0.0
    } else {
        count as f64 / of as f64
    }
}

/// [`prepare_cached`] without a cache.
///
/// # Errors
/// As there.
pub fn prepare(scene: &mut Scene, progress: &(dyn Fn(f32) + Sync)) -> Result<Prepared> {
    prepare_cached(scene, &Session::off(), progress)
}

/// Prepares `scene`, and takes the primitives out of its meshes to do so. `progress` is called with the fraction done, from any thread, ending in 1.
///
/// The result does not depend on the number of threads.
///
/// # Errors
/// `BakeError::Input` where the scene breaks a promise of [`crate::scene`], an attribute is not finite,
/// an instance leaves the range of f32, or a count leaves that of the package.
pub fn prepare_cached(
    scene: &mut Scene,
    session: &Session,
    progress: &(dyn Fn(f32) + Sync),
) -> Result<Prepared> {
    validate::scene(scene)?;
    let geometry = geometry::build(scene, session, &|done| progress(done * 0.9))?;
    let mut steps = geometry.steps;
    let mut placed = steps.time(Step::Bounds, 0, || instances::place(scene, &geometry))?;
    let mut diagnostics = geometry.diagnostics.clone();
    let mut features = materials::features(scene, &geometry.materials);
    let mut emissive_triangles = Vec::new();
    if features & features::EMISSIVE != 0 {
        let start = Instant::now();
        let (listed, warning) = emission::list(scene, &geometry, &placed);
        let count = listed.triangles.len() as u64;
        steps.record(Step::Emission, count, start.elapsed());
        emissive_triangles = listed.triangles;
        for (node, first) in placed.mesh_instances.iter_mut().zip(listed.firsts) {
            node.first_emissive = first;
        }
        diagnostics.extend(warning);
    }
    let lights = lights::lights(scene)?;
    let directional_lights = lights::directional(scene);
    let punctual_lights = lights::punctual(scene);
    let cameras = lights::cameras(scene)?;

    let mut stats = geometry.stats;
    stats.add(&placed.stats);
    let mut set = |bit: u32, condition: bool| features |= if condition { bit } else { 0 };
    set(features::MIRRORED, placed.mirrored);
    set(features::DIRECTIONAL_LIGHTS, !directional_lights.is_empty());
    set(features::PUNCTUAL_LIGHTS, !punctual_lights.is_empty());
    set(features::VERTEX_COLORS, !geometry.colors.is_empty());
    progress(1.0);
    Ok(Prepared {
        report: report(&stats, &geometry, placed.bounds.len()),
        vertices: geometry.vertices,
        colors: geometry.colors,
        indices: geometry.indices,
        meshes: geometry.meshes,
        primitives: geometry.primitives,
        bounds: placed.bounds.iter().copied().fold(Aabb::EMPTY, Aabb::union),
        instances: placed.instances,
        cluster_bounds: if placed.bounds.len() >= MIN_CLUSTERED {
            clusters(&placed.bounds)
        } else {
            Vec::new()
        },
        instance_bounds: placed.bounds,
        draw_groups: placed.groups,
        mesh_instances: placed.mesh_instances,
        emissive_triangles,
        directional_lights,
        punctual_lights,
        lights,
        cameras,
        materials_used: geometry.materials,
        features,
        stats,
        steps: steps.list(),
        diagnostics,
    })
}

/// Rows are named after the step that they measure, where it has a time of its own.
fn report(stats: &GeometryStats, geometry: &Stored, instances: usize) -> Vec<ReportRow> {
    let vertices = geometry.vertices.len();
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
    if !geometry.colors.is_empty() {
        rows.push(row(
            "vertex colors",
            "unorm16",
            "largest difference of a channel",
            stats.color_error,
            size_of_val(geometry.colors.as_slice()),
        ));
    }
    let index_bytes = size_of_val(geometry.indices.as_slice());
    let mut order = |item: &str, setting: &str, names: [&str; 2], values: [f64; 2]| {
        for (name, value) in names.into_iter().zip(values) {
            rows.push(row(item, setting, name, value, index_bytes));
        }
    };
    if stats.triangles > 0 {
        let setting = "FIFO of 16";
        order(
            "vertex cache",
            setting,
            ["acmr before", "acmr after"],
            stats.acmr(),
        );
        order(
            "vertex cache",
            setting,
            ["atvr before", "atvr after"],
            stats.atvr(),
        );
    }
    if stats.pixels_covered > 0 {
        let names = ["overdraw before", "overdraw after"];
        order("overdraw", "largest primitives", names, stats.overdraw());
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

fn fault(scene: &Scene, code: &'static str, message: impl Into<String>) -> BakeError {
    BakeError::input(code, &scene.origin(""), message)
}

#[cfg(test)]
mod tests;
