//! From values to places on an axis, and which values are written there.

use super::Axis;

/// A number on an axis.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Tick {
    pub value: f64,
    pub label: String,
}

/// An axis laid on the drawing.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Scale {
    low: f64,
    high: f64,
    /// Where `low` and `high` lie \[px\].
    from_px: f64,
    to_px: f64,
}

/// Part of the span that is left free at either end where the data alone set it.
const PADDING: f64 = 0.05;
/// Least span against the size of its ends: below it neighbouring numbers of f64 would be ticks.
const LEAST_SPAN: f64 = 1e-9;
/// Largest value: the difference of two is still finite.
const LARGEST: f64 = 1e300;
/// Smallest span: its power of ten is still a number.
const SMALLEST: f64 = 1e-290;
/// Numbers that an axis should carry at least: two do not show where its middle is.
const FEWEST: usize = 3;
/// Values from here on are written with an exponent.
const WITH_EXPONENT_FROM: f64 = 1e6;
/// Steps below are written with an exponent.
const WITH_EXPONENT_BELOW: f64 = 1e-5;

/// Least and greatest of the axis; `None` where nothing finite sets it.
pub(super) fn range(
    axis: &Axis,
    shown: impl Iterator<Item = f64>,
    padded: bool,
) -> Option<[f64; 2]> {
    let limits = axis
        .limits
        .filter(|l| l.iter().all(|v| v.is_finite()) && l[0] <= l[1]);
    let padded = padded && limits.is_none();
    let [low, high] = limits.or_else(|| {
        let (low, high) = shown
            .filter(|v| v.is_finite())
            .fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), v| {
                (l.min(v), h.max(v))
            });
        (low <= high).then_some([low, high])
    })?;
    let (low, high) = (low.clamp(-LARGEST, LARGEST), high.clamp(-LARGEST, LARGEST));
    let least = (LEAST_SPAN * low.abs().max(high.abs())).max(SMALLEST);
    if high - low >= least {
        let free = if padded { PADDING * (high - low) } else { 0.0 };
        return Some([low - free, high + free]);
    }
    // One value: it stands in the middle, ten per cent of it or one half either way.
    let half = if low == 0.0 {
        0.5
    } else {
        0.1 * low.abs().max(SMALLEST)
    };
    Some([low - half, high + half])
}

/// From this span on a time axis is written in minutes \[s\]: ten of them, and numbers of four digits would crowd.
const MINUTES_FROM_S: f64 = 600.0;
const SECONDS_PER_MINUTE: f64 = 60.0;

impl Axis {
    /// Its name with the unit, and how much one of that unit is, for an axis that spans so much.
    pub(super) fn unit(&self, range: Option<[f64; 2]>) -> (String, f64) {
        if !self.time {
            return (self.label.clone(), 1.0);
        }
        let long = range.is_some_and(|[low, high]| high - low >= MINUTES_FROM_S);
        let (unit, size) = if long {
            ("min", SECONDS_PER_MINUTE)
        } else {
            ("s", 1.0)
        };
        (format!("{} [{unit}]", self.label), size)
    }
}

impl Scale {
    /// From `low` at `from_px` to `high` at `to_px`, the other way round for a reversed axis.
    pub fn new([low, high]: [f64; 2], from_px: f64, to_px: f64, reversed: bool) -> Self {
        let (from_px, to_px) = if reversed {
            (to_px, from_px)
        } else {
            (from_px, to_px)
        };
        Scale {
            low,
            high,
            from_px,
            to_px,
        }
    }

    /// Place of a value \[px\], exact inside the axis; values far beyond may all go to the same far place.
    pub fn px(&self, value: f64) -> f64 {
        let share = (value - self.low) / (self.high - self.low);
        self.from_px + share.clamp(-1e4, 1e4) * (self.to_px - self.from_px)
    }

    /// Whether the axis shows a value.
    pub fn holds(&self, value: f64) -> bool {
        (self.low..=self.high).contains(&value)
    }

    /// A value, or the end of the axis that is nearest to it.
    pub fn within(&self, value: f64) -> f64 {
        value.clamp(self.low, self.high)
    }

    /// Round values inside the axis, at most about `wanted` of them: multiples of 1, 2 or 5 times a power of ten.
    /// Where that leaves fewer than three, finer ones, as long as there are no more than `most`.
    pub fn ticks(&self, wanted: f64, most: f64) -> Vec<Tick> {
        let span = self.high - self.low;
        let mut ticks = self.multiples(step(span / wanted.max(1.0)), most);
        let mut finer = wanted.max(1.0);
        while ticks.len() < FEWEST && finer < most {
            finer = (1.5 * finer).min(most);
            let more = self.multiples(step(span / finer), most);
            if more.len() as f64 <= most {
                ticks = more;
            }
        }
        ticks
    }

    /// [`Scale::ticks`] that are round in another unit, `unit` of the axis' own.
    pub fn ticks_in(&self, unit: f64, wanted: f64, most: f64) -> Vec<Tick> {
        let scale = Scale {
            low: self.low / unit,
            high: self.high / unit,
            ..*self
        };
        let mut ticks = scale.ticks(wanted, most);
        for tick in &mut ticks {
            tick.value *= unit;
        }
        ticks
    }

    fn multiples(&self, step: f64, most: f64) -> Vec<Tick> {
        let first = (self.low / step - 1e-9).ceil();
        let last = (self.high / step + 1e-9).floor();
        let count = (last - first).clamp(0.0, 2.0 * most.max(1.0) + 2.0) as i32;
        let largest = self.low.abs().max(self.high.abs());
        (0..=count)
            .map(|k| (first + f64::from(k)) * step + 0.0)
            .filter(|v| self.low - 1e-6 * step <= *v && *v <= self.high + 1e-6 * step)
            .map(|value| Tick {
                value,
                label: label(value, step, largest),
            })
            .collect()
    }
}

/// The least of 1, 2 and 5 times a power of ten that is not below `least`.
fn step(least: f64) -> f64 {
    let power = 10f64.powf(least.log10().floor());
    [1.0, 2.0, 5.0]
        .into_iter()
        .map(|k| k * power)
        .find(|s| *s >= least * (1.0 - 1e-9))
        .unwrap_or(10.0 * power)
}

/// A tick's number, with as many places as its step has.
fn label(value: f64, step: f64, largest: f64) -> String {
    let of_step = (step.log10() + 1e-9).floor();
    if value == 0.0 {
        return "0".to_owned();
    }
    if largest < WITH_EXPONENT_FROM && step >= WITH_EXPONENT_BELOW {
        let places = (-of_step).max(0.0) as usize;
        return format!("{value:.places$}");
    }
    // All ticks of an axis carry the same exponent.
    let exponent = (largest.log10() + 1e-9).floor();
    let places = (exponent - of_step).clamp(0.0, 12.0) as usize;
    format!("{:.places$}e{exponent}", value / 10f64.powf(exponent))
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn labels(low: f64, high: f64, wanted: f64) -> Vec<String> {
        let scale = Scale::new([low, high], 0.0, 100.0, false);
        let ticks = scale.ticks(wanted, wanted);
        ticks.into_iter().map(|t| t.label).collect()
    }

    #[test]
    fn where_one_number_would_stand_finer_ones_do_if_they_fit() {
        let scale = Scale::new([-8.5, 8.5], 80.0, 0.0, false);
        let labels = |most: f64| -> Vec<String> {
            let ticks = scale.ticks(3.0, most);
            ticks.into_iter().map(|t| t.label).collect()
        };
        assert_eq!(labels(3.0), ["0"]);
        assert_eq!(labels(5.7), ["-5", "0", "5"]);
    }

    #[test]
    fn a_long_time_is_written_in_minutes() {
        let axis = Axis::time();
        assert_eq!(axis.unit(Some([0.0, 599.0])), ("time [s]".to_owned(), 1.0));
        assert_eq!(axis.unit(None).0, "time [s]");
        let (name, unit) = axis.unit(Some([0.0, 1500.0]));
        assert_eq!(name, "time [min]");
        let ticks = Scale::new([0.0, 1500.0], 0.0, 700.0, false).ticks_in(unit, 6.0, 6.0);
        let read: Vec<(f64, &str)> = ticks.iter().map(|t| (t.value, t.label.as_str())).collect();
        let round = [
            (0.0, "0"),
            (300.0, "5"),
            (600.0, "10"),
            (900.0, "15"),
            (1200.0, "20"),
            (1500.0, "25"),
        ];
        assert_eq!(read, round);
    }

    #[test]
    fn ticks_are_round_inside_and_as_many_as_wanted() {
        assert_eq!(labels(-0.013, 0.041, 5.0), ["0", "0.02", "0.04"]);
        assert_eq!(labels(0.0, 24.0, 5.0), ["0", "5", "10", "15", "20"]);
        assert_eq!(labels(-20.0, 20.0, 4.0), ["-20", "-10", "0", "10", "20"]);
        assert_eq!(labels(0.1, 0.3, 2.0), ["0.1", "0.2", "0.3"]);
        assert_eq!(labels(0.0, 3e7, 3.0), ["0", "1e7", "2e7", "3e7"]);
        assert_eq!(labels(0.0, 2.5e-6, 3.0), ["0", "1e-6", "2e-6"]);
        assert_eq!(labels(5e6, 5.1e6, 2.0), ["5.00e6", "5.05e6", "5.10e6"]);
    }

    #[test]
    fn one_value_stands_in_the_middle_and_no_value_sets_no_range() {
        let free = Axis::new("");
        assert_eq!(
            range(&free, [3.0, f64::NAN].into_iter(), true),
            Some([2.7, 3.3])
        );
        assert_eq!(range(&free, [0.0].into_iter(), true), Some([-0.5, 0.5]));
        assert_eq!(range(&free, [f64::NAN].into_iter(), true), None);
        let set = Axis::new("").limits([0.0, 640.0]);
        assert_eq!(range(&set, [1e9].into_iter(), true), Some([0.0, 640.0]));
    }

    #[test]
    fn a_reversed_axis_runs_the_other_way() {
        let down = Scale::new([0.0, 480.0], 300.0, 20.0, true);
        assert_eq!((down.px(0.0), down.px(480.0)), (20.0, 300.0));
    }

    proptest! {
        #[test]
        fn any_two_numbers_make_an_axis_with_ticks_inside(
            a in proptest::num::f64::ANY,
            b in proptest::num::f64::ANY,
            wanted in 1.0..12.0f64,
            finer in 1.0..3.0f64,
        ) {
            let Some([low, high]) = range(&Axis::new(""), [a, b].into_iter(), true) else {
                prop_assert!(!a.is_finite() && !b.is_finite());
                return Ok(());
            };
            prop_assert!(low < high && (high - low).is_finite());
            let scale = Scale::new([low, high], 10.0, 810.0, false);
            let ticks = scale.ticks(wanted, finer * wanted);
            prop_assert!(ticks.len() as f64 <= finer * wanted + 2.0, "{ticks:?}");
            for tick in &ticks {
                let px = scale.px(tick.value);
                prop_assert!((9.9..=810.1).contains(&px), "{tick:?} at {px}");
                prop_assert!(!tick.label.contains("NaN") && !tick.label.contains("inf"));
                // The label is the value, to a hundredth of the way to the next.
                let read: f64 = tick.label.parse().map_err(|_| TestCaseError::fail(tick.label.clone()))?;
                prop_assert!((scale.px(read) - px).abs() < 0.02 * 800.0 / (finer * wanted), "{tick:?}");
            }
            let labels: std::collections::BTreeSet<&str> = ticks.iter().map(|t| t.label.as_str()).collect();
            prop_assert_eq!(labels.len(), ticks.len());
        }
    }
}
