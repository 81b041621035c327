//! Gain of two candidates at once: laws that need each other, of which either alone gains little.

use hydroline_numerics::{cancel, parallel};
use nalgebra::{Matrix2, Vector2};

use super::{Outside, Products, dot, minus};
use crate::fit::{Fit, Problem};
use crate::term::Kind;

/// Points to begin from of each candidate that are asked in pairs: the best of those alone.
const STARTS: usize = 2;
/// Squared correlation of two responses above which they are one.
const ALIKE: f64 = 0.999;

/// Two candidates beside a model.
#[derive(Debug, Clone, PartialEq)]
pub struct PredictedPair {
    /// (Place among the body's candidates, natural numbers to begin from) of both.
    pub members: [(usize, Vec<f64>); 2],
    /// Gain in log likelihood that the linear view gains with both.
    pub gain: f64,
    /// The same with the better one of them alone.
    pub better_alone: f64,
}

/// A response of one candidate.
struct Response {
    candidate: usize,
    start: usize,
    products: Products,
    outside: Outside,
    alone: f64,
}

impl Problem {
    /// Gains of pairs of effects beside a model, each pair at its best point; the largest first.
    pub fn predicted_pairs(&self, fit: &Fit) -> Vec<PredictedPair> {
        let here = self.predicted(&fit.terms, &fit.point);
        let Some(view) = self.view(fit, 0, &[], true) else {
            return Vec::new();
        };
        let asked: Vec<usize> = (0..self.body.candidates.len())
            .filter(|c| !fit.terms.contains(c) && self.body.candidates[*c].kind == Kind::Effect)
            .collect();
        let responses = parallel::map_slice(&asked, |&c| {
            let candidate = &self.body.candidates[c];
            let each = candidate
                .starts
                .iter()
                .enumerate()
                .filter_map(|(s, start)| {
                    cancel::check();
                    let (terms, point) = self.with(fit, c, start);
                    let response = minus(self.predicted(&terms, &point), &here)?;
                    let products = self.products(&view, &response)?;
                    let outside = view.whole.outside(&products)?;
                    let Outside { along, size, .. } = outside;
                    let share = self.share(c, start, along / size);
                    Some(Response {
                        candidate: c,
                        start: s,
                        products,
                        outside,
                        alone: share * along - 0.5 * share * share * size,
                    })
                });
            let mut each: Vec<Response> = each.collect();
            each.sort_by(|a, b| b.alone.total_cmp(&a.alone));
            each.truncate(STARTS);
            each
        });
        let all: Vec<Response> = responses.into_iter().flatten().collect();
        let rows: Vec<usize> = (0..all.len()).collect();
        let made = parallel::map_slice(&rows, |&i| {
            cancel::check();
            let others = all[..i].iter().filter(|b| b.candidate != all[i].candidate);
            let pairs = others.filter_map(|b| self.joined(&all[i], b));
            // Of each other candidate the better point.
            let mut best: Vec<PredictedPair> = Vec::new();
            for p in pairs {
                match best.iter_mut().find(|b| b.members[1].0 == p.members[1].0) {
                    Some(b) if b.gain >= p.gain => (),
                    Some(b) => *b = p,
                    None => best.push(p),
                }
            }
            best
        });
        let mut made: Vec<PredictedPair> = made.into_iter().flatten().collect();
        made.sort_by(|a, b| b.gain.total_cmp(&a.gain));
        made.dedup_by(|a, b| a.members[0].0 == b.members[0].0 && a.members[1].0 == b.members[1].0);
        made
    }

    /// Both responses at once; `None` where they are one.
    fn joined(&self, a: &Response, b: &Response) -> Option<PredictedPair> {
        let each = a.products.white.iter();
        let cross: f64 = each
            .filter_map(|(k, w)| Some(dot(w, b.products.white.get(k)?)))
            .sum();
        let [one, other] = [&a.outside, &b.outside];
        let cross = cross - one.part.dot(&other.solved);
        if cross * cross > ALIKE * one.size * other.size {
            return None;
        }
        let square = Matrix2::new(one.size, cross, cross, other.size);
        let right = Vector2::new(one.along, other.along);
        let best = square.try_inverse()? * right;
        let start = |r: &Response| &self.body.candidates[r.candidate].starts[r.start];
        let shares = Vector2::new(
            self.share(a.candidate, start(a), best[0]),
            self.share(b.candidate, start(b), best[1]),
        );
        let gain = shares.dot(&right) - 0.5 * shares.dot(&(square * shares));
        let member = |r: &Response, share: f64| {
            let c = &self.body.candidates[r.candidate];
            (r.candidate, c.at_share(start(r), c.stretched(), share))
        };
        Some(PredictedPair {
            members: [member(a, shares[0]), member(b, shares[1])],
            gain,
            better_alone: a.alone.max(b.alone),
        })
    }
}
