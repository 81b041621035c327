//! The systems in which coefficients are made nondimensional (SNAME 1950; Norrbin 1970; Fossen 2011, 7.2.5).
//!
//! | system | mass | length | time |
//! |---|---|---|---|
//! | I | rho L^3 / 2 | L | L / U |
//! | II | rho L^2 T / 2 | L | L / U |
//! | bis | m | L | sqrt(L / g) |
//!
//! T = draught. Bis needs no speed: it is that of vehicles which hover. Its mass is mu rho nabla with the ratio of body and
//! water, mu = m / (rho nabla), and so the vehicle's own.

use super::Dimension;

/// Gravitational acceleration where nothing else is given \[m/s2\].
pub const GRAVITY_MPS2: f64 = 9.81;
/// Density of fresh water \[kg/m3\], where nothing else is given.
pub const FRESH_KGPM3: f64 = 1000.0;

/// A system of units.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Prime {
    /// Prime system I: area L^2.
    I,
    /// Prime system II: area L T.
    II,
    /// Bis system: the vehicle's mass, and time by gravity.
    Bis,
}

/// Numbers of a hull that the systems are made of.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Particulars {
    /// Reference length L \[m\].
    pub length_m: f64,
    /// Reference speed U \[m/s\].
    pub speed_mps: Option<f64>,
    /// Density of the water \[kg/m3\].
    pub density_kgpm3: f64,
    /// Draught T; of a body under water its height \[m\].
    pub draught_m: Option<f64>,
    /// Mass of the vehicle \[kg\].
    pub mass_kg: Option<f64>,
    /// Gravitational acceleration \[m/s2\].
    pub gravity_mps2: f64,
}

impl Particulars {
    /// A hull of this length in fresh water, of which nothing else is known.
    pub fn of_length(length_m: f64) -> Self {
        Particulars {
            length_m,
            speed_mps: None,
            density_kgpm3: FRESH_KGPM3,
            draught_m: None,
            mass_kg: None,
            gravity_mps2: GRAVITY_MPS2,
        }
    }
}

/// A number that a system needs and that is missing, or has no sense.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
#[allow(missing_docs)] // Each message names its fields.
pub enum PrimeError {
    #[error("prime system {system} needs {what}: give {flag}")]
    Missing {
        system: &'static str,
        what: &'static str,
        flag: &'static str,
    },
    #[error("{flag} {value}: more than 0 is needed")]
    NotPositive { flag: &'static str, value: f64 },
}

/// Units of mass, length and time.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Units {
    /// Unit of mass \[kg\].
    pub mass_kg: f64,
    /// Unit of length \[m\].
    pub length_m: f64,
    /// Unit of time \[s\].
    pub time_s: f64,
}

impl Units {
    /// One unit of a dimension, SI: a primed number times this is the dimensional one.
    pub fn of(&self, dimension: Dimension) -> f64 {
        self.mass_kg.powi(dimension.mass)
            * self.length_m.powi(dimension.length)
            * self.time_s.powi(dimension.time)
    }
}

impl Prime {
    /// Name in tables and on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Prime::I => "I",
            Prime::II => "II",
            Prime::Bis => "bis",
        }
    }

    /// Mark behind a symbol: one prime, or two of bis.
    pub fn mark(self) -> &'static str {
        match self {
            Prime::I | Prime::II => "'",
            Prime::Bis => "''",
        }
    }

    /// The system of this name.
    pub fn named(name: &str) -> Option<Prime> {
        [Prime::I, Prime::II, Prime::Bis]
            .into_iter()
            .find(|p| p.name().eq_ignore_ascii_case(name))
    }

    /// Its units for a hull.
    ///
    /// # Errors
    /// [`PrimeError`] where the hull lacks a number that the system is made of.
    pub fn units(self, hull: &Particulars) -> Result<Units, PrimeError> {
        let missing = |what, flag| PrimeError::Missing {
            system: self.name(),
            what,
            flag,
        };
        let length_m = positive("--length", hull.length_m)?;
        let half_density = 0.5 * positive("--rho", hull.density_kgpm3)?;
        let time_s = || {
            let speed = hull
                .speed_mps
                .ok_or(missing("the speed U [m/s]", "--speed"))?;
            Ok(length_m / positive("--speed", speed)?)
        };
        let (mass_kg, time_s) = match self {
            Prime::I => (half_density * length_m.powi(3), time_s()?),
            Prime::II => {
                let draught_m = hull
                    .draught_m
                    .ok_or(missing("the draught T [m]", "--draught"))?;
                let area = length_m * positive("--draught", draught_m)?;
                (half_density * length_m * area, time_s()?)
            }
            Prime::Bis => {
                let mass_kg = hull
                    .mass_kg
                    .ok_or(missing("the vehicle's mass [kg]", "--mass, or --rig"))?;
                let gravity = positive("--gravity", hull.gravity_mps2)?;
                (positive("--mass", mass_kg)?, (length_m / gravity).sqrt())
            }
        };
        Ok(Units {
            mass_kg,
            length_m,
            time_s,
        })
    }
}

fn positive(flag: &'static str, value: f64) -> Result<f64, PrimeError> {
    if value.is_finite() && value > 0.0 {
        Ok(value)
    } else {
        Err(PrimeError::NotPositive { flag, value })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dimension::{Load, Motion};
    use proptest::prelude::*;

    fn hull() -> Particulars {
        Particulars {
            speed_mps: Some(1.5),
            draught_m: Some(0.3),
            mass_kg: Some(40.0),
            density_kgpm3: 1025.0,
            ..Particulars::of_length(2.0)
        }
    }

    /// The rows of Fossen 2011, table 7.2, that its caption gives by hand.
    #[test]
    fn forces_and_moments_have_the_units_of_the_textbook() {
        let force = Dimension::derivative(Load::Force, &[]);
        let moment = Dimension::derivative(Load::Moment, &[]);
        let (l, u, t, rho, m, g) = (2.0f64, 1.5f64, 0.3, 1025.0, 40.0, GRAVITY_MPS2);
        for (system, expected_n, expected_nm) in [
            (
                Prime::I,
                0.5 * rho * u * u * l * l,
                0.5 * rho * u * u * l.powi(3),
            ),
            (
                Prime::II,
                0.5 * rho * u * u * l * t,
                0.5 * rho * u * u * l * l * t,
            ),
            (Prime::Bis, m * g, m * g * l),
        ] {
            let units = system.units(&hull()).unwrap();
            assert!(
                (units.of(force) / expected_n - 1.0).abs() < 1e-14,
                "{system:?}"
            );
            assert!(
                (units.of(moment) / expected_nm - 1.0).abs() < 1e-14,
                "{system:?}"
            );
        }
        let bis = Prime::Bis.units(&hull()).unwrap();
        let velocity = Dimension {
            mass: 0,
            length: 1,
            time: -1,
        };
        assert!((bis.of(velocity) / (l * g).sqrt() - 1.0).abs() < 1e-14);
        let rate = Dimension::derivative(Load::Moment, &[Motion::Rate]);
        assert!((bis.of(rate) / (m * l * l * (g / l).sqrt()) - 1.0).abs() < 1e-14);
    }

    #[test]
    fn a_number_that_is_missing_is_named_with_its_flag() {
        let bare = Particulars::of_length(2.0);
        for (system, flag) in [
            (Prime::I, "--speed"),
            (Prime::II, "--draught"),
            (Prime::Bis, "--mass"),
        ] {
            let words = system.units(&bare).unwrap_err().to_string();
            assert!(
                words.contains(flag) && words.contains(system.name()),
                "{words}"
            );
        }
        let no_draught = Particulars {
            draught_m: None,
            ..hull()
        };
        let words = Prime::II.units(&no_draught).unwrap_err().to_string();
        assert!(words.contains("--draught"), "{words}");
        let words = Prime::I.units(&Particulars::of_length(-1.0)).unwrap_err();
        assert!(words.to_string().contains("--length -1"), "{words}");
    }

    proptest! {
        /// Units of a product are the product of the units.
        #[test]
        fn units_multiply(a in (-2..3i32, -3..4i32, -3..3i32), b in (-2..3i32, -3..4i32, -3..3i32)) {
            let units = Prime::II.units(&hull()).unwrap();
            let of = |(mass, length, time): (i32, i32, i32)| units.of(Dimension { mass, length, time });
            let both = (a.0 + b.0, a.1 + b.1, a.2 + b.2);
            prop_assert!((of(a) * of(b) / of(both) - 1.0).abs() < 1e-12);
        }
    }
}
