//! A pyramid of sky cells, each with the direction its radiance comes from.

use std::f64::consts::PI;

use glam::DVec3;
use rayon::prelude::*;

use super::cubemap::{
    Cube, downsample, energy, face_solid_angles, texel_direction, to_f32, to_f64,
};

/// One level of the pyramid; vectors are indexed like a cube level, face-major.
pub(super) struct CellLevel<'a> {
    pub size: u32,
    /// Exact solid angle of each texel of one face.
    pub solid_angles: Vec<f64>,
    cells: Cells<'a>,
    /// Mean of the sky, channels summed.
    mean: f32,
}

/// Cells of the finest level are derived from its texels when asked for: few of its many are.
enum Cells<'a> {
    Texels(&'a [[f32; 3]]),
    Kept(Vec<Cell>),
}

impl CellLevel<'_> {
    pub fn len(&self) -> usize {
        6 * self.solid_angles.len()
    }

    pub fn solid_angle(&self, index: usize) -> f64 {
        self.solid_angles[index % self.solid_angles.len()]
    }

    #[inline]
    pub fn cell(&self, index: usize) -> Cell {
        match &self.cells {
            Cells::Kept(cells) => cells[index],
            Cells::Texels(texels) => {
                let moment = texel_moment(texels, self.size, index, self.solid_angle(index));
                Cell::new(texels[index], &moment, self.solid_angle(index), self.mean)
            }
        }
    }

    /// The cells of the next finer level that one covers.
    pub fn children(&self, index: usize) -> [usize; 4] {
        let side = self.size as usize;
        let first = 4 * (index / side) * side + 2 * (index % side);
        [first, first + 1, first + 2 * side, first + 2 * side + 1]
    }
}

/// One texel of the sky.
///
/// A mean of unit directions is shorter than 1 by half their variance, which the kernels use: a weight is right to
/// third order however unevenly the radiance lies within the cell, and a sun smaller than its cell is seen where it
/// is, as small as it is.
#[derive(Clone, Copy)]
pub(super) struct Cell {
    /// Mean radiance.
    pub radiance: [f32; 3],
    /// Mean direction of the cell's area.
    pub centre: [f32; 3],
    /// Mean direction weighted by radiance (sum of channels); `centre` where black.
    pub centroid: [f32; 3],
    /// Variance of the directions: `1 - |centre|^2`, `1 - |centroid|^2`.
    pub spread: [f32; 2],
    /// Cell side that serves this radiance, relative to that of a cell as bright as the mean: the error of a
    /// cell is its light times its side squared, so bright cells are split further.
    pub reach: f32,
}

/// Least [`Cell::reach`].
const LEAST_REACH: f32 = 0.25;

impl Cell {
    fn new(radiance: [f32; 3], moment: &Moment, angle: f64, mean: f32) -> Self {
        let light: f32 = radiance.iter().sum();
        let centre = moment.area / angle;
        let centroid = if light > 0.0 {
            moment.light / (angle * to_f64(radiance).element_sum())
        } else {
            centre
        };
        let reach = if light > mean {
            (mean / light).sqrt().sqrt()
        } else {
            1.0
        };
        Self {
            reach: reach.max(LEAST_REACH),
            radiance,
            centre: to_f32(centre),
            centroid: to_f32(centroid),
            spread: [centre, centroid].map(|mean| (1.0 - mean.length_squared()).max(0.0) as f32),
        }
    }
}

/// Levels from coarse (at least `coarsest` texels a side) to the cube's `finest`.
pub(super) fn build(cube: &Cube, finest: usize, coarsest: u32) -> Vec<CellLevel<'_>> {
    let mut size = cube.level_size(finest);
    let texels = &cube.levels[finest];
    let mean = (energy(texels, size).element_sum() / (4.0 * PI)) as f32;
    let mut levels = vec![CellLevel {
        size,
        solid_angles: face_solid_angles(size),
        cells: Cells::Texels(texels),
        mean,
    }];
    let mut moments: Vec<Moment> = Vec::new();
    let mut radiance: Vec<[f32; 3]> = Vec::new();
    while size > coarsest && size.is_multiple_of(2) {
        let finer = &levels[levels.len() - 1];
        (moments, radiance) = match finer.cells {
            Cells::Texels(texels) => {
                let moment = |index| texel_moment(texels, size, index, finer.solid_angle(index));
                (halve(moment, size), downsample(texels, size))
            }
            Cells::Kept(_) => (
                halve(|index| moments[index], size),
                downsample(&radiance, size),
            ),
        };
        size /= 2;
        levels.push(level(size, &radiance, &moments, mean));
    }
    levels.reverse();
    levels
}

/// Direction integrated over a cell: plain, weighted by radiance.
#[derive(Clone, Copy)]
struct Moment {
    area: DVec3,
    light: DVec3,
}

/// A texel is a square of its area, alight evenly: its variance is a sixth of the area.
fn texel_moment(texels: &[[f32; 3]], size: u32, index: usize, angle: f64) -> Moment {
    let area = texel_direction(index, size) * (angle * (1.0 - angle / 12.0));
    Moment {
        area,
        light: area * to_f64(texels[index]).element_sum(),
    }
}

fn halve(moment: impl Fn(usize) -> Moment + Sync, size: u32) -> Vec<Moment> {
    let side = size as usize;
    let half = side / 2;
    (0..6 * half * half)
        .into_par_iter()
        .map(|index| {
            let (strip, column) = (index / half, index % half);
            let first = 2 * strip * side + 2 * column;
            let children = [first, first + 1, first + side, first + side + 1].map(&moment);
            Moment {
                area: children.iter().map(|child| child.area).sum(),
                light: children.iter().map(|child| child.light).sum(),
            }
        })
        .collect()
}

fn level<'a>(size: u32, texels: &[[f32; 3]], moments: &[Moment], mean: f32) -> CellLevel<'a> {
    let solid_angles = face_solid_angles(size);
    let cells = (0..texels.len())
        .into_par_iter()
        .map(|index| {
            let angle = solid_angles[index % solid_angles.len()];
            Cell::new(texels[index], &moments[index], angle, mean)
        })
        .collect();
    CellLevel {
        size,
        solid_angles,
        cells: Cells::Kept(cells),
        mean,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_sun_stays_where_it_is_in_every_level() {
        let size = 64;
        let sun = 2 * 4096 + 17 * 64 + 41;
        let mut texels = vec![[0.0; 3]; 6 * 4096];
        texels[sun] = [5.0, 0.0, 1.0];
        let cube = Cube::single(size, texels);
        let direction = texel_direction(sun, size);
        let levels = build(&cube, 0, 4);
        assert_eq!(levels.len(), 5);
        for level in &levels {
            let cells = (0..level.len()).map(|index| level.cell(index));
            let lit: Vec<Cell> = cells.filter(|cell| cell.radiance[0] > 0.0).collect();
            assert_eq!(lit.len(), 1);
            assert!((to_f64(lit[0].centroid) - direction).length() < 1e-4);
            assert!(lit[0].spread[1] < 1e-3 * lit[0].spread[0].max(0.2));
        }
    }
}
