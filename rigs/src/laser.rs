//! Laser sheet, the mounts of camera and laser on the body, and the camera's port.

use crate::Channel;

/// The laser sheet. Apex at body (l_laser, 0, 0), fan centred on body z.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Laser {
    /// Full fan angle \[rad\] (paper: 40 deg).
    pub fan_rad: f64,
    /// Standard deviation of the sheet's Gaussian profile, across \[m\] (paper: 6 mm full width; 2 mm chosen).
    pub sigma_m: f64,
    /// Peak grey level of the stripe on a white floor at the principal ray \[grey levels\].
    pub peak: f64,
    /// What of a colour camera's light shows the laser best.
    pub channel: Channel,
    /// Whether vertical steps cast laser shadows (off for the paper's tables and the cases).
    pub shadows: bool,
}

/// Paper Fig. 2 / Table 2. Camera at body (-l_camera, 0, +h_camera); laser plane at x_b = l_laser.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Mounts {
    /// CG to laser plane, forward \[m\].
    pub l_laser_m: f64,
    /// CG to camera, aft \[m\].
    pub l_camera_m: f64,
    /// CG to camera, down \[m\].
    pub h_camera_m: f64,
    /// CG to the laser plane's origin (eta = 0), down \[m\].
    pub h_centre_m: f64,
    /// Optical axis from the vertical, looking forward and down \[rad\] (alpha, 45 deg).
    pub camera_tilt_rad: f64,
}

/// The flat port that the camera looks through, as far as a ruler measures it; for `refractive` maps.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FlatPort {
    /// Entrance pupil of the lens to the port's inner face \[m\].
    pub distance_m: f64,
    /// Thickness of the port \[m\].
    pub glass_m: f64,
}
