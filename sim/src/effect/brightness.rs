//! Brightness as laws of light and camera change it: nothing in here moves the stripe.

use crate::real::Real;

/// Path of the light of scene and room to grey levels; each field's neutral value is that of [`Brightness::new`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Brightness<T = f64> {
    /// Share of the laser's light that the ends of its fan lack.
    pub line_end_loss: T,
    /// How much brighter the fan's starboard end is than its port end, over the middle.
    pub line_tilt: T,
    /// Share of all light lost in the image's farthest corner.
    pub corner_loss: T,
    /// Rise of the background over the columns and over the rows \[grey levels\].
    pub ambient_rise_grey: [T; 2],
    /// Half of what lies between dark and bright bands \[grey levels\].
    pub banding_grey: T,
    /// Mains frequency; lamps flicker at twice that \[Hz\].
    pub mains_hz: T,
    /// From one row to the next, for the bands \[s\].
    pub banding_row_s: T,
    /// Phase of the flicker at the first row of frame 0 \[rad\].
    pub banding_phase_rad: T,
    /// Exponent of the tone curve.
    pub gamma: T,
    /// Levels that 0 and 255 become: all levels are squeezed between them.
    pub scaled_grey: [T; 2],
    /// Least and greatest grey level: others are cut off there.
    pub clipped_grey: [T; 2],
}

impl<T: Real> Brightness<T> {
    /// Even light on a linear camera of 8 bits.
    pub fn new() -> Self {
        let c = |v: f64| T::from_f64(v);
        Brightness {
            line_end_loss: c(0.0),
            line_tilt: c(0.0),
            corner_loss: c(0.0),
            ambient_rise_grey: [c(0.0); 2],
            banding_grey: c(0.0),
            mains_hz: c(50.0),
            banding_row_s: c(0.0),
            banding_phase_rad: c(0.0),
            gamma: c(1.0),
            scaled_grey: [c(0.0), c(255.0)],
            clipped_grey: [c(0.0), c(255.0)],
        }
    }
}

impl<T: Real> Default for Brightness<T> {
    fn default() -> Self {
        Self::new()
    }
}
