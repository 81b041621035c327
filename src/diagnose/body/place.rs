//! Where the vehicle alone misses, and the test that it does.

use std::collections::{BTreeMap, BTreeSet};

use hydroline_inference::fit::Fit;
use hydroline_inference::hyper::{Cell, Cells};
use hydroline_inference::term::Kind;
use hydroline_numerics::statistics::chi2_above;
use hydroline_rigs::Dof;

use super::earned::worst;
use super::found::{Judged, relative};
use crate::verdict::{Test, Where};

/// Length over which innovations are summed \[s\].
const WINDOW_S: f64 = 0.5;
/// Excess of their squares, in its sd, above which a window counts.
const BEYOND: f64 = 5.0;

impl Judged<'_> {
    /// Stage, DOFs and windows.
    pub fn place(&self) -> Where {
        let problem = &self.found.problem;
        let body = &problem.body;
        let heaviest = self.weights.get(&self.best.terms).and_then(|w| {
            let each = self.best.terms.iter().zip(w);
            each.max_by(|a, b| {
                relative(a.1, &body.tolerance).total_cmp(&relative(b.1, &body.tolerance))
            })
        });
        let mut windows: BTreeMap<String, Vec<[f64; 2]>> = BTreeMap::new();
        let mut dof: Vec<String> = Vec::new();
        for (d, runs) in problem.innovations(&[], &self.alone.point) {
            let mut any = false;
            for (run, white) in runs.iter().enumerate() {
                let r = &body.recording.runs[run];
                for window in high(&r.times_s, white) {
                    any = true;
                    merge(windows.entry(r.name.clone()).or_default(), window);
                }
            }
            if any {
                dof.push(Dof::ALL[d].name().to_owned());
            }
        }
        let first = body
            .recording
            .runs
            .first()
            .and_then(|r| windows.get(&r.name));
        Where {
            stage: heaviest.map(|h| body.candidates[*h.0].info.stage.name().to_owned()),
            windows_s: first.cloned().unwrap_or_default(),
            regime: if dof.is_empty() {
                "nowhere beyond the noise".to_owned()
            } else {
                format!("in {}", dof.join(", "))
            },
            dof,
            windows,
        }
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
            made.cells = Cells::of([Cell::default(); 6]);
            made
        };
        let beside_alone = problem.unseen(&laws_of(self.alone));
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

/// Windows in which innovations are larger than noise.
fn high(times_s: &[f64], white: &[[f64; 2]]) -> Vec<[f64; 2]> {
    let mut found = Vec::new();
    let mut first = 0;
    while first < times_s.len() {
        let from_s = times_s[first];
        let next = times_s
            .partition_point(|t| *t < from_s + WINDOW_S)
            .max(first + 1);
        let all = white[first..next].iter().flatten().filter(|v| **v != 0.0);
        let (energy, n) = all.fold((0.0, 0.0), |(e, n), v| (e + v * v, n + 1.0));
        if n > 0.0 && (energy - n) / (2.0_f64 * n).sqrt() > BEYOND {
            found.push([from_s, times_s[next - 1]]);
        }
        first = next;
    }
    found
}

fn merge(windows: &mut Vec<[f64; 2]>, new: [f64; 2]) {
    windows.push(new);
    windows.sort_by(|a, b| a[0].total_cmp(&b[0]));
    let mut joined: Vec<[f64; 2]> = Vec::new();
    for w in windows.drain(..) {
        match joined.last_mut().filter(|l| w[0] - l[1] < 2.0 * WINDOW_S) {
            Some(last) => last[1] = last[1].max(w[1]),
            None => joined.push(w),
        }
    }
    *windows = joined;
}
