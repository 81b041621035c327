//! Models of the posterior into the verdict, for draws.

use hydroline_inference::body::{Body, Own};
use hydroline_inference::fit::Fit;
use hydroline_inference::term::Kind;
use hydroline_rigs::{ParameterValue, PhysicsEntry};
use hydroline_sim::effect::Trend;

use super::found::Judged;
use crate::verdict::PosteriorModel;

/// Models less probable than this are in no draw of a thousand.
const LEAST: f64 = 1e-3;

/// A number of a model that is drawn.
struct Drawn {
    name: String,
    /// Its place among the scaled numbers.
    place: usize,
    logarithmic: bool,
}

/// `[[physics]]` tables as a rig has them.
fn toml(entries: &[PhysicsEntry]) -> String {
    let mut text = String::new();
    for entry in entries {
        text += &format!("[[physics]]\neffect = \"{}\"\n", entry.effect);
        for (name, value) in &entry.parameters {
            text += &match value {
                ParameterValue::Number(v) => format!("{name} = {v:?}\n"),
                ParameterValue::Word(w) => format!("{name} = \"{w}\"\n"),
            };
        }
    }
    text
}

fn is_logarithmic(own: &Own) -> bool {
    !matches!(own, Own::Unsaid(..))
}

impl Judged<'_> {
    /// A model's effects and forces as a rig has them.
    pub(super) fn entries(&self, fit: &Fit) -> Vec<PhysicsEntry> {
        let body = &self.found.problem.body;
        let natural = body.natural(&fit.terms, &fit.point);
        let places = body.places(&fit.terms);
        let numbers =
            |at: usize, n: usize| -> Vec<f64> { natural[at..at + n].iter().map(|v| v.0).collect() };
        let mut entries = Vec::new();
        for (member, t) in fit.terms.iter().enumerate() {
            let c = &body.candidates[*t];
            // The trend of a law is written with its effect.
            if matches!(c.kind, Kind::Trend { .. }) {
                continue;
            }
            let mut effect = c.checked(&numbers(places[member], c.scales.len()));
            let trend = self.found.problem.dependants(&fit.terms, member).next();
            effect.trend = trend.and_then(|m| {
                let trend = &body.candidates[fit.terms[m]];
                let (along, range) = trend.along?;
                Some(Trend {
                    parameter: 0,
                    nothing: c.nothing,
                    along,
                    range,
                    shares: numbers(places[m], trend.scales.len()),
                })
            });
            entries.push(effect.entry());
        }
        entries
    }

    fn drawn(&self, fit: &Fit) -> Vec<Drawn> {
        let body: &Body = &self.found.problem.body;
        let mut all: Vec<Drawn> = body
            .own
            .iter()
            .enumerate()
            .map(|(place, own)| Drawn {
                name: own.name().to_owned(),
                place,
                logarithmic: is_logarithmic(own),
            })
            .collect();
        let places = body.places(&fit.terms);
        let members = fit.terms.iter().zip(&places);
        let written = members.filter(|(t, _)| {
            let kind = body.candidates[**t].kind;
            !matches!(kind, Kind::Trend { .. })
        });
        for (entry, (t, at)) in written.enumerate() {
            let c = &body.candidates[*t];
            if c.kind != Kind::Effect {
                continue;
            }
            for (i, (p, scale)) in c.info.parameters.iter().zip(&c.scales).enumerate() {
                // A number that is held is no estimate.
                if scale.limits.0 < scale.limits.1 {
                    all.push(Drawn {
                        name: format!("{}.{}", entry + 1, p.name),
                        place: at + i,
                        logarithmic: scale.logarithmic,
                    });
                }
            }
        }
        all
    }

    fn model(&self, fit: &Fit, probability: f64) -> PosteriorModel {
        let natural = self.found.problem.body.natural(&fit.terms, &fit.point);
        let drawn = self.drawn(fit);
        // Scaled numbers are logarithms already where these are normal.
        let slope = |d: &Drawn| {
            if d.logarithmic {
                1.0
            } else {
                natural[d.place].1
            }
        };
        let cell = |a: &Drawn, b: &Drawn| {
            let c = &fit.covariance;
            0.5 * slope(a) * slope(b) * (c[(a.place, b.place)] + c[(b.place, a.place)])
        };
        let row = |a: &Drawn| drawn.iter().map(|b| cell(a, b)).collect();
        PosteriorModel {
            probability,
            physics: toml(&self.entries(fit)),
            values: drawn.iter().map(|d| natural[d.place].0).collect(),
            logarithmic: drawn.iter().map(|d| d.logarithmic).collect(),
            covariance: drawn.iter().map(row).collect(),
            numbers: drawn.into_iter().map(|d| d.name).collect(),
        }
    }

    /// The models that draws come from, most probable first.
    pub fn posterior_models(&self) -> Vec<PosteriorModel> {
        let models = self.posterior.models.iter().filter(|m| m.1 >= LEAST);
        models
            .filter_map(|(terms, p)| Some(self.model(self.found.models.get(terms)?, *p)))
            .filter(|m| m.covariance.iter().flatten().all(|v| v.is_finite()))
            .collect()
    }
}
