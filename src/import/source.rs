//! Where a table's bytes come from: they are read more than once.

use std::fs::File;
use std::io::{self, Read, Seek, SeekFrom};
use std::os::unix::fs::MetadataExt;
use std::path::{Path, PathBuf};

use hydroline_log::foreign::{self, Content, Foreign};
use hydroline_rigs::bounded::{STREAM_BYTES, is_stream, open_once};

use crate::recorded::Packing;

/// Something that can be read from its beginning, again and again.
pub trait Source {
    /// A reader at the beginning.
    ///
    /// # Errors
    /// Those of the file.
    fn open(&self) -> io::Result<Box<dyn Read + '_>>;

    /// Whether it is still what it was when it was first opened: asked behind a reading of the whole.
    ///
    /// # Errors
    /// It has changed, in words; those of the file.
    fn unchanged(&self) -> io::Result<()> {
        Ok(())
    }
}

/// State of a file that is read more than once: another one in its place, another size, another time of change.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct State {
    path: PathBuf,
    device: u64,
    inode: u64,
    bytes: u64,
    modified_s: i64,
    modified_ns: i64,
}

impl State {
    /// Of a file as it is now.
    pub fn of(path: &Path) -> io::Result<State> {
        let found = std::fs::metadata(path)?;
        Ok(State {
            path: path.to_owned(),
            device: found.dev(),
            inode: found.ino(),
            bytes: found.len(),
            modified_s: found.mtime(),
            modified_ns: found.mtime_nsec(),
        })
    }

    /// Whether the file is still in this state.
    ///
    /// # Errors
    /// It is not, in words; those of the file.
    pub fn unchanged(&self) -> io::Result<()> {
        let now = State::of(&self.path)?;
        if now == *self {
            return Ok(());
        }
        let size = match now.bytes == self.bytes {
            true => String::new(),
            false => format!(" ({} bytes at first, {} then)", self.bytes, now.bytes),
        };
        Err(io::Error::other(format!(
            "{} was changed while it was read{size}: let the program that writes it end, or import a copy",
            self.path.display()
        )))
    }
}

impl Source for [u8] {
    fn open(&self) -> io::Result<Box<dyn Read + '_>> {
        Ok(Box::new(self))
    }
}

/// A file; what has no beginning to go back to (standard input as `-`, a pipe) is copied to a scratch file first, what is packed
/// is unpacked there.
#[derive(Debug)]
pub struct TableFile {
    path: PathBuf,
    copy: Option<File>,
    /// As it was opened; `None` = it was copied.
    state: Option<State>,
}

impl TableFile {
    /// Opens it.
    ///
    /// # Errors
    /// Those of the file; [`io::ErrorKind::NotSeekable`] of a device, or of a pipe that nobody handed over;
    /// [`io::ErrorKind::FileTooLarge`] for a stream beyond [`STREAM_BYTES`], [`io::ErrorKind::InvalidData`] for what does not unpack,
    /// [`io::ErrorKind::StorageFull`] for what needs more room than there is for scratch files.
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
        let state = match copy {
            Some(_) => None,
            None => Some(State::of(path)?),
        };
        let mut table = TableFile {
            path: path.to_owned(),
            copy,
            state,
        };
        if let Some(packing) = Packing::of(&table.head()?) {
            let packed = match &table.copy {
                Some(copy) => rewound(copy)?,
                None => File::open(path)?,
            };
            let scratch = tempfile::tempfile()?;
            packing.unpack(packed, &scratch)?;
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
        Ok(Content::of(&self.head()?).no_table())
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

    fn unchanged(&self) -> io::Result<()> {
        self.state.as_ref().map_or(Ok(()), State::unchanged)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Map, survey};

    #[test]
    fn an_mcap_that_comes_as_a_stream_was_taken_for_a_table() {
        use std::io::Write;
        use std::os::fd::AsRawFd;
        let log = b"\x89MCAP0\r\n\x01rest of a log".repeat(4);
        let packed = zstd::bulk::compress(&log, 1).unwrap();
        for bytes in [log, packed] {
            let (reader, mut writer) = io::pipe().unwrap();
            writer.write_all(&bytes).unwrap();
            drop(writer);
            let name = format!("/dev/fd/{}", reader.as_raw_fd());
            let table = TableFile::open(Path::new(&name)).unwrap();
            let found = table.foreign().unwrap().unwrap();
            assert!(found.what.contains("MCAP"), "{found:?}");
            assert!(found.next.contains("write it to a file"), "{found:?}");
        }
    }

    /// What was left of it was imported, with exit code 0.
    #[test]
    fn a_table_that_is_cut_or_goes_on_while_it_is_read_is_an_error() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("t.csv");
        let text: String = (0..50)
            .map(|k| format!("{k},{}\n", 0.1 * f64::from(k)))
            .collect();
        let text = format!("t,x\n{text}");
        let map =
            "[time]\ncolumn = \"t\"\nunit = \"s\"\n[motion.x_m]\ncolumn = \"x\"\nunit = \"m\"\n";
        let map = Map::from_toml(map, "m").unwrap();
        for becomes in [&text[..200], &format!("{text}51,5.1\n")] {
            std::fs::write(&path, &text).unwrap();
            let table = TableFile::open(&path).unwrap();
            assert!(survey(&table, &map, None).is_ok());
            std::fs::write(&path, becomes).unwrap();
            let error = survey(&table, &map, None).unwrap_err().to_string();
            assert!(error.contains("was changed while it was read"), "{error}");
        }
    }
}
