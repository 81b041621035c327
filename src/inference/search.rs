//! From the vehicle alone to the models that the data leave: add, drop, exchange, as the score test proposes.
//!
//! Textbook loop: of all models visited the likeliest that was not yet looked at is expanded; what lies outside of
//! Occam's window is not (Madigan and Raftery 1994). Every model is scored by the same function. A limit ends the loop
//! between two steps, and changes nothing in their order (`limited`).

mod limited;
mod noise;
mod proposals;

use std::collections::{BTreeMap, BTreeSet};

use hydroline_numerics::parallel;

use hydroline_core::run::Channel;
use hydroline_identify::parameter::Term;

use super::body::Own;
use super::fit::{Effort, Fit, Problem};
use super::hyper::{Cell, Cells, SIZES};
use super::limit::{Account, Limit, Watch};
use super::posterior::{UNNAMED, above_tolerance};

/// Options of a search.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Options {
    /// Log score below the best at which a model is not expanded (Occam's window: a hundredth).
    pub window: f64,
    /// Candidates fitted beside each model.
    pub additions: usize,
    /// The same beside the vehicle alone: far from everything the linear view ranks worst, and fits are cheapest.
    pub first_additions: usize,
    /// The first so many of these are the most promising; then come the best of the DOFs that have none yet.
    pub foremost: usize,
    /// Log score by which a model may stay behind one that has all but one of its effects and still be expanded: what an
    /// effect that does not pay its way leads to, the smaller model leads to (Madigan and Raftery 1994, eq. 8).
    pub behind: f64,
    /// Candidates fitted in a member's place.
    pub exchanges: usize,
    /// Tables fitted beside each model that leaves something.
    pub tables: usize,
    /// Known laws fitted, as nearly right, in the place of a force of no known effect.
    pub laws: usize,
    /// Budget of all fits, in fits of one pass of sensitivities ([`Body::passes_of`]): a table costs as much as several
    /// effects.
    pub cost: usize,
    /// Models scored anew when the noise changes.
    pub rescored: usize,
    /// Gain in log likelihood below which a predicted gain is not worth a fit.
    pub least_gain: f64,
    /// Log score by which one step must better the best model for the noise to be estimated anew at once.
    pub renewed_after: f64,
    /// Times that the noise is estimated beside the best model and the models are scored anew.
    pub noise_rounds: usize,
    /// Log score by which a model under a new noise may lie behind the same one under the old noise for the new one to stand.
    pub noise_gain: f64,
    /// Change of a noise's logarithm below which it stays.
    pub noise_change: f64,
    /// Factors by which the correlation times of coloured noise are taken shorter at the end, the fast part kept: what is
    /// slow in it may be what a law misses.
    pub shorter: [f64; 2],
    /// Log score that this has to gain: the noise as it was then keeps a twentieth, and is left out.
    pub shorter_gain: f64,
    /// DOFs that nothing commanded: where no model follows one, its motion is an input, and there is no use in going on.
    pub may_give_up: [bool; 6],
    /// Fits after which that is asked.
    pub give_up_after: usize,
    /// Share of the tolerance below which evidence is not asked for: less than that matters to nobody.
    pub floor_over_tolerance: f64,
}

impl Default for Options {
    fn default() -> Self {
        Options {
            window: 100f64.ln(),
            additions: 5,
            first_additions: 12,
            foremost: 3,
            behind: 1.0,
            exchanges: 2,
            tables: 2,
            laws: 3,
            cost: 150,
            rescored: 24,
            least_gain: 3.0,
            renewed_after: 20.0,
            noise_rounds: 2,
            noise_gain: 1.0,
            noise_change: 0.03,
            shorter: [2.0, 4.0],
            shorter_gain: 20f64.ln(),
            may_give_up: [false; 6],
            give_up_after: 30,
            floor_over_tolerance: 0.05,
        }
    }
}

/// Outcome of a search.
#[derive(Debug)]
pub struct Found {
    /// The problem, with the noise at the end.
    pub problem: Problem,
    /// Models visited, by their effects.
    pub models: BTreeMap<Vec<usize>, Fit>,
    /// Fits made.
    pub fits: usize,
    /// DOFs that no model follows, of those that may be given up.
    pub given_up: Vec<usize>,
    /// How far the search came, and what a limit left open.
    pub account: Account,
}

/// Size of the random force over the noise from which a DOF is not followed: less is little more than what an instrument
/// adds.
const FAR_BEYOND: f64 = 5.0;

/// Sizes of the random force where a search begins: a large one keeps a vehicle that is far off from drowning everything,
/// a small one finds the mode that a large one hides.
const BEGIN: [usize; 3] = [4, 8, 12];
/// Factors on inertia and damping from which the vehicle alone is fitted as well: a rig may be off by five.
const FAR: [(f64, f64); 4] = [(3.0, 1.0), (0.4, 1.0), (1.0, 4.0), (1.0, 0.25)];

/// Fits that begin under the random forces given.
const AS_GIVEN: Effort = Effort {
    as_given: true,
    ..Effort::DEFAULT
};

struct Search<'a> {
    problem: Problem,
    models: BTreeMap<Vec<usize>, Fit>,
    expanded: BTreeSet<Vec<usize>>,
    fits: usize,
    cost: usize,
    options: Options,
    watch: Watch<'a>,
    account: Account,
    /// Fits of the present step that the limit kept from beginning.
    not_begun: usize,
}

type Job = (Vec<usize>, Vec<f64>, Cells);

impl<'a> Search<'a> {
    /// Nothing fitted yet.
    fn new(problem: Problem, options: Options, watch: Watch<'a>) -> Search<'a> {
        Search {
            problem,
            models: BTreeMap::new(),
            expanded: BTreeSet::new(),
            fits: 0,
            cost: 0,
            options,
            watch,
            account: Account::default(),
            not_begun: 0,
        }
    }

    fn fit(&mut self, jobs: Vec<Job>, effort: Effort) {
        self.fit_within(jobs, effort, Limit::NONE);
    }

    /// Fits the jobs that begin before the limit is over; a fit that has begun is never cut.
    fn fit_within(&mut self, jobs: Vec<Job>, effort: Effort, limit: Limit) {
        let all = jobs.len();
        let made = parallel::map_owned(jobs, |(terms, from, cells)| {
            let passes = self.problem.body.passes_of(&terms);
            let begins = !limit.is_over();
            begins.then(|| (passes, self.problem.fit(&terms, &from, cells, effort)))
        });
        let begun: Vec<(usize, Option<Fit>)> = made.into_iter().flatten().collect();
        self.fits += begun.len();
        self.not_begun += all - begun.len();
        self.cost += begun.iter().map(|b| b.0).sum::<usize>();
        for fit in begun.into_iter().filter_map(|b| b.1) {
            tracing::debug!(
                "{:.1} evidence {:.1} {:?} {:?}",
                fit.ln_score,
                fit.ln_evidence,
                self.names(&fit),
                self.problem
                    .body
                    .dofs
                    .iter()
                    .map(|d| fit.cells.misfit[*d])
                    .collect::<Vec<_>>()
            );
            let keep = self
                .models
                .get(&fit.terms)
                .is_none_or(|old| old.ln_score < fit.ln_score);
            if keep {
                self.models.insert(fit.terms.clone(), fit);
            }
        }
    }

    /// The vehicle alone, from several points.
    fn alone(&mut self) {
        let begin = self.problem.body.begin();
        let cell = |size: usize| Cell {
            size,
            correlation: 1,
        };
        let mut jobs: Vec<Job> = BEGIN
            .iter()
            .map(|s| (Vec::new(), begin.clone(), Cells::of([cell(*s); 6])))
            .collect();
        for (inertia, damping) in FAR {
            let mut from = begin.clone();
            for (own, v) in self.problem.body.own.iter().zip(&mut from) {
                *v = match own {
                    Own::Coefficient(c, _) if c.term == Term::Added => inertia.ln(),
                    Own::Coefficient(..) => damping.ln(),
                    // Where the rig says 0 there is no factor: none, or as much as is usual.
                    Own::Unsaid(c, _) if c.term == Term::Added => f64::from(inertia > 1.0),
                    Own::Unsaid(..) => f64::from(damping > 1.0),
                    Own::Restoring(_)
                    | Own::Stiffness(..)
                    | Own::NetWeight(_)
                    | Own::ClockOffset(_)
                    | Own::ClockDrift(_) => 0.0,
                };
            }
            jobs.push((Vec::new(), from, Cells::of([cell(BEGIN[1]); 6])));
        }
        self.fit(jobs, AS_GIVEN);
    }

    /// The same model from where it is under small random forces: a mode under large ones may be one that forgives what
    /// another explains.
    fn sharpened(&mut self, fit: Fit) -> Fit {
        let large = |d: &usize| fit.cells.misfit[*d].size > BEGIN[0];
        if !self.problem.body.dofs.iter().any(large) {
            return fit;
        }
        let mut small = fit.cells.clone();
        for cell in &mut small.misfit {
            cell.size = cell.size.min(BEGIN[0]);
        }
        self.fit(
            vec![(fit.terms.clone(), fit.point.clone(), small)],
            AS_GIVEN,
        );
        self.models.get(&fit.terms).cloned().unwrap_or(fit)
    }

    fn names(&self, fit: &Fit) -> Vec<String> {
        self.problem.names(fit)
    }

    fn best(&self) -> Option<&Fit> {
        self.models
            .values()
            .max_by(|a, b| a.ln_score.total_cmp(&b.ln_score))
    }

    /// Whether a model with one effect less is likelier by more than `behind`.
    fn is_behind_a_part(&self, fit: &Fit) -> bool {
        (0..fit.terms.len()).any(|member| {
            let (part, _) = self.problem.without(fit, member);
            let part = self.models.get(&part);
            part.is_some_and(|p| p.ln_score > fit.ln_score + self.options.behind)
        })
    }

    /// The likeliest model within the window that was not looked at.
    fn next(&self) -> Option<Fit> {
        self.pending().first().map(|f| (*f).clone())
    }

    /// Models within the window that were not looked at, likeliest first.
    fn pending(&self) -> Vec<&Fit> {
        let Some(best) = self.best() else {
            return Vec::new();
        };
        let floor = best.ln_score - self.options.window;
        let mut all: Vec<&Fit> = self
            .models
            .values()
            .filter(|f| f.ln_score >= floor && !self.expanded.contains(&f.terms))
            .filter(|f| !self.is_behind_a_part(f))
            .collect();
        // Of two with the same score the later set comes first.
        all.reverse();
        all.sort_by(|a, b| b.ln_score.total_cmp(&a.ln_score));
        all
    }

    /// DOFs in which only known laws are asked: a table follows any motion, and what nobody commanded and only a table follows
    /// is an input. Where nothing at all was commanded every DOF is explained as well as it can be.
    fn followed_by_laws(&self) -> [bool; 6] {
        let may = self.options.may_give_up;
        let commanded = self.problem.body.dofs.iter().any(|d| !may[*d]);
        may.map(|may| may && commanded)
    }

    fn found(self) -> Found {
        Found {
            given_up: match self.is_cut_early() {
                true => Vec::new(),
                false => self.not_followed(),
            },
            account: self.account,
            problem: self.problem,
            models: self.models,
            fits: self.fits,
        }
    }

    /// DOFs that the best model does not follow, of those that may be given up; none where nothing would be left to explain.
    fn not_followed(&self) -> Vec<usize> {
        let Some(best) = self.best() else {
            return Vec::new();
        };
        let Problem { body, noises, .. } = &self.problem;
        let far = |d: &usize| {
            let [place, rate] = Channel::of(*d);
            let channel = if noises.channels[place].is_some() {
                place
            } else {
                rate
            };
            let worth = SIZES[best.cells.misfit[*d].size] * body.tolerance[channel];
            let noise = noises.channels[channel].map_or(0.0, |n| n.total_sd());
            above_tolerance(best, *d) >= UNNAMED && worth > FAR_BEYOND * noise
        };
        let may = body.dofs.iter().filter(|d| self.options.may_give_up[**d]);
        let found: Vec<usize> = may.copied().filter(far).collect();
        if found.len() == body.dofs.len() {
            return Vec::new();
        }
        found
    }

    /// Whether there is no use in going on.
    fn gives_up(&self) -> bool {
        self.fits >= self.options.give_up_after && !self.not_followed().is_empty()
    }

    fn run(&mut self) {
        while self.cost < self.options.cost && !self.gives_up() {
            let Some(fit) = self.next() else { break };
            if self.ends_here() {
                break;
            }
            self.tell(&fit);
            let (terms, beside) = (fit.terms.clone(), self.label(&fit));
            let before = self.best().map_or(f64::INFINITY, |b| b.ln_score);
            self.expand(fit);
            self.end_step(&terms, &beside);
            // Beside a model that misses so much the instruments looked worse than they are.
            let gained = self.best().map_or(0.0, |b| b.ln_score - before);
            let has_time = !self.watch.limit.is_over();
            if gained > self.options.renewed_after && has_time && self.renew_noise(true) {
                self.rescore();
            }
        }
    }
}

/// Searches the models of a problem.
///
/// `None` when the vehicle alone gives no finite motion from the rig's numbers. The vehicle alone is fitted whatever the
/// limit says.
pub fn search(problem: Problem, options: Options, watch: Watch<'_>) -> Option<Found> {
    let mut search = Search::new(problem, options, watch);
    search.set_floor();
    search.alone();
    search.best()?;
    search.account.did("the vehicle alone");
    if search.renew_noise(false) {
        search.rescore();
    }
    search.run();
    for _ in 0..options.noise_rounds {
        if search.gives_up() || search.leaves_open("noise beside the best model") {
            break;
        }
        if !search.renew_noise(false) {
            break;
        }
        search.rescore();
        search.options.cost = search.cost + options.cost / 3;
        search.run();
    }
    if !search.gives_up() && !search.leaves_open("noise that is correlated for a shorter time") {
        search.with_shorter_noise(options.cost / 3);
    }
    Some(search.found())
}

/// The vehicle alone at its likeliest mode, with the noise beside it: the model that every search begins with. Its likelihood has no
/// floor ([`Options::floor_over_tolerance`]): what is asked of it are numbers, and these are known as well as the noise lets them be.
///
/// `None` when it gives no finite motion from the rig's numbers.
pub fn vehicle_alone(problem: Problem, options: Options, watch: Watch<'_>) -> Option<Found> {
    let mut search = Search::new(problem, options, watch);
    search.alone();
    search.best()?;
    for _ in 0..=options.noise_rounds {
        if !search.renew_noise(false) {
            break;
        }
        search.rescore();
    }
    search.best()?;
    search.account.did("the vehicle alone");
    Some(search.found())
}

/// Searches about a model that is known: the noise stays as it is, and nothing else is asked first.
pub fn about(problem: Problem, from: &Fit, options: Options) -> Found {
    let found = Found {
        problem,
        models: BTreeMap::from([(from.terms.clone(), from.clone())]),
        fits: 0,
        given_up: Vec::new(),
        account: Account::default(),
    };
    resumed(found, BTreeSet::new(), options, Watch::unlimited(&|_| {}))
}

/// Goes on from models that joined a search, beside what was expanded; `expanded` = what was there before.
pub(super) fn resumed(
    found: Found,
    expanded: BTreeSet<Vec<usize>>,
    options: Options,
    watch: Watch<'_>,
) -> Found {
    let mut search = Search {
        problem: found.problem,
        models: found.models,
        expanded,
        fits: found.fits,
        cost: 0,
        // The noise is known.
        options: Options {
            renewed_after: f64::INFINITY,
            ..options
        },
        watch,
        account: found.account,
        not_begun: 0,
    };
    search.run();
    search.found()
}

#[cfg(test)]
mod tests;
