//! Forward-mode automatic differentiation: a value with `N` derivatives.
//!
//! Run through the laws of motion (they are written in [`Real`]) a dual gives the exact
//! derivative of the integrator's own output, to rounding: no step size to choose, and delays
//! keep their derivative through the split steps. Reference: Griewank and Walther,
//! Evaluating Derivatives, 2nd ed., section 3.1.

use std::cmp::Ordering;
use std::ops::{Add, Div, Mul, Neg, Sub};

use crate::real::Real;

/// A real number with its derivatives with respect to `N` independent variables.
#[derive(Debug, Clone, Copy)]
pub struct Dual<const N: usize> {
    /// Value of the number.
    pub value: f64,
    /// Partial derivatives.
    pub slope: [f64; N],
}

impl<const N: usize> Dual<N> {
    /// A constant.
    pub fn constant(value: f64) -> Self {
        Dual {
            value,
            slope: [0.0; N],
        }
    }

    /// The independent variable number `index`; beyond `N` a constant.
    pub fn variable(value: f64, index: usize) -> Self {
        let mut dual = Self::constant(value);
        if let Some(slope) = dual.slope.get_mut(index) {
            *slope = 1.0;
        }
        dual
    }

    /// All values, those from `first` on as the variables of one pass of `N` directions.
    pub fn pass(values: &[f64], first: usize) -> Vec<Self> {
        values
            .iter()
            .enumerate()
            .map(|(i, v)| {
                if i >= first {
                    Self::variable(*v, i - first)
                } else {
                    Self::constant(*v)
                }
            })
            .collect()
    }

    /// A value with the slopes that `of` says, one direction after the other.
    ///
    /// Written into a fresh array and inlined everywhere: by value through calls these operators spent
    /// a fifth of a diagnosis copying operands.
    #[inline(always)]
    fn with(value: f64, of: impl Fn(usize) -> f64) -> Self {
        let mut slope = [0.0; N];
        for (i, s) in slope.iter_mut().enumerate() {
            *s = of(i);
        }
        Dual { value, slope }
    }

    /// f(self) for a function with this value and derivative at `self.value`.
    #[inline(always)]
    fn chain(self, value: f64, derivative: f64) -> Self {
        Self::with(value, |i| self.slope[i] * derivative)
    }
}

impl<const N: usize> PartialEq for Dual<N> {
    /// Compares values: a law may branch on these, never on derivatives.
    fn eq(&self, other: &Self) -> bool {
        self.value == other.value
    }
}

impl<const N: usize> PartialOrd for Dual<N> {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        self.value.partial_cmp(&other.value)
    }
}

impl<const N: usize> Add for Dual<N> {
    type Output = Self;
    #[inline(always)]
    fn add(self, other: Self) -> Self {
        Self::with(self.value + other.value, |i| self.slope[i] + other.slope[i])
    }
}

impl<const N: usize> Sub for Dual<N> {
    type Output = Self;
    #[inline(always)]
    fn sub(self, other: Self) -> Self {
        Self::with(self.value - other.value, |i| self.slope[i] - other.slope[i])
    }
}

impl<const N: usize> Mul for Dual<N> {
    type Output = Self;
    #[inline(always)]
    // The product rule.
    #[allow(clippy::suspicious_arithmetic_impl)]
    fn mul(self, other: Self) -> Self {
        Self::with(self.value * other.value, |i| {
            self.slope[i] * other.value + self.value * other.slope[i]
        })
    }
}

impl<const N: usize> Mul<f64> for Dual<N> {
    type Output = Self;
    #[inline(always)]
    fn mul(self, factor: f64) -> Self {
        self.chain(self.value * factor, factor)
    }
}

impl<const N: usize> Div for Dual<N> {
    type Output = Self;
    #[inline(always)]
    fn div(self, other: Self) -> Self {
        let inverse = 1.0 / other.value;
        // Not value * inverse: a dual's value is bit for bit that of the plain number.
        let value = self.value / other.value;
        Self::with(value, |i| {
            (self.slope[i] - value * other.slope[i]) * inverse
        })
    }
}

impl<const N: usize> Neg for Dual<N> {
    type Output = Self;
    #[inline(always)]
    fn neg(self) -> Self {
        self.chain(-self.value, -1.0)
    }
}

impl<const N: usize> Real for Dual<N> {
    /// In place: by value a table's neighbours cost more to copy than to add.
    fn weighted(values: &[Self], weights: &[f64]) -> Self {
        let mut sum = Self::constant(0.0);
        for (v, w) in values.iter().zip(weights) {
            if *w != 0.0 {
                sum.value += v.value * w;
                for (s, d) in sum.slope.iter_mut().zip(&v.slope) {
                    *s += d * w;
                }
            }
        }
        sum
    }
    fn from_f64(value: f64) -> Self {
        Self::constant(value)
    }
    fn value(self) -> f64 {
        self.value
    }
    fn constant(self) -> Option<f64> {
        self.slope.iter().all(|s| *s == 0.0).then_some(self.value)
    }
    fn sin(self) -> Self {
        self.chain(self.value.sin(), self.value.cos())
    }
    fn cos(self) -> Self {
        self.chain(self.value.cos(), -self.value.sin())
    }
    fn sin_cos(self) -> (Self, Self) {
        let (sin, cos) = self.value.sin_cos();
        (self.chain(sin, cos), self.chain(cos, -sin))
    }
    fn exp(self) -> Self {
        let e = self.value.exp();
        self.chain(e, e)
    }
    fn ln(self) -> Self {
        self.chain(self.value.ln(), 1.0 / self.value)
    }
    fn sqrt(self) -> Self {
        let root = self.value.sqrt();
        self.chain(root, 0.5 / root)
    }
    fn tanh(self) -> Self {
        let t = self.value.tanh();
        self.chain(t, 1.0 - t * t)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fixture::lshpi_rig;
    use crate::model::{Model, ModelState};
    use crate::trajectory::Trajectory;
    use crate::vehicle::{Hydrodynamics, VehicleState};
    use proptest::prelude::*;

    fn f<T: Real>(x: T, y: T) -> T {
        (x * y).sin() / (T::one() + y.exp())
            + x.abs().sqrt() * y.tanh()
            + (x - y).cos() * 0.3
            + (x * y).ln()
            + (-x).max(y).min(x + y)
    }

    proptest! {
        #[test]
        fn derivatives_are_those_of_central_differences(x in 0.2..2.0f64, y in 0.1..0.9f64) {
            let d: Dual<2> = f(Dual::variable(x, 0), Dual::variable(y, 1));
            let h = 1e-6;
            prop_assert_eq!(d.value, f(x, y));
            prop_assert!((d.slope[0] - (f(x + h, y) - f(x - h, y)) / (2.0 * h)).abs() < 1e-7);
            prop_assert!((d.slope[1] - (f(x, y + h) - f(x, y - h)) / (2.0 * h)).abs() < 1e-7);
        }
    }

    /// The sensitivity of a whole coupled trajectory, command edges off the grid included.
    #[test]
    fn a_trajectory_carries_its_sensitivities() {
        let vehicle = lshpi_rig().vehicle;
        let end = |h: Hydrodynamics<f64>| {
            let model = Model {
                hydrodynamics: h,
                effects: crate::EffectStack::empty(),
            };
            let mut path = Trajectory::new(model, ModelState::at_rest([0.0; 6]), 0.02).unwrap();
            path.command(0.013, [8.0, 3.0, 2.0, 0.3, 0.4, 0.5]).unwrap();
            path.command(2.717, [-8.0, 0.0, 2.0, 0.0, -0.4, 0.5])
                .unwrap();
            path.state_at(6.003).unwrap().vehicle
        };
        let mut h: Hydrodynamics<Dual<3>> = Hydrodynamics::new(&vehicle);
        h.added[0] = Dual::variable(vehicle.coefficients[0].added, 0);
        h.linear[4] = Dual::variable(vehicle.coefficients[4].linear, 1);
        h.quadratic[5] = Dual::variable(vehicle.coefficients[5].quadratic, 2);
        let model = Model {
            hydrodynamics: h,
            effects: crate::EffectStack::empty(),
        };
        let mut path =
            Trajectory::new(model, ModelState::at_rest([Dual::constant(0.0); 6]), 0.02).unwrap();
        let wrench = |w: [f64; 6]| w.map(Dual::constant);
        path.command(
            Dual::constant(0.013),
            wrench([8.0, 3.0, 2.0, 0.3, 0.4, 0.5]),
        )
        .unwrap();
        path.command(
            Dual::constant(2.717),
            wrench([-8.0, 0.0, 2.0, 0.0, -0.4, 0.5]),
        )
        .unwrap();
        let dual = path.state_at(Dual::constant(6.003)).unwrap().vehicle;
        type Nudge = fn(&mut Hydrodynamics<f64>) -> &mut f64;
        let nudges: [Nudge; 3] = [
            |h| &mut h.added[0],
            |h| &mut h.linear[4],
            |h| &mut h.quadratic[5],
        ];
        for (n, nudge) in nudges.into_iter().enumerate() {
            let at = |by: f64| -> VehicleState {
                let mut h = Hydrodynamics::new(&vehicle);
                *nudge(&mut h) += by;
                end(h)
            };
            let (up, down) = (at(1e-3), at(-1e-3));
            for c in 0..6 {
                let numeric = (up.eta[c] - down.eta[c]) / 2e-3;
                assert!(
                    (dual.eta[c].slope[n] - numeric).abs() < 1e-8 + 1e-5 * numeric.abs(),
                    "eta {c} by {n}"
                );
            }
        }
    }
}
