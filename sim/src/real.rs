//! The scalar the laws of motion are written in.
//!
//! Laws take `T: Real` so that the same code runs on `f64` (simulation) and on a dual
//! number (exact sensitivities of a trajectory to coefficients, effect parameters and
//! delays). A law may clamp and choose by a sign ([`Real::where_negative`]); it must never branch on derivatives, nor in code of its
//! own on values that move: then it can be written down as a formula too.

use crate::effect::covariate_table::cubic;
use std::fmt::Debug;
use std::ops::{Add, Div, Mul, Neg, Sub};

/// A real number, or a real number with derivatives.
pub trait Real:
    Copy
    + Debug
    + PartialOrd
    + Send
    + Sync
    + 'static
    + Add<Output = Self>
    + Sub<Output = Self>
    + Mul<Output = Self>
    + Div<Output = Self>
    + Neg<Output = Self>
    + Mul<f64, Output = Self>
{
    /// A constant (all derivatives zero).
    fn from_f64(value: f64) -> Self;
    /// The value, without derivatives.
    fn value(self) -> f64;
    /// The value where nothing moves it: what depends on it alone needs no derivatives. `None` = something does, or nobody knows.
    fn constant(self) -> Option<f64> {
        None
    }
    /// sin, argument in radians.
    fn sin(self) -> Self;
    /// cos, argument in radians.
    fn cos(self) -> Self;
    /// Both at once.
    fn sin_cos(self) -> (Self, Self) {
        (self.sin(), self.cos())
    }
    /// e^x.
    fn exp(self) -> Self;
    /// Natural logarithm.
    fn ln(self) -> Self;
    /// Square root.
    fn sqrt(self) -> Self;
    /// Hyperbolic tangent.
    fn tanh(self) -> Self;

    /// Sum of values by plain weights; a weight of 0 asks for no value.
    fn weighted(values: &[Self], weights: &[f64]) -> Self {
        let mut sum = Self::zero();
        for (v, w) in values.iter().zip(weights) {
            if *w != 0.0 {
                sum = sum + *v * *w;
            }
        }
        sum
    }

    /// `negative` where this is below 0, else `otherwise`.
    fn where_negative(self, negative: Self, otherwise: Self) -> Self {
        if self.value() < 0.0 {
            negative
        } else {
            otherwise
        }
    }

    /// The value at `at` of a table at equally spaced points over `range` (see [`cubic`](crate::effect::covariate_table::cubic)).
    fn looked_up(table: &[Self], range: (f64, f64), at: Self) -> Self {
        cubic(table, range, at)
    }

    /// The number 0.
    fn zero() -> Self {
        Self::from_f64(0.0)
    }
    /// The number 1.
    fn one() -> Self {
        Self::from_f64(1.0)
    }
    /// Absolute value; its derivative at 0 is that of +x.
    fn abs(self) -> Self {
        if self.value() < 0.0 { -self } else { self }
    }
    /// The larger of two; on a tie `self`.
    fn max(self, other: Self) -> Self {
        if other.value() > self.value() {
            other
        } else {
            self
        }
    }
    /// The smaller of two; on a tie `self`.
    fn min(self, other: Self) -> Self {
        if other.value() < self.value() {
            other
        } else {
            self
        }
    }
}

impl Real for f64 {
    fn constant(self) -> Option<f64> {
        Some(self)
    }
    fn from_f64(value: f64) -> Self {
        value
    }
    fn value(self) -> f64 {
        self
    }
    fn sin(self) -> Self {
        f64::sin(self)
    }
    fn cos(self) -> Self {
        f64::cos(self)
    }
    fn exp(self) -> Self {
        f64::exp(self)
    }
    fn ln(self) -> Self {
        f64::ln(self)
    }
    fn sqrt(self) -> Self {
        f64::sqrt(self)
    }
    fn tanh(self) -> Self {
        f64::tanh(self)
    }
}

#[cfg(test)]
mod tests;
