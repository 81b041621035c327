//! The power of the rate with which a named law grows, freed: which exponents the data leave open.
//!
//! A law whose force is a power of the rate (measured on the law itself, no list of such laws) gets a factor
//! |rate / typical rate|^k on its first parameter, k stepwise, everything else refitted beside each.

use rayon::prelude::*;

use super::rivals::LIGHT;

use crate::descent::{Effort, descend};
use crate::family::{Acts, Family, FamilyFit, Joint, Prior, Variable};
use crate::fit::Fit;
use crate::predict::{BETTER_T, Prediction, Starts, predicted_beside};
use crate::search::Search;
use crate::setting::{COEFFICIENTS, Setting, Track};
use crate::verdict::Exponent;

/// Exponents tried: from, step, how many.
const TRIED: (f64, f64, usize) = (0.5, 0.25, 15);
/// A law that grows less than this is not asked.
const FASTER: f64 = 1.2;
/// By how much the slope of a power law may vary over the rates it is measured at.
const STRAIGHT: f64 = 0.03;
/// By how much the way a force sets a motion back may differ from a quarter at half the time.
const FROM_THE_START: f64 = 0.1;
/// Half chi-square within which an exponent is in the 95 % interval.
const WITHIN: f64 = 1.92;
/// rms of the runs held out over the least one's up to which an exponent is open however little the errors
/// vary.
const AS_GOOD: f64 = 1.02;
/// Knots of the factor, and the rates they span over the typical one.
const KNOTS: (usize, f64, f64) = (28, 0.01, 5.0);
/// Length of the motion a law's force is measured by \[s\].
const MOMENT_S: f64 = 0.01;

/// Of each member that is not light and whose law is a power of the rate.
pub fn exponents(
    search: &Search<'_>,
    first: &Fit,
    shares: &[f64],
    held: &[Track],
    established: &dyn Fn(&str) -> bool,
) -> Vec<Exponent> {
    let setting = search.setting;
    let typical = typical_rate(setting);
    let vehicle = &first.at[..COEFFICIENTS];
    (0..first.set.len())
        .filter(|m| shares[*m] > LIGHT * setting.tolerance && typical > 0.0)
        .filter(|m| established(setting.vocabulary[first.set[*m]].info.id))
        .filter_map(|m| {
            let law = power(
                setting,
                first.set[m],
                first.member(setting, m),
                vehicle,
                typical,
            )?;
            if law < FASTER {
                return None;
            }
            one(search, first, m, (law, typical), held)
        })
        .collect()
}

/// rms of the measured rates \[m/s, rad/s\].
fn typical_rate(setting: &Setting) -> f64 {
    let rates = || {
        setting
            .tracks
            .iter()
            .flat_map(|t| t.times_s.iter().map(|s| t.rate_at(*s)))
    };
    (rates().map(|r| r * r).sum::<f64>() / rates().count().max(1) as f64).sqrt()
}

/// Power of the rate that a candidate's force is against the motion; `None` where it is none.
fn power(
    setting: &Setting,
    candidate: usize,
    values: &[f64],
    vehicle: &[f64],
    rate: f64,
) -> Option<f64> {
    let like = setting.tracks.first()?;
    let there = setting.with_tracks(vec![Track {
        times_s: vec![0.5 * MOMENT_S, MOMENT_S],
        measured: vec![0.0; 2],
        edges: Vec::new(),
        start_s: 0.0,
        ..like.clone()
    }]);
    let globals: Vec<f64> = vehicle.iter().chain(values).copied().collect();
    // By how much a short motion falls behind, at a place where nothing else has begun.
    let behind = |rate: f64| -> Option<f64> {
        let with = there.values(0, &[candidate], &globals, (0.0, rate));
        let none = there.values(0, &[], vehicle, (0.0, rate));
        let [half, whole] = [0, 1].map(|k| none[k] - with[k]);
        // A force of the rate is there from the first moment on: twice the time, four times as far. One of
        // the place, or of what went before, grows into it.
        (whole.abs() > 0.0 && (4.0 * half / whole - 1.0).abs() < FROM_THE_START).then_some(whole)
    };
    let sizes: Vec<f64> = [1.0, 0.5, 0.25]
        .iter()
        .map(|share| behind(share * rate))
        .collect::<Option<_>>()?;
    let back = behind(-rate)?;
    let slope = |i: usize| (sizes[i] / sizes[i + 1]).ln() / 2f64.ln();
    let odd = sizes[0] > 0.0 && (back / sizes[0] + 1.0).abs() < STRAIGHT;
    let straight = (slope(0) - slope(1)).abs() < STRAIGHT;
    (odd && straight).then(|| (100.0 * slope(0)).round() / 100.0)
}

/// The law's own parameters and all else, refitted with the factor of one exponent.
fn with_factor(
    search: &Search<'_>,
    first: &Fit,
    member: usize,
    by: f64,
    typical: f64,
) -> Option<(f64, Fit, FamilyFit)> {
    let setting = search.setting;
    let (count, low, high) = KNOTS;
    let knots: Vec<f64> = (0..count)
        .map(|k| typical * low * (high / low).powf(k as f64 / (count as f64 - 1.0)))
        .collect();
    let amplitudes: Vec<f64> = knots.iter().map(|u| by * (u / typical).ln()).collect();
    let function = FamilyFit {
        family: Family {
            acts: Acts::Bends(first.set[member]),
            variable: Variable::Speed,
            knots,
            measured: false,
            quiet: Vec::new(),
        },
        sds: vec![0.0; amplitudes.len()],
        amplitudes,
        gain: 0.0,
        // Nothing is asked of the amplitudes: they stand.
        prior: Prior {
            sd: 1e9,
            length: 0.0,
        },
        response: nalgebra::DVector::zeros(0),
    };
    let joint = Joint::new(setting, &search.weights, first, &function);
    let n = first.at.len();
    let free = Starts {
        joint: &joint,
        fixed: function.unknowns(first),
        range: 0..n,
    };
    let found = descend(&free, first.at.clone(), Effort::FULL).ok()?;
    let fit = Fit {
        at: found.at,
        cost: found.cost,
        ..first.clone()
    };
    found
        .cost
        .is_finite()
        .then_some((found.cost, fit, function))
}

fn one(
    search: &Search<'_>,
    first: &Fit,
    member: usize,
    (law, typical): (f64, f64),
    held: &[Track],
) -> Option<Exponent> {
    let setting = search.setting;
    let noise = search.weights.noise;
    let made: Vec<(f64, f64, Option<Prediction>)> = (0..TRIED.2)
        .into_par_iter()
        .filter_map(|k| {
            let exponent = TRIED.0 + TRIED.1 * k as f64;
            let (cost, fit, function) =
                with_factor(search, first, member, exponent - law, typical)?;
            let missed = predicted_beside(setting, held, &fit, &function, noise);
            Some((exponent, cost, missed))
        })
        .collect();
    let least = made.iter().map(|m| m.1).fold(f64::INFINITY, f64::min);
    let likely = range(made.iter().filter(|m| m.1 < least + WITHIN).map(|m| m.0))?;
    let best = made
        .iter()
        .filter_map(|m| Some((m.0, m.2.as_ref()?)))
        .min_by(|a, b| a.1.rms.total_cmp(&b.1.rms));
    let open = match best {
        Some((_, best)) => range(made.iter().filter_map(|(exponent, _, missed)| {
            let missed = missed.as_ref()?;
            let good = missed.rms <= AS_GOOD * best.rms || best.better_than(missed) < BETTER_T;
            good.then_some(*exponent)
        }))?,
        // Nothing was held out: the likelihood is all there is.
        None => likely,
    };
    let id = setting.vocabulary[first.set[member]].info.id;
    let told = told(search, first, member, law, typical, likely, open);
    Some(Exponent {
        effect: id.to_owned(),
        channel: setting.channel().to_owned(),
        law,
        tried: made.iter().map(|m| m.0).collect(),
        log_likelihood: made.iter().map(|m| least - m.1).collect(),
        held_out: made.iter().map(|m| m.2.as_ref().map(|p| p.rms)).collect(),
        likelihood_95: likely,
        open,
        told: format!("{id}: {told}"),
    })
}

fn range(of: impl Iterator<Item = f64>) -> Option<[f64; 2]> {
    of.fold(None, |r: Option<[f64; 2]>, v| {
        Some(r.map_or([v, v], |[low, high]| [low.min(v), high.max(v)]))
    })
}

/// Both intervals in words, and which laws of the vocabulary lie within.
fn told(
    search: &Search<'_>,
    first: &Fit,
    member: usize,
    law: f64,
    typical: f64,
    likely: [f64; 2],
    open: [f64; 2],
) -> String {
    let setting = search.setting;
    let vehicle = &first.at[..COEFFICIENTS];
    let info = setting.vocabulary[first.set[member]].info;
    let mut within = Vec::new();
    for (candidate, kin) in setting.vocabulary.iter().enumerate() {
        let own = candidate == first.set[member];
        if !own && !info.kin.contains(&kin.info.id) {
            continue;
        }
        let typically: Vec<f64> = kin.info.parameters.iter().map(|p| p.typical).collect();
        if let Some(p) = power(setting, candidate, &typically, vehicle, typical)
            .filter(|p| (open[0] - 0.05..=open[1] + 0.05).contains(p) && *p >= FASTER)
        {
            within.push(format!("{} (power {p})", kin.info.id));
        }
    }
    let last = TRIED.0 + TRIED.1 * (TRIED.2 as f64 - 1.0);
    let edge = |[low, high]: [f64; 2]| match (low <= TRIED.0, high >= last) {
        (true, true) => format!("any from {low} to {high}"),
        (true, false) => format!("{high} or less"),
        (false, true) => format!("{low} or more"),
        (false, false) => format!("{low} to {high}"),
    };
    let verdict = match within.len() {
        0 => format!("no law of the vocabulary has one of them, the nearest found has {law}"),
        1 => format!("of the vocabulary only {} lies within", within[0]),
        _ => format!("{} are not decided", within.join(" and ")),
    };
    let sure = if open[1] > open[0] {
        "not decided closer than"
    } else {
        "decided:"
    };
    let faster = if open[0] > 1.0 {
        "force grows faster than linearly with the rate"
    } else {
        "that the force grows linearly with the rate is not excluded"
    };
    format!(
        "{faster}; exponent {sure} {} by prediction ({} by likelihood, 95 %): {verdict}",
        edge(open),
        edge(likely)
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use hydroline_identify::data::{Run, Sample};
    use hydroline_rigs::{Dof, Rig};

    /// The law itself says its power; what acts by place, time or command has none.
    #[test]
    fn a_laws_power_of_the_rate_is_measured_on_the_law() {
        let rig = Rig::builtin("lshpi").unwrap();
        let mut run = Run::default();
        for k in 0..40 {
            let t_s = 0.1 * f64::from(k);
            let mut values = [f64::NAN; 12];
            values[3] = 0.1 * (2.5 * t_s).cos();
            run.samples.push(Sample {
                t_s,
                values,
                covariance: None,
            });
        }
        let setting = Setting::new(&[run], &rig, Dof::Roll).unwrap();
        let typical = typical_rate(&setting);
        assert!((typical / 0.177 - 1.0).abs() < 0.2, "{typical}");
        let vehicle = setting.coefficients();
        let of = |id: &str| {
            let candidate = setting
                .vocabulary
                .iter()
                .position(|c| c.info.id == id)
                .unwrap();
            let values: Vec<f64> = setting.vocabulary[candidate]
                .info
                .parameters
                .iter()
                .map(|p| p.typical)
                .collect();
            power(&setting, candidate, &values, &vehicle, typical)
        };
        for (id, expected) in [("quadratic_damping", 2.0), ("cubic_damping", 3.0)] {
            let found = of(id).unwrap();
            assert!((found - expected).abs() < 0.05, "{id}: {found}");
        }
        for id in ["nonlinear_restoring", "constant_force", "thruster_lag"] {
            assert_eq!(of(id), None, "{id}");
        }
    }
}
