//! The end of a search before its end, as a verdict says it.

use hydroline_inference::limit::{Account, Cause};
use serde::Serialize;

use super::Verdict;

/// Open work that the sentence names; the notes name all.
const NAMED: usize = 3;

/// Who ended a search.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, schemars::JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum TruncatedBy {
    /// The time limit.
    TimeLimit,
    /// The user, by Ctrl-C.
    Interrupt,
}

/// End of a search that was not at its end.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, schemars::JsonSchema)]
pub struct Truncated {
    /// Who ended it.
    pub by: TruncatedBy,
    /// Steps of the search that were made whole: each looks beside one model for others.
    pub steps: usize,
    /// Last work that was done, in words: `beside thruster_lag surge`.
    pub after: String,
    /// Work that was left open, in the order in which it would have come.
    pub open: Vec<String>,
}

impl Truncated {
    /// End of a search by its account; `None` = nothing was left open.
    pub fn of(account: &Account) -> Option<Truncated> {
        Some(Truncated {
            by: match account.cause? {
                Cause::Time => TruncatedBy::TimeLimit,
                Cause::Interrupt => TruncatedBy::Interrupt,
            },
            steps: account.steps,
            after: account.last.clone(),
            open: account.open.clone(),
        })
    }

    /// The end in a sentence, with at most so much of the open work.
    pub fn sentence(&self, named: usize) -> String {
        let by = match self.by {
            TruncatedBy::TimeLimit => "--time-limit",
            TruncatedBy::Interrupt => "Ctrl-C",
        };
        let mut open = self.open[..self.open.len().min(named)].join(", ");
        if self.open.len() > named {
            open += &format!(" and {} more", self.open.len() - named);
        }
        let plural = if self.steps == 1 { "" } else { "s" };
        format!(
            "The search ended by {by} after {} step{plural}; still open: {open}.",
            self.steps
        )
    }
}

impl Verdict {
    /// Marks the verdict as what was found so far, where a limit left work open.
    pub(crate) fn mark_truncated(&mut self, account: &Account) {
        let Some(truncated) = Truncated::of(account) else {
            return;
        };
        self.sentence = format!("So far: {} {}", self.sentence, truncated.sentence(NAMED));
        self.notes.push(truncated.sentence(usize::MAX));
        self.truncated = Some(truncated);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_verdict_that_a_limit_ended_is_marked_and_says_what_is_open() {
        let mut verdict = Verdict {
            sentence: "Nothing that matters was left out.".to_owned(),
            ..Verdict::default()
        };
        let mut account = Account {
            steps: 1,
            last: "beside the vehicle alone".to_owned(),
            ..Account::default()
        };
        verdict.mark_truncated(&account);
        assert_eq!(verdict.truncated, None);
        for what in ["beside a", "beside b", "beside c", "the next run"] {
            account.cut(Cause::Time, what);
        }
        verdict.mark_truncated(&account);
        assert_eq!(
            verdict.sentence,
            "So far: Nothing that matters was left out. The search ended by --time-limit after 1 step; still open: beside a, beside b, beside c and 1 more."
        );
        let truncated = verdict.truncated.unwrap();
        assert_eq!(truncated.by, TruncatedBy::TimeLimit);
        assert_eq!(truncated.after, "beside the vehicle alone");
        assert_eq!(truncated.open.len(), 4);
        assert!(verdict.notes[0].contains("the next run"));
    }
}
