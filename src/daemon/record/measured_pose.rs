//! The newest measured pose, as far as the limits, and a plan that begins, may be judged by it.

use crate::bring_back::{StartTolerance, wrapped};
use hydroline_pose::joint::JointPose;

/// A position with a larger standard deviation is no measurement to stop for \[m\]: limits are decimetres apart.
const MAX_SD_M: f64 = 0.02;
/// The same of an angle \[rad\]: 2 deg.
const MAX_SD_RAD: f64 = 0.035;

/// Age up to which a pose is one of now \[ns\].
const FRESH_NS: u64 = 2_000_000_000;

#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct MeasuredPose {
    /// When its frame was received, CLOCK_MONOTONIC \[ns\].
    pub received_ns: u64,
    /// x, y, z, phi, theta, psi and their standard deviations \[m, rad\]; `None` = not shown by the frame.
    pub eta: [Option<(f64, f64)>; 6],
}

impl MeasuredPose {
    pub fn of(received_ns: u64, fit: &JointPose) -> Self {
        let values = fit.pose.to_array();
        let eta = std::array::from_fn(|i| {
            fit.measured[i].then(|| (values[i], fit.covariance[(i, i)].sqrt()))
        });
        Self { received_ns, eta }
    }

    /// Whether it shows where the vehicle is now.
    pub fn is_fresh(&self, now_ns: u64) -> bool {
        now_ns.saturating_sub(self.received_ns) < FRESH_NS && self.is_placed()
    }

    /// The value of one degree of freedom when it is known well enough to judge by.
    pub fn sane(&self, i: usize) -> Option<f64> {
        let largest = if i < 3 { MAX_SD_M } else { MAX_SD_RAD };
        self.eta[i]
            .filter(|(value, sd)| value.is_finite() && *sd <= largest)
            .map(|(value, _)| value)
    }

    /// Another pose with every value put in that is known well enough.
    pub fn start(&self, of: [f64; 6]) -> [f64; 6] {
        std::array::from_fn(|i| self.sane(i).unwrap_or(of[i]))
    }

    /// Whether the place over the floor is known at all: height and attitude are the same everywhere.
    pub fn is_placed(&self) -> bool {
        self.sane(0).or(self.sane(1)).is_some()
    }

    /// Whether all that is known well enough is another pose's, within the tolerance and twice the value's own sd.
    pub fn is_at(&self, other: &[f64; 6], tolerance: &StartTolerance) -> bool {
        let is_near = |i: usize| {
            let (Some(value), Some((_, sd))) = (self.sane(i), self.eta[i]) else {
                return true;
            };
            let (off, allowed) = match i {
                0..3 => (value - other[i], tolerance.position_m),
                _ => (wrapped(value - other[i]), tolerance.heading_rad),
            };
            off.abs() <= allowed + 2.0 * sd
        };
        (0..6).all(is_near)
    }

    /// All that is known well enough, in words.
    pub fn shown(&self) -> String {
        let names = ["x", "y", "z", "roll", "pitch", "heading"];
        let value = |(i, name): (usize, &str)| {
            let value = self.sane(i)?;
            Some(match i {
                0..3 => format!("{name} {value:.3} m"),
                _ => format!("{name} {:.1} deg", value.to_degrees()),
            })
        };
        let values: Vec<String> = names.into_iter().enumerate().filter_map(value).collect();
        values.join(", ")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_a_pose_does_not_show_well_is_the_starts() {
        let mut eta = [None; 6];
        eta[0] = Some((0.3, 0.001));
        // Known worse than a limit can be judged by, and not a number.
        eta[1] = Some((0.4, 0.1));
        eta[2] = Some((f64::NAN, 0.001));
        let pose = MeasuredPose {
            received_ns: 1,
            eta,
        };
        let start = [-0.2, 0.0, -0.83, 0.0, 0.0, 0.1];
        assert_eq!(pose.start(start), [0.3, 0.0, -0.83, 0.0, 0.0, 0.1]);
        assert_eq!(pose.shown(), "x 0.300 m");
        assert!(pose.is_placed());
        let tolerance = StartTolerance::default();
        assert!(!pose.is_at(&start, &tolerance));
        assert!(pose.is_at(&[0.32, 0.0, -0.83, 0.0, 0.0, 0.1], &tolerance));
    }

    #[test]
    fn a_heading_is_near_the_short_way_and_height_alone_is_no_place() {
        let mut eta = [None; 6];
        eta[2] = Some((-0.83, 0.001));
        eta[5] = Some((3.13, 0.001));
        let pose = MeasuredPose {
            received_ns: 1,
            eta,
        };
        let start = [0.0, 0.0, -0.83, 0.0, 0.0, -3.13];
        assert!(pose.is_at(&start, &StartTolerance::default()));
        assert!(!pose.is_placed());
    }
}
