//! Resolves buffers and buffer views to bytes.

use crate::diagnostic::Result;

use super::context::Context;

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
            let message = "the buffer has neither a URI nor a BIN chunk; export again \
                           (buffers of compression extensions are not supported)";
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
    let buffer = buffer(context, view.buffer.value(), &format!("{pointer}/buffer"))?;
    let offset = view.byte_offset.map_or(0, |offset| offset.0);
    let range = offset
        .checked_add(view.byte_length.0)
        .and_then(|end| Some(usize::try_from(offset).ok()?..usize::try_from(end).ok()?));
    let Some(bytes) = range.and_then(|range| buffer.get(range)) else {
        let message = format!(
            "{} bytes at offset {offset} leave the buffer of {} bytes; export again",
            view.byte_length.0,
            buffer.len()
        );
        return Err(context.error("buffer-view-out-of-range", pointer, message));
    };
    let stride = view.byte_stride.map(|stride| stride.0);
    if let Some(stride) = stride.filter(|stride| !(4..=252).contains(stride)) {
        let message = format!("byteStride {stride} is not within 4 to 252; export again");
        return Err(context.error("buffer-view-stride", pointer, message));
    }
    Ok(View { bytes, stride })
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
