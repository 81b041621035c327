//! How files begin: by that their kind is recognised, and what they are if they are not read.

use std::io::{self, Read};
use std::path::Path;

use hydroline_rigs::bounded;

use super::message::RecordedError;

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

/// Error for a log of a known kind that is not read, with the way to one that is.
pub(super) fn not_read(head: &[u8]) -> Option<RecordedError> {
    let rerun = head.starts_with(b"RRF") && head.get(3).is_some_and(u8::is_ascii_digit);
    let (what, next) = if head.starts_with(b"#ROSBAG V") {
        (
            "a bag of ROS 1",
            "make one of ROS 2 of it (`pip install rosbags`, then `rosbags-convert --src FILE.bag --dst FOLDER`) and import that folder",
        )
    } else if rerun {
        (
            "a recording of Rerun (.rrd)",
            "write the entities that you need as a table (Rerun's guide \"Export the dataframe\", then pandas' to_csv) and import that, or import what Rerun was given: MCAP is read",
        )
    } else {
        return None;
    };
    Some(RecordedError::NotRead { what, next })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_not_read_is_named_with_the_way_on() {
        for (head, words) in [
            (&b"#ROSBAG V2.0\nE\0\0\0"[..], "rosbags-convert --src"),
            (b"#ROSBAG V1.2\n", "a bag of ROS 1"),
            (b"RRF2\0\x18\0\0", "Export the dataframe"),
            (b"RRF0", "Rerun"),
        ] {
            let error = not_read(head).unwrap().to_string();
            assert!(error.contains(words), "{error}");
        }
        for head in [&b"RRFt,x\n"[..], b"RRF", b"#ROSBAG, t, x\n", b"", b"t,x\n"] {
            assert!(not_read(head).is_none());
        }
    }
}
