//! A file under another name until it is whole: what is interrupted leaves no half file behind that looks like a whole
//! one.

use super::LogError;
use super::held::{Holder, folder_of, hold, is_at, is_held};
use std::fs::{File, OpenOptions};
use std::io::{self, ErrorKind};
use std::os::unix::fs::{MetadataExt, OpenOptionsExt};
use std::path::{Path, PathBuf};
use tempfile::TempPath;

/// Times that the name is tried again when somebody finished or removed the file in the moment in which it was opened.
const ATTEMPTS: u32 = 16;

/// A file that is being written, under the name `NAME.part`. Dropped before [`Self::finish`] it is removed; a killed process
/// leaves it, and the next attempt replaces it: nobody holds its lock any more.
#[derive(Debug)]
pub struct AtomicFile {
    part: PathBuf,
    whole: PathBuf,
    /// Holds the lock.
    file: File,
    replaces: bool,
    done: bool,
}

impl AtomicFile {
    /// For the new file `whole`: makes the empty file that is written until then.
    ///
    /// # Errors
    /// [`LogError::OutputExists`] when it is there; [`LogError::BeingWritten`] when somebody else is about to make it;
    /// [`LogError::Create`].
    pub fn begin(whole: &Path) -> Result<Self, LogError> {
        if whole.symlink_metadata().is_ok() {
            return Err(LogError::OutputExists {
                path: whole.to_owned(),
            });
        }
        Self::beside(whole, false)
    }

    /// The same in the place of a file that may be there, which stays until the new one is whole.
    ///
    /// # Errors
    /// As [`Self::begin`].
    pub fn begin_over(whole: &Path) -> Result<Self, LogError> {
        Self::beside(whole, true)
    }

    fn beside(whole: &Path, replaces: bool) -> Result<Self, LogError> {
        let part = part_path(whole);
        let (file, left_bytes) = taken(&part)?;
        if left_bytes > 0 {
            tracing::warn!(
                "{}: {left_bytes} bytes that an attempt left which was broken off: nobody writes it any more, it is replaced",
                part.display()
            );
        }
        Ok(Self {
            part,
            whole: whole.to_owned(),
            file,
            replaces,
            done: false,
        })
    }

    /// Whether somebody else is about to make the file `whole`.
    pub fn is_begun(whole: &Path) -> bool {
        is_held(&part_path(whole))
    }

    /// Path to write to until the file is whole.
    pub fn path(&self) -> &Path {
        &self.part
    }

    /// The open, empty file.
    ///
    /// # Errors
    /// [`LogError::Output`].
    pub fn file(&self) -> Result<File, LogError> {
        self.file.try_clone().map_err(LogError::output(&self.part))
    }

    /// It is whole: gives it its name.
    ///
    /// # Errors
    /// [`LogError::OutputExists`] when someone else has made a file of that name meanwhile; [`LogError::Output`].
    pub fn finish(mut self) -> Result<(), LogError> {
        let failed = LogError::output(&self.whole);
        self.file.sync_all().map_err(&failed)?;
        let named = match self.replaces {
            true => std::fs::rename(&self.part, &self.whole),
            false => rename_new(&self.part, &self.whole),
        };
        named.map_err(|e| match e.kind() {
            ErrorKind::AlreadyExists => LogError::OutputExists {
                path: self.whole.clone(),
            },
            _ => failed(e),
        })?;
        self.done = true;
        // The name is on the disk when its folder is. Some file systems sync no folder: the file is whole all the same.
        if let Ok(folder) = File::open(folder_of(&self.whole)) {
            folder.sync_all().ok();
        }
        Ok(())
    }
}

/// Renames to a name that nobody has, in one step: a file that another program makes in that moment stays. Where the file system
/// knows neither such a rename nor a second name of a file, it looks first.
pub(super) fn rename_new(from: &Path, to: &Path) -> io::Result<()> {
    let Err(refused) = TempPath::try_from_path(from)?.persist_noclobber(to) else {
        return Ok(());
    };
    let error = refused.error;
    // Dropped, it would be removed.
    refused.path.keep().map_err(|e| e.error)?;
    match error.kind() {
        ErrorKind::PermissionDenied | ErrorKind::Unsupported | ErrorKind::InvalidInput => {
            if to.symlink_metadata().is_ok() {
                return Err(ErrorKind::AlreadyExists.into());
            }
            std::fs::rename(from, to)
        }
        _ => Err(error),
    }
}

/// Name of a file until it is whole.
fn part_path(whole: &Path) -> PathBuf {
    let mut part = whole.as_os_str().to_owned();
    part.push(".part");
    PathBuf::from(part)
}

/// The file of that name, new or left by somebody who does not hold it any more, locked and empty; how many bytes were left.
fn taken(part: &Path) -> Result<(File, u64), LogError> {
    let exists = || LogError::OutputExists {
        path: part.to_owned(),
    };
    let create = |source| LogError::Create { part: 0, source };
    for _ in 0..ATTEMPTS {
        let there = part.symlink_metadata().ok();
        if there.as_ref().is_some_and(|m| !m.is_file()) {
            return Err(exists());
        }
        let file = OpenOptions::new()
            .read(true)
            .write(true)
            .create(true)
            .truncate(false)
            .custom_flags(libc::O_NOFOLLOW | libc::O_NONBLOCK)
            .open(part)
            .map_err(|e| {
                create(std::io::Error::new(
                    e.kind(),
                    format!("{}: {e}", part.display()),
                ))
            })?;
        match hold(&file) {
            Holder::Another => {
                return Err(LogError::BeingWritten {
                    path: part.to_owned(),
                });
            }
            // It may be another's, and there is no way to know.
            Holder::Unknown if there.is_some() => return Err(exists()),
            Holder::Us | Holder::Unknown => {}
        }
        if !is_at(&file, part) {
            continue;
        }
        let left = file.metadata().map_err(create)?;
        if left.nlink() > 1 {
            // Killed between a whole file's new name and the end of the old one: it is not emptied.
            std::fs::remove_file(part).map_err(create)?;
            continue;
        }
        let left_bytes = left.len();
        file.set_len(0).map_err(create)?;
        return Ok((file, left_bytes));
    }
    Err(LogError::BeingWritten {
        path: part.to_owned(),
    })
}

impl Drop for AtomicFile {
    fn drop(&mut self) {
        // Locked, and so nobody else's, unless somebody took the name away.
        if !self.done && is_at(&self.file, &self.part) {
            std::fs::remove_file(&self.part).ok();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_name_is_taken_only_by_a_whole_file() {
        let dir = tempfile::tempdir().unwrap();
        let whole = dir.path().join("new.mcap");
        let unfinished = AtomicFile::begin(&whole).unwrap();
        std::fs::write(unfinished.path(), "half").unwrap();
        drop(unfinished);
        assert_eq!(std::fs::read_dir(dir.path()).unwrap().count(), 0);

        let unfinished = AtomicFile::begin(&whole).unwrap();
        std::fs::write(unfinished.path(), "all").unwrap();
        unfinished.finish().unwrap();
        assert_eq!(std::fs::read(&whole).unwrap(), b"all");
        assert!(matches!(
            AtomicFile::begin(&whole),
            Err(LogError::OutputExists { .. })
        ));
        let over = AtomicFile::begin_over(&whole).unwrap();
        std::fs::write(over.path(), "new").unwrap();
        assert_eq!(std::fs::read(&whole).unwrap(), b"all");
        over.finish().unwrap();
        assert_eq!(std::fs::read(&whole).unwrap(), b"new");
    }

    #[test]
    fn what_a_killed_process_left_is_replaced_and_what_another_writes_is_not() {
        let dir = tempfile::tempdir().unwrap();
        let (whole, part) = (
            dir.path().join("new.mcap"),
            dir.path().join("new.mcap.part"),
        );
        std::fs::write(&part, "half of it").unwrap();
        let ours = AtomicFile::begin(&whole).unwrap();
        assert_eq!(std::fs::read(&part).unwrap(), b"");
        std::fs::write(ours.path(), "ours").unwrap();
        let error = AtomicFile::begin(&whole).unwrap_err();
        assert!(matches!(error, LogError::BeingWritten { .. }), "{error}");
        assert!(error.to_string().contains("new.mcap.part"), "{error}");
        assert_eq!(std::fs::read(&part).unwrap(), b"ours");
        ours.finish().unwrap();
        assert!(!part.exists());

        // What is no file was not left by an attempt.
        let precious = dir.path().join("precious");
        std::fs::write(&precious, "years of work").unwrap();
        std::os::unix::fs::symlink(&precious, dir.path().join("b.mcap.part")).unwrap();
        let error = AtomicFile::begin(&dir.path().join("b.mcap")).unwrap_err();
        assert!(matches!(error, LogError::OutputExists { .. }), "{error}");
        assert_eq!(std::fs::read(&precious).unwrap(), b"years of work");
    }

    /// It looked, and gave the name later: a file that came in between was gone.
    #[test]
    fn a_file_that_another_program_makes_in_the_moment_of_the_end_is_not_replaced() {
        for _ in 0..200 {
            let dir = tempfile::tempdir().unwrap();
            let whole = dir.path().join("new.mcap");
            let ours = AtomicFile::begin(&whole).unwrap();
            std::fs::write(ours.path(), "ours").unwrap();
            let start = std::sync::Barrier::new(2);
            let (is_named, is_made) = std::thread::scope(|scope| {
                let other = scope.spawn(|| {
                    start.wait();
                    let mut options = OpenOptions::new();
                    options.write(true).create_new(true).open(&whole).is_ok()
                });
                start.wait();
                (ours.finish().is_ok(), other.join().unwrap())
            });
            assert!(is_named != is_made, "one of the two has the name");
        }
    }

    #[test]
    fn a_second_name_of_a_whole_file_is_no_part_of_another_one() {
        let dir = tempfile::tempdir().unwrap();
        let whole = dir.path().join("new.mcap");
        std::fs::write(&whole, "whole").unwrap();
        std::fs::hard_link(&whole, dir.path().join("new.mcap.part")).unwrap();
        let over = AtomicFile::begin_over(&whole).unwrap();
        std::fs::write(over.path(), "half").unwrap();
        assert_eq!(std::fs::read(&whole).unwrap(), b"whole");
    }
}
