//! Cases as they are: those of the other proofs, without runs held out.

use hydroline_diagnose::Source;
use hydroline_rigs::Rig;

use crate::benchmark::case::{self, Category};
use crate::benchmark::coupled;
use crate::benchmark::error::ProveError;
use crate::benchmark::experiment::Recorded;

/// Kinds of cases of one DOF, in turn.
const KINDS: [Category; 6] = [
    Category::Single,
    Category::Nothing,
    Category::Pair,
    Category::Modulated,
    Category::Unnamed,
    Category::Triple,
];

/// A run that is given.
#[derive(Debug, Clone)]
pub struct Given {
    /// Its log.
    pub source: Source,
    /// Messages of its log, of cases that are made of messages.
    pub(super) recorded: Option<Recorded>,
}

/// A case as it is, or a variant of it.
#[derive(Debug, Clone)]
pub struct Base {
    /// Number of the case.
    pub index: usize,
    /// Id of the case of another proof that it is.
    pub of: String,
    /// The rig file.
    pub rig: Rig,
    /// Runs that are given.
    pub given: Vec<Given>,
}

impl Base {
    /// Logs that the diagnosis sees.
    pub fn sources(&self) -> Vec<Source> {
        self.given.iter().map(|g| g.source.clone()).collect()
    }
}

/// Makes a case; every third is coupled.
///
/// # Errors
/// [`ProveError`].
pub fn make(seed: u64, index: usize) -> Result<Base, ProveError> {
    if index % 3 == 2 {
        // Of the coupled cases' even numbers none has an effect.
        let nth = index / 3 + 1;
        let case = coupled::make(seed, nth)?;
        let runs = case.sources.into_iter();
        return Ok(Base {
            index,
            of: format!("coupled-{nth}"),
            rig: case.rig,
            given: runs
                .map(|source| Given {
                    source,
                    recorded: None,
                })
                .collect(),
        });
    }
    let kind = KINDS[(index - index / 3) % KINDS.len()];
    let case = case::make(seed, kind, index)?;
    let given = case.sealed.sources.into_iter().zip(case.key.runs);
    let given = given.map(|(source, run)| Given {
        source,
        recorded: Some(run),
    });
    Ok(Base {
        index,
        of: case.id,
        rig: case.sealed.rig,
        given: given.collect(),
    })
}
