//! Runs one after the other: what comes next, and how the series ends.
//!
//! A state machine without camera, files and clock: what has happened goes in, what to do next comes out with what is to be
//! said before it. Whoever drives it records, waits, asks and prints, and tells it what came of that.

mod line;

pub use line::Line;

use hydroline_core::shutdown::StopReason;
use std::time::Duration;

/// Where the plans of a series come from.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Plans {
    /// The same plan, or none, in every run.
    Given,
    /// Each is proposed by what the runs so far say.
    Proposed(Starts),
}

/// How a proposed plan is started.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Starts {
    /// Not at all: it is only shown.
    Never,
    /// By whoever is at the tank.
    Asked,
    /// By itself.
    Unasked,
}

/// A series before its next run.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Rules {
    /// Where the plans come from.
    pub plans: Plans,
    /// Number of the next run, from 1.
    pub next: u32,
    /// Number of the last run that may be made.
    pub last: u32,
    /// Earlier runs of the series that can be used.
    pub usable: usize,
    /// Pause between runs of a given plan, so that the water comes to rest.
    pub settle: Duration,
    /// Whether hands bring the vehicle back before a run; of a given plan before all but the first.
    pub return_to_start: bool,
}

/// A run that ended.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Made {
    /// Reason why it ended.
    pub stop: StopReason,
    /// Whether anything of it was lost.
    pub lost: bool,
    /// Frames without a pose, in words, where they are most.
    pub few_poses: Option<String>,
    /// Whether its log lies elsewhere than it was to be written.
    pub misplaced: bool,
    /// Reason why the calibration that it was to make is not there.
    pub not_calibrated: Option<String>,
    /// Whether the controller has not confirmed neutral at the end: the vehicle is not known to rest.
    pub neutral_open: bool,
}

/// Something that has happened.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Event {
    /// A plan is proposed, and nothing that speaks against it.
    Proposed,
    /// No run is wanted any more: the verdict is decided, or no run would decide it.
    Concluded,
    /// An offer was chosen, by its place; `None` = no more runs.
    Chosen(Option<usize>),
    /// The water has come to rest or the vehicle is back at the start; false = that was broken off.
    Ready(bool),
    /// The run has ended.
    Recorded(Made),
    /// The run's poses are there.
    Examined {
        /// Whether somebody wants no more runs.
        stop: bool,
    },
}

/// The next thing to do; the event that it ends with goes to [`Series::next`].
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Action {
    /// Diagnose the runs, and propose plans for the next one.
    Propose {
        /// Its number.
        run: u32,
        /// Runs that may still be made.
        left: usize,
    },
    /// Ask which of the plans to start.
    Choose,
    /// Let the water come to rest for so long.
    Settle(Duration),
    /// Show the way back to the start of this run, until the vehicle is there.
    Return {
        /// Its number.
        run: u32,
    },
    /// Record a run.
    Record {
        /// Its number.
        run: u32,
        /// Place of its plan among the offers; 0 where the plan is given.
        offer: usize,
    },
    /// Find the poses of the run that has ended.
    Examine {
        /// Its number.
        run: u32,
    },
    /// Nothing more.
    End(End),
}

/// How a series ends.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum End {
    /// As far as it was to go, or as somebody let it.
    Done {
        /// Whether anything was lost in a run.
        lossy: bool,
    },
    /// A run failed.
    Failed(String),
}

/// A line to say, and an action to do then.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Step {
    /// For people, first.
    pub say: Option<Line>,
    /// Then this.
    pub action: Action,
}

/// The state machine.
#[derive(Debug, Clone)]
pub struct Series {
    rules: Rules,
    /// Place of the chosen plan.
    offer: usize,
    lossy: bool,
    /// Somebody ended the last run.
    ended: bool,
    /// The water has come to rest.
    settled: bool,
}

impl Series {
    /// A series, and its first step.
    pub fn begin(rules: Rules) -> (Series, Step) {
        let series = Series {
            rules,
            offer: 0,
            lossy: false,
            ended: false,
            settled: false,
        };
        let step = match rules.plans {
            Plans::Given => series.record(),
            Plans::Proposed(_) => {
                let goes_on = (rules.usable > 0).then_some(Line::GoesOn { runs: rules.usable });
                series.propose().saying(goes_on)
            }
        };
        (series, step)
    }

    /// Step that follows an event.
    pub fn next(&mut self, event: Event) -> Step {
        let Rules { plans, .. } = self.rules;
        match event {
            Event::Concluded => self.end(),
            Event::Proposed => match plans {
                Plans::Proposed(Starts::Asked) => Action::Choose.into(),
                Plans::Proposed(Starts::Unasked) | Plans::Given => self.record(),
                Plans::Proposed(Starts::Never) => self.end(),
            },
            Event::Chosen(Some(offer)) => {
                self.offer = offer;
                match self.rules.return_to_start {
                    true => self.bring_back(),
                    false => self.record(),
                }
            }
            Event::Chosen(None) | Event::Ready(false) => self.stopped(),
            Event::Ready(true) if !self.settled && plans == Plans::Given => {
                self.settled = true;
                match self.rules.return_to_start {
                    true => self.bring_back(),
                    false => self.record(),
                }
            }
            Event::Ready(true) => self.record(),
            Event::Recorded(made) => self.recorded(made),
            Event::Examined { stop } => {
                self.rules.next += 1;
                self.rules.usable += 1;
                match stop || self.ended {
                    true => self.end().saying(Some(Line::EndedHere)),
                    false => self.propose(),
                }
            }
        }
    }

    /// Step that follows a run: none does where the thrusters may still be running.
    fn recorded(&mut self, mut made: Made) -> Step {
        if !made.neutral_open {
            return self.recorded_at_rest(made);
        }
        self.lossy = true;
        let few_poses = made.few_poses.take();
        let step = self.recorded_at_rest(made);
        let step = match step.action {
            Action::End(_) => step,
            _ => self.end(),
        };
        step.saying(Some(Line::NeutralOpen { few_poses }))
    }

    fn recorded_at_rest(&mut self, made: Made) -> Step {
        let failed = |words: String| Action::End(End::Failed(words)).into();
        match &made.stop {
            StopReason::Failed(_) | StopReason::Limit(_) | StopReason::PlanAborted(_) => {
                return failed(made.stop.to_string());
            }
            // Recorded as planned, but not where it was to be: what comes next would not find it.
            _ if made.misplaced => return failed(MISPLACED.to_owned()),
            StopReason::LogStopped(_) => {
                self.lossy = true;
                return match self.rules.plans {
                    Plans::Given => self.end(),
                    Plans::Proposed(_) => self.examine(),
                };
            }
            StopReason::Asked(_)
            | StopReason::Finished
            | StopReason::PlanCut(_)
            | StopReason::SourceEnded => {}
        }
        if let Some(why) = made.not_calibrated {
            return failed(why);
        }
        self.ended = matches!(made.stop, StopReason::Asked(_));
        self.lossy |= made.lost || made.few_poses.is_some();
        let step = match self.rules.plans {
            Plans::Proposed(_) => self.examine(),
            Plans::Given if self.ended || self.rules.next >= self.rules.last => self.end(),
            Plans::Given => {
                self.rules.next += 1;
                self.settled = false;
                Action::Settle(self.rules.settle).into()
            }
        };
        step.saying(made.few_poses.map(Line::FewPoses))
    }

    /// End of a series that somebody wanted before a run.
    fn stopped(&self) -> Step {
        let Rules { next, last, .. } = self.rules;
        self.end().saying(Some(match self.rules.plans {
            Plans::Given => Line::StoppedBetween {
                made: next - 1,
                of: last,
            },
            Plans::Proposed(_) => Line::Ended {
                runs: self.rules.usable,
            },
        }))
    }

    fn propose(&self) -> Step {
        let Rules { next, last, .. } = self.rules;
        let left = (last + 1).saturating_sub(next) as usize;
        Action::Propose { run: next, left }.into()
    }

    fn bring_back(&self) -> Step {
        let run = self.rules.next;
        Action::Return { run }.into()
    }

    fn record(&self) -> Step {
        let (run, offer) = (self.rules.next, self.offer);
        Action::Record { run, offer }.into()
    }

    fn examine(&self) -> Step {
        let run = self.rules.next;
        Action::Examine { run }.into()
    }

    fn end(&self) -> Step {
        Action::End(End::Done { lossy: self.lossy }).into()
    }
}

/// Why a run whose log lies elsewhere is the last one.
const MISPLACED: &str = "the log is not where it was to be written, as said above";

impl From<Action> for Step {
    fn from(action: Action) -> Step {
        Step { say: None, action }
    }
}

impl Step {
    fn saying(self, say: Option<Line>) -> Step {
        Step { say, ..self }
    }
}

#[cfg(test)]
mod tests;
