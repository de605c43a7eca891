//! Cube maps: face directions, exact solid angles, mip filtering, half-float texel bytes.

use glam::DVec3;
use half::f16;
use rayon::prelude::*;

/// The largest finite half.
pub const HALF_MAX: f32 = 65504.0;

/// A cube map with mips, linear radiance, right-handed, Y up.
///
/// `levels[k]` holds 6 faces (+X, -X, +Y, -Y, +Z, -Z) of `(size >> k)^2` texels each,
/// face-major, rows from `t = -1`, with Vulkan's face directions ([`face_direction`]).
#[derive(Clone, Debug, PartialEq)]
pub struct Cube {
    pub size: u32,
    pub levels: Vec<Vec<[f32; 3]>>,
}

impl Cube {
    /// A cube with only its finest level.
    pub(super) fn single(size: u32, texels: Vec<[f32; 3]>) -> Self {
        Self {
            size,
            levels: vec![texels],
        }
    }

    /// Adds every level down to 1 texel per face by [`downsample`].
    pub(super) fn with_mips(mut self) -> Self {
        let mut size = self.size;
        while size > 1 {
            let Some(finest) = self.levels.last() else {
                break;
            };
            let coarser = downsample(finest, size);
            self.levels.push(coarser);
            size /= 2;
        }
        self
    }

    /// Side of a face at `level`, in texels.
    pub fn level_size(&self, level: usize) -> u32 {
        (self.size >> level.min(31)).max(1)
    }

    /// How many texels, over all levels, have a channel above [`HALF_MAX`].
    pub fn texels_above_half(&self) -> u64 {
        let above = |texel: &&[f32; 3]| texel.iter().any(|&channel| channel > HALF_MAX);
        self.levels
            .iter()
            .map(|level| level.iter().filter(above).count() as u64)
            .sum()
    }
}

/// The direction (not normalised) through face coordinates `s`, `t` in [-1, 1] (Vulkan 1.3,
/// "Cube Map Face Selection and Transformations").
pub fn face_direction(face: usize, s: f64, t: f64) -> [f64; 3] {
    match face {
        0 => [1.0, -t, -s],
        1 => [-1.0, -t, s],
        2 => [s, 1.0, t],
        3 => [s, -1.0, -t],
        4 => [s, -t, 1.0],
        _ => [-s, -t, -1.0],
    }
}

/// Face coordinate of the edge before texel `index`.
pub(super) fn edge_coordinate(index: usize, size: u32) -> f64 {
    2.0 * index as f64 / f64::from(size) - 1.0
}

/// Unit direction of a texel centre; `index` counts face-major within a level.
pub(super) fn texel_direction(index: usize, size: u32) -> DVec3 {
    let side = size as usize;
    let (face, within) = (index / (side * side), index % (side * side));
    let coordinate = |i: usize| (2.0 * i as f64 + 1.0) / f64::from(size) - 1.0;
    let [x, y, z] = face_direction(face, coordinate(within % side), coordinate(within / side));
    DVec3::new(x, y, z).normalize()
}

/// The texel of a level that a direction falls into.
pub(crate) fn texel_at(direction: DVec3, size: u32) -> usize {
    let DVec3 { x, y, z } = direction;
    let magnitude = direction.abs();
    let (face, s, t, major) = if magnitude.x >= magnitude.y && magnitude.x >= magnitude.z {
        if x > 0.0 {
            (0, -z, -y, magnitude.x)
        } else {
            (1, z, -y, magnitude.x)
        }
    } else if magnitude.y >= magnitude.z {
        if y > 0.0 {
            (2, x, z, magnitude.y)
        } else {
            (3, x, -z, magnitude.y)
        }
    } else if z > 0.0 {
        (4, x, -y, magnitude.z)
    } else {
        (5, -x, -y, magnitude.z)
    };
    let side = size as usize;
    let index = |c: f64| (((c / major * 0.5 + 0.5) * f64::from(size)) as usize).min(side - 1);
    (face * side + index(t)) * side + index(s)
}

/// Exact solid angles of the texels of one row of a face, in steradians.
pub(super) fn row_solid_angles(row: usize, size: u32) -> Vec<f64> {
    // Solid angle of the rectangle from the face centre to (s, t).
    let corner = |s: f64, t: f64| libm::atan2(s * t, (s * s + t * t + 1.0).sqrt());
    let (top, bottom) = (edge_coordinate(row, size), edge_coordinate(row + 1, size));
    let strip: Vec<f64> = (0..=size as usize)
        .map(|column| {
            let s = edge_coordinate(column, size);
            corner(s, bottom) - corner(s, top)
        })
        .collect();
    strip.windows(2).map(|pair| pair[1] - pair[0]).collect()
}

/// Exact solid angles of all texels of one face, row order.
pub(super) fn face_solid_angles(size: u32) -> Vec<f64> {
    (0..size as usize)
        .into_par_iter()
        .flat_map_iter(|row| row_solid_angles(row, size))
        .collect()
}

/// Halves a level (even `size`): each texel is the mean of its four children weighted by their
/// exact solid angles, so radiance times solid angle is kept.
pub(super) fn downsample(texels: &[[f32; 3]], size: u32) -> Vec<[f32; 3]> {
    let side = size as usize;
    let half = side / 2;
    (0..6 * half)
        .into_par_iter()
        .flat_map_iter(|strip| {
            let (face, row) = (strip / half, strip % half);
            let angles = [
                row_solid_angles(2 * row, size),
                row_solid_angles(2 * row + 1, size),
            ];
            (0..half).map(move |column| {
                let mut sum = DVec3::ZERO;
                let mut area = 0.0;
                for (k, angles) in angles.iter().enumerate() {
                    for x in [2 * column, 2 * column + 1] {
                        let texel = texels[(face * side + 2 * row + k) * side + x];
                        sum += to_f64(texel) * angles[x];
                        area += angles[x];
                    }
                }
                to_f32(sum / area)
            })
        })
        .collect()
}

/// Radiance times solid angle summed over a level.
pub(super) fn energy(texels: &[[f32; 3]], size: u32) -> DVec3 {
    let side = size as usize;
    let rows: Vec<DVec3> = (0..6 * side)
        .into_par_iter()
        .map(|strip| {
            let angles = row_solid_angles(strip % side, size);
            let row = &texels[strip * side..][..side];
            row.iter().zip(angles).map(|(&l, a)| to_f64(l) * a).sum()
        })
        .collect();
    rows.into_iter().sum()
}

pub(super) fn to_f64([r, g, b]: [f32; 3]) -> DVec3 {
    DVec3::new(f64::from(r), f64::from(g), f64::from(b))
}

pub(super) fn to_f32(value: DVec3) -> [f32; 3] {
    value.to_array().map(|channel| channel as f32)
}

/// Little-endian RGBA16F bytes of a level, alpha 1, 8 bytes per texel in the level's order.
///
/// Rounds to nearest even, clamps to [0, 65504]; NaN becomes 0.
pub fn level_to_rgba16f(texels: &[[f32; 3]]) -> Vec<u8> {
    let convert = |channel: f32| {
        let positive = if channel > 0.0 { channel } else { 0.0 };
        f16::from_f32(positive.min(HALF_MAX)).to_le_bytes()
    };
    texels
        .iter()
        .flat_map(|&[r, g, b]| [convert(r), convert(g), convert(b), f16::ONE.to_le_bytes()])
        .flatten()
        .collect()
}

#[cfg(test)]
mod tests {
    use std::f64::consts::PI;

    use super::*;

    #[test]
    fn solid_angles_cover_the_sphere_and_match_quadrature() {
        for size in [1_u32, 2, 7, 64, 512] {
            let total: f64 = face_solid_angles(size).iter().sum();
            assert!((6.0 * total - 4.0 * PI).abs() < 1e-10, "{size}: {total}");
        }
        let size = 8;
        let exact = row_solid_angles(1, size)[6];
        let mut sum = 0.0;
        let steps = 400;
        for i in 0..steps {
            for j in 0..steps {
                let fraction = |k: i32| (f64::from(k) + 0.5) / f64::from(steps);
                let s = (6.0 + fraction(i)) / 4.0 - 1.0;
                let t = (1.0 + fraction(j)) / 4.0 - 1.0;
                let square = 1.0 + s * s + t * t;
                sum += 0.0625 / f64::from(steps * steps) / (square * square.sqrt());
            }
        }
        assert!((sum / exact - 1.0).abs() < 1e-6);
    }

    #[test]
    fn directions_and_texels_are_inverse() {
        for size in [1_u32, 2, 5, 16] {
            for index in 0..6 * (size * size) as usize {
                assert_eq!(texel_at(texel_direction(index, size), size), index);
            }
        }
    }

    #[test]
    fn mips_keep_energy() {
        let size = 16;
        let texels: Vec<[f32; 3]> = (0..6 * 256)
            .map(|i| [(i % 17) as f32, if i == 300 { 1e6 } else { 1e-2 }, 0.0])
            .collect();
        let cube = Cube::single(size, texels).with_mips();
        assert_eq!(cube.levels.len(), 5);
        let full = energy(&cube.levels[0], size);
        for level in 1..5 {
            let coarse = energy(&cube.levels[level], cube.level_size(level));
            assert!((coarse / full).x - 1.0 < 1e-6 && 1.0 - (coarse / full).x < 1e-6);
            assert!(((coarse / full).y - 1.0).abs() < 1e-6);
            assert_eq!(coarse.z, 0.0);
        }
    }

    #[test]
    fn half_bytes_round_clamp_and_carry_alpha() {
        let bytes = level_to_rgba16f(&[
            [1.0, 70000.0, -1.0],
            [f32::NAN, 1.0 + 1.5 / 1024.0, 65519.0],
        ]);
        let halves: Vec<f32> = bytes
            .chunks_exact(2)
            .map(|pair| f16::from_le_bytes([pair[0], pair[1]]).to_f32())
            .collect();
        let even = 1.0 + 2.0 / 1024.0;
        assert_eq!(halves, [1.0, 65504.0, 0.0, 1.0, 0.0, even, 65504.0, 1.0]);
    }
}
