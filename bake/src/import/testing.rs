//! Builds small glTF scenes in memory for the tests of import.

use std::path::PathBuf;

use crate::diagnostic::{BakeError, Diagnostic, Result};

use super::context::{Context, describe};

/// A context for JSON text; `{asset}` is added, `{data:BASE64}` style URIs are the caller's.
pub(super) fn context(body: &str) -> Context {
    try_context(body).unwrap_or_else(|error| panic!("{error}"))
}

pub(super) fn try_context(body: &str) -> Result<Context> {
    let text = format!(
        r#"{{"asset":{{"version":"2.0"}}{}{body}}}"#,
        if body.is_empty() { "" } else { "," }
    );
    let bytes = text.into_bytes();
    let source = describe("test.gltf".into(), &bytes);
    Context::parse(
        "test.gltf".into(),
        PathBuf::from("/nonexistent"),
        bytes,
        source,
    )
}

/// A data URI of bytes.
pub(super) fn data_uri(bytes: &[u8]) -> String {
    use base64::Engine as _;
    let text = base64::engine::general_purpose::STANDARD.encode(bytes);
    format!("data:application/octet-stream;base64,{text}")
}

/// The diagnostic of an expected input error.
pub(super) fn fault<T>(result: Result<T>) -> Diagnostic {
    match result {
        Err(BakeError::Input(diagnostic)) => diagnostic,
        Err(other) => panic!("{other}"),
        Ok(_) => panic!("no error"),
    }
}
