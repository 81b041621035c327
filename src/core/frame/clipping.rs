//! Pixels that are clipped in a colour while their luma does not show it.
//!
//! The stripe's fit knows clipped pixels by their level. A green laser that clips green alone makes a luma of 182 at
//! most: its flat top then passes for the line's shape. The cure is to read the channel; here it is only noticed.

use super::{Channel, Frame, FrameError, GreyImage, GreyRule, still};

/// From this level on a pixel counts as clipped, as for the stripe.
const CLIPPED_FROM: u8 = 254;

/// Clipping that a frame's luma hides.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct HiddenClipping {
    /// The channel that clips most.
    pub channel: Channel,
    /// Its pixels that are clipped and whose luma is not.
    pub pixels: u64,
}

/// Looks at some of a stream's frames for clipping that their luma hides.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct ClippingWatch {
    seen: u64,
    looked: u64,
    clipped: u64,
    worst: Option<HiddenClipping>,
}

impl ClippingWatch {
    /// One frame of so many is looked at: a clipped laser clips for long, and a look costs four conversions.
    pub const EVERY: u64 = 25;

    /// The next frame of the stream. What does not decode is reported elsewhere.
    pub fn see(&mut self, frame: &Frame, rule: &GreyRule) {
        let turn = self.seen.is_multiple_of(Self::EVERY);
        self.seen += 1;
        if turn && let Ok(hidden) = frame.hidden_clipping(rule) {
            self.looked += 1;
            self.clipped += u64::from(hidden.is_some());
            if hidden.map_or(0, |h| h.pixels) > self.worst.map_or(0, |w| w.pixels) {
                self.worst = hidden;
            }
        }
    }

    /// Message about hidden clipping, with the cure; `None` = there was none.
    pub fn words(&self) -> Option<String> {
        let worst = self.worst?;
        Some(format!(
            "{} of {} frames looked at: {worst}",
            self.clipped, self.looked
        ))
    }
}

impl std::fmt::Display for HiddenClipping {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let (pixels, channel) = (self.pixels, self.channel.name());
        write!(
            f,
            "up to {pixels} pixels are clipped in {channel} while their luma does not show it: the stripe's fit takes \
             them for sound; set laser.channel = \"{channel}\" if that is the laser's colour, or shorten the exposure"
        )
    }
}

impl Frame {
    /// Clipping that the frame's luma does not show; `None` where there is none, or a channel is read as it is. Takes as
    /// long as four conversions, of a compressed frame with one decoding: ask it of samples.
    ///
    /// # Errors
    /// As [`Frame::inspect`].
    pub fn hidden_clipping(&self, rule: &GreyRule) -> Result<Option<HiddenClipping>, FrameError> {
        if rule.channel != Channel::Luma || !self.format.has_colour() {
            return Ok(None);
        }
        // Whatever its blocks look like: clipping is said of a stream, not of a frame.
        if self.format.is_compressed() {
            return still::hidden_in_frame(self, rule);
        }
        worst(rule, |rule| self.to_grey(rule))
    }
}

/// The channel that clips most where luma does not, of images read by `of`.
pub(super) fn worst<E>(
    rule: &GreyRule,
    of: impl Fn(&GreyRule) -> Result<GreyImage, E>,
) -> Result<Option<HiddenClipping>, E> {
    let luma = of(rule)?;
    let mut worst: Option<HiddenClipping> = None;
    for channel in [Channel::Red, Channel::Green, Channel::Blue] {
        let image = of(&GreyRule { channel, ..*rule })?;
        let pairs = image.pixels.iter().zip(&luma.pixels);
        let hidden = pairs.filter(|(c, y)| **c >= CLIPPED_FROM && **y < CLIPPED_FROM);
        let pixels = hidden.count() as u64;
        if pixels > worst.map_or(0, |w| w.pixels) {
            worst = Some(HiddenClipping { channel, pixels });
        }
    }
    Ok(worst)
}
