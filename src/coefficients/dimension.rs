//! Dimensions of hydrodynamic derivatives.

use hydroline_identify::parameter::{Coefficient, Term};

/// Powers of mass, length and time in which a number is measured; an angle has none.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub struct Dimension {
    /// Power of mass.
    pub mass: i32,
    /// Power of length.
    pub length: i32,
    /// Power of time.
    pub time: i32,
}

/// Load that a derivative makes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Load {
    /// X, Y, Z.
    Force,
    /// K, M, N.
    Moment,
}

/// Motion by which a load is differentiated.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Motion {
    /// u, v, w.
    Velocity,
    /// p, q, r.
    Rate,
    /// Their derivatives in time, of u, v, w.
    Acceleration,
    /// Of p, q, r.
    RateOfRate,
}

impl Dimension {
    /// Of a number without any.
    pub const NONE: Dimension = Dimension {
        mass: 0,
        length: 0,
        time: 0,
    };
    /// Of a mass.
    pub const MASS: Dimension = Dimension {
        mass: 1,
        length: 0,
        time: 0,
    };
    /// Of a moment of inertia.
    pub const INERTIA: Dimension = Dimension {
        mass: 1,
        length: 2,
        time: 0,
    };

    /// Of a derivative of a load by a product of motions: Y_v is by one velocity, N_r|r| by two rates.
    pub fn derivative(load: Load, by: &[Motion]) -> Dimension {
        let force = Dimension {
            mass: 1,
            length: if load == Load::Moment { 2 } else { 1 },
            time: -2,
        };
        by.iter().fold(force, |d, motion| {
            let (length, time) = match motion {
                Motion::Velocity => (1, -1),
                Motion::Rate => (0, -1),
                Motion::Acceleration => (1, -2),
                Motion::RateOfRate => (0, -2),
            };
            Dimension {
                mass: d.mass,
                length: d.length - length,
                time: d.time - time,
            }
        })
    }

    /// Of one of the vehicle's eighteen.
    pub fn of(coefficient: Coefficient) -> Dimension {
        let (load, velocity, acceleration) = if coefficient.dof.index() < 3 {
            (Load::Force, Motion::Velocity, Motion::Acceleration)
        } else {
            (Load::Moment, Motion::Rate, Motion::RateOfRate)
        };
        match coefficient.term {
            Term::Added => Dimension::derivative(load, &[acceleration]),
            Term::Linear => Dimension::derivative(load, &[velocity]),
            Term::Quadratic => Dimension::derivative(load, &[velocity, velocity]),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use hydroline_rigs::Dof;

    /// The unit that the results print, as powers.
    fn by_unit(unit: &str) -> Dimension {
        let (length, time) = match unit {
            "kg" => (0, 0),
            "kg/s" => (0, -1),
            "kg/m" => (-1, 0),
            "kg m2" => (2, 0),
            "kg m2/s" => (2, -1),
            other => panic!("{other}"),
        };
        Dimension {
            mass: 1,
            length,
            time,
        }
    }

    #[test]
    fn the_eighteen_have_the_dimension_of_their_unit() {
        for c in Dof::ALL.into_iter().flat_map(Coefficient::of) {
            assert_eq!(Dimension::of(c), by_unit(c.unit()), "{}", c.key());
        }
    }

    #[test]
    fn derivatives_by_other_motions_have_theirs() {
        use Load::{Force, Moment};
        use Motion::{Acceleration, Rate, RateOfRate, Velocity};
        // Z_qdot [kg m], M_wdot [kg m], N_v [kg m/s], X_vr [kg].
        for (load, by, length, time) in [
            (Force, &[RateOfRate][..], 1, 0),
            (Moment, &[Acceleration], 1, 0),
            (Moment, &[Velocity], 1, -1),
            (Force, &[Velocity, Rate], 0, 0),
        ] {
            let of = Dimension::derivative(load, by);
            assert_eq!((of.mass, of.length, of.time), (1, length, time), "{by:?}");
        }
    }
}
