//! Calls into the ISPC block compressors, by default pinned to kernels that agree on every x86-64 machine.
//!
//! The libraries choose a kernel by the CPU they run on, and their AVX2 and AVX-512 kernels contract and
//! approximate differently: the same image gives other blocks on another machine. The SSE2, SSE4 and AVX
//! kernels give equal bytes, so the default takes the widest of those that the CPU has.
#![allow(unsafe_code)]

use ctt_bc7enc_rdo as bc7e;
use ctt_bc7enc_rdo::bindings::bc7e_compress_block_params as Bc7Params;
use ctt_intel_texture_compressor::bindings::kernel::{CompressBlocksBC5_ispc, rgba_surface};

use super::{Kernels, Quality};

/// Blocks of one call: the encoders see the same groups whatever the number of threads.
pub(super) const BLOCKS_PER_CALL: usize = 64;

/// An instruction set whose kernels are linked by name.
#[cfg(target_arch = "x86_64")]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Isa {
    Sse2,
    Sse4,
    Avx,
}

#[cfg(target_arch = "x86_64")]
impl Isa {
    fn detect() -> Self {
        if is_x86_feature_detected!("avx") {
            Self::Avx
        } else if is_x86_feature_detected!("sse4.1") && is_x86_feature_detected!("sse4.2") {
            Self::Sse4
        } else {
            Self::Sse2
        }
    }
}

#[cfg(target_arch = "x86_64")]
mod pinned {
    use super::{Bc7Params, rgba_surface};

    unsafe extern "C" {
        pub fn bc7e_compress_block_init_sse2();
        pub fn bc7e_compress_block_init_sse4();
        pub fn bc7e_compress_block_init_avx();
        pub fn bc7e_compress_blocks_sse2(
            n: u32,
            out: *mut u64,
            px: *const u32,
            p: *const Bc7Params,
        );
        pub fn bc7e_compress_blocks_sse4(
            n: u32,
            out: *mut u64,
            px: *const u32,
            p: *const Bc7Params,
        );
        pub fn bc7e_compress_blocks_avx(n: u32, out: *mut u64, px: *const u32, p: *const Bc7Params);
        pub fn CompressBlocksBC5_ispc_sse2(source: *mut rgba_surface, out: *mut u8);
        pub fn CompressBlocksBC5_ispc_sse4(source: *mut rgba_surface, out: *mut u8);
        pub fn CompressBlocksBC5_ispc_avx(source: *mut rgba_surface, out: *mut u8);
    }
}

/// The bc7e settings of a quality, linear metric (equal weights: the data is not always colour).
pub(super) fn bc7_params(quality: Quality) -> Bc7Params {
    match quality {
        Quality::Fast => bc7e::params_init_ultrafast(false),
        Quality::Default => bc7e::params_init_veryfast(false),
        Quality::Best => bc7e::params_init_slow(false),
    }
}

/// Compresses whole blocks of 16 RGBA8 texels (little-endian, red lowest) to BC7.
///
/// # Panics
/// If the slices differ in length.
pub(super) fn bc7(
    kernels: Kernels,
    params: &Bc7Params,
    blocks: &[[u32; 16]],
    out: &mut [[u64; 2]],
) {
    assert_eq!(blocks.len(), out.len());
    match kernels {
        Kernels::Native => {
            bc7e::compress_blocks(out.as_flattened_mut(), blocks.as_flattened(), params);
        }
        #[cfg(target_arch = "x86_64")]
        Kernels::Reproducible => bc7_pinned(Isa::detect(), params, blocks, out),
        #[cfg(not(target_arch = "x86_64"))]
        Kernels::Reproducible => {
            bc7e::compress_blocks(out.as_flattened_mut(), blocks.as_flattened(), params);
        }
    }
}

#[cfg(target_arch = "x86_64")]
fn bc7_pinned(isa: Isa, params: &Bc7Params, blocks: &[[u32; 16]], out: &mut [[u64; 2]]) {
    use std::sync::Once;

    static INIT: [Once; 3] = [const { Once::new() }; 3];
    let (init, compress) = match isa {
        Isa::Sse2 => (
            pinned::bc7e_compress_block_init_sse2 as unsafe extern "C" fn(),
            pinned::bc7e_compress_blocks_sse2
                as unsafe extern "C" fn(u32, *mut u64, *const u32, *const Bc7Params),
        ),
        Isa::Sse4 => (
            pinned::bc7e_compress_block_init_sse4 as _,
            pinned::bc7e_compress_blocks_sse4 as _,
        ),
        Isa::Avx => (
            pinned::bc7e_compress_block_init_avx as _,
            pinned::bc7e_compress_blocks_avx as _,
        ),
    };
    // SAFETY: it fills this instruction set's tables, once, and the CPU has the instructions.
    INIT[isa as usize].call_once(|| unsafe { init() });
    let count = u32::try_from(blocks.len()).expect("a call takes at most BLOCKS_PER_CALL blocks");
    // SAFETY: the kernel reads 16 texels and writes two u64 for each of `count` blocks; both slices hold
    // `count` (asserted by `bc7`), `params` outlives the call, the tables are initialised.
    unsafe {
        compress(
            count,
            out.as_flattened_mut().as_mut_ptr(),
            blocks.as_flattened().as_ptr(),
            params,
        );
    }
}

/// Compresses the first two channels of whole blocks to BC5, in the block layout of `bc7`.
///
/// # Panics
/// If the slices differ in length, or hold more than `BLOCKS_PER_CALL`.
pub(super) fn bc5(kernels: Kernels, blocks: &[[u32; 16]], out: &mut [[u64; 2]]) {
    #[cfg(target_arch = "x86_64")]
    let compress = match (kernels, Isa::detect()) {
        (Kernels::Native, _) => CompressBlocksBC5_ispc,
        (Kernels::Reproducible, isa) => bc5_pinned(isa),
    };
    #[cfg(not(target_arch = "x86_64"))]
    let compress = {
        let _ = kernels;
        CompressBlocksBC5_ispc
    };
    bc5_with(compress, blocks, out);
}

type CompressBc5 = unsafe extern "C" fn(*mut rgba_surface, *mut u8);

#[cfg(target_arch = "x86_64")]
fn bc5_pinned(isa: Isa) -> CompressBc5 {
    match isa {
        Isa::Sse2 => pinned::CompressBlocksBC5_ispc_sse2,
        Isa::Sse4 => pinned::CompressBlocksBC5_ispc_sse4,
        Isa::Avx => pinned::CompressBlocksBC5_ispc_avx,
    }
}

/// The kernel reads an image, so the blocks are laid side by side in one of four rows.
fn bc5_with(compress: CompressBc5, blocks: &[[u32; 16]], out: &mut [[u64; 2]]) {
    assert_eq!(blocks.len(), out.len());
    assert!(blocks.len() <= BLOCKS_PER_CALL);
    // Two RG texels a word; rows of `2 * blocks.len()` words.
    let mut image = [0_u32; BLOCKS_PER_CALL * 8];
    let row_words = blocks.len() * 2;
    for (index, block) in blocks.iter().enumerate() {
        for (pair, texels) in block.as_chunks::<2>().0.iter().enumerate() {
            let word = (texels[0] & 0xffff) | (texels[1] << 16);
            image[(pair / 2) * row_words + index * 2 + pair % 2] = word;
        }
    }
    let mut surface = rgba_surface {
        ptr: image.as_mut_ptr().cast(),
        width: (blocks.len() * 4) as i32,
        height: 4,
        stride: (row_words * 4) as i32,
    };
    // SAFETY: `image` holds four rows of `stride` bytes, `out` 16 bytes for each of the `width / 4` blocks
    // of the only row; the kernel reads the one and writes the other, and the CPU has its instructions.
    unsafe { compress(&mut surface, out.as_mut_ptr().cast()) };
}

#[cfg(all(test, target_arch = "x86_64"))]
mod tests {
    use super::*;

    /// Smooth blocks, noise, flat ones, and translucent ones.
    fn blocks() -> Vec<[u32; 16]> {
        let mut state = 0x9e37_79b9_u32;
        let mut random = move || {
            state ^= state << 13;
            state ^= state >> 17;
            state ^= state << 5;
            state
        };
        (0..1024_u32)
            .map(|index| {
                let (base, noise) = (random(), random() % 48 + 1);
                std::array::from_fn(|texel| {
                    let alpha = if index % 3 == 0 { random() & 0xff } else { 255 };
                    let channel = |shift: u32, slope: u32, jitter: u32| {
                        let centre = (base >> shift & 0xff) / 2 + slope * texel as u32 / 4;
                        ((centre + jitter % noise) & 0xff) << shift
                    };
                    let colour = channel(0, index % 17, random())
                        | channel(8, index % 11, random())
                        | channel(16, index % 7, random());
                    colour | alpha << 24
                })
            })
            .collect()
    }

    fn runnable() -> Vec<Isa> {
        let all = [Isa::Sse2, Isa::Sse4, Isa::Avx];
        all.into_iter()
            .filter(|&isa| isa as usize <= Isa::detect() as usize)
            .collect()
    }

    #[test]
    fn bc7_bytes_do_not_depend_on_the_instruction_set() {
        let blocks = blocks();
        for quality in [Quality::Fast, Quality::Default, Quality::Best] {
            let params = bc7_params(quality);
            let results: Vec<Vec<[u64; 2]>> = runnable()
                .into_iter()
                .map(|isa| {
                    let mut out = vec![[0; 2]; blocks.len()];
                    bc7_pinned(isa, &params, &blocks, &mut out);
                    out
                })
                .collect();
            assert!(results[0].iter().all(|block| *block != [0; 2]));
            for result in &results[1..] {
                assert!(result == &results[0], "{quality:?}");
            }
        }
    }

    #[test]
    fn bc5_bytes_do_not_depend_on_the_instruction_set() {
        let blocks = blocks();
        let results: Vec<Vec<[u64; 2]>> = runnable()
            .into_iter()
            .map(|isa| {
                let mut out = vec![[0; 2]; blocks.len()];
                for (blocks, out) in blocks
                    .chunks(BLOCKS_PER_CALL)
                    .zip(out.chunks_mut(BLOCKS_PER_CALL))
                {
                    bc5_with(bc5_pinned(isa), blocks, out);
                }
                out
            })
            .collect();
        for result in &results[1..] {
            assert!(result == &results[0]);
        }
    }

    #[test]
    fn blocks_do_not_depend_on_their_neighbours() {
        let blocks = blocks();
        let params = bc7_params(Quality::Default);
        let mut together = vec![[0; 2]; 64];
        bc7(Kernels::Reproducible, &params, &blocks[..64], &mut together);
        for (block, expected) in blocks.iter().zip(&together) {
            let mut alone = [[0; 2]];
            bc7(
                Kernels::Reproducible,
                &params,
                std::slice::from_ref(block),
                &mut alone,
            );
            assert_eq!(alone[0], *expected);
        }
    }
}
