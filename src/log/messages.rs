//! The log's messages and the way from our own types to them and back, bit by bit.
//!
//! `hydroline.*` comes from `hydroline.proto`; `foxglove.*` from the foxglove crate, whose
//! messages are prost messages and therefore decode as well as they encode.

pub use foxglove::messages::{
    CameraCalibration, CompressedImage, ImageAnnotations, Log, PoseInFrame, RawImage,
};
use prost_types::Timestamp;

use hydroline_core::clock::ClockTriple;
use hydroline_core::event::{Event, Severity};
use hydroline_core::run::{COMPANIONS, SharedErrors};
use hydroline_rigs::channel::{Channel, PerChannel};

mod cdr;
mod encodings;
mod frames;
mod ros;

pub use cdr::CdrError;
pub(crate) use encodings::compression;
pub use frames::{
    ImageError, ImageMessage, fault_name, format_name, frame_from, frame_info, image_message,
    stamp_clock_name, stamp_source_name,
};
#[cfg(test)]
pub(crate) use ros::tests::written as ros_written;
pub(crate) use ros::{compressed as ros_compressed, image as ros_image};

/// Generated from `hydroline.proto`, checked in so that a build needs no protobuf compiler; a test makes it anew
/// and compares.
#[allow(missing_docs, clippy::all)]
pub mod pb {
    include!("generated/hydroline.rs");
}

pub use pb::{
    ClockPair, ControllerClock, FrameInfo, PlaneCalibration, StripeProfile, ThrusterCommand,
    ThrusterEcho, VehicleMotion,
};

/// Coordinate frame of everything the camera sees, as viewers name it.
pub const CAMERA_FRAME: &str = "camera_optical";
/// The tank frame (Z down, floor at 0), as viewers name it.
pub const TANK_FRAME: &str = "tank";

const NS: u64 = 1_000_000_000;

/// A message of the log that can be decoded over another one, whose memory it takes.
pub trait DecodeOver: Default {
    /// Takes what the bytes say, and nothing of what was here.
    ///
    /// # Errors
    /// Description of the fault in the bytes.
    fn decode_over(&mut self, data: &[u8]) -> Result<(), String>;
}

impl<M: prost::Message + Default> DecodeOver for M {
    fn decode_over(&mut self, data: &[u8]) -> Result<(), String> {
        self.clear();
        self.merge(data).map_err(|e| e.to_string())
    }
}

/// UNIX nanoseconds as a protobuf timestamp.
pub fn timestamp(unix_ns: u64) -> Timestamp {
    Timestamp {
        seconds: (unix_ns / NS) as i64,
        nanos: (unix_ns % NS) as i32,
    }
}

/// A protobuf timestamp as UNIX nanoseconds; times before 1970 give 0.
pub fn unix_ns(t: &Timestamp) -> u64 {
    let ns = i128::from(t.seconds) * i128::from(NS) + i128::from(t.nanos);
    ns.clamp(0, i128::from(u64::MAX)) as u64
}

/// UNIX nanoseconds in Foxglove's timestamp (32-bit seconds: good until 2106).
pub fn foxglove_time(unix_ns: u64) -> foxglove::messages::Timestamp {
    let sec = u32::try_from(unix_ns / NS).unwrap_or(u32::MAX);
    foxglove::messages::Timestamp::new(sec, (unix_ns % NS) as u32)
}

/// Foxglove's timestamp as UNIX nanoseconds.
pub fn foxglove_ns(t: &foxglove::messages::Timestamp) -> u64 {
    u64::from(t.sec()) * NS + u64::from(t.nsec())
}

/// A message that says when it was true.
pub trait Stamped {
    /// UNIX \[ns\]; `None` when the message does not say.
    fn stamp_ns(&self) -> Option<u64>;
}

macro_rules! stamped {
    ($convert:expr => $($message:ty),+) => {
        $(impl Stamped for $message {
            fn stamp_ns(&self) -> Option<u64> {
                self.timestamp.as_ref().map($convert)
            }
        })+
    };
}
stamped!(unix_ns => ThrusterCommand, ThrusterEcho, VehicleMotion, FrameInfo, ClockPair, pb::Event,
    StripeProfile, PlaneCalibration, pb::AutopilotState);
stamped!(foxglove_ns => RawImage, CompressedImage, CameraCalibration, ImageAnnotations, PoseInFrame, Log);

/// An event as a message.
pub fn event_message(event: &Event) -> pb::Event {
    let severity = match event.severity {
        Severity::Info => pb::event::Severity::Info,
        Severity::Warning => pb::event::Severity::Warning,
        Severity::Error => pb::event::Severity::Error,
    };
    pb::Event {
        timestamp: Some(timestamp(event.timestamp_ns)),
        severity: severity.into(),
        kind: event.kind.name.to_owned(),
        message: event.message.clone(),
        values: event
            .values
            .iter()
            .map(|(name, value)| (name.to_string(), *value))
            .collect(),
    }
}

/// Severity of a logged event; an unknown number counts as an error.
pub fn event_severity(event: &pb::Event) -> Severity {
    match pb::event::Severity::try_from(event.severity) {
        Ok(pb::event::Severity::Info) => Severity::Info,
        Ok(pb::event::Severity::Warning) => Severity::Warning,
        Ok(pb::event::Severity::Error) | Err(_) => Severity::Error,
    }
}

/// The clocks, with the controller's where the link has one.
pub fn clock_message(clocks: &ClockTriple, controller: Option<ControllerClock>) -> ClockPair {
    ClockPair {
        timestamp: Some(timestamp(clocks.realtime_ns)),
        monotonic_ns: clocks.monotonic_ns,
        realtime_ns: clocks.realtime_ns,
        boottime_ns: clocks.boottime_ns,
        bracket_ns: clocks.bracket_ns,
        controller,
    }
}

/// The rig's pinhole as viewers read it. Pixel origin = centre of the top left pixel, as in OpenCV's K.
pub fn camera_calibration(camera: &hydroline_rigs::Camera, unix_ns: u64) -> CameraCalibration {
    let (fx, fy, cx, cy) = (camera.fx_px, camera.fy_px, camera.cx_px, camera.cy_px);
    CameraCalibration {
        timestamp: Some(foxglove_time(unix_ns)),
        frame_id: CAMERA_FRAME.to_owned(),
        width: camera.width_px,
        height: camera.height_px,
        distortion_model: "plumb_bob".to_owned(),
        d: vec![0.0; 5],
        k: vec![fx, 0.0, cx, 0.0, fy, cy, 0.0, 0.0, 1.0],
        r: vec![1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0],
        p: vec![fx, 0.0, cx, 0.0, 0.0, fy, cy, 0.0, 0.0, 0.0, 1.0, 0.0],
    }
}

/// The stripe drawn over the image: points at ours + 0.5, because Foxglove's origin is the outer
/// corner of the top left pixel and ours its centre.
pub fn stripe_annotations(profile: &StripeProfile) -> ImageAnnotations {
    use foxglove::messages as fg;
    let points = profile
        .column_px
        .iter()
        .zip(&profile.row_px)
        .map(|(c, r)| fg::Point2 {
            x: f64::from(*c) + 0.5,
            y: f64::from(*r) + 0.5,
        })
        .collect();
    let stamp = profile.stamp_ns().map(foxglove_time);
    ImageAnnotations {
        timestamp: stamp,
        points: vec![fg::PointsAnnotation {
            timestamp: stamp,
            r#type: fg::points_annotation::Type::Points.into(),
            points,
            outline_color: Some(fg::Color {
                r: 1.0,
                g: 0.2,
                b: 0.2,
                a: 1.0,
            }),
            thickness: 1.0,
            ..Default::default()
        }],
        ..Default::default()
    }
}

impl VehicleMotion {
    /// A motion true at a UNIX time \[ns\]; `None` = not measured.
    pub fn of(stamp_ns: u64, channels: PerChannel<Option<f64>>) -> VehicleMotion {
        VehicleMotion {
            timestamp: Some(timestamp(stamp_ns)),
            x_m: channels[Channel::X],
            y_m: channels[Channel::Y],
            z_m: channels[Channel::Z],
            phi_rad: channels[Channel::Phi],
            theta_rad: channels[Channel::Theta],
            psi_rad: channels[Channel::Psi],
            u_mps: channels[Channel::U],
            v_mps: channels[Channel::V],
            w_mps: channels[Channel::W],
            p_radps: channels[Channel::P],
            q_radps: channels[Channel::Q],
            r_radps: channels[Channel::R],
            ..VehicleMotion::default()
        }
    }

    /// The same of a pose alone.
    pub fn of_pose(stamp_ns: u64, pose: [Option<f64>; 6]) -> VehicleMotion {
        VehicleMotion::of(stamp_ns, PerChannel::of_state(pose, [None; 6]))
    }

    /// The twelve channels as sent.
    pub fn channels(&self) -> PerChannel<Option<f64>> {
        let pose = (self.x_m, self.y_m, self.z_m);
        let turn = (self.phi_rad, self.theta_rad, self.psi_rad);
        let way = (self.u_mps, self.v_mps, self.w_mps);
        let rates = (self.p_radps, self.q_radps, self.r_radps);
        let both = |a: (_, _, _), b: (_, _, _)| [a.0, a.1, a.2, b.0, b.1, b.2];
        PerChannel::of_state(both(pose, turn), both(way, rates))
    }

    /// Covariance of the pose's own error, 6 × 6 row by row \[SI\]: as sent, less what all poses of its calibration share; `None` = none
    /// was sent, or no matrix of numbers.
    pub fn own_covariance(&self) -> Option<[f64; 36]> {
        let mut own = <[f64; 36]>::try_from(self.covariance.as_slice()).ok()?;
        if !own.iter().all(|v| v.is_finite()) {
            return None;
        }
        for by in SharedErrors::of_rows(&self.shared_loadings)
            .iter()
            .flatten()
        {
            for (k, v) in own.iter_mut().enumerate() {
                *v -= by[k / 6] * by[k % 6];
            }
        }
        Some(own)
    }

    /// Values measured beside the motion: rudder \[rad\], elevator \[rad\], shaft \[rad/s\], wave \[m\].
    pub fn companions(&self) -> [Option<f64>; COMPANIONS.len()] {
        [
            self.rudder_rad,
            self.elevator_rad,
            self.shaft_radps,
            self.wave_m,
        ]
    }
}

/// A measured pose for viewers; `None` unless all six coordinates were measured.
///
/// Z-Y-X Euler angles (Fossen 2011, Eq. 2.18: R = Rz(psi) Ry(theta) Rx(phi)) to a unit quaternion.
pub fn pose_message(motion: &VehicleMotion) -> Option<PoseInFrame> {
    use foxglove::messages as fg;
    let (phi, theta, psi) = (motion.phi_rad?, motion.theta_rad?, motion.psi_rad?);
    let q = nalgebra::UnitQuaternion::from_euler_angles(phi, theta, psi);
    Some(PoseInFrame {
        timestamp: motion.stamp_ns().map(foxglove_time),
        frame_id: TANK_FRAME.to_owned(),
        pose: Some(fg::Pose {
            position: Some(fg::Vector3 {
                x: motion.x_m?,
                y: motion.y_m?,
                z: motion.z_m?,
            }),
            orientation: Some(fg::Quaternion {
                x: q.i,
                y: q.j,
                z: q.k,
                w: q.w,
            }),
        }),
    })
}

#[cfg(test)]
mod tests;
