//! How many frames were due, by time alone.
//!
//! Per second: its length, divided by the period and rounded. The period of a second is the slope of a straight
//! line through its stamps, weighed (one-state Kalman filter) against that of the seconds before by the scatter
//! about the line. A stamp put into the wrong place on that line makes the scatter large, so the line is then
//! not believed: the count does not repeat the mistake. No sequence number and no decision of the tracker enters,
//! except where time is undecided: a stretch whose length is about half a period off a whole number of them (a camera
//! whose phase has slipped) has as many as were found.

use super::tracker::FAR;

/// Intervals within this share of the period count as one period.
const CLEAN: f64 = 0.3;
/// Share of the rounding's rest that is carried on: a late last frame belongs to the next second, but a
/// drift must not add up.
const CARRY: f64 = 0.5;
/// How well the period of one second predicts that of the next, relative standard deviation.
const STEADY: f64 = 0.001;
/// How well a nominal rate predicts the real one, relative standard deviation.
const NOMINAL: f64 = 0.03;
/// Share of a frame's distance from its place that is kept for the next.
const LEAD_FADES: f64 = 0.95;
/// The same while the period is only assumed.
const LEAD_FADES_UNSURE: f64 = 0.7;
/// Relative variance beyond which a period is only assumed.
const UNSURE: f64 = 1e-4;
/// Scatter that a line is credited with at least, share of the period.
const LEAST_SCATTER: f64 = 1e-4;

/// How far from a tie, in periods, time is still undecided between two whole numbers.
const TIE: f64 = 0.2;

/// Counts the periods of a run of intervals.
#[derive(Debug, Clone)]
pub struct Expected {
    period_ns: f64,
    /// Relative variance of `period_ns`.
    relative_variance: f64,
    line: Line,
    /// Intervals, and whether each was about one period.
    intervals: u64,
    /// Frames received and found lost in them.
    found: u64,
    all_clean: bool,
    length_ns: f64,
    rest: f64,
    done: u64,
}

impl Expected {
    /// `period_ns` 0 = not known: the first interval is taken for it.
    pub fn new(period_ns: f64) -> Self {
        Self {
            period_ns,
            relative_variance: NOMINAL * NOMINAL,
            line: Line::default(),
            intervals: 0,
            found: 0,
            all_clean: true,
            length_ns: 0.0,
            rest: 0.0,
            done: 0,
        }
    }

    /// From one stamp to the next \[ns\]; `found` = the frame and what was found lost before it.
    pub fn interval(&mut self, dt_ns: f64, found: u64) {
        self.found = self.found.saturating_add(found);
        if self.period_ns <= 0.0 {
            self.period_ns = dt_ns.max(0.0);
        }
        let periods = dt_ns / self.period_ns.max(1.0);
        self.intervals += 1;
        self.length_ns += dt_ns;
        self.all_clean &= (periods - 1.0).abs() < CLEAN;
        self.line.add(
            periods,
            if self.relative_variance > UNSURE {
                LEAD_FADES_UNSURE
            } else {
                LEAD_FADES
            },
        );
    }

    /// A pause of whole periods: the phase was lost, so nothing carries over it.
    pub fn pause(&mut self, periods: u64) {
        self.count();
        self.rest = 0.0;
        self.done += periods;
    }

    /// The period changed.
    pub fn new_rate(&mut self, period_ns: f64) {
        self.count();
        self.rest = 0.0;
        self.period_ns = period_ns;
        self.relative_variance = NOMINAL * NOMINAL;
    }

    fn count(&mut self) {
        if self.intervals > 0 {
            if let Some((slope, variance)) = self.line.slope() {
                let gain = self.relative_variance / (self.relative_variance + variance);
                self.period_ns *= 1.0 + gain * slope;
                self.relative_variance = (1.0 - gain) * self.relative_variance + STEADY * STEADY;
            }
            let periods = self.rest + self.length_ns / self.period_ns.max(1.0);
            // Nothing but single periods: no division needed, and none can err.
            let whole = if self.all_clean {
                self.intervals as f64
            } else if (periods - self.found as f64).abs() < 0.5 + TIE {
                self.found as f64
            } else {
                periods.round().clamp(-FAR, FAR)
            };
            self.rest = (CARRY * (periods - whole)).clamp(-CARRY, CARRY);
            self.done = self.done.saturating_add_signed(whole as i64);
        }
        self.line = Line::default();
        (self.intervals, self.all_clean, self.length_ns) = (0, true, 0.0);
        self.found = 0;
    }

    /// Ends the second: frames due in it.
    pub fn close(&mut self) -> u64 {
        self.count();
        std::mem::take(&mut self.done)
    }
}

/// Least squares of (stamp in periods - place) on place, from the point (0, 0).
#[derive(Debug, Clone, Default)]
struct Line {
    lead: f64,
    place: f64,
    stamp: f64,
    n: f64,
    x: f64,
    y: f64,
    xx: f64,
    xy: f64,
    yy: f64,
}

impl Line {
    fn add(&mut self, periods: f64, fades: f64) {
        // A late frame takes the places of those that queue up behind it: its lead is kept until they have come.
        // It fades, so that an assumed period that is some percent off does not add up to a place.
        self.lead = fades * self.lead + periods;
        let places = self.lead.round();
        self.lead -= places;
        self.place += places;
        self.stamp += periods;
        let (x, y) = (self.place, self.stamp - self.place);
        self.n += 1.0;
        self.x += x;
        self.y += y;
        self.xx += x * x;
        self.xy += x * y;
        self.yy += y * y;
    }

    /// Relative error of the assumed period and its variance.
    fn slope(&self) -> Option<(f64, f64)> {
        let n = self.n + 1.0;
        let (sxx, sxy) = (self.xx - self.x * self.x / n, self.xy - self.x * self.y / n);
        let syy = self.yy - self.y * self.y / n;
        if n < 5.0 || sxx <= 0.0 {
            return None;
        }
        let slope = sxy / sxx;
        let scatter = ((syy - slope * sxy) / (n - 2.0)).max(LEAST_SCATTER * LEAST_SCATTER);
        (slope.abs() < CLEAN && scatter.is_finite()).then_some((slope, scatter / sxx))
    }
}
