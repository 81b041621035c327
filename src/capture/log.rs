//! The frames of a log as a [`FrameSource`]: whatever runs behind a camera runs behind a recording.
//!
//! Capture otherwise knows frames, events and clocks only. Here it reads through [`hydroline_log::LogReader`]: the log's
//! records are checked and decoded in that one place, and a second reader of the same files would be one to diverge. The
//! dependency goes one way, to the reader; nothing of the log knows of this source.
//!
//! Nothing is lost here: a slow consumer delays the frames. Sequence, stamps, faults and the losses noted before each
//! frame come out as they were recorded; the account is made anew from sequence and stamps by the same two witnesses as
//! while recording ([`super::gaps`]), with the pauses that the log's events name. A frame that the log itself dropped
//! (`log.frames_dropped`) therefore counts as lost here: it is not in the file.

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Duration;

use hydroline_rigs::Rig;

use super::gaps::{Account, Note, Pause};
use super::{
    CaptureCounts, CaptureError, Captured, FrameSource, NegotiatedFormat, SourceDescription,
};
use hydroline_core::clock::Clock;
use hydroline_core::frame::{Frame, FrameMeta};
use hydroline_log::messages::format_name;
use hydroline_log::{LogError, LogReader, Record};

/// Plays the `/camera/image` frames of a log, in the file's order.
pub struct LogSource {
    path: PathBuf,
    reader: LogReader,
    pace: Option<Pace>,
    description: SourceDescription,
    account: Account,
    /// Read, not yet due.
    ahead: Option<Frame>,
    ended: bool,
}

/// Frames come at the distances of their stamps.
struct Pace {
    clock: Arc<dyn Clock>,
    /// Clock and stamp of the first frame \[ns\].
    start_ns: Option<(u64, u64)>,
}

impl LogSource {
    /// Opens a log and reads up to its first frame. `pace` `None` = as fast as asked; a clock = each frame when its
    /// mid-exposure is due on it, counted from the first call of `next`.
    ///
    /// # Errors
    /// [`CaptureError::Source`] when the file cannot be read, is no log, is damaged before its first frame, or has none.
    pub fn open(path: &Path, pace: Option<Arc<dyn Clock>>) -> Result<Self, CaptureError> {
        let reader = LogReader::open(path).map_err(|error| broken(path, &error))?;
        let rig = reader
            .rig_toml()
            .and_then(|toml| Rig::from_toml(toml, "the log's rig", None).ok());
        // A third-party log names no rate: the account then takes it from the stamps.
        let rate_fps = rig.map_or(0.0, |rig| rig.camera.rate_fps);
        let period_s = if rate_fps > 0.0 { 1.0 / rate_fps } else { 0.0 };
        let mut source = Self {
            path: path.to_owned(),
            reader,
            pace: pace.map(|clock| Pace {
                clock,
                start_ns: None,
            }),
            description: SourceDescription::default(),
            account: Account::new(period_s),
            ahead: None,
            ended: false,
        };
        let first = source.read()?.ok_or_else(|| CaptureError::Source {
            source_name: path.display().to_string(),
            reason: "holds no frame on /camera/image: choose a log that was recorded with a camera"
                .to_owned(),
        })?;
        source.description = describe(path, source.reader.library(), &first, rate_fps);
        source.ahead = Some(first);
        Ok(source)
    }

    /// The next frame of the file; `None` = there is no further one.
    fn read(&mut self) -> Result<Option<Frame>, CaptureError> {
        for item in self.reader.by_ref() {
            match item {
                Ok(message) => match message.record {
                    Record::Frame(frame) => return Ok(Some(frame)),
                    Record::Event(event) => {
                        if let Some(cause) = pause(&event.kind) {
                            self.account.pause(cause);
                        }
                    }
                    _ => {}
                },
                Err(error) => {
                    // What follows damage may be sound, but no longer complete: `recover` is the tool for it.
                    self.ended = true;
                    return Err(broken(&self.path, &error));
                }
            }
        }
        self.ended = true;
        Ok(None)
    }

    fn count(&mut self, meta: &FrameMeta) {
        // Mid-exposure is on one scale for every frame and every log; a driver's raw stamp may be on any clock, or missing.
        let (_, notes) = self.account.frame(meta.sequence, meta.mid_exposure_ns);
        if !notes.iter().any(|n| matches!(n, Note::Repeated { .. }))
            && let Some(fault) = meta.fault
        {
            self.account.mark(fault);
        }
    }
}

impl FrameSource for LogSource {
    fn describe(&self) -> SourceDescription {
        self.description.clone()
    }

    fn next(&mut self, wait: Duration) -> Result<Captured, CaptureError> {
        if self.ahead.is_none() && !self.ended {
            self.ahead = self.read()?;
        }
        let Some(frame) = self.ahead.take() else {
            return Ok(Captured::Finished);
        };
        if let Some(pace) = &mut self.pace {
            let now_ns = pace.clock.monotonic_ns();
            let stamp_ns = frame.meta.mid_exposure_ns;
            let (start_ns, first_ns) = *pace.start_ns.get_or_insert((now_ns, stamp_ns));
            let due_ns = start_ns.saturating_add(stamp_ns.saturating_sub(first_ns));
            let left = Duration::from_nanos(due_ns.saturating_sub(now_ns));
            pace.clock.sleep(left.min(wait));
            if left > wait {
                self.ahead = Some(frame);
                return Ok(Captured::Nothing);
            }
        }
        self.count(&frame.meta);
        Ok(Captured::Frame(frame))
    }

    fn counts(&self) -> CaptureCounts {
        self.account.counts()
    }
}

/// The pause that an event of [`super::v4l`] stands for.
fn pause(kind: &str) -> Option<Pause> {
    match kind {
        "camera.frozen" => Some(Pause::Frozen),
        "camera.unplugged" => Some(Pause::Unplugged),
        "camera.stream_error" | "camera.void_buffers" | "camera.driver_nonsense" => {
            Some(Pause::Restarted)
        }
        _ => None,
    }
}

fn broken(path: &Path, error: &LogError) -> CaptureError {
    // The log's errors begin with the path, and so does CaptureError::Source.
    let text = error.to_string();
    let name = path.display().to_string();
    let reason = text
        .strip_prefix(&format!("{name}: "))
        .unwrap_or(&text)
        .to_owned();
    CaptureError::Source {
        source_name: name,
        reason,
    }
}

fn describe(path: &Path, library: &str, first: &Frame, rate_fps: f64) -> SourceDescription {
    let size = |n: usize| u32::try_from(n).unwrap_or(u32::MAX);
    SourceDescription {
        kind: "log".to_owned(),
        driver: library.to_owned(),
        node: path.display().to_string(),
        format: NegotiatedFormat {
            fourcc: format_name(first.format),
            width_px: first.width_px,
            height_px: first.height_px,
            stride_bytes: first.stride_bytes,
            // JPEGs differ in size from frame to frame.
            size_bytes: if first.format.is_compressed() {
                0
            } else {
                size(first.data.len())
            },
            field: "none".to_owned(),
            yuv_range: None,
        },
        rate_fps,
        ..SourceDescription::default()
    }
}

#[cfg(test)]
mod tests;
