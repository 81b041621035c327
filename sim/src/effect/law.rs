//! The hooks a law may fill; every default does nothing.

use super::{EffectInfo, Optics};
use crate::given::{COMPANIONS, Given};
use crate::real::Real;
use crate::vehicle::Hydrodynamics;

/// State that a law may look at while the motion is integrated. References: with derivatives each array is a kilobyte.
#[derive(Debug, Clone, Copy)]
pub struct Moment<'a, T> {
    /// Time since the log's first stamp, on the commands' clock \[s\].
    pub t_s: T,
    /// Start of the current step, which never spans an edge: a law that jumps in time decides by it \[s\].
    pub step_start_s: T,
    /// Wrench commanded \[N, N m\].
    pub load: &'a [T; 6],
    /// Pose, tank frame.
    pub eta: &'a [T; 6],
    /// Sine and cosine of the heading psi.
    pub heading: &'a (T, T),
    /// Rates over ground, body frame.
    pub nu: &'a [T; 6],
    /// Rates through the water; equal to `nu` until `relative_velocity` has run.
    pub nu_r: &'a [T; 6],
    /// Rigid plus added mass per DOF; final once `added_mass` has run.
    pub mass: &'a [T; 6],
    /// The vehicle's own coefficients.
    pub hydrodynamics: &'a Hydrodynamics<T>,
    /// Companions measured beside the motion (see [`crate::given`]); `None` = there are none.
    pub companions: Option<&'a [T; COMPANIONS]>,
    /// Curves that they are taken from; `None` = there are none.
    pub given: Option<&'a Given>,
}

impl<T: Real> Moment<'_, T> {
    /// A companion by its place; 0 where it was not measured.
    pub fn companion(&self, place: usize) -> T {
        self.companions.map_or(T::zero(), |c| c[place])
    }

    /// First and second time derivative of a companion; 0 where it was not measured.
    pub fn companion_slopes(&self, place: usize) -> [T; 2] {
        let curve = self.given.and_then(|g| g.companions[place].as_ref());
        curve.map_or([T::zero(); 2], |c| c.slopes_at(self.t_s))
    }
}

/// Checked parameter values handed to a law's constructor: numbers and words in the order of its [`EffectInfo`].
#[derive(Debug, Clone, Copy)]
pub struct Values<'a, T> {
    /// The effect.
    pub info: &'a EffectInfo,
    /// One number per `info.parameters`.
    pub numbers: &'a [T],
    /// One index into `allowed` per `info.words`.
    pub words: &'a [usize],
}

/// An effect at work. `own` and `rate` are the effect's own states and their derivatives
/// (as many as [`Law::states`]), 0 at the log's start.
///
/// Units: SI; poses in the tank frame, forces and rates in the body frame, SNAME order.
pub trait Law<T: Real>: Send + Sync + std::fmt::Debug {
    /// Number of own states.
    fn states(&self) -> usize {
        0
    }

    /// Time constant of its fastest own state \[s\]: what an explicit integrator must resolve.
    fn fastest_s(&self) -> f64 {
        f64::INFINITY
    }

    /// Timing: a command stamped t acts at t + this \[s\].
    fn command_delay_s(&self) -> T {
        T::zero()
    }
    /// Timing: the time \[s\] at which the scene was as row `row_px` of a frame stamped `stamp_s` shows it.
    fn scene_time_s(&self, stamp_s: T, _row_px: f64) -> T {
        stamp_s
    }
    /// Times \[s\] at which the law jumps: the integrator puts a node there.
    fn time_edges_s(&self) -> Vec<T> {
        Vec::new()
    }

    /// Thruster stage: changes the wrench that reaches the hull, sets the rates of states that live here.
    fn thrust(&self, _m: &Moment<'_, T>, _wrench: &mut [T; 6], _own: &[T], _rate: &mut [T]) {}

    /// Hydrodynamics: changes the velocity through the water that the drag sees.
    fn relative_velocity(&self, _m: &Moment<'_, T>, _nu_r: &mut [T; 6]) {}
    /// Hydrodynamics: changes the mass per DOF.
    fn added_mass(&self, _m: &Moment<'_, T>, _mass: &mut [T; 6]) {}
    /// Hydrodynamics: changes the drag (a law that scales it) or adds to it.
    fn drag(&self, _m: &Moment<'_, T>, _drag: &mut [T; 6]) {}
    /// Hydrodynamics: adds forces. A force proportional to the acceleration belongs into `added_mass`.
    fn force(&self, _m: &Moment<'_, T>, _own: &[T], _force: &mut [T; 6]) {}
    /// Rates of states that follow the acceleration (fluid memory); runs last.
    fn own_rate(&self, _m: &Moment<'_, T>, _nu_dot: &[T; 6], _own: &[T], _rate: &mut [T]) {}

    /// Measurement: the pose at which the camera really looks at the scene at `t_s`.
    fn scene_pose(&self, _t_s: T, _pose: &mut [T; 6]) {}
    /// Measurement: what an instrument reports of that pose.
    fn reported_pose(&self, _t_s: T, _pose: &mut [T; 6]) {}
    /// Measurement: changes camera, sheet, target or image formation from what the rig says.
    fn optics(&self, _optics: &mut Optics<T>) {}
}
