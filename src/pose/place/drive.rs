//! Thrust that was commanded, as the surge and sway acceleration that the rig's vehicle makes of it.

use hydroline_rigs::Rig;
use hydroline_sim::thrust::Commanded;
use hydroline_sim::vehicle::Hydrodynamics;

/// Commands older than this before the newest are forgotten \[ns\]: frames are fitted within seconds.
const KEPT_NS: u64 = 120_000_000_000;

/// The vehicle's inertia and drag in the plane, and the commands up to now.
#[derive(Debug, Clone)]
pub(super) struct Drive {
    /// `None` for a layout of thrusters that makes no wrench: then no command counts.
    commanded: Option<Commanded>,
    /// Mass with added mass, linear and quadratic damping (negative), in surge and sway.
    inertia: [[f64; 3]; 2],
    /// From when \[ns\] which forces \[N\] in surge and sway hold, by time.
    forces_n: Vec<(u64, [f64; 2])>,
}

impl Drive {
    pub fn new(rig: &Rig) -> Self {
        let h = Hydrodynamics::<f64>::new(&rig.vehicle);
        let mass = h.mass();
        Drive {
            commanded: Commanded::new(rig).ok(),
            inertia: [0, 1].map(|i| [mass[i], h.linear[i], h.quadratic[i]]),
            forces_n: Vec::new(),
        }
    }

    /// Takes the command that holds from a stamp on; the newest comes last.
    pub fn command(&mut self, stamp_ns: u64, thruster: &str, thrust_n: f64) {
        if !thrust_n.is_finite() {
            return;
        }
        let Some(commanded) = &mut self.commanded else {
            return;
        };
        let Some(target) = commanded.target(thruster) else {
            return;
        };
        commanded.set(target, thrust_n);
        let Ok(wrench) = commanded.wrench() else {
            return;
        };
        let forces_n = [wrench[0], wrench[1]];
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
