//! The modes of BC6H and the places of their bits (Khronos Data Format Specification 1.3, section 20.2).

use super::super::partition;

/// One mode.
pub(super) struct Mode {
    /// The lowest bits of the block.
    code: u128,
    code_bits: u32,
    /// Regions of texels, one line each.
    pub regions: usize,
    /// Of the first endpoint, and of the others where there are no differences.
    pub bits: u32,
    /// Bits of the other endpoints' differences from the first, by channel; 0 where endpoints stand for themselves.
    pub deltas: [u32; 3],
    /// Runs of bits behind the code: field, its lowest bit in the run, number of bits.
    layout: &'static [(usize, u32, u32)],
}

// A field is a channel of an endpoint: the first region's are W and X, the second's Y and Z.
const RW: usize = 0;
const GW: usize = 1;
const BW: usize = 2;
const RX: usize = 3;
const GX: usize = 4;
const BX: usize = 5;
const RY: usize = 6;
const GY: usize = 7;
const BY: usize = 8;
const RZ: usize = 9;
const GZ: usize = 10;
const BZ: usize = 11;

const fn two(
    code: u128,
    bits: u32,
    deltas: [u32; 3],
    layout: &'static [(usize, u32, u32)],
) -> Mode {
    Mode {
        code,
        code_bits: if code < 2 { 2 } else { 5 },
        regions: 2,
        bits,
        deltas,
        layout,
    }
}

const fn one(code: u128, bits: u32, delta: u32, layout: &'static [(usize, u32, u32)]) -> Mode {
    Mode {
        code,
        code_bits: 5,
        regions: 1,
        bits,
        deltas: [delta; 3],
        layout,
    }
}

/// Modes of two regions, then those of one; of each kind from the coarsest endpoints to the finest.
#[rustfmt::skip]
pub(super) static MODES: [Mode; 14] = [
    two(30, 6, [0; 3], &[
        (RW, 0, 6), (GZ, 4, 1), (BZ, 0, 1), (BZ, 1, 1), (BY, 4, 1), (GW, 0, 6), (GY, 5, 1), (BY, 5, 1), (BZ, 2, 1),
        (GY, 4, 1), (BW, 0, 6), (GZ, 5, 1), (BZ, 3, 1), (BZ, 5, 1), (BZ, 4, 1), (RX, 0, 6), (GY, 0, 4), (GX, 0, 6),
        (GZ, 0, 4), (BX, 0, 6), (BY, 0, 4), (RY, 0, 6), (RZ, 0, 6),
    ]),
    two(1, 7, [6; 3], &[
        (GY, 5, 1), (GZ, 4, 2), (RW, 0, 7), (BZ, 0, 2), (BY, 4, 1), (GW, 0, 7), (BY, 5, 1), (BZ, 2, 1), (GY, 4, 1),
        (BW, 0, 7), (BZ, 3, 1), (BZ, 5, 1), (BZ, 4, 1), (RX, 0, 6), (GY, 0, 4), (GX, 0, 6), (GZ, 0, 4), (BX, 0, 6),
        (BY, 0, 4), (RY, 0, 6), (RZ, 0, 6),
    ]),
    two(18, 8, [6, 5, 5], &[
        (RW, 0, 8), (GZ, 4, 1), (BY, 4, 1), (GW, 0, 8), (BZ, 2, 1), (GY, 4, 1), (BW, 0, 8), (BZ, 3, 2), (RX, 0, 6),
        (GY, 0, 4), (GX, 0, 5), (BZ, 0, 1), (GZ, 0, 4), (BX, 0, 5), (BZ, 1, 1), (BY, 0, 4), (RY, 0, 6), (RZ, 0, 6),
    ]),
    two(22, 8, [5, 6, 5], &[
        (RW, 0, 8), (BZ, 0, 1), (BY, 4, 1), (GW, 0, 8), (GY, 5, 1), (GY, 4, 1), (BW, 0, 8), (GZ, 5, 1), (BZ, 4, 1),
        (RX, 0, 5), (GZ, 4, 1), (GY, 0, 4), (GX, 0, 6), (GZ, 0, 4), (BX, 0, 5), (BZ, 1, 1), (BY, 0, 4), (RY, 0, 5),
        (BZ, 2, 1), (RZ, 0, 5), (BZ, 3, 1),
    ]),
    two(26, 8, [5, 5, 6], &[
        (RW, 0, 8), (BZ, 1, 1), (BY, 4, 1), (GW, 0, 8), (BY, 5, 1), (GY, 4, 1), (BW, 0, 8), (BZ, 5, 1), (BZ, 4, 1),
        (RX, 0, 5), (GZ, 4, 1), (GY, 0, 4), (GX, 0, 5), (BZ, 0, 1), (GZ, 0, 4), (BX, 0, 6), (BY, 0, 4), (RY, 0, 5),
        (BZ, 2, 1), (RZ, 0, 5), (BZ, 3, 1),
    ]),
    two(14, 9, [5; 3], &[
        (RW, 0, 9), (BY, 4, 1), (GW, 0, 9), (GY, 4, 1), (BW, 0, 9), (BZ, 4, 1), (RX, 0, 5), (GZ, 4, 1), (GY, 0, 4),
        (GX, 0, 5), (BZ, 0, 1), (GZ, 0, 4), (BX, 0, 5), (BZ, 1, 1), (BY, 0, 4), (RY, 0, 5), (BZ, 2, 1), (RZ, 0, 5),
        (BZ, 3, 1),
    ]),
    two(0, 10, [5; 3], &[
        (GY, 4, 1), (BY, 4, 1), (BZ, 4, 1), (RW, 0, 10), (GW, 0, 10), (BW, 0, 10), (RX, 0, 5), (GZ, 4, 1), (GY, 0, 4),
        (GX, 0, 5), (BZ, 0, 1), (GZ, 0, 4), (BX, 0, 5), (BZ, 1, 1), (BY, 0, 4), (RY, 0, 5), (BZ, 2, 1), (RZ, 0, 5),
        (BZ, 3, 1),
    ]),
    two(2, 11, [5, 4, 4], &[
        (RW, 0, 10), (GW, 0, 10), (BW, 0, 10), (RX, 0, 5), (RW, 10, 1), (GY, 0, 4), (GX, 0, 4), (GW, 10, 1), (BZ, 0, 1),
        (GZ, 0, 4), (BX, 0, 4), (BW, 10, 1), (BZ, 1, 1), (BY, 0, 4), (RY, 0, 5), (BZ, 2, 1), (RZ, 0, 5), (BZ, 3, 1),
    ]),
    two(6, 11, [4, 5, 4], &[
        (RW, 0, 10), (GW, 0, 10), (BW, 0, 10), (RX, 0, 4), (RW, 10, 1), (GZ, 4, 1), (GY, 0, 4), (GX, 0, 5), (GW, 10, 1),
        (GZ, 0, 4), (BX, 0, 4), (BW, 10, 1), (BZ, 1, 1), (BY, 0, 4), (RY, 0, 4), (BZ, 0, 1), (BZ, 2, 1), (RZ, 0, 4),
        (GY, 4, 1), (BZ, 3, 1),
    ]),
    two(10, 11, [4, 4, 5], &[
        (RW, 0, 10), (GW, 0, 10), (BW, 0, 10), (RX, 0, 4), (RW, 10, 1), (BY, 4, 1), (GY, 0, 4), (GX, 0, 4), (GW, 10, 1),
        (BZ, 0, 1), (GZ, 0, 4), (BX, 0, 5), (BW, 10, 1), (BY, 0, 4), (RY, 0, 4), (BZ, 1, 2), (RZ, 0, 4), (BZ, 4, 1),
        (BZ, 3, 1),
    ]),
    one(3, 10, 0, &[(RW, 0, 10), (GW, 0, 10), (BW, 0, 10), (RX, 0, 10), (GX, 0, 10), (BX, 0, 10)]),
    one(7, 11, 9, &[
        (RW, 0, 10), (GW, 0, 10), (BW, 0, 10), (RX, 0, 9), (RW, 10, 1), (GX, 0, 9), (GW, 10, 1), (BX, 0, 9), (BW, 10, 1),
    ]),
    one(11, 12, 8, &[
        (RW, 0, 10), (GW, 0, 10), (BW, 0, 10), (RX, 0, 8), (RW, 11, 1), (RW, 10, 1), (GX, 0, 8), (GW, 11, 1), (GW, 10, 1),
        (BX, 0, 8), (BW, 11, 1), (BW, 10, 1),
    ]),
    one(15, 16, 4, &[
        (RW, 0, 10), (GW, 0, 10), (BW, 0, 10),
        (RX, 0, 4), (RW, 15, 1), (RW, 14, 1), (RW, 13, 1), (RW, 12, 1), (RW, 11, 1), (RW, 10, 1),
        (GX, 0, 4), (GW, 15, 1), (GW, 14, 1), (GW, 13, 1), (GW, 12, 1), (GW, 11, 1), (GW, 10, 1),
        (BX, 0, 4), (BW, 15, 1), (BW, 14, 1), (BW, 13, 1), (BW, 12, 1), (BW, 11, 1), (BW, 10, 1),
    ]),
];

/// Modes of two regions: those before the first of one.
pub(super) const TWO_REGIONS: usize = 10;
/// Partitions into two regions: the first of BC7's.
pub(super) const PARTITIONS: usize = 32;

/// The fields of a block.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Fields {
    pub mode: usize,
    pub partition: usize,
    /// `[region][end][channel]`, before differences are taken.
    pub ends: [[[i32; 3]; 2]; 2],
    /// The highest bit of the anchors' is 0.
    pub indices: [u8; 16],
}

impl Fields {
    pub const NONE: Self = Self {
        mode: TWO_REGIONS,
        partition: 0,
        ends: [[[0; 3]; 2]; 2],
        indices: [0; 16],
    };

    /// The block.
    pub fn pack(&self) -> [u8; 16] {
        let mode = &MODES[self.mode];
        let mut fields = [0; 12];
        for (at, field) in fields.iter_mut().enumerate() {
            let (end, channel) = (at / 3, at % 3);
            let base = self.ends[0][0][channel];
            let value = self.ends[end / 2][end % 2][channel];
            *field = if end > 0 && mode.deltas[channel] > 0 {
                value - base
            } else {
                value
            };
        }
        let mut block = mode.code;
        let mut at = mode.code_bits;
        let mut put = |value: u128, count: u32| {
            block |= value << at;
            at += count;
        };
        for &(field, low, count) in mode.layout {
            let bits = (fields[field] >> low) as u32 & ((1 << count) - 1);
            put(u128::from(bits), count);
        }
        let index_bits = if mode.regions == 2 { 3 } else { 4 };
        let anchors = partition::anchors(mode.regions, self.partition);
        if mode.regions == 2 {
            put(self.partition as u128, 5);
        }
        for (texel, &index) in self.indices.iter().enumerate() {
            let is_anchor = texel == 0 || texel == usize::from(anchors[1]);
            put(u128::from(index), index_bits - u32::from(is_anchor));
        }
        block.to_le_bytes()
    }
}
