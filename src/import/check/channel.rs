//! Findings about one channel by itself: empty, dead, stuck, beyond what a vehicle does.

use std::f64::consts::{FRAC_PI_2, PI};

use hydroline_identify::data::unwrap_turns;

use super::{Finding, FindingList, Options, Severity, name, quantile};
use crate::table::Imported;

/// Four whole turns: an angle that comes back from farther is in another unit \[rad\].
const TURNS_MAX_RAD: f64 = 8.0 * PI;

/// Between which values a channel lies.
#[derive(Debug, Clone, Copy)]
pub(super) struct Extent {
    pub count: usize,
    pub low: f64,
    pub high: f64,
}

impl Default for Extent {
    fn default() -> Self {
        Extent {
            count: 0,
            low: f64::INFINITY,
            high: f64::NEG_INFINITY,
        }
    }
}

impl Extent {
    pub fn add(&mut self, values: &[f64]) {
        for v in values.iter().filter(|v| v.is_finite()) {
            self.count += 1;
            self.low = self.low.min(*v);
            self.high = self.high.max(*v);
        }
    }

    /// Whether there is nothing more to look at: no value, or always the same.
    pub fn report(&self, place: usize, findings: &mut Vec<Finding>) -> bool {
        let name = name(place);
        if self.count == 0 {
            findings.fault("empty_channel", format!("{name}: no usable value"));
            return true;
        }
        if self.low == self.high {
            findings.warning(
                "dead_channel",
                format!(
                    "{name}: always {}; a dead channel? Leave it out of the map if so",
                    self.low
                ),
            );
            return true;
        }
        false
    }
}

pub(super) fn check(
    place: usize,
    values: &[f64],
    data: &Imported,
    options: &Options,
    findings: &mut Vec<Finding>,
) {
    let mut extent = Extent::default();
    extent.add(values);
    if extent.count == 0 || extent.low == extent.high {
        return;
    }
    stuck(place, values, data, options.stuck_rows, findings);
    if let Some((severity, words)) = beyond(place, extent, values, data, options) {
        findings.push(match severity {
            Severity::Fault => Finding::fault("units", None, words),
            _ => Finding::warning("units", None, words),
        });
    } else if place < 3 && extent.high - extent.low < 1e-5 {
        findings.warning(
            "units",
            format!(
                "{}: moves by {:.1e} m in all: metres mapped as mm?",
                name(place),
                extent.high - extent.low
            ),
        );
    }
}

/// The same value for a second and so many rows in a channel that else changes with nearly every row.
fn stuck(place: usize, values: &[f64], data: &Imported, rows: usize, findings: &mut Vec<Finding>) {
    let changes = values.windows(2).filter(|w| w[0] != w[1]).count() as f64 / values.len() as f64;
    let (mut longest, mut run, mut at) = (0, 0, 0);
    for i in 1..values.len() {
        run = if values[i] == values[i - 1] {
            run + 1
        } else {
            0
        };
        if run > longest {
            (longest, at) = (run, i - run);
        }
    }
    if longest >= rows && changes > 0.5 && data.times_s[at + longest] - data.times_s[at] > 1.0 {
        findings.warning_at(
            "stuck_channel",
            data.lines.get(at).copied(),
            format!(
                "{}: stands at {} for {} rows from line {}",
                name(place),
                values[at],
                longest + 1,
                data.lines[at]
            ),
        );
    }
}

/// Words for values that hardly a vehicle has, a fault where nothing that is moved by hand, thrown or falls has them either.
fn beyond(
    place: usize,
    extent: Extent,
    values: &[f64],
    data: &Imported,
    options: &Options,
) -> Option<(Severity, String)> {
    let Extent { low, high, .. } = extent;
    let (name, largest) = (name(place), high.abs().max(low.abs()));
    let found = |is_fault: bool, words: String| {
        let severity = match is_fault {
            true => Severity::Fault,
            false => Severity::Warning,
        };
        Some((severity, words))
    };
    match place {
        3 | 4 if largest > 1.2 * FRAC_PI_2 => {
            let angle = continued(values);
            // A hull that is rolled by hand turns over, and over.
            let is_fault = largest_speed(&data.times_s, &angle) > options.rate_max_radps
                || largest > TURNS_MAX_RAD && !circles(&angle, data, options);
            found(
                is_fault,
                format!(
                    "{name}: reaches {largest:.2} rad ({:.0} deg), beyond any roll or pitch of a hull by itself: degrees mapped as rad? Of a quaternion: is its order right?",
                    largest.to_degrees()
                ),
            )
        }
        5 if high - low > TURNS_MAX_RAD => {
            let mut words = format!(
                "{name}: turns by {:.1} rad: degrees mapped as rad?",
                high - low
            );
            let is_circling = circles(values, data, options);
            if is_circling {
                words += " Or in circles?";
            }
            found(!is_circling, words)
        }
        0..3 => {
            let speed = largest_speed(&data.times_s, values);
            // However far: a long track at the speed of a vehicle is one.
            if speed <= options.speed_max_mps {
                return None;
            }
            found(
                speed > options.speed_unit_mps,
                format!(
                    "{name}: covers {:.1} m at up to {speed:.1} m/s: millimetres mapped as m?",
                    high - low
                ),
            )
        }
        6..9 if largest > options.speed_max_mps => found(
            held(values) > options.speed_unit_mps,
            format!("{name}: reaches {largest:.1} m/s: mm/s mapped as m/s?"),
        ),
        9..12 if largest > options.rate_max_radps => found(
            held(values) > options.rate_unit_radps,
            format!("{name}: reaches {largest:.1} rad/s: deg/s mapped as rad/s?"),
        ),
        _ => None,
    }
}

/// An angle without its jumps of a whole turn.
fn continued(values: &[f64]) -> Vec<f64> {
    let mut angle = values.to_vec();
    unwrap_turns(angle.iter_mut());
    angle
}

/// Whether an angle goes on one way, no faster than a vehicle turns.
fn circles(values: &[f64], data: &Imported, options: &Options) -> bool {
    let mut extent = Extent::default();
    extent.add(values);
    let mut finite = values.iter().filter(|v| v.is_finite());
    let ends = finite.next().zip(finite.next_back());
    let net = ends.map_or(0.0, |(a, b)| (b - a).abs());
    net > options.one_way_share * (extent.high - extent.low)
        && largest_speed(&data.times_s, values) < options.turning_max_radps
}

/// Size that one value in twenty exceeds: single outliers do not count.
fn held(values: &[f64]) -> f64 {
    let finite = values.iter().filter(|v| v.is_finite());
    let mut sizes: Vec<f64> = finite.map(|v| v.abs()).collect();
    quantile(&mut sizes, 0.95).unwrap_or(0.0)
}

/// Largest speed held over ten rows: single outliers do not count.
fn largest_speed(times_s: &[f64], values: &[f64]) -> f64 {
    let span = 10.min(times_s.len() - 1);
    let speeds = (0..times_s.len() - span)
        .map(|i| ((values[i + span] - values[i]) / (times_s[i + span] - times_s[i])).abs());
    let mut speeds: Vec<f64> = speeds.filter(|s| s.is_finite()).collect();
    quantile(&mut speeds, 0.95).unwrap_or(0.0)
}
