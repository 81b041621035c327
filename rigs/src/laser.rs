//! Laser sheet, the mounts of camera and laser on the body, and the camera's port.

use crate::Channel;
use crate::raw::{Kind, Quantity, Section, angle, flag, number, words};

table! {
    /// The laser sheet: a fan centred on body z.
    ///
    /// Its apex is at body (l_laser, 0, 0).
    pub struct Laser: Copy as LaserTyped, checked by along_rows {
        /// Full angle of the fan.
        ///
        /// Paper: 40 deg.
        pub fan_rad: f64 = angle(number(1.0, 170.0, "deg")),
        /// Thickness of the sheet: standard deviation of its Gaussian cross-section.
        ///
        /// Paper: 6 mm full width; 2 mm chosen.
        pub sigma_m: f64 = number(1e-5, 0.05, "m").hint("A Gaussian sheet's full width is about 3 sigma"),
        /// Grey level of the line on a white floor; beyond 255 it is clipped.
        pub peak: f64 = number(1.0, 10_000.0, "grey levels"),
        /// Whether steps of the simulated scene cast laser shadows.
        ///
        /// Off for the paper's tables and the cases.
        pub shadows: bool = flag().or(false),
        /// Direction of the line in the image: along rows (horizontal) only, for calibration and poses.
        key orientation: bool = words([("horizontal", false), ("vertical", true)]).or_said(false, "horizontal").quiet()
            => |_| None,
        /// Channel of a colour camera that the grey levels are taken from: the laser's colour.
        pub channel: Channel = words(Channel::ALL).or_said(Channel::Luma, "luma").quiet(),
    }
}

fn along_rows(typed: &mut LaserTyped, s: &Section<'_>) {
    if typed.orientation == Some(true) {
        s.rule(
            "orientation",
            "calibration and poses know a line that runs along the image's rows (\"horizontal\") only",
            "Turn the camera by 90 degrees; single images go through `hydroline extract --orientation vertical`",
        );
    }
}

/// From the CG along an axis of the body.
const fn length() -> Quantity {
    number(-20.0, 20.0, "m")
}

table! {
    /// Where camera and sheet sit on the body, from the centre of gravity (CG).
    ///
    /// Paper Fig. 2, Table 2: the camera at body (-l_camera, 0, h_camera), the laser plane at x = l_laser.
    pub struct Mounts: Copy as MountsTyped, checked by baseline {
        /// CG to laser sheet, forward.
        pub l_laser_m: f64 = length(),
        /// CG to camera, aft.
        pub l_camera_m: f64 = length(),
        /// CG to camera, down.
        pub h_camera_m: f64 = length(),
        /// CG to the origin (η = 0) of the sheet's coordinates, down.
        pub h_centre_m: f64 = length(),
        /// Tilt of the optical axis from the vertical, towards forward.
        ///
        /// α of the paper, 45 deg.
        pub camera_tilt_rad: f64 =
            angle(number(-89.0, 89.0, "deg").hint("0 looks straight down, positive looks forward")),
    }
}

fn baseline(typed: &mut MountsTyped, s: &Section<'_>) {
    let (Some(laser_m), Some(camera_m)) = (typed.l_laser_m, typed.l_camera_m) else {
        return;
    };
    let baseline_m = laser_m + camera_m;
    if baseline_m.abs() < 1e-3 {
        s.rule(
            "l_camera_m",
            format!(
                "the camera sits {baseline_m} m from the laser sheet (l_laser_m + l_camera_m): it sees the sheet edge on and cannot measure in it"
            ),
            "Enter the distances of camera (aft) and sheet (forward) from the CG; they must add up to at least 1 mm",
        );
    }
}

table! {
    /// The flat port before the lens, for `calibrate --method refractive`. Omitted: there is none.
    pub struct FlatPort: Copy as PortTyped {
        /// From the lens' entrance pupil to the inner face of the port.
        pub distance_m: f64 = number(0.0, 0.5, "m").hint("From the lens' entrance pupil to the port's inner face"),
        /// Thickness of the port.
        pub glass_m: f64 = number(0.0, 0.1, "m").hint("The port's thickness"),
    }
}
