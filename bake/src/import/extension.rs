//! Reads the extension objects that the typed JSON leaves free-form.

use serde::de::DeserializeOwned;
use serde_json::Value;

use crate::diagnostic::Result;

use super::context::Context;
use super::document;

/// The typed form of the extension object at `pointer`.
///
/// # Errors
/// A property that is missing or has the wrong type.
pub(super) fn parse<T: DeserializeOwned>(
    context: &Context,
    value: &Value,
    pointer: &str,
) -> Result<T> {
    let parsed = T::deserialize(value).or_else(|error| {
        let mut value = value.clone();
        match document::make_integral(&mut value) {
            true => T::deserialize(&value).map_err(|_| error),
            false => Err(error),
        }
    });
    parsed.map_err(|error| {
        let message = format!("{error}; correct the extension or export again");
        context.error("extension-schema", pointer, message)
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::import::testing::{context, fault};

    #[test]
    fn integers_may_be_written_as_floats() {
        let value = serde_json::json!([1.0, 2]);
        let parsed: Vec<usize> = parse(&context(""), &value, "/test").unwrap();
        assert_eq!(parsed, [1, 2]);
        for bad in [serde_json::json!([1.5]), serde_json::json!([-1])] {
            let error = fault(parse::<Vec<usize>>(&context(""), &bad, "/test"));
            assert_eq!(
                (error.code, error.place.as_str()),
                ("extension-schema", "/test")
            );
        }
    }
}
