//! The beginning of a file, by which its kind is recognised.

use std::io::{self, Read};
use std::path::Path;

use hydroline_rigs::bounded;

/// The first bytes of a file, at most so many; none of what has no beginning to go back to.
///
/// # Errors
/// The system's.
pub(super) fn head(path: &Path, most: u64) -> io::Result<Vec<u8>> {
    // A pipe is a table or nothing.
    if bounded::is_stream(path) {
        return Ok(Vec::new());
    }
    let file = bounded::open(path)?;
    let mut head = Vec::new();
    file.take(most).read_to_end(&mut head)?;
    Ok(head)
}
