//! Writes an identification into a rig file: values with their covariance.

use hydroline_rigs::{Identified, Rig};
use nalgebra::{DMatrix, DVector, SymmetricEigen};

use super::outcome::{Estimate, Identification};
use super::parameter::{Coefficient, Term};
use hydroline_report::significant;

/// Directions whose variance is below this share of the largest (at unit variances) carry no information.
const NEGLIGIBLE: f64 = 1e-12;

/// Standard deviations within which a coefficient is taken for zero.
pub const ZERO_WITHIN_SD: f64 = 2.0;

/// One coefficient of a result.
struct Found<'r> {
    /// Row and column of the result's covariance.
    place: usize,
    coefficient: Coefficient,
    estimate: &'r Estimate,
    /// Reason why the rig keeps its value; `None` = it does not.
    kept: Option<&'static str>,
}

/// Puts every coefficient that was determined into the rig, with its covariance into `[identified]`; what an
/// earlier identification left there of other coefficients stays. Returns a sentence for each that was not taken.
///
/// A coefficient that is not taken keeps the rig's value, and the others are then what they are beside that value, not beside the
/// one they were fitted with. It has its rows of the covariance too: its uncertainty is in the others, and a band
/// made of the rig is the fit's.
pub fn adopt(result: &Identification, rig: &mut Rig) -> Vec<String> {
    let mut all: Vec<Found<'_>> = result
        .order
        .iter()
        .enumerate()
        .filter_map(|(place, key)| {
            let coefficient = Coefficient::find(key)?;
            let estimate = result.parameters.get(key)?;
            Some(Found {
                place,
                coefficient,
                estimate,
                kept: why_kept(coefficient, estimate),
            })
        })
        .collect();
    // A coefficient that is zero within its noise is zero for the rig, on whichever side of it the noise has put it.
    for f in all
        .iter_mut()
        .filter(|f| is_zero(f.coefficient, f.estimate))
    {
        f.coefficient.put(&mut rig.vehicle, 0.0);
        f.kept = Some("zero within its noise, on the side that no hull has: 0 is written");
    }
    let written = loop {
        let written = beside_kept(result, &all, rig);
        // A coefficient that turns positive beside the rig's values of the others, which no hull has, stays out too.
        let positive = written.values.iter().find(|(_, value)| *value > 0.0);
        match positive.and_then(|(i, _)| all.get_mut(*i)) {
            Some(found) if found.kept.is_none() => {
                found.kept = Some("would be positive beside what the rig keeps of the others");
            }
            _ => break written,
        }
    };
    let mut kept_out: Vec<String> = all
        .iter()
        .filter_map(|f| {
            let keeps = significant(f.coefficient.of_vehicle(&rig.vehicle));
            let key = f.coefficient.key();
            Some(format!("{key}: {}; the rig keeps {keeps}", f.kept?))
        })
        .collect();
    let moved: Vec<String> = written
        .values
        .iter()
        .filter_map(|(i, value)| {
            let found = all.get(*i).filter(|f| f.kept.is_none())?;
            let fitted = found.estimate.value;
            let away = (value - fitted).abs() > 1e-9 * fitted.abs();
            let (now, before) = (significant(*value), significant(fitted));
            away.then(|| {
                format!(
                    "{} is written as {now} (fitted {before})",
                    found.coefficient.key()
                )
            })
        })
        .collect();
    if let Some(last) = kept_out.last_mut().filter(|_| !moved.is_empty()) {
        *last += &format!("; beside what the rig keeps {}", moved.join(", "));
    }
    let new: Vec<(Coefficient, f64)> = written
        .values
        .iter()
        .filter_map(|(i, value)| Some((all.get(*i)?.coefficient, *value)))
        .collect();
    put(
        rig,
        &new,
        &(written.covariance + beyond_samples(result, &new)),
    );
    kept_out
}

/// Covariance of the whole budget beyond that of the samples, of these coefficients.
fn beyond_samples(result: &Identification, of: &[(Coefficient, f64)]) -> DMatrix<f64> {
    let place = |c: Coefficient| result.order.iter().position(|key| key == c.key());
    let cell = |from: &[Vec<Option<f64>>], i: usize, j: usize| from.get(i)?.get(j).copied()?;
    DMatrix::from_fn(of.len(), of.len(), |a, b| {
        let (Some(i), Some(j)) = (place(of[a].0), place(of[b].0)) else {
            return 0.0;
        };
        let combined = cell(&result.covariance_combined, i, j);
        let own = cell(&result.covariance, i, j);
        combined.zip(own).map_or(0.0, |(all, own)| all - own)
    })
}

/// Puts coefficients and their covariance (SI) into a rig; what `[identified]` says of others that the rig keeps stays.
pub fn put(rig: &mut Rig, new: &[(Coefficient, f64)], covariance: &DMatrix<f64>) {
    let mut known = of_others(rig, new);
    for (c, value) in new {
        c.put(&mut rig.vehicle, *value);
    }
    let before = known.coefficients.len();
    for row in &mut known.covariance {
        row.extend(std::iter::repeat_n(0.0, new.len()));
    }
    for ((c, value), row) in new.iter().zip(covariance.row_iter()) {
        let own = known.coefficients.len() - before;
        known.coefficients.push(c.key().to_owned());
        known.values.push(*value);
        known.sd.push(row[own].sqrt());
        let empty = std::iter::repeat_n(0.0, before);
        known
            .covariance
            .push(empty.chain(row.iter().copied()).collect());
    }
    rig.identified = (!known.coefficients.is_empty()).then_some(known);
}

fn why_kept(c: Coefficient, p: &Estimate) -> Option<&'static str> {
    if !p.excited {
        Some("not determined by these runs")
    } else if p.at_bound {
        Some("ended on its search range")
    } else if p.value > 0.0 {
        Some(match c.term {
            Term::Added => "found positive: added mass that no hull has",
            Term::Linear | Term::Quadratic => "found positive: damping that no hull has",
        })
    } else {
        None
    }
}

/// Damping that is determined, came out positive, and is no more than noise away from none.
fn is_zero(c: Coefficient, p: &Estimate) -> bool {
    let sd = p.sd.unwrap_or(0.0);
    let damping = c.term != Term::Added;
    damping && p.excited && !p.at_bound && p.value > 0.0 && p.value < ZERO_WITHIN_SD * sd
}

/// Values for the rig as (index of the coefficient, value), and their covariance in the same order.
struct Written {
    values: Vec<(usize, f64)>,
    covariance: DMatrix<f64>,
}

/// Taken coefficients t beside the rig's values of the kept ones k: t + B (rig - k), B = C_tk C_kk^-1, which leaves
/// C_tt - B C_kt of their own, and B D B^T of the kept ones' error D beside their rig's values.
///
/// D is the mean square of that error when the rig's uncertainty and the data are put together: with
/// V = (C_kk^-1 + prior_sd^-2)^-1 and the mean d = V C_kk^-1 (k - rig) it is V + d d^T. Of what was fitted beside the
/// rig's priors, or held at the rig's value, C_kk says that already: V = C_kk.
fn beside_kept(result: &Identification, all: &[Found<'_>], rig: &Rig) -> Written {
    let cell = |i: usize, j: usize| {
        let row = result.covariance.get(all[i].place)?;
        row.get(all[j].place).copied().flatten()
    };
    // A coefficient without a variance is written nowhere: no number can be said of it.
    let is_taken = |i: &usize| all[*i].kept.is_none();
    let known = |i: &usize| cell(*i, *i).is_some_and(|v| v > 0.0 || is_taken(i));
    let (taken, kept): (Vec<usize>, Vec<usize>) = (0..all.len()).filter(known).partition(is_taken);
    let scale = |i: usize| cell(i, i).filter(|v| *v > 0.0).map_or(1.0, f64::sqrt);
    // At unit variances: coefficients differ by 10^4 in size.
    let block = |rows: &[usize], columns: &[usize]| {
        DMatrix::from_fn(rows.len(), columns.len(), |a, b| {
            let (i, j) = (rows[a], columns[b]);
            let both = [cell(i, j), cell(j, i)].map(|v| v.unwrap_or(0.0));
            0.5 * (both[0] + both[1]) / (scale(i) * scale(j))
        })
    };
    let said = |i: usize| all[i].coefficient.of_vehicle(&rig.vehicle);
    let information = inverse(&block(&kept, &kept));
    let follow = block(&taken, &kept) * &information;
    let of_rig = DMatrix::from_fn(kept.len(), kept.len(), |a, b| {
        let estimate = all[kept[a]].estimate;
        let held = !estimate.excited && !estimate.at_bound && estimate.value == said(kept[a]);
        if a == b && !held && result.flat_priors {
            (scale(kept[a]) / all[kept[a]].coefficient.prior_sd(rig).max(1e-9)).powi(2)
        } else {
            0.0
        }
    });
    let away = DVector::from_fn(kept.len(), |a, _| {
        (all[kept[a]].estimate.value - said(kept[a])) / scale(kept[a])
    });
    let left = inverse(&(&information + of_rig));
    let mean = &left * &information * &away;
    let error = left + &mean * mean.transpose();
    let shift = -(&follow * away);
    let own = block(&taken, &taken) - &follow * block(&kept, &taken)
        + &follow * &error * follow.transpose();
    let across = &follow * &error;
    let order: Vec<usize> = taken.iter().chain(&kept).copied().collect();
    let n = taken.len();
    let joint = DMatrix::from_fn(order.len(), order.len(), |a, b| match (a < n, b < n) {
        (true, true) => 0.5 * (own[(a, b)] + own[(b, a)]),
        (true, false) => across[(a, b - n)],
        (false, true) => across[(b, a - n)],
        (false, false) => 0.5 * (error[(a - n, b - n)] + error[(b - n, a - n)]),
    });
    let joint = without_negative(joint);
    let value = |(a, i): (usize, &usize)| match shift.get(a) {
        Some(by) => (*i, all[*i].estimate.value + by * scale(*i)),
        None => (*i, said(*i)),
    };
    Written {
        values: order.iter().enumerate().map(value).collect(),
        covariance: DMatrix::from_fn(order.len(), order.len(), |a, b| {
            joint[(a, b)] * scale(order[a]) * scale(order[b])
        }),
    }
}

/// Inverse of a symmetric matrix; directions without information stay out.
fn inverse(matrix: &DMatrix<f64>) -> DMatrix<f64> {
    let n = matrix.nrows();
    let mut out = DMatrix::zeros(n, n);
    if n == 0 {
        return out;
    }
    let eigen = SymmetricEigen::new(matrix.clone());
    let largest = eigen.eigenvalues.max();
    for (k, value) in eigen.eigenvalues.iter().enumerate() {
        if *value > NEGLIGIBLE * largest {
            let direction = eigen.eigenvectors.column(k);
            out.ger(1.0 / value, &direction, &direction, 1.0);
        }
    }
    out
}

/// The same matrix where no eigenvalue is negative; rounding makes some.
fn without_negative(matrix: DMatrix<f64>) -> DMatrix<f64> {
    if matrix.is_empty() {
        return matrix;
    }
    let mut eigen = SymmetricEigen::new(matrix.clone());
    if eigen.eigenvalues.min() >= 0.0 {
        return matrix;
    }
    for value in eigen.eigenvalues.iter_mut() {
        *value = value.max(0.0);
    }
    let made = eigen.recompose();
    0.5 * (&made + made.transpose())
}

/// Entries of the rig's `[identified]` for coefficients that are not written anew and still have the value that they belong to;
/// the spread of published sets does not stay beside what was measured.
fn of_others(rig: &Rig, new: &[(Coefficient, f64)]) -> Identified {
    let known = rig.identified.clone();
    let stay_together = |k: &Identified| new.is_empty() || k.is_measured();
    let old = known.filter(stay_together).unwrap_or_else(|| Identified {
        coefficients: Vec::new(),
        values: Vec::new(),
        sd: Vec::new(),
        covariance: Vec::new(),
        source: None,
    });
    let stays: Vec<usize> = (0..old.coefficients.len())
        .filter(|i| {
            Coefficient::find(&old.coefficients[*i]).is_some_and(|c| {
                c.of_vehicle(&rig.vehicle) == old.values[*i] && new.iter().all(|t| t.0 != c)
            })
        })
        .collect();
    let of = |list: &[f64]| stays.iter().map(|i| list[*i]).collect::<Vec<f64>>();
    Identified {
        coefficients: stays.iter().map(|i| old.coefficients[*i].clone()).collect(),
        values: of(&old.values),
        sd: of(&old.sd),
        covariance: stays.iter().map(|i| of(&old.covariance[*i])).collect(),
        source: old.source,
    }
}
