//! What a bake read and made, kept to know the next time what changed, and whether anything did.

use std::path::{Path, PathBuf};
use std::time::SystemTime;

use serde::{Deserialize, Serialize};

use super::key::{Inputs, content_hash};
use super::stamp::Stamp;
use super::store::Store;
use crate::report::Summary;

/// A file that decided bytes of the package.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Dependency {
    /// Absolute.
    pub path: PathBuf,
    /// BLAKE3 of the content.
    pub hash: [u8; 32],
    /// Absent where the file was changed too shortly before it was read.
    pub stamp: Option<Stamp>,
}

/// The package that a bake wrote.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Output {
    /// Absolute.
    pub path: PathBuf,
    /// The content hash in the header.
    pub content_hash: [u8; 32],
    /// Absent until a later bake has seen the file lie still.
    pub stamp: Option<Stamp>,
}

/// Everything about one bake.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Manifest {
    /// Settings and code of the whole bake.
    pub request: Inputs,
    pub dependencies: Vec<Dependency>,
    pub output: Output,
    pub products: Vec<Inputs>,
    /// The summary as JSON.
    summary: String,
}

impl Manifest {
    /// Everything about a bake that is over.
    pub fn new(
        request: Inputs,
        dependencies: Vec<Dependency>,
        output: Output,
        products: Vec<Inputs>,
        summary: &Summary,
    ) -> Self {
        Self {
            request,
            dependencies,
            output,
            products,
            summary: serde_json::to_string(summary).unwrap_or_default(),
        }
    }

    /// What the bake told; `None` where it held a number that JSON has not.
    pub fn summary(&self) -> Option<Summary> {
        serde_json::from_str(&self.summary).ok()
    }

    /// What is remembered under a path: of the output, or of the scene. Damaged ones count as absent.
    pub fn read(store: &Store, path: &Path) -> Option<Self> {
        let text = std::fs::read(file(store, path)).ok()?;
        let (hash, json) = text.split_at_checked(HASH_LINE)?;
        let expected = hash_line(json);
        (hash == expected.as_bytes())
            .then(|| serde_json::from_slice(json).ok())
            .flatten()
    }

    /// Remembers the bake under each of `paths`.
    ///
    /// # Errors
    /// The cache cannot be written.
    pub fn write(&self, store: &Store, paths: &[&Path]) -> std::io::Result<()> {
        let json = serde_json::to_vec(self)?;
        let hash = hash_line(&json);
        for path in paths {
            store.write(&file(store, path), &[hash.as_bytes(), &json])?;
        }
        Ok(())
    }
}

/// Length of the first line: a hash in hexadecimal and a newline.
const HASH_LINE: usize = 65;

fn hash_line(json: &[u8]) -> String {
    format!(
        "{}\n",
        blake3::Hash::from_bytes(content_hash(json)).to_hex()
    )
}

fn file(store: &Store, path: &Path) -> PathBuf {
    let name = blake3::hash(path.as_os_str().as_encoded_bytes()).to_hex();
    store.bake(&name)
}

impl Dependency {
    /// A file that was read with this content at `started` or later.
    pub fn new(path: PathBuf, hash: [u8; 32], started: SystemTime) -> Self {
        let stamp = Stamp::of(&path).filter(|stamp| stamp.is_older_than(started));
        Self { path, hash, stamp }
    }

    /// Whether the file still has its content; its stamp is brought up to date.
    pub fn holds(&mut self, started: SystemTime) -> bool {
        let now = Stamp::of(&self.path);
        if self.stamp.is_some() && self.stamp == now {
            return true;
        }
        let same = file_hash(&self.path).is_ok_and(|hash| hash == self.hash);
        if same {
            self.stamp = now.filter(|stamp| stamp.is_older_than(started));
        }
        same
    }
}

/// Hash of a regular file's content.
///
/// # Errors
/// It cannot be read, or is no regular file.
pub fn file_hash(path: &Path) -> std::io::Result<[u8; 32]> {
    crate::import::read_file(path).map(|bytes| content_hash(&bytes))
}

impl Output {
    /// Whether the package is still as it was written; its stamp is brought up to date. What the stamp does not
    /// tell, the hashes of all sections do.
    pub fn holds(&mut self, started: SystemTime) -> bool {
        let now = Stamp::of(&self.path);
        if self.stamp.is_some() && self.stamp == now {
            return true;
        }
        let sound = cairn_format::Package::open(&self.path).is_ok_and(|package| {
            package.header().content_hash == self.content_hash && package.verify().is_ok()
        });
        if sound {
            self.stamp = now.filter(|stamp| stamp.is_older_than(started));
        }
        sound
    }
}
