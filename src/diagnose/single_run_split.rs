//! One recording by itself: the stretches it is made of.
//!
//! A fit to all of a recording has nothing left to predict. So the recording is cut into four stretches, each a run of its
//! own, and each is predicted by the others.

use hydroline_rigs::{Dof, Rig};

use hydroline_core::run::{Channel, Run};

/// Stretches of a recording.
const STRETCHES: usize = 4;
/// Shortest of them \[s\], and its fewest samples.
const SHORTEST_S: f64 = 5.0;
/// See [`SHORTEST_S`].
const FEWEST: usize = 100;
/// Swing of a decay over the tolerance below which it is not looked for where it was released.
const SWINGS: f64 = 5.0;

/// A run without any load.
fn is_decay(run: &Run) -> bool {
    run.largest_wrench().iter().all(|w| *w == 0.0)
}

/// A recording in equal stretches; `None` where they are too short to say anything.
pub(super) fn stretches(run: &Run) -> Option<[Run; STRETCHES]> {
    let (first_s, end_s) = (run.samples.first()?.t_s, run.end_s());
    let each_s = (end_s - first_s) / STRETCHES as f64;
    if each_s < SHORTEST_S || run.samples.len() < STRETCHES * FEWEST {
        return None;
    }
    let edge_s = |k: usize| first_s + k as f64 * each_s;
    let parts = std::array::from_fn(|k| {
        let from_s = edge_s(k);
        // A sample belongs to one stretch only.
        let to_s = if k + 1 == STRETCHES {
            end_s
        } else {
            edge_s(k + 1).next_down()
        };
        let mut part = run.clone().window(from_s, to_s);
        part.name = format!("{}@{from_s:.1}..{:.1}", run.name, edge_s(k + 1));
        part
    });
    let filled = |part: &Run| part.samples.len() >= FEWEST;
    parts.iter().all(filled).then_some(parts)
}

/// Share of the farthest excursion that a turn has at least in a hull that swings.
const TURNS: f64 = 0.3;
/// Half periods at a log's start within which a hull that swings from its first stamp on has turned on both sides.
const BOTH_SIDES: f64 = 2.2;

/// When a log without any load was released \[s since its start\], and in which channel: a hull is pressed down and swings
/// freely from then on. `None` = it is free from its first stamp.
///
/// The largest excursion may still be held; the next turn on the other side of rest is free for certain. A hull that swings
/// from the first stamp on was not held, whichever of its swings is the farthest. All times scale with its own period.
pub(super) fn release_instant(run: &Run, rig: &Rig) -> Option<(f64, &'static str)> {
    if !is_decay(run) {
        return None;
    }
    // Only roll and pitch have a place to swing about.
    [Dof::Roll, Dof::Pitch].into_iter().find_map(|dof| {
        let channel = Channel::POSES[dof.index()];
        let rest = run.median(channel)?;
        let angles: Vec<(f64, f64)> = run
            .samples
            .iter()
            .filter(|s| s.values[channel].is_finite())
            .map(|s| (s.t_s, s.values[channel] - rest))
            .collect();
        let (first_s, _) = *angles.first()?;
        let farthest = angles
            .iter()
            .enumerate()
            .max_by(|a, b| a.1.1.abs().total_cmp(&b.1.1.abs()))?
            .0;
        let (at_s, excursion) = angles[farthest];
        if excursion.abs() < SWINGS * rig.tolerance.attitude_rad {
            return None;
        }
        let beyond = |a: &(f64, f64)| a.1 * excursion.signum() < 0.0;
        let crossed = farthest + angles[farthest..].iter().position(beyond)?;
        let back = angles[crossed..]
            .iter()
            .position(|a| !beyond(a))
            .map_or(angles.len(), |k| crossed + k);
        let turn = angles[crossed..back]
            .iter()
            .max_by(|a, b| a.1.abs().total_cmp(&b.1.abs()))?;
        // It swings on: a hull that only came to rest at another place was not released.
        let back_s = angles.get(back)?.0;
        let half_s = back_s - angles[crossed].0;
        let is_turn = |a: &(f64, f64)| beyond(a) && a.1.abs() > TURNS * excursion.abs();
        let swings_at_first = angles[..farthest]
            .iter()
            .take_while(|a| a.0 - first_s <= BOTH_SIDES * half_s)
            .any(is_turn);
        // A log that begins within the swing is free from its start.
        let swing_s = turn.0 - at_s;
        (at_s - first_s > swing_s && is_turn(turn) && !swings_at_first)
            .then(|| (turn.0, channel.name()))
    })
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;
    use hydroline_core::run::{Command, PerChannel, Sample};

    /// At rest, pressed to one side, held for a second, released at 8 s.
    fn decay() -> Run {
        let samples = (0..2000).map(|k| {
            let t_s = 0.02 * f64::from(k);
            let phi = match t_s {
                t if t < 5.0 => 0.0,
                t if t < 7.0 => -0.09 * (t - 5.0),
                t if t < 8.0 => -0.18,
                t => -0.18 * (-0.03 * (t - 8.0)).exp() * (2.2 * (t - 8.0)).cos(),
            };
            let mut values = PerChannel::NAN;
            values[Channel::Phi] = phi + 0.01;
            Sample {
                t_s,
                values,
                covariance: None,
            }
        });
        Run {
            name: "decay".to_owned(),
            samples: samples.collect(),
            ..Run::default()
        }
    }

    #[test]
    fn a_decay_begins_at_the_turn_after_the_hull_was_released() {
        let rig = Rig::builtin("lshpi").unwrap();
        let (at_s, channel) = release_instant(&decay(), &rig).unwrap();
        // Half a period after it was released, pi / 2.2 s.
        assert!((at_s - 9.42).abs() < 0.06, "{at_s}");
        assert_eq!(channel, "phi_rad");
    }

    /// Forty samples per period, with the angle of each as a function of time in periods.
    fn at_period(period_s: f64, periods: u32, angle: impl Fn(f64) -> f64) -> Run {
        let samples = (0..40 * periods).map(|k| {
            let at = f64::from(k) / 40.0;
            let mut values = PerChannel::NAN;
            values[Channel::Phi] = angle(at);
            Sample {
                t_s: period_s * at,
                values,
                covariance: None,
            }
        });
        Run {
            samples: samples.collect(),
            ..Run::default()
        }
    }

    /// One that swings at .1 Hz was cut by a third, since its third swing went a little farther than its first.
    #[test]
    fn a_hull_that_swings_from_the_first_stamp_stays_whole_at_any_period() {
        let rig = Rig::builtin("lshpi").unwrap();
        let turn = std::f64::consts::TAU;
        for period_s in [10.0, 1.0] {
            for phase in [0.0, 0.25, 0.6, 0.9] {
                let swinging = at_period(period_s, 6, |at| {
                    let farther = if (2.0..3.0).contains(&at) { 1.1 } else { 1.0 };
                    0.12 * farther * (-0.02 * at).exp() * (turn * (at + phase)).cos()
                });
                let released = release_instant(&swinging, &rig);
                assert_eq!(released, None, "{period_s} s, phase {phase}");
            }
            // At rest, pressed, held and released, all in periods of its own.
            let held = at_period(period_s, 12, |at| match at {
                t if t < 2.0 => 0.0,
                t if t < 3.0 => 0.15 * (t - 2.0),
                t if t < 4.0 => 0.15,
                t => 0.15 * (-0.05 * (t - 4.0)).exp() * (turn * (t - 4.0)).cos(),
            });
            let (at_s, _) = release_instant(&held, &rig).unwrap();
            let released = at_s / period_s;
            assert!((released - 4.5).abs() < 0.06, "{period_s} s: {released}");
        }
    }

    #[test]
    fn a_decay_from_its_first_stamp_and_a_driven_run_stay_whole() {
        let rig = Rig::builtin("lshpi").unwrap();
        assert_eq!(release_instant(&decay().window(9.42, 40.0), &rig), None);
        let mut driven = decay();
        driven.commands.push(Command {
            t_s: 5.0,
            wrench: [0.0, 0.0, 0.0, 1.0, 0.0, 0.0],
        });
        assert_eq!(release_instant(&driven, &rig), None);
        let mut heeled = decay();
        heeled.samples.retain(|s| s.t_s < 8.0);
        assert_eq!(release_instant(&heeled, &rig), None, "nobody released it");
    }

    #[test]
    fn stretches_share_no_sample_and_lose_none() {
        let run = decay();
        let parts = stretches(&run).unwrap();
        let all: Vec<f64> = parts
            .iter()
            .flat_map(|p| p.samples.iter().map(|s| s.t_s))
            .collect();
        let own: Vec<f64> = run.samples.iter().map(|s| s.t_s).collect();
        assert_eq!(all, own);
        assert!(stretches(&run.window(0.0, 15.0)).is_none());
    }
}
