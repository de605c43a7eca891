//! Diffuse irradiance cube: the cosine integral over the whole sky.

use glam::{DVec3, Vec3};
use rayon::prelude::*;

use super::cells::CellLevel;
use super::cubemap::{texel_direction, to_f32};

/// Irradiance divided by pi for the normal of every texel of a cube of the given side.
///
/// Sums `max(0, n.l)` over all cells of the level; since the cosine is linear in `l`, a cell's
/// centroid gives its exact contribution wherever the horizon does not cross it. The
/// normalisation is summed the same way, so a constant sky is reproduced.
pub(super) fn irradiance(sky: &CellLevel, size: u32) -> Vec<[f32; 3]> {
    let per_face = sky.solid_angles.len();
    (0..6 * (size * size) as usize)
        .into_par_iter()
        .map(|index| {
            let normal = texel_direction(index, size).as_vec3();
            let (mut sum, mut weights) = (DVec3::ZERO, 0.0);
            for face in sky.cells.chunks_exact(per_face) {
                for (cell, &angle) in face.iter().zip(&sky.solid_angles) {
                    let lit = f64::from(normal.dot(Vec3::from(cell.centroid)).max(0.0)) * angle;
                    let open = f64::from(normal.dot(Vec3::from(cell.centre)).max(0.0)) * angle;
                    sum += Vec3::from(cell.radiance).as_dvec3() * lit;
                    weights += open;
                }
            }
            to_f32(sum / weights)
        })
        .collect()
}
