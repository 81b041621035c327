//! Packed files: those that rosbag2 packed whole (`compression_mode: FILE`), and logs and tables that a person packed. They are
//! unpacked beside the system's other scratch files.

use std::fs::File;
use std::io::{self, BufReader, BufWriter, Read, Write};
use std::path::{Path, PathBuf};

use hydroline_rigs::bounded;

use super::head::head;

/// Largest unpacked size per packed byte, and an allowance for any file: no recording packs better, and a bomb does \[bytes\].
const UNPACKED_PER_BYTE: u64 = 500;
const UNPACKED_LEAST: u64 = 1 << 20;
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

    /// Unpacks what is `packed_bytes` long.
    ///
    /// # Errors
    /// The system's; [`io::ErrorKind::InvalidData`] of what is cut, damaged, or unpacks to more than any recording.
    pub fn unpack(self, packed: File, packed_bytes: u64, out: &File) -> io::Result<()> {
        let most = UNPACKED_LEAST + UNPACKED_PER_BYTE * packed_bytes;
        let packed = BufReader::new(packed);
        let reader: Box<dyn Read> = match self {
            Packing::Zstd => Box::new(zstd::Decoder::with_buffer(packed)?),
            Packing::Gzip => Box::new(flate2::bufread::MultiGzDecoder::new(packed)),
        };
        let mut out = BufWriter::new(out);
        let copied = io::copy(&mut reader.take(most + 1), &mut out).map_err(|e| {
            use io::ErrorKind as Kind;
            match e.kind() {
                Kind::UnexpectedEof | Kind::InvalidInput | Kind::InvalidData | Kind::Other => {
                    invalid(format!("{e}: it is cut or damaged; fetch it anew"))
                }
                _ => e,
            }
        })?;
        if copied > most {
            return Err(invalid(format!(
                "to more than {UNPACKED_PER_BYTE} times its size ({most} bytes), which no recording does"
            )));
        }
        out.flush()
    }
}

fn invalid(words: String) -> io::Error {
    io::Error::new(
        io::ErrorKind::InvalidData,
        format!("it does not unpack: {words}"),
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
    let bytes = file.metadata()?.len();
    let scratch = tempfile::NamedTempFile::new()?;
    packing.unpack(file, bytes, scratch.as_file())?;
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
        let bomb = dir.path().join("c.mcap.zstd");
        let zeros = vec![0; 16 << 20];
        std::fs::write(&bomb, zstd::bulk::compress(&zeros, 19).unwrap()).unwrap();
        let error = Unpacked::of(vec![bomb]).unwrap_err().to_string();
        assert!(error.contains("more than 500 times"), "{error}");
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
        let bomb = dir.path().join("c.gz");
        std::fs::write(&bomb, gzip(&vec![0; 16 << 20])).unwrap();
        let error = Unpacked::of(vec![bomb]).unwrap_err().to_string();
        assert!(error.contains("more than 500 times"), "{error}");
    }
}
