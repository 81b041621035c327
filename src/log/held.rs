//! Files that somebody writes, distinguished from those that a killed process left: a writer holds the lock of its file
//! (flock(2)), and the system gives it back with the process.

use hydroline_core::lock::Lock;
use std::collections::BTreeSet;
use std::fs::{File, OpenOptions, Permissions, TryLockError};
use std::io;
use std::os::unix::fs::{MetadataExt, OpenOptionsExt, PermissionsExt};
use std::path::{Path, PathBuf};
use std::sync::Mutex;
use tempfile::NamedTempFile;

/// Holder of a file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Holder {
    /// This process, from now on, for as long as the file is open.
    Us,
    /// Somebody else writes it.
    Another,
    /// Not known: the file system knows no locks.
    Unknown,
}

/// Takes the lock of an open file or folder, without waiting.
pub fn hold(file: &File) -> Holder {
    match file.try_lock() {
        Ok(()) => Holder::Us,
        Err(TryLockError::WouldBlock) => Holder::Another,
        Err(TryLockError::Error(_)) => Holder::Unknown,
    }
}

/// Whether an open file is still the one under that name: it may have been finished or removed before it was locked.
pub fn is_at(file: &File, path: &Path) -> bool {
    let same =
        |a: std::fs::Metadata, b: std::fs::Metadata| (a.dev(), a.ino()) == (b.dev(), b.ino());
    match (file.metadata(), path.symlink_metadata()) {
        (Ok(open), Ok(named)) => same(open, named),
        _ => false,
    }
}

/// Opens what a killed process may have left; no link is followed, and nothing is waited for.
fn open_left(path: &Path) -> io::Result<File> {
    OpenOptions::new()
        .read(true)
        .custom_flags(libc::O_NOFOLLOW | libc::O_NONBLOCK)
        .open(path)
}

/// Whether somebody else writes the file of that name.
pub fn is_held(path: &Path) -> bool {
    open_left(path).is_ok_and(|file| hold(&file) == Holder::Another)
}

/// Removes a file that nobody holds; whether it did. Anything but a file stays, and so does one of which it is not known.
pub fn remove_unheld(path: &Path) -> bool {
    let Ok(file) = open_left(path) else {
        return false;
    };
    file.metadata().is_ok_and(|m| m.is_file())
        && hold(&file) == Holder::Us
        && is_at(&file, path)
        && std::fs::remove_file(path).is_ok()
}

/// Holder of a folder that a process may have left: it is held by [`hold`] of the folder itself.
pub(super) fn folder(path: &Path) -> io::Result<(File, Holder)> {
    let folder = open_left(path)?;
    let holder = hold(&folder);
    Ok((folder, holder))
}

/// Beginning and end of the names of files that are written, whatever the result's: that may be as long as a name can be.
const PART: (&str, &str) = (".hydroline-", ".part");

/// Folder of a file; of a name alone, the one that this process is in.
pub fn folder_of(path: &Path) -> &Path {
    match path.parent() {
        Some(folder) if !folder.as_os_str().is_empty() => folder,
        _ => Path::new("."),
    }
}

/// A new file beside the results of a folder, for one that gets its name when it is whole. What killed processes left there is
/// removed at the first.
///
/// # Errors
/// The system's, where none can be made.
pub fn part_in(folder: &Path) -> io::Result<NamedTempFile> {
    clear_once(folder);
    held_part(folder)
}

/// A new file whose lock is held until it has its name: what holds none was left by a process that was killed.
fn held_part(folder: &Path) -> io::Result<NamedTempFile> {
    /// In the moment between making and locking it, somebody may take it for such a file.
    const ATTEMPTS: usize = 16;
    let mut builder = tempfile::Builder::new();
    // As any new file: what the umask leaves.
    let rights = Permissions::from_mode(0o666);
    builder.prefix(PART.0).suffix(PART.1).permissions(rights);
    let mut part = builder.tempfile_in(folder)?;
    for _ in 0..ATTEMPTS {
        if hold(part.as_file()) != Holder::Another && is_at(part.as_file(), part.path()) {
            break;
        }
        part = builder.tempfile_in(folder)?;
    }
    Ok(part)
}

/// Removes what killed processes left in a folder, at the first result of this process that goes into it.
fn clear_once(folder: &Path) {
    static CLEARED: Mutex<BTreeSet<PathBuf>> = Mutex::new(BTreeSet::new());
    if !CLEARED.held().insert(folder.to_owned()) {
        return;
    }
    for path in left_in(folder) {
        if remove_unheld(&path) {
            tracing::warn!(
                "{}: removed: a command that was broken off left it, and nobody writes it any more",
                path.display()
            );
        }
    }
}

fn left_in(folder: &Path) -> impl Iterator<Item = PathBuf> {
    let entries = std::fs::read_dir(folder).into_iter().flatten().flatten();
    entries
        .filter(|entry| {
            let name = entry.file_name();
            let name = name.to_string_lossy();
            name.starts_with(PART.0) && name.ends_with(PART.1)
        })
        .map(|entry| entry.path())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parts_that_killed_commands_left_are_cleared_and_those_that_are_written_are_not() {
        let dir = tempfile::tempdir().unwrap();
        let at = |name: &str| dir.path().join(name);
        for name in [".hydroline-a1b2c3.part", ".hydroline-notes", "run.part"] {
            std::fs::write(at(name), "half").unwrap();
        }
        let other = held_part(dir.path()).unwrap();
        let ours = part_in(dir.path()).unwrap();
        assert!(!at(".hydroline-a1b2c3.part").exists(), "left by nobody");
        assert!(is_held(other.path()) && is_held(ours.path()));
        assert!(at(".hydroline-notes").exists() && at("run.part").exists());
    }
}
