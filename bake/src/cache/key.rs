//! What a product is made of, and the key that follows from it.

use std::fmt::{self, Debug};

use serde::{Deserialize, Serialize};

use super::fingerprint;

/// Changes when entries are laid out or keyed in another way.
const DOMAIN: &str = "cairn cache 1";

/// Kinds of products.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Kind {
    /// Which channels of an image are constant.
    ImageFacts,
    Texture,
    Geometry,
    EmissivePowers,
    Environment,
    BrdfTable,
    /// A whole bake; it has no entry.
    Package,
}

impl Kind {
    /// As messages and JSON have it.
    pub fn name(self) -> &'static str {
        match self {
            Self::ImageFacts => "image-facts",
            Self::Texture => "texture",
            Self::Geometry => "geometry",
            Self::EmissivePowers => "emissive-powers",
            Self::Environment => "environment",
            Self::BrdfTable => "brdf-table",
            Self::Package => "package",
        }
    }
}

/// BLAKE3 of everything that decides the bytes of a product.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Key(pub [u8; 32]);

impl fmt::Display for Key {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&blake3::Hash::from_bytes(self.0).to_hex())
    }
}

/// One thing that a product depends on.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Part {
    /// Such as `image` or `settings`.
    pub label: String,
    /// A hash of content, or the text of a setting.
    pub value: String,
}

/// Everything that a product depends on: contents, settings, code.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Inputs {
    pub kind: Kind,
    /// The object, as messages name it; it decides no bytes.
    pub name: String,
    pub parts: Vec<Part>,
}

/// How a hash of content is written in a [`Part`].
const CONTENT: &str = "blake3:";
/// Label of the hash of the code.
const CODE: &str = "code";

impl Inputs {
    /// A product made by the code of `module`, which is what `module_path!()` says there: a change of any file
    /// that this module can reach changes the key.
    pub fn new(kind: Kind, module: &str, name: impl Into<String>) -> Self {
        let mut inputs = Self {
            kind,
            name: name.into(),
            parts: Vec::new(),
        };
        inputs.push(CODE, fingerprint::of(module).to_owned());
        inputs
    }

    /// Settings by their `Debug` text, which holds all of their fields, and every bit of a finite number.
    pub fn settings(mut self, label: &str, settings: &dyn Debug) -> Self {
        self.push(label, format!("{settings:?}"));
        self
    }

    /// The content of a file, or of a part of one.
    pub fn content(self, label: &str, bytes: &[u8]) -> Self {
        self.hash(label, &content_hash(bytes))
    }

    /// Content whose hash is known.
    pub fn hash(mut self, label: &str, hash: &[u8; 32]) -> Self {
        let hex = blake3::Hash::from_bytes(*hash).to_hex();
        self.push(label, format!("{CONTENT}{hex}"));
        self
    }

    fn push(&mut self, label: &str, value: String) {
        self.parts.push(Part {
            label: label.to_owned(),
            value,
        });
    }

    /// The key.
    pub fn key(&self) -> Key {
        let mut hasher = blake3::Hasher::new();
        // Lengths in front keep neighbours apart.
        let mut text = |text: &str| {
            hasher.update(&(text.len() as u64).to_le_bytes());
            hasher.update(text.as_bytes());
        };
        text(DOMAIN);
        text(self.kind.name());
        for part in &self.parts {
            text(&part.label);
            text(&part.value);
        }
        Key(*hasher.finalize().as_bytes())
    }

    /// What differs from an earlier product of the same name.
    pub fn difference(&self, before: &Self) -> String {
        let old = |label: &str| before.parts.iter().find(|part| part.label == label);
        let mut changes: Vec<String> = self
            .parts
            .iter()
            .filter_map(|part| match old(&part.label) {
                Some(have) if have.value == part.value => None,
                Some(have) => Some(change(&part.label, &have.value, &part.value)),
                None => Some(format!("{} is new", part.label)),
            })
            .collect();
        let gone = before
            .parts
            .iter()
            .filter(|part| self.parts.iter().all(|have| have.label != part.label));
        changes.extend(gone.map(|part| format!("{} is gone", part.label)));
        changes.join("; ")
    }
}

/// BLAKE3, of large contents on all cores.
pub fn content_hash(bytes: &[u8]) -> [u8; 32] {
    let mut hasher = blake3::Hasher::new();
    if bytes.len() >= 1 << 20 {
        hasher.update_rayon(bytes);
    } else {
        hasher.update(bytes);
    }
    *hasher.finalize().as_bytes()
}

/// What tells this machine's processor from others, for products whose bytes depend on it.
pub fn processor() -> String {
    let text = std::fs::read_to_string("/proc/cpuinfo").unwrap_or_default();
    // Of the first core: vendor, model and instruction sets, but no clock, which changes all the time.
    let lines = text.lines().take_while(|line| !line.is_empty());
    let wanted = [
        "vendor_id",
        "cpu family",
        "model",
        "stepping",
        "flags",
        "Features",
    ];
    let lines = lines.filter(|line| wanted.iter().any(|name| line.starts_with(name)));
    std::iter::once(std::env::consts::ARCH)
        .chain(lines)
        .collect()
}

/// One changed part in words; of long settings only the fields that differ.
fn change(label: &str, before: &str, after: &str) -> String {
    if label == CODE {
        return "this program's code for it changed".into();
    }
    if before.starts_with(CONTENT) || after.starts_with(CONTENT) {
        return format!("{label} changed");
    }
    let (before, after) = (fields(before), fields(after));
    if before.len() != after.len() {
        return format!("{label} changed");
    }
    let pairs = before.iter().zip(&after);
    let differences: Vec<String> = pairs
        .filter(|(before, after)| before != after)
        .map(
            |(before, after)| match (before.split_once(": "), after.split_once(": ")) {
                (Some((name, old)), Some((same, new))) if name == same => {
                    format!("{name} {old} -> {new}")
                }
                _ => format!("{before} -> {after}"),
            },
        )
        .collect();
    format!("{label} changed: {}", differences.join(", "))
}

/// The fields of a `Debug` text, nested ones too.
fn fields(text: &str) -> Vec<&str> {
    text.split(['{', '}', ','])
        .map(str::trim)
        .filter(|field| !field.is_empty())
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[derive(Debug)]
    #[expect(dead_code, reason = "read by Debug alone")]
    struct Settings {
        quality: &'static str,
        error: f64,
    }

    fn inputs(name: &str, image: &[u8], quality: &'static str) -> Inputs {
        Inputs::new(Kind::Texture, module_path!(), name)
            .content("image", image)
            .settings(
                "settings",
                &Settings {
                    quality,
                    error: 0.002,
                },
            )
    }

    #[test]
    fn a_key_is_of_contents_and_settings_and_not_of_names() {
        let key = inputs("a", b"1", "best").key();
        assert_eq!(inputs("b", b"1", "best").key(), key);
        assert_ne!(inputs("a", b"2", "best").key(), key);
        assert_ne!(inputs("a", b"1", "fast").key(), key);
        let mut other = inputs("a", b"1", "best");
        other.kind = Kind::Geometry;
        assert_ne!(other.key(), key);
        assert_eq!(key.to_string().len(), 64);
    }

    #[test]
    fn neighbouring_parts_stay_apart() {
        let parts = |a: &str, b: &str| {
            let mut inputs = Inputs::new(Kind::Texture, module_path!(), "");
            inputs.push(a, b.into());
            inputs.key()
        };
        assert_ne!(parts("ab", "c"), parts("a", "bc"));
    }

    #[test]
    fn differences_name_what_changed() {
        let before = inputs("a", b"1", "best");
        assert_eq!(before.difference(&before), "");
        assert_eq!(
            inputs("a", b"2", "best").difference(&before),
            "image changed"
        );
        assert_eq!(
            inputs("a", b"1", "fast").difference(&before),
            "settings changed: quality \"best\" -> \"fast\""
        );
        let mut newer = before.clone();
        newer.parts[0].value = "other".into();
        newer.push("mask", "1".into());
        assert_eq!(
            newer.difference(&before),
            "this program's code for it changed; mask is new"
        );
        assert_eq!(
            before.difference(&newer),
            "this program's code for it changed; mask is gone"
        );
    }

    #[test]
    fn large_contents_have_the_hash_of_small_ones() {
        let bytes = vec![7; (1 << 20) + 3];
        assert_eq!(content_hash(&bytes), *blake3::hash(&bytes).as_bytes());
    }
}
