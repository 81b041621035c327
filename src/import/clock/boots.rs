//! A clock that was started anew within a file: an autopilot that restarted, a logger that goes on in the same file.
//!
//! A stamp that steps (back, or far ahead) is held until the rows behind it tell why: where they follow it, the clock was
//! started anew (or there is a gap); where they follow what stood before, it is wrong.

use crate::check::{Finding, FindingList};
use crate::map::{Map, TimeSource};
use crate::recorded::order::{BACK_NS, follows};

/// Rows that follow a step before it is no row with a wrong stamp.
const CONFIRMED_ROWS: usize = 8;
/// Restarts that are named.
const NAMED_MAX: usize = 8;
/// A counter of a clock that starts again from 0 by itself.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Counter {
    pub bits: u32,
    /// Of one count.
    pub unit: &'static str,
    unit_ns: i128,
}

impl Counter {
    /// Time after which it starts again \[ns\].
    pub fn full_ns(self) -> i128 {
        (1_i128 << self.bits) * self.unit_ns
    }
}

const fn counter(bits: u32, unit: &'static str, unit_ns: i128) -> Counter {
    Counter {
        bits,
        unit,
        unit_ns,
    }
}

/// Counters that instruments have, in the order in which they are tried.
pub(crate) const COUNTERS: [Counter; 5] = [
    counter(32, "us", 1_000),
    counter(32, "ms", 1_000_000),
    counter(32, "ns", 1),
    counter(16, "ms", 1_000_000),
    counter(24, "us", 1_000),
];

/// A clock's new start.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Restart {
    line: u64,
    /// Last stamp before it, and its own first \[ns\].
    last_ns: i128,
    first_ns: i128,
}

/// Rows that wait, all behind a step.
#[derive(Debug, Clone, Copy)]
struct Held {
    rows: usize,
    line: u64,
    first_ns: i128,
    newest_ns: i128,
}

/// Outcome of a row: runs, from 1, of the rows that were held and of itself; `None` = they wait.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Seen {
    pub held: Option<u32>,
    pub own: Option<u32>,
}

/// Runs of a table, row by row.
#[derive(Debug)]
pub(crate) struct Boots {
    /// Whether the clock is one that can start anew.
    counts: bool,
    /// Run that the map names.
    chosen: Option<u32>,
    run: u32,
    newest_ns: Option<i128>,
    held: Option<Held>,
    restarts: Vec<Restart>,
    /// Rows of runs that are not taken.
    pub others: usize,
}

/// Whether a counter that passed its end looks the same.
fn is_turn(last_ns: i128, first_ns: i128) -> bool {
    COUNTERS.iter().any(|counter| {
        let full_ns = counter.full_ns();
        let tenth_ns = full_ns / 10;
        (full_ns - tenth_ns..=full_ns).contains(&last_ns) && (0..=tenth_ns).contains(&first_ns)
    })
}

impl Boots {
    pub fn new(map: &Map) -> Boots {
        let time = &map.time;
        let is_number = matches!(time.source, TimeSource::Numbers(_) | TimeSource::Frames(_));
        Boots {
            counts: is_number && !time.unix,
            chosen: time.boot,
            run: 1,
            newest_ns: None,
            held: None,
            restarts: Vec::new(),
            others: 0,
        }
    }

    /// Whether rows of a run are taken.
    pub fn takes(&self, run: u32) -> bool {
        run == self.chosen.unwrap_or(1)
    }

    /// The next row's stamp.
    pub fn see(&mut self, ns: i128, line: u64) -> Seen {
        let now = |run| Seen {
            held: None,
            own: Some(run),
        };
        let wait = Seen {
            held: None,
            own: None,
        };
        let Some(before_ns) = self.newest_ns.filter(|_| self.counts) else {
            self.newest_ns = Some(ns);
            return now(self.run);
        };
        let step = Held {
            rows: 1,
            line,
            first_ns: ns,
            newest_ns: ns,
        };
        let Some(held) = self.held else {
            if follows(ns, before_ns) {
                self.newest_ns = Some(ns);
                return now(self.run);
            }
            self.held = Some(step);
            return wait;
        };
        let released = |boots: &mut Boots, ns| {
            boots.newest_ns = Some(ns);
            boots.held = None;
            Seen {
                held: Some(boots.run),
                own: Some(boots.run),
            }
        };
        let resumes =
            follows(ns, before_ns) && (ns - before_ns).abs() <= (ns - held.newest_ns).abs();
        if resumes {
            return released(self, ns);
        }
        if follows(ns, held.newest_ns) {
            let rows = held.rows + 1;
            if rows < CONFIRMED_ROWS {
                self.held = Some(Held {
                    rows,
                    newest_ns: ns,
                    ..held
                });
                return wait;
            }
            // Rows in which the time stands are no run.
            let is_run = ns > held.first_ns && before_ns - held.first_ns > BACK_NS;
            if is_run && (self.chosen.is_some() || !is_turn(before_ns, held.first_ns)) {
                self.run = self.run.saturating_add(1);
                self.restarts.push(Restart {
                    line: held.line,
                    last_ns: before_ns,
                    first_ns: held.first_ns,
                });
            }
            return released(self, ns);
        }
        // Neither: what was held goes on, and this one is a step from there.
        self.newest_ns = Some(held.newest_ns);
        self.held = Some(step);
        Seen {
            held: Some(self.run),
            own: None,
        }
    }

    /// Run of the rows that still wait at the table's end: too few to be one of their own.
    pub fn rest(&self) -> u32 {
        self.run
    }

    /// Adds what was found; `first_s` names stamps by the file's own clock.
    pub fn report(&self, findings: &mut Vec<Finding>) {
        let runs = self.run;
        let Some(first) = self.restarts.first() else {
            if let Some(boot) = self.chosen.filter(|b| *b > 1) {
                findings.fault(
                    "boot",
                    format!("time.boot is {boot}, but the clock never starts anew: there is one run; leave boot out"),
                );
            }
            return;
        };
        let seconds = |ns: i128| ns as f64 * 1e-9;
        let named: Vec<String> = self
            .restarts
            .iter()
            .take(NAMED_MAX)
            .map(|r| {
                format!(
                    "{:.3} s (line {} begins at {:.3} s)",
                    seconds(r.last_ns),
                    r.line,
                    seconds(r.first_ns)
                )
            })
            .collect();
        let more = match self.restarts.len().saturating_sub(NAMED_MAX) {
            0 => String::new(),
            n => format!(" and {n} more"),
        };
        let words = format!(
            "restarted at {}{more}: {} runs",
            named.join(", "),
            count(runs)
        );
        let others = self.others;
        match self.chosen {
            Some(boot) if boot > runs => findings.fault(
                "boot",
                format!("time.boot is {boot}, but the clock {words}; boot must be 1 .. {runs}"),
            ),
            Some(boot) => findings.info(
                "restarted",
                format!("{words}; boot = {boot} is taken, {others} row(s) belong to others"),
            ),
            None => {
                let rest = if runs > 2 {
                    format!(", up to boot = {runs}")
                } else {
                    String::new()
                };
                findings.fault_at(
                    "restarted",
                    Some(first.line),
                    format!(
                        "{words}, whose stamps do not go together; [time] boot = 1 takes the first, boot = 2 takes the second{rest}; without it only the first is imported, and {others} row(s) are lost"
                    ),
                );
            }
        }
    }
}

/// Small numbers as words.
fn count(runs: u32) -> String {
    match runs {
        2 => "two".to_owned(),
        3 => "three".to_owned(),
        n => n.to_string(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const MAP: &str =
        "[time]\ncolumn = \"t\"\nunit = \"s\"\n[motion.x_m]\ncolumn = \"x\"\nunit = \"m\"\n";

    /// Run of each row, in the order of the rows.
    fn runs(stamps_s: &[f64]) -> Vec<u32> {
        let mut boots = Boots::new(&Map::from_toml(MAP, "map").unwrap());
        let (mut all, mut waiting) = (Vec::new(), 0);
        for (line, t_s) in (2..).zip(stamps_s) {
            let seen = boots.see((t_s * 1e9).round() as i128, line);
            if let Some(run) = seen.held {
                all.extend(std::iter::repeat_n(run, waiting));
                waiting = 0;
            }
            match seen.own {
                Some(run) => all.push(run),
                None => waiting += 1,
            }
        }
        all.extend(std::iter::repeat_n(boots.rest(), waiting));
        all
    }

    fn from(start_s: f64, rows: usize) -> Vec<f64> {
        (0..rows).map(|k| start_s + 0.04 * k as f64).collect()
    }

    #[test]
    fn a_clock_that_starts_anew_begins_a_run() {
        for second_s in [0.0, 3.0, 28.5] {
            let stamps = [
                from(30.0, 20),
                from(second_s, 20),
                from(5000.0, 20),
                from(1.0, 9),
            ];
            let found = runs(&stamps.concat());
            // A gap ahead is none.
            let expected = [vec![1; 20], vec![2; 40], vec![3; 9]].concat();
            assert_eq!(found, expected, "{second_s}");
        }
    }

    #[test]
    fn wrong_stamps_gaps_and_turns_begin_no_run() {
        let first = from(30.0, 20);
        for between in [
            vec![2.0],
            vec![0.0; 5],
            vec![1e9],
            vec![1e9, 2.0, -5e8],
            vec![3.0, 3.04, 3.08],
        ] {
            let rest = from(30.84, 20);
            let found = runs(&[&first[..], &between, &rest].concat());
            assert!(found.iter().all(|run| *run == 1), "{between:?}: {found:?}");
        }
        // Too few rows at the end, a time that stands, a counter of 32 bits of microseconds.
        for stamps in [
            [first.clone(), from(2.0, 7)],
            [first.clone(), vec![0.0; 30]],
            [from(4294.0, 24), from(0.0, 30)],
            [first.clone(), first.iter().rev().copied().collect()],
        ] {
            let found = runs(&stamps.concat());
            assert!(found.iter().all(|run| *run == 1), "{stamps:?}: {found:?}");
        }
        let minutes: Vec<f64> = (0..20).map(|k| 120.0 * f64::from(k)).collect();
        assert!(runs(&minutes).iter().all(|run| *run == 1));
    }
}
