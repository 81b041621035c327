//! Excitation that a run so far lacks, by what the commands that were sent have done to the rig's model.
//!
//! A coefficient that no motion depends on is not identifiable from it, however long the run. Reported per degree of
//! freedom that the thrusters can drive; what a run was never meant to excite stays listed, and rightly.

use super::prediction::Motion;
use hydroline_rigs::{Dof, Rig};
use hydroline_sim::Allocation;

/// Velocities count from this many times what matters to the rig (2 mm/s, 0.1 deg/s) on.
const ABOVE_TOLERANCE: f64 = 5.0;
/// A step of the load is one from this share of the largest load so far.
const STEP_SHARE: f64 = 0.3;
/// Rest that measures the noise of the poses \[s\].
const REST_S: f64 = 20.0;

/// Gathers what a run excites.
#[derive(Debug, Clone)]
pub struct Excited {
    /// Velocity that counts, per degree of freedom.
    least: [f64; 6],
    driven: [bool; 6],
    fastest: [f64; 6],
    backwards: [f64; 6],
    largest: [f64; 6],
    stepped: [bool; 6],
    last: Option<Motion>,
    rest_s: f64,
}

impl Excited {
    /// For a rig.
    pub fn new(rig: &Rig) -> Self {
        let (speed, rate) = (rig.tolerance.speed_mps, rig.tolerance.rate_radps);
        let least = [speed, speed, speed, rate, rate, rate].map(|v| ABOVE_TOLERANCE * v);
        Self {
            least,
            driven: driven(rig),
            fastest: [0.0; 6],
            backwards: [0.0; 6],
            largest: [0.0; 6],
            stepped: [false; 6],
            last: None,
            rest_s: 0.0,
        }
    }

    /// The next look, `step_s` after the last one.
    pub fn look(&mut self, motion: &Motion, step_s: f64) {
        let nu = motion.state.nu;
        for (i, nu) in nu.into_iter().enumerate() {
            self.fastest[i] = self.fastest[i].max(nu);
            self.backwards[i] = self.backwards[i].min(nu);
            self.largest[i] = self.largest[i].max(motion.wrench[i].abs());
            let change = self
                .last
                .map_or(0.0, |l| (motion.wrench[i] - l.wrench[i]).abs());
            self.stepped[i] |= change > 1e-6 && change >= STEP_SHARE * self.largest[i];
        }
        let still =
            (0..6).all(|i| nu[i].abs() < 0.2 * self.least[i] && motion.wrench[i].abs() < 1e-9);
        if still && self.last.is_some() {
            self.rest_s += step_s;
        }
        self.last = Some(*motion);
    }

    /// Missing excitation, in words; empty when all that is looked for was excited.
    pub fn missing(&self) -> Vec<String> {
        let mut missing = Vec::new();
        for (i, dof) in Dof::ALL
            .iter()
            .map(|dof| dof.name())
            .enumerate()
            .filter(|(i, _)| self.driven[*i])
        {
            let (ahead, astern) = (
                self.fastest[i] >= self.least[i],
                -self.backwards[i] >= self.least[i],
            );
            match (ahead, astern) {
                (false, false) => missing.push(format!("{dof} drag: not yet excited")),
                (true, true) => {}
                _ => missing.push(format!("{dof} asymmetry: moved one way only")),
            }
            if (ahead || astern) && !self.stepped[i] {
                missing.push(format!("{dof} lag: no step of the load yet"));
            }
        }
        if self.rest_s < REST_S {
            missing.push(format!(
                "noise of the pose: {:.0} of {REST_S:.0} s at rest",
                self.rest_s
            ));
        }
        missing
    }
}

/// Whether any thruster acts in each degree of freedom.
fn driven(rig: &Rig) -> [bool; 6] {
    let Ok(allocation) = Allocation::new(&rig.thrusters) else {
        return [false; 6];
    };
    let n = rig.thrusters.thrusters.len();
    let mut driven = [false; 6];
    for place in 0..n {
        let mut thrust_n = vec![0.0; n];
        thrust_n[place] = 1.0;
        if let Ok(wrench) = allocation.wrench(&thrust_n) {
            for (dof, value) in driven
                .iter_mut()
                .zip(super::prediction::components(&wrench))
            {
                *dof |= value.abs() > 1e-6;
            }
        }
    }
    driven
}

#[cfg(test)]
mod tests {
    use super::*;
    use hydroline_sim::VehicleState;

    fn motion(nu: [f64; 6], wrench: [f64; 6]) -> Motion {
        Motion {
            state: VehicleState { eta: [0.0; 6], nu },
            wrench,
        }
    }

    #[test]
    fn what_was_not_moved_is_missing_and_what_was_is_not() {
        let rig = Rig::builtin("lshpi").unwrap();
        let mut excited = Excited::new(&rig);
        let all = excited.missing();
        assert_eq!(all.len(), 7, "{all:?}");
        assert!(
            all.contains(&"yaw drag: not yet excited".to_owned()),
            "{all:?}"
        );
        let surge =
            |u: f64, x: f64| motion([u, 0.0, 0.0, 0.0, 0.0, 0.0], [x, 0.0, 0.0, 0.0, 0.0, 0.0]);
        for k in 0..250 {
            excited.look(&surge(0.0, 0.0), 0.1);
            if k > 200 {
                excited.look(&surge(0.2, 4.0), 0.1);
            }
        }
        let missing = excited.missing();
        assert!(
            missing.contains(&"surge asymmetry: moved one way only".to_owned()),
            "{missing:?}"
        );
        assert!(
            !missing
                .iter()
                .any(|m| m.contains("surge drag") || m.contains("lag") || m.contains("noise")),
            "{missing:?}"
        );
        excited.look(&surge(-0.2, -4.0), 0.1);
        assert!(!excited.missing().iter().any(|m| m.contains("surge")));
    }

    #[test]
    fn a_load_that_only_creeps_shows_no_lag() {
        let rig = Rig::builtin("lshpi").unwrap();
        let mut excited = Excited::new(&rig);
        for k in 1..=400 {
            let x = 0.01 * f64::from(k);
            excited.look(
                &motion(
                    [0.05 * x, 0.0, 0.0, 0.0, 0.0, 0.0],
                    [x + 1.0, 0.0, 0.0, 0.0, 0.0, 0.0],
                ),
                0.1,
            );
        }
        assert!(
            excited
                .missing()
                .contains(&"surge lag: no step of the load yet".to_owned()),
            "{:?}",
            excited.missing()
        );
    }
}
