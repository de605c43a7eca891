//! What endpoints and indices of a mode may be.

use pulp::Simd;

use super::modes::{MODES, Parity};
use super::wide::Wide;

/// See the module.
#[derive(Clone, Copy, Debug)]
pub(super) struct Grid {
    /// The highest stored value.
    pub top: f32,
    /// Of stored values, in codes with the parity bit.
    stride: f32,
    /// Codes a unit of 8-bit values.
    scale: f32,
    up: f32,
    down: f32,
    /// The highest index.
    pub steps: f32,
    pub parities: &'static [[usize; 2]],
    /// Which parity bits occur.
    pub occurs: [bool; 2],
    /// Variance of what one channel of a texel loses by the rounding of its endpoints, nearly: that of even errors at
    /// both ends, halved between them.
    pub noise: f32,
    /// Error along the axis in units of that of many evenly spread values: the values of a subset are few and lie in
    /// clusters, and its endpoints are fitted to them. Chosen so that the best ways are ranked first most often.
    pub clustering: f32,
}

impl Grid {
    pub const fn new(bits: u32, parity: Parity, index_bits: u32) -> Self {
        let all = bits + (!matches!(parity, Parity::None)) as u32;
        let scale = ((1_u32 << all) - 1) as f32 / 255.0;
        Self {
            top: ((1_u32 << bits) - 1) as f32,
            stride: (1_u32 << (all - bits)) as f32,
            scale,
            up: (1_u32 << (8 - all)) as f32,
            down: 1.0 / (1_u32 << (2 * all - 8)) as f32,
            steps: ((1_u32 << index_bits) - 1) as f32,
            parities: match parity {
                Parity::None => &[[0, 0]],
                Parity::Shared => &[[0, 0], [1, 1]],
                Parity::Each => &[[0, 0], [1, 1], [0, 1], [1, 0]],
            },
            occurs: [true, !matches!(parity, Parity::None)],
            noise: 1.0 / (27.0 * scale * scale),
            clustering: if index_bits == 2 { 0.2 } else { 0.45 },
        }
    }

    /// With both parity bits set, as opaque alpha needs them.
    pub const fn odd(mut self) -> Self {
        self.parities = &[[1, 1]];
        self.occurs = [false, true];
        self
    }

    /// A value in units of stored ones.
    #[inline(always)]
    pub fn position<S: Simd>(&self, value: Wide<S>, parity: f32) -> Wide<S> {
        (value * self.scale - value.of(parity)) * (1.0 / self.stride)
    }

    /// The nearest stored value.
    #[inline(always)]
    pub fn store<S: Simd>(&self, value: Wide<S>, parity: f32) -> Wide<S> {
        self.position(value, parity).round().clamp(0.0, self.top)
    }

    /// The 8-bit value that the decoder makes of a stored one.
    #[inline(always)]
    pub fn expand<S: Simd>(&self, stored: Wide<S>, parity: Wide<S>) -> Wide<S> {
        let code = stored * self.stride + parity;
        // Rounded down: half a step of the quotient keeps it off the halves.
        let low = (code * self.down + code.of(0.5 * self.down - 0.5)).round();
        code * self.up + low
    }
}

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
/// Mode 6 where alpha is 255 and stays so.
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
