//! Lattices of directions coarser than a cube level, and the level interpolated from them.

use glam::DVec3;
use rayon::prelude::*;

use super::cubemap::{face_direction, to_f32, to_f64};

/// Points of a Lagrange polynomial.
const ORDER: usize = 8;
/// Points beyond a face's edge, so that polynomials never leave the lattice.
const MARGIN: usize = ORDER / 2;

/// Texels are at least this share of the darkest point about them: a dip between points is shallow.
const LEAST_SHARE: f64 = 0.99;

/// Texel centres of a cube level, with a margin of points beyond each face's edges in the plane of the face.
pub(super) struct Lattice {
    /// Points per side within a face.
    pub size: u32,
    margin: usize,
}

impl Lattice {
    /// The texel centres of a level.
    pub fn whole(size: u32) -> Self {
        Self { size, margin: 0 }
    }

    /// One point for `ratio * ratio` texels of a level, from which the level can be interpolated.
    pub fn around(size: u32, ratio: u32) -> Self {
        Self {
            size: size / ratio,
            margin: MARGIN,
        }
    }

    /// Points per side.
    pub fn side(&self) -> usize {
        self.size as usize + 2 * self.margin
    }

    /// Whether it has clearly fewer points than a level.
    pub fn saves(&self, size: u32) -> bool {
        self.size as usize >= ORDER && 4 * self.side().pow(2) < 3 * (size as usize).pow(2)
    }

    /// Unit direction of a point.
    pub fn direction(&self, face: usize, x: usize, y: usize) -> DVec3 {
        let coordinate =
            |at: usize| (2.0 * (at as f64 - self.margin as f64) + 1.0) / f64::from(self.size) - 1.0;
        DVec3::from(face_direction(face, coordinate(x), coordinate(y))).normalize()
    }
}

/// Where a texel lies among the points of a row: the first of its polynomial, and the weights.
struct Stencil {
    first: usize,
    weights: [f64; ORDER],
}

/// A level from values on a lattice of [`Lattice::around`], by polynomials along rows and columns of each face.
///
/// No texel is clearly darker than the darkest of the sixteen points about it, as polynomials overshoot beside a lamp.
pub(super) fn interpolate(values: &[[f32; 3]], lattice: &Lattice, size: u32) -> Vec<[f32; 3]> {
    let (points, side) = (lattice.side(), size as usize);
    let stencils: Vec<Stencil> = (0..side).map(|at| stencil(at, lattice, size)).collect();
    let along = |row: &[DVec3], stencil: &Stencil| -> DVec3 {
        let values = &row[stencil.first..][..ORDER];
        values
            .iter()
            .zip(stencil.weights)
            .map(|(value, weight)| *value * weight)
            .sum()
    };
    let faces: Vec<Vec<[f32; 3]>> = (0..6)
        .into_par_iter()
        .map(|face| {
            let values = &values[face * points * points..][..points * points];
            // Rows of the lattice at the columns of the level, stored by column.
            let mut columns = vec![DVec3::ZERO; side * points];
            for y in 0..points {
                let row: Vec<DVec3> = values[y * points..][..points]
                    .iter()
                    .map(|&value| to_f64(value))
                    .collect();
                for (x, stencil) in stencils.iter().enumerate() {
                    columns[x * points + y] = along(&row, stencil);
                }
            }
            let texel = |index: usize| {
                let (x, y) = (index % side, index / side);
                let value = along(&columns[x * points..][..points], &stencils[y]);
                let least = darkest(values, points, stencils[x].first, stencils[y].first);
                to_f32(value.max(least * LEAST_SHARE))
            };
            (0..side * side).map(texel).collect()
        })
        .collect();
    faces.concat()
}

fn darkest(values: &[[f32; 3]], points: usize, left: usize, top: usize) -> DVec3 {
    let near = ORDER / 2 - 2..ORDER / 2 + 2;
    let rows = near
        .clone()
        .map(|y| &values[(top + y) * points + left..][..ORDER]);
    let texels = rows.flat_map(|row| &row[near.clone()]);
    texels
        .map(|&value| to_f64(value))
        .fold(DVec3::INFINITY, DVec3::min)
}

fn stencil(texel: usize, lattice: &Lattice, size: u32) -> Stencil {
    // The texel's centre in points, the first of the face's own at `margin`.
    let ratio = f64::from(size / lattice.size);
    let at = (texel as f64 + 0.5) / ratio - 0.5 + lattice.margin as f64;
    let first = libm::floor(at) as usize + 1 - ORDER / 2;
    let offset = at - first as f64;
    let weights = std::array::from_fn(|k| {
        let others = (0..ORDER).filter(|&j| j != k);
        others
            .map(|j| (offset - j as f64) / (k as f64 - j as f64))
            .product()
    });
    Stencil { first, weights }
}

#[cfg(test)]
mod tests {
    use super::super::cubemap::texel_direction;
    use super::*;

    #[test]
    fn smooth_light_is_interpolated_across_edges() {
        let radiance = |n: DVec3| [(2.0 + n.x * n.y) as f32, libm::exp(n.z) as f32, 0.5];
        for ratio in [2, 4] {
            let size = 64;
            let lattice = Lattice::around(size, ratio);
            assert!(lattice.saves(size));
            let side = lattice.side();
            let values: Vec<[f32; 3]> = (0..6 * side * side)
                .map(|at| {
                    let within = at % (side * side);
                    radiance(lattice.direction(at / (side * side), within % side, within / side))
                })
                .collect();
            for (index, texel) in interpolate(&values, &lattice, size).iter().enumerate() {
                let exact = radiance(texel_direction(index, size));
                for (found, exact) in texel.iter().zip(exact) {
                    assert!(
                        (found - exact).abs() < 2e-5 * exact,
                        "{index}: {found} {exact}"
                    );
                }
            }
        }
    }

    #[test]
    fn nothing_is_clearly_darker_than_what_it_lies_between() {
        let lattice = Lattice::around(32, 4);
        let side = lattice.side();
        let mut values = vec![[1e-2; 3]; 6 * side * side];
        values[side * side / 2 + side / 2] = [1e4; 3];
        let level = interpolate(&values, &lattice, 32);
        assert!(level.iter().flatten().all(|value| *value >= 0.989e-2));
        assert!(!Lattice::around(16, 4).saves(16));
    }
}
