//! Unnamed forces, drawn by composition: shapes of a place or of the speed, sums of them, products with the speed.
//!
//! Some are what a diagnosis may write down in closed form, some are not: it must not know which, nor how they are drawn.

use rand::{RngExt, rngs::StdRng};

use super::external_law::Here;

/// A shape of s; s = x, or |u| with the sign of u against the motion.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, schemars::JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Shape {
    /// (s / w)^n.
    Power {
        /// Exponent n.
        exponent: f64,
        /// Scale w.
        at: f64,
    },
    /// max(0, s - b) / w.
    Beyond {
        /// Start b.
        from: f64,
        /// Scale w.
        at: f64,
    },
    /// sin(2 pi s / w + phase).
    Wave {
        /// Wavelength w.
        length: f64,
        /// Phase \[rad\].
        phase_rad: f64,
    },
    /// exp(-((s - b) / w)^2 / 2).
    Bump {
        /// Centre b.
        centre: f64,
        /// Width w.
        width: f64,
    },
    /// (1 + tanh((s - b) / w)) / 2.
    Step {
        /// Centre b.
        centre: f64,
        /// Width w.
        width: f64,
    },
    /// 1 / (1 + ((s - b) / w)^2): broader at its foot than any bump.
    Lorentz {
        /// Centre b.
        centre: f64,
        /// Width w: half of it at half height.
        width: f64,
    },
    /// Two waves of lengths that do not meet, their phases with them: no short expression.
    Irregular {
        /// Length of the first.
        length: f64,
        /// Phase \[rad\].
        phase_rad: f64,
    },
    /// Zero everywhere.
    Nothing,
}

/// A force drawn by composition.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, schemars::JsonSchema)]
pub struct Composed {
    /// Along the speed; else along x.
    pub of_speed: bool,
    /// Shapes with their forces \[N\].
    pub parts: [(f64, Shape); 2],
    /// Times |u| over this \[m/s\]; 0 = not.
    pub times_speed: f64,
}

impl Composed {
    /// Draws one; `reach_m` = range of x in the runs.
    pub fn draw(f_n: f64, reach_m: (f64, f64), rng: &mut StdRng) -> Composed {
        let mut between = |low: f64, high: f64| low + (high - low) * rng.random::<f64>();
        let of_speed = between(0.0, 1.0) < 0.4;
        let span = reach_m.1 - reach_m.0;
        let mut one = || {
            let kind = between(0.0, if of_speed { 6.0 } else { 5.5 }) as usize;
            let (centre, width) = match of_speed {
                true => (between(0.05, 0.11), between(0.01, 0.03)),
                false => (reach_m.0 + span * between(0.2, 0.8), between(0.05, 0.15)),
            };
            match kind {
                0 => Shape::Bump { centre, width },
                1 => Shape::Step {
                    centre,
                    width: 0.5 * width,
                },
                2 => Shape::Beyond {
                    from: centre,
                    at: 5.0 * width,
                },
                3 if !of_speed => Shape::Wave {
                    length: between(0.25, 0.7),
                    phase_rad: between(-3.1, 3.1),
                },
                4 => Shape::Lorentz { centre, width },
                5 if !of_speed => Shape::Irregular {
                    length: between(0.3, 0.5),
                    phase_rad: between(-3.1, 3.1),
                },
                _ if of_speed => Shape::Power {
                    exponent: between(0.3, 4.0),
                    at: 0.12,
                },
                _ => Shape::Bump { centre, width },
            }
        };
        let (first, second) = (one(), one());
        let sum = between(0.0, 1.0) < 0.25;
        let times_speed = if !of_speed && between(0.0, 1.0) < 0.2 {
            0.1
        } else {
            0.0
        };
        // Against the motion where it depends on it: water gives nothing.
        let f_n = if of_speed { -f_n.abs() } else { f_n };
        Composed {
            of_speed,
            parts: [
                (f_n, first),
                match sum {
                    true => (0.6 * f_n, second),
                    false => (0.0, Shape::Nothing),
                },
            ],
            times_speed,
        }
    }

    /// Force \[N\].
    pub fn force(&self, here: &Here) -> f64 {
        let s = if self.of_speed {
            here.u_mps.abs()
        } else {
            here.x_m
        };
        let of = |shape: Shape| match shape {
            Shape::Power { exponent, at } => (s / at).powf(exponent),
            Shape::Beyond { from, at } => (s - from).max(0.0) / at,
            Shape::Wave { length, phase_rad } => {
                (std::f64::consts::TAU * s / length + phase_rad).sin()
            }
            Shape::Bump { centre, width } => (-0.5 * ((s - centre) / width).powi(2)).exp(),
            Shape::Step { centre, width } => 0.5 * (1.0 + ((s - centre) / width).tanh()),
            Shape::Lorentz { centre, width } => 1.0 / (1.0 + ((s - centre) / width).powi(2)),
            Shape::Irregular { length, phase_rad } => {
                let turn = std::f64::consts::TAU * s / length;
                0.6 * (turn + phase_rad).sin()
                    + 0.4 * (1.618 * turn - 2.0 * phase_rad).sin()
                    + 0.3 * (2.414 * turn + 3.0 * phase_rad).sin()
            }
            Shape::Nothing => 0.0,
        };
        let sum: f64 = self.parts.iter().map(|(f_n, shape)| f_n * of(*shape)).sum();
        // As dry friction comes to rest.
        let sign = if self.of_speed {
            (here.u_mps / 0.004).tanh()
        } else {
            1.0
        };
        match self.times_speed {
            0.0 => sum * sign,
            over => sum * sign * here.u_mps.abs() / over,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::SeedableRng;

    #[test]
    fn what_depends_on_the_speed_never_drives() {
        let mut rng = StdRng::seed_from_u64(3);
        let mut kinds = [0; 2];
        for _ in 0..200 {
            let law = Composed::draw(1.0, (-0.3, 1.2), &mut rng);
            kinds[usize::from(law.of_speed)] += 1;
            for k in -20..20 {
                let u_mps = 0.01 * f64::from(k);
                let here = Here {
                    t_s: 0.0,
                    x_m: 0.3,
                    u_mps,
                    drag: [0.0; 2],
                    run: 0,
                    load_n: 0.0,
                };
                let force = law.force(&here);
                assert!(force.is_finite());
                assert!(!law.of_speed || force * u_mps <= 0.0, "{law:?}");
            }
        }
        assert!(kinds.iter().all(|k| *k > 40), "{kinds:?}");
    }
}
