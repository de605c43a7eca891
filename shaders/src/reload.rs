//! Shaders that change while the program runs: a watch over their folder, and the SPIR-V that stands in for what is
//! embedded.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use std::sync::{Arc, PoisonError, RwLock};
use std::time::SystemTime;
use std::{env, fs, process};

use crate::compile::{compile_all, files, find_compiler, is_entry};
use crate::{ALL, Shader};

/// SPIR-V by the shader's name; `None` is the embedded one.
pub type Replacements = BTreeMap<&'static str, Option<Arc<[u32]>>>;

static CURRENT: RwLock<Replacements> = RwLock::new(BTreeMap::new());

/// What stands in for the words of an embedded shader, which are known by their place.
pub fn current(embedded: &[u32]) -> Option<Arc<[u32]>> {
    let shader = ALL
        .iter()
        .find(|shader| std::ptr::eq(shader.spirv, embedded))?;
    let current = CURRENT.read().unwrap_or_else(PoisonError::into_inner);
    current.get(shader.name).cloned().flatten()
}

/// Puts shaders in the place of others, and returns those.
pub fn replace(shaders: Replacements) -> Replacements {
    let mut current = CURRENT.write().unwrap_or_else(PoisonError::into_inner);
    let put = |(name, words)| (name, current.insert(name, words).flatten());
    shaders.into_iter().map(put).collect()
}

/// When a file was written, and its length.
type Stamp = (SystemTime, u64);

/// Watches a copy of this crate's folder by the times of its files.
#[derive(Debug)]
pub struct Watch {
    root: PathBuf,
    stamps: BTreeMap<PathBuf, Stamp>,
    /// Entry points that changed and did not compile since.
    pending: BTreeSet<PathBuf>,
    /// Gets the SPIR-V.
    out: PathBuf,
}

impl Watch {
    /// Watches `CAIRN_SHADERS`, or else the folder that this crate was built from.
    ///
    /// # Errors
    /// As [`Watch::new`].
    pub fn from_environment() -> Result<Self, String> {
        let named = env::var_os("CAIRN_SHADERS").map(PathBuf::from);
        Self::new(&named.unwrap_or_else(|| env!("CARGO_MANIFEST_DIR").into()))
    }

    /// Watches `root` for changes from now on.
    ///
    /// # Errors
    /// A folder that is not there; no folder for temporary files.
    pub fn new(root: &Path) -> Result<Self, String> {
        let out = env::temp_dir().join(format!("cairn-shaders-{}", process::id()));
        let stamps = stamps(root)
            .map_err(|error| format!("{error}; set CAIRN_SHADERS to the shaders' folder"))?;
        fs::create_dir(&out).map_err(|error| format!("{}: {error}", out.display()))?;
        Ok(Self {
            root: root.to_owned(),
            stamps,
            pending: BTreeSet::new(),
            out,
        })
    }

    /// Compiles what changed since the last call, and what failed then; `None` where nothing changed. A change of
    /// an included file concerns every entry point.
    ///
    /// # Errors
    /// The compiler's messages, as `file:line: message`.
    pub fn poll(&mut self) -> Result<Option<Replacements>, String> {
        let now = stamps(&self.root)?;
        let changed = |path: &&PathBuf| self.stamps.get(*path) != now.get(*path);
        let changed: Vec<PathBuf> = now.keys().filter(changed).cloned().collect();
        let all = changed.iter().any(|path| !is_entry(path));
        self.pending
            .extend(changed.iter().filter(|path| known(path).is_some()).cloned());
        if all {
            let entries = now.keys().filter(|path| known(path).is_some());
            self.pending.extend(entries.cloned());
        }
        self.pending.retain(|path| now.contains_key(path));
        self.stamps = now;
        if changed.is_empty() || self.pending.is_empty() {
            return Ok(None);
        }
        let sources: Vec<PathBuf> = self.pending.iter().cloned().collect();
        let compiled = compile_all(&find_compiler()?, &self.root, &sources, &self.out)?;
        let mut shaders = Replacements::new();
        for shader in compiled {
            eprint!("{}", shader.warnings);
            let Some(entry) = known(&shader.source) else {
                continue;
            };
            let bytes = fs::read(&shader.spirv)
                .map_err(|error| format!("{}: {error}", shader.spirv.display()))?;
            let (words, _) = bytes.as_chunks();
            let words = words.iter().map(|word| u32::from_le_bytes(*word)).collect();
            shaders.insert(entry.name, Some(words));
        }
        self.pending.clear();
        Ok(Some(shaders))
    }
}

impl Drop for Watch {
    fn drop(&mut self) {
        // What cannot be removed lies among the system's temporary files.
        let _ = fs::remove_dir_all(&self.out);
    }
}

/// The embedded shader of a source; entry points that are new have no use yet.
fn known(path: &Path) -> Option<&'static Shader> {
    let name = path.file_name()?.to_str()?;
    ALL.iter().copied().find(|shader| shader.name == name)
}

fn stamps(root: &Path) -> Result<BTreeMap<PathBuf, Stamp>, String> {
    // A file that an editor is just replacing is looked at next time.
    let stamp = |path: PathBuf| {
        let data = fs::metadata(&path).ok()?;
        Some((path, (data.modified().ok()?, data.len())))
    };
    Ok(files(root)?.into_iter().filter_map(stamp).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shaders_are_known_by_their_place() {
        for shader in ALL {
            let other = |other: &&&Shader| std::ptr::eq(other.spirv, shader.spirv);
            assert_eq!(ALL.iter().filter(other).count(), 1, "{}", shader.name);
        }
    }
}
