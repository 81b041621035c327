//! Bytes that the chunks of a log may unpack to: what a file costs to read is bounded by its size, and a dark recording is
//! read all the same.
//!
//! Black pixels shrink thousands of times, and by how much depends on the frame's size: no ratio divides recordings from
//! bombs. The head does: it states the frame's size and the chunk's, and a chunk that is no larger than they are is what
//! the recording wrote, however few bytes it takes. Whatever is larger, and all of a log without such a head, counts
//! against [`EXPANSION_MAX`].

use hydroline_rigs::Rig;

use super::policy::Limits;
use super::records::{Damage, EXPANSION_MAX, LIMIT_BYTES};
use super::scan::Learnt;
use super::space::bytes_per_frame;

/// Key of the session: bytes of the largest frame \[byte\], of a log whose frames are not of its rig's camera.
pub const FRAME_BYTES_KEY: &str = "frame_bytes";

/// Room for a frame beside the one of its size: drivers pad rows and planes, by less than the image itself but for tiny
/// ones, which the chunk's own size covers.
const FRAME_ROOM: f64 = 2.0;

/// Account of the chunks so far.
#[derive(Debug, Default)]
pub(super) struct Expansion {
    /// Bytes that they unpacked to.
    unpacked_bytes: u64,
    /// Largest chunk by the head of this text.
    by_head: Option<(String, u64)>,
}

impl Expansion {
    /// Takes a chunk that unpacks to so many bytes, when `read_bytes` of the file have been read.
    pub fn take(&mut self, bytes: u64, read_bytes: u64, learnt: &Learnt) -> Result<(), Damage> {
        let unpacked = self.unpacked_bytes.saturating_add(bytes);
        let most = EXPANSION_MAX.saturating_mul(read_bytes);
        if unpacked <= most.saturating_add(LIMIT_BYTES) {
            self.unpacked_bytes = unpacked;
            return Ok(());
        }
        // Neither counts: sound chunks behind a few bombs are read.
        let largest = self.largest_chunk(learnt);
        match bytes <= largest {
            true => Ok(()),
            false => Err(Damage::Expansion { bytes, largest }),
        }
    }

    fn largest_chunk(&mut self, learnt: &Learnt) -> u64 {
        let rig = learnt.metadata.get("rig").and_then(|m| m.get("toml"));
        let Some(text) = rig else {
            // A log of ours whose rig is destroyed (the first channel names it) is not a bomb for that.
            return match learnt.sealed.contains_key("rig") {
                true => LIMIT_BYTES,
                false => 0,
            };
        };
        if let Some((of, largest)) = &self.by_head
            && of == text
        {
            return *largest;
        }
        let largest = stated(text, learnt);
        self.by_head = Some((text.clone(), largest));
        largest
    }
}

/// Largest chunk of a log with this rig; a rig that cannot be read leaves the limit of all chunks.
fn stated(rig: &str, learnt: &Learnt) -> u64 {
    let Ok(rig) = Rig::from_toml(rig, "the log's rig", None) else {
        return LIMIT_BYTES;
    };
    let session = learnt.metadata.get("session");
    let other = session.and_then(|map| map.get(FRAME_BYTES_KEY)?.parse::<f64>().ok());
    let frame = bytes_per_frame(&rig.camera).max(other.unwrap_or(0.0));
    // `recover` and `replay` write chunks of the default size, whatever the recording's was.
    let chunk = rig.log.chunk_bytes.max(Limits::offline().chunk_bytes);
    chunk
        .saturating_add((FRAME_ROOM * frame) as u64)
        .min(LIMIT_BYTES)
}
