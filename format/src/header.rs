//! The fixed header and the section table.

use crate::record::file_record;

/// First eight bytes; the line ends show a transfer in text mode.
pub const MAGIC: [u8; 8] = *b"CAIRN\r\n\x1a";
/// Version of the layout; readers refuse any other.
pub const FORMAT_VERSION: u32 = 3;
/// Alignment of every section, in bytes.
pub const PAGE: u64 = 4096;
/// Alignment of the root and of image levels, in bytes.
pub const ALIGNMENT: u64 = 16;

file_record! {
    /// File bytes 0..128, little-endian.
    pub struct Header {
        /// [`MAGIC`].
        pub magic: [u8; 8],
        /// [`FORMAT_VERSION`].
        pub version: u32,
        /// Entries of the section table, which begins at byte 128.
        pub section_count: u32,
        /// Bytes of the whole file.
        pub file_length: u64,
        /// Hash of every record's layout: [`crate::schema::schema_hash`].
        pub schema_hash: u64,
        /// Byte offset of the rkyv root, a multiple of 16.
        pub root_offset: u64,
        /// Bytes of the rkyv root.
        pub root_length: u64,
        /// Version of the writing tool, ASCII, zero-padded.
        pub tool_version: [u8; 16],
        /// BLAKE3 of bytes 0..64, the section table and the root; the table holds the sections' hashes.
        pub content_hash: [u8; 32],
        /// Zero.
        pub reserved: [u8; 32],
    }
}

file_record! {
    /// One row of the section table.
    pub struct SectionEntry {
        /// [`crate::SectionKind`] as u32; rows ascend strictly.
        pub kind: u32,
        /// Bytes of one record.
        pub stride: u32,
        /// Byte offset, a multiple of [`PAGE`].
        pub offset: u64,
        /// Bytes: `count * stride`.
        pub length: u64,
        /// Records.
        pub count: u64,
        /// BLAKE3 of the section's bytes.
        pub hash: [u8; 32],
    }
}

/// Bytes of the header.
pub const HEADER_BYTES: u64 = size_of::<Header>() as u64;
/// Bytes of one row of the section table.
pub const ENTRY_BYTES: u64 = size_of::<SectionEntry>() as u64;
/// Bytes of the header that the content hash covers.
pub const HASHED_HEADER_BYTES: usize = std::mem::offset_of!(Header, content_hash);

const _: () = {
    assert!(size_of::<Header>() == 128);
    assert!(size_of::<SectionEntry>() == 64);
    assert!(HASHED_HEADER_BYTES == 64);
    assert!(cfg!(target_endian = "little"), "packages are little-endian");
};

impl Header {
    /// The tool version as text; bytes that are no printable ASCII become `?`.
    pub fn tool(&self) -> String {
        let text = self.tool_version.iter().take_while(|byte| **byte != 0);
        text.map(|byte| {
            if byte.is_ascii_graphic() {
                *byte as char
            } else {
                '?'
            }
        })
        .collect()
    }
}

/// `value` rounded up to a multiple of `alignment`, a power of two.
pub const fn align_up(value: u64, alignment: u64) -> u64 {
    (value + alignment - 1) & !(alignment - 1)
}
