//! ASTC blocks beside an independent decoder: software Vulkan reads none, so that no picture tests them.

use astc_decode::{Footprint, astc_decode_block};
use basisu::uastc::unpack::{UnpackedUastcBlock, unpack_to_block, unpack_uastc};
use basisu::uastc::{bise, tables};

use super::{BLOCK, Target};

type Texels = [[u8; 4]; 16];

/// Number of the modes of UASTC, and of the one that has a colour and no weights.
const MODES: usize = 19;
const SOLID: u32 = 8;
/// Blocks of each mode.
const SAMPLES: usize = 256;

/// Random blocks that are valid UASTC, as many of each mode.
fn samples() -> Vec<(u32, [u8; BLOCK])> {
    let mut state = 1_u128;
    let mut counts = [0; MODES];
    let mut blocks = Vec::new();
    while counts.iter().any(|count| *count < SAMPLES) {
        // A multiplicative congruential generator (L'Ecuyer, Mathematics of Computation 68, 1999); its upper half is good.
        state = state.wrapping_mul(0xda94_2042_e4dd_58b5);
        let high = state >> 64;
        state = state.wrapping_mul(0xda94_2042_e4dd_58b5);
        let block = (high | state >> 64 << 64).to_le_bytes();
        let Some(unpacked) = unpack_to_block(&block, false, false) else {
            continue;
        };
        let count = &mut counts[unpacked.mode as usize];
        if *count < SAMPLES {
            *count += 1;
            blocks.push((unpacked.mode, block));
        }
    }
    blocks
}

fn astc(block: &[u8; BLOCK]) -> [u8; BLOCK] {
    let mut staged = [0; BLOCK];
    let done = Target::Astc.transcode(block, &mut staged, [4, 4], false);
    assert_eq!(done, Ok(()));
    staged
}

fn shown(block: &[u8; BLOCK], srgb: bool) -> Texels {
    unpack_uastc(block, srgb)
        .expect("a block of UASTC")
        .map(|texel| texel.c)
}

/// The decoder rounds 16-bit values to 8 bits, where UASTC cuts them off.
#[test]
fn astc_shows_what_uastc_does_in_every_mode() {
    for (mode, block) in samples() {
        let mut read: Texels = [[0; 4]; 16];
        let valid = astc_decode_block(&astc(&block), Footprint::new(4, 4), |x, y, color| {
            read[(y * 4 + x) as usize] = color;
        });
        assert!(valid, "mode {mode}: {block:x?}");
        for (read, shown) in read.iter().zip(shown(&block, false)) {
            let apart = read
                .iter()
                .zip(shown)
                .map(|(read, shown)| read.abs_diff(shown));
            assert!(apart.max() <= Some(1), "mode {mode}: {read:?} {shown:?}");
        }
    }
}

/// What sRGB textures show of blocks with one subset and one plane: endpoints widened by half a code, their mean by
/// 64ths, its upper 8 bits (Khronos Data Format 1.3, chapter 23).
fn interpolated(block: &UnpackedUastcBlock, low_byte: impl Fn(u32) -> u32) -> Texels {
    let mode = block.mode as usize;
    let range = u32::from(tables::ENDPOINT_RANGES[mode]);
    let bits = u32::from(tables::WEIGHT_BITS[mode]);
    let components = usize::from(tables::COMPS[mode]);
    std::array::from_fn(|texel| {
        // Weights of n bits repeat their bits to six, and skip 32.
        let repeated = repeat(u32::from(block.astc.weights[texel]), bits);
        let weight = repeated + u32::from(repeated > 32);
        std::array::from_fn(|channel| {
            let component = match (components, channel) {
                (2, 3) => 1,
                (2, _) => 0,
                (3, 3) => return 255,
                _ => channel,
            };
            let [low, high] = [0, 1].map(|end| {
                let code = u32::from(block.astc.endpoints[2 * component + end]);
                let value = bise::unquant_astc_endpoint_val(code, range);
                value << 8 | low_byte(value)
            });
            ((low * (64 - weight) + high * weight + 32) / (64 * 256)) as u8
        })
    })
}

/// The first six bits of `code` written again and again.
fn repeat(code: u32, bits: u32) -> u32 {
    let times = 6_u32.div_ceil(bits);
    let all = (0..times).fold(0, |all, _| all << bits | code);
    all >> (times * bits - 6)
}

#[test]
fn plain_texels_follow_both_rules_of_expansion() {
    let mut differ = 0;
    for (mode, block) in samples() {
        let subsets = tables::SUBSETS[mode as usize];
        if mode == SOLID || subsets > 1 || tables::PLANES[mode as usize] > 1 {
            continue;
        }
        let unpacked = unpack_to_block(&block, false, false).expect("a block of UASTC");
        let [linear, srgb] = [false, true].map(|srgb| shown(&block, srgb));
        assert_eq!(
            linear,
            interpolated(&unpacked, |value| value),
            "mode {mode}"
        );
        assert_eq!(srgb, interpolated(&unpacked, |_| 0x80), "mode {mode}");
        differ += usize::from(linear != srgb);
    }
    assert!(differ > SAMPLES, "{differ} blocks tell the rules apart");
}
