//! The schema hash: two programs that disagree about any layout refuse each other's packages.

use crate::gpu::records;
use crate::section::SectionKind;

/// Text of every GPU record, section and root type, whitespace removed.
pub fn schema_text() -> String {
    let mut text = String::new();
    for (name, size, fields) in records() {
        text.push_str(&format!("{name}={size}["));
        for field in fields {
            text.push_str(&format!(
                "{}:{}*{}@{};",
                field.name, field.glsl, field.count, field.offset
            ));
        }
        text.push(']');
    }
    for kind in SectionKind::ALL {
        text.push_str(&format!(
            "{}#{}x{};",
            kind.name(),
            kind as u32,
            kind.stride()
        ));
    }
    text.push_str(&crate::scene::schema_text());
    text.retain(|character| !character.is_whitespace());
    text
}

/// First eight bytes of the BLAKE3 of [`schema_text`].
pub fn schema_hash() -> u64 {
    static HASH: std::sync::OnceLock<u64> = std::sync::OnceLock::new();
    *HASH.get_or_init(|| {
        let hash = blake3::hash(schema_text().as_bytes());
        let mut first = [0; 8];
        first.copy_from_slice(&hash.as_bytes()[..8]);
        u64::from_le_bytes(first)
    })
}
