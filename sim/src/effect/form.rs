//! Pieces of which a written force is a sum: a shape of one covariate c, of its size |c|, or of its size with its sign.
//!
//! Each has at most three numbers: a force, a place (of a power its exponent, of a wave its phase) and a width (of a power
//! and of a straight line the covariate at which the force is reached), so that a force is a force in all of them.

use super::coulomb_friction::SLIP_MPS;
use crate::real::Real;

/// Names of all forms, as rig files write them.
pub const FORMS: &[&str] = &[
    "constant",
    "odd_constant",
    "even_power",
    "odd_power",
    "beyond",
    "below",
    "even_beyond",
    "odd_beyond",
    "wave",
    "bump",
    "even_bump",
    "odd_bump",
    "step",
    "even_step",
    "odd_step",
    "odd_saturation",
    "decay",
    "even_decay",
    "odd_decay",
    "none",
];

/// Numbers of a piece: force, place, width.
pub const NUMBERS: usize = 3;
/// Of a power its least argument over the width: below one the slope has no bound at 0.
const NEAR: f64 = 1e-3;

/// Parity of a form in its covariate c.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Parity {
    /// Function of c.
    Plain,
    /// Function of |c|.
    Even,
    /// Function of |c|, with the sign of c.
    Odd,
}

/// Function of the argument s, with force a, place b and width w.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Shape {
    /// Constant a.
    Constant,
    /// a (s / w)^b.
    Power,
    /// a max(0, s - b) / w.
    Beyond,
    /// a max(0, b - s) / w.
    Below,
    /// a sin(2 pi s / w + b).
    Wave,
    /// a exp(-((s - b) / w)^2 / 2).
    Bump,
    /// a (1 + tanh((s - b) / w)) / 2.
    Step,
    /// a tanh((s - b) / w).
    Saturation,
    /// a exp(-(s - b) / w).
    Decay,
    /// Zero everywhere.
    None,
}

/// A form by its place among [`FORMS`]; nothing for one that is not there.
pub fn form(place: usize) -> (Parity, Shape) {
    let name = FORMS.get(place).copied().unwrap_or("none");
    let (parity, shape) = match name.split_once('_') {
        Some(("even", shape)) => (Parity::Even, shape),
        Some(("odd", shape)) => (Parity::Odd, shape),
        _ => (Parity::Plain, name),
    };
    let shape = match shape {
        "constant" => Shape::Constant,
        "power" => Shape::Power,
        "beyond" => Shape::Beyond,
        "below" => Shape::Below,
        "wave" => Shape::Wave,
        "bump" => Shape::Bump,
        "step" => Shape::Step,
        "saturation" => Shape::Saturation,
        "decay" => Shape::Decay,
        _ => Shape::None,
    };
    (parity, shape)
}

/// Sign of a covariate: that of a rate goes over through rest as dry friction does.
pub fn sign<T: Real>(c: T, of_a_rate: bool) -> T {
    if of_a_rate {
        (c * (1.0 / SLIP_MPS)).tanh()
    } else {
        c.where_negative(T::from_f64(-1.0), T::one())
    }
}

/// A piece's force; `form` = its place among [`FORMS`].
pub fn piece<T: Real>(place: usize, [a, b, w]: [T; NUMBERS], c: T, of_a_rate: bool) -> T {
    let (parity, shape) = form(place);
    let s = if parity == Parity::Plain { c } else { c.abs() };
    let value = match shape {
        Shape::None => return T::zero(),
        Shape::Constant => a,
        Shape::Power => a * (b * (s / w).max(T::from_f64(NEAR)).ln()).exp(),
        Shape::Beyond => a * (s - b).max(T::zero()) / w,
        Shape::Below => a * (b - s).max(T::zero()) / w,
        Shape::Wave => a * (s * std::f64::consts::TAU / w + b).sin(),
        Shape::Bump => {
            let z = (s - b) / w;
            a * (z * z * -0.5).exp()
        }
        Shape::Step => a * (T::one() + ((s - b) / w).tanh()) * 0.5,
        Shape::Saturation => a * ((s - b) / w).tanh(),
        Shape::Decay => a * (-((s - b) / w)).exp(),
    };
    if parity == Parity::Odd {
        value * sign(c, of_a_rate)
    } else {
        value
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Dual;
    use proptest::prelude::*;

    #[test]
    fn every_name_is_a_form() {
        let none = FORMS.iter().position(|f| *f == "none").unwrap();
        for (k, name) in FORMS.iter().enumerate() {
            assert_eq!(form(k).1 == Shape::None, k == none, "{name}");
        }
        assert_eq!(form(99).1, Shape::None);
    }

    #[test]
    fn a_force_is_reached_where_the_form_says() {
        let at = |name: &str, numbers: [f64; 3], c: f64| {
            piece(
                FORMS.iter().position(|f| *f == name).unwrap(),
                numbers,
                c,
                false,
            )
        };
        assert!((at("odd_power", [-2.0, 1.7, 0.3], 0.3) + 2.0).abs() < 1e-12);
        assert!((at("odd_power", [-2.0, 1.7, 0.3], -0.3) - 2.0).abs() < 1e-12);
        assert!((at("even_power", [-2.0, 2.0, 0.3], -0.6) + 8.0).abs() < 1e-12);
        assert_eq!(at("odd_beyond", [2.0, 0.1, 0.2], 0.05), 0.0);
        assert!((at("odd_beyond", [2.0, 0.1, 0.2], -0.3) + 2.0).abs() < 1e-12);
        assert!((at("below", [2.0, 0.1, 0.2], -0.1) - 2.0).abs() < 1e-12);
        assert!((at("bump", [2.0, 0.1, 0.2], 0.1) - 2.0).abs() < 1e-12);
        assert!((at("wave", [2.0, 0.0, 0.4], 0.1) - 2.0).abs() < 1e-12);
        assert!((at("step", [2.0, 0.1, 0.2], 9.0) - 2.0).abs() < 1e-12);
        assert!((at("decay", [2.0, 1.0, 0.2], 1.0) - 2.0).abs() < 1e-12);
    }

    proptest! {
        #[test]
        fn derivatives_are_those_of_central_differences(place in 0..FORMS.len() - 1, c in -0.5..0.5f64, b in 0.2..2.5f64, w in 0.1..0.6f64) {
            // Not on a corner.
            prop_assume!(c.abs() > 0.02 && (c - b).abs() > 1e-3 && (c.abs() - b).abs() > 1e-3);
            let numbers = [1.3, b, w, c];
            let d = |v: [Dual<4>; 4]| piece(place, [v[0], v[1], v[2]], v[3], true);
            let dual = d(std::array::from_fn(|i| Dual::variable(numbers[i], i)));
            for i in 0..4 {
                let at = |by: f64| {
                    let mut v = numbers;
                    v[i] += by;
                    piece(place, [v[0], v[1], v[2]], v[3], true)
                };
                let numeric = (at(1e-6) - at(-1e-6)) / 2e-6;
                let size = 1.0 + numeric.abs() + at(0.0).abs();
                prop_assert!((dual.slope[i] - numeric).abs() < 1e-5 * size, "{} {i}: {} {numeric}", FORMS[place], dual.slope[i]);
            }
        }
    }
}
