//! What these runs cannot show.

use std::collections::BTreeMap;

use crate::bank::{View, outside, responses, whitened};
use crate::fit::Fit;
use crate::search::Search;
use crate::setting::{Setting, Track};

/// Whitened size below which an effect at its most plausible could not be seen.
const UNSEEN: f64 = 4.0;
/// Share of an effect that the vehicle's own coefficients must not absorb.
const ABSORBED: f64 = 1e-3;

/// What these runs cannot show: effects that act in this DOF but whose response, at their most
/// plausible, drowns in the noise or in the vehicle's own coefficients.
pub fn blind(search: &Search<'_>, fit: &Fit) -> Vec<String> {
    let setting = search.setting;
    let view = View::new(setting, &search.weights, fit);
    let mut best: BTreeMap<usize, (f64, f64)> = BTreeMap::new();
    for r in responses(setting, fit) {
        let w = whitened(setting, &search.weights, &r.column);
        let left = outside(&view.basis, &w).norm();
        let entry = best.entry(r.candidate).or_insert((0.0, 0.0));
        entry.0 = entry.0.max(left);
        entry.1 = entry.1.max(left / w.norm().max(1e-300));
    }
    // What would act here if the vehicle went astern and coasted: seen in a run that does.
    let probe = probe(setting);
    (0..setting.vocabulary.len())
        .filter(|c| !fit.set.contains(c))
        .filter(|c| {
            search.blind.contains(c)
                || match best.get(c) {
                    Some((size, share)) => *size < UNSEEN || *share < ABSORBED,
                    None => probe.contains(c),
                }
        })
        .map(|c| setting.vocabulary[c].info.id.to_owned())
        .collect()
}

/// Candidates that move this DOF in a run ahead, astern and at rest.
pub fn probe(setting: &Setting) -> Vec<usize> {
    let Some(like) = setting.tracks.first() else {
        return Vec::new();
    };
    let size = setting
        .tracks
        .iter()
        .flat_map(|t| &t.edges)
        .map(|e| e.1.abs())
        .fold(0.0, f64::max);
    let size = if size > 0.0 { size } else { 1.0 };
    let times_s: Vec<f64> = (0..200).map(|k| 0.006 + 0.1 * f64::from(k)).collect();
    let track = Track {
        measured: vec![0.0; times_s.len()],
        times_s,
        edges: vec![(0.0, size), (6.0, -size), (15.0, 0.0)],
        start_s: 0.0,
        ..like.clone()
    };
    let there = setting.with_tracks(vec![track]);
    let vehicle = setting.coefficients();
    let none = Fit {
        set: Vec::new(),
        at: vehicle.iter().copied().chain([0.0, 0.0]).collect(),
        cost: 0.0,
        hessian: nalgebra::DMatrix::zeros(0, 0),
        log_evidence: 0.0,
        rough: false,
    };
    let mut moved: Vec<usize> = responses(&there, &none)
        .iter()
        .map(|r| r.candidate)
        .collect();
    moved.dedup();
    moved
}
