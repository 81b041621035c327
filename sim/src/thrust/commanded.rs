//! Thrusts in force, command by command, and the wrench on the body that they make.

use super::{Allocation, ThrustError};
use hydroline_rigs::{Dof, Rig};

/// Place that a command acts on.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Target {
    /// Thruster, by its place in the rig.
    Thruster(usize),
    /// Component of the wrench itself, where the rig has no thruster of this name: what a table of a vehicle without
    /// thrusters commands.
    Component(usize),
}

/// Thrusts and components in force: each holds until its next command.
#[derive(Debug, Clone)]
pub struct Commanded {
    names: Vec<String>,
    allocation: Allocation,
    thrust_n: Vec<f64>,
    /// Components commanded as such \[N or N m\].
    direct: [f64; 6],
}

impl Commanded {
    /// A rig's thrusters, none of which pushes.
    ///
    /// # Errors
    /// [`ThrustError`] for a layout of thrusters that makes no wrench.
    pub fn new(rig: &Rig) -> Result<Self, ThrustError> {
        let thrusters = &rig.thrusters.thrusters;
        Ok(Commanded {
            names: thrusters.iter().map(|t| t.name.to_string()).collect(),
            allocation: Allocation::new(&rig.thrusters)?,
            thrust_n: vec![0.0; thrusters.len()],
            direct: [0.0; 6],
        })
    }

    /// The thruster of a name, else the component (`surge` to `yaw`); `None` = the rig has neither.
    pub fn target(&self, name: &str) -> Option<Target> {
        let thruster = self.names.iter().position(|n| n == name);
        let component = || Dof::ALL.iter().find(|d| d.name() == name);
        thruster
            .map(Target::Thruster)
            .or_else(|| component().map(|d| Target::Component(d.index())))
    }

    /// Sets a thrust \[N\] or a component \[N or N m\], which holds from now on.
    pub fn set(&mut self, target: Target, value: f64) {
        match target {
            Target::Thruster(place) => self.thrust_n[place] = value,
            Target::Component(place) => self.direct[place] = value,
        }
    }

    /// Wrench in force, surge to yaw \[N, N m\].
    ///
    /// # Errors
    /// [`ThrustError::NotFinite`] for a thrust that is no number.
    pub fn wrench(&self) -> Result<[f64; 6], ThrustError> {
        let made = self.allocation.wrench(&self.thrust_n)?.to_array();
        Ok(std::array::from_fn(|i| made[i] + self.direct[i]))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn thrusters_and_components_add_and_hold_until_their_next_command() {
        let rig = Rig::builtin("lshpi").expect("a rig of the library");
        let mut commanded = Commanded::new(&rig).expect("a layout that makes a wrench");
        let name = rig.thrusters.thrusters[0].name.to_string();
        let first = commanded.target(&name).expect("the rig's own thruster");
        assert_eq!(first, Target::Thruster(0));
        commanded.set(first, 2.0);
        let alone = commanded.wrench().expect("finite thrusts");
        assert!(alone.iter().any(|v| v.abs() > 1.0), "{alone:?}");
        commanded.set(Target::Component(5), 0.5);
        commanded.set(first, 0.0);
        let left = commanded.wrench().expect("finite thrusts");
        assert_eq!(left, [0.0, 0.0, 0.0, 0.0, 0.0, 0.5]);
        assert_eq!(commanded.target("nobody"), None);
        commanded.set(first, f64::NAN);
        assert!(commanded.wrench().is_err());
    }
}
