//! Where a table's bytes come from: they are read more than once.

use std::fs::File;
use std::io::{self, Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};

use hydroline_log::foreign::{self, Content, Foreign};
use hydroline_rigs::bounded::STREAM_BYTES;

use crate::recorded::Packing;

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

/// A file; what has no beginning to go back to (a pipe) is copied to a scratch file first, what is packed is unpacked there.
#[derive(Debug)]
pub struct TableFile {
    path: PathBuf,
    copy: Option<File>,
}

impl TableFile {
    /// Opens it.
    ///
    /// # Errors
    /// Those of the file; [`io::ErrorKind::FileTooLarge`] for a stream beyond [`STREAM_BYTES`],
    /// [`io::ErrorKind::InvalidData`] for what does not unpack.
    pub fn open(path: &Path) -> io::Result<TableFile> {
        let mut copy = None;
        let file = File::open(path)?;
        if !file.metadata()?.is_file() {
            let mut scratch = tempfile::tempfile()?;
            let copied = io::copy(&mut file.take(STREAM_BYTES + 1), &mut scratch)?;
            if copied > STREAM_BYTES {
                return Err(io::Error::new(
                    io::ErrorKind::FileTooLarge,
                    format!("a stream of more than {STREAM_BYTES} bytes is no table: give a file"),
                ));
            }
            copy = Some(scratch);
        }
        let mut table = TableFile {
            path: path.to_owned(),
            copy,
        };
        if let Some(packing) = Packing::of(&table.head()?) {
            let packed = match &table.copy {
                Some(copy) => rewound(copy)?,
                None => File::open(path)?,
            };
            let bytes = packed.metadata()?.len();
            let scratch = tempfile::tempfile()?;
            packing.unpack(packed, bytes, &scratch)?;
            table.copy = Some(scratch);
        }
        Ok(table)
    }

    fn head(&self) -> io::Result<Vec<u8>> {
        let mut head = Vec::new();
        self.open_bytes()?
            .take(foreign::HEAD_BYTES)
            .read_to_end(&mut head)?;
        Ok(head)
    }

    fn open_bytes(&self) -> io::Result<File> {
        match &self.copy {
            Some(copy) => rewound(copy),
            None => File::open(&self.path),
        }
    }

    /// Kind of the file and the way on, if it is no text.
    ///
    /// # Errors
    /// Those of the file.
    pub fn foreign(&self) -> io::Result<Option<Foreign>> {
        Ok(Content::of(&self.head()?).foreign())
    }
}

fn rewound(file: &File) -> io::Result<File> {
    let mut copy = file.try_clone()?;
    copy.seek(SeekFrom::Start(0))?;
    Ok(copy)
}

impl Source for TableFile {
    fn open(&self) -> io::Result<Box<dyn Read + '_>> {
        Ok(Box::new(self.open_bytes()?))
    }
}
