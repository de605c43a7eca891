//! Loads equirectangular environment images (`.hdr`, `.exr`).

use std::io::Cursor;
use std::path::Path;

use exr::image::{AnyChannels, FlatSamples, Layer};
use exr::meta::MetaData;
use exr::meta::header::Header;
use exr::prelude::{ReadChannels, ReadLayers, read};

use crate::diagnostic::{BakeError, Diagnostic, Result};
use crate::scene::{Origin, Source};

use super::context::{describe, read_file};
use super::{radiance, sniff};

/// An environment as latitude-longitude texels of linear RGB radiance, all finite and >= 0.
///
/// For a unit direction (x, y, z) in glTF's right-handed, +Y-up space the texel coordinates are
/// `u = 0.5 + atan2(z, x) / 2 pi` and `v = acos(y) / pi`; row 0 is the top (+Y).
#[derive(Clone, Debug)]
pub struct EnvironmentImage {
    pub width: u32,
    pub height: u32,
    /// `width * height` texels, row by row.
    pub texels: Vec<[f32; 3]>,
    pub replaced: ReplacedTexels,
    /// The file as the user named it.
    pub source: Source,
    pub diagnostics: Vec<Diagnostic>,
}

/// How many channel values were not usable and were replaced.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ReplacedTexels {
    /// Set to zero.
    pub nan: u64,
    /// Positive infinities, set to the largest finite value of the image.
    pub infinite: u64,
    /// Set to zero; negative infinities among them.
    pub negative: u64,
}

/// 16384 x 8192.
const PIXEL_LIMIT: u64 = 1 << 27;

/// More pixels than this for a byte of file are taken for an attack on the memory, since no
/// compressor of the format reaches it on a picture.
const PIXELS_PER_BYTE: u64 = 1 << 16;

/// Width, height, texels.
type Texels = (u32, u32, Vec<[f32; 3]>);

/// Loads an environment image; the format is told by content.
///
/// # Errors
/// `BakeError::Io` where the file cannot be read, `BakeError::Input` where it is broken, too
/// large, or in a variant that is not supported.
pub fn load_environment(path: &Path) -> Result<EnvironmentImage> {
    let (bytes, source) = read_environment(path)?;
    decode_environment(path, &bytes, source)
}

/// Reads the file of an environment image without looking into it.
///
/// # Errors
/// `BakeError::Io` where the file cannot be read.
pub fn read_environment(path: &Path) -> Result<(Vec<u8>, Source)> {
    let bytes = read_file(path).map_err(|error| BakeError::io(path, error))?;
    let name = path.display().to_string().replace('\\', "/");
    let source = describe(name, &bytes);
    Ok((bytes, source))
}

/// Pixels of an environment image by its header; `None` where decoding will say what is wrong.
pub fn environment_pixels(bytes: &[u8]) -> Option<u64> {
    if radiance::is_radiance(bytes) {
        return radiance::pixels(bytes);
    }
    let meta = MetaData::read_from_buffered(Cursor::new(bytes), false).ok()?;
    let size = meta.headers.first()?.layer_size;
    (size.width() as u64).checked_mul(size.height() as u64)
}

/// Decodes an environment image; the format is told by content.
///
/// # Errors
/// `BakeError::Input` where it is broken, too large, or in a variant that is not supported.
pub fn decode_environment(path: &Path, bytes: &[u8], source: Source) -> Result<EnvironmentImage> {
    decode(bytes, path.display().to_string(), source)
}

fn decode(bytes: &[u8], file: String, source: Source) -> Result<EnvironmentImage> {
    let origin = Origin {
        file,
        pointer: String::new(),
    };
    let mut diagnostics = Vec::new();
    let (width, height, mut texels) = if radiance::is_radiance(bytes) {
        decode_radiance(bytes, &origin, &mut diagnostics)?
    } else if bytes.starts_with(&[0x76, 0x2f, 0x31, 0x01]) {
        decode_exr(bytes, &origin, &mut diagnostics)?
    } else {
        let message = match (sniff::impostor(bytes), sniff::image_format(bytes)) {
            (Some(what), _) => what.to_owned(),
            (None, Some(name)) => {
                format!("{name} holds no radiance; use a Radiance .hdr or an OpenEXR file")
            }
            (None, None) => "this is neither Radiance .hdr nor OpenEXR; save it as one".into(),
        };
        return Err(BakeError::input("environment-format", &origin, message));
    };
    if u64::from(width) != 2 * u64::from(height) {
        let message = format!(
            "{width}x{height} is not twice as wide as high; it is stretched over the whole sphere"
        );
        diagnostics.push(Diagnostic::warning("environment-aspect", &origin, message));
    }
    let replaced = sanitise(&mut texels);
    if replaced != ReplacedTexels::default() {
        let ReplacedTexels {
            nan,
            infinite,
            negative,
        } = replaced;
        let message = format!(
            "values replaced: {nan} NaN and {negative} negative by 0, {infinite} infinite by the \
             largest finite value"
        );
        diagnostics.push(Diagnostic::warning("environment-values", &origin, message));
    }
    Ok(EnvironmentImage {
        width,
        height,
        texels,
        replaced,
        source,
        diagnostics,
    })
}

fn decode_radiance(
    bytes: &[u8],
    origin: &Origin,
    diagnostics: &mut Vec<Diagnostic>,
) -> Result<Texels> {
    let picture = radiance::decode(bytes, PIXEL_LIMIT).map_err(|fault| {
        let origin = Origin {
            pointer: format!("byte {}", fault.offset),
            ..origin.clone()
        };
        BakeError::input("environment-broken", &origin, fault.message)
    })?;
    for entry in &picture.ignored {
        let message =
            format!("the header entry `{entry}` is not applied; save the file with linear values");
        diagnostics.push(Diagnostic::warning("environment-header", origin, message));
    }
    Ok((picture.width, picture.height, picture.texels))
}

fn decode_exr(bytes: &[u8], origin: &Origin, diagnostics: &mut Vec<Diagnostic>) -> Result<Texels> {
    let broken = |error: exr::error::Error| {
        let (code, what) = match error {
            exr::error::Error::NotSupported(what) => ("environment-format", what),
            other => ("environment-broken", other.to_string().into()),
        };
        let message = format!("{what}; re-save it as ZIP-compressed scanlines");
        BakeError::input(code, origin, message)
    };
    let meta = MetaData::read_from_buffered(Cursor::new(bytes), false).map_err(broken)?;
    let Some(header) = meta.headers.first() else {
        return Err(BakeError::input(
            "environment-broken",
            origin,
            "the file has no layer",
        ));
    };
    check_exr(header, bytes.len() as u64)
        .map_err(|(code, message)| BakeError::input(code, origin, message))?;
    if meta.headers.len() > 1 {
        let message = "only the first layer is used";
        diagnostics.push(Diagnostic::warning("environment-layers", origin, message));
    }
    let window = header.shared_attributes.display_window;
    if window.size != header.layer_size || window.position != header.own_attributes.layer_position {
        let message = "the data window differs from the display window; the data window is used";
        diagnostics.push(Diagnostic::warning("environment-window", origin, message));
    }
    // In this thread: the library's decoders panic on some damaged blocks, and a panic in its pool ends the process.
    let decoded = std::panic::catch_unwind(|| {
        read()
            .no_deep_data()
            .largest_resolution_level()
            .all_channels()
            .first_valid_layer()
            .all_attributes()
            .non_parallel()
            .from_buffered(Cursor::new(bytes))
    });
    let damaged = |_| {
        broken(exr::error::Error::Invalid(
            "a compressed block is damaged".into(),
        ))
    };
    let image = decoded.map_err(damaged)?.map_err(broken)?;
    let layer = &image.layer_data;
    match exr_texels(layer) {
        Some(texels) => Ok((
            layer.size.width() as u32,
            layer.size.height() as u32,
            texels,
        )),
        None => {
            let message = "the first layer has neither R, G, B nor Y alone; save it as RGB";
            Err(BakeError::input("environment-format", origin, message))
        }
    }
}

/// Bounds what the decoder will allocate, and names what cannot be decoded.
fn check_exr(header: &Header, bytes: u64) -> Result<(), (&'static str, String)> {
    use exr::compression::Compression;
    let unsupported = |what: &str| {
        let message = format!("{what} is not supported; re-save it as ZIP-compressed scanlines");
        Err(("environment-format", message))
    };
    if header.deep {
        return unsupported("deep data");
    }
    if matches!(
        header.compression,
        Compression::HTJ2K32 | Compression::HTJ2K256
    ) {
        return unsupported("HTJ2K compression");
    }
    let (width, height) = (
        header.layer_size.width() as u64,
        header.layer_size.height() as u64,
    );
    let channels = header.channels.list.len() as u64;
    let pixels = width.saturating_mul(height);
    let limit = PIXEL_LIMIT.min(bytes.saturating_mul(PIXELS_PER_BYTE));
    if pixels == 0 || pixels > limit || pixels.saturating_mul(channels) > 4 * PIXEL_LIMIT {
        let message = format!(
            "{width}x{height} pixels of {channels} channels in {bytes} bytes are not within the \
             limits; resize it and keep only R, G, B"
        );
        return Err(("environment-broken", message));
    }
    if header
        .channels
        .list
        .iter()
        .any(|c| c.sampling.x() != 1 || c.sampling.y() != 1)
    {
        return unsupported("subsampled chroma");
    }
    Ok(())
}

/// RGB of the channels R, G and B, or grey of Y.
fn exr_texels(layer: &Layer<AnyChannels<FlatSamples>>) -> Option<Vec<[f32; 3]>> {
    let channels = &layer.channel_data.list;
    let find = |name: &str| {
        let channel = channels.iter().find(|channel| channel.name.eq(name));
        channel.map(|channel| channel.sample_data.values_as_f32())
    };
    if let (Some(r), Some(g), Some(b)) = (find("R"), find("G"), find("B")) {
        return Some(r.zip(g).zip(b).map(|((r, g), b)| [r, g, b]).collect());
    }
    if find("RY").is_some() || find("BY").is_some() {
        return None;
    }
    find("Y").map(|grey| grey.map(|y| [y; 3]).collect())
}

/// Makes every value finite and non-negative.
fn sanitise(texels: &mut [[f32; 3]]) -> ReplacedTexels {
    let values = texels.as_flattened_mut();
    let finite = values.iter().copied().filter(|value| value.is_finite());
    let largest = finite.fold(0.0, f32::max);
    let mut replaced = ReplacedTexels::default();
    for value in values {
        if value.is_nan() {
            *value = 0.0;
            replaced.nan += 1;
        } else if *value < 0.0 {
            *value = 0.0;
            replaced.negative += 1;
        } else if value.is_infinite() {
            *value = largest;
            replaced.infinite += 1;
        }
    }
    replaced
}

#[cfg(test)]
mod tests {
    use exr::prelude::*;

    use super::*;
    use crate::import::testing::fault;

    fn load(bytes: &[u8]) -> crate::Result<EnvironmentImage> {
        let image = super::decode(bytes, "test".into(), describe("test".into(), bytes));
        if let Ok(image) = &image {
            let pixels = u64::from(image.width) * u64::from(image.height);
            assert_eq!(environment_pixels(bytes), Some(pixels));
        }
        image
    }

    fn codes(image: &EnvironmentImage) -> Vec<&'static str> {
        image
            .diagnostics
            .iter()
            .map(|warning| warning.code)
            .collect()
    }

    /// An OpenEXR file of `width` x `height` with the named channels.
    fn exr(
        width: usize,
        height: usize,
        compression: Compression,
        blocks: Blocks,
        channels: Vec<(&str, FlatSamples)>,
    ) -> Vec<u8> {
        let encoding = Encoding {
            compression,
            blocks,
            line_order: LineOrder::Increasing,
        };
        let channels = channels
            .into_iter()
            .map(|(name, data)| AnyChannel::new(name, data));
        let layer = Layer::new(
            (width, height),
            LayerAttributes::default(),
            encoding,
            AnyChannels::sort(channels.collect()),
        );
        let mut bytes = Vec::new();
        let image = Image::from_layer(layer);
        image
            .write()
            .to_buffered(std::io::Cursor::new(&mut bytes))
            .unwrap();
        bytes
    }

    fn ramp(scale: f32) -> FlatSamples {
        FlatSamples::F32((0..8).map(|i| i as f32 * scale).collect())
    }

    #[test]
    fn exr_channels_are_read_exactly() {
        let tiles = Blocks::Tiles(Vec2(3, 2));
        for (compression, blocks) in [
            (Compression::Uncompressed, Blocks::ScanLines),
            (Compression::ZIP16, Blocks::ScanLines),
            (Compression::PIZ, Blocks::ScanLines),
            (Compression::RLE, tiles),
            (Compression::ZIP1, tiles),
        ] {
            let channels = vec![
                ("R", ramp(1.0)),
                ("G", ramp(2.0)),
                ("B", ramp(4.0)),
                ("A", ramp(0.0)),
            ];
            let image = load(&exr(4, 2, compression, blocks, channels)).unwrap();
            assert_eq!((image.width, image.height), (4, 2));
            assert_eq!(image.texels[5], [5.0, 10.0, 20.0]);
            assert!(image.diagnostics.is_empty(), "{:?}", image.diagnostics);
        }
    }

    #[test]
    fn half_and_grey_are_widened() {
        let half = FlatSamples::F16(
            (0..8u8)
                .map(|i| f16::from_f32(f32::from(i) / 4.0))
                .collect(),
        );
        let image = load(&exr(
            4,
            2,
            Compression::ZIP16,
            Blocks::ScanLines,
            vec![("Y", half)],
        ))
        .unwrap();
        assert_eq!(image.texels[3], [0.75; 3]);
        let lone = exr(
            4,
            2,
            Compression::ZIP16,
            Blocks::ScanLines,
            vec![("Z", ramp(1.0))],
        );
        assert_eq!(fault(load(&lone)).code, "environment-format");
    }

    #[test]
    fn unusable_values_are_replaced_and_counted() {
        let values = vec![
            f32::NAN,
            f32::INFINITY,
            f32::NEG_INFINITY,
            -1.0,
            1e6,
            7e4,
            -0.0,
            3.0,
        ];
        let channels = vec![("Y", FlatSamples::F32(values))];
        let image = load(&exr(
            4,
            2,
            Compression::Uncompressed,
            Blocks::ScanLines,
            channels,
        ))
        .unwrap();
        let first: Vec<f32> = image.texels.iter().map(|texel| texel[0]).collect();
        assert_eq!(first, [0.0, 1e6, 0.0, 0.0, 1e6, 7e4, 0.0, 3.0]);
        let expected = ReplacedTexels {
            nan: 3,
            infinite: 3,
            negative: 6,
        };
        assert_eq!(image.replaced, expected);
        assert_eq!(codes(&image), ["environment-values"]);
    }

    #[test]
    fn odd_aspects_are_warned_of() {
        let bytes = exr(
            8,
            1,
            Compression::Uncompressed,
            Blocks::ScanLines,
            vec![("Y", ramp(1.0))],
        );
        assert_eq!(codes(&load(&bytes).unwrap()), ["environment-aspect"]);
    }

    #[test]
    fn cut_and_flipped_exr_files_never_panic() {
        let channels = || vec![("R", ramp(1.0)), ("G", ramp(2.0)), ("B", ramp(4.0))];
        for compression in [
            Compression::Uncompressed,
            Compression::ZIP16,
            Compression::PIZ,
        ] {
            let bytes = exr(4, 2, compression, Blocks::ScanLines, channels());
            for length in 0..bytes.len() {
                assert!(load(&bytes[..length]).is_err(), "{compression} {length}");
            }
            for position in 0..bytes.len() {
                for value in [0, 0x7f, 0xff] {
                    let mut bytes = bytes.clone();
                    bytes[position] = value;
                    if let Ok(image) = load(&bytes) {
                        assert!(image.texels.as_flattened().iter().all(|v| v.is_finite()));
                    }
                }
            }
        }
    }

    /// What people ship: 16 bits lose nothing where a compression keeps them, and little where it does not.
    #[test]
    fn every_compression_of_halves_and_floats_is_read() {
        let (width, height) = (70_usize, 35_usize);
        let value = |index: usize, channel: usize| {
            let (x, y) = ((index % width) as f32, (index / width) as f32);
            0.5 + 0.01 * x + 0.02 * y * (channel + 1) as f32
        };
        let samples = |channel: usize, half: bool| {
            let values = (0..width * height).map(move |index| value(index, channel));
            if half {
                FlatSamples::F16(values.map(f16::from_f32).collect())
            } else {
                FlatSamples::F32(values.collect())
            }
        };
        for (compression, lossy) in [
            (Compression::Uncompressed, 0.0),
            (Compression::RLE, 0.0),
            (Compression::ZIP1, 0.0),
            (Compression::ZIP16, 0.0),
            (Compression::PIZ, 0.0),
            (Compression::PXR24, 1e-4),
            (Compression::B44, 2e-2),
            (Compression::B44A, 2e-2),
            (Compression::DWAA(None), 2e-2),
            (Compression::DWAB(None), 2e-2),
        ] {
            for half in [false, true] {
                for blocks in [Blocks::ScanLines, Blocks::Tiles(Vec2(32, 16))] {
                    let channels = ["R", "G", "B"].into_iter().enumerate();
                    let channels = channels.map(|(at, name)| (name, samples(at, half)));
                    let bytes = exr(width, height, compression, blocks, channels.collect());
                    let image = load(&bytes).unwrap();
                    let bound = lossy + if half { 5e-4 } else { 0.0 };
                    for (index, texel) in image.texels.iter().enumerate() {
                        for (channel, found) in texel.iter().enumerate() {
                            let exact = value(index, channel);
                            assert!(
                                (found - exact).abs() <= bound * exact,
                                "{compression} half {half}: {found} {exact}"
                            );
                        }
                    }
                }
            }
        }
    }

    #[test]
    fn radiance_files_load_and_others_are_named() {
        let bytes = b"#?RADIANCE\nGAMMA=2.2\n\n-Y 1 +X 2\n\x80\x80\x80\x81\x80\x80\x80\x81";
        let image = load(bytes).unwrap();
        assert_eq!(image.texels, [[1.0; 3]; 2]);
        assert_eq!(codes(&image), ["environment-header"]);
        let error = fault(load(&bytes[..bytes.len() - 1]));
        assert_eq!(
            (error.code, error.place.as_str()),
            ("environment-broken", "byte 36")
        );
        let named = |bytes: &[u8]| fault(load(bytes)).message;
        assert!(named(b"version https://git-lfs.github.com/spec/v1\n").contains("git lfs pull"));
        assert!(named(b"\x89PNG\r\n\x1a\n").contains("PNG"));
        assert!(named(b"").contains("neither"));
    }
}
