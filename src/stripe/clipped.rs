//! Fit of a column whose brightest pixels are clipped: from the flanks, with the exact model.
//!
//! A clipped pixel says "at least so bright", which the flanks already imply, so it is left
//! out. What is left lies far from the centre, where the table's linearisation is too coarse:
//! here the profile is evaluated exactly at every step,
//! `P = s sqrt(2 pi) (Phi(b) - Phi(a))`, a, b = edges of the pixel over s,
//! `dP/dc = g(a) - g(b)`, `dP/ds = P/s + a g(a) - b g(b)`, `g(x) = exp(-x^2 / 2)`.

use super::fit::{Fit, Known, Window};
use super::kernel::{Kernel, SIGMA_MAX_PX, SIGMA_MIN_PX};
use nalgebra::{Matrix4, Vector4};

/// Reach and step of the table: linear interpolation is good to 4e-5 of the height at most.
const REACH: f64 = 7.0;
const STEPS_PER_UNIT: f64 = 96.0;
const MAX_ITERATIONS: usize = 12;
/// Steps below these end the iteration \[px\].
const ROW_STEP_PX: f64 = 0.01;
const SIGMA_STEP_PX: f64 = 0.03;

/// sqrt(2 pi) Phi(x) and exp(-x²/2), tabulated.
#[derive(Debug, Clone)]
pub(super) struct GaussTable {
    values: Vec<[f64; 2]>,
}

impl GaussTable {
    /// Builds the table.
    pub fn new() -> Self {
        let step = 1.0 / STEPS_PER_UNIT;
        let gauss = |x: f64| (-0.5 * x * x).exp();
        let mut integral = 0.0;
        let count = (2.0 * REACH * STEPS_PER_UNIT) as usize + 2;
        let values = (0..count)
            .map(|i| {
                let x = -REACH + step * i as f64;
                let here = [integral, gauss(x)];
                // Simpson's rule over the step: exact to 1e-13.
                integral += step / 6.0 * (gauss(x) + 4.0 * gauss(x + 0.5 * step) + gauss(x + step));
                here
            })
            .collect();
        Self { values }
    }

    fn at(&self, x: f64) -> [f64; 2] {
        let place = (x.clamp(-REACH, REACH) + REACH) * STEPS_PER_UNIT;
        let index = (place as usize).min(self.values.len() - 2);
        let part = place - index as f64;
        let ([p, g], [q, h]) = (self.values[index], self.values[index + 1]);
        [p + part * (q - p), g + part * (h - g)]
    }
}

/// Fits a clipped column from `start_px`, under the taps of `kernel`.
pub(super) fn fit(
    window: &Window,
    kernel: &Kernel,
    gauss: &GaussTable,
    start_px: f64,
    wander_px: f64,
    known: Known,
) -> Option<Fit> {
    let (mut row_px, mut sigma_px) = (start_px, kernel.sigma_px);
    for _ in 0..MAX_ITERATIONS {
        let whole = (row_px + 0.5).floor();
        let y = window.under(kernel, whole as i64)?;
        let first = whole - kernel.half as f64;
        let system = System::at(&y[..kernel.taps()], first, row_px, sigma_px, gauss, known);
        let (solution, row_variance) = system.solve()?;
        let (b, a) = (solution[0], solution[1]);
        if a <= 0.0 {
            return None;
        }
        let row_step = (solution[2] / a).clamp(-sigma_px, sigma_px);
        let sigma_step = (solution[3] / a).clamp(-0.3 * sigma_px, 0.3 * sigma_px);
        row_px += row_step;
        sigma_px = (sigma_px + sigma_step).clamp(SIGMA_MIN_PX, SIGMA_MAX_PX);
        if (row_px - start_px).abs() > wander_px {
            return None;
        }
        if row_step.abs() < ROW_STEP_PX && sigma_step.abs() < SIGMA_STEP_PX {
            let variance = system.residual(&solution);
            return Some(Fit {
                row_px,
                peak: a,
                background: b,
                sigma_px,
                variance,
                row_variance,
                saturated: true,
            });
        }
    }
    None
}

/// Normal equations for (b, A, A dc, A ds) over the pixels that are not clipped.
struct System {
    normal: Matrix4<f64>,
    right: Vector4<f64>,
    square: f64,
    used: f64,
    /// Of the pixels alone, without prior knowledge.
    pixels: Matrix4<f64>,
    offset: f64,
}

impl System {
    fn at(
        y: &[i16],
        first: f64,
        row_px: f64,
        sigma_px: f64,
        gauss: &GaussTable,
        known: Known,
    ) -> Self {
        let mut normal = Matrix4::zeros();
        let mut right = Vector4::zeros();
        let (mut square, mut used) = (0.0, 0.0);
        // Numbers near zero lose no digits in the residual.
        let offset = f64::from(y.first().copied().unwrap_or(0));
        let saturation = i16::from(known.saturation);
        let mut a = (first - 0.5 - row_px) / sigma_px;
        let [mut integral, mut height] = gauss.at(a);
        for (k, value) in y.iter().enumerate() {
            let b = (first + k as f64 + 0.5 - row_px) / sigma_px;
            let [next_integral, next_height] = gauss.at(b);
            if *value < saturation {
                let p = sigma_px * (next_integral - integral);
                let haze = known.haze.map_or(0.0, |(shape, level)| {
                    f64::from(level) * shape.at(first + k as f64 - row_px)
                });
                let x = Vector4::new(
                    1.0,
                    p + haze,
                    height - next_height,
                    p / sigma_px + a * height - b * next_height,
                );
                let v = f64::from(*value) - offset;
                normal.ger(1.0, &x, &x, 1.0);
                right.axpy(v, &x, 1.0);
                square += v * v;
                used += 1.0;
            }
            (a, integral, height) = (b, next_integral, next_height);
        }
        let pixels = normal;
        if let Some(prior) = known.width {
            // (A ds) - A (expected - current width) = 0, with the prior's weight.
            let x = Vector4::new(0.0, sigma_px - prior.sigma_px, 0.0, 1.0);
            normal.ger(prior.weight, &x, &x, 1.0);
        }
        Self {
            normal,
            right,
            square,
            used,
            pixels,
            offset,
        }
    }

    fn solve(&self) -> Option<(Vector4<f64>, f64)> {
        let factor = self.normal.cholesky()?;
        let mut solution = factor.solve(&self.right);
        solution[0] += self.offset;
        let covariance = factor.solve(&Vector4::new(0.0, 0.0, 1.0, 0.0));
        Some((solution, covariance[2]))
    }

    /// Residual variance of the pixels used.
    fn residual(&self, solution: &Vector4<f64>) -> f64 {
        let mut s = *solution;
        s[0] -= self.offset;
        let sum = self.square - 2.0 * s.dot(&self.right) + s.dot(&(self.pixels * s));
        sum.max(0.0) / (self.used - 4.0).max(1.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::stripe::kernel::profile;

    #[test]
    fn table_gives_the_profile() {
        let table = GaussTable::new();
        for (d, s) in [(0.3f64, 0.8f64), (2.0, 1.1), (-5.0, 3.0), (20.0, 2.0)] {
            let (a, b) = ((d - 0.5) / s, (d + 0.5) / s);
            let ([p, g], [q, h]) = (table.at(a), table.at(b));
            let [exact, c, w] = profile(d, s);
            assert!((s * (q - p) - exact).abs() < 1e-4);
            assert!((g - h - c).abs() < 1e-4);
            assert!(((q - p) + a * g - b * h - w).abs() < 2e-4);
        }
    }
}
