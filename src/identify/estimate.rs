//! The whole way from runs to parameters with their uncertainty.

mod choice;
mod conclude;
mod fit;
mod held_out;
mod noise_at_rest;

use self::choice::{choose, rests, what_is_free};
use self::fit::Fit;
use self::held_out::cross_validate;
use self::noise_at_rest::{before_the_first_load, centred, noise_at_rest, stored_noise};
use super::axis::Axis;
use super::blind::blind_spots;
use super::coupled::{Coupled, every_pose_is_known};
use super::data::{Start, is_still, memory_s};
use super::forward::{Forward, ForwardError};
use super::lm::LevenbergMarquardt;
use super::method::{Method, MethodError};
use super::outcome::Identification;
use super::parameter::Coefficient;
use super::problem::{Objective, median_logged_sd};
use hydroline_core::run::{Channel, Run, longest_step_s};
use hydroline_rigs::{Dof, Rig};
use hydroline_sim::effect::EffectError;

/// Equations of motion to fit.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ModelChoice {
    /// One DOF when only one is driven (or, without commands, only one moves), else coupled.
    Auto,
    /// One DOF.
    Axis(Dof),
    /// The rig's model (`eq1` or `decoupled`), every measured DOF.
    Coupled,
}

/// Options of an identification.
pub struct Options<'a> {
    /// Equations of motion.
    pub model: ModelChoice,
    /// Search method.
    pub method: &'a dyn Method,
    /// Objective of the search.
    pub objective: Objective,
    /// Coefficients kept as the rig has them.
    pub fixed: Vec<Coefficient>,
    /// Prior knowledge of every run's start.
    pub start: Start,
    /// Leave-one-run-out.
    pub cross_validate: bool,
    /// Seed of random starts and searches.
    pub seed: u64,
}

impl Default for Options<'_> {
    fn default() -> Self {
        Options {
            model: ModelChoice::Auto,
            method: &LevenbergMarquardt { starts: 6 },
            objective: Objective::LeastSquares,
            fixed: Vec::new(),
            start: Start::Free,
            cross_validate: true,
            seed: 1,
        }
    }
}

/// Failure to identify.
#[derive(Debug, thiserror::Error)]
#[allow(missing_docs)] // Each message names its fields.
pub enum IdentifyError {
    #[error(
        "{samples} usable samples for {free} unknowns in {dof}; give longer runs, or check that the channel is in the log (hydroline info)"
    )]
    TooFew {
        samples: usize,
        free: usize,
        dof: String,
    },
    #[error("all {0} log(s) are at rest: they measure the noise; add runs that move")]
    OnlyStill(usize),
    #[error("no run given")]
    NoRun,
    #[error(
        "{logs} log(s): no four samples in a row are less than {apart_s:.0} s apart, the time constant of the vehicle's slowest motion, so that they do not show how it moves: are the stamps of the import right ([time] unit)?"
    )]
    TooSparse { logs: usize, apart_s: f64 },
    #[error(transparent)]
    Effect(#[from] EffectError),
    #[error(transparent)]
    Method(#[from] MethodError),
    #[error(transparent)]
    Forward(#[from] ForwardError),
}

/// Runs cut at gaps that are longer than the rig's vehicle remembers, without samples that are too far apart to show motion.
///
/// # Errors
/// [`IdentifyError::TooSparse`] where nothing is left.
pub fn stretched(runs: &[Run], rig: &Rig) -> Result<Vec<Run>, IdentifyError> {
    let memory_s = memory_s(&rig.vehicle);
    let all: Vec<Run> = runs.iter().flat_map(|r| r.stretches(memory_s)).collect();
    match all.is_empty() && !runs.is_empty() {
        true => Err(IdentifyError::TooSparse {
            logs: runs.len(),
            apart_s: longest_step_s(memory_s),
        }),
        false => Ok(all),
    }
}

/// Identifies from runs; runs at rest (no load, >= 20 s, no motion) measure the noise instead. A gap that is longer than
/// the vehicle remembers begins another run.
///
/// # Errors
/// [`IdentifyError`].
pub fn identify(
    runs: &[Run],
    rig: &Rig,
    options: &Options<'_>,
) -> Result<Identification, IdentifyError> {
    let runs = &stretched(runs, rig)?[..];
    let tolerance = [rig.tolerance.position_m, rig.tolerance.attitude_rad];
    let (still, moving): (Vec<&Run>, Vec<&Run>) = runs.iter().partition(|r| is_still(r, tolerance));
    let moving: Vec<Run> = moving.into_iter().cloned().collect();
    if moving.is_empty() {
        return Err(if runs.is_empty() {
            IdentifyError::NoRun
        } else {
            IdentifyError::OnlyStill(runs.len())
        });
    }
    let still: Vec<Run> = still.into_iter().cloned().collect();
    let choice = match options.model {
        ModelChoice::Auto => choose(&moving, rig),
        given => given,
    };
    let (coefficients, dofs, name) = what_is_free(choice, &moving, rig, options);
    let one_dof = matches!(choice, ModelChoice::Axis(_)) && rig.physics.is_empty();
    // One decision for what moves and what rests: else the noise at rest would be that of other slots.
    let (moving_known, still_known) = (
        moving.iter().all(every_pose_is_known),
        still.iter().all(every_pose_is_known),
    );
    let whitened = moving_known && still_known;
    let make = |runs: &[Run], free: &[Coefficient]| -> Result<Box<dyn Forward>, IdentifyError> {
        Ok(match choice {
            ModelChoice::Axis(dof) if one_dof => {
                Box::new(Axis::new(runs, &rig.vehicle, dof, free, options.start))
            }
            _ => Box::new(Coupled::new(runs, rig, free, options.start, whitened)?),
        })
    };
    let forward = make(&moving, &coefficients)?;
    // A run that begins at rest for long enough brings its own measurement of the noise.
    let openings: Vec<Option<(Run, f64)>> = moving
        .iter()
        .map(|r| before_the_first_load(r, tolerance).filter(|_| still.is_empty()))
        .collect();
    let opening_s: Vec<Option<f64>> = openings.iter().map(|o| Some(o.as_ref()?.1)).collect();
    let openings: Vec<Run> = openings.into_iter().flatten().map(|o| o.0).collect();
    let resting_runs: Vec<Run> = still
        .iter()
        .chain(&openings)
        .map(|r| centred(r, one_dof))
        .collect();
    let logged = median_logged_sd(forward.as_ref());
    // The paper's Eq. 10 weighs all samples alike: so must the least squares that its intervals come from.
    let alike = options.objective == Objective::SumOfAbsolute;
    let references = if alike {
        vec![None; logged.len()]
    } else {
        logged.clone()
    };
    let measured_noise = if resting_runs.is_empty() {
        stored_noise(runs, forward.slots(), &references)
    } else {
        let rest = make(&resting_runs, &coefficients)?;
        let found = noise_at_rest(rest.as_ref(), forward.slots(), &references);
        found.iter().any(Option::is_some).then_some(found)
    };
    // Whether each run at rest measured a slot of the fit.
    let used: Vec<bool> = (0..resting_runs.len())
        .map(|i| {
            let slots = measured_noise.iter().flatten().flatten();
            slots
                .filter_map(|rest| rest.stretches.get(i))
                .any(|(_, values)| values.iter().any(|v| v.is_finite()))
        })
        .collect();
    let mut fit = Fit::new(forward.as_ref(), measured_noise, opening_s, name)?;
    if alike {
        fit.problem.weigh(references);
    }
    let resting: Vec<Dof> = dofs
        .iter()
        .copied()
        .filter(|d| rests(&moving, *d))
        .collect();
    fit.hold_resting(|i| resting.contains(&coefficients[i].dof));
    fit.search(options)?;
    let mut result = fit.conclude(&moving, rig, &coefficients, options)?;
    let all = moving.iter().flat_map(|r| &r.samples);
    let (count, known) = all.fold((0usize, 0usize), |(n, k), s| {
        (n + 1, k + usize::from(s.covariance.is_some()))
    });
    if known > 0 && known < count {
        result.notes.push(format!(
            "{} of {count} samples carry no covariance of the pose: they count like the median of the others",
            count - known
        ));
    }
    if alike && logged.iter().any(Option::is_some) {
        result.notes.push(
            "the objective l1 is the paper's Eq. 10: samples count alike, whatever sd their logs say, in the intervals too (--objective ls weighs them)".to_owned(),
        );
    }
    if !one_dof && moving_known && !still_known {
        result.notes.push(
            "the logs at rest do not carry every pose with its covariance: channels are weighed by their own sd, not by whole covariances".to_owned(),
        );
    }
    for (i, r) in still.iter().chain(&openings).enumerate() {
        let first_s = r.samples.first().map_or(0.0, |s| s.t_s);
        result.notes.push(format!(
            "{}: at rest for {:.0} s{}, {}",
            r.name,
            r.end_s() - first_s,
            if still.is_empty() {
                " before its first load"
            } else {
                ""
            },
            if used[i] {
                "used as the measurement of the noise"
            } else {
                "not used: it measured nothing that these equations are fitted to"
            }
        ));
    }
    if options.cross_validate && moving.len() > 1 {
        result.cross_validation = cross_validate(&moving, &result, &fit, &make, &coefficients)?;
    }
    let undetermined: Vec<Coefficient> = coefficients
        .iter()
        .copied()
        .filter(|c| result.parameters.get(c.key()).is_some_and(|p| !p.excited))
        .collect();
    let floats = rig.vehicle.stiffness[0] != 0.0;
    let is_restored = |d: &Dof| match d {
        Dof::Roll | Dof::Pitch => true,
        Dof::Heave => floats,
        _ => false,
    };
    let restored: Vec<Dof> = dofs.iter().copied().filter(is_restored).collect();
    result.blind_spots = blind_spots(&moving, &dofs, &resting, &undetermined, &restored);
    result.held_effects = rig.physics.iter().map(|p| p.effect.clone()).collect();
    Ok(result)
}

/// Names of the measured channels of a run, for messages.
pub fn measured_channels(run: &Run) -> Vec<&'static str> {
    let measured = Channel::ALL.into_iter().filter(|c| run.has(*c));
    measured.map(Channel::name).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use hydroline_core::run::{Command, PerChannel, Sample};
    use rand::{SeedableRng, rngs::StdRng};
    use rand_distr::{Distribution, Normal};

    /// Surge at 25 Hz for 24 s under reversals; from half of it on stamps are `gap_s` later, as of a clock that was set.
    fn reversals(rig: &Rig, gap_s: f64) -> Run {
        let loads_n = [8.0, -8.0, 6.0, -6.0, 8.0, 0.0];
        let commands = loads_n.iter().enumerate().map(|(k, load_n)| Command {
            t_s: 0.002 + 4.0 * k as f64,
            wrench: [*load_n, 0.0, 0.0, 0.0, 0.0, 0.0],
        });
        let sample = |k: usize| Sample {
            t_s: 0.04 * k as f64,
            values: PerChannel::from_fn(|c| if c == Channel::X { 0.0 } else { f64::NAN }),
            covariance: None,
        };
        let mut run = Run {
            name: "run".to_owned(),
            commands: commands.collect(),
            samples: (0..600).map(sample).collect(),
            ..Run::default()
        };
        let one = std::slice::from_ref(&run);
        let truth = Axis::new(one, &rig.vehicle, Dof::Surge, &[], Start::AtRestFromZero);
        let mut moved = Vec::new();
        truth.values(0, &[], &mut moved).unwrap();
        let noise = Normal::new(0.0, 1.5e-4).unwrap();
        let mut rng = StdRng::seed_from_u64(7);
        for (sample, x_m) in run.samples.iter_mut().zip(moved) {
            sample.values[Channel::X] = x_m + noise.sample(&mut rng);
        }
        let set = |t_s: &mut f64| *t_s += if *t_s > 12.01 { gap_s } else { 0.0 };
        run.samples.iter_mut().for_each(|s| set(&mut s.t_s));
        run.commands.iter_mut().for_each(|c| set(&mut c.t_s));
        run
    }

    /// The gap was integrated in steps of 40 ms: a year of it took tens of gigabytes, until the kernel ended the program.
    #[test]
    fn a_gap_of_a_century_makes_two_runs_and_costs_neither_time_nor_memory() {
        let rig = Rig::builtin("lshpi").unwrap();
        let fit = |gap_s: f64| {
            let options = Options {
                cross_validate: false,
                ..Options::default()
            };
            identify(&[reversals(&rig, gap_s)], &rig, &options).unwrap()
        };
        let key = Coefficient::of(Dof::Surge)[2].key();
        let whole = fit(0.0).parameters[key].clone();
        for gap_s in [1000.7, 3.2e9] {
            let found = fit(gap_s);
            let (own, sd) = (&found.parameters[key], whole.sd.unwrap());
            assert_eq!(found.runs.len(), 2, "{gap_s}");
            assert!(
                (own.value - whole.value).abs() < 4.0 * sd,
                "{own:?} {whole:?}"
            );
            let notes = &found.runs[0].notes;
            assert!(notes[0].contains("taken as 2 run(s)"), "{notes:?}");
        }
    }

    /// They drew the first fit away, what it left passed for noise of 70 mm, and by that nothing was determined: the rig's own
    /// numbers were given for the vehicle's.
    #[test]
    fn spikes_in_two_of_a_hundred_samples_leave_every_coefficient_determined() {
        let rig = Rig::builtin("lshpi").unwrap();
        let fit = |spike_m: f64| {
            let mut run = reversals(&rig, 0.0);
            let spiked = (0..600).filter(|k| k % 53 == 17);
            spiked.for_each(|k| run.samples[k].values[Channel::X] += spike_m);
            let options = Options {
                cross_validate: false,
                ..Options::default()
            };
            identify(&[run], &rig, &options).unwrap()
        };
        let clean = fit(0.0);
        for spike_m in [0.5, -0.03, 40.0] {
            let found = fit(spike_m);
            for c in Coefficient::of(Dof::Surge) {
                let (own, whole) = (&found.parameters[c.key()], &clean.parameters[c.key()]);
                assert!(own.excited, "{spike_m}: {own:?}");
                assert!(
                    (own.value - whole.value).abs() < whole.sd.unwrap(),
                    "{spike_m}: {own:?} {whole:?}"
                );
            }
            let noise = &found.noise["x_m"];
            assert!(noise.noise.white_sd < 2e-4, "{spike_m}: {noise:?}");
            assert!(
                (noise.outliers - 11.0 / 600.0).abs() < 5e-3,
                "{spike_m}: {noise:?}"
            );
        }
    }

    #[test]
    fn samples_that_are_all_far_apart_are_refused_with_the_reason() {
        let rig = Rig::builtin("lshpi").unwrap();
        for apart_s in [15.0, 50.0, 86_400.0] {
            let mut run = reversals(&rig, 0.0);
            let samples = run.samples.iter_mut();
            samples.for_each(|s| s.t_s *= apart_s / 0.04);
            let error = identify(&[run], &rig, &Options::default()).unwrap_err();
            assert!(matches!(error, IdentifyError::TooSparse { .. }), "{error}");
            assert!(error.to_string().contains("less than 14 s"), "{error}");
        }
    }
}
