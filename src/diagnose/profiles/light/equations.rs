//! The likelihood of the samples about a state, with its derivatives; what is each frame's and each bin's own is eliminated.

use super::candidate::LightCandidate;
use super::forward::{AMBIENTS, Fields, Forward, GAINS, Own, Uncertain};
use super::options::LightOptions;
use super::samples::{Bin, LightFrame};
use crate::profiles::candidate::Base;
use hydroline_numerics::{cancel, parallel};
use hydroline_rigs::Rig;
use nalgebra::{DMatrix, DVector, Matrix2, SMatrix, SVector, Vector2};

/// Numbers of [`Uncertain`].
pub(super) const NUISANCES: usize = 5 + GAINS + AMBIENTS;
/// First of the gain field's, and of the background's.
pub(super) const FIELDS: [usize; 2] = [5, 5 + GAINS];
/// Numbers of [`Own`]; the last is the lamps' phase.
pub(super) const OWN: usize = 4;
const LAMP: usize = 3;
/// Step of a derivative in units of the priors' sds.
const STEP: f64 = 1e-3;
/// The same of a bin's row \[px\].
const ROW_STEP_PX: f64 = 0.01;
/// Phases tried for a frame that is not among the data.
const PHASES_ALONE: usize = 24;
/// √2π.
const TAU_ROOT: f64 = 2.506_628_274_631_000_2;

/// Frames, candidates and options that all models are judged on.
pub(super) struct Data<'a> {
    pub rig: &'a Rig,
    pub base: &'a Base,
    pub frames: Vec<LightFrame>,
    pub candidates: Vec<LightCandidate>,
    pub options: LightOptions,
    /// Spread beyond the noise: over the stripe's brightness, and of the background \[grey levels\].
    pub floors: [f64; 2],
    /// Whether all of the target is as bright as the floor.
    pub even_target: bool,
}

/// Numbers of a model, in units of their priors.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct State {
    /// Candidates in the model, by index.
    pub terms: Vec<usize>,
    /// As the candidates' scales have them.
    pub numbers: Vec<Vec<f64>>,
    pub nuisance: [f64; NUISANCES],
    pub own: Vec<[f64; OWN]>,
    /// Place of each field's size in the table of sizes.
    pub sizes: [usize; 2],
    /// Extra sd of the samples beyond noise and floors while the state is far from the mode, else 0 \[grey levels\].
    pub spread_grey: f64,
}

/// Normal equations of what all frames share, and what the frames' own are where those are.
pub(super) struct Equations {
    pub value: f64,
    pub information: DMatrix<f64>,
    pub gradient: DVector<f64>,
    /// Half the log determinants of the frames' own.
    pub half_log_own: f64,
    own: Vec<OwnStep>,
    /// Residuals of the samples, each with the probability that it belongs.
    pub left: Vec<Left>,
}

/// Residual of a sample.
#[derive(Debug, Clone, Copy)]
pub(super) struct Left {
    pub on_line: bool,
    /// Measured − predicted \[grey levels\].
    pub off: f64,
    /// Variance by noise alone \[grey levels²\].
    pub noise: f64,
    /// Unit of the floor: the stripe's brightness near the sample \[grey levels\]; 1 in the background.
    pub scale: f64,
    /// Probability that it belongs.
    pub belongs: f64,
}

/// own = at − by · shared step.
struct OwnStep {
    at: SVector<f64, OWN>,
    by: DMatrix<f64>,
}

impl Equations {
    /// Share of samples that are something else.
    pub fn strays(&self) -> f64 {
        let sum: f64 = self.left.iter().map(|l| 1.0 - l.belongs).sum();
        sum / self.left.len().max(1) as f64
    }

    /// The frames' own steps that go with one of the shared numbers.
    pub fn own_steps(&self, shared: &DVector<f64>) -> Vec<[f64; OWN]> {
        (self.own.iter())
            .map(|o| {
                let step = &o.by * shared;
                std::array::from_fn(|k| o.at[k] - step[k])
            })
            .collect()
    }
}

/// One frame's likelihood: value, and by (shared, own) where asked for.
struct Frame {
    value: f64,
    information: DMatrix<f64>,
    gradient: DVector<f64>,
    left: Vec<Left>,
}

impl Data<'_> {
    /// Natural numbers of what is uncertain.
    pub fn uncertain(&self, x: &[f64; NUISANCES]) -> Uncertain {
        let o = &self.options;
        Uncertain {
            thickness: o.thickness_ln * x[0],
            spread: o.spread_ln * x[1],
            noise: o.noise_ln * x[2],
            shape: [o.shape * x[3], o.shape * x[4]],
            gain: std::array::from_fn(|k| o.gain * x[FIELDS[0] + k]),
            ambient: std::array::from_fn(|k| o.ambient_grey * x[FIELDS[1] + k]),
        }
    }

    /// Natural numbers of a frame's own.
    pub fn own(&self, x: &[f64; OWN]) -> Own {
        let o = &self.options;
        Own {
            brightness: o.brightness_ln * x[0],
            background: self.rig.camera.noise.ambient + o.background_grey * x[1],
            rise: o.rise * x[2],
            lamp_s: o.lamp_s * x[LAMP],
        }
    }

    /// A state's prediction.
    pub fn forward(&self, state: &State, near: Option<&Forward>) -> Option<Forward> {
        let effects: Vec<_> = (state.terms.iter().zip(&state.numbers))
            .map(|(t, numbers)| {
                let c = &self.candidates[*t];
                let natural = c.scales.iter().zip(numbers).map(|(s, v)| s.natural(*v).0);
                c.effect(&natural.collect::<Vec<_>>())
            })
            .collect();
        let optics = self.base.optics_of(&effects)?;
        let uncertain = self.uncertain(&state.nuisance);
        Some(Forward::new(self.rig, optics, uncertain, near))
    }

    /// sd of one of an effect's scaled numbers: the unit of its step.
    pub fn unit(&self, term: usize, number: usize) -> f64 {
        let density = self.candidates[term].scales[number].density;
        let curvature = |at: f64| density.step(at).1;
        match density {
            hydroline_inference::prior::Density::Student { centre, .. } => {
                curvature(centre).max(1e-12).powf(-0.5)
            }
            _ => 1.0,
        }
    }

    /// The prediction with each shared number moved but those of the fields, and by how much in its unit.
    fn moved(&self, state: &State, near: &Forward) -> Option<Vec<(Forward, f64)>> {
        let mut moved = Vec::new();
        for (k, term) in state.terms.iter().enumerate() {
            for (n, scale) in self.candidates[*term].scales.iter().enumerate() {
                let mut other = state.clone();
                let step = STEP * self.unit(*term, n);
                // Away from a limit of the law.
                let up = other.numbers[k][n] + step <= scale.bounds().1;
                let signed = if up { step } else { -step };
                other.numbers[k][n] += signed;
                moved.push((self.forward(&other, Some(near))?, signed));
            }
        }
        for n in 0..FIELDS[0] {
            let mut other = state.clone();
            other.nuisance[n] += STEP;
            moved.push((self.forward(&other, Some(near))?, STEP));
        }
        Some(moved)
    }

    /// Results of a job for each frame with its own numbers.
    fn each<T: Send>(
        &self,
        state: &State,
        job: impl Fn(&LightFrame, &[f64; OWN]) -> T + Sync,
    ) -> Vec<T> {
        let frames: Vec<_> = self.frames.iter().zip(&state.own).collect();
        parallel::map_slice(&frames, |(frame, own)| job(frame, own))
    }

    /// log likelihood alone.
    pub fn value(&self, state: &State) -> Option<f64> {
        let forward = self.forward(state, None)?;
        let values = self.each(state, |f, own| {
            self.frame(f, own, &forward, (&[], state.spread_grey), false)
                .value
        });
        let sum: f64 = values.iter().sum();
        sum.is_finite().then_some(sum)
    }

    /// Likelihood and normal equations about a state.
    pub fn equations(&self, state: &State) -> Option<Equations> {
        let forward = self.forward(state, None)?;
        let moved = self.moved(state, &forward)?;
        let timed = self.timed(&forward);
        let frames = self.each(state, |f, own| {
            self.frame(f, own, &forward, (&moved, state.spread_grey), true)
        });
        let n = moved.len() + GAINS + AMBIENTS;
        let mut sum = Equations {
            value: 0.0,
            information: DMatrix::zeros(n, n),
            gradient: DVector::zeros(n),
            half_log_own: 0.0,
            own: Vec::new(),
            left: Vec::new(),
        };
        for (f, x) in frames.into_iter().zip(&state.own) {
            sum.value += f.value;
            sum.left.extend(f.left);
            let cross = f.information.view((n, 0), (OWN, n)).into_owned();
            let mut own: SMatrix<f64, OWN, OWN> =
                SMatrix::from_fn(|i, j| f.information[(n + i, n + j)]);
            let mut right = SVector::<f64, OWN>::from_fn(|i, _| f.gradient[n + i]);
            for k in 0..OWN {
                if k == LAMP && timed {
                    // Any phase alike within the unit: worth nothing where the lamps' light is too faint to tell.
                    own[(k, k)] += std::f64::consts::TAU;
                    sum.half_log_own -= 0.5 * std::f64::consts::TAU.ln();
                } else {
                    own[(k, k)] += 1.0;
                    right[k] -= x[k];
                }
            }
            let l = own.cholesky()?;
            sum.half_log_own += (0..OWN).map(|k| l.l_dirty()[(k, k)].ln()).sum::<f64>();
            let back = l.inverse();
            let by = DMatrix::from_fn(OWN, n, |i, j| {
                (0..OWN).map(|k| back[(i, k)] * cross[(k, j)]).sum::<f64>()
            });
            sum.information += f.information.view((0, 0), (n, n)) - cross.tr_mul(&by);
            let at = back * right;
            let at_dynamic = DVector::from_column_slice(at.as_slice());
            sum.gradient += f.gradient.rows(0, n) - cross.tr_mul(&at_dynamic);
            sum.own.push(OwnStep { at, by });
        }
        sum.value.is_finite().then_some(sum)
    }

    /// Own numbers of a frame that is not among the data, all frames' held.
    pub fn alone(&self, frames: &[LightFrame], state: &State, steps: usize) -> [f64; OWN] {
        let (Some(frame), Some(own)) = (frames.first(), state.own.first()) else {
            return [0.0; OWN];
        };
        let (mut x, Some(forward)) = (*own, self.forward(state, None)) else {
            return *own;
        };
        let timed = self.timed(&forward);
        let value = |x: &[f64; OWN]| {
            let prior: f64 = x[..LAMP].iter().map(|v| 0.5 * v * v).sum();
            self.frame(frame, x, &forward, (&[], 0.0), false).value - prior
        };
        if timed {
            x = self.phase_of(frame, &x, &forward, PHASES_ALONE);
        }
        let mut now = value(&x);
        let first = GAINS + AMBIENTS;
        for _ in 0..steps {
            let f = self.frame(frame, &x, &forward, (&[], 0.0), true);
            let mut a: SMatrix<f64, OWN, OWN> =
                SMatrix::from_fn(|i, j| f.information[(first + i, first + j)]);
            let mut g = SVector::<f64, OWN>::from_fn(|i, _| f.gradient[first + i]);
            for k in 0..OWN {
                a[(k, k)] += 1.0;
                g[k] -= if k == LAMP { 0.0 } else { x[k] };
            }
            let Some(l) = a.cholesky() else { break };
            let step = l.solve(&g);
            let better = [1.0, 0.3, 0.1].iter().find_map(|share| {
                let next: [f64; OWN] = std::array::from_fn(|k| x[k] + share * step[k]);
                let there = value(&next);
                (there > now).then_some((next, there))
            });
            match better {
                Some((next, there)) => {
                    let settled = there - now < self.options.settled;
                    (x, now) = (next, there);
                    if settled {
                        break;
                    }
                }
                None => break,
            }
        }
        x
    }

    /// A frame's own numbers with the lamps' phase that suits its background best, of `count` within their span.
    fn phase_of(
        &self,
        frame: &LightFrame,
        own: &[f64; OWN],
        forward: &Forward,
        count: usize,
    ) -> [f64; OWN] {
        let only = LightFrame {
            bins: frame.bins.iter().filter(|b| !b.on_line).cloned().collect(),
            ..frame.clone()
        };
        let at = |k: usize| {
            let mut own = *own;
            own[LAMP] += k as f64 / count as f64;
            (
                self.frame(&only, &own, forward, (&[], 0.0), false).value,
                own,
            )
        };
        let best = (0..count).map(at).max_by(|a, b| a.0.total_cmp(&b.0));
        best.map_or(*own, |b| b.1)
    }

    /// Whether a prediction depends on when a frame was taken.
    pub fn timed(&self, forward: &Forward) -> bool {
        let Some(frame) = self.frames.first() else {
            return false;
        };
        let at = |lamp: f64| self.own(&[0.0, 0.0, 0.0, lamp]);
        let samples = frame
            .bins
            .iter()
            .filter(|b| !b.on_line)
            .flat_map(|b| &b.samples);
        samples.take(64).any(|s| {
            // No period of any mains is a multiple of this share.
            (forward.light(s, &at(0.0)) - forward.light(s, &at(0.382))).abs() > 1e-9
        })
    }

    /// The lamps' phases that suit the frames best, of `count` within their span.
    pub fn phased(&self, state: &State, count: usize) -> Option<State> {
        let forward = self.forward(state, None)?;
        let mut state = state.clone();
        if !self.timed(&forward) {
            return Some(state);
        }
        state.own = self.each(&state, |f, own| self.phase_of(f, own, &forward, count));
        Some(state)
    }

    fn frame(
        &self,
        frame: &LightFrame,
        x: &[f64; OWN],
        forward: &Forward,
        (moved, spread_grey): (&[(Forward, f64)], f64),
        slopes: bool,
    ) -> Frame {
        cancel::check();
        let own = self.own(x);
        let others: Vec<Own> = (0..OWN)
            .map(|k| {
                let mut x = *x;
                x[k] += STEP;
                self.own(&x)
            })
            .collect();
        // Shared numbers, the fields' last, then the frame's own.
        let shared = moved.len() + GAINS + AMBIENTS;
        let n = if slopes { shared + OWN } else { 0 };
        let mut sum = Frame {
            value: 0.0,
            information: DMatrix::zeros(n, n),
            gradient: DVector::zeros(n),
            left: Vec::new(),
        };
        for bin in &frame.bins {
            let predicted: Vec<f64> = bin
                .samples
                .iter()
                .map(|s| forward.grey(s, &own, 0.0))
                .collect();
            let measured =
                Measured::new(self, frame, bin, (forward, &own), (&predicted, spread_grey));
            sum.value += measured.value;
            if !slopes {
                continue;
            }
            let mut j = DMatrix::zeros(bin.samples.len(), n);
            for (i, (s, p)) in bin.samples.iter().zip(&predicted).enumerate() {
                for (k, (other, step)) in moved.iter().enumerate() {
                    j[(i, k)] = (other.grey(s, &own, 0.0) - p) / step;
                }
                for (k, other) in others.iter().enumerate() {
                    j[(i, shared + k)] = (forward.grey(s, other, 0.0) - p) / STEP;
                }
                // Fields are brightness and background that depend on the place.
                let Fields { gains, ambients } = &s.fields;
                let by_gain = j[(i, shared)] * self.options.gain
                    / self.options.brightness_ln
                    / (1.0 + forward.gain(s));
                let by_ambient =
                    j[(i, shared + 1)] * self.options.ambient_grey / self.options.background_grey;
                for (k, basis) in gains.iter().enumerate() {
                    j[(i, moved.len() + k)] = by_gain * basis;
                }
                for (k, basis) in ambients.iter().enumerate() {
                    j[(i, moved.len() + GAINS + k)] = by_ambient * basis;
                }
            }
            measured.add(&j, &mut sum.information, &mut sum.gradient);
            sum.left.extend(measured.left);
        }
        sum
    }
}

/// A bin's residuals, its own row and brightness taken out.
struct Measured {
    value: f64,
    /// Residuals and their weights.
    off: DVector<f64>,
    weight: DVector<f64>,
    /// By the bin's row and brightness.
    by: DMatrix<f64>,
    /// Inverse of the information of those.
    back: Matrix2<f64>,
    left: Vec<Left>,
}

impl Measured {
    fn new(
        data: &Data<'_>,
        frame: &LightFrame,
        bin: &Bin,
        (forward, own): (&Forward, &Own),
        (predicted, spread_grey): (&[f64], f64),
    ) -> Measured {
        let o = &data.options;
        let n = bin.samples.len();
        let mut made = Measured {
            value: 0.0,
            off: DVector::zeros(n),
            weight: DVector::zeros(n),
            by: DMatrix::zeros(n, 2),
            back: Matrix2::zeros(),
            left: Vec::with_capacity(n),
        };
        let mut sds = Vec::with_capacity(n);
        // Rounding to whole grey levels is noise too.
        let noise2 = frame.noise_sd.powi(2).max(1.0 / 12.0);
        let brighter = Own {
            brightness: own.brightness + STEP,
            ..*own
        };
        for (i, (s, p)) in bin.samples.iter().zip(predicted).enumerate() {
            made.off[i] = s.grey - p;
            let scale = if bin.on_line {
                forward.on_stripe(s, own)
            } else {
                1.0
            };
            let noise = s.variance * noise2;
            let floor = if bin.on_line {
                (data.floors[0] * scale).hypot(data.floors[1])
            } else {
                data.floors[1]
            };
            sds.push((noise + floor * floor + spread_grey * spread_grey).sqrt());
            made.left.push(Left {
                on_line: bin.on_line,
                off: s.grey - p,
                noise,
                scale,
                belongs: 1.0,
            });
            if bin.on_line {
                made.by[(i, 0)] = (forward.grey(s, own, ROW_STEP_PX) - p) / ROW_STEP_PX;
                made.by[(i, 1)] = (forward.grey(s, &brighter, 0.0) - p) / STEP;
            }
        }
        let paint = if data.even_target {
            o.paint
        } else {
            o.paint_uneven
        };
        let prior = Matrix2::from_diagonal(&Vector2::new(o.row_px.powi(-2), paint.powi(-2)));
        let (stray, range) = o.stray;
        let outside = (stray / range).ln();
        let mut shift: Vector2<f64> = Vector2::zeros();
        // Twice: whether a sample belongs is seen with its bin's row and brightness.
        for _ in 0..2 {
            made.value = 0.0;
            for (i, sd) in sds.iter().copied().enumerate() {
                let left = made.off[i] - made.by[(i, 0)] * shift[0] - made.by[(i, 1)] * shift[1];
                let inside = (1.0 - stray).ln() - 0.5 * (left / sd).powi(2) - (sd * TAU_ROOT).ln();
                let top = inside.max(outside);
                let log = top + ((inside - top).exp() + (outside - top).exp()).ln();
                made.value += log;
                let belongs = (inside - log).exp();
                made.left[i].off = left;
                made.left[i].belongs = belongs;
                made.weight[i] = belongs / (sd * sd);
            }
            made.value -= 0.5 * shift.dot(&(prior * shift));
            if !bin.on_line {
                break;
            }
            let mut information = prior;
            let mut right = Vector2::zeros();
            for i in 0..n {
                let b = Vector2::new(made.by[(i, 0)], made.by[(i, 1)]);
                information += b * b.transpose() * made.weight[i];
                right += b * (made.weight[i] * made.off[i]);
            }
            made.back = information.try_inverse().unwrap_or_else(Matrix2::zeros);
            shift = made.back * right;
        }
        for (off, left) in made.off.iter_mut().zip(&made.left) {
            *off = left.off;
        }
        made
    }

    /// Adds to normal equations: Schur's complement of the bin's own.
    fn add(&self, j: &DMatrix<f64>, information: &mut DMatrix<f64>, gradient: &mut DVector<f64>) {
        let mut weighted = j.clone();
        for (i, mut row) in weighted.row_iter_mut().enumerate() {
            row *= self.weight[i];
        }
        let cross = self.by.tr_mul(&weighted);
        information.gemm_tr(1.0, j, &weighted, 1.0);
        let back = DMatrix::from_fn(2, 2, |i, k| self.back[(i, k)]);
        *information -= cross.tr_mul(&(back * &cross));
        gradient.gemv_tr(1.0, &weighted, &self.off, 1.0);
    }
}
