//! Poses of all frames, what they share, and an explanation's parameters, fitted together.
//!
//! Gauss–Newton on the log posterior; noise beyond the measurements' own (`floors`) and the
//! vehicle's wobble are chosen by evidence at every step, so that each explanation is judged
//! with the noise it needs itself.

use super::candidate::{Base, Candidate};
use super::evidence::{Quadratic, half_log_det, inverse_factor};
use super::geometry::{Geometry, Placed};
use super::model::{Belongs, Kind, Rays, Shared, Widths, belongs, kinds, residuals};
use super::observe::{ImageRun, Seen};
use super::prior::{FIRST, Motion, Wobbles};
use super::start;
use super::wobble::{self, Alone};
use hydroline_calib::Pose;
use hydroline_rigs::Rig;
use hydroline_sim::effect::EffectInfo;
use nalgebra::{Cholesky, DMatrix, DVector, Dyn, Vector3};

/// Poses are fitted in mm and mrad.
pub(super) const UNIT: f64 = 1e-3;
const ITERATIONS: usize = 40;
/// Times that the wobbles are chosen at most.
const CHOICES: usize = 14;
/// First steps, at which they are chosen each time.
const EARLY: usize = 3;
/// Rounds through all of them in one choice.
const ROUNDS: usize = 3;
/// Change of the log posterior below which a fit has settled.
const SETTLED: f64 = 0.02;

/// What all fits of a diagnosis work on.
pub struct Problem<'a> {
    /// The rig.
    pub rig: &'a Rig,
    /// Its optics.
    pub base: Base,
    /// Runs.
    pub runs: &'a [ImageRun],
    /// How each moves.
    pub motions: Vec<Motion>,
    /// Shared numbers.
    pub shared: Vec<Shared>,
    /// Rows by which haze may pull the stripe \[px\].
    pub pull_px: f64,
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
    /// How the vehicle wobbles.
    pub wobbles: Wobbles,
    /// Spread beyond the measurements' own, per [`Kind`] \[px\].
    pub floors: [f64; 3],
}

/// One measurement after a fit.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Left {
    /// Run.
    pub run: usize,
    /// Frame of the run.
    pub frame: usize,
    /// What.
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
    /// What the evidence gains where an effect may do without some of its numbers.
    pub simpler: f64,
    /// Standard deviations of the numbers.
    pub sds: Vec<Vec<f64>>,
    /// Posterior precision of the numbers in units of their priors, poses and shared ones eliminated.
    pub masked: DMatrix<f64>,
    /// What is left of each measurement.
    pub left: Vec<Left>,
    /// What each frame's measurements belong to, run by run.
    pub belongs: Vec<Belongs>,
}

/// Which parts of a fit are free.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Free {
    /// Everything.
    All,
    /// Poses alone: shared numbers and effects are taken over from elsewhere.
    Poses,
}

impl<'a> Problem<'a> {
    /// Of some runs.
    pub fn new(rig: &'a Rig, base: Base, runs: &'a [ImageRun], motions: Vec<Motion>) -> Self {
        let heights = rig.target.as_ref().map_or(1, |t| {
            crate::pose::outline::Surfaces::new(Some(t))
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
            pull_px: 0.0,
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
            wobbles: FIRST,
            floors: Kind::ALL.map(|k| k.floors().1),
        }
    }

    /// A state with these numbers at the poses that they give the frames; see [`start::poses`] for `roughly`.
    pub fn placed(
        &self,
        effects: &[&Candidate],
        numbers: Vec<Vec<f64>>,
        roughly: bool,
    ) -> Option<State> {
        let g = self.geometry(effects, &numbers)?;
        let poses = start::poses(self.rig, &g, self.runs, &self.motions, roughly)?;
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

    /// Spread of a shared number's prior.
    fn prior_sd(&self, shared: Shared) -> f64 {
        match shared {
            Shared::Rows(_) => shared.prior_sd().hypot(self.pull_px),
            // Light beside the line fades otherwise than the line does where a top ends.
            Shared::Ends(..) => shared.prior_sd().hypot(3.0 * self.pull_px),
            other => other.prior_sd(),
        }
    }

    /// Shared numbers in their own units.
    fn shared_values(&self, scaled: &[f64]) -> Vec<f64> {
        self.shared
            .iter()
            .zip(scaled)
            .map(|(s, v)| self.prior_sd(*s) * v)
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
        // Choosing the wobbles takes most of the time, and chosen before the rest has settled they
        // make up for what is wrong with it: at once only where nothing is known of them yet.
        let fresh = work.state.wobbles == FIRST;
        let mut solved = if fresh {
            work.choose(&best)
        } else {
            work.solve(&best, &work.state.wobbles)
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
            // What belongs to what may have changed with the poses, and the floors have.
            let again = work.linear()?;
            let same = again.belongs == best.belongs;
            best = again;
            let settled = after - before < SETTLED && share == 1.0 && same && change < 0.03;
            if !settled && (iteration >= EARLY || !fresh) {
                solved = work.solve(&best, &work.state.wobbles);
                continue;
            }
            let wobbles = work.state.wobbles;
            solved = work.choose(&best);
            chosen += 1;
            if settled && (work.state.wobbles == wobbles || chosen > CHOICES) {
                break;
            }
        }
        let (_, log_evidence, l) = solved?;
        work.finish(best, log_evidence, &l, effects)
    }
}

impl Problem<'_> {
    /// The same without a step: what the fit would find were all linear.
    pub fn glance(&self, candidates: &[Candidate], effects: &[usize], at: State) -> Option<Fitted> {
        let work = Work {
            problem: self,
            chosen: effects.iter().map(|k| &candidates[*k]).collect(),
            free: Free::All,
            state: at,
        };
        let linear = work.linear()?;
        let (_, log_evidence, l) = work.solve(&linear, &work.state.wobbles)?;
        work.finish(linear, log_evidence, &l, effects)
    }
}

/// The likelihood about a state.
struct Linear {
    quadratic: Quadratic,
    /// The state in the fit's units.
    x: DVector<f64>,
    belongs: Vec<Belongs>,
    left: Vec<Left>,
    /// Responsibility of the proper model for each measurement, and its derivatives by frame.
    weights: Vec<f64>,
    rows: Vec<DVector<f64>>,
}

type Solved = (DVector<f64>, f64, Cholesky<f64, Dyn>);

struct Work<'p, 'a> {
    problem: &'p Problem<'a>,
    chosen: Vec<&'p Candidate>,
    free: Free,
    state: State,
}

impl Work<'_, '_> {
    fn frames(&self) -> usize {
        self.state.poses.iter().map(Vec::len).sum()
    }

    fn numbers(&self) -> usize {
        self.chosen.iter().map(|c| c.neutral.len()).sum()
    }

    fn size(&self) -> usize {
        let more = match self.free {
            Free::All => self.problem.shared.len() + self.numbers(),
            Free::Poses => 0,
        };
        6 * self.frames() + more
    }

    /// The state in the fit's units: poses off the rig's motion, the rest in units of their priors.
    fn x(&self) -> DVector<f64> {
        let mut x = Vec::with_capacity(self.size());
        for (poses, motion) in self.state.poses.iter().zip(&self.problem.motions) {
            for (pose, mean) in poses.iter().zip(&motion.mean) {
                x.extend((0..6).map(|d| (pose[d] - mean[d]) / UNIT));
            }
        }
        if self.free == Free::All {
            x.extend(&self.state.shared);
            for (c, numbers) in self.chosen.iter().zip(&self.state.numbers) {
                let scaled = numbers.iter().zip(&c.neutral).zip(&c.prior_sd);
                x.extend(scaled.map(|((v, n), s)| (v - n) / s));
            }
        }
        DVector::from_vec(x)
    }

    /// Moves the state, poses along the valley of a frame.
    fn step(&mut self, by: &DVector<f64>) {
        let mut values = by.iter().copied();
        let lever_m = self.problem.rig.mounts.l_laser_m;
        for pose in self.state.poses.iter_mut().flatten() {
            let own: [f64; 6] = std::array::from_fn(|_| UNIT * values.next().unwrap_or(0.0));
            *pose = along_the_valley(pose, &own, lever_m);
        }
        if self.free == Free::All {
            for s in &mut self.state.shared {
                *s += values.next().unwrap_or(0.0);
            }
            for (c, numbers) in self.chosen.iter().zip(&mut self.state.numbers) {
                for (k, number) in numbers.iter_mut().enumerate() {
                    let limits = c.info.parameters[k].limits;
                    let v = *number + c.prior_sd[k] * values.next().unwrap_or(0.0);
                    *number = v.clamp(limits.0, limits.1);
                }
            }
        }
    }

    fn linear(&self) -> Option<Linear> {
        let g = self.problem.geometry(&self.chosen, &self.state.numbers)?;
        let mut all = Vec::with_capacity(self.frames());
        for (r, f, seen) in self.problem.frames() {
            let placed = Placed::from(&Pose::from_array(self.state.poses[r][f]));
            all.push(belongs(&g, &placed, &Rays::new(&g, seen), seen));
        }
        self.linear_about(&all)
    }

    /// Likelihood and derivatives, measurements belonging as given.
    fn linear_about(&self, all: &[Belongs]) -> Option<Linear> {
        let problem = self.problem;
        let g = problem.geometry(&self.chosen, &self.state.numbers)?;
        // One geometry per number, moved by a little.
        let step = 1e-4;
        let mut moved: Vec<(Geometry, f64)> = Vec::new();
        if self.free == Free::All {
            for (e, c) in self.chosen.iter().enumerate() {
                for k in 0..c.neutral.len() {
                    let mut numbers = self.state.numbers.clone();
                    // Away from a limit of the law.
                    let sign =
                        if numbers[e][k] + step * c.prior_sd[k] > c.info.parameters[k].limits.1 {
                            -1.0
                        } else {
                            1.0
                        };
                    numbers[e][k] += sign * step * c.prior_sd[k];
                    let target = problem.geometry(&self.chosen, &numbers)?;
                    moved.push((target, sign * step));
                }
            }
        }
        let values = problem.shared_values(&self.state.shared);
        let mut shifted = Vec::new();
        if self.free == Free::All {
            for (k, s) in problem.shared.iter().enumerate() {
                let mut v = values.clone();
                v[k] += step * problem.prior_sd(*s);
                shifted.push(v);
            }
        }
        let size = self.size();
        let mut a = DMatrix::zeros(size, size);
        let mut gradient = DVector::zeros(size);
        let (mut value, mut left, mut weights, mut rows) =
            (0.0, Vec::new(), Vec::new(), Vec::new());
        let (mut base, mut other) = (Vec::new(), Vec::new());
        let tail = 6 * self.frames();
        for (i, ((r, f, seen), belongs)) in problem.frames().zip(all).enumerate() {
            let pose = self.state.poses[r][f];
            let placed = Placed::from(&Pose::from_array(pose));
            let rays = Rays::new(&g, seen);
            let widths = &problem.widths;
            let shared = problem.shared.as_slice();
            residuals(
                &g,
                &placed,
                &rays,
                seen,
                belongs,
                widths,
                (shared, &values),
                &mut base,
            );
            let n = base.len();
            let mut j = DMatrix::zeros(n, 6 + shifted.len() + moved.len());
            let mut put = |column: usize, other: &[f64], h: f64| {
                for (k, (o, b)) in other.iter().zip(&base).enumerate() {
                    let d = (o - b) / h;
                    // What the prediction does: the residual falls as it grows.
                    j[(k, column)] = if d.is_finite() { -d } else { 0.0 };
                }
            };
            for d in 0..6 {
                let mut p = pose;
                let h = 1e-3;
                p[d] += h * UNIT;
                let placed = Placed::from(&Pose::from_array(p));
                residuals(
                    &g,
                    &placed,
                    &rays,
                    seen,
                    belongs,
                    widths,
                    (shared, &values),
                    &mut other,
                );
                put(d, &other, h);
            }
            for (k, v) in shifted.iter().enumerate() {
                residuals(
                    &g,
                    &placed,
                    &rays,
                    seen,
                    belongs,
                    widths,
                    (shared, v),
                    &mut other,
                );
                put(6 + k, &other, step);
            }
            for (k, (g, h)) in moved.iter().enumerate() {
                let rays = Rays::new(g, seen);
                residuals(
                    g,
                    &placed,
                    &rays,
                    seen,
                    belongs,
                    widths,
                    (shared, &values),
                    &mut other,
                );
                put(6 + shifted.len() + k, &other, *h);
            }
            let place = |k: usize| if k < 6 { 6 * i + k } else { tail + k - 6 };
            let ats = seen
                .bins
                .iter()
                .chain(&seen.bins)
                .map(|b| [b.column_px, b.row_px])
                .chain(seen.edges.iter().map(|e| [e.column_px, e.row_px]));
            for (k, ((kind, own_sd), at_px)) in
                kinds(seen, belongs).into_iter().zip(ats).enumerate()
            {
                let sd = own_sd.hypot(self.state.floors[kind as usize]);
                let off = base[k];
                let (stray, range) = kind.stray();
                let outside = (stray / range).ln();
                let inside = if off.is_finite() {
                    (1.0 - stray).ln() - 0.5 * (off / sd).powi(2) - (sd * TAU_ROOT).ln()
                } else {
                    f64::NEG_INFINITY
                };
                let top = inside.max(outside);
                let log = top + ((inside - top).exp() + (outside - top).exp()).ln();
                value += log;
                let w = (inside - log).exp();
                let row = j.row(k).transpose();
                if w > 1e-6 {
                    let scale = w / (sd * sd);
                    for p in 0..row.len() {
                        let at = place(p);
                        gradient[at] += scale * row[p] * off;
                        for q in 0..=p {
                            a[(at, place(q))] += scale * row[p] * row[q];
                        }
                    }
                }
                left.push(Left {
                    run: r,
                    frame: f,
                    kind,
                    at_px,
                    off_px: off,
                    sd_px: sd,
                });
                weights.push(w);
                rows.push(row);
            }
        }
        for p in 0..size {
            for q in 0..p {
                a[(q, p)] = a[(p, q)];
            }
        }
        let x = self.x();
        let ax = &a * &x;
        let c = value - gradient.dot(&x) - 0.5 * x.dot(&ax);
        Some(Linear {
            quadratic: Quadratic {
                b: &gradient + &ax,
                a,
                c,
            },
            x,
            belongs: all.to_vec(),
            left,
            weights,
            rows,
        })
    }

    /// Prior precision of everything and half the log determinant of its covariance.
    fn prior(&self, wobbles: &Wobbles) -> Option<(DMatrix<f64>, f64)> {
        let mut p = DMatrix::identity(self.size(), self.size());
        let mut half = 0.0;
        let mut first = 0;
        for motion in &self.problem.motions {
            for (d, wobble) in wobbles.iter().enumerate() {
                let known = motion.precision(d, wobble)?;
                let (own, own_half) = known.as_ref();
                half += own_half;
                for i in 0..motion.frames() {
                    for j in 0..motion.frames() {
                        p[(first + 6 * i + d, first + 6 * j + d)] = own[(i, j)];
                    }
                }
            }
            first += 6 * motion.frames();
        }
        Some((p, half))
    }

    /// log posterior at `x` of the likelihood about its own point.
    fn posterior(&self, linear: &Linear, x: &DVector<f64>) -> Option<f64> {
        let (p, half) = self.prior(&self.state.wobbles)?;
        let q = &linear.quadratic;
        let likelihood = q.c + q.b.dot(x) - 0.5 * x.dot(&(&q.a * x));
        Some(likelihood - 0.5 * x.dot(&(p * x)) - half)
    }

    fn solve(&self, linear: &Linear, wobbles: &Wobbles) -> Option<Solved> {
        let (p, half) = self.prior(wobbles)?;
        linear.quadratic.solved(&p, half)
    }

    /// The wobbles by evidence, DOF by DOF; the solution with them.
    fn choose(&mut self, linear: &Linear) -> Option<Solved> {
        let mut wobbles = self.state.wobbles;
        for _ in 0..ROUNDS {
            let before = wobbles;
            for d in 0..wobbles.len() {
                let driven = self.problem.motions.iter().any(|m| m.driven[d]);
                let (prior, _) = self.prior(&wobbles)?;
                if let Some(alone) = Alone::of(&linear.quadratic, &prior, &self.problem.motions, d)
                {
                    wobbles[d] = wobble::chosen(wobbles[d], driven, &|w| alone.value(w));
                }
            }
            if wobbles == before {
                break;
            }
        }
        match self.solve(linear, &wobbles) {
            Some(solved) => {
                self.state.wobbles = wobbles;
                Some(solved)
            }
            // Digits did not suffice there.
            None => self.solve(linear, &self.state.wobbles),
        }
    }

    /// Floors: what the residuals scatter beyond the measurements' own sds, by as many of them as
    /// the fit has not used up (MacKay 1992). Returns the largest change, as a share.
    fn spread(&mut self, linear: &Linear, l: &Cholesky<f64, Dyn>) -> f64 {
        let Some(root) = inverse_factor(l) else {
            return f64::INFINITY;
        };
        let n = root.nrows();
        let tail = 6 * self.frames();
        let end = root.columns(tail, n - tail);
        let end_block = end.tr_mul(&end);
        let mut sums = [[0.0; 4]; 3];
        let mut index = 0;
        let mut last = (usize::MAX, usize::MAX);
        let mut frame = 0;
        let mut block = DMatrix::zeros(0, 0);
        for ((left, w), row) in linear.left.iter().zip(&linear.weights).zip(&linear.rows) {
            if (left.run, left.frame) != last {
                if last.0 != usize::MAX {
                    frame += 1;
                }
                last = (left.run, left.frame);
                let own = root.columns(6 * frame, 6);
                let t = n - tail;
                block = DMatrix::zeros(6 + t, 6 + t);
                block.view_mut((0, 0), (6, 6)).copy_from(&own.tr_mul(&own));
                let cross = own.tr_mul(&end);
                block.view_mut((0, 6), (6, t)).copy_from(&cross);
                block.view_mut((6, 0), (t, 6)).copy_from(&cross.transpose());
                block.view_mut((6, 6), (t, t)).copy_from(&end_block);
            }
            if left.off_px.is_finite() && *w > 1e-6 {
                let unsure = row.dot(&(&block * row));
                let sd2 = left.sd_px.powi(2);
                let sum = &mut sums[left.kind as usize];
                sum[0] += w * left.off_px.powi(2);
                sum[1] += w * (1.0 - w * unsure / sd2);
                sum[2] += w * (sd2 - self.state.floors[left.kind as usize].powi(2));
                sum[3] += w;
            }
            index += 1;
        }
        debug_assert_eq!(index, linear.left.len());
        let mut change = 0.0f64;
        let pull_px = self.problem.pull_px;
        for (kind, [square, free, own2, weight]) in Kind::ALL.into_iter().zip(sums) {
            if weight > 3.0 {
                let found = square / free.max(0.02 * weight) - own2 / weight;
                let floor = &mut self.state.floors[kind as usize];
                // Slowly down: a fit that still moves looks better in one kind than it is.
                let next = found.max(0.0).sqrt().clamp(0.6 * *floor, 3.0 * *floor);
                // Haze broadens the line too, here more and there less.
                let hazy = if kind == Kind::Width {
                    0.5 * pull_px
                } else {
                    0.0
                };
                let next = next.max(kind.floors().0).max(hazy);
                change = change.max((next / *floor - 1.0).abs());
                *floor = next;
            }
        }
        change
    }

    /// An effect whose numbers may be left out of a rig file is each subset of them with the same
    /// prior probability. A subset's evidence is that of all, times the posterior's density over
    /// the prior's where the others do nothing (Savage and Dickey; Verdinelli and Wasserman 1995).
    fn simpler(&self, covariance: &DMatrix<f64>) -> f64 {
        let x = self.x();
        let from = x.len() - covariance.nrows();
        let mut place = 0;
        let mut sum = 0.0;
        for c in &self.chosen {
            let first = place;
            place += c.neutral.len();
            let open: Vec<usize> = (0..c.neutral.len())
                .filter(|k| c.info.parameters[*k].absent == Some(c.neutral[*k]))
                .map(|k| first + k)
                .collect();
            let mut logs = Vec::with_capacity(1 << open.len());
            for mask in 0..1usize << open.len() {
                let out: Vec<usize> = (0..open.len())
                    .filter(|k| mask >> k & 1 == 1)
                    .map(|k| open[k])
                    .collect();
                // All of them left out is no effect.
                if out.len() == c.neutral.len() {
                    continue;
                }
                let v = DMatrix::from_fn(out.len(), out.len(), |i, j| covariance[(out[i], out[j])]);
                let m = DVector::from_iterator(out.len(), out.iter().map(|k| x[from + k]));
                // Both densities at the neutral point; the prior's is (2π)^(-n/2).
                if let Some(l) = Cholesky::new(v) {
                    logs.push(-0.5 * m.dot(&l.solve(&m)) - half_log_det(&l));
                }
            }
            let top = logs.iter().copied().fold(f64::NEG_INFINITY, f64::max);
            if top.is_finite() {
                let all = logs.iter().map(|v| (v - top).exp()).sum::<f64>() / logs.len() as f64;
                sum += top + all.ln();
            }
        }
        sum
    }

    fn finish(
        self,
        linear: Linear,
        log_evidence: f64,
        l: &Cholesky<f64, Dyn>,
        effects: &[usize],
    ) -> Option<Fitted> {
        let n = if self.free == Free::All {
            self.numbers()
        } else {
            0
        };
        let root = inverse_factor(l)?;
        let numbers = root.columns(root.ncols() - n, n);
        let block = numbers.tr_mul(&numbers);
        let mut place = 0;
        let sds = self
            .chosen
            .iter()
            .map(|c| {
                let own = c.prior_sd.iter().enumerate().map(|(k, s)| {
                    let at = place + k;
                    if at < n {
                        s * block[(at, at)].max(0.0).sqrt()
                    } else {
                        f64::NAN
                    }
                });
                let own: Vec<f64> = own.collect();
                place += c.prior_sd.len();
                own
            })
            .collect();
        let simpler = if n > 0 { self.simpler(&block) } else { 0.0 };
        Some(Fitted {
            effects: effects.to_vec(),
            state: self.state,
            log_evidence,
            simpler,
            sds,
            masked: block.try_inverse().unwrap_or_else(|| DMatrix::zeros(n, n)),
            left: linear.left,
            belongs: linear.belongs,
        })
    }
}

/// √2π.
const TAU_ROOT: f64 = 2.506_628_274_631_000_2;

/// A pose moved by a step that is linear in where the sheet's middle meets the floor (X, Y), its
/// range there, and the angles. Turning θ alone leaves the line in the image; in x, z and θ it
/// follows a curve, which a straight step leaves by H δθ²/2: many row sds after a tenth of a degree.
fn along_the_valley(pose: &[f64; 6], by: &[f64; 6], lever_m: f64) -> [f64; 6] {
    let seen = |p: &[f64; 6]| {
        let pose = Pose::from_array(*p);
        let r = pose.body_to_tank_rotation();
        // Height 0: z + r31 l + r33 ρ = 0.
        let range_m = -(pose.z_m + r[(2, 0)] * lever_m) / r[(2, 2)];
        let foot = pose.position_m() + r * Vector3::new(lever_m, 0.0, range_m);
        [foot.x, foot.y, range_m]
    };
    let here = seen(pose);
    let h = 1e-3;
    let (mut ahead, mut behind) = (*pose, *pose);
    for d in 0..6 {
        ahead[d] += h * by[d];
        behind[d] -= h * by[d];
    }
    let (a, b) = (seen(&ahead), seen(&behind));
    let there: [f64; 3] = std::array::from_fn(|i| here[i] + (a[i] - b[i]) / (2.0 * h));
    let mut next = *pose;
    for d in 3..6 {
        next[d] += by[d];
    }
    let arm = Pose::from_array(next).body_to_tank_rotation() * Vector3::new(lever_m, 0.0, there[2]);
    [next[0], next[1], next[2]] = [there[0] - arm.x, there[1] - arm.y, -arm.z];
    next
}

impl Fitted {
    /// Says to the log where the fit ended.
    pub(super) fn told(&self, what: &str) {
        tracing::debug!(
            effects = ?self.effects,
            log_evidence = self.log_evidence,
            simpler = self.simpler,
            rms_px = ?Kind::ALL.map(|k| self.rms_px(k)),
            floors_px = ?self.state.floors,
            wobble_sds = ?self.state.wobbles.map(|w| w.sd),
            wobble_tau_s = ?self.state.wobbles.map(|w| w.tau_s),
            wobble_drives = ?self.state.wobbles.map(|w| w.drive),
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

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::super::candidate::vocabulary;
    use super::super::prior::Wobble;
    use super::*;
    use crate::prove::images::make;

    /// Two runs, driven in surge alone: with the rest integrated out each DOF's wobble is worth what it is worth
    /// in the whole problem.
    #[test]
    fn one_dof_alone_is_worth_what_it_is_in_the_whole() {
        let case = make(2, 6).unwrap();
        let base = Base::new(&case.rig).unwrap();
        let candidates = vocabulary(&base);
        let motions = case
            .runs
            .iter()
            .map(|r| Motion::new(r, &case.rig).unwrap())
            .collect();
        let problem = Problem::new(&case.rig, base, &case.runs, motions);
        let chosen = vec![&candidates[3]];
        let numbers = vec![candidates[3].neutral.clone()];
        let state = problem.placed(&chosen, numbers, false).unwrap();
        let work = Work {
            problem: &problem,
            chosen,
            free: Free::All,
            state,
        };
        let linear = work.linear().unwrap();
        for dof in [0, 2, 4] {
            assert_eq!(problem.motions[0].driven[dof], dof == 0);
            let value = |sd: f64, tau_s: f64| {
                let mut wobbles = FIRST;
                let wobble = Wobble {
                    sd,
                    tau_s,
                    drive: 3e-8,
                };
                wobbles[dof] = wobble;
                let (prior, _) = work.prior(&FIRST).unwrap();
                let motions = &problem.motions;
                let alone = Alone::of(&linear.quadratic, &prior, motions, dof).unwrap();
                let whole = work.solve(&linear, &wobbles).unwrap().1;
                (alone.value(&wobble).unwrap(), whole)
            };
            let (a, b) = (value(1e-3, 0.7), value(2e-2, 5.0));
            let (alone, whole) = (a.0 - b.0, a.1 - b.1);
            assert!(whole.abs() > 1.0, "{dof}: nothing is asked");
            assert!(
                (alone - whole).abs() < 1e-3 * whole.abs().max(1.0),
                "{dof}: {alone} {whole}"
            );
        }
    }
}
