//! Levels as blocks: gathering, with the edge repeated, and decoding.

use basisu::uastc::unpack;
use cairn_format::TextureFormat;
use rayon::prelude::*;

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
    /// Whether an alpha of 1 has to stay so.
    pub alpha_is_read: bool,
}

impl Image<'_> {
    /// Blocks of a row.
    pub fn blocks_across(&self) -> usize {
        self.width.div_ceil(4) as usize
    }

    /// The 16 texels of a block, counted in rows; beyond the edge the last row and column repeat.
    pub fn gather<T: Copy>(&self, texels: &[T], block: usize) -> [T; 16] {
        let (width, height) = (self.width as usize, self.height as usize);
        let (column, row) = (block % self.blocks_across(), block / self.blocks_across());
        std::array::from_fn(|texel| {
            let x = (column * 4 + texel % 4).min(width - 1);
            let y = (row * 4 + texel / 4).min(height - 1);
            texels[y * width + x]
        })
    }
}

/// Decodes one block as the GPU would: BC7 and UASTC to 8-bit values, BC5 and BC4 interpolated in f32.
///
/// # Panics
/// If `format` is none of BC7, BC5, BC4 and UASTC.
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
        TextureFormat::Bc4Unorm => {
            let mut values = [0.0_f32; 16];
            bcdec_rs::bc4_float(bytes, &mut values, 4, false);
            values.map(|value| [value, 0.0, 0.0, 1.0])
        }
        TextureFormat::UastcUnorm | TextureFormat::UastcSrgb => {
            decode_uastc(format, bytes).map(|texel| texel.map(|code| f32::from(code) / 255.0))
        }
        _ => unreachable!("{format:?} is not a format of this stage"),
    }
}

/// The 4x4 texels at `[column, row]` of a level without blocks; beyond the edge they are 0.
///
/// # Panics
/// If `format` is not one of 8 or 16 bits a channel.
pub(super) fn decode_plain(
    format: TextureFormat,
    level: &[u8],
    [width, height]: [usize; 2],
    [column, row]: [usize; 2],
) -> Block {
    let bytes = format.block_bytes() as usize;
    std::array::from_fn(|texel| {
        let (x, y) = (column * 4 + texel % 4, row * 4 + texel / 4);
        if x >= width || y >= height {
            return [0.0; 4];
        }
        let texel = &level[(y * width + x) * bytes..][..bytes];
        match format {
            TextureFormat::Rgba8Srgb | TextureFormat::Rgba8Unorm => {
                std::array::from_fn(|channel| f32::from(texel[channel]) / 255.0)
            }
            TextureFormat::Rgba16Unorm => std::array::from_fn(|channel| {
                let code = u16::from_le_bytes([texel[2 * channel], texel[2 * channel + 1]]);
                f32::from(code) / 65535.0
            }),
            _ => unreachable!("{format:?} is not a format of this stage"),
        }
    })
}

/// Decodes one BC7 block to RGBA codes.
pub(super) fn decode_bc7(bytes: &[u8]) -> [[u8; 4]; 16] {
    let mut codes = [[0_u8; 4]; 16];
    bcdec_rs::bc7(bytes, codes.as_flattened_mut(), 16);
    codes
}

/// Decodes one UASTC block of this encoder to RGBA codes.
fn decode_uastc(format: TextureFormat, bytes: &[u8]) -> [[u8; 4]; 16] {
    let block = bytes.first_chunk::<16>();
    let texels = block.and_then(|block| unpack::unpack_uastc(block, format.is_srgb()));
    texels
        .expect("the encoder writes valid blocks")
        .map(|texel| texel.c)
}

/// The alpha codes of a level of BC7, UASTC or 8-bit texels, row by row.
pub(super) fn decode_alpha(
    format: TextureFormat,
    level: &[u8],
    width: u32,
    height: u32,
) -> Vec<u8> {
    if format.block_extent() == 1 {
        return level.iter().skip(3).step_by(4).copied().collect();
    }
    let (width, height) = (width as usize, height as usize);
    let mut alpha = vec![0_u8; width * height];
    let blocks_across = width.div_ceil(4);
    alpha
        .par_chunks_mut(width * 4)
        .zip(level.par_chunks(blocks_across * 16))
        .for_each(|(rows, blocks)| {
            for (block_x, block) in blocks.chunks_exact(16).enumerate() {
                let codes = match format.is_universal() {
                    true => decode_uastc(format, block),
                    false => decode_bc7(block),
                };
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
    use crate::encode::{Codec, Kernels, Quality, Role};

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
            alpha_is_read: true,
        };
        let block = image.gather(image.codes, 1);
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
        let image = Image {
            width,
            height,
            codes: &codes,
            exact: &[],
            alpha_is_read: true,
        };
        let level = Codec::Bc7 {
            quality: Quality::Default,
            kernels: Kernels::Reproducible,
        }
        .compress(Role::Color, &image);
        let expected: Vec<u8> = codes.iter().map(|code| code[3]).collect();
        let decoded = decode_alpha(TextureFormat::Bc7Srgb, &level, width, height);
        assert_eq!(decoded, expected);
        let quality = Quality::Default;
        let level = Codec::Uastc { quality }.compress(Role::Color, &image);
        let decoded = decode_alpha(TextureFormat::UastcSrgb, &level, width, height);
        assert_eq!(decoded, expected);
    }
}
