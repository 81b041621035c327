//! `added_mass_coupling`: the Coriolis terms of Eq. 1, in a rig whose model is decoupled.

use hydroline_rigs::VehicleModel;

use super::{EffectInfo, Law, Moment, Stage, Values};
use crate::real::Real;
use crate::vehicle::equations;

pub(super) const INFO: EffectInfo = EffectInfo {
    id: "added_mass_coupling",
    law: "+ the Coriolis terms of Eq. 1 where vehicle.model = decoupled; nothing where it is eq1",
    stage: Stage::Hydrodynamics,
    order: 120,
    // Its numbers are the vehicle's own masses.
    parameters: &[],
    words: &[],
    confusable: &["cross_flow_coupling", "thrust_line_offset"],
    source: "theory/physics.md, hydrodynamics; paper Eq. 1; Fossen 2011, 6.3",
};

#[derive(Debug)]
struct Coupling;

pub(super) fn law<T: Real>(_values: &Values<'_, T>) -> impl Law<T> + use<T> {
    Coupling
}

impl<T: Real> Law<T> for Coupling {
    fn force(&self, m: &Moment<'_, T>, _own: &[T], force: &mut [T; 6]) {
        // A coupled model has them already.
        if m.hydrodynamics.model == VehicleModel::Decoupled {
            let cross = equations::coriolis(m.hydrodynamics, m.nu);
            *force = std::array::from_fn(|i| force[i] + cross[i]);
        }
    }
}

#[cfg(test)]
mod tests {
    use crate::effect::testing::*;
    use hydroline_rigs::VehicleModel;

    #[test]
    fn it_makes_the_decoupled_model_the_coupled_one() {
        let mut rig = crate::fixture::lshpi_rig();
        let mut end = |model, entries: &[hydroline_rigs::PhysicsEntry]| {
            rig.vehicle.model = model;
            rig.physics = entries.to_vec();
            let mut w = crate::World::new(&rig, [0.0; 6]).unwrap();
            let wrench = hydroline_rigs::Wrench {
                surge_n: 8.0,
                yaw_nm: 1.0,
                ..Default::default()
            };
            w.command(0.0, &wrench).unwrap();
            w.state_at(6.0).unwrap()
        };
        let coupled = end(VehicleModel::Eq1, &[]);
        let plain = end(VehicleModel::Decoupled, &[]);
        let on = [entry("added_mass_coupling", &[])];
        // No roll in this run, so the decoupled roll equation's missing cos(theta) does not show.
        assert_eq!(end(VehicleModel::Decoupled, &on), coupled);
        assert_eq!(end(VehicleModel::Eq1, &on), coupled, "never twice");
        assert!((plain.eta[1] - coupled.eta[1]).abs() > 0.01);
    }
}
