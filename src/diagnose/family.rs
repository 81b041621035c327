//! Unnamed structure: a force, or a parameter of an effect, as a free function of one variable.
//!
//! Hat functions over the variable, amplitudes with a Gaussian prior whose size and length are chosen by
//! the evidence (an empirical Gaussian process, `prior`). Two uses: a force that nothing in the vocabulary
//! explains (`unknown`), and an effect whose law is not quite the vocabulary's (`inexact`): then
//! its first parameter depends on something it should not depend on.
//! Reference: MacKay 1992, Bayesian interpolation.

mod joint;
mod kinds;
mod linear;
mod prior;
mod refine;
mod windows;

use std::cell::Cell;

use hydroline_sim::Real;
use hydroline_sim::single::Instant;
use nalgebra::DVector;

use super::setting::{Setting, Track};

pub use joint::Joint;
pub use kinds::{bends, forces, laid_out, regimes};
pub use prior::Prior;

/// Rate at which a force against the motion has three quarters of its size, as in
/// `coulomb_friction` \[m/s, rad/s\].
const TURN_MPS: f64 = 0.004;
/// How far a straight line is followed beyond its two knots, over what lies between them.
const STRAIGHT_ON: f64 = 1.0;
/// Least factor on a law that varies evenly: a parameter keeps its sign.
const LEAST_FACTOR: f64 = 0.05;
/// Log of the choice among a dozen functions.
const PENALTY: f64 = 3.0;

/// What a free function depends on.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum Variable {
    /// Position along the line \[m, rad\].
    Place,
    /// The same, of a force against the motion \[m, rad\].
    PlaceAgainst,
    /// Rate over ground \[m/s\].
    Rate,
    /// Its size.
    Speed,
    /// The same with knots by ratio: what a friction does near rest, where it begins.
    SpeedRatio,
    /// The same, of a force against the motion \[m/s\]: a drag that depends on speed as it likes.
    SpeedAgainst,
    /// Commanded load \[N\].
    Load,
    /// Its size.
    LoadSize,
    /// The same with knots by ratio: what a thruster does at small loads, where its thresholds lie.
    LoadRatio,
    /// Time since the log's first stamp, the same in all runs \[s\].
    Time,
    /// Time since the last command edge \[s\].
    SinceEdge,
    /// The same, of a force in proportion to what the edge changed \[s\].
    AfterEdge,
    /// Time in one run only \[s\].
    TimeIn(usize),
    /// Time in each run by itself, runs end to end \[s\]: someone pulls, at another time in every run.
    TimeEach,
}

impl Variable {
    /// Name in reports, with the unit where it is linear motion.
    pub fn name(self) -> String {
        match self {
            Variable::Place => "position".to_owned(),
            Variable::PlaceAgainst => "position, against the motion".to_owned(),
            Variable::Rate => "rate".to_owned(),
            Variable::Speed | Variable::SpeedRatio => "speed".to_owned(),
            Variable::SpeedAgainst => "speed, against the motion".to_owned(),
            Variable::Load => "command".to_owned(),
            Variable::LoadSize | Variable::LoadRatio => "size of the command".to_owned(),
            Variable::Time => "time since the log's start".to_owned(),
            Variable::SinceEdge => "time since the last command edge".to_owned(),
            Variable::AfterEdge => {
                "time since the last command edge, in proportion to its change".to_owned()
            }
            Variable::TimeIn(run) => format!("time in run {}", run + 1),
            Variable::TimeEach => "time in each run by itself".to_owned(),
        }
    }

    /// Times in one run, in each or in all are one kind, and so are places; a force against the motion is one of its rate;
    /// how knots lie makes no kind.
    pub fn kind(self) -> Variable {
        match self {
            Variable::TimeIn(_) | Variable::Time => Variable::TimeEach,
            Variable::PlaceAgainst => Variable::Place,
            Variable::SpeedAgainst => Variable::Rate,
            Variable::LoadRatio => Variable::LoadSize,
            Variable::SpeedRatio => Variable::Speed,
            other => other,
        }
    }

    /// The same quantity, with its sign or without.
    pub fn quantity(self) -> Variable {
        match self.kind() {
            Variable::Speed => Variable::Rate,
            Variable::LoadSize => Variable::Load,
            other => other,
        }
    }

    fn of<T: Real>(self, here: &Instant<T>) -> T {
        let plain = |v: f64| T::from_f64(v);
        match self {
            Variable::Place | Variable::PlaceAgainst => here.position,
            Variable::Rate => here.rate,
            Variable::Speed | Variable::SpeedRatio | Variable::SpeedAgainst => here.rate.abs(),
            Variable::Load => plain(here.load),
            Variable::LoadSize | Variable::LoadRatio => plain(here.load.abs()),
            Variable::Time | Variable::TimeIn(_) | Variable::TimeEach => plain(here.t_s.value()),
            Variable::SinceEdge | Variable::AfterEdge => plain(here.t_s.value() - here.edge_s),
        }
    }

    /// What the function is multiplied by at a rate.
    fn factor<T: Real>(self, here: &Instant<T>, rate: T) -> T {
        match self {
            Variable::AfterEdge => T::from_f64(here.jump),
            Variable::PlaceAgainst | Variable::SpeedAgainst => -(rate * (1.0 / TURN_MPS)).tanh(),
            _ => T::one(),
        }
    }
}

/// What the function acts on.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Acts {
    /// A force \[N, N m\] of its own.
    Force,
    /// The logarithm of a factor on the first parameter of this candidate; of a straight line the factor less one.
    Bends(usize),
}

/// A free function.
#[derive(Debug, Clone, PartialEq)]
pub struct Family {
    /// On what.
    pub acts: Acts,
    /// Of what.
    pub variable: Variable,
    /// Peaks of the hats, ascending.
    pub knots: Vec<f64>,
    /// Place and rate are those that were measured, not those of the model: far from the noise
    /// only so the motion is nearly linear in the function.
    pub measured: bool,
    /// Knots at which nothing is expected; empty = none of them.
    pub quiet: Vec<bool>,
}

/// A fitted free function beside a set.
#[derive(Debug, Clone)]
pub struct FamilyFit {
    /// Which.
    pub family: Family,
    /// Amplitude at each knot \[N, N m; 1\].
    pub amplitudes: Vec<f64>,
    /// sd of each.
    pub sds: Vec<f64>,
    /// Log evidence gained over the set alone.
    pub gain: f64,
    /// Prior of the amplitudes.
    pub prior: Prior,
    /// Raw response to the fitted function, runs end to end \[m, rad\].
    pub response: DVector<f64>,
}

impl Family {
    /// What the function is asked about at an instant of a run.
    fn value<T: Real>(&self, setting: &Setting, run: usize, here: &Instant<T>) -> T {
        let track = &setting.tracks[run];
        match self.variable {
            Variable::TimeEach => T::from_f64(here.t_s.value() + kinds::laid_out_s(setting, run)),
            Variable::Place | Variable::PlaceAgainst if self.measured => {
                T::from_f64(track.at(here.t_s.value()))
            }
            Variable::Rate if self.measured => T::from_f64(track.rate_at(here.t_s.value())),
            Variable::SpeedAgainst if self.measured => {
                T::from_f64(track.rate_at(here.t_s.value()).abs())
            }
            other => other.of(here),
        }
    }

    /// What it is multiplied by.
    fn factor<T: Real>(&self, track: &Track, here: &Instant<T>) -> T {
        let against = matches!(
            self.variable,
            Variable::PlaceAgainst | Variable::SpeedAgainst
        );
        let rate = if self.measured && against {
            T::from_f64(track.rate_at(here.t_s.value()))
        } else {
            here.rate
        };
        self.variable.factor(here, rate)
    }

    /// Whether one run ends at this knot and the next begins at the one behind it.
    fn between_runs(&self, knot: usize) -> bool {
        let gap = self
            .knots
            .get(knot + 1)
            .map_or(0.0, |k| k - self.knots[knot]);
        self.variable == Variable::TimeEach && gap > 0.5 * kinds::BETWEEN_S
    }

    /// A value of the variable as people are shown it: runs laid end to end follow each other after a second.
    pub fn shown(&self, value: f64) -> f64 {
        let gaps = (0..self.knots.len())
            .filter(|i| self.between_runs(*i) && value > self.knots[*i] + 0.5 * kinds::BETWEEN_S)
            .count();
        value - (kinds::BETWEEN_S - 1.0) * gaps as f64
    }

    /// Whether it says anything of other runs: a force in time does not, a law that bends with the time since
    /// the log's start does.
    pub fn lasts(&self) -> bool {
        match self.acts {
            Acts::Force => self.variable.kind() != Variable::TimeEach,
            Acts::Bends(_) => !matches!(self.variable, Variable::TimeIn(_) | Variable::TimeEach),
        }
    }

    /// Whether it does anything in a run.
    fn acts_in(&self, run: usize) -> bool {
        !matches!(self.variable, Variable::TimeIn(only) if only != run)
    }

    /// Whether it is a straight line between two knots, which goes on beyond them.
    pub fn straight(&self) -> bool {
        self.knots.len() == 2
    }

    /// The factor on a parameter where the function is `f`: e^f keeps the parameter's sign. What varies evenly (a current
    /// v (1 + s x)) does so itself, not by its logarithm.
    fn bend<T: Real>(&self, f: T) -> T {
        if self.straight() {
            (T::one() + f).max(T::from_f64(LEAST_FACTOR))
        } else {
            f.exp()
        }
    }

    /// How far beyond its outermost knots it still says what it says between them, over their span.
    pub fn beyond(&self) -> f64 {
        if self.straight() { STRAIGHT_ON } else { 0.0 }
    }

    /// Hat at or before a value and the share of the next one; constant beyond the ends, and where a straight line's use ends.
    fn between(&self, value: f64) -> (usize, f64) {
        let k = &self.knots;
        if self.straight() {
            let share = (value - k[0]) / (k[1] - k[0]);
            return (0, share.clamp(-STRAIGHT_ON, 1.0 + STRAIGHT_ON));
        }
        let after = k.partition_point(|k| *k <= value);
        if after == 0 {
            (0, 0.0)
        } else if after == k.len() {
            (after - 1, 0.0)
        } else {
            let i = after - 1;
            (i, (value - k[i]) / (k[after] - k[i]))
        }
    }

    /// The function at an instant, with its slope in the variable. `mark` may give the value
    /// derivatives with respect to the amplitudes of the two hats there.
    fn profile<T: Real>(
        &self,
        setting: &Setting,
        run: usize,
        here: &Instant<T>,
        amplitudes: &[f64],
        mark: &impl Fn(T, usize, f64) -> T,
    ) -> T {
        let v = self.value(setting, run, here);
        let (i, share) = self.between(v.value());
        let mut made = T::from_f64(amplitudes[i]);
        if let Some(next) = self.knots.get(i + 1) {
            let (k, rise) = (self.knots[i], amplitudes[i + 1] - amplitudes[i]);
            let room = self.beyond() * (next - k);
            let inside = v.value() >= self.knots[0] - room && v.value() <= next + room;
            made = made
                + if inside {
                    (v - T::from_f64(k)) * (rise / (next - k))
                } else {
                    T::from_f64(share * rise)
                };
        }
        mark(made, i, share) * self.factor(&setting.tracks[run], here)
    }

    /// Motion of a run under a set and this function.
    #[allow(clippy::too_many_arguments)] // one call, five of them are the point of evaluation
    fn drive<T: Real>(
        &self,
        setting: &Setting,
        run: usize,
        set: &[usize],
        globals: &[T],
        start: (T, T),
        amplitudes: &[f64],
        mark: &impl Fn(T, usize, f64) -> T,
    ) -> Vec<T> {
        let acts_here = self.acts_in(run);
        match self.acts {
            Acts::Force => setting.simulate(run, set, globals, start, |h| {
                if acts_here {
                    self.profile(setting, run, h, amplitudes, mark)
                } else {
                    T::zero()
                }
            }),
            Acts::Bends(candidate) => {
                let member = set.iter().position(|c| *c == candidate).unwrap_or(0);
                setting.simulate_bent(run, set, globals, start, member, |h| {
                    self.bend(self.profile(setting, run, h, amplitudes, mark))
                })
            }
        }
    }
}

/// Hats that a motion comes by: only those have derivatives.
struct Touched(Cell<(usize, usize)>);

impl Touched {
    fn none() -> Touched {
        Touched(Cell::new((usize::MAX, 0)))
    }

    fn by(&self, hat: usize, share: f64) {
        let (low, high) = self.0.get();
        let last = hat + usize::from(share != 0.0);
        self.0.set((low.min(hat), high.max(last)));
    }

    /// First and number.
    fn range(&self) -> (usize, usize) {
        let (low, high) = self.0.get();
        if low > high {
            (0, 0)
        } else {
            (low, high + 1 - low)
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fit::Posed;
    use crate::testing::{candidate, setting, surge};
    use crate::weights::Weights;

    /// A line through two knots is a line of the parameter itself: halfway lies the mean of both ends.
    #[test]
    fn what_varies_evenly_has_the_mean_of_its_ends_halfway_and_keeps_its_sign() {
        let over = |knots: &[f64]| Family {
            acts: Acts::Bends(0),
            variable: Variable::Place,
            knots: knots.to_vec(),
            measured: false,
            quiet: Vec::new(),
        };
        let (line, bend) = (over(&[0.0, 1.0]), over(&[0.0, 0.5, 1.0]));
        let (low, high) = (line.bend(-0.4), line.bend(0.8));
        assert!((line.bend(0.5 * (-0.4 + 0.8)) - 0.5 * (low + high)).abs() < 1e-12);
        assert_eq!(line.bend(-3.0), LEAST_FACTOR);
        assert!((bend.bend(0.2) - 0.2_f64.exp()).abs() < 1e-12);
    }

    /// A straight line goes on where its knots end, for the motion and for its derivatives alike.
    #[test]
    fn a_straight_line_goes_on_beyond_its_knots() {
        let current: &[(&str, &[(&str, f64)])] = &[("current", &[("vx_mps", 0.02)])];
        let own = setting(&[surge(0, current)]);
        let weights = Weights::first(&own.tracks);
        let current = candidate(&own, "current");
        let set = [current];
        let posed = Posed::new(&own, &weights, &set);
        let fit = posed.fit(posed.start()).unwrap();
        let seen = &own.tracks[0].measured;
        let low = seen.iter().copied().fold(f64::INFINITY, f64::min);
        let high = seen.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        let over = |first: f64, last: f64| Family {
            acts: Acts::Bends(current),
            variable: Variable::Place,
            knots: vec![low + first * (high - low), low + last * (high - low)],
            measured: false,
            quiet: Vec::new(),
        };
        // The same line by its values at two other places: a change of unknowns, by the same derivatives.
        let (whole, part) = (over(0.0, 1.0), over(0.3, 0.8));
        let (all, some) = (whole.columns(&own, &fit), part.columns(&own, &fit));
        let turned = |k: usize| {
            let (first, second) = if k == 0 { (0.7, 0.2) } else { (0.3, 0.8) };
            some.column(0) * first + some.column(1) * second
        };
        // Hats 1 - s and s at s = 0.3 and 0.8.
        for k in 0..2 {
            let apart = (turned(k) - all.column(k)).norm();
            assert!(apart < 1e-9 * all.column(k).norm(), "{k}: {apart:e}");
        }
        assert_eq!(whole.between(high + 5.0 * (high - low)), (0, 2.0));
    }
}
