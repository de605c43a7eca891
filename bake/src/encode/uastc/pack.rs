//! Writes the bits of UASTC blocks (UASTC Texture Specification 1.0).

use basisu::uastc::patterns::{
    ASTC_BC7_PATTERN2_ANCHORS, ASTC_BC7_PATTERN3_ANCHORS, ASTC_BC7_PATTERNS2, ASTC_BC7_PATTERNS3,
};
use basisu::uastc::tables::{ASTC_BISE_RANGE_TABLE, MODE_HUFF_CODES, TOTAL_HINT_BITS};

use super::{Candidate, SOLID};

/// Bits, the first in the lowest place.
#[derive(Default)]
struct Bits {
    word: u128,
    used: u32,
}

impl Bits {
    fn push(&mut self, value: u32, count: u32) {
        self.word |= u128::from(value) << self.used;
        self.used += count;
    }

    fn mode(number: u8) -> Self {
        let [code, size] = MODE_HUFF_CODES[usize::from(number)];
        let mut bits = Self::default();
        bits.push(code, size);
        bits
    }
}

/// A block of one colour.
pub(super) fn solid(color: [u8; 4]) -> [u8; 16] {
    let mut bits = Bits::mode(SOLID);
    for channel in color {
        bits.push(u32::from(channel), 8);
    }
    bits.word.to_le_bytes()
}

pub(super) fn pack(block: &Candidate) -> [u8; 16] {
    let mut block = block.clone();
    let anchors = anchors(&block);
    lower_anchors(&mut block, &anchors);
    let mode = block.mode;
    let mut bits = Bits::mode(mode.number);
    bits.push(0, u32::from(TOTAL_HINT_BITS[usize::from(mode.number)]));
    match mode.subsets {
        2 => bits.push(block.pattern as u32, 5),
        3 => bits.push(block.pattern as u32, 4),
        _ => {}
    }
    if let Some(plane) = block.plane
        && mode.components > 2
    {
        bits.push(plane as u32, 2);
    }
    push_endpoints(&mut bits, &block);
    for texel in 0..16 {
        let short = anchors[..mode.subsets].contains(&texel);
        let count = mode.weight_bits - u32::from(short);
        bits.push(u32::from(block.weights[0][texel]), count);
        if block.plane.is_some() {
            bits.push(u32::from(block.weights[1][texel]), count);
        }
    }
    bits.word.to_le_bytes()
}

/// The texel of each subset whose weight lacks its highest bit.
fn anchors(block: &Candidate) -> [usize; 3] {
    match block.mode.subsets {
        2 => ASTC_BC7_PATTERN2_ANCHORS[block.pattern].map(usize::from),
        3 => ASTC_BC7_PATTERN3_ANCHORS[block.pattern].map(usize::from),
        _ => [0; 3],
    }
}

/// Swaps the ends of lines on which an anchor's weight has its highest bit.
fn lower_anchors(block: &mut Candidate, anchors: &[usize; 3]) {
    let most = (1 << block.mode.weight_bits) - 1;
    let subset_of = |texel: usize| match block.mode.subsets {
        2 => usize::from(ASTC_BC7_PATTERNS2[block.pattern][texel]),
        3 => usize::from(ASTC_BC7_PATTERNS3[block.pattern][texel]),
        _ => 0,
    };
    let subsets: [usize; 16] = std::array::from_fn(subset_of);
    let planes = 1 + usize::from(block.plane.is_some());
    for &anchor in &anchors[..block.mode.subsets] {
        for plane in 0..planes {
            if block.weights[plane][anchor] <= most / 2 {
                continue;
            }
            let subset = subsets[anchor];
            for (texel, weight) in block.weights[plane].iter_mut().enumerate() {
                if subsets[texel] == subset {
                    *weight = most - *weight;
                }
            }
            for (component, ends) in block.endpoints[subset].iter_mut().enumerate() {
                if (block.plane == Some(component)) == (plane == 1) {
                    ends.swap(0, 1);
                }
            }
        }
    }
}

/// All trits or quints of the endpoints in groups, then their bits.
fn push_endpoints(bits: &mut Bits, block: &Candidate) {
    let mode = block.mode;
    let [plain, trits, quints] = ASTC_BISE_RANGE_TABLE[mode.range].map(|count| count as u32);
    let codes: Vec<u32> = block.endpoints[..mode.subsets]
        .iter()
        .flat_map(|subset| subset[..mode.components].as_flattened())
        .map(|&code| u32::from(code))
        .collect();
    let (base, group, sizes): (u32, usize, &[u32]) = match (trits, quints) {
        (0, 0) => (1, codes.len(), &[]),
        (0, _) => (5, 3, &[3, 5, 7]),
        _ => (3, 5, &[2, 4, 5, 7, 8]),
    };
    if base > 1 {
        for codes in codes.chunks(group) {
            let digits = codes.iter().rev();
            let value = digits.fold(0, |value, code| value * base + (code >> plain));
            bits.push(value, sizes[codes.len() - 1]);
        }
    }
    for code in codes {
        bits.push(code & ((1 << plain) - 1), plain);
    }
}
