//! Who answers between two runs.

use hydroline_daemon::bring_back::question::Answer;
use hydroline_daemon::record::keys::Keys;
use std::sync::mpsc::{Receiver, channel};
use std::time::Duration;

/// An Enter from before the question was asked is no answer to it.
const BEFORE: Duration = Duration::from_millis(150);

/// Keys of a terminal, else a line on stdin.
pub enum Asked {
    /// Keys of a terminal.
    Keys(Keys),
    /// A pipe: whether there was a line in it.
    Line(Receiver<bool>),
}

impl Asked {
    pub fn begin() -> Self {
        if let Some(keys) = Keys::watch(None) {
            std::thread::sleep(BEFORE);
            keys.enter();
            return Self::Keys(keys);
        }
        let (sender, receiver) = channel();
        std::thread::spawn(move || {
            let mut line = String::new();
            // End of input (no terminal, nobody there): nobody has brought anything back.
            let here = std::io::stdin().read_line(&mut line).is_ok_and(|n| n > 0);
            sender.send(here).ok();
        });
        Self::Line(receiver)
    }

    /// Answer since the last call.
    pub fn answer(&self) -> Option<Answer> {
        match self {
            Self::Keys(keys) if keys.space() || keys.quit() => Some(Answer::End),
            Self::Keys(keys) => keys.enter().then_some(Answer::Go),
            Self::Line(receiver) => receiver
                .try_recv()
                .ok()
                .map(|here| if here { Answer::Go } else { Answer::End }),
        }
    }

    /// Whether a Space or q came with the last keys.
    pub fn ended(self) -> bool {
        match self {
            Self::Keys(keys) => keys.finish(),
            Self::Line(_) => false,
        }
    }

    /// Whether the same person can be asked again.
    pub fn asks_again(&self) -> bool {
        matches!(self, Self::Keys(_))
    }
}
