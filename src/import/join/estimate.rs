//! Offset and drift from the data: the motion answers to the commands.
//!
//! Each degree of freedom that is commanded and measured follows its own equation (`response`); offset, drift and all
//! coefficients are fitted together to velocities and ways travelled along the body's axes, weighted by the noise
//! that is left, whitened by its correlation from sample to sample. A latency between command and load cannot be determined
//! from an offset of the clocks: it is in what is found.

use nalgebra::{DMatrix, DVector, Dyn};

use hydroline_numerics::least_squares::{LeastSquares, Normal, Options, minimise};

use super::coarse::{coarse, start};
use super::problem::{Aligned, DRIFT_UNIT, Problem, SHARED};
use super::response::COEFFICIENTS;

/// Rounds in which noise and fit are found in turn.
const ROUNDS: usize = 3;

/// The fit; drift, restoring and what is not there are held.
pub(super) struct Fit<'a> {
    pub(super) problem: &'a Problem,
    pub(super) held: Vec<bool>,
}

impl Fit<'_> {
    fn size(&self, at: &DVector<f64>, k: usize) -> f64 {
        // A thousandth of a second, of a drift's unit, of a coefficient.
        1e-4 * at[k].abs().max(if k < SHARED { 1.0 } else { 1e-2 })
    }
}

impl LeastSquares<Dyn> for Fit<'_> {
    type Point = DVector<f64>;
    type Evaluated = Vec<f64>;
    type Error = String;

    fn cost(&mut self, at: &DVector<f64>, evaluated: &mut Vec<f64>) -> Option<f64> {
        *evaluated = self.problem.residuals(at)?;
        Some(0.5 * evaluated.iter().map(|r| r * r).sum::<f64>())
    }

    fn begin(&mut self, at: &DVector<f64>, evaluated: &mut Vec<f64>) -> Result<(), String> {
        *evaluated = self
            .problem
            .residuals(at)
            .ok_or("the motion runs away at the start of the fit")?;
        Ok(())
    }

    fn linearise(
        &mut self,
        at: &DVector<f64>,
        evaluated: &Vec<f64>,
    ) -> Result<Normal<Dyn>, String> {
        let n = at.len();
        let mut columns: Vec<Vec<f64>> = Vec::with_capacity(n);
        for k in 0..n {
            if self.held[k] {
                columns.push(vec![0.0; evaluated.len()]);
                continue;
            }
            let h = self.size(at, k);
            let side = |sign: f64| {
                let mut moved = at.clone();
                moved[k] += sign * h;
                self.problem.residuals(&moved)
            };
            let (Some(up), Some(down)) = (side(1.0), side(-1.0)) else {
                return Err("the motion runs away".to_owned());
            };
            columns.push(
                up.iter()
                    .zip(&down)
                    .map(|(u, d)| (u - d) / (2.0 * h))
                    .collect(),
            );
        }
        let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(x, y)| x * y).sum::<f64>();
        Ok(Normal {
            cost: 0.5 * dot(evaluated, evaluated),
            gradient: DVector::from_fn(n, |k, _| dot(&columns[k], evaluated)),
            hessian: DMatrix::from_fn(n, n, |i, j| {
                if i == j && self.held[i] {
                    1.0
                } else {
                    dot(&columns[i], &columns[j])
                }
            }),
        })
    }

    fn moved(&self, at: &DVector<f64>, step: &DVector<f64>) -> Option<DVector<f64>> {
        Some(at + step)
    }

    fn moves(&self, _: &DVector<f64>, _: &DVector<f64>, k: usize) -> bool {
        !self.held[k]
    }
}

/// Finds offset and drift; the offset lies `within_s`, between the two zeros; `drift` holds it.
///
/// # Errors
/// Why it cannot be done, in words.
pub fn align(
    problem: &Problem,
    drift: Option<f64>,
    within_s: (f64, f64),
) -> Result<Aligned, String> {
    Ok(fitted(problem, drift, within_s)?.0)
}

/// As [`align`], with all unknowns where they were found, and which of them were held.
pub(super) fn fitted(
    problem: &Problem,
    drift: Option<f64>,
    within_s: (f64, f64),
) -> Result<(Aligned, DVector<f64>, Vec<bool>), String> {
    if problem.dofs.is_empty() {
        return Err(
            "no degree of freedom is both commanded (with a load that changes) and measured"
                .to_owned(),
        );
    }
    let minima = coarse(problem, within_s);
    let Some(best) = minima.first().copied() else {
        return Err("at no offset within --search-s of the stamps does half of the shorter log overlap the other; a larger --search-s looks further".to_owned());
    };
    if best.1 > -0.1 * problem.series.len() as f64 {
        return Err("the motion does not answer to the commands at any offset".to_owned());
    }
    let mut own = problem.copy();
    let n = SHARED + own.dofs.len() * COEFFICIENTS;
    let mut held = vec![false; n];
    held[1] = drift.is_some();
    for (place, dof) in own.dofs.iter().enumerate() {
        let first = SHARED + place * COEFFICIENTS;
        // Where no way is measured its start means nothing; surge, sway and yaw have no springs.
        let has_way = own.series.iter().any(|s| s.dof == place && s.is_way);
        held[first + 5] = !has_way;
        held[first + 6] = !has_way || matches!(dof, 0 | 1 | 5);
    }
    let options = Options::default();
    let mut found: Vec<(f64, DVector<f64>)> = Vec::new();
    for (offset_s, _) in minima.iter().take(3) {
        // Weights of one size for all: what each series varies by.
        for s in &mut own.series {
            let values: Vec<f64> = s.values.iter().copied().filter(|v| v.is_finite()).collect();
            let mean = values.iter().sum::<f64>() / values.len() as f64;
            let power = values.iter().map(|v| (v - mean).powi(2)).sum::<f64>();
            s.sd = (power / values.len() as f64).sqrt().max(1e-9) * 0.1;
            s.rho = 0.0;
        }
        let mut fit = Fit {
            problem: &own,
            held: held.clone(),
        };
        let begin = start(&own, *offset_s, drift.unwrap_or(0.0));
        if let Ok(f) = minimise(&mut fit, begin, &options) {
            found.push((f.normal.cost, f.at));
        }
    }
    found.sort_by(|a, b| a.0.total_cmp(&b.0));
    let Some((_, mut at)) = found.first().cloned() else {
        return Err("no fit of the motion to the commands ends".to_owned());
    };
    let mut normal = None;
    for _ in 0..ROUNDS {
        own.learn_noise(&at).ok_or("the fitted motion runs away")?;
        let mut fit = Fit {
            problem: &own,
            held: held.clone(),
        };
        let f = minimise(&mut fit, at.clone(), &options)?;
        at = f.at;
        normal = Some(f.normal);
    }
    let normal = normal.ok_or("no fit")?;
    let back = -own.middle_s * DRIFT_UNIT;
    let (variance, vd) = own.variances(&normal.hessian, &held);
    let mut warnings = Vec::new();
    if !(variance.is_finite() && variance > 0.0) {
        return Err("the commands do not change within the motion, so that no offset fits better than another".to_owned());
    }
    if let Some(second) = minima.iter().skip(1).find(|m| (m.0 - best.0).abs() > 2.0)
        && second.1 - best.1 < 0.05 * problem.series.len() as f64
    {
        warnings.push(format!(
            "an offset {:+.1} s from this one explains the motion nearly as well: are the commands periodic?",
            second.0 - best.0
        ));
    }
    let aligned = Aligned {
        offset_s: at[0] + back * at[1],
        offset_sd_s: variance.sqrt(),
        drift: at[1] * DRIFT_UNIT,
        drift_sd: vd.max(0.0).sqrt() * DRIFT_UNIT,
        warnings,
    };
    Ok((aligned, at, held))
}
