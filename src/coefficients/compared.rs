//! Two sets of coefficients, difference by difference.
//!
//! Nobody says how the errors of two results hang together: two days share a thrust curve, two fits may share runs. With
//! standard deviations s_A and s_B and a correlation ρ the difference has the variance s_A² + s_B² - 2 ρ s_A s_B. It is given
//! for independent errors (ρ = 0) and for the worst (ρ = -1), where the sd is s_A + s_B: beyond that a difference is one
//! whatever they share. Errors that are common to both (ρ > 0) make a difference clearer than is said here.

use crate::{Fitted, Row};
use hydroline_identify::parameter::Coefficient;
use hydroline_numerics::cholesky::ScaledCholesky;
use hydroline_numerics::statistics::chi2_above;
use nalgebra::{DMatrix, DVector};
use schemars::JsonSchema;
use serde::Serialize;

/// Share of the diagonal that is added before the two covariances' sum is factored: their digits in a file.
const JITTER: f64 = 1e-12;

/// A value with its spread, SI.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, JsonSchema)]
pub struct Side {
    /// Estimate.
    pub value: f64,
    /// Standard deviation; `None` = nothing is known of it.
    pub sd: Option<f64>,
    /// Lower end of the 95 % interval.
    pub low: Option<f64>,
    /// Its upper end.
    pub high: Option<f64>,
}

/// A coefficient on both sides.
#[derive(Debug, Clone, PartialEq, Serialize, JsonSchema)]
pub struct ComparedRow {
    /// Name in rig files and results.
    pub key: &'static str,
    /// Symbol of SNAME.
    pub symbol: &'static str,
    /// SI unit.
    pub unit: &'static str,
    /// A; `None` = it has none.
    pub first: Option<Side>,
    /// B.
    pub second: Option<Side>,
    /// Sides whose runs do not determine it: a value there is the prior's, and the difference is not judged.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub undetermined: Vec<&'static str>,
    /// B less A.
    pub difference: Option<f64>,
    /// Standard deviation of the difference where the errors of both are independent.
    pub sd: Option<f64>,
    /// Difference in these.
    pub sds: Option<f64>,
    /// Difference in the largest sd that it can have, whatever the errors share.
    pub sds_at_least: Option<f64>,
}

/// All coefficients that both determine, and whose covariance is known on both sides, as one difference; for independent errors.
#[derive(Debug, Clone, PartialEq, Serialize, JsonSchema)]
pub struct Together {
    /// Keys of these coefficients.
    pub keys: Vec<&'static str>,
    /// Squared length of the difference by the sum of both covariances.
    pub chi2: f64,
    /// Probability of one as long where both are the same.
    pub probability: f64,
}

/// Two sets of coefficients.
#[derive(Debug, Clone, PartialEq, Serialize, JsonSchema)]
pub struct Compared {
    /// Coefficients that either side has, in SNAME order.
    pub rows: Vec<ComparedRow>,
    /// All at once; `None` = a covariance is missing.
    pub together: Option<Together>,
    /// Both were fitted beside a prior: where it was the same, it draws them together.
    pub both_beside_prior: bool,
    /// Names of runs that stand in both: if they are the same runs, the errors are not independent.
    pub runs_in_both: Vec<String>,
}

impl Compared {
    /// B against A.
    pub fn of(first: &Fitted, second: &Fitted) -> Self {
        let rows = (hydroline_rigs::Dof::ALL.into_iter())
            .flat_map(Coefficient::of)
            .filter_map(|c| row(c, [first, second]));
        let names = |f: &Fitted| -> Vec<String> { f.runs.iter().map(|r| r.0.clone()).collect() };
        let others = names(second);
        let mut runs_in_both = names(first);
        runs_in_both.retain(|name| others.contains(name));
        Self {
            rows: rows.collect(),
            together: together(first, second),
            both_beside_prior: first.beside_prior && second.beside_prior,
            runs_in_both,
        }
    }

    /// Rows whose difference is at least so many sds, for independent errors.
    pub fn beyond(&self, sds: f64) -> impl Iterator<Item = &ComparedRow> {
        let is_beyond = move |r: &&ComparedRow| r.sds.is_some_and(|s| s.abs() >= sds);
        self.rows.iter().filter(is_beyond)
    }

    /// Rows whose difference has a standard deviation.
    pub fn judged(&self) -> usize {
        self.rows.iter().filter(|r| r.sds.is_some()).count()
    }
}

/// A coefficient of one side, with the sd of its whole budget where the covariance has it.
fn side(fitted: &Fitted, coefficient: Coefficient) -> Option<Side> {
    let own = |r: &&Row| r.coefficient == coefficient;
    let row = fitted.rows.iter().find(own)?;
    let place = fitted.order.iter().position(|c| *c == coefficient);
    let variance = place.and_then(|i| Some(*fitted.covariance.get(i)?.get(i)?));
    let combined = variance.filter(|v| *v > 0.0).map(f64::sqrt);
    Some(Side {
        value: row.value,
        sd: combined.or(row.sd),
        low: row.interval.map(|i| i[0]),
        high: row.interval.map(|i| i[1]),
    })
}

fn row(c: Coefficient, sides: [&Fitted; 2]) -> Option<ComparedRow> {
    let [first, second] = sides.map(|fitted| side(fitted, c));
    if first.is_none() && second.is_none() {
        return None;
    }
    let both = first.zip(second);
    let difference = both.map(|(a, b)| b.value - a.value);
    let named = ["A", "B"].into_iter().zip(sides);
    let undetermined = named.filter(|(_, fitted)| fitted.undetermined.contains(&c));
    let undetermined: Vec<&'static str> = undetermined.map(|(name, _)| name).collect();
    let judged = both.filter(|_| undetermined.is_empty());
    let sds = judged.and_then(|(a, b)| a.sd.zip(b.sd));
    let by = |sd: Option<f64>| {
        let (difference, sd) = difference.zip(sd)?;
        (sd > 0.0).then(|| difference / sd)
    };
    let sd = sds.map(|(a, b)| a.hypot(b));
    Some(ComparedRow {
        key: c.key(),
        symbol: c.symbol(),
        unit: c.unit(),
        first,
        second,
        undetermined,
        difference,
        sd,
        sds: by(sd),
        sds_at_least: by(sds.map(|(a, b)| a + b)),
    })
}

fn together(first: &Fitted, second: &Fitted) -> Option<Together> {
    let place = |f: &Fitted, c: Coefficient| f.order.iter().position(|own| *own == c);
    let value = |f: &Fitted, c: Coefficient| {
        let row = f.rows.iter().find(|r| r.coefficient == c);
        row.map(|r| r.value)
    };
    let determined = |c: &&Coefficient| ![first, second].iter().any(|f| f.undetermined.contains(c));
    let shared: Vec<(Coefficient, usize, usize)> = (first.order.iter())
        .filter(determined)
        .filter_map(|c| Some((*c, place(first, *c)?, place(second, *c)?)))
        .collect();
    let n = shared.len();
    let mut difference = Vec::with_capacity(n);
    for (c, ..) in &shared {
        difference.push(value(second, *c)? - value(first, *c)?);
    }
    let sum = DMatrix::from_fn(n, n, |i, k| {
        first.covariance[shared[i].1][shared[k].1] + second.covariance[shared[i].2][shared[k].2]
    });
    if n == 0 {
        return None;
    }
    let factor = ScaledCholesky::new(&sum, JITTER)?;
    let chi2 = factor.squared_norm(&DVector::from_vec(difference));
    Some(Together {
        keys: shared.iter().map(|(c, ..)| c.key()).collect(),
        chi2,
        probability: chi2_above(chi2, n as f64),
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn fitted(values: &[(&str, f64)], covariance: Vec<Vec<f64>>) -> Fitted {
        let of = |key: &str| Coefficient::find(key).unwrap();
        Fitted {
            source: "identify".to_owned(),
            rows: values
                .iter()
                .zip(0..)
                .map(|((key, value), i)| Row {
                    coefficient: of(key),
                    value: *value,
                    sd: covariance.get(i).map(|r: &Vec<f64>| r[i].sqrt()),
                    interval: None,
                })
                .collect(),
            order: (values.iter().take(covariance.len()))
                .map(|(key, _)| of(key))
                .collect(),
            covariance,
            undetermined: Vec::new(),
            beside_prior: false,
            mass_kg: None,
            gravity_mps2: None,
            runs: vec![("day-1".to_owned(), Vec::new())],
            basis: None,
            missing: Vec::new(),
        }
    }

    #[test]
    fn a_difference_is_in_its_own_sds_and_in_the_worst() {
        let a = fitted(&[("x_u", -20.0), ("y_v", -30.0)], vec![vec![9.0]]);
        let b = fitted(&[("x_u", -30.0), ("n_r", -1.0)], vec![vec![16.0]]);
        let compared = Compared::of(&a, &b);
        assert_eq!(compared.rows.len(), 3);
        let x_u = compared.rows.iter().find(|r| r.key == "x_u").unwrap();
        assert_eq!((x_u.difference, x_u.sd), (Some(-10.0), Some(5.0)));
        assert_eq!((x_u.sds, x_u.sds_at_least), (Some(-2.0), Some(-10.0 / 7.0)));
        let y_v = compared.rows.iter().find(|r| r.key == "y_v").unwrap();
        assert_eq!((y_v.second, y_v.difference, y_v.sds), (None, None, None));
        assert_eq!((compared.judged(), compared.beyond(2.0).count()), (1, 1));
        assert_eq!(compared.runs_in_both, ["day-1"]);
        let together = compared.together.unwrap();
        assert!((together.chi2 - 4.0).abs() < 1e-9 && (together.probability - 0.0455).abs() < 1e-4);
    }

    #[test]
    fn a_pair_that_hangs_together_is_judged_together() {
        // Linear and quadratic damping trade against each other: each alone is within its sd, both in the same way are not.
        let c = vec![vec![4.0, -3.9], vec![-3.9, 4.0]];
        let a = fitted(&[("x_u", -20.0), ("x_uu", -40.0)], c.clone());
        let b = fitted(&[("x_u", -18.0), ("x_uu", -38.0)], c);
        let compared = Compared::of(&a, &b);
        assert!(compared.rows.iter().all(|r| r.sds.unwrap().abs() < 1.0));
        assert!(compared.together.unwrap().probability < 1e-6);
    }

    #[test]
    fn what_only_a_prior_says_is_not_judged() {
        let c = vec![vec![4.0, 0.0], vec![0.0, 9.0]];
        let mut a = fitted(&[("x_u", -20.0), ("y_v", -30.0)], c.clone());
        let b = fitted(&[("x_u", -21.0), ("y_v", -30.0)], c);
        a.undetermined = b.order[1..].to_vec();
        let compared = Compared::of(&a, &b);
        let y_v = compared.rows.iter().find(|r| r.key == "y_v").unwrap();
        assert_eq!((y_v.difference, y_v.sds), (Some(0.0), None));
        assert_eq!(
            (y_v.undetermined.as_slice(), compared.judged()),
            (&["A"][..], 1)
        );
        assert_eq!(compared.together.unwrap().keys, ["x_u"]);
    }

    proptest! {
        /// The worst sd is never below the independent one, and both change sign with the sides.
        #[test]
        fn sides_are_exchanged(a in -50.0..50.0f64, b in -50.0..50.0f64, sa in 0.01..9.0f64, sb in 0.01..9.0f64) {
            let one = fitted(&[("x_u", a)], vec![vec![sa * sa]]);
            let other = fitted(&[("x_u", b)], vec![vec![sb * sb]]);
            let (there, back) = (Compared::of(&one, &other), Compared::of(&other, &one));
            let (there_row, back_row) = (&there.rows[0], &back.rows[0]);
            prop_assert_eq!(there_row.sds.unwrap(), -back_row.sds.unwrap());
            prop_assert!(there_row.sds_at_least.unwrap().abs() <= there_row.sds.unwrap().abs());
            let (p, q) = (there.together.unwrap(), back.together.unwrap());
            prop_assert!((p.chi2 - q.chi2).abs() <= 1e-9 * p.chi2.max(1.0));
        }
    }
}
