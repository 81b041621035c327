//! Choice of the equations that these runs call for, and of the coefficients that are free.

use hydroline_core::run::{Channel, Run};
use hydroline_identify::model_test::driven;
use hydroline_identify::parameter::Coefficient;
use hydroline_inference::body::Body;
use hydroline_inference::prior::PriorTable;
use hydroline_inference::recording::Recording;
use hydroline_numerics::statistics::extent;
use hydroline_rigs::{Dof, Rig, VehicleModel};
use hydroline_sim::effect::EffectError;

use super::options::{ModelChoice, Options};

/// Scale of a coefficient of which the rig says 0, over what stands for it ([`PriorTable::unsaid`]): the rig knows nothing of it, and the
/// truth lies anywhere in Table 9's range for a vehicle of this mass, ten times as far.
const UNSAID: f64 = 10.0;
/// Probability that the rig's equations miss nothing of a DOF ([`PriorTable::exact`]): as likely as not. Without it every fit had some
/// random force, below what shows, and intervals of runs in which nothing is left out were half as wide again as their errors.
const EXACT: f64 = 0.5;
/// Fewest samples that say how far a DOF moved.
const MOVED_MIN: usize = 9;

/// Equations and coefficients of a fit.
pub(crate) struct Asked {
    /// `surge` .. `yaw`, `eq1` or `decoupled`.
    pub name: String,
    /// DOFs whose coefficients are listed.
    pub dofs: Vec<Dof>,
    /// DOFs that are simulated: those that move.
    pub moving: Vec<usize>,
    /// Coefficients that are listed: all but those that are fixed.
    pub coefficients: Vec<Coefficient>,
    /// Coefficients that are fixed, of the DOFs that are simulated.
    pub fixed: Vec<Coefficient>,
}

impl Asked {
    pub fn of(runs: &[Run], rig: &Rig, recording: &Recording, options: &Options<'_>) -> Asked {
        let choice = match options.model {
            ModelChoice::Auto => choose(runs, rig),
            given => given,
        };
        let (dofs, mut moving): (Vec<Dof>, Vec<usize>) = match choice {
            ModelChoice::Axis(dof) => (vec![dof], vec![dof.index()]),
            _ => {
                let measured = Dof::ALL
                    .into_iter()
                    .filter(|d| recording.measures(d.index()));
                (
                    measured.collect(),
                    recording.moving(&rig.tolerance.channels()),
                )
            }
        };
        if moving.is_empty() {
            moving.push(moves_most(runs, rig).index());
        }
        let name = match choice {
            ModelChoice::Axis(dof) => dof.name().to_owned(),
            _ if rig.vehicle.model == VehicleModel::Eq1 => "eq1".to_owned(),
            _ => "decoupled".to_owned(),
        };
        let all = dofs.iter().flat_map(|d| Coefficient::of(*d));
        Asked {
            name,
            fixed: options
                .fixed
                .iter()
                .copied()
                .filter(|c| moving.contains(&c.dof.index()))
                .collect(),
            moving,
            coefficients: all.filter(|c| !options.fixed.contains(c)).collect(),
            dofs,
        }
    }

    /// DOFs of coefficients that are listed which nothing moves.
    pub fn resting(&self) -> Vec<Dof> {
        let rests = |d: &Dof| !self.moving.contains(&d.index());
        self.dofs.iter().copied().filter(rests).collect()
    }

    /// The vehicle with these coefficients free; all else is as the rig says.
    ///
    /// # Errors
    /// [`EffectError`] for a bad `[[physics]]` entry.
    pub fn body(
        &self,
        recording: Recording,
        rig: &Rig,
        options: &Options<'_>,
    ) -> Result<Body, EffectError> {
        let mut body = Body::plain(recording, rig, &self.moving)?;
        let is_free = |c: Coefficient| self.coefficients.contains(&c);
        body.own
            .retain(|o| o.coefficient().is_some_and(is_free) || o.is_clock());
        if options.from_rest {
            for starts in &mut body.starts {
                starts.retain(|c| !c.is_rate());
            }
        }
        body.prior = PriorTable {
            unsaid: UNSAID,
            exact: EXACT,
            ..PriorTable::default()
        };
        if options.flat_priors {
            body.prior = body.prior.flat();
        }
        Ok(body)
    }
}

/// One DOF if only one is driven; without commands the one that moves most for its noise.
fn choose(runs: &[Run], rig: &Rig) -> ModelChoice {
    let driven = driven(runs.iter().map(Run::largest_wrench));
    let driven: Vec<Dof> = Dof::ALL.into_iter().filter(|d| driven[d.index()]).collect();
    match driven.as_slice() {
        [one] => ModelChoice::Axis(*one),
        [] => ModelChoice::Axis(moves_most(runs, rig)),
        _ => ModelChoice::Coupled,
    }
}

/// The DOF that moves by most tolerances.
fn moves_most(runs: &[Run], rig: &Rig) -> Dof {
    let moved = |dof: &Dof| -> f64 {
        let i = dof.index();
        let of = |r: &Run| {
            let measured = r.measured(measured_by(r, i));
            let (low, high) = extent(measured.clone());
            match measured.count() >= MOVED_MIN {
                true => (high - low) / rig.tolerance.channels()[Channel::POSES[i]],
                false => 0.0,
            }
        };
        runs.iter().map(of).fold(0.0, f64::max)
    };
    let best = Dof::ALL
        .into_iter()
        .max_by(|a, b| moved(a).total_cmp(&moved(b)));
    best.unwrap_or(Dof::Surge)
}

/// The channel that shows how a DOF moved: its position or angle, else its rate (over a second).
fn measured_by(run: &Run, dof: usize) -> Channel {
    let [place, rate] = Channel::of(dof);
    if run.has(place) { place } else { rate }
}
