//! The newest measured pose, as far as the limits may be judged by it.

use hydroline_pose::joint::JointPose;

/// A position with a larger standard deviation is no measurement to stop for \[m\]: limits are decimetres apart.
const MAX_SD_M: f64 = 0.02;
/// The same of an angle \[rad\]: 2 deg.
const MAX_SD_RAD: f64 = 0.035;

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

    /// The value of one degree of freedom when it is known well enough to judge by.
    pub fn sane(&self, i: usize) -> Option<f64> {
        let largest = if i < 3 { MAX_SD_M } else { MAX_SD_RAD };
        self.eta[i]
            .filter(|(value, sd)| value.is_finite() && *sd <= largest)
            .map(|(value, _)| value)
    }
}
