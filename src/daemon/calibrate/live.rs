//! The calibration in the daemon: every analysed frame is looked at, until one is accepted.
//!
//! A state machine: frames in, messages and events out. It has no clock; the frames' stamps are its time.

use super::{PlacedBy, Pose, Setup, Sheet, message, rfc3339, see};
use hydroline_calib::Calibration;
use hydroline_calib::detect::NotFound;
use hydroline_core::event::{Event, Severity, kind};
use hydroline_core::frame::GreyImage;
use hydroline_log::messages::pb::PlaneCalibration;
use std::mem::{Discriminant, discriminant};

/// Period at which a missing board is asked for its reason \[ns\]: finding that out takes several frames' time.
const REASON_EVERY_NS: u64 = 1_000_000_000;
/// Period at which the same reason is reported again \[ns\].
const REPEAT_NS: u64 = 10_000_000_000;

/// Result of a look at one frame.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Look {
    /// For `/laser/calibration`.
    pub progress: Option<PlaneCalibration>,
    /// For `/daemon/event`.
    pub events: Vec<Event>,
    /// This frame completed the calibration.
    pub accepted: bool,
}

/// The state machine.
#[derive(Debug, Clone)]
pub struct Live {
    setup: Setup,
    pose: Pose,
    line: String,
    asked_ns: Option<u64>,
    reported: Option<(Discriminant<NotFound>, u64)>,
    /// Missing items when they were last reported, in words.
    missing: Vec<String>,
    accepted: Option<(Calibration, PlacedBy)>,
}

impl Live {
    /// Nothing seen yet.
    pub fn new(setup: Setup) -> Self {
        Live {
            pose: Pose::new(&setup),
            line: "no board seen yet".to_owned(),
            setup,
            asked_ns: None,
            reported: None,
            missing: Vec::new(),
            accepted: None,
        }
    }

    /// The status in one line.
    pub fn line(&self) -> &str {
        &self.line
    }

    /// The accepted calibration.
    pub fn accepted(&self) -> Option<&Calibration> {
        self.accepted.as_ref().map(|(c, _)| c)
    }

    /// Looks at a frame of that stamp (UNIX \[ns\]). After acceptance nothing is looked at any more.
    pub fn look(&mut self, image: &GreyImage, unix_ns: u64) -> Look {
        if self.accepted.is_some() {
            return Look::default();
        }
        let due = |since: Option<u64>, every: u64| {
            since.is_none_or(|at| unix_ns.saturating_sub(at) >= every)
        };
        let ask = due(self.asked_ns, REASON_EVERY_NS);
        match see(&self.setup, image, ask) {
            Err(reason) => {
                if ask {
                    self.asked_ns = Some(unix_ns);
                }
                self.line = reason.to_string();
                let kind = discriminant(&reason);
                let news = match self.reported {
                    Some((reported, at_ns)) => {
                        reported != kind || unix_ns.saturating_sub(at_ns) >= REPEAT_NS
                    }
                    None => true,
                };
                let mut look = Look::default();
                if ask && news {
                    self.reported = Some((kind, unix_ns));
                    look.events.push(Event::new(
                        unix_ns,
                        Severity::Warning,
                        &kind::CALIBRATION_NO_BOARD,
                        reason.to_string(),
                    ));
                }
                look
            }
            Ok(sighting) => {
                self.reported = None;
                let status = self.pose.push(&self.setup, sighting).clone();
                self.line = message::line(&status);
                let mut look = Look::default();
                if status.accepted {
                    self.accepted = self.pose.calibration(&self.setup, rfc3339(unix_ns));
                }
                let accepted = self.accepted();
                look.progress = Some(message::progress(&self.setup, &status, accepted, unix_ns));
                if let Some((calibration, by)) = &self.accepted {
                    look.accepted = true;
                    self.line = format!("calibration accepted: {}", calibration.claim());
                    look.events.push(numbers(
                        Event::new(
                            unix_ns,
                            Severity::Info,
                            &kind::CALIBRATION_ACCEPTED,
                            format!(
                                "calibration accepted: {}; placed {}{}",
                                calibration.claim(),
                                by.words(),
                                Sheet::of(&self.setup, calibration).map_or_else(
                                    String::new,
                                    |s| format!("; holds for {}", s.words())
                                )
                            ),
                        ),
                        &status,
                    ));
                } else if kinds(&self.missing) != kinds(&status.missing) {
                    look.events.push(numbers(
                        Event::new(
                            unix_ns,
                            Severity::Info,
                            &kind::CALIBRATION_PROGRESS,
                            format!("missing: {}", status.missing.join("; ")),
                        ),
                        &status,
                    ));
                    self.missing = status.missing;
                }
                look
            }
        }
    }

    /// Reason why there is no accepted calibration yet.
    pub fn missing(&self) -> String {
        match self.pose.status() {
            Some(status) if !status.missing.is_empty() => status.missing.join("; "),
            Some(_) => "no map could be fitted".to_owned(),
            None => self.line.clone(),
        }
    }
}

/// Missing items without their numbers, which change with every frame.
fn kinds(missing: &[String]) -> Vec<String> {
    missing
        .iter()
        .map(|words| words.chars().filter(|c| !c.is_ascii_digit()).collect())
        .collect()
}

fn numbers(event: Event, status: &hydroline_calib::online::Status) -> Event {
    let event = event
        .with("frames", f64::from(status.frames))
        .with("nodes", status.nodes as f64)
        .with("coverage", status.coverage.share());
    match status.worst_sd_m {
        Some(sd) => event.with("worst_sd_m", sd),
        None => event,
    }
}
