//! The state in the text format of Prometheus (version 0.0.4).

use super::state::State;
use std::fmt::Write;

/// The content type of what [`text`] gives.
pub const CONTENT_TYPE: &str = "text/plain; version=0.0.4; charset=utf-8";

struct Family<'a>(&'a mut String);

impl Family<'_> {
    fn head(&mut self, name: &str, kind: &str, help: &str) {
        let _ = writeln!(self.0, "# HELP {name} {help}\n# TYPE {name} {kind}");
    }

    fn one(&mut self, name: &str, kind: &str, help: &str, value: Option<f64>) {
        if let Some(value) = value {
            self.head(name, kind, help);
            let _ = writeln!(self.0, "{name} {}", number(value));
        }
    }

    fn labelled<'b>(
        &mut self,
        (name, help): (&str, &str),
        label: &str,
        samples: impl Iterator<Item = (&'b str, Option<f64>)>,
    ) {
        let samples: Vec<_> = samples.filter_map(|(of, v)| Some((of, v?))).collect();
        if samples.is_empty() {
            return;
        }
        self.head(name, "gauge", help);
        for (of, value) in samples {
            let of = escaped(of);
            let _ = writeln!(self.0, "{name}{{{label}=\"{of}\"}} {}", number(value));
        }
    }
}

fn number(value: f64) -> String {
    match value {
        v if v.is_nan() => "NaN".to_owned(),
        v if v.is_infinite() => if v > 0.0 { "+Inf" } else { "-Inf" }.to_owned(),
        v => v.to_string(),
    }
}

fn escaped(label: &str) -> String {
    label
        .replace('\\', "\\\\")
        .replace('"', "\\\"")
        .replace('\n', "\\n")
}

/// All samples of a state; `connections` = viewers' open connections.
pub fn text(state: &State, connections: usize) -> String {
    let mut out = String::new();
    let mut to = Family(&mut out);
    let frames = &state.frames;
    let counters = [
        (
            "hydroline_frames_received_total",
            "Frames received from the camera.",
            frames.received,
        ),
        (
            "hydroline_frames_lost_total",
            "Frames lost by the camera.",
            frames.lost,
        ),
        (
            "hydroline_frames_dropped_total",
            "Frames dropped by the log's queue.",
            frames.dropped,
        ),
        (
            "hydroline_frames_not_analysed_total",
            "Frames not analysed live.",
            frames.skipped,
        ),
    ];
    for (name, help, value) in counters {
        to.one(name, "counter", help, Some(value as f64));
    }
    to.one(
        "hydroline_frame_rate_hertz",
        "gauge",
        "Frames per second.",
        frames.rate_fps,
    );
    to.one(
        "hydroline_stripe_points",
        "gauge",
        "Points in the newest stripe.",
        Some(frames.points as f64),
    );
    to.one(
        "hydroline_elapsed_seconds",
        "gauge",
        "Since camera and controller were ready.",
        state.run.elapsed_s,
    );
    to.one(
        "hydroline_plan_step",
        "gauge",
        "Step of the plan, from 1; 0 = none.",
        Some(f64::from(state.run.step)),
    );
    to.one(
        "hydroline_stop_pressed",
        "gauge",
        "1 = STOP was pressed on the page.",
        Some(f64::from(u8::from(state.stop.pressed))),
    );
    if let Some(disk) = &state.disk {
        to.one(
            "hydroline_log_bytes",
            "gauge",
            "Bytes in the log.",
            Some(disk.bytes as f64),
        );
        let left_s = disk.left_min.map(|m| 60.0 * m);
        to.one(
            "hydroline_disk_left_seconds",
            "gauge",
            "Recording that the disk still takes.",
            left_s,
        );
    }
    if let Some(clock) = &state.clock {
        to.one(
            "hydroline_controller_offset_sd_seconds",
            "gauge",
            "How well the controller's clock is known.",
            Some(1e-6 * clock.offset_sd_us),
        );
        to.one(
            "hydroline_controller_drift_ratio",
            "gauge",
            "Controller's clock fast against ours.",
            Some(1e-6 * clock.drift_ppm),
        );
        to.one(
            "hydroline_controller_round_trip_seconds",
            "gauge",
            "Round trip, median.",
            Some(1e-6 * clock.round_trip_us),
        );
    }
    if let Some(pose) = &state.pose {
        let channels = || pose.channels.iter();
        to.labelled(
            ("hydroline_pose", "Measured pose, m and rad."),
            "channel",
            channels().map(|c| (c.name, c.value)),
        );
        to.labelled(
            (
                "hydroline_pose_residual",
                "Measured less predicted, m and rad.",
            ),
            "channel",
            channels().map(|c| (c.name, c.residual)),
        );
    }
    let thrusters = || state.thrusters.iter();
    to.labelled(
        (
            "hydroline_thrust_newtons",
            "Thrust at the pulse that was sent.",
        ),
        "thruster",
        thrusters().map(|t| (t.name.as_str(), t.thrust_n)),
    );
    to.labelled(
        ("hydroline_pulse_seconds", "Pulse that was sent."),
        "thruster",
        thrusters().map(|t| (t.name.as_str(), t.pulse_us.map(|p| 1e-6 * p))),
    );
    to.labelled(
        (
            "hydroline_pulse_echoed_seconds",
            "Pulse that the controller puts out.",
        ),
        "thruster",
        thrusters().map(|t| (t.name.as_str(), t.echo_us.map(|p| 1e-6 * p))),
    );
    to.one(
        "hydroline_live_connections",
        "gauge",
        "Open connections to the live page.",
        Some(connections as f64),
    );
    out
}

#[cfg(test)]
mod tests {
    use super::super::state::{Disk, Thruster};
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn what_is_there_is_reported_and_what_is_not_is_absent() {
        let mut state = State::default();
        state.frames.received = 250;
        state.disk = Some(Disk {
            bytes: 1000,
            left_min: Some(2.0),
        });
        let text = text(&state, 3);
        for line in [
            "hydroline_frames_received_total 250",
            "hydroline_disk_left_seconds 120",
            "hydroline_live_connections 3",
            "# TYPE hydroline_frames_lost_total counter",
        ] {
            assert!(text.lines().any(|l| l == line), "{line}\n{text}");
        }
        assert!(
            !text.contains("elapsed") && !text.contains("thrust_newtons"),
            "{text}"
        );
    }

    proptest! {
        #[test]
        fn a_name_never_ends_its_line_or_its_quotes(name in ".*", value in any::<f64>()) {
            let thruster = Thruster { name, thrust_n: Some(value), ..Thruster::default() };
            let state = State { thrusters: vec![thruster], ..State::default() };
            let text = text(&state, 0);
            let lines: Vec<_> = text.split('\n').filter(|l| l.starts_with("hydroline_thrust_newtons{")).collect();
            prop_assert_eq!(lines.len(), 1);
            let (head, tail) = lines[0].rsplit_once("\"} ").unwrap();
            prop_assert!(tail.parse::<f64>().is_ok());
            let label = head.strip_prefix("hydroline_thrust_newtons{thruster=\"").unwrap();
            // Every quote inside stands behind an odd number of backslashes.
            let mut slashes = 0;
            for c in label.chars() {
                match c {
                    '\\' => slashes += 1,
                    '"' => { prop_assert!(slashes % 2 == 1); slashes = 0; }
                    _ => slashes = 0,
                }
            }
            prop_assert!(slashes % 2 == 0);
        }
    }
}
