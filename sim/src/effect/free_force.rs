//! `free_force`: a force written down from data, as a table over one covariate.

use super::covariate_table::{COVARIATES, covariate, interpolated};
use super::info::DOF;
use super::{EffectInfo, Law, Moment, ParameterInfo, Stage, Values, WordInfo};
use crate::real::Real;

const fn point(name: &'static str) -> ParameterInfo {
    ParameterInfo::new(
        name,
        "N (N m for a moment)",
        "force at this point of the table",
        (-5.0, 5.0),
        (-1e6, 1e6),
        0.2,
    )
    .or(0.0)
}

const fn end(name: &'static str, typical: f64) -> ParameterInfo {
    ParameterInfo::new(
        name,
        "unit of the covariate",
        "covariate at this end of the table",
        (-10.0, 10.0),
        (-1e6, 1e6),
        typical,
    )
}

/// Numbers before the table's: its ends.
pub const ENDS: usize = 2;

pub(super) const INFO: EffectInfo = EffectInfo {
    id: "free_force",
    law: "+ f(c) in one DOF; c = along (pose, body rate, t, or the DOF's commanded load), f by 40 points from `from` to `to`, cubic between",
    stage: Stage::Hydrodynamics,
    order: 140,
    parameters: &[
        end("from", -1.0),
        end("to", 1.0),
        point("f01_n"),
        point("f02_n"),
        point("f03_n"),
        point("f04_n"),
        point("f05_n"),
        point("f06_n"),
        point("f07_n"),
        point("f08_n"),
        point("f09_n"),
        point("f10_n"),
        point("f11_n"),
        point("f12_n"),
        point("f13_n"),
        point("f14_n"),
        point("f15_n"),
        point("f16_n"),
        point("f17_n"),
        point("f18_n"),
        point("f19_n"),
        point("f20_n"),
        point("f21_n"),
        point("f22_n"),
        point("f23_n"),
        point("f24_n"),
        point("f25_n"),
        point("f26_n"),
        point("f27_n"),
        point("f28_n"),
        point("f29_n"),
        point("f30_n"),
        point("f31_n"),
        point("f32_n"),
        point("f33_n"),
        point("f34_n"),
        point("f35_n"),
        point("f36_n"),
        point("f37_n"),
        point("f38_n"),
        point("f39_n"),
        point("f40_n"),
    ],
    words: &[
        DOF,
        WordInfo {
            name: "along",
            meaning: "quantity over which the table of forces is",
            allowed: COVARIATES,
            absent: Some("x"),
        },
    ],
    confusable: &[],
    source: "theory/physics.md, hydrodynamics: a force that had no name; Catmull and Rom 1974",
};

#[derive(Debug)]
struct Free<T> {
    dof: usize,
    along: usize,
    range: (f64, f64),
    values: Vec<T>,
}

pub(super) fn law<T: Real>(values: &Values<'_, T>) -> impl Law<T> + use<T> {
    Free {
        dof: values.words[0],
        along: values.words[1],
        range: (values.numbers[0].value(), values.numbers[1].value()),
        values: values.numbers[ENDS..].to_vec(),
    }
}

impl<T: Real> Law<T> for Free<T> {
    fn force(&self, m: &Moment<'_, T>, _own: &[T], force: &mut [T; 6]) {
        let at = covariate(m, self.along, self.dof);
        force[self.dof] = force[self.dof] + interpolated(&self.values, self.range, at);
    }
}

#[cfg(test)]
mod tests {
    use crate::effect::testing::*;

    #[test]
    fn it_is_its_table_at_the_covariate() {
        let ends = [("from", -0.5), ("to", 0.5), ("f40_n", 3.0)];
        let along = |word| with_word(entry("free_force", &ends), "along", word);
        let state = State {
            nu: [0.7, 0.0, 0.0, 0.0, 0.0, 0.0],
            ..State::default()
        };
        assert!((extra(&[along("u")], state, [0.0; 6])[0] - 3.0).abs() < 1e-12);
        assert!(extra(&[along("x")], state, [0.0; 6])[0].abs() < 1e-12);
        let load = extra(
            &[along("load")],
            State::default(),
            [0.6, 0.0, 0.0, 0.0, 0.0, 0.0],
        );
        assert!((load[0] - 3.0).abs() < 1e-12, "{load:?}");
    }
}
