//! Options of a set of plans.

use hydroline_calib::calibration::Calibration;
use hydroline_numerics::noise::Noise;
use hydroline_rigs::Dof;

/// Purpose of the runs.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum Purpose {
    /// The vehicle's own coefficients (D-optimality).
    #[default]
    Identify,
    /// Which physics the rig leaves out: amplitudes of effects, the coefficients unknown beside them (D_s-optimality;
    /// Atkinson, Donev and Tobias 2007, section 10.3).
    Diagnose,
}

/// Noise of poses to expect.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Instruments {
    /// Of x, y, z \[m\].
    pub position: Noise,
    /// Of roll, pitch, yaw \[rad\].
    pub attitude: Noise,
    /// Poses per second.
    pub rate_hz: f64,
}

impl Default for Instruments {
    /// Poses of the paper's camera as the simulated chain has them: .15 mm and .17 mrad (1/100 deg) white, and as much
    /// correlated over half a second. A worse camera worsens all plans alike; only position against attitude counts.
    fn default() -> Self {
        let of = |sd| Noise {
            white_sd: sd,
            coloured_sd: sd,
            correlation_s: 0.5,
        };
        Instruments {
            position: of(1.5e-4),
            attitude: of(1.7e-4),
            // Half the camera's rate: what is correlated over half a second is seen as well by every second frame.
            rate_hz: 12.5,
        }
    }
}

/// Options of a design.
#[derive(Debug, Clone, PartialEq)]
pub struct Options {
    /// Purpose of the runs; default: the vehicle's coefficients.
    pub purpose: Purpose,
    /// Number of plans; default 5.
    pub plans: usize,
    /// Length of each \[s\].
    pub length_s: f64,
    /// Time watched behind each plan \[s\], default 5: a vehicle's coasting says as much as its drive.
    pub tail_s: f64,
    /// By which the run will be seen; `None` = the rig's ideal camera.
    pub calibration: Option<Calibration>,
    /// DOFs to drive; empty = all that the thrusters can.
    pub dofs: Vec<Dof>,
    /// Noise and rate of the poses to expect.
    pub instruments: Instruments,
    /// Patterns drawn to begin from.
    pub drawn: usize,
    /// Of these the best that are improved.
    pub improved: usize,
    /// Times that every step of a pattern is gone through.
    pub sweeps: usize,
    /// Seed of what is drawn.
    pub seed: u64,
}

impl Default for Options {
    fn default() -> Self {
        Options {
            purpose: Purpose::Identify,
            plans: 5,
            length_s: 30.0,
            tail_s: 5.0,
            calibration: None,
            dofs: Vec::new(),
            instruments: Instruments::default(),
            drawn: 48,
            improved: 2,
            sweeps: 2,
            seed: 1,
        }
    }
}
