//! Expected information of a run by a plan, before the run is made.
//!
//! Response of the motion to every number asked, whitened by the noise to expect; their inner products are the Fisher
//! information of the run (Pukelsheim 2006, ch. 3), which adds up over runs. Where the run begins is fitted with it and
//! taken out. Effects are asked by their finite response at a typical size: thresholds and delays have no derivative at
//! nothing.

use hydroline_core::run::Channel::{X, Y};
use hydroline_core::run::{Command, PerChannel, Run, Sample};
use hydroline_numerics::cholesky::{PROJECTION_JITTER, ScaledCholesky};
use hydroline_numerics::noise::Noise;
use hydroline_rigs::Rig;
use hydroline_sim::effect::EffectError;
use nalgebra::DMatrix;

use super::body::Body;
use super::filter::Force;
use super::fit::{Fit, Problem};
use super::hyper::{Cell, Cells, Noises, Worth, with_force};
use super::prior::PriorTable;
use super::recording::Recording;

/// An effect at a typical size.
#[derive(Debug, Clone, PartialEq)]
pub struct Typical {
    /// Its place among the candidates.
    pub candidate: usize,
    /// Natural numbers.
    pub numbers: Vec<f64>,
}

impl Problem {
    /// A rig's body with all that may have been left out of it, before anything is measured: sizes of effects are those for a
    /// vehicle that moves as it does under these commands from the rig's start at rest.
    ///
    /// `noise` = that of the instruments to expect, per channel.
    ///
    /// # Errors
    /// [`EffectError`] for a bad `[[physics]]` entry of the rig.
    pub fn of_rig(
        rig: &Rig,
        dofs: &[usize],
        commands: &[Command],
        times_s: &[f64],
        noise: PerChannel<Option<Noise>>,
    ) -> Result<Problem, EffectError> {
        let pose = rig.tank.start_pose;
        let rest = PerChannel::of_state(pose, [f64::NAN; 6]);
        let mut run = Run {
            name: "planned".to_owned(),
            commands: commands.to_vec(),
            samples: times_s
                .iter()
                .map(|t_s| Sample {
                    t_s: *t_s,
                    values: rest,
                    covariance: None,
                })
                .collect(),
            ..Run::default()
        };
        let recording = Recording::new(std::slice::from_ref(&run), pose[5]);
        let still = Body::plain(recording, rig, dofs)?;
        // Rotated as measured values are; back along the tank's axes.
        let moved = still.values(0, &[], &still.begin());
        let (sin, cos) = still.recording.runs[0].heading[0];
        for (sample, v) in run.samples.iter_mut().zip(moved) {
            sample.values = PerChannel::of_state(v.pose(), sample.values.rates());
            sample.values[X] = cos * v[X] - sin * v[Y];
            sample.values[Y] = sin * v[X] + cos * v[Y];
        }
        let recording = Recording::new(&[run], pose[5]);
        let body = Body::new(recording, rig, dofs, &[], PriorTable::default())?;
        let used = vec![PerChannel::splat(true); times_s.len()];
        Ok(Problem {
            worth: Worth::none(),
            noises: Noises {
                channels: noise,
                floor_sd: PerChannel::splat(0.0),
                has_force: true,
                at_rest: PerChannel::splat(None),
                used: vec![used],
            },
            body,
        })
    }

    /// Information about the vehicle's own numbers (scaled: logarithms of their ratios to the rig's, where it says them) and, behind them, the
    /// amplitudes of these effects in units of their typical size, from the run of a [`Problem::planned`]. `None` where the
    /// motion is not finite.
    pub fn expected(&self, effects: &[Typical]) -> Option<DMatrix<f64>> {
        let body = &self.body;
        let at = body.begin();
        let own = body.own.len();
        let here = body.simulated(0, &[], &at);
        let finite = |values: &[PerChannel<f64>]| values.iter().flatten().all(|v| v.is_finite());
        if !finite(&here.values) {
            return None;
        }
        let fit = Fit::begin(at, Cells::of([Cell::default(); 6]));
        let mut responses = Vec::with_capacity(effects.len());
        for e in effects {
            let (terms, point) = self.with(&fit, e.candidate, &e.numbers);
            let mut there = body.values(0, &terms, &point);
            if !finite(&there) {
                // At this size it is no model of this vehicle: nothing is said of it.
                there.clone_from(&here.values);
            }
            for (a, b) in there.iter_mut().zip(&here.values) {
                for (a, b) in a.iter_mut().zip(b) {
                    *a -= b;
                }
            }
            responses.push(there);
        }
        // Own numbers, effects, starts.
        let place = |i: usize| if i < own { i } else { i + effects.len() };
        let asked = own + effects.len();
        let all = asked + body.starts[0].len();
        let columns: Vec<(usize, &[PerChannel<f64>])> = here
            .columns
            .iter()
            .map(|(i, c)| (place(*i), c.as_slice()))
            .chain(
                responses
                    .iter()
                    .enumerate()
                    .map(|(k, c)| (own + k, c.as_slice())),
            )
            .collect();
        let mut information = DMatrix::zeros(all, all);
        for &d in &body.dofs {
            let filters = with_force(body, &self.noises, d, Force::NONE);
            let white: Vec<(usize, Vec<f64>)> = columns
                .iter()
                .filter_map(|(i, c)| {
                    let series = self.white_column(d, c, filters.first()?)?;
                    Some((*i, series.into_iter().flatten().collect()))
                })
                .collect();
            let Some(rows) = white.first().map(|w| w.1.len()) else {
                continue;
            };
            let data = white.iter().flat_map(|w| w.1.iter().copied());
            let matrix = DMatrix::from_iterator(rows, white.len(), data);
            let square = matrix.transpose() * &matrix;
            for (a, (i, _)) in white.iter().enumerate() {
                for (b, (j, _)) in white.iter().enumerate() {
                    information[(*i, *j)] += square[(a, b)];
                }
            }
        }
        without_last(&information, asked)
    }
}

/// Information of the first `keep` numbers, the others unknown (Schur complement).
pub fn without_last(information: &DMatrix<f64>, keep: usize) -> Option<DMatrix<f64>> {
    let n = information.nrows();
    let rest = information
        .view((keep, keep), (n - keep, n - keep))
        .into_owned();
    let across = information.view((keep, 0), (n - keep, keep)).into_owned();
    let root = ScaledCholesky::new(&rest, PROJECTION_JITTER)?;
    let taken = root.solve_columns(&across);
    Some(information.view((0, 0), (keep, keep)) - across.transpose() * taken)
}
