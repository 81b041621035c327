//! Files that rosbag2 packed whole (`compression_mode: FILE`): unpacked beside the system's other scratch files.

use std::io::{self, BufWriter, Read, Write};
use std::path::{Path, PathBuf};

use hydroline_rigs::bounded;

use super::head::head;

/// How a frame of zstd begins (RFC 8878, section 3.1.1).
const MAGIC: [u8; 4] = [0x28, 0xb5, 0x2f, 0xfd];
/// Largest unpacked size per packed byte, and an allowance for any file: no recording packs better, and a bomb does \[bytes\].
const UNPACKED_PER_BYTE: u64 = 500;
const UNPACKED_LEAST: u64 = 1 << 20;

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
            if head(&file, MAGIC.len() as u64)? != MAGIC {
                made.files.push(file);
                continue;
            }
            let scratch = unpacked(&file).map_err(|e| {
                io::Error::new(
                    e.kind(),
                    format!("{}: it does not unpack: {e}", file.display()),
                )
            })?;
            made.files.push(scratch.to_path_buf());
            made.scratch.push(scratch);
        }
        Ok(made)
    }
}

fn unpacked(path: &Path) -> io::Result<tempfile::TempPath> {
    let file = bounded::open(path)?;
    let most = UNPACKED_LEAST + UNPACKED_PER_BYTE * file.metadata()?.len();
    let mut reader = zstd::Decoder::new(file)?.take(most + 1);
    let scratch = tempfile::NamedTempFile::new()?;
    let mut out = BufWriter::new(scratch.as_file());
    if io::copy(&mut reader, &mut out)? > most {
        return Err(io::Error::other(format!(
            "to more than {UNPACKED_PER_BYTE} times its size ({most} bytes), which no recording does"
        )));
    }
    out.flush()?;
    drop(out);
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
        let error = Unpacked::of(vec![cut]).unwrap_err().to_string();
        assert!(error.contains("b.db3.zstd: it does not unpack"), "{error}");
    }
}
