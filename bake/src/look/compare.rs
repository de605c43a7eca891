//! How far two images or two meshes are from each other.

use cairn_format::scene::ArchivedImage;
use glam::Vec3;
use rayon::prelude::*;
use serde::Serialize;

use super::decode::layer;
use super::mesh::MeshView;
use super::nearest::Points;

/// Difference of two images of one size.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ImageDifference {
    /// Of the decoded values of level 0 over all layers, their peak being 1 or the greatest of either image, so that
    /// both directions agree; absent where they are equal.
    pub psnr_db: Option<f64>,
    /// Greatest difference of one channel.
    pub largest: f64,
    /// Levels that differ in any value.
    pub levels: u32,
}

/// Difference of two meshes.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct MeshDifference {
    /// Before and after.
    pub vertices: [u64; 2],
    /// Before and after.
    pub triangles: [u64; 2],
    /// Whether both have the same triangles of the same vertices, so that vertices are compared by their number.
    pub same_order: bool,
    /// Longest way of a vertex in object space, metres: to its counterpart, or else to the nearest vertex of the
    /// other mesh, from either side. Absent where one of them has no vertex.
    pub largest_move: Option<f64>,
    /// Greatest angle between normals, degrees; only in the same order.
    pub largest_normal_turn: Option<f64>,
    /// Greatest difference of a texture coordinate; only in the same order.
    pub largest_uv_move: Option<f64>,
    /// Greatest difference of a bound in object space, metres.
    pub bounds_move: f64,
}

/// Compares images of equal extents, layers and levels; `None` where these differ.
pub fn images(a: (&ArchivedImage, &[u8]), b: (&ArchivedImage, &[u8])) -> Option<ImageDifference> {
    let shape = |image: &ArchivedImage| {
        let sizes = [image.width, image.height, image.layers].map(|size| size.to_native());
        (sizes, image.levels.len())
    };
    if shape(a.0) != shape(b.0) || a.0.format.native().is_srgb() != b.0.format.native().is_srgb() {
        return None;
    }
    let mut difference = ImageDifference {
        psnr_db: None,
        largest: 0.0,
        levels: 0,
    };
    for level in 0..a.0.levels.len() {
        let (mut squares, mut largest, mut peak, mut count) = (0.0, 0.0_f64, 1.0_f64, 0);
        for face in 0..a.0.layers.to_native() {
            let (one, other) = (layer(a.0, a.1, level, face), layer(b.0, b.1, level, face));
            let values = one
                .texels
                .as_flattened()
                .iter()
                .zip(other.texels.as_flattened());
            for (x, y) in values {
                let (x, y) = (f64::from(*x), f64::from(*y));
                squares += (x - y) * (x - y);
                largest = largest.max((x - y).abs());
                peak = peak.max(x.abs()).max(y.abs());
            }
            count += one.texels.len() * 4;
        }
        difference.largest = difference.largest.max(largest);
        difference.levels += u32::from(largest > 0.0);
        if level == 0 && squares > 0.0 {
            let mean = squares / count as f64;
            difference.psnr_db = Some(10.0 * libm::log10(peak * peak / mean));
        }
    }
    Some(difference)
}

/// Compares meshes.
pub fn meshes(a: &MeshView, b: &MeshView) -> MeshDifference {
    let size = |mesh: &MeshView| {
        let sums = mesh.primitives.iter().fold([0, 0], |[v, t], primitive| {
            [
                v + primitive.vertices.len(),
                t + primitive.indices.len() / 3,
            ]
        });
        sums.map(|sum| sum as u64)
    };
    let ([a_vertices, a_triangles], [b_vertices, b_triangles]) = (size(a), size(b));
    let same_order = a.primitives.len() == b.primitives.len()
        && a.primitives
            .iter()
            .zip(&b.primitives)
            .all(|(a, b)| a.vertices.len() == b.vertices.len() && a.indices == b.indices);
    let attributes = same_order.then(|| attributes(a, b));
    let (a_points, b_points) = (positions(a), positions(b));
    MeshDifference {
        vertices: [a_vertices, b_vertices],
        triangles: [a_triangles, b_triangles],
        same_order,
        largest_move: match &attributes {
            _ if a_points.is_empty() || b_points.is_empty() => None,
            Some([largest, ..]) => Some(*largest),
            None => Some(farthest(&a_points, &b_points).max(farthest(&b_points, &a_points))),
        },
        largest_normal_turn: attributes.map(|[_, turn, _]| turn),
        largest_uv_move: attributes.map(|[.., uv]| uv),
        bounds_move: bounds_move(&a_points, &b_points),
    }
}

fn positions(mesh: &MeshView) -> Vec<Vec3> {
    let vertices = mesh
        .primitives
        .iter()
        .flat_map(|primitive| primitive.vertices);
    vertices.map(|vertex| Vec3::from(vertex.position)).collect()
}

/// Greatest move, turn in degrees and change of coordinates over vertices in the same order.
fn attributes(a: &MeshView, b: &MeshView) -> [f64; 3] {
    let mut largest = [0.0_f64; 3];
    for (a, b) in a.primitives.iter().zip(&b.primitives) {
        for (a, b) in a.vertices.iter().zip(b.vertices) {
            let way = Vec3::from(a.position)
                .as_dvec3()
                .distance(Vec3::from(b.position).as_dvec3());
            // By the chord: the arc cosine of a dot product near 1 has no digits left.
            let chord = Vec3::from(a.normal)
                .as_dvec3()
                .distance(Vec3::from(b.normal).as_dvec3());
            let turn = 2.0 * libm::asin((0.5 * chord).min(1.0)).to_degrees();
            let coordinates = [a.uv0, a.uv1]
                .concat()
                .into_iter()
                .zip([b.uv0, b.uv1].concat());
            let uv = coordinates
                .map(|(a, b)| f64::from((a - b).abs()))
                .fold(0.0, f64::max);
            largest = [
                largest[0].max(way),
                largest[1].max(turn),
                largest[2].max(uv),
            ];
        }
    }
    largest
}

/// The longest way from a point of `from` to its nearest of `to`.
fn farthest(from: &[Vec3], to: &[Vec3]) -> f64 {
    let index = Points::new(to);
    let ways = from.par_iter().map(|point| index.nearest_squared(*point));
    ways.reduce(|| 0.0, f64::max).sqrt()
}

fn bounds_move(a: &[Vec3], b: &[Vec3]) -> f64 {
    let bounds = |points: &[Vec3]| {
        let first = points.first().copied().unwrap_or(Vec3::ZERO);
        points.iter().fold([first, first], |[min, max], point| {
            [min.min(*point), max.max(*point)]
        })
    };
    let (a, b) = (bounds(a), bounds(b));
    let corners = a.into_iter().zip(b);
    corners
        .map(|(a, b)| f64::from((a - b).abs().max_element()))
        .fold(0.0, f64::max)
}

#[cfg(test)]
mod tests {
    use super::super::mesh::PrimitiveView;
    use super::*;
    use bytemuck::Zeroable;
    use cairn_format::Vertex;

    fn vertex(x: f32, y: f32) -> Vertex {
        Vertex {
            position: [x, y, 0.0],
            normal: [0.0, 0.0, 1.0],
            ..Vertex::zeroed()
        }
    }

    fn view<'a>(vertices: &'a [Vertex], indices: &'a [u32]) -> MeshView<'a> {
        MeshView {
            name: "mesh",
            primitives: vec![PrimitiveView {
                material: 0,
                indices,
                vertices,
                colors: &[],
            }],
        }
    }

    #[test]
    fn a_moved_vertex_is_measured() {
        let a = [vertex(0.0, 0.0), vertex(1.0, 0.0), vertex(0.0, 1.0)];
        let mut b = a;
        b[1].position[0] = 1.5;
        b[2].normal = [0.0, 1.0, 0.0];
        b[0].uv1 = [0.25, 0.0];
        let difference = meshes(&view(&a, &[0, 1, 2]), &view(&b, &[0, 1, 2]));
        assert!(difference.same_order);
        assert_eq!(difference.largest_move, Some(0.5));
        assert_eq!(difference.largest_uv_move, Some(0.25));
        assert_eq!(difference.bounds_move, 0.5);
        let turn = difference.largest_normal_turn.expect("the same order");
        assert!((turn - 90.0).abs() < 1e-9, "{turn}");
    }

    #[test]
    fn another_order_is_no_move() {
        let a = [vertex(0.0, 0.0), vertex(1.0, 0.0), vertex(0.0, 1.0)];
        let b = [a[2], a[0], a[1]];
        let same = meshes(&view(&a, &[0, 1, 2]), &view(&b, &[1, 2, 0]));
        assert!(!same.same_order && same.largest_move == Some(0.0));
        let more = [a[0], a[1], a[2], vertex(3.0, 4.0)];
        let grown = meshes(&view(&a, &[0, 1, 2]), &view(&more, &[0, 1, 2, 0, 1, 3]));
        let expected = 18.0_f64.sqrt();
        assert!((grown.largest_move.expect("vertices") - expected).abs() < 1e-9);
        assert_eq!((grown.vertices, grown.bounds_move), ([3, 4], 3.0));
        let none = meshes(&view(&a, &[0, 1, 2]), &view(&[], &[]));
        assert_eq!(none.largest_move, None);
    }
}
