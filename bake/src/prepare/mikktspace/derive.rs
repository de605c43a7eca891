//! What a triangle knows by itself: orientation, degeneracy, weighted tangents of its corners.

use rayon::prelude::*;

use super::vector::{V3, not_zero};
use super::{Corners, arc_cosine, flag};

/// Triangles that go through the arithmetic together.
const LANES: usize = 64;
/// Triangles of one parallel task.
const TASK: usize = LANES * 32;

/// All directions: axes, positive and negative, along which the projected unit tangent (low six bits) and bitangent
/// (next six) reach 0.3. Vectors that share one are not opposite. No bit where lengths are in doubt; all where a
/// vector may join any other.
pub(super) const ALL_DIRECTIONS: u32 = 0xFFF;
/// The directions of the tangent; those of the bitangent are six bits higher.
pub(super) const TANGENT_DIRECTIONS: u32 = 0x3F;

/// Per triangle and per corner results.
pub(super) struct Derived {
    /// Bits of [`flag`] per triangle.
    pub(super) flags: Vec<u8>,
    /// What each corner adds to the tangent of its group: its tangent in the plane of its normal, of the length of
    /// its angle and zero without coordinates, and the bits of its [`directions`] as the fourth float.
    ///
    /// One record serves for input and output, because fresh memory costs as much time as the arithmetic.
    pub(super) corners: Vec<[f32; 4]>,
    /// Corners of the box around all positions; NaN is left out.
    pub(super) low: [f32; 3],
    pub(super) high: [f32; 3],
}

/// First-order tangent and bitangent of a triangle, unit length.
#[derive(Clone, Copy, Debug)]
pub(super) struct FirstOrder {
    pub(super) tangent: V3,
    pub(super) bitangent: V3,
    pub(super) preserving: bool,
    /// Whether the coordinates say nothing, so that the triangle follows any neighbour.
    pub(super) any: bool,
}

/// Derivatives of position by texture coordinate (Mikkelsen 2008, equations 18 and 19).
#[inline(always)]
pub(super) fn first_order(p: [V3; 3], uv: [[f32; 2]; 3]) -> FirstOrder {
    let (u1, v1) = (uv[1][0] - uv[0][0], uv[1][1] - uv[0][1]);
    let (u2, v2) = (uv[2][0] - uv[0][0], uv[2][1] - uv[0][1]);
    let (d1, d2) = (p[1].sub(p[0]), p[2].sub(p[0]));
    let area = u1 * v2 - v1 * u2;
    let tangent = d1.scale(v2).sub(d2.scale(v1));
    let bitangent = d1.scale(-u2).add(d2.scale(u1));
    let preserving = area > 0.0;
    let sign = if preserving { 1.0 } else { -1.0 };
    let size = area.abs();
    let sound =
        not_zero(size) & not_zero(tangent.length() / size) & not_zero(bitangent.length() / size);
    FirstOrder {
        tangent: tangent.normalized().scale(sign),
        bitangent: bitangent.normalized().scale(sign),
        preserving,
        any: !sound,
    }
}

/// Evaluates all triangles.
pub(super) fn derive<C: Corners + ?Sized>(corners: &C) -> Derived {
    let triangles = corners.count() / 3;
    let mut flags = vec![0u8; triangles];
    let mut weighted = vec![[0.0; 4]; triangles * 3];
    let (low, high) = flags
        .par_chunks_mut(TASK)
        .zip(weighted.par_chunks_mut(TASK * 3))
        .enumerate()
        .map(|(task, (flags, weighted))| {
            let mut block = Block::new();
            let groups = flags.chunks_mut(LANES).zip(weighted.chunks_mut(LANES * 3));
            for (group, (flags, weighted)) in groups.enumerate() {
                block.load(corners, task * TASK + group * LANES, flags.len());
                block.evaluate();
                block.store(flags, weighted);
            }
            block.bounds()
        })
        .reduce(|| ([f32::INFINITY; 3], [f32::NEG_INFINITY; 3]), unite);
    Derived {
        flags,
        corners: weighted,
        low,
        high,
    }
}

fn unite(
    (low, high): ([f32; 3], [f32; 3]),
    (other_low, other_high): ([f32; 3], [f32; 3]),
) -> ([f32; 3], [f32; 3]) {
    (
        std::array::from_fn(|axis| low[axis].min(other_low[axis])),
        std::array::from_fn(|axis| high[axis].max(other_high[axis])),
    )
}

type Lanes<T> = [T; LANES];

/// Structure of arrays over the triangles of a block; indices are corner, axis, lane.
struct Block {
    positions: [[Lanes<f32>; 3]; 3],
    normals: [[Lanes<f32>; 3]; 3],
    uvs: [[Lanes<f32>; 2]; 3],
    tangent: [Lanes<f32>; 3],
    bitangent: [Lanes<f32>; 3],
    flags: Lanes<u32>,
    weights: [[Lanes<f32>; 3]; 3],
    angles: [Lanes<f32>; 3],
    directions: [Lanes<u32>; 3],
    low: [Lanes<f32>; 3],
    high: [Lanes<f32>; 3],
}

#[inline(always)]
fn lane(vectors: &[Lanes<f32>; 3], lane: usize) -> V3 {
    V3::new([vectors[0][lane], vectors[1][lane], vectors[2][lane]])
}

#[inline(always)]
fn set_lane(vectors: &mut [Lanes<f32>; 3], lane: usize, value: V3) {
    vectors[0][lane] = value.x;
    vectors[1][lane] = value.y;
    vectors[2][lane] = value.z;
}

impl Block {
    fn new() -> Box<Self> {
        let zero = [0.0; LANES];
        Box::new(Self {
            positions: [[zero; 3]; 3],
            normals: [[zero; 3]; 3],
            uvs: [[zero; 2]; 3],
            tangent: [zero; 3],
            bitangent: [zero; 3],
            flags: [0; LANES],
            weights: [[zero; 3]; 3],
            angles: [zero; 3],
            directions: [[0; LANES]; 3],
            low: [[f32::INFINITY; LANES]; 3],
            high: [[f32::NEG_INFINITY; LANES]; 3],
        })
    }

    /// Reads `count` triangles from `first` on; lanes beyond repeat the first.
    fn load<C: Corners + ?Sized>(&mut self, corners: &C, first: usize, count: usize) {
        for lane in 0..LANES {
            let triangle = first + if lane < count { lane } else { 0 };
            for vertex in 0..3 {
                let corner = triangle * 3 + vertex;
                let position = corners.position(corner);
                let normal = corners.normal(corner);
                let uv = corners.uv(corner);
                for axis in 0..3 {
                    self.positions[vertex][axis][lane] = position[axis];
                    self.normals[vertex][axis][lane] = normal[axis];
                }
                self.uvs[vertex][0][lane] = uv[0];
                self.uvs[vertex][1][lane] = uv[1];
            }
        }
    }

    fn evaluate(&mut self) {
        self.enclose();
        self.differentiate();
        for vertex in 0..3 {
            self.project(vertex);
            self.measure(vertex);
            arc_cosine::in_place(&mut self.angles[vertex]);
        }
    }

    fn enclose(&mut self) {
        for positions in &self.positions {
            for (axis, values) in positions.iter().enumerate() {
                for (lane, &value) in values.iter().enumerate() {
                    let (low, high) = (self.low[axis][lane], self.high[axis][lane]);
                    self.low[axis][lane] = if value < low { value } else { low };
                    self.high[axis][lane] = if value > high { value } else { high };
                }
            }
        }
    }

    fn differentiate(&mut self) {
        for at in 0..LANES {
            let p = [
                lane(&self.positions[0], at),
                lane(&self.positions[1], at),
                lane(&self.positions[2], at),
            ];
            let uv = [
                [self.uvs[0][0][at], self.uvs[0][1][at]],
                [self.uvs[1][0][at], self.uvs[1][1][at]],
                [self.uvs[2][0][at], self.uvs[2][1][at]],
            ];
            let same = |a: V3, b: V3| {
                u32::from(a.x == b.x) & u32::from(a.y == b.y) & u32::from(a.z == b.z)
            };
            let degenerate = same(p[0], p[1]) | same(p[1], p[2]) | same(p[2], p[0]);
            let order = first_order(p, uv);
            set_lane(&mut self.tangent, at, order.tangent);
            set_lane(&mut self.bitangent, at, order.bitangent);
            self.flags[at] = degenerate * u32::from(flag::DEGENERATE)
                + u32::from(order.any) * u32::from(flag::ANY)
                + u32::from(order.preserving) * u32::from(flag::PRESERVING);
        }
    }

    /// The tangent in the plane of the normal, and the directions of both vectors.
    fn project(&mut self, vertex: usize) {
        for at in 0..LANES {
            let normal = lane(&self.normals[vertex], at);
            let tangent = lane(&self.tangent, at).project(normal).normalized();
            let bitangent = lane(&self.bitangent, at).project(normal);
            set_lane(&mut self.weights[vertex], at, tangent);
            let directions =
                directions(tangent, 0.95, 1.05) | (directions(bitangent, 1e-20, 1e20) << 6);
            let any = self.flags[at] & u32::from(flag::ANY) != 0;
            self.directions[vertex][at] = if any { ALL_DIRECTIONS } else { directions };
        }
    }

    /// Cosine of the corner's angle, seen along the normal.
    fn measure(&mut self, vertex: usize) {
        let (after, before) = ((vertex + 1) % 3, (vertex + 2) % 3);
        for at in 0..LANES {
            let normal = lane(&self.normals[vertex], at);
            let apex = lane(&self.positions[vertex], at);
            let a = lane(&self.positions[after], at).sub(apex);
            let b = lane(&self.positions[before], at).sub(apex);
            let a = a.project(normal).normalized();
            let b = b.project(normal).normalized();
            self.angles[vertex][at] = a.dot(b).clamp(-1.0, 1.0);
        }
    }

    fn store(&self, flags: &mut [u8], weighted: &mut [[f32; 4]]) {
        for (at, (flags, weighted)) in flags
            .iter_mut()
            .zip(weighted.chunks_exact_mut(3))
            .enumerate()
        {
            *flags = self.flags[at] as u8;
            let any = *flags & flag::ANY != 0;
            for (vertex, weighted) in weighted.iter_mut().enumerate() {
                let tangent = lane(&self.weights[vertex], at).scale(self.angles[vertex][at]);
                // A sum that starts at +0 keeps its bits when zero is added.
                let V3 { x, y, z } = if any { V3::default() } else { tangent };
                *weighted = [x, y, z, f32::from_bits(self.directions[vertex][at])];
            }
        }
    }

    fn bounds(&self) -> ([f32; 3], [f32; 3]) {
        let fold = |lanes: &Lanes<f32>, start, pick: fn(f32, f32) -> f32| {
            lanes.iter().copied().fold(start, pick)
        };
        (
            std::array::from_fn(|axis| fold(&self.low[axis], f32::INFINITY, f32::min)),
            std::array::from_fn(|axis| fold(&self.high[axis], f32::NEG_INFINITY, f32::max)),
        )
    }
}

/// Six bits: the axes, positive then negative, along which `v` reaches 0.3 of its length, whose square must
/// lie between `least` and `most`.
#[inline(always)]
fn directions(v: V3, least: f32, most: f32) -> u32 {
    let square = v.dot(v);
    let limit = 0.09 * square;
    let zero = (v.x == 0.0) & (v.y == 0.0) & (v.z == 0.0);
    let certain = (square > least) & (square < most);
    let mut bits = 0;
    for (axis, value) in [v.x, v.y, v.z].into_iter().enumerate() {
        let far = u32::from(value * value > limit);
        let positive = u32::from(value > 0.0);
        bits |= (far & positive) << (2 * axis);
        bits |= (far & (positive ^ 1)) << (2 * axis + 1);
    }
    let bits = if certain { bits } else { 0 };
    if zero { TANGENT_DIRECTIONS } else { bits }
}
