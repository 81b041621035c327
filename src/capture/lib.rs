//! Frames from wherever they come: one [`FrameSource`] for V4L2 and simulator.
//!
//! A source never loses a frame silently: each loss is counted under its cause in
//! [`CaptureCounts`], and the number of frames that time says there should have been
//! is computed on its own, so that the two can be compared.
//!
//! ```
//! use hydroline_capture::sim::{Scene, SimCamera};
//! use hydroline_capture::{CaptureError, Captured, FrameSource};
//! use hydroline_core::clock::ManualClock;
//! use std::{sync::Arc, time::Duration};
//!
//! struct Dark;
//! impl Scene for Dark {
//!     fn image_at(&mut self, _t_s: f64, _index: u64) -> Result<Vec<u8>, CaptureError> {
//!         Ok(vec![0; 720 * 576])
//!     }
//! }
//! let camera = hydroline_rigs::Rig::builtin("lshpi")?.camera;
//! let mut source = SimCamera::new(Dark, &camera, Arc::new(ManualClock::new(0, 0)));
//! while !matches!(source.next(Duration::from_millis(10))?, Captured::Frame(_)) {}
//! let counts = source.counts();
//! assert_eq!(counts.received + counts.lost.total(), counts.expected);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

use std::time::Duration;

use hydroline_core::event::Event;
use hydroline_core::frame::Frame;

pub mod counts;
pub mod description;
pub mod devices;
pub mod error;
pub mod folder;
pub mod gaps;
pub mod queue;
pub mod sim;
pub mod v4l;

pub use counts::{CaptureCounts, Excluded, Losses, SecondCounts};
pub use description::{ControlReading, NegotiatedFormat, SourceDescription};
pub use error::CaptureError;
pub use folder::{FolderError, FolderFrames, ImageFolder};
pub use v4l::{OpenOptions, V4lSource};

/// A camera, or something that stands for one.
pub trait FrameSource: Send {
    /// Describes this source as it is set up now, for the log's session metadata.
    fn describe(&self) -> SourceDescription;

    /// The next thing that happened, after at most about `wait`.
    ///
    /// A source mends what it can by itself (frozen stream, unplug) and says so by
    /// [`Captured::Event`]; it goes on being called with the same recording open.
    ///
    /// # Errors
    /// Only what the source cannot mend: the caller ends the recording, in an orderly way.
    fn next(&mut self, wait: Duration) -> Result<Captured, CaptureError>;

    /// The caller stops here: frames that were due since the last one and never came are counted as lost.
    ///
    /// To be called once, after the last [`Self::next`] and before the last [`Self::counts`]. A source that ends by
    /// itself (a log) has nothing to add.
    fn finish(&mut self) {}

    /// Frames received, lost per cause, and expected, up to now.
    fn counts(&self) -> CaptureCounts;
}

/// One thing a source has to say.
#[derive(Debug, Clone, PartialEq)]
pub enum Captured {
    /// A frame, sound or marked by `meta.fault`.
    Frame(Frame),
    /// Something happened to the source; goes to the log, never dropped.
    Event(Event),
    /// Nothing within the wait.
    Nothing,
    /// No frame will ever come again (end of a log, of a simulated plan, of a script).
    Finished,
}
