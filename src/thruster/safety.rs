//! Limits on commands: pulse range and slew are checked before a byte is made, and who says stop is remembered.
//!
//! A pulse outside the range is a mistake upstream: the set is REFUSED and the thrusters go to neutral. A step that is
//! too steep is ordinary (a plan's edge): it is LIMITED by ramping, with one event per ramp. Going to neutral is never
//! slowed down.

use std::fmt;

/// Reason why the thrusters are at neutral.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum NeutralReason {
    /// Not started yet, or the plan is over.
    Idle,
    /// Someone asked.
    Request,
    /// A limit on x, z or attitude was passed.
    Limit,
    /// A set-point came too late or not at all.
    Deadline,
    /// A pulse outside the range was asked for.
    Range,
    /// The link was lost.
    Lost,
    /// The controller says that it puts out other pulses than it was sent.
    Contradicted,
    /// The controller goes on reporting errors.
    Fault,
    /// The daemon ends.
    Exit,
    /// A part of the daemon panicked.
    Panic,
}

impl NeutralReason {
    /// Word in the log (`cause` of a command).
    pub fn word(self) -> &'static str {
        match self {
            NeutralReason::Idle => "neutral",
            NeutralReason::Request => "request",
            NeutralReason::Limit => "limit",
            NeutralReason::Deadline => "deadline",
            NeutralReason::Range => "range",
            NeutralReason::Lost => "lost",
            NeutralReason::Contradicted => "contradicted",
            NeutralReason::Fault => "fault",
            NeutralReason::Exit => "exit",
            NeutralReason::Panic => "panic",
        }
    }
}

impl fmt::Display for NeutralReason {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.word())
    }
}

/// State of the thrusters.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum State {
    /// At neutral, ready to run.
    Armed,
    /// Following set-points.
    Running,
    /// At neutral until armed again.
    Neutral(NeutralReason),
    /// No link; neutral is the first thing sent when it is back.
    Lost,
}

/// Limits of the rig.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PulseLimits {
    /// Neutral \[us\].
    pub neutral_us: f64,
    /// Smallest \[us\].
    pub min_us: f64,
    /// Largest \[us\].
    pub max_us: f64,
    /// Largest change \[us/s\].
    pub max_slew_us_per_s: f64,
    /// Longest step the slew limit credits \[s\]: a pause must not save up a jump. Two command periods.
    pub max_step_s: f64,
}

/// Reason why a set was refused.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[allow(missing_docs)] // Each message names its fields.
pub enum Refused {
    #[error(
        "thruster {index}: pulse {pulse_us} us is outside {min_us}..{max_us} us: nothing was sent; check the curve and [thrusters] limits"
    )]
    Range {
        index: usize,
        pulse_us: f64,
        min_us: f64,
        max_us: f64,
    },
    #[error("{got} pulses for {want} thrusters: nothing was sent")]
    Count { got: usize, want: usize },
    #[error("thrusters are {state:?}: a set-point is not taken before they are armed again")]
    State { state: State },
}

/// A set that may go out.
#[derive(Debug, Clone, PartialEq)]
pub struct Admitted {
    /// Pulses in the rig's order \[us\], within range and slew.
    pub pulses_us: Vec<f64>,
    /// Index and wanted pulse \[us\] of the first thruster whose step was limited.
    pub limited: Option<(usize, f64)>,
    /// True on the first limited set of a ramp: time for one event.
    pub ramp_begins: bool,
}

/// The gate between set-points and the wire.
#[derive(Debug, Clone)]
pub struct Safety {
    limits: PulseLimits,
    state: State,
    last_us: Vec<f64>,
    last_ns: Option<u64>,
    ramping: bool,
}

impl Safety {
    /// `channels` thrusters, all taken to be at neutral.
    pub fn new(limits: PulseLimits, channels: usize) -> Self {
        Self {
            limits,
            state: State::Neutral(NeutralReason::Idle),
            last_us: vec![limits.neutral_us; channels],
            last_ns: None,
            ramping: false,
        }
    }

    /// State of the thrusters.
    pub fn state(&self) -> State {
        self.state
    }

    /// Ready to run again; not possible without a link. True when the state is now `Armed` or already `Running`.
    pub fn arm(&mut self) -> bool {
        match self.state {
            State::Lost => false,
            State::Running => true,
            State::Neutral(_) | State::Armed => {
                self.state = State::Armed;
                true
            }
        }
    }

    /// Everything to neutral at once. Returns the pulses to send; true when the state changed by it.
    pub fn neutral(&mut self, reason: NeutralReason, now_ns: u64) -> (Vec<f64>, bool) {
        let next = if self.state == State::Lost {
            State::Lost
        } else {
            State::Neutral(reason)
        };
        let changed = next != self.state;
        self.state = next;
        self.last_us.fill(self.limits.neutral_us);
        self.last_ns = Some(now_ns);
        self.ramping = false;
        (self.last_us.clone(), changed)
    }

    /// The link is gone. True when it was there before.
    pub fn lose(&mut self) -> bool {
        let changed = self.state != State::Lost;
        self.state = State::Lost;
        self.last_us.fill(self.limits.neutral_us);
        self.ramping = false;
        changed
    }

    /// The link is back (and neutral has been sent): neutral, not running.
    pub fn regain(&mut self, reason: NeutralReason) {
        if self.state == State::Lost {
            self.state = State::Neutral(reason);
        }
    }

    /// Checks a wanted set; on success it counts as sent.
    ///
    /// # Errors
    /// [`Refused`]; nothing may be sent then.
    pub fn admit(&mut self, now_ns: u64, wanted_us: &[f64]) -> Result<Admitted, Refused> {
        if !matches!(self.state, State::Armed | State::Running) {
            return Err(Refused::State { state: self.state });
        }
        if wanted_us.len() != self.last_us.len() {
            return Err(Refused::Count {
                got: wanted_us.len(),
                want: self.last_us.len(),
            });
        }
        let PulseLimits { min_us, max_us, .. } = self.limits;
        for (index, &pulse_us) in wanted_us.iter().enumerate() {
            // Written so that NaN is refused too.
            if !(pulse_us >= min_us && pulse_us <= max_us) {
                return Err(Refused::Range {
                    index,
                    pulse_us,
                    min_us,
                    max_us,
                });
            }
        }
        let dt_s = self.last_ns.map_or(self.limits.max_step_s, |last| {
            now_ns.saturating_sub(last) as f64 * 1e-9
        });
        let step_us = self.limits.max_slew_us_per_s * dt_s.min(self.limits.max_step_s);
        let mut limited = None;
        for (index, (last, &wanted)) in self.last_us.iter_mut().zip(wanted_us).enumerate() {
            let next = wanted.clamp(*last - step_us, *last + step_us);
            // On the wire's grid, rounded TOWARDS the last value: rounding must not break the slew limit.
            let next = if next == wanted {
                next
            } else {
                towards_quarter(next, *last)
            };
            if next != wanted && limited.is_none() {
                limited = Some((index, wanted));
            }
            *last = next;
        }
        let ramp_begins = limited.is_some() && !self.ramping;
        self.ramping = limited.is_some();
        self.last_ns = Some(now_ns);
        self.state = State::Running;
        Ok(Admitted {
            pulses_us: self.last_us.clone(),
            limited,
            ramp_begins,
        })
    }
}

fn towards_quarter(value_us: f64, last_us: f64) -> f64 {
    let quarters = value_us * 4.0;
    let rounded = if value_us > last_us {
        quarters.floor()
    } else {
        quarters.ceil()
    } / 4.0;
    // A step smaller than the grid must not walk backwards past the last value.
    if value_us > last_us {
        rounded.max(last_us)
    } else {
        rounded.min(last_us)
    }
}

#[cfg(test)]
mod tests;
