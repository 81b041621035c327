//! Which free functions are asked: variables, and knots over the range that the runs have of them.

use std::cell::RefCell;

use hydroline_sim::effect::Stage;

use super::{Acts, Family, Variable};
use crate::fit::Fit;
use crate::setting::Setting;

/// Knots per run at most and at least, and in all runs together.
const EACH_RUN: (usize, usize, usize) = (17, 8, 120);
/// Between runs laid end to end \[s\]: far enough that what pulls in one says nothing of the next.
pub(super) const BETWEEN_S: f64 = 1000.0;
/// Smallest load and speed with a knot of its own, of the largest: a deadband is some twentieth of that, and so is the
/// speed at which a friction that falls has fallen.
pub(super) const SMALL: f64 = 0.02;
/// First knot after a command edge \[s\].
pub(super) const AFTER_EDGE_S: f64 = 0.15;

/// Range of each plain variable in each run of a fit: one motion per run serves all functions.
/// And whether any run has commands.
struct Ranges(Vec<Vec<(Variable, f64, f64)>>, bool);

impl Ranges {
    fn of(setting: &Setting, fit: &Fit) -> Ranges {
        const PLAIN: [Variable; 9] = [
            Variable::Place,
            Variable::PlaceAgainst,
            Variable::Rate,
            Variable::Speed,
            Variable::SpeedAgainst,
            Variable::Load,
            Variable::LoadSize,
            Variable::Time,
            Variable::SinceEdge,
        ];
        let of_run = |run: usize| {
            let seen = RefCell::new(PLAIN.map(|v| (v, f64::INFINITY, f64::NEG_INFINITY)));
            let start = fit.start(setting, run);
            let _ = setting.simulate(run, &fit.set, fit.globals(setting), start, |h| {
                for (v, low, high) in seen.borrow_mut().iter_mut() {
                    let value = v.of(h);
                    *low = low.min(value);
                    *high = high.max(value);
                }
                0.0
            });
            seen.into_inner().to_vec()
        };
        let commanded = setting.tracks.iter().any(|t| !t.edges.is_empty());
        Ranges((0..setting.tracks.len()).map(of_run).collect(), commanded)
    }

    fn get(&self, variable: Variable) -> Option<(f64, f64)> {
        let (plain, only) = match variable {
            Variable::TimeIn(run) => (Variable::Time, Some(run)),
            Variable::AfterEdge => (Variable::SinceEdge, None),
            Variable::LoadRatio => (Variable::LoadSize, None),
            Variable::SpeedRatio => (Variable::Speed, None),
            other => (other, None),
        };
        let (low, high) = self
            .0
            .iter()
            .enumerate()
            .filter(|(run, _)| only.is_none_or(|o| o == *run))
            .flat_map(|(_, seen)| seen)
            .filter(|s| s.0 == plain)
            .fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), s| {
                (l.min(s.1), h.max(s.2))
            });
        (high > low + 1e-12).then_some((low, high))
    }

    /// Even knots over the range of a variable; times since an edge, and small loads and speeds, by ratio.
    fn family(&self, acts: Acts, variable: Variable, count: usize) -> Option<Family> {
        // Without any command there is no edge and no load to depend on.
        let commanded = matches!(
            variable,
            Variable::SinceEdge
                | Variable::AfterEdge
                | Variable::Load
                | Variable::LoadSize
                | Variable::LoadRatio
        );
        if commanded && !self.1 {
            return None;
        }
        let (low, high) = self.get(variable)?;
        let knots = if matches!(variable, Variable::LoadRatio | Variable::SpeedRatio) {
            let ratio = SMALL.powf(-1.0 / (count as f64 - 2.0));
            std::iter::once(0.0)
                .chain((0..count - 1).map(|k| high * SMALL * ratio.powi(k as i32)))
                .collect()
        } else if matches!(variable, Variable::SinceEdge | Variable::AfterEdge) {
            if high < 4.0 * AFTER_EDGE_S {
                return None;
            }
            let ratio = (high / AFTER_EDGE_S).powf(1.0 / (count as f64 - 2.0));
            std::iter::once(0.0)
                .chain((0..count - 1).map(|k| AFTER_EDGE_S * ratio.powi(k as i32)))
                .collect()
        } else {
            (0..count)
                .map(|k| low + (high - low) * k as f64 / (count as f64 - 1.0))
                .collect()
        };
        Some(Family {
            acts,
            variable,
            knots,
            measured: false,
            quiet: Vec::new(),
        })
    }
}

/// What a run's times are moved by when those of all runs are laid end to end \[s\]. Asked at every instant
/// of a motion: no list is made for it.
pub(super) fn laid_out_s(setting: &Setting, run: usize) -> f64 {
    let next = setting.tracks[..run]
        .iter()
        .fold(0.0, |next, t| next + (t.end_s() - t.start_s + BETWEEN_S));
    next - setting.tracks[run].start_s
}

/// The same for every run \[s\].
pub fn laid_out(setting: &Setting) -> Vec<f64> {
    (0..setting.tracks.len())
        .map(|run| laid_out_s(setting, run))
        .collect()
}

/// Knots over the time of every run.
fn each_run(setting: &Setting) -> Family {
    let (most, least, all) = EACH_RUN;
    let each = (all / setting.tracks.len().max(1)).clamp(least, most);
    let knots = setting
        .tracks
        .iter()
        .zip(laid_out(setting))
        .flat_map(|(t, first)| {
            let span = t.end_s() - t.start_s;
            (0..each).map(move |k| first + t.start_s + span * k as f64 / (each as f64 - 1.0))
        })
        .collect();
    Family {
        acts: Acts::Force,
        variable: Variable::TimeEach,
        knots,
        measured: false,
        quiet: Vec::new(),
    }
}

/// Forces as functions of everything they may depend on.
pub fn forces(setting: &Setting, fit: &Fit) -> Vec<Family> {
    forces_over(setting, &Ranges::of(setting, fit))
}

fn forces_over(setting: &Setting, ranges: &Ranges) -> Vec<Family> {
    let mut kinds = vec![
        (Variable::Place, 32),
        (Variable::PlaceAgainst, 32),
        (Variable::Rate, 24),
        (Variable::SpeedAgainst, 24),
        (Variable::Load, 12),
        (Variable::Time, 16),
        (Variable::SinceEdge, 10),
    ];
    kinds.extend((0..setting.tracks.len()).map(|run| (Variable::TimeIn(run), 16)));
    let mut all: Vec<Family> = kinds
        .into_iter()
        .filter_map(|(v, n)| ranges.family(Acts::Force, v, n))
        .collect();
    if setting.tracks.len() > 1 {
        all.push(each_run(setting));
    }
    all
}

/// The same and, in proportion to each command edge, the time since it: where the mismatch acts. That
/// one is what any lag of the thrust looks like, so it locates but is no explanation of its own.
pub fn regimes(setting: &Setting, fit: &Fit) -> Vec<Family> {
    let ranges = Ranges::of(setting, fit);
    let mut all = forces_over(setting, &ranges);
    all.extend(ranges.family(Acts::Force, Variable::AfterEdge, 10));
    all
}

/// Ways in which the laws of members may be bent.
pub fn bends(setting: &Setting, fit: &Fit, candidates: &[usize]) -> Vec<Family> {
    let kinds = [
        (Variable::Place, 10),
        // What varies along the tank varies evenly first (a Taylor series), also where no run fitted went.
        (Variable::Place, 2),
        (Variable::Rate, 10),
        (Variable::Speed, 8),
        (Variable::SpeedRatio, 10),
        (Variable::Load, 10),
        (Variable::LoadSize, 8),
        (Variable::LoadRatio, 10),
        (Variable::Time, 8),
        // So does what changes in the course of a log: one number gains where eight would cost more than they bring.
        (Variable::Time, 2),
        (Variable::SinceEdge, 8),
    ];
    let ranges = Ranges::of(setting, fit);
    candidates
        .iter()
        .flat_map(|c| {
            // A thruster or a clock knows nothing of the tank: what acts at a place there is a force.
            let stage = setting.vocabulary[*c].info.stage;
            let placeless = matches!(stage, Stage::Timing | Stage::Thruster);
            let thruster = stage == Stage::Thruster;
            kinds
                .iter()
                .filter(move |(v, _)| !(placeless && *v == Variable::Place))
                .filter(move |(v, _)| thruster || *v != Variable::LoadRatio)
                .filter(move |(v, _)| !(placeless && *v == Variable::SpeedRatio))
                .map(|(v, n)| ranges.family(Acts::Bends(*c), *v, *n))
                .collect::<Vec<_>>()
        })
        .flatten()
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::search::Search;
    use crate::testing::{candidate, setting, surge};

    #[test]
    fn only_thrusters_bend_at_small_loads_and_all_but_them_at_small_speeds() {
        let setting = setting(&[surge(0, &[]), surge(1, &[])]);
        let mut search = Search::new(&setting, &|_| {});
        search.nothing();
        let nothing = search.get(&[]).unwrap();
        let small = |id: &str| {
            let all = bends(&setting, nothing, &[candidate(&setting, id)]);
            let largest = |f: &Family| f.knots.last().copied().unwrap();
            let even = all.iter().find(|f| f.variable == Variable::LoadSize);
            let most = largest(even.unwrap());
            let found = all.into_iter().find(|f| f.variable == Variable::LoadRatio);
            found.map(|f| (f.knots[0], f.knots[1] / most, largest(&f) / most))
        };
        let (first, second, last) = small("thruster_deadband").unwrap();
        assert_eq!(first, 0.0);
        assert!((second - SMALL).abs() < 1e-9 && (last - 1.0).abs() < 1e-9);
        assert!(small("current").is_none() && small("command_latency").is_none());
        assert_eq!(Variable::LoadRatio.kind(), Variable::LoadSize);
        assert_eq!(Variable::LoadRatio.quantity(), Variable::Load.quantity());
        // A friction varies near rest; a thruster knows nothing of that.
        let near_rest = |id: &str| {
            let all = bends(&setting, nothing, &[candidate(&setting, id)]);
            let found = all.into_iter().find(|f| f.variable == Variable::SpeedRatio);
            found.map(|f| f.knots[1] / f.knots.last().copied().unwrap())
        };
        let share = near_rest("coulomb_friction").unwrap();
        assert!((share - SMALL).abs() < 1e-9);
        assert!(near_rest("thruster_deadband").is_none() && near_rest("command_latency").is_none());
        assert_eq!(Variable::SpeedRatio.kind(), Variable::Speed);
    }

    #[test]
    fn a_thruster_does_not_bend_by_place_and_a_drag_may() {
        let setting = setting(&[surge(0, &[]), surge(1, &[])]);
        let mut search = Search::new(&setting, &|_| {});
        search.nothing();
        let nothing = search.get(&[]).unwrap();
        let by_place = |id: &str| {
            let candidates = [candidate(&setting, id)];
            let all = bends(&setting, nothing, &candidates);
            assert!(all.len() > 3, "{id}");
            all.iter().any(|f| f.variable == Variable::Place)
        };
        assert!(!by_place("thruster_lag") && !by_place("thrust_asymmetry"));
        assert!(by_place("current") && by_place("tether_spring"));
        assert_eq!(Variable::SpeedAgainst.kind(), Variable::Rate);
    }
}
