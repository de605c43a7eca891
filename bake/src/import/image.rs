//! Reads encoded images, decodes them to pixels on demand.

use std::io::Cursor;

use ::image::{ColorType, DynamicImage, ImageDecoder, ImageFormat, ImageReader};

use crate::diagnostic::{BakeError, Result};
use crate::scene::Image;

use super::context::Context;
use super::uri::{self, Resource};
use super::{buffer, sniff};

/// A decoded image: `width * height` RGBA texels, row 0 first, values as encoded (no colour
/// conversion; colour profiles, gamma chunks and EXIF orientation are ignored, glTF 2.0 section
/// 3.8.2).
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct DecodedImage {
    pub width: u32,
    pub height: u32,
    /// Grey is spread over RGB, absent alpha is 65535, 8-bit values are widened by `v * 257`.
    pub texels: Vec<[u16; 4]>,
    /// 8 (also for fewer bits) or 16.
    pub source_bits: u8,
    /// Whether the file carries alpha: a channel, or a transparent palette entry or colour key.
    pub has_alpha: bool,
}

/// Reads the encoded bytes of image `index` without decoding them.
///
/// # Errors
/// A missing file, or not exactly one of `uri` and `bufferView`.
pub(super) fn read(context: &Context, index: u32) -> Result<Image> {
    let image = &context.document.images[index as usize];
    let pointer = format!("/images/{index}");
    let bytes = match (&image.uri, image.buffer_view) {
        (Some(uri), None) => context.resource(uri, &pointer)?,
        (None, Some(view)) => {
            let referrer = format!("{pointer}/bufferView");
            buffer::view(context, view.value(), &referrer)?
                .bytes
                .to_vec()
        }
        _ => {
            let message = "an image needs either a URI or a bufferView; export again";
            return Err(context.error("image-source", pointer, message));
        }
    };
    let named = image.name.clone().filter(|name| !name.is_empty());
    let stem = || image.uri.as_deref().and_then(file_stem);
    Ok(Image {
        name: named
            .or_else(stem)
            .unwrap_or_else(|| format!("image {index}")),
        bytes,
        origin: context.origin(pointer),
    })
}

fn file_stem(uri: &str) -> Option<String> {
    let Ok(Resource::File(path)) = uri::resolve(uri) else {
        return None;
    };
    let stem = std::path::Path::new(&path).file_stem()?;
    Some(stem.to_string_lossy().into_owned())
}

/// Decodes a PNG or JPEG, told apart by content.
///
/// # Errors
/// Another format, broken or cut data, or more than `limit_pixels` pixels; the size is checked
/// before anything is decoded.
pub fn decode_image(image: &Image, limit_pixels: u64) -> Result<DecodedImage> {
    let fault = |code, message: String| {
        let message = format!("image `{}`: {message}", image.name);
        BakeError::input(code, &image.origin, message)
    };
    let format = match sniff::image_format(&image.bytes) {
        Some("PNG") => ImageFormat::Png,
        Some("JPEG") => ImageFormat::Jpeg,
        other => return Err(fault("image-format", unknown_format(other, &image.bytes))),
    };
    let broken = |error: ::image::ImageError| {
        fault(
            "image-broken",
            format!("{error}; save it again as PNG or JPEG"),
        )
    };
    let mut reader = ImageReader::with_format(Cursor::new(&image.bytes), format);
    // The caller's pixel limit bounds the memory instead of the decoder's fixed one.
    reader.no_limits();
    let decoder = reader.into_decoder().map_err(broken)?;
    let (width, height) = decoder.dimensions();
    let pixels = u64::from(width) * u64::from(height);
    if pixels == 0 || pixels > limit_pixels {
        let message = format!(
            "{width}x{height} pixels are not within 1 and the limit of {limit_pixels}; resize it"
        );
        return Err(fault("image-size", message));
    }
    if format == ImageFormat::Jpeg && !jpeg_is_complete(&image.bytes) {
        let message = "the JPEG ends before its end marker; copy or save it again";
        return Err(fault("image-broken", message.into()));
    }
    let color = decoder.color_type();
    let decoded = DynamicImage::from_decoder(decoder).map_err(broken)?;
    let Some(texels) = widen(&decoded) else {
        let message = format!("the pixel format {color:?} is not supported; save it as RGBA");
        return Err(fault("image-format", message));
    };
    Ok(DecodedImage {
        width,
        height,
        texels,
        source_bits: if matches!(
            color,
            ColorType::L16 | ColorType::La16 | ColorType::Rgb16 | ColorType::Rgba16
        ) {
            16
        } else {
            8
        },
        has_alpha: color.has_alpha(),
    })
}

fn unknown_format(known: Option<&str>, bytes: &[u8]) -> String {
    match (known, sniff::impostor(bytes)) {
        (Some(name), _) => format!("{name} is not supported; save it as PNG or JPEG"),
        (None, Some(what)) => what.into(),
        (None, None) => "this is neither PNG nor JPEG; save it as one of them".into(),
    }
}

/// Whether an end-of-image marker follows the last scan. The decoder fills a cut JPEG with grey.
fn jpeg_is_complete(bytes: &[u8]) -> bool {
    let last = |marker: [u8; 2]| bytes.windows(2).rposition(|pair| pair == marker);
    match (last([0xff, 0xda]), last([0xff, 0xd9])) {
        (Some(scan), Some(end)) => end > scan,
        _ => false,
    }
}

/// All texels as 16-bit RGBA, or `None` for floating-point pixels.
fn widen(image: &DynamicImage) -> Option<Vec<[u16; 4]>> {
    const OPAQUE: u16 = u16::MAX;
    fn texels<const N: usize>(data: &[u8], rgba: fn([u16; N]) -> [u16; 4]) -> Vec<[u16; 4]> {
        let wide = |texel: &[u8; N]| rgba(texel.map(|value| u16::from(value) * 257));
        data.as_chunks::<N>().0.iter().map(wide).collect()
    }
    fn texels16<const N: usize>(data: &[u16], rgba: fn([u16; N]) -> [u16; 4]) -> Vec<[u16; 4]> {
        let chunks = data.as_chunks::<N>().0.iter();
        chunks.map(|texel| rgba(*texel)).collect()
    }
    let grey = |[l]: [u16; 1]| [l, l, l, OPAQUE];
    let grey_alpha = |[l, a]: [u16; 2]| [l, l, l, a];
    let rgb = |[r, g, b]: [u16; 3]| [r, g, b, OPAQUE];
    let rgba = |texel: [u16; 4]| texel;
    Some(match image {
        DynamicImage::ImageLuma8(pixels) => texels(pixels, grey),
        DynamicImage::ImageLumaA8(pixels) => texels(pixels, grey_alpha),
        DynamicImage::ImageRgb8(pixels) => texels(pixels, rgb),
        DynamicImage::ImageRgba8(pixels) => texels(pixels, rgba),
        DynamicImage::ImageLuma16(pixels) => texels16(pixels, grey),
        DynamicImage::ImageLumaA16(pixels) => texels16(pixels, grey_alpha),
        DynamicImage::ImageRgb16(pixels) => texels16(pixels, rgb),
        DynamicImage::ImageRgba16(pixels) => texels16(pixels, rgba),
        _ => return None,
    })
}

#[cfg(test)]
mod tests {
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
        header.extend([0, 0, 0, 1, bits, color, 0, 0, 0]);
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
            (&b"RIFF\0\0\0\0WEBPVP8 "[..], "WebP"),
            (b"\xabKTX 20\xbb\r\n\x1a\n", "KTX2"),
            (
                b"version https://git-lfs.github.com/spec/v1\n",
                "git lfs pull",
            ),
            (b"hello", "neither PNG nor JPEG"),
            (b"", "neither PNG nor JPEG"),
        ] {
            let error = fault(decode_image(&image(bytes.to_vec()), 100));
            assert_eq!(error.code, "image-format");
            assert!(error.message.contains(name), "{}", error.message);
        }
    }
}
