//! Writes packages: the same scene and sections give the same bytes.

use std::borrow::Cow;
use std::collections::BTreeMap;
use std::io::Write;

use bytemuck::Zeroable;

use crate::error::{Error, Part, Result};
use crate::gpu::Record;
use crate::header::{
    ALIGNMENT, ENTRY_BYTES, FORMAT_VERSION, HASHED_HEADER_BYTES, HEADER_BYTES, Header, MAGIC, PAGE,
    SectionEntry, align_up,
};
use crate::scene::Scene;
use crate::section::SectionKind;

/// Collects sections, then writes the file in one pass.
#[derive(Debug, Default)]
pub struct Writer<'a> {
    sections: BTreeMap<SectionKind, Cow<'a, [u8]>>,
}

impl<'a> Writer<'a> {
    /// A package without sections.
    pub fn new() -> Self {
        Self::default()
    }

    /// Adds a section of records; an empty one is left out.
    ///
    /// # Panics
    /// Where the record's size is not the section's stride, or the section was added before.
    pub fn records<T: Record>(&mut self, kind: SectionKind, records: &'a [T]) -> &mut Self {
        assert_eq!(
            size_of::<T>() as u32,
            kind.stride(),
            "records of section {}",
            kind.name()
        );
        self.bytes(kind, Cow::Borrowed(bytemuck::cast_slice(records)))
    }

    /// Adds a section of bytes; an empty one is left out.
    ///
    /// # Panics
    /// Where the length is no multiple of the section's stride, or the section was added before.
    pub fn bytes(&mut self, kind: SectionKind, bytes: impl Into<Cow<'a, [u8]>>) -> &mut Self {
        let bytes = bytes.into();
        assert_eq!(
            bytes.len() % kind.stride() as usize,
            0,
            "length of section {}",
            kind.name()
        );
        if !bytes.is_empty() {
            let before = self.sections.insert(kind, bytes);
            assert!(before.is_none(), "section {} was added twice", kind.name());
        }
        self
    }

    /// Bytes of each section, in file order.
    pub fn section_bytes(&self) -> impl Iterator<Item = (SectionKind, u64)> {
        self.sections
            .iter()
            .map(|(kind, bytes)| (*kind, bytes.len() as u64))
    }

    /// Writes the package. `tool_version` is cut to 16 bytes.
    pub fn write(&self, scene: &Scene, tool_version: &str, out: &mut dyn Write) -> Result<()> {
        let io = |source| Error::Io {
            path: "package output".into(),
            source,
        };
        let root = rkyv::to_bytes::<rkyv::rancor::BoxedError>(scene)
            .map_err(|error| Error::corrupt(Part::Root, 0, error.to_string()))?;
        let root_offset = align_up(
            HEADER_BYTES + ENTRY_BYTES * self.sections.len() as u64,
            ALIGNMENT,
        );
        let table = self.table(root_offset + root.len() as u64);
        let header = self.header(&table, root_offset, &root, tool_version);

        out.write_all(bytemuck::bytes_of(&header)).map_err(io)?;
        out.write_all(bytemuck::cast_slice(&table)).map_err(io)?;
        out.write_all(&root).map_err(io)?;
        let mut position = root_offset + root.len() as u64;
        for (entry, bytes) in table.iter().zip(self.sections.values()) {
            let padding = [0; PAGE as usize];
            out.write_all(&padding[..(entry.offset - position) as usize])
                .map_err(io)?;
            out.write_all(bytes).map_err(io)?;
            position = entry.offset + entry.length;
        }
        out.flush().map_err(io)
    }

    /// The package as bytes.
    pub fn to_vec(&self, scene: &Scene, tool_version: &str) -> Result<Vec<u8>> {
        let mut bytes = Vec::new();
        self.write(scene, tool_version, &mut bytes)?;
        Ok(bytes)
    }

    fn table(&self, mut end: u64) -> Vec<SectionEntry> {
        let mut table = Vec::with_capacity(self.sections.len());
        for (kind, bytes) in &self.sections {
            let offset = align_up(end, PAGE);
            let length = bytes.len() as u64;
            table.push(SectionEntry {
                kind: *kind as u32,
                stride: kind.stride(),
                offset,
                length,
                count: length / u64::from(kind.stride()),
                hash: section_hash(bytes),
            });
            end = offset + length;
        }
        table
    }

    fn header(&self, table: &[SectionEntry], root_offset: u64, root: &[u8], tool: &str) -> Header {
        let mut header = Header {
            magic: MAGIC,
            version: FORMAT_VERSION,
            section_count: table.len() as u32,
            file_length: match table.last() {
                Some(last) => last.offset + last.length,
                None => root_offset + root.len() as u64,
            },
            schema_hash: crate::schema::schema_hash(),
            root_offset,
            root_length: root.len() as u64,
            ..Header::zeroed()
        };
        for (to, from) in header.tool_version.iter_mut().zip(tool.bytes()) {
            *to = from;
        }
        header.content_hash = content_hash(&header, bytemuck::cast_slice(table), root);
        header
    }
}

/// BLAKE3 of the header's hashed bytes, the section table and the root.
pub(crate) fn content_hash(header: &Header, table: &[u8], root: &[u8]) -> [u8; 32] {
    let mut hasher = blake3::Hasher::new();
    hasher.update(&bytemuck::bytes_of(header)[..HASHED_HEADER_BYTES]);
    hasher.update(table);
    hasher.update(root);
    *hasher.finalize().as_bytes()
}

/// BLAKE3 of a section; large ones are hashed on all cores.
pub(crate) fn section_hash(bytes: &[u8]) -> [u8; 32] {
    let mut hasher = blake3::Hasher::new();
    if bytes.len() >= 1 << 20 {
        hasher.update_rayon(bytes);
    } else {
        hasher.update(bytes);
    }
    *hasher.finalize().as_bytes()
}
