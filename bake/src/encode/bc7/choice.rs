//! One way of storing one block, and its fields.

use pulp::Simd;

use super::estimate::SCALARS;
use super::fit::{Fit, Grid, Measure, Subset};
use super::modes::{Fields, MODES, Parity};
use super::partition;
use super::wide::{Wide, round};

/// What the vector channels of each mode are stored on; modes 4 and 5 less their scalar.
pub(super) static GRIDS: [Grid; 8] = {
    let mut grids = [Grid::new(8, Parity::None, 2); 8];
    let mut at = 0;
    while at < 8 {
        let mode = &MODES[at];
        grids[at] = Grid::new(mode.color_bits, mode.parity, mode.index_bits);
        at += 1;
    }
    grids
};
pub(super) static OPAQUE_WHOLE: Grid = GRIDS[6].odd();

/// The grids of the vector and of the scalar in modes 4 and 5.
pub(super) fn rotated_grids(mode: usize, swapped_indices: bool) -> [&'static Grid; 2] {
    static FIVE: [Grid; 2] = [Grid::new(7, Parity::None, 2), Grid::new(8, Parity::None, 2)];
    static FOUR: [[Grid; 2]; 2] = [
        [Grid::new(5, Parity::None, 2), Grid::new(6, Parity::None, 3)],
        [Grid::new(5, Parity::None, 3), Grid::new(6, Parity::None, 2)],
    ];
    let [vector, scalar] = match mode {
        4 => &FOUR[usize::from(swapped_indices)],
        _ => &FIVE,
    };
    [vector, scalar]
}

/// A way of storing one block, endpoints as stored bits.
#[derive(Clone, Copy, Debug)]
pub(super) struct Choice {
    pub mode: usize,
    pub partition: usize,
    pub rotation: usize,
    pub swapped_indices: bool,
    /// `[subset][end][channel]`.
    pub ends: [[[f32; 4]; 2]; 3],
    pub parity: [[f32; 2]; 3],
    /// Of the scalar channel.
    pub scalar: [f32; 2],
    pub error: f32,
}

impl Choice {
    pub const NONE: Self = Self {
        mode: 6,
        partition: 0,
        rotation: 0,
        swapped_indices: false,
        ends: [[[0.0; 4]; 2]; 3],
        parity: [[0.0; 2]; 3],
        scalar: [0.0; 2],
        error: f32::INFINITY,
    };

    /// With the endpoints of one subset, those of a lane of a fit.
    pub fn subset<S: Simd>(mut self, at: usize, fit: &Fit<S>, lane: usize) -> Self {
        for end in 0..2 {
            for channel in 0..4 {
                self.ends[at][end][channel] = fit.ends.stored[end][channel].lane(lane);
            }
            self.parity[at][end] = fit.ends.parity[end].lane(lane);
        }
        self
    }

    /// The fields of the block; indices are those that the search measured, found again.
    pub fn fields(&self, texels: &[[u8; 4]; 16], opaque: bool) -> Fields {
        let mode = &MODES[self.mode];
        let mut fields = Fields {
            mode: self.mode,
            partition: self.partition,
            rotation: self.rotation as u32,
            swapped_indices: self.swapped_indices,
            parity: self.parity.map(|ends| ends.map(|bit| bit as u8)),
            ..Fields::default()
        };
        for (subset, ends) in self.ends[..mode.subsets].iter().enumerate() {
            fields.ends[subset] = ends.map(|end| end.map(|value| value as u8));
        }
        let simd = pulp::Scalar::new();
        let mut values = [[Wide::zero(simd); 16]; 4];
        for (texel, codes) in texels.iter().enumerate() {
            for channel in 0..4 {
                values[channel][texel] = Wide::splat(simd, f32::from(codes[channel]));
            }
        }
        if mode.scalar_index_bits > 0 {
            let alone = SCALARS[self.rotation];
            values.swap(alone, 3);
            let [grid, scalar_grid] = rotated_grids(self.mode, self.swapped_indices);
            fields.indices = self.indices::<3>(&values, grid, 0, 0xffff);
            values[0] = values[3];
            let scalar = Self {
                ends: [self.scalar.map(|end| [end, 0.0, 0.0, 0.0]); 3],
                parity: [[0.0; 2]; 3],
                ..*self
            };
            fields.scalar_indices = scalar.indices::<1>(&values, scalar_grid, 0, 0xffff);
            for (end, stored) in fields.ends[0].iter_mut().zip(self.scalar) {
                end[3] = stored as u8;
            }
            return fields;
        }
        let masks = partition::masks(mode.subsets, self.partition);
        for (subset, mask) in masks.into_iter().enumerate().take(mode.subsets) {
            let grid = &GRIDS[self.mode];
            let indices = if mode.alpha_bits > 0 && !opaque {
                self.indices::<4>(&values, grid, subset, mask)
            } else {
                self.indices::<3>(&values, grid, subset, mask)
            };
            for texel in (0..16).filter(|texel| mask >> texel & 1 == 1) {
                fields.indices[texel] = indices[texel];
            }
        }
        if opaque && mode.alpha_bits > 0 {
            for end in &mut fields.ends[0] {
                end[3] = 127;
            }
        }
        fields
    }

    fn indices<const C: usize>(
        &self,
        values: &[[Wide<pulp::Scalar>; 16]; 4],
        grid: &Grid,
        subset: usize,
        mask: u16,
    ) -> [u8; 16] {
        let simd = pulp::Scalar::new();
        let mut fit = Fit::none(simd);
        for end in 0..2 {
            let splat = |value: f32| Wide::splat(simd, value);
            fit.ends.stored[end] = self.ends[subset][end].map(splat);
            fit.ends.parity[end] = splat(self.parity[subset][end]);
        }
        let mut texels = Subset::whole(simd, values);
        texels.choose(&[u32::from(mask)]);
        Measure::<_, C> {
            subset: &texels,
            grid,
            ends: &fit.ends,
            weights: &mut fit.weights,
        }
        .run();
        fit.weights
            .map(|weight| round(weight.lane(0) * grid.steps / 64.0) as u8)
    }
}
