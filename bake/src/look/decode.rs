//! Texel blocks back to texels.

use basisu::uastc::unpack;
use cairn_format::TextureFormat;
use cairn_format::scene::{ArchivedImage, ArchivedSwizzle};
use cairn_format::texture::mip_extent;
use half::f16;
use rayon::prelude::*;

use crate::encode::unpack_rgb9e5;

/// One layer of one level as shaders read it, but for the sRGB curve: rows from the top, values from 0 to 1, or
/// radiance as stored. Absent colour channels are 0, absent alpha is 1.
#[derive(Clone, Debug, PartialEq)]
pub struct Plane {
    /// How it was stored.
    pub format: TextureFormat,
    /// Texels.
    pub width: u32,
    /// Texels.
    pub height: u32,
    /// Red, green, blue, alpha.
    pub texels: Vec<[f32; 4]>,
}

const IDENTITY: [ArchivedSwizzle; 4] = [
    ArchivedSwizzle::Red,
    ArchivedSwizzle::Green,
    ArchivedSwizzle::Blue,
    ArchivedSwizzle::Alpha,
];

/// Decodes one layer of one level of an image whose texel section is `texels`; both must be there.
///
/// # Panics
/// Where the image has no such layer or level, or `texels` is not its package's section.
pub fn layer(image: &ArchivedImage, texels: &[u8], level: usize, layer: u32) -> Plane {
    let format = image.format.native();
    let width = mip_extent(image.width.to_native(), level as u32);
    let height = mip_extent(image.height.to_native(), level as u32);
    assert!(layer < image.layers.to_native(), "layer {layer}");
    let bytes = format.level_bytes(width, height);
    let start = image.levels[level].offset.to_native() + u64::from(layer) * bytes;
    let bytes = &texels[start as usize..(start + bytes) as usize];
    let mut texels = decode(format, width, height, bytes);
    let components = image.swizzle;
    if components != IDENTITY {
        texels
            .iter_mut()
            .for_each(|texel| *texel = components.map(|c| component(c, texel)));
    }
    Plane {
        format,
        width,
        height,
        texels,
    }
}

/// What a shader reads as one component.
fn component(swizzle: ArchivedSwizzle, texel: &[f32; 4]) -> f32 {
    match swizzle {
        ArchivedSwizzle::Red => texel[0],
        ArchivedSwizzle::Green => texel[1],
        ArchivedSwizzle::Blue => texel[2],
        ArchivedSwizzle::Alpha => texel[3],
        ArchivedSwizzle::Zero => 0.0,
        ArchivedSwizzle::One => 1.0,
    }
}

/// Decodes one layer of `width` x `height` texels.
///
/// # Panics
/// Where `bytes` are not [`TextureFormat::level_bytes`] of them.
pub fn decode(format: TextureFormat, width: u32, height: u32, bytes: &[u8]) -> Vec<[f32; 4]> {
    assert_eq!(bytes.len() as u64, format.level_bytes(width, height));
    let (width, extent) = (width as usize, format.block_extent() as usize);
    let mut texels = vec![[0.0; 4]; width * height as usize];
    let row_bytes = width.div_ceil(extent) * format.block_bytes() as usize;
    texels
        .par_chunks_mut(width * extent)
        .zip(bytes.par_chunks_exact(row_bytes))
        .for_each(|(rows, blocks)| {
            let blocks = blocks.chunks_exact(format.block_bytes() as usize);
            for (column, block) in blocks.enumerate() {
                if extent == 1 {
                    rows[column] = decode_texel(format, block);
                } else {
                    scatter(rows, width, column * extent, &decode_block(format, block));
                }
            }
        });
    texels
}

/// Writes a block's texels into its rows, those that lie inside of the image.
fn scatter(rows: &mut [[f32; 4]], width: usize, left: usize, block: &[[f32; 4]; 16]) {
    for (y, row) in rows.chunks_exact_mut(width).enumerate() {
        for (x, texel) in row[left..width.min(left + 4)].iter_mut().enumerate() {
            *texel = block[4 * y + x];
        }
    }
}

/// One texel of a format without blocks.
fn decode_texel(format: TextureFormat, bytes: &[u8]) -> [f32; 4] {
    let wide = |index: usize| u16::from_le_bytes([bytes[2 * index], bytes[2 * index + 1]]);
    match format {
        TextureFormat::Rgba16Float => std::array::from_fn(|c| f16::from_bits(wide(c)).to_f32()),
        TextureFormat::Rgba16Unorm => std::array::from_fn(|c| f32::from(wide(c)) / 65535.0),
        TextureFormat::Rgb9e5Ufloat => {
            let word = u32::from_le_bytes([bytes[0], bytes[1], bytes[2], bytes[3]]);
            let [r, g, b] = unpack_rgb9e5(word);
            [r, g, b, 1.0]
        }
        _ => std::array::from_fn(|c| f32::from(bytes[c]) / 255.0),
    }
}

/// One block of 4x4 texels, by decoders of projects of their own. A UASTC block that is none is magenta.
fn decode_block(format: TextureFormat, bytes: &[u8]) -> [[f32; 4]; 16] {
    let from_codes = |codes: [u8; 4]| codes.map(|code| f32::from(code) / 255.0);
    match format {
        TextureFormat::UastcUnorm | TextureFormat::UastcSrgb => {
            let block = bytes.first_chunk::<16>();
            let texels = block.and_then(|block| unpack::unpack_uastc(block, format.is_srgb()));
            texels.map_or([[1.0, 0.0, 1.0, 1.0]; 16], |texels| {
                std::array::from_fn(|texel| from_codes(texels[texel].c))
            })
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
        TextureFormat::Bc6hUfloat => {
            let mut values = [0.0_f32; 48];
            bcdec_rs::bc6h_float(bytes, &mut values, 12, false);
            std::array::from_fn(|texel| {
                let [r, g, b] = [0, 1, 2].map(|channel| values[3 * texel + channel]);
                [r, g, b, 1.0]
            })
        }
        _ => {
            let mut codes = [0_u8; 64];
            bcdec_rs::bc7(bytes, &mut codes, 16);
            std::array::from_fn(|texel| {
                [0, 1, 2, 3].map(|c| f32::from(codes[4 * texel + c]) / 255.0)
            })
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn edge_blocks_keep_to_the_image() {
        // BC4: both ends equal, so that every texel is the first end.
        let block = |value: u8| [value, value, 0, 0, 0, 0, 0, 0];
        let bytes = [block(0), block(255), block(51), block(102)].concat();
        let texels = decode(TextureFormat::Bc4Unorm, 5, 6, &bytes);
        let at = |x: usize, y: usize| (texels[y * 5 + x][0] * 255.0).round();
        assert_eq!(texels.len(), 30);
        assert_eq!(
            [at(0, 0), at(3, 3), at(4, 0), at(4, 3)],
            [0.0, 0.0, 255.0, 255.0]
        );
        assert_eq!(
            [at(0, 4), at(3, 5), at(4, 4), at(4, 5)],
            [51.0, 51.0, 102.0, 102.0]
        );
    }

    #[test]
    fn plain_texels_come_back() {
        let half = |value: f32| f16::from_f32(value).to_le_bytes();
        let bytes = [half(0.5), half(-2.0), half(1024.0), half(1.0)].concat();
        assert_eq!(
            decode(TextureFormat::Rgba16Float, 1, 1, &bytes),
            [[0.5, -2.0, 1024.0, 1.0]]
        );
        assert_eq!(
            decode(
                TextureFormat::Rgba8Srgb,
                2,
                1,
                &[0, 51, 102, 255, 255, 0, 0, 0]
            ),
            [[0.0, 0.2, 0.4, 1.0], [1.0, 0.0, 0.0, 0.0]]
        );
        // 256 * 2^(16 - 15 - 9) = 0.5 in red, one half of it in green.
        let word = 256_u32 | 128 << 9 | 15 << 27;
        let texel = decode(TextureFormat::Rgb9e5Ufloat, 1, 1, &word.to_le_bytes());
        assert_eq!(texel, [[0.5, 0.25, 0.0, 1.0]]);
    }
}
