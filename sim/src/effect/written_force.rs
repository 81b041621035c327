//! `written_force`: a force written down from data in closed form, as a sum of two pieces over one covariate.

use super::covariate_table::{COVARIATES, covariate};
use super::form::{FORMS, NUMBERS, piece, sign};
use super::info::DOF;
use super::{EffectInfo, Law, Moment, ParameterInfo, Stage, Values, WordInfo};
use crate::real::Real;

/// Pieces at most.
pub const PIECES: usize = 2;

/// Place of the rate at which a factor is one, behind the pieces' numbers.
pub const TIMES_AT: usize = PIECES * NUMBERS;

/// Factors of the sum: one, a rate or its size over that at which the factor is one, or its sign.
pub const TIMES: &[&str] = &[
    "one", "u", "v", "w", "p", "q", "r", "abs_u", "abs_v", "abs_w", "abs_p", "abs_q", "abs_r",
    "sign_u", "sign_v", "sign_w", "sign_p", "sign_q", "sign_r",
];

const fn force(name: &'static str, typical: f64) -> ParameterInfo {
    ParameterInfo::new(
        name,
        "N (N m for a moment)",
        "force of the piece",
        (-5.0, 5.0),
        (-1e6, 1e6),
        typical,
    )
    .or(0.0)
}

const fn place(name: &'static str) -> ParameterInfo {
    ParameterInfo::new(
        name,
        "unit of the covariate (1 of a power, rad of a wave)",
        "place of the piece; of a power its exponent, of a wave its phase",
        (-10.0, 10.0),
        (-1e6, 1e6),
        0.0,
    )
    .or(0.0)
}

const fn width(name: &'static str) -> ParameterInfo {
    ParameterInfo::new(
        name,
        "unit of the covariate",
        "width of the piece; of a wave its length, of a power the covariate at which the force is reached",
        (0.01, 10.0),
        (1e-6, 1e6),
        1.0,
    )
    .or(1.0)
}

pub(super) const INFO: EffectInfo = EffectInfo {
    id: "written_force",
    law: "+ (f1(c) + f2(c)) times in one DOF; times = 1, a rate or its size over `times_at`, its sign; c = along; s = c, |c| (even) or |c| with the sign of c (odd): a, a (s / w)^b, a max(0, s - b) / w, a sin(2 pi s / w + b), a exp(-((s - b) / w)^2 / 2), a (1 + tanh((s - b) / w)) / 2, a tanh((s - b) / w), a exp(-(s - b) / w)",
    stage: Stage::Hydrodynamics,
    order: 141,
    parameters: &[
        force("first_n", 0.2),
        place("first_at"),
        width("first_width"),
        force("second_n", 0.0),
        place("second_at"),
        width("second_width"),
        ParameterInfo::new(
            "times_at",
            "m/s, rad/s",
            "rate at which the factor is one",
            (0.01, 10.0),
            (1e-6, 1e6),
            1.0,
        )
        .or(1.0),
    ],
    words: &[
        DOF,
        WordInfo {
            name: "along",
            meaning: "quantity that the force is a function of",
            allowed: COVARIATES,
            absent: None,
        },
        WordInfo {
            name: "first",
            meaning: "form of the first piece",
            allowed: FORMS,
            absent: None,
        },
        WordInfo {
            name: "second",
            meaning: "form of the second piece",
            allowed: FORMS,
            absent: Some("none"),
        },
        WordInfo {
            name: "times",
            meaning: "rate by which the force is multiplied",
            allowed: TIMES,
            absent: Some("one"),
        },
    ],
    confusable: &[],
    source: "theory/physics.md, hydrodynamics: a force that had no name, written down",
};

#[derive(Debug)]
struct Written<T> {
    dof: usize,
    along: usize,
    pieces: [(usize, [T; NUMBERS]); PIECES],
    times: (usize, T),
}

pub(super) fn law<T: Real>(values: &Values<'_, T>) -> impl Law<T> + use<T> {
    let (numbers, words) = (values.numbers, values.words);
    Written {
        dof: words[0],
        along: words[1],
        pieces: std::array::from_fn(|k| {
            let at = k * NUMBERS;
            (
                words[2 + k],
                [numbers[at], numbers[at + 1], numbers[at + 2]],
            )
        }),
        times: (words[2 + PIECES], numbers[TIMES_AT]),
    }
}

/// Whether a covariate, by its place, is a rate.
pub fn is_a_rate(along: usize) -> bool {
    (6..12).contains(&along)
}

impl<T: Real> Law<T> for Written<T> {
    fn force(&self, m: &Moment<'_, T>, _own: &[T], force: &mut [T; 6]) {
        let c = covariate(m, self.along, self.dof);
        let each = self.pieces.iter();
        let sum = each.fold(T::zero(), |sum, (form, numbers)| {
            sum + piece(*form, *numbers, c, is_a_rate(self.along))
        });
        let (times, at) = self.times;
        let times = match times.checked_sub(1) {
            None => T::one(),
            Some(k) if k < 6 => m.nu[k] / at,
            Some(k) if k < 12 => m.nu[k - 6].abs() / at,
            Some(k) => sign(m.nu[(k - 12).min(5)], true),
        };
        force[self.dof] = force[self.dof] + sum * times;
    }
}

#[cfg(test)]
mod tests {
    use crate::effect::tests::fixtures::*;
    use crate::effect::{EffectError, check};

    #[test]
    fn it_is_the_sum_of_its_pieces_times_a_rate() {
        let numbers = [
            ("first_n", -2.0),
            ("first_at", 2.0),
            ("first_width", 0.5),
            ("second_n", 0.7),
            ("second_at", 0.1),
            ("second_width", 0.2),
            ("times_at", 0.5),
        ];
        let written = |along: &str, times: &str| {
            let words = [
                ("along", along),
                ("first", "odd_power"),
                ("second", "bump"),
                ("times", times),
            ];
            let made = entry("written_force", &numbers);
            words.iter().fold(made, |e, (n, w)| with_word(e, n, w))
        };
        let state = State {
            nu: [0.25, 0.0, 0.0, 0.0, 0.0, 0.0],
            ..State::default()
        };
        let expected = -0.5 + 0.7 * (-0.5 * (0.15f64 / 0.2).powi(2)).exp();
        let at = |times| extra(&[written("u", times)], state, [0.0; 6])[0];
        assert!((at("one") - expected).abs() < 1e-9, "{}", at("one"));
        assert!((at("u") - 0.5 * expected).abs() < 1e-9);
        assert!((at("abs_u") - 0.5 * expected).abs() < 1e-9);
        assert!((at("sign_u") - expected).abs() < 1e-9);
        assert!(at("sign_r").abs() < 1e-12);
    }

    #[test]
    fn a_form_that_is_none_is_refused_with_those_there_are() {
        let wrong = with_word(entry("written_force", &[("first_n", 1.0)]), "along", "x");
        let said = check(std::slice::from_ref(&wrong)).unwrap_err();
        assert!(matches!(said, EffectError::MissingWord { .. }), "{said}");
        let wrong = with_word(wrong, "first", "hump");
        let said = check(&[wrong]).unwrap_err().to_string();
        assert!(said.contains("odd_bump"), "{said}");
    }
}
