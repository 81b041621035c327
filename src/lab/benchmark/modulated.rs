//! Laws of known mechanisms one number of which goes with something that the library keeps it from: place, rate, time or
//! load. Which mechanism, which covariate and which shape are drawn apart from each other.

use rand::{RngExt, rngs::StdRng};

use super::external_law::Here;

/// Mechanisms that can be drawn.
pub const MODULATED: [&str; 6] = [
    "coulomb_friction",
    "current",
    "tether_spring",
    "thruster_deadband",
    "thruster_saturation",
    "thrust_asymmetry",
];

/// Covariate that a number goes with.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, schemars::JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum With {
    /// x \[m\].
    Place,
    /// |u| \[m/s\].
    Rate,
    /// t \[s\].
    Time,
    /// |X| \[N\].
    Load,
}

/// Over a covariate that goes from 0 to 1 within the runs; what it gives lies between -1 and 1.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, schemars::JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Shape {
    /// 2 s - 1.
    Line,
    /// sin(2 pi turns s + phase).
    Wave {
        /// Turns over the range.
        turns: f64,
        /// Phase \[rad\].
        phase_rad: f64,
    },
    /// tanh((s - at) / width).
    Step {
        /// Centre of the step.
        at: f64,
        /// Width of the step.
        width: f64,
    },
    /// 2 exp(-((s - at) / width)^2) - 1.
    Bump {
        /// Centre of the bump.
        at: f64,
        /// Width of the bump.
        width: f64,
    },
}

impl Shape {
    fn at(self, s: f64) -> f64 {
        match self {
            Shape::Line => 2.0 * s - 1.0,
            Shape::Wave { turns, phase_rad } => {
                (std::f64::consts::TAU * turns * s + phase_rad).sin()
            }
            Shape::Step { at, width } => ((s - at) / width).tanh(),
            Shape::Bump { at, width } => 2.0 * (-((s - at) / width).powi(2)).exp() - 1.0,
        }
    }
}

/// Such a law.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, schemars::JsonSchema)]
pub struct Modulated {
    /// Place among [`MODULATED`].
    pub mechanism: usize,
    /// Its number in the middle: f \[N\], v \[m/s\], k \[N/m\], width \[N\], limit \[N\], gain.
    pub number: f64,
    /// Slack of a tether \[m\].
    pub slack_m: f64,
    /// Covariate that the number goes with.
    pub with: With,
    /// That at 0 and 1 of the shape.
    pub range: (f64, f64),
    /// Shape of the dependence.
    pub shape: Shape,
    /// Share of the number.
    pub by: f64,
}

/// Ranges of what a number may go with in the runs of a case.
#[derive(Debug, Clone, Copy)]
pub struct Ranges {
    /// x \[m\].
    pub reach_m: (f64, f64),
    /// Largest load \[N\].
    pub top_n: f64,
    /// Length of a run \[s\].
    pub run_s: f64,
}

/// Largest surge rate of the runs, about \[m/s\].
const RATE_MPS: f64 = 0.15;

impl Modulated {
    /// Draws one of a mechanism, at a share of its practical size.
    pub fn draw(
        mechanism: &str,
        share: f64,
        ranges: &Ranges,
        rng: &mut StdRng,
    ) -> Option<Modulated> {
        let mechanism = MODULATED.iter().position(|m| *m == mechanism)?;
        let mut between = |low: f64, high: f64| low + (high - low) * rng.random::<f64>();
        let signed = |v: f64, turn: f64| if turn < 0.5 { -v } else { v };
        let number = match MODULATED[mechanism] {
            "coulomb_friction" => 0.5 * share,
            "current" => signed(0.02 * share, between(0.0, 1.0)),
            "tether_spring" => 2.0 * share,
            "thruster_deadband" => 1.2 * share,
            "thruster_saturation" => ranges.top_n * (1.05 - 0.5 * share),
            _ => 1.0 - 0.35 * share,
        };
        let with = match between(0.0, 4.0) as usize {
            0 => With::Place,
            1 => With::Rate,
            2 => With::Time,
            _ => With::Load,
        };
        let (at, width) = (between(0.25, 0.75), between(0.1, 0.3));
        let shape = match between(0.0, 4.0) as usize {
            0 => Shape::Line,
            1 => Shape::Wave {
                turns: between(0.6, 1.5),
                phase_rad: between(-3.1, 3.1),
            },
            2 => Shape::Step { at, width },
            _ => Shape::Bump { at, width },
        };
        let by = signed(between(0.25, 0.7), between(0.0, 1.0));
        Some(Modulated {
            mechanism,
            number,
            slack_m: ranges.reach_m.0 + (ranges.reach_m.1 - ranges.reach_m.0) * between(0.1, 0.4),
            with,
            range: match with {
                With::Place => ranges.reach_m,
                With::Rate => (0.0, RATE_MPS),
                With::Time => (0.0, ranges.run_s),
                With::Load => (0.0, ranges.top_n),
            },
            shape,
            by,
        })
    }

    /// The number where the motion is.
    fn number(&self, here: &Here) -> f64 {
        let covariate = match self.with {
            With::Place => here.x_m,
            With::Rate => here.u_mps.abs(),
            With::Time => here.t_s,
            With::Load => here.load_n.abs(),
        };
        let s = ((covariate - self.range.0) / (self.range.1 - self.range.0)).clamp(0.0, 1.0);
        let factor = 1.0 + self.by * self.shape.at(s);
        match MODULATED[self.mechanism] {
            // The loss astern varies, not the thrust.
            "thrust_asymmetry" => 1.0 - (1.0 - self.number) * factor,
            _ => self.number * factor,
        }
    }

    /// Load behind the law \[N\].
    pub fn thrust(&self, load_n: f64, here: &Here) -> f64 {
        let number = self.number(here);
        match MODULATED[self.mechanism] {
            "thruster_deadband" => load_n.signum() * (load_n.abs() - number).max(0.0),
            "thruster_saturation" => load_n.clamp(-number, number),
            "thrust_asymmetry" if load_n < 0.0 => load_n * number,
            _ => load_n,
        }
    }

    /// Force on the hull \[N\].
    pub fn force(&self, here: &Here) -> f64 {
        let number = self.number(here);
        match MODULATED[self.mechanism] {
            "coulomb_friction" => -(here.u_mps / 0.004).tanh() * number,
            "current" => {
                let drag = |u: f64| (here.drag[0] + here.drag[1] * u.abs()) * u;
                drag(here.u_mps - number) - drag(here.u_mps)
            }
            "tether_spring" => -number * (here.x_m - self.slack_m).max(0.0),
            _ => 0.0,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::SeedableRng;

    #[test]
    fn a_number_varies_about_its_middle_and_only_the_mechanism_acts() {
        let mut rng = StdRng::seed_from_u64(5);
        let ranges = Ranges {
            reach_m: (-0.2, 1.0),
            top_n: 16.0,
            run_s: 24.0,
        };
        for mechanism in MODULATED {
            for _ in 0..40 {
                let law = Modulated::draw(mechanism, 0.7, &ranges, &mut rng).unwrap();
                let mut seen = (f64::INFINITY, f64::NEG_INFINITY);
                for k in 0..200 {
                    let share = f64::from(k) / 199.0;
                    let here = Here {
                        t_s: 24.0 * share,
                        x_m: -0.2 + 1.2 * share,
                        u_mps: 0.15 * share,
                        drag: [-20.0, -200.0],
                        run: 0,
                        load_n: 16.0 * share,
                    };
                    let number = law.number(&here);
                    seen = (seen.0.min(number), seen.1.max(number));
                    let thruster = mechanism.starts_with("thrust");
                    assert!(!thruster || law.force(&here) == 0.0, "{law:?}");
                    assert!(thruster || law.thrust(3.0, &here) == 3.0, "{law:?}");
                }
                assert!(seen.1 > seen.0, "{law:?}");
                let widest = 0.7 * law.number.abs().max(1.0 - law.number) + 1e-9;
                assert!(
                    seen.1 - law.number <= widest && law.number - seen.0 <= widest,
                    "{law:?} {seen:?}"
                );
            }
        }
    }
}
