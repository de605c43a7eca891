//! Files that take their name only when they are whole, and leave nothing behind when they do not get there.

use std::fs::File;
use std::io;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, MutexGuard};
use std::time::Duration;

use tempfile::NamedTempFile;

const PREFIX: &str = ".cairn-";
const SUFFIX: &str = ".tmp";
/// A file younger than this may not have been locked yet.
const YOUNG: Duration = Duration::from_secs(10);
/// Where locks say nothing, only age does.
const ABANDONED: Duration = Duration::from_secs(24 * 60 * 60);

/// Paths of the temporary files of this process.
static ALIVE: Mutex<Vec<PathBuf>> = Mutex::new(Vec::new());

fn alive() -> MutexGuard<'static, Vec<PathBuf>> {
    ALIVE
        .lock()
        .unwrap_or_else(|poisoned| poisoned.into_inner())
}

/// A file under a name of its own, in the folder where it shall stay. Dropped, it is removed; a process that dies
/// leaves it to [`sweep`].
pub struct Temporary {
    file: Option<NamedTempFile>,
    path: PathBuf,
}

impl Temporary {
    /// Creates a file in `folder`, as readable as the user's other files.
    ///
    /// # Errors
    /// The folder is absent or cannot be written.
    pub fn create(folder: &Path) -> io::Result<Self> {
        let mut builder = tempfile::Builder::new();
        builder.prefix(PREFIX).suffix(SUFFIX);
        #[cfg(unix)]
        builder.permissions(std::os::unix::fs::PermissionsExt::from_mode(0o666));
        // Under the lock, so that no file comes into being behind the back of `remove_all`.
        let mut alive = alive();
        let file = builder.tempfile_in(folder)?;
        // The lock says that the file is alive; it ends with this process. Where there are no locks, age decides.
        #[cfg(unix)]
        let _ = file.as_file().try_lock();
        let path = file.path().to_owned();
        alive.push(path.clone());
        Ok(Self {
            file: Some(file),
            path,
        })
    }

    /// The open file.
    pub fn file(&self) -> &File {
        self.file
            .as_ref()
            .expect("it is there until `publish` takes it")
            .as_file()
    }

    /// Where it is for now.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Syncs the file and gives it its name, replacing what had it: readers see the old file or the new one. The
    /// name survives a crash too once its folder is synced, which this does.
    ///
    /// # Errors
    /// What the system says; the old file is then as it was.
    pub fn publish(mut self, path: &Path) -> io::Result<()> {
        self.file().sync_all()?;
        {
            let _alive = alive();
            let file = self.file.take().expect("`publish` is called once");
            file.persist(path).map_err(|error| error.error)?;
        }
        sync_folder(folder_of(path))
    }
}

impl Drop for Temporary {
    fn drop(&mut self) {
        let mut alive = alive();
        drop(self.file.take());
        alive.retain(|path| *path != self.path);
    }
}

/// Removes every temporary file of this process, and then leaves it with `code`. Threads that would make or name a
/// file meanwhile wait for ever.
pub fn remove_all_and_exit(code: i32) -> ! {
    let alive = alive();
    for path in alive.iter() {
        // It may have been renamed already, or its folder be gone.
        let _ = std::fs::remove_file(path);
    }
    std::process::exit(code)
}

/// Removes what dead processes left in `folder`; returns how many files.
pub fn sweep(folder: &Path) -> u64 {
    let Ok(entries) = std::fs::read_dir(folder) else {
        return 0;
    };
    let stale = entries.flatten().filter(|entry| {
        let name = entry.file_name();
        let name = name.to_string_lossy();
        name.starts_with(PREFIX) && name.ends_with(SUFFIX) && is_abandoned(&entry.path())
    });
    stale
        .filter(|entry| std::fs::remove_file(entry.path()).is_ok())
        .count() as u64
}

fn is_abandoned(path: &Path) -> bool {
    let age = std::fs::metadata(path)
        .and_then(|metadata| metadata.modified())
        .ok()
        .and_then(|modified| modified.elapsed().ok());
    let Some(age) = age else { return false };
    if cfg!(unix) && age > YOUNG {
        let opened = File::options().read(true).write(true).open(path);
        if let Ok(file) = opened {
            return file.try_lock().is_ok();
        }
    }
    age > ABANDONED
}

/// The folder that a file lies in.
pub fn folder_of(path: &Path) -> &Path {
    path.parent()
        .filter(|folder| !folder.as_os_str().is_empty())
        .unwrap_or(Path::new("."))
}

#[cfg(unix)]
fn sync_folder(folder: &Path) -> io::Result<()> {
    File::open(folder)?.sync_all()
}

#[cfg(not(unix))]
fn sync_folder(_folder: &Path) -> io::Result<()> {
    Ok(())
}

#[cfg(test)]
mod tests {
    use std::io::Write;

    use super::*;

    fn names(folder: &Path) -> Vec<String> {
        let mut names: Vec<String> = std::fs::read_dir(folder)
            .expect("a folder")
            .map(|entry| {
                let entry = entry.expect("an entry");
                entry.file_name().to_string_lossy().into_owned()
            })
            .collect();
        names.sort();
        names
    }

    #[test]
    fn a_file_appears_whole_or_not_at_all() {
        let folder = tempfile::tempdir().expect("a folder");
        let wanted = folder.path().join("out");
        let temporary = Temporary::create(folder.path()).expect("a file");
        temporary.file().write_all(b"half").expect("written");
        assert!(!wanted.exists());
        drop(temporary);
        assert!(names(folder.path()).is_empty());

        let temporary = Temporary::create(folder.path()).expect("a file");
        temporary.file().write_all(b"whole").expect("written");
        temporary.publish(&wanted).expect("published");
        assert_eq!(std::fs::read(&wanted).expect("a file"), b"whole");
        assert_eq!(names(folder.path()), ["out"]);
    }

    #[test]
    fn a_name_that_cannot_be_taken_leaves_nothing() {
        let folder = tempfile::tempdir().expect("a folder");
        let wanted = folder.path().join("folder");
        std::fs::create_dir(&wanted).expect("a folder");
        let temporary = Temporary::create(folder.path()).expect("a file");
        assert!(temporary.publish(&wanted).is_err());
        assert_eq!(names(folder.path()), ["folder"]);
    }

    #[cfg(unix)]
    #[test]
    fn only_what_dead_processes_left_is_swept() {
        let folder = tempfile::tempdir().expect("a folder");
        let old = std::time::SystemTime::now() - 2 * YOUNG;
        let write = |name: &str| {
            let file = File::create(folder.path().join(name)).expect("a file");
            file.set_modified(old).expect("a time");
            file
        };
        drop(write(".cairn-dead.tmp"));
        drop(write("cairn-other.tmp"));
        let young = File::create(folder.path().join(".cairn-young.tmp")).expect("a file");
        drop(young);
        let alive = Temporary::create(folder.path()).expect("a file");
        alive.file().set_modified(old).expect("a time");
        assert_eq!(sweep(folder.path()), 1);
        let left = names(folder.path());
        assert_eq!(left.len(), 3, "{left:?}");
        assert!(!left.contains(&".cairn-dead.tmp".to_owned()), "{left:?}");
    }
}
