//! Files read into memory, never more than there is reason for: `/dev/zero` has no end.

use std::fs::File;
use std::io::{Error, ErrorKind, Read, Result};
use std::path::Path;

/// Configuration, written by people: rigs, plans, boards, targets, maps of tables.
pub const CONFIG_BYTES: u64 = 1 << 20;
/// Files that hydroline writes to read again (calibrations with their maps, results), and small tables of readings.
pub const RESULT_BYTES: u64 = 64 << 20;
/// A table from something that has no size of its own: a pipe or a device.
pub const STREAM_BYTES: u64 = 1 << 30;

/// The bytes of a file.
///
/// # Errors
/// Those of the file; [`ErrorKind::FileTooLarge`] beyond `largest_bytes`.
pub fn read_bytes(path: &Path, largest_bytes: u64) -> Result<Vec<u8>> {
    let mut bytes = Vec::new();
    let file = File::open(path)?;
    let read = file
        .take(largest_bytes.saturating_add(1))
        .read_to_end(&mut bytes)?;
    if read as u64 > largest_bytes {
        let words = format!(
            "larger than {largest_bytes} bytes, which no file of this kind is: it is another one"
        );
        return Err(Error::new(ErrorKind::FileTooLarge, words));
    }
    Ok(bytes)
}

/// The bytes of a table: all of a regular file, at most [`STREAM_BYTES`] of anything else.
///
/// # Errors
/// As [`read_bytes`].
pub fn read_table(path: &Path) -> Result<Vec<u8>> {
    let there = std::fs::metadata(path)?;
    let largest_bytes = if there.is_file() {
        there.len()
    } else {
        STREAM_BYTES
    };
    read_bytes(path, largest_bytes)
}

/// The text of a file.
///
/// # Errors
/// As [`read_bytes`]; [`ErrorKind::InvalidData`] when it is not UTF-8.
pub fn read_text(path: &Path, largest_bytes: u64) -> Result<String> {
    String::from_utf8(read_bytes(path, largest_bytes)?).map_err(|e| {
        let words = format!("byte {} is not UTF-8 text", e.utf8_error().valid_up_to());
        Error::new(ErrorKind::InvalidData, words)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_file_without_an_end_is_refused_and_one_at_the_bound_is_read() {
        let endless = read_text(Path::new("/dev/zero"), CONFIG_BYTES).unwrap_err();
        assert_eq!(endless.kind(), ErrorKind::FileTooLarge);
        let this = Path::new(env!("CARGO_MANIFEST_DIR")).join("src/bounded.rs");
        let length = std::fs::metadata(&this).unwrap().len();
        assert_eq!(read_bytes(&this, length).unwrap().len() as u64, length);
        assert!(read_bytes(&this, length - 1).is_err());
        assert_eq!(read_table(&this).unwrap().len() as u64, length);
    }
}
