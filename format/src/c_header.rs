//! Emits `include/cairn.h`, the C view of a package: head, section table, root and records.

use std::fmt::Write;

use crate::features;
use crate::gpu::{
    CONSTANTS, EmissiveAliasEntry, EmissiveAliasHeader, EnvAliasEntry, EnvAliasHeader, FileField,
    FileType, RecordLayout,
};
use crate::header::{ALIGNMENT, FORMAT_VERSION, Header, PAGE, SectionEntry};
use crate::section::SectionKind;
use crate::texture::TextureFormat;

const INTRO: &str = "/* cairn.h: the layout of a Cairn package, for C11 and C++11. Generated from cairn-format's records;\n \
    * `UPDATE_GOLDEN=1 cargo test -p cairn-format --test reference` writes it anew. Described in docs/format.md.\n \
    * Everything is little-endian. Nothing here checks a file: offsets, lengths and hashes are the reader's duty. */\n\
    #ifndef CAIRN_H\n#define CAIRN_H\n\n#include <stddef.h>\n#include <stdint.h>\n\n\
    #ifdef __cplusplus\n#define CAIRN_ASSERT(condition) static_assert(condition, #condition)\n#else\n\
    #define CAIRN_ASSERT(condition) _Static_assert(condition, #condition)\n#endif\n\n";

const HELPERS: &str = r"/* A list: `offset` bytes from the place of this field lie `length` elements. */
typedef struct CairnList {
    int64_t offset;
    uint64_t length;
} CairnList;
CAIRN_ASSERT(sizeof(CairnList) == 16);

/* A text in UTF-8: read with cairn_text. */
typedef union CairnString {
    uint8_t bytes[16];
    struct {
        uint64_t length;
        int64_t offset;
    } outside;
} CairnString;
CAIRN_ASSERT(sizeof(CairnString) == 16);

/* First element of a list. */
static inline const void *cairn_items(const CairnList *list) {
    return (const char *)list + list->offset;
}

/* Bytes of a text, and their number; they do not end with zero. Up to 16 bytes lie in the field itself, the rest of it
 * filled with 0xff; the first byte of a longer one, which no text begins with, has the form 10xxxxxx. */
static inline const char *cairn_text(const CairnString *text, size_t *length) {
    const uint64_t stored = text->outside.length;
    if ((text->bytes[0] & 0xc0) != 0x80) {
        *length = 0;
        while (*length < 16 && text->bytes[*length] != 0xff) {
            *length += 1;
        }
        return (const char *)text->bytes;
    }
    *length = (size_t)((stored & 0x3f) | (stored & ~(uint64_t)0xff) >> 2);
    return (const char *)text + text->outside.offset;
}

";

const ROOT: &str = r"/* The root: the last bytes of its part of the file. */
static inline const CairnScene *cairn_root(const void *file) {
    const CairnHeader *header = (const CairnHeader *)file;
    return (const CairnScene *)((const char *)file + header->root_offset + header->root_length - sizeof(CairnScene));
}

/* Row of a section, or a null pointer where it is absent. */
static inline const CairnSectionEntry *cairn_section(const void *file, uint32_t kind) {
    const CairnHeader *header = (const CairnHeader *)file;
    const CairnSectionEntry *table = (const CairnSectionEntry *)((const char *)file + sizeof(CairnHeader));
    uint32_t row;
    for (row = 0; row < header->section_count; row += 1) {
        if (table[row].kind == kind) {
            return &table[row];
        }
    }
    return NULL;
}

#endif
";

/// The whole text of `include/cairn.h`.
pub fn cairn_h() -> String {
    let mut out = String::from(INTRO);
    constants(&mut out).unwrap_or_default();
    for layout in [Header::LAYOUT, SectionEntry::LAYOUT] {
        file_type(&mut out, &layout).unwrap_or_default();
    }
    out.push_str("/* Records of the sections. */\n\n");
    for kind in SectionKind::ALL {
        if let Some(layout) = kind.record() {
            record(&mut out, &layout).unwrap_or_default();
        }
    }
    for layout in table_records() {
        record(&mut out, &layout).unwrap_or_default();
    }
    out.push_str("/* The root. */\n\n");
    out.push_str(HELPERS);
    for layout in in_order() {
        file_type(&mut out, &layout).unwrap_or_default();
    }
    out + ROOT
}

/// Records of the sections that are words: header and entries of the alias tables.
pub fn table_records() -> [RecordLayout; 4] {
    [
        RecordLayout::of::<EnvAliasHeader>(),
        RecordLayout::of::<EnvAliasEntry>(),
        RecordLayout::of::<EmissiveAliasHeader>(),
        RecordLayout::of::<EmissiveAliasEntry>(),
    ]
}

/// Name of a constant: `PunctualLights` is `PUNCTUAL_LIGHTS`.
fn screaming(name: &str) -> String {
    let mut out = String::new();
    for (index, letter) in name.char_indices() {
        if letter == '-' {
            out.push('_');
            continue;
        }
        if letter.is_ascii_uppercase() && index > 0 {
            out.push('_');
        }
        out.push(letter.to_ascii_uppercase());
    }
    out
}

fn constants(out: &mut String) -> std::fmt::Result {
    writeln!(out, "#define CAIRN_MAGIC \"CAIRN\\r\\n\\x1a\"")?;
    writeln!(out, "#define CAIRN_VERSION {FORMAT_VERSION}u")?;
    writeln!(
        out,
        "#define CAIRN_SCHEMA_HASH 0x{:016x}u",
        crate::schema::schema_hash()
    )?;
    writeln!(
        out,
        "#define CAIRN_PAGE {PAGE}u\n#define CAIRN_ALIGNMENT {ALIGNMENT}u\n"
    )?;
    for kind in SectionKind::ALL {
        writeln!(
            out,
            "#define CAIRN_SECTION_{} {}u",
            screaming(kind.name()),
            kind as u32
        )?;
    }
    out.push('\n');
    for format in TextureFormat::ALL {
        writeln!(
            out,
            "#define CAIRN_FORMAT_{} {}u",
            screaming(&format!("{format:?}")),
            format as u32
        )?;
    }
    out.push('\n');
    for (bit, name) in features::NAMES {
        writeln!(out, "#define CAIRN_HAS_{} 0x{bit:x}u", screaming(name))?;
    }
    out.push('\n');
    for (name, value) in CONSTANTS {
        writeln!(out, "#define CAIRN_{name} 0x{value:x}u")?;
    }
    out.push('\n');
    Ok(())
}

fn record(out: &mut String, layout: &RecordLayout) -> std::fmt::Result {
    writeln!(out, "typedef struct Cairn{} {{", layout.name)?;
    for field in layout.fields {
        let (ty, dimensions) = match field.glsl {
            "uint" => ("uint32_t", ""),
            "uint64_t" => ("uint64_t", ""),
            "uvec4" => ("uint32_t", "[4]"),
            "vec2" => ("float", "[2]"),
            "vec3" => ("float", "[3]"),
            "vec4" => ("float", "[4]"),
            "mat4" => ("float", "[4][4]"),
            _ => ("float", ""),
        };
        let outer = if field.count > 0 {
            format!("[{}]", field.count)
        } else {
            String::new()
        };
        writeln!(out, "    {ty} {}{outer}{dimensions};", field.name)?;
    }
    let offsets = layout.fields.iter().map(|field| (field.name, field.offset));
    end(out, layout.name, layout.bytes, offsets)
}

fn end<'a>(
    out: &mut String,
    name: &str,
    bytes: usize,
    offsets: impl Iterator<Item = (&'a str, usize)>,
) -> std::fmt::Result {
    writeln!(out, "}} Cairn{name};")?;
    writeln!(out, "CAIRN_ASSERT(sizeof(Cairn{name}) == {bytes});")?;
    for (field, offset) in offsets {
        writeln!(
            out,
            "CAIRN_ASSERT(offsetof(Cairn{name}, {field}) == {offset});"
        )?;
    }
    out.push('\n');
    Ok(())
}

/// Root types, each behind those that it holds.
fn in_order() -> Vec<FileType> {
    let mut open = crate::scene::layouts();
    let mut done: Vec<FileType> = Vec::new();
    while !open.is_empty() {
        let (ready, rest): (Vec<FileType>, Vec<FileType>) = open.iter().partition(|layout| {
            let mut held = layout.fields.iter().filter_map(|field| embedded(field.ty));
            held.all(|name| {
                done.iter().any(|known| known.name == name)
                    || !open.iter().any(|other| other.name == name)
            })
        });
        assert!(!ready.is_empty(), "root types hold each other");
        done.extend(ready);
        open = rest;
    }
    done
}

/// Name of the root type that a field embeds, where it does.
fn embedded(ty: &str) -> Option<String> {
    let ty = bare(ty);
    let inner = ty
        .strip_prefix("Option<")
        .map_or(ty.as_str(), |inner| inner.trim_end_matches('>'));
    let named = inner.starts_with(|letter: char| letter.is_ascii_uppercase());
    (named && inner != "String" && !inner.starts_with("Vec<")).then(|| inner.to_owned())
}

fn bare(ty: &str) -> String {
    ty.chars()
        .filter(|letter| !letter.is_whitespace())
        .collect()
}

fn file_type(out: &mut String, layout: &FileType) -> std::fmt::Result {
    let name = layout.name;
    if !layout.variants.is_empty() {
        writeln!(out, "typedef uint8_t Cairn{name};")?;
        for (variant, value, _) in layout.variants {
            writeln!(
                out,
                "#define CAIRN_{}_{} {value}u",
                screaming(name),
                screaming(variant)
            )?;
        }
        out.push('\n');
        return Ok(());
    }
    for field in layout.fields {
        option(out, field)?;
    }
    writeln!(out, "typedef struct Cairn{name} {{")?;
    for field in layout.fields {
        writeln!(out, "    {};", member(field))?;
    }
    end(
        out,
        name,
        layout.bytes,
        layout.fields.iter().map(|field| (field.name, field.offset)),
    )
}

/// The type of an optional field, declared before the struct that holds it.
fn option(out: &mut String, field: &FileField) -> std::fmt::Result {
    let ty = bare(field.ty);
    let Some(inner) = ty
        .strip_prefix("Option<")
        .and_then(|inner| inner.strip_suffix('>'))
    else {
        return Ok(());
    };
    let name = option_name(inner);
    writeln!(
        out,
        "typedef struct {name} {{\n    uint8_t present;\n    {} value;\n}} {name};",
        scalar(inner)
    )?;
    writeln!(out, "CAIRN_ASSERT(sizeof({name}) == {});\n", field.bytes)
}

fn option_name(inner: &str) -> String {
    let mut letters = inner.chars();
    let first = letters.next().map(|letter| letter.to_ascii_uppercase());
    format!(
        "CairnOption{}{}",
        first.unwrap_or_default(),
        letters.as_str()
    )
}

fn member(field: &FileField) -> String {
    let ty = bare(field.ty);
    if let Some(inner) = ty
        .strip_prefix("Vec<")
        .and_then(|inner| inner.strip_suffix('>'))
    {
        return format!("CairnList {} /* of {} */", field.name, scalar(inner));
    }
    if let Some(inner) = ty
        .strip_prefix("Option<")
        .and_then(|inner| inner.strip_suffix('>'))
    {
        return format!("{} {}", option_name(inner), field.name);
    }
    // `[[f32;3];9]` is nine times three.
    let (mut inner, mut dimensions) = (ty.as_str(), String::new());
    while let Some((element, count)) = inner
        .strip_prefix('[')
        .and_then(|rest| rest.strip_suffix(']'))
        .and_then(|rest| rest.rsplit_once(';'))
    {
        dimensions += &format!("[{count}]");
        inner = element;
    }
    format!("{} {}{dimensions}", scalar(inner), field.name)
}

fn scalar(ty: &str) -> String {
    match ty {
        "f32" => "float".into(),
        "f64" => "double".into(),
        "bool" => "uint8_t".into(),
        "u8" | "u32" | "u64" => format!("uint{}_t", &ty[1..]),
        "TextureFormat" => "uint8_t".into(),
        other => format!("Cairn{other}"),
    }
}
