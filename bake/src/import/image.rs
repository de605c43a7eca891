//! Reads encoded images, decodes them to pixels on demand.

use std::io::Cursor;

use ::image::{ColorType, DynamicImage, ImageDecoder, ImageFormat, ImageReader};

use crate::diagnostic::{BakeError, Result};
use crate::scene::Image;

mod dds;
mod ktx2;

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
    /// Levels 1, 2, ... where the file has its own, each of `max(1, size >> level)` texels.
    pub smaller: Vec<Vec<[u16; 4]>>,
    /// 8 (also for fewer bits) or 16.
    pub source_bits: u8,
    /// Whether the file carries alpha: a channel, or a transparent palette entry or colour key.
    pub has_alpha: bool,
    /// Whether the file holds two channels alone, which are red and green here; blue is then 0.
    pub pair: bool,
    /// The blocks that were decoded, where a package may hold them as they are. Whoever changes texels drops them.
    pub universal: Option<Universal>,
}

impl DecodedImage {
    /// Gives normals of two channels the blue that a unit normal has.
    pub fn rebuild_normals(&mut self) {
        let rebuild = |texel: &mut [u16; 4]| {
            let [x, y] = [texel[0], texel[1]].map(|code| f32::from(code) / 32767.5 - 1.0);
            let z = (1.0 - x * x - y * y).max(0.0).sqrt();
            texel[2] = ((z + 1.0) * 32767.5 + 0.5) as u16;
        };
        self.texels.iter_mut().for_each(rebuild);
        self.smaller.iter_mut().flatten().for_each(rebuild);
    }
}

/// UASTC blocks of a file: RGBA, or of a pair the first channel as colour and the second as alpha.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Universal {
    /// Of every level that the file has, in rows, edge blocks whole.
    pub levels: Vec<Vec<u8>>,
}

/// Reads the encoded bytes of image `index` without decoding them; its user is left open.
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
        material: String::new(),
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

/// What is known of an image before it is decoded.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ImageHeader {
    pub width: u32,
    pub height: u32,
    /// Whether the file may carry alpha.
    pub has_alpha: bool,
}

/// Reads the header of an image; nothing is decoded.
///
/// # Errors
/// Another format, a broken header, or more than `limit_pixels` pixels.
pub fn image_header(image: &Image, limit_pixels: u64) -> Result<ImageHeader> {
    let header = match sniff::image_format(&image.bytes) {
        Some("KTX2") => ktx2::header(&image.bytes),
        Some("DDS") => dds::header(&image.bytes),
        _ => {
            let decoder = raster(image)?;
            let (width, height) = decoder.dimensions();
            Ok(ImageHeader {
                width,
                height,
                has_alpha: decoder.color_type().has_alpha(),
            })
        }
    };
    let header = header.map_err(|message| fault(image, "image-broken", message))?;
    let pixels = u64::from(header.width) * u64::from(header.height);
    if pixels == 0 || pixels > limit_pixels {
        let (width, height) = (header.width, header.height);
        let message = format!(
            "{width}x{height} pixels are not within 1 and the limit of {limit_pixels}; resize it or raise --limit-pixels"
        );
        return Err(fault(image, "image-size", message));
    }
    Ok(header)
}

/// Decodes a PNG, JPEG, WebP, DDS, or a KTX2 of Basis Universal, told apart by content.
///
/// # Errors
/// Another format, broken or cut data, or more than `limit_pixels` pixels; the size is checked
/// before anything is decoded.
pub fn decode_image(image: &Image, limit_pixels: u64) -> Result<DecodedImage> {
    let header = image_header(image, limit_pixels)?;
    let blocks = match sniff::image_format(&image.bytes) {
        Some("KTX2") => ktx2::decode(&image.bytes, header),
        Some("DDS") => dds::decode(&image.bytes, header),
        _ => return decode_raster(image, header),
    };
    blocks.map_err(|message| fault(image, "image-broken", message))
}

fn decode_raster(image: &Image, header: ImageHeader) -> Result<DecodedImage> {
    if image.bytes.starts_with(b"\xff\xd8") && !jpeg_is_complete(&image.bytes) {
        let message = "the JPEG ends before its end marker; copy or save it again";
        return Err(fault(image, "image-broken", message));
    }
    let decoder = raster(image)?;
    let color = decoder.color_type();
    let decoded = DynamicImage::from_decoder(decoder).map_err(|error| broken(image, &error))?;
    let Some(texels) = widen(&decoded) else {
        let message = format!("the pixel format {color:?} is not supported; save it as RGBA");
        return Err(fault(image, "image-format", message));
    };
    let wide = [
        ColorType::L16,
        ColorType::La16,
        ColorType::Rgb16,
        ColorType::Rgba16,
    ];
    Ok(DecodedImage {
        width: header.width,
        height: header.height,
        texels,
        smaller: Vec::new(),
        source_bits: if wide.contains(&color) { 16 } else { 8 },
        has_alpha: header.has_alpha,
        pair: false,
        universal: None,
    })
}

/// The decoder of a PNG, JPEG or WebP.
fn raster(image: &Image) -> Result<impl ImageDecoder + '_> {
    let format = match sniff::image_format(&image.bytes) {
        Some("PNG") => ImageFormat::Png,
        Some("JPEG") => ImageFormat::Jpeg,
        Some("WebP") => ImageFormat::WebP,
        other => {
            let message = unknown_format(other, &image.bytes);
            return Err(fault(image, "image-format", message));
        }
    };
    let mut reader = ImageReader::with_format(Cursor::new(&image.bytes), format);
    // The caller's pixel limit bounds the memory instead of the decoder's fixed one.
    reader.no_limits();
    reader.into_decoder().map_err(|error| broken(image, &error))
}

fn fault(image: &Image, code: &'static str, message: impl std::fmt::Display) -> BakeError {
    let user = match image.material.as_str() {
        "" => String::new(),
        material => format!(" of material `{material}`"),
    };
    let message = format!("image `{}`{user}: {message}", image.name);
    BakeError::input(code, &image.origin, message)
}

fn broken(image: &Image, error: &::image::ImageError) -> BakeError {
    let message = format!("{error}; save it again as PNG or JPEG");
    fault(image, "image-broken", message)
}

fn unknown_format(known: Option<&str>, bytes: &[u8]) -> String {
    match (known, sniff::impostor(bytes)) {
        (Some(name), _) => format!("{name} is not supported; save it as PNG or JPEG"),
        (None, Some(what)) => what.into(),
        (None, None) => "this is no PNG, JPEG, WebP, KTX2 or DDS; save it as one of them".into(),
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

/// 8-bit RGBA texels as 16-bit ones.
fn wide(codes: &[u8]) -> Vec<[u16; 4]> {
    let texels = codes.as_chunks::<4>().0.iter();
    texels
        .map(|texel| texel.map(|code| u16::from(code) * 257))
        .collect()
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
mod tests;
