//! One frame with what is drawn on it.

use hydroline_core::frame::{Frame, GreyRule};
use serde::Serialize;

/// Most points of a line that are drawn: a stripe of a wide image is thinned.
pub const POINTS_MAX: usize = 400;

/// A frame, and what was found in it.
#[derive(Debug, Clone)]
pub struct Picture {
    /// The frame; its pixels are shared, not copied.
    pub frame: Frame,
    /// Rule by which its grey levels come out.
    pub rule: GreyRule,
    /// Lines drawn on it and beside it.
    pub overlay: Overlay,
}

/// Lines over the image \[px\] and in the laser plane \[m\].
#[derive(Debug, Clone, PartialEq, Default, Serialize)]
pub struct Overlay {
    /// The driver's number of the frame.
    pub sequence: u32,
    /// Width of the image \[px\].
    pub width_px: u32,
    /// Height of the image \[px\].
    pub height_px: u32,
    /// The stripe that was extracted: column, row \[px\].
    pub stripe_px: Vec<[f32; 2]>,
    /// Where floor and target should be seen from the pose; `null` breaks the line.
    pub outline_px: Vec<Option<[f32; 2]>>,
    /// The stripe in the laser plane: xi, eta \[m\].
    pub profile_m: Vec<[f32; 2]>,
    /// Floor and target in the laser plane, from the pose.
    pub expected_m: Vec<Option<[f32; 2]>>,
    /// Why there is no stripe.
    pub fault: String,
}

/// Two columns of numbers as points, thinned to [`POINTS_MAX`], rounded to `step`; without what is no number.
pub fn points(x: &[f32], y: &[f32], step: f64) -> Vec<[f32; 2]> {
    let stride = x.len().min(y.len()).div_ceil(POINTS_MAX).max(1);
    x.iter()
        .zip(y)
        .step_by(stride)
        .filter(|(x, y)| x.is_finite() && y.is_finite())
        .map(|(x, y)| [rounded(f64::from(*x), step), rounded(f64::from(*y), step)])
        .collect()
}

/// The nearest multiple of `step`: fewer digits to send.
pub fn rounded(value: f64, step: f64) -> f32 {
    let per = 1.0 / step;
    ((value * per).round() / per) as f32
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_wide_stripe_is_thinned_and_gaps_are_left_out() {
        let x: Vec<f32> = (0..4000u16).map(f32::from).collect();
        let mut y = vec![100.123_4; 4000];
        y[0] = f32::NAN;
        let points = points(&x, &y, 0.01);
        assert_eq!((points.len(), points[0]), (POINTS_MAX - 1, [10.0, 100.12]));
        assert!(super::points(&[], &[], 0.01).is_empty());
    }
}
