//! The kinds of rows in a campaign's table.

use crate::table::Row;
use serde::{Deserialize, Serialize};

/// Kind of a row, as its column `kind` has it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Kind {
    /// A file that cannot be used.
    Bad,
    /// A log.
    Run,
    /// Runs of one day, together.
    Day,
    /// Runs of a group since its last change, together.
    Group,
    /// A change from the days before to a day.
    Change,
}

impl Kind {
    /// Word of the column.
    pub fn name(self) -> &'static str {
        match self {
            Self::Bad => "bad",
            Self::Run => "run",
            Self::Day => "day",
            Self::Group => "group",
            Self::Change => "change",
        }
    }

    /// Kind of a row; `None` = another program's.
    pub fn of(row: &Row) -> Option<Self> {
        Self::deserialize(row.get("kind")?).ok()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_row_has_the_kind_that_its_word_names() {
        for kind in [Kind::Bad, Kind::Run, Kind::Day, Kind::Group, Kind::Change] {
            let mut row = Row::new();
            assert_eq!(Kind::of(&row), None);
            row.insert("kind".to_owned(), kind.name().into());
            assert_eq!(Kind::of(&row), Some(kind));
        }
    }
}
