//! What no file states: the scale of the positions, what all poses of a run share, effects that the runs cannot show.

use std::collections::BTreeMap;

use hydroline_core::run::{Channel, PerChannel};
use hydroline_inference::body::Body;
use hydroline_inference::fit::Problem;
use hydroline_inference::prior::PriorTable;
use hydroline_numerics::parallel;

use super::sources::{Consider, Moved, Sources, minus};
use crate::fitted::Fitted;

/// sd of the length scale of positions: a board measured with a steel rule.
const POSITION_SCALE_SD: f64 = 0.002;
/// What all poses of a run share: of the calibration, of the camera's response, of where the target lies \[m\].
const SHARED_M: f64 = 1e-4;
/// The same of angles: 0.05 deg \[rad\].
const SHARED_RAD: f64 = 8.7e-4;
/// Effects that stand in the budget by another name.
const ELSEWHERE: [&str; 2] = ["thrust_scale", "position_scale"];
/// Effects that a measured thrust curve holds.
const IN_CURVE: [&str; 3] = [
    "thruster_deadband",
    "thrust_asymmetry",
    "thruster_saturation",
];

impl Sources<'_> {
    /// Scale of the positions, and what all poses of a run share.
    pub fn of_the_poses(&self) -> Vec<Consider> {
        let base = self.base();
        let measured = |c: Channel| self.fitted.problem.noises.channels[c].is_some();
        let consider = |source: &str, sd: f64, unit, reduce: &str, moved: Moved| Consider {
            source: source.to_owned(),
            sd: Some(sd),
            unit,
            basis: "assumed".to_owned(),
            reduce: reduce.to_owned(),
            moved,
            prior_ln_odds: None,
        };
        let mut all = Vec::new();
        let lengths = [Channel::X, Channel::Y, Channel::Z];
        if lengths.into_iter().any(measured) {
            let of = |v: &PerChannel<f64>| {
                PerChannel::from_fn(|c| match lengths.contains(&c) {
                    true => POSITION_SCALE_SD * v[c],
                    false => 0.0,
                })
            };
            let moved = base
                .iter()
                .map(|run| run.iter().map(of).collect())
                .collect();
            all.push(consider(
                "length scale of the positions",
                POSITION_SCALE_SD,
                "1",
                "moving the vehicle by a known distance",
                moved,
            ));
        }
        for run in 0..base.len() {
            for c in Channel::POSES.into_iter().filter(|c| measured(*c)) {
                let (sd, unit) = match c.is_angular() {
                    true => (SHARED_RAD, "rad"),
                    false => (SHARED_M, "m"),
                };
                let one = PerChannel::from_fn(|other| if other == c { sd } else { 0.0 });
                let of = |r: usize, v: &Vec<PerChannel<f64>>| match r == run {
                    true => vec![one; v.len()],
                    false => vec![PerChannel::splat(0.0); v.len()],
                };
                let moved = base.iter().enumerate().map(|(r, v)| of(r, v)).collect();
                let source = match c.is_angular() {
                    true => "angles that all poses of a run share",
                    false => "offset that all poses of a run share",
                };
                all.push(consider(
                    source,
                    sd,
                    unit,
                    "a calibration with less left over",
                    moved,
                ));
            }
        }
        all
    }

    /// Effects that these runs would not show at their typical size, each with the probability that it is there; in each DOF where one may act it is another one, of whose forms there
    /// the one counts that moves the vehicle by most tolerances.
    pub fn unseen(&self) -> Vec<Consider> {
        let Fitted { problem, fit, .. } = self.fitted;
        let body = &problem.body;
        let asked = Body::new(
            body.recording.clone(),
            self.rig,
            &body.dofs,
            &[],
            PriorTable::default(),
        );
        let Ok(asked) = asked else {
            return Vec::new();
        };
        let with = Problem {
            body: Body {
                candidates: asked.candidates,
                ..body.clone()
            },
            noises: problem.noises.clone(),
            worth: problem.worth.clone(),
        };
        let base = self.base();
        let unseen: Vec<usize> = with
            .unseen(fit)
            .into_iter()
            .filter(|c| {
                let id = with.body.candidates[*c].info.id;
                let in_curve = self.has_measured_curve && IN_CURVE.contains(&id);
                !in_curve && !ELSEWHERE.contains(&id)
            })
            .collect();
        let made = parallel::map_slice(&unseen, |c| {
            let candidate = &with.body.candidates[*c];
            let numbers = candidate.starts.first()?;
            let (terms, point) = with.with(fit, *c, numbers);
            let moved = minus(&with.predicted(&terms, &point), &base, 1.0);
            let finite = moved.iter().flatten().flatten().all(|v| v.is_finite());
            let ln_odds = with.ln_prior(&[*c]);
            finite.then(|| ((candidate.info.id, candidate.place()), (moved, ln_odds)))
        });
        let tolerance = &body.tolerance;
        let tolerances = |v: &PerChannel<f64>| -> f64 {
            let each = v.each().map(|(c, v)| (v / tolerance[c]).powi(2));
            each.filter(|v| v.is_finite()).sum()
        };
        let mut largest: BTreeMap<(&str, Option<&str>), (f64, Moved, f64)> = BTreeMap::new();
        for (place, (moved, ln_odds)) in made.into_iter().flatten() {
            let size: f64 = moved.iter().flatten().map(tolerances).sum();
            if largest.get(&place).is_none_or(|(most, ..)| size > *most) {
                largest.insert(place, (size, moved, ln_odds));
            }
        }
        let each = largest.into_iter();
        each.map(|((id, _), (_, moved, ln_odds))| Consider {
            source: id.to_owned(),
            sd: None,
            unit: "typical size",
            basis: "not identifiable with these runs".to_owned(),
            reduce: "a run that shows it (hydroline diagnose names the plan)".to_owned(),
            moved,
            prior_ln_odds: Some(ln_odds),
        })
        .collect()
    }
}
