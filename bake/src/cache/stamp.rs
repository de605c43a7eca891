//! When a file was changed last: what spares reading it again.

use std::path::Path;
use std::time::{Duration, SystemTime};

use serde::{Deserialize, Serialize};

/// Coarsest clock of a file system in use (FAT): what changed so shortly before it was read may have changed again
/// without a trace.
const GRANULARITY: Duration = Duration::from_secs(2);

/// What a file system says of a file. Equal stamps, both older than the reading, mean equal content. The time of the
/// last change of the inode cannot be set back, unlike that of the content.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Stamp {
    pub bytes: u64,
    /// Nanoseconds since 1970.
    pub modified: i64,
    /// Nanoseconds since 1970.
    pub changed: i64,
    pub device: u64,
    pub inode: u64,
}

impl Stamp {
    /// The stamp of a file; `None` where the file or its system gives none.
    #[cfg(unix)]
    pub fn of(path: &Path) -> Option<Self> {
        use std::os::unix::fs::MetadataExt;
        let metadata = std::fs::metadata(path).ok()?;
        let nanoseconds =
            |seconds: i64, rest: i64| seconds.saturating_mul(1_000_000_000).saturating_add(rest);
        Some(Self {
            bytes: metadata.len(),
            modified: nanoseconds(metadata.mtime(), metadata.mtime_nsec()),
            changed: nanoseconds(metadata.ctime(), metadata.ctime_nsec()),
            device: metadata.dev(),
            inode: metadata.ino(),
        })
    }

    /// Without a time of the last change there is no stamp to trust: contents are hashed every time.
    #[cfg(not(unix))]
    pub fn of(_path: &Path) -> Option<Self> {
        None
    }

    /// Whether the file lay still when it was read at `time` or later.
    pub fn is_older_than(&self, time: SystemTime) -> bool {
        let Ok(since) = time.duration_since(SystemTime::UNIX_EPOCH) else {
            return false;
        };
        let latest = since.saturating_sub(GRANULARITY).as_nanos() as i64;
        self.changed < latest && self.modified < latest
    }
}

#[cfg(all(test, unix))]
mod tests {
    use super::*;

    #[test]
    fn a_stamp_follows_the_file() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("a");
        assert_eq!(Stamp::of(&path), None);
        std::fs::write(&path, b"one").expect("written");
        let first = Stamp::of(&path).expect("a stamp");
        assert_eq!(Stamp::of(&path), Some(first));
        // Same length, same time of modification, another file.
        let other = folder.path().join("b");
        std::fs::write(&other, b"two").expect("written");
        let modified = std::fs::metadata(&path).and_then(|metadata| metadata.modified());
        let file = std::fs::File::options()
            .write(true)
            .open(&other)
            .expect("a file");
        file.set_modified(modified.expect("a time")).expect("set");
        std::fs::rename(&other, &path).expect("renamed");
        assert_ne!(Stamp::of(&path), Some(first));
    }

    #[test]
    fn what_is_young_is_not_trusted() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("a");
        std::fs::write(&path, b"one").expect("written");
        let stamp = Stamp::of(&path).expect("a stamp");
        let now = SystemTime::now();
        assert!(!stamp.is_older_than(now));
        assert!(stamp.is_older_than(now + 2 * GRANULARITY));
    }
}
