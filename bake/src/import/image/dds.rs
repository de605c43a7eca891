//! Decodes DDS files (`MSFT_texture_dds`): BC1 to BC5, BC7 and plain 32-bit texels, all levels.

use cairn_format::texture::{full_mip_count, mip_extent};

use super::{DecodedImage, ImageHeader, wide};

/// Offsets in the header, which begins with the magic (DDS_HEADER and DDS_HEADER_DXT10 of Direct3D).
const HEIGHT: usize = 12;
const MIP_COUNT: usize = 28;
const PIXEL_FLAGS: usize = 80;
const FOUR_CC: usize = 84;
const BIT_COUNT: usize = 88;
const RED_MASK: usize = 92;
const CAPS2: usize = 112;
const DXGI_FORMAT: usize = 128;
const DATA: usize = 128;
const DATA_DX10: usize = 148;
/// `DDPF_ALPHAPIXELS`.
const HAS_ALPHA: u32 = 1;
/// `DDPF_FOURCC`.
const HAS_FOUR_CC: u32 = 4;
/// Bits of `DDSCAPS2` that make a cube or a volume.
const CUBE_OR_VOLUME: u32 = 0x20_0200;

/// How texels are stored.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Layout {
    Bc1,
    Bc2,
    Bc3,
    Bc4,
    Bc5,
    Bc7,
    Rgba8,
    Bgra8,
    /// As the last, with a fourth byte that means nothing.
    Bgrx8,
}

impl Layout {
    fn level_bytes(self, width: u32, height: u32) -> usize {
        let blocks = width.div_ceil(4) as usize * height.div_ceil(4) as usize;
        match self {
            Self::Bc1 | Self::Bc4 => blocks * 8,
            Self::Bc2 | Self::Bc3 | Self::Bc5 | Self::Bc7 => blocks * 16,
            Self::Rgba8 | Self::Bgra8 | Self::Bgrx8 => width as usize * height as usize * 4,
        }
    }

    fn has_alpha(self) -> bool {
        !matches!(self, Self::Bc4 | Self::Bc5 | Self::Bgrx8)
    }
}

fn word(bytes: &[u8], offset: usize) -> Result<u32, String> {
    let word = bytes
        .get(offset..offset + 4)
        .and_then(|word| word.try_into().ok());
    word.map(u32::from_le_bytes)
        .ok_or_else(|| "the DDS header is cut off; copy or save it again".into())
}

/// Layout, and where the texels begin.
fn layout(bytes: &[u8]) -> Result<(Layout, usize), String> {
    let flags = word(bytes, PIXEL_FLAGS)?;
    if flags & HAS_FOUR_CC == 0 {
        let layout = match (word(bytes, BIT_COUNT)?, word(bytes, RED_MASK)?) {
            (32, 0xff) => Layout::Rgba8,
            (32, 0xff_0000) if flags & HAS_ALPHA != 0 => Layout::Bgra8,
            (32, 0xff_0000) => Layout::Bgrx8,
            (bits, _) => return Err(format!("texels of {bits} bits in the DDS; save it as PNG")),
        };
        return Ok((layout, DATA));
    }
    let code = word(bytes, FOUR_CC)?.to_le_bytes();
    let layout = match &code {
        b"DXT1" => Layout::Bc1,
        b"DXT2" | b"DXT3" => Layout::Bc2,
        b"DXT4" | b"DXT5" => Layout::Bc3,
        b"ATI1" | b"BC4U" => Layout::Bc4,
        b"ATI2" | b"BC5U" => Layout::Bc5,
        b"DX10" => {
            let layout = match word(bytes, DXGI_FORMAT)? {
                70..=72 => Layout::Bc1,
                73..=75 => Layout::Bc2,
                76..=78 => Layout::Bc3,
                79 | 80 => Layout::Bc4,
                82 | 83 => Layout::Bc5,
                97..=99 => Layout::Bc7,
                27..=29 => Layout::Rgba8,
                87 | 91 => Layout::Bgra8,
                88 | 93 => Layout::Bgrx8,
                other => return Err(format!("DXGI format {other} in the DDS; save it as PNG")),
            };
            return Ok((layout, DATA_DX10));
        }
        other => {
            let name = other.escape_ascii();
            return Err(format!(
                "texels of kind `{name}` in the DDS; save it as PNG"
            ));
        }
    };
    Ok((layout, DATA))
}

pub(super) fn header(bytes: &[u8]) -> Result<ImageHeader, String> {
    let (layout, _) = layout(bytes)?;
    if word(bytes, CAPS2)? & CUBE_OR_VOLUME != 0 {
        return Err("the DDS is no single 2D image; save it as one".into());
    }
    Ok(ImageHeader {
        width: word(bytes, HEIGHT + 4)?,
        height: word(bytes, HEIGHT)?,
        has_alpha: layout.has_alpha(),
    })
}

/// All levels of the file.
pub(super) fn decode(bytes: &[u8], header: ImageHeader) -> Result<DecodedImage, String> {
    let (layout, mut start) = layout(bytes)?;
    let most = full_mip_count(header.width, header.height);
    let mut levels = Vec::new();
    for level in 0..word(bytes, MIP_COUNT)?.clamp(1, most) {
        let [width, height] = [header.width, header.height].map(|size| mip_extent(size, level));
        let end = start + layout.level_bytes(width, height);
        let stored = bytes
            .get(start..end)
            .ok_or("the DDS is cut off; copy or save it again")?;
        levels.push(texels(layout, stored, width, height));
        start = end;
    }
    let smaller = levels.split_off(1);
    Ok(DecodedImage {
        width: header.width,
        height: header.height,
        texels: levels.pop().unwrap_or_default(),
        smaller,
        source_bits: 8,
        has_alpha: header.has_alpha,
        pair: false,
        universal: None,
    })
}

/// One level as RGBA; a single channel is grey, two are red and green.
fn texels(layout: Layout, stored: &[u8], width: u32, height: u32) -> Vec<[u16; 4]> {
    match layout {
        Layout::Rgba8 => return wide(stored),
        Layout::Bgra8 | Layout::Bgrx8 => {
            let opaque = layout == Layout::Bgrx8;
            let swapped = stored.as_chunks::<4>().0.iter().flat_map(|&[b, g, r, a]| {
                let alpha = if opaque { 255 } else { a };
                [r, g, b, alpha]
            });
            return wide(&swapped.collect::<Vec<u8>>());
        }
        _ => {}
    }
    let (width, height) = (width as usize, height as usize);
    let mut codes = vec![[0, 0, 0, 255]; width * height];
    let block_bytes = layout.level_bytes(4, 4);
    for (index, block) in stored.chunks_exact(block_bytes).enumerate() {
        let decoded = decode_block(layout, block);
        let across = width.div_ceil(4);
        let [x, y] = [index % across * 4, index / across * 4];
        for (texel, code) in decoded.into_iter().enumerate() {
            let [x, y] = [x + texel % 4, y + texel / 4];
            if x < width && y < height {
                codes[y * width + x] = code;
            }
        }
    }
    wide(codes.as_flattened())
}

fn decode_block(layout: Layout, block: &[u8]) -> [[u8; 4]; 16] {
    let mut rgba = [[0_u8; 4]; 16];
    let flat = rgba.as_flattened_mut();
    match layout {
        Layout::Bc1 => bcdec_rs::bc1(block, flat, 16),
        Layout::Bc2 => bcdec_rs::bc2(block, flat, 16),
        Layout::Bc3 => bcdec_rs::bc3(block, flat, 16),
        Layout::Bc4 => {
            let mut grey = [0; 16];
            bcdec_rs::bc4(block, &mut grey, 4, false);
            return grey.map(|value| [value, value, value, 255]);
        }
        Layout::Bc5 => {
            let mut pairs = [[0; 2]; 16];
            bcdec_rs::bc5(block, pairs.as_flattened_mut(), 8, false);
            return pairs.map(|[x, y]| [x, y, 255, 255]);
        }
        _ => bcdec_rs::bc7(block, flat, 16),
    }
    rgba
}
