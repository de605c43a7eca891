//! Right hashes for a damaged package, so that the damage is reached.

use cairn_format::header::{ENTRY_BYTES, HASHED_HEADER_BYTES, HEADER_BYTES, Header, SectionEntry};

/// Writes the hashes that the package's bytes have, as far as header and table lead to bytes.
pub fn seal(bytes: &mut [u8]) {
    let header_bytes = HEADER_BYTES as usize;
    let Some(head) = bytes.get(..header_bytes) else {
        return;
    };
    let header: Header = bytemuck::pod_read_unaligned(head);
    seal_sections(bytes, header.section_count);
    let (Ok(root), Ok(length)) = (
        usize::try_from(header.root_offset),
        usize::try_from(header.root_length),
    ) else {
        return;
    };
    let table = bytes.get(header_bytes..root);
    let root = root
        .checked_add(length)
        .and_then(|end| bytes.get(root..end));
    let (Some(table), Some(root)) = (table, root) else {
        return;
    };
    let mut hasher = blake3::Hasher::new();
    hasher
        .update(&bytes[..HASHED_HEADER_BYTES])
        .update(table)
        .update(root);
    let hash = hasher.finalize();
    let place = std::mem::offset_of!(Header, content_hash);
    bytes[place..place + 32].copy_from_slice(hash.as_bytes());
}

fn seal_sections(bytes: &mut [u8], count: u32) {
    for row in 0..count as usize {
        let start = HEADER_BYTES as usize + row * ENTRY_BYTES as usize;
        let Some(entry) = bytes.get(start..start + ENTRY_BYTES as usize) else {
            return;
        };
        let entry: SectionEntry = bytemuck::pod_read_unaligned(entry);
        let range = usize::try_from(entry.offset).ok().and_then(|offset| {
            let end = offset.checked_add(usize::try_from(entry.length).ok()?)?;
            Some(offset..end)
        });
        let Some(section) = range.and_then(|range| bytes.get(range)) else {
            continue;
        };
        let hash = blake3::hash(section);
        let place = start + std::mem::offset_of!(SectionEntry, hash);
        bytes[place..place + 32].copy_from_slice(hash.as_bytes());
    }
}
