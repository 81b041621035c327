//! Clocks written as one number, `hhmmss`, that look like a count of seconds.

/// Digits behind the second that such a number has without a decimal sign: none, or milliseconds.
const SCALES: [f64; 2] = [1.0, 1000.0];
/// A step of so many usual ones is no usual one, nor is a usual one that of so many.
const STEPS: f64 = 2.0;
/// No day has more hours.
const HOURS: f64 = 24.0;

/// A reading of the numbers as clocks, at one scale.
#[derive(Debug, Clone, Copy)]
struct Reading {
    /// Every number so far is a clock.
    possible: bool,
    /// Last number, and the second of the day that it is.
    last: Option<(f64, f64)>,
    /// Last step that both readings make alike \[s\].
    usual_s: f64,
    /// Steps that are usual for a clock and not for a count, and line and number of the first.
    carries: usize,
    first: Option<(u64, [f64; 2])>,
}

/// Whether numbers whose file states so many seconds for one may be clocks: hours that are written as one number are called
/// seconds, if anything, and never parts of one.
pub(crate) fn may_be(stated_s: Option<f64>) -> bool {
    stated_s.is_none_or(|s| s >= 1.0)
}

/// Watches the numbers of a column of time.
#[derive(Debug, Clone)]
pub(crate) struct Sexagesimal([Reading; 2]);

impl Default for Sexagesimal {
    fn default() -> Self {
        Sexagesimal(
            [Reading {
                possible: true,
                last: None,
                usual_s: 0.0,
                carries: 0,
                first: None,
            }; 2],
        )
    }
}

/// A clock among the numbers of a column.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Carry {
    /// Pattern that reads it.
    pub format: &'static str,
    /// Line of the first step from a full minute to the next.
    pub line: u64,
    /// Numbers before and after it.
    pub numbers: [f64; 2],
    /// Number of such steps.
    pub count: usize,
}

impl Sexagesimal {
    /// The next number of the column, as it stands in the file.
    pub fn row(&mut self, number: f64, line: u64) {
        for (reading, scale) in self.0.iter_mut().zip(SCALES) {
            if reading.possible {
                reading.row(number / scale, number, scale, line);
            }
        }
    }

    /// The first carry; `None` = nothing speaks for a clock.
    pub fn carry(&self) -> Option<Carry> {
        let formats = ["%H%M%S%.f", "%H%M%S%3f"];
        self.0.iter().zip(formats).find_map(|(reading, format)| {
            let (line, numbers) = reading.first.filter(|_| reading.possible)?;
            Some(Carry {
                format,
                line,
                numbers,
                count: reading.carries,
            })
        })
    }
}

impl Reading {
    fn row(&mut self, clock: f64, number: f64, scale: f64, line: u64) {
        let minutes = (clock / 100.0).floor();
        let (hour, minute, second) = (
            (minutes / 100.0).floor(),
            minutes % 100.0,
            clock - 100.0 * minutes,
        );
        // A leap second is the sixtieth.
        if !(0.0..HOURS).contains(&hour) || minute >= 60.0 || second >= 61.0 {
            self.possible = false;
            return;
        }
        let of_day_s = 3600.0 * hour + 60.0 * minute + second;
        if let Some((before, before_s)) = self.last {
            let (count_s, clock_s) = (clock - before, of_day_s - before_s);
            // A clock goes on at the full minute as it did before: a count whose steps are some tens makes less of it.
            let (least_s, most_s) = (self.usual_s / STEPS, STEPS * self.usual_s.max(1.0 / scale));
            if (count_s - clock_s).abs() < 1.0 {
                self.usual_s = clock_s.abs();
            } else if clock_s >= least_s && clock_s <= most_s {
                self.carries += 1;
                self.first.get_or_insert((line, [before * scale, number]));
            }
        }
        self.last = Some((clock, of_day_s));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn carry(numbers: impl Iterator<Item = f64>) -> Option<Carry> {
        let mut watch = Sexagesimal::default();
        for (number, line) in numbers.zip(2..) {
            watch.row(number, line);
        }
        watch.carry()
    }

    /// `hhmmss` of a second of the day.
    fn written(s: f64) -> f64 {
        let (h, m) = ((s / 3600.0).floor(), (s / 60.0).floor() % 60.0);
        10_000.0 * h + 100.0 * m + (s - 60.0 * (s / 60.0).floor())
    }

    #[test]
    fn a_clock_that_carries_at_sixty_is_no_count_of_seconds() {
        let clock = |k: i32| written(9.0 * 3600.0 + 59.0 * 60.0 + 50.0 + 0.04 * f64::from(k));
        let found = carry((0..600).map(clock)).unwrap();
        assert_eq!((found.format, found.count), ("%H%M%S%.f", 1));
        assert!(found.numbers[1] - found.numbers[0] > 4000.0, "{found:?}");
        let slow = |k: i32| written(3600.0 + f64::from(k));
        assert_eq!(carry((0..200).map(slow)).map(|c| c.count), Some(3));
        let millis = carry((0..600).map(|k| (1000.0 * clock(k)).round())).unwrap();
        assert_eq!(millis.format, "%H%M%S%3f");
    }

    #[test]
    fn a_count_of_seconds_is_no_clock_whatever_gaps_it_has() {
        assert_eq!(carry((0..5000).map(|k| 0.04 * f64::from(k))), None);
        assert_eq!(carry((0..300).map(|k| 1e6 + f64::from(k))), None);
        let gap = |k: i32| 0.04 * f64::from(k) + if k > 300 { 65.0 } else { 0.0 };
        assert_eq!(carry((0..600).map(gap)), None);
        // 20 Hz in milliseconds: 50, 100 is no step from second 50 to the full minute.
        for step in [50.0, 51.0, 55.0, 50_000.0, 55_000.0] {
            let count = |k: i32| step * f64::from(k);
            for rows in 3..200 {
                assert_eq!(carry((0..rows).map(count)), None, "{rows} of {step}");
            }
        }
        let whole_minutes = |k: i32| 0.04 * f64::from(k) + if k > 300 { 88.0 } else { 0.0 };
        assert_eq!(carry((0..600).map(whole_minutes)), None);
    }
}
