//! The ideal observer: the Bayes-optimal choice at the true noise.
//!
//! Same runs, same candidates, same priors and evidence as the diagnosis, but it is given the noise (its law fitted to the
//! noise itself, and which samples are outliers) and starts from the truth: it only asks whether a model near the truth is
//! likelier, and goes on from a better one. What it gets wrong, the data do not hold.
//!
//! Of a law near the library's it is asked whether it can be seen at all that the law is another one: it knows that law,
//! and takes it where it is likelier than the best model of the library.

use hydroline_core::run::{Channel, PerChannel, Run};
use hydroline_inference::fit::{Effort, Fit, Problem};
use hydroline_inference::hyper::{Cell, Cells};
use hydroline_inference::prior::PriorTable;
use hydroline_inference::search::{Found, Options, about};
use hydroline_inference::term::{Candidate, Kind};
use hydroline_numerics::noise::{Series, estimate};
use hydroline_numerics::parallel;
use hydroline_rigs::{ParameterValue, PhysicsEntry};

use super::case::{Case, UNNAMED_ID};

/// The only DOF that moves in these cases.
const SURGE: usize = 0;
/// Largest cost of its choice, in passes: it begins at the truth.
const COST: usize = 60;
/// Log evidence that one more number of a law costs: its range over its sd is some twenty.
const ONE_MORE: f64 = 3.0;
/// Standard deviations of what the noise itself gains by chance over a fit of its own law.
const CHANCE: f64 = 2.0;
/// Under next to no random force: there is none but where a law is not the library's.
const QUIET: Cell = Cell {
    size: 1,
    correlation: 1,
};
/// One that forgives a third of the tolerance.
const FORGIVING: Cell = Cell {
    size: 5,
    correlation: 2,
};

/// Models of the library alone: what has no name it does not ask for.
fn options() -> Options {
    Options {
        tables: 0,
        laws: 0,
        cost: COST,
        ..Options::default()
    }
}

/// The observer of one case.
pub struct Ideal {
    truth: Fit,
    found: Found,
}

/// The problem of the runs fitted, with the noise that is there.
fn problem(case: &Case) -> Option<Problem> {
    let runs: Vec<Run> = case.sealed.sources.iter().map(|s| s.run.clone()).collect();
    let mut made = Problem::new(&runs, &case.sealed.rig, &[SURGE], PriorTable::default()).ok()?;
    let recorded = &made.body.recording.runs;
    let aligned = recorded.iter().zip(&case.key.runs);
    let aligned = aligned.fold(true, |all, (r, k)| {
        all && r.times_s.len() == k.noise_m.len()
    });
    if recorded.len() != case.key.runs.len() || !aligned {
        return None;
    }
    let series: Vec<Series<'_>> = recorded
        .iter()
        .zip(&case.key.runs)
        .map(|(r, k)| Series {
            times_s: &r.times_s,
            values: &k.noise_m,
            jacobian: None,
        })
        .collect();
    let (noise, _) = estimate(&series)?;
    made.noises.channels[Channel::X] = Some(noise);
    for (used, k) in made.noises.used.iter_mut().zip(&case.key.runs) {
        for (sample, outlier) in used.iter_mut().zip(&k.outlier) {
            sample[Channel::X] = !outlier;
        }
    }
    Some(made)
}

/// The candidate that an entry of a rig file is, and its numbers.
fn candidate(problem: &Problem, entry: &PhysicsEntry) -> Option<(usize, Vec<f64>)> {
    let said = |c: &Candidate| {
        entry.parameters.iter().all(|(name, value)| match value {
            ParameterValue::Word(w) => c.word(name) == Some(w.as_str()),
            ParameterValue::Number(_) => true,
        })
    };
    let all = &problem.body.candidates;
    let is = |c: &Candidate| c.kind == Kind::Effect && c.info.id == entry.effect && said(c);
    let place = all.iter().position(is)?;
    let given = super::magnitudes::numbers(entry);
    let numbers = all[place].parameters.iter().map(|p| {
        let own = given.iter().find(|(n, _)| n == p.name).map(|(_, v)| *v);
        own.or(p.absent).unwrap_or(p.typical)
    });
    Some((place, numbers.collect()))
}

/// The vehicle that is there, without effects, as a point to begin from.
fn bare(problem: &Problem, case: &Case) -> Fit {
    let mut point = problem.body.begin();
    for (own, v) in problem.body.own.iter().zip(&mut point) {
        let there = own.coefficient();
        let there = there.map(|c| c.of_vehicle(&case.key.tank.vehicle));
        *v = there.and_then(|value| own.scaled(value)).unwrap_or(*v);
    }
    Fit::begin(point, Cells::of([QUIET; 6]))
}

impl Ideal {
    /// Tells it the noise and the truth; `None` where the truth is no model of the library or its fit diverges. A law
    /// near the library's stands as the library's, fitted.
    pub fn new(case: &Case) -> Option<Ideal> {
        let near = case.key.truth.iter().find(|t| !t.exact).map(|t| &t.effect);
        if near.is_some_and(|n| n == UNNAMED_ID) {
            return None;
        }
        let problem = problem(case)?;
        let mut from = bare(&problem, case);
        for entry in &case.key.tank.entries {
            let (place, numbers) = candidate(&problem, entry)?;
            (from.terms, from.point) = problem.with(&from, place, &numbers);
        }
        let mut ways = vec![from];
        if let Some(near) = near {
            let all = &problem.body.candidates;
            let place = all.iter().position(|c| c.info.id == *near)?;
            let with = |start: &Vec<f64>| {
                let mut made = ways[0].clone();
                (made.terms, made.point) = problem.with(&made, place, start);
                made
            };
            ways = all[place].starts.iter().map(with).collect();
        }
        // Where a run begins is not given: a rate there that its first samples get wrong leads a fit under small forces away
        // from the truth, and a larger one forgives it.
        let begins = || [QUIET, FORGIVING].into_iter();
        let each = ways.iter().flat_map(|w| begins().map(move |c| (w, c)));
        let each: Vec<(&Fit, Cell)> = each.collect();
        let fits = parallel::map_slice(&each, |(w, cell)| fitted_under(&problem, w, *cell));
        let fits = fits.into_iter().flatten();
        let truth = fits.max_by(|a, b| a.ln_score.total_cmp(&b.ln_score))?;
        Some(Ideal {
            found: about(problem, &truth, options()),
            truth,
        })
    }

    fn best(&self) -> &Fit {
        let models = self.found.models.values();
        models
            .max_by(|a, b| a.ln_score.total_cmp(&b.ln_score))
            .unwrap_or(&self.truth)
    }

    /// Its choice: (effect, weight \[m\]), heaviest first.
    pub fn choice(&self) -> Vec<(String, f64)> {
        let best = self.best();
        let problem = &self.found.problem;
        let each = best.terms.iter().zip(problem.weights(best));
        let mut found: Vec<(String, f64)> = each
            .map(|(t, w)| {
                (
                    problem.body.candidates[*t].info.id.to_owned(),
                    w[Channel::X],
                )
            })
            .collect();
        found.sort_by(|a, b| b.1.total_cmp(&a.1));
        found
    }

    /// Whether it would take the law that is near the library's for another one than that: its likelihood is that of the
    /// noise itself, with one number more than the library's.
    pub fn sees_another_law(&self, case: &Case) -> bool {
        let (gain, sd) = self.gain_of_the_noise(case);
        let law = self.truth.ln_evidence + gain;
        let top = self.best().ln_evidence;
        tracing::debug!(
            "the other law gains {:.1} over the best model, by chance {sd:.1}",
            law - top
        );
        law > top + CHANCE * sd
    }

    /// Log evidence by which a law whose motion leaves the noise itself beats the truth as it was fitted, and the standard
    /// deviation of that where the truth is the law: half a chi-square of as many degrees as numbers were fitted.
    fn gain_of_the_noise(&self, case: &Case) -> (f64, f64) {
        let problem = &self.found.problem;
        let recorded = problem.body.recording.runs.iter().zip(&case.key.runs);
        let motion: Vec<Vec<PerChannel<f64>>> = recorded
            .map(|(r, k)| {
                let each = k.noise_m.iter().enumerate().map(|(i, noise)| {
                    let mut there = r.measured(i);
                    there[Channel::X] -= noise;
                    there
                });
                each.collect()
            })
            .collect();
        // At its minimum a fit leaves half its numbers less than the noise, those that no prior holds.
        let number_prior = problem.number_prior(&self.truth.terms);
        let densities = number_prior
            .densities
            .iter()
            .zip(&self.truth.point)
            .enumerate();
        let by_priors: f64 = densities
            .map(|(i, (d, v))| (self.truth.covariance[(i, i)] * d.step(*v).1).min(1.0))
            .sum();
        let numbers = self.truth.point.len() as f64 - by_priors + 1.0;
        // Both under random forces of any size: what is left may be no more than what the noise's law lacks.
        let fitted = problem.predicted(&self.truth.terms, &self.truth.point);
        let gain = problem.cost_of(&fitted) - problem.cost_of(&motion) + 0.5 * numbers - ONE_MORE;
        (gain, (0.5 * numbers).sqrt())
    }

    /// rms of the run held out under its choice \[m\].
    pub fn held_out(&self, case: &Case) -> Option<f64> {
        let last = case.sealed.held.last()?.run.clone();
        let best = self.best();
        let problem = &self.found.problem;
        let over = problem.over(&[last], &case.sealed.rig).ok()?;
        let over = over.without_outliers(best);
        Some(over.left_of(&over.predict(best)?.values)[Channel::X])
    }

    /// Log evidence by which the truth beats the same model without some of its effects; `None` where one of them is not
    /// there, or where what is left could not be fitted.
    pub fn worth(&self, missing: &[&str]) -> Option<f64> {
        let less = fitted(&self.found.problem, &self.lacking(missing)?)?;
        let worth = self.truth.ln_evidence - less.ln_evidence;
        tracing::debug!("without {}: {worth:.2} less", missing.join(", "));
        Some(worth)
    }

    /// The truth without some of its effects, where the others stand; `None` where one of them is not there.
    fn lacking(&self, missing: &[&str]) -> Option<Fit> {
        let problem = &self.found.problem;
        let mut rest = self.truth.clone();
        for id in missing {
            let held = |c: &usize| problem.body.candidates[*c].info.id == *id;
            let member = rest.terms.iter().position(held)?;
            (rest.terms, rest.point) = problem.without(&rest, member);
        }
        Some(rest)
    }

    /// Log evidence by which the truth beats the same model with `wrong` in the place of `missing`: infinite where that one,
    /// fitted there, is worth no more than nothing; none where that is no question or it could not be fitted.
    pub fn gap(&self, missing: &str, wrong: &str) -> Option<f64> {
        let problem = &self.found.problem;
        let all = &problem.body.candidates;
        let is = |c: &Candidate| c.kind == Kind::Effect && c.info.id == wrong;
        let place = all.iter().position(is)?;
        let from = self.lacking(&[missing])?;
        if self.truth.terms.contains(&place) {
            return None;
        }
        // From the true numbers and from those that the others have without it.
        let less = fitted(problem, &from);
        let jobs: Vec<Fit> = [Some(&from), less.as_ref()]
            .into_iter()
            .flatten()
            .flat_map(|rest| {
                all[place].starts.iter().map(move |start| {
                    let mut made = rest.clone();
                    (made.terms, made.point) = problem.with(rest, place, start);
                    made
                })
            })
            .collect();
        let other = parallel::map_slice(&jobs, |j| fitted(problem, j));
        let other: Vec<Fit> = other.into_iter().flatten().collect();
        // One that does nothing there stands for nothing.
        let does = |f: &&Fit| less.as_ref().is_none_or(|l| f.ln_evidence > l.ln_evidence);
        let gap = other
            .iter()
            .filter(does)
            .map(|o| self.truth.ln_evidence - o.ln_evidence)
            .fold(f64::INFINITY, f64::min);
        tracing::debug!("{wrong} for {missing}: {gap:.2} less");
        (!other.is_empty()).then_some(gap)
    }
}

/// A model fitted from where it stands, under small random forces first.
fn fitted(problem: &Problem, from: &Fit) -> Option<Fit> {
    fitted_under(problem, from, QUIET)
}

/// The same under these first.
fn fitted_under(problem: &Problem, from: &Fit, cell: Cell) -> Option<Fit> {
    let effort = Effort {
        as_given: true,
        ..Effort::DEFAULT
    };
    let made = problem.fit(&from.terms, &from.point, Cells::of([cell; 6]), effort)?;
    made.ln_evidence.is_finite().then_some(made)
}

#[cfg(test)]
mod tests {
    use super::super::case::{Category, make};
    use super::*;

    /// The measure of a law that is another one, of cases whose laws are the library's: the noise itself gains no more
    /// over the truth as it was fitted than chance gives. It gained 60 where a rate at the start had led the fit astray.
    #[test]
    fn where_the_laws_are_the_vocabularys_the_noise_itself_gains_nothing() {
        for index in [1, 3] {
            let case = make(811, Category::Single, index).unwrap();
            assert!(case.key.truth.iter().all(|t| t.exact));
            let (gain, sd) = Ideal::new(&case).unwrap().gain_of_the_noise(&case);
            assert!(gain < CHANCE * sd, "{index}: {gain:.1}, by chance {sd:.1}");
        }
    }
}
