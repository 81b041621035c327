//! Options of an identification, and the reasons why there is none.

use hydroline_identify::data::TooSparse;
use hydroline_identify::parameter::Coefficient;
use hydroline_rigs::Dof;
use hydroline_sim::effect::EffectError;

/// Equations of motion to fit.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ModelChoice {
    /// One DOF when only one is driven (or, without commands, only one moves), else coupled.
    Auto,
    /// One DOF.
    Axis(Dof),
    /// The rig's model (`eq1` or `decoupled`), every DOF that moves.
    Coupled,
}

/// Options of an identification.
#[derive(Clone)]
pub struct Options<'a> {
    /// Equations of motion.
    pub model: ModelChoice,
    /// Coefficients kept as the rig has them.
    pub fixed: Vec<Coefficient>,
    /// Every run starts at rest: its velocity there is 0.
    pub from_rest: bool,
    /// Priors of coefficients and starts that say nothing: maximum likelihood.
    pub flat_priors: bool,
    /// Leave-one-run-out.
    pub cross_validate: bool,
    /// The uncertainty budget beside the samples' scatter.
    pub budget: bool,
    /// Receiver of what begins, in words.
    pub progress: &'a (dyn Fn(&str) + Sync),
}

impl Default for Options<'_> {
    fn default() -> Self {
        Options {
            model: ModelChoice::Auto,
            fixed: Vec::new(),
            from_rest: false,
            flat_priors: false,
            cross_validate: true,
            budget: true,
            progress: &|_| {},
        }
    }
}

/// Failure to identify.
#[derive(Debug, thiserror::Error)]
#[allow(missing_docs)] // Each message names its fields.
pub enum EstimateError {
    #[error(
        "{samples} usable samples for {free} unknowns in {dof}; give longer runs, or check that the channel is in the log (hydroline info)"
    )]
    TooFew {
        samples: usize,
        free: usize,
        dof: String,
    },
    #[error("all {0} log(s) are at rest: they measure the noise; add runs that move")]
    OnlyStill(usize),
    #[error("no run given")]
    NoRun,
    #[error("no coefficient is free: all of {0} are fixed (--fix); leave one free")]
    NothingFree(String),
    #[error(
        "no starting point gives a finite motion in {0}; check the rig's coefficients (all negative) and the commands' units"
    )]
    NoFit(String),
    #[error(transparent)]
    TooSparse(#[from] TooSparse),
    #[error(transparent)]
    Effect(#[from] EffectError),
}
