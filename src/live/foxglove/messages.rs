//! State and picture as the log's messages.

use super::super::picture::{Overlay, Picture};
use super::super::state::{Event, Pose, State};
use super::{Channel, Viewer};
use bytes::Bytes;
use foxglove::messages as fg;
use hydroline_log::Topic;
use hydroline_log::messages::pb::{self, StripeProfile, ThrusterCommand, ThrusterEcho};
use hydroline_log::messages::{
    CAMERA_FRAME, CompressedImage, ImageAnnotations, VehicleMotion, foxglove_time, pose_message,
    stripe_annotations, timestamp,
};
use prost::Message as _;

const NS_PER_S: f64 = 1e9;

fn ns(at_s: f64) -> u64 {
    (at_s * NS_PER_S) as u64
}

/// Last pose and event that one viewer has been sent, so that each is sent once.
#[derive(Debug, Default)]
pub struct Sent {
    pose_s: f64,
    event: Option<Event>,
}

impl Sent {
    /// Messages of a state at this time (UNIX \[ns\]).
    pub fn of_state(&mut self, viewer: &Viewer, state: &State, at_ns: u64) -> Vec<Bytes> {
        let mut out = Vec::new();
        let mut tell = |channel: Channel, data: &[u8]| {
            out.extend(viewer.frames(channel, at_ns, data));
        };
        if viewer.wants(|c| c == Channel::State) {
            let json = serde_json::to_vec(state).unwrap_or_default();
            tell(Channel::State, &json);
        }
        if let Some(pose) = state.pose.as_ref().filter(|p| p.at_s != self.pose_s) {
            self.pose_s = pose.at_s;
            let motion = motion(pose);
            tell(Channel::Log(Topic::Motion), &motion.encode_to_vec());
            if let Some(pose) = pose_message(&motion) {
                tell(Channel::Log(Topic::Pose), &pose.encode_to_vec());
            }
        }
        for thruster in &state.thrusters {
            let name = thruster.name.clone();
            if let (Some(thrust_n), Some(pulse_us)) = (thruster.thrust_n, thruster.pulse_us) {
                let command = ThrusterCommand {
                    timestamp: Some(timestamp(at_ns)),
                    thruster: name.clone(),
                    thrust_n,
                    pulse_us,
                    plan_step: state.run.step,
                    ..ThrusterCommand::default()
                };
                tell(Channel::Log(Topic::Command), &command.encode_to_vec());
            }
            if let Some(pulse_us) = thruster.echo_us {
                let echo = ThrusterEcho {
                    timestamp: Some(timestamp(at_ns)),
                    thruster: name,
                    pulse_us,
                    ..ThrusterEcho::default()
                };
                tell(Channel::Log(Topic::Echo), &echo.encode_to_vec());
            }
        }
        for event in self.news(state) {
            tell(Channel::Log(Topic::Event), &event.encode_to_vec());
        }
        out
    }

    /// Events behind the one that was sent last.
    fn news(&mut self, state: &State) -> Vec<pb::Event> {
        let sent = self.event.as_ref();
        let behind = sent.and_then(|last| state.events.iter().rposition(|e| e == last));
        let from = behind.map_or(0, |i| i + 1);
        let news = state.events.iter().skip(from).map(event).collect();
        self.event = state.events.back().cloned();
        news
    }
}

/// Messages of a picture, whose image was encoded as `jpeg`, `scale` times its size.
pub fn of_picture(
    viewer: &Viewer,
    picture: &Picture,
    jpeg: Bytes,
    scale: f32,
    at_ns: u64,
) -> Vec<Bytes> {
    let stamp_ns = picture.frame.meta.mid_exposure_ns;
    let mut out = Vec::new();
    if !jpeg.is_empty() {
        let image = CompressedImage {
            timestamp: Some(foxglove_time(stamp_ns)),
            frame_id: CAMERA_FRAME.to_owned(),
            data: jpeg,
            format: "jpeg".to_owned(),
        };
        let data = image.encode_to_vec();
        out.extend(viewer.frames(Channel::Log(Topic::CompressedImage), at_ns, &data));
    }
    let drawn = annotations(&picture.overlay, scale, stamp_ns).encode_to_vec();
    out.extend(viewer.frames(Channel::Log(Topic::Annotations), at_ns, &drawn));
    out
}

/// The stripe as the log draws it, and where floor and target should be seen.
fn annotations(overlay: &Overlay, scale: f32, stamp_ns: u64) -> ImageAnnotations {
    // Pixel centres are whole numbers; an image of half the size has its first centre at a quarter of the first pixel's side.
    let scaled = |v: f32| (v + 0.5) * scale - 0.5;
    let mut made = stripe_annotations(&StripeProfile {
        timestamp: Some(timestamp(stamp_ns)),
        column_px: overlay.stripe_px.iter().map(|p| scaled(p[0])).collect(),
        row_px: overlay.stripe_px.iter().map(|p| scaled(p[1])).collect(),
        ..StripeProfile::default()
    });
    let lines = overlay.outline_px.split(Option::is_none);
    let lines = lines.filter(|line| line.len() > 1);
    made.points.extend(lines.map(|line| {
        fg::PointsAnnotation {
            timestamp: Some(foxglove_time(stamp_ns)),
            r#type: fg::points_annotation::Type::LineStrip.into(),
            points: line
                .iter()
                .flatten()
                .map(|p| fg::Point2 {
                    x: f64::from(scaled(p[0])) + 0.5,
                    y: f64::from(scaled(p[1])) + 0.5,
                })
                .collect(),
            outline_color: Some(fg::Color {
                r: 0.2,
                g: 0.6,
                b: 1.0,
                a: 1.0,
            }),
            thickness: 1.0,
            ..fg::PointsAnnotation::default()
        }
    }));
    made
}

fn motion(pose: &Pose) -> VehicleMotion {
    let value = |i: usize| pose.channels.get(i).and_then(|c| c.value);
    VehicleMotion::of_pose(ns(pose.at_s), std::array::from_fn(value))
}

fn event(of: &Event) -> pb::Event {
    let severity = match of.severity {
        "info" => pb::event::Severity::Info,
        "warning" => pb::event::Severity::Warning,
        _ => pb::event::Severity::Error,
    };
    pb::Event {
        timestamp: Some(timestamp(ns(of.at_s))),
        severity: severity.into(),
        kind: of.kind.clone(),
        message: of.message.clone(),
        ..pb::Event::default()
    }
}
