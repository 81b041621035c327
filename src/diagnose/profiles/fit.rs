//! Poses of all frames, what they share, and an explanation's parameters, fitted together.
//!
//! Gauss–Newton on the log posterior; noise beyond the measurements' own (`floors`) and the
//! vehicle's motion prior are chosen by evidence at every step, so that each explanation is judged
//! with the noise it needs itself.

mod linear;
mod solve;
mod work;

use super::candidate::{Base, Candidate};
use super::geometry::Geometry;
use super::model::{Belongs, Kind, Shared, Widths};
use super::observe::{ImageRun, Seen};
use super::prior::{FIRST, Motion, MotionPriors};
use super::start;
use hydroline_rigs::Rig;
use hydroline_sim::effect::EffectInfo;
use nalgebra::DMatrix;
use work::Work;

/// Poses are fitted in mm and mrad.
pub(super) const UNIT: f64 = 1e-3;
const ITERATIONS: usize = 40;
/// Times that the motion priors are chosen at most.
const CHOICES: usize = 14;
/// First steps, at which they are chosen each time.
const EARLY: usize = 3;
/// Change of the log posterior below which a fit has settled.
const SETTLED: f64 = 0.02;

/// Rig, runs and priors that all fits of a diagnosis share.
pub struct Problem<'a> {
    /// The rig.
    pub rig: &'a Rig,
    /// Its optics.
    pub base: Base,
    /// Frames of each run.
    pub runs: &'a [ImageRun],
    /// Motion prior of each run.
    pub motions: Vec<Motion>,
    /// Shared numbers.
    pub shared: Vec<Shared>,
    widths: Widths,
}

/// A fit to begin from.
#[derive(Debug, Clone, PartialEq)]
pub struct State {
    /// Per run and frame.
    pub poses: Vec<Vec<[f64; 6]>>,
    /// In units of their priors.
    pub shared: Vec<f64>,
    /// Numbers per effect, as in the registry.
    pub numbers: Vec<Vec<f64>>,
    /// Disturbance of the vehicle's motion beside its model, per DOF.
    pub motion_priors: MotionPriors,
    /// Spread beyond the measurements' own, per [`Kind`] \[px\].
    pub floors: [f64; 3],
}

/// One measurement after a fit.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Left {
    /// Index of the run.
    pub run: usize,
    /// Frame of the run.
    pub frame: usize,
    /// Kind of measurement.
    pub kind: Kind,
    /// Where \[px\].
    pub at_px: [f64; 2],
    /// Measured − predicted \[px\].
    pub off_px: f64,
    /// Its standard deviation, floor included \[px\].
    pub sd_px: f64,
}

/// A fit.
#[derive(Debug, Clone)]
pub struct Fitted {
    /// Candidates by index.
    pub effects: Vec<usize>,
    /// Where it ended.
    pub state: State,
    /// log evidence.
    pub log_evidence: f64,
    /// Gain of log evidence where an effect may do without some of its numbers \[nat\].
    pub simpler: f64,
    /// Standard deviations of the numbers.
    pub sds: Vec<Vec<f64>>,
    /// Posterior precision of the numbers in units of their priors, poses and shared ones eliminated.
    pub masked: DMatrix<f64>,
    /// Residual of each measurement.
    pub left: Vec<Left>,
    /// Height, top and side that each frame's measurements belong to, run by run.
    pub belongs: Vec<Belongs>,
}

/// Parts of a fit that are free.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Free {
    /// Poses, shared numbers and effects.
    All,
    /// Poses alone: shared numbers and effects are taken over from elsewhere.
    Poses,
}

impl<'a> Problem<'a> {
    /// Of some runs.
    pub fn new(rig: &'a Rig, base: Base, runs: &'a [ImageRun], motions: Vec<Motion>) -> Self {
        let heights = rig.target.as_ref().map_or(1, |t| {
            hydroline_pose::outline::Surfaces::new(Some(t))
                .heights_m()
                .len()
        });
        let blur_px = rig.camera.noise.blur_px;
        Problem {
            rig,
            base,
            runs,
            motions,
            shared: Shared::all(heights),
            widths: Widths {
                sheet_m: rig.laser.sigma_m,
                // The pixel's box: 1/12.
                spread_px2: blur_px * blur_px + 1.0 / 12.0,
            },
        }
    }

    /// A state at these poses that knows nothing else.
    pub fn first(&self, poses: Vec<Vec<[f64; 6]>>) -> State {
        State {
            poses,
            shared: vec![0.0; self.shared.len()],
            numbers: Vec::new(),
            motion_priors: FIRST,
            floors: Kind::ALL.map(|k| k.floors().1),
        }
    }

    /// A state with these numbers at the poses that they give the frames; see [`start::poses`] for `coarse`.
    pub fn placed(
        &self,
        effects: &[&Candidate],
        numbers: Vec<Vec<f64>>,
        coarse: bool,
    ) -> Option<State> {
        let g = self.geometry(effects, &numbers)?;
        let poses = start::poses(self.rig, &g, self.runs, &self.motions, coarse)?;
        Some(State {
            numbers,
            ..self.first(poses)
        })
    }

    /// The geometry with these effects.
    pub fn geometry(&self, effects: &[&Candidate], numbers: &[Vec<f64>]) -> Option<Geometry> {
        let more: Vec<(&'static EffectInfo, &[f64])> = effects
            .iter()
            .zip(numbers)
            .map(|(c, n)| (c.info, n.as_slice()))
            .collect();
        let optics = self.base.optics(&more)?;
        Some(Geometry::new(self.rig, optics))
    }

    fn frames(&self) -> impl Iterator<Item = (usize, usize, &Seen)> {
        self.runs
            .iter()
            .enumerate()
            .flat_map(|(r, run)| run.frames.iter().enumerate().map(move |(f, s)| (r, f, s)))
    }

    /// Shared numbers in their own units.
    fn shared_values(&self, scaled: &[f64]) -> Vec<f64> {
        self.shared
            .iter()
            .zip(scaled)
            .map(|(s, v)| s.prior_sd() * v)
            .collect()
    }

    /// Fits these candidates from a state.
    pub fn fit(
        &self,
        candidates: &[Candidate],
        effects: &[usize],
        from: State,
        free: Free,
    ) -> Option<Fitted> {
        let chosen: Vec<&Candidate> = effects.iter().map(|k| &candidates[*k]).collect();
        let mut work = Work {
            problem: self,
            chosen,
            free,
            state: from,
        };
        let mut best = work.linear()?;
        // Choosing the motion priors takes most of the time, and chosen before the rest has settled they
        // make up for what is wrong with it: at once only where nothing is known of them yet.
        let fresh = work.state.motion_priors == FIRST;
        let mut solved = if fresh {
            work.choose(&best)
        } else {
            work.solve(&best, &work.state.motion_priors)
        };
        let mut chosen = 1;
        for iteration in 0..ITERATIONS {
            let (target, _, l) = solved.as_ref()?;
            let before = work.posterior(&best, &best.x)?;
            let mut share = 1.0;
            let mut moved = None;
            let start = work.state.clone();
            for _ in 0..6 {
                work.state = start.clone();
                work.step(&((target - &best.x) * share));
                if let Some(next) = work.linear_about(&best.belongs) {
                    let after = work.posterior(&next, &next.x)?;
                    if after > before - 1e-9 {
                        moved = Some((next, after));
                        break;
                    }
                }
                share *= 0.3;
            }
            let Some((next, after)) = moved else {
                work.state = start;
                break;
            };
            let change = work.spread(&next, l);
            // The assignment to heights and edges may have changed with the poses, and the floors have.
            let again = work.linear()?;
            let same = again.belongs == best.belongs;
            best = again;
            let settled = after - before < SETTLED && share == 1.0 && same && change < 0.03;
            if !settled && (iteration >= EARLY || !fresh) {
                solved = work.solve(&best, &work.state.motion_priors);
                continue;
            }
            let motion_priors = work.state.motion_priors;
            solved = work.choose(&best);
            chosen += 1;
            if settled && (work.state.motion_priors == motion_priors || chosen > CHOICES) {
                break;
            }
        }
        let (_, log_evidence, l) = solved?;
        work.finish(best, log_evidence, &l, effects)
    }
}

impl Problem<'_> {
    /// The same without a step: what the fit would find were all linear.
    pub fn screened(
        &self,
        candidates: &[Candidate],
        effects: &[usize],
        at: State,
    ) -> Option<Fitted> {
        let work = Work {
            problem: self,
            chosen: effects.iter().map(|k| &candidates[*k]).collect(),
            free: Free::All,
            state: at,
        };
        let linear = work.linear()?;
        let (_, log_evidence, l) = work.solve(&linear, &work.state.motion_priors)?;
        work.finish(linear, log_evidence, &l, effects)
    }
}

impl Fitted {
    /// Says to the log where the fit ended.
    pub(super) fn trace(&self, what: &str) {
        tracing::debug!(
            effects = ?self.effects,
            log_evidence = self.log_evidence,
            simpler = self.simpler,
            rms_px = ?Kind::ALL.map(|k| self.rms_px(k)),
            floors_px = ?self.state.floors,
            motion_sds = ?self.state.motion_priors.map(|w| w.sd),
            motion_tau_s = ?self.state.motion_priors.map(|w| w.tau_s),
            motion_drives = ?self.state.motion_priors.map(|w| w.drive),
            shared = ?self.state.shared,
            numbers = ?self.state.numbers,
            "{what}"
        );
    }

    /// rms of what is left of one kind, strays aside \[px\].
    pub fn rms_px(&self, kind: Kind) -> f64 {
        let own = self
            .left
            .iter()
            .filter(|l| l.kind == kind && l.off_px.abs() < 6.0 * l.sd_px);
        let (sum, n) = own.fold((0.0, 0usize), |(s, n), l| (s + l.off_px.powi(2), n + 1));
        (sum / n.max(1) as f64).sqrt()
    }
}
