//! The state that the parts of an import share: document, files, warnings, limits.

use std::cell::{Cell, OnceCell, RefCell};
use std::collections::BTreeMap;
use std::ops::Range;
use std::path::{Path, PathBuf};

use crate::diagnostic::{BakeError, Diagnostic, Result};
use crate::scene::{Origin, Source};

use super::document::Document;
use super::uri::{self, Resource};
use super::{glb, sniff};

/// The most accessor elements that one scene may decode: hostile files can name one buffer any
/// number of times.
const ELEMENT_LIMIT: u64 = 1 << 28;

/// The most elements of accessors without a buffer view, which cost the file nothing.
const ZEROED_LIMIT: u64 = 1 << 24;

/// The most bytes that compressed buffer views and meshes of one scene may decode to.
const DECODED_LIMIT: u64 = 1 << 29;

pub(super) struct Context {
    pub document: Document,
    /// Decoded buffers by glTF index, filled on first use.
    pub buffers: Vec<OnceCell<Vec<u8>>>,
    /// Decompressed buffer views by glTF index, filled on first use.
    pub views: Vec<OnceCell<Vec<u8>>>,
    /// The BIN chunk, in `container`.
    bin: Option<Range<usize>>,
    container: Vec<u8>,
    file: String,
    folder: PathBuf,
    sources: RefCell<Vec<Source>>,
    warnings: RefCell<Warnings>,
    elements: Cell<u64>,
    zeroed: Cell<u64>,
    decoded: Cell<u64>,
    triangles: Cell<u64>,
    /// What the scene may reach and be.
    pub rules: Rules,
}

/// What an import may read, and how large a scene may be.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Rules {
    /// Whether URIs may name files outside the scene's folder.
    pub allow_external: bool,
    /// Most triangles of all meshes that are drawn, each counted once.
    pub limit_triangles: u64,
}

/// Triangles that a bake takes by default: 67 million, a package of several gigabytes.
pub const DEFAULT_LIMIT_TRIANGLES: u64 = 1 << 26;

impl Default for Rules {
    fn default() -> Self {
        Self {
            allow_external: false,
            limit_triangles: DEFAULT_LIMIT_TRIANGLES,
        }
    }
}

/// Warnings in order of first occurrence; equal groups are counted instead of repeated.
#[derive(Default)]
struct Warnings {
    list: Vec<(Diagnostic, u64)>,
    by_group: BTreeMap<(&'static str, String), usize>,
}

impl Context {
    /// Reads and parses the scene file.
    pub fn open(path: &Path) -> Result<Self> {
        let container = read_file(path).map_err(|error| BakeError::io(path, error))?;
        let name = path.file_name().unwrap_or_default().to_string_lossy();
        let mut source = describe(name.into_owned(), &container);
        path.clone_into(&mut source.location);
        let folder = path.parent().unwrap_or(Path::new("")).to_owned();
        Self::parse(path.display().to_string(), folder, container, source)
    }

    /// Parses the content of a scene file.
    pub fn parse(
        file: String,
        folder: PathBuf,
        container: Vec<u8>,
        source: Source,
    ) -> Result<Self> {
        let refuse = |code, place: String, message: String| {
            let origin = Origin {
                file: file.clone(),
                pointer: place,
            };
            BakeError::input(code, &origin, message)
        };
        if let Some(what) = sniff::impostor(&container) {
            return Err(refuse("not-gltf", String::new(), what.into()));
        }
        let (json, bin, remarks) = if glb::is_glb(&container) {
            let chunks = glb::split(&container)
                .map_err(|fault| refuse("glb", format!("byte {}", fault.offset), fault.message))?;
            (chunks.json, chunks.bin, chunks.remarks)
        } else {
            (0..container.len(), None, Vec::new())
        };
        let document = Document::parse(&container[json])
            .map_err(|fault| refuse(fault.code, fault.place, fault.message))?;
        let context = Self {
            buffers: document.buffers.iter().map(|_| OnceCell::new()).collect(),
            views: document
                .buffer_views
                .iter()
                .map(|_| OnceCell::new())
                .collect(),
            document,
            bin,
            container,
            file,
            folder,
            sources: RefCell::new(vec![source]),
            warnings: RefCell::default(),
            elements: Cell::new(0),
            zeroed: Cell::new(0),
            decoded: Cell::new(0),
            triangles: Cell::new(0),
            rules: Rules::default(),
        };
        for remark in remarks {
            context.warn("glb", format!("byte {}", remark.offset), remark.message);
        }
        Ok(context)
    }

    pub fn origin(&self, pointer: impl Into<String>) -> Origin {
        Origin {
            file: self.file.clone(),
            pointer: pointer.into(),
        }
    }

    /// An error at a JSON pointer of the scene file.
    pub fn error(
        &self,
        code: &'static str,
        pointer: impl Into<String>,
        message: impl Into<String>,
    ) -> BakeError {
        let pointer = pointer.into();
        let object = self.document.object_at(&pointer);
        let origin = self.origin(pointer);
        BakeError::Input(Diagnostic::error(code, &origin, message).about(object))
    }

    /// A reference to an absent element of a top-level array.
    pub fn absent(
        &self,
        pointer: impl Into<String>,
        kind: &str,
        index: usize,
        length: usize,
    ) -> BakeError {
        let message = format!(
            "{kind} {index} does not exist, the file has {length}; correct the index or export again"
        );
        self.error("index-out-of-range", pointer, message)
    }

    /// A warning; repetitions of one code are counted.
    pub fn warn(&self, code: &'static str, pointer: impl Into<String>, message: impl Into<String>) {
        self.warn_group(code, "", pointer, message);
    }

    /// A warning; repetitions of one code and group are counted.
    pub fn warn_group(
        &self,
        code: &'static str,
        group: &str,
        pointer: impl Into<String>,
        message: impl Into<String>,
    ) {
        let mut warnings = self.warnings.borrow_mut();
        let next = warnings.list.len();
        let key = (code, group.to_owned());
        let index = *warnings.by_group.entry(key).or_insert(next);
        if let Some((_, count)) = warnings.list.get_mut(index) {
            *count += 1;
        } else {
            let pointer = pointer.into();
            let object = self.document.object_at(&pointer);
            let diagnostic = Diagnostic::warning(code, &self.origin(pointer), message);
            warnings.list.push((diagnostic.about(object), 1));
        }
    }

    /// Warns of what the file contains and import leaves out.
    pub fn note_ignored_features(&self) {
        for (index, name) in self.document.ignored_extensions() {
            let pointer = format!("/extensionsUsed/{index}");
            let message = format!("the extension {name} is not supported and is ignored");
            self.warn_group("extension-ignored", name, pointer, message);
        }
        if !self.document.animations.is_empty() {
            let count = self.document.animations.len();
            let message = format!("{count} animations are ignored; the default pose is used");
            self.warn("animation-ignored", "/animations", message);
        }
        if !self.document.skins.is_empty() {
            let count = self.document.skins.len();
            let message =
                format!("{count} skins do not move; meshes are baked in their default pose");
            self.warn("skin-static", "/skins", message);
        }
    }

    /// Accounts for accessor elements about to be decoded from a buffer.
    pub fn charge(&self, elements: u64, pointer: &str) -> Result<()> {
        let what = "accessor elements";
        self.spend(&self.elements, ELEMENT_LIMIT, elements, what, pointer)
    }

    /// Accounts for accessor elements about to be filled with zeros.
    pub fn charge_zeroed(&self, elements: u64, pointer: &str) -> Result<()> {
        let what = "accessor elements";
        self.spend(&self.zeroed, ZEROED_LIMIT, elements, what, pointer)
    }

    /// Accounts for bytes about to be decompressed.
    pub fn charge_decoded(&self, bytes: u64, pointer: &str) -> Result<()> {
        let what = "decompressed bytes";
        self.spend(&self.decoded, DECODED_LIMIT, bytes, what, pointer)
    }

    /// Accounts for triangles about to be decoded.
    pub fn charge_triangles(&self, triangles: u64, pointer: &str) -> Result<()> {
        let total = self.triangles.get().saturating_add(triangles);
        let limit = self.rules.limit_triangles;
        if total > limit {
            let message = format!(
                "with {triangles} more triangles the scene has {total}, over the limit of {limit}; simplify it, \
                 or raise --limit-triangles"
            );
            return Err(self.error("scene-too-large", pointer, message));
        }
        self.triangles.set(total);
        Ok(())
    }

    /// Bytes that may still be decompressed.
    pub fn decodable(&self) -> u64 {
        DECODED_LIMIT.saturating_sub(self.decoded.get())
    }

    fn spend(
        &self,
        spent: &Cell<u64>,
        limit: u64,
        amount: u64,
        what: &str,
        pointer: &str,
    ) -> Result<()> {
        let total = spent.get().saturating_add(amount);
        if total > limit {
            let message = format!(
                "{amount} more {what} would pass the limit of {limit} in a scene; split the scene"
            );
            return Err(self.error("scene-too-large", pointer, message));
        }
        spent.set(total);
        Ok(())
    }

    /// The bytes that a URI of the scene file stands for.
    pub fn resource(&self, uri: &str, pointer: &str) -> Result<Vec<u8>> {
        let resolved = if self.rules.allow_external {
            uri::resolve_external(uri)
        } else {
            uri::resolve(uri)
        };
        let resource = resolved.map_err(|(code, message)| self.error(code, pointer, message))?;
        let (path, name) = match resource {
            Resource::Data(bytes) => return Ok(bytes),
            Resource::File(path) => (self.folder.join(&path), path),
            Resource::External(path) => (self.folder.join(&path), external_name(&path)),
        };
        let bytes = read_file(&path).map_err(|error| {
            let message = format!(
                "`{}` cannot be read: {error}; put the file there or correct the URI",
                path.display()
            );
            self.error("file-missing", pointer, message)
        })?;
        let mut sources = self.sources.borrow_mut();
        if !sources.iter().any(|source| source.location == path) {
            let mut source = describe(name, &bytes);
            source.location = path;
            sources.push(source);
        }
        Ok(bytes)
    }

    /// The BIN chunk of a `.glb`.
    pub fn bin(&self) -> Option<&[u8]> {
        self.container.get(self.bin.clone()?)
    }

    /// The files that were read and the warnings, in order.
    pub fn finish(self) -> (Vec<Source>, Vec<Diagnostic>) {
        let warnings = self.warnings.into_inner().list.into_iter();
        let diagnostics = warnings.map(|(mut diagnostic, count)| {
            if count > 1 {
                let also = format!(" (the first of {count} such places)");
                diagnostic.message.push_str(&also);
            }
            diagnostic
        });
        (self.sources.into_inner(), diagnostics.collect())
    }
}

/// Reads a regular file whole. Pipes and devices are refused: they may never end.
pub(crate) fn read_file(path: &Path) -> std::io::Result<Vec<u8>> {
    if !std::fs::metadata(path)?.is_file() {
        return Err(std::io::Error::other("not a regular file"));
    }
    std::fs::read(path)
}

/// What a package says of a file outside the scene's folder: a relative path as it is, of others only the name,
/// since where a folder lies must not change the bytes.
fn external_name(path: &str) -> String {
    if path.starts_with("..") {
        return path.to_owned();
    }
    path.rsplit('/').next().unwrap_or_default().to_owned()
}

/// The dependency record of a file.
pub(super) fn describe(path: String, bytes: &[u8]) -> Source {
    Source {
        location: PathBuf::from(&path),
        path,
        bytes: bytes.len() as u64,
        hash: *blake3::hash(bytes).as_bytes(),
    }
}
