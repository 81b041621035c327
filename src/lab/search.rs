//! Searches for the coefficients of one DOF that the paper's tables are computed and compared with: its objective (Eq. 10), its
//! genetic algorithm, an evolution strategy, and Levenberg–Marquardt on the same equations.
//!
//! `identify` has none of them: it is the likelihood of all DOFs (`hydroline_inference`).

pub mod axis;
pub mod cmaes;
pub mod forward;
pub mod ga;
mod least_absolute;
pub mod lm;
pub mod method;
pub mod paper_fit;
pub mod problem;
