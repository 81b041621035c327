//! The account of a recording's frames: which were lost, by which cause, checked against time.
//!
//! Two witnesses are kept apart:
//!
//! * **found losses** = gaps in the driver's sequence + missing periods seen frame by frame against a
//!   tracked grid ([`tracker`]) + whole periods of a pause;
//! * **expected** = periods in each second by time alone ([`expected`]); it hears of the found losses only where time
//!   is undecided between two numbers.
//!
//! Measured limits (property tests): exact for jitter up to 5 % of the period (rms) with a fifth of the frames lost,
//! and for stamps up to 2.5 periods late on a busy host; a drop in the very moment of such a jam may be counted
//! wrong by one, and is then mostly seen as a disagreement.
//!
//! A loss is marked on the frame behind it as soon as that comes, and a mark that later frames refute is taken
//! back by name ([`Note::Retracted`]): marks - retractions + what fell due after the last frame = found losses, always.
//!
//! `received + lost - expected` is reported as it is, per second and in total; it is 0 unless the driver's
//! sequence contradicts its stamps. Only across a pause (stream restarted, device gone) is there a single
//! witness, the time: both sides then use the same whole number of periods.

use std::collections::VecDeque;

use super::counts::{CaptureCounts, Excluded, Losses, SecondCounts};
use hydroline_core::frame::{FrameFault, LossBefore};

pub mod expected;
pub mod tracker;

use expected::Expected;
use tracker::Tracker;

/// Steps kept open, so that a late frame or a changed rate is distinguished from a loss by what follows it.
const OPEN_STEPS: usize = 24;
/// Like intervals that make a new rate.
const RATE_STEPS: usize = 8;
/// Intervals of one changed rate agree within this ratio.
const RATE_SPREAD: f64 = 1.2;
/// A rate counts as changed beyond this relative difference; smaller ones the tracker follows.
const RATE_STEP: f64 = 0.10;
/// Intervals within this share of the period are calm.
const CALM: f64 = 0.25;
/// Readout and transfer of a frame after its stamp, beyond one period \[ns\]: USB, decoding in the driver, a busy host.
const TRANSFER_NS: f64 = 20e6;
/// One account entry per this many nanoseconds of stamps.
const SECOND_NS: f64 = 1e9;

/// Whole periods after the frame stamped `last_ns` whose frames must have been here by `now_ns` (same scale).
///
/// A frame may come up to one period and a transfer after its stamp (drivers stamp start or end of the exposure): the
/// one in flight at `now_ns` is not due.
pub fn due_after(last_ns: u64, now_ns: u64, period_ns: f64) -> u64 {
    if !(period_ns.is_finite() && period_ns > 0.0) {
        return 0;
    }
    let since_ns = now_ns.saturating_sub(last_ns) as f64;
    ((since_ns - TRANSFER_NS) / period_ns - 1.0)
        .floor()
        .clamp(0.0, tracker::FAR) as u64
}

/// Why the stream stood still.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Pause {
    /// Silence without an error.
    Frozen,
    /// Restarted after an error of the driver.
    Restarted,
    /// The device was gone.
    Unplugged,
}

/// Note of the account, besides the loss before a frame.
#[derive(Debug, Clone, PartialEq)]
pub enum Note {
    /// The period changed for good.
    RateChanged {
        /// Before \[s\].
        from_period_s: f64,
        /// Now \[s\].
        to_period_s: f64,
    },
    /// The sequence started again or jumped to where time does not follow: time alone decides here.
    Renumbered {
        /// Sequence number of the frame before.
        from: u32,
        /// Sequence number of this frame.
        to: u32,
    },
    /// Losses marked on an earlier frame were none (it was late, and those behind it have come), or stand elsewhere
    /// now. Marks minus retractions are the account, at any time.
    Retracted {
        /// Sequence number of the frame that was marked: the last one of that number.
        sequence: u32,
        /// Number of its losses that are taken back.
        frames: u64,
    },
    /// This frame has the number and the period of the one before.
    Repeated {
        /// Its sequence number.
        sequence: u32,
    },
    /// The frame before was a leftover from before the start.
    Leftover {
        /// Its sequence number.
        sequence: u32,
    },
    /// A pause ended.
    Resumed {
        /// Cause of the pause.
        pause: Pause,
        /// From the last stamp before to the first after \[s\].
        gap_s: f64,
        /// Whole periods lost.
        lost: u64,
    },
    /// A second was closed.
    Second(SecondCounts),
}

#[derive(Debug, Clone, Copy)]
struct Mark {
    sequence: u32,
    stamp_ns: u64,
}

/// From one received frame to the next, which is marked with [`Self::lost`].
#[derive(Debug, Clone, Copy)]
struct Step {
    /// Number of the frame it leads to.
    sequence: u32,
    dt_ns: f64,
    sequence_gap: u64,
    /// Missing periods beyond the sequence gap; negative = the sequence claims more than time has room for.
    time_gap: i64,
    pause: Option<(Pause, u64)>,
    /// First step of a new rate: its period.
    new_period_ns: Option<f64>,
}

impl Step {
    fn lost(&self) -> u64 {
        self.pause.map_or(
            self.sequence_gap + self.time_gap.max(0) as u64,
            |(_, lost)| lost,
        )
    }
}

/// The account. Fed with every buffer that came, in order; no clock, no I/O.
#[derive(Debug, Clone)]
pub struct Account {
    tracker: Tracker,
    expected: Expected,
    origin_ns: Option<u64>,
    last: Option<Mark>,
    before_start: Option<Mark>,
    since_start: u64,
    start_pause: Option<Pause>,
    pending_pause: Option<Pause>,
    open: VecDeque<Step>,
    second: SecondCounts,
    closed: Losses,
    received: u64,
    excluded: Excluded,
    restarts: u64,
    expected_closed: u64,
    nominal_ns: f64,
    /// No rate has been settled on yet.
    rate_unsettled: bool,
    /// Frames due between the last one and the end of the recording.
    tail: Option<(Pause, u64)>,
}

impl Account {
    /// A new account; `nominal_period_s` as read back from the device, 0 if it does not state it.
    pub fn new(nominal_period_s: f64) -> Self {
        let period_ns = if nominal_period_s.is_finite() && nominal_period_s > 0.0 {
            nominal_period_s * 1e9
        } else {
            0.0
        };
        Self {
            tracker: Tracker::new(period_ns),
            expected: Expected::new(period_ns),
            origin_ns: None,
            last: None,
            before_start: None,
            since_start: 0,
            start_pause: None,
            pending_pause: None,
            open: VecDeque::with_capacity(OPEN_STEPS + 1),
            second: SecondCounts::default(),
            closed: Losses::default(),
            received: 0,
            excluded: Excluded::default(),
            restarts: 0,
            expected_closed: 0,
            nominal_ns: period_ns,
            rate_unsettled: true,
            tail: None,
        }
    }

    /// The stream was stopped and will start again: the next frame's sequence starts anew and its distance
    /// is a pause. Of several causes before the next frame the gravest is kept.
    pub fn pause(&mut self, cause: Pause) {
        self.restarts += 1;
        self.pending_pause = self.pending_pause.max(Some(cause));
    }

    /// A buffer without a frame in it (ERROR, no bytes, no stamp): counted, its numbers ignored.
    pub fn void(&mut self) {
        self.excluded.void += 1;
    }

    /// A frame's fault, for the count of excluded frames.
    pub fn mark(&mut self, fault: FrameFault) {
        match fault {
            FrameFault::DriverError => self.excluded.driver_error += 1,
            FrameFault::Truncated => self.excluded.truncated += 1,
            FrameFault::BrokenJpeg => self.excluded.broken_jpeg += 1,
            FrameFault::Stale => self.excluded.stale += 1,
        }
    }

    /// Period as measured \[ns\]; 0 = not known yet.
    pub fn period_ns(&self) -> f64 {
        self.tracker.long_period_ns()
    }

    /// A frame with its sequence number and its stamp on one monotonic scale \[ns\].
    /// Returns what was lost just before it, as far as is known now, and notes.
    pub fn frame(&mut self, sequence: u32, stamp_ns: u64) -> (LossBefore, Vec<Note>) {
        let mut notes = Vec::new();
        let mark = Mark { sequence, stamp_ns };
        self.received += 1;
        self.tail = None;
        let origin = *self.origin_ns.get_or_insert(stamp_ns);
        let at_ns = stamp_ns as f64 - origin as f64;
        let resumed = self.pending_pause.take();
        let Some(last) = self.last.replace(mark) else {
            self.tracker.anchor(at_ns);
            (self.since_start, self.before_start, self.start_pause) = (1, None, resumed);
            return (LossBefore::default(), notes);
        };
        if resumed.is_some() {
            (self.since_start, self.before_start, self.start_pause) = (1, Some(last), resumed);
            let loss = self.resume(last, mark, at_ns, resumed, &mut notes);
            return (loss, notes);
        }
        self.since_start += 1;
        let dt_ns = stamp_ns as f64 - last.stamp_ns as f64;
        let slots = self.tracker.slots(at_ns);
        let step = sequence.wrapping_sub(last.sequence);
        let claimed = u64::from(step).wrapping_sub(1);
        if step == 0 && slots <= 0 {
            // The same number in the same period: one frame handed out twice (vivid does, when it is late).
            self.last = Some(last);
            self.since_start -= 1;
            self.received -= 1;
            self.excluded.repeated += 1;
            notes.push(Note::Repeated { sequence });
            return (LossBefore::default(), notes);
        }
        let renumbered = step == 0 || step > u32::MAX / 2 || claimed > 2 * slots.max(0) as u64 + 16;
        if self.since_start == 2 && step != 1 && (renumbered || claimed as i64 > slots) {
            // v4l2loopback hands out one buffer of old content, numbered 0, before the feeder's count begins.
            self.received -= 1;
            self.excluded.leftover += 1;
            notes.push(Note::Leftover {
                sequence: last.sequence,
            });
            self.since_start = 1;
            match self.before_start {
                None => {
                    self.origin_ns = Some(stamp_ns);
                    self.tracker.anchor(0.0);
                }
                Some(before) => {
                    // The pause ends at this frame, so the mark on the leftover stands on it from now on.
                    if let Some(step) = self.open.pop_back() {
                        retract(step.sequence, step.lost(), &mut notes);
                    }
                    let cause = self.start_pause;
                    let loss = self.resume(before, mark, at_ns, cause, &mut notes);
                    return (loss, notes);
                }
            }
            return (LossBefore::default(), notes);
        }
        if renumbered {
            notes.push(Note::Renumbered {
                from: last.sequence,
                to: sequence,
            });
        }
        self.tracker.advance(at_ns, slots);
        let sequence_gap = if renumbered { 0 } else { claimed };
        let mut new = Step {
            sequence,
            dt_ns,
            sequence_gap,
            time_gap: slots - 1 - sequence_gap as i64,
            pause: None,
            new_period_ns: None,
        };
        self.settle(&mut new, &mut notes);
        self.open.push_back(new);
        // The frame's own gap is reported only after the test whether it belongs to a new rate.
        let time_gap = if self.look_for_new_rate(at_ns, &mut notes) {
            0
        } else {
            new.time_gap
        };
        let loss = LossBefore {
            sequence_gap: sequence_gap as u32,
            time_gap: time_gap.clamp(0, i64::from(u32::MAX)) as u32,
        };
        self.close_steps(&mut notes);
        (loss, notes)
    }

    /// A late frame looks like a loss and the next, on time again, like a surplus: the two cancel, and what was marked
    /// on the late one is taken back.
    fn settle(&mut self, new: &mut Step, notes: &mut Vec<Note>) {
        for old in self.open.iter_mut().rev().filter(|s| s.pause.is_none()) {
            if new.time_gap.signum() * old.time_gap.signum() == -1 {
                let both = new.time_gap.abs().min(old.time_gap.abs());
                if old.time_gap > 0 {
                    retract(old.sequence, both as u64, notes);
                }
                new.time_gap -= both * new.time_gap.signum();
                old.time_gap -= both * old.time_gap.signum();
            }
        }
    }

    fn resume(
        &mut self,
        last: Mark,
        mark: Mark,
        at_ns: f64,
        cause: Option<Pause>,
        notes: &mut Vec<Note>,
    ) -> LossBefore {
        let dt_ns = mark.stamp_ns as f64 - last.stamp_ns as f64;
        let pause = cause.unwrap_or(Pause::Restarted);
        let period_ns = self.tracker.long_period_ns();
        let lost = if period_ns > 0.0 {
            ((dt_ns / period_ns).round() - 1.0).clamp(0.0, tracker::FAR) as u64
        } else {
            0
        };
        self.tracker.anchor(at_ns);
        self.open.push_back(Step {
            sequence: mark.sequence,
            dt_ns,
            sequence_gap: 0,
            time_gap: 0,
            pause: Some((pause, lost)),
            new_period_ns: None,
        });
        notes.push(Note::Resumed {
            pause,
            gap_s: dt_ns / 1e9,
            lost,
        });
        self.close_steps(notes);
        LossBefore {
            sequence_gap: 0,
            time_gap: lost.min(u64::from(u32::MAX)) as u32,
        }
    }

    /// Eight like intervals that are not the period are a new period, not eight losses; whether they are.
    fn look_for_new_rate(&mut self, at_ns: f64, notes: &mut Vec<Note>) -> bool {
        let steady = self.tracker.settled_period_ns();
        if self.open.len() < RATE_STEPS || steady <= 0.0 {
            return false;
        }
        let recent = self.open.len() - RATE_STEPS;
        if self
            .open
            .iter()
            .skip(recent)
            .any(|s| s.pause.is_some() || s.sequence_gap > 0 || s.new_period_ns.is_some())
        {
            return false;
        }
        let intervals = || self.open.iter().skip(recent).map(|s| s.dt_ns);
        let (shortest, longest) = (
            intervals().fold(f64::INFINITY, f64::min),
            intervals().fold(0.0, f64::max),
        );
        let mean = intervals().sum::<f64>() / RATE_STEPS as f64;
        if shortest <= 0.0
            || longest > RATE_SPREAD * shortest
            || (mean / steady - 1.0).abs() < RATE_STEP
        {
            return false;
        }
        // The newest frame has not been marked yet: nothing to take back there.
        let newest = self.open.len() - 1;
        for (i, step) in self.open.iter_mut().enumerate().skip(recent) {
            if i < newest {
                retract(step.sequence, step.lost(), notes);
            }
            step.time_gap = 0;
        }
        if let Some(first) = self.open.get_mut(recent) {
            first.new_period_ns = Some(mean);
        }
        self.tracker.restart(at_ns, mean);
        // A crooked first interval may look like a rate; the nominal one is then no news.
        let nominal = self.rate_unsettled && (mean / self.nominal_ns - 1.0).abs() < RATE_STEP;
        self.rate_unsettled = false;
        if !nominal {
            notes.push(Note::RateChanged {
                from_period_s: steady / 1e9,
                to_period_s: mean / 1e9,
            });
        }
        true
    }

    fn close_steps(&mut self, notes: &mut Vec<Note>) {
        while self.open.len() > OPEN_STEPS {
            let Some(step) = self.open.pop_front() else {
                return;
            };
            if let Some(second) = self.close(step) {
                notes.push(Note::Second(second));
            }
        }
    }

    fn close(&mut self, step: Step) -> Option<SecondCounts> {
        if step.pause.is_some() {
            self.tracker.unlearn_phase();
        }
        match step.pause {
            Some((cause, lost)) => *self.closed.of(cause) += lost,
            None => {
                self.closed.sequence_gap += step.sequence_gap;
                self.closed.time_gap += step.time_gap.max(0) as u64;
                self.tracker
                    .learn(step.dt_ns, 1 + step.sequence_gap as i64 + step.time_gap);
            }
        }
        feed(&mut self.expected, &step);
        self.second.received += 1;
        self.second.lost += step.lost();
        self.second.span_s += step.dt_ns / SECOND_NS;
        if self.second.span_s < 1.0 || self.second.span_s < 3.0 && !self.calm(&step) {
            return None;
        }
        self.second.expected = self.expected.close();
        self.expected_closed += self.second.expected;
        let done = self.second;
        self.second = SecondCounts {
            from_s: done.from_s + done.span_s,
            ..SecondCounts::default()
        };
        Some(done)
    }

    /// A second ends at a frame that came on time: a late one would count its lateness into this second and out of
    /// the next, by time, while the tracker has long seen that nothing was lost.
    fn calm(&self, step: &Step) -> bool {
        let period_ns = self.tracker.long_period_ns();
        let on_time = |s: &Step| (s.dt_ns - period_ns).abs() < CALM * period_ns;
        on_time(step) && self.open.iter().take(3).all(on_time)
    }

    /// The recording ends at `now_ns` (the stamps' scale): a pause or silence since the last frame is closed, in whole
    /// periods. Silence without a named pause counts as frozen. Returns the frames lost by it.
    ///
    /// Nothing is counted where no frame ever came: there is no stamp to count from.
    pub fn finish(&mut self, now_ns: u64) -> u64 {
        let lost = self
            .last
            .map_or(0, |last| due_after(last.stamp_ns, now_ns, self.period_ns()));
        let cause = self.pending_pause.unwrap_or(Pause::Frozen);
        self.tail = (lost > 0).then_some((cause, lost));
        lost
    }

    /// The account up to the last frame, or, after [`Self::finish`], up to the end.
    pub fn counts(&self) -> CaptureCounts {
        let mut end = self.clone();
        while let Some(step) = end.open.pop_front() {
            end.close(step);
        }
        end.expected_closed += end.expected.close();
        let first = u64::from(self.last.is_some());
        // As across any pause, time is the only witness here: both sides take the same whole periods.
        let tail = end.tail.map_or(0, |(cause, lost)| {
            *end.closed.of(cause) += lost;
            lost
        });
        let expected = end.expected_closed + first + tail;
        CaptureCounts {
            received: self.received,
            excluded: self.excluded,
            lost: end.closed,
            expected,
            disagreement: (self.received + end.closed.total()) as i64 - expected as i64,
            period_s: self.period_ns() / 1e9,
            restarts: self.restarts,
            lost_at_end: tail,
        }
    }
}

impl Losses {
    fn of(&mut self, cause: Pause) -> &mut u64 {
        match cause {
            Pause::Frozen => &mut self.frozen,
            Pause::Restarted => &mut self.restarted,
            Pause::Unplugged => &mut self.unplugged,
        }
    }
}

/// Notes that `frames` of the losses marked on a frame were none.
fn retract(sequence: u32, frames: u64, notes: &mut Vec<Note>) {
    if frames > 0 {
        notes.push(Note::Retracted { sequence, frames });
    }
}

fn feed(expected: &mut Expected, step: &Step) {
    if let Some(period_ns) = step.new_period_ns {
        expected.new_rate(period_ns);
    }
    match step.pause {
        Some((_, lost)) => expected.pause(lost + 1),
        None => expected.interval(step.dt_ns, 1 + step.lost()),
    }
}

#[cfg(test)]
mod tests;
