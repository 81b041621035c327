//! The beginning of a file, by which its kind is recognised.

use std::fs::File;
use std::io::{self, Read};
use std::path::Path;

/// The first bytes of a file, at most so many; none of what has no beginning to go back to.
///
/// # Errors
/// The system's.
pub(super) fn head(path: &Path, most: u64) -> io::Result<Vec<u8>> {
    let file = File::open(path)?;
    // A pipe is a table or nothing.
    if !file.metadata()?.is_file() {
        return Ok(Vec::new());
    }
    let mut head = Vec::new();
    file.take(most).read_to_end(&mut head)?;
    Ok(head)
}
