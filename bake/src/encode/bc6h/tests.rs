use half::f16;

use super::super::partition;
use super::modes::{Fields, MODES, Mode, PARTITIONS};
use super::*;

type Texels16 = [[u16; 3]; 16];

const QUALITIES: [Quality; 3] = Quality::ALL;

fn compressed(blocks: &[Texels16], quality: Quality) -> Vec<[u8; 16]> {
    let mut out = vec![[0; 16]; blocks.len()];
    compress(blocks, quality, &mut out);
    out
}

fn stored(texels: &Texels16, quality: Quality) -> Texels16 {
    decompress_block(&compressed(std::slice::from_ref(texels), quality)[0])
}

fn squared_error(a: &Texels16, b: &Texels16) -> f64 {
    let pairs = a.as_flattened().iter().zip(b.as_flattened());
    pairs.map(|(a, b)| f64::from(a.abs_diff(*b)).powi(2)).sum()
}

fn bits(value: f32) -> u16 {
    f16::from_f32(value).to_bits()
}

fn random(mut state: u32) -> impl FnMut() -> u32 {
    move || {
        state ^= state << 13;
        state ^= state >> 17;
        state ^= state << 5;
        state
    }
}

/// Gradients of every steepness, of which every third is two flat parts, every fourth has noise on it; in between
/// blocks of noise alone.
fn blocks() -> Vec<Texels16> {
    let mut random = random(0x1234_5678);
    let mut unit = move || (random() >> 8) as f32 / (1 << 24) as f32;
    (0..600)
        .map(|index| {
            let base = [0; 3].map(|_| 300.0 + 28_000.0 * unit());
            let reach = libm::powf(2.0, 14.0 * unit());
            let slope = [0; 3].map(|_| reach * (unit() - 0.3));
            let (angle, noise) = ([unit() - 0.5, unit() - 0.5], 0.05 * reach * unit());
            std::array::from_fn(|texel| {
                let along = angle[0] * (texel % 4) as f32 + angle[1] * (texel / 4) as f32;
                let along = match index % 3 {
                    0 => f32::from(along > 0.4),
                    _ => along,
                };
                [0, 1, 2].map(|k| {
                    let value = if index % 10 == 9 {
                        30_000.0 * unit()
                    } else if index % 4 == 0 {
                        base[k] + slope[k] * along + noise * unit()
                    } else {
                        base[k] + slope[k] * along
                    };
                    value.clamp(0.0, f32::from(LARGEST)) as u16
                })
            })
        })
        .collect()
}

/// The 16-bit value of a stored endpoint.
fn unquantise(stored: i32, bits: u32) -> i32 {
    match stored {
        0 => 0,
        _ if bits >= 15 => stored,
        _ if stored == (1 << bits) - 1 => 0xffff,
        _ => ((stored << 16) + 0x8000) >> bits,
    }
}

/// What the specification makes of fields.
fn meaning(fields: &Fields) -> Texels16 {
    const THREE: [i32; 8] = [0, 9, 18, 27, 37, 46, 55, 64];
    const FOUR: [i32; 16] = [0, 4, 9, 13, 17, 21, 26, 30, 34, 38, 43, 47, 51, 55, 60, 64];
    let mode = &MODES[fields.mode];
    let second = partition::masks(mode.regions, fields.partition)[1];
    std::array::from_fn(|texel| {
        let [low, high] = fields.ends[usize::from(second >> texel & 1 == 1)];
        let index = usize::from(fields.indices[texel]);
        let weight = if mode.regions == 2 {
            THREE[index]
        } else {
            FOUR[index]
        };
        [0, 1, 2].map(|k| {
            let [low, high] = [low[k], high[k]].map(|end| unquantise(end, mode.bits));
            let mixed = (low * (64 - weight) + high * weight + 32) >> 6;
            ((mixed * 31) >> 6) as u16
        })
    })
}

#[test]
fn every_mode_is_decoded_as_it_was_meant() {
    let mut random = random(99);
    for mode in 0..MODES.len() {
        for partition in 0..PARTITIONS {
            let Mode {
                regions,
                bits,
                deltas,
                ..
            } = MODES[mode];
            let mut fields = Fields {
                mode,
                partition: if regions == 2 { partition } else { 0 },
                ..Fields::NONE
            };
            let top = (1 << bits) - 1;
            for k in 0..3 {
                // All of the first endpoint's bits, and of the others' or of their differences.
                let base = random() as i32 & top;
                for at in 0..2 * regions {
                    let delta = if deltas[k] == 0 {
                        (random() as i32 & top) - base
                    } else {
                        let half = 1 << (deltas[k] - 1);
                        (random() as i32).rem_euclid(2 * half) - half
                    };
                    let end = if at == 0 { base } else { base + delta };
                    fields.ends[at / 2][at % 2][k] = end.clamp(0, top);
                }
            }
            let anchors = partition::anchors(regions, fields.partition);
            for texel in 0..16 {
                let is_anchor = texel == 0 || (regions == 2 && texel == usize::from(anchors[1]));
                let count = (if regions == 2 { 8 } else { 16 }) >> u32::from(is_anchor);
                fields.indices[texel] = (random() % count) as u8;
            }
            let decoded = decompress_block(&fields.pack());
            assert_eq!(decoded, meaning(&fields), "mode {mode}: {fields:?}");
        }
    }
}

#[test]
fn blocks_of_one_colour_are_exact() {
    let mut random = random(7);
    let greys = [0, 1, 2, 31, 0x3ff, 0x400, 0x3c00, LARGEST - 1, LARGEST].map(|grey| [grey; 3]);
    let colors = (0..1000).map(|_| {
        [0; 3]
            .map(|_| random() as u16 & 0x7fff)
            .map(|bits| bits.min(LARGEST))
    });
    let blocks: Vec<Texels16> = greys
        .into_iter()
        .chain(colors)
        .map(|color| [color; 16])
        .collect();
    for quality in QUALITIES {
        for (block, out) in blocks.iter().zip(compressed(&blocks, quality)) {
            assert_eq!(decompress_block(&out), *block);
        }
    }
}

#[test]
fn bits_above_half_are_clamped() {
    for quality in QUALITIES {
        let decoded = stored(&[[0x7c00, 0xffff, 0]; 16], quality);
        assert_eq!(decoded, [[LARGEST, LARGEST, 0]; 16]);
    }
}

/// One texel of the sun in the dark: both stay what they are within a few steps of half floats.
#[test]
fn one_extreme_texel_spares_the_others() {
    for (dark, bright) in [(0.01, 65504.0), (0.0, 65504.0), (1e-7, 1.0), (0.3, 1000.0)] {
        for place in 0..16 {
            let mut texels = [[bits(dark); 3]; 16];
            texels[place] = [bits(bright), bits(0.9 * bright), bits(0.7 * bright)];
            for quality in QUALITIES {
                for (a, b) in texels.iter().zip(stored(&texels, quality)) {
                    for k in 0..3 {
                        assert!(a[k].abs_diff(b[k]) < 32, "{quality:?} {place}: {a:?} {b:?}");
                    }
                }
            }
        }
    }
}

/// Within half a step of 12 bits.
#[test]
fn denormals_stay_small() {
    let texels: Texels16 = std::array::from_fn(|i| [i as u16, 3 * i as u16, 40]);
    for quality in QUALITIES {
        for (a, b) in texels.iter().zip(stored(&texels, quality)) {
            assert!((0..3).all(|k| a[k].abs_diff(b[k]) <= 4), "{a:?} {b:?}");
        }
    }
}

#[test]
fn gradients_are_close() {
    let texels = std::array::from_fn(|i| {
        let value = 1.0 + 0.01 * i as f32;
        [bits(value), bits(0.8 * value), bits(0.3 * value)]
    });
    for quality in QUALITIES {
        let decoded = stored(&texels, quality);
        for (a, b) in texels.as_flattened().iter().zip(decoded.as_flattened()) {
            let [a, b] = [a, b].map(|bits| f16::from_bits(*bits).to_f64());
            assert!((a - b).abs() < 5e-3 * a, "{quality:?}: {a} {b}");
        }
    }
}

/// The search measures what a decoder will see, but for its roundings: half a step each of two.
#[test]
fn the_error_of_the_search_is_that_of_the_block() {
    let blocks = blocks();
    let mut modes = [0; 14];
    for quality in QUALITIES {
        let compress = Compress {
            blocks: &blocks,
            preset: preset(quality),
            out: &mut [],
        };
        for (block, choice) in blocks.iter().zip(compress.find(pulp::Scalar::new())) {
            let decoded = decompress_block(&choice.fields.pack());
            assert_eq!(decoded, meaning(&choice.fields));
            let (found, error) = (f64::from(choice.error), squared_error(block, &decoded));
            let off = (found.sqrt() - error.sqrt()).abs();
            assert!(off <= 48.0_f64.sqrt(), "{found} {error}");
            modes[choice.fields.mode] += 1;
        }
    }
    assert!(modes.iter().all(|count| *count > 0), "{modes:?}");
}

/// What a block becomes depends neither on its neighbours nor on how many are searched side by side.
#[test]
fn blocks_are_the_same_in_any_company() {
    let blocks = blocks();
    for quality in QUALITIES {
        let together = compressed(&blocks, quality);
        for (block, expected) in blocks.iter().zip(&together).step_by(7) {
            let alone = compressed(std::slice::from_ref(block), quality);
            assert_eq!(alone[0], *expected, "{quality:?}");
        }
    }
}

/// The same bytes with one block at a time, and with each vector unit that this machine has.
#[test]
fn bytes_do_not_depend_on_the_instruction_set() {
    fn run<S: Simd>(simd: S, blocks: &[Texels16], quality: Quality) -> Vec<[u8; 16]> {
        let mut out = vec![[0; 16]; blocks.len()];
        simd.vectorize(Compress {
            blocks,
            preset: preset(quality),
            out: &mut out,
        });
        out
    }
    let blocks = blocks();
    for quality in QUALITIES {
        let one = run(pulp::Scalar::new(), &blocks, quality);
        assert!(one == compressed(&blocks, quality), "{quality:?}");
        #[cfg(target_arch = "x86_64")]
        {
            if let Some(simd) = pulp::x86::V3::try_new() {
                assert!(one == run(simd, &blocks, quality), "{quality:?} AVX2");
            }
            if let Some(simd) = pulp::x86::V4::try_new() {
                assert!(one == run(simd, &blocks, quality), "{quality:?} AVX-512");
            }
        }
    }
}

#[test]
fn error_is_bounded_and_falls_with_quality() {
    let mut index = 0;
    let mut blocks = blocks();
    // Noise alone would outweigh the rest.
    blocks.retain(|_| {
        index += 1;
        index % 10 != 0
    });
    let found = QUALITIES.map(|quality| {
        let out = compressed(&blocks, quality);
        let pairs = blocks.iter().zip(&out);
        let sum: f64 = pairs
            .map(|(block, out)| squared_error(block, &decompress_block(out)))
            .sum();
        (sum / (48 * blocks.len()) as f64).sqrt()
    });
    eprintln!("{found:?} steps of half floats");
    assert!(found[0] > found[1] && found[1] > found[2], "{found:?}");
    for (found, bound) in found.into_iter().zip(BOUNDS) {
        assert!(found < bound, "{found} {bound}");
    }
}

/// Root mean squares of each quality in steps of half floats, a twentieth above what was measured.
const BOUNDS: [f64; 3] = [39.4, 29.1, 26.8];

/// The bytes of fixed blocks, by FNV-1a. A machine that computes otherwise, or a change of the encoder, fails; after a
/// change of the encoder the numbers are to be renewed.
#[test]
fn bytes_are_the_same_on_every_machine() {
    let blocks = blocks();
    let hashes = QUALITIES.map(|quality| {
        let mut hash = 0xcbf2_9ce4_8422_2325_u64;
        for byte in compressed(&blocks, quality).as_flattened() {
            hash = (hash ^ u64::from(*byte)).wrapping_mul(0x0100_0000_01b3);
        }
        hash
    });
    assert_eq!(hashes, GOLDEN, "{hashes:#018x?}");
}

const GOLDEN: [u64; 3] = [
    0x0495_8fd9_9b39_75cf,
    0xab80_5572_bb1f_7def,
    0x3f13_0e00_f505_281a,
];
