//! Makes only what changed: products of stages, kept under the hash of everything that decides their bytes.
//!
//! A stage asks a [`Session`] for its product and says what it is made of ([`Inputs`]) and how. The session looks
//! into the [`Store`], else makes and keeps it, and notes which of the two it was and why. At the end of a bake a
//! [`Manifest`] remembers all inputs and products: with it the next bake tells what changed, and a bake that would
//! change nothing is over once that is known.
//!
//! Nothing here decides bytes of a package. A cache that cannot be read or written costs time, never a bake.

mod fingerprint;
mod key;
mod manifest;
mod place;
mod stamp;
mod store;

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, MutexGuard};
use std::time::{Instant, SystemTime};

use rkyv::api::high::{HighDeserializer, HighSerializer, HighValidator};
use rkyv::bytecheck::CheckBytes;
use rkyv::rancor::BoxedError;
use rkyv::ser::allocator::ArenaHandle;
use rkyv::util::AlignedVec;
use serde::{Deserialize, Serialize};

use crate::diagnostic::Result;
use crate::report::Summary;

pub use key::{Inputs, Key, Kind, Part, content_hash, processor};
pub use manifest::{Dependency, Manifest, Output, file_hash};
pub use place::{Place, VARIABLE};
pub use stamp::Stamp;
pub use store::{Collected, Found, Status, Store};

/// A product that can be kept: anything that rkyv writes and reads back.
pub trait Product: Sized {
    fn to_bytes(&self) -> Option<AlignedVec>;
    /// `None` where the bytes are no such product.
    fn from_bytes(bytes: &[u8]) -> Option<Self>;
}

impl<T> Product for T
where
    T: rkyv::Archive
        + for<'a> rkyv::Serialize<HighSerializer<AlignedVec, ArenaHandle<'a>, BoxedError>>,
    T::Archived: for<'a> CheckBytes<HighValidator<'a, BoxedError>>
        + rkyv::Deserialize<T, HighDeserializer<BoxedError>>,
{
    fn to_bytes(&self) -> Option<AlignedVec> {
        rkyv::to_bytes::<BoxedError>(self).ok()
    }

    fn from_bytes(bytes: &[u8]) -> Option<Self> {
        rkyv::from_bytes::<T, BoxedError>(bytes).ok()
    }
}

/// Where a product came from, and why.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Outcome {
    pub kind: Kind,
    pub name: String,
    /// Whether it was in the cache.
    pub hit: bool,
    pub why: String,
    /// Looking for it, and making it where it was not there.
    pub seconds: f64,
    /// As stored.
    pub bytes: u64,
}

/// What the cache did for a bake.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Report {
    pub folder: PathBuf,
    /// Whether the output already was what the bake would have written.
    pub unchanged: bool,
    pub hits: u64,
    pub misses: u64,
    pub products: Vec<Outcome>,
    /// Why products could not be kept.
    pub problem: Option<String>,
}

/// The cache during one bake.
pub struct Session {
    store: Option<Store>,
    before: Option<Manifest>,
    started: SystemTime,
    state: Mutex<State>,
}

#[derive(Default)]
struct State {
    products: Vec<(Inputs, Outcome)>,
    problem: Option<String>,
    /// Keys of products that were not there before.
    made: BTreeSet<Key>,
}

impl Session {
    /// A session that keeps nothing and notes nothing.
    pub fn off() -> Self {
        Self {
            store: None,
            before: None,
            started: SystemTime::now(),
            state: Mutex::default(),
        }
    }

    /// A session on the cache in `folder`, for a bake of `scene` into `output`.
    pub fn open(folder: &Path, scene: &Path, output: &Path) -> Self {
        let store = Store::new(folder);
        let read = |path: &Path| Manifest::read(&store, &absolute(path));
        Self {
            before: read(output).or_else(|| read(scene)),
            store: Some(store),
            ..Self::off()
        }
    }

    /// The product of `inputs`: from the cache, or else from `make`, whose errors are nobody's but the caller's.
    ///
    /// # Errors
    /// Those of `make`.
    pub fn fetch<T: Product>(
        &self,
        inputs: impl FnOnce() -> Inputs,
        make: impl FnOnce() -> Result<T>,
    ) -> Result<T> {
        let Some(store) = &self.store else {
            return make();
        };
        let start = Instant::now();
        let inputs = inputs();
        let key = inputs.key();
        let found = match store.get(&key) {
            Found::Hit(bytes) => match T::from_bytes(&bytes) {
                Some(product) => {
                    let why = self.why_hit(&key);
                    self.note(inputs, true, why, start, bytes.len());
                    return Ok(product);
                }
                None => Found::Damaged,
            },
            other => other,
        };
        let product = make()?;
        let bytes = product.to_bytes().unwrap_or_default();
        if let Err(error) = store.put(&key, &bytes) {
            self.state().problem.get_or_insert(error.to_string());
        }
        self.state().made.insert(key);
        let why = self.why_missed(&inputs, &key, &found);
        self.note(inputs, false, why, start, bytes.len());
        Ok(product)
    }

    /// Whether products are kept at all.
    pub fn keeps(&self) -> bool {
        self.store.is_some()
    }

    /// Which products were hits so far, by name.
    #[cfg(test)]
    pub(crate) fn hits(&self) -> Vec<bool> {
        let state = self.state();
        let mut hits: Vec<(&str, bool)> = state
            .products
            .iter()
            .map(|(inputs, outcome)| (inputs.name.as_str(), outcome.hit))
            .collect();
        hits.sort_unstable();
        hits.into_iter().map(|(_, hit)| hit).collect()
    }

    /// Whether an entry is there, sound or not.
    pub fn holds(&self, inputs: &Inputs) -> bool {
        let store = self.store.as_ref();
        store.is_some_and(|store| store.holds(&inputs.key()))
    }

    fn note(&self, inputs: Inputs, hit: bool, why: String, start: Instant, bytes: usize) {
        let outcome = Outcome {
            kind: inputs.kind,
            name: inputs.name.clone(),
            hit,
            why,
            seconds: start.elapsed().as_secs_f64(),
            bytes: bytes as u64,
        };
        self.state().products.push((inputs, outcome));
    }

    fn why_hit(&self, key: &Key) -> String {
        if self.state().made.contains(key) {
            return "equal to another of this bake".into();
        }
        let known = self.before.as_ref().is_some_and(|before| {
            let mut products = before.products.iter();
            products.any(|product| product.key() == *key)
        });
        if known {
            "unchanged".into()
        } else {
            "made by another bake".into()
        }
    }

    fn why_missed(&self, inputs: &Inputs, key: &Key, found: &Found) -> String {
        if matches!(found, Found::Damaged) {
            return "its entry was damaged".into();
        }
        let Some(before) = &self.before else {
            return "no earlier bake of this output or scene is known".into();
        };
        let same = before
            .products
            .iter()
            .filter(|product| product.kind == inputs.kind && product.name == inputs.name);
        // Names need not be unique: the likest of the same name is taken for the same object.
        let differing = |product: &&Inputs| {
            let parts = product.parts.iter();
            parts.filter(|part| !inputs.parts.contains(part)).count()
        };
        match same.min_by_key(differing) {
            None => "new since the last bake".into(),
            Some(product) if product.key() == *key => "its entry is gone from the cache".into(),
            Some(product) => inputs.difference(product),
        }
    }

    fn state(&self) -> MutexGuard<'_, State> {
        self.state
            .lock()
            .unwrap_or_else(|poisoned| poisoned.into_inner())
    }

    /// The summary of the bake that wrote the output, where that is still what `request` would write: no file that
    /// it depends on, no setting and no code changed, nor did the output.
    pub fn unchanged(&self, request: &Inputs, output: &Path) -> Option<Summary> {
        let store = self.store.as_ref()?;
        let mut manifest = self.before.clone()?;
        let before = manifest.clone();
        let started = self.started;
        let mut dependencies = manifest.dependencies.iter_mut();
        let summary = before.summary()?;
        // It may be what is remembered of the scene, baked into another package.
        let holds = manifest.output.path == absolute(output)
            && manifest.request == *request
            && dependencies.all(|dependency| dependency.holds(started))
            && manifest.output.holds(started);
        if !holds {
            return None;
        }
        if manifest.dependencies != before.dependencies || manifest.output != before.output {
            // Only the next time's speed depends on it.
            let _ = manifest.write(store, &[&manifest.output.path]);
        }
        let outcome = |product: &Inputs| Outcome {
            kind: product.kind,
            name: product.name.clone(),
            hit: true,
            why: "unchanged".into(),
            seconds: 0.0,
            bytes: 0,
        };
        let products: Vec<Outcome> = manifest.products.iter().map(outcome).collect();
        Some(Summary {
            cache: Some(Report {
                folder: store.root().to_owned(),
                unchanged: true,
                hits: products.len() as u64,
                misses: 0,
                products,
                problem: None,
            }),
            ..summary
        })
    }

    /// Remembers a finished bake, and adds what the cache did to its summary.
    pub fn finish(
        self,
        request: Inputs,
        scene: &Path,
        files: impl IntoIterator<Item = (PathBuf, [u8; 32])>,
        (output, content_hash): (&Path, [u8; 32]),
        summary: &mut Summary,
    ) {
        let Some(store) = self.store else { return };
        store.sweep();
        let mut state = self
            .state
            .into_inner()
            .unwrap_or_else(|poisoned| poisoned.into_inner());
        // Threads note them as they come.
        state
            .products
            .sort_by_cached_key(|(inputs, _)| (inputs.kind, inputs.name.clone(), inputs.key()));
        let (products, outcomes): (Vec<Inputs>, Vec<Outcome>) = state.products.into_iter().unzip();
        let output = absolute(output);
        let scene = absolute(scene);
        let dependency =
            |(path, hash): (PathBuf, _)| Dependency::new(absolute(&path), hash, self.started);
        let written = Output {
            path: output.clone(),
            content_hash,
            stamp: None,
        };
        let dependencies = files.into_iter().map(dependency).collect();
        let manifest = Manifest::new(request, dependencies, written, products, summary);
        let written = manifest.write(&store, &[&output, &scene]);
        let problem = state
            .problem
            .or_else(|| written.err().map(|error| error.to_string()));
        let hits = outcomes.iter().filter(|outcome| outcome.hit).count() as u64;
        summary.cache = Some(Report {
            folder: store.root().to_owned(),
            unchanged: false,
            hits,
            misses: outcomes.len() as u64 - hits,
            products: outcomes,
            problem,
        });
    }
}

/// The path from the root of the file system, with links followed where it exists.
pub fn absolute(path: &Path) -> PathBuf {
    let canonical = path.canonicalize().or_else(|_| {
        let folder = crate::temporary::folder_of(path).canonicalize()?;
        Ok::<_, std::io::Error>(folder.join(path.file_name().unwrap_or_default()))
    });
    canonical.unwrap_or_else(|_| path.to_owned())
}

#[cfg(test)]
mod tests;
