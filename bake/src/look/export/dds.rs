//! DirectDraw surfaces, stored blocks as they are ("DDS File Layout" and "DDS_HEADER_DXT10", Microsoft).

use cairn_format::TextureFormat;
use cairn_format::scene::ArchivedImage;

use super::stored;

/// `DDSCAPS2_CUBEMAP` and all six faces.
const CUBE: u32 = 0xfe00;

/// An image with all of its levels and faces.
///
/// # Errors
/// Where the format has no DXGI name.
pub fn dds(image: &ArchivedImage, texels: &[u8]) -> Result<Vec<u8>, String> {
    let format = image.format.native();
    let dxgi = dxgi(format).ok_or("a DDS holds no UASTC; write .ktx2 or .png")?;
    let [width, height, layers] = [image.width, image.height, image.layers].map(|n| n.to_native());
    let levels = image.levels.len() as u32;
    let cube = layers == 6;
    let blocks = format.block_extent() > 1;
    let (pitch, pitch_flag) = if blocks {
        (format.level_bytes(width, height) as u32, 0x8_0000)
    } else {
        (width * format.block_bytes(), 0x8)
    };
    let mut out = b"DDS ".to_vec();
    let mut words = |words: &[u32]| {
        out.extend(words.iter().flat_map(|word| word.to_le_bytes()));
    };
    // Size; caps, height, width, pixel format, mip count and pitch are given; extents, pitch, depth, levels.
    words(&[124, 0x2_1007 | pitch_flag, height, width, pitch, 1, levels]);
    words(&[0; 11]);
    // Pixel format: its size, DDPF_FOURCC, the code.
    words(&[32, 4, u32::from_le_bytes(*b"DX10"), 0, 0, 0, 0, 0]);
    // Texture, complex, mipmaps; faces.
    words(&[0x40_1008, if cube { CUBE } else { 0 }, 0, 0, 0]);
    // DXT10: format, 2D, cube flag, one element, unknown alpha mode.
    words(&[dxgi, 3, if cube { 4 } else { 0 }, 1, 0]);
    for layer in 0..layers {
        for level in 0..levels as usize {
            out.extend_from_slice(stored(image, texels, level, layer));
        }
    }
    Ok(out)
}

/// `DXGI_FORMAT`.
fn dxgi(format: TextureFormat) -> Option<u32> {
    Some(match format {
        TextureFormat::Rgba16Float => 10,
        TextureFormat::Rgba16Unorm => 11,
        TextureFormat::Rgba8Unorm => 28,
        TextureFormat::Rgba8Srgb => 29,
        TextureFormat::Rgb9e5Ufloat => 67,
        TextureFormat::Bc4Unorm => 80,
        TextureFormat::Bc5Unorm => 83,
        TextureFormat::Bc6hUfloat => 95,
        TextureFormat::Bc7Unorm => 98,
        TextureFormat::Bc7Srgb => 99,
        TextureFormat::UastcUnorm | TextureFormat::UastcSrgb => return None,
    })
}
