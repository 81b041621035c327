//! Thrust that was commanded, as the surge and sway acceleration that the rig's vehicle makes of it.

use hydroline_rigs::{Dof, Rig};
use hydroline_sim::Allocation;
use hydroline_sim::vehicle::Hydrodynamics;

/// Commands older than this before the newest are forgotten \[ns\]: frames are fitted within seconds.
const KEPT_NS: u64 = 120_000_000_000;

/// The vehicle's inertia and drag in the plane, and the commands up to now.
#[derive(Debug, Clone)]
pub(super) struct Drive {
    thrusters: Vec<String>,
    allocation: Option<Allocation>,
    thrust_n: Vec<f64>,
    wrench: [f64; 6],
    /// Mass with added mass, linear and quadratic damping (negative), in surge and sway.
    inertia: [[f64; 3]; 2],
    /// From when \[ns\] which forces \[N\] in surge and sway hold, by time.
    forces_n: Vec<(u64, [f64; 2])>,
}

impl Drive {
    pub fn new(rig: &Rig) -> Self {
        let h = Hydrodynamics::<f64>::new(&rig.vehicle);
        let mass = h.mass();
        let allocation = Allocation::new(&rig.thrusters).ok();
        Drive {
            thrusters: rig
                .thrusters
                .thrusters
                .iter()
                .map(|t| t.name.to_string())
                .collect(),
            thrust_n: vec![0.0; allocation.as_ref().map_or(0, Allocation::len)],
            allocation,
            wrench: [0.0; 6],
            inertia: [0, 1].map(|i| [mass[i], h.linear[i], h.quadratic[i]]),
            forces_n: Vec::new(),
        }
    }

    /// Takes the command that holds from a stamp on; the newest comes last.
    pub fn command(&mut self, stamp_ns: u64, thruster: &str, thrust_n: f64) {
        if !thrust_n.is_finite() {
            return;
        }
        if let Some(place) = self.thrusters.iter().position(|name| name == thruster) {
            if let Some(n) = self.thrust_n.get_mut(place) {
                *n = thrust_n;
            }
            let made = self
                .allocation
                .as_ref()
                .and_then(|a| a.wrench(&self.thrust_n).ok());
            if let Some(made) = made {
                self.wrench = made.to_array();
            }
        } else if let Some(dof) = Dof::ALL.iter().find(|d| d.name() == thruster) {
            // A component of the wrench, where the rig has no thruster of this name.
            self.wrench[dof.index()] = thrust_n;
        } else {
            return;
        }
        let forces_n = [self.wrench[0], self.wrench[1]];
        match self.forces_n.last_mut() {
            Some(last) if last.1 == forces_n => return,
            Some(last) if last.0 >= stamp_ns => last.1 = forces_n,
            _ => self.forces_n.push((stamp_ns, forces_n)),
        }
        let old = |f: &(u64, [f64; 2])| f.0 + KEPT_NS < stamp_ns;
        // The last of the old ones still holds when the others begin.
        let forgotten = self.forces_n.iter().take_while(|f| old(f)).count();
        self.forces_n.drain(..forgotten.saturating_sub(1));
    }

    /// Acceleration along the tank's x that is commanded at a stamp, for a heading \[m/s²\].
    pub fn commanded_mps2(&self, at_ns: u64, psi_rad: f64) -> f64 {
        let after = self.forces_n.partition_point(|f| f.0 <= at_ns);
        let Some((_, [surge_n, sway_n])) = after.checked_sub(1).and_then(|k| self.forces_n.get(k))
        else {
            return 0.0;
        };
        let [ahead, aside] = self.inertia.map(|i| i[0]);
        psi_rad.cos() * surge_n / ahead - psi_rad.sin() * sway_n / aside
    }

    /// Drag along the tank's x \[m/s²\] at a speed, and its slope by the speed; the hull's surge drag, which is the less.
    pub fn drag_mps2(&self, u_mps: f64) -> (f64, f64) {
        let [mass, linear, quadratic] = self.inertia[0];
        let of = (linear + quadratic * u_mps.abs()) / mass;
        (of * u_mps, of + quadratic * u_mps.abs() / mass)
    }

    /// The next change of a command after a stamp.
    pub fn next_change_ns(&self, at_ns: u64) -> Option<u64> {
        let after = self.forces_n.partition_point(|f| f.0 <= at_ns);
        self.forces_n.get(after).map(|f| f.0)
    }
}
