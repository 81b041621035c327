//! Clocks that were set in mid-run: stamps that jump on while the motion goes on as from one row to the next.
//!
//! Rows that are missing leave a way: a vehicle under way comes as much further as the gap is long. Where every channel
//! that would show it stands where its next row would have, no time has passed but on the clock.

use std::f64::consts::{PI, TAU};

use super::{Finding, FindingList, Options, name, quantile};
use crate::table::Imported;

/// No recording of a run pauses for so long \[s\]: a day. A step beyond is the clock's, whatever the motion does.
const PAUSE_MAX_S: f64 = 86_400.0;
/// Rows on either side of a gap that tell how fast a channel goes on there.
const SIDE_ROWS: usize = 8;
/// Way along these rows from which it goes on at all, in times of what rows differ from a straight line by.
const SIDE_CURVATURES: f64 = 3.0;
/// Way that a gap must leave at the speeds beside it, in times of what rows differ from a straight line by: below, a
/// vehicle that hardly moves shows nothing.
const WAY_CURVATURES: f64 = 10.0;
/// A channel that is no further off its next row than this many times that goes on as from row to row.
const NEXT_CURVATURES: f64 = 2.0;
/// Speeds on the two sides of a row agree within this share.
const SPEED_SHARE: f64 = 0.5;
/// Rows behind a gap that follow each other by less than this share of the usual step catch it up: stamps that came late.
const LATE_SHARE: f64 = 0.5;

/// A step of the clock: the rows on its two sides.
#[derive(Debug, Clone, Copy)]
struct Step {
    rows: [usize; 2],
    /// Channel that goes on through it; `None` = it is only too long for a pause.
    shown_by: Option<&'static str>,
}

/// Rows on one side of a gap: their usual step \[s\], the way along them, and its mean speed.
struct Side {
    step_s: f64,
    way: f64,
    speed: f64,
}

/// Evidence of a channel about a gap.
enum Says {
    /// It goes on as from one row to the next.
    NoTime,
    /// It came further, or turned meanwhile.
    Time,
    /// It hardly moves, or too few rows stand beside the gap.
    Nothing,
}

/// One channel where it is measured.
struct Track<'a> {
    rows: Vec<usize>,
    values: &'a [f64],
    times_s: &'a [f64],
    is_angle: bool,
    usual_s: f64,
    /// Distance of a row from the straight line through those before it; a twentieth of them is further off.
    curvature: f64,
}

impl<'a> Track<'a> {
    fn of(place: usize, data: &'a Imported) -> Option<Track<'a>> {
        let values = &data.motion[place];
        let rows: Vec<usize> = (0..values.len())
            .filter(|k| values[*k].is_finite())
            .collect();
        let mut track = Track {
            rows,
            values,
            times_s: &data.times_s,
            is_angle: (3..6).contains(&place),
            usual_s: 0.0,
            curvature: 0.0,
        };
        let n = track.rows.len();
        let mut steps: Vec<f64> = (1..n).map(|i| track.time_s(i - 1, i)).collect();
        steps.retain(|s| *s > 0.0);
        track.usual_s = quantile(&mut steps, 0.5)?;
        let mut curvatures: Vec<f64> = (2..n)
            .map(|i| (track.change(i - 1, i) - track.change(i - 2, i - 1)).abs())
            .collect();
        let mut changes: Vec<f64> = (1..n).map(|i| track.change(i - 1, i).abs()).collect();
        changes.retain(|c| *c > 0.0);
        // A coarse instrument stands and steps.
        let quantum = match 2 * changes.len() < n {
            true => quantile(&mut changes, 0.5)?,
            false => 0.0,
        };
        track.curvature = quantile(&mut curvatures, 0.95)?.max(quantum);
        (track.curvature > 0.0).then_some(track)
    }

    fn change(&self, from: usize, to: usize) -> f64 {
        let change = self.values[self.rows[to]] - self.values[self.rows[from]];
        match self.is_angle {
            true => (change + PI).rem_euclid(TAU) - PI,
            false => change,
        }
    }

    fn time_s(&self, from: usize, to: usize) -> f64 {
        self.times_s[self.rows[to]] - self.times_s[self.rows[from]]
    }

    fn side(&self, rows: std::ops::Range<usize>, gap_s: f64) -> Option<Side> {
        let last = rows.end.checked_sub(1)?;
        let mut steps: Vec<f64> = rows
            .clone()
            .skip(1)
            .map(|i| self.time_s(i - 1, i))
            .collect();
        // Beside another gap there is no speed.
        if steps.len() < 2 || steps.iter().any(|s| *s <= 0.0 || *s > gap_s) {
            return None;
        }
        Some(Side {
            step_s: quantile(&mut steps, 0.5)?,
            way: self.change(rows.start, last),
            speed: self.change(rows.start, last) / self.time_s(rows.start, last),
        })
    }

    /// Evidence about the step to its row `i`.
    fn says(&self, i: usize, longest_s: f64) -> Says {
        let before = self.side(i.saturating_sub(SIDE_ROWS)..i, longest_s);
        let after = self.side(i..(i + SIDE_ROWS).min(self.rows.len()), longest_s);
        let (Some(before), Some(after)) = (before, after) else {
            return Says::Nothing;
        };
        let mean = 0.5 * (before.speed + after.speed);
        let off = (self.change(i - 1, i) - mean * self.usual_s).abs();
        let slower = before.speed.abs().min(after.speed.abs());
        let way = slower * (self.time_s(i - 1, i) - self.usual_s);
        let near = NEXT_CURVATURES * self.curvature;
        let moves = [&before, &after]
            .iter()
            .all(|side| side.way.abs() > SIDE_CURVATURES * self.curvature);
        let alike = before.speed * after.speed > 0.0
            && (after.speed - before.speed).abs() <= SPEED_SHARE * mean.abs();
        if off > 3.0 * near || after.step_s < LATE_SHARE * self.usual_s {
            Says::Time
        } else if moves && alike && off <= near && way > WAY_CURVATURES * self.curvature {
            Says::NoTime
        } else {
            Says::Nothing
        }
    }
}

/// Steps of the clock within a table.
fn steps(data: &Imported, options: &Options) -> Vec<Step> {
    let (mut found, mut refuted): (Vec<Step>, Vec<[f64; 2]>) = (Vec::new(), Vec::new());
    for place in 0..6 {
        let Some(track) = Track::of(place, data) else {
            continue;
        };
        let longest_s = options.gap_steps * track.usual_s;
        for i in 1..track.rows.len() {
            if track.time_s(i - 1, i) <= longest_s {
                continue;
            }
            let rows = [track.rows[i - 1], track.rows[i]];
            match track.says(i, longest_s) {
                Says::NoTime => found.push(Step {
                    rows,
                    shown_by: Some(name(place)),
                }),
                Says::Time => refuted.push(rows.map(|k| data.times_s[k])),
                Says::Nothing => {}
            }
        }
    }
    let overlaps = |step: &Step, [from, to]: &[f64; 2]| {
        data.times_s[step.rows[0]] < *to && *from < data.times_s[step.rows[1]]
    };
    found.retain(|step| !refuted.iter().any(|other| overlaps(step, other)));
    let long = (1..data.times_s.len()).map(|k| [k - 1, k]).filter(|rows| {
        let [from_s, to_s] = rows.map(|k| data.times_s[k]);
        to_s - from_s >= PAUSE_MAX_S
    });
    found.extend(long.map(|rows| Step {
        rows,
        shown_by: None,
    }));
    // Channels of one table see the same step.
    found.sort_by_key(|s| (s.rows[1], s.rows[0], s.shown_by.is_none()));
    found.dedup_by(|b, a| b.rows[0] < a.rows[1]);
    found
}

/// Adds the fault, with the two runs that there are instead; `way_on` words them by the ends of the first run and the
/// start of the second \[s after the first row\].
pub(super) fn check(
    data: &Imported,
    options: &Options,
    way_on: impl Fn(f64, f64) -> String,
    findings: &mut Vec<Finding>,
) {
    let all = steps(data, options);
    let Some(first) = all.first() else {
        return;
    };
    let [from_s, to_s] = first.rows.map(|k| data.times_s[k]);
    let line = data.lines.get(first.rows[1]).copied();
    let reason = match first.shown_by {
        Some(channel) => format!("while {channel} goes on as from one row to the next"),
        None => "which no recording of a run pauses for".to_owned(),
    };
    let more = match all.len() {
        1 => String::new(),
        n => format!(" (the first of {n} such steps)"),
    };
    // Half a row beside the ends, so that no rounding takes a row.
    let mut rows: Vec<f64> = data.times_s.windows(2).map(|w| w[1] - w[0]).collect();
    rows.retain(|s| *s > 0.0);
    let half_s = 0.5 * quantile(&mut rows, 0.5).unwrap_or(0.0).min(to_s - from_s);
    findings.fault_at(
        "clock_step",
        line,
        format!(
            "time jumps by {:.3} s on line {}{more}, {reason}: the clock was set in mid-run (NTP, GPS)? {}",
            to_s - from_s,
            line.unwrap_or(0),
            way_on(from_s + half_s, to_s - half_s),
        ),
    );
}

/// The two runs by the keys of a map.
pub(super) fn by_map(to_s: f64, from_s: f64) -> String {
    format!(
        "Import two runs: [time] to_s = {to_s:.3} takes the one before, from_s = {from_s:.3} the one behind"
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Surge at 25 Hz with noise, its stamps set ahead by `set_s` and `lost` rows missing at the middle.
    fn surge(set_s: f64, lost: usize, speed_mps: f64) -> Vec<Finding> {
        let mut data = Imported::default();
        for k in (0..300).filter(|k| !(150..150 + lost).contains(k)) {
            let t_s = 0.04 * k as f64;
            let noise_m = 1.5e-4 * ((k * 7919 % 101) as f64 / 50.0 - 1.0);
            let ahead_s = if k >= 150 { set_s } else { 0.0 };
            data.times_s.push(t_s + ahead_s);
            data.lines.push(k as u64 + 2);
            let way_m = speed_mps * (t_s + (0.5 * t_s).sin());
            data.motion[0].push(way_m + noise_m);
            data.motion[2].push(0.8 + noise_m);
        }
        let mut found = Vec::new();
        check(&data, &Options::default(), by_map, &mut found);
        found
    }

    #[test]
    fn a_clock_that_is_set_while_the_vehicle_moves_is_a_fault_at_any_size() {
        for set_s in [1.0, 18.0, 37.0, 1000.7, 1e6 + 0.7, 3.2e9] {
            let found = surge(set_s, 0, 0.2);
            assert_eq!(found.len(), 1, "{set_s}");
            let words = &found[0].message;
            assert!(
                words.contains("to_s = 5.980") && words.contains("from_s ="),
                "{words}"
            );
            assert_eq!(found[0].line, Some(152));
        }
    }

    #[test]
    fn rows_that_are_missing_and_pauses_at_rest_are_no_step_of_the_clock() {
        assert!(surge(0.0, 0, 0.2).is_empty());
        for lost in [4, 10, 25, 100] {
            assert!(surge(0.0, lost, 0.2).is_empty(), "{lost}");
        }
        for pause_s in [1.0, 60.0, 3600.7, 80_000.0] {
            assert!(surge(pause_s, 0, 0.0).is_empty(), "{pause_s}");
        }
        assert_eq!(surge(90_000.0, 0, 0.0).len(), 1);
    }

    /// Rows held up on their way and stamped on arrival: time has passed, and is caught up.
    #[test]
    fn stamps_that_came_late_are_no_step_of_the_clock() {
        let mut data = Imported::default();
        for k in 0..300 {
            let t_s = 0.04 * f64::from(k);
            let stamp_s = if (150..170).contains(&k) {
                6.8 + 1e-4 * f64::from(k - 150)
            } else {
                t_s
            };
            data.times_s.push(stamp_s);
            data.lines.push(k as u64 + 2);
            data.motion[0].push(0.2 * (t_s + (0.5 * t_s).sin()) + 1e-4 * f64::from(k % 3));
        }
        let mut found = Vec::new();
        check(&data, &Options::default(), by_map, &mut found);
        assert!(found.is_empty(), "{found:?}");
    }
}
