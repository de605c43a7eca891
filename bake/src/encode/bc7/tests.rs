//! Tests of whole blocks: exactness, error floors, opacity, determinism.

use super::*;

const QUALITIES: [Quality; 3] = [Quality::Fast, Quality::Default, Quality::Best];

type Texels16 = [[u8; 4]; 16];

/// One block whose alpha is read.
fn compress_block(block: &Texels16, quality: Quality) -> [u8; 16] {
    let mut out = [[0; 16]];
    compress(std::slice::from_ref(block), quality, true, &mut out);
    out[0]
}

fn compressed(blocks: &[Texels16], quality: Quality, alpha_is_read: bool) -> Vec<[u8; 16]> {
    let mut out = vec![[0; 16]; blocks.len()];
    compress(blocks, quality, alpha_is_read, &mut out);
    out
}

/// A deterministic stream of integers.
pub(super) fn random(seed: u64) -> impl FnMut() -> u32 {
    let mut state = seed.wrapping_mul(0x9e37_79b9_7f4a_7c15) | 1;
    move || {
        state ^= state << 13;
        state ^= state >> 7;
        state ^= state << 17;
        (state >> 32) as u32
    }
}

pub(super) fn decode(block: &[u8; 16]) -> Texels16 {
    let mut codes = [[0_u8; 4]; 16];
    bcdec_rs::bc7(block, codes.as_flattened_mut(), 16);
    codes
}

fn squared_error(a: &Texels16, b: &Texels16) -> u32 {
    let pairs = a.as_flattened().iter().zip(b.as_flattened());
    pairs.map(|(&a, &b)| u32::from(a.abs_diff(b)).pow(2)).sum()
}

/// Of all four channels.
fn psnr(blocks: &[Texels16], quality: Quality) -> f64 {
    let out = compressed(blocks, quality, true);
    let pairs = blocks.iter().zip(&out);
    let error: f64 = pairs
        .map(|(block, out)| f64::from(squared_error(block, &decode(out))))
        .sum();
    let mean = error / (blocks.len() as f64 * 64.0);
    -10.0 * (mean / (255.0 * 255.0)).log10()
}

/// A slope of each channel, with noise of an amplitude.
fn gradients(opaque: bool, noise: u32) -> Vec<Texels16> {
    let mut random = random(17);
    (0..512)
        .map(|_| {
            let base = [0; 4].map(|_: u32| 40 + random() % 120);
            let slope = [[0; 2]; 4].map(|pair| pair.map(|_: u32| random() % 13));
            std::array::from_fn(|texel| {
                let (x, y) = (texel as u32 % 4, texel as u32 / 4);
                let mut code = [0, 1, 2, 3].map(|channel| {
                    let [dx, dy]: [u32; 2] = slope[channel];
                    (base[channel] + dx * x + dy * y + random() % (noise + 1)) as u8
                });
                if opaque {
                    code[3] = 255;
                }
                code
            })
        })
        .collect()
}

/// Noise, and two colours along a line, opaque and not.
fn noise_and_edges() -> Vec<Texels16> {
    let mut random = random(29);
    (0..512)
        .map(|index| {
            let colors = [[0_u8; 4]; 2].map(|color| color.map(|_| random() as u8));
            let line = [random() % 7, random() % 7, random() % 16];
            std::array::from_fn(|texel| {
                let (x, y) = (texel as u32 % 4, texel as u32 / 4);
                let mut code = match index % 4 {
                    0 => [0_u8; 4].map(|_| random() as u8),
                    _ => colors[usize::from(line[0] * x + line[1] * y > line[2])],
                };
                if index % 2 == 0 {
                    code[3] = 255;
                }
                code
            })
        })
        .collect()
}

#[test]
fn blocks_of_one_colour_are_exact() {
    let mut random = random(7);
    let greys = (0..=255).map(|grey| [grey, grey, grey, 255]);
    let colors: Vec<[u8; 4]> = (0..1000).map(|_| random().to_le_bytes()).collect();
    for color in greys.chain(colors) {
        for quality in QUALITIES {
            assert_eq!(decode(&compress_block(&[color; 16], quality)), [color; 16]);
        }
    }
}

fn is_solid(texels: &Texels16) -> bool {
    texels[1..].iter().all(|texel| *texel == texels[0])
}

/// The search measures what a decoder will see, bit for bit.
#[test]
fn the_error_of_the_search_is_that_of_the_block() {
    let blocks = [
        gradients(true, 9),
        gradients(false, 9),
        gradients(true, 0),
        noise_and_edges(),
    ]
    .concat();
    let mut modes = [0; 8];
    for quality in QUALITIES {
        for (opaque, alpha) in [(false, Alpha::Varies), (true, Alpha::Opaque)] {
            let is_of_kind = |block: &&Texels16| {
                !is_solid(block) && block.iter().all(|texel| texel[3] == 255) == opaque
            };
            let blocks: Vec<&Texels16> = blocks.iter().filter(is_of_kind).step_by(4).collect();
            let packed: Vec<Packed> = blocks.iter().map(|block| Packed::new(block)).collect();
            let search = Search {
                simd: pulp::Scalar::new(),
                blocks: &packed,
                alpha,
                preset: preset(quality),
            };
            let kept = search.preset.kept;
            let mut found = search.find();
            for polished in [false, true] {
                if polished {
                    search.polish(&mut found);
                }
                // Each of the ways kept as if it were the best.
                for rank in 0..kept {
                    let mut firsts = found.clone();
                    firsts.rotate_left(rank);
                    search.pack(&firsts, |slot, block| {
                        let slot = slot as usize;
                        let job = &found[slot * kept + rank];
                        if job.error.is_finite() {
                            let error = squared_error(blocks[slot], &decode(&block));
                            assert_eq!(job.error, error as f32, "{job:?} {quality:?}");
                            modes[usize::from(job.way.mode)] += 1;
                        }
                    });
                }
            }
        }
    }
    assert!(modes.iter().all(|count| *count > 0), "{modes:?}");
}

/// Alpha that nobody reads is stored as 254 where that serves colour, and colour is the better for it.
#[test]
fn ignored_alpha_serves_colour() {
    let blocks = gradients(true, 5);
    let color = |block: &Texels16| block.map(|[r, g, b, _]| [r, g, b, 255]);
    for quality in QUALITIES {
        let error = |alpha_is_read| -> u32 {
            let out = compressed(&blocks, quality, alpha_is_read);
            blocks
                .iter()
                .zip(&out)
                .map(|(block, out)| {
                    let decoded = decode(out);
                    assert!(decoded.iter().all(|texel| texel[3] >= 254));
                    squared_error(block, &color(&decoded))
                })
                .sum()
        };
        let (read, ignored) = (error(true), error(false));
        assert!(ignored < read, "{quality:?}: {ignored} {read}");
    }
}

/// What a block becomes depends neither on its neighbours nor on how many are searched side by side.
#[test]
fn blocks_are_the_same_in_any_company() {
    let blocks = [gradients(true, 9), gradients(false, 5), noise_and_edges()].concat();
    for (quality, alpha_is_read) in QUALITIES.into_iter().flat_map(|q| [(q, true), (q, false)]) {
        let step = if quality == Quality::Best { 24 } else { 4 };
        let blocks: Vec<Texels16> = blocks.iter().step_by(step).copied().collect();
        let together = compressed(&blocks, quality, alpha_is_read);
        for (block, expected) in blocks.iter().zip(&together) {
            let alone = compressed(std::slice::from_ref(block), quality, alpha_is_read);
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
            alpha_is_read: false,
            preset: preset(quality),
            out: &mut out,
        });
        out
    }
    let blocks = [gradients(true, 9), gradients(false, 5), noise_and_edges()].concat();
    for quality in QUALITIES {
        let step = if quality == Quality::Best { 12 } else { 3 };
        let blocks: Vec<Texels16> = blocks.iter().step_by(step).copied().collect();
        let one = run(pulp::Scalar::new(), &blocks, quality);
        assert!(one == compressed(&blocks, quality, false), "{quality:?}");
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
fn opaque_blocks_stay_opaque() {
    let edges = noise_and_edges();
    for texels in gradients(true, 3).iter().chain(&edges) {
        if texels.iter().any(|texel| texel[3] != 255) {
            continue;
        }
        for quality in QUALITIES {
            let decoded = decode(&compress_block(texels, quality));
            assert!(decoded.iter().all(|texel| texel[3] == 255), "{texels:?}");
        }
    }
}

#[test]
fn error_is_bounded_and_falls_with_quality() {
    for (name, blocks, floors) in [
        ("smooth", gradients(true, 0), FLOORS[0]),
        ("noisy", gradients(true, 9), FLOORS[1]),
        ("translucent", gradients(false, 3), FLOORS[2]),
        ("noise and edges", noise_and_edges(), FLOORS[3]),
    ] {
        let found = QUALITIES.map(|quality| psnr(&blocks, quality));
        assert!(
            found[0] <= found[1] && found[1] <= found[2],
            "{name}: {found:?}"
        );
        for (found, floor) in found.into_iter().zip(floors) {
            assert!(found > floor, "{name}: {found} {floor}");
        }
    }
}

/// Decibels of each quality, half a decibel below what was measured.
const FLOORS: [[f64; 3]; 4] = [
    [40.5, 43.7, 44.0],
    [38.4, 40.7, 40.8],
    [38.5, 38.9, 39.0],
    [23.1, 24.6, 25.0],
];

#[test]
fn edges_of_two_opaque_colours_are_nearly_exact() {
    let blocks = noise_and_edges();
    let edges = blocks.iter().skip(2).step_by(4);
    let worst = edges
        .map(|block| squared_error(block, &decode(&compress_block(block, Quality::Best))))
        .max();
    assert!(worst.is_some_and(|worst| worst <= 48), "{worst:?}");
}

/// The bytes of a fixed image, by FNV-1a. A machine that computes otherwise, or a change of the encoder, fails;
/// after a change of the encoder the numbers are to be renewed.
#[test]
fn bytes_are_the_same_on_every_machine() {
    let blocks = [gradients(true, 9), gradients(false, 5), noise_and_edges()].concat();
    let hashes = QUALITIES.map(|quality| {
        let mut hash = 0xcbf2_9ce4_8422_2325_u64;
        for byte in compressed(&blocks, quality, true).as_flattened() {
            hash = (hash ^ u64::from(*byte)).wrapping_mul(0x0100_0000_01b3);
        }
        hash
    });
    assert_eq!(hashes, GOLDEN, "{hashes:#018x?}");
}

const GOLDEN: [u64; 3] = [
    0x2ab8_4d14_3253_6b3d,
    0x6142_599b_fea9_09bc,
    0x2255_93f1_637c_8afa,
];
