//! What is diagnosed: the runs of one DOF, the rig's model of it, and the candidates.

use hydroline_rigs::{Dof, Rig, Vehicle};
use hydroline_sim::effect::{CheckedEffect, EffectError, EffectStack, check};
use hydroline_sim::single::{AsTheyAre, Feed, Instant, Line, Retune, Single};
use hydroline_sim::vehicle::Hydrodynamics;
use hydroline_sim::{Dual, Real};
use nalgebra::DMatrix;

use super::candidate::{Candidate, limit, vocabulary};
use super::scale::{factors, rescale};
use hydroline_identify::data::{CHANNELS, Run};
use hydroline_identify::parameter::{Coefficient, Term};
use hydroline_inference::recording;

/// Longest RK4 step \[s\]: with time constants of seconds its error is below 1e-7 of the motion.
const STEP_MAX_S: f64 = 0.04;
/// Thrusters whose mean a law is that stands twice with its corners in the load.
const SIDE_BY_SIDE: usize = 8;
/// A log whose motion starts this late is one cut to a window: the state is free at its first stamp \[s\].
const START_SLACK_S: f64 = 1.0;
/// Derivatives per pass.
pub const PASS: usize = 16;

/// Samples per second looked at: of denser ones every second, third … [1/s]. Slow motion and correlated
/// noise say no more with more of them.
const RATE_MOST_HZ: f64 = 60.0;

/// One run along one DOF.
#[derive(Debug, Clone, PartialEq)]
pub struct Track {
    /// Name of the run.
    pub name: String,
    /// Stamps of the measured positions \[s\].
    pub times_s: Vec<f64>,
    /// Positions along the line \[m, rad\].
    pub measured: Vec<f64>,
    /// (time, load of this DOF), only changes.
    pub edges: Vec<(f64, f64)>,
    /// Where the state is given \[s\].
    pub start_s: f64,
    /// The line.
    pub line: Line,
}

impl Track {
    /// The run's motion along one DOF; `None` where its channel has fewer than 8 samples.
    pub fn of(run: &Run, dof: Dof) -> Option<Track> {
        let i = dof.index();
        let mut rest = [0.0; 6];
        for (c, value) in rest.iter_mut().enumerate() {
            *value = run.median(c).unwrap_or(0.0);
        }
        let both = run.count(0) > 0 && run.count(1) > 0;
        if i < 2 && !both {
            rest[5] = 0.0;
        }
        let line = Line { dof: i, rest };
        let (mut times_s, mut measured) = (Vec::new(), Vec::new());
        for sample in &run.samples {
            let pose: [f64; 6] = std::array::from_fn(|c| {
                let v = sample.values[c];
                if c == i || (i < 2 && c < 2 && both) {
                    v
                } else {
                    rest[c]
                }
            });
            let s = line.along(&pose);
            if s.is_finite() {
                times_s.push(sample.t_s);
                measured.push(s);
            }
        }
        if times_s.len() < 8 {
            return None;
        }
        let span_s = times_s.last().copied().unwrap_or(0.0) - times_s[0];
        let every = ((times_s.len() - 1) as f64 / span_s.max(1e-9) / RATE_MOST_HZ - 0.05).ceil();
        // A few samples in a row say nothing of a rate.
        if every > 1.0 && span_s > 1.0 {
            let thin = |v: Vec<f64>| v.into_iter().step_by(every as usize).collect::<Vec<_>>();
            (times_s, measured) = (thin(times_s), thin(measured));
        }
        let first_s = times_s.first().copied().unwrap_or(0.0);
        let start_s = if first_s > START_SLACK_S {
            first_s
        } else {
            0.0
        };
        let mut edges: Vec<(f64, f64)> = Vec::new();
        for c in &run.commands {
            let load = c.wrench[i];
            if edges.last().map_or(load != 0.0, |e| e.1 != load) {
                edges.push((c.t_s, load));
            }
        }
        Some(Track {
            name: run.name.clone(),
            times_s,
            measured,
            edges: averaged(edges),
            start_s,
            line,
        })
    }

    /// Measured position at a time, between stamps by a line \[m, rad\].
    pub fn at(&self, t_s: f64) -> f64 {
        let after = self.times_s.partition_point(|t| *t <= t_s);
        match (after.checked_sub(1), self.times_s.get(after)) {
            (Some(k), Some(next)) => {
                let share = (t_s - self.times_s[k]) / (next - self.times_s[k]);
                self.measured[k] + share * (self.measured[after] - self.measured[k])
            }
            (Some(k), None) => self.measured[k],
            (None, _) => self.measured.first().copied().unwrap_or(0.0),
        }
    }

    /// Measured rate at a time, over 0.4 s \[m/s, rad/s\].
    pub fn rate_at(&self, t_s: f64) -> f64 {
        (self.at(t_s + 0.2) - self.at(t_s - 0.2)) / 0.4
    }

    /// Whether the state at the start has a rate of its own: a decay, a window cut out of a run, or a log that
    /// begins under way, farther in 0.2 s than two tolerances \[m, rad\]. Any other driven run starts from rest.
    pub fn starts_under_way(&self, tolerance: f64) -> bool {
        self.edges.is_empty()
            || self.start_s > 0.0
            || self
                .rate_at_start()
                .is_some_and(|rate| 0.2 * rate.abs() > 2.0 * tolerance)
    }

    /// Rate at the first stamp \[m/s, rad/s\]: of the parabola through three medians of three samples each within
    /// the first quarter of a second, so that neither an outlier nor an acceleration from rest looks like a rate. `None`
    /// with fewer than three samples there.
    pub fn rate_at_start(&self) -> Option<f64> {
        let first_s = *self.times_s.first()?;
        let point = |after_s: f64| -> Option<(f64, f64)> {
            let k = self
                .times_s
                .partition_point(|t| *t < first_s + after_s)
                .max(1);
            let mut three: Vec<f64> = self.measured.get(k - 1..k + 2)?.to_vec();
            three.sort_by(f64::total_cmp);
            Some((self.times_s[k] - first_s, three[1]))
        };
        let [(a, at_a), (b, at_b), (c, at_c)] = [point(0.0)?, point(0.1)?, point(0.2)?];
        (a < b && b < c).then(|| {
            // Derivative at 0 of Lagrange's interpolation.
            -(at_a * (b + c) / ((a - b) * (a - c))
                + at_b * (a + c) / ((b - a) * (b - c))
                + at_c * (a + b) / ((c - a) * (c - b)))
        })
    }

    /// Last stamp \[s\].
    pub fn end_s(&self) -> f64 {
        self.times_s.last().copied().unwrap_or(0.0)
    }
}

/// The same, of one load.
fn averaged(edges: Vec<(f64, f64)>) -> Vec<(f64, f64)> {
    let made = recording::averaged(edges.into_iter().map(|(t_s, load)| (t_s, [load])).collect());
    made.into_iter().map(|(t_s, [load])| (t_s, load)).collect()
}

/// The problem of one DOF.
#[derive(Debug)]
pub struct Setting {
    /// Degree of freedom.
    pub dof: Dof,
    /// The rig's vehicle: where the coefficients start.
    pub vehicle: Vehicle,
    /// Effects that the rig already has switched on, held as they are.
    pub base: Vec<CheckedEffect>,
    /// Runs to fit.
    pub tracks: Vec<Track>,
    /// What may have been left out.
    pub vocabulary: Vec<Candidate>,
    /// rms that matters in this DOF \[m, rad\].
    pub tolerance: f64,
}

/// A stack of which one effect's first parameter is bent.
struct Bent<'a, T: Real, F> {
    stack: EffectStack<T>,
    given: usize,
    effect: &'a CheckedEffect,
    straight: T,
    numbers: Vec<T>,
    bend: F,
}

impl<T: Real, F: Fn(&Instant<T>) -> T> Retune<T> for Bent<'_, T, F> {
    fn at(&mut self, here: &Instant<T>) -> Option<&EffectStack<T>> {
        self.numbers[0] = self.straight * (self.bend)(here);
        self.stack
            .replace(self.given, self.effect, &self.numbers)
            .ok()?;
        Some(&self.stack)
    }
}

/// Largest load that runs command \[N, N m\].
fn largest_load(tracks: &[Track]) -> f64 {
    let loads = tracks.iter().flat_map(|t| &t.edges).map(|e| e.1.abs());
    loads.fold(0.0, f64::max)
}

/// Coefficients of one DOF.
pub const COEFFICIENTS: usize = 3;

impl Setting {
    /// One DOF of these runs.
    ///
    /// # Errors
    /// [`EffectError`] for a bad `[[physics]]` entry of the rig.
    pub fn new(runs: &[Run], rig: &Rig, dof: Dof) -> Result<Setting, EffectError> {
        let base = check(&rig.physics)?;
        let tracks: Vec<Track> = runs.iter().filter_map(|r| Track::of(r, dof)).collect();
        let mut vocabulary = vocabulary(dof, &base);
        if let Some((load, speed)) = factors(dof, &rig.vehicle, &tracks) {
            rescale(&mut vocabulary, load, speed);
        }
        limit(&mut vocabulary, largest_load(&tracks));
        Ok(Setting {
            dof,
            vehicle: rig.vehicle.clone(),
            tracks,
            vocabulary,
            base,
            tolerance: if dof.index() < 3 {
                rig.tolerance.position_m
            } else {
                rig.tolerance.attitude_rad
            },
        })
    }

    /// Whether something takes the vehicle back to its place (roll, pitch): elsewhere every small force adds up.
    pub fn is_restored(&self) -> bool {
        matches!(self.dof, Dof::Roll | Dof::Pitch)
    }

    /// The same model with other runs.
    #[must_use]
    pub fn with_tracks(&self, tracks: Vec<Track>) -> Setting {
        Setting {
            dof: self.dof,
            vehicle: self.vehicle.clone(),
            base: self.base.clone(),
            tracks,
            vocabulary: self.vocabulary.clone(),
            tolerance: self.tolerance,
        }
    }

    /// The same model fitted to other runs: a limit on the load may lie anywhere below theirs.
    #[must_use]
    pub fn fitting(&self, tracks: Vec<Track>) -> Setting {
        let mut made = self.with_tracks(tracks);
        limit(&mut made.vocabulary, largest_load(&made.tracks));
        made
    }

    /// Name of the measured channel.
    pub fn channel(&self) -> &'static str {
        CHANNELS[self.dof.index()]
    }

    /// The rig's coefficients of this DOF.
    pub fn coefficients(&self) -> [f64; COEFFICIENTS] {
        Coefficient::of(self.dof).map(|c| c.of_vehicle(&self.vehicle))
    }

    /// Number of parameters of a set of effects.
    pub fn parameters(&self, set: &[usize]) -> usize {
        set.iter()
            .map(|c| self.vocabulary[*c].info.parameters.len())
            .sum()
    }

    /// Place of each member's first parameter in the vector of globals.
    pub fn places(&self, set: &[usize]) -> Vec<usize> {
        let mut at = COEFFICIENTS;
        set.iter()
            .map(|c| {
                let here = at;
                at += self.vocabulary[*c].info.parameters.len();
                here
            })
            .collect()
    }

    fn hydrodynamics<T: Real>(&self, globals: &[T]) -> Hydrodynamics<T> {
        let mut h: Hydrodynamics<T> = Hydrodynamics::new(&self.vehicle);
        for (c, value) in Coefficient::of(self.dof).iter().zip(globals) {
            let place = match c.term {
                Term::Added => &mut h.added,
                Term::Linear => &mut h.linear,
                Term::Quadratic => &mut h.quadratic,
            };
            place[self.dof.index()] = *value;
        }
        h
    }

    fn checked(&self, set: &[usize]) -> Vec<CheckedEffect> {
        let mut on = self.base.clone();
        for c in set {
            let candidate = &self.vocabulary[*c];
            on.push(CheckedEffect {
                info: candidate.info,
                numbers: vec![0.0; candidate.info.parameters.len()],
                words: candidate.words.clone(),
                trend: None,
                notes: Vec::new(),
            });
        }
        on
    }

    /// The stack of a set.
    fn stack<T: Real>(
        &self,
        on: &[CheckedEffect],
        set: &[usize],
        globals: &[T],
    ) -> Result<EffectStack<T>, EffectError> {
        let places = self.places(set);
        let fixed = self.base.len();
        let corner = |c: usize| self.vocabulary[c].info.parameters[0].corner;
        let twice = set.windows(2).position(|w| w[0] == w[1] && corner(w[0]));
        let Some(first) = twice else {
            return EffectStack::assemble(on, |e, p, value| match e.checked_sub(fixed) {
                Some(member) => globals[places[member] + p],
                None => T::from_f64(value),
            });
        };
        // Of a law with a corner in the load the two copies are where the corners of many thrusters begin and end.
        let mut on = on.to_vec();
        let more = on.len();
        on.extend(vec![on[fixed + first].clone(); SIDE_BY_SIDE - 2]);
        let mut stack = EffectStack::assemble(&on, |e, p, value| {
            let Some(member) = e.checked_sub(fixed) else {
                return T::from_f64(value);
            };
            let one = match e.checked_sub(more) {
                Some(k) => k + 2,
                None if member == first || member == first + 1 => member - first,
                None => return globals[places[member] + p],
            };
            let share = (one as f64 + 0.5) / SIDE_BY_SIDE as f64;
            let (low, high) = (globals[places[first] + p], globals[places[first + 1] + p]);
            low * (1.0 - share) + high * share
        })?;
        stack.side_by_side(fixed);
        Ok(stack)
    }

    /// Positions of one run as a set of effects would have them measured.
    pub fn simulate<T: Real>(
        &self,
        run: usize,
        set: &[usize],
        globals: &[T],
        start: (T, T),
        extra: impl Fn(&Instant<T>) -> T,
    ) -> Vec<T> {
        let on = self.checked(set);
        match self.stack(&on, set, globals) {
            Ok(stack) => self.drive(run, &stack, globals, start, &mut AsTheyAre, extra),
            // More own states than fit: such a set is no candidate.
            Err(_) => vec![T::from_f64(f64::NAN); self.tracks[run].times_s.len()],
        }
    }

    /// As [`Setting::simulate`], with a member's first parameter that depends on where the motion is:
    /// `bend(instant)` is what it is multiplied by.
    pub fn simulate_bent<T: Real>(
        &self,
        run: usize,
        set: &[usize],
        globals: &[T],
        start: (T, T),
        member: usize,
        bend: impl Fn(&Instant<T>) -> T,
    ) -> Vec<T> {
        let on = self.checked(set);
        let given = self.base.len() + member;
        let (first, count) = (self.places(set)[member], on[given].numbers.len());
        let stacks = || self.stack(&on, set, globals);
        match (stacks(), stacks()) {
            (Ok(plain), Ok(stack)) => {
                let mut bent = Bent {
                    stack,
                    given,
                    effect: &on[given],
                    straight: globals[first],
                    numbers: globals[first..first + count].to_vec(),
                    bend,
                };
                self.drive(run, &plain, globals, start, &mut bent, |_| T::zero())
            }
            _ => vec![T::from_f64(f64::NAN); self.tracks[run].times_s.len()],
        }
    }

    fn drive<T: Real>(
        &self,
        run: usize,
        stack: &EffectStack<T>,
        globals: &[T],
        start: (T, T),
        retune: &mut impl Retune<T>,
        extra: impl Fn(&Instant<T>) -> T,
    ) -> Vec<T> {
        let track = &self.tracks[run];
        let feed = Feed {
            start_s: track.start_s,
            edges: &track.edges,
            stamps_s: &track.times_s,
            step_max_s: STEP_MAX_S,
            given: None,
        };
        let mut out = Vec::with_capacity(track.times_s.len());
        Single::new(self.hydrodynamics(globals), track.line).run(
            stack,
            &feed,
            start,
            retune,
            extra,
            |x| out.push(x),
        );
        out
    }

    /// Plain positions.
    pub fn values(
        &self,
        run: usize,
        set: &[usize],
        globals: &[f64],
        start: (f64, f64),
    ) -> Vec<f64> {
        self.simulate(run, set, globals, start, |_| 0.0)
    }

    /// Positions and their derivatives: columns = globals, start position, start rate.
    pub fn sensitivities(
        &self,
        run: usize,
        set: &[usize],
        globals: &[f64],
        start: (f64, f64),
    ) -> (Vec<f64>, DMatrix<f64>) {
        let all: Vec<f64> = globals.iter().copied().chain([start.0, start.1]).collect();
        match all.len() {
            0..=6 => self.passes::<6>(run, set, &all),
            7..=8 => self.passes::<8>(run, set, &all),
            9..=12 | 17..=24 => self.passes::<12>(run, set, &all),
            _ => self.passes::<PASS>(run, set, &all),
        }
    }

    fn passes<const N: usize>(
        &self,
        run: usize,
        set: &[usize],
        all: &[f64],
    ) -> (Vec<f64>, DMatrix<f64>) {
        let p = all.len();
        let rows = self.tracks[run].times_s.len();
        let mut jacobian = DMatrix::zeros(rows, p);
        let mut values = Vec::new();
        for first in (0..p).step_by(N) {
            let duals = Dual::<N>::pass(all, first);
            let (globals, start) = duals.split_at(p - 2);
            let out = self.simulate(run, set, globals, (start[0], start[1]), |_| {
                Dual::constant(0.0)
            });
            for (row, value) in out.iter().enumerate() {
                for (i, slope) in value.slope.iter().take(p - first).enumerate() {
                    jacobian[(row, first + i)] = *slope;
                }
            }
            values = out.into_iter().map(|d| d.value).collect();
        }
        (values, jacobian)
    }
}

#[cfg(test)]
mod tests {
    use super::{Track, averaged};
    use crate::testing::surge;
    use hydroline_rigs::Dof;

    /// A table cut in the middle of a motion, its time counted from the cut, was fitted as if it began at rest.
    #[test]
    fn a_log_that_begins_under_way_is_told_from_one_that_begins_at_rest() {
        let rest = Track::of(&surge(2, &[]), Dof::Surge).unwrap();
        assert!(!rest.starts_under_way(0.002));
        let mut outlier = rest.clone();
        outlier.measured[0] += 0.05;
        assert!(!outlier.starts_under_way(0.002));
        let cut = Track {
            times_s: rest.times_s[60..].iter().map(|t| t - 4.8).collect(),
            measured: rest.measured[60..].to_vec(),
            ..rest.clone()
        };
        assert!(cut.start_s == 0.0 && cut.starts_under_way(0.002));
        let rate = (rest.measured[61] - rest.measured[58]) / 0.24;
        let found = cut.rate_at_start().unwrap();
        assert!((found / rate - 1.0).abs() < 0.2, "{found} {rate}");
    }

    #[test]
    fn dense_commands_keep_their_impulse_and_sparse_ones_stay() {
        let sparse = vec![(0.0, 4.0), (3.0, -4.0), (9.0, 0.0)];
        assert_eq!(averaged(sparse.clone()), sparse);
        let dense: Vec<(f64, f64)> = (0..=3000)
            .map(|k| {
                let t_s = 0.001 * f64::from(k);
                (
                    t_s,
                    if k == 3000 {
                        0.0
                    } else {
                        (7.0 * t_s).sin() + 0.3
                    },
                )
            })
            .collect();
        let impulse = |edges: &[(f64, f64)]| -> f64 {
            edges.windows(2).map(|e| e[0].1 * (e[1].0 - e[0].0)).sum()
        };
        let made = averaged(dense.clone());
        assert!(made.len() < 160, "{}", made.len());
        assert!((impulse(&made) - impulse(&dense)).abs() < 1e-9);
        assert_eq!(made.last().map(|e| e.1), Some(0.0));
    }

    /// A span of whole whiles whose sum was rounded onto the last edge left that edge out, and the
    /// thrusters on until the run's end.
    #[test]
    fn the_last_edge_stays_whatever_the_span() {
        for hundredths in 10..1200u32 {
            let edges: Vec<(f64, f64)> = (0..=hundredths)
                .map(|k| {
                    let load = if k == hundredths {
                        0.0
                    } else {
                        1.0 + f64::from(k % 7)
                    };
                    (3.7 + 0.01 * f64::from(k), load)
                })
                .collect();
            assert_eq!(
                averaged(edges).last().map(|e| e.1),
                Some(0.0),
                "{hundredths}"
            );
        }
    }
}
