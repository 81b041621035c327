//! Gain of a candidate beside a fitted model: the score test, by the response of the motion to it.
//!
//! The response is finite (the candidate at a typical size), so that thresholds and delays, whose derivative at nothing
//! is nothing, are asked as well. It is projected off everything that the model can already do.

pub mod pair;

use std::collections::BTreeMap;

use hydroline_core::run::PerChannel;
use nalgebra::{Cholesky, DMatrix, DVector, Dyn};

use super::body::Point;
use super::filter::Filter;
use super::fit::{Fit, Problem};
use super::hyper::{Cell, filters};
use super::term::Kind;
use hydroline_numerics::{cancel, parallel};

/// Places in the table of sizes by which the random force is taken smaller for a second look: it shrinks when the right
/// effect joins.
const SHRUNK: usize = 3;
/// Least one of an effect whose size has one sign: it does not go through nothing.
const SHARE_LEAST: f64 = 0.02;
/// Largest multiple of the typical size that a response is stretched to where the law is not linear in it.
const STRETCH: f64 = 4.0;

/// Share of a response that must lie outside of what a model can do already for it to be identifiable at all.
const SEEN: f64 = 1e-6;

/// Gain in log likelihood that an effect of typical size must have predicted for a recording to show it.
const DETECTABLE_NAT: f64 = 3.0;

/// Share of the typical size at which a linear law's response is as good as its derivative.
const SMALL: f64 = 0.01;
/// On the diagonal of what data alone say: numbers that do the same are one.
const JITTER: f64 = 1e-10;

/// Channels per run and sample.
type Motion = Vec<Vec<PerChannel<f64>>>;

/// A candidate beside a model.
#[derive(Debug, Clone, PartialEq)]
pub struct PredictedGain {
    /// Place of the candidate among the body's.
    pub candidate: usize,
    /// Natural numbers to begin from.
    pub numbers: Vec<f64>,
    /// Gain in log likelihood that the linear view gains.
    pub gain: f64,
    /// For an exchange: the member that goes.
    pub instead: Option<usize>,
}

/// Columns by the number that they are derivatives by, (position, rate) per sample.
type Columns = Vec<(usize, Vec<[f64; 2]>)>;

/// Whitened columns of a model under one set of cells.
struct View {
    /// Whitened derivatives per DOF and run: (index, column).
    columns: BTreeMap<(usize, usize), Columns>,
    residuals: BTreeMap<(usize, usize), Vec<[f64; 2]>>,
    filters: BTreeMap<usize, Vec<Filter>>,
    gradient: DVector<f64>,
    whole: Left,
    /// Of the model without each of its members.
    without: Vec<Option<(Left, Products)>>,
}

/// Numbers of a model, or of one without a member, that responses are projected off.
struct Left {
    keep: Vec<usize>,
    root: Cholesky<f64, Dyn>,
    gradient: DVector<f64>,
}

impl Left {
    fn new(information: &DMatrix<f64>, gradient: &DVector<f64>, keep: Vec<usize>) -> Option<Left> {
        let n = keep.len();
        let part = DMatrix::from_fn(n, n, |i, j| information[(keep[i], keep[j])]);
        Some(Left {
            root: Cholesky::new(part)?,
            gradient: DVector::from_iterator(n, keep.iter().map(|i| gradient[*i])),
            keep,
        })
    }

    /// Products of a response with these numbers, and the change of the numbers that takes it up.
    fn solve(&self, with_columns: &DVector<f64>) -> (DVector<f64>, DVector<f64>) {
        let part = self.part(with_columns);
        let solved = self.root.solve(&part);
        (part, solved)
    }

    /// A response outside of what these numbers can do; `None` where next to nothing of it is.
    fn outside(&self, p: &Products) -> Option<Outside> {
        let own: f64 = p.white.values().map(|w| dot(w, w)).sum();
        let (part, solved) = self.solve(&p.with_columns);
        let size = own - part.dot(&solved);
        (size >= SEEN * own && size > 0.0).then(|| Outside {
            along: p.with_residual - solved.dot(&self.gradient),
            part,
            solved,
            size,
        })
    }

    fn part(&self, with_columns: &DVector<f64>) -> DVector<f64> {
        DVector::from_iterator(self.keep.len(), self.keep.iter().map(|i| with_columns[*i]))
    }
}

/// A response outside of what a model's numbers can do already.
struct Outside {
    /// Its products with these numbers, and the change of them that takes it up.
    part: DVector<f64>,
    solved: DVector<f64>,
    /// Products of what is outside with the residual and with itself.
    along: f64,
    size: f64,
}

/// A response against a view: inner products with the columns, the residual and itself.
struct Products {
    with_columns: DVector<f64>,
    with_residual: f64,
    white: BTreeMap<(usize, usize), Vec<[f64; 2]>>,
}

/// Inner product of two whitened series.
pub(super) fn dot(a: &[[f64; 2]], b: &[[f64; 2]]) -> f64 {
    a.iter()
        .zip(b)
        .map(|(a, b)| a[0] * b[0] + a[1] * b[1])
        .sum()
}

/// By how much a motion differs from another; `None` where it is not finite.
fn minus(mut made: Motion, here: &[Vec<PerChannel<f64>>]) -> Option<Motion> {
    let others = here.iter().flatten().flatten();
    for (a, b) in made.iter_mut().flatten().flatten().zip(others) {
        *a -= b;
        if !a.is_finite() {
            return None;
        }
    }
    Some(made)
}

impl Problem {
    /// View of a model at its point; `known` = with the prior of its numbers.
    fn view(
        &self,
        fit: &Fit,
        shrink: usize,
        members: &[Option<Motion>],
        known: bool,
    ) -> Option<View> {
        let mut misfit = fit.cells.misfit;
        for cell in &mut misfit {
            *cell = Cell {
                size: cell.size.saturating_sub(shrink),
                ..*cell
            };
        }
        let all = self.simulate(&fit.terms, &fit.point)?;
        let n = fit.point.len();
        let mut information = DMatrix::zeros(n, n);
        let mut gradient = DVector::zeros(n);
        let number_prior = self.number_prior(&fit.terms);
        number_prior.add_tables(&fit.point, &fit.cells, &mut information, &mut gradient);
        if known {
            number_prior.add_from(0, &fit.point, &mut information, &mut gradient);
        }
        let (mut columns, mut residuals, mut by_dof) =
            (BTreeMap::new(), BTreeMap::new(), BTreeMap::new());
        for &d in &self.body.dofs {
            let filters = filters(&self.body, &self.worth, &self.noises, d, misfit[d]);
            let normal = self.normal_with(&all, d, &filters, n);
            information += normal.information;
            gradient += normal.gradient;
            for (run, sim) in all.iter().enumerate() {
                let each = sim.columns.iter();
                let white =
                    each.filter_map(|(i, c)| Some((*i, self.white_column(d, c, &filters[run])?)));
                columns.insert((d, run), white.collect());
                residuals.insert(
                    (d, run),
                    self.white_residual(run, d, &sim.values, &filters[run]),
                );
            }
            by_dof.insert(d, filters);
        }
        if !known {
            for i in 0..n {
                information[(i, i)] = information[(i, i)] * (1.0 + JITTER) + 1e-12;
            }
        }
        let whole = Left::new(&information, &gradient, (0..n).collect())?;
        let mut made = View {
            columns,
            residuals,
            filters: by_dof,
            gradient,
            whole,
            without: Vec::new(),
        };
        let places = self.body.places(&fit.terms);
        made.without = members
            .iter()
            .enumerate()
            .map(|(m, response)| {
                let keep = (0..n)
                    .filter(|i| !(places[m]..places[m + 1]).contains(i))
                    .collect();
                // A member's trends go with it: no exchange is predicted for those.
                if self.dependants(&fit.terms, m).next().is_some() {
                    return None;
                }
                let left = Left::new(&information, &made.gradient, keep)?;
                Some((left, self.products(&made, response.as_ref()?)?))
            })
            .collect();
        Some(made)
    }

    /// A response (per run, channels per sample) against a view; `None` where nothing of it is seen.
    fn products(&self, view: &View, response: &[Vec<PerChannel<f64>>]) -> Option<Products> {
        let mut made = Products {
            with_columns: DVector::zeros(view.gradient.len()),
            with_residual: 0.0,
            white: BTreeMap::new(),
        };
        for (d, filters) in &view.filters {
            for (run, (column, filter)) in response.iter().zip(filters).enumerate() {
                let Some(white) = self.white_column(*d, column, filter) else {
                    continue;
                };
                if let Some(columns) = view.columns.get(&(*d, run)) {
                    for (i, c) in columns {
                        made.with_columns[*i] += dot(c, &white);
                    }
                }
                if let Some(r) = view.residuals.get(&(*d, run)) {
                    made.with_residual += dot(r, &white);
                }
                made.white.insert((*d, run), white);
            }
        }
        (!made.white.is_empty()).then_some(made)
    }

    /// Gains of what may be added to a model or put in a member's place, each at its best point; the largest first.
    pub fn predicted_gains(&self, fit: &Fit) -> Vec<PredictedGain> {
        let here = self.predicted(&fit.terms, &fit.point);
        // Motion without each member, minus the motion with all of them.
        let members: Vec<Option<Motion>> = (0..fit.terms.len())
            .map(|m| {
                let (terms, point) = self.without(fit, m);
                minus(self.predicted(&terms, &point), &here)
            })
            .collect();
        let Some(plain) = self.view(fit, 0, &members, true) else {
            return Vec::new();
        };
        let shrunk = if fit.cells.misfit.iter().any(|c| c.size > 0) {
            self.view(fit, SHRUNK, &members, true)
        } else {
            None
        };
        let asked: Vec<(usize, usize)> = (0..self.body.candidates.len())
            .filter(|c| !fit.terms.contains(c) && self.body.candidates[*c].kind == Kind::Effect)
            .flat_map(|c| (0..self.body.candidates[c].starts.len()).map(move |s| (c, s)))
            .collect();
        let found = parallel::map_slice(&asked, |&(c, s)| {
            cancel::check();
            let candidate = &self.body.candidates[c];
            let start = &candidate.starts[s];
            let (terms, point) = self.with(fit, c, start);
            let Some(response) = minus(self.predicted(&terms, &point), &here) else {
                return Vec::new();
            };
            let mut made = Vec::new();
            for view in [Some(&plain), shrunk.as_ref()].into_iter().flatten() {
                let Some(p) = self.products(view, &response) else {
                    continue;
                };
                let mut offer = |left: &Left, gone: Option<(usize, &Products)>| {
                    let Some(outside) = left.outside(&p) else {
                        return;
                    };
                    let Outside {
                        mut along,
                        size,
                        solved,
                        ..
                    } = outside;
                    if let Some((_, q)) = gone {
                        // Without the member the residual is larger by what it did.
                        let each = q.white.iter();
                        let cross: f64 = each
                            .filter_map(|(k, w)| Some(dot(w, p.white.get(k)?)))
                            .sum();
                        along -= cross - solved.dot(&left.part(&q.with_columns));
                    }
                    let share = self.share(c, start, along / size);
                    made.push(PredictedGain {
                        candidate: c,
                        numbers: candidate.at_share(start, candidate.stretched(), share),
                        gain: share * along - 0.5 * share * share * size,
                        instead: gone.map(|g| g.0),
                    });
                };
                offer(&view.whole, None);
                for (m, without) in view.without.iter().enumerate() {
                    if let Some((left, products)) = without {
                        offer(left, Some((m, products)));
                    }
                }
            }
            made
        });
        // Of each candidate and place the best point.
        let mut best: BTreeMap<(usize, Option<usize>), PredictedGain> = BTreeMap::new();
        for p in found.into_iter().flatten() {
            let key = (p.candidate, p.instead);
            if best.get(&key).is_none_or(|b| b.gain < p.gain) {
                best.insert(key, p);
            }
        }
        let mut all: Vec<PredictedGain> = best.into_values().collect();
        all.sort_by(|a, b| b.gain.total_cmp(&a.gain));
        all
    }

    /// Candidates whose response at their typical size says less than [`DETECTABLE_NAT`] beside a model, whatever is known of the
    /// vehicle's own numbers beforehand. Where a law is linear its response is taken small and scaled: what a coefficient does
    /// as well is seen to be that, however large.
    pub fn unseen(&self, fit: &Fit) -> Vec<usize> {
        let Some(view) = self.view(fit, 0, &[], false) else {
            return Vec::new();
        };
        let here = self.predicted(&fit.terms, &fit.point);
        let asked = |c: &usize| {
            let candidate = &self.body.candidates[*c];
            !fit.terms.contains(c) && !candidate.own && candidate.kind == Kind::Effect
        };
        let asked: Vec<usize> = (0..self.body.candidates.len()).filter(asked).collect();
        let unseen = parallel::map_slice(&asked, |c| {
            let candidate = &self.body.candidates[*c];
            let Some(start) = candidate.starts.first() else {
                return false;
            };
            let share = if candidate.linear.is_empty() {
                1.0
            } else {
                SMALL
            };
            let numbers = candidate.at_share(start, candidate.stretched(), share);
            let (terms, point) = self.with(fit, *c, &numbers);
            let Some(response) = minus(self.predicted(&terms, &point), &here) else {
                return false;
            };
            let Some(p) = self.products(&view, &response) else {
                return true;
            };
            let own: f64 = p.white.values().map(|w| dot(w, w)).sum();
            let (part, solved) = view.whole.solve(&p.with_columns);
            0.5 * (own - part.dot(&solved)) < DETECTABLE_NAT * share * share
        });
        let each = asked.into_iter().zip(unseen);
        each.filter_map(|(c, unseen)| unseen.then_some(c)).collect()
    }

    /// Bounds how far a response is stretched: within what its numbers may be, and where the law is linear no less.
    fn share(&self, candidate: usize, start: &[f64], share: f64) -> f64 {
        let c = &self.body.candidates[candidate];
        let Some(scale) = c.scales.first() else {
            // A law without numbers is there or not.
            return 1.0;
        };
        let most = if c.linear.is_empty() {
            STRETCH
        } else {
            f64::INFINITY
        };
        let low = if scale.logarithmic || c.info.parameters[0].bounds_load {
            SHARE_LEAST
        } else {
            -most
        };
        let mut share = share.clamp(low, most);
        for i in c.stretched() {
            let (a, b) = c.scales[*i].limits;
            let from = c.at_share(start, &[*i], 0.0)[*i];
            let value = (from + share * (start[*i] - from)).clamp(a, b);
            if start[*i] != from {
                share = (value - from) / (start[*i] - from);
            }
        }
        share
    }

    /// A model with one effect more, at these natural numbers.
    pub fn with(&self, fit: &Fit, candidate: usize, numbers: &[f64]) -> (Vec<usize>, Point) {
        let at = fit.terms.partition_point(|t| *t < candidate);
        let mut terms = fit.terms.clone();
        terms.insert(at, candidate);
        let place = self.body.places(&fit.terms)[at];
        let scales = self.body.candidates[candidate].scales.iter();
        let scaled: Vec<f64> = scales
            .zip(numbers)
            .map(|(s, v)| {
                let (low, high) = s.bounds();
                s.scaled(*v).clamp(low, high)
            })
            .collect();
        let mut point = fit.point.clone();
        point.splice(place..place, scaled);
        (terms, point)
    }

    /// Members that are trends of another one.
    pub fn dependants<'a>(
        &'a self,
        terms: &'a [usize],
        member: usize,
    ) -> impl DoubleEndedIterator<Item = usize> + 'a {
        let of = terms[member];
        let depends = move |m: &usize| {
            let kind = self.body.candidates[terms[*m]].kind;
            kind == Kind::Trend { of }
        };
        (0..terms.len()).filter(depends)
    }

    /// A model without one of its effects, and without what varies with it.
    pub fn without(&self, fit: &Fit, member: usize) -> (Vec<usize>, Point) {
        let places = self.body.places(&fit.terms);
        let mut terms = fit.terms.clone();
        let mut point = fit.point.clone();
        // Trends stand behind all effects.
        let gone = std::iter::once(member).chain(self.dependants(&fit.terms, member));
        for m in gone.collect::<Vec<_>>().into_iter().rev() {
            terms.remove(m);
            point.drain(places[m]..places[m + 1]);
        }
        (terms, point)
    }
}

#[cfg(test)]
mod tests {
    use crate::fit::Effort;
    use crate::hyper::{Cell, Cells, SIZES};
    use crate::prior::PriorTable;
    use crate::tests::fixtures::Tank;

    /// Friction stood among what runs cannot show because a random force followed all of their motion.
    #[test]
    fn what_a_random_force_hides_is_shown_without_one() {
        let tank = Tank {
            seconds: 12.0,
            hz: 12.5,
            ..Tank::new(&[0], vec![])
        };
        let runs = tank.runs(3, 5);
        let prior = PriorTable::default();
        let problem = crate::fit::Problem::new(&runs, &tank.rig, &[0], prior).unwrap();
        let none = Cells::of([Cell::default(); 6]);
        let begin = problem.body.begin();
        let mut fit = problem.fit(&[], &begin, none, Effort::default()).unwrap();
        let friction = |fit: &crate::fit::Fit| {
            let unseen = problem.unseen(fit);
            let names = unseen.iter().map(|c| problem.body.candidates[*c].name());
            names.filter(|n| n.starts_with("coulomb_friction")).count()
        };
        fit.cells = Cells::of([Cell::default(); 6]);
        assert_eq!(friction(&fit), 0);
        // Three hundred tolerances.
        let size = SIZES.iter().position(|s| *s == 300.0).unwrap();
        let large = Cell {
            size,
            correlation: 0,
        };
        fit.cells = Cells::of([large; 6]);
        assert_eq!(friction(&fit), 1);
    }
}
