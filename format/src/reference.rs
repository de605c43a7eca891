//! Emits the tables of `docs/format.md` from the declarations that the reader is compiled from.

use std::fmt::Write;

use crate::c_header::table_records;
use crate::features;
use crate::gpu::{CONSTANTS, FileType, RecordLayout};
use crate::header::{Header, SectionEntry};
use crate::scene::layouts;
use crate::section::SectionKind;
use crate::texture::TextureFormat;

/// Name and text of every generated block.
pub fn blocks() -> Vec<(&'static str, String)> {
    vec![
        ("header", file_type(&Header::LAYOUT)),
        ("section-entry", file_type(&SectionEntry::LAYOUT)),
        ("sections", sections()),
        ("records", records()),
        ("constants", constants()),
        (
            "root",
            layouts()
                .iter()
                .map(file_type)
                .collect::<Vec<_>>()
                .join("\n"),
        ),
        ("formats", formats()),
        ("features", feature_bits()),
    ]
}

/// Bytes as rows of offset, hexadecimal digits and characters; rows of zeros between others are left out.
pub fn hexdump(bytes: &[u8]) -> String {
    let mut out = String::new();
    let mut skipped = false;
    for (row, chunk) in bytes.chunks(16).enumerate() {
        let last = (row + 1) * 16 >= bytes.len();
        if row > 0 && !last && chunk.iter().all(|byte| *byte == 0) {
            if !skipped {
                out.push_str("*\n");
            }
            skipped = true;
            continue;
        }
        skipped = false;
        let digits: Vec<String> = chunk.iter().map(|byte| format!("{byte:02x}")).collect();
        let characters = chunk.iter().map(|byte| match byte {
            0x20..=0x7e => *byte as char,
            _ => '.',
        });
        let characters: String = characters.collect();
        let _ = writeln!(
            out,
            "{:08x}  {:<47}  |{characters}|",
            row * 16,
            digits.join(" ")
        );
    }
    out
}

/// A text in a cell: no line breaks, no links of rustdoc.
fn cell(doc: &str) -> String {
    let mut text = String::new();
    let mut rest = doc.trim();
    // `[`name`](path)` and `[`name`]` become `name`.
    while let Some(start) = rest.find("[`") {
        text += &rest[..start];
        let Some(end) = rest[start..].find("`]").map(|end| start + end) else {
            break;
        };
        let name = rest[start + 2..end].rsplit("::").next().unwrap_or_default();
        text += &format!("`{name}`");
        rest = &rest[end + 2..];
        if let Some(after) = rest.strip_prefix('(').and_then(|link| link.split_once(')')) {
            rest = after.1;
        }
    }
    text += rest;
    text.replace('|', "\\|")
}

fn table(out: &mut String, head: &str, rows: impl Iterator<Item = String>) {
    let columns = head.matches('|').count() + 1;
    let _ = writeln!(out, "| {head} |\n|{}", "---|".repeat(columns));
    for row in rows {
        let _ = writeln!(out, "| {row} |");
    }
}

fn file_type(layout: &FileType) -> String {
    let mut out = format!(
        "**{}**, {} bytes. {}\n\n",
        layout.name,
        layout.bytes,
        cell(layout.doc)
    );
    if layout.variants.is_empty() {
        let rows = layout.fields.iter().map(|field| {
            let ty = field.ty.replace('\n', " ");
            format!(
                "{} | {} | `{ty}` | `{}` | {}",
                field.offset,
                field.bytes,
                field.name,
                cell(field.doc)
            )
        });
        table(&mut out, "offset | bytes | type | name | content", rows);
    } else {
        let rows = layout.variants.iter();
        let rows = rows.map(|(name, value, doc)| format!("{value} | `{name}` | {}", cell(doc)));
        table(&mut out, "value | name | meaning", rows);
    }
    out
}

fn sections() -> String {
    let mut out = String::new();
    let rows = SectionKind::ALL.into_iter().map(|kind| {
        let record = match (kind.record(), kind) {
            (Some(layout), _) => format!("`{}`", layout.name),
            (None, SectionKind::Texels) => "bytes".into(),
            (None, SectionKind::InstanceBounds | SectionKind::ClusterBounds) => "`f32`".into(),
            (None, SectionKind::EnvAlias) => "words: `EnvAliasHeader`, then `EnvAliasEntry`".into(),
            (None, SectionKind::EmissiveAlias) => {
                "words: `EmissiveAliasHeader`, then `EmissiveAliasEntry`".into()
            }
            (None, _) => "`u32`".into(),
        };
        format!(
            "{} | `{}` | {} | {record}",
            kind as u32,
            kind.name(),
            kind.stride()
        )
    });
    table(&mut out, "kind | name | stride | records", rows);
    out
}

fn records() -> String {
    let kinds = SectionKind::ALL.into_iter().filter_map(SectionKind::record);
    let all = kinds.chain(table_records());
    all.map(|layout| record(&layout))
        .collect::<Vec<_>>()
        .join("\n")
}

fn record(layout: &RecordLayout) -> String {
    let doc = cell(layout.doc);
    let mut out = format!("**{}**, {} bytes. {doc}\n\n", layout.name, layout.bytes);
    let rows = layout.fields.iter().map(|field| {
        let count = if field.count > 0 {
            format!("[{}]", field.count)
        } else {
            String::new()
        };
        format!(
            "{} | {} | `{}{count}` | `{}` | {}",
            field.offset,
            field.bytes(),
            field.glsl,
            field.name,
            cell(field.doc)
        )
    });
    table(&mut out, "offset | bytes | type | name | content", rows);
    out
}

fn constants() -> String {
    let mut out = String::new();
    let rows = CONSTANTS
        .iter()
        .map(|(name, value)| format!("`{name}` | 0x{value:x}"));
    table(&mut out, "name | value", rows);
    out
}

fn formats() -> String {
    let mut out = String::new();
    let rows = TextureFormat::ALL.into_iter().map(|format| {
        let (edge, bytes) = (format.block_extent(), format.block_bytes());
        let curve = if format.is_srgb() { "sRGB" } else { "linear" };
        format!(
            "{} | `{format:?}` | {edge} x {edge} | {bytes} | {curve}",
            format as u8
        )
    });
    table(
        &mut out,
        "value | name | texels of a block | bytes of a block | colour",
        rows,
    );
    out
}

fn feature_bits() -> String {
    let mut out = String::new();
    let rows = features::NAMES
        .iter()
        .map(|(bit, name)| format!("{} | `{name}`", bit.trailing_zeros()));
    table(&mut out, "bit | name", rows);
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cells_have_no_links() {
        let doc =
            " Bits of [`Material::double_sided`]; [`NO_EMISSION`](crate::gpu::NO_EMISSION) | none.";
        assert_eq!(cell(doc), "Bits of `double_sided`; `NO_EMISSION` \\| none.");
        assert_eq!(cell("plain [x]"), "plain [x]");
    }

    #[test]
    fn zeros_are_left_out_of_dumps() {
        let mut bytes = vec![0; 80];
        bytes[..3].copy_from_slice(b"abc");
        let dump = hexdump(&bytes);
        assert_eq!(dump.lines().count(), 3, "{dump}");
        assert!(
            dump.starts_with("00000000  61 62 63 00") && dump.contains("\n*\n00000040  00"),
            "{dump}"
        );
    }
}
