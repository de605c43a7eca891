//! KTX 2.0 files, stored blocks as they are ("KTX File Format Specification", version 2; "Khronos Data Format
//! Specification" 1.3, chapters 5 and 13).

use cairn_format::TextureFormat;
use cairn_format::scene::{ArchivedImage, ArchivedSwizzle};

use super::stored;

const IDENTIFIER: [u8; 12] = *b"\xabKTX 20\xbb\r\n\x1a\n";
/// Bytes of identifier, header and index.
const HEAD: usize = 80;

/// An image with all of its levels and faces.
pub fn ktx2(image: &ArchivedImage, texels: &[u8]) -> Vec<u8> {
    let format = image.format.native();
    let layers = image.layers.to_native();
    let levels = image.levels.len();
    let descriptor = descriptor(format, is_pair(image));
    let pairs = pairs(image);
    let descriptor_at = HEAD + 24 * levels;
    let pairs_at = descriptor_at + descriptor.len();
    let alignment = (format.block_bytes() as usize).max(4);
    let mut end = pairs_at + pairs.len();
    // Smallest levels first.
    let mut places = vec![(0, 0); levels];
    for level in (0..levels).rev() {
        let length = stored(image, texels, level, 0).len() * layers as usize;
        let offset = end.next_multiple_of(alignment);
        places[level] = (offset, length);
        end = offset + length;
    }

    let mut out = IDENTIFIER.to_vec();
    let type_size = match format {
        TextureFormat::Rgba16Float | TextureFormat::Rgba16Unorm => 2,
        TextureFormat::Rgb9e5Ufloat => 4,
        _ => 1,
    };
    let (width, height) = (image.width.to_native(), image.height.to_native());
    // Depth, layers, faces, levels, supercompression; then the index, without global data.
    for word in [
        vulkan(format),
        type_size,
        width,
        height,
        0,
        0,
        layers,
        levels as u32,
        0,
    ]
    .into_iter()
    .chain(
        [
            descriptor_at,
            descriptor.len(),
            pairs_at,
            pairs.len(),
            0,
            0,
            0,
            0,
        ]
        .map(|n| n as u32),
    ) {
        out.extend(word.to_le_bytes());
    }
    for (offset, length) in &places {
        out.extend(
            [*offset, *length, *length]
                .iter()
                .flat_map(|n| (*n as u64).to_le_bytes()),
        );
    }
    out.extend(descriptor);
    out.extend(pairs);
    for level in (0..levels).rev() {
        out.resize(places[level].0, 0);
        for face in 0..layers {
            out.extend_from_slice(stored(image, texels, level, face));
        }
    }
    out
}

/// Whether what is read of alpha is no alpha: the second of two channels.
fn is_pair(image: &ArchivedImage) -> bool {
    image.swizzle[..3].contains(&ArchivedSwizzle::Alpha)
}

/// `VkFormat`; undefined where only the descriptor tells.
fn vulkan(format: TextureFormat) -> u32 {
    match format {
        TextureFormat::Rgba8Unorm => 37,
        TextureFormat::Rgba8Srgb => 43,
        TextureFormat::Rgba16Unorm => 91,
        TextureFormat::Rgba16Float => 97,
        TextureFormat::Rgb9e5Ufloat => 123,
        TextureFormat::Bc4Unorm => 139,
        TextureFormat::Bc5Unorm => 141,
        TextureFormat::Bc6hUfloat => 143,
        TextureFormat::Bc7Unorm => 145,
        TextureFormat::Bc7Srgb => 146,
        TextureFormat::UastcUnorm | TextureFormat::UastcSrgb => 0,
    }
}

/// One sample of a data format descriptor: first bit, bits, channel with its qualifiers, and the values of 0 and 1.
struct Sample(u16, u8, u8, u32, u32);

/// Qualifiers of a channel.
const LINEAR: u8 = 0x10;
const EXPONENT: u8 = 0x20;
const SIGNED_FLOAT: u8 = 0xc0;
const UNSIGNED_FLOAT: u8 = 0x80;
/// Channel numbers of red, green, blue and alpha in the model RGBSDA.
const RGBA: [u8; 4] = [0, 1, 2, 15];

/// Colour model and samples of a format.
fn samples(format: TextureFormat, pair: bool) -> (u8, Vec<Sample>) {
    let block = |model, channel| (model, vec![Sample(0, 128, channel, 0, u32::MAX)]);
    let plain = |bits: u8, qualifiers: u8, low: u32, high: u32| {
        let sample = |(index, channel): (usize, u8)| {
            // Alpha has no curve where colour has the sRGB one.
            let linear = if format.is_srgb() && channel == 15 {
                LINEAR
            } else {
                0
            };
            Sample(
                index as u16 * u16::from(bits),
                bits,
                channel | qualifiers | linear,
                low,
                high,
            )
        };
        (1, RGBA.into_iter().enumerate().map(sample).collect())
    };
    match format {
        TextureFormat::Bc4Unorm => (131, vec![Sample(0, 64, 0, 0, u32::MAX)]),
        TextureFormat::Bc5Unorm => {
            let halves = [
                Sample(0, 64, 0, 0, u32::MAX),
                Sample(64, 64, 1, 0, u32::MAX),
            ];
            (132, halves.into())
        }
        TextureFormat::Bc6hUfloat => (
            133,
            vec![Sample(0, 128, UNSIGNED_FLOAT, 0, 1.0_f32.to_bits())],
        ),
        TextureFormat::Bc7Unorm | TextureFormat::Bc7Srgb => block(134, 0),
        // The channel says which of a block's channels matter: all four, or red and alpha.
        TextureFormat::UastcUnorm | TextureFormat::UastcSrgb => {
            block(166, if pair { 5 } else { 3 })
        }
        TextureFormat::Rgba8Unorm | TextureFormat::Rgba8Srgb => plain(8, 0, 0, 255),
        TextureFormat::Rgba16Unorm => plain(16, 0, 0, 65_535),
        TextureFormat::Rgba16Float => {
            plain(16, SIGNED_FLOAT, (-1.0_f32).to_bits(), 1.0_f32.to_bits())
        }
        TextureFormat::Rgb9e5Ufloat => {
            let mantissa = |channel: u8| Sample(9 * u16::from(channel), 9, channel, 0, 8448);
            let exponent = |channel: u8| Sample(27, 5, channel | EXPONENT, 15, 31);
            let samples = [0, 1, 2].map(|channel| [mantissa(channel), exponent(channel)]);
            (1, samples.into_iter().flatten().collect())
        }
    }
}

/// The data format descriptor, its total size before it.
fn descriptor(format: TextureFormat, pair: bool) -> Vec<u8> {
    let (model, samples) = samples(format, pair);
    let block = 24 + 16 * samples.len() as u32;
    let mut out = Vec::new();
    // Total size; vendor and type 0; version 2 and the block's size.
    for word in [block + 4, 0, 2 | block << 16] {
        out.extend(word.to_le_bytes());
    }
    let transfer = if format.is_srgb() { 2 } else { 1 };
    // BT.709 primaries, straight alpha.
    out.extend([model, 1, transfer, 0]);
    let edge = format.block_extent() as u8 - 1;
    out.extend([edge, edge, 0, 0]);
    out.extend([format.block_bytes() as u8, 0, 0, 0, 0, 0, 0, 0]);
    for Sample(bit, bits, channel, low, high) in samples {
        out.extend(bit.to_le_bytes());
        out.extend([bits - 1, channel, 0, 0, 0, 0]);
        out.extend(low.to_le_bytes());
        out.extend(high.to_le_bytes());
    }
    out
}

/// Key and value pairs, in order of their keys.
fn pairs(image: &ArchivedImage) -> Vec<u8> {
    let letters: String = image
        .swizzle
        .iter()
        .map(|component| match component {
            ArchivedSwizzle::Red => 'r',
            ArchivedSwizzle::Green => 'g',
            ArchivedSwizzle::Blue => 'b',
            ArchivedSwizzle::Alpha => 'a',
            ArchivedSwizzle::Zero => '0',
            ArchivedSwizzle::One => '1',
        })
        .collect();
    let writer = crate::pipeline::tool();
    let swizzle = (letters != "rgba").then_some(("KTXswizzle", letters));
    let mut out: Vec<u8> = Vec::new();
    for (key, value) in swizzle.into_iter().chain([("KTXwriter", writer)]) {
        let pair = format!("{key}\0{value}\0");
        out.extend((pair.len() as u32).to_le_bytes());
        out.extend(pair.bytes());
        out.resize(out.len().next_multiple_of(4), 0);
    }
    out
}
