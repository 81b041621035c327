//! A run in stretches: where motion is missing for longer than the vehicle remembers, another run begins.

use super::{Run, Sample};

/// Fewest samples of a stretch between two gaps that say anything of the motion.
const SAMPLES_MIN: usize = 4;
/// Time of a stretch's first sample \[s\]: later than the slack at a log's start, so that its state is free, and no more, so that
/// neither rounding nor what acts on stamps goes with how late it is in the log.
const BEGIN_S: f64 = 2.0;
/// A run that begins later in its log than this \[s\] is taken as such a stretch: a day.
const LATE_S: f64 = 86_400.0;
/// Share of the memory that the samples of a stretch are apart on average, at most: it is the time constant of the slowest motion.
/// Further apart they show where the vehicle came to and not how it moves, and what a fit costs goes with stamps.
const APART_SHARE: f64 = 0.2;
/// Most stretches of one run: beyond, the time of a fit grows with their number and intervals shrink with its root.
const STRETCHES_MAX: usize = 12;

/// Longest time between the samples of a stretch on average \[s\], of a vehicle that remembers for `memory_s`: the time constant of
/// its slowest motion.
pub fn longest_step_s(memory_s: f64) -> f64 {
    APART_SHARE * memory_s
}

impl Run {
    /// The run cut at every gap of its motion that is longer than `memory_s`; itself where there is none.
    ///
    /// Motion after such a gap does not depend on that before it, and what it costs to integrate over the gap goes with
    /// the stamps instead of with the samples. A stretch behind a gap has a clock of its own, its state is free at its
    /// start ([`super::start_s`]), and it keeps the command in force there; so has a run that begins days into its log.
    /// Samples that are on average further apart than [`longest_step_s`] are cut at each step that is longer than that.
    /// Of more than twelve the longest are kept, and none of fewer than four samples: what is left out is noted. Empty
    /// where all samples are that far apart.
    pub fn stretches(&self, memory_s: f64) -> Vec<Run> {
        let is_late = self.samples.first().is_some_and(|s| s.t_s > LATE_S);
        let all = self.parts(memory_s);
        if all.len() <= 1 {
            let mut whole = self.clone();
            if is_late {
                whole = self.stretch(&self.samples, true);
                (whole.name, whole.notes) = (self.name.clone(), self.notes.clone());
            }
            return vec![whole];
        }
        let long_enough = all.into_iter().filter(|p| p.len() >= SAMPLES_MIN);
        let mut parts: Vec<&[Sample]> = long_enough.collect();
        parts.sort_by_key(|p| std::cmp::Reverse(p.len()));
        parts.truncate(STRETCHES_MAX);
        parts.sort_by(|a, b| a[0].t_s.total_cmp(&b[0].t_s));
        let mut made: Vec<Run> = parts
            .iter()
            .map(|part| self.stretch(part, is_late))
            .collect();
        let count = made.len();
        if let Some(first) = made.first_mut() {
            let reason = match self.longest_gap().filter(|gap| gap.1 > memory_s) {
                Some((from_s, gap_s)) => format!(
                    "no motion for {gap_s:.1} s after {from_s:.2} s, longer than the vehicle remembers ({memory_s:.0} s)"
                ),
                None => format!(
                    "samples are more than {:.0} s apart on average, the time constant of the vehicle's slowest motion",
                    longest_step_s(memory_s)
                ),
            };
            let mut note = format!(
                "{}: {reason}: taken as {count} run(s), each with a start of its own",
                self.name,
            );
            let kept: usize = parts.iter().map(|p| p.len()).sum();
            if kept < self.samples.len() {
                note += &format!(
                    "; {} of {} samples stand in short stretches between such gaps and are left out",
                    self.samples.len() - kept,
                    self.samples.len()
                );
            }
            first.notes.clone_from(&self.notes);
            first.notes.push(note);
        }
        made
    }

    /// Samples between which the vehicle remembers, and of which each shows how it moved since the one before.
    fn parts(&self, memory_s: f64) -> Vec<&[Sample]> {
        let step_s = longest_step_s(memory_s);
        let is_sparse = |part: &[Sample]| match part {
            [first, .., last] => last.t_s - first.t_s > step_s * (part.len() - 1) as f64,
            _ => false,
        };
        let mut parts: Vec<&[Sample]> = Vec::new();
        for part in self.samples.chunk_by(|a, b| b.t_s - a.t_s <= memory_s) {
            match is_sparse(part) {
                true => parts.extend(part.chunk_by(|a, b| b.t_s - a.t_s <= step_s)),
                false => parts.push(part),
            }
        }
        parts
    }

    /// Longest time without a sample: where it begins and how long it is \[s\]; `None` below two samples.
    pub fn longest_gap(&self) -> Option<(f64, f64)> {
        let gaps = self
            .samples
            .windows(2)
            .map(|w| (w[0].t_s, w[1].t_s - w[0].t_s));
        gaps.max_by(|a, b| a.1.total_cmp(&b.1))
    }

    /// The stretch with most samples; `None` where all samples are further apart than `memory_s`.
    pub fn longest_stretch(&self, memory_s: f64) -> Option<Run> {
        let all = self.stretches(memory_s).into_iter();
        all.max_by_key(|run| run.samples.len())
    }

    /// Some of the samples as a run of its own; `is_late`: the run's first ones too.
    fn stretch(&self, samples: &[Sample], is_late: bool) -> Run {
        let (from_s, to_s) = (samples[0].t_s, samples[samples.len() - 1].t_s);
        // Commands of before a run's first motion move the vehicle into it.
        let is_first = self.samples[0].t_s == from_s && !is_late;
        let (from, offset_s) = match is_first {
            true => (0, 0.0),
            false => (
                self.commands.partition_point(|c| c.t_s <= from_s).max(1) - 1,
                from_s - BEGIN_S,
            ),
        };
        let to = self.commands.partition_point(|c| c.t_s <= to_s);
        let mut made = Run {
            name: format!("{}@{from_s:.2}..{to_s:.2}", self.name),
            start_ns: self.start_ns.saturating_add((offset_s * 1e9) as u64),
            commands: self.commands[from.min(to)..to].to_vec(),
            samples: samples.to_vec(),
            companions: self.companions.between(from_s, to_s),
            from_pulses: self.from_pulses,
            noise_at_rest: self.noise_at_rest.clone(),
            joined: self.joined,
            instrument_sd: self.instrument_sd,
            shared_errors: self.shared_errors.as_ref().map(|s| s.later_by(-offset_s)),
            notes: Vec::new(),
        };
        if !is_first {
            made.samples.iter_mut().for_each(|s| s.t_s -= offset_s);
            let companions = made.companions.times_s.iter_mut();
            companions.for_each(|t_s| *t_s -= offset_s);
            let commands = made.commands.iter_mut();
            commands.for_each(|c| c.t_s = (c.t_s - offset_s).max(0.0));
        }
        made
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::run::{Command, PerChannel};

    fn run(times_s: impl IntoIterator<Item = f64>) -> Run {
        let sample = |t_s| Sample {
            t_s,
            values: PerChannel::splat(t_s),
            covariance: None,
        };
        let command = |t_s: f64| Command {
            t_s,
            wrench: [t_s, 0.0, 0.0, 0.0, 0.0, 0.0],
        };
        Run {
            name: "r".to_owned(),
            samples: times_s.into_iter().map(sample).collect(),
            commands: [0.0, 0.5, 3.0, 5e8, 3e9 + 0.5, 4e9].map(command).to_vec(),
            ..Run::default()
        }
    }

    #[test]
    fn a_gap_longer_than_the_memory_begins_another_run_under_the_load_in_force() {
        let tenths = |from_s: f64| (0..11).map(move |k| from_s + 0.1 * f64::from(k));
        let whole = run(tenths(0.0).chain(tenths(31.0)));
        assert_eq!(whole.stretches(60.0), std::slice::from_ref(&whole));
        let parts = run(tenths(0.0).chain(tenths(3e9))).stretches(60.0);
        let loads = |r: &Run| r.commands.iter().map(|c| c.wrench[0]).collect::<Vec<_>>();
        assert_eq!(parts.len(), 2);
        assert_eq!(loads(&parts[0]), [0.0, 0.5]);
        assert_eq!(loads(&parts[1]), [5e8, 3e9 + 0.5]);
        assert_eq!(parts[1].samples.len(), 11);
        // Its clock begins anew, under the load in force.
        assert!((parts[1].samples[0].t_s - 2.0).abs() < 1e-6);
        assert!((parts[1].commands[1].t_s - 2.5).abs() < 1e-6);
        assert_eq!(parts[1].wrench_at(2.0)[0], 5e8);
        assert_eq!(parts[1].start_ns, 2_999_999_998_000_000_000);
        assert!(
            parts[0].notes[0].contains("2 run(s)"),
            "{:?}",
            parts[0].notes
        );
        assert_ne!(parts[0].name, parts[1].name);
    }

    #[test]
    fn samples_that_stand_alone_are_left_out_and_said_and_a_thousand_gaps_make_a_dozen_runs() {
        let alone = run([0.0, 1e3, 1e3 + 0.1, 1e3 + 0.2, 1e3 + 0.3, 1e6]).stretches(60.0);
        assert_eq!(alone.len(), 1);
        assert!(
            alone[0].notes[0].contains("2 of 6 samples"),
            "{:?}",
            alone[0].notes
        );
        assert!(
            run((0..9).map(|k| 1e4 * f64::from(k)))
                .stretches(60.0)
                .is_empty()
        );
        let burst = |k: u32| (0..5 + k % 7).map(move |j| 1e4 * f64::from(k) + 0.1 * f64::from(j));
        let many = run((0..1000).flat_map(burst)).stretches(60.0);
        assert_eq!(many.len(), STRETCHES_MAX);
        assert!(many.iter().all(|r| r.samples.len() == 11));
    }

    /// Every row of such a log cost 2500 steps of each simulation of a fit.
    #[test]
    fn samples_further_apart_than_the_slowest_time_constant_are_no_stretch() {
        let apart = |step_s: f64| run((0..50).map(move |k| step_s * f64::from(k)));
        for step_s in [25.0, 100.0, 119.0] {
            assert!(apart(step_s).stretches(120.0).is_empty(), "{step_s}");
        }
        assert_eq!(apart(23.0).stretches(120.0), [apart(23.0)]);
        // Bursts between them are runs of their own, and a gap among many samples cuts nothing.
        let bursts = |samples: u32| {
            let burst =
                move |k: u32| (0..samples).map(move |j| 119.0 * f64::from(k) + 0.1 * f64::from(j));
            run((0..5).flat_map(burst))
        };
        let parts = bursts(4).stretches(120.0);
        assert_eq!(parts.len(), 5);
        assert!(
            parts[0].notes[0].contains("24 s apart"),
            "{:?}",
            parts[0].notes
        );
        assert_eq!(bursts(6).stretches(120.0).len(), 1);
    }
}
