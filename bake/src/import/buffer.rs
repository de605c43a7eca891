//! Resolves buffers and buffer views to bytes.

use gltf::json;

use crate::diagnostic::Result;

use super::context::Context;
use super::{extension, meshopt};

/// The bytes of a buffer view.
#[derive(Clone, Copy, Debug)]
pub(super) struct View<'a> {
    pub bytes: &'a [u8],
    /// `byteStride`, where given.
    pub stride: Option<usize>,
}

/// The bytes of a buffer, cut to its `byteLength`; read on first use.
fn buffer<'a>(context: &'a Context, index: usize, referrer: &str) -> Result<&'a [u8]> {
    let buffers = &context.document.buffers;
    let (Some(buffer), Some(cell)) = (buffers.get(index), context.buffers.get(index)) else {
        return Err(context.absent(referrer, "buffer", index, buffers.len()));
    };
    let pointer = format!("/buffers/{index}");
    let bytes: &[u8] = match (&buffer.uri, context.bin()) {
        (None, Some(bin)) if index == 0 => bin,
        (None, _) => {
            let message = "the buffer has neither a URI nor a BIN chunk; export again";
            return Err(context.error("buffer-without-data", pointer, message));
        }
        (Some(uri), _) => match cell.get() {
            Some(bytes) => bytes,
            None => {
                let bytes = context.resource(uri, &format!("{pointer}/uri"))?;
                cell.get_or_init(|| bytes)
            }
        },
    };
    let length = usize::try_from(buffer.byte_length.0).ok();
    length.and_then(|length| bytes.get(..length)).ok_or_else(|| {
        let message = format!(
            "byteLength is {} but only {} bytes are there; the file is cut or was exported wrongly",
            buffer.byte_length.0,
            bytes.len()
        );
        context.error("buffer-too-short", pointer, message)
    })
}

/// The bytes of buffer view `index`, which the element at `referrer` names.
///
/// # Errors
/// An index or a range that does not exist, a bad stride, or an unreadable buffer.
pub(super) fn view<'a>(context: &'a Context, index: usize, referrer: &str) -> Result<View<'a>> {
    let views = &context.document.buffer_views;
    let Some(view) = views.get(index) else {
        return Err(context.absent(referrer, "bufferView", index, views.len()));
    };
    let pointer = format!("/bufferViews/{index}");
    let bytes = match meshopt::extension(view) {
        Some(found) => decompressed(context, index, view, found, &pointer)?,
        None => {
            let offset = view.byte_offset.map_or(0, |offset| offset.0);
            let length = view.byte_length.0;
            range(context, view.buffer.value(), offset, length, &pointer)?
        }
    };
    let stride = view.byte_stride.map(|stride| stride.0);
    if let Some(stride) = stride.filter(|stride| !(4..=252).contains(stride)) {
        let message = format!("byteStride {stride} is not within 4 to 252; export again");
        return Err(context.error("buffer-view-stride", pointer, message));
    }
    Ok(View { bytes, stride })
}

/// `length` bytes of a buffer, which the object at `pointer` names.
fn range<'a>(
    context: &'a Context,
    index: usize,
    offset: u64,
    length: u64,
    pointer: &str,
) -> Result<&'a [u8]> {
    let buffer = buffer(context, index, &format!("{pointer}/buffer"))?;
    let range = offset
        .checked_add(length)
        .and_then(|end| Some(usize::try_from(offset).ok()?..usize::try_from(end).ok()?));
    range.and_then(|range| buffer.get(range)).ok_or_else(|| {
        let message = format!(
            "{length} bytes at offset {offset} leave the buffer of {} bytes; export again",
            buffer.len()
        );
        context.error("buffer-view-out-of-range", pointer, message)
    })
}

/// The content of a compressed view, decoded on first use. The view's own buffer is a fallback
/// that need not have data.
fn decompressed<'a>(
    context: &'a Context,
    index: usize,
    view: &json::buffer::View,
    (name, value): (&str, &serde_json::Value),
    pointer: &str,
) -> Result<&'a [u8]> {
    let cell = &context.views[index];
    if let Some(bytes) = cell.get() {
        return Ok(bytes);
    }
    let pointer = format!("{pointer}/extensions/{name}");
    let compressed: meshopt::Compressed = extension::parse(context, value, &pointer)?;
    let (offset, length) = (compressed.byte_offset, compressed.byte_length);
    let bytes = range(context, compressed.buffer, offset, length, &pointer)?;
    let bytes = meshopt::decode(context, &compressed, bytes, view.byte_length.0, &pointer)?;
    Ok(cell.get_or_init(|| bytes))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::import::testing::{context, data_uri, fault};

    #[test]
    fn missing_and_short_buffers_are_refused() {
        let view_of = |buffers: &str| {
            let views = r#""bufferViews":[{"buffer":0,"byteLength":4}]"#;
            let context = context(&format!("{views},\"buffers\":[{buffers}]"));
            fault(view(&context, 0, "/test").map(|view| view.bytes.len()))
        };
        assert_eq!(view_of("").code, "index-out-of-range");
        assert_eq!(view_of(r#"{"byteLength":4}"#).code, "buffer-without-data");
        let short = format!(r#"{{"byteLength":5,"uri":"{}"}}"#, data_uri(&[0; 4]));
        assert_eq!(view_of(&short).code, "buffer-too-short");
        let huge = format!(
            r#"{{"byteLength":{},"uri":"{}"}}"#,
            u64::MAX,
            data_uri(&[0; 4])
        );
        assert_eq!(view_of(&huge).code, "buffer-too-short");
        let missing = view_of(r#"{"byteLength":4,"uri":"no%20such.bin"}"#);
        assert_eq!(
            (missing.code, missing.place.as_str()),
            ("file-missing", "/buffers/0/uri")
        );
        assert!(missing.message.contains("no such.bin"));
        assert_eq!(
            view_of(r#"{"byteLength":4,"uri":"../a.bin"}"#).code,
            "uri-outside"
        );
    }

    #[test]
    fn bytes_beyond_the_declared_length_are_out_of_reach() {
        let uri = data_uri(&[0; 8]);
        let context = context(&format!(
            r#""bufferViews":[{{"buffer":0,"byteLength":8}}],"buffers":[{{"byteLength":4,"uri":"{uri}"}}]"#
        ));
        let error = fault(view(&context, 0, "/test").map(|view| view.bytes.len()));
        assert_eq!(error.code, "buffer-view-out-of-range");
    }
}
