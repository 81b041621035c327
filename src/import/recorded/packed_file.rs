//! Packed files: those that rosbag2 packed whole (`compression_mode: FILE`), and logs and tables that a person packed. They are
//! unpacked beside the system's other scratch files.

use std::fs::File;
use std::io::{self, BufReader, BufWriter, Read, Write};
use std::path::{Path, PathBuf};

use hydroline_log::foreign::{Content, HEAD_BYTES};
use hydroline_log::free_bytes;
use hydroline_rigs::bounded;

use super::head::head;

/// Share of the free disk space that is left to others, as one of so many parts. There is no other limit: black images shrink
/// thousands of times, so that no ratio divides recordings from bombs.
const LEFT_PART: u64 = 10;
/// Bytes that tell how a file is packed.
const MAGIC_BYTES: u64 = 4;

/// Endings that packers put behind a file's name.
const ENDINGS: [&str; 3] = [".zstd", ".zst", ".gz"];

/// A file's name without the ending of a packed file.
pub(super) fn unpacked_name(name: &str) -> &str {
    ENDINGS
        .iter()
        .find_map(|ending| name.strip_suffix(*ending))
        .unwrap_or(name)
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Packing {
    /// RFC 8878, section 3.1.1.
    Zstd,
    /// RFC 1952, with deflate, the only method that there is.
    Gzip,
}

impl Packing {
    /// Packing of a file that begins so; `None` = it is not packed.
    pub fn of(head: &[u8]) -> Option<Packing> {
        match head {
            [0x28, 0xb5, 0x2f, 0xfd, ..] => Some(Packing::Zstd),
            [0x1f, 0x8b, 8, ..] => Some(Packing::Gzip),
            _ => None,
        }
    }

    /// Unpacks a file into a scratch file: all of it, or of a kind that is not read the beginning, which names it.
    ///
    /// # Errors
    /// The system's; [`io::ErrorKind::InvalidData`] of what is cut or damaged; [`io::ErrorKind::StorageFull`] of what needs more room
    /// than there is for scratch files.
    pub fn unpack(self, packed: File, out: &File) -> io::Result<()> {
        let free = free_bytes(&std::env::temp_dir());
        let most = free.map_or(u64::MAX, |free| free - free / LEFT_PART);
        self.unpack_within(most, packed, out)
    }

    fn unpack_within(self, most: u64, packed: File, out: &File) -> io::Result<()> {
        let packed = BufReader::new(packed);
        let mut reader: Box<dyn Read> = match self {
            Packing::Zstd => Box::new(zstd::Decoder::with_buffer(packed)?),
            Packing::Gzip => Box::new(flate2::bufread::MultiGzDecoder::new(packed)),
        };
        let mut beginning = Vec::new();
        reader
            .by_ref()
            .take(HEAD_BYTES)
            .read_to_end(&mut beginning)
            .map_err(not_unpacked)?;
        let mut out = BufWriter::new(out);
        out.write_all(&beginning)?;
        if !matches!(Content::of(&beginning), Content::Other(_)) {
            let left = most.saturating_sub(beginning.len() as u64);
            let mut rest = reader.take(left.saturating_add(1));
            let copied = io::copy(&mut rest, &mut out).map_err(not_unpacked)?;
            if copied > left {
                return Err(no_room(most));
            }
        }
        out.flush()
    }
}

/// The error of what does not unpack to its end; others as they are.
fn not_unpacked(error: io::Error) -> io::Error {
    use io::ErrorKind as Kind;
    match error.kind() {
        Kind::UnexpectedEof | Kind::InvalidInput | Kind::InvalidData | Kind::Other => {
            io::Error::new(
                Kind::InvalidData,
                format!("it does not unpack: {error}: it is cut or damaged; fetch it anew"),
            )
        }
        _ => error,
    }
}

fn no_room(most: u64) -> io::Error {
    io::Error::new(
        io::ErrorKind::StorageFull,
        format!(
            "it unpacks to more than {most} bytes, and no more may be written to {}: unpack it where there is room and name what comes out, or name a folder with room in TMPDIR",
            std::env::temp_dir().display()
        ),
    )
}

/// The files to be read, and what goes when they are no longer needed.
#[derive(Debug, Default)]
pub(super) struct Unpacked {
    pub files: Vec<PathBuf>,
    scratch: Vec<tempfile::TempPath>,
}

impl Unpacked {
    /// Those files, packed ones unpacked.
    ///
    /// # Errors
    /// The system's, and those of a file that does not unpack, with its name.
    pub fn of(files: Vec<PathBuf>) -> io::Result<Unpacked> {
        let mut made = Unpacked::default();
        for file in files {
            let Some(packing) = Packing::of(&head(&file, MAGIC_BYTES)?) else {
                made.files.push(file);
                continue;
            };
            let scratch = unpacked(packing, &file)
                .map_err(|e| io::Error::new(e.kind(), format!("{}: {e}", file.display())))?;
            made.files.push(scratch.to_path_buf());
            made.scratch.push(scratch);
        }
        Ok(made)
    }
}

fn unpacked(packing: Packing, path: &Path) -> io::Result<tempfile::TempPath> {
    let file = bounded::open(path)?;
    let scratch = tempfile::NamedTempFile::new()?;
    packing.unpack(file, scratch.as_file())?;
    Ok(scratch.into_temp_path())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_packed_file_is_read_and_a_cut_one_is_named() {
        let dir = tempfile::tempdir().unwrap();
        let packed = zstd::bulk::compress(&b"SQLite format 3\0".repeat(100), 1).unwrap();
        let (whole, cut) = (dir.path().join("a.db3.zstd"), dir.path().join("b.db3.zstd"));
        std::fs::write(&whole, &packed).unwrap();
        std::fs::write(&cut, &packed[..packed.len() - 5]).unwrap();
        let made = Unpacked::of(vec![whole]).unwrap();
        let text = std::fs::read(&made.files[0]).unwrap();
        assert_eq!(text.len(), 1600);
        let path = made.files[0].clone();
        drop(made);
        assert!(!path.exists());
        let error = Unpacked::of(vec![cut]).unwrap_err();
        let words = error.to_string();
        assert!(words.contains("b.db3.zstd: it does not unpack"), "{words}");
        assert_eq!(error.kind(), io::ErrorKind::InvalidData);
    }

    fn gzip(bytes: &[u8]) -> Vec<u8> {
        let mut packer = flate2::write::GzEncoder::new(Vec::new(), flate2::Compression::best());
        packer.write_all(bytes).unwrap();
        packer.finish().unwrap()
    }

    #[test]
    fn a_file_packed_with_gzip_is_read_and_a_cut_one_is_named() {
        let dir = tempfile::tempdir().unwrap();
        let (whole, cut) = (dir.path().join("a.ulg.gz"), dir.path().join("b.ulg.gz"));
        // Members one after the other are one file, as `cat` makes them.
        let packed = [gzip(b"ULog"), gzip(b" and more")].concat();
        std::fs::write(&whole, &packed).unwrap();
        std::fs::write(&cut, &packed[..packed.len() - 9]).unwrap();
        let made = Unpacked::of(vec![whole]).unwrap();
        assert_eq!(std::fs::read(&made.files[0]).unwrap(), b"ULog and more");
        let error = Unpacked::of(vec![cut]).unwrap_err();
        assert_eq!(error.kind(), io::ErrorKind::InvalidData, "{error}");
    }

    #[test]
    fn a_packed_recording_of_black_images_was_called_a_bomb() {
        let dir = tempfile::tempdir().unwrap();
        let black = [&b"\x89MCAP0\r\n"[..], &vec![0; 4 << 20]].concat();
        let packed = zstd::bulk::compress(&black, 19).unwrap();
        assert!(packed.len() * 2000 < black.len());
        for (name, bytes) in [("a.mcap.zstd", packed), ("a.mcap.gz", gzip(&black))] {
            let path = dir.path().join(name);
            std::fs::write(&path, bytes).unwrap();
            let made = Unpacked::of(vec![path.clone()]).unwrap();
            let unpacked = std::fs::read(&made.files[0]).unwrap();
            assert!(unpacked == black, "{name}");
            // Where there is no room it is said.
            let packing = Packing::of(&head(&path, MAGIC_BYTES).unwrap()).unwrap();
            let (file, scratch) = (File::open(&path).unwrap(), tempfile::tempfile().unwrap());
            let error = packing.unpack_within(1 << 20, file, &scratch).unwrap_err();
            assert_eq!(error.kind(), io::ErrorKind::StorageFull, "{error}");
            assert!(error.to_string().contains("TMPDIR"), "{error}");
        }
    }

    #[test]
    fn of_a_kind_that_is_not_read_only_the_beginning_is_unpacked() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("bomb.gz");
        std::fs::write(&path, gzip(&vec![0; 4 << 20])).unwrap();
        let made = Unpacked::of(vec![path]).unwrap();
        let unpacked = std::fs::metadata(&made.files[0]).unwrap();
        assert_eq!(unpacked.len(), HEAD_BYTES);
    }
}
