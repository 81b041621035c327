//! Windows of one recording that meet: one run, which somebody has given in parts.

use super::{Run, Sample};

/// Gap between two windows over the longest step within them, up to which they meet.
const MEETS: f64 = 1.5;

/// Longest step within samples \[s\].
fn longest_step_s(samples: &[Sample]) -> f64 {
    let steps = samples.windows(2).map(|w| w[1].t_s - w[0].t_s);
    steps.fold(0.0, f64::max)
}

/// Name of both windows: from where the first begins to where the second ends.
fn name(first: &str, second: &str) -> String {
    let ends = |name: &str| -> Option<(String, String, String)> {
        let (log, window) = name.rsplit_once('@')?;
        let (from, to) = window.split_once("..")?;
        Some((log.to_owned(), from.to_owned(), to.to_owned()))
    };
    match (ends(first), ends(second)) {
        (Some((log, from, _)), Some((_, _, to))) => format!("{log}@{from}..{to}"),
        _ => first.to_owned(),
    }
}

impl Run {
    /// This run and the window that goes on where it ends, as one run; `None` where the other is of another recording, or where
    /// samples lie between them or in both.
    pub fn joined_with(&self, next: &Run) -> Option<Run> {
        let is_same = self.start_ns == next.start_ns
            && self.commands == next.commands
            && self.from_pulses == next.from_pulses;
        let (last, first) = (self.samples.last()?, next.samples.first()?);
        let gap_s = first.t_s - last.t_s;
        let step_s = longest_step_s(&self.samples).max(longest_step_s(&next.samples));
        if !is_same || gap_s <= 0.0 || gap_s > MEETS * step_s {
            return None;
        }
        let mut made = self.clone();
        made.name = name(&self.name, &next.name);
        made.samples.extend_from_slice(&next.samples);
        let new = next.notes.iter().filter(|n| !self.notes.contains(n));
        made.notes.extend(new.cloned());
        made.noise_at_rest = made.noise_at_rest.or_else(|| next.noise_at_rest.clone());
        Some(made)
    }
}

#[cfg(test)]
mod tests {
    use super::super::Command;
    use super::*;
    use crate::run::PerChannel;

    fn run(stamps: impl Iterator<Item = u32>) -> Run {
        let sample = |k| Sample {
            t_s: 0.04 * f64::from(k),
            values: PerChannel::splat(f64::from(k)),
            covariance: None,
        };
        Run {
            name: "log".to_owned(),
            start_ns: 7,
            commands: vec![Command {
                t_s: 0.1,
                wrench: [1.0; 6],
            }],
            samples: stamps.map(sample).collect(),
            ..Run::default()
        }
    }

    #[test]
    fn windows_that_meet_are_the_run_they_were_cut_from() {
        let whole = run(0..100);
        let [mut first, mut second] =
            [(0.0, 1.5), (1.501, 9.0)].map(|(from_s, to_s)| whole.clone().window(from_s, to_s));
        first.name = "log@..1.5".to_owned();
        second.name = "log@1.501..9".to_owned();
        let joined = first.joined_with(&second).unwrap();
        assert!(joined.same_recording(&whole));
        assert_eq!(joined.name, "log@..9");
        assert!(second.joined_with(&first).is_none());
        // A stop between them, another log, a sample in both.
        assert!(first.joined_with(&whole.clone().window(1.7, 9.0)).is_none());
        assert!(first.joined_with(&whole).is_none());
        second.start_ns = 8;
        assert!(first.joined_with(&second).is_none());
    }
}
