//! Traces that the report draws: a channel of every DOF that moves, measured and by both models.

use hydroline_core::run::{Channel, PerChannel};
use hydroline_identify::figures::edges;
use hydroline_inference::fit::Problem;

use super::found::{Judged, Predicted};
use crate::report::{Runs, Shown, Trace};

/// Predictions, per run and sample.
type Motion = Vec<Vec<PerChannel<f64>>>;

/// Motion without and with the effects.
type Both<'a> = (&'a Motion, &'a Motion);

impl Predicted {
    fn values(&self) -> Both<'_> {
        (&self.before.values, &self.after.values)
    }
}

impl Judged<'_> {
    /// One per DOF: its position where that is measured, else its rate.
    pub fn shown(&self) -> Vec<Shown> {
        let problem = &self.found.problem;
        let before = problem.predicted(&self.alone.terms, &self.alone.point);
        let after = problem.predicted(&self.best.terms, &self.best.point);
        let noise = self.noise();
        let channels = problem.body.dofs.iter().filter_map(|d| {
            let measured = |c: &Channel| problem.noises.channels[*c].is_some();
            Channel::of(*d).into_iter().find(measured)
        });
        channels
            .map(|c| Shown {
                channel: c.name().to_owned(),
                noise_sd: noise[c],
                predicted: match (&self.held, &self.one_run_out) {
                    (Some((over, f)), _) => Runs::HeldOut(traces(over, c, f.values())),
                    (None, Some(f)) => Runs::ByTheOthers(traces(problem, c, f.values())),
                    (None, None) => Runs::None,
                },
                fitted: traces(problem, c, (&before, &after)),
            })
            .collect()
    }
}

/// Along and across are the body's axes, as noise and random forces are described.
fn traces(problem: &Problem, channel: Channel, (before, after): Both<'_>) -> Vec<Trace> {
    let runs = problem.body.recording.runs.iter().zip(&problem.noises.used);
    runs.zip(before.iter().zip(after))
        .map(|((r, used), (before, after))| {
            let of = |motion: &[PerChannel<f64>]| motion.iter().map(|v| v[channel]).collect();
            Trace {
                name: r.name.clone(),
                times_s: r.times_s.clone(),
                edges: edges(r.commands.iter().copied(), channel.dof().index()),
                measured: (0..r.times_s.len())
                    .map(|k| r.measured(k)[channel])
                    .collect(),
                before: of(before),
                after: of(after),
                used: used.iter().map(|u| u[channel]).collect(),
            }
        })
        .collect()
}
