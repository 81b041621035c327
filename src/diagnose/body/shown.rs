//! What the report draws: a channel of every DOF that moves, measured and by both models.

use hydroline_identify::data::CHANNELS;
use hydroline_identify::figures::edges;
use hydroline_inference::fit::Problem;

use super::found::Judged;
use crate::report::{Shown, Trace};

/// Predictions, per run and sample.
type Motion = Vec<Vec<[f64; 12]>>;

impl Judged<'_> {
    /// One per DOF: its position where that is measured, else its rate.
    pub fn shown(&self) -> Vec<Shown> {
        let problem = &self.found.problem;
        let before = problem.predicted(&self.alone.terms, &self.alone.point);
        let after = problem.predicted(&self.best.terms, &self.best.point);
        let noise = self.noise();
        let channels = problem.body.dofs.iter().filter_map(|d| {
            let measured = |c: &usize| problem.noises.channels[*c].is_some();
            [*d, 6 + d].into_iter().find(measured)
        });
        channels
            .map(|c| Shown {
                channel: CHANNELS[c].to_owned(),
                noise_sd: noise[c],
                predicted: match (&self.held, &self.one_run_out) {
                    (Some((over, f)), _) => traces(over, c, &f.before.values, &f.after.values),
                    (None, Some(f)) => traces(problem, c, &f.before.values, &f.after.values),
                    (None, None) => Vec::new(),
                },
                fitted: traces(problem, c, &before, &after),
            })
            .collect()
    }
}

/// Along and across are the body's axes, as noise and random forces are described.
fn traces(problem: &Problem, channel: usize, before: &Motion, after: &Motion) -> Vec<Trace> {
    let runs = problem.body.recording.runs.iter().zip(&problem.noises.used);
    runs.zip(before.iter().zip(after))
        .map(|((r, used), (before, after))| {
            let of = |motion: &[[f64; 12]]| motion.iter().map(|v| v[channel]).collect();
            Trace {
                name: r.name.clone(),
                times_s: r.times_s.clone(),
                edges: edges(r.commands.iter().copied(), channel % 6),
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
