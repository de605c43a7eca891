//! The eight block modes of BC7: their fields, in the order in which they are packed.
//!
//! Khronos Data Format Specification 1.3, section 20.1.

use super::partition;

/// How endpoints get their lowest bit.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Parity {
    /// Not at all.
    None,
    /// One bit for both endpoints of a subset.
    Shared,
    /// One bit for each endpoint.
    Each,
}

/// The fields of a mode.
#[derive(Clone, Copy, Debug)]
pub(super) struct Mode {
    pub subsets: usize,
    pub partition_bits: u32,
    /// Bits of a stored colour component, less the parity bit.
    pub color_bits: u32,
    /// 0 where alpha is 255 throughout.
    pub alpha_bits: u32,
    pub parity: Parity,
    pub index_bits: u32,
    /// Bits of the separate indices of the scalar channel; 0 where all channels share theirs.
    pub scalar_index_bits: u32,
}

const fn mode(
    subsets: usize,
    partition_bits: u32,
    endpoint_bits: [u32; 2],
    parity: Parity,
    index_bits: [u32; 2],
) -> Mode {
    Mode {
        subsets,
        partition_bits,
        color_bits: endpoint_bits[0],
        alpha_bits: endpoint_bits[1],
        parity,
        index_bits: index_bits[0],
        scalar_index_bits: index_bits[1],
    }
}

pub(super) const MODES: [Mode; 8] = [
    mode(3, 4, [4, 0], Parity::Each, [3, 0]),
    mode(2, 6, [6, 0], Parity::Shared, [3, 0]),
    mode(3, 6, [5, 0], Parity::None, [2, 0]),
    mode(2, 6, [7, 0], Parity::Each, [2, 0]),
    mode(1, 0, [5, 6], Parity::None, [2, 3]),
    mode(1, 0, [7, 8], Parity::None, [2, 2]),
    mode(1, 0, [7, 7], Parity::Each, [4, 0]),
    mode(2, 6, [5, 5], Parity::Each, [2, 0]),
];

/// Endpoints and indices of a block, before its anchors are put right.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Fields {
    pub mode: usize,
    pub partition: usize,
    /// 0, or the channel plus one that changes places with alpha; modes 4 and 5.
    pub rotation: u32,
    /// Whether colour has the 3-bit indices and the scalar the 2-bit ones; mode 4.
    pub swapped_indices: bool,
    /// Stored bits of `[subset][end][channel]`, without the parity bit.
    pub ends: [[[u8; 4]; 2]; 3],
    /// `[subset][end]`.
    pub parity: [[u8; 2]; 3],
    pub indices: Nibbles,
    /// Of the scalar channel; modes 4 and 5.
    pub scalar_indices: Nibbles,
}

/// Bits from the lowest up.
struct Writer {
    bits: u128,
    at: u32,
}

impl Writer {
    #[inline(always)]
    fn put(&mut self, value: u64, count: u32) {
        self.bits |= u128::from(value) << self.at;
        self.at += count;
    }
}

/// Indices of 16 texels, the first in the lowest four bits.
pub(super) type Nibbles = u64;

/// Bit `bit` of each nibble whose texel is in `mask`.
const fn spread(mask: u16, bit: u32) -> Nibbles {
    let mut x = mask as u64;
    x = (x | x << 24) & 0x0000_00ff_0000_00ff;
    x = (x | x << 12) & 0x000f_000f_000f_000f;
    x = (x | x << 6) & 0x0303_0303_0303_0303;
    x = (x | x << 3) & 0x1111_1111_1111_1111;
    x << bit
}

/// The nibbles of the texels of a mask, all bits of an index set.
const fn inverted(mask: u16, bits: u32) -> Nibbles {
    spread(mask, 0) * ((1 << bits) - 1)
}

/// Indices one after the other, `bits` each, one less for anchors; and how many bits that takes.
fn squeeze(nibbles: Nibbles, bits: u32, anchors: &[u8]) -> (u64, u32) {
    let mut x = nibbles;
    match bits {
        2 => {
            x = (x | x >> 2) & 0x0f0f_0f0f_0f0f_0f0f;
            x = (x | x >> 4) & 0x00ff_00ff_00ff_00ff;
            x = (x | x >> 8) & 0x0000_ffff_0000_ffff;
            x = (x | x >> 16) & 0xffff_ffff;
        }
        3 => {
            x = (x & 0x0707_0707_0707_0707) | (x & 0x7070_7070_7070_7070) >> 1;
            x = (x & 0x003f_003f_003f_003f) | (x & 0x3f00_3f00_3f00_3f00) >> 2;
            x = (x & 0x0000_0fff_0000_0fff) | (x & 0x0fff_0000_0fff_0000) >> 4;
            x = (x & 0x00ff_ffff) | (x & 0x00ff_ffff_0000_0000) >> 8;
        }
        _ => {}
    }
    // The highest bit of an anchor goes; from the last texel on, so that those before it stay where they are.
    let mut order = [0_u32; 3];
    for (order, anchor) in order.iter_mut().zip(anchors) {
        *order = u32::from(*anchor);
    }
    let order = &mut order[..anchors.len()];
    order.sort_unstable_by(|a, b| b.cmp(a));
    for anchor in &*order {
        let at = anchor * bits + bits - 1;
        let low = (1 << at) - 1;
        x = (x & low) | (x >> 1 & !low);
    }
    (x, 16 * bits - anchors.len() as u32)
}

impl Fields {
    /// Bits of the colour and scalar indices, as the index selection has it.
    fn index_bits(&self) -> [u32; 2] {
        let mode = &MODES[self.mode];
        if self.swapped_indices {
            [mode.scalar_index_bits, mode.index_bits]
        } else {
            [mode.index_bits, mode.scalar_index_bits]
        }
    }

    /// Exchanges endpoints and inverts indices where an anchor would need its most significant bit; what is
    /// decoded stays the same, the weights being symmetric.
    fn settle_anchors(&mut self) {
        let mode = &MODES[self.mode];
        let [bits, scalar_bits] = self.index_bits();
        let anchors = partition::anchors(mode.subsets, self.partition);
        let masks = partition::masks(mode.subsets, self.partition);
        let channels = if mode.scalar_index_bits > 0 { 3 } else { 4 };
        for subset in 0..mode.subsets {
            if self.indices >> (4 * u32::from(anchors[subset]) + bits - 1) & 1 == 0 {
                continue;
            }
            self.indices ^= inverted(masks[subset], bits);
            let [low, high] = &mut self.ends[subset];
            low[..channels].swap_with_slice(&mut high[..channels]);
            self.parity[subset].reverse();
        }
        if scalar_bits > 0 && self.scalar_indices >> (scalar_bits - 1) & 1 == 1 {
            self.scalar_indices ^= inverted(0xffff, scalar_bits);
            let [low, high] = &mut self.ends[0];
            std::mem::swap(&mut low[3], &mut high[3]);
        }
    }

    /// The block.
    pub fn pack(mut self) -> [u8; 16] {
        self.settle_anchors();
        let mode = &MODES[self.mode];
        let mut out = Writer { bits: 0, at: 0 };
        out.put(1 << self.mode, self.mode as u32 + 1);
        out.put(self.partition as u64, mode.partition_bits);
        if mode.scalar_index_bits > 0 {
            out.put(u64::from(self.rotation), 2);
        }
        if self.mode == 4 {
            out.put(u64::from(self.swapped_indices), 1);
        }
        let ends = self.ends[..mode.subsets].as_flattened();
        for channel in 0..4 {
            let bits = [mode.color_bits, mode.alpha_bits][usize::from(channel == 3)];
            // At most six ends of eight bits.
            let mut row = 0;
            for end in ends.iter().rev() {
                row = row << bits | u64::from(end[channel]);
            }
            if bits > 0 {
                out.put(row, bits * ends.len() as u32);
            }
        }
        for parity in &self.parity[..mode.subsets] {
            match mode.parity {
                Parity::None => {}
                Parity::Shared => out.put(u64::from(parity[0]), 1),
                Parity::Each => out.put(u64::from(parity[0] | parity[1] << 1), 2),
            }
        }
        let anchors = partition::anchors(mode.subsets, self.partition);
        let (first, second) = if self.swapped_indices {
            (self.scalar_indices, self.indices)
        } else {
            (self.indices, self.scalar_indices)
        };
        let (bits, count) = squeeze(first, mode.index_bits, &anchors[..mode.subsets]);
        out.put(bits, count);
        if mode.scalar_index_bits > 0 {
            let (bits, count) = squeeze(second, mode.scalar_index_bits, &[0]);
            out.put(bits, count);
        }
        debug_assert_eq!(out.at, 128);
        out.bits.to_le_bytes()
    }
}

#[cfg(test)]
mod tests {
    use super::super::tests::{decode, random};
    use super::*;

    /// The weights of the specification.
    const WEIGHTS: [&[u32]; 3] = [
        &[0, 21, 43, 64],
        &[0, 9, 18, 27, 37, 46, 55, 64],
        &[0, 4, 9, 13, 17, 21, 26, 30, 34, 38, 43, 47, 51, 55, 60, 64],
    ];

    fn index(nibbles: Nibbles, texel: usize) -> u8 {
        (nibbles >> (4 * texel) & 15) as u8
    }

    fn interpolate(ends: [u32; 2], index: u8, bits: u32) -> u8 {
        let weight = WEIGHTS[bits as usize - 2][usize::from(index)];
        (((64 - weight) * ends[0] + weight * ends[1] + 32) >> 6) as u8
    }

    /// The texels by the letter of the specification.
    fn expected(fields: &Fields) -> [[u8; 4]; 16] {
        let mode = &MODES[fields.mode];
        let masks = partition::masks(mode.subsets, fields.partition);
        let [bits, scalar_bits] = fields.index_bits();
        std::array::from_fn(|texel| {
            let subset = (0..3).find(|&subset| masks[subset] >> texel & 1 == 1);
            let subset = subset.expect("the subsets cover the block");
            let mut code = [0, 1, 2, 3].map(|channel| {
                let stored_bits = [mode.color_bits, mode.alpha_bits][usize::from(channel == 3)];
                if stored_bits == 0 {
                    return 255;
                }
                let ends = [0, 1].map(|end| {
                    let mut value = u32::from(fields.ends[subset][end][channel]);
                    let mut all = stored_bits;
                    if mode.parity != Parity::None {
                        value = value << 1 | u32::from(fields.parity[subset][end]);
                        all += 1;
                    }
                    value << (8 - all) | value >> (2 * all - 8)
                });
                if channel == 3 && scalar_bits > 0 {
                    interpolate(ends, index(fields.scalar_indices, texel), scalar_bits)
                } else {
                    interpolate(ends, index(fields.indices, texel), bits)
                }
            });
            if fields.rotation > 0 {
                code.swap(fields.rotation as usize - 1, 3);
            }
            code
        })
    }

    fn random_fields(mode: usize, partition: usize, random: &mut impl FnMut() -> u32) -> Fields {
        let fields = &MODES[mode];
        let mut result = Fields {
            mode,
            partition,
            rotation: if fields.scalar_index_bits > 0 {
                random() % 4
            } else {
                0
            },
            swapped_indices: mode == 4 && random() % 2 == 1,
            ..Fields::default()
        };
        for end in result.ends.as_flattened_mut() {
            *end = [0, 1, 2, 3].map(|channel| {
                let bits = [fields.color_bits, fields.alpha_bits][usize::from(channel == 3)];
                (random() % (1 << bits)) as u8
            });
        }
        result.parity = result.parity.map(|_| {
            let bits = [0, 1].map(|_| (random() % 2) as u8);
            [bits[0], bits[usize::from(fields.parity == Parity::Each)]]
        });
        let [bits, scalar_bits] = result.index_bits();
        let mut nibbles = |bits: u32| {
            (0..16).fold(0, |nibbles, _| {
                nibbles << 4 | u64::from(random() % (1 << bits))
            })
        };
        result.indices = nibbles(bits);
        result.scalar_indices = if scalar_bits > 0 {
            nibbles(scalar_bits)
        } else {
            0
        };
        result
    }

    /// Random indices want their anchors exchanged half of the time.
    #[test]
    fn every_mode_and_partition_decodes_as_specified() {
        let mut random = random(3);
        for (mode, fields) in MODES.iter().enumerate() {
            for partition in 0..1 << fields.partition_bits {
                for _ in 0..64 {
                    let fields = random_fields(mode, partition, &mut random);
                    assert_eq!(decode(&fields.pack()), expected(&fields), "{fields:?}");
                }
            }
        }
    }

    #[test]
    fn settled_anchors_have_no_most_significant_bit_and_the_same_texels() {
        let mut random = random(4);
        for (mode, fields) in MODES.iter().enumerate() {
            for partition in 0..1 << fields.partition_bits {
                let fields = random_fields(mode, partition, &mut random);
                let mut settled = fields;
                settled.settle_anchors();
                let [bits, scalar_bits] = fields.index_bits();
                let subsets = MODES[mode].subsets;
                for anchor in &partition::anchors(subsets, partition)[..subsets] {
                    let index = index(settled.indices, usize::from(*anchor));
                    assert_eq!(index >> (bits - 1), 0);
                }
                if scalar_bits > 0 {
                    assert_eq!(index(settled.scalar_indices, 0) >> (scalar_bits - 1), 0);
                }
                assert_eq!(expected(&settled), expected(&fields));
            }
        }
    }
}
