//! Where the vehicle alone misses, and the test that it does.

mod windows;

use std::collections::{BTreeMap, BTreeSet};

use hydroline_inference::fit::Fit;
use hydroline_inference::hyper::{Cell as ForceCell, Cells};
use hydroline_inference::term::Kind;
use hydroline_numerics::statistics::chi2_above;
use hydroline_rigs::Dof;

use super::earned::worst;
use super::found::{Judged, relative};
use crate::verdict::{Test, Where};
use windows::{Cell, Windows, cells, merge};

/// Misfit of a model, over all DOFs.
#[derive(Debug, Default)]
struct Misfit {
    /// DOFs in which it is more than noise.
    dof: Vec<String>,
    /// Windows by run \[s\].
    windows: BTreeMap<String, Vec<[f64; 2]>>,
    /// DOF by DOF in words.
    words: Vec<String>,
    /// Those of them that speak of a small part of the time.
    events: Vec<String>,
}

impl Judged<'_> {
    /// Stage, DOFs and windows.
    pub fn place(&self) -> Where {
        let body = &self.found.problem.body;
        let heaviest = self.weights.get(&self.best.terms).and_then(|w| {
            let each = self.best.terms.iter().zip(w);
            each.max_by(|a, b| {
                relative(a.1, &body.tolerance).total_cmp(&relative(b.1, &body.tolerance))
            })
        });
        let alone = self.misfit(&self.alone);
        let left = match self.best.terms.is_empty() {
            true => Misfit::default(),
            false => self.misfit(self.best),
        };
        let first = body.recording.runs.first();
        let first = first.and_then(|r| alone.windows.get(&r.name));
        let mut regime = match alone.words.is_empty() {
            true => "nowhere beyond the noise".to_owned(),
            false => alone.words.join("; "),
        };
        if !left.words.is_empty() {
            regime += &format!("; what the effects leave: {}", left.words.join("; "));
        }
        Where {
            stage: heaviest.map(|h| body.candidates[*h.0].info.stage.name().to_owned()),
            windows_s: first.cloned().unwrap_or_default(),
            regime,
            dof: alone.dof,
            windows: alone.windows,
            left_windows: left.windows,
        }
    }

    /// Remark on what the likeliest model leaves where most of it lies in a small part of the time: something happened there.
    pub fn events(&self) -> Vec<String> {
        let events = self.misfit(self.best).events.into_iter();
        events
            .map(|words| {
                format!(
                    "most of what the model leaves lies in a small part of the time, {words}: did something happen there that no command says (a stop, a touch, a cable)?"
                )
            })
            .collect()
    }

    /// Windows in which a model misses, of all DOFs and runs.
    fn misfit(&self, fit: &Fit) -> Misfit {
        let problem = &self.found.problem;
        let runs = &problem.body.recording.runs;
        let mut made = Misfit::default();
        for (d, white) in problem.innovations(&fit.terms, &fit.point) {
            let both = runs.iter().zip(&white).enumerate();
            let cells: Vec<Cell> = both
                .flat_map(|(run, (r, white))| cells(run, &r.times_s, white))
                .collect();
            let name = Dof::ALL[d].name();
            let Some(found) = Windows::of(&cells) else {
                continue;
            };
            made.dof.push(name.to_owned());
            for w in &found.all {
                let of_run = made.windows.entry(runs[w.run].name.clone()).or_default();
                merge(of_run, w.span_s);
            }
            let words = found.words(name, |run| runs[run].name.as_str());
            if found.is_event() {
                made.events.push(words.clone());
            }
            made.words.push(words);
        }
        made
    }

    /// Whether the vehicle alone passes as noise.
    pub fn test(&self) -> Test {
        let problem = &self.found.problem;
        let (mut value, mut count) = (0.0, 0usize);
        for (_, runs) in problem.innovations(&[], &self.alone.point) {
            for pair in runs.iter().flatten() {
                for v in pair.iter().filter(|v| **v != 0.0) {
                    value += v * v;
                    count += 1;
                }
            }
        }
        let freedom = (count as f64 - self.alone.point.len() as f64).max(1.0);
        let runs = problem.body.recording.runs.len();
        let whiteness = (0..runs).map(|run| {
            let of_run: Vec<Option<f64>> = self.left.iter().map(|l| l.white_p[run]).collect();
            worst(&of_run)
        });
        Test {
            statistic: "chi-square of the vehicle alone, refitted: squared innovations under the instruments' noise".to_owned(),
            value,
            freedom,
            p_value: chi2_above(value, freedom),
            whiteness_p: whiteness.collect(),
            noise_rms: self.noise().by_name(),
        }
    }

    /// Candidates that say too little beside the vehicle alone and beside the laws of the likeliest model alike. Tables, trends,
    /// forms and random forces are left out of both: they take any law's share, and what they take these runs do show.
    fn unseen(&self) -> Vec<usize> {
        let problem = &self.found.problem;
        let laws_of = |fit: &Fit| {
            let mut made = fit.clone();
            for member in (0..made.terms.len()).rev() {
                if problem.body.candidates[made.terms[member]].kind != Kind::Effect {
                    (made.terms, made.point) = problem.without(&made, member);
                }
            }
            made.cells = Cells::of([ForceCell::default(); 6]);
            made
        };
        let beside_alone = problem.unseen(&laws_of(&self.alone));
        let laws = laws_of(self.best);
        if laws.terms.is_empty() {
            return beside_alone;
        }
        let beside_laws = problem.unseen(&laws);
        let both = |c: &usize| beside_laws.contains(c);
        beside_alone.into_iter().filter(both).collect()
    }

    /// Effects that these runs would not show: at their typical size they change nothing that the vehicle's own numbers
    /// could not. Each stands there once, with the DOFs in which it acts by name.
    pub fn blind_spots(&self) -> Vec<String> {
        let body = &self.found.problem.body;
        let mut spots: Vec<(String, BTreeSet<usize>)> = Vec::new();
        for c in self.unseen() {
            let id = self.id(c);
            if self.best.terms.iter().any(|t| self.id(*t) == id) {
                continue;
            }
            let dof = body.candidates[c].dof();
            match spots.iter_mut().find(|s| s.0 == id) {
                Some((_, dofs)) => dofs.extend(dof),
                None => spots.push((id, dof.into_iter().collect())),
            }
        }
        let named = |(id, dofs): (String, BTreeSet<usize>)| {
            let dofs: Vec<&str> = dofs.iter().map(|d| Dof::ALL[*d].name()).collect();
            match dofs.is_empty() {
                true => id,
                false => format!("{id} in {}", dofs.join(", ")),
            }
        };
        spots.into_iter().map(named).collect()
    }
}
