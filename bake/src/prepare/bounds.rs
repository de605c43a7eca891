//! World bounds of instances that hold whatever rounding a GPU does.
//!
//! A GPU evaluates `m0 p0 + m1 p1 + m2 p2 + t` in f32, in any order, fused or not, and may flush subnormals to zero.
//! Each addition rounds a value of magnitude at most S, the sum of the terms' magnitudes, and each product rounds
//! itself. With u = 2^-24 the result is within `3 halfulp(S) + u S` of the truth (Higham 2002, section 3.1, with the
//! additions counted in half ulp rather than in u), less where terms vanish. That is 2.5 ulp of S at most, and
//! rounding outward adds one: 3.5 ulp of the largest coordinate, unless large terms cancel.

use cairn_format::{Aabb, Vertex};
use glam::Vec3;

/// Half the spacing of f32 just below 1.
const UNIT_ROUNDOFF: f64 = 1.0 / (1u64 << 24) as f64;
/// Covers that intermediate results are rounded too, and the rounding of the f64 evaluation.
const INFLATION: f64 = 1.0 + 1.0 / (1u64 << 20) as f64;
/// Eight flushed intermediate results: three products, three sums, the translation, the result.
const FLUSHED: f64 = 8.0 * f32::MIN_POSITIVE as f64;
const BLOCK: usize = 64;

/// The vertices of a primitive, grouped so that most need not be transformed.
pub(super) struct Cloud<'a> {
    vertices: &'a [Vertex],
    /// Bounds of every run of [`BLOCK`] vertices.
    blocks: Vec<Extent>,
    whole: Extent,
    /// Largest magnitude of a subnormal coordinate per axis: what flushing may take away.
    subnormal: [f64; 3],
}

/// Bounds of an instance.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct WorldBounds {
    pub(super) aabb: Aabb,
    /// Distance from the bounds of the exactly transformed vertices, at most, in ulp of the axis's largest coordinate.
    pub(super) slack_ulp: f64,
}

#[derive(Clone, Copy)]
struct Extent {
    min: [f32; 3],
    max: [f32; 3],
}

impl Extent {
    /// Bounds of a run that is not empty.
    fn of(vertices: &[Vertex]) -> Self {
        let none = Self {
            min: [f32::INFINITY; 3],
            max: [f32::NEG_INFINITY; 3],
        };
        vertices.iter().fold(none, |extent, vertex| Self {
            min: std::array::from_fn(|axis| extent.min[axis].min(vertex.position[axis])),
            max: std::array::from_fn(|axis| extent.max[axis].max(vertex.position[axis])),
        })
    }

    fn magnitude(&self, axis: usize) -> f64 {
        f64::from(self.min[axis].abs().max(self.max[axis].abs()))
    }
}

/// One row of a model matrix with the error of its evaluation.
struct Row {
    linear: [f64; 3],
    translation: f64,
    /// Additions that may round.
    additions: f64,
    /// Unit roundoff of the products, 0 where they are exact.
    products: f64,
    /// What flushing to zero may change.
    flush: f64,
}

impl Row {
    fn new(model: &[[f32; 4]; 4], row: usize, cloud: &Cloud) -> Self {
        let elements: [f32; 3] = std::array::from_fn(|column| model[column][row]);
        let translation = model[3][row];
        let terms = elements
            .iter()
            .chain([&translation])
            .filter(|value| **value != 0.0)
            .count();
        // A product with zero or one is exact; other powers of two may underflow.
        let copies = elements
            .iter()
            .all(|value| *value == 0.0 || value.abs() == 1.0);
        let mut flush = if copies && terms <= 1 { 0.0 } else { FLUSHED };
        if translation.is_subnormal() {
            flush += f64::from(translation.abs());
        }
        for (axis, element) in elements.iter().enumerate() {
            let lost = if element.is_subnormal() {
                cloud.whole.magnitude(axis)
            } else {
                cloud.subnormal[axis]
            };
            flush += f64::from(element.abs()) * lost;
        }
        Self {
            linear: elements.map(f64::from),
            translation: translation.into(),
            additions: terms.saturating_sub(1) as f64,
            products: if copies { 0.0 } else { UNIT_ROUNDOFF },
            flush,
        }
    }

    /// Largest difference between the truth and f32, for terms whose magnitudes sum to `sum`.
    fn error(&self, sum: f64) -> f64 {
        let sum = sum * INFLATION;
        if sum == 0.0 {
            return 0.0;
        }
        self.additions * half_ulp(sum) + self.products * sum + self.flush
    }

    fn sum(&self, point: [f64; 3]) -> f64 {
        let [a, b, c] = self.linear;
        a * point[0] + b * point[1] + c * point[2] + self.translation
    }

    fn magnitude(&self, point: [f64; 3]) -> f64 {
        let [a, b, c] = self.linear.map(f64::abs);
        a * point[0].abs() + b * point[1].abs() + c * point[2].abs() + self.translation.abs()
    }

    /// Bounds of what every vertex inside `extent` may give. The operations are those of a vertex, and rounding is
    /// monotone: no vertex inside exceeds them, not even by a bit.
    fn reach(&self, extent: &Extent) -> (f64, f64) {
        let pick = |upper: bool| -> [f64; 3] {
            std::array::from_fn(|axis| {
                let positive = self.linear[axis] >= 0.0;
                let value = if positive == upper {
                    extent.max[axis]
                } else {
                    extent.min[axis]
                };
                f64::from(value)
            })
        };
        let farthest = std::array::from_fn(|axis| extent.magnitude(axis));
        let error = self.error(self.magnitude(farthest));
        (self.sum(pick(false)) - error, self.sum(pick(true)) + error)
    }
}

/// Half the spacing of the f32 values of `value`'s binade.
fn half_ulp(value: f64) -> f64 {
    const EXPONENT: u64 = 0x7FF0_0000_0000_0000;
    f64::from_bits(value.to_bits() & EXPONENT) * UNIT_ROUNDOFF
}

/// Interval along one world axis: with the error of f32, and without.
#[derive(Clone, Copy)]
struct Interval {
    low: f64,
    high: f64,
    true_low: f64,
    true_high: f64,
}

impl Interval {
    const EMPTY: Self = Self {
        low: f64::INFINITY,
        high: f64::NEG_INFINITY,
        true_low: f64::INFINITY,
        true_high: f64::NEG_INFINITY,
    };

    fn include(&mut self, row: &Row, point: [f64; 3]) {
        let (value, error) = (row.sum(point), row.error(row.magnitude(point)));
        self.low = self.low.min(value - error);
        self.high = self.high.max(value + error);
        self.true_low = self.true_low.min(value);
        self.true_high = self.true_high.max(value);
    }

    /// Bounds in f32, rounded outward, and their slack in ulp of the largest coordinate.
    fn rounded(&self) -> (f32, f32, f64) {
        let (low, high) = (-round_up(-self.low), round_up(self.high));
        let largest = self.true_low.abs().max(self.true_high.abs());
        let ulp = 2.0 * half_ulp(largest.max(f32::MIN_POSITIVE.into()));
        let slack = (self.true_low - f64::from(low)).max(f64::from(high) - self.true_high);
        (low, high, slack / ulp)
    }
}

/// The least f32 that is not below `value`.
fn round_up(value: f64) -> f32 {
    let nearest = value as f32;
    if f64::from(nearest) < value {
        nearest.next_up()
    } else {
        nearest
    }
}

impl<'a> Cloud<'a> {
    /// Groups the vertices of a primitive, of which there is at least one.
    pub(super) fn new(vertices: &'a [Vertex]) -> Self {
        let mut subnormal = [0.0; 3];
        for vertex in vertices {
            for (axis, value) in vertex.position.iter().enumerate() {
                if value.is_subnormal() {
                    subnormal[axis] = f64::max(subnormal[axis], value.abs().into());
                }
            }
        }
        Self {
            vertices,
            blocks: vertices.chunks(BLOCK).map(Extent::of).collect(),
            whole: Extent::of(vertices),
            subnormal,
        }
    }

    /// Bounds of the vertices under `model`; `None` where f32 arithmetic may overflow.
    pub(super) fn world_bounds(&self, model: &[[f32; 4]; 4]) -> Option<WorldBounds> {
        let rows: [Row; 3] = std::array::from_fn(|row| Row::new(model, row, self));
        let farthest = std::array::from_fn(|axis| self.whole.magnitude(axis));
        if rows
            .iter()
            .any(|row| row.magnitude(farthest) * INFLATION >= f64::from(f32::MAX))
        {
            return None;
        }
        let mut axes = [Interval::EMPTY; 3];
        for block in self.promising(&rows) {
            self.include(block, &rows, &mut axes);
        }
        for (block, extent) in self.blocks.iter().enumerate() {
            let outside = |(row, axis): (&Row, &Interval)| {
                let (low, high) = row.reach(extent);
                low < axis.low || high > axis.high
            };
            if rows.iter().zip(&axes).any(outside) {
                self.include(block, &rows, &mut axes);
            }
        }
        let [x, y, z] = axes.map(|axis| axis.rounded());
        Some(WorldBounds {
            aabb: Aabb {
                min: Vec3::new(x.0, y.0, z.0),
                max: Vec3::new(x.1, y.1, z.1),
            },
            slack_ulp: x.2.max(y.2).max(z.2),
        })
    }

    /// The block that reaches farthest in each of the six directions: most others then lie within.
    fn promising(&self, rows: &[Row; 3]) -> [usize; 6] {
        let mut best = [(f64::NEG_INFINITY, 0); 6];
        for (block, extent) in self.blocks.iter().enumerate() {
            for (axis, row) in rows.iter().enumerate() {
                let (low, high) = row.reach(extent);
                for (direction, reach) in [(axis, -low), (axis + 3, high)] {
                    if reach > best[direction].0 {
                        best[direction] = (reach, block);
                    }
                }
            }
        }
        best.map(|(_, block)| block)
    }

    fn include(&self, block: usize, rows: &[Row; 3], axes: &mut [Interval; 3]) {
        let start = block * BLOCK;
        let end = (start + BLOCK).min(self.vertices.len());
        for vertex in &self.vertices[start..end] {
            let point = vertex.position.map(f64::from);
            for (row, axis) in rows.iter().zip(axes.iter_mut()) {
                axis.include(row, point);
            }
        }
    }
}

#[cfg(test)]
#[path = "bounds_tests.rs"]
mod tests;
