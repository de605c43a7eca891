//! Every validation rule of a package, one function each.
//!
//! Rules hand what is broken to a [`Found`], which says whether to go on: `open` stops at the first, `examine`
//! may take all of them.

mod bulk;
mod emission;
mod environment;
mod records;
mod root;

use std::ops::{ControlFlow, Range};

use crate::error::{Error, Part, Result};
use crate::header::{
    ALIGNMENT, ENTRY_BYTES, FORMAT_VERSION, HEADER_BYTES, Header, MAGIC, PAGE, SectionEntry,
    align_up,
};
use crate::section::SectionKind;

pub(crate) use bulk::{bulk, hashes_and_padding, rootless};
pub use emission::{emissive, emits};
pub use environment::env_alias;
pub use records::{
    indices, instances, material_extensions, materials, mesh_instances, punctual_lights,
    texture_transforms, vertices,
};
pub(crate) use root::root;

/// Largest width or height of an image.
pub const MAX_IMAGE_EXTENT: u32 = 1 << 16;

/// Whether a check goes on behind a broken rule; [`ControlFlow::Break`] ends it.
pub type Flow<T = ()> = ControlFlow<(), T>;

/// Takes broken rules, one at a time.
pub type Found<'a> = dyn FnMut(Error) -> Flow + 'a;

/// The value of `check`, or the first broken rule that it finds.
pub(crate) fn first<T>(check: impl FnOnce(&mut Found) -> Flow<T>) -> Result<T> {
    let mut error = None;
    let flow = check(&mut |found| {
        error = Some(found);
        Flow::Break(())
    });
    match (flow, error) {
        (_, Some(error)) => Err(error),
        (Flow::Continue(value), None) => Ok(value),
        (Flow::Break(()), None) => unreachable!("a check broke off without a broken rule"),
    }
}

/// The value, or its error handed over: without the value, the check cannot go on.
fn given<T>(value: Result<T>, found: &mut Found) -> Flow<T> {
    match value {
        Ok(value) => Flow::Continue(value),
        Err(error) => {
            found(error)?;
            Flow::Break(())
        }
    }
}

fn root_error(what: impl Into<String>) -> Error {
    Error::corrupt(Part::Root, 0, what)
}

fn section_error(kind: SectionKind, record: usize, what: impl Into<String>) -> Error {
    let offset = record as u64 * u64::from(kind.stride());
    Error::corrupt(Part::Section(kind), offset, what)
}

/// `start..start + count` where it lies inside `0..limit`.
fn range(start: u32, count: u32, limit: u64) -> Option<Range<u64>> {
    let end = u64::from(start) + u64::from(count);
    (end <= limit).then_some(u64::from(start)..end)
}

fn finite(values: &[f32]) -> bool {
    values.iter().all(|value| value.is_finite())
}

/// Header rules; returns the end of the root, which is at most `length`.
pub(crate) fn header(header: &Header, length: u64) -> Result<u64> {
    if header.magic != MAGIC {
        return Err(Error::NotAPackage);
    }
    if header.version != FORMAT_VERSION {
        return Err(Error::Version {
            found: header.version,
            supported: FORMAT_VERSION,
            tool: header.tool(),
        });
    }
    let expected = crate::schema::schema_hash();
    if header.schema_hash != expected {
        return Err(Error::Schema {
            found: header.schema_hash,
            expected,
            tool: header.tool(),
        });
    }
    if header.file_length != length {
        return Err(Error::Length {
            expected: header.file_length,
            actual: length,
        });
    }
    let fail = |offset, what: String| Err(Error::corrupt(Part::Header, offset, what));
    if header.section_count as usize > SectionKind::ALL.len() {
        return fail(12, format!("{} sections", header.section_count));
    }
    if header.reserved != [0; 32] {
        return fail(96, "reserved bytes are not zero".into());
    }
    let table_end = HEADER_BYTES + u64::from(header.section_count) * ENTRY_BYTES;
    if header.root_offset != align_up(table_end, ALIGNMENT) {
        return fail(
            32,
            format!("root offset {}, not behind the table", header.root_offset),
        );
    }
    match header.root_offset.checked_add(header.root_length) {
        Some(end) if end <= length => Ok(end),
        _ => fail(
            40,
            format!("root length {} leaves the file", header.root_length),
        ),
    }
}

/// The content hash over header, table and root.
pub(crate) fn content_hash(header: &Header, head: &[u8]) -> Result<()> {
    let table = &head[HEADER_BYTES as usize..header.root_offset as usize];
    let root = &head[header.root_offset as usize..];
    if crate::writer::content_hash(header, table, root) == header.content_hash {
        return Ok(());
    }
    let what = "header, section table or root differ from their BLAKE3 hash: the file is damaged";
    Err(Error::corrupt(Part::Header, 64, what))
}

/// Section table rules: known kinds in order, right strides, tight pages, nothing behind the last section. Every
/// row is checked against the end of the one before.
pub(crate) fn table(header: &Header, table: &[SectionEntry], found: &mut Found) -> Flow {
    let mut end = header.root_offset + header.root_length;
    let mut last_kind = 0;
    for (row, entry) in table.iter().enumerate() {
        let mut fail = |field: u64, what: String| {
            let offset = row as u64 * ENTRY_BYTES + field;
            found(Error::corrupt(Part::Table, offset, what))
        };
        let Some(kind) = SectionKind::from_u32(entry.kind).filter(|_| entry.kind > last_kind)
        else {
            return fail(0, format!("section kind {} after {last_kind}", entry.kind));
        };
        if entry.stride != kind.stride() {
            let what = format!("stride {} of section {}", entry.stride, kind.name());
            fail(4, what)?;
        }
        let expected = align_up(end, PAGE);
        if entry.offset != expected {
            fail(8, format!("offset {}, expected {expected}", entry.offset))?;
        }
        let length = entry.count.checked_mul(u64::from(kind.stride()));
        if entry.count == 0 || length != Some(entry.length) {
            let what = format!("length {} of {} records", entry.length, entry.count);
            fail(16, what)?;
        }
        end = match entry.offset.checked_add(entry.length) {
            Some(end) if end <= header.file_length => end,
            _ => return fail(16, format!("section {} leaves the file", kind.name())),
        };
        last_kind = entry.kind;
    }
    if end != header.file_length {
        let what = format!(
            "file length {}, but the last section ends at {end}",
            header.file_length
        );
        found(Error::corrupt(Part::Header, 16, what))?;
    }
    Flow::Continue(())
}
