//! When a set-point is due: a grid of due times without accumulated rounding, and what counts as missed.

/// Load of a plan at one time.
#[derive(Debug, Clone, PartialEq)]
pub struct PlannedLoad {
    /// Thrust per thruster, in the rig's order \[N\].
    pub thrust_n: Vec<f64>,
    /// The pulses that make it, in the same order \[us\]; `None` = the service inverts the curves.
    pub pulses_us: Option<Vec<f64>>,
    /// Step of the plan, from 1; 0 = none.
    pub plan_step: u32,
}

/// The plan as a function of time since its start \[s\].
pub type LoadAt = Box<dyn FnMut(f64) -> PlannedLoad + Send>;

/// State of the grid at one moment.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Tick {
    /// Nothing due before this time \[ns\].
    Wait {
        /// Next due time \[ns\].
        until_ns: u64,
    },
    /// A set-point is due.
    Due {
        /// When it was wanted \[ns\].
        due_ns: u64,
        /// Plan time \[s\].
        t_s: f64,
        /// Older set-points that came due since the last call and are superseded by this one.
        skipped: u64,
    },
    /// The newest due set-point is later than the deadline allows.
    Missed {
        /// When it was wanted \[ns\].
        due_ns: u64,
        /// Delay after that \[ns\].
        late_ns: u64,
    },
    /// The plan is over.
    Finished,
}

/// The grid of one plan run: set-point `k` is due at `start + k / rate_hz`.
#[derive(Debug, Clone)]
pub struct Scheduler {
    start_ns: u64,
    period_s: f64,
    count: u64,
    deadline_ns: u64,
    next: u64,
}

impl Scheduler {
    /// A run from `start_ns` for `duration_s` at `rate_hz`; later than `deadline_s` after its due time = missed.
    ///
    /// The last set-point is the last grid point before the plan's end.
    pub fn new(start_ns: u64, rate_hz: f64, duration_s: f64, deadline_s: f64) -> Self {
        let rate_hz = if rate_hz.is_finite() {
            rate_hz.max(1e-3)
        } else {
            1.0
        };
        // 1e-9: a plan of exactly n periods has n set-points, not n + 1 by rounding.
        let count = (duration_s.max(0.0) * rate_hz - 1e-9).ceil().max(0.0) as u64;
        Self {
            start_ns,
            period_s: 1.0 / rate_hz,
            count,
            deadline_ns: (deadline_s.max(0.0) * 1e9) as u64,
            next: 0,
        }
    }

    /// Due time of grid point `k` \[ns\].
    pub fn due_ns(&self, k: u64) -> u64 {
        self.start_ns
            .saturating_add((k as f64 * self.period_s * 1e9).round() as u64)
    }

    /// When the plan ends \[ns\]: one period after its last set-point.
    pub fn end_ns(&self) -> u64 {
        self.due_ns(self.count)
    }

    /// Wait that [`Self::poll`] would report; `Due` and `Missed` are not consumed and count as a wait of 0.
    pub fn peek(&self, now_ns: u64) -> Tick {
        let until_ns = if self.next >= self.count {
            self.end_ns()
        } else {
            self.due_ns(self.next)
        };
        Tick::Wait {
            until_ns: until_ns.max(now_ns),
        }
    }

    /// Moves to `now_ns`. A `Due` or `Missed` consumes the grid points up to now.
    pub fn poll(&mut self, now_ns: u64) -> Tick {
        if self.next >= self.count {
            let end_ns = self.end_ns();
            return if now_ns >= end_ns {
                Tick::Finished
            } else {
                Tick::Wait { until_ns: end_ns }
            };
        }
        let due_ns = self.due_ns(self.next);
        if now_ns < due_ns {
            return Tick::Wait { until_ns: due_ns };
        }
        let first = self.next;
        while self.next + 1 < self.count && self.due_ns(self.next + 1) <= now_ns {
            self.next += 1;
        }
        let newest = self.next;
        self.next += 1;
        // Lateness counts from the FIRST point that was not served: after a stall of many periods the
        // newest point alone would look punctual although the thrusters ran on an old value.
        let late_ns = now_ns - due_ns;
        if late_ns > self.deadline_ns {
            return Tick::Missed { due_ns, late_ns };
        }
        Tick::Due {
            due_ns: self.due_ns(newest),
            t_s: newest as f64 * self.period_s,
            skipped: newest - first,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const MS: u64 = 1_000_000;

    #[test]
    fn every_point_once_then_finished() {
        let mut s = Scheduler::new(5 * MS, 50.0, 0.1, 0.01);
        let mut dues = Vec::new();
        let mut now = 0;
        loop {
            match s.poll(now) {
                Tick::Wait { until_ns } => now = until_ns,
                Tick::Due {
                    due_ns, skipped, ..
                } => {
                    assert_eq!(skipped, 0);
                    dues.push(due_ns);
                }
                Tick::Missed { .. } => unreachable!("never late"),
                Tick::Finished => break,
            }
        }
        assert_eq!(dues, [5 * MS, 25 * MS, 45 * MS, 65 * MS, 85 * MS]);
        assert_eq!(now, 105 * MS);
    }

    #[test]
    fn a_stall_beyond_the_deadline_is_missed_a_shorter_one_skips() {
        let mut s = Scheduler::new(0, 100.0, 1.0, 0.025);
        assert!(matches!(s.poll(0), Tick::Due { .. }));
        assert_eq!(
            s.poll(32 * MS),
            Tick::Due {
                due_ns: 30 * MS,
                t_s: 0.03,
                skipped: 2
            }
        );
        assert_eq!(
            s.poll(80 * MS),
            Tick::Missed {
                due_ns: 40 * MS,
                late_ns: 40 * MS
            }
        );
    }

    proptest! {
        #[test]
        fn due_times_rise_and_cover_the_plan(rate in 1.0f64..400.0, length in 0.0f64..5.0, hop_ms in 1u64..30) {
            let mut s = Scheduler::new(0, rate, length, 1e3);
            let (mut now, mut last, mut served) = (0u64, None, 0u64);
            loop {
                match s.poll(now) {
                    Tick::Due { due_ns, skipped, .. } => {
                        prop_assert!(due_ns <= now && last < Some(due_ns));
                        last = Some(due_ns);
                        served += 1 + skipped;
                    }
                    Tick::Wait { .. } => now += hop_ms * MS,
                    Tick::Missed { .. } => prop_assert!(false),
                    Tick::Finished => break,
                }
            }
            prop_assert_eq!(served, s.count);
        }
    }
}
