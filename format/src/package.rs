//! Opens packages: bytes become types here, once, after they were checked.
//!
//! `open` reads header, section table and root into memory of its own, so that nothing can change them later,
//! and maps the file for the bulk sections. Its cost grows with the metadata, never with the bulk data.
#![allow(unsafe_code)]

use std::fs::File;
use std::io::Read;
use std::path::Path;

use bytemuck::{Pod, Zeroable};
use rkyv::rancor::BoxedError;
use rkyv::util::AlignedVec;

use crate::bounds::BoundsView;
use crate::check::{self, Flow, Found};
use crate::error::{Error, Part, Result};
use crate::gpu::{
    DirectionalLight, DrawGroup, EmissiveTriangle, EnvAliasEntry, EnvAliasHeader, Instance,
    Material, MaterialExtension, MeshInstance, PunctualLight, TextureTransform, VertexColor,
};
use crate::header::{ENTRY_BYTES, HEADER_BYTES, Header, SectionEntry};
use crate::scene::ArchivedScene;
use crate::section::SectionKind;
use crate::vertex::Vertex;

/// A checked package. After `open`, every index, offset and enum of the root, the materials and the draw groups
/// is in range; bulk data is checked by [`Package::verify`], or by the `check_*` functions as it is copied.
pub struct Package {
    header: Header,
    table: Vec<SectionEntry>,
    /// Header, table and root: the checked copy.
    head: AlignedVec<16>,
    bytes: Bytes,
}

/// Where the bulk sections lie.
enum Bytes {
    /// The file, kept open so that a changed length is noticed.
    Mapped(memmap2::Mmap, File),
    /// A copy in memory, aligned like a page's beginning for every record type.
    Owned(AlignedVec<16>),
}

impl std::fmt::Debug for Package {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Package")
            .field("header", &self.header)
            .finish_non_exhaustive()
    }
}

impl Package {
    /// Maps and checks a file.
    ///
    /// # Errors
    /// [`Error`] with section and offset; never panics, never allocates more than the file's length.
    pub fn open(path: &Path) -> Result<Self> {
        let (header, head, bytes) = map(path)?;
        Self::checked(header, head, bytes)
    }

    /// Checks a file as far as its damage allows, and hands every broken rule to `found`, in order: header, table,
    /// root, hashes and padding, then bulk data. What a broken rule makes unreadable is not looked at.
    ///
    /// # Errors
    /// [`Error::Io`] where the file cannot be read; everything else goes to `found`.
    pub fn examine(path: &Path, found: &mut Found) -> Result<()> {
        match map(path) {
            Ok((header, head, bytes)) => {
                let _ = Self::examined(header, head, bytes, found);
                Ok(())
            }
            Err(error @ Error::Io { .. }) => Err(error),
            Err(error) => {
                let _ = found(error);
                Ok(())
            }
        }
    }

    /// [`Package::examine`] of a package in memory.
    pub fn examine_bytes(bytes: &[u8], found: &mut Found) {
        let _ = match copy(bytes) {
            Ok((header, head, bytes)) => Self::examined(header, head, bytes, found),
            Err(error) => found(error),
        };
    }

    /// Checks a package in memory; the bytes are copied to aligned memory.
    ///
    /// # Errors
    /// As [`Package::open`].
    pub fn from_bytes(bytes: &[u8]) -> Result<Self> {
        let (header, head, bytes) = copy(bytes)?;
        Self::checked(header, head, bytes)
    }

    fn checked(header: Header, head: AlignedVec<16>, bytes: Bytes) -> Result<Self> {
        check::first(|found| {
            let package = Self::from_parts(header, head, bytes, found)?;
            check::root(&package, found)?;
            Flow::Continue(package)
        })
    }

    fn examined(header: Header, head: AlignedVec<16>, bytes: Bytes, found: &mut Found) -> Flow {
        let package = Self::from_parts(header, head, bytes, found)?;
        let mut sound = true;
        check::root(&package, &mut |error| {
            sound = false;
            found(error)
        })?;
        check::hashes_and_padding(&package, found)?;
        if sound {
            check::bulk(&package, found)
        } else {
            check::rootless(&package, found)
        }
    }

    /// Table and root, readable but not yet checked against each other.
    fn from_parts(
        header: Header,
        head: AlignedVec<16>,
        bytes: Bytes,
        found: &mut Found,
    ) -> Flow<Self> {
        let table_bytes = u64::from(header.section_count) * ENTRY_BYTES;
        let table_end = (HEADER_BYTES + table_bytes) as usize;
        let rows: &[SectionEntry] = bytemuck::cast_slice(&head[HEADER_BYTES as usize..table_end]);
        let table = rows.to_vec();
        if let Err(error) = check::content_hash(&header, &head) {
            found(error)?;
        }
        let mut sound = true;
        let mut keep = |error| {
            sound = false;
            found(error)
        };
        check::table(&header, &table, &mut keep)?;
        let root = &head[header.root_offset as usize..];
        if let Err(error) = rkyv::access::<ArchivedScene, BoxedError>(root) {
            keep(Error::corrupt(Part::Root, 0, error.to_string()))?;
        }
        if !sound {
            return Flow::Break(());
        }
        Flow::Continue(Self {
            header,
            table,
            head,
            bytes,
        })
    }

    /// The root.
    pub fn scene(&self) -> &ArchivedScene {
        let root = &self.head[self.header.root_offset as usize..];
        // SAFETY: `from_parts` validated exactly these bytes with `rkyv::access`, and they lie in memory that
        // only this value owns and never writes.
        unsafe { rkyv::access_unchecked::<ArchivedScene>(root) }
    }

    /// The header.
    pub fn header(&self) -> &Header {
        &self.header
    }

    /// Rows of the sections that are present, in file order.
    pub fn table(&self) -> &[SectionEntry] {
        &self.table
    }

    /// Row of a section.
    pub fn entry(&self, kind: SectionKind) -> Option<&SectionEntry> {
        self.table.iter().find(|entry| entry.kind == kind as u32)
    }

    /// Records of a section; 0 where it is absent.
    pub fn count(&self, kind: SectionKind) -> u64 {
        self.entry(kind).map_or(0, |entry| entry.count)
    }

    /// Bytes of a section; empty where it is absent.
    ///
    /// # Errors
    /// [`Error::Changed`] where the mapped file no longer has the length it had at `open`.
    pub fn section(&self, kind: SectionKind) -> Result<&[u8]> {
        let Some(entry) = self.entry(kind) else {
            return Ok(&[]);
        };
        Ok(&self.file_bytes()?[entry.offset as usize..(entry.offset + entry.length) as usize])
    }

    /// The whole file, its length confirmed.
    pub(crate) fn file_bytes(&self) -> Result<&[u8]> {
        match &self.bytes {
            Bytes::Owned(bytes) => Ok(bytes),
            Bytes::Mapped(map, file) => {
                let actual = file.metadata().map_or(0, |metadata| metadata.len());
                if actual != map.len() as u64 {
                    return Err(Error::Changed {
                        expected: map.len() as u64,
                        actual,
                    });
                }
                Ok(map)
            }
        }
    }

    fn records<T: Pod>(&self, kind: SectionKind) -> Result<&[T]> {
        let bytes = self.section(kind)?;
        if bytes.is_empty() {
            return Ok(&[]);
        }
        // Sections begin at pages and hold whole records, both checked by `open`.
        Ok(bytemuck::cast_slice(bytes))
    }

    /// The vertex arena.
    ///
    /// # Errors
    /// As [`Package::section`]; the same holds for the views below.
    pub fn vertices(&self) -> Result<&[Vertex]> {
        self.records(SectionKind::Vertices)
    }

    /// The index arena.
    pub fn indices(&self) -> Result<&[u32]> {
        self.records(SectionKind::Indices)
    }

    /// Instance records.
    pub fn instances(&self) -> Result<&[Instance]> {
        self.records(SectionKind::Instances)
    }

    /// World bounds of the instances.
    pub fn instance_bounds(&self) -> Result<BoundsView<'_>> {
        let arrays = self.records(SectionKind::InstanceBounds)?;
        let count = self.count(SectionKind::Instances) as usize;
        BoundsView::new(arrays, count).ok_or_else(|| {
            let part = Part::Section(SectionKind::InstanceBounds);
            Error::corrupt(
                part,
                0,
                format!("{} floats do not fit {count} instances", arrays.len()),
            )
        })
    }

    /// World bounds of every [`crate::bounds::CLUSTER`] consecutive instances; `None` where the section is absent.
    pub fn cluster_bounds(&self) -> Result<Option<BoundsView<'_>>> {
        let arrays: &[f32] = self.records(SectionKind::ClusterBounds)?;
        let instances = self.count(SectionKind::Instances) as usize;
        Ok(
            BoundsView::new(arrays, instances.div_ceil(crate::bounds::CLUSTER))
                .filter(|_| !arrays.is_empty()),
        )
    }

    /// Texture coordinate transforms, one per 2D slot; empty where all are the identity.
    pub fn texture_transforms(&self) -> Result<&[TextureTransform]> {
        self.records(SectionKind::TextureTransforms)
    }

    /// Vertex colours, one per vertex of the arena; empty where no primitive has any.
    pub fn vertex_colors(&self) -> Result<&[VertexColor]> {
        self.records(SectionKind::VertexColors)
    }

    /// The environment's importance table; `None` where the section is absent.
    pub fn env_alias(&self) -> Result<Option<(&EnvAliasHeader, &[EnvAliasEntry])>> {
        let bytes = self.section(SectionKind::EnvAlias)?;
        Ok(bytes
            .split_first_chunk::<{ size_of::<EnvAliasHeader>() }>()
            .map(|(head, entries)| (bytemuck::from_bytes(head), bytemuck::cast_slice(entries))))
    }

    /// Emissive triangles in world space.
    pub fn emissive_triangles(&self) -> Result<&[EmissiveTriangle]> {
        self.records(SectionKind::EmissiveTriangles)
    }

    /// Words of the emissive triangles' alias table: [`crate::gpu::EmissiveAliasHeader`], then one
    /// [`crate::gpu::EmissiveAliasEntry`] per triangle; empty where nothing is sampled.
    pub fn emissive_alias(&self) -> Result<&[u32]> {
        self.records(SectionKind::EmissiveAlias)
    }

    /// Draw groups.
    pub fn draw_groups(&self) -> Result<&[DrawGroup]> {
        self.records(SectionKind::DrawGroups)
    }

    /// Top-level instances.
    pub fn mesh_instances(&self) -> Result<&[MeshInstance]> {
        self.records(SectionKind::MeshInstances)
    }

    /// Material records.
    pub fn materials(&self) -> Result<&[Material]> {
        self.records(SectionKind::Materials)
    }

    /// Directional light records.
    pub fn directional_lights(&self) -> Result<&[DirectionalLight]> {
        self.records(SectionKind::DirectionalLights)
    }

    /// Point and spot light records.
    pub fn punctual_lights(&self) -> Result<&[PunctualLight]> {
        self.records(SectionKind::PunctualLights)
    }

    /// Further lobes, one record per material; empty where no material has any.
    pub fn material_extensions(&self) -> Result<&[MaterialExtension]> {
        self.records(SectionKind::MaterialExtensions)
    }

    /// Texel bytes of all images.
    pub fn texels(&self) -> Result<&[u8]> {
        self.section(SectionKind::Texels)
    }

    /// Recomputes every hash, checks that padding is zero, and checks all bulk data.
    ///
    /// # Errors
    /// The first broken rule, with section and offset.
    pub fn verify(&self) -> Result<()> {
        check::first(|found| {
            check::hashes_and_padding(self, found)?;
            check::bulk(self, found)
        })
    }
}

/// Header, checked copy of the head, and the sections' bytes of a file.
fn map(path: &Path) -> Result<(Header, AlignedVec<16>, Bytes)> {
    let io = |source| Error::Io {
        path: path.to_owned(),
        source,
    };
    let mut file = File::open(path).map_err(io)?;
    let length = file.metadata().map_err(io)?.len();
    let header = read_header(&mut file, length).map_err(|error| with_path(error, path))?;
    let end = check::header(&header, length)?;
    let mut head = AlignedVec::<16>::with_capacity(end as usize);
    head.extend_from_slice(bytemuck::bytes_of(&header));
    head.resize(end as usize, 0);
    file.read_exact(&mut head[HEADER_BYTES as usize..])
        .map_err(io)?;
    // SAFETY: the map is read-only and only ever viewed as plain records for which every bit pattern is
    // valid; what must not change (header, table, root) was copied above. A file that is cut while mapped
    // is the one case left: `section` compares the length before it hands out a slice.
    let map = unsafe { memmap2::Mmap::map(&file) }.map_err(io)?;
    if map.len() as u64 != length {
        return Err(Error::Changed {
            expected: length,
            actual: map.len() as u64,
        });
    }
    Ok((header, head, Bytes::Mapped(map, file)))
}

/// The same of a package in memory, in aligned memory of its own.
fn copy(bytes: &[u8]) -> Result<(Header, AlignedVec<16>, Bytes)> {
    let length = bytes.len() as u64;
    let header = read_header(&mut &*bytes, length)?;
    let end = check::header(&header, length)? as usize;
    let mut head = AlignedVec::<16>::with_capacity(end);
    head.extend_from_slice(&bytes[..end]);
    let mut owned = AlignedVec::<16>::with_capacity(bytes.len());
    owned.extend_from_slice(bytes);
    Ok((header, head, Bytes::Owned(owned)))
}

fn read_header(source: &mut dyn Read, length: u64) -> Result<Header> {
    let mut header = Header::zeroed();
    if length < HEADER_BYTES {
        let mut magic = [0; 8];
        let known = source.read_exact(&mut magic).is_ok() && magic == crate::header::MAGIC;
        return Err(if known {
            Error::Length {
                expected: HEADER_BYTES,
                actual: length,
            }
        } else {
            Error::NotAPackage
        });
    }
    let read = source.read_exact(bytemuck::bytes_of_mut(&mut header));
    read.map_err(|source| Error::Io {
        path: "package".into(),
        source,
    })?;
    Ok(header)
}

fn with_path(error: Error, path: &Path) -> Error {
    match error {
        Error::Io { source, .. } => Error::Io {
            path: path.to_owned(),
            source,
        },
        other => other,
    }
}
