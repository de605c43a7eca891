//! Reorders the triangles and vertices of a primitive for the GPU.
//!
//! Triangles keep their winding, but not their order, and their corners may be rotated.

use cairn_format::Vertex;
use cairn_format::gpu::VertexColor;
use meshopt::VertexDataAdapter;

use super::GeometryStats;
use super::steps::{Step, Steps};

/// Vertices that a GPU is taken to keep, first in first out: the model of the reports.
const CACHE: u32 = 16;
/// What reordering against overdraw may cost of the vertex cache's efficiency.
const THRESHOLD: f32 = 1.05;
/// The optimiser's time grows with the sum of the squares of the triangles at each vertex. Beyond this multiple of
/// the corners a linear one does the work.
const MAX_MEAN_VALENCE: u64 = 512;
/// Sizes whose areas stay far inside the range of f32, so that triangles can be told from each other.
const SIZES: std::ops::Range<f32> = 1e-12..1e12;

/// A welded triangle list.
#[derive(Clone, Debug, Default)]
pub(super) struct Welded {
    /// All are used.
    pub(super) vertices: Vec<Vertex>,
    /// One per vertex, or none at all.
    pub(super) colors: Vec<VertexColor>,
    pub(super) indices: Vec<u32>,
}

/// What the order of a primitive may and shall be.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Policy {
    /// Blended triangles are drawn in the order of the source.
    pub(super) keep: bool,
    /// Whether overdraw is measured.
    pub(super) measure_overdraw: bool,
}

/// Puts triangles of which `degenerate` is true last, in the order of the source; orders the others for the vertex
/// cache (Forsyth 2006) and against overdraw (Sander, Nehab and Barczak 2007), then the vertices by first use.
/// Returns the indices of the triangles with an area.
pub(super) fn optimize(
    mesh: &mut Welded,
    degenerate: &[bool],
    policy: Policy,
    stats: &mut GeometryStats,
    steps: &mut Steps,
) -> usize {
    let triangles = degenerate.len() as u64;
    steps.time(Step::Analysis, triangles, || {
        stats.transformed_before = transformed(mesh);
    });
    let traced = partition(&mut mesh.indices, degenerate);
    let flat = traced < mesh.indices.len();
    let improvable = !policy.keep && traced >= 6 && mesh.vertices.len() > CACHE as usize;
    let sizable = SIZES.contains(&size(&mesh.vertices));
    let measured = policy.measure_overdraw && sizable && traced > 0;
    if measured {
        steps.time(Step::Analysis, triangles, || {
            (stats.pixels_covered, stats.pixels_shaded_before) = overdraw(mesh, traced);
        });
    }
    if improvable {
        let front = &mut mesh.indices[..traced];
        let count = traced as u64 / 3;
        steps.time(Step::VertexCache, count, || {
            cache(front, mesh.vertices.len());
        });
        if sizable && let Ok(positions) = positions(&mesh.vertices) {
            steps.time(Step::Overdraw, count, || {
                meshopt::optimize_overdraw_in_place(front, &positions, THRESHOLD);
            });
        }
    }
    if improvable || flat {
        steps.time(Step::VertexFetch, triangles, || by_first_use(mesh));
    }
    steps.time(Step::Analysis, 0, || {
        stats.transformed_after = transformed(mesh);
        if measured {
            (_, stats.pixels_shaded_after) = overdraw(mesh, traced);
        }
    });
    traced
}

/// Moves degenerate triangles behind the others; returns the indices of the others.
fn partition(indices: &mut Vec<u32>, degenerate: &[bool]) -> usize {
    if !degenerate.contains(&true) {
        return indices.len();
    }
    let mut behind = Vec::new();
    let mut traced = 0;
    for (triangle, flat) in degenerate.iter().enumerate() {
        let corners = triangle * 3..triangle * 3 + 3;
        if *flat {
            behind.extend_from_slice(&indices[corners]);
        } else {
            indices.copy_within(corners, traced);
            traced += 3;
        }
    }
    indices.truncate(traced);
    indices.append(&mut behind);
    traced
}

fn cache(indices: &mut [u32], vertices: usize) {
    let mut valences = vec![0u32; vertices];
    for index in indices.iter() {
        valences[*index as usize] += 1;
    }
    let squares: u64 = valences.iter().map(|count| u64::from(*count).pow(2)).sum();
    if squares > MAX_MEAN_VALENCE * indices.len() as u64 {
        meshopt::optimize_vertex_cache_fifo_in_place(indices, vertices, CACHE);
    } else {
        meshopt::optimize_vertex_cache_in_place(indices, vertices);
    }
}

/// Renumbers the vertices, all of which are used, in the order in which the indices name them.
fn by_first_use(mesh: &mut Welded) {
    let numbers = meshopt::optimize_vertex_fetch_remap(&mesh.indices, mesh.vertices.len());
    for index in &mut mesh.indices {
        *index = numbers[*index as usize];
    }
    permute(&mut mesh.vertices, &numbers);
    permute(&mut mesh.colors, &numbers);
}

/// Moves value `i` to place `numbers[i]`.
fn permute<T: Copy + bytemuck::Zeroable>(values: &mut Vec<T>, numbers: &[u32]) {
    let mut moved = vec![T::zeroed(); values.len()];
    for (value, number) in values.iter().zip(numbers) {
        moved[*number as usize] = *value;
    }
    *values = moved;
}

fn transformed(mesh: &Welded) -> u64 {
    let count = mesh.vertices.len();
    meshopt::analyze_vertex_cache(&mesh.indices, count, CACHE, 0, 0)
        .vertices_transformed
        .into()
}

/// Pixels covered and shaded by the triangles with an area, from the six sides.
fn overdraw(mesh: &Welded, traced: usize) -> (u64, u64) {
    let Ok(positions) = positions(&mesh.vertices) else {
        return (0, 0);
    };
    let found = meshopt::analyze_overdraw(&mesh.indices[..traced], &positions);
    (found.pixels_covered.into(), found.pixels_shaded.into())
}

fn positions(vertices: &[Vertex]) -> meshopt::Result<VertexDataAdapter<'_>> {
    let offset = std::mem::offset_of!(Vertex, position);
    VertexDataAdapter::new(bytemuck::cast_slice(vertices), size_of::<Vertex>(), offset)
}

/// Largest distance along an axis.
fn size(vertices: &[Vertex]) -> f32 {
    let extent = |axis: usize| {
        let values = vertices.iter().map(|vertex| vertex.position[axis]);
        let (min, max) = values.fold((f32::INFINITY, f32::NEG_INFINITY), |(min, max), value| {
            (min.min(value), max.max(value))
        });
        max - min
    };
    extent(0).max(extent(1)).max(extent(2))
}

#[cfg(test)]
#[path = "order_tests.rs"]
mod tests;
