//! `[vehicle]` as typed.

use super::{Section, quantity};
use crate::{AxisCoefficients, Dof, Vehicle, VehicleModel};

pub(super) fn read_vehicle(s: &Section<'_>) -> Option<Vehicle> {
    let model = s.choice_opt(
        "model",
        &[
            ("eq1", VehicleModel::Eq1),
            ("decoupled", VehicleModel::Decoupled),
        ],
    );
    let model_sound = model.is_some() || !s.has("model");
    let mass_kg = s.number("mass_kg", quantity(0.0, 1e6, "kg").above());
    let inertia_kgm2 = s.numbers("inertia_kgm2", quantity(0.0, 1e9, "kg m2").above());
    let r_bz_m = s.number(
        "r_bz_m",
        quantity(-10.0, 10.0, "m").hint("Negative: centre of buoyancy above the centre of gravity"),
    );
    let gravity_mps2 = s.number_or("gravity_mps2", quantity(0.0, 30.0, "m/s2").above(), 9.81);
    let axes = Dof::ALL.map(|dof| read_axis(&s.table(dof.name()), dof));
    s.finish();
    let [surge, sway, heave, roll, pitch, yaw] = axes;
    model_sound.then_some(())?;
    Some(Vehicle {
        model: model.unwrap_or(VehicleModel::Eq1),
        mass_kg: mass_kg?,
        inertia_kgm2: inertia_kgm2?,
        r_bz_m: r_bz_m?,
        gravity_mps2,
        coefficients: [surge?, sway?, heave?, roll?, pitch?, yaw?],
    })
}

/// Names of added mass, linear and quadratic damping in files, with their units.
pub(crate) fn axis_keys(dof: Dof) -> [(&'static str, &'static str); 3] {
    match dof {
        Dof::Surge | Dof::Sway | Dof::Heave => [
            ("added_kg", "kg"),
            ("linear_kgps", "kg/s"),
            ("quadratic_kgpm", "kg/m"),
        ],
        Dof::Roll | Dof::Pitch | Dof::Yaw => [
            ("added_kgm2", "kg m2"),
            ("linear_kgm2ps", "kg m2/s"),
            ("quadratic_kgm2", "kg m2"),
        ],
    }
}

fn read_axis(s: &Section<'_>, dof: Dof) -> Option<AxisCoefficients> {
    let [added, linear, quadratic] = axis_keys(dof).map(|(key, unit)| {
        s.number(
            key,
            quantity(-1e7, 0.0, unit)
                .hint("SNAME signs: added mass and damping are negative (X_udot = -250)"),
        )
    });
    s.finish();
    Some(AxisCoefficients {
        added: added?,
        linear: linear?,
        quadratic: quadratic?,
    })
}
