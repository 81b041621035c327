//! The part of the runs held out over which free functions know what they say.

use super::Explanation;
use crate::family::{Family, Variable};
use crate::setting::Track;

/// How far beyond its outermost knots a function is still asked, over their span; a straight line further.
const MARGIN: f64 = 0.02;
/// Samples in a row that must lie outside.
const LASTS: usize = 8;
/// Samples that must be left of a run.
const LEAST: usize = 20;
/// Share of a run's samples that must be left of it.
const LEAST_SHARE: f64 = 0.15;

/// Runs held out up to where the first of these explanations' functions would be asked about a place, a rate
/// or a load that no run fitted showed it: what it says there is nobody's prediction, and what follows hangs
/// on it. Runs of which hardly anything is left go.
pub fn covered(contenders: &[&Explanation], held: &[Track]) -> Vec<Track> {
    let functions: Vec<&Family> = contenders
        .iter()
        .filter_map(|e| Some(&e.family.as_ref()?.family))
        .filter(|f| f.lasts())
        .collect();
    if functions.is_empty() {
        return held.to_vec();
    }
    held.iter()
        .filter_map(|track| {
            let known = functions
                .iter()
                .map(|f| samples_known(f, track))
                .fold(track.times_s.len(), usize::min);
            let enough = known >= LEAST && known as f64 >= LEAST_SHARE * track.times_s.len() as f64;
            enough.then(|| Track {
                times_s: track.times_s[..known].to_vec(),
                measured: track.measured[..known].to_vec(),
                ..track.clone()
            })
        })
        .collect()
}

/// Samples before the variable of a function leaves the range of its knots.
fn samples_known(function: &Family, track: &Track) -> usize {
    let (Some(low), Some(high)) = (function.knots.first(), function.knots.last()) else {
        return 0;
    };
    let margin = function.beyond().max(MARGIN) * (high - low);
    let outside = |k: &usize| {
        let value = measured(function.variable, track, *k);
        value < low - margin || value > high + margin
    };
    let n = track.times_s.len();
    let beyond: Vec<usize> = (0..n).filter(outside).collect();
    // One that is apart is an outlier, or noise of a rate.
    beyond
        .windows(LASTS)
        .find(|w| w[LASTS - 1] - w[0] == LASTS - 1)
        .map_or(n, |w| w[0])
}

/// The variable as the run shows it at a sample.
fn measured(variable: Variable, track: &Track, k: usize) -> f64 {
    let t_s = track.times_s[k];
    let edge = || {
        let after = track.edges.partition_point(|e| e.0 <= t_s);
        after.checked_sub(1).map(|k| track.edges[k])
    };
    let load_n = || edge().map_or(0.0, |e| e.1);
    match variable {
        Variable::Place | Variable::PlaceAgainst => track.measured[k],
        Variable::Rate => track.rate_at(t_s),
        Variable::Speed | Variable::SpeedRatio | Variable::SpeedAgainst => track.rate_at(t_s).abs(),
        Variable::Load => load_n(),
        Variable::LoadSize | Variable::LoadRatio => load_n().abs(),
        Variable::SinceEdge | Variable::AfterEdge => t_s - edge().map_or(track.start_s, |e| e.0),
        Variable::Time | Variable::TimeIn(_) | Variable::TimeEach => t_s,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::family::Acts;
    use hydroline_sim::single::Line;

    #[test]
    fn a_run_is_known_until_it_stays_beyond_the_knots() {
        let times_s: Vec<f64> = (0..200).map(|k| 0.04 * f64::from(k)).collect();
        // 0.1 m/s from 0: beyond 0.4 m from 4 s on; one outlier long before.
        let mut measured: Vec<f64> = times_s.iter().map(|t| 0.1 * t).collect();
        measured[30] = 3.0;
        let track = Track {
            name: String::new(),
            edges: vec![(0.0, 2.0), (2.0, 5.0)],
            start_s: 0.0,
            line: Line {
                dof: 0,
                rest: [0.0; 6],
            },
            times_s,
            measured,
        };
        let of = |variable: Variable, high: f64| Family {
            acts: Acts::Force,
            variable,
            knots: vec![0.0, 0.5 * high, high],
            measured: false,
            quiet: Vec::new(),
        };
        let known = samples_known(&of(Variable::Place, 0.4), &track);
        assert!((101..=104).contains(&known), "{known}");
        assert_eq!(samples_known(&of(Variable::Place, 1.0), &track), 200);
        assert_eq!(samples_known(&of(Variable::Load, 4.0), &track), 50);
        assert_eq!(samples_known(&of(Variable::Load, 5.0), &track), 200);
    }
}
