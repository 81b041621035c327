//! `[vehicle]` as typed.

use nalgebra::DMatrix;

use super::section::Item;
use super::thruster::row;
use super::{Section, quantity};
use crate::error::{ProblemKind, nearest};
use crate::{AxisCoefficients, Dof, Identified, Vehicle, VehicleModel};

/// What is rounding in a covariance that went through files and inverses, as a share of the sds concerned.
const ROUNDING: f64 = 1e-6;

pub(super) fn read_vehicle(s: &Section<'_>) -> Option<Vehicle> {
    let model = s.choice_opt(
        "model",
        &[
            ("eq1", VehicleModel::Eq1),
            ("decoupled", VehicleModel::Decoupled),
        ],
    );
    s.default_is("model", "eq1");
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
    s.asks_for("coefficients", "texts", names);
    s.requires("coefficients");
    let coefficients: Option<Vec<String>> = match s.item("coefficients") {
        Some(item) => s
            .elements(&item, names)
            .and_then(|words| read_names(&s, &words)),
        None => {
            s.missing("coefficients", names);
            None
        }
    };
    let any = || quantity(-1e15, 1e15, "SI");
    s.asks_number("values", "numbers", &any());
    s.requires("values");
    s.asks_number("sd", "numbers", &quantity(0.0, 1e15, "SI"));
    s.requires("sd");
    s.asks_number("covariance", "rows of numbers", &any());
    s.requires("covariance");
    let list = |key: &str, expected: &str| match s.item(key) {
        Some(item) => row(&s, &item, expected, any()),
        None => {
            s.missing(key, expected);
            None
        }
    };
    let values = list("values", "one value per coefficient, SI");
    let sd = match s.item("sd") {
        Some(item) => row(
            &s,
            &item,
            "one standard deviation per coefficient, SI",
            quantity(0.0, 1e15, "SI"),
        ),
        None => {
            s.missing("sd", "one standard deviation per coefficient, SI");
            None
        }
    };
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
    if let Some((key, what)) = senseless(&known) {
        s.rule(&key, what, next);
        return None;
    }
    Some(Some(known))
}

/// Names of coefficients: each one there is, none twice.
fn read_names(s: &Section<'_>, words: &[Item<'_>]) -> Option<Vec<String>> {
    let allowed = || Dof::ALL.into_iter().flat_map(Dof::coefficient_names);
    let mut names: Vec<String> = Vec::new();
    let mut sound = true;
    for (i, word) in words.iter().enumerate() {
        let Some(name) = word.value.as_str() else {
            s.wrong_type(word, "a coefficient's name");
            return None;
        };
        if !allowed().any(|a| a == name) {
            let kind = ProblemKind::NotOneOf {
                typed: s.typed(word),
                allowed: allowed().map(|a| format!("\"{a}\"")).collect(),
                suggestion: nearest(name, allowed()),
            };
            s.report(word, kind);
            sound = false;
        } else if let Some(first) = names.iter().position(|n| n == name) {
            let kind = ProblemKind::Rule {
                what: format!("\"{name}\" stands at places {first} and {i}"),
                next: "Name each coefficient once, with its value, sd and row at the same place"
                    .to_owned(),
            };
            s.report(word, kind);
            sound = false;
        }
        names.push(name.to_owned());
    }
    sound.then_some(names)
}

/// The first thing that no covariance is: where, and what with its values. Lengths are right.
fn senseless(known: &Identified) -> Option<(String, String)> {
    let c = &known.covariance;
    let n = c.len();
    let name = |i: usize| known.coefficients[i].as_str();
    let wrong = |key: String, what: String| Some((key, what));
    for (i, (row, sd)) in c.iter().zip(&known.sd).enumerate() {
        let variance = row[i];
        if variance < 0.0 {
            return wrong(
                "covariance".into(),
                format!(
                    "the variance of {}, row {i}, is {variance}: negative; 0 or more is allowed",
                    name(i)
                ),
            );
        }
        let root = variance.sqrt();
        if (sd - root).abs() > ROUNDING * root {
            return wrong(
                "sd".into(),
                format!(
                    "the sd of {}, place {i}, is {sd}, but the covariance's diagonal says {variance}: only its square root {root} is allowed",
                    name(i)
                ),
            );
        }
    }
    for i in 0..n {
        for j in 0..i {
            let (below, above) = (c[i][j], c[j][i]);
            let scale = c[i][i].sqrt() * c[j][j].sqrt();
            if (below - above).abs() > ROUNDING * scale {
                return wrong(
                    "covariance".into(),
                    format!(
                        "of {} and {} it says {below} in row {i} and {above} in row {j}: only the same number is allowed",
                        name(i),
                        name(j)
                    ),
                );
            }
            if below.abs() > (1.0 + ROUNDING) * scale {
                return wrong(
                    "covariance".into(),
                    format!(
                        "of {} and {} it says {below}: no correlation is beyond 1; from {} to {scale} is allowed",
                        name(i),
                        name(j),
                        -scale
                    ),
                );
            }
        }
    }
    if n == 0 {
        return None;
    }
    // Of the correlations: kilograms and kilograms per metre have no common scale. A variance of 0 has, by
    // the limits above, no covariances either.
    let correlation = DMatrix::from_fn(n, n, |i, j| {
        let scale = c[i][i].sqrt() * c[j][j].sqrt();
        match (i == j, scale > 0.0) {
            (true, _) => 1.0,
            (false, true) => 0.5 * (c[i][j] + c[j][i]) / scale,
            (false, false) => 0.0,
        }
    });
    let least = correlation
        .symmetric_eigenvalues()
        .iter()
        .fold(1.0, |a: f64, b| a.min(*b));
    // Rounding of n entries adds up to at most n times that of one.
    if least < -ROUNDING * n as f64 {
        return wrong(
            "covariance".into(),
            format!(
                "its correlations contradict each other: some sum of the coefficients would have a negative variance (smallest eigenvalue of the correlations {least:.3e}, 0 or more is allowed)"
            ),
        );
    }
    None
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

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]

    use super::super::tests::tells;
    use crate::{Identified, Rig};

    fn rig() -> Rig {
        let mut rig = Rig::builtin("lshpi").unwrap();
        rig.identified = Some(Identified {
            coefficients: ["x_udot", "x_u", "x_uu"].map(String::from).to_vec(),
            values: vec![-250.25, -20.125, -200.5],
            sd: vec![1.0, 2.0, 0.0],
            covariance: vec![
                vec![1.0, 1.5, 0.0],
                vec![1.5, 4.0, 0.0],
                vec![0.0, 0.0, 0.0],
            ],
        });
        rig
    }

    #[test]
    fn a_covariance_that_is_none_is_refused_with_its_place_and_what_is_allowed() {
        let sound = rig();
        let read = |rig: &Rig| Rig::from_toml(&rig.to_toml(), "r.toml", None);
        assert_eq!(read(&sound).unwrap().identified, sound.identified);
        type Change = fn(&mut Identified);
        let cases: [(Change, &[&str]); 9] = [
            (
                |k| k.coefficients[1] = "x_uudot".into(),
                &["identified.coefficients[1]", "\"x_uudot\"", "\"x_udot\""],
            ),
            (
                |k| k.coefficients[1] = "x_udot".into(),
                &["identified.coefficients[1]", "places 0 and 1"],
            ),
            (
                |k| k.sd[1] = 4.0,
                &["identified.sd", "x_u", "is 4", "root 2 is"],
            ),
            (|k| k.sd[0] = -1.0, &["identified.sd[0]", "-1", "from 0"]),
            (
                |k| k.covariance[1][0] = 1.4,
                &["identified.covariance", "1.4", "row 1", "same"],
            ),
            (
                |k| (k.covariance[0][1], k.covariance[1][0]) = (2.5, 2.5),
                &["identified.covariance", "2.5", "from -2 to 2"],
            ),
            (
                |k| (k.covariance[0][2], k.covariance[2][0]) = (0.1, 0.1),
                &["identified.covariance", "0.1"],
            ),
            (
                |k| k.covariance[0][0] = -1.0,
                &["identified.covariance", "x_udot", "-1", "negative"],
            ),
            (
                // Each pair may be; the three together may not: 1 - 3 0.81 - 2 0.729 < 0.
                |k| {
                    k.sd = vec![1.0; 3];
                    k.covariance = vec![
                        vec![1.0, 0.9, 0.9],
                        vec![0.9, 1.0, -0.9],
                        vec![0.9, -0.9, 1.0],
                    ];
                },
                &["identified.covariance", "contradict", "0 or more"],
            ),
        ];
        for (change, words) in cases {
            let mut wrong = sound.clone();
            change(wrong.identified.as_mut().unwrap());
            tells(&read(&wrong).unwrap_err(), words);
        }
    }

    #[test]
    fn rounding_in_a_covariance_is_no_contradiction() {
        let mut known = rig();
        let k = known.identified.as_mut().unwrap();
        // Wholly correlated, as one unknown scale leaves it, with a last digit astray.
        k.covariance[0][1] = 2.0 + 1e-9;
        k.covariance[1][0] = 2.0 - 1e-9;
        assert!(Rig::from_toml(&known.to_toml(), "r.toml", None).is_ok());
        // Nothing known is no contradiction either.
        let k = known.identified.as_mut().unwrap();
        (k.coefficients, k.values, k.sd, k.covariance) = (vec![], vec![], vec![], vec![]);
        assert!(Rig::from_toml(&known.to_toml(), "r.toml", None).is_ok());
    }
}
