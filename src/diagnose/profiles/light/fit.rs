//! The mode of one model and its evidence (Laplace), fields without a name of the size that the frames ask for.

use super::equations::{Data, Equations, FIELDS, NUISANCES, OWN, State};
use hydroline_inference::prior::{Density, PriorTable};
use nalgebra::{Cholesky, DMatrix, DVector, Dyn};

/// Sizes that a field may have, over their median: by factors of four.
pub(super) const SIZES: [f64; 5] = [0.25, 1.0, 4.0, 16.0, 64.0];
/// Phases that are tried before a fit.
const PHASES: usize = 12;
/// Share of strays from which a fit begins far off, what samples may be off then \[grey levels\], and steps at each.
const FAR_OFF: f64 = 0.02;
const SPREADS_GREY: [f64; 3] = [20.0, 5.0, 1.5];
const STEPS_FAR: usize = 3;
/// Shares of a step that are tried.
const SHARES: [f64; 5] = [1.0, 0.5, 0.2, 0.06, 0.02];

/// A fit of one model.
#[derive(Debug, Clone)]
pub struct LightFit {
    /// Candidates in the model, by index.
    pub terms: Vec<usize>,
    /// Natural numbers of each.
    pub numbers: Vec<Vec<f64>>,
    /// Their sds.
    pub sds: Vec<Vec<f64>>,
    /// log evidence \[nat\].
    pub ln_evidence: f64,
    /// log evidence and log prior odds \[nat\].
    pub ln_score: f64,
    pub(super) state: State,
    pub(super) left: Vec<super::equations::Left>,
}

/// Log prior probability of a size on the grid: half-Cauchy of median 1, and what is larger than the unevenness of any lamp
/// and print is light of no known effect, as likely as a force without one.
fn ln_size(size: f64) -> f64 {
    let half_cauchy = std::f64::consts::FRAC_2_PI * size / (1.0 + size * size) * 4f64.ln();
    let unnamed = PriorTable::default().unnamed;
    let share = if size > 1.0 { unnamed } else { 1.0 - unnamed };
    (half_cauchy * share).ln()
}

/// Sizes of a field's numbers.
fn field(n: usize) -> Option<usize> {
    match n {
        n if n >= FIELDS[1] => Some(1),
        n if n >= FIELDS[0] => Some(0),
        _ => None,
    }
}

impl Data<'_> {
    /// A state without effects at which the frames' own numbers suit what was measured.
    pub(super) fn first(&self) -> State {
        State {
            terms: Vec::new(),
            numbers: Vec::new(),
            nuisance: [0.0; NUISANCES],
            own: vec![[0.0; OWN]; self.frames.len()],
            sizes: [1, 1],
            spread_grey: 0.0,
        }
    }

    /// log prior density of a state but for the constants of normal numbers, which the Laplace integral takes off again.
    fn ln_prior(&self, state: &State) -> f64 {
        let half_tau = 0.5 * std::f64::consts::TAU.ln();
        let effects = state
            .terms
            .iter()
            .zip(&state.numbers)
            .flat_map(|(t, numbers)| {
                let scales = &self.candidates[*t].scales;
                scales
                    .iter()
                    .zip(numbers)
                    .map(|(s, v)| s.density.ln(*v) + half_tau)
            });
        let nuisance = state
            .nuisance
            .iter()
            .enumerate()
            .map(|(n, x)| match field(n) {
                Some(f) => {
                    let size = SIZES[state.sizes[f]];
                    -0.5 * (x / size).powi(2) - size.ln()
                }
                None => -0.5 * x * x,
            });
        // The lamps' phase is any.
        let own = state
            .own
            .iter()
            .flat_map(|x| x[..OWN - 1].iter().map(|x| -0.5 * x * x));
        let sizes = state.sizes.iter().map(|s| ln_size(SIZES[*s]));
        effects.chain(nuisance).chain(own).chain(sizes).sum()
    }

    /// Prior's precision and slope at a state, of what all frames share.
    fn number_prior(&self, state: &State) -> (DVector<f64>, DVector<f64>) {
        let (mut precision, mut slope) = (Vec::new(), Vec::new());
        for (t, numbers) in state.terms.iter().zip(&state.numbers) {
            for (n, (s, v)) in self.candidates[*t].scales.iter().zip(numbers).enumerate() {
                let (down, curvature) = s.density.step(*v);
                slope.push(down);
                // Even on a circle: as if known to a turn.
                let least = if matches!(s.density, Density::Circle(_)) {
                    0.1
                } else {
                    1e-12
                };
                precision.push(curvature.max(least * self.unit(*t, n).powi(-2)));
            }
        }
        for (n, x) in state.nuisance.iter().enumerate() {
            let p = field(n).map_or(1.0, |f| SIZES[state.sizes[f]].powi(-2));
            precision.push(p);
            slope.push(-p * x);
        }
        (DVector::from_vec(precision), DVector::from_vec(slope))
    }

    /// Step, factor of the posterior's information, evidence where all is linear.
    fn solved(
        &self,
        state: &State,
        e: &Equations,
    ) -> Option<(DVector<f64>, Cholesky<f64, Dyn>, f64)> {
        let (precision, slope) = self.number_prior(state);
        let l = Cholesky::new(&e.information + DMatrix::from_diagonal(&precision))?;
        let right = &e.gradient + slope;
        let step = l.solve(&right);
        let half: f64 = (0..l.l_dirty().nrows())
            .map(|i| l.l_dirty()[(i, i)].ln())
            .sum();
        let there = e.value + self.ln_prior(state) - half - e.half_log_own;
        let evidence = there + 0.5 * right.dot(&step);
        evidence.is_finite().then_some((step, l, evidence))
    }

    /// The fields' sizes with most evidence about a state, one field after the other.
    fn sized(&self, state: &State, e: &Equations) -> State {
        let mut best = state.clone();
        for field in 0..best.sizes.len() {
            let worth = |size: usize| {
                let mut other = best.clone();
                other.sizes[field] = size;
                let evidence = self.solved(&other, e).map(|s| s.2);
                (evidence.unwrap_or(f64::NEG_INFINITY), other)
            };
            let all = (0..SIZES.len()).map(worth);
            if let Some((_, found)) = all.max_by(|a, b| a.0.total_cmp(&b.0)) {
                best = found;
            }
        }
        best
    }

    fn stepped(&self, state: &State, step: &DVector<f64>, own: &[[f64; OWN]], share: f64) -> State {
        let mut next = state.clone();
        let mut values = step.iter().map(|v| share * v);
        for (t, numbers) in next.terms.iter().zip(&mut next.numbers) {
            for (s, v) in self.candidates[*t].scales.iter().zip(numbers) {
                let (low, high) = s.bounds();
                *v = (*v + values.next().unwrap_or(0.0)).clamp(low, high);
            }
        }
        for (x, v) in next.nuisance.iter_mut().zip(values) {
            *x += v;
        }
        for (x, v) in next.own.iter_mut().zip(own) {
            for (x, v) in x.iter_mut().zip(v) {
                *x += share * v;
            }
        }
        next
    }

    /// Fits a model from a state, in so many steps at most.
    pub(super) fn fit(&self, from: &State, steps: usize) -> Option<LightFit> {
        self.fit_from(from, steps, &SPREADS_GREY)
    }

    /// The same; what samples may be off at the first steps, should it begin far off \[grey levels\].
    pub(super) fn fit_from(
        &self,
        from: &State,
        steps: usize,
        spreads_grey: &[f64],
    ) -> Option<LightFit> {
        let mut state = self.phased(from, PHASES)?;
        let mut e = self.equations(&state)?;
        // Far off, most samples would pass for strays: at first all of them may be off by a lot.
        if e.strays() > FAR_OFF {
            for spread in spreads_grey {
                state.spread_grey = *spread;
                (state, _) = self.steps(state, None, STEPS_FAR)?;
                state = self.phased(&state, PHASES)?;
            }
            state.spread_grey = 0.0;
            e = self.equations(&state)?;
        }
        let (mut state, e) = self.steps(state, Some(e), steps)?;
        state = self.sized(&state, &e);
        self.finished(state, e)
    }

    /// Gauss–Newton steps from a state, and the equations where they end.
    fn steps(
        &self,
        mut state: State,
        e: Option<Equations>,
        steps: usize,
    ) -> Option<(State, Equations)> {
        let mut e = match e {
            Some(e) => e,
            None => self.equations(&state)?,
        };
        for _ in 0..steps {
            state = self.sized(&state, &e);
            let (step, ..) = self.solved(&state, &e)?;
            let own = e.own_steps(&step);
            let before = e.value + self.ln_prior(&state);
            let better = SHARES.iter().find_map(|share| {
                let next = self.stepped(&state, &step, &own, *share);
                let gain = self.value(&next)? + self.ln_prior(&next) - before;
                (gain > 0.0).then_some((next, gain))
            });
            let Some((next, gain)) = better else { break };
            state = next;
            e = self.equations(&state)?;
            if gain < self.options.settled {
                break;
            }
        }
        Some((state, e))
    }

    fn finished(&self, state: State, e: Equations) -> Option<LightFit> {
        let (_, l, _) = self.solved(&state, &e)?;
        let half: f64 = (0..l.l_dirty().nrows())
            .map(|i| l.l_dirty()[(i, i)].ln())
            .sum();
        let ln_evidence = e.value + self.ln_prior(&state) - half - e.half_log_own;
        let covariance = l.inverse();
        let (mut numbers, mut sds, mut place) = (Vec::new(), Vec::new(), 0);
        for (t, scaled) in state.terms.iter().zip(&state.numbers) {
            let scales = &self.candidates[*t].scales;
            let natural = scales.iter().zip(scaled).map(|(s, v)| s.natural(*v));
            let (values, slopes): (Vec<f64>, Vec<f64>) = natural.unzip();
            let sd = |(k, slope): (usize, &f64)| {
                slope.abs() * covariance[(place + k, place + k)].max(0.0).sqrt()
            };
            sds.push(slopes.iter().enumerate().map(sd).collect());
            place += scales.len();
            numbers.push(values);
        }
        Some(LightFit {
            terms: state.terms.clone(),
            numbers,
            sds,
            ln_evidence,
            ln_score: ln_evidence,
            left: e.left,
            state,
        })
    }
}
