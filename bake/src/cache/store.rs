//! The folder of entries: one file a product, named after its key, checked whenever it is read.
//!
//! ```text
//! CACHEDIR.TAG
//! entries/ab/abcdef…   magic, key, length, BLAKE3 of the content, content
//! bakes/…              what earlier bakes read and made: see `manifest`
//! temporary/           files that are being written
//! ```
//!
//! An entry appears by a rename and never changes, so any number of processes may share a folder.

use std::fs::{self, File};
use std::io::{self, Read, Write};
use std::path::{Path, PathBuf};
use std::time::{Duration, SystemTime};

use rkyv::util::AlignedVec;

use super::key::{Key, content_hash};
use crate::temporary::{self, Temporary};

const MAGIC: [u8; 8] = *b"CAIRNCE1";
const HEAD: usize = 80;
/// Uses of an entry within this time of the last are not noted.
const USE_STEP: Duration = Duration::from_secs(60 * 60);
/// <https://bford.info/cachedir/>: tells backups that nothing here is worth keeping.
const TAG: &str = "Signature: 8a477f597d28d172789f06886806bc55\n# Products of cairn-bake; `cairn-bake cache gc` makes it smaller.\n";

/// A cache folder.
#[derive(Clone, Debug)]
pub struct Store {
    root: PathBuf,
}

/// What became of a look into the store.
#[derive(Debug)]
pub enum Found {
    Hit(AlignedVec),
    Absent,
    /// The entry was not what it should be, and is gone.
    Damaged,
}

/// What a store holds.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize)]
pub struct Status {
    pub entries: u64,
    pub entry_bytes: u64,
    /// Bakes that are remembered.
    pub bakes: u64,
    pub bake_bytes: u64,
}

/// What was taken out of a store.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize)]
pub struct Collected {
    pub files: u64,
    pub bytes: u64,
    /// What dead processes had left.
    pub temporary: u64,
}

/// A file of the store.
struct Item {
    path: PathBuf,
    bytes: u64,
    used: SystemTime,
}

impl Store {
    /// The store in `root`, which need not exist yet.
    pub fn new(root: impl Into<PathBuf>) -> Self {
        Self { root: root.into() }
    }

    /// The folder.
    pub fn root(&self) -> &Path {
        &self.root
    }

    fn entry(&self, key: &Key) -> PathBuf {
        let name = key.to_string();
        self.root.join("entries").join(&name[..2]).join(name)
    }

    /// Where what is remembered of a bake lies.
    pub fn bake(&self, name: &str) -> PathBuf {
        self.root.join("bakes").join(name)
    }

    /// Whether there is an entry, sound or not.
    pub fn holds(&self, key: &Key) -> bool {
        self.entry(key).is_file()
    }

    /// The content under `key`. An entry that is cut, changed or misplaced is removed.
    pub fn get(&self, key: &Key) -> Found {
        let path = self.entry(key);
        let Ok(mut file) = File::open(&path) else {
            return Found::Absent;
        };
        let Some(content) = read_entry(&mut file, key) else {
            let _ = fs::remove_file(&path);
            return Found::Damaged;
        };
        note_use(&file);
        Found::Hit(content)
    }

    /// Stores `content` under `key`.
    ///
    /// # Errors
    /// The folder cannot be made or written.
    pub fn put(&self, key: &Key, content: &[u8]) -> io::Result<()> {
        let head = [
            &MAGIC[..],
            &key.0,
            &(content.len() as u64).to_le_bytes(),
            &content_hash(content),
        ];
        self.write(&self.entry(key), &[&head.concat(), content])
    }

    /// Writes a file of the store whole or not at all.
    ///
    /// # Errors
    /// The folder cannot be made or written.
    pub fn write(&self, path: &Path, parts: &[&[u8]]) -> io::Result<()> {
        let workshop = self.workshop();
        if !workshop.is_dir() {
            fs::create_dir_all(&workshop)?;
            fs::write(self.root.join("CACHEDIR.TAG"), TAG)?;
        }
        fs::create_dir_all(temporary::folder_of(path))?;
        let temporary = Temporary::create(&workshop)?;
        for part in parts {
            temporary.file().write_all(part)?;
        }
        temporary.publish(path)
    }

    /// Removes what dead processes left; returns how many files.
    pub fn sweep(&self) -> u64 {
        temporary::sweep(&self.workshop())
    }

    fn workshop(&self) -> PathBuf {
        self.root.join("temporary")
    }

    /// Counts what is there.
    ///
    /// # Errors
    /// A folder that cannot be read; an absent one is empty.
    pub fn status(&self) -> io::Result<Status> {
        let [entries, bakes] = [self.entries()?, self.bakes()?];
        let bytes = |items: &[Item]| items.iter().map(|item| item.bytes).sum();
        Ok(Status {
            entries: entries.len() as u64,
            entry_bytes: bytes(&entries),
            bakes: bakes.len() as u64,
            bake_bytes: bytes(&bakes),
        })
    }

    /// Removes what was used longest ago until `most` bytes are left, and what dead processes left behind.
    ///
    /// # Errors
    /// A folder that cannot be read. A file that cannot be removed stays and counts.
    pub fn collect(&self, most: u64) -> io::Result<Collected> {
        let mut items = self.entries()?;
        items.extend(self.bakes()?);
        // By path where times are equal, so that the same folder is always emptied in the same order.
        items.sort_by(|a, b| (a.used, &a.path).cmp(&(b.used, &b.path)));
        let mut left: u64 = items.iter().map(|item| item.bytes).sum();
        let mut collected = Collected {
            temporary: self.sweep(),
            ..Collected::default()
        };
        for item in items {
            if left <= most {
                break;
            }
            if fs::remove_file(&item.path).is_ok() {
                left -= item.bytes;
                collected.files += 1;
                collected.bytes += item.bytes;
            }
        }
        Ok(collected)
    }

    /// Reads every entry and removes the damaged ones; returns how many were sound and how many not.
    ///
    /// # Errors
    /// A folder that cannot be read.
    pub fn check(&self) -> io::Result<[u64; 2]> {
        let mut counts = [0; 2];
        for item in self.entries()? {
            let sound = key_of(&item.path).is_some_and(|key| {
                let file = File::open(&item.path);
                file.is_ok_and(|mut file| read_entry(&mut file, &key).is_some())
            });
            counts[usize::from(!sound)] += 1;
            if !sound {
                let _ = fs::remove_file(&item.path);
            }
        }
        Ok(counts)
    }

    fn entries(&self) -> io::Result<Vec<Item>> {
        let mut items = Vec::new();
        for folder in list(&self.root.join("entries"))? {
            items.extend(files(&folder)?);
        }
        Ok(items)
    }

    fn bakes(&self) -> io::Result<Vec<Item>> {
        files(&self.root.join("bakes"))
    }
}

fn key_of(path: &Path) -> Option<Key> {
    let name = path.file_name()?.to_str()?;
    Some(Key(*blake3::Hash::from_hex(name).ok()?.as_bytes()))
}

fn read_entry(file: &mut File, key: &Key) -> Option<AlignedVec> {
    let length = file.metadata().ok()?.len();
    let mut head = [0; HEAD];
    file.read_exact(&mut head).ok()?;
    let (magic, rest) = head.split_at(MAGIC.len());
    let (name, rest) = rest.split_at(key.0.len());
    let (count, hash) = rest.split_at(size_of::<u64>());
    let count = u64::from_le_bytes(count.try_into().ok()?);
    if magic != MAGIC || name != key.0 || count.checked_add(HEAD as u64)? != length {
        return None;
    }
    let mut content = AlignedVec::new();
    content.resize(usize::try_from(count).ok()?, 0);
    file.read_exact(&mut content).ok()?;
    (content_hash(&content) == hash).then_some(content)
}

/// Remembers that an entry was used, for [`Store::collect`]. On a read-only file system it is not remembered.
fn note_use(file: &File) {
    let recent = file
        .metadata()
        .and_then(|metadata| metadata.modified())
        .is_ok_and(|used| used.elapsed().is_ok_and(|age| age < USE_STEP));
    if !recent {
        let _ = file.set_modified(SystemTime::now());
    }
}

/// What lies in a folder; nothing where there is none.
fn list(folder: &Path) -> io::Result<Vec<PathBuf>> {
    match fs::read_dir(folder) {
        Ok(entries) => entries.map(|entry| Ok(entry?.path())).collect(),
        Err(error) if error.kind() == io::ErrorKind::NotFound => Ok(Vec::new()),
        Err(error) => Err(error),
    }
}

/// The files of a folder. Others may remove some meanwhile.
fn files(folder: &Path) -> io::Result<Vec<Item>> {
    let item = |path: PathBuf| {
        let metadata = fs::metadata(&path).ok()?;
        metadata.is_file().then(|| Item {
            bytes: metadata.len(),
            used: metadata.modified().unwrap_or(SystemTime::UNIX_EPOCH),
            path,
        })
    };
    Ok(list(folder)?.into_iter().filter_map(item).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn key(number: u8) -> Key {
        Key([number; 32])
    }

    fn store() -> (tempfile::TempDir, Store) {
        let folder = tempfile::tempdir().expect("a folder");
        let store = Store::new(folder.path().join("cache"));
        (folder, store)
    }

    fn content(store: &Store, number: u8) -> Option<Vec<u8>> {
        match store.get(&key(number)) {
            Found::Hit(content) => Some(content.to_vec()),
            Found::Absent => None,
            Found::Damaged => panic!("entry {number} is damaged"),
        }
    }

    #[test]
    fn what_was_put_is_got() {
        let (_folder, store) = store();
        assert_eq!(store.status().expect("a status"), Status::default());
        assert_eq!(content(&store, 1), None);
        for bytes in [&b""[..], b"one", &[7; 3 << 20]] {
            store.put(&key(1), bytes).expect("stored");
            assert_eq!(content(&store, 1).as_deref(), Some(bytes));
        }
        store.put(&key(2), b"two").expect("stored");
        let status = store.status().expect("a status");
        assert_eq!((status.entries, status.bakes), (2, 0));
        assert_eq!(status.entry_bytes, (3 << 20) + 3 + 2 * HEAD as u64);
        assert_eq!(store.check().expect("checked"), [2, 0]);
    }

    #[test]
    fn any_damage_is_noticed_once() {
        let (_folder, store) = store();
        store.put(&key(1), b"some content").expect("stored");
        let path = store.entry(&key(1));
        let sound = fs::read(&path).expect("an entry");
        let mut damaged: Vec<Vec<u8>> = (0..sound.len()).map(|end| sound[..end].to_vec()).collect();
        damaged.extend((0..sound.len()).map(|place| {
            let mut bytes = sound.clone();
            bytes[place] ^= 0x10;
            bytes
        }));
        damaged.push([&sound[..], b"more"].concat());
        for bytes in damaged {
            fs::write(&path, &bytes).expect("written");
            assert!(matches!(store.get(&key(1)), Found::Damaged), "{bytes:?}");
            assert!(matches!(store.get(&key(1)), Found::Absent), "{bytes:?}");
        }
        // An entry under a name that is not its own.
        fs::write(&path, &sound).expect("written");
        fs::create_dir_all(store.entry(&key(2)).parent().expect("a folder")).expect("made");
        fs::rename(&path, store.entry(&key(2))).expect("moved");
        assert_eq!(store.check().expect("checked"), [0, 1]);
        assert_eq!(store.status().expect("a status").entries, 0);
    }

    #[test]
    fn what_was_used_last_stays() {
        let (_folder, store) = store();
        let day = Duration::from_secs(24 * 60 * 60);
        for number in 1..=4 {
            store.put(&key(number), &[number; 100]).expect("stored");
            let file = File::options()
                .write(true)
                .open(store.entry(&key(number)))
                .expect("an entry");
            file.set_modified(SystemTime::now() - day * u32::from(10 - number))
                .expect("a time");
        }
        // Reading it makes the oldest the youngest.
        assert!(content(&store, 1).is_some());
        let collected = store.collect(2 * (100 + HEAD as u64)).expect("collected");
        assert_eq!(
            (collected.files, collected.bytes),
            (2, 2 * (100 + HEAD as u64))
        );
        let left: Vec<u8> = (1..=4)
            .filter(|number| content(&store, *number).is_some())
            .collect();
        assert_eq!(left, [1, 4]);
        store.collect(0).expect("collected");
        assert_eq!(store.status().expect("a status"), Status::default());
    }

    #[test]
    fn many_may_write_and_read_at_once() {
        let (_folder, store) = store();
        std::thread::scope(|scope| {
            for thread in 0..4u8 {
                let store = &store;
                scope.spawn(move || {
                    for round in 0..20u8 {
                        let number = (round + thread) % 5;
                        store.put(&key(number), &[number; 5000]).expect("stored");
                        let found = content(store, number).expect("it was stored");
                        assert_eq!(found, [number; 5000]);
                    }
                });
            }
        });
        assert_eq!(store.check().expect("checked"), [5, 0]);
    }
}
