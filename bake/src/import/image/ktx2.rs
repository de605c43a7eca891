//! Decodes KTX2 files of Basis Universal (`KHR_texture_basisu`): ETC1S under BasisLZ, and UASTC, plain or under
//! Zstandard.

use basisu::ktx2::Ktx2Header;
use basisu::uastc::unpack::unpack_uastc;
use basisu::{DecodeFlags, SourceFormat, TargetFormat, Transcoder};
use cairn_format::texture::{full_mip_count, mip_extent};
use rayon::prelude::*;
use ruzstd::StreamingDecoder;
use ruzstd::io::Read;

use super::{DecodedImage, ImageHeader, Universal, wide};

/// Offset of `vkFormat`, `pixelWidth`, `pixelDepth`, `layerCount`, `faceCount` (KTX 2.0 section 3).
const VK_FORMAT: usize = 12;
const WIDTH: usize = 20;
const DEPTH: usize = 28;
const LAYERS: usize = 32;
const FACES: usize = 36;

/// The scheme of Zstandard.
const ZSTANDARD: u32 = 2;
/// Bytes of a UASTC block, and texels along its edge.
const BLOCK: usize = 16;
const EDGE: usize = 4;

/// Offset of the data format descriptor's offset, and in the descriptor those of its colour model with primaries,
/// transfer function and flags, and of the first word of its first and second sample (Khronos Data Format 1.3,
/// section 5).
const DESCRIPTOR: usize = 48;
const MODEL: usize = 12;
const SAMPLE: usize = 28;
const SECOND_SAMPLE: usize = 44;
/// `KHR_DF_TRANSFER_SRGB`.
const TRANSFER_SRGB: u32 = 2;
/// Channels of UASTC: the second of two is stored in alpha.
const UASTC_RRRG: u32 = 5;
/// Channels of the two slices of ETC1S where they are red and green.
const ETC1S_RRR: u32 = 3;
const ETC1S_GGG: u32 = 4;

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

/// Bytes of the blocks of a level.
fn level_bytes(header: ImageHeader, level: u32) -> usize {
    let [width, height] = [header.width, header.height].map(|size| mip_extent(size, level));
    width.div_ceil(4) as usize * height.div_ceil(4) as usize * BLOCK
}

/// What the descriptor says of the channels.
struct Channels {
    srgb: bool,
    /// Whether there are two alone: the second is where alpha else is.
    pair: bool,
}

impl Channels {
    fn of(bytes: &[u8], format: SourceFormat) -> Result<Self, String> {
        let start = word(bytes, DESCRIPTOR)? as usize;
        let model = word(bytes, start + MODEL)?;
        let channel = |place: usize| Ok::<u32, String>(word(bytes, start + place)? >> 24 & 15);
        let pair = match format {
            SourceFormat::UastcLdr => channel(SAMPLE)? == UASTC_RRRG,
            _ => channel(SAMPLE)? == ETC1S_RRR && channel(SECOND_SAMPLE)? == ETC1S_GGG,
        };
        Ok(Self {
            srgb: model >> 16 & 255 == TRANSFER_SRGB,
            pair,
        })
    }

    /// A pair as red and green.
    fn place(&self, mut texels: Vec<[u16; 4]>) -> Vec<[u16; 4]> {
        if self.pair {
            for texel in &mut texels {
                *texel = [texel[0], texel[3], 0, u16::MAX];
            }
        }
        texels
    }
}

/// All levels of the file.
pub(super) fn decode(bytes: &[u8], header: ImageHeader) -> Result<DecodedImage, String> {
    let broken = |error: basisu::Error| format!("{error:?} in the KTX2; save it again");
    let transcoder = Transcoder::new(bytes).map_err(broken)?;
    let format = transcoder.source_format();
    let most = full_mip_count(header.width, header.height);
    let count = transcoder.level_count().min(most);
    let channels = Channels::of(bytes, format)?;
    let mut universal = None;
    let levels: Vec<Vec<[u16; 4]>> = match format {
        SourceFormat::Etc1s => {
            let levels = (0..count).map(|level| {
                let codes = transcoder.transcode(level, TargetFormat::Rgba32, DecodeFlags::NONE);
                codes.map(|codes| wide(&codes)).map_err(broken)
            });
            levels.collect::<Result<_, _>>()?
        }
        SourceFormat::UastcLdr => {
            let blocks = (0..count).map(|level| blocks(bytes, header, level));
            let blocks: Vec<Vec<u8>> = blocks.collect::<Result<_, _>>()?;
            let levels = (0..).zip(&blocks).map(|(level, blocks)| {
                let width = mip_extent(header.width, level) as usize;
                let height = mip_extent(header.height, level) as usize;
                unpack(blocks, [width, height], channels.srgb)
                    .ok_or_else(|| format!("level {level} of the KTX2 is not UASTC; save it again"))
            });
            let levels = levels.collect::<Result<_, _>>()?;
            universal = Some(Universal { levels: blocks });
            levels
        }
        found => return Err(format!("{found:?} in the KTX2; save it as ETC1S or UASTC")),
    };
    let mut levels = levels.into_iter().map(|texels| channels.place(texels));
    Ok(DecodedImage {
        width: header.width,
        height: header.height,
        texels: levels
            .next()
            .ok_or("the KTX2 has no level; save it again")?,
        smaller: levels.collect(),
        source_bits: 8,
        has_alpha: transcoder.has_alpha() && !channels.pair,
        pair: channels.pair,
        universal,
    })
}

/// The UASTC blocks of a level.
fn blocks(bytes: &[u8], header: ImageHeader, level: u32) -> Result<Vec<u8>, String> {
    let expected = level_bytes(header, level);
    let file = Ktx2Header::parse(bytes).ok_or("the KTX2 header is broken; save it again")?;
    let cut = || format!("level {level} of the KTX2 is cut off; copy or save it again");
    let entry = file.levels.get(level as usize).ok_or_else(cut)?;
    let stored = usize::try_from(entry.byte_offset).ok().and_then(|start| {
        let length = usize::try_from(entry.byte_length).ok()?;
        bytes.get(start..start.checked_add(length)?)
    });
    let stored = stored.ok_or_else(cut)?;
    let length = match file.supercompression {
        ZSTANDARD => entry.uncompressed_byte_length,
        _ => entry.byte_length,
    };
    // A length that is believed would be allocated.
    if length != expected as u64 {
        return Err(format!(
            "level {level} of the KTX2 has {length} bytes instead of {expected}; save it again"
        ));
    }
    match file.supercompression {
        0 => Ok(stored.to_vec()),
        ZSTANDARD => inflate(stored, expected)
            .ok_or_else(|| format!("level {level} of the KTX2 does not unpack; save it again")),
        other => Err(format!(
            "the KTX2 packs UASTC by scheme {other}; save it plain or under Zstandard"
        )),
    }
}

/// Unpacks exactly `length` bytes of Zstandard.
fn inflate(stored: &[u8], length: usize) -> Option<Vec<u8>> {
    let mut decoder = StreamingDecoder::new(stored).ok()?;
    let mut out = vec![0; length];
    decoder.read_exact(&mut out).ok()?;
    (decoder.read(&mut [0]).ok()? == 0).then_some(out)
}

/// The texels of a level, or `None` where a block is none of UASTC's.
fn unpack(blocks: &[u8], [width, height]: [usize; 2], srgb: bool) -> Option<Vec<[u16; 4]>> {
    let mut texels = vec![[0; 4]; width * height];
    let rows = blocks
        .as_chunks::<BLOCK>()
        .0
        .par_chunks(width.div_ceil(EDGE));
    let done = texels.par_chunks_mut(width * EDGE).zip(rows);
    done.map(|(texels, blocks)| {
        for (column, block) in blocks.iter().enumerate() {
            let colors = unpack_uastc(block, srgb)?;
            for (row, texels) in texels.chunks_mut(width).enumerate() {
                let texels = texels[column * EDGE..].iter_mut().take(EDGE);
                for (texel, color) in texels.zip(&colors[row * EDGE..]) {
                    *texel = color.c.map(|code| u16::from(code) * 257);
                }
            }
        }
        Some(())
    })
    .collect::<Option<()>>()?;
    Some(texels)
}
