//! Problems that are only known by their residuals: derivatives by central differences.

use nalgebra::{DMatrix, DVector, DVectorView, Dyn};

use super::{LeastSquares, Normal};

/// Residuals or their differences are not finite.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[error("a residual or one of its derivatives is not finite")]
pub struct NotFinite;

/// A step below this share of the differences' half width ends a search: a shorter one is below what the differences
/// can tell.
const NEGLIGIBLE: f64 = 1e-3;

/// A problem given by a function from unknowns to residuals.
///
/// The Jacobian is central differences with a half width per unknown, which the caller knows (he knows the unknown's
/// size): error h² f‴ / 6 + ε f / h, least near h = ε^⅓ of the size (Nocedal and Wright, section 8.1). At the border of
/// where the model is defined one side is enough.
pub struct Differences<'a, R> {
    residuals: R,
    half_widths: &'a [f64],
    jacobian: DMatrix<f64>,
    plus: Vec<f64>,
    minus: Vec<f64>,
}

impl<'a, R: FnMut(&[f64], &mut [f64]) -> bool> Differences<'a, R> {
    /// `residuals(x, out)` fills `out` (length `count`) and returns false where the model is not defined.
    /// `half_widths` are of the central differences, one per unknown.
    pub fn new(residuals: R, count: usize, half_widths: &'a [f64]) -> Self {
        Differences {
            residuals,
            half_widths,
            jacobian: DMatrix::zeros(count, half_widths.len()),
            plus: vec![0.0; count],
            minus: vec![0.0; count],
        }
    }
}

impl<R: FnMut(&[f64], &mut [f64]) -> bool> LeastSquares<Dyn> for Differences<'_, R> {
    type Point = DVector<f64>;
    /// Residuals at a point.
    type Evaluated = Vec<f64>;
    type Error = NotFinite;

    fn cost(&mut self, at: &DVector<f64>, residuals: &mut Vec<f64>) -> Option<f64> {
        residuals.resize(self.plus.len(), 0.0);
        let defined = (self.residuals)(at.as_slice(), residuals);
        let cost = 0.5 * DVectorView::from_slice(residuals, residuals.len()).norm_squared();
        (defined && cost.is_finite()).then_some(cost)
    }

    fn begin(&mut self, at: &DVector<f64>, residuals: &mut Vec<f64>) -> Result<(), NotFinite> {
        self.cost(at, residuals).map(drop).ok_or(NotFinite)
    }

    fn linearise(
        &mut self,
        at: &DVector<f64>,
        residuals: &Vec<f64>,
    ) -> Result<Normal<Dyn>, NotFinite> {
        let mut x = at.clone();
        for (k, h) in self.half_widths.iter().enumerate() {
            x[k] = at[k] + h;
            let up = (self.residuals)(x.as_slice(), &mut self.plus);
            x[k] = at[k] - h;
            let down = (self.residuals)(x.as_slice(), &mut self.minus);
            x[k] = at[k];
            for (i, slope) in self.jacobian.column_mut(k).iter_mut().enumerate() {
                *slope = match (up, down) {
                    (true, true) => (self.plus[i] - self.minus[i]) / (2.0 * h),
                    (true, false) => (self.plus[i] - residuals[i]) / h,
                    (false, true) => (residuals[i] - self.minus[i]) / h,
                    (false, false) => 0.0,
                };
            }
        }
        if self.jacobian.iter().any(|v| !v.is_finite()) {
            return Err(NotFinite);
        }
        let r = DVectorView::from_slice(residuals, residuals.len());
        Ok(Normal {
            cost: 0.5 * r.norm_squared(),
            gradient: self.jacobian.tr_mul(&r),
            hessian: self.jacobian.tr_mul(&self.jacobian),
        })
    }

    fn moved(&self, at: &DVector<f64>, step: &DVector<f64>) -> Option<DVector<f64>> {
        Some(at + step)
    }

    fn negligible(&self, _: &DVector<f64>, _: &DVector<f64>, step: &DVector<f64>) -> bool {
        let mut pairs = step.iter().zip(self.half_widths);
        pairs.all(|(step, h)| step.abs() <= NEGLIGIBLE * h)
    }
}
