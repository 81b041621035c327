//! Frames to JPEG: one at a time, each once for all viewers, on a thread that yields to everything else, and only when
//! somebody asks.

use super::super::feed::Numbered;
use super::super::jpeg::{halved, halvings, write_jpeg};
use super::super::picture::Picture;
use bytes::Bytes;
use hydroline_core::thread_class::step_back;
use std::sync::Arc;
use std::time::Duration;
use tokio::sync::{Mutex, watch};
use tokio::time::Instant;

/// Between two pictures: fifteen a second are smooth enough to aim by.
const PERIOD: Duration = Duration::from_millis(66);

/// The newest picture as it is sent: length of the overlay (u32, little endian), overlay (JSON), image (JPEG, or empty
/// where the frame cannot be read).
#[derive(Debug, Clone)]
pub(super) struct Encoded {
    pub(super) number: u64,
    pub(super) bytes: Bytes,
    /// Picture that it was made of.
    pub(super) picture: Arc<Picture>,
    /// Where the image begins in the bytes.
    image_at: usize,
    /// Its size over the frame's.
    pub(super) scale: f32,
}

impl Encoded {
    /// The image alone.
    pub(super) fn jpeg(&self) -> Bytes {
        self.bytes.slice(self.image_at..)
    }
}

#[derive(Debug, Default)]
pub(super) struct Encoder {
    last: Mutex<Option<(Encoded, Instant)>>,
}

impl Encoder {
    /// The newest picture, encoded now or for somebody else before; `None` when it could not be.
    pub(super) async fn newest(
        &self,
        pictures: &watch::Receiver<Numbered<Picture>>,
    ) -> Option<Encoded> {
        let mut last = self.last.lock().await;
        if let Some((encoded, at)) = &*last {
            if encoded.number == pictures.borrow().number {
                return Some(encoded.clone());
            }
            tokio::time::sleep_until(*at + PERIOD).await;
        }
        // Newer still, after the wait.
        let Numbered { number, value } = pictures.borrow().clone();
        let picture: Arc<Picture> = value?;
        let encoded = tokio::task::spawn_blocking(move || {
            step_back(19);
            encode(number, picture)
        });
        let encoded = encoded.await.ok()?;
        *last = Some((encoded.clone(), Instant::now()));
        Some(encoded)
    }
}

fn encode(number: u64, picture: Arc<Picture>) -> Encoded {
    let overlay = serde_json::to_vec(&picture.overlay).unwrap_or_default();
    let mut out = Vec::with_capacity(64 << 10);
    out.extend((overlay.len() as u32).to_le_bytes());
    out.extend(overlay);
    let image_at = out.len();
    // A frame that does not decode has no image; the overlay says why. Blocks that look like damage are for eyes to see.
    if let Ok(inspected) = picture.frame.inspect(&picture.rule) {
        write_jpeg(&halved(inspected.image), &mut out);
    }
    Encoded {
        number,
        bytes: out.into(),
        image_at,
        scale: 0.5_f32.powi(halvings(picture.frame.width_px as usize) as i32),
        picture,
    }
}
