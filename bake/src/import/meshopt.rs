//! Decodes the buffer views of `EXT_meshopt_compression` and `KHR_meshopt_compression`.

use gltf::json;
use serde::Deserialize;
use serde_json::Value;

use crate::diagnostic::Result;

use super::context::Context;

/// The names of the extension; both have one layout, the ratified one adds the colour filter.
const NAMES: [&str; 2] = ["KHR_meshopt_compression", "EXT_meshopt_compression"];

/// The extension object of a buffer view.
#[derive(Debug, Deserialize)]
#[serde(rename_all = "camelCase")]
pub(super) struct Compressed {
    pub buffer: usize,
    #[serde(default)]
    pub byte_offset: u64,
    pub byte_length: u64,
    byte_stride: usize,
    count: usize,
    mode: String,
    #[serde(default = "no_filter")]
    filter: String,
}

fn no_filter() -> String {
    "NONE".into()
}

/// The extension of a view with its name, where the view has one.
pub(super) fn extension(view: &json::buffer::View) -> Option<(&'static str, &Value)> {
    let others = &view.extensions.as_ref()?.others;
    NAMES
        .into_iter()
        .find_map(|name| Some((name, others.get(name)?)))
}

/// Decompresses a view of `length` bytes.
///
/// # Errors
/// Parameters that the extension forbids, more data than the compressed bytes could describe,
/// a scene over its limit, or damaged data.
pub(super) fn decode(
    context: &Context,
    compressed: &Compressed,
    bytes: &[u8],
    length: u64,
    pointer: &str,
) -> Result<Vec<u8>> {
    let fault = |message: String| {
        let message = format!("{message}; export again");
        context.error("meshopt", pointer, message)
    };
    let codec = compressed.check().map_err(&fault)?;
    let (count, stride) = (compressed.count, compressed.byte_stride);
    let size = count.checked_mul(stride);
    let Some(size) = size.filter(|&size| size as u64 == length) else {
        return Err(fault(format!(
            "{count} elements of {stride} bytes do not fill the view of {length} bytes"
        )));
    };
    if size.div_ceil(codec.expansion()) > bytes.len() {
        return Err(fault(format!(
            "{} compressed bytes cannot describe {size} bytes",
            bytes.len()
        )));
    }
    context.charge_decoded(size as u64, pointer)?;
    let decoded = match codec {
        _ if count == 0 => Ok(Vec::new()),
        Codec::Attributes(filter) => attributes(bytes, count, stride).map(|mut words| {
            filter.apply(&mut words, stride);
            bytemuck::cast_slice(&words).to_vec()
        }),
        Codec::Triangles if stride == 2 => {
            meshopt::decode_index_buffer::<u16>(bytes, count).map(|v| little_endian(&v))
        }
        Codec::Triangles => {
            meshopt::decode_index_buffer::<u32>(bytes, count).map(|v| little_endian(&v))
        }
        Codec::Indices if stride == 2 => {
            meshopt::decode_index_sequence::<u16>(bytes, count).map(|v| little_endian(&v))
        }
        Codec::Indices => {
            meshopt::decode_index_sequence::<u32>(bytes, count).map(|v| little_endian(&v))
        }
    };
    decoded.map_err(|error| fault(format!("the compressed data is damaged ({error})")))
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Codec {
    Attributes(Filter),
    Triangles,
    Indices,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Filter {
    None,
    Octahedral,
    Quaternion,
    Exponential,
    Color,
}

impl Compressed {
    /// The codec, once the layout is one that the extension allows. The decoders themselves
    /// assert these rules.
    fn check(&self) -> std::result::Result<Codec, String> {
        let stride = self.byte_stride;
        let filter = match self.filter.as_str() {
            "NONE" => Filter::None,
            "OCTAHEDRAL" => Filter::Octahedral,
            "QUATERNION" => Filter::Quaternion,
            "EXPONENTIAL" => Filter::Exponential,
            "COLOR" => Filter::Color,
            other => return Err(format!("the filter `{other}` is not known")),
        };
        let codec = match self.mode.as_str() {
            "ATTRIBUTES" => Codec::Attributes(filter),
            "TRIANGLES" => Codec::Triangles,
            "INDICES" => Codec::Indices,
            other => return Err(format!("the mode `{other}` is not known")),
        };
        let fits = match codec {
            Codec::Attributes(filter) => {
                stride.is_multiple_of(4) && (4..=256).contains(&stride) && filter.accepts(stride)
            }
            _ => matches!(stride, 2 | 4) && filter == Filter::None,
        };
        if !fits {
            return Err(format!(
                "byteStride {stride} is not allowed for mode {} with filter {}",
                self.mode, self.filter
            ));
        }
        if codec == Codec::Triangles && !self.count.is_multiple_of(3) {
            return Err(format!(
                "{} indices are no whole number of triangles",
                self.count
            ));
        }
        Ok(codec)
    }
}

impl Codec {
    /// The most bytes that one compressed byte can stand for: a block of 256 constant vertices of
    /// four bytes takes one byte, a triangle takes at least one, and so does an index.
    fn expansion(self) -> usize {
        match self {
            Self::Attributes(_) => 1024,
            Self::Triangles => 12,
            Self::Indices => 4,
        }
    }
}

impl Filter {
    fn accepts(self, stride: usize) -> bool {
        match self {
            Self::None | Self::Exponential => true,
            Self::Octahedral | Self::Color => matches!(stride, 4 | 8),
            Self::Quaternion => stride == 8,
        }
    }

    fn apply(self, words: &mut [u32], stride: usize) {
        use bytemuck::cast_slice_mut;
        match (self, stride) {
            (Self::None, _) => {}
            (Self::Octahedral, 4) => {
                meshopt::decode_filter_oct::<i8>(cast_slice_mut::<u32, [i8; 4]>(words));
            }
            (Self::Octahedral, _) => {
                meshopt::decode_filter_oct::<i16>(cast_slice_mut::<u32, [i16; 4]>(words));
            }
            (Self::Color, 4) => {
                meshopt::decode_filter_color::<u8>(cast_slice_mut::<u32, [u8; 4]>(words));
            }
            (Self::Color, _) => {
                meshopt::decode_filter_color::<u16>(cast_slice_mut::<u32, [u16; 4]>(words));
            }
            (Self::Quaternion, _) => {
                meshopt::decode_filter_quat(cast_slice_mut::<u32, [i16; 4]>(words));
            }
            (Self::Exponential, _) => {
                meshopt::decode_filter_exp(cast_slice_mut::<u32, [u32; 1]>(words));
            }
        }
    }
}

/// The bytes of unsigned integers, as a buffer view stores them.
fn little_endian<T: bytemuck::Pod>(values: &[T]) -> Vec<u8> {
    bytemuck::cast_slice(values).to_vec()
}

/// An element of `4 * WORDS` bytes, whose size the decoder takes from the type.
#[derive(Clone, Copy)]
struct Element<const WORDS: usize>([u32; WORDS]);

impl<const WORDS: usize> Default for Element<WORDS> {
    fn default() -> Self {
        Self([0; WORDS])
    }
}

fn words<const WORDS: usize>(bytes: &[u8], count: usize) -> meshopt::Result<Vec<u32>> {
    let elements: Vec<Element<WORDS>> = meshopt::decode_vertex_buffer(bytes, count)?;
    let mut words = Vec::with_capacity(WORDS * count);
    for element in &elements {
        words.extend_from_slice(&element.0);
    }
    Ok(words)
}

/// Decodes `count` elements of `stride` bytes, a multiple of four up to 256.
fn attributes(bytes: &[u8], count: usize, stride: usize) -> meshopt::Result<Vec<u32>> {
    macro_rules! by_size {
        ($($size:literal)+) => {
            match stride / 4 {
                $($size => words::<$size>(bytes, count),)+
                size => unreachable!("elements of {size} words were refused"),
            }
        };
    }
    by_size!(
        1 2 3 4 5 6 7 8 9 10 11 12 13 14 15 16 17 18 19 20 21 22 23 24 25 26 27 28 29 30 31 32
        33 34 35 36 37 38 39 40 41 42 43 44 45 46 47 48 49 50 51 52 53 54 55 56 57 58 59 60 61 62
        63 64
    )
}

#[cfg(test)]
mod tests;
