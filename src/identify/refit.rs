//! Runs fitted with the noise of a fit before, and with the coefficients free that it determined: for searches that ask what many
//! other loads would have made of the same runs.
//!
//! [`crate::identify`] finds more than coefficients (the noise and its colour, outliers, intervals by profile). That
//! costs many fits; it is the same for all of these.

use super::coupled::{Coupled, every_pose_is_known};
use super::data::{Start, is_still};
use super::estimate::{IdentifyError, stretched};
use super::forward::Forward;
use super::lm::descend;
use super::outcome::Identification;
use super::parameter::Coefficient;
use super::problem::Problem;
use super::uncertainty::covariance;
use hydroline_core::run::Run;
use hydroline_numerics::noise::Noise;
use hydroline_rigs::Rig;
use std::collections::BTreeMap;

/// A step that brings less than this of half the sum of squares is the last: a hundredth of what one standard deviation costs.
pub(crate) const ENOUGH: f64 = 0.005;

/// Result of a refit of the runs under a rig.
#[derive(Debug, Clone, PartialEq)]
pub struct Refitted {
    /// Values by key, SI; of those that were free.
    pub values: BTreeMap<String, f64>,
    /// Order of the covariance.
    pub order: Vec<String>,
    /// Covariance under the noise of the fit before, SI.
    pub covariance: Vec<Vec<f64>>,
    /// Run by run: name, samples, rms of measured minus fitted per channel, SI.
    pub runs: Vec<(String, usize, BTreeMap<String, f64>)>,
}

/// Fits runs of all DOFs under a rig, from the coefficients that it has; free are those that `before`, a fit of these or of
/// other runs of the vehicle, determined.
///
/// # Errors
/// [`IdentifyError`]: effects of the rig, a motion that diverges at the start, runs that all rest.
pub fn refit(runs: &[Run], rig: &Rig, before: &Identification) -> Result<Refitted, IdentifyError> {
    let runs = stretched(runs, rig)?;
    let tolerance = [rig.tolerance.position_m, rig.tolerance.attitude_rad];
    let count = runs.len();
    let (still, moving): (Vec<Run>, Vec<Run>) =
        runs.into_iter().partition(|r| is_still(r, tolerance));
    if moving.is_empty() {
        return Err(IdentifyError::OnlyStill(count));
    }
    let free: Vec<Coefficient> = before
        .parameters
        .iter()
        .filter(|(_, p)| p.excited)
        .filter_map(|(key, _)| Coefficient::find(key))
        .collect();
    let whitened = moving.iter().chain(&still).all(every_pose_is_known);
    let forward = Coupled::new(&moving, rig, &free, Start::Free, whitened)?;
    let known: Vec<Option<Noise>> = forward
        .slots()
        .iter()
        .map(|slot| before.noise.get(slot).map(|n| n.noise))
        .collect();
    let noises: Vec<Noise> = known
        .iter()
        .map(|n| n.unwrap_or(Noise::white(1.0)))
        .collect();
    let mut problem = Problem::new(&forward, &vec![1.0; noises.len()]);
    // A channel that the fit before did not have has no noise to go by: it does not count.
    problem.set_noise(&noises, |_, slot, _| known[slot].is_some());
    let held = vec![false; problem.free().len()];
    let (found, normal) = descend(&problem, problem.start(), &held, ENOUGH)?;
    let all = covariance(&normal.hessian);
    let n = free.len();
    let mut fitted = Vec::with_capacity(moving.len());
    for (k, run) in moving.iter().enumerate() {
        let channels = forward.channels(k, &problem.of_run(k, &found.parameters))?;
        let rms = channels
            .iter()
            .filter(|c| c.measured.iter().any(|v| v.is_finite()))
            .map(|c| (c.name.clone(), c.rms()))
            .collect();
        fitted.push((run.name.clone(), run.samples.len(), rms));
    }
    Ok(Refitted {
        values: (free.iter().zip(&found.parameters))
            .map(|(c, v)| (c.key().to_owned(), *v))
            .collect(),
        order: free.iter().map(|c| c.key().to_owned()).collect(),
        covariance: (0..n)
            .map(|i| (0..n).map(|j| all[(i, j)]).collect())
            .collect(),
        runs: fitted,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::lm::LevenbergMarquardt;
    use crate::{ModelChoice, Options, identify};
    use hydroline_core::run::{Channel, Command, PerChannel, Sample};
    use hydroline_rigs::Dof;
    use rand::{SeedableRng, rngs::StdRng};
    use rand_distr::{Distribution, Normal};

    /// A surge run at 10 Hz under steps of load, noise of 0.3 mm.
    fn run(rig: &Rig, gain: f64) -> Run {
        let loads_n = [6.0, -4.0, 8.0, 0.0, 3.0];
        let commands = loads_n.iter().enumerate().map(|(k, load_n)| Command {
            t_s: 1.0 + 6.0 * k as f64,
            wrench: [gain * load_n, 0.0, 0.0, 0.0, 0.0, 0.0],
        });
        let sample = |k: usize| Sample {
            t_s: 0.1 * k as f64,
            values: PerChannel::from_fn(|c| if c == Channel::X { 0.0 } else { f64::NAN }),
            covariance: None,
        };
        let mut run = Run {
            name: "steps".to_owned(),
            commands: commands.collect(),
            samples: (0..310).map(sample).collect(),
            ..Run::default()
        };
        let forward = Coupled::new(
            std::slice::from_ref(&run),
            rig,
            &[],
            Start::AtRestFromZero,
            false,
        )
        .unwrap();
        let mut truth = Vec::new();
        let start = vec![0.0; forward.locals(0).len()];
        forward.values(0, &start, &mut truth).unwrap();
        let noise = Normal::new(0.0, 3e-4).unwrap();
        let mut rng = StdRng::seed_from_u64(4);
        for (sample, x_m) in run.samples.iter_mut().zip(truth) {
            sample.values[Channel::X] = x_m + noise.sample(&mut rng);
        }
        run
    }

    #[test]
    fn the_same_rig_gives_what_the_fit_before_gave_and_other_loads_what_they_would() {
        let rig = Rig::builtin("lshpi").unwrap();
        let measured = [run(&rig, 1.0)];
        let options = Options {
            model: ModelChoice::Coupled,
            method: &LevenbergMarquardt { starts: 1 },
            cross_validate: false,
            ..Options::default()
        };
        let before = identify(&measured, &rig, &options).unwrap();
        let again = refit(&measured, &rig, &before).unwrap();
        let keys = Coefficient::of(Dof::Surge).map(|c| c.key().to_owned());
        assert_eq!(again.order.len(), 3);
        for (k, key) in again.order.iter().enumerate() {
            assert!(keys.contains(key));
            let sd = again.covariance[k][k].sqrt();
            let was = &before.parameters[key];
            assert!((again.values[key] - was.value).abs() < 0.3 * sd, "{key}");
            let ratio = sd / was.sd.unwrap();
            assert!((0.5..2.0).contains(&ratio), "{key}: {ratio}");
        }
        // Half the load for the same motion: half the inertia, half the damping (Eq. 1 of surge is linear in them).
        let mut halved = measured.clone();
        for command in &mut halved[0].commands {
            command.wrench[0] *= 0.5;
        }
        let half = refit(&halved, &rig, &before).unwrap();
        let m = rig.vehicle.mass_kg;
        let [added, linear, _] = Coefficient::of(Dof::Surge);
        let inertia = |of: &Refitted| m - of.values[added.key()];
        assert!((inertia(&half) / inertia(&again) - 0.5).abs() < 0.01);
        let ratio = half.values[linear.key()] / again.values[linear.key()];
        assert!((ratio - 0.5).abs() < 0.01, "{ratio}");
        assert!(half.runs[0].2["x_m"] < 4e-4);
    }
}
