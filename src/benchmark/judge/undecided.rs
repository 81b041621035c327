//! Names that the data cannot distinguish, by the ideal observer: it knows the noise and the truth.

use super::Found;
use super::tally::Split;
use super::thresholds::{SAID, SPLIT};
use crate::case::Case;
use crate::observer::Ideal;

/// The observer of a case, and what the diagnosis says of it.
pub(super) struct Undecided<'a> {
    ideal: Option<&'a Ideal>,
    /// A law that the observer has only nearly: what soaks up its error beats the truth, and stands for nothing.
    near: bool,
    said: &'a [Found],
}

impl<'a> Undecided<'a> {
    /// Without an observer everything can be distinguished. `said`: what the diagnosis found; nothing where the
    /// observer's own choice is asked about.
    pub(super) fn new(ideal: Option<&'a Ideal>, case: &Case, said: &'a [Found]) -> Self {
        Undecided {
            ideal,
            near: case.key.tank.external_law.is_some(),
            said,
        }
    }
}

/// Whether a gap in log evidence leaves open which of two effects is there.
fn open(gap: f64, said: bool, near: bool) -> bool {
    let apart = if said { SAID } else { SPLIT };
    gap < apart && (!near || gap > -apart)
}

impl Split for Undecided<'_> {
    fn exchanged(&self, missing: &str, wrong: &str) -> bool {
        let or = |f: &Found| f.effect == wrong && f.or.iter().any(|o| o == missing);
        let said = self.said.iter().any(or);
        let gap = self.ideal.and_then(|i| i.gap(missing, wrong));
        gap.is_some_and(|g| open(g, said, self.near))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_beats_a_truth_that_is_not_quite_the_vocabularys_stands_for_nothing() {
        assert!(open(-40.0, false, false) && !open(-40.0, false, true));
        assert!(open(2.9, false, true) && !open(3.1, false, true));
        assert!(open(5.9, true, true) && !open(6.1, true, false));
        assert!(!open(f64::NAN, true, false) && !open(f64::INFINITY, true, false));
    }
}
