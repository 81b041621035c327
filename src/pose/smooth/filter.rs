//! Extended Kalman filter forwards, Rauch–Tung–Striebel smoother backwards.

use super::{
    ACCELERATIONS, Dynamics, MeasuredFrame, RATES, STATES, SmoothError, Square, State, THICKNESS,
    THICKNESS_UNIT_M,
};
use hydroline_numerics::cholesky::{JITTER, ScaledCholesky};
use nalgebra::{DMatrix, DVector};

/// Sd of a run's first state about its first pose: far beyond what a frame leaves open.
const START_POSE: [f64; 6] = [0.3, 0.3, 0.3, 0.2, 0.2, 0.2];
/// Sd of the first rates \[m/s, rad/s\].
const START_RATE: f64 = 0.3;
/// Sd of the first unknown accelerations \[m/s², rad/s²\].
const START_ACCELERATION: f64 = 0.2;
/// Sd of the thickness before any frame, in its unit: 0.5 mm.
const START_THICKNESS: f64 = 5.0;
/// Squared innovation per number from which a frame counts less: one in 10⁵ of six honest ones.
const DOWNWEIGHT_CHI2: f64 = 32.0;

pub(super) struct Filtered {
    /// After each frame: state and covariance.
    pub after: Vec<(State, Square)>,
    /// Before each frame but the first: prediction, covariance, derivative of the step.
    pub before: Vec<(State, Square, Square)>,
    pub downweighted: usize,
    pub chi2: f64,
    /// −2 log likelihood of the innovations, up to a constant.
    pub minus_two_log_likelihood: f64,
}

fn start(frames: &[MeasuredFrame]) -> (State, Square) {
    let mut x = State::zeros();
    let mut p = Square::zeros();
    let first = |i: usize| {
        frames
            .iter()
            .filter_map(|f| f.measured.as_ref())
            .find(|m| if i < 6 { m.measured[i] } else { m.thickness })
            .map(|m| m.values[i])
    };
    for i in 0..6 {
        x[i] = first(i).unwrap_or(0.0);
        p[(i, i)] = START_POSE[i].powi(2);
        p[(RATES + i, RATES + i)] = START_RATE.powi(2);
        p[(ACCELERATIONS + i, ACCELERATIONS + i)] = START_ACCELERATION.powi(2);
    }
    x[THICKNESS] = first(6).unwrap_or(0.002) / THICKNESS_UNIT_M;
    p[(THICKNESS, THICKNESS)] = START_THICKNESS.powi(2);
    (x, p)
}

/// Forwards with unknown accelerations that gain `walk_sd` per root second. `robust`: frames that
/// disagree grossly count less.
pub(super) fn forwards(
    frames: &[MeasuredFrame],
    dynamics: &Dynamics,
    walk_sd: &[f64; 6],
    robust: bool,
) -> Result<Filtered, SmoothError> {
    let (mut x, mut p) = start(frames);
    let mut out = Filtered {
        after: Vec::with_capacity(frames.len()),
        before: Vec::with_capacity(frames.len()),
        downweighted: 0,
        chi2: 0.0,
        minus_two_log_likelihood: 0.0,
    };
    let mut numbers = 0;
    for (frame, seen) in frames.iter().enumerate() {
        if frame > 0 {
            let from_ns = frames[frame - 1].stamp_ns;
            let (next, slopes) = dynamics
                .step(from_ns, seen.stamp_ns, &x)
                .ok_or(SmoothError::Diverged { frame })?;
            let dt_s = (seen.stamp_ns - from_ns) as f64 * 1e-9;
            p = slopes * p * slopes.transpose() + gained(walk_sd, dt_s);
            x = next;
            out.before.push((x, p, slopes));
        }
        if let Some(update) = Update::of(seen, &x, &p) {
            let mut scale = 1.0;
            let per_number = update.chi2 / update.n as f64;
            if robust && frame > 0 && per_number > DOWNWEIGHT_CHI2 / 6.0 {
                scale = per_number / (DOWNWEIGHT_CHI2 / 6.0);
                out.downweighted += 1;
            }
            if frame > 0 {
                out.chi2 += update.chi2 / scale;
                // A downweighted frame still costs: of two strengths the one that downweights less is likelier.
                out.minus_two_log_likelihood +=
                    update.chi2 / scale * (1.0 + f64::ln(scale)) + update.log_size;
                numbers += update.n;
            }
            (x, p) = update
                .applied(&x, &p, scale)
                .ok_or(SmoothError::Diverged { frame })?;
        }
        if !x.iter().chain(p.iter()).all(|v| v.is_finite()) {
            return Err(SmoothError::Diverged { frame });
        }
        out.after.push((x, p));
    }
    out.chi2 /= f64::from(u32::try_from(numbers.max(1)).unwrap_or(u32::MAX));
    Ok(out)
}

/// Covariance that a random walk of d adds over a step, with what it moves ν and η meanwhile
/// (axes taken as aligned within one step): ∫ (s³.., s², s).
fn gained(walk_sd: &[f64; 6], dt: f64) -> Square {
    let mut q = Square::zeros();
    for (i, sd) in walk_sd.iter().enumerate() {
        let v = sd * sd;
        let at = [i, RATES + i, ACCELERATIONS + i];
        let terms = [
            [dt.powi(5) / 20.0, dt.powi(4) / 8.0, dt.powi(3) / 6.0],
            [dt.powi(4) / 8.0, dt.powi(3) / 3.0, dt.powi(2) / 2.0],
            [dt.powi(3) / 6.0, dt.powi(2) / 2.0, dt],
        ];
        for (a, row) in at.iter().zip(terms) {
            for (b, term) in at.iter().zip(row) {
                q[(*a, *b)] += v * term;
            }
        }
    }
    q
}

/// One frame against its prediction.
struct Update {
    n: usize,
    places: Vec<usize>,
    innovation: DVector<f64>,
    own: DMatrix<f64>,
    chi2: f64,
    log_size: f64,
}

impl Update {
    fn of(seen: &MeasuredFrame, x: &State, p: &Square) -> Option<Self> {
        let m = seen.measured.as_ref()?;
        let mut from: Vec<usize> = (0..6).filter(|i| m.measured[*i]).collect();
        if m.thickness {
            from.push(6);
        }
        if from.is_empty() {
            return None;
        }
        let unit = |i: usize| if i == 6 { THICKNESS_UNIT_M } else { 1.0 };
        let places: Vec<usize> = from
            .iter()
            .map(|i| if *i == 6 { THICKNESS } else { *i })
            .collect();
        let n = from.len();
        let innovation = DVector::from_fn(n, |k, _| {
            let (i, at) = (from[k], places[k]);
            m.values[i] / unit(i) - x[at]
        });
        let own = DMatrix::from_fn(n, n, |a, b| {
            m.covariance[(from[a], from[b])] / unit(from[a]) / unit(from[b])
        });
        let mut update = Update {
            n,
            places,
            innovation,
            own,
            chi2: 0.0,
            log_size: 0.0,
        };
        let factor = ScaledCholesky::new(&update.total(p, 1.0), JITTER)?;
        update.chi2 = factor.squared_norm(&update.innovation);
        update.log_size = factor.ln_determinant();
        Some(update)
    }

    fn total(&self, p: &Square, scale: f64) -> DMatrix<f64> {
        DMatrix::from_fn(self.n, self.n, |a, b| {
            p[(self.places[a], self.places[b])] + scale * self.own[(a, b)]
        })
    }

    /// Joseph's form: symmetric and positive whatever the rounding.
    fn applied(&self, x: &State, p: &Square, scale: f64) -> Option<(State, Square)> {
        let factor = ScaledCholesky::new(&self.total(p, scale), JITTER)?;
        // (S⁻¹ H P)ᵀ
        let hp = DMatrix::from_fn(self.n, STATES, |a, j| p[(self.places[a], j)]);
        let gain_t = factor.solve_columns(&hp);
        let mut next = *x;
        let mut keep = Square::identity();
        for j in 0..STATES {
            for a in 0..self.n {
                next[j] += gain_t[(a, j)] * self.innovation[a];
                keep[(j, self.places[a])] -= gain_t[(a, j)];
            }
        }
        let noise = gain_t.transpose() * &self.own * &gain_t * scale;
        let mut after = keep * p * keep.transpose();
        for i in 0..STATES {
            for j in 0..STATES {
                after[(i, j)] += noise[(i, j)];
            }
        }
        Some((next, 0.5 * (after + after.transpose())))
    }
}

/// Backwards: state and covariance of every frame given the whole run.
pub(super) fn backwards(filtered: &Filtered) -> Result<Vec<(State, Square)>, SmoothError> {
    let mut out = filtered.after.clone();
    for k in (0..out.len().saturating_sub(1)).rev() {
        let (x, p) = &filtered.after[k];
        let (predicted, spread, slopes) = &filtered.before[k];
        let factor =
            ScaledCholesky::new(spread, JITTER).ok_or(SmoothError::Diverged { frame: k })?;
        // Gᵀ = S⁻¹ F P
        let gain_t = factor.solve_columns(&(slopes * p));
        let gain = gain_t.transpose();
        let (next_x, next_p) = out[k + 1];
        let state = x + gain * (next_x - predicted);
        let covariance = p + gain * (next_p - spread) * gain_t;
        out[k] = (state, 0.5 * (covariance + covariance.transpose()));
    }
    Ok(out)
}
