//! The grid of frame times, tracked frame by frame: which period each stamp belongs to.
//!
//! An alpha-beta filter with the gains of a growing-memory straight line,
//! alpha = 2(2n-1)/(n(n+1)), beta = 6/(n(n+1)) (Brookner, Tracking and Kalman Filtering Made Easy,
//! 1998, eqs. 1.2-38a and b), held at n = 20: it averages jitter and still follows a rate that drifts by some percent.

/// Memory of the filter \[frames\].
const MEMORY: f64 = 20.0;
/// A start from a nominal period counts as so many frames of experience.
const PRIOR: f64 = 4.0;
/// Memory of the second filter \[frames\], for gaps of many periods.
const LONG_MEMORY: f64 = 250.0;
/// The second filter is used only while the first agrees with it.
const LONG_AGREES: f64 = 0.01;

/// A stamp may be late by any amount (a busy host): what is farther off its place than this share of the period is
/// not followed, or one late frame would drag the grid along and make the next ones early.
const LATE: f64 = 0.25;

/// No stamp is farther than this many periods: keeps sums of garbage stamps within 64 bits.
pub(super) const FAR: f64 = 1e12;

/// Gains (alpha, beta) after n frames.
fn gains(n: f64) -> (f64, f64) {
    (
        2.0 * (2.0 * n - 1.0) / (n * (n + 1.0)),
        6.0 / (n * (n + 1.0)),
    )
}

/// Phase and period of the frames. Times in ns from an origin of the caller's.
#[derive(Debug, Clone)]
pub struct Tracker {
    slot_ns: f64,
    period_ns: f64,
    experience: f64,
    long: Long,
}

/// The same filter with a long memory, on settled steps only.
#[derive(Debug, Clone)]
struct Long {
    period_ns: f64,
    /// Last stamp minus the place the filter gave it.
    behind_ns: f64,
    experience: f64,
    since_anchor: f64,
    /// Steps in a row during which the first filter disagreed.
    apart: u32,
}

impl Tracker {
    /// `period_ns` 0 = not known: the first interval is taken for it.
    pub fn new(period_ns: f64) -> Self {
        let long = Long {
            period_ns,
            behind_ns: 0.0,
            experience: 1.0,
            since_anchor: 1.0,
            apart: 0,
        };
        Self {
            slot_ns: 0.0,
            period_ns,
            experience: PRIOR,
            long,
        }
    }

    /// The phase starts anew here; the period stays.
    pub fn anchor(&mut self, at_ns: f64) {
        self.slot_ns = at_ns;
        self.experience = self.experience.min(MEMORY / 2.0);
    }

    /// A new period, known from some intervals.
    pub fn restart(&mut self, at_ns: f64, period_ns: f64) {
        *self = Self {
            slot_ns: at_ns,
            experience: 2.0 * PRIOR,
            ..Self::new(period_ns)
        };
    }

    /// Whole periods from the last frame's place to this stamp.
    pub fn slots(&self, at_ns: f64) -> i64 {
        let distance = at_ns - self.slot_ns;
        if self.period_ns <= 0.0 {
            return 1;
        }
        let short = (distance / self.period_ns).round().clamp(-FAR, FAR);
        // Far away the short memory's error in the period adds up; the long one's does not.
        if short > MEMORY / 2.0 {
            (distance / self.long_period_ns()).round().clamp(-FAR, FAR) as i64
        } else {
            short as i64
        }
    }

    /// Takes the stamp as being `slots` periods on.
    pub fn advance(&mut self, at_ns: f64, slots: i64) {
        if self.period_ns <= 0.0 {
            let period_ns = (at_ns - self.slot_ns).max(0.0);
            *self = Self {
                slot_ns: at_ns,
                ..Self::new(period_ns)
            };
            return;
        }
        if slots > MEMORY as i64 {
            // So far on the phase says nothing; it starts anew and the period stays.
            self.anchor(at_ns);
            return;
        }
        self.experience = (self.experience + 1.0).min(MEMORY);
        let (alpha, beta) = gains(self.experience);
        let predicted = self.slot_ns + slots as f64 * self.period_ns;
        if slots <= 0 {
            // It queued up behind a late frame: its stamp says when the jam ended, not when it was due.
            self.slot_ns = predicted;
            return;
        }
        let far = LATE * self.period_ns;
        let residual = (at_ns - predicted).clamp(-far, far);
        self.slot_ns = predicted + alpha * residual;
        self.period_ns += beta * residual / slots.max(1) as f64;
    }

    /// A settled step of so many periods, for the long memory.
    pub fn learn(&mut self, dt_ns: f64, periods: i64) {
        let long = &mut self.long;
        if long.period_ns <= 0.0 || periods < 1 || periods > MEMORY as i64 {
            self.unlearn_phase();
            return;
        }
        long.experience = (long.experience + 1.0).min(LONG_MEMORY);
        long.since_anchor = (long.since_anchor + 1.0).min(LONG_MEMORY);
        let residual = long.behind_ns + dt_ns - periods as f64 * long.period_ns;
        let alpha = gains(long.since_anchor).0.min(1.0);
        // After an anchor the phase is new but the period is not: its gain goes on where it was.
        let beta = gains(long.experience).1.min(gains(long.since_anchor).1);
        long.behind_ns = (1.0 - alpha) * residual;
        long.period_ns += beta * residual / periods as f64;
        // A step in the rate too small to be called one: believe the short memory once it has settled.
        let apart = (long.period_ns / self.period_ns - 1.0).abs() > LONG_AGREES;
        long.apart = if apart { long.apart + 1 } else { 0 };
        if f64::from(long.apart) > MEMORY {
            self.long = Long {
                period_ns: self.period_ns,
                experience: MEMORY,
                behind_ns: 0.0,
                since_anchor: 1.0,
                apart: 0,
            };
        }
    }

    /// The phase was lost: the long memory keeps the period only.
    pub fn unlearn_phase(&mut self) {
        self.long.behind_ns = 0.0;
        self.long.since_anchor = 1.0;
    }

    /// The best period for long distances \[ns\]; 0 = not known.
    pub fn long_period_ns(&self) -> f64 {
        let agrees = (self.long.period_ns / self.period_ns - 1.0).abs() < LONG_AGREES;
        if agrees && self.long.experience >= MEMORY {
            self.long.period_ns
        } else {
            self.period_ns
        }
    }

    /// The period before the steps that are still open \[ns\]; 0 = not known.
    pub fn settled_period_ns(&self) -> f64 {
        self.long.period_ns
    }
}
