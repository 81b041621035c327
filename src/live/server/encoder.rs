//! Frames to JPEG: one at a time, each once for all viewers, on a thread that yields to everything else, and only when
//! somebody asks.

use super::super::feed::Numbered;
use super::super::picture::Picture;
use bytes::Bytes;
use hydroline_core::frame::GreyImage;
use hydroline_core::thread_class::step_back;
use image::ExtendedColorType;
use image::codecs::jpeg::JpegEncoder;
use std::sync::Arc;
use std::time::Duration;
use tokio::sync::{Mutex, watch};
use tokio::time::Instant;

/// Between two pictures: fifteen a second are smooth enough to aim by.
const PERIOD: Duration = Duration::from_millis(66);
/// Wider images are halved until they fit: no screen at a tank shows more.
const WIDTH_MAX_PX: usize = 1280;
const QUALITY: u8 = 75;

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

/// Appends an image; nothing where it cannot be encoded.
fn write_jpeg(grey: &GreyImage, out: &mut Vec<u8>) {
    let before = out.len();
    let sides = (u16::try_from(grey.width_px), u16::try_from(grey.height_px));
    if let (Ok(width), Ok(height)) = sides {
        let mut jpeg = JpegEncoder::new_with_quality(&mut *out, QUALITY);
        let written = jpeg.encode(
            &grey.pixels,
            width.into(),
            height.into(),
            ExtendedColorType::L8,
        );
        if written.is_err() {
            out.truncate(before);
        }
    }
}

/// Number of times that an image of this width is halved.
fn halvings(mut width_px: usize) -> u32 {
    let mut times = 0;
    while width_px > WIDTH_MAX_PX {
        (width_px, times) = (width_px / 2, times + 1);
    }
    times
}

/// Halved until it is no wider than a screen; each pixel the mean of four.
fn halved(mut image: GreyImage) -> GreyImage {
    for _ in 0..halvings(image.width_px) {
        let (width_px, height_px) = (image.width_px / 2, image.height_px / 2);
        let mut pixels = Vec::with_capacity(width_px * height_px);
        for rows in image.pixels.chunks_exact(2 * image.width_px) {
            let (upper, lower) = rows.split_at(image.width_px);
            let four = upper.chunks_exact(2).zip(lower.chunks_exact(2));
            pixels.extend(four.map(|(u, l)| {
                let sum = u.iter().chain(l).map(|p| u16::from(*p)).sum::<u16>();
                ((sum + 2) / 4) as u8
            }));
        }
        image = GreyImage {
            width_px,
            height_px,
            pixels,
        };
    }
    image
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_wide_image_is_halved_to_its_mean() {
        let row = |a: u8, b: u8| [a, b].repeat(1000);
        let pixels = [row(10, 20), row(30, 40), row(0, 0)].concat();
        let small = halved(GreyImage {
            width_px: 2000,
            height_px: 3,
            pixels,
        });
        assert_eq!((small.width_px, small.height_px), (1000, 1));
        assert!(small.pixels.iter().all(|p| *p == 25) && small.pixels.len() == 1000);
    }
}
