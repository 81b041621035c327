//! Lines that a series prints between its steps.

use std::fmt;

/// A line for people.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Line {
    /// Earlier runs of the series are there.
    GoesOn {
        /// Number that can be used.
        runs: usize,
    },
    /// Somebody wanted no more runs, with so many usable.
    Ended {
        /// Number that can be used.
        runs: usize,
    },
    /// The same, after a run.
    EndedHere,
    /// Somebody broke off the pause between runs of a given plan.
    StoppedBetween {
        /// Runs that are recorded.
        made: u32,
        /// Runs that were wanted.
        of: u32,
    },
    /// Few frames of the run have a pose.
    FewPoses(String),
    /// The controller has not confirmed neutral at the end of a run.
    NeutralOpen {
        /// Few frames of the run have a pose, too.
        few_poses: Option<String>,
    },
}

impl fmt::Display for Line {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Line::GoesOn { runs } => write!(f, "goes on from {runs} run(s) of this series"),
            Line::Ended { runs } => {
                write!(
                    f,
                    "ended by you; the same command goes on from {runs} run(s)"
                )
            }
            Line::EndedHere => f.write_str("ended by you; the same command goes on from here"),
            Line::StoppedBetween { made, of } => {
                write!(f, "stopped between runs; {made} of {of} runs are recorded")
            }
            Line::FewPoses(words) => f.write_str(words),
            Line::NeutralOpen { few_poses } => {
                f.write_str(
                    "the controller has not confirmed neutral: the thrusters may still run, and no further run follows; look \
                     at them, cut their power if they do, then `hydroline check`",
                )?;
                match few_poses {
                    Some(words) => write!(f, "; {words}"),
                    None => Ok(()),
                }
            }
        }
    }
}
