//! Where a table's bytes come from: they are read more than once.

use std::fs::File;
use std::io::{self, Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};

use hydroline_rigs::bounded::{STREAM_BYTES, is_stream, open_once};

/// Something that can be read from its beginning, again and again.
pub trait Source {
    /// A reader at the beginning.
    ///
    /// # Errors
    /// Those of the file.
    fn open(&self) -> io::Result<Box<dyn Read + '_>>;
}

impl Source for [u8] {
    fn open(&self) -> io::Result<Box<dyn Read + '_>> {
        Ok(Box::new(self))
    }
}

/// A file; what has no beginning to go back to (standard input as `-`, a pipe) is copied to a scratch file first.
#[derive(Debug)]
pub struct TableFile {
    path: PathBuf,
    copy: Option<File>,
}

impl TableFile {
    /// Opens it.
    ///
    /// # Errors
    /// Those of the file; [`io::ErrorKind::NotSeekable`] of a device, or of a pipe that nobody handed over;
    /// [`io::ErrorKind::FileTooLarge`] for a stream beyond [`STREAM_BYTES`].
    pub fn open(path: &Path) -> io::Result<TableFile> {
        let mut copy = None;
        let once = open_once(path)?;
        if is_stream(path) {
            let mut scratch = tempfile::tempfile()?;
            let copied = io::copy(&mut once.take(STREAM_BYTES + 1), &mut scratch)?;
            if copied > STREAM_BYTES {
                return Err(io::Error::new(
                    io::ErrorKind::FileTooLarge,
                    format!("a stream of more than {STREAM_BYTES} bytes is no table: give a file"),
                ));
            }
            copy = Some(scratch);
        }
        Ok(TableFile {
            path: path.to_owned(),
            copy,
        })
    }
}

impl Source for TableFile {
    fn open(&self) -> io::Result<Box<dyn Read + '_>> {
        match &self.copy {
            Some(copy) => {
                let mut copy = copy.try_clone()?;
                copy.seek(SeekFrom::Start(0))?;
                Ok(Box::new(copy))
            }
            None => Ok(Box::new(File::open(&self.path)?)),
        }
    }
}
