//! A cut through the cell pyramid that serves a few directions, and the lobe's integral over it.

use glam::{DVec3, Vec3};

use super::cells::{Cell, CellLevel};
use super::cubemap::to_f32;
use super::ggx::mean_lobe_weight;
use super::simd::{self, Work};

/// Largest cell side in radians relative to the cut, whatever the lobe.
const LARGEST_CELL: f64 = 0.6;
/// Cells summed in f32 before the sums move to f64.
const CHUNK: usize = 512;
/// Sums side by side, whatever the width of the processor's vectors.
const LANES: usize = 16;

/// Cells of a cut, structure of arrays, padded with empty cells to whole lanes.
#[derive(Default)]
pub(super) struct CellList {
    centre: [Vec<f32>; 3],
    centroid: [Vec<f32>; 3],
    /// Of the centre, of the centroid.
    spread: [Vec<f32>; 2],
    solid_angle: Vec<f32>,
    /// Mean radiance times solid angle.
    light: [Vec<f32>; 3],
    stack: Vec<(usize, usize)>,
}

impl CellList {
    /// Collects the cells that serve every one of the directions.
    ///
    /// Distances are chords, which are never longer than angles: a cell counts as nearer than it is.
    pub fn gather(
        &mut self,
        pyramid: &[CellLevel<'_>],
        directions: &[DVec3],
        alpha: f64,
        cut: f64,
    ) {
        self.clear();
        let middle = directions.iter().sum::<DVec3>().normalize();
        let reach = directions
            .iter()
            .map(|direction| direction.distance(middle))
            .fold(0.0, f64::max) as f32;
        let middle = middle.as_vec3();
        let (largest, cut) = ((LARGEST_CELL * cut) as f32, cut as f32);
        let least_squared = (4.0 * alpha * alpha) as f32;
        self.stack
            .extend((0..pyramid[0].len()).map(|index| (0, index)));
        while let Some((depth, index)) = self.stack.pop() {
            let level = &pyramid[depth];
            // Bounds of a texel's side and half diagonal, met at the middle of a face.
            let side = 2.0 / level.size as f32;
            let radius = side * std::f32::consts::FRAC_1_SQRT_2;
            let cell = level.cell(index);
            let nearest = Vec3::from(cell.centre).distance(middle) - reach - radius;
            if nearest > std::f32::consts::SQRT_2 {
                continue;
            }
            let scale = (nearest.max(0.0) * nearest.max(0.0) + least_squared).sqrt();
            if depth + 1 == pyramid.len() || side <= largest.min(cut * scale) * cell.reach {
                self.push(&cell, level.solid_angle(index) as f32);
            } else {
                let children = level.children(index);
                self.stack.extend(children.map(|child| (depth + 1, child)));
            }
        }
        self.pad();
    }

    fn columns(&mut self) -> impl Iterator<Item = &mut Vec<f32>> {
        self.centre
            .iter_mut()
            .chain(&mut self.centroid)
            .chain(&mut self.spread)
            .chain(&mut self.light)
            .chain(std::iter::once(&mut self.solid_angle))
    }

    fn clear(&mut self) {
        self.columns().for_each(Vec::clear);
        self.stack.clear();
    }

    fn push(&mut self, cell: &Cell, angle: f32) {
        for axis in 0..3 {
            self.centre[axis].push(cell.centre[axis]);
            self.centroid[axis].push(cell.centroid[axis]);
            self.light[axis].push(cell.radiance[axis] * angle);
        }
        for (column, spread) in self.spread.iter_mut().zip(cell.spread) {
            column.push(spread);
        }
        self.solid_angle.push(angle);
    }

    fn pad(&mut self) {
        let length = self.solid_angle.len().next_multiple_of(LANES);
        self.columns().for_each(|column| column.resize(length, 0.0));
    }

    /// The lobe's mean of the cells' light about a direction.
    pub fn integrate(&self, normal: Vec3, alpha: f32) -> [f32; 3] {
        let (mut sum, mut weights) = (DVec3::ZERO, 0.0);
        let length = self.solid_angle.len();
        for start in (0..length).step_by(CHUNK) {
            let range = start..length.min(start + CHUNK);
            let sum_of_range = Sum {
                list: self,
                range,
                normal,
                alpha_squared: alpha * alpha,
            };
            let [r, g, b, weight] = simd::widest(sum_of_range)
                .map(|lanes| lanes.iter().map(|&lane| f64::from(lane)).sum::<f64>());
            sum += DVec3::new(r, g, b);
            weights += weight;
        }
        to_f32(sum / weights)
    }
}

/// The sums of light and weight over some of the cells.
struct Sum<'a> {
    list: &'a CellList,
    range: std::ops::Range<usize>,
    normal: Vec3,
    alpha_squared: f32,
}

impl Sum<'_> {
    #[inline(always)]
    fn weights(&self, axes: &[Vec<f32>; 3], spread: &[f32], at: usize) -> [f32; LANES] {
        let [x, y, z] = axes.each_ref().map(|axis| lanes(axis, at));
        let (spread, normal) = (lanes(spread, at), self.normal);
        let mut weights = [0.0; LANES];
        for k in 0..LANES {
            let (dx, dy, dz) = (normal.x - x[k], normal.y - y[k], normal.z - z[k]);
            let distance_squared = dx * dx + dy * dy + dz * dz;
            weights[k] = mean_lobe_weight(distance_squared, spread[k], self.alpha_squared);
        }
        weights
    }
}

impl Work for Sum<'_> {
    /// Red, green, blue, weight.
    type Output = [[f32; LANES]; 4];

    #[inline(always)]
    fn run(self) -> Self::Output {
        let list = self.list;
        let mut sums = [[0.0_f32; LANES]; 4];
        for at in self.range.clone().step_by(LANES) {
            let lit = self.weights(&list.centroid, &list.spread[1], at);
            let open = self.weights(&list.centre, &list.spread[0], at);
            let solid_angle = lanes(&list.solid_angle, at);
            for k in 0..LANES {
                sums[3][k] += open[k] * solid_angle[k];
            }
            for (sums, light) in sums.iter_mut().zip(&list.light) {
                let light = lanes(light, at);
                for k in 0..LANES {
                    sums[k] += lit[k] * light[k];
                }
            }
        }
        sums
    }
}

#[inline(always)]
fn lanes(column: &[f32], at: usize) -> [f32; LANES] {
    let mut values = [0.0; LANES];
    values.copy_from_slice(&column[at..at + LANES]);
    values
}
