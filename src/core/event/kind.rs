//! Kinds of events: the one list of them, which every event names and the book prints.

mod camera;
mod daemon;
mod thruster;

pub use camera::*;
pub use daemon::*;
pub use thruster::*;

use super::Severity;

/// A kind of event.
#[derive(Debug, PartialEq)]
pub struct EventKind {
    /// Stable machine word in the log, `part.what`.
    pub name: &'static str,
    /// Severities with which it is written.
    pub severities: &'static [Severity],
    /// Occurrence that it reports, as the reference prints it.
    pub meaning: &'static str,
    /// Numbers that it may carry.
    pub values: &'static [EventValue],
}

/// A number that events of a kind may carry.
#[derive(Debug, PartialEq)]
pub struct EventValue {
    /// Name in the log; one that begins with `*` stands for all names with that ending.
    pub name: &'static str,
    /// Unit; "" = a count or a pure number.
    pub unit: &'static str,
    /// Meaning, as the reference prints it.
    pub meaning: &'static str,
}

impl EventKind {
    /// Whether events of this kind may carry a number of this name.
    pub fn carries(&self, value: &str) -> bool {
        self.values.iter().any(|v| match v.name.strip_prefix('*') {
            Some(ending) => value.ends_with(ending),
            None => v.name == value,
        })
    }

    /// All kinds, in the order of the book.
    pub fn all() -> impl Iterator<Item = &'static EventKind> {
        let parts = [camera::ALL, thruster::ALL, daemon::ALL];
        parts.into_iter().flatten().copied()
    }
}

/// So that a kind compares with the word that a log has.
impl PartialEq<str> for EventKind {
    fn eq(&self, word: &str) -> bool {
        self.name == word
    }
}

/// `CONSTANT "word" [Severity, ...] "meaning" { "value" ["unit"] "meaning", ... };`
macro_rules! kinds {
    ($($constant:ident $word:literal [$($severity:ident),+] $meaning:literal
        { $($value:literal [$unit:literal] $what:literal),* $(,)? };)+) => {
        $(
            #[doc = $meaning]
            pub static $constant: EventKind = EventKind {
                name: $word,
                severities: &[$(Severity::$severity),+],
                meaning: $meaning,
                values: &[$(EventValue { name: $value, unit: $unit, meaning: $what }),*],
            };
        )+
        pub(super) static ALL: &[&EventKind] = &[$(&$constant),+];
    };
}
use kinds;

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::BTreeSet;

    #[test]
    fn each_word_stands_once_and_says_what_it_means() {
        let mut words = BTreeSet::new();
        for kind in EventKind::all() {
            assert!(words.insert(kind.name), "{} stands twice", kind.name);
            assert!(kind.name.split_once('.').is_some(), "{}", kind.name);
            assert!(!kind.severities.is_empty(), "{}", kind.name);
            assert!(kind.meaning.ends_with('.'), "{}", kind.name);
            for value in kind.values {
                assert!(!value.meaning.is_empty(), "{}.{}", kind.name, value.name);
            }
        }
    }

    #[test]
    fn a_name_with_a_star_stands_for_all_with_that_ending() {
        assert!(CAMERA_RESPONSE.carries("ln_gamma_black_levels_covariance"));
        assert!(CAMERA_RESPONSE.carries("frames"));
        assert!(!CAMERA_RESPONSE.carries("covariance_of"));
        assert!(!CAMERA_LEFTOVER.carries("frames"));
    }
}
