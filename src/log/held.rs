//! Files that somebody writes, distinguished from those that a killed process left: a writer holds the lock of its file
//! (flock(2)), and the system gives it back with the process.

use std::fs::{File, OpenOptions, TryLockError};
use std::io;
use std::os::unix::fs::{MetadataExt, OpenOptionsExt};
use std::path::Path;

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
