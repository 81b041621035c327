//! Methods of search behind one trait.

use super::forward::ForwardError;
use super::problem::{Objective, Problem};

/// Where a search ended.
#[derive(Debug, Clone, PartialEq)]
pub struct Solution {
    /// All parameters of the problem.
    pub parameters: Vec<f64>,
    /// The objective there.
    pub objective: f64,
    /// Evaluations of the objective over all runs; one with sensitivities counts as one.
    pub evaluations: usize,
    /// Whether the method's own criterion of convergence was met.
    pub converged: bool,
    /// Starting points, restarts or repetitions tried.
    pub tries: usize,
}

/// Failure of a search.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[allow(missing_docs)] // Each message names its fields.
pub enum MethodError {
    #[error(
        "no starting point gives a finite motion ({0}); check the rig's coefficients (all negative) and the commands' units"
    )]
    NoStart(ForwardError),
    #[error("no free parameter")]
    NothingFree,
}

/// A search. The same problem, objective and seed give the same answer.
pub trait Method: Sync {
    /// Name on the command line.
    fn name(&self) -> &'static str;

    /// Minimises the objective of a problem; random numbers come from `seed`.
    ///
    /// # Errors
    /// [`MethodError`].
    fn minimise(
        &self,
        problem: &Problem<'_>,
        objective: Objective,
        seed: u64,
    ) -> Result<Solution, MethodError>;
}
