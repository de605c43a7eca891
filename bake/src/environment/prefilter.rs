//! Specular prefiltering: every texel integrates the GGX lobe over the whole sky.

use glam::{DVec3, Vec3};
use rayon::prelude::*;

use super::cells::CellLevel;
use super::cubemap::{texel_direction, to_f32, to_f64};
use super::ggx::lobe_weight_f32;
use super::verify::probe_texels;

/// Cell sides allowed relative to the lobe's local scale `sqrt(angle^2 + (2 alpha)^2)`, coarsest first.
const CUTS: [f64; 8] = [0.8, 0.56, 0.4, 0.28, 0.2, 0.14, 0.1, 0.07];
/// Cut that stands for the truth when one of [`CUTS`] is chosen.
const FINEST_CUT: f64 = 0.05;
/// Largest cell side in radians relative to the cut, whatever the lobe.
const LARGEST_CELL: f64 = 0.6;
/// Directions at which a cut is tried.
const TRIALS: usize = 24;
/// Share of the bound that a trial may use: it sees few directions.
const SAFETY: f64 = 0.5;
/// Side of the level the search starts from.
pub(super) const COARSEST_CELLS: u32 = 8;
/// Output texels per side of a tile; a tile shares one list of cells.
const TILE: usize = 4;
/// Cells summed in f32 before the sums move to f64.
const CHUNK: usize = 256;
const LANES: usize = 8;

/// Roughness of a level: 0 at the finest, 1 at the coarsest.
pub fn level_roughness(level: usize, levels: usize) -> f64 {
    if levels > 1 {
        level as f64 / (levels - 1) as f64
    } else {
        0.0
    }
}

/// Radiance filtered by the lobe of [`lobe_weight_f32`] about every texel's direction.
///
/// No sampling: each output integrates a cut through the cell pyramid that covers its whole
/// hemisphere, fine near the lobe's peak and coarser along its tails, so no light is missed and
/// the result has no noise. Weights are normalised per texel by the same cut.
pub(super) fn prefilter(pyramid: &[CellLevel], size: u32, alpha: f64, cut: f64) -> Vec<[f32; 3]> {
    let side = size as usize;
    let tile = TILE.min(side);
    let tiles = side / tile;
    let blocks: Vec<Vec<[f32; 3]>> = (0..6 * tiles * tiles)
        .into_par_iter()
        .map_init(CellList::default, |list, block| {
            let (face, row, column) = (
                block / (tiles * tiles),
                block / tiles % tiles,
                block % tiles,
            );
            let directions: Vec<DVec3> = (0..tile * tile)
                .map(|k| {
                    let (x, y) = (column * tile + k % tile, row * tile + k / tile);
                    texel_direction((face * side + y) * side + x, size)
                })
                .collect();
            list.gather(pyramid, &directions, alpha, cut);
            directions
                .iter()
                .map(|&direction| list.integrate(direction.as_vec3(), alpha as f32))
                .collect()
        })
        .collect();
    let mut texels = vec![[0.0; 3]; 6 * side * side];
    for (block, values) in blocks.iter().enumerate() {
        let (face, row, column) = (
            block / (tiles * tiles),
            block / tiles % tiles,
            block % tiles,
        );
        for (k, value) in values.iter().enumerate() {
            let (x, y) = (column * tile + k % tile, row * tile + k / tile);
            texels[(face * side + y) * side + x] = *value;
        }
    }
    texels
}

/// The coarsest cut whose relative RMS difference from the finest stays well within `bound`, tried at a few
/// directions of a level of the given side.
pub(super) fn choose_cut(pyramid: &[CellLevel], size: u32, alpha: f64, bound: f64) -> f64 {
    let probes = probe_texels(TRIALS, size);
    let values = |cut: f64| -> Vec<DVec3> {
        let value = |list: &mut CellList, &index: &usize| {
            let direction = texel_direction(index, size);
            list.gather(pyramid, &[direction], alpha, cut);
            to_f64(list.integrate(direction.as_vec3(), alpha as f32))
        };
        probes
            .par_iter()
            .map_init(CellList::default, value)
            .collect()
    };
    let truth = values(FINEST_CUT);
    let scale: f64 = truth.iter().map(|value| value.length_squared()).sum();
    let fits = |cut: f64| {
        let pairs = values(cut).into_iter().zip(&truth);
        let error: f64 = pairs
            .map(|(value, truth)| (value - *truth).length_squared())
            .sum();
        error <= scale * (SAFETY * bound) * (SAFETY * bound)
    };
    CUTS.into_iter()
        .find(|&cut| fits(cut))
        .unwrap_or(FINEST_CUT)
}

/// A cut through the pyramid, structure of arrays, padded with empty cells to whole lanes.
#[derive(Default)]
struct CellList {
    centre: [Vec<f32>; 3],
    centroid: [Vec<f32>; 3],
    solid_angle: Vec<f32>,
    /// Mean radiance times solid angle.
    light: [Vec<f32>; 3],
    stack: Vec<(usize, usize)>,
}

impl CellList {
    /// Collects the cells that serve every one of the tile's directions.
    ///
    /// Distances are chords, which are never longer than angles: a cell counts as nearer than it is.
    fn gather(&mut self, pyramid: &[CellLevel], directions: &[DVec3], alpha: f64, cut: f64) {
        self.clear();
        let middle = directions.iter().sum::<DVec3>().normalize();
        let tile_radius = directions
            .iter()
            .map(|direction| direction.distance(middle))
            .fold(0.0, f64::max);
        let largest = LARGEST_CELL * cut;
        self.stack
            .extend((0..pyramid[0].cells.len()).map(|index| (0, index)));
        while let Some((depth, index)) = self.stack.pop() {
            let level = &pyramid[depth];
            // Bounds of a texel's side and half diagonal, met at the middle of a face.
            let side = 2.0 / f64::from(level.size);
            let radius = side * std::f64::consts::FRAC_1_SQRT_2;
            let centre = Vec3::from(level.cells[index].centre).as_dvec3();
            let nearest = centre.distance(middle) - tile_radius - radius;
            if nearest > std::f64::consts::SQRT_2 {
                continue;
            }
            let scale = (nearest.max(0.0) * nearest.max(0.0) + 4.0 * alpha * alpha).sqrt();
            if depth + 1 == pyramid.len()
                || side <= largest.min(cut * scale) * f64::from(level.cells[index].reach)
            {
                self.push(level, index);
            } else {
                let side = level.size as usize;
                let (strip, column) = (index / side, index % side);
                let first = 4 * strip * side + 2 * column;
                for child in [first, first + 1, first + 2 * side, first + 2 * side + 1] {
                    self.stack.push((depth + 1, child));
                }
            }
        }
        self.pad();
    }

    fn columns(&mut self) -> impl Iterator<Item = &mut Vec<f32>> {
        self.centre
            .iter_mut()
            .chain(&mut self.centroid)
            .chain(&mut self.light)
            .chain(std::iter::once(&mut self.solid_angle))
    }

    fn clear(&mut self) {
        self.columns().for_each(Vec::clear);
        self.stack.clear();
    }

    fn push(&mut self, level: &CellLevel, index: usize) {
        let cell = &level.cells[index];
        let angle = level.solid_angles[index % level.solid_angles.len()] as f32;
        for axis in 0..3 {
            self.centre[axis].push(cell.centre[axis]);
            self.centroid[axis].push(cell.centroid[axis]);
            self.light[axis].push(cell.radiance[axis] * angle);
        }
        self.solid_angle.push(angle);
    }

    fn pad(&mut self) {
        let length = self.solid_angle.len().next_multiple_of(LANES);
        self.columns().for_each(|column| column.resize(length, 0.0));
    }

    fn integrate(&self, normal: Vec3, alpha: f32) -> [f32; 3] {
        let (mut sum, mut weights) = (DVec3::ZERO, 0.0);
        let length = self.solid_angle.len();
        for start in (0..length).step_by(CHUNK) {
            let (light, weight) =
                self.integrate_chunk(start, length.min(start + CHUNK), normal, alpha);
            sum += light;
            weights += weight;
        }
        to_f32(sum / weights)
    }

    fn integrate_chunk(&self, start: usize, end: usize, normal: Vec3, alpha: f32) -> (DVec3, f64) {
        let mut lanes = [[0.0_f32; LANES]; 4];
        let lane = |column: &[f32], at: usize| -> [f32; LANES] {
            let mut values = [0.0; LANES];
            values.copy_from_slice(&column[at..at + LANES]);
            values
        };
        let weights_at = |axes: &[Vec<f32>; 3], at: usize| -> [f32; LANES] {
            let (x, y, z) = (lane(&axes[0], at), lane(&axes[1], at), lane(&axes[2], at));
            let mut weights = [0.0; LANES];
            for k in 0..LANES {
                let (dx, dy, dz) = (normal.x - x[k], normal.y - y[k], normal.z - z[k]);
                weights[k] = lobe_weight_f32(dx * dx + dy * dy + dz * dz, alpha);
            }
            weights
        };
        for at in (start..end).step_by(LANES) {
            let lit = weights_at(&self.centroid, at);
            let open = weights_at(&self.centre, at);
            let solid_angle = lane(&self.solid_angle, at);
            for k in 0..LANES {
                lanes[3][k] += open[k] * solid_angle[k];
            }
            for (lane_sums, light) in lanes.iter_mut().zip(&self.light) {
                let light = lane(light, at);
                for k in 0..LANES {
                    lane_sums[k] += lit[k] * light[k];
                }
            }
        }
        let total = |lane: [f32; LANES]| lane.iter().map(|&value| f64::from(value)).sum::<f64>();
        let [r, g, b, weight] = lanes.map(total);
        (DVec3::new(r, g, b), weight)
    }
}
