//! How much, and how smoothly, a free function is expected to vary.
//!
//! Amplitudes of neighbouring hats are alike over a length: a Gaussian process with Matern's covariance of
//! smoothness 3/2 (Rasmussen and Williams 2006, Eq. 4.17), seen at the knots. A function that hardly wiggles
//! then costs what two or three numbers cost, however fine its knots are.

use nalgebra::{Cholesky, DMatrix, Dyn};

use super::kinds::{AFTER_EDGE_S, BETWEEN_S, SMALL};
use super::{Family, Variable};

/// Lengths tried, over the span of the knots; 0 = every amplitude by itself.
pub const LENGTHS: [f64; 5] = [0.0, 0.04, 0.1, 0.25, 0.6];
/// Added to the diagonal: knots much closer than a length are alike to rounding.
const NUGGET: f64 = 1e-5;

/// Prior of a function's amplitudes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Prior {
    /// sd of each amplitude \[N, N m; 1\].
    pub sd: f64,
    /// Length over which they are alike, in the variable's unit (a logarithm for times since an edge and where
    /// knots lie by ratio); 0 = none.
    pub length: f64,
}

impl Prior {
    /// Length of a share of what a function's knots span (of one run where runs are laid end to end).
    pub fn length(family: &Family, share: f64, runs: usize) -> f64 {
        let first = family.knots.first().map_or(0.0, |k| place(family, *k));
        let last = family.knots.last().map_or(0.0, |k| place(family, *k));
        let (between, parts) = match family.variable {
            Variable::TimeEach => (
                BETWEEN_S * runs.saturating_sub(1) as f64,
                runs.max(1) as f64,
            ),
            _ => (0.0, 1.0),
        };
        share * (last - first - between) / parts
    }

    /// Covariance of the amplitudes, of the prior's variance: their correlation, and less where nothing is expected.
    pub fn correlation(length: f64, family: &Family) -> DMatrix<f64> {
        let m = family.knots.len();
        DMatrix::from_fn(m, m, |i, k| {
            let both = family.expected_at(i) * family.expected_at(k);
            if i == k {
                return both * (1.0 + NUGGET);
            }
            if length <= 0.0 {
                return 0.0;
            }
            let apart = place(family, family.knots[i]) - place(family, family.knots[k]);
            let r = 3f64.sqrt() * apart.abs() / length;
            both * (1.0 + r) * (-r).exp()
        })
    }

    /// Inverse covariance, and half the logarithm of its determinant.
    pub fn precision(&self, family: &Family) -> (DMatrix<f64>, f64) {
        let m = family.knots.len();
        let scale = 1.0 / (self.sd * self.sd);
        let own = |m: usize| (DMatrix::identity(m, m) * scale, -(m as f64) * self.sd.ln());
        if self.length <= 0.0 && family.quiet.is_empty() {
            return own(m);
        }
        match Cholesky::<f64, Dyn>::new(Prior::correlation(self.length, family)) {
            Some(root) => {
                let half_log: f64 = root.l_dirty().diagonal().iter().map(|d| d.ln()).sum();
                let mut inverse = root.inverse() * scale;
                inverse.fill_lower_triangle_with_upper_triangle();
                (inverse, -(m as f64) * self.sd.ln() - half_log)
            }
            None => own(m),
        }
    }
}

/// Where a knot lies for the covariance: times since an edge, and small loads, on a logarithm.
fn place(family: &Family, knot: f64) -> f64 {
    match family.variable {
        Variable::SinceEdge | Variable::AfterEdge => (1.0 + knot.max(0.0) / AFTER_EDGE_S).ln(),
        Variable::LoadRatio | Variable::SpeedRatio => {
            // By the largest one, which stays where it is when knots become denser.
            let largest = family.knots.last().copied().unwrap_or(1.0);
            (1.0 + knot.max(0.0) / (SMALL * largest)).ln()
        }
        _ => knot,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::family::Acts;

    /// Denser knots keep what was known of the old ones.
    #[test]
    fn a_knot_between_leaves_the_correlation_of_the_others() {
        let of = |knots: &[f64]| {
            let family = Family {
                acts: Acts::Bends(0),
                variable: Variable::LoadRatio,
                knots: knots.to_vec(),
                measured: false,
                quiet: Vec::new(),
            };
            Prior::correlation(0.7, &family)
        };
        let (coarse, fine) = (of(&[0.0, 0.2, 1.5, 10.0]), of(&[0.0, 0.1, 0.2, 1.5, 10.0]));
        for (i, k) in [(0, 1), (1, 2), (1, 3), (0, 3)] {
            let moved = |i: usize| if i == 0 { 0 } else { i + 1 };
            assert_eq!(coarse[(i, k)], fine[(moved(i), moved(k))], "{i} {k}");
        }
    }

    #[test]
    fn precision_is_the_inverse_of_the_covariance_and_knows_its_determinant() {
        let family = Family {
            acts: Acts::Force,
            variable: Variable::Place,
            knots: (0..9).map(|k| 0.1 * f64::from(k)).collect(),
            measured: false,
            quiet: Vec::new(),
        };
        for share in LENGTHS {
            let prior = Prior {
                sd: 0.3,
                length: Prior::length(&family, share, 1),
            };
            let (precision, half_log) = prior.precision(&family);
            let covariance = Prior::correlation(prior.length, &family) * 0.09;
            let product = &precision * &covariance;
            let off = (product - DMatrix::identity(9, 9)).abs().max();
            assert!(off < 2e-5, "{share}: {off}");
            let log = -0.5 * covariance.determinant().ln();
            assert!((half_log - log).abs() < 1e-3, "{share}: {half_log} {log}");
        }
    }
}
