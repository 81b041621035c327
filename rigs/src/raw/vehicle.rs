//! `[vehicle]` as typed.

use super::thruster::row;
use super::{Section, quantity};
use crate::{AxisCoefficients, Dof, Identified, Vehicle, VehicleModel};

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

/// `[identified]`, which `identify --write-rig` writes; `Some(None)` = there is none.
pub(super) fn read_identified(root: &Section<'_>) -> Option<Option<Identified>> {
    if !root.has("identified") {
        return Some(None);
    }
    let s = root.table("identified");
    let names = "the list of coefficients, e.g. [\"x_udot\", \"x_u\"]";
    let coefficients: Option<Vec<String>> = match s.item("coefficients") {
        Some(item) => s.elements(&item, names).and_then(|words| {
            let read = words.iter().map(|w| {
                let text = w.value.as_str().map(str::to_owned);
                if text.is_none() {
                    s.wrong_type(w, "a coefficient's name");
                }
                text
            });
            read.collect()
        }),
        None => {
            s.missing("coefficients", names);
            None
        }
    };
    let any = || quantity(-1e15, 1e15, "SI");
    let list = |key: &str, expected: &str| match s.item(key) {
        Some(item) => row(&s, &item, expected, any()),
        None => {
            s.missing(key, expected);
            None
        }
    };
    let values = list("values", "one value per coefficient, SI");
    let sd = list("sd", "one standard deviation per coefficient, SI");
    let square = "one list of covariances per coefficient, SI";
    let covariance: Option<Vec<Vec<f64>>> = match s.item("covariance") {
        Some(item) => s
            .elements(&item, square)
            .and_then(|rows| rows.iter().map(|r| row(&s, r, square, any())).collect()),
        None => {
            s.missing("covariance", square);
            None
        }
    };
    s.finish();
    let known = Identified {
        coefficients: coefficients?,
        values: values?,
        sd: sd?,
        covariance: covariance?,
    };
    let n = known.coefficients.len();
    let next = "Write it with hydroline identify LOG... --write-rig";
    let lengths = [known.values.len(), known.sd.len(), known.covariance.len()];
    if lengths != [n; 3] || known.covariance.iter().any(|r| r.len() != n) {
        s.rule(
            "covariance",
            format!("{n} coefficients need {n} values, {n} sds and {n} rows of {n} covariances"),
            next,
        );
        return None;
    }
    if (0..n).any(|i| known.covariance[i][i] < 0.0) {
        s.rule("covariance", "a variance is negative", next);
        return None;
    }
    Some(Some(known))
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
