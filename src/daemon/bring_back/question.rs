//! The question between two runs: whether the next one may start.

use std::time::Duration;

/// A second Enter within this time starts the run although the vehicle is not seen at the start.
const AGAIN: Duration = Duration::from_secs(10);

/// Answer of somebody at the tank.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Answer {
    /// The next run.
    Go,
    /// No more runs.
    End,
}

/// Consequence of an answer.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Reply {
    /// The run starts.
    Start,
    /// No run follows.
    End,
    /// The vehicle is not at the start: say so, and ask again.
    NotThere,
}

/// The question as long as it is open.
#[derive(Debug, Clone, Copy, Default)]
pub struct Question {
    /// Last time that the vehicle was not there.
    warned: Option<Duration>,
}

impl Question {
    /// Consequence of an answer at this time, which never goes back; `free` = the vehicle is back, is not looked for, or
    /// nobody can be asked again.
    pub fn reply(&mut self, at: Duration, answer: Answer, free: bool) -> Reply {
        let again = self.warned.is_some_and(|w| at.saturating_sub(w) < AGAIN);
        match answer {
            Answer::End => Reply::End,
            Answer::Go if free || again => Reply::Start,
            Answer::Go => {
                self.warned = Some(at);
                Reply::NotThere
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_second_enter_starts_a_run_away_from_the_start() {
        let mut question = Question::default();
        let s = Duration::from_secs;
        assert_eq!(question.reply(s(1), Answer::Go, true), Reply::Start);
        assert_eq!(question.reply(s(2), Answer::Go, false), Reply::NotThere);
        assert_eq!(question.reply(s(20), Answer::Go, false), Reply::NotThere);
        assert_eq!(question.reply(s(25), Answer::Go, false), Reply::Start);
        assert_eq!(question.reply(s(26), Answer::End, true), Reply::End);
    }
}
