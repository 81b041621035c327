//! Findings about the stamps of a table.

use super::{Finding, FindingList, quantile};
use crate::clock::{COUNTERS, Counter};

/// Stamps seen so far: steps back, repetitions, gaps and missing rows, with their counts.
#[derive(Debug, Default)]
pub(super) struct Clocks {
    rows: usize,
    first_s: f64,
    last: Option<(f64, u64)>,
    /// Median of the first stretch's steps \[s\].
    interval_s: Option<f64>,
    /// Medians of the first and the last part \[s\].
    ends_s: Option<(f64, f64)>,
    zone: Option<(u64, f64)>,
    back: Counted,
    repeated: Counted,
    gaps: Counted,
    missing: f64,
}

/// Number of such steps, line of the first, and its size (of gaps: the longest) \[s\].
#[derive(Debug, Default, Clone, Copy)]
struct Counted {
    count: usize,
    line: u64,
    step_s: f64,
}

impl Counted {
    fn add(&mut self, line: u64, step_s: f64) {
        if self.count == 0 {
            (self.line, self.step_s) = (line, step_s);
        }
        self.count += 1;
    }
}

/// Zones lie no further apart \[half hours\]: UTC-12 to UTC+14. A larger step is the clock's.
const ZONES_MAX: f64 = 52.0;

/// Half hours in a step: an hour or more to the second is a change of zone or of daylight saving time.
fn half_hours(step_s: f64) -> f64 {
    (step_s / 1800.0).round()
}

impl Clocks {
    /// The rows of a stretch from `fresh` on; those before were in the last one.
    pub fn stretch(&mut self, times_s: &[f64], lines: &[u64], fresh: usize) {
        let steps =
            |from: usize| -> Vec<f64> { times_s[from..].windows(2).map(|w| w[1] - w[0]).collect() };
        if self.interval_s.is_none() {
            let mut positive = steps(0);
            positive.retain(|d| *d > 0.0);
            self.interval_s = quantile(&mut positive, 0.5);
        }
        let interval_s = self.interval_s.unwrap_or(f64::INFINITY);
        let all = steps(fresh.min(times_s.len()));
        if all.len() > 62 {
            let part = |s: &[f64]| quantile(&mut s.to_vec(), 0.5).unwrap_or(interval_s);
            let third = all.len() / 3;
            let tail = part(&all[2 * third..]);
            self.ends_s = Some((
                self.ends_s.map_or_else(|| part(&all[..third]), |e| e.0),
                tail,
            ));
        }
        for (t_s, line) in times_s.iter().zip(lines).skip(fresh) {
            self.rows += 1;
            let Some((before_s, _)) = self.last.replace((*t_s, *line)) else {
                self.first_s = *t_s;
                continue;
            };
            self.step(t_s - before_s, *line, interval_s);
        }
    }

    fn step(&mut self, step_s: f64, line: u64, interval_s: f64) {
        let hours = half_hours(step_s);
        let zone_jump = (1.0..=ZONES_MAX).contains(&hours.abs())
            && (step_s - hours * 1800.0).abs() < 5.0 * interval_s;
        if zone_jump {
            self.zone.get_or_insert((line, hours / 2.0));
        } else if step_s < 0.0 {
            self.back.add(line, -step_s);
        } else if step_s == 0.0 {
            self.repeated.add(line, 0.0);
        } else if step_s > 1.6 * interval_s {
            self.gaps.add(line, step_s);
            self.gaps.step_s = self.gaps.step_s.max(step_s);
            self.missing += (step_s / interval_s).round() - 1.0;
        }
    }

    /// Whether time advances at all.
    pub fn report(&self, findings: &mut Vec<Finding>) -> bool {
        let Some(interval_s) = self.interval_s else {
            findings.fault(
                "time_stands",
                "time never advances; is time.column right?".to_owned(),
            );
            return false;
        };
        findings.info(
            "rate",
            format!(
                "{} rows, {:.3} s, every {:.4} s ({:.2}/s)",
                self.rows,
                self.last.map_or(0.0, |l| l.0) - self.first_s,
                interval_s,
                1.0 / interval_s
            ),
        );
        if !(1e-4..=10.0).contains(&interval_s) {
            findings.fault(
                "time_unit",
                format!("rows are {interval_s:.3e} s apart; is time.unit right?"),
            );
        }
        if let Some((line, hours)) = self.zone {
            findings.fault_at("time_zone_jump", Some(line), format!("time jumps by {hours:+.1} h on line {line}: time zones or daylight saving mixed, or a clock that was set? Two runs: [time] to_s and from_s of the map part them"));
        }
        self.order(findings);
        let Counted {
            count,
            line,
            step_s,
        } = self.gaps;
        if count > 0 {
            findings.warning_at(
                "gaps",
                Some(line),
                format!(
                    "{count} gap(s), about {:.0} row(s) missing, the longest {step_s:.3} s, the first before line {line}",
                    self.missing,
                ),
            );
        }
        if let Some((head, tail)) = self.ends_s
            && (tail / head - 1.0).abs() > 0.1
        {
            findings.warning(
                "rate_changes",
                format!("rows are {head:.4} s apart at the start and {tail:.4} s at the end"),
            );
        }
        true
    }

    fn order(&self, findings: &mut Vec<Finding>) {
        let Counted {
            count,
            line,
            step_s,
        } = self.back;
        if count > 0 {
            // Largest range of a counter that starts again from 0: its step back is 0.9 to 1 times that.
            let turn = COUNTERS.into_iter().find(|counter| {
                let full_s = counter.full_ns() as f64 * 1e-9;
                (0.9 * full_s..=full_s).contains(&step_s)
            });
            let hint = turn.map_or(String::new(), |Counter { bits, unit, .. }| {
                format!(
                    "; a counter of {bits} bits in {unit} that starts again? [time] unwrap = {bits}; a clock that was started anew? boot = 2 takes the second run"
                )
            });
            findings.fault_at(
                "time_backwards",
                Some(line),
                format!(
                    "time goes back {count} time(s), first by {step_s:.4} s on line {line}{hint}"
                ),
            );
        }
        let Counted { count, line, .. } = self.repeated;
        if count > 0 {
            let hint = if count * 50 > self.rows {
                "; rounded stamps? [time] rate_hz = .. puts them back"
            } else {
                ""
            };
            findings.fault_at(
                "repeated_stamps",
                Some(line),
                format!("{count} stamp(s) repeat the one before, the first on line {line}{hint}"),
            );
        }
    }

    /// Only repeats and steps back: of rows that are no samples.
    pub fn report_order(&self, findings: &mut Vec<Finding>) {
        self.order(findings);
    }
}
