//! A rig's vehicle in its tank, fed with commands as they come.
//!
//! Serves both real time (a simulated controller and camera call it from their threads,
//! behind one `Mutex`) and offline simulation. Times are seconds since the log's first
//! stamp on the commands' clock.

use crate::effect::EffectError;
use crate::model::{Model, ModelState};
use crate::scene::{FramePoses, Pose6};
use crate::thrust::{Allocation, ThrustError};
use crate::trajectory::{GRID_STEP_S, Trajectory, TrajectoryError};
use crate::vehicle::VehicleState;
use hydroline_rigs::{Rig, Wrench};

/// Failure of a simulated world: of its effects, thrusters or trajectory.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[allow(missing_docs)] // Each message names its fields.
pub enum SimError {
    #[error(transparent)]
    Effect(#[from] EffectError),
    #[error(transparent)]
    Thrust(#[from] ThrustError),
    #[error(transparent)]
    Trajectory(#[from] TrajectoryError),
}

/// The simulated vehicle.
#[derive(Debug)]
pub struct World {
    trajectory: Trajectory,
    allocation: Allocation,
}

impl World {
    /// A vehicle at rest at `start_pose` (tank frame) at t = 0, with the rig's effects.
    ///
    /// # Errors
    /// [`SimError`] for a bad `[[physics]]` entry, thruster layout or start pose.
    pub fn new(rig: &Rig, start_pose: [f64; 6]) -> Result<Self, SimError> {
        let model = Model::from_rig(rig)?;
        let trajectory = Trajectory::new(model, ModelState::at_rest(start_pose), GRID_STEP_S)?;
        Ok(World {
            trajectory,
            allocation: Allocation::new(&rig.thrusters)?,
        })
    }

    /// Effects' notes: what is unusual about their parameters.
    pub fn notes(&self) -> &[String] {
        self.trajectory.model().effects.notes()
    }

    /// The thrusters' geometry and curves.
    pub fn allocation(&self) -> &Allocation {
        &self.allocation
    }

    /// A body wrench stamped `t_s`, taken as it is (no allocation, no saturation); holds until the next command.
    ///
    /// # Errors
    /// [`TrajectoryError`] when it is not finite or older than the kept history.
    pub fn command(&mut self, t_s: f64, wrench: &Wrench) -> Result<(), SimError> {
        Ok(self.trajectory.command(t_s, wrench.to_array())?)
    }

    /// Thrusts \[N\] per thruster in the rig's order, stamped `t_s`.
    ///
    /// # Errors
    /// [`ThrustError`] or [`TrajectoryError`].
    pub fn command_thrusts(&mut self, t_s: f64, thrust_n: &[f64]) -> Result<(), SimError> {
        let wrench = self.allocation.wrench(thrust_n)?;
        self.command(t_s, &wrench)
    }

    /// Pulses \[us\] per thruster in the rig's order, stamped `t_s`, through the rig's curves.
    ///
    /// # Errors
    /// [`ThrustError`] or [`TrajectoryError`].
    pub fn command_pulses(&mut self, t_s: f64, pulses_us: &[f64]) -> Result<(), SimError> {
        let thrust_n = self.allocation.thrusts_of_pulses(pulses_us)?;
        self.command_thrusts(t_s, &thrust_n)
    }

    /// The true state at `t_s`; before 0 the start. How often it is asked changes no bit of any answer.
    ///
    /// # Errors
    /// [`TrajectoryError`] when the motion diverged or `t_s` is older than the kept history (about 10 s).
    pub fn state_at(&mut self, t_s: f64) -> Result<VehicleState, SimError> {
        Ok(self.trajectory.state_at(t_s)?.vehicle)
    }

    /// The pose that row `row_px` of a frame stamped `stamp_s` shows (timing and scene-pose effects).
    ///
    /// # Errors
    /// As [`World::state_at`].
    pub fn pose_seen(&mut self, stamp_s: f64, row_px: f64) -> Result<Pose6, SimError> {
        let t_s = self
            .trajectory
            .model()
            .effects
            .scene_time_s(stamp_s, row_px);
        let eta = self.state_at(t_s)?.eta;
        Ok(Pose6::from(
            self.trajectory.model().effects.scene_pose(t_s, eta),
        ))
    }

    /// The poses that the rows of a frame stamped `stamp_s` show: one, or one per row under a rolling shutter
    /// or interlace. Command everything up to [`World::latest_scene_time_s`] first.
    ///
    /// # Errors
    /// As [`World::state_at`].
    pub fn frame_poses(&mut self, stamp_s: f64, rows: usize) -> Result<FramePoses, SimError> {
        let effects = &self.trajectory.model().effects;
        let at: Vec<f64> = (0..rows)
            .map(|row| effects.scene_time_s(stamp_s, row as f64))
            .collect();
        if at.iter().all(|t| *t == at[0]) {
            return Ok(FramePoses::from(self.pose_seen(stamp_s, 0.0)?));
        }
        // A rolling shutter's rows are evenly spaced in time; two fields are not.
        let interlaced = at.windows(3).next().is_some_and(|t| {
            let (first, second) = (t[1] - t[0], t[2] - t[1]);
            (first - second).abs() > 1e-9
        });
        let poses: Result<Vec<Pose6>, SimError> = (0..rows)
            .map(|row| self.pose_seen(stamp_s, row as f64))
            .collect();
        Ok(FramePoses::rows(poses?, interlaced))
    }

    /// The latest time that any row of a frame (or a measurement, `rows` = 1) stamped `stamp_s` shows: drift,
    /// rolling shutter and interlace may look beyond the stamp.
    pub fn latest_scene_time_s(&self, stamp_s: f64, rows: usize) -> f64 {
        let effects = &self.trajectory.model().effects;
        (0..rows.max(1))
            .map(|row| effects.scene_time_s(stamp_s, row as f64))
            .fold(f64::NEG_INFINITY, f64::max)
    }

    /// The pose that a measurement stamped `stamp_s` reports (all timing and measurement effects on poses).
    ///
    /// # Errors
    /// As [`World::state_at`].
    pub fn pose_reported(&mut self, stamp_s: f64) -> Result<Pose6, SimError> {
        let seen = self.pose_seen(stamp_s, 0.0)?;
        let effects = &self.trajectory.model().effects;
        let t_s = effects.scene_time_s(stamp_s, 0.0);
        Ok(Pose6::from(effects.reported_pose(t_s, seen.to_array())))
    }
}

#[cfg(test)]
mod tests;
