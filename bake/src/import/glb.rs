//! Splits the binary glTF container (glTF 2.0 section 4.4).

use std::ops::Range;

/// Where the chunks of a `.glb` lie in the file.
#[derive(Debug, PartialEq, Eq)]
pub(super) struct Chunks {
    pub json: Range<usize>,
    pub bin: Option<Range<usize>>,
    /// Deviations that do not stop the reading.
    pub remarks: Vec<Fault>,
}

/// A fault at a byte offset.
#[derive(Debug, PartialEq, Eq)]
pub(super) struct Fault {
    pub offset: usize,
    pub message: String,
}

const HEADER: usize = 12;
const CHUNK_HEADER: usize = 8;
const JSON: [u8; 4] = *b"JSON";
const BIN: [u8; 4] = *b"BIN\0";
const AGAIN: &str = "copy or export the file again";

/// Whether the bytes claim to be a `.glb`.
pub(super) fn is_glb(bytes: &[u8]) -> bool {
    bytes.starts_with(b"glTF")
}

/// Locates the JSON and BIN chunks. Chunks of unknown types are skipped, as the specification asks.
///
/// # Errors
/// A truncated file, a wrong version, or chunks out of order.
pub(super) fn split(bytes: &[u8]) -> Result<Chunks, Fault> {
    let mut remarks = Vec::new();
    let end = header(bytes, &mut remarks)?;
    let (mut json, mut bin) = (None, None);
    let mut offset = HEADER;
    let mut ordinal = 0;
    while offset < end {
        let (kind, body) = chunk(bytes, offset, end)?;
        if body.len() % 4 != 0 {
            remarks.push(Fault {
                offset,
                message: "the chunk's length is not a multiple of four".into(),
            });
        }
        if ordinal == 0 && kind != JSON {
            return fault(offset, format!("the first chunk is not JSON; {AGAIN}"));
        }
        match kind {
            JSON if ordinal > 0 => return fault(offset, format!("a second JSON chunk; {AGAIN}")),
            JSON => json = Some(body.clone()),
            BIN if ordinal > 1 => {
                return fault(
                    offset,
                    format!("the BIN chunk is not the second one; {AGAIN}"),
                );
            }
            BIN => bin = Some(body.clone()),
            _ => {}
        }
        offset = body.end;
        ordinal += 1;
    }
    match json {
        Some(json) => Ok(Chunks { json, bin, remarks }),
        None => fault(offset, format!("the file has no chunks; {AGAIN}")),
    }
}

fn fault<T>(offset: usize, message: String) -> Result<T, Fault> {
    Err(Fault { offset, message })
}

fn word(bytes: &[u8], offset: usize) -> Option<u32> {
    let word = bytes.get(offset..)?.first_chunk::<4>()?;
    Some(u32::from_le_bytes(*word))
}

/// Checks the file header and returns the container's end.
fn header(bytes: &[u8], remarks: &mut Vec<Fault>) -> Result<usize, Fault> {
    let (Some(version), Some(length)) = (word(bytes, 4), word(bytes, 8)) else {
        return fault(
            bytes.len(),
            format!("the file ends inside its header; {AGAIN}"),
        );
    };
    if version != 2 {
        let message =
            format!("container version {version}, only 2 is supported; convert to glTF 2.0");
        return fault(4, message);
    }
    let length = length as usize;
    if length > bytes.len() {
        let message = format!(
            "the header promises {length} bytes but the file has {}; {AGAIN}",
            bytes.len()
        );
        return fault(8, message);
    }
    if length < bytes.len() {
        remarks.push(Fault {
            offset: length,
            message: format!(
                "{} bytes follow the container and are ignored",
                bytes.len() - length
            ),
        });
    }
    Ok(length)
}

/// The type and body of the chunk at `offset`.
fn chunk(bytes: &[u8], offset: usize, end: usize) -> Result<([u8; 4], Range<usize>), Fault> {
    let start = offset + CHUNK_HEADER;
    let head = bytes.get(offset..start.min(end)).unwrap_or_default();
    let (Some(length), Some(kind)) = (word(head, 0), head.get(4..).and_then(<[u8]>::first_chunk))
    else {
        return fault(
            offset,
            format!("the file ends inside a chunk header; {AGAIN}"),
        );
    };
    match start.checked_add(length as usize) {
        Some(stop) if stop <= end => Ok((*kind, start..stop)),
        _ => {
            let message = format!(
                "the chunk claims {length} bytes but {} are left; {AGAIN}",
                end.saturating_sub(start)
            );
            fault(offset, message)
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn glb(chunks: &[(&[u8; 4], &[u8])]) -> Vec<u8> {
        let body: Vec<u8> = chunks
            .iter()
            .flat_map(|(kind, data)| {
                [&(data.len() as u32).to_le_bytes()[..], &kind[..], data].concat()
            })
            .collect();
        let length = (HEADER + body.len()) as u32;
        [
            b"glTF",
            &2u32.to_le_bytes(),
            &length.to_le_bytes(),
            &body[..],
        ]
        .concat()
    }

    #[test]
    fn chunks_are_located() {
        let bytes = glb(&[(b"JSON", b"{}  "), (b"BIN\0", b"12345678")]);
        let chunks = split(&bytes).unwrap();
        assert_eq!(&bytes[chunks.json], b"{}  ");
        assert_eq!(&bytes[chunks.bin.unwrap()], b"12345678");
        assert!(chunks.remarks.is_empty());
    }

    #[test]
    fn a_missing_or_empty_bin_chunk_is_legal() {
        assert_eq!(split(&glb(&[(b"JSON", b"{}  ")])).unwrap().bin, None);
        let bytes = glb(&[(b"JSON", b"{}  "), (b"BIN\0", b"")]);
        assert!(split(&bytes).unwrap().bin.unwrap().is_empty());
    }

    #[test]
    fn unknown_chunks_are_skipped() {
        let bytes = glb(&[(b"JSON", b"{}  "), (b"BIN\0", b"1234"), (b"XXXX", b"abcd")]);
        assert_eq!(&bytes[split(&bytes).unwrap().bin.unwrap()], b"1234");
        assert!(split(&glb(&[(b"JSON", b"{}  "), (b"XXXX", b"abcd")])).is_ok());
    }

    #[test]
    fn chunk_order_is_enforced() {
        for chunks in [
            &[(b"BIN\0", &b"1234"[..]), (b"JSON", b"{}  ")][..],
            &[(b"JSON", b"{}  "), (b"JSON", b"{}  ")],
            &[(b"JSON", b"{}  "), (b"XXXX", b"1234"), (b"BIN\0", b"1234")],
            &[(b"JSON", b"{}  "), (b"BIN\0", b"1234"), (b"BIN\0", b"1234")],
            &[],
        ] {
            assert!(split(&glb(chunks)).is_err(), "{chunks:?}");
        }
    }

    #[test]
    fn truncation_at_every_byte_is_an_error() {
        let bytes = glb(&[(b"JSON", b"{}  "), (b"BIN\0", b"12345678")]);
        for length in 0..bytes.len() {
            assert!(split(&bytes[..length]).is_err(), "{length} bytes accepted");
        }
    }

    #[test]
    fn a_header_that_agrees_with_the_cut_is_still_checked() {
        let bytes = glb(&[(b"JSON", b"{}  "), (b"BIN\0", b"12345678")]);
        for length in 12..bytes.len() {
            let mut cut = bytes[..length].to_vec();
            cut[8..12].copy_from_slice(&(length as u32).to_le_bytes());
            // 24 is the end of the JSON chunk: a complete file without BIN.
            assert_eq!(split(&cut).is_ok(), length == 24, "{length}");
        }
    }

    #[test]
    fn hostile_lengths_do_not_overflow() {
        let mut bytes = glb(&[(b"JSON", b"{}  ")]);
        bytes[12..16].copy_from_slice(&u32::MAX.to_le_bytes());
        assert_eq!(split(&bytes).unwrap_err().offset, 12);
        for claimed in [0u32, 1, 11, 13, 19, u32::MAX] {
            let mut bytes = glb(&[(b"JSON", b"{}  ")]);
            bytes[8..12].copy_from_slice(&claimed.to_le_bytes());
            assert!(split(&bytes).is_err(), "{claimed}");
        }
    }

    #[test]
    fn trailing_bytes_are_remarked() {
        let mut bytes = glb(&[(b"JSON", b"{}  ")]);
        bytes.extend([0; 5]);
        assert_eq!(split(&bytes).unwrap().remarks[0].offset, 24);
    }
}
