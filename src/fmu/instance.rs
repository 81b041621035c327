//! A vehicle of an FMU, without any C: set, step, get.

use std::path::Path;

use hydroline_rigs::{Rig, RigError};
use hydroline_sim::model::ModelState;
use hydroline_sim::trajectory::GRID_STEP_S;
use hydroline_sim::{Allocation, EffectError, Model, ThrustError, Trajectory, TrajectoryError};

use super::variables::{Causality, Variable, put, token, variables};

/// Name of the rig's file in the resources.
pub const RIG_FILE: &str = "rig.toml";

/// Failure of an instance.
#[derive(Debug, thiserror::Error)]
#[allow(missing_docs)] // Each message names its fields.
pub enum InstanceError {
    #[error(transparent)]
    Rig(#[from] RigError),
    #[error("{path}: {source}; is the FMU unpacked?")]
    Unreadable {
        path: String,
        source: std::io::Error,
    },
    #[error(
        "instantiation token {found}, but {RIG_FILE} of the resources has {expected}: description and resources are of two exports"
    )]
    Token { found: String, expected: String },
    #[error(transparent)]
    Effect(#[from] EffectError),
    #[error(transparent)]
    Thrust(#[from] ThrustError),
    #[error(transparent)]
    Trajectory(#[from] TrajectoryError),
    #[error("no variable has the reference {0}")]
    Unknown(u32),
    #[error("{name} is {role} and cannot be set now")]
    NotSettable { name: String, role: &'static str },
    #[error("{name} is {value}; it must be finite")]
    NotFinite { name: String, value: f64 },
    #[error("{what} before the run was initialised")]
    NotBegun { what: &'static str },
}

/// A vehicle under way.
#[derive(Debug)]
struct Run {
    trajectory: Trajectory,
    allocation: Allocation,
    /// Time of the FMU at which the vehicle's own is 0 \[s\].
    start_s: f64,
    /// Time reached, the vehicle's own \[s\].
    now_s: f64,
    /// Thrusts that were commanded last.
    commanded: Option<Vec<f64>>,
}

/// An instance.
#[derive(Debug)]
pub struct Instance {
    /// The rig as it was exported.
    exported: Rig,
    /// The same with the parameters that were set.
    rig: Rig,
    variables: Vec<Variable>,
    thrust_n: Vec<f64>,
    /// Time of the FMU at which the run is to begin \[s\].
    start_s: f64,
    run: Option<Run>,
}

impl Instance {
    /// Reads the rig of the FMU's resources.
    ///
    /// # Errors
    /// [`InstanceError`].
    pub fn read(resources: &Path, expected: &str) -> Result<Instance, InstanceError> {
        let path = resources.join(RIG_FILE);
        let text = std::fs::read_to_string(&path).map_err(|source| InstanceError::Unreadable {
            path: path.display().to_string(),
            source,
        })?;
        let found = token(&text);
        if expected != found {
            return Err(InstanceError::Token {
                found: expected.to_owned(),
                expected: found,
            });
        }
        Ok(Instance::new(Rig::from_toml(&text, RIG_FILE, None)?))
    }

    /// An instance of a rig.
    pub fn new(rig: Rig) -> Instance {
        Instance {
            variables: variables(&rig),
            thrust_n: vec![0.0; rig.thrusters.thrusters.len()],
            exported: rig.clone(),
            rig,
            start_s: 0.0,
            run: None,
        }
    }

    /// Forgets the run, and all that was set.
    pub fn reset(&mut self) {
        *self = Instance::new(self.exported.clone());
    }

    fn variable(&self, reference: u32) -> Result<&Variable, InstanceError> {
        let place = (reference as usize).checked_sub(1);
        let found = place.and_then(|p| self.variables.get(p));
        found.ok_or(InstanceError::Unknown(reference))
    }

    /// Sets a variable: a thrust always, a parameter before the run has begun.
    ///
    /// # Errors
    /// [`InstanceError`].
    pub fn set(&mut self, reference: u32, value: f64) -> Result<(), InstanceError> {
        let variable = self.variable(reference)?;
        let (name, causality) = (variable.name.clone(), variable.causality);
        if !value.is_finite() {
            return Err(InstanceError::NotFinite { name, value });
        }
        let not_settable = |role| InstanceError::NotSettable {
            name: name.clone(),
            role,
        };
        match causality {
            Causality::Input => self.thrust_n[reference as usize - 1] = value,
            Causality::Output => return Err(not_settable("an output")),
            Causality::Parameter if self.run.is_some() => {
                return Err(not_settable("a parameter of a run that has begun"));
            }
            Causality::Parameter => {
                put(&mut self.rig, &name, value);
                self.variables[reference as usize - 1].start = value;
            }
        }
        Ok(())
    }

    /// Takes the time of the FMU at which the run is to begin \[s\].
    pub fn plan_start(&mut self, start_s: f64) {
        self.start_s = start_s;
    }

    /// Begins the run there.
    ///
    /// # Errors
    /// [`InstanceError`].
    pub fn begin_as_planned(&mut self) -> Result<(), InstanceError> {
        self.begin(self.start_s)
    }

    /// Begins the run at this time of the FMU \[s\].
    ///
    /// # Errors
    /// [`InstanceError`].
    pub fn begin(&mut self, start_s: f64) -> Result<(), InstanceError> {
        let model = Model::from_rig(&self.rig)?;
        let at_rest = ModelState::at_rest(self.rig.tank.start_pose);
        self.run = Some(Run {
            trajectory: Trajectory::new(model, at_rest, GRID_STEP_S)?,
            allocation: Allocation::new(&self.rig.thrusters)?,
            start_s,
            now_s: 0.0,
            commanded: None,
        });
        Ok(())
    }

    /// Moves the vehicle over a step, the thrusts held.
    ///
    /// # Errors
    /// [`InstanceError`].
    pub fn step(&mut self, from_s: f64, step_s: f64) -> Result<(), InstanceError> {
        let run = self
            .run
            .as_mut()
            .ok_or(InstanceError::NotBegun { what: "a step" })?;
        let at_s = from_s - run.start_s;
        if run.commanded.as_ref() != Some(&self.thrust_n) {
            let wrench = run.allocation.wrench(&self.thrust_n)?.to_array();
            run.trajectory.command(at_s, wrench)?;
            run.commanded = Some(self.thrust_n.clone());
        }
        run.trajectory.state_at(at_s + step_s)?;
        run.now_s = at_s + step_s;
        Ok(())
    }

    /// Value of a variable; of the time (0) that which was reached.
    ///
    /// # Errors
    /// [`InstanceError`].
    pub fn get(&mut self, reference: u32) -> Result<f64, InstanceError> {
        if reference == 0 {
            return Ok(self.run.as_ref().map_or(0.0, |r| r.start_s + r.now_s));
        }
        let variable = self.variable(reference)?;
        match variable.causality {
            Causality::Input => Ok(self.thrust_n[reference as usize - 1]),
            Causality::Parameter => Ok(variable.start),
            Causality::Output => {
                let place = reference as usize - 1 - self.thrust_n.len();
                let Some(run) = &mut self.run else {
                    let start = self.rig.tank.start_pose;
                    return Ok(start.get(place).copied().unwrap_or(0.0));
                };
                let state = run.trajectory.state_at(run.now_s)?.vehicle;
                let all = state.eta.iter().chain(&state.nu);
                Ok(all.copied().nth(place).unwrap_or(f64::NAN))
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn it_moves_as_the_simulator_and_its_parameters_are_set_before_the_run() {
        let rig = Rig::builtin("lshpi").unwrap();
        let mut one = Instance::new(rig.clone());
        let reference = |name: &str| {
            let all = variables(&rig);
            all.iter().find(|v| v.name == name).unwrap().reference
        };
        let (x, x_u) = (reference("x"), reference("x_u"));
        assert_eq!(one.get(x).unwrap(), rig.tank.start_pose[0]);
        one.set(x_u, -40.0).unwrap();
        one.begin(3.0).unwrap();
        assert!(matches!(
            one.set(x_u, -20.0),
            Err(InstanceError::NotSettable { .. })
        ));
        assert!(matches!(
            one.set(x, 0.0),
            Err(InstanceError::NotSettable { .. })
        ));
        assert!(matches!(
            one.set(999, 0.0),
            Err(InstanceError::Unknown(999))
        ));
        assert!(matches!(
            one.set(1, f64::NAN),
            Err(InstanceError::NotFinite { .. })
        ));
        let thrust = [2.0, 3.0, 2.0, 3.0, 0.5, -0.5, 0.0, 0.0];
        for (k, n) in thrust.iter().enumerate() {
            one.set(k as u32 + 1, *n).unwrap();
        }
        let mut heavy = rig.clone();
        heavy.vehicle.coefficients[0].linear = -40.0;
        let mut world = hydroline_sim::World::new(&heavy, rig.tank.start_pose).unwrap();
        world.command_thrusts(0.0, &thrust).unwrap();
        for k in 0..50 {
            one.step(3.0 + 0.1 * f64::from(k), 0.1).unwrap();
        }
        let state = world.state_at(5.0).unwrap();
        for (d, value) in state.eta.iter().chain(&state.nu).enumerate() {
            let ours = one.get(x + d as u32).unwrap();
            assert!((ours - value).abs() < 1e-12, "{d}: {ours} {value}");
        }
        assert!((one.get(0).unwrap() - 8.0).abs() < 1e-12);
        one.reset();
        assert_eq!(one.get(x_u).unwrap(), -20.0);
        assert!(matches!(
            one.step(0.0, 0.1),
            Err(InstanceError::NotBegun { .. })
        ));
    }

    #[test]
    fn resources_of_another_export_are_refused() {
        let folder = tempfile::tempdir().unwrap();
        let text = Rig::builtin("lshpi").unwrap().effective_toml;
        std::fs::write(folder.path().join(RIG_FILE), &text).unwrap();
        assert!(Instance::read(folder.path(), &token(&text)).is_ok());
        let refused = Instance::read(folder.path(), "other").unwrap_err();
        assert!(refused.to_string().contains("two exports"), "{refused}");
        let missing = Instance::read(&folder.path().join("none"), "x").unwrap_err();
        assert!(missing.to_string().contains("unpacked"), "{missing}");
    }
}
