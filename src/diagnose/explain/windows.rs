//! Runs cut into windows with a state of their own (multiple shooting, Bock and Plitt 1984).
//!
//! A drive that a controller holds runs off by metres in a model without its friction, and from there no
//! fit finds back. Over a second or two nothing runs off: there the set's numbers are found that a
//! fit of the whole runs begins with.

use std::ops::Range;

use nalgebra::DVector;
use rayon::prelude::*;

use crate::bank::{View, joined, responses, whitened};
use crate::fit::{Fit, Posed};
use crate::search::Search;
use crate::setting::{COEFFICIENTS, Setting, Track};
use crate::weights::Weights;
use hydroline_numerics::noise::Noise;

/// Windows per run.
const WINDOWS: usize = 10;
/// Samples that a window has at least.
const SAMPLES: usize = 20;
/// Starting points fitted per candidate.
const STARTS: usize = 2;

/// The problem in windows.
pub struct Windows {
    setting: Setting,
    weights: Weights,
}

/// Samples of each window of a run.
fn ranges(track: &Track) -> impl Iterator<Item = Range<usize>> {
    let n = track.times_s.len();
    let length = n.div_ceil(WINDOWS).max(SAMPLES);
    (0..n)
        .step_by(length)
        .map(move |first| first..(first + length).min(n))
        .filter(|r| r.len() >= SAMPLES / 2)
}

/// A window of a run, which begins under way.
fn piece(track: &Track, range: Range<usize>) -> Track {
    Track {
        start_s: if range.start == 0 {
            track.start_s
        } else {
            track.times_s[range.start]
        },
        times_s: track.times_s[range.clone()].to_vec(),
        measured: track.measured[range].to_vec(),
        ..track.clone()
    }
}

/// Runs cut into windows.
pub fn pieces(tracks: &[Track]) -> Vec<Track> {
    tracks
        .iter()
        .flat_map(|t| ranges(t).map(|r| piece(t, r)))
        .collect()
}

impl Windows {
    /// Of a search's runs.
    pub fn of(search: &Search<'_>) -> Windows {
        let (mut tracks, mut used) = (Vec::new(), Vec::new());
        for (track, counts) in search.setting.tracks.iter().zip(&search.weights.used) {
            for range in ranges(track) {
                used.push(counts[range.clone()].to_vec());
                tracks.push(piece(track, range));
            }
        }
        let noise = Noise::white(search.weights.noise.total_sd());
        Windows {
            weights: Weights::new(&tracks, noise, used),
            setting: search.setting.with_tracks(tracks),
        }
    }

    fn from(&self, globals: &[f64]) -> Vec<f64> {
        let starts = self
            .setting
            .tracks
            .iter()
            .flat_map(|t| [t.measured[0], t.rate_at(t.times_s[0] + 0.2)]);
        globals.iter().copied().chain(starts).collect()
    }

    /// A set fitted in windows from numbers of its own.
    pub fn fit(&self, set: &[usize], globals: &[f64]) -> Option<Fit> {
        let effort = self.weights.to_a_percent();
        Posed::new(&self.setting, &self.weights, set)
            .fit_with(self.from(globals), effort)
            .ok()
            .filter(|f| f.cost.is_finite() && f.confounded(&self.setting).is_empty())
    }

    /// A set, fitted, with each of its most promising additions: best first.
    pub fn grow(&self, fit: &Fit, blind: impl Fn(usize) -> bool, width: usize) -> Vec<Fit> {
        let bank = responses(&self.setting, fit);
        let white: Vec<DVector<f64>> = bank
            .par_iter()
            .map(|r| whitened(&self.setting, &self.weights, &r.column))
            .collect();
        let view = View::new(&self.setting, &self.weights, fit);
        let jobs: Vec<(usize, usize)> = view
            .promises(&bank, &white, &fit.set)
            .into_iter()
            .filter(|l| !blind(l[0].candidate))
            .take(width)
            .flat_map(|l| {
                l.into_iter()
                    .take(STARTS)
                    .map(|p| (p.candidate, p.start))
                    .collect::<Vec<_>>()
            })
            .collect();
        let made: Vec<Fit> = jobs
            .into_par_iter()
            .filter_map(|(candidate, start)| {
                let point = &self.setting.vocabulary[candidate].starts[start];
                let (set, at) = joined(&self.setting, fit, candidate, point);
                let globals = &at[..COEFFICIENTS + self.setting.parameters(&set)];
                self.fit(&set, globals)
            })
            .collect();
        let mut best: Vec<Fit> = Vec::new();
        for fit in made {
            match best.iter_mut().find(|b| b.set == fit.set) {
                Some(b) if b.cost <= fit.cost => {}
                Some(b) => *b = fit,
                None => best.push(fit),
            }
        }
        best.sort_by(|a, b| a.cost.total_cmp(&b.cost));
        best
    }

    /// Where a fit of the whole runs begins that has these numbers.
    pub fn whole(&self, search: &Search<'_>, fit: &Fit) -> (Vec<usize>, Vec<f64>) {
        let starts = search
            .setting
            .tracks
            .iter()
            .flat_map(|t| [t.measured.first().copied().unwrap_or(0.0), 0.0]);
        let globals = fit.globals(&self.setting).iter().copied();
        (fit.set.clone(), globals.chain(starts).collect())
    }
}
