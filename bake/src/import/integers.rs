//! Finds integers that the typed JSON would silently cut to 32 bits.

use std::fmt;

use serde::de::{DeserializeSeed, Deserializer, MapAccess, SeqAccess, Visitor};

/// Properties that are 64-bit in the typed JSON.
const WIDE: [&str; 4] = ["count", "byteOffset", "byteLength", "byteStride"];

/// JSON pointer and value of the first integer above `u32::MAX` that stands for an index or an
/// enumerator, if any. Free-form parts (`extras`, extensions that are not read) are not searched.
///
/// # Errors
/// Those of the JSON syntax.
pub(super) fn find_oversized(json: &[u8]) -> serde_json::Result<Option<(String, u64)>> {
    let mut search = Search::default();
    let mut deserializer = serde_json::Deserializer::from_slice(json);
    Walk(&mut search).deserialize(&mut deserializer)?;
    deserializer.end()?;
    Ok(search.found)
}

#[derive(Default)]
struct Search {
    path: Vec<String>,
    found: Option<(String, u64)>,
}

impl Search {
    fn free_form(&self) -> bool {
        self.path.iter().enumerate().any(|(depth, name)| {
            name == "extras"
                || name == "extensions"
                    && self
                        .path
                        .get(depth + 1)
                        .is_some_and(|extension| extension != "KHR_lights_punctual")
        })
    }

    fn visit(&mut self, value: u64) {
        let wide = self
            .path
            .last()
            .is_some_and(|name| WIDE.contains(&name.as_str()));
        if value > u64::from(u32::MAX) && self.found.is_none() && !wide && !self.free_form() {
            let pointer = self.path.iter().map(|part| format!("/{part}")).collect();
            self.found = Some((pointer, value));
        }
    }
}

struct Walk<'a>(&'a mut Search);

impl<'de> DeserializeSeed<'de> for Walk<'_> {
    type Value = ();

    fn deserialize<D: Deserializer<'de>>(self, deserializer: D) -> Result<(), D::Error> {
        deserializer.deserialize_any(self)
    }
}

impl<'de> Visitor<'de> for Walk<'_> {
    type Value = ();

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("any JSON value")
    }

    fn visit_u64<E>(self, value: u64) -> Result<(), E> {
        self.0.visit(value);
        Ok(())
    }

    fn visit_i64<E>(self, _: i64) -> Result<(), E> {
        Ok(())
    }

    fn visit_f64<E>(self, _: f64) -> Result<(), E> {
        Ok(())
    }

    fn visit_bool<E>(self, _: bool) -> Result<(), E> {
        Ok(())
    }

    fn visit_str<E>(self, _: &str) -> Result<(), E> {
        Ok(())
    }

    fn visit_unit<E>(self) -> Result<(), E> {
        Ok(())
    }

    fn visit_seq<A: SeqAccess<'de>>(self, mut seq: A) -> Result<(), A::Error> {
        for index in 0u64.. {
            self.0.path.push(index.to_string());
            let element = seq.next_element_seed(Walk(self.0))?;
            self.0.path.pop();
            if element.is_none() {
                break;
            }
        }
        Ok(())
    }

    fn visit_map<A: MapAccess<'de>>(self, mut map: A) -> Result<(), A::Error> {
        while let Some(key) = map.next_key::<String>()? {
            self.0.path.push(key);
            map.next_value_seed(Walk(self.0))?;
            self.0.path.pop();
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn find(json: &str) -> Option<(String, u64)> {
        find_oversized(json.as_bytes()).unwrap()
    }

    #[test]
    fn oversized_indices_are_found() {
        let json = r#"{"textures":[{},{"source":4294967296}]}"#;
        assert_eq!(find(json), Some(("/textures/1/source".into(), 1 << 32)));
        let json = r#"{"nodes":[{"extensions":{"KHR_lights_punctual":{"light":4294967297}}}]}"#;
        assert!(find(json).is_some());
    }

    #[test]
    fn wide_and_free_form_numbers_are_left_alone() {
        assert_eq!(
            find(r#"{"accessors":[{"count":18446744073709551615}]}"#),
            None
        );
        assert_eq!(find(r#"{"extras":{"id":[4294967296]}}"#), None);
        assert_eq!(find(r#"{"extensions":{"EXT_x":{"id":4294967296}}}"#), None);
        assert_eq!(
            find(r#"{"scene":4294967295,"x":[-1,1.5,true,null,"s"]}"#),
            None
        );
    }

    #[test]
    fn depth_is_bounded() {
        let json = "[".repeat(100_000);
        assert!(find_oversized(json.as_bytes()).is_err());
    }
}
