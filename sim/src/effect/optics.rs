//! Camera, sheet and scene as the light meets them: the rig's numbers, changed by measurement effects.

use super::Brightness;
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
    /// Brown's k1, k2, p1, p2 on normalised coordinates, x right and y down.
    pub distortion: [T; 4],
    /// Flat port across the axis, ahead of the pinhole \[m\]; counts where `n_water` is not 1.
    pub port_m: T,
    /// Refractive index behind the port; 1 = a pinhole without a port.
    pub n_water: T,
    /// Sine of the fan's tilt from the normal of the laser's port; 0 = a flat sheet.
    pub cone_sin: T,
    /// Refractive index that refracts the sheet.
    pub cone_n_water: T,
    /// Haze beyond the sheet over the stripe's peak.
    pub haze_fraction: T,
    /// Distance over which the haze fades by e \[m\].
    pub haze_length_m: T,
    /// Standard deviation of speckle over its mean.
    pub speckle_contrast: T,
    /// Size of a speckle grain \[px\].
    pub speckle_grain_px: T,
    /// Attenuation of laser light in the water \[1/m\].
    pub attenuation_pm: T,
    /// Parameters that change brightness alone.
    pub brightness: Brightness<T>,
}

impl Optics {
    /// The laser's light in the direction whose tangent from the middle of the fan is `tan` (starboard positive), over that of
    /// an evenly lit fan.
    pub fn line_profile(&self, tan: f64) -> f64 {
        let Brightness {
            line_end_loss,
            line_tilt,
            ..
        } = self.brightness;
        if line_end_loss == 0.0 && line_tilt == 0.0 {
            return 1.0;
        }
        let w = tan.atan() / self.half_fan_rad;
        (1.0 - line_end_loss * w * w + 0.5 * line_tilt * w).max(0.0)
    }
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
            distortion: [c(0.0); 4],
            port_m: c(0.0),
            n_water: c(1.0),
            cone_sin: c(0.0),
            cone_n_water: c(1.333),
            haze_fraction: c(0.0),
            haze_length_m: c(0.01),
            speckle_contrast: c(0.0),
            speckle_grain_px: c(1.0),
            attenuation_pm: c(0.0),
            brightness: Brightness::new(),
        }
    }

    /// How far the curved sheet lies forward of the flat one at body (y, z) from the apex, along x_b \[m\].
    ///
    /// A ray of the plane fan, (cos b sin g, sin b, cos b cos g) in air with z along the port's normal, has
    /// its first two parts divided by n in the water and unit length. Without b: with s = y/z,
    /// x/z = sin g sqrt((1 - (n^2 - 1) s^2) / (n^2 - sin^2 g)), an elliptic cone. What it is at s = 0 is the
    /// sheet's own direction, so that is taken off.
    pub fn cone_m(&self, y_m: T, z_m: T) -> T {
        let s = y_m / z_m;
        let n2 = self.cone_n_water * self.cone_n_water;
        let inside = (T::one() - (n2 - T::one()) * s * s).max(T::zero());
        let across = (n2 - self.cone_sin * self.cone_sin).sqrt();
        z_m * self.cone_sin * (inside.sqrt() - T::one()) / across
    }
}
