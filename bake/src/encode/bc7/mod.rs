//! BC7 blocks from 8-bit texels, with the same bytes on every machine.
//!
//! Format: Khronos Data Format Specification 1.3, section 20.1. The squared error of the stored values is made
//! small, all channels alike. Only additions, products, divisions, square roots and roundings, each in a
//! fixed order: no fused or approximate instruction, which processors do differently.

#[allow(
    clippy::needless_range_loop,
    reason = "several arrays of channels, texels and groups share an index"
)]
mod estimate;
#[allow(
    clippy::needless_range_loop,
    reason = "several arrays of channels, texels and groups share an index"
)]
mod fit;
mod lanes;
mod modes;
mod partition;
mod solid;

use super::Quality;
use estimate::{Products, SCALARS, rank};
use fit::{Effort, Fit, Grid, Texels, fit, polish};
use modes::{Fields, MODES, Parity};

/// Compresses 16 RGBA texels, rows of four. Opaque blocks stay opaque exactly, those of one colour are exact.
fn compress_block(texels: &[[u8; 4]; 16], quality: Quality) -> [u8; 16] {
    if texels[1..].iter().all(|texel| *texel == texels[0]) {
        return solid::solid(texels[0]);
    }
    let encoder = Encoder::searched(texels, quality);
    encoder.best.fields(encoder.opaque).pack()
}

/// Compresses blocks, each as `compress_block` does.
///
/// # Panics
/// If the slices differ in length.
pub(super) fn compress(blocks: &[[[u8; 4]; 16]], quality: Quality, out: &mut [[u8; 16]]) {
    assert_eq!(blocks.len(), out.len());
    for (out, block) in out.iter_mut().zip(blocks) {
        *out = compress_block(block, quality);
    }
}

/// What a quality tries.
struct Preset {
    /// Of mode 6.
    whole: Effort,
    /// Of all other modes.
    parts: Effort,
    /// Most partitions of modes 0, 1, 2, 3 (opaque) and 7 (alpha).
    partitions: [usize; 5],
    /// Most rotations of modes 4 and 5, of blocks with alpha first, then of opaque ones.
    rotations: [usize; 2],
    /// Whether mode 4 is tried, in the same order.
    fourth: [bool; 2],
    /// Most rounds of descent from a way whose error is below the best times `margin`.
    polish: u32,
    margin: f32,
    /// Ways whose estimate is worse than the best error times this are not tried.
    trust: f32,
}

const fn effort(rounds: u32, parities: bool) -> Effort {
    Effort { rounds, parities }
}

const fn preset(quality: Quality) -> Preset {
    match quality {
        Quality::Fast => Preset {
            whole: effort(1, false),
            parts: effort(1, false),
            partitions: [0, 0, 0, 0, 0],
            rotations: [1, 0],
            fourth: [true, false],
            polish: 1,
            margin: 1.0,
            trust: 4.0,
        },
        Quality::Default => Preset {
            whole: effort(2, false),
            parts: effort(1, false),
            partitions: [0, 3, 0, 2, 2],
            rotations: [2, 1],
            fourth: [true, false],
            polish: 1,
            margin: 1.0,
            trust: 4.0,
        },
        Quality::Best => Preset {
            whole: effort(3, true),
            parts: effort(2, true),
            partitions: [6, 10, 6, 10, 10],
            rotations: [4, 3],
            fourth: [true, true],
            polish: 4,
            margin: 1.5,
            trust: 4.0,
        },
    }
}

/// Most partitions of one mode that are ranked.
const RANKED: usize = 16;

/// What the vector channels of each mode are stored on; modes 4 and 5 less their scalar.
static GRIDS: [Grid; 8] = {
    let mut grids = [Grid::new(8, Parity::None, 2); 8];
    let mut at = 0;
    while at < 8 {
        let mode = &MODES[at];
        grids[at] = Grid::new(mode.color_bits, mode.parity, mode.index_bits);
        at += 1;
    }
    grids
};

/// The grids of the vector and of the scalar in modes 4 and 5.
fn rotated_grids(mode: usize, swapped_indices: bool) -> [&'static Grid; 2] {
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

/// A way of storing the block.
#[derive(Clone, Copy)]
struct Choice {
    mode: usize,
    partition: usize,
    rotation: usize,
    swapped_indices: bool,
    /// Of each subset.
    fits: [Fit; 3],
    scalar: Fit,
    error: f32,
}

impl Choice {
    const NONE: Self = Self {
        mode: 6,
        partition: 0,
        rotation: 0,
        swapped_indices: false,
        fits: [Fit::NONE; 3],
        scalar: Fit::NONE,
        error: f32::INFINITY,
    };

    fn fields(&self, opaque: bool) -> Fields {
        let mode = &MODES[self.mode];
        let mut bits = [mode.index_bits, mode.scalar_index_bits];
        if self.swapped_indices {
            bits.reverse();
        }
        let steps = bits.map(|bits| ((1_u32 << bits) - 1) as f32);
        let mut fields = Fields {
            mode: self.mode,
            partition: self.partition,
            rotation: self.rotation as u32,
            swapped_indices: self.swapped_indices,
            ..Fields::default()
        };
        let masks = partition::masks(mode.subsets, self.partition);
        for (subset, fit) in self.fits[..mode.subsets].iter().enumerate() {
            fields.ends[subset] = fit
                .ends
                .stored
                .map(|end| end.to_array().map(|value| value as u8));
            fields.parity[subset] = fit.ends.parity.map(|bit| bit as u8);
            let texels = (0..16).filter(|texel| masks[subset] >> texel & 1 == 1);
            for (texel, index) in texels.zip(fit.indices(steps[0])) {
                fields.indices[texel] = index;
            }
        }
        if mode.scalar_index_bits > 0 {
            for (end, stored) in fields.ends[0].iter_mut().zip(self.scalar.ends.stored) {
                end[3] = stored[0] as u8;
            }
            let indices = self.scalar.indices(steps[1]);
            for (slot, index) in fields.scalar_indices.iter_mut().zip(indices) {
                *slot = index;
            }
        } else if opaque {
            for end in &mut fields.ends[0] {
                end[3] = 127;
            }
        }
        fields
    }
}

/// A block and the best way found for it.
struct Encoder {
    /// `[channel][texel]`.
    values: [[f32; 16]; 4],
    opaque: bool,
    preset: Preset,
    best: Choice,
}

impl Encoder {
    fn searched(texels: &[[u8; 4]; 16], quality: Quality) -> Self {
        let mut values = [[0.0; 16]; 4];
        for (texel, codes) in texels.iter().enumerate() {
            for (channel, &code) in codes.iter().enumerate() {
                values[channel][texel] = f32::from(code);
            }
        }
        let mut encoder = Self {
            values,
            opaque: texels.iter().all(|texel| texel[3] == 255),
            preset: preset(quality),
            best: Choice::NONE,
        };
        encoder.search();
        encoder
    }

    /// All modes that the preset has for such a block; alpha excludes modes 0 to 3, opacity mode 7.
    fn search(&mut self) {
        let mut whole = Texels::NONE;
        whole.gather(&self.values, 0xffff);
        if self.opaque {
            self.whole::<3>(&whole, &GRIDS[6].odd());
        } else {
            self.whole::<4>(&whole, &GRIDS[6]);
        }
        let [zero, one, two, three, seven] = self.preset.partitions;
        let rotations = self.preset.rotations[usize::from(self.opaque)];
        if self.best.error == 0.0 || one + seven + rotations == 0 {
            return;
        }
        let mut products = Products::ZERO;
        products.fill(&self.values);
        if self.opaque && one + three > 0 {
            let spreads = products.two_subsets::<3>();
            self.partitioned::<3>(1, &spreads.errors(7.0), one);
            self.partitioned::<3>(3, &spreads.errors(3.0), three);
        }
        self.rotated(&whole, &products, rotations);
        if self.opaque && zero + two > 0 {
            let spreads = products.three_subsets::<3>();
            self.partitioned::<3>(0, &spreads.errors(7.0)[..16], zero);
            self.partitioned::<3>(2, &spreads.errors(3.0), two);
        }
        if !self.opaque && seven > 0 {
            let spreads = products.two_subsets::<4>();
            self.partitioned::<4>(7, &spreads.errors(3.0), seven);
        }
    }

    /// Mode 6.
    fn whole<const C: usize>(&mut self, whole: &Texels, grid: &Grid) {
        let mut fit = fit::<C>(whole, grid, self.preset.whole);
        polish::<C>(whole, grid, self.preset.polish, &mut fit);
        self.best.error = fit.error;
        self.best.fits[0] = fit;
    }

    /// Modes 0 to 3 and 7, for the partitions of least estimated error.
    fn partitioned<const C: usize>(&mut self, mode: usize, errors: &[f32], most: usize) {
        let subsets = MODES[mode].subsets;
        let mut texels = [Texels::NONE; 3];
        let (guesses, count) = rank::<RANKED>(errors, most);
        for &(estimate, partition) in &guesses[..count] {
            if estimate >= self.best.error * self.preset.trust {
                return;
            }
            let masks = partition::masks(subsets, partition);
            for (texels, mask) in texels.iter_mut().zip(masks).take(subsets) {
                texels.gather(&self.values, mask);
            }
            let fits = self.fit_subsets::<C>(&texels[..subsets], &GRIDS[mode]);
            let error = fits[..subsets].iter().map(|fit| fit.error).sum();
            if error < self.best.error {
                self.best = Choice {
                    mode,
                    partition,
                    fits,
                    error,
                    ..Choice::NONE
                };
            }
        }
    }

    /// Fits of the subsets, the error infinite where they are not worth finishing.
    #[inline(always)]
    fn fit_subsets<const C: usize>(&self, texels: &[Texels], grid: &Grid) -> [Fit; 3] {
        let limit = self.best.error * self.preset.margin;
        let mut fits = [Fit::NONE; 3];
        let mut error = 0.0;
        for (found, texels) in fits.iter_mut().zip(texels) {
            *found = fit::<C>(texels, grid, self.preset.parts);
            error += found.error;
            if error >= limit {
                return [Fit::NONE; 3];
            }
        }
        for (found, texels) in fits.iter_mut().zip(texels) {
            polish::<C>(texels, grid, self.preset.polish, found);
        }
        fits
    }

    /// Modes 5 and 4, for the rotations of least estimated error.
    fn rotated(&mut self, whole: &Texels, products: &Products, most: usize) {
        self.rotations(5, false, whole, products, most);
        if self.preset.fourth[usize::from(self.opaque)] {
            self.rotations(4, false, whole, products, most);
            self.rotations(4, true, whole, products, most);
        }
    }

    fn rotations(
        &mut self,
        mode: usize,
        swapped_indices: bool,
        whole: &Texels,
        products: &Products,
        most: usize,
    ) {
        let [grid, scalar_grid] = rotated_grids(mode, swapped_indices);
        let errors = products.rotations(grid.steps, scalar_grid.steps);
        let (guesses, count) = rank::<4>(&errors, most);
        for &(_, rotation) in &guesses[..count] {
            let limit = self.best.error * self.preset.margin;
            let alone = SCALARS[rotation];
            let (texels, scalar_texels) = (whole.swapped(alone), whole.only(alone));
            let mut scalar = fit::<1>(&scalar_texels, scalar_grid, self.preset.parts);
            if scalar.error >= limit {
                continue;
            }
            let mut vector = fit::<3>(&texels, grid, self.preset.parts);
            if vector.error + scalar.error >= limit {
                continue;
            }
            polish::<3>(&texels, grid, self.preset.polish, &mut vector);
            polish::<1>(&scalar_texels, scalar_grid, self.preset.polish, &mut scalar);
            let error = vector.error + scalar.error;
            if error < self.best.error {
                self.best = Choice {
                    mode,
                    rotation,
                    swapped_indices,
                    fits: [vector, Fit::NONE, Fit::NONE],
                    scalar,
                    error,
                    ..Choice::NONE
                };
            }
        }
    }
}

#[cfg(test)]
mod tests;
