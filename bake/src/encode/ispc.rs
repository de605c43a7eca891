//! BC7 by bc7e's ISPC kernels, for `Kernels::Native`.
//!
//! The library chooses a kernel by the CPU it runs on. Its kernels contract and approximate differently, and the
//! approximate reciprocals of one instruction set differ between vendors besides: the bytes depend on the CPU.

use ctt_bc7enc_rdo as bc7e;
pub(super) use ctt_bc7enc_rdo::bindings::bc7e_compress_block_params as Bc7Params;

use super::Quality;

/// Blocks of one call.
const BLOCKS_PER_CALL: usize = 64;

/// The bc7e settings of a quality, linear metric (equal weights: the data is not always colour).
fn bc7_params(quality: Quality) -> Bc7Params {
    match quality {
        Quality::Fast => bc7e::params_init_ultrafast(false),
        Quality::Default => bc7e::params_init_veryfast(false),
        Quality::Best => bc7e::params_init_slow(false),
    }
}

/// Compresses blocks of 16 RGBA texels to BC7 by the kernel for this CPU.
///
/// # Panics
/// If the slices differ in length.
pub(super) fn bc7(quality: Quality, blocks: &[[[u8; 4]; 16]], out: &mut [[u8; 16]]) {
    compress(&bc7_params(quality), blocks, out);
}

/// The same by any settings of bc7e.
pub(super) fn compress(params: &Bc7Params, blocks: &[[[u8; 4]; 16]], out: &mut [[u8; 16]]) {
    assert_eq!(blocks.len(), out.len());
    let mut texels = [[0_u32; 16]; BLOCKS_PER_CALL];
    let mut packed = [[0_u64; 2]; BLOCKS_PER_CALL];
    for (blocks, out) in blocks
        .chunks(BLOCKS_PER_CALL)
        .zip(out.chunks_mut(BLOCKS_PER_CALL))
    {
        for (texels, block) in texels.iter_mut().zip(blocks) {
            *texels = block.map(u32::from_le_bytes);
        }
        let (texels, packed) = (&texels[..blocks.len()], &mut packed[..blocks.len()]);
        bc7e::compress_blocks(packed.as_flattened_mut(), texels.as_flattened(), params);
        for (out, packed) in out.iter_mut().zip(packed) {
            *out = bytemuck::cast(packed.map(u64::to_le));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Smooth blocks with noise of several strengths.
    fn blocks() -> Vec<[[u8; 4]; 16]> {
        let mut state = 0x9e37_79b9_u32;
        let mut random = move || {
            state ^= state << 13;
            state ^= state >> 17;
            state ^= state << 5;
            state
        };
        (0..BLOCKS_PER_CALL)
            .map(|_| {
                let (base, noise) = (random() & 0x3f3f_3f3f, random() % 48 + 1);
                std::array::from_fn(|texel| {
                    (base + (texel as u32) * 0x0101_0101 + random() % noise).to_le_bytes()
                })
            })
            .collect()
    }

    #[test]
    fn blocks_do_not_depend_on_their_neighbours() {
        let blocks = blocks();
        let mut together = vec![[0; 16]; blocks.len()];
        bc7(Quality::Default, &blocks, &mut together);
        for (block, expected) in blocks.iter().zip(&together) {
            let mut alone = [[0; 16]];
            bc7(Quality::Default, std::slice::from_ref(block), &mut alone);
            assert_eq!(alone[0], *expected);
        }
    }
}
