//! The same hull at another size, by Froude's law: lengths by the scale, times by its root, masses by its cube.

use super::{Dimension, Units};

/// Change of size.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Scale {
    /// Length of the other hull over that of this one.
    pub factor: f64,
    /// Density of its water over that of this one's.
    pub density_ratio: f64,
}

impl Scale {
    /// A size in the same water.
    pub fn by(factor: f64) -> Self {
        Scale {
            factor,
            density_ratio: 1.0,
        }
    }

    /// Factor by which a number of this dimension is another one at that size.
    pub fn of(self, dimension: Dimension) -> f64 {
        let units = Units {
            mass_kg: self.density_ratio * self.factor.powi(3),
            length_m: self.factor,
            time_s: self.factor.sqrt(),
        };
        units.of(dimension)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Particulars, Prime};
    use hydroline_identify::parameter::Coefficient;
    use hydroline_rigs::Dof;

    /// At the same Froude number, U / sqrt(g L), primed numbers of model and ship are one.
    #[test]
    fn primed_numbers_do_not_change_with_the_size() {
        let scale = Scale {
            factor: 7.5,
            density_ratio: 1025.0 / 1000.0,
        };
        let model = Particulars {
            speed_mps: Some(1.2),
            draught_m: Some(0.2),
            mass_kg: Some(30.0),
            ..Particulars::of_length(1.6)
        };
        let of = |d| scale.of(d);
        let length = |m: f64| m * scale.factor;
        let ship = Particulars {
            length_m: length(1.6),
            speed_mps: Some(1.2 * scale.factor.sqrt()),
            draught_m: Some(length(0.2)),
            mass_kg: Some(30.0 * of(Dimension::MASS)),
            density_kgpm3: 1025.0,
            ..model
        };
        for system in [Prime::I, Prime::II, Prime::Bis] {
            let (small, large) = (system.units(&model).unwrap(), system.units(&ship).unwrap());
            for d in Dof::ALL
                .into_iter()
                .flat_map(Coefficient::of)
                .map(Dimension::of)
            {
                let ratio = large.of(d) / small.of(d);
                assert!((ratio / of(d) - 1.0).abs() < 1e-12, "{system:?} {d:?}");
            }
        }
    }
}
