//! One prior table: what each kind of term costs before any data, and how large its numbers are taken to be.
//!
//! Every number here has its reason beside it; a verdict must not depend on any of them to within a factor of 1.5.

use hydroline_sim::effect::ParameterInfo;

/// The table.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PriorTable {
    /// Effects that one expects to have been left out of a rig's model in a tank: a couple that show
    /// (theory/priors.md, number of effects).
    pub effects_expected: f64,
    /// Scale of the logarithm of a coefficient over the rig's (Student's t with two degrees of freedom): tables of
    /// similar hulls agree to some 30 %, and now and then not at all.
    pub coefficient_ln: f64,
    /// Scale of a coefficient of which the rig says 0, over what stands for it there (Student's t with two degrees of freedom):
    /// where the rig leaves a term out, there is mostly little of it.
    pub unsaid: f64,
    /// Scale of the velocity at a run's start (Cauchy) \[m/s, rad/s\]: most runs begin at rest, to about a millimetre per
    /// second, and some under way.
    pub start_rate: f64,
    /// sd of the place of a run's start about its first sample \[m, rad\]: the same for every model.
    pub start_place: f64,
    /// Median of what the random force is worth, over the tolerance (half-Cauchy): what a model misses is mostly well
    /// below what matters.
    pub misfit_over_tolerance: f64,
    /// Probability that a model misses nothing in a DOF: no random force. 0 = it always misses something, however little.
    pub exact: f64,
    /// Median and spread (sd of the logarithm) of the correlation time of an instrument's coloured noise \[s\].
    pub colour_s: f64,
    /// See there.
    pub colour_ln: f64,
    /// Probability that a force of no known effect acts somewhere: nearly all of what moves a vehicle in a tank has one. A force
    /// of the angle alone is first of all a restoring moment whose law is not quite the library's.
    pub unnamed: f64,
    /// Median of what such a force is worth, over the tolerance (half-Cauchy): one that is worth a term of its own shows.
    pub unnamed_over_tolerance: f64,
    /// Probability that such a force has a closed form of the grammar: nobody knows.
    pub closed: f64,
    /// Probability that such a form is a sum of two pieces: most are one.
    pub second_piece: f64,
    /// Probability that it is multiplied by a rate, or by the size or the sign of one: a few are.
    pub product: f64,
    /// Probability that the law of an effect is only nearly the library's: a table's laws are idealised, most fit.
    pub inexact: f64,
    /// Median of the share by which such a law's number varies (half-Cauchy).
    pub inexact_share: f64,
}

impl Default for PriorTable {
    fn default() -> Self {
        PriorTable {
            effects_expected: 1.5,
            coefficient_ln: 0.3,
            unsaid: 1.0,
            start_rate: 1e-3,
            start_place: 0.1,
            misfit_over_tolerance: 0.1,
            exact: 0.0,
            colour_s: 0.5,
            colour_ln: 0.7,
            unnamed: 0.03,
            unnamed_over_tolerance: 3.0,
            closed: 0.5,
            second_piece: 0.25,
            product: 0.2,
            inexact: 0.3,
            inexact_share: 0.3,
        }
    }
}

/// Scale of a prior that says nothing: whatever data there are say more.
const FLAT: f64 = 1e6;

impl PriorTable {
    /// The same with priors of the vehicle's numbers and the runs' starts that say nothing: the mode is that of the likelihood.
    #[must_use]
    pub fn flat(self) -> PriorTable {
        PriorTable {
            coefficient_ln: FLAT,
            unsaid: FLAT,
            start_rate: FLAT,
            start_place: FLAT,
            ..self
        }
    }

    /// Whether a coefficient's prior says nothing.
    pub fn is_flat(&self) -> bool {
        self.coefficient_ln >= FLAT
    }

    /// Log prior odds of one effect of a library of `effects`, in one of the `places` where it may act.
    pub fn ln_odds_of_effect(&self, effects: usize, places: usize) -> f64 {
        let p = self.effects_expected / (effects * places).max(1) as f64;
        // A library of one or two effects: as likely as not at most.
        let p = p.min(0.5);
        (p / (1.0 - p)).ln()
    }
}

/// A density of one number, by its logarithm and what a Gauss–Newton step needs of it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Density {
    /// Student's t with `freedom` degrees about `centre`.
    Student {
        /// Centre of the density.
        centre: f64,
        /// Scale of the density: the sd where it is normal.
        scale: f64,
        /// Degrees of freedom; infinite = normal.
        freedom: f64,
    },
    /// Even on a circle of this circumference.
    Circle(f64),
    /// A point of a table: its prior is that of the whole table ([`super::table`]).
    Table,
}

impl Density {
    /// Normal density.
    pub fn normal(centre: f64, sd: f64) -> Density {
        Density::Student {
            centre,
            scale: sd,
            freedom: f64::INFINITY,
        }
    }

    /// Log density.
    pub fn ln(&self, value: f64) -> f64 {
        match *self {
            Density::Circle(length) => -length.ln(),
            Density::Table => 0.0,
            Density::Student {
                centre,
                scale,
                freedom,
            } => {
                let t2 = ((value - centre) / scale).powi(2);
                if freedom.is_infinite() {
                    return -0.5 * t2 - scale.ln() - 0.5 * std::f64::consts::TAU.ln();
                }
                let gamma = statrs::function::gamma::ln_gamma;
                gamma(0.5 * (freedom + 1.0))
                    - gamma(0.5 * freedom)
                    - 0.5 * (freedom * std::f64::consts::PI).ln()
                    - scale.ln()
                    - 0.5 * (freedom + 1.0) * (t2 / freedom).ln_1p()
            }
        }
    }

    /// (slope of the log density, curvature for a Newton step: that of the normal density which majorises it).
    pub fn step(&self, value: f64) -> (f64, f64) {
        match *self {
            Density::Circle(_) | Density::Table => (0.0, 0.0),
            Density::Student {
                centre,
                scale,
                freedom,
            } => {
                let d = (value - centre) / scale;
                let weight = if freedom.is_infinite() {
                    1.0
                } else {
                    (freedom + 1.0) / (freedom + d * d)
                };
                (-weight * d / scale, weight / (scale * scale))
            }
        }
    }
}

/// In which scale a parameter is searched, and its density there.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Scale {
    /// By its logarithm: it has one sign and no natural unit.
    pub logarithmic: bool,
    /// sign of what is inside of the logarithm.
    pub sign: f64,
    /// Density of the scaled number.
    pub density: Density,
    /// Limits of the natural number.
    pub limits: (f64, f64),
}

/// Degrees of freedom of a parameter's prior: the plausible range is where nine in ten lie, and beyond it anything may.
const FREEDOM: f64 = 4.0;
/// Student's t with four degrees: 95 % point over the scale.
const T95: f64 = 2.132;
/// Ratio of the plausible range's ends from which a parameter goes by its logarithm.
const BY_RATIO: f64 = 4.0;

/// sd of a number that is held, over its plausible range: as good as none.
const HELD: f64 = 1e-4;

impl Scale {
    /// Of an effect's parameter.
    pub fn of(p: &ParameterInfo, index: usize) -> Scale {
        let (low, high) = p.plausible;
        if let Some(value) = p.absent.filter(|_| p.held) {
            return Scale {
                logarithmic: false,
                sign: 1.0,
                density: Density::normal(value, HELD * (high - low)),
                limits: (value, value),
            };
        }
        if p.unit == "rad" && p.name.starts_with("phase") {
            return Scale {
                logarithmic: false,
                sign: 1.0,
                density: Density::Circle(std::f64::consts::TAU),
                limits: p.limits,
            };
        }
        let student = |low: f64, high: f64| Density::Student {
            centre: 0.5 * (low + high),
            scale: 0.5 * (high - low) / T95,
            freedom: FREEDOM,
        };
        let sign = if high <= 0.0 { -1.0 } else { 1.0 };
        let (near, far) = if sign > 0.0 {
            (low, high)
        } else {
            (-high, -low)
        };
        if near > 0.0 && far >= BY_RATIO * near {
            return Scale {
                logarithmic: true,
                sign,
                density: student(near.ln(), far.ln()),
                limits: p.limits,
            };
        }
        // A parameter beside the first that a rig file need not give is mostly what it is then.
        let density = match p.absent.filter(|_| index > 0) {
            Some(usual) => Density::Student {
                centre: usual,
                scale: (high - low) / 12f64.sqrt(),
                freedom: FREEDOM,
            },
            None if index == 0 => {
                // The first parameter says how large the effect is: from nothing to the far end.
                let nothing = nothing(p);
                let reach = (high - nothing).abs().max((low - nothing).abs());
                Density::Student {
                    centre: nothing,
                    scale: reach / T95,
                    freedom: FREEDOM,
                }
            }
            None => student(low, high),
        };
        Scale {
            logarithmic: false,
            sign: 1.0,
            density,
            limits: p.limits,
        }
    }

    /// Of a point of a table.
    pub fn of_table() -> Scale {
        Scale {
            logarithmic: false,
            sign: 1.0,
            density: Density::Table,
            limits: (f64::NEG_INFINITY, f64::INFINITY),
        }
    }

    /// Natural number and its derivative by the scaled one.
    pub fn natural(&self, scaled: f64) -> (f64, f64) {
        if self.logarithmic {
            let v = self.sign * scaled.exp();
            (v, v)
        } else {
            (scaled, 1.0)
        }
    }

    /// The scaled number of a natural one.
    pub fn scaled(&self, natural: f64) -> f64 {
        if self.logarithmic {
            (self.sign * natural).max(1e-12).ln()
        } else {
            natural
        }
    }

    /// Scaled limits.
    pub fn bounds(&self) -> (f64, f64) {
        if !self.logarithmic {
            return self.limits;
        }
        let ends = [self.scaled(self.limits.0), self.scaled(self.limits.1)];
        (ends[0].min(ends[1]), ends[0].max(ends[1]))
    }
}

/// Where an effect is not there: 0, or a factor of 1 if that is nearer to the plausible range.
pub fn nothing(p: &ParameterInfo) -> f64 {
    let (low, high) = p.plausible;
    let away = |v: f64| (low - v).max(v - high);
    if p.unit == "1" && away(1.0) < away(0.0) {
        1.0
    } else {
        0.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use hydroline_sim::effect::ALL;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn slopes_are_those_of_the_density(x in -5.0..5.0f64, freedom in 1.0..9.0f64) {
            for density in [
                Density::normal(0.3, 1.2),
                Density::Student { centre: 0.3, scale: 0.7, freedom },
            ] {
                let h = 1e-5;
                let numeric = (density.ln(x + h) - density.ln(x - h)) / (2.0 * h);
                prop_assert!((density.step(x).0 - numeric).abs() < 1e-6);
            }
        }
    }

    /// A number of one sign that goes by its logarithm is never searched on the other side of 0, whatever its limits allow: an
    /// effect of that sign is named by something else. Each one says why that is meant.
    #[test]
    fn where_limits_allow_a_sign_that_the_prior_cannot_reach_that_is_meant() {
        const DRIVES: &str = "the other sign drives instead of resisting: another mechanism";
        const PHASE: &str = "the other sign is the same with the phase moved by half a turn";
        const MEANT: [(&str, &str); 10] = [
            ("battery_sag sag", "a supply does not rise under load"),
            (
                "advance_loss loss_spm",
                "a propeller gains no thrust by speed",
            ),
            (
                "wall_added_mass gain",
                "a wall adds mass (Lamb 1932, art. 137)",
            ),
            ("seiche amp_mps", PHASE),
            ("attitude_disturbance amp_rad", PHASE),
            ("linear_damping coefficient", DRIVES),
            ("quadratic_damping coefficient", DRIVES),
            ("lift_damping c", DRIVES),
            ("coulomb_friction f_n", DRIVES),
            ("fluid_memory gain_nspm", DRIVES),
        ];
        let mut found = Vec::new();
        for info in ALL.iter().filter(|i| !i.is_written()) {
            for (index, p) in info.parameters.iter().enumerate() {
                let scale = Scale::of(p, index);
                let other = if scale.sign > 0.0 {
                    -p.limits.0
                } else {
                    p.limits.1
                };
                if scale.logarithmic && other > 0.0 {
                    found.push(format!("{} {}", info.id, p.name));
                }
            }
        }
        for name in &found {
            assert!(
                MEANT.iter().any(|(meant, _)| meant == name),
                "{name}: its plausible range has one sign, so the other one is never searched, though its limits allow it: let \
                 the range span 0, narrow the limits, or list it here with the reason"
            );
        }
        for (meant, why) in MEANT {
            assert!(found.iter().any(|name| name == meant), "{meant} ({why})");
        }
    }

    #[test]
    fn densities_are_normalised() {
        let d = Density::Student {
            centre: 1.0,
            scale: 0.5,
            freedom: 4.0,
        };
        let sum: f64 = (-200_000..200_000)
            .map(|k| d.ln(f64::from(k) * 1e-3).exp() * 1e-3)
            .sum();
        assert!((sum - 1.0).abs() < 1e-4);
    }
}
