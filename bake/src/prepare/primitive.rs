//! One primitive as a welded run of the vertex and index arenas.

use cairn_format::{Aabb, Vertex};
use glam::{DVec3, Vec3};

use crate::scene::Primitive;

use super::GeometryStats;
use super::materials::MaterialUse;
use super::normals;
use super::tangents::{self, Corners};
use super::weld::Welder;

/// A primitive ready for the arenas.
#[derive(Clone, Debug)]
pub(super) struct Built {
    pub(super) vertices: Vec<Vertex>,
    /// Corners in the order of the source.
    pub(super) indices: Vec<u32>,
    /// Object-space bounds of `vertices`, exact.
    pub(super) bounds: Aabb,
    pub(super) stats: GeometryStats,
    /// Why the tangents are stand-ins, where all are.
    pub(super) warning: Option<&'static str>,
}

/// Builds a primitive that holds at least one triangle.
///
/// Normals come first, because flat ones replace authored tangents (glTF 2.0 section 3.7.2.1); then tangents on
/// unindexed corners, because one index may need several; then welding of vertices that agree in every bit.
pub(super) fn build(primitive: &Primitive, uses: &MaterialUse) -> Built {
    let mut stats = GeometryStats {
        triangles: (primitive.indices.len() / 3) as u64,
        vertices_in: primitive.positions.len() as u64,
        degenerate_triangles: degenerate(primitive),
        ..GeometryStats::default()
    };
    let mut corners = CornerView {
        primitive,
        flat: flat_normals(primitive, &mut stats),
        uvs: [
            primitive.uv0.as_deref().filter(|_| uses.samples(0)),
            primitive.uv1.as_deref().filter(|_| uses.samples(1)),
        ],
        normal_uvs: None,
        tangents: Tangents::None,
    };
    let mut warning = None;
    if let Some(texture) = uses.normal {
        corners.normal_uvs = match texture.uv_set {
            0 => primitive.uv0.as_deref(),
            _ => primitive.uv1.as_deref(),
        };
        (corners.tangents, warning) = corners.make_tangents(&mut stats);
        stats.mixed_handedness = corners.mixed_handedness();
    }
    let (vertices, indices) = corners.weld();
    stats.vertices_out = vertices.len() as u64;
    let bounds = vertices.iter().fold(Aabb::EMPTY, |bounds, vertex| {
        bounds.include(Vec3::from(vertex.position))
    });
    Built {
        vertices,
        indices,
        bounds,
        stats,
        warning,
    }
}

fn corner_positions(primitive: &Primitive, triangle: &[u32]) -> [[f32; 3]; 3] {
    std::array::from_fn(|corner| primitive.positions[triangle[corner] as usize])
}

fn degenerate(primitive: &Primitive) -> u64 {
    let triangles = primitive.indices.chunks_exact(3);
    let flat = |triangle: &&[u32]| {
        normals::area_vector(corner_positions(primitive, triangle)) == DVec3::ZERO
    };
    triangles.filter(flat).count() as u64
}

/// One normal per triangle, where the primitive has none.
fn flat_normals(primitive: &Primitive, stats: &mut GeometryStats) -> Option<Vec<[f32; 3]>> {
    if primitive.normals.is_some() {
        return None;
    }
    stats.flat_primitives = 1;
    let triangles = primitive.indices.chunks_exact(3);
    Some(
        triangles
            .map(|triangle| normals::flat(corner_positions(primitive, triangle)))
            .collect(),
    )
}

enum Tangents {
    None,
    /// One per source vertex.
    Authored(Vec<[f32; 4]>),
    /// One per corner.
    Generated(Vec<[f32; 4]>),
}

/// The unindexed corners of a primitive, none of them stored.
struct CornerView<'a> {
    primitive: &'a Primitive,
    /// Per triangle.
    flat: Option<Vec<[f32; 3]>>,
    /// Coordinates that are stored.
    uvs: [Option<&'a [[f32; 2]]>; 2],
    /// Coordinates of the normal map.
    normal_uvs: Option<&'a [[f32; 2]]>,
    tangents: Tangents,
}

impl Corners for CornerView<'_> {
    fn count(&self) -> usize {
        self.primitive.indices.len()
    }

    fn position(&self, corner: usize) -> [f32; 3] {
        self.primitive.positions[self.source(corner)]
    }

    fn normal(&self, corner: usize) -> [f32; 3] {
        match (&self.flat, &self.primitive.normals) {
            (Some(flat), _) => flat[corner / 3],
            (None, Some(normals)) => normals[self.source(corner)],
            (None, None) => unreachable!("absent normals are flat"),
        }
    }

    fn uv(&self, corner: usize) -> [f32; 2] {
        self.normal_uvs
            .map_or([0.0; 2], |uvs| uvs[self.source(corner)])
    }
}

impl CornerView<'_> {
    /// Source vertex of a corner.
    fn source(&self, corner: usize) -> usize {
        self.primitive.indices[corner] as usize
    }

    fn tangent(&self, corner: usize) -> [f32; 4] {
        match &self.tangents {
            Tangents::None => [0.0; 4],
            Tangents::Authored(tangents) => tangents[self.source(corner)],
            Tangents::Generated(tangents) => tangents[corner],
        }
    }

    fn vertex(&self, corner: usize) -> Vertex {
        let source = self.source(corner);
        let [uv0, uv1] = self.uvs.map(|uvs| uvs.map_or([0.0; 2], |uvs| uvs[source]));
        Vertex {
            position: self.position(corner),
            normal: self.normal(corner),
            uv0,
            tangent: self.tangent(corner),
            uv1,
        }
    }

    /// Tangents for a normal map, and why they are stand-ins where all are.
    fn make_tangents(&self, stats: &mut GeometryStats) -> (Tangents, Option<&'static str>) {
        if let (None, Some(tangents)) = (&self.flat, &self.primitive.tangents) {
            return (Tangents::Authored(self.authored(tangents, stats)), None);
        }
        if self.normal_uvs.is_none() {
            stats.missing_normal_uvs = 1;
            let why = "the normal map's texture coordinates are absent";
            return (self.stand_ins(stats), Some(why));
        }
        let Some(generated) = tangents::generate(self) else {
            let why = "too many triangles share one vertex for MikkTSpace";
            return (self.stand_ins(stats), Some(why));
        };
        stats.tangent_fallbacks += generated.fallbacks;
        stats.generated_tangents += self.count() as u64 - generated.fallbacks;
        let tilts = generated.tangents.iter().enumerate();
        stats.tangent_tilt = tilts
            .map(|(corner, tangent)| tangents::tilt(self.normal(corner), *tangent))
            .fold(0.0, f64::max);
        (Tangents::Generated(generated.tangents), None)
    }

    fn authored(&self, tangents: &[[f32; 4]], stats: &mut GeometryStats) -> Vec<[f32; 4]> {
        let mut snapped = vec![None; tangents.len()];
        for corner in 0..self.count() {
            let source = self.source(corner);
            if snapped[source].is_none() {
                let (tangent, replaced) = tangents::authored(self.normal(corner), tangents[source]);
                snapped[source] = Some(tangent);
                stats.tangent_fallbacks += u64::from(replaced);
            }
        }
        snapped.into_iter().map(Option::unwrap_or_default).collect()
    }

    fn stand_ins(&self, stats: &mut GeometryStats) -> Tangents {
        stats.tangent_fallbacks += self.count() as u64;
        let corners = 0..self.count();
        Tangents::Generated(
            corners
                .map(|corner| tangents::fallback(self.normal(corner)))
                .collect(),
        )
    }

    fn mixed_handedness(&self) -> u64 {
        let mixed = |face: &usize| {
            let sign = |vertex: usize| self.tangent(face * 3 + vertex)[3];
            sign(0) != sign(1) || sign(1) != sign(2)
        };
        (0..self.count() / 3).filter(mixed).count() as u64
    }

    /// Vertices that differ, in order of first appearance, and the corners' indices.
    fn weld(&self) -> (Vec<Vertex>, Vec<u32>) {
        let mut welder = Welder::new();
        let mut add = |corner: usize| -> u32 {
            welder.add(bytemuck::cast::<Vertex, [u32; 14]>(self.vertex(corner)))
        };
        let per_source = self.flat.is_none() && !matches!(self.tangents, Tangents::Generated(_));
        let indices = if per_source {
            let mut numbers = vec![None; self.primitive.positions.len()];
            let corners = 0..self.count();
            corners
                .map(|corner| *numbers[self.source(corner)].get_or_insert_with(|| add(corner)))
                .collect()
        } else {
            (0..self.count()).map(add).collect()
        };
        (bytemuck::cast_vec(welder.into_values()), indices)
    }
}

#[cfg(test)]
#[path = "primitive_tests.rs"]
mod tests;
