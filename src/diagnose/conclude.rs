//! Outcome of a diagnosis, and the reasons why there is none.

use std::ops::ControlFlow;

use hydroline_identify::data::TooSparse;
use hydroline_inference::limit::Account;
use hydroline_report::Body;
use hydroline_rigs::Rig;
use hydroline_sim::effect::EffectError;

use super::profiles::ImageError;
use super::source::Source;
use super::verdict::{DataFault, Verdict, Word};

/// Why there is no verdict.
#[derive(Debug, thiserror::Error)]
#[allow(missing_docs)] // Each message names its fields.
pub enum DiagnoseError {
    #[error(
        "no DOF moves in these {0} log(s): nothing to diagnose; give runs with commands, or a decay"
    )]
    NothingMoves(usize),
    /// Runs that show no motion of any DOF.
    #[error(transparent)]
    Runs(#[from] TooSparse),
    #[error(transparent)]
    Effect(#[from] EffectError),
    #[error(transparent)]
    Images(Box<ImageError>),
    #[error(
        "{dof}: the rig's own model gives no finite motion; check its coefficients (all negative) and the commands' units"
    )]
    NoFit {
        /// DOF, by name.
        dof: &'static str,
    },
}

impl From<ImageError> for DiagnoseError {
    fn from(error: ImageError) -> DiagnoseError {
        DiagnoseError::Images(Box::new(error))
    }
}

/// A verdict, and the rig with what was left out put in.
#[derive(Debug, Clone)]
pub struct Diagnosis {
    /// For people and machines.
    pub verdict: Verdict,
    /// The rig with refitted coefficients and `[[physics]]` of the first explanation.
    pub rig: Rig,
    /// Per DOF what the report draws.
    pub shown: Vec<super::report::Shown>,
    /// Probability of what matters together, by the verdict.
    pub probability: f64,
    /// The word by the motion alone.
    pub by_motion: Word,
    /// Findings of the frames, as a section of the report; `None` = none were asked.
    pub images: Option<Body>,
    /// Plans for the next run, the best first.
    pub offers: Vec<super::body::next::Offer>,
    /// How far the search came, and what a limit left open.
    pub account: Account,
}

/// A verdict with the data's faults: `Break` where one of them ends it, of those that `counts`.
pub(super) fn stopped_by_faults(
    sources: &[Source],
    held: &[Source],
    rig: &Rig,
    counts: impl Fn(&DataFault) -> bool,
) -> ControlFlow<Diagnosis, Diagnosis> {
    let mut verdict = Verdict::default();
    let all = sources.iter().chain(held);
    verdict.data_faults = all.flat_map(|s| s.faults.clone()).collect();
    for fault in &mut verdict.data_faults {
        fault.fatal &= counts(fault);
    }
    let fatal = verdict.data_faults.iter().find(|f| f.fatal);
    let stops = fatal.map(|f| format!("{} in {} of {}: {}", f.fault, f.channel, f.run, f.evidence));
    let mut made = Diagnosis {
        verdict,
        rig: rig.clone(),
        shown: Vec::new(),
        probability: 0.0,
        by_motion: Word::DataFault,
        images: None,
        offers: Vec::new(),
        account: Account::default(),
    };
    let Some(first) = stops else {
        return ControlFlow::Continue(made);
    };
    made.verdict.verdict = Word::DataFault;
    made.verdict.sentence = format!("The data are at fault, not the model: {first}");
    ControlFlow::Break(made)
}
