//! Tests of decoding: every layout, every source, damage.

use ::image::codecs::jpeg::JpegEncoder;
use ::image::{ExtendedColorType, ImageEncoder, codecs::png::PngEncoder};

use super::*;
use crate::import::testing::fault;

fn image(bytes: Vec<u8>) -> Image {
    Image {
        name: "test".into(),
        bytes,
        ..Image::default()
    }
}

fn png(texels: &[u8], width: u32, height: u32, color: ExtendedColorType) -> Image {
    let mut bytes = Vec::new();
    let encoder = PngEncoder::new(&mut bytes);
    encoder.write_image(texels, width, height, color).unwrap();
    image(bytes)
}

fn decoded(image: &Image) -> DecodedImage {
    decode_image(image, 1 << 20).unwrap()
}

#[test]
fn every_png_layout_becomes_rgba() {
    let texel = |bytes: &[u8], color| {
        let image = decoded(&png(bytes, 1, 1, color));
        (image.texels[0], image.source_bits, image.has_alpha)
    };
    let wide = |value: u16| value * 257;
    let (g, r, a) = (wide(3), wide(9), wide(200));
    assert_eq!(
        texel(&[3], ExtendedColorType::L8),
        ([g, g, g, 65535], 8, false)
    );
    assert_eq!(
        texel(&[3, 200], ExtendedColorType::La8),
        ([g, g, g, a], 8, true)
    );
    assert_eq!(
        texel(&[9, 3, 255], ExtendedColorType::Rgb8),
        ([r, g, 65535, 65535], 8, false)
    );
    assert_eq!(
        texel(&[9, 3, 0, 200], ExtendedColorType::Rgba8),
        ([r, g, 0, a], 8, true)
    );
}

#[test]
fn sixteen_bits_are_lossless() {
    let values = [1u16, 257, 4660, 65534];
    let bytes: Vec<u8> = values.iter().flat_map(|v| v.to_ne_bytes()).collect();
    let image = decoded(&png(&bytes, 1, 1, ExtendedColorType::Rgba16));
    assert_eq!((image.texels[0], image.source_bits), (values, 16));
    let image = decoded(&png(&bytes, 4, 1, ExtendedColorType::L16));
    assert_eq!(image.texels[2], [4660, 4660, 4660, 65535]);
}

/// A PNG of one row from raw chunks, for layouts that the encoder does not write.
fn raw_png(bits: u8, color: u8, width: u32, row: &[u8], extra: &[(&[u8; 4], &[u8])]) -> Image {
    png_of_rows([bits, color, 0], width, row, extra)
}

/// As `raw_png`, with the interlace method as the third of `kind`.
fn png_of_rows(
    [bits, color, interlace]: [u8; 3],
    width: u32,
    row: &[u8],
    extra: &[(&[u8; 4], &[u8])],
) -> Image {
    let chunk = |kind: &[u8], data: &[u8]| {
        let body = [kind, data].concat();
        let mut crc = u32::MAX;
        for byte in &body {
            crc ^= u32::from(*byte);
            for _ in 0..8 {
                crc = crc >> 1 ^ if crc & 1 == 1 { 0xedb8_8320 } else { 0 };
            }
        }
        let length = (data.len() as u32).to_be_bytes();
        [&length[..], &body, &(!crc).to_be_bytes()].concat()
    };
    let raw = [&[0], row].concat();
    let (mut a, mut b) = (1u32, 0u32);
    for byte in &raw {
        a = (a + u32::from(*byte)) % 65521;
        b = (b + a) % 65521;
    }
    let length = raw.len() as u16;
    let mut zlib = vec![0x78, 1, 1];
    zlib.extend(length.to_le_bytes());
    zlib.extend((!length).to_le_bytes());
    zlib.extend(&raw);
    zlib.extend((b << 16 | a).to_be_bytes());
    let mut header = width.to_be_bytes().to_vec();
    header.extend([0, 0, 0, 1, bits, color, 0, 0, interlace]);
    let mut bytes = b"\x89PNG\r\n\x1a\n".to_vec();
    bytes.extend(chunk(b"IHDR", &header));
    for (kind, data) in extra {
        bytes.extend(chunk(*kind, data));
    }
    bytes.extend(chunk(b"IDAT", &zlib));
    bytes.extend(chunk(b"IEND", &[]));
    image(bytes)
}

#[test]
fn palettes_and_few_bits_are_expanded() {
    let palette: (&[u8; 4], &[u8]) = (b"PLTE", &[255, 0, 0, 0, 255, 0]);
    let image = decoded(&raw_png(1, 3, 2, &[0b0100_0000], &[palette]));
    assert_eq!(image.texels, [[65535, 0, 0, 65535], [0, 65535, 0, 65535]]);
    assert!(!image.has_alpha);
    let image = decoded(&raw_png(8, 3, 2, &[0, 1], &[palette, (b"tRNS", &[128])]));
    assert_eq!(
        image.texels,
        [[65535, 0, 0, 128 * 257], [0, 65535, 0, 65535]]
    );
    assert!(image.has_alpha);
    let image = decoded(&raw_png(2, 0, 4, &[0b0001_1011], &[]));
    let greys: Vec<u16> = image.texels.iter().map(|texel| texel[0]).collect();
    assert_eq!(greys, [0, 85 * 257, 170 * 257, 65535]);
}

#[test]
fn gamma_chunks_are_ignored() {
    let gamma = 100_000u32.to_be_bytes();
    let image = decoded(&raw_png(8, 0, 1, &[77], &[(b"gAMA", &gamma)]));
    assert_eq!(image.texels[0][0], 77 * 257);
}

fn jpeg(texels: &[u8], width: u32, height: u32, color: ExtendedColorType) -> Vec<u8> {
    let mut bytes = Vec::new();
    let mut encoder = JpegEncoder::new_with_quality(&mut bytes, 100);
    encoder.encode(texels, width, height, color).unwrap();
    bytes
}

#[test]
fn jpegs_decode() {
    let red = decoded(&image(jpeg(
        &[200, 10, 10].repeat(63),
        9,
        7,
        ExtendedColorType::Rgb8,
    )));
    assert_eq!((red.width, red.height, red.source_bits), (9, 7, 8));
    let close = |value: u16, wanted: i32| (i32::from(value / 257) - wanted).abs() <= 3;
    assert!(
        red.texels
            .iter()
            .all(|&[r, g, _, a]| close(r, 200) && close(g, 10) && a == 65535)
    );
    let grey = decoded(&image(jpeg(&[90; 64], 8, 8, ExtendedColorType::L8)));
    assert!(
        grey.texels
            .iter()
            .all(|&[r, g, b, _]| close(r, 90) && r == g && g == b)
    );
}

#[test]
fn truncation_at_every_byte_is_an_error() {
    // The last 12 bytes of a PNG are its empty end chunk, which the decoder does not ask for.
    let files = [
        (png(&[7; 300], 10, 10, ExtendedColorType::Rgb8).bytes, 12),
        (jpeg(&[7; 300], 10, 10, ExtendedColorType::Rgb8), 0),
    ];
    for (bytes, unread) in files {
        assert!(decode_image(&image(bytes.clone()), 100).is_ok());
        for length in 0..bytes.len() - unread {
            let cut = image(bytes[..length].to_vec());
            assert!(
                decode_image(&cut, 100).is_err(),
                "{length} of {}",
                bytes.len()
            );
        }
    }
}

#[test]
fn flipped_bytes_never_panic() {
    let files = [
        png(&[7; 300], 10, 10, ExtendedColorType::Rgb8).bytes,
        jpeg(&[7; 300], 10, 10, ExtendedColorType::Rgb8),
    ];
    for bytes in files {
        for position in 0..bytes.len() {
            for value in [0, 0x7f, 0xff, bytes[position] ^ 1] {
                let mut bytes = bytes.clone();
                bytes[position] = value;
                if let Ok(decoded) = decode_image(&image(bytes), 1 << 16) {
                    let pixels = u64::from(decoded.width) * u64::from(decoded.height);
                    assert_eq!(decoded.texels.len() as u64, pixels);
                }
            }
        }
    }
}

#[test]
fn size_is_checked_before_decoding() {
    let error = fault(decode_image(
        &png(&[0; 12], 4, 3, ExtendedColorType::L8),
        11,
    ));
    assert_eq!(error.code, "image-size");
    assert!(error.message.contains("4x3"));
    let mut huge = png(&[0; 12], 4, 3, ExtendedColorType::L8);
    huge.bytes[16..24].copy_from_slice(&[0x7f, 0xff, 0xff, 0xff, 0x7f, 0xff, 0xff, 0xff]);
    assert!(decode_image(&huge, 1 << 26).is_err());
}

#[test]
fn other_formats_are_named() {
    for (bytes, name) in [
        (&b"GIF89a"[..], "GIF"),
        (b"\xabKTX 11\xbb\r\n\x1a\n", "KTX"),
        (
            b"version https://git-lfs.github.com/spec/v1\n",
            "git lfs pull",
        ),
        (b"hello", "no PNG, JPEG"),
        (b"", "no PNG, JPEG"),
    ] {
        let error = fault(decode_image(&image(bytes.to_vec()), 100));
        assert_eq!(error.code, "image-format");
        assert!(error.message.contains(name), "{}", error.message);
    }
}

/// Adam7 sends the first texel, then the third, then the second, each pass with a filter byte of its own.
#[test]
fn interlaced_rows_are_put_in_order() {
    let image = decoded(&png_of_rows([8, 0, 1], 3, &[10, 0, 30, 0, 20], &[]));
    let greys: Vec<u16> = image.texels.iter().map(|texel| texel[0] / 257).collect();
    assert_eq!(greys, [10, 20, 30]);
    let wide = decoded(&png_of_rows(
        [16, 4, 1],
        2,
        &[1, 2, 3, 4, 0, 5, 6, 7, 8],
        &[],
    ));
    assert_eq!(wide.texels[1], [0x506, 0x506, 0x506, 0x708]);
    assert!(wide.has_alpha && wide.source_bits == 16);
}

const PROGRESSIVE: &[u8] = include_bytes!("fixtures/progressive.jpg");
const CMYK: &[u8] = include_bytes!("fixtures/cmyk.jpg");
const LOSSLESS: &[u8] = include_bytes!("fixtures/lossless.webp");
const LOSSY: &[u8] = include_bytes!("fixtures/lossy.webp");
const ETC1S: &[u8] = include_bytes!("fixtures/etc1s.ktx2");
const UASTC: &[u8] = include_bytes!("fixtures/uastc.ktx2");

/// The picture of every fixture but the CMYK one: two ramps, a disc in blue, and alpha that falls at the right.
fn picture(x: u32, y: u32) -> [u8; 4] {
    let inside = (x as i32 - 10).pow(2) + (y as i32 - 6).pow(2) < 16;
    let alpha = if x < 14 { 255 } else { 255 - 20 * (x - 13) };
    let blue = if inside { 255 } else { 64 };
    [x * 255 / 19, y * 255 / 11, blue, alpha].map(|value| value as u8)
}

/// Largest and root mean square difference to the picture in the first `channels`, in steps of 1/255.
fn difference(image: &DecodedImage, channels: usize) -> (f64, f64) {
    assert_eq!((image.width, image.height), (20, 12));
    let (mut largest, mut sum) = (0.0_f64, 0.0);
    for (index, texel) in (0..).zip(&image.texels) {
        let expected = picture(index % 20, index / 20);
        for channel in 0..channels {
            let found = f64::from(texel[channel]) / 257.0;
            let difference = (found - f64::from(expected[channel])).abs();
            largest = largest.max(difference);
            sum += difference * difference;
        }
    }
    (largest, (sum / (240 * channels) as f64).sqrt())
}

#[test]
fn every_source_shows_the_picture() {
    let lossless = decoded(&image(LOSSLESS.into()));
    assert_eq!(difference(&lossless, 4), (0.0, 0.0));
    assert!(lossless.has_alpha && lossless.smaller.is_empty());
    for (bytes, channels, bound) in [
        (PROGRESSIVE, 3, 24.0),
        (LOSSY, 3, 24.0),
        (ETC1S, 4, 36.0),
        (UASTC, 4, 6.0),
    ] {
        let image = decoded(&image(bytes.into()));
        let (_, rms) = difference(&image, channels);
        assert!(rms < bound, "{rms} for {} bytes", bytes.len());
        assert_eq!(image.has_alpha, channels == 4);
    }
}

#[test]
fn levels_of_ktx2_files_are_read() {
    for (bytes, bound) in [(ETC1S, 20.0), (UASTC, 8.0)] {
        let image = decoded(&image(bytes.into()));
        let sizes: Vec<usize> = image.smaller.iter().map(Vec::len).collect();
        assert_eq!(sizes, [60, 15, 2, 1]);
        // The last level is the mean of the picture, in linear light; alpha is linear as it is.
        let mean = |channel: usize| {
            let power = if channel == 3 { 1.0 } else { 2.2 };
            let codes = (0..240).map(|index| picture(index % 20, index / 20)[channel]);
            let sum: f64 = codes
                .map(|code| (f64::from(code) / 255.0).powf(power))
                .sum();
            255.0 * (sum / 240.0).powf(power.recip())
        };
        for channel in 0..4 {
            let found = f64::from(image.smaller[3][0][channel]) / 257.0;
            let expected = mean(channel);
            assert!(
                (found - expected).abs() < bound,
                "{channel}: {found} {expected}"
            );
        }
    }
}

/// The data format descriptor's word of colour model and transfer function, and the channel of its sample.
const TRANSFER: usize = 202 + 12;
const CHANNEL: usize = 200 + 31;

#[test]
fn universal_blocks_come_with_their_texels() {
    let srgb = decoded(&image(UASTC.into()));
    let lengths: Vec<usize> = srgb.universal.as_ref().map_or(Vec::new(), |universal| {
        universal.levels.iter().map(Vec::len).collect()
    });
    assert_eq!(lengths, [15 * 16, 6 * 16, 2 * 16, 16, 16]);
    let mut bytes = UASTC.to_vec();
    assert_eq!(bytes[TRANSFER], 2);
    bytes[TRANSFER] = 1;
    let linear = decoded(&image(bytes.clone()));
    assert_eq!(linear.universal, srgb.universal);
    let apart = |one: &[u16; 4], other: &[u16; 4]| {
        let pairs = one.iter().zip(other);
        pairs.map(|(one, other)| one.abs_diff(*other)).max()
    };
    let pairs = linear.texels.iter().zip(&srgb.texels);
    assert_eq!(
        pairs.map(|(one, other)| apart(one, other)).max(),
        Some(Some(257))
    );
    // The same file, read by the transcoder, which expands as for linear texels.
    let transcoder = basisu::Transcoder::new(&bytes).expect("a good file");
    let (target, flags) = (basisu::TargetFormat::Rgba32, basisu::DecodeFlags::NONE);
    for (level, texels) in (0..).zip(std::iter::once(&linear.texels).chain(&linear.smaller)) {
        let codes = transcoder.transcode(level, target, flags).expect("a level");
        assert_eq!(wide(&codes), *texels);
    }
}

#[test]
fn two_channels_are_red_and_green() {
    let all = decoded(&image(UASTC.into()));
    let mut bytes = UASTC.to_vec();
    assert_eq!(bytes[CHANNEL] & 15, 3);
    bytes[CHANNEL] = 5;
    let mut pair = decoded(&image(bytes));
    assert!(pair.pair && !pair.has_alpha && !all.pair);
    assert_eq!(pair.universal, all.universal);
    let levels =
        |image: &DecodedImage| [vec![image.texels.clone()], image.smaller.clone()].concat();
    for (pair, all) in levels(&pair)
        .iter()
        .flatten()
        .zip(levels(&all).iter().flatten())
    {
        assert_eq!(*pair, [all[0], all[3], 0, u16::MAX]);
    }
    pair.rebuild_normals();
    for texel in &pair.texels {
        let [x, y, z] = [0, 1, 2].map(|at| f32::from(texel[at]) / 32767.5 - 1.0);
        let beyond = (x * x + y * y).max(1.0);
        assert!((x * x + y * y + z * z - beyond).abs() < 1e-3, "{x} {y} {z}");
    }
    // Red and green of ETC1S lie in two slices.
    let mut bytes = ETC1S.to_vec();
    assert_eq!([bytes[CHANNEL], bytes[CHANNEL + 16]], [0, 15]);
    [bytes[CHANNEL], bytes[CHANNEL + 16]] = [3, 4];
    assert!(decoded(&image(bytes)).pair);
}

#[test]
fn faulty_levels_of_universal_blocks_are_named() {
    let fails = |change: &dyn Fn(&mut Vec<u8>)| {
        let mut bytes = UASTC.to_vec();
        change(&mut bytes);
        fault(decode_image(&image(bytes), 1 << 16)).message
    };
    // Entries of the level index: offset, length, unpacked length.
    let longer = fails(&|bytes| bytes[80 + 24 + 16] += 16);
    assert!(
        longer.contains("level 1 of the KTX2 has 112 bytes instead of 96"),
        "{longer}"
    );
    let cut = fails(&|bytes| bytes[80 + 48 + 2] = 1);
    assert!(cut.contains("level 2 of the KTX2 is cut off"), "{cut}");
    let start = UASTC[80] as usize | (UASTC[81] as usize) << 8;
    let packed = fails(&|bytes| bytes[start] ^= 0xff);
    assert!(
        packed.contains("level 0 of the KTX2 does not unpack"),
        "{packed}"
    );
    let plain = fails(&|bytes| bytes[44] = 0);
    assert!(plain.contains("bytes instead of"), "{plain}");
}

/// Ink of 0, 200, 255 and 30 of 255: full red, a fifth of green, no blue, darkened by the black.
#[test]
fn cmyk_becomes_rgb() {
    let image = decoded(&image(CMYK.into()));
    let [r, g, b, a] = image.texels[27].map(|value| i32::from(value / 257));
    assert!(
        (r - 225).abs() < 6 && (g - 49).abs() < 6 && b < 6,
        "{r} {g} {b}"
    );
    assert_eq!((a, image.has_alpha), (255, false));
}

#[test]
fn cut_files_of_other_formats_are_errors() {
    // The end of a KTX2 or WebP may be padding.
    for (bytes, unread) in [(LOSSLESS, 8), (LOSSY, 8), (ETC1S, 1), (UASTC, 1)] {
        for length in 0..bytes.len() - unread {
            let cut = image(bytes[..length].to_vec());
            let error = fault(decode_image(&cut, 1 << 16));
            assert!(
                error.message.starts_with("image `test`"),
                "{}",
                error.message
            );
        }
    }
}

#[test]
fn changed_bytes_of_other_formats_never_panic() {
    for bytes in [LOSSLESS, LOSSY, ETC1S, UASTC] {
        for position in 0..bytes.len() {
            for value in [0, 0x7f, 0xff, bytes[position] ^ 1] {
                let mut bytes = bytes.to_vec();
                bytes[position] = value;
                if let Ok(decoded) = decode_image(&image(bytes), 1 << 16) {
                    let pixels = u64::from(decoded.width) * u64::from(decoded.height);
                    assert_eq!(decoded.texels.len() as u64, pixels);
                }
            }
        }
    }
}

#[test]
fn errors_name_image_and_material() {
    let mut broken = image(b"RIFF\x10\0\0\0WEBPVP8 ".to_vec());
    broken.material = "bark".into();
    let error = fault(decode_image(&broken, 100));
    assert!(
        error
            .message
            .starts_with("image `test` of material `bark`:")
    );
    for bytes in [LOSSLESS, LOSSY, ETC1S, UASTC, PROGRESSIVE] {
        let error = fault(decode_image(&image(bytes.into()), 239));
        assert_eq!(error.code, "image-size");
    }
}

/// A DDS of one 4x4 level.
fn dds(flags: u32, code: &[u8; 4], dxgi: u32, texels: &[u8]) -> Image {
    let mut words = [0_u32; 37];
    words[0] = u32::from_le_bytes(*b"DDS ");
    (words[3], words[4]) = (4, 4);
    (words[20], words[21]) = (flags, u32::from_le_bytes(*code));
    (words[22], words[23]) = (32, 0xff_0000);
    words[32] = dxgi;
    let length = if code == b"DX10" { 37 } else { 32 };
    let header = words[..length].iter().flat_map(|word| word.to_le_bytes());
    image(header.chain(texels.iter().copied()).collect())
}

#[test]
fn dds_files_decode() {
    let bgra = dds(0x41, &[0; 4], 0, &[1, 2, 3, 4].repeat(16));
    assert_eq!(
        decoded(&bgra).texels[7],
        [3, 2, 1, 4].map(|code: u16| code * 257)
    );
    // Red 31 of 31 in both endpoints.
    let red = [0x00, 0xf8, 0x00, 0xf8, 0, 0, 0, 0];
    let bc1 = decoded(&dds(4, b"DXT1", 0, &red));
    assert_eq!(bc1.texels[3], [65535, 0, 0, 65535]);
    let bc5 = decoded(&dds(
        4,
        b"DX10",
        83,
        &[200, 100, 0, 0, 0, 0, 0, 0].repeat(2),
    ));
    assert_eq!(bc5.texels[0][..2], [200 * 257; 2]);
    for (bytes, what) in [
        (dds(4, b"DXT1", 0, &red[..7]).bytes, "cut off"),
        (dds(4, b"DX10", 2, &red).bytes, "DXGI format 2"),
        (dds(4, b"????", 0, &red).bytes, "`????`"),
        (b"DDS ".to_vec(), "cut off"),
    ] {
        let error = fault(decode_image(&image(bytes), 100));
        assert!(error.message.contains(what), "{}", error.message);
    }
}
