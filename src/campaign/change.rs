//! Single change of the rig that explains a day after the days before it.
//!
//! The days before give coefficients θ with covariance C. Under a cause with one number s (a mass that was added, a factor on
//! damping, on all thrusts, on one thruster) the day's own coefficients θ_d, fitted with the loads as that cause has them, are
//! T(θ, s) within C + C_d. So the day's log likelihood is, but for a constant,
//!
//! ```text
//! -J(s) / 2,   J(s) = χ²_d(s) + Δᵀ (C + C_d)⁻¹ Δ,   Δ = θ_d(s) - T(θ, s)
//! ```
//!
//! with χ²_d what the day's own fit leaves, in units of the noise and misfit that the days before have shown (so a model that
//! never fitted well makes no change). Evidence by Laplace's method over s (Gelman et al. 2013, ch. 13); beside the causes stand
//! "nothing changed" (s fixed) and "something else" (θ_d free, with a broad prior).

use crate::sheet::{Cause, Change, Coefficients, Number, What};
use hydroline_core::run::Run;
use hydroline_estimate::{EstimateError, ModelChoice, Options, Refitted, identify, refit};
use hydroline_identify::Identification;
use hydroline_identify::parameter::{Coefficient, Term};
use hydroline_numerics::parallel;
use hydroline_rigs::{Dof, Rig};
use nalgebra::{DMatrix, SymmetricEigen};
use std::collections::BTreeMap;
use std::f64::consts::TAU;

/// Prior probability that a day is as the days before.
const SAME: f64 = 0.5;
/// Prior probability of a change that is none of the causes, given that there is one.
const ELSE: f64 = 0.1;
/// Prior sd of an added mass, as a share of the vehicle's.
const MASS_SHARE: f64 = 0.2;
/// Prior sd of the logarithm of a factor on damping or on all thrusts.
const LN_FACTOR: f64 = 0.3;
/// Prior sd of a coefficient that changed for another reason, as a share of itself.
const ELSE_SHARE: f64 = 0.3;
/// One thruster gives between nothing and a little more than all of its thrust, any share alike.
const THRUSTER: [f64; 2] = [0.0, 1.2];
/// Shares of a thruster's thrust that are tried beside all of it.
const TRIED: [f64; 2] = [0.8, 0.5];
/// Vertices tried after these, at most.
const REFINED: usize = 12;
/// A vertex within this share of the sd of what was tried is tried already.
const FINE: f64 = 0.2;
/// From this probability on a cause is named alone.
const ESTABLISHED: f64 = 0.95;

/// The runs of the days before (`false`) or of the day (`true`), with their loads as a rig has them; words where they cannot be read.
pub type LoadRuns<'a> = dyn Fn(&Rig, bool) -> Result<Vec<Run>, String> + Sync + 'a;

/// A coefficient as it looks where a cause with a number s acts that the rig does not know.
type Apparent = fn(Coefficient, f64, f64, &Rig) -> f64;

/// Noise and misfit that the days before have shown: sd per channel, and the time over which they hang together.
struct Shown {
    sd: BTreeMap<String, f64>,
    correlation_s: f64,
}

fn fit(runs: &[Run], rig: &Rig) -> Result<Identification, EstimateError> {
    identify(
        runs,
        rig,
        &Options {
            model: ModelChoice::Coupled,
            // A prior is the same on both days, and says nothing of what lies between them.
            flat_priors: true,
            cross_validate: false,
            budget: false,
            ..Options::default()
        },
    )
}

/// Finds the change from the days before to a day, and the probability that there is none.
///
/// # Errors
/// Words: a fit that is not possible.
pub fn change(
    rig: &Rig,
    date: &str,
    since: &[String],
    load: &LoadRuns<'_>,
) -> Result<Change, String> {
    let words = |e: EstimateError| e.to_string();
    let runs_before = load(rig, false)?;
    let before = fit(&runs_before, rig).map_err(words)?;
    let shown = shown(&before);
    let reference = Coefficients::of(&before);
    let start = at(rig, &reference);
    // Noise and which coefficients are determined come from the days before: a day under a wrong cause would take its misfit
    // for noise.
    let day = |rig: &Rig| -> Result<(Refitted, f64, f64), String> {
        let runs = load(rig, true)?;
        let found = refit(&runs, rig, &before, false).map_err(words)?;
        let (chi2, samples) = chi2(&found, &runs, &shown);
        Ok((found, chi2, samples))
    };
    // With its chi-square (see [`crate::change`]) and its independent samples.
    let (as_is, chi2_as_is, samples) = day(&start)?;
    // Both sides by one estimator: what a model that is wrong does to it, both have alike.
    let noise_alone = refit(&runs_before, &start, &before, false).map_err(words)?;
    let wider = Wider::of(&reference, &noise_alone);
    let reference = wider.apply(&noise_alone);
    let compared = Compared::of(&reference, &wider.apply(&as_is))
        .ok_or("no coefficient is determined on both sides")?;
    let unchanged = chi2_as_is + compared.distance(&|_, v| v);
    let mut hypotheses = vec![
        Hypothesis::fixed(What::Nothing, SAME.ln(), -0.5 * unchanged),
        compared.anything((1.0 - SAME).ln() + ELSE.ln(), chi2_as_is),
    ];
    let each = ((1.0 - SAME) * (1.0 - ELSE)).ln();
    let kinds = 3.0 + f64::from(u8::from(rig.thrusters.thrusters.len() > 1));
    let m = rig.vehicle.mass_kg;
    let scaled = |ln: f64, apparent: Apparent, what: What, sd: f64| {
        let objective = |s: f64| {
            chi2_as_is + compared.distance(&|c, v| apparent(c, v, s, rig)) + (s / sd).powi(2)
        };
        let ln = ln - sd.ln() - 0.5 * TAU.ln();
        Hypothesis::laplace(what, ln, &objective, 4.0 * sd)
    };
    let per_kind = each - kinds.ln();
    hypotheses.push(scaled(per_kind, with_mass, What::Mass, MASS_SHARE * m));
    hypotheses.push(scaled(per_kind, with_drag, What::Drag, LN_FACTOR).factor());
    hypotheses.push(scaled(per_kind, with_thrust, What::Thrust, LN_FACTOR).factor());
    // A thruster that no run drives can be anything.
    let driven = driven(rig, load)?;
    let several: &[usize] = match driven.as_slice() {
        [_] => &[],
        all => all,
    };
    // Each costs some fits of the day.
    hypotheses.extend(parallel::map_slice(several, |&k| {
        let ln = per_kind - (driven.len() as f64).ln() - (THRUSTER[1] - THRUSTER[0]).ln();
        let objective = |share: f64| -> f64 {
            let Ok((fit, chi2, _)) = day(&with_share(&start, k, share)) else {
                return f64::INFINITY;
            };
            match Compared::of(&reference, &wider.apply(&fit)) {
                Some(c) => chi2 + c.distance(&|_, v| v),
                None => f64::INFINITY,
            }
        };
        let what = What::Thruster(rig.thrusters.thrusters[k].name.clone());
        Hypothesis::searched(what, ln, &objective, unchanged)
    }));
    Ok(conclude(date, since, &hypotheses, samples))
}

fn at(rig: &Rig, coefficients: &Coefficients) -> Rig {
    let mut with = rig.clone();
    for (key, number) in &coefficients.numbers {
        if let Some(c) = Coefficient::find(key) {
            c.put(&mut with.vehicle, number.value);
        }
    }
    with
}

/// How far errors go over what the noise alone makes of them (misfit, what residuals leave open of the noise), by the days before.
///
/// Errors of the noise alone are e = C_n^(1/2) z; those of the whole fit are T e, where T C_n Tᵀ is its covariance and T is symmetric by
/// the measure of C_n. A day's errors go as much farther, whatever its runs say: T C_d Tᵀ.
struct Wider {
    keys: Vec<String>,
    noise_alone: DMatrix<f64>,
    whole: DMatrix<f64>,
}

impl Wider {
    fn of(whole: &Coefficients, noise_alone: &Refitted) -> Self {
        let place = |order: &[String], key: &String| order.iter().position(|k| k == key);
        let places: Vec<(usize, usize)> = (0..whole.order.len())
            .filter_map(|i| Some((i, place(&noise_alone.order, &whole.order[i])?)))
            .filter(|(_, k)| noise_alone.covariance[*k][*k].is_finite())
            .collect();
        let n = places.len();
        Self {
            keys: places
                .iter()
                .map(|(i, _)| whole.order[*i].clone())
                .collect(),
            noise_alone: DMatrix::from_fn(n, n, |i, j| {
                noise_alone.covariance[places[i].1][places[j].1]
            }),
            whole: DMatrix::from_fn(n, n, |i, j| whole.covariance[places[i].0][places[j].0]),
        }
    }

    /// T of these coefficients, by their places; none where the runs before do not determine them beside each other.
    fn stretch(&self, places: &[usize]) -> Option<DMatrix<f64>> {
        let of = |m: &DMatrix<f64>| m.select_rows(places).select_columns(places);
        let root = of(&self.noise_alone).cholesky()?.unpack();
        let left = root.solve_lower_triangular(&of(&self.whole))?;
        let ratio = root.solve_lower_triangular(&left.transpose())?;
        let mut squares = SymmetricEigen::new(ratio);
        squares.eigenvalues.apply(|v| *v = v.max(0.0).sqrt());
        let inverse =
            root.solve_lower_triangular(&DMatrix::identity(places.len(), places.len()))?;
        Some(&root * squares.recompose() * inverse)
    }

    /// Coefficients of a refit, of those that the whole fit knows too.
    fn apply(&self, found: &Refitted) -> Coefficients {
        let known = |k: &usize| {
            let place = self.keys.iter().position(|key| *key == found.order[*k])?;
            (found.covariance[*k][*k].is_finite()).then_some((*k, place))
        };
        let (kept, places): (Vec<usize>, Vec<usize>) =
            (0..found.order.len()).filter_map(|k| known(&k)).unzip();
        let n = kept.len();
        let alone = DMatrix::from_fn(n, n, |i, j| found.covariance[kept[i]][kept[j]]);
        let covariance = match self.stretch(&places) {
            Some(t) => &t * alone * t.transpose(),
            None => alone,
        };
        let number = |i: usize| {
            let key = &found.order[kept[i]];
            let number = Number {
                value: *found.values.get(key)?,
                sd: Some(covariance[(i, i)].sqrt()),
                low: None,
                high: None,
                rig: f64::NAN,
            };
            Some((key.clone(), number))
        };
        Coefficients {
            numbers: (0..n).filter_map(number).collect(),
            order: kept.iter().map(|k| found.order[*k].clone()).collect(),
            covariance: (0..n)
                .map(|i| covariance.row(i).iter().copied().collect())
                .collect(),
            ..Coefficients::default()
        }
    }
}

fn with_share(rig: &Rig, thruster: usize, share: f64) -> Rig {
    let mut with = rig.clone();
    for part in &mut with.thrusters.thrusters[thruster].direction {
        *part *= share;
    }
    with
}

/// Thrusters whose share changes the day's loads.
fn driven(rig: &Rig, load: &LoadRuns<'_>) -> Result<Vec<usize>, String> {
    let loads = |rig: &Rig| -> Result<Vec<_>, String> {
        let runs = load(rig, true)?;
        Ok(runs.into_iter().map(|r| r.commands).collect())
    };
    let all = loads(rig)?;
    let mut driven = Vec::new();
    for k in 0..rig.thrusters.thrusters.len() {
        if loads(&with_share(rig, k, TRIED[0]))? != all {
            driven.push(k);
        }
    }
    Ok(driven)
}

/// Apparent coefficient where a mass s \[kg\] was added that the rig does not know: in translation the added mass hides it.
fn with_mass(c: Coefficient, value: f64, s: f64, _rig: &Rig) -> f64 {
    match c.term {
        Term::Added if c.dof.index() < 3 => value - s,
        _ => value,
    }
}

/// Where all damping is e^s times.
fn with_drag(c: Coefficient, value: f64, s: f64, _rig: &Rig) -> f64 {
    match c.term {
        Term::Added => value,
        Term::Linear | Term::Quadratic => value * s.exp(),
    }
}

/// Where all thrust is e^s times: inertia and damping look smaller by as much.
fn with_thrust(c: Coefficient, value: f64, s: f64, rig: &Rig) -> f64 {
    let gain = s.exp();
    match c.term {
        Term::Added => {
            let rigid = match c.dof.index() {
                0..3 => rig.vehicle.mass_kg,
                i => rig.vehicle.inertia_kgm2[i - 3],
            };
            rigid - (rigid - value) / gain
        }
        Term::Linear | Term::Quadratic => value / gain,
    }
}

fn shown(found: &Identification) -> Shown {
    let mut sum: BTreeMap<String, (f64, f64)> = BTreeMap::new();
    for run in &found.runs {
        for (channel, rms) in &run.rms {
            let entry = sum.entry(channel.clone()).or_default();
            entry.0 += run.samples as f64 * rms * rms;
            entry.1 += run.samples as f64;
        }
    }
    let correlation_s = found
        .noise
        .values()
        .map(|n| {
            let all = n.noise.white_sd.powi(2) + n.noise.coloured_sd.powi(2);
            match all > 0.0 {
                true => n.noise.correlation_s * n.noise.coloured_sd.powi(2) / all,
                false => 0.0,
            }
        })
        .fold(0.0, f64::max);
    Shown {
        sd: sum
            .into_iter()
            .map(|(channel, (square, n))| (channel, (square / n).sqrt()))
            .collect(),
        correlation_s,
    }
}

/// Chi-square of a day's fit, and how many independent samples it is of: an autocorrelation of time τ leaves one in
/// 1 + 2τ/Δt (Priestley 1981, 5.3).
fn chi2(found: &Refitted, runs: &[Run], shown: &Shown) -> (f64, f64) {
    let (mut chi2, mut samples) = (0.0, 0.0);
    for (name, count, rms) in &found.runs {
        let interval_s = runs
            .iter()
            .find(|r| r.name == *name)
            .and_then(Run::interval_s)
            .unwrap_or(1.0);
        let n = *count as f64 / (1.0 + 2.0 * shown.correlation_s / interval_s);
        for (channel, rms) in rms {
            if let Some(sd) = shown.sd.get(channel).filter(|sd| **sd > 0.0) {
                chi2 += n * (rms / sd).powi(2);
                samples += n;
            }
        }
    }
    (chi2, samples)
}

/// Coefficients that are determined on both sides, with the sum of their covariances.
struct Compared {
    keys: Vec<Coefficient>,
    before: Vec<f64>,
    day: Vec<f64>,
    /// Inverse of the sum, and the logarithm of its determinant, by Cholesky.
    covariance: DMatrix<f64>,
}

impl Compared {
    fn of(before: &Coefficients, day: &Coefficients) -> Option<Self> {
        // Where ballast lies turns inertia and trim by what nobody noted: rotation's added inertia is not compared.
        let kept: Vec<(usize, usize, Coefficient)> = before
            .order
            .iter()
            .enumerate()
            .filter_map(|(i, key)| {
                let j = day.order.iter().position(|k| k == key)?;
                let c = Coefficient::find(key)?;
                let rotation = c.dof.index() >= Dof::Roll.index();
                (!rotation || c.term != Term::Added).then_some((i, j, c))
            })
            .collect();
        if kept.is_empty() {
            return None;
        }
        let n = kept.len();
        let covariance = DMatrix::from_fn(n, n, |a, b| {
            before.covariance[kept[a].0][kept[b].0] + day.covariance[kept[a].1][kept[b].1]
        });
        let value = |of: &Coefficients, key: &str| of.numbers.get(key).map(|n| n.value);
        Some(Self {
            before: kept
                .iter()
                .filter_map(|(i, ..)| value(before, &before.order[*i]))
                .collect(),
            day: kept
                .iter()
                .filter_map(|(_, j, _)| value(day, &day.order[*j]))
                .collect(),
            keys: kept.into_iter().map(|(.., c)| c).collect(),
            covariance,
        })
    }

    /// Δᵀ (C + C_d)⁻¹ Δ under a transformation of the coefficients before.
    fn distance(&self, of: &dyn Fn(Coefficient, f64) -> f64) -> f64 {
        let each = self.keys.iter().zip(&self.before).zip(&self.day);
        let off: Vec<f64> = each.map(|((c, b), d)| d - of(*c, *b)).collect();
        let off = nalgebra::DVector::from_vec(off);
        match self.covariance.clone().cholesky() {
            Some(root) => off.dot(&root.solve(&off)),
            None => f64::INFINITY,
        }
    }

    /// Any change of any coefficient: Δ ~ N(0, C + C_d + P), against the density that the day's own fit has at Δ = 0.
    fn anything(&self, ln_prior: f64, chi2: f64) -> Hypothesis {
        let n = self.keys.len();
        let wide = DMatrix::from_fn(n, n, |a, b| {
            let own = if a == b {
                (ELSE_SHARE * self.before[a]).powi(2)
            } else {
                0.0
            };
            self.covariance[(a, b)] + own
        });
        let off = nalgebra::DVector::from_fn(n, |k, _| self.day[k] - self.before[k]);
        let ln = match (wide.cholesky(), self.covariance.clone().cholesky()) {
            (Some(wide), Some(narrow)) => {
                let ln_det = |l: &nalgebra::Cholesky<f64, nalgebra::Dyn>| {
                    2.0 * l.l_dirty().diagonal().iter().map(|v| v.ln()).sum::<f64>()
                };
                // Against the narrow one, which all other hypotheses are measured by.
                -0.5 * (chi2 + off.dot(&wide.solve(&off)) + ln_det(&wide) - ln_det(&narrow))
            }
            _ => f64::NEG_INFINITY,
        };
        Hypothesis::fixed(What::Else, ln_prior, ln)
    }
}

/// A hypothesis with its log probability, not normalised.
struct Hypothesis {
    what: What,
    value: f64,
    sd: f64,
    ln: f64,
    /// -J/2 at its best.
    best: f64,
}

impl Hypothesis {
    fn fixed(what: What, ln_prior: f64, ln_likelihood: f64) -> Self {
        Self {
            what,
            value: f64::NAN,
            sd: f64::NAN,
            ln: ln_prior + ln_likelihood,
            best: ln_likelihood,
        }
    }

    /// Laplace's method about the least of an objective J within ± `range`.
    fn laplace(what: What, ln_prior: f64, objective: &dyn Fn(f64) -> f64, range: f64) -> Self {
        let (value, least) = golden(objective, [-range, range], 1e-4 * range);
        Self::at(what, ln_prior, objective, value, least, 1e-3 * range)
    }

    fn at(
        what: What,
        ln_prior: f64,
        objective: &dyn Fn(f64) -> f64,
        value: f64,
        least: f64,
        step: f64,
    ) -> Self {
        // J about its least: (s - s0)² / sd².
        let around = 0.5 * (objective(value - step) + objective(value + step)) - least;
        let sd = step / around.max(1e-12).sqrt();
        Self {
            what,
            value,
            sd,
            ln: ln_prior - 0.5 * least + (sd * TAU.sqrt()).ln(),
            best: -0.5 * least,
        }
    }

    /// The same where each value costs a fit: a parabola through three values, its vertex tried, and again.
    fn searched(what: What, ln_prior: f64, objective: &dyn Fn(f64) -> f64, at_one: f64) -> Self {
        let mut tried = vec![(1.0, at_one)];
        tried.extend(TRIED.map(|s| (s, objective(s))));
        for _ in 0..REFINED {
            let Some((vertex, curvature)) = parabola(&mut tried) else {
                break;
            };
            let vertex = vertex.clamp(THRUSTER[0], THRUSTER[1]);
            let fine = FINE / curvature.sqrt();
            if tried.iter().any(|(s, _)| (s - vertex).abs() < fine) {
                break;
            }
            tried.push((vertex, objective(vertex)));
        }
        let curvature = parabola(&mut tried).map_or_else(|| secant(&tried), |(_, c)| c);
        let (value, least) = tried.first().copied().unwrap_or((f64::NAN, f64::INFINITY));
        // J about its least is (s - s0)² / sd²; wider than the prior it cannot be.
        let sd = (1.0 / curvature.max(1e-12).sqrt()).min(THRUSTER[1] - THRUSTER[0]);
        Self {
            what,
            value,
            sd,
            ln: ln_prior - 0.5 * least + (sd * TAU.sqrt()).ln(),
            best: -0.5 * least,
        }
    }

    /// A logarithm as the factor that it is of.
    fn factor(mut self) -> Self {
        self.value = self.value.exp();
        self.sd *= self.value;
        self
    }
}

/// Vertex and curvature (J = c (s - s0)² + ...) of the parabola through the three best of the points, which it sorts, best first.
fn parabola(points: &mut [(f64, f64)]) -> Option<(f64, f64)> {
    points.sort_by(|a, b| a.1.total_cmp(&b.1));
    let [(a, fa), (b, fb), (c, fc), ..] = *points else {
        return None;
    };
    let (slope, other) = ((fb - fa) / (b - a), (fc - fa) / (c - a));
    let curvature = (slope - other) / (b - c);
    (curvature > 0.0 && fc.is_finite()).then(|| (0.5 * (a + b - slope / curvature), curvature))
}

/// Curvature of a parabola about the best of the points through the nearest other one. Three that have no least between them (a fit
/// that ended early is among them) are no likelihood that is flat.
fn secant(points: &[(f64, f64)]) -> f64 {
    let Some(((best, least), others)) = points.split_first() else {
        return 0.0;
    };
    let far = |p: &&(f64, f64)| (p.0 - best).abs();
    let nearest = others.iter().min_by(|a, b| far(a).total_cmp(&far(b)));
    nearest.map_or(0.0, |p| (p.1 - least) / far(&p).powi(2))
}

/// Golden section search (Kiefer 1953).
fn golden(objective: &dyn Fn(f64) -> f64, [mut low, mut high]: [f64; 2], fine: f64) -> (f64, f64) {
    let share = 0.5 * (5f64.sqrt() - 1.0);
    let mut inner = [high - share * (high - low), low + share * (high - low)];
    let mut value = [objective(inner[0]), objective(inner[1])];
    while high - low > fine {
        if value[0] < value[1] {
            high = inner[1];
            inner = [high - share * (high - low), inner[0]];
            value = [objective(inner[0]), value[0]];
        } else {
            low = inner[0];
            inner = [inner[1], low + share * (high - low)];
            value = [value[1], objective(inner[1])];
        }
    }
    match value[0] < value[1] {
        true => (inner[0], value[0]),
        false => (inner[1], value[1]),
    }
}

fn conclude(date: &str, since: &[String], all: &[Hypothesis], samples: f64) -> Change {
    let most = all.iter().map(|h| h.ln).fold(f64::NEG_INFINITY, f64::max);
    let sum: f64 = all.iter().map(|h| (h.ln - most).exp()).sum();
    let probability = |h: &Hypothesis| (h.ln - most).exp() / sum;
    let same_probability = probability(&all[0]);
    let mut causes: Vec<Cause> = all[1..]
        .iter()
        .map(|h| Cause {
            what: h.what.clone(),
            value: Some(h.value).filter(|v| v.is_finite()),
            sd: Some(h.sd).filter(|v| v.is_finite()),
            probability: probability(h),
        })
        .collect();
    causes.sort_by(|a, b| b.probability.total_cmp(&a.probability));
    let best = all.iter().map(|h| h.best).fold(f64::NEG_INFINITY, f64::max);
    let per = |ln: f64| -2.0 * ln / samples.max(1.0);
    let sentence = sentence(date, since, same_probability, &causes);
    Change {
        date: date.to_owned(),
        since: since.to_vec(),
        same_probability,
        causes,
        chi2_per_dof: [per(all[0].best), per(best)],
        sentence,
    }
}

/// A number with its sd, to the two digits of the sd that are known.
fn with_sd(value: f64, sd: f64) -> String {
    let digits = match sd > 0.0 && sd.is_finite() {
        true => (1.0 - sd.log10().floor()).clamp(0.0, 9.0) as usize,
        false => 3,
    };
    format!("{value:.digits$} ± {sd:.digits$}")
}

fn sentence(date: &str, since: &[String], same: f64, causes: &[Cause]) -> String {
    let days = match since {
        [one] => one.clone(),
        [first, .., last] => format!("{first} to {last}"),
        [] => String::new(),
    };
    if same >= ESTABLISHED {
        return format!("{date}: as {days} (probability {same:.3})");
    }
    let said = |c: &Cause| -> String {
        let (value, sd) = (c.value.unwrap_or(f64::NAN), c.sd.unwrap_or(f64::NAN));
        match &c.what {
            What::Mass if value > 0.0 => format!("+{} kg of mass", with_sd(value, sd)),
            What::Mass => format!("{} kg of mass", with_sd(value, sd)),
            What::Drag => format!("damping {} times", with_sd(value, sd)),
            What::Thrust => format!("all thrust {} times", with_sd(value, sd)),
            What::Nothing | What::Else => {
                "a change that is none of mass, damping, thrust or one thruster".to_owned()
            }
            What::Thruster(_) => format!("{} gives {} of its thrust", c.what, with_sd(value, sd)),
        }
    };
    match causes {
        [first, ..] if first.probability >= ESTABLISHED => format!(
            "{date}: {} against {days} (probability {:.3})",
            said(first),
            first.probability
        ),
        _ => {
            let listed: Vec<String> = causes
                .iter()
                .filter(|c| c.probability > 1.0 - ESTABLISHED)
                .map(|c| format!("{} ({:.2})", said(c), c.probability))
                .collect();
            format!(
                "{date}: against {days} undecided: nothing changed ({same:.2}); {}",
                listed.join("; ")
            )
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_least_of_a_parabola_has_its_sd() {
        let found =
            Hypothesis::laplace(What::Mass, 0.0, &|s| ((s - 0.3) / 0.05).powi(2) + 7.0, 4.0);
        assert!((found.value - 0.3).abs() < 1e-3 && (found.sd - 0.05).abs() < 1e-3);
        assert!((found.ln - (-3.5 + (0.05 * TAU.sqrt()).ln())).abs() < 1e-2);
    }

    /// The difference of two covariances was added to a day's: where the whole fit is surer than the noise taken, less than none was left.
    #[test]
    fn errors_of_a_day_are_stretched_as_those_before_and_stay_errors() {
        let refitted = |covariance: [[f64; 2]; 2]| Refitted {
            values: BTreeMap::from([("x_u".to_owned(), -20.0), ("x_uu".to_owned(), -200.0)]),
            order: vec!["x_u".to_owned(), "x_uu".to_owned()],
            covariance: covariance.map(Vec::from).to_vec(),
            runs: Vec::new(),
        };
        let before = refitted([[4.0, -3.0], [-3.0, 9.0]]);
        for scale in [0.25, 2.0] {
            let whole = Coefficients {
                order: before.order.clone(),
                covariance: [[4.0, -3.0], [-3.0, 9.0]]
                    .map(|row| row.map(|v| scale * v).to_vec())
                    .to_vec(),
                ..Coefficients::default()
            };
            let wider = Wider::of(&whole, &before);
            let day = wider.apply(&refitted([[1.0, 0.5], [0.5, 2.0]]));
            for (i, j, alone) in [(0, 0, 1.0), (0, 1, 0.5), (1, 1, 2.0)] {
                let found = day.covariance[i][j];
                assert!(
                    (found - scale * alone).abs() < 1e-9,
                    "{scale} {i} {j} {found}"
                );
            }
        }
        // In one direction only: x_u's error is three times as far, its share of the other's as well.
        let whole = Coefficients {
            order: before.order.clone(),
            covariance: vec![vec![36.0, -9.0], vec![-9.0, 9.0]],
            ..Coefficients::default()
        };
        let again = Wider::of(&whole, &before).apply(&before);
        assert!((again.covariance[0][0] - 36.0).abs() < 1e-9);
        assert!((again.covariance[0][1] + 9.0).abs() < 1e-9);
    }

    #[test]
    fn a_number_is_printed_to_the_digits_of_its_sd() {
        assert_eq!(with_sd(2.00312, 0.0123), "2.003 ± 0.012");
        assert_eq!(with_sd(0.600_028, 4.6e-5), "0.600028 ± 0.000046");
        assert_eq!(with_sd(-16.8, 12.0), "-17 ± 12");
    }

    #[test]
    fn a_search_that_is_no_parabola_ends_at_its_least_within_its_sd() {
        // Least at 0.6 with an sd of 1e-3, and steeper below than above.
        let objective = |s: f64| {
            let off = (s - 0.6) / 1e-3;
            off * off * (1.0 - 0.8 * (s - 0.6))
        };
        let found = Hypothesis::searched(
            What::Thruster("a".to_owned()),
            0.0,
            &objective,
            objective(1.0),
        );
        assert!((found.value - 0.6).abs() < 3e-4, "{}", found.value);
        assert!((found.sd / 1e-3 - 1.0).abs() < 0.1, "{}", found.sd);
    }

    /// A day that was as the one before became undecided: "h_fore_port gives 1.0 ± 1.2 of its thrust".
    #[test]
    fn a_search_whose_trials_have_no_parabola_is_no_flat_likelihood() {
        let objective = |s: f64| 500.0 + 1000.0 * (s - 1.0).abs().sqrt();
        let what = || What::Thruster("a".to_owned());
        let found = Hypothesis::searched(what(), 0.0, &objective, objective(1.0));
        assert!(found.value == 1.0 && found.sd < 0.02, "{}", found.sd);
        // Where no fit but that of the whole thrust is possible, no other share has any probability.
        let alone = |_: f64| f64::INFINITY;
        let found = Hypothesis::searched(what(), 0.0, &alone, 500.0);
        assert!(found.value == 1.0 && found.ln == f64::NEG_INFINITY);
    }

    #[test]
    fn thrust_scales_inertia_and_damping_alike() {
        let rig = Rig::builtin("lshpi").unwrap();
        let [added, linear, _] = Coefficient::of(Dof::Surge);
        let m = rig.vehicle.mass_kg;
        let s = 0.8f64.ln();
        let apparent = m - with_thrust(added, -30.0, s, &rig);
        assert!((apparent - (m + 30.0) / 0.8).abs() < 1e-9);
        assert!((with_thrust(linear, -20.0, s, &rig) + 25.0).abs() < 1e-9);
    }
}
