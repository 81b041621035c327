//! Runs fitted with the noise of a fit before, and with the coefficients free that it determined: for searches that ask what many
//! other loads would have made of the same runs.
//!
//! [`crate::identify`] finds more than coefficients (the noise and its colour, outliers, a random force, intervals by profile). That
//! costs many fits; it is the same for all of these.

use std::collections::BTreeMap;

use hydroline_core::run::{Channel, PerChannel, Run};
use hydroline_identify::Identification;
use hydroline_identify::data::{is_still, stretched};
use hydroline_identify::parameter::Coefficient;
use hydroline_inference::body::Body;
use hydroline_inference::fit::{Effort, Problem};
use hydroline_inference::hyper::{Cell, Cells};
use hydroline_inference::prior::PriorTable;
use hydroline_inference::recording::Recording;
use hydroline_rigs::{Dof, Rig};

use super::fitted::Fitted;
use super::numbers::Numbers;
use super::options::EstimateError;

/// To a tenth of an sd, under the noise alone.
const BY_NOISE: Effort = Effort {
    decrement: 5e-3,
    forces_held: true,
    rounds: 1,
    steps: 40,
    ..Effort::DEFAULT
};

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

/// Fits runs under a rig, from the coefficients that it has; free are those that `before`, a fit of these or of other runs of the
/// vehicle, determined. With `from_rest` every run starts at rest.
///
/// # Errors
/// [`EstimateError`]: effects of the rig, a motion that diverges at the start, runs that all rest.
pub fn refit(
    runs: &[Run],
    rig: &Rig,
    before: &Identification,
    from_rest: bool,
) -> Result<Refitted, EstimateError> {
    let runs = stretched(runs, rig)?;
    let tolerance = [rig.tolerance.position_m, rig.tolerance.attitude_rad];
    let count = runs.len();
    let moving: Vec<Run> = runs
        .into_iter()
        .filter(|r| !is_still(r, tolerance))
        .collect();
    if moving.is_empty() {
        return Err(EstimateError::OnlyStill(count));
    }
    let free: Vec<Coefficient> = before
        .parameters
        .iter()
        .filter(|(_, p)| p.excited)
        .filter_map(|(key, _)| Coefficient::find(key))
        .collect();
    let recording = Recording::new(&moving, rig.tank.start_pose[5]);
    let dofs = match Dof::ALL.iter().find(|d| d.name() == before.model) {
        Some(dof) => vec![dof.index()],
        None => recording.moving(&rig.tolerance.channels()),
    };
    let mut body = Body::plain(recording, rig, &dofs)?;
    let is_free = |c: Coefficient| free.contains(&c);
    body.own
        .retain(|o| o.coefficient().is_some_and(is_free) || o.is_clock());
    body.prior = PriorTable::default().flat();
    if from_rest {
        for starts in &mut body.starts {
            starts.retain(|c| !c.is_rate());
        }
    }
    // A channel that the fit before did not have has no noise to go by: it does not count, and starts that only it shows are as they look.
    let known = |c: Channel| before.noise.get(c.name()).map(|n| n.noise);
    for starts in &mut body.starts {
        starts.retain(|c| {
            Channel::of(c.dof().index())
                .into_iter()
                .any(|c| known(c).is_some())
        });
    }
    let noises = PerChannel::from_fn(|c| known(c).filter(|_| dofs.contains(&c.dof().index())));
    let problem = Problem::under(body, noises);
    let diverged = || EstimateError::NoFit(before.model.clone());
    let cells = Cells::of([Cell::default(); 6]);
    let begin = problem.body.begin();
    let fit = problem
        .fit(&[], &begin, cells, BY_NOISE)
        .ok_or_else(diverged)?;
    let fitted = Fitted {
        problem,
        fit,
        held: Vec::new(),
        fits: 1,
    };
    let numbers = Numbers::at_mode(&fitted, rig).ok_or_else(diverged)?;
    let predicted = fitted.problem.predicted(&[], &fitted.fit.point);
    let left = fitted.problem.left_by_run(&predicted);
    // Clocks stand behind the coefficients.
    let own = fitted.problem.body.own.iter().filter(|o| !o.is_clock());
    let order: Vec<String> = own.map(|o| o.name().to_owned()).collect();
    let n = order.len();
    Ok(Refitted {
        values: order.iter().cloned().zip(numbers.values).collect(),
        order,
        covariance: (0..n)
            .map(|i| (0..n).map(|j| numbers.covariance[(i, j)]).collect())
            .collect(),
        runs: moving
            .iter()
            .zip(left)
            .map(|(r, rms)| (r.name.clone(), r.samples.len(), rms.by_name()))
            .collect(),
    })
}
