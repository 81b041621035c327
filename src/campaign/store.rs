//! Sheets on disk: one file per unit, named by its key; and content hashes of files that have not changed since.

use hydroline_log::held;
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};
use sha2::{Digest, Sha256};
use std::collections::BTreeMap;
use std::io::{BufWriter, Read, Write};
use std::path::{Path, PathBuf};
use std::time::UNIX_EPOCH;

/// Hexadecimal digits of a key: 2^64 of them make two alike once in some thousand million sheets.
const KEY_DIGITS: usize = 16;
/// Bytes read at a time.
const BLOCK_BYTES: usize = 1 << 20;
/// Name of the file with the content hashes.
const HASHES: &str = "hashes.json";

/// Why the store could not be used.
#[derive(Debug, thiserror::Error)]
#[allow(missing_docs)] // Each message names its fields.
pub enum StoreError {
    /// A file of the store or a log.
    #[error("{path}: {source}; check that the folder is writable and the disk has room")]
    File {
        path: PathBuf,
        source: std::io::Error,
    },
    #[error("{path}: {source}; the file was changed while it was read: run `campaign` again")]
    Json {
        path: PathBuf,
        source: serde_json::Error,
    },
}

/// Hash of the inputs of a key, part by part; parts cannot run into each other.
#[derive(Debug, Clone)]
pub struct Key(Sha256);

impl Key {
    /// Of a kind of unit.
    pub fn of(kind: &str) -> Self {
        Self(Sha256::new()).with(kind)
    }

    /// With one more input.
    #[must_use]
    pub fn with(mut self, part: &str) -> Self {
        self.0.update((part.len() as u64).to_le_bytes());
        self.0.update(part.as_bytes());
        self
    }

    /// As a name.
    pub fn name(self) -> String {
        hex(&self.0.finalize())
    }
}

fn hex(digest: &[u8]) -> String {
    let all: String = digest.iter().map(|b| format!("{b:02x}")).collect();
    all.chars().take(KEY_DIGITS).collect()
}

/// Size and time of change, by which a file's content is known without reading it, and its hash.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
struct Seen {
    bytes: u64,
    modified_ns: u64,
    hash: String,
}

/// A folder of sheets.
#[derive(Debug)]
pub struct Store {
    folder: PathBuf,
    /// By absolute path.
    hashes: BTreeMap<String, Seen>,
}

impl Store {
    /// Opens or makes the folder.
    ///
    /// # Errors
    /// [`StoreError::File`].
    pub fn open(folder: &Path) -> Result<Self, StoreError> {
        let sheets = folder.join("sheets");
        std::fs::create_dir_all(&sheets).map_err(file(&sheets))?;
        let poses = folder.join("poses");
        std::fs::create_dir_all(&poses).map_err(file(&poses))?;
        // Hashes that cannot be read are computed anew.
        let hashes = std::fs::read(folder.join(HASHES))
            .ok()
            .and_then(|bytes| serde_json::from_slice(&bytes).ok())
            .unwrap_or_default();
        Ok(Self {
            folder: folder.to_owned(),
            hashes,
        })
    }

    /// Where the sheet of a key stands.
    pub fn sheet_path(&self, key: &str) -> PathBuf {
        self.folder.join("sheets").join(format!("{key}.json"))
    }

    /// Where the poses of a log stand that a replay made.
    pub fn poses_path(&self, key: &str) -> PathBuf {
        self.folder.join("poses").join(format!("{key}.mcap"))
    }

    /// A sheet that is there and whole.
    pub fn get<T: DeserializeOwned>(&self, key: &str) -> Option<T> {
        let bytes = std::fs::read(self.sheet_path(key)).ok()?;
        serde_json::from_slice(&bytes).ok()
    }

    /// Writes a sheet, whole or not at all.
    ///
    /// # Errors
    /// [`StoreError`].
    pub fn put<T: Serialize>(&self, key: &str, sheet: &T) -> Result<(), StoreError> {
        write_whole(&self.sheet_path(key), |out| {
            Ok(serde_json::to_writer(out, sheet)?)
        })
    }

    /// Hash of a file's content. A file of the same size and time of change as before is not read again.
    ///
    /// # Errors
    /// [`StoreError::File`].
    pub fn hash(&mut self, path: &Path) -> Result<String, StoreError> {
        let meta = std::fs::metadata(path).map_err(file(path))?;
        if !meta.is_file() {
            // A pipe or a device would be waited for without end.
            return Err(file(path)(std::io::Error::new(
                std::io::ErrorKind::InvalidInput,
                "no file with a log in it",
            )));
        }
        let since = meta
            .modified()
            .ok()
            .and_then(|t| t.duration_since(UNIX_EPOCH).ok());
        let modified_ns = since.map_or(0, |t| u64::try_from(t.as_nanos()).unwrap_or(u64::MAX));
        let name = std::path::absolute(path)
            .unwrap_or_else(|_| path.to_owned())
            .display()
            .to_string();
        if let Some(seen) = self.hashes.get(&name)
            && (seen.bytes, seen.modified_ns) == (meta.len(), modified_ns)
            && modified_ns > 0
        {
            return Ok(seen.hash.clone());
        }
        let hash = content_hash(path).map_err(file(path))?;
        let seen = Seen {
            bytes: meta.len(),
            modified_ns,
            hash: hash.clone(),
        };
        self.hashes.insert(name, seen);
        Ok(hash)
    }

    /// Keeps the hashes for the next time.
    ///
    /// # Errors
    /// [`StoreError`].
    pub fn keep_hashes(&self) -> Result<(), StoreError> {
        let path = self.folder.join(HASHES);
        let json = serde_json::to_vec(&self.hashes).map_err(|e| file(&path)(e.into()))?;
        if std::fs::read(&path).is_ok_and(|now| now == json) {
            return Ok(());
        }
        write_whole(&path, |out| out.write_all(&json))
    }
}

/// Names the file that an error is of.
pub(crate) fn file(path: &Path) -> impl Fn(std::io::Error) -> StoreError + use<> {
    let path = path.to_owned();
    move |source| StoreError::File {
        path: path.clone(),
        source,
    }
}

fn content_hash(path: &Path) -> std::io::Result<String> {
    let mut source = hydroline_rigs::bounded::open(path)?;
    let mut digest = Sha256::new();
    let mut block = vec![0; BLOCK_BYTES];
    loop {
        match source.read(&mut block)? {
            0 => return Ok(hex(&digest.finalize())),
            n => digest.update(&block[..n]),
        }
    }
}

/// Writes beside the place and renames: a kill leaves the old file or the new one.
///
/// # Errors
/// [`StoreError::File`].
pub fn write_whole(
    path: &Path,
    write: impl FnOnce(&mut BufWriter<&mut std::fs::File>) -> std::io::Result<()>,
) -> Result<(), StoreError> {
    let mut part = held::part_in(held::folder_of(path)).map_err(file(path))?;
    let mut out = BufWriter::new(part.as_file_mut());
    write(&mut out)
        .and_then(|()| out.flush())
        .map_err(file(path))?;
    drop(out);
    part.persist(path).map_err(|e| StoreError::File {
        path: path.to_owned(),
        source: e.error,
    })?;
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parts_of_a_key_cannot_run_into_each_other() {
        let key = |parts: &[&str]| parts.iter().fold(Key::of("run"), |k, p| k.with(p)).name();
        assert_eq!(key(&["ab", "c"]), key(&["ab", "c"]));
        assert_ne!(key(&["ab", "c"]), key(&["a", "bc"]));
        assert_eq!(key(&[]).len(), KEY_DIGITS);
    }

    #[test]
    fn a_file_is_read_again_only_when_it_changed() {
        let dir = tempfile::tempdir().unwrap();
        let log = dir.path().join("a.mcap");
        std::fs::write(&log, "one").unwrap();
        let mut store = Store::open(&dir.path().join("store")).unwrap();
        let first = store.hash(&log).unwrap();
        store.keep_hashes().unwrap();
        let mut again = Store::open(&dir.path().join("store")).unwrap();
        assert_eq!(again.hashes.len(), 1);
        assert_eq!(again.hash(&log).unwrap(), first);
        std::fs::write(&log, "another").unwrap();
        assert_ne!(again.hash(&log).unwrap(), first);
    }

    /// They stayed for ever: only what holds no lock is known to be nobody's.
    #[test]
    fn sheets_that_a_killed_campaign_left_unfinished_are_cleared() {
        let dir = tempfile::tempdir().unwrap();
        let at = |name: &str| dir.path().join(name);
        std::fs::write(at(".hydroline-a1b2c3.part"), "half").unwrap();
        write_whole(&at("k.json"), |out| {
            let entries = std::fs::read_dir(dir.path())?.flatten();
            let held: Vec<bool> = entries.map(|e| held::is_held(&e.path())).collect();
            assert_eq!(held, [true], "its own alone");
            out.write_all(b"[]")
        })
        .unwrap();
        assert!(at("k.json").exists());
        assert_eq!(std::fs::read_dir(dir.path()).unwrap().count(), 1);
    }

    #[test]
    fn half_a_sheet_is_none() {
        let dir = tempfile::tempdir().unwrap();
        let store = Store::open(dir.path()).unwrap();
        store.put("k", &vec![1, 2]).unwrap();
        assert_eq!(store.get::<Vec<i32>>("k"), Some(vec![1, 2]));
        std::fs::write(store.sheet_path("k"), "[1,").unwrap();
        assert_eq!(store.get::<Vec<i32>>("k"), None);
    }
}
