//! Decodes KTX2 files of Basis Universal (`KHR_texture_basisu`): ETC1S under BasisLZ, and UASTC, plain or under
//! Zstandard.

use basisu::{DecodeFlags, SourceFormat, TargetFormat, Transcoder};
use cairn_format::texture::{full_mip_count, mip_extent};

use super::{DecodedImage, ImageHeader, wide};

/// Offset of `vkFormat`, `pixelWidth`, `pixelDepth`, `layerCount`, `faceCount` (KTX 2.0 section 3).
const VK_FORMAT: usize = 12;
const WIDTH: usize = 20;
const DEPTH: usize = 28;
const LAYERS: usize = 32;
const FACES: usize = 36;

/// Offset of `supercompressionScheme`, and of the level index with its three 64-bit words a level.
const SCHEME: usize = 44;
const LEVELS: usize = 80;
/// The scheme of Zstandard.
const ZSTANDARD: u32 = 2;
/// Bytes of a UASTC block.
const BLOCK: u64 = 16;

/// Size, and whether there is alpha, which only the data format descriptor tells: reported as perhaps.
pub(super) fn header(bytes: &[u8]) -> Result<ImageHeader, String> {
    let word = |offset| word(bytes, offset);
    let format = word(VK_FORMAT)?;
    if format != 0 {
        return Err(format!(
            "the KTX2 holds texels of VkFormat {format}, glTF allows Basis Universal only; save it as that"
        ));
    }
    if word(DEPTH)? > 0 || word(LAYERS)? > 1 || word(FACES)? != 1 {
        return Err("the KTX2 is no single 2D image; save it as one".into());
    }
    Ok(ImageHeader {
        width: word(WIDTH)?,
        height: word(WIDTH + 4)?,
        has_alpha: true,
    })
}

fn word(bytes: &[u8], offset: usize) -> Result<u32, String> {
    let word = bytes
        .get(offset..offset + 4)
        .and_then(|word| word.try_into().ok());
    word.map(u32::from_le_bytes)
        .ok_or_else(|| "the KTX2 header is cut off; copy or save it again".into())
}

/// The decoder believes what a level says of its length, and allocates it.
fn check_lengths(bytes: &[u8], header: ImageHeader, levels: u32) -> Result<(), String> {
    if word(bytes, SCHEME)? != ZSTANDARD {
        return Ok(());
    }
    for level in 0..levels {
        let place = LEVELS + 24 * level as usize + 16;
        let length = u64::from(word(bytes, place)?) | u64::from(word(bytes, place + 4)?) << 32;
        let [width, height] = [header.width, header.height].map(|size| mip_extent(size, level));
        let blocks = u64::from(width.div_ceil(4)) * u64::from(height.div_ceil(4));
        if length != blocks * BLOCK {
            return Err(format!(
                "level {level} of the KTX2 has {length} bytes instead of {}; save it again",
                blocks * BLOCK
            ));
        }
    }
    Ok(())
}

/// All levels of the file.
pub(super) fn decode(bytes: &[u8], header: ImageHeader) -> Result<DecodedImage, String> {
    let broken = |error: basisu::Error| format!("{error:?} in the KTX2; save it again");
    let transcoder = Transcoder::new(bytes).map_err(broken)?;
    if !matches!(
        transcoder.source_format(),
        SourceFormat::Etc1s | SourceFormat::UastcLdr
    ) {
        let found = transcoder.source_format();
        return Err(format!("{found:?} in the KTX2; save it as ETC1S or UASTC"));
    }
    let most = full_mip_count(header.width, header.height);
    let count = transcoder.level_count().min(most);
    check_lengths(bytes, header, count)?;
    let mut levels = (0..count).map(|level| {
        let codes = transcoder.transcode(level, TargetFormat::Rgba32, DecodeFlags::NONE);
        codes.map(|codes| wide(&codes)).map_err(broken)
    });
    let texels = levels
        .next()
        .ok_or("the KTX2 has no level; save it again")??;
    Ok(DecodedImage {
        width: header.width,
        height: header.height,
        texels,
        smaller: levels.collect::<Result<_, _>>()?,
        source_bits: 8,
        has_alpha: transcoder.has_alpha(),
    })
}
