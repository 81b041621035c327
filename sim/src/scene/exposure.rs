//! From the light of the scene to the grey levels of a camera that is not linear and a room that is not dark.
//!
//! In the order of the light's way: the laser's own profile is in `sheet` and `board`; here laser and background
//! (its constant part, its rise across the image, lamps that flicker) pass the lens together, the sensor adds its
//! noise and saturates (`noise`), the tone curve and the camera's range follow, and rounding comes last.

use crate::effect::{Brightness, Optics};
use hydroline_rigs::Camera;
use std::f64::consts::TAU;

/// One camera's light on its way to grey levels, with the effects in force: for the renderer and the diagnosis's predictions.
#[derive(Debug, Clone)]
pub struct Exposure {
    law: Brightness,
    ambient_grey: f64,
    /// Optical axis: column, row \[px\].
    centre_px: [f64; 2],
    /// Weights of squared column and row distances in q.
    per_px2: [f64; 2],
    /// Last column and row \[px\], at least 1.
    last_px: [f64; 2],
    rate_fps: f64,
}

/// Light that all pixels of a row have in common.
#[derive(Debug, Clone, Copy)]
pub struct RowLight {
    /// Background but for its rise over the columns \[grey levels\].
    background: f64,
    /// The row's part of q.
    q: f64,
}

/// How far along its way a light that rises by `grey` has come at `share` of the image: never below 0.
fn rise(grey: f64, share: f64) -> f64 {
    if grey < 0.0 {
        -grey * (1.0 - share)
    } else {
        grey * share
    }
}

impl Exposure {
    /// `None` for an even light on a linear camera.
    pub(super) fn new(optics: &Optics, camera: &Camera) -> Option<Self> {
        let law = optics.brightness;
        let (lens, line) = (Brightness::new(), law);
        // The line's profile is the scene's.
        let plain = Brightness {
            line_end_loss: line.line_end_loss,
            line_tilt: line.line_tilt,
            ..lens
        };
        (law != plain).then(|| Self::of(optics, camera))
    }

    /// The same, an even light on a linear camera included.
    pub fn of(optics: &Optics, camera: &Camera) -> Self {
        let law = optics.brightness;
        let size_px = [camera.width_px, camera.height_px].map(f64::from);
        // Angles off the axis, as tangents, of the farthest edge in each direction.
        let far = |i: usize| {
            let (low, high) = (
                -0.5 - optics.centre_px[i],
                size_px[i] - 0.5 - optics.centre_px[i],
            );
            low.abs().max(high.abs()) / optics.focal_px[i]
        };
        let corner = far(0).powi(2) + far(1).powi(2);
        Exposure {
            law,
            ambient_grey: camera.noise.ambient,
            centre_px: optics.centre_px,
            per_px2: optics.focal_px.map(|f| 1.0 / (f * f * corner)),
            last_px: size_px.map(|n| (n - 1.0).max(1.0)),
            rate_fps: camera.rate_fps,
        }
    }

    pub(super) fn row(&self, frame_index: u64, row: usize) -> RowLight {
        self.row_at(frame_index as f64 / self.rate_fps, row as f64)
    }

    /// Of a row of a frame whose first row is at `frame_s`, on the clock of the lamps' phase.
    pub fn row_at(&self, frame_s: f64, row_px: f64) -> RowLight {
        let row = row_px;
        let law = &self.law;
        let lamp = if law.banding_grey > 0.0 {
            // In turns, without the whole ones, so that a late frame is as exact as the first.
            let per_s = 2.0 * law.mains_hz;
            let turns = (per_s * frame_s).fract() + per_s * row * law.banding_row_s;
            law.banding_grey * (1.0 + (TAU * turns + law.banding_phase_rad).sin())
        } else {
            0.0
        };
        let off_px = row - self.centre_px[1];
        RowLight {
            background: self.ambient_grey
                + rise(law.ambient_rise_grey[1], row / self.last_px[1])
                + lamp,
            q: off_px * off_px * self.per_px2[1],
        }
    }

    /// Light on the sensor where the scene gives `laser` grey levels.
    pub fn light(&self, row: &RowLight, column_px: f64, laser: f64) -> f64 {
        let column = column_px;
        let background =
            row.background + rise(self.law.ambient_rise_grey[0], column / self.last_px[0]);
        let off_px = column - self.centre_px[0];
        let q = row.q + off_px * off_px * self.per_px2[0];
        (background + laser) * (1.0 - self.law.corner_loss * q)
    }

    /// Level before rounding that the camera gives for `linear` levels of light and noise.
    pub fn grey(&self, linear: f64) -> f64 {
        let law = &self.law;
        let curved = if law.gamma == 1.0 {
            linear
        } else {
            255.0 * (linear.max(0.0) / 255.0).powf(law.gamma)
        };
        let [black, white] = law.scaled_grey;
        let scaled = black + curved.clamp(0.0, 255.0) * (white - black) / 255.0;
        let [low, high] = law.clipped_grey;
        scaled.max(low).min(high)
    }
}
