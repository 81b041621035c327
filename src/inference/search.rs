//! From the vehicle alone to the models that the data leave: add, drop, exchange, as the score test proposes.
//!
//! Textbook loop: of all models visited the likeliest that was not yet looked at is expanded; what lies outside of
//! Occam's window is not (Madigan and Raftery 1994). Every model is scored by the same function.

use std::collections::{BTreeMap, BTreeSet};

use rayon::prelude::*;

use hydroline_identify::parameter::Term;

use super::body::Own;
use super::fit::{Effort, Fit, Problem};
use super::hyper::{Cell, Cells, Noises, SIZES};
use super::noise::estimate;
use super::posterior::{UNNAMED, above_tolerance};
use super::promise::Promise;

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
    /// Known laws fitted, as nearly right, in the place of a force without a name.
    pub laws: usize,
    /// What all fits may cost, in fits of one pass of sensitivities ([`Body::passes_of`]): a table costs as much as several
    /// effects.
    pub cost: usize,
    /// Models scored anew when the noise changes.
    pub rescored: usize,
    /// Gain in log likelihood below which a promise is not worth a fit.
    pub least_gain: f64,
    /// Log score by which one step must better the best model for the noise to be estimated anew at once.
    pub renewed_after: f64,
    /// Times that the noise is estimated beside the best model and the models are scored anew.
    pub noise_rounds: usize,
    /// Log score by which a model under a new noise may lie behind the same one under the old noise for the new one to stand.
    pub noise_gain: f64,
    /// Change of a noise's logarithm below which it stays.
    pub noise_change: f64,
    /// DOFs that nothing commanded: where no model follows one, its motion is an input, and there is no use in going on.
    pub may_give_up: [bool; 6],
    /// Fits after which that is asked.
    pub give_up_after: usize,
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
            may_give_up: [false; 6],
            give_up_after: 30,
        }
    }
}

/// What a search found.
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
    progress: &'a (dyn Fn(&str) + Sync),
}

type Job = (Vec<usize>, Vec<f64>, Cells);

impl Search<'_> {
    fn fit(&mut self, jobs: Vec<Job>, effort: Effort) {
        self.fits += jobs.len();
        let body = &self.problem.body;
        self.cost += jobs.iter().map(|j| body.passes_of(&j.0)).sum::<usize>();
        let made: Vec<Fit> = jobs
            .into_par_iter()
            .filter_map(|(terms, from, cells)| self.problem.fit(&terms, &from, cells, effort))
            .collect();
        for fit in made {
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
                    Own::Restoring(_) => 0.0,
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
        fit.terms
            .iter()
            .map(|t| self.problem.body.candidates[*t].name())
            .collect()
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
        let floor = self.best()?.ln_score - self.options.window;
        self.models
            .values()
            .filter(|f| f.ln_score >= floor && !self.expanded.contains(&f.terms))
            .filter(|f| !self.is_behind_a_part(f))
            .max_by(|a, b| a.ln_score.total_cmp(&b.ln_score))
            .cloned()
    }

    /// Which additions are fitted: what explains one DOF's residual is alike, and must not crowd out the others.
    fn proposed<'p>(&self, fit: &Fit, promises: &'p [Promise]) -> Vec<&'p Promise> {
        let most = match fit.terms.is_empty() {
            true => self.options.first_additions,
            false => self.options.additions,
        };

        let dof = |p: &Promise| self.problem.body.candidates[p.candidate].dof();
        let worth = |p: &&Promise| p.instead.is_none() && p.gain > self.options.least_gain;
        let all: Vec<&Promise> = promises.iter().filter(worth).collect();
        let (first, others) = all.split_at(self.options.foremost.min(all.len()));
        let mut chosen = first.to_vec();
        let mut left = Vec::new();
        for p in others {
            if chosen.iter().all(|c| dof(c) != dof(p)) {
                chosen.push(p);
            } else {
                left.push(*p);
            }
        }
        chosen.extend(left);
        chosen.truncate(most);
        chosen
    }

    fn expand(&mut self, fit: Fit) {
        let fit = &self.sharpened(fit);
        self.expanded.insert(fit.terms.clone());
        let promises = self.problem.promises(fit);
        let mut jobs: Vec<Job> = Vec::new();
        let mut add = |job: Job| {
            if !self.models.contains_key(&job.0) {
                jobs.push(job);
            }
        };
        for p in self.proposed(fit, &promises) {
            let (terms, point) = self.problem.with(fit, p.candidate, &p.numbers);
            add((terms, point, fit.cells.clone()));
        }
        let tables = self
            .problem
            .tables(fit, &self.followed_by_laws())
            .into_iter();
        for p in tables
            .filter(|p| p.gain > self.options.least_gain)
            .take(self.options.tables)
        {
            let nothing = vec![0.0; self.problem.body.candidates[p.candidate].scales.len()];
            let (terms, point) = self.problem.with(fit, p.candidate, &nothing);
            add((terms, point, p.cells));
        }
        for member in 0..fit.terms.len() {
            let (terms, point) = self.problem.without(fit, member);
            add((terms.clone(), point.clone(), fit.cells.clone()));
            let instead: Vec<&Promise> = promises
                .iter()
                .filter(|p| p.instead == Some(member))
                .collect();
            for p in instead
                .into_iter()
                .filter(|p| p.gain > self.options.least_gain)
                .take(self.options.exchanges)
            {
                let smaller = Fit {
                    terms: terms.clone(),
                    point: point.clone(),
                    ..fit.clone()
                };
                let (terms, point) = self.problem.with(&smaller, p.candidate, &p.numbers);
                add((terms, point, fit.cells.clone()));
            }
            // A force along a covariate may be a known law that is only nearly the library's: both at once, for the law
            // alone may be worse by far than the force.
            let mut laws = self.problem.nearly(fit.terms[member]);
            laws.retain(|(effect, _)| !fit.terms.contains(effect));
            let place = |effect: &usize| {
                let mut of = promises.iter().filter(|p| p.instead == Some(member));
                of.position(|p| p.candidate == *effect)
            };
            laws.sort_by_key(|(effect, _)| place(effect).unwrap_or(usize::MAX));
            for (effect, trend) in laws.into_iter().take(self.options.laws) {
                let promised = promises
                    .iter()
                    .find(|p| p.instead == Some(member) && p.candidate == effect);
                let start = self.problem.body.candidates[effect].starts.first();
                let Some(numbers) = promised.map(|p| &p.numbers).or(start) else {
                    continue;
                };
                let mut made = Fit {
                    terms: terms.clone(),
                    point: point.clone(),
                    ..fit.clone()
                };
                let nothing = vec![0.0; self.problem.body.candidates[trend].scales.len()];
                for (candidate, numbers) in [(effect, numbers), (trend, &nothing)] {
                    (made.terms, made.point) = self.problem.with(&made, candidate, numbers);
                }
                add((made.terms, made.point, fit.cells.clone()));
            }
        }
        self.fit(jobs, Effort::default());
    }

    /// DOFs in which only known laws are asked: a table follows any motion, and what nobody commanded and only a table follows
    /// is an input. Where nothing at all was commanded every DOF is explained as well as it can be.
    fn followed_by_laws(&self) -> [bool; 6] {
        let may = self.options.may_give_up;
        let commanded = self.problem.body.dofs.iter().any(|d| !may[*d]);
        may.map(|may| may && commanded)
    }

    /// DOFs that the best model does not follow, of those that may be given up; none where nothing would be left to explain.
    fn not_followed(&self) -> Vec<usize> {
        let Some(best) = self.best() else {
            return Vec::new();
        };
        let Problem { body, noises, .. } = &self.problem;
        let far = |d: &usize| {
            let channel = if noises.channels[*d].is_some() {
                *d
            } else {
                6 + *d
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
            (self.progress)(&match fit.terms.len() {
                0 => "beside the vehicle alone".to_owned(),
                _ => format!("beside {}", self.names(&fit).join(" + ")),
            });
            let before = self.best().map_or(f64::INFINITY, |b| b.ln_score);
            self.expand(fit);
            // Beside a model that misses so much the instruments looked worse than they are.
            let gained = self.best().map_or(0.0, |b| b.ln_score - before);
            if gained > self.options.renewed_after && self.renew_noise(true) {
                self.rescore();
            }
        }
    }

    /// Noise beside the best model; whether it changed by so much that scores have to be taken again.
    ///
    /// What a model on the way misses is in what it leaves: with `only_less` no channel's noise becomes larger by it.
    fn renew_noise(&mut self, only_less: bool) -> bool {
        let Some(best) = self.best().cloned() else {
            return false;
        };
        let Some(predicted) = self.problem.closest(&best.terms, &best.point) else {
            return false;
        };
        let mut noises = estimate(&self.problem.body, &predicted, Some(&self.problem.noises));
        if only_less {
            noises.no_larger_than(&self.problem.noises);
        }
        let pairs = noises.channels.iter().zip(&self.problem.noises.channels);
        let change = pairs
            .filter_map(|(a, b)| Some((a.as_ref()?.total_sd() / b.as_ref()?.total_sd()).ln().abs()))
            .fold(0.0, f64::max);
        let rejected = noises.used != self.problem.noises.used;
        if change < self.options.noise_change && !rejected {
            return false;
        }
        tracing::debug!(
            "noise {:?}",
            noises.channels.iter().flatten().collect::<Vec<_>>()
        );
        // On the samples that count now the new noise must not make the model less likely by more than that: noise that is
        // estimated of a residual by itself sometimes does.
        let before = self.problem.noises.clone();
        let kept = Noises {
            channels: before.channels,
            used: noises.used.clone(),
        };
        let [old, new] = [kept, noises].map(|noises| {
            self.problem.noises = noises;
            self.problem
                .fit(
                    &best.terms,
                    &best.point,
                    best.cells.clone(),
                    Effort::default(),
                )
                .map(|f| (f.ln_score, self.problem.noises.clone()))
        });
        let Some((score, noises)) = new else {
            self.problem.noises = before;
            return false;
        };
        let worse = old.filter(|(before, _)| *before > score + self.options.noise_gain);
        let is_worse = worse.is_some();
        self.problem.noises = worse.map_or(noises, |w| w.1);
        !is_worse || rejected
    }

    /// Scores of the models at the front under the present noise; the others are dropped.
    fn rescore(&mut self) {
        let Some(floor) = self.best().map(|b| b.ln_score - 3.0 * self.options.window) else {
            return;
        };
        let mut kept: Vec<Fit> = std::mem::take(&mut self.models).into_values().collect();
        kept.sort_by(|a, b| b.ln_score.total_cmp(&a.ln_score));
        let jobs = kept
            .into_iter()
            .enumerate()
            .filter(|(k, f)| {
                *k < self.options.rescored && f.ln_score >= floor || f.terms.is_empty()
            })
            .map(|(_, f)| f)
            .map(|f| (f.terms, f.point, f.cells))
            .collect();
        self.expanded.clear();
        self.fit(jobs, Effort::default());
    }
}

/// Searches the models of a problem.
///
/// `None` when the vehicle alone gives no finite motion from the rig's numbers.
pub fn search(
    problem: Problem,
    options: Options,
    progress: &(dyn Fn(&str) + Sync),
) -> Option<Found> {
    let mut search = Search {
        problem,
        models: BTreeMap::new(),
        expanded: BTreeSet::new(),
        fits: 0,
        cost: 0,
        options,
        progress,
    };
    search.alone();
    search.best()?;
    if search.renew_noise(false) {
        search.rescore();
    }
    search.run();
    for _ in 0..options.noise_rounds {
        if search.gives_up() || !search.renew_noise(false) {
            break;
        }
        search.rescore();
        search.options.cost = search.cost + options.cost / 3;
        search.run();
    }
    Some(Found {
        given_up: search.not_followed(),
        problem: search.problem,
        models: search.models,
        fits: search.fits,
    })
}

/// Searches about a model that is known: the noise stays as it is, and nothing else is asked first.
pub fn about(problem: Problem, from: &Fit, options: Options) -> Found {
    let found = Found {
        problem,
        models: BTreeMap::from([(from.terms.clone(), from.clone())]),
        fits: 0,
        given_up: Vec::new(),
    };
    resumed(found, BTreeSet::new(), options, &|_| {})
}

/// Goes on from models that joined a search, beside what was expanded; `expanded` = what was there before.
pub(super) fn resumed(
    found: Found,
    expanded: BTreeSet<Vec<usize>>,
    options: Options,
    progress: &(dyn Fn(&str) + Sync),
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
        progress,
    };
    search.run();
    Found {
        given_up: search.not_followed(),
        problem: search.problem,
        models: search.models,
        fits: search.fits,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::posterior::Posterior;
    use crate::prior::PriorTable;
    use crate::recording::Recording;
    use crate::testing::{Tank, entry};
    use hydroline_rigs::{PhysicsEntry, Rig};
    use std::time::Instant;

    fn cases() -> Vec<(&'static str, Vec<usize>, Vec<PhysicsEntry>)> {
        let lag = |dof: &str| vec![entry("thruster_lag", &[("lag_s", 0.25)], &[("dof", dof)])];
        let cross = |dof: &str, a: &str, b: &str, c: f64| {
            vec![entry(
                "cross_flow_coupling",
                &[("c", c)],
                &[("dof", dof), ("a", a), ("b", b)],
            )]
        };
        vec![
            ("surge-nothing", vec![0], vec![]),
            ("surge-lag", vec![0], lag("surge")),
            ("planar-nothing", vec![0, 1, 5], vec![]),
            ("planar-lag-yaw", vec![0, 1, 5], lag("yaw")),
            (
                "planar-current",
                vec![0, 1, 5],
                vec![entry(
                    "current",
                    &[("vx_mps", -0.012), ("vy_mps", 0.008)],
                    &[],
                )],
            ),
            ("planar-cross", vec![0, 1, 5], cross("yaw", "u", "r", -8.0)),
            (
                "planar-latency",
                vec![0, 1, 5],
                vec![entry("command_latency", &[("delay_s", 0.1)], &[])],
            ),
            (
                "surge-pitch",
                vec![0],
                vec![entry(
                    "thrust_line_offset",
                    &[("lever_m", 0.02)],
                    &[("axis", "pitch")],
                )],
            ),
            ("surge-bump", vec![0], vec![bump()]),
            (
                "surge-two",
                vec![0],
                vec![
                    entry("thruster_lag", &[("lag_s", 0.2)], &[("dof", "surge")]),
                    entry("constant_force", &[("bias_n", 0.2)], &[("dof", "surge")]),
                ],
            ),
        ]
    }

    /// Short runs, so that every day has its share; `a_few_cases` has more.
    fn short(driven: &[usize], effects: Vec<PhysicsEntry>, seed: u64) -> (Found, Posterior) {
        let tank = Tank {
            seconds: 12.0,
            hz: 12.5,
            ..Tank::new(driven, effects)
        };
        let runs = tank.runs(3, seed);
        let dofs = Recording::new(&runs, 0.1).moving(&tank.rig.tolerance.channels());
        let problem = Problem::new(&runs, &tank.rig, &dofs, PriorTable::default()).unwrap();
        let found = search(problem, Options::default(), &|_| {}).unwrap();
        let posterior = Posterior::new(&found);
        (found, posterior)
    }

    fn probability(found: &Found, posterior: &Posterior, name: &str) -> f64 {
        let body = &found.problem.body;
        let of = posterior
            .effects
            .iter()
            .find(|e| body.candidates[e.candidate].name() == name);
        of.map_or(0.0, |e| e.probability)
    }

    #[test]
    fn nothing_left_out_is_nothing_found() {
        for driven in [&[0][..], &[0, 1, 5]] {
            let (_, posterior) = short(driven, vec![], 3);
            let nothing = posterior.models.iter().find(|m| m.0.is_empty()).unwrap();
            assert!(nothing.1 > 0.5, "{posterior:?}");
            assert!(
                posterior.effects.iter().all(|e| e.probability < 0.5),
                "{posterior:?}"
            );
            assert!(posterior.unnamed.iter().all(|u| u.1 < 0.1), "{posterior:?}");
        }
    }

    /// A lag in yaw alone, while surge and sway are driven as well, gave no verdict in ten minutes.
    #[test]
    fn a_lag_of_one_dof_of_three_is_named_there() {
        let lag = entry("thruster_lag", &[("lag_s", 0.25)], &[("dof", "yaw")]);
        let (found, posterior) = short(&[0, 1, 5], vec![lag], 4);
        assert!(
            probability(&found, &posterior, "thruster_lag yaw") > 0.95,
            "{posterior:?}"
        );
        let best = &found.models[&posterior.models[0].0];
        let body = &found.problem.body;
        let member = best
            .terms
            .iter()
            .position(|t| body.candidates[*t].name() == "thruster_lag yaw")
            .unwrap();
        let at = body.places(&best.terms)[member];
        let (lag_s, slope) = body.natural(&best.terms, &best.point)[at];
        let sd = slope * best.covariance[(at, at)].sqrt();
        assert!((lag_s - 0.25).abs() < 4.0 * sd && sd < 0.01, "{lag_s} {sd}");
    }

    /// Surge runs that pitch, which no command asks for, were taken for complete.
    #[test]
    fn a_dof_that_nobody_commanded_is_looked_at() {
        let offset = entry(
            "thrust_line_offset",
            &[("lever_m", 0.03)],
            &[("axis", "pitch")],
        );
        let (found, posterior) = short(&[0], vec![offset], 5);
        assert!(found.problem.body.dofs.contains(&4));
        assert!(
            probability(&found, &posterior, "thrust_line_offset pitch") > 0.95,
            "{posterior:?}"
        );
    }

    /// A force that no effect of the library is, at one place of the tank.
    fn bump() -> PhysicsEntry {
        let points: Vec<(String, f64)> = (0..40)
            .map(|k| {
                let x_m = -1.0 + 2.0 * f64::from(k) / 39.0;
                let force_n = 1.2 * (-((x_m - 0.2) / 0.1_f64).powi(2)).exp();
                (format!("f{:02}_n", k + 1), force_n)
            })
            .collect();
        let mut numbers: Vec<(&str, f64)> = vec![("from", -1.0), ("to", 1.0)];
        numbers.extend(points.iter().map(|(n, v)| (n.as_str(), *v)));
        entry("free_force", &numbers, &[("dof", "surge"), ("along", "x")])
    }

    /// Such a force was explained by whatever came nearest.
    #[test]
    fn a_force_without_a_name_is_a_table_and_no_effect() {
        let (found, posterior) = short(&[0], vec![bump()], 6);
        let table = probability(&found, &posterior, "free_force surge x");
        assert!(table > 0.9, "{posterior:?}");
    }

    /// What a search finds, for eyes.
    fn told(problem: Problem, begun: Instant) {
        for d in &problem.body.dofs {
            println!(
                "   {d} {:?} {:?}",
                problem.noises.channels[*d], problem.body.responses[*d]
            );
        }
        let found = search(problem, Options::default(), &|what| {
            println!("   {:.1} s {what}", begun.elapsed().as_secs_f64());
        })
        .unwrap();
        let body = &found.problem.body;
        let dofs = &body.dofs;
        let posterior = Posterior::new(&found);
        println!(
            "   {} fits, {:.1} s",
            found.fits,
            begun.elapsed().as_secs_f64()
        );
        for (terms, p) in posterior.models.iter().take(6) {
            let fit = &found.models[terms];
            let names: Vec<String> = terms.iter().map(|t| body.candidates[*t].name()).collect();
            let places = body.places(terms);
            let natural = body.natural(terms, &fit.point);
            let numbers: Vec<String> = natural[places[0]..places[terms.len()]]
                .iter()
                .zip(places[0]..)
                .map(|(v, i)| {
                    format!(
                        "{:.4}±{:.4}",
                        v.0,
                        v.1.abs() * fit.covariance[(i, i)].sqrt()
                    )
                })
                .collect();
            let cells: Vec<_> = dofs
                .iter()
                .map(|d| (fit.cells.misfit[*d].size, fit.cells.misfit[*d].correlation))
                .collect();
            println!(
                "   p {p:.4} {:.2} {names:?} {numbers:?} {cells:?}",
                fit.ln_score
            );
        }
        for e in posterior.effects.iter().take(8) {
            println!(
                "   {:.4} {}",
                e.probability,
                body.candidates[e.candidate].name()
            );
        }
        let best = &found.models[&posterior.models[0].0];
        let natural = body.natural(&best.terms, &best.point);
        for (i, own) in body.own.iter().enumerate() {
            let ratio = best.point[i].exp();
            println!(
                "   {} {:.4} = {ratio:.3} of the rig's, ±{:.3}",
                own.name(),
                natural[i].0,
                best.covariance[(i, i)].sqrt()
            );
        }
        let short = |r: [f64; 12]| -> Vec<String> {
            r.iter()
                .filter(|v| v.is_finite())
                .map(|v| format!("{v:.2e}"))
                .collect()
        };
        println!(
            "   alone {:?}",
            short(found.problem.left(&[], &found.models[&Vec::new()].point))
        );
        println!(
            "   best  {:?}",
            short(found.problem.left(&best.terms, &best.point))
        );
        for (t, w) in best.terms.iter().zip(found.problem.weights(best)) {
            println!("   weight {} {:?}", body.candidates[*t].name(), short(w));
        }
        println!("   unnamed {:?}", posterior.unnamed);
        for d in dofs {
            println!(
                "   noise {d} {:?} {:?}",
                found.problem.noises.channels[*d],
                found.problem.noises.channels[6 + *d]
            );
        }
    }

    /// `RIG=rig.toml LOGS="a.mcap b.mcap" cargo test -p hydroline-inference --lib of_logs -- --ignored --nocapture`
    #[test]
    #[ignore]
    fn of_logs() {
        let rig = std::env::var("RIG").unwrap_or_else(|_| "lshpi".to_owned());
        let rig = Rig::load_or_builtin(&rig).unwrap();
        let logs = std::env::var("LOGS").unwrap();
        let runs: Vec<_> = logs
            .split_whitespace()
            .map(|l| hydroline_identify::data::load(std::path::Path::new(l), &rig).unwrap())
            .collect();
        let begun = Instant::now();
        let dofs = Recording::new(&runs, 0.0).moving(&rig.tolerance.channels());
        println!("== {logs} dofs {dofs:?}");
        told(
            Problem::new(&runs, &rig, &dofs, PriorTable::default()).unwrap(),
            begun,
        );
    }

    /// `CASE=name SEED=n cargo test -p hydroline-inference --lib a_few -- --ignored --nocapture`
    #[test]
    #[ignore]
    fn a_few_cases() {
        let one = std::env::var("CASE").unwrap_or_default();
        let seed: u64 = std::env::var("SEED")
            .ok()
            .and_then(|s| s.parse().ok())
            .unwrap_or(1);
        for (name, driven, effects) in cases() {
            if !name.contains(&one) {
                continue;
            }
            let tank = Tank::new(&driven, effects);
            let runs = tank.runs(4, seed);
            let begun = Instant::now();
            let recording = Recording::new(&runs, 0.1);
            let dofs = recording.moving(&tank.rig.tolerance.channels());
            let problem = Problem::new(&runs, &tank.rig, &dofs, PriorTable::default()).unwrap();
            println!(
                "== {name} dofs {dofs:?}, noise at {:.1} s",
                begun.elapsed().as_secs_f64()
            );
            told(problem, begun);
        }
    }
}
