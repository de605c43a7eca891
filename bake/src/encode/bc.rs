//! Block compression of 8-bit images, edge blocks included.

use cairn_format::TextureFormat;
use rayon::prelude::*;

use super::ispc::{self, BLOCKS_PER_CALL};
use super::{EncodeOptions, Kernels, Quality, Role, bc5, bc7};

/// A 4x4 block, decoded to four channels in [0,1]; absent channels are 0, absent alpha 1.
pub(super) type Block = [[f32; 4]; 16];

/// An image in the precisions that the encoders read; both have `width * height` texels.
pub(super) struct Image<'a> {
    pub width: u32,
    pub height: u32,
    /// 8-bit RGBA.
    pub codes: &'a [[u8; 4]],
    /// The level in the role's filterable space.
    pub exact: &'a [[f32; 4]],
}

/// Compresses an image to `format.level_bytes(width, height)` bytes, blocks in rows; blocks across the edge
/// repeat the last row and column.
pub(super) fn compress(role: Role, image: &Image, options: &EncodeOptions) -> Vec<u8> {
    let across = image.width.div_ceil(4) as usize;
    let count = across * image.height.div_ceil(4) as usize;
    let mut out = vec![0_u8; count * 16];
    out.par_chunks_mut(BLOCKS_PER_CALL * 16)
        .enumerate()
        .for_each(|(call, bytes)| {
            let position = |index: usize| {
                let index = call * BLOCKS_PER_CALL + index;
                [index % across, index / across]
            };
            if role != Role::Normal && options.kernels == Kernels::Native {
                return image.compress_ispc(options.quality, position, bytes);
            }
            for (index, block) in bytes.as_chunks_mut::<16>().0.iter_mut().enumerate() {
                *block = image.compress_block(role, options, position(index));
            }
        });
    out
}

impl Image<'_> {
    /// One block by our own encoders.
    fn compress_block(&self, role: Role, options: &EncodeOptions, block: [usize; 2]) -> [u8; 16] {
        if role == Role::Normal {
            let texels = self.gather(self.exact, block);
            return bc5::compress_block(&texels.map(|texel| {
                let [x, y, ..] = role.stored(texel);
                [x, y]
            }));
        }
        bc7::compress_block(&self.gather(self.codes, block), options.quality)
    }

    /// The colour or data blocks at `position` by the ISPC kernels, `BLOCKS_PER_CALL` at most.
    fn compress_ispc(
        &self,
        quality: Quality,
        position: impl Fn(usize) -> [usize; 2],
        bytes: &mut [u8],
    ) {
        let count = bytes.len() / 16;
        let mut blocks = [[0_u32; 16]; BLOCKS_PER_CALL];
        let mut packed = [[0_u64; 2]; BLOCKS_PER_CALL];
        for (index, block) in blocks[..count].iter_mut().enumerate() {
            *block = self
                .gather(self.codes, position(index))
                .map(u32::from_le_bytes);
        }
        let (blocks, packed) = (&blocks[..count], &mut packed[..count]);
        ispc::bc7(quality, blocks, packed);
        bytes.copy_from_slice(bytemuck::cast_slice(packed));
    }

    /// The 16 texels of the block at `[column, row]`.
    fn gather<T: Copy>(&self, texels: &[T], block: [usize; 2]) -> [T; 16] {
        let (width, height) = (self.width as usize, self.height as usize);
        std::array::from_fn(|texel| {
            let x = (block[0] * 4 + texel % 4).min(width - 1);
            let y = (block[1] * 4 + texel / 4).min(height - 1);
            texels[y * width + x]
        })
    }
}

/// Decodes one 16-byte block as the GPU would: BC7 to 8-bit values, BC5 interpolated in f32.
///
/// # Panics
/// If `format` is neither BC7 nor BC5.
pub(super) fn decode_block(format: TextureFormat, bytes: &[u8]) -> Block {
    match format {
        TextureFormat::Bc7Unorm | TextureFormat::Bc7Srgb => {
            decode_bc7(bytes).map(|texel| texel.map(|code| f32::from(code) / 255.0))
        }
        TextureFormat::Bc5Unorm => {
            let mut values = [0.0_f32; 32];
            bcdec_rs::bc5_float(bytes, &mut values, 8, false);
            std::array::from_fn(|texel| [values[2 * texel], values[2 * texel + 1], 0.0, 1.0])
        }
        _ => unreachable!("{format:?} is not a format of this stage"),
    }
}

/// Decodes one BC7 block to RGBA codes.
pub(super) fn decode_bc7(bytes: &[u8]) -> [[u8; 4]; 16] {
    let mut codes = [[0_u8; 4]; 16];
    bcdec_rs::bc7(bytes, codes.as_flattened_mut(), 16);
    codes
}

/// The alpha codes of a BC7 level, row by row.
pub(super) fn decode_alpha(level: &[u8], width: u32, height: u32) -> Vec<u8> {
    let (width, height) = (width as usize, height as usize);
    let mut alpha = vec![0_u8; width * height];
    let blocks_across = width.div_ceil(4);
    alpha
        .par_chunks_mut(width * 4)
        .zip(level.par_chunks(blocks_across * 16))
        .for_each(|(rows, blocks)| {
            for (block_x, block) in blocks.chunks_exact(16).enumerate() {
                let codes = decode_bc7(block);
                for (y, row) in rows.chunks_mut(width).enumerate() {
                    for x in block_x * 4..(block_x * 4 + 4).min(width) {
                        row[x] = codes[y * 4 + x % 4][3];
                    }
                }
            }
        });
    alpha
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn edge_blocks_repeat_the_last_row_and_column() {
        // A 5x3 image whose codes name their own position.
        let codes: Vec<[u8; 4]> = (0..15)
            .map(|index| [index % 5, index / 5, 0, 255])
            .collect();
        let image = Image {
            width: 5,
            height: 3,
            codes: &codes,
            exact: &[],
        };
        let block = image.gather(image.codes, [1, 0]);
        for (texel, code) in block.into_iter().enumerate() {
            assert_eq!(code, [4, (texel / 4).min(2) as u8, 0, 255]);
        }
    }

    #[test]
    fn alpha_is_decoded_in_place() {
        let (width, height) = (7, 5);
        let codes: Vec<[u8; 4]> = (0..width * height)
            .map(|index| [90, 90, 90, if index % width < 4 { 255 } else { 0 }])
            .collect();
        let options = EncodeOptions::default();
        let image = Image {
            width,
            height,
            codes: &codes,
            exact: &[],
        };
        let level = compress(Role::Color, &image, &options);
        let expected: Vec<u8> = codes.iter().map(|code| code[3]).collect();
        assert_eq!(decode_alpha(&level, width, height), expected);
    }
}
