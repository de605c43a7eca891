//! Recognises files that are not what their name says.

/// Names well-known content that is served in place of a wanted file, with its remedy.
pub(super) fn impostor(bytes: &[u8]) -> Option<&'static str> {
    let head = &bytes[..bytes.len().min(512)];
    let text = head.trim_ascii_start();
    let starts = |prefix: &[u8]| {
        text.get(..prefix.len())
            .is_some_and(|start| start.eq_ignore_ascii_case(prefix))
    };
    if starts(b"version https://git-lfs.github.com/spec/") {
        Some("this is a Git LFS pointer, not the file itself; run `git lfs pull` in its repository")
    } else if starts(b"<!doctype html") || starts(b"<html") {
        Some("this is an HTML page, probably a download error; download the file again")
    } else if starts(b"<?xml") {
        Some("this is an XML document, probably a download error; download the file again")
    } else if head.starts_with(b"PK\x03\x04") {
        Some("this is a ZIP archive; unpack it first")
    } else if head.starts_with(b"\x1f\x8b") {
        Some("this is a gzip file; decompress it first")
    } else {
        None
    }
}

/// Name of an image container by its magic bytes.
pub(super) fn image_format(bytes: &[u8]) -> Option<&'static str> {
    let at = |offset: usize, magic: &[u8]| {
        bytes
            .get(offset..)
            .is_some_and(|tail| tail.starts_with(magic))
    };
    let formats: [(usize, &[u8], &str); 11] = [
        (0, b"\x89PNG\r\n\x1a\n", "PNG"),
        (0, b"\xff\xd8\xff", "JPEG"),
        (8, b"WEBP", "WebP"),
        (0, b"\xabKTX 20\xbb\r\n\x1a\n", "KTX2"),
        (0, b"\xabKTX 11\xbb\r\n\x1a\n", "KTX"),
        (0, b"DDS ", "DDS"),
        (0, b"GIF8", "GIF"),
        (0, b"BM", "BMP"),
        (0, b"II*\0", "TIFF"),
        (0, b"MM\0*", "TIFF"),
        (4, b"ftypavif", "AVIF"),
    ];
    formats
        .into_iter()
        .find(|&(offset, magic, _)| at(offset, magic))
        .map(|(_, _, name)| name)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn impostors_are_named() {
        let lfs = b"version https://git-lfs.github.com/spec/v1\noid sha256:0\nsize 1\n";
        assert!(impostor(lfs).unwrap().contains("git lfs pull"));
        assert!(
            impostor(b"\n  <!DOCTYPE html><html>")
                .unwrap()
                .contains("HTML")
        );
        assert_eq!(impostor(b"{\"asset\":{}}"), None);
        assert_eq!(impostor(b""), None);
    }

    #[test]
    fn image_formats_are_told_by_magic() {
        assert_eq!(image_format(b"\x89PNG\r\n\x1a\n...."), Some("PNG"));
        assert_eq!(image_format(b"RIFF\0\0\0\0WEBPVP8 "), Some("WebP"));
        assert_eq!(image_format(b"\x89PN"), None);
    }
}
