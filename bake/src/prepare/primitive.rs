//! One primitive as a welded run of the vertex and index arenas.

use cairn_format::gpu::VertexColor;
use cairn_format::{Aabb, Vertex};
use glam::Vec3;

use crate::scene::{Primitive, UvTransform};

use super::GeometryStats;
use super::colors::{self, Colors};
use super::materials::MaterialUse;
use super::normals;
use super::order::{self, Policy, Welded};
use super::steps::{Step, Steps};
use super::tangents::{self, Corners};
use super::weld::Welder;

/// A primitive ready for the arenas.
#[derive(Clone, Debug)]
pub(super) struct Built {
    pub(super) vertices: Vec<Vertex>,
    /// One per vertex; empty where all are white.
    pub(super) colors: Vec<VertexColor>,
    /// Triangles with an area come first.
    pub(super) indices: Vec<u32>,
    /// Indices of the triangles with an area.
    pub(super) traced: usize,
    /// Object-space bounds of `vertices`, exact.
    pub(super) bounds: Aabb,
    pub(super) stats: GeometryStats,
    pub(super) steps: Steps,
    /// Why the tangents are stand-ins, where all are.
    pub(super) warning: Option<&'static str>,
}

/// Builds a primitive that holds at least one triangle.
///
/// Normals come first, because flat ones replace authored tangents (glTF 2.0 section 3.7.2.1); then tangents on
/// unindexed corners, because one index may need several; then welding of vertices that agree in every bit; then
/// the order of triangles and vertices, which tangents must not see.
pub(super) fn build(primitive: Primitive, uses: &MaterialUse, policy: Policy) -> Built {
    let triangles = (primitive.indices.len() / 3) as u64;
    let mut stats = GeometryStats {
        triangles,
        vertices_in: primitive.positions.len() as u64,
        ..GeometryStats::default()
    };
    let mut steps = Steps::default();
    let (degenerate, flat) = steps.time(Step::Normals, triangles, || {
        (degenerate(&primitive), flat_normals(&primitive, &mut stats))
    });
    stats.degenerate_triangles = degenerate.iter().filter(|flat| **flat).count() as u64;
    let (mut welded, warning) = weld(&primitive, flat, uses, &mut stats, &mut steps);
    drop(primitive);
    stats.vertices_out = welded.vertices.len() as u64;
    let traced = order::optimize(&mut welded, &degenerate, policy, &mut stats, &mut steps);
    let bounds = steps.time(Step::Bounds, triangles, || bounds(&welded.vertices));
    Built {
        vertices: welded.vertices,
        colors: welded.colors,
        indices: welded.indices,
        traced,
        bounds,
        stats,
        steps,
        warning,
    }
}

fn bounds(vertices: &[Vertex]) -> Aabb {
    vertices.iter().fold(Aabb::EMPTY, |bounds, vertex| {
        bounds.include(Vec3::from(vertex.position))
    })
}

/// Tangents where `uses` needs them, then welding; and why the tangents are stand-ins where all are.
fn weld(
    primitive: &Primitive,
    flat: Option<Vec<[f32; 3]>>,
    uses: &MaterialUse,
    stats: &mut GeometryStats,
    steps: &mut Steps,
) -> (Welded, Option<&'static str>) {
    let triangles = stats.triangles;
    let colors = colors::stored(primitive);
    stats.color_error = colors.as_ref().map_or(0.0, |colors| colors.error);
    let mut corners = CornerView {
        primitive,
        flat,
        uvs: [
            primitive.uv0.as_deref().filter(|_| uses.samples(0)),
            primitive.uv1.as_deref().filter(|_| uses.samples(1)),
        ],
        colors,
        normal_uvs: None,
        transform: None,
        tangents: Tangents::None,
    };
    let mut warning = None;
    if let Some(texture) = uses.tangent_space() {
        steps.time(Step::Tangents, triangles, || {
            corners.normal_uvs = match texture.uv_set {
                0 => primitive.uv0.as_deref(),
                _ => primitive.uv1.as_deref(),
            };
            let transform = Some(texture.transform);
            corners.transform = transform.filter(|found| *found != UvTransform::IDENTITY);
            (corners.tangents, warning) = corners.make_tangents(stats);
            stats.mixed_handedness = corners.mixed_handedness();
        });
    }
    let welded = steps.time(Step::Weld, triangles, || corners.weld());
    (welded, warning)
}

fn corner_positions(primitive: &Primitive, triangle: &[u32]) -> [[f32; 3]; 3] {
    std::array::from_fn(|corner| primitive.positions[triangle[corner] as usize])
}

/// Whether each triangle has no area.
fn degenerate(primitive: &Primitive) -> Vec<bool> {
    let triangles = primitive.indices.chunks_exact(3);
    triangles
        .map(|triangle| normals::is_degenerate(corner_positions(primitive, triangle)))
        .collect()
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
    colors: Option<Colors>,
    /// Coordinates of the normal map.
    normal_uvs: Option<&'a [[f32; 2]]>,
    /// What the normal map's texture does to them; `None` is the identity.
    transform: Option<UvTransform>,
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
        let uv = self
            .normal_uvs
            .map_or([0.0; 2], |uvs| uvs[self.source(corner)]);
        self.transform.map_or(uv, |transform| transform.apply(uv))
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
        let far = |corner: usize| !self.uv(corner).iter().all(|value| value.is_finite());
        if self.transform.is_some() && (0..self.count()).any(far) {
            let why = "the normal map's texture transform leaves the range of 32-bit floats";
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
    fn weld(&self) -> Welded {
        let Some(colors) = &self.colors else {
            let key = |corner| bytemuck::cast::<Vertex, [u32; 14]>(self.vertex(corner));
            let (values, indices) = self.numbers(key);
            return Welded {
                vertices: bytemuck::cast_vec(values),
                colors: Vec::new(),
                indices,
            };
        };
        let (values, indices) = self.numbers(|corner| -> [u32; 16] {
            let VertexColor {
                red_green,
                blue_alpha,
            } = colors.stored[self.source(corner)];
            let mut key = [0; 16];
            key[..14].copy_from_slice(&bytemuck::cast::<Vertex, [u32; 14]>(self.vertex(corner)));
            (key[14], key[15]) = (red_green, blue_alpha);
            key
        });
        Welded {
            vertices: values
                .iter()
                .map(|value| bytemuck::pod_read_unaligned(bytemuck::cast_slice(&value[..14])))
                .collect(),
            colors: values
                .iter()
                .map(|value| VertexColor {
                    red_green: value[14],
                    blue_alpha: value[15],
                })
                .collect(),
            indices,
        }
    }

    /// The distinct keys of the corners in order of first appearance, and the number of each corner's.
    fn numbers<const N: usize>(
        &self,
        key: impl Fn(usize) -> [u32; N],
    ) -> (Vec<[u32; N]>, Vec<u32>) {
        const NONE: u32 = u32::MAX;
        let sources = self.primitive.positions.len();
        let mut welder = Welder::with_capacity(sources.min(self.count()));
        // Corners of one source vertex are mostly one vertex, which then need not be looked up.
        let mut recent = vec![NONE; sources];
        let per_source = self.flat.is_none() && !matches!(self.tangents, Tangents::Generated(_));
        let indices = (0..self.count())
            .map(|corner| {
                let recent = &mut recent[self.source(corner)];
                if per_source && *recent != NONE {
                    return *recent;
                }
                let key = key(corner);
                if *recent == NONE || *welder.value(*recent) != key {
                    *recent = welder.add(key);
                }
                *recent
            })
            .collect();
        (welder.into_values(), indices)
    }
}

#[cfg(test)]
#[path = "primitive_tests.rs"]
mod tests;
