//! The other five DOFs, identified through rendered frames, undisturbed.

use hydroline_rigs::{Dof, Rig};
use serde::Serialize;

use super::ReproduceError;
use super::coefficient_errors::{
    CoefficientErrors, ESTIMATORS, Estimator, Identified, by_condition,
};
use super::experiment::{Experiment, Seen, guess_of};
use hydroline_identify::parameter::Coefficient;
use hydroline_pose::Pose;

/// One DOF by one estimator.
#[derive(Debug, Clone, PartialEq, Serialize, schemars::JsonSchema)]
pub struct DofRow {
    /// `sway` .. `yaw`.
    pub dof: String,
    /// `paper` (its formula) or `joint`.
    pub estimator: String,
    /// Number of experiments.
    pub seeds: usize,
    /// Frames of one experiment.
    pub frames: usize,
    /// Coefficients as the paper writes them.
    pub symbols: [String; 3],
    /// Actual values.
    pub actual: [f64; 3],
    /// Mean error \[%\].
    pub mean_percent: [f64; 3],
    /// rms error \[%\].
    pub rms_percent: [f64; 3],
    /// rms of the reported standard deviations \[%\].
    pub sd_percent: [f64; 3],
    /// Largest error in units of its own reported sd.
    pub worst_in_sd: [f64; 3],
    /// rms position error about its mean \[mm or °\].
    pub position_rms: f64,
    /// Share of frames without an answer.
    pub lost: f64,
}

/// Two runs per DOF within the ranges of Table 3: a strong one that turns round and a weaker one that
/// ends in a coast-down, so that all three terms move the vehicle.
fn experiments(dof: Dof) -> [Experiment; 2] {
    // Height of the CG [m], half period [s] and load [N, N m] of the strong run, load of the weak
    // one, whose half period is longer by the last factor. Roll and pitch are driven near their
    // own period (4.8 and 8.4 s); the motion stays within 120 mm, 17 deg of roll, 21 of pitch, 17 of yaw.
    let (height_m, half_s, strong, weak, longer) = match dof {
        Dof::Surge | Dof::Sway => (0.83, 3.0, 14.0, 5.0, 1.2),
        Dof::Heave => (0.74, 3.5, 14.0, 5.0, 1.2),
        Dof::Roll => (0.68, 2.6, 0.9, 0.45, 1.3),
        Dof::Pitch => (0.68, 4.0, 1.4, 0.7, 1.0),
        Dof::Yaw => (0.83, 2.5, 2.0, 0.8, 1.2),
    };
    let slow_s = longer * half_s;
    let start = Pose {
        x_m: 0.2,
        z_m: -height_m,
        ..Pose::default()
    };
    // Half a period, then whole ones with alternating sign: the motion swings about its start.
    let square = |load: f64, half_s: f64, count: usize| -> Vec<(f64, f64)> {
        std::iter::once((0.0, load))
            .chain((0..count).map(|k| {
                let sign = if k % 2 == 0 { -1.0 } else { 1.0 };
                (half_s * (k as f64 + 0.5), sign * load)
            }))
            .collect()
    };
    let mut coasting = square(weak, slow_s, 5);
    coasting.push((5.5 * slow_s, 0.0));
    let run = |name: &str, loads: Vec<(f64, f64)>, length_s: f64| Experiment {
        name: format!("{} {name}", dof.name()),
        dof,
        start,
        loads,
        length_s,
        swings: Vec::new(),
    };
    [
        run("strong", square(strong, half_s, 7), 7.5 * half_s),
        run("weak", coasting, 5.5 * slow_s + 6.0),
    ]
}

struct Outcome {
    identified: Identified,
    frames: usize,
    position_rms: f64,
    lost: f64,
}

/// Identifies sway, heave, roll, pitch and yaw `seeds` times each; `progress` is called with each experiment.
///
/// # Errors
/// [`ReproduceError`].
pub fn all_dofs(seeds: u64, progress: &(dyn Fn() + Sync)) -> Result<Vec<DofRow>, ReproduceError> {
    dofs(&Dof::ALL[1..], seeds, progress)
}

/// The same for some of them.
///
/// # Errors
/// [`ReproduceError`].
pub fn dofs(
    chosen: &[Dof],
    seeds: u64,
    progress: &(dyn Fn() + Sync),
) -> Result<Vec<DofRow>, ReproduceError> {
    let rig = Rig::builtin("lshpi")?;
    let guess = guess_of(&rig);
    let outcomes = by_condition(chosen, seeds, |dof, seed| {
        let runs = experiments(dof);
        let seen = Experiment::see_all(&runs, &rig, seed)?;
        let both = [
            fit(dof, &guess, &runs, &seen, |s| &s.formula)?,
            fit(dof, &guess, &runs, &seen, |s| &s.joint)?,
        ];
        progress();
        Ok(both)
    })?;
    let mut rows = Vec::new();
    for (dof, both) in &outcomes {
        for (e, estimator) in ESTIMATORS.into_iter().enumerate() {
            let of: Vec<&Outcome> = both.iter().map(|both| &both[e]).collect();
            rows.push(row(*dof, estimator, &rig, &of));
        }
    }
    Ok(rows)
}

fn fit(
    dof: Dof,
    guess: &Rig,
    runs: &[Experiment; 2],
    seen: &[Seen],
    positions: impl Fn(&Seen) -> &Vec<f64>,
) -> Result<Outcome, ReproduceError> {
    let (mut square, mut answered, mut frames) = (0.0, 0usize, 0usize);
    for s in seen {
        let errors = s.finite_errors(positions(s));
        let mean = errors.iter().sum::<f64>() / errors.len().max(1) as f64;
        square += errors.iter().map(|e| (e - mean).powi(2)).sum::<f64>();
        answered += errors.len();
        frames += s.t_s.len();
    }
    let unit = if dof.index() < 3 {
        1e3
    } else {
        1f64.to_degrees()
    };
    Ok(Outcome {
        identified: Identified::from_positions(
            dof,
            guess,
            runs,
            seen,
            positions,
            Estimator::Likelihood,
        )?,
        position_rms: unit * (square / answered.max(1) as f64).sqrt(),
        frames,
        lost: 1.0 - answered as f64 / frames.max(1) as f64,
    })
}

fn row(dof: Dof, estimator: &str, rig: &Rig, of: &[&Outcome]) -> DofRow {
    let terms = Coefficient::of(dof);
    let actual = terms.map(|c| c.of_vehicle(&rig.vehicle));
    let n = of.len().max(1) as f64;
    let found: Vec<Identified> = of.iter().map(|o| o.identified).collect();
    let errors = CoefficientErrors::of(actual, &found);
    let square = of.iter().map(|o| o.position_rms.powi(2)).sum::<f64>();
    DofRow {
        dof: dof.name().to_owned(),
        estimator: estimator.to_owned(),
        seeds: of.len(),
        frames: of.first().map_or(0, |o| o.frames),
        symbols: terms.map(|c| c.symbol().to_owned()),
        actual,
        mean_percent: errors.mean_percent,
        rms_percent: errors.rms_percent,
        sd_percent: errors.sd_percent,
        worst_in_sd: errors.worst_in_sd,
        position_rms: (square / n).sqrt(),
        lost: of.iter().map(|o| o.lost).sum::<f64>() / n,
    }
}
