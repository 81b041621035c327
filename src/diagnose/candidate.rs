//! Candidates: every effect of the registry that can act in a DOF, with points to start from.
//!
//! Nothing here knows an effect: stage, parameters, plausible range and words come from its info.

use hydroline_rigs::Dof;
use hydroline_sim::effect::{ALL, CheckedEffect, EffectInfo, ParameterInfo};

/// An effect that may have been left out.
#[derive(Debug, Clone, PartialEq)]
pub struct Candidate {
    /// The effect.
    pub info: &'static EffectInfo,
    /// Index per word; `dof` words stand on the DOF diagnosed.
    pub words: Vec<usize>,
    /// Points to start from, each one number per parameter.
    pub starts: Vec<Vec<f64>>,
    /// Bounds of a fit per parameter: the plausible range and twice its width beyond, within the limits.
    pub bounds: Vec<(f64, f64)>,
    /// Width of the prior per parameter.
    pub widths: Vec<f64>,
    /// Range in which the prior is flat per parameter: the plausible one and "not there".
    pub flat: Vec<(f64, f64)>,
}

/// Every effect that is not already switched on.
pub fn vocabulary(dof: Dof, on: &[CheckedEffect]) -> Vec<Candidate> {
    ALL.iter()
        .filter_map(|info| Candidate::new(info, dof))
        .filter(|c| {
            !on.iter()
                .any(|o| o.info.id == c.info.id && o.words == c.words)
        })
        .collect()
}

impl Candidate {
    fn new(info: &'static EffectInfo, dof: Dof) -> Option<Candidate> {
        if info.parameters.is_empty() {
            return None;
        }
        let words = info
            .words
            .iter()
            .map(|w| {
                let named = |name: &str| w.allowed.iter().position(|a| *a == name);
                let own = if w.name == "dof" {
                    named(dof.name())
                } else {
                    None
                };
                own.or_else(|| w.absent.and_then(named)).unwrap_or(0)
            })
            .collect();
        let bound = |p: &ParameterInfo| {
            let span = p.plausible.1 - p.plausible.0;
            (
                (p.plausible.0 - 2.0 * span).max(p.limits.0),
                (p.plausible.1 + 2.0 * span).min(p.limits.1),
            )
        };
        Some(Candidate {
            info,
            words,
            starts: starts(info),
            bounds: info.parameters.iter().map(bound).collect(),
            widths: info
                .parameters
                .iter()
                .map(|p| (p.plausible.1.max(0.0) - p.plausible.0.min(0.0)).max(1e-12))
                .collect(),
            flat: info.parameters.iter().map(flat).collect(),
        })
    }
}

/// The plausible range down to where the effect is not there: 0, or a factor of 1 if that is nearer.
fn flat(p: &ParameterInfo) -> (f64, f64) {
    let (low, high) = p.plausible;
    let away = |v: f64| (low - v).max(v - high);
    let nothing = if p.unit == "1" && away(1.0) < away(0.0) {
        1.0
    } else {
        0.0
    };
    (low.min(nothing), high.max(nothing))
}

/// A share of the plausible range, by ratio where the range spans one sign and a factor of four.
fn point(p: &ParameterInfo, share: f64) -> f64 {
    let (low, high) = p.plausible;
    if low > 0.0 && high >= 4.0 * low {
        low * (high / low).powf(share)
    } else {
        low + (high - low) * share
    }
}

/// Radical inverse: evenly filling points without a seed (Halton 1960).
fn radical(mut k: usize, base: usize) -> f64 {
    let (mut value, mut digit) = (0.0, 1.0 / base as f64);
    while k > 0 {
        value += (k % base) as f64 * digit;
        k /= base;
        digit /= base as f64;
    }
    value
}

fn starts(info: &EffectInfo) -> Vec<Vec<f64>> {
    const BASES: [usize; 5] = [2, 3, 5, 7, 11];
    let typical: Vec<f64> = info.parameters.iter().map(|p| p.typical).collect();
    let mut points = vec![typical];
    // Two ends and the middle of a line, more the more corners there are.
    let count = match info.parameters.len() {
        1 => {
            points.extend([0.05, 0.95, 0.3, 0.7].map(|s| vec![point(&info.parameters[0], s)]));
            return points;
        }
        2 => 12,
        _ => 48,
    };
    for k in 1..=count {
        points.push(
            info.parameters
                .iter()
                .enumerate()
                .map(|(i, p)| point(p, radical(k, BASES[i % BASES.len()])))
                .collect(),
        );
    }
    points
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_start_is_plausible_and_every_effect_of_the_registry_is_asked() {
        let all = vocabulary(Dof::Roll, &[]);
        assert_eq!(
            all.len(),
            ALL.iter().filter(|i| !i.parameters.is_empty()).count()
        );
        for c in &all {
            for start in &c.starts {
                for ((v, p), (low, high)) in start.iter().zip(c.info.parameters).zip(&c.bounds) {
                    assert!((*low..=*high).contains(v), "{} {} = {v}", c.info.id, p.name);
                }
            }
            for (w, i) in c.info.words.iter().zip(&c.words) {
                assert!(
                    w.name != "dof" || w.allowed[*i] == "roll" || !w.allowed.contains(&"roll"),
                    "{}",
                    c.info.id
                );
            }
        }
    }
}
