//! `[identified]`: what an identification left behind.

use nalgebra::DMatrix;

use crate::Dof;
use crate::error::{ProblemKind, nearest};
use crate::raw::{Item, Kind, Section, list, number, one, rows, text};
use crate::response::is_source;

/// Rounding in a covariance that went through files and inverses, as a share of the sds concerned.
const ROUNDING: f64 = 1e-6;

table! {
    /// Coefficients with their covariance, as `identify --write-rig` writes them: `predict` makes its band of it. Omitted:
    /// coefficients carry no uncertainty.
    ///
    /// SI throughout.
    pub struct Identified as IdentifiedTyped, checked by is_covariance {
        /// Names of the coefficients, in the order of the other lists.
        pub coefficients: Vec<String> =
            one("", NAMES, ["texts", NAMES], names, |w, key, names| w.words(key, names)),
        /// Their values.
        ///
        /// The covariance belongs to them: where `[vehicle]` says other ones it is not theirs.
        pub values: Vec<f64> = list(number(-1e15, 1e15, "SI"), "one value per coefficient, SI"),
        /// Their standard deviations: the roots of the covariance's diagonal.
        pub sd: Vec<f64> = list(number(0.0, 1e15, "SI"), "one standard deviation per coefficient, SI"),
        /// Their covariance, one row per coefficient.
        pub covariance: Vec<Vec<f64>> = rows(number(-1e15, 1e15, "SI"), "one list of covariances per coefficient, SI"),
        /// Where values and sds come from when they are no identification of this vehicle, as the spread of published sets; each
        /// command that uses them says it. Omitted: `identify` found them.
        pub source: Option<String> = text(
            "a text of 1 to 400 letters that says where these numbers come from, like \"spread of two published sets\"",
            is_source,
        ).optional(),
    }
}

impl Identified {
    /// Whether runs of this vehicle gave the numbers: a plan need not leave room for another vehicle then.
    pub fn is_measured(&self) -> bool {
        self.source.is_none()
    }
}

fn is_covariance(typed: &mut IdentifiedTyped, s: &Section<'_>) {
    let (Some(names), Some(values), Some(sd), Some(covariance)) = (
        &typed.coefficients,
        &typed.values,
        &typed.sd,
        &typed.covariance,
    ) else {
        return;
    };
    let n = names.len();
    let next = "Write it with hydroline identify LOG... --write-rig";
    if [values.len(), sd.len(), covariance.len()] != [n; 3]
        || covariance.iter().any(|r| r.len() != n)
    {
        s.rule(
            "covariance",
            format!("{n} coefficients need {n} values, {n} sds and {n} rows of {n} covariances"),
            next,
        );
    } else if let Some((key, what)) = senseless(names, sd, covariance) {
        s.rule(key, what, next);
    }
}

/// Expected form of the list of names, for messages.
const NAMES: &str = "the list of coefficients, e.g. [\"x_udot\", \"x_u\"]";

/// Names of coefficients: each one there is, none twice.
fn names<'d>(s: &Section<'d>, item: &Item<'d>) -> Option<Vec<String>> {
    let allowed = || Dof::ALL.into_iter().flat_map(Dof::coefficient_names);
    let mut names: Vec<String> = Vec::new();
    let mut sound = true;
    for (i, word) in s.elements(item, NAMES)?.iter().enumerate() {
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
            s.rule_at(
                word,
                format!("\"{name}\" stands at places {first} and {i}"),
                "Name each coefficient once, with its value, sd and row at the same place",
            );
            sound = false;
        }
        names.push(name.to_owned());
    }
    sound.then_some(names)
}

/// The first thing that no covariance is: where, and what with its values. Lengths are right.
fn senseless(names: &[String], sd: &[f64], c: &[Vec<f64>]) -> Option<(&'static str, String)> {
    let n = c.len();
    let name = |i: usize| names[i].as_str();
    let wrong = |key: &'static str, what: String| Some((key, what));
    for (i, (row, sd)) in c.iter().zip(sd).enumerate() {
        let variance = row[i];
        if variance < 0.0 {
            return wrong(
                "covariance",
                format!(
                    "the variance of {}, row {i}, is {variance}: negative; 0 or more is allowed",
                    name(i)
                ),
            );
        }
        let root = variance.sqrt();
        if (sd - root).abs() > ROUNDING * root {
            return wrong(
                "sd",
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
                    "covariance",
                    format!(
                        "of {} and {} it says {below} in row {i} and {above} in row {j}: only the same number is allowed",
                        name(i),
                        name(j)
                    ),
                );
            }
            if below.abs() > (1.0 + ROUNDING) * scale {
                return wrong(
                    "covariance",
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
            "covariance",
            format!(
                "its correlations contradict each other: some sum of the coefficients would have a negative variance (smallest eigenvalue of the correlations {least:.3e}, 0 or more is allowed)"
            ),
        );
    }
    None
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]

    use crate::raw::tests::tells;
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
            source: None,
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
    fn numbers_that_no_run_gave_say_where_they_come_from() {
        let mut rig = rig();
        let known = rig.identified.as_mut().unwrap();
        assert!(known.is_measured());
        known.source = Some("spread of two published sets".into());
        let read = Rig::from_toml(&rig.to_toml(), "r.toml", None).unwrap();
        assert_eq!(read.identified, rig.identified);
        rig.identified.as_mut().unwrap().source = Some("two\nlines".into());
        let refused = Rig::from_toml(&rig.to_toml(), "r.toml", None).unwrap_err();
        tells(&refused, &["identified.source", "1 to 400 letters"]);
        for name in ["bluerov2", "bluerov2-heavy"] {
            let known = Rig::builtin(name).unwrap().identified.unwrap();
            assert!(!known.is_measured(), "{name}");
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
