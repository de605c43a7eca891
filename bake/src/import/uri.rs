//! Resolves the URIs of a glTF file to bytes or to paths below the scene's folder.

use base64::Engine as _;
use base64::alphabet::STANDARD;
use base64::engine::{DecodePaddingMode, GeneralPurpose, GeneralPurposeConfig};
use percent_encoding::percent_decode;

/// Padding is optional: exporters disagree about it.
const BASE64: GeneralPurpose = GeneralPurpose::new(
    &STANDARD,
    GeneralPurposeConfig::new().with_decode_padding_mode(DecodePaddingMode::Indifferent),
);

/// What a URI stands for.
#[derive(Debug, PartialEq, Eq)]
pub(super) enum Resource {
    /// The payload of a data URI.
    Data(Vec<u8>),
    /// A file below the scene's folder: `/`-separated, without `.` or `..`.
    File(String),
    /// A file elsewhere: `/`-separated, absolute or beginning with `..`.
    External(String),
}

/// A refused URI: stable code, then the reason with its remedy.
pub(super) type Refusal = (&'static str, String);

/// Resolves one URI (glTF 2.0 section 2.8; RFC 2397 and RFC 3986 in its subset).
///
/// # Errors
/// A remote or absolute location, a path that leaves the scene's folder, or undecodable text.
pub(super) fn resolve(uri: &str) -> Result<Resource, Refusal> {
    if uri
        .get(..5)
        .is_some_and(|scheme| scheme.eq_ignore_ascii_case("data:"))
    {
        return data(&uri[5..]).map(Resource::Data);
    }
    file(uri).map(Resource::File)
}

/// As [`resolve`], but absolute paths, `file:` URIs and paths that leave the scene's folder are files too.
///
/// # Errors
/// A remote location or undecodable text.
pub(super) fn resolve_external(uri: &str) -> Result<Resource, Refusal> {
    let refusal = match resolve(uri) {
        Ok(resource) => return Ok(resource),
        Err(refusal) => refusal,
    };
    let local = match uri.get(..5) {
        // RFC 8089: an empty authority or this host.
        Some(scheme) if scheme.eq_ignore_ascii_case("file:") => {
            let rest = &uri[5..];
            let path = rest.strip_prefix("//").unwrap_or(rest);
            path.strip_prefix("localhost").unwrap_or(path)
        }
        _ => uri,
    };
    if !matches!(refusal.0, "uri-absolute" | "uri-outside") && local.len() == uri.len() {
        return Err(refusal);
    }
    let path = decoded(local)?;
    Ok(Resource::External(match path.strip_prefix('/') {
        // `/C:/a.bin` is how a URI writes a drive.
        Some(drive) if scheme_of_drive(drive) => drive.to_owned(),
        _ => path,
    }))
}

/// Decodes what follows `data:`.
fn data(rest: &str) -> Result<Vec<u8>, Refusal> {
    let bad = |what: String| ("uri-data", format!("{what}; export the file again"));
    let Some((media_type, payload)) = rest.split_once(',') else {
        return Err(bad("the data URI has no comma before its payload".into()));
    };
    let decoded: Vec<u8> = percent_decode(payload.as_bytes()).collect();
    if !media_type.to_ascii_lowercase().ends_with(";base64") {
        return Ok(decoded);
    }
    let compact: Vec<u8> = decoded
        .into_iter()
        .filter(|byte| !byte.is_ascii_whitespace())
        .collect();
    BASE64.decode(compact).map_err(|error| {
        bad(format!(
            "the base64 payload of the data URI is broken: {error}"
        ))
    })
}

/// Turns a relative reference into a clean relative path.
fn file(uri: &str) -> Result<String, Refusal> {
    if let Some(scheme) = scheme(uri) {
        let remedy = if scheme.eq_ignore_ascii_case("file") {
            "refer to the file by a path relative to the scene, or trust the scene with --allow-external"
        } else {
            "download the file, put it beside the scene and refer to it by a relative path"
        };
        let message = format!("the URI scheme `{scheme}:` is not supported; {remedy}");
        return Err(("uri-scheme", message));
    }
    let path = decoded(uri)?;
    if path.starts_with('/') || scheme_of_drive(&path) {
        let remedy = "refer to the file by a path relative to the scene, pack a .glb, or trust the scene with \
                      --allow-external";
        return Err(("uri-absolute", format!("`{path}` is absolute; {remedy}")));
    }
    normalise(&path)
}

/// The text of a path behind its percent encoding.
fn decoded(uri: &str) -> Result<String, Refusal> {
    let Ok(path) = percent_decode(uri.as_bytes()).decode_utf8() else {
        let message = "the percent-decoded URI is not UTF-8; rename the file and export again";
        return Err(("uri-encoding", message.into()));
    };
    if path.contains('\0') {
        let message = "the URI contains a NUL character; rename the file and export again";
        return Err(("uri-encoding", message.into()));
    }
    // Some exporters on Windows write backslashes; they must not evade the checks of paths either.
    Ok(path.replace('\\', "/"))
}

/// Removes `.` and `..` without leaving the folder.
fn normalise(path: &str) -> Result<String, Refusal> {
    let mut parts: Vec<&str> = Vec::new();
    for part in path.split('/') {
        match part {
            "" | "." => {}
            ".." => {
                if parts.pop().is_none() {
                    let remedy = "move the file below that folder, pack everything into one .glb, or trust the scene \
                         with --allow-external";
                    let message = format!("`{path}` leaves the scene's folder; {remedy}");
                    return Err(("uri-outside", message));
                }
            }
            name => parts.push(name),
        }
    }
    if parts.is_empty() {
        return Err(("uri-empty", "the URI names no file; export again".into()));
    }
    Ok(parts.join("/"))
}

/// The URI scheme, where there is one of two letters or more (one letter is a Windows drive).
fn scheme(uri: &str) -> Option<&str> {
    let (head, _) = uri.split_once(':')?;
    let mut bytes = head.bytes();
    let valid = head.len() > 1
        && bytes.next()?.is_ascii_alphabetic()
        && bytes.all(|b| b.is_ascii_alphanumeric() || b"+.-".contains(&b));
    valid.then_some(head)
}

fn scheme_of_drive(path: &str) -> bool {
    let bytes = path.as_bytes();
    matches!(bytes, [letter, b':', ..] if letter.is_ascii_alphabetic())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn path(uri: &str) -> String {
        match resolve(uri) {
            Ok(Resource::File(path)) => path,
            other => panic!("{uri}: {other:?}"),
        }
    }

    fn code(uri: &str) -> &'static str {
        resolve(uri).expect_err(uri).0
    }

    #[test]
    fn relative_paths_are_decoded_and_cleaned() {
        assert_eq!(path("Box%20With%20Spaces.bin"), "Box With Spaces.bin");
        assert_eq!(path(" 2x2 image  has.png"), " 2x2 image  has.png");
        assert_eq!(path("./a/./b//c.png"), "a/b/c.png");
        assert_eq!(path("a/../b.png"), "b.png");
        assert_eq!(path("textures\\wood.png"), "textures/wood.png");
        assert_eq!(path("%E2%82%AC.png"), "\u{20ac}.png");
        assert_eq!(path("100%.png"), "100%.png");
    }

    #[test]
    fn what_leaves_the_folder_is_refused() {
        assert_eq!(code("../a.bin"), "uri-outside");
        assert_eq!(code("a/../../b.bin"), "uri-outside");
        assert_eq!(code("%2e%2e/a.bin"), "uri-outside");
        assert_eq!(code("..%2Fa.bin"), "uri-outside");
        assert_eq!(code("..\\a.bin"), "uri-outside");
        assert_eq!(code("/etc/passwd"), "uri-absolute");
        assert_eq!(code("%2Fetc/passwd"), "uri-absolute");
        assert_eq!(code("C:\\a.bin"), "uri-absolute");
        assert_eq!(code("\\\\server\\share"), "uri-absolute");
        assert_eq!(code("https://example.com/a.bin"), "uri-scheme");
        assert_eq!(code("file:///a.bin"), "uri-scheme");
        assert_eq!(code(""), "uri-empty");
        assert_eq!(code("./"), "uri-empty");
        assert_eq!(code("%ff.png"), "uri-encoding");
        assert_eq!(code("a%00.png"), "uri-encoding");
    }

    #[test]
    fn trusted_scenes_reach_other_folders() {
        let path = |uri: &str| match resolve_external(uri) {
            Ok(Resource::External(path)) => path,
            other => panic!("{uri}: {other:?}"),
        };
        assert_eq!(path("../a%20b.bin"), "../a b.bin");
        assert_eq!(path("a/../../b.bin"), "a/../../b.bin");
        assert_eq!(path("/srv/a.bin"), "/srv/a.bin");
        assert_eq!(path("C:\\a.bin"), "C:/a.bin");
        assert_eq!(path("file:///srv/a.bin"), "/srv/a.bin");
        assert_eq!(path("file:/srv/a.bin"), "/srv/a.bin");
        assert_eq!(path("file://localhost/C:/a.bin"), "C:/a.bin");
        assert_eq!(
            resolve_external("a/./b.bin"),
            Ok(Resource::File("a/b.bin".into()))
        );
        for (uri, code) in [
            ("https://example.com/a.bin", "uri-scheme"),
            ("", "uri-empty"),
            ("..%ff", "uri-encoding"),
            ("data:;base64", "uri-data"),
        ] {
            assert_eq!(
                resolve_external(uri).map_err(|refusal| refusal.0),
                Err(code),
                "{uri}"
            );
        }
    }

    #[test]
    fn data_uris_are_decoded() {
        let bytes = |uri: &str| match resolve(uri) {
            Ok(Resource::Data(bytes)) => bytes,
            other => panic!("{uri}: {other:?}"),
        };
        assert_eq!(
            bytes("data:application/octet-stream;base64,AAEC"),
            [0, 1, 2]
        );
        assert_eq!(bytes("data:;base64,AAE="), [0, 1]);
        assert_eq!(bytes("DATA:;base64,AAE"), [0, 1]);
        assert_eq!(bytes("data:;base64,AA%3D%3D"), [0]);
        assert_eq!(bytes("data:,a%20b"), b"a b");
        assert!(bytes("data:;base64,").is_empty());
        assert_eq!(code("data:;base64,A*=="), "uri-data");
        assert_eq!(code("data:;base64"), "uri-data");
    }
}
