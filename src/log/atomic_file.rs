//! A file under another name until it is whole: what is interrupted leaves no half file behind that looks like a whole
//! one.

use super::LogError;
use std::path::{Path, PathBuf};

/// A file that is being written. Dropped before [`Self::finish`] it is removed; a killed process leaves `NAME.part`.
#[derive(Debug)]
pub struct AtomicFile {
    part: PathBuf,
    whole: PathBuf,
    done: bool,
}

impl AtomicFile {
    /// For the new file `whole`; nothing is created yet.
    ///
    /// # Errors
    /// [`LogError::OutputExists`] when it, or an unfinished one of an earlier attempt, is there.
    pub fn begin(whole: &Path) -> Result<Self, LogError> {
        let mut part = whole.as_os_str().to_owned();
        part.push(".part");
        let part = PathBuf::from(part);
        for path in [whole, part.as_path()] {
            if path.symlink_metadata().is_ok() {
                return Err(LogError::OutputExists {
                    path: path.to_owned(),
                });
            }
        }
        Ok(Self {
            part,
            whole: whole.to_owned(),
            done: false,
        })
    }

    /// Path to write to until the file is whole.
    pub fn path(&self) -> &Path {
        &self.part
    }

    /// It is whole: gives it its name.
    ///
    /// # Errors
    /// [`LogError::OutputExists`] when someone else has made a file of that name meanwhile; [`LogError::Output`].
    pub fn finish(mut self) -> Result<(), LogError> {
        if self.whole.symlink_metadata().is_ok() {
            return Err(LogError::OutputExists {
                path: self.whole.clone(),
            });
        }
        std::fs::rename(&self.part, &self.whole).map_err(LogError::output(&self.whole))?;
        self.done = true;
        Ok(())
    }
}

impl Drop for AtomicFile {
    fn drop(&mut self) {
        if !self.done {
            // Made since begin(), which found nothing of that name.
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
    }

    #[test]
    fn what_a_killed_process_left_is_not_overwritten() {
        let dir = tempfile::tempdir().unwrap();
        std::fs::write(dir.path().join("new.mcap.part"), "half").unwrap();
        let error = AtomicFile::begin(&dir.path().join("new.mcap")).unwrap_err();
        assert!(error.to_string().contains("new.mcap.part"), "{error}");
    }
}
