//! State of a run, ten times a second: plain numbers and words, ready for the page and for Prometheus.
//!
//! Fields that a kind of run does not have (`aim` no thrusters, `replay` no disk) are absent, and the page leaves them out.

use hydroline_core::event::Severity;
use serde::Serialize;
use std::collections::VecDeque;

/// A run as it is now.
#[derive(Debug, Clone, PartialEq, Default, Serialize)]
pub struct State {
    /// `record`, `aim`, `simulate` or `replay`.
    pub mode: &'static str,
    /// The rig, and the log.
    pub title: String,
    /// Present phase of the run, in words.
    pub phase: String,
    /// The run is over; nothing will change any more.
    pub ended: bool,
    /// Where in the run.
    pub run: Run,
    /// The camera's account.
    pub frames: Frames,
    /// The log and its disk.
    pub disk: Option<Disk>,
    /// The thruster controller's clock against ours.
    pub clock: Option<Clock>,
    /// Where the vehicle is.
    pub pose: Option<Pose>,
    /// Load per thruster, in the rig's order.
    pub thrusters: Vec<Thruster>,
    /// The STOP button.
    pub stop: Stop,
    /// Quantities that the run so far cannot show, each with its reason; empty = none.
    pub not_shown: Vec<String>,
    /// Focus, exposure and laser.
    pub aim: Vec<Check>,
    /// Events, newest last.
    pub events: VecDeque<Event>,
}

/// Where in the run.
#[derive(Debug, Clone, PartialEq, Default, Serialize)]
pub struct Run {
    /// Since camera and controller were ready \[s\]; `None` = not ready yet.
    pub elapsed_s: Option<f64>,
    /// Length that was asked for \[s\].
    pub length_s: Option<f64>,
    /// The plan's name.
    pub plan: Option<String>,
    /// Step of the plan, from 1; 0 = none.
    pub step: u32,
    /// Steps of the plan.
    pub steps: u32,
}

/// The camera's account.
#[derive(Debug, Clone, PartialEq, Default, Serialize)]
pub struct Frames {
    /// Frames received.
    pub received: u64,
    /// Lost by the camera.
    pub lost: u64,
    /// Dropped by the log's queue.
    pub dropped: u64,
    /// Not analysed live: a newer one came first.
    pub skipped: u64,
    /// Per second, over the last seconds; `None` = not known yet.
    pub rate_fps: Option<f64>,
    /// Points in the newest stripe.
    pub points: u64,
}

/// The log and its disk.
#[derive(Debug, Clone, PartialEq, Default, Serialize)]
pub struct Disk {
    /// Bytes in the log.
    pub bytes: u64,
    /// Minutes of recording that the disk still takes.
    pub left_min: Option<f64>,
}

/// The controller's clock against ours.
#[derive(Debug, Clone, PartialEq, Default, Serialize)]
pub struct Clock {
    /// Standard deviation of the offset \[us\].
    pub offset_sd_us: f64,
    /// Controller fast against host \[ppm\].
    pub drift_ppm: f64,
    /// Round trip, median \[us\].
    pub round_trip_us: f64,
}

/// Where the vehicle is.
#[derive(Debug, Clone, PartialEq, Default, Serialize)]
pub struct Pose {
    /// When it was true, UNIX \[s\].
    pub at_s: f64,
    /// Age when this was written \[s\].
    pub age_s: f64,
    /// x, y, z, roll, pitch, yaw.
    pub channels: Vec<Channel>,
    /// Source of the pose: measured, simulated, from the log.
    pub kind: &'static str,
}

/// One degree of freedom. Metres, and radians where the name says so.
#[derive(Debug, Clone, PartialEq, Default, Serialize)]
pub struct Channel {
    /// `x_m` ... `psi_rad`.
    pub name: &'static str,
    /// Measured; `None` = the frame does not show it.
    pub value: Option<f64>,
    /// Its standard deviation.
    pub sd: Option<f64>,
    /// Where the rig's model has it, from the commands that were sent.
    pub predicted: Option<f64>,
    /// Measured less predicted.
    pub residual: Option<f64>,
}

/// Names of the channels, with their units.
pub const CHANNELS: [&str; 6] = ["x_m", "y_m", "z_m", "phi_rad", "theta_rad", "psi_rad"];

impl Pose {
    /// From what is measured (value, standard deviation) and what is predicted.
    pub fn new(
        kind: &'static str,
        at_s: f64,
        age_s: f64,
        measured: [Option<(f64, f64)>; 6],
        predicted: Option<[f64; 6]>,
    ) -> Self {
        let channels = CHANNELS.iter().enumerate().map(|(i, name)| {
            let (value, predicted) = (measured[i].map(|m| m.0), predicted.map(|p| p[i]));
            Channel {
                name,
                value,
                sd: measured[i].map(|m| m.1),
                predicted,
                residual: value.zip(predicted).map(|(value, p)| value - p),
            }
        });
        Self {
            at_s,
            age_s,
            channels: channels.collect(),
            kind,
        }
    }
}

/// Load of a thruster.
#[derive(Debug, Clone, PartialEq, Default, Serialize)]
pub struct Thruster {
    /// Name in the rig.
    pub name: String,
    /// Thrust at the pulse that was sent \[N\]; `None` = nothing sent yet.
    pub thrust_n: Option<f64>,
    /// Pulse that was sent \[us\].
    pub pulse_us: Option<f64>,
    /// Pulse that the controller says it puts out \[us\].
    pub echo_us: Option<f64>,
    /// Thrust of that pulse by the rig's curve \[N\].
    pub echo_n: Option<f64>,
    /// Least and greatest thrust of the rig's curve \[N\].
    pub range_n: [f64; 2],
}

/// The STOP button.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize)]
pub struct Stop {
    /// There are thrusters to stop.
    pub possible: bool,
    /// It was pressed.
    pub pressed: bool,
}

/// One thing to get right before a run.
#[derive(Debug, Clone, PartialEq, Default, Serialize)]
pub struct Check {
    /// `focus`, `exposure`, `laser`, `camera`.
    pub what: &'static str,
    /// Is it right? `None` = nothing to judge by.
    pub good: Option<bool>,
    /// In a few words, with the number.
    pub words: String,
}

/// Something that happened.
#[derive(Debug, Clone, PartialEq, Default, Serialize)]
pub struct Event {
    /// UNIX \[s\].
    pub at_s: f64,
    /// `info`, `warning`, `error`.
    pub severity: &'static str,
    /// The machine word.
    pub kind: String,
    /// One sentence.
    pub message: String,
}

/// Events that the page shows.
pub const EVENTS_MAX: usize = 50;
/// Longest message that is shown, in characters.
const MESSAGE_MAX: usize = 400;

impl Event {
    /// One event; a long message is cut.
    pub fn new(timestamp_ns: u64, severity: Severity, kind: &str, message: &str) -> Self {
        Self {
            at_s: timestamp_ns as f64 * 1e-9,
            severity: match severity {
                Severity::Info => "info",
                Severity::Warning => "warning",
                Severity::Error => "error",
            },
            kind: kind.to_owned(),
            message: message.chars().take(MESSAGE_MAX).collect(),
        }
    }
}

impl From<&hydroline_core::event::Event> for Event {
    fn from(event: &hydroline_core::event::Event) -> Self {
        Self::new(
            event.timestamp_ns,
            event.severity,
            event.kind.name,
            &event.message,
        )
    }
}

/// Keeps the newest [`EVENTS_MAX`].
pub fn keep(events: &mut VecDeque<Event>, event: Event) {
    if events.len() == EVENTS_MAX {
        events.pop_front();
    }
    events.push_back(event);
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_residual_needs_both_sides() {
        let mut measured = [None; 6];
        measured[0] = Some((0.25, 0.001));
        let pose = Pose::new("measured", 1.0, 0.1, measured, Some([0.2; 6]));
        assert!((pose.channels[0].residual.unwrap() - 0.05).abs() < 1e-12);
        assert_eq!(
            (pose.channels[1].residual, pose.channels[1].predicted),
            (None, Some(0.2))
        );
        assert_eq!(
            Pose::new("measured", 1.0, 0.1, measured, None).channels[0].residual,
            None
        );
    }

    #[test]
    fn a_flood_of_events_does_not_grow() {
        let mut events = VecDeque::new();
        for k in 0..10_000 {
            keep(
                &mut events,
                Event {
                    at_s: f64::from(k),
                    ..Event::default()
                },
            );
        }
        assert_eq!(
            (events.len(), events[EVENTS_MAX - 1].at_s),
            (EVENTS_MAX, 9999.0)
        );
    }
}
