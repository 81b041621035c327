//! Camera, sheet and scene as the light meets them: the rig's numbers, changed by measurement effects.

use crate::real::Real;
use hydroline_rigs::Rig;

/// Everything the image depends on besides the pose. A measurement effect changes fields;
/// an effect that needs another one adds it here and its use in `scene`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Optics<T = f64> {
    /// Focal lengths along columns and rows \[px\].
    pub focal_px: [T; 2],
    /// Principal point: column, row \[px\].
    pub centre_px: [T; 2],
    /// Pinhole in the body frame \[m\].
    pub camera_m: [T; 3],
    /// Optical axis from the vertical, forward \[rad\].
    pub camera_tilt_rad: T,
    /// Sheet: x_b = l_laser + tan(pitch) z_b + tan(yaw) y_b \[m\].
    pub l_laser_m: T,
    /// tan of the sheet's pitch.
    pub sheet_tan_pitch: T,
    /// tan of the sheet's yaw (> 0 brings starboard forward).
    pub sheet_tan_yaw: T,
    /// Sheet's Gaussian thickness \[m\].
    pub sheet_sigma_m: T,
    /// Half the fan's angle \[rad\].
    pub half_fan_rad: T,
    /// Peak grey level of the stripe on albedo 1 before the point-spread blur.
    pub peak: T,
    /// Lengths along the target's centre line times this (hexagon side, board length).
    pub target_scale: T,
    /// Surface at z = -slope X (> 0 rises along +X), target on it.
    pub floor_slope: T,
    /// Grey level at which the sensor saturates.
    pub saturation: T,
}

impl<T: Real> Optics<T> {
    /// The rig's own numbers, all constants.
    pub fn new(rig: &Rig) -> Self {
        let c = |v: f64| T::from_f64(v);
        Optics {
            focal_px: [c(rig.camera.fx_px), c(rig.camera.fy_px)],
            centre_px: [c(rig.camera.cx_px), c(rig.camera.cy_px)],
            camera_m: [c(-rig.mounts.l_camera_m), c(0.0), c(rig.mounts.h_camera_m)],
            camera_tilt_rad: c(rig.mounts.camera_tilt_rad),
            l_laser_m: c(rig.mounts.l_laser_m),
            sheet_tan_pitch: c(0.0),
            sheet_tan_yaw: c(0.0),
            sheet_sigma_m: c(rig.laser.sigma_m),
            half_fan_rad: c(rig.laser.fan_rad / 2.0),
            peak: c(rig.laser.peak),
            target_scale: c(1.0),
            floor_slope: c(0.0),
            saturation: c(255.0),
        }
    }
}
