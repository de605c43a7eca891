//! Diffuse irradiance cube: the cosine integral over the whole sky.

use glam::{DMat3, DVec3};
use rayon::prelude::*;

use super::cells::CellLevel;
use super::cubemap::{texel_direction, to_f32, to_f64};

/// Irradiance divided by pi for the normal of every texel of a cube of the given side.
///
/// The cosine is linear in the direction, so that the first moments of a cell give its exact contribution, however
/// large it is, wherever the horizon does not cross it: only cells that it crosses are split, down to those of the
/// level given. The normalisation is summed the same way, so a constant sky is reproduced.
pub(super) fn irradiance(sky: &CellLevel<'_>, size: u32) -> Vec<[f32; 3]> {
    let pyramid = pyramid(sky);
    let coarsest = &pyramid[pyramid.len() - 1];
    (0..6 * (size * size) as usize)
        .into_par_iter()
        .map_init(Vec::new, |stack, index| {
            let normal = texel_direction(index, size);
            let (mut light, mut open) = (DVec3::ZERO, 0.0);
            stack.extend((0..coarsest.moments.len()).map(|cell| (pyramid.len() - 1, cell)));
            while let Some((depth, cell)) = stack.pop() {
                let level = &pyramid[depth];
                let moment = &level.moments[cell];
                let height = normal.dot(moment.centre);
                // Half the diagonal of a texel at the middle of a face, where it is longest.
                let radius = std::f64::consts::SQRT_2 / level.side as f64;
                let crossed = height.abs() < radius;
                if crossed && depth > 0 {
                    stack.extend(level.children(cell).map(|child| (depth - 1, child)));
                } else if height > 0.0 {
                    light += (moment.light * normal).max(DVec3::ZERO);
                    open += normal.dot(moment.area);
                }
            }
            to_f32(light / open)
        })
        .collect()
}

/// Cells of one size.
struct Level {
    side: usize,
    moments: Vec<Moment>,
}

impl Level {
    /// Cells of the next finer level.
    fn children(&self, cell: usize) -> [usize; 4] {
        let first = 4 * (cell / self.side) * self.side + 2 * (cell % self.side);
        let below = first + 2 * self.side;
        [first, first + 1, below, below + 1]
    }
}

/// Integrals over a cell.
#[derive(Clone, Copy)]
struct Moment {
    /// Direction to the middle, of unit length.
    centre: DVec3,
    /// Of direction.
    area: DVec3,
    /// Of radiance times direction: a row a channel.
    light: DMat3,
}

/// Levels from the one given to four cells a face side.
fn pyramid(sky: &CellLevel<'_>) -> Vec<Level> {
    let finest = (0..sky.len()).map(|index| {
        let (cell, angle) = (sky.cell(index), sky.solid_angle(index));
        let area = to_f64(cell.centre) * angle;
        let light = to_f64(cell.centroid) * angle;
        let radiance = to_f64(cell.radiance);
        Moment {
            centre: to_f64(cell.centre).normalize(),
            area,
            light: DMat3::from_cols(radiance * light.x, radiance * light.y, radiance * light.z),
        }
    });
    let mut levels = vec![Level {
        side: sky.size as usize,
        moments: finest.collect(),
    }];
    while levels[levels.len() - 1].side > 4 && levels[levels.len() - 1].side.is_multiple_of(2) {
        let finer = &levels[levels.len() - 1];
        let side = finer.side / 2;
        let mut coarser = Level {
            side,
            moments: Vec::with_capacity(6 * side * side),
        };
        for cell in 0..6 * side * side {
            let children = coarser.children(cell).map(|child| finer.moments[child]);
            let area: DVec3 = children.iter().map(|child| child.area).sum();
            coarser.moments.push(Moment {
                centre: area.normalize(),
                area,
                light: children
                    .iter()
                    .fold(DMat3::ZERO, |sum, child| sum + child.light),
            });
        }
        levels.push(coarser);
    }
    levels
}
