//! The eighteen coefficients of Table 1: names, units, ranges.

use hydroline_rigs::{Dof, Rig, Vehicle};

/// One of the three coefficients of a DOF.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum Term {
    /// Added mass, X_udot.
    Added,
    /// Linear damping, X_u.
    Linear,
    /// Quadratic damping, X_u|u|.
    Quadratic,
}

impl Term {
    /// All three.
    pub const ALL: [Term; 3] = [Term::Added, Term::Linear, Term::Quadratic];
}

/// One of the eighteen.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct Coefficient {
    /// Degree of freedom.
    pub dof: Dof,
    /// Term of that DOF.
    pub term: Term,
}

const SYMBOLS: [[&str; 3]; 6] = [
    ["X_u̇", "X_u", "X_u|u|"],
    ["Y_v̇", "Y_v", "Y_v|v|"],
    ["Z_ẇ", "Z_w", "Z_w|w|"],
    ["K_ṗ", "K_p", "K_p|p|"],
    ["M_q̇", "M_q", "M_q|q|"],
    ["N_ṙ", "N_r", "N_r|r|"],
];

impl Coefficient {
    /// The three of one DOF (Table 1).
    pub fn of(dof: Dof) -> [Coefficient; 3] {
        Term::ALL.map(|term| Coefficient { dof, term })
    }

    /// Name in files, e.g. `x_udot`.
    pub fn key(self) -> &'static str {
        self.dof.coefficient_names()[self.term as usize]
    }

    /// As the paper writes it.
    pub fn symbol(self) -> &'static str {
        SYMBOLS[self.dof.index()][self.term as usize]
    }

    /// SI unit.
    pub fn unit(self) -> &'static str {
        match (self.dof.index() < 3, self.term) {
            (true, Term::Added) => "kg",
            (true, Term::Linear) => "kg/s",
            (true, Term::Quadratic) => "kg/m",
            (false, Term::Linear) => "kg m2/s",
            (false, _) => "kg m2",
        }
    }

    /// The one with this key.
    pub fn find(key: &str) -> Option<Coefficient> {
        Dof::ALL
            .into_iter()
            .flat_map(Coefficient::of)
            .find(|c| c.key() == key)
    }

    /// The rig's value.
    pub fn of_vehicle(self, vehicle: &Vehicle) -> f64 {
        let c = vehicle.coefficients[self.dof.index()];
        match self.term {
            Term::Added => c.added,
            Term::Linear => c.linear,
            Term::Quadratic => c.quadratic,
        }
    }

    /// Puts a value into a vehicle.
    pub fn put(self, vehicle: &mut Vehicle, value: f64) {
        let c = &mut vehicle.coefficients[self.dof.index()];
        match self.term {
            Term::Added => c.added = value,
            Term::Linear => c.linear = value,
            Term::Quadratic => c.quadratic = value,
        }
    }
}

/// Mass of the paper's vehicle (Table 6) \[kg\].
pub const PAPER_MASS_KG: f64 = 29.777;
/// Widths of Table 9's ranges of X_udot, X_u, X_u|u| per kilogram of the paper's vehicle.
const TABLE9_PER_KG: [f64; 3] = [
    500.0 / PAPER_MASS_KG,
    100.0 / PAPER_MASS_KG,
    500.0 / PAPER_MASS_KG,
];

impl Coefficient {
    /// How far the truth may be from what the rig says, as a standard deviation: what an identification left in
    /// the rig's `[identified]` of this very number; else as far as the number is large; where it is 0 the rig
    /// claims to know nothing, and the truth lies anywhere in Table 9's range for a vehicle of this mass
    /// (inertia): a uniform distribution over 0 .. -R is R / sqrt 3 about 0. The spread of published sets makes a number
    /// less sure, never surer: two sets may agree by chance.
    pub fn prior_sd(self, rig: &Rig) -> f64 {
        let is_measured = rig.identified.as_ref().is_some_and(|k| k.is_measured());
        match self.identified_sd(rig) {
            Some(sd) if is_measured => sd,
            Some(spread) => spread.max(self.size(rig)),
            None => self.size(rig),
        }
    }

    /// Size that the rig gives it: its number's, and where that is 0 Table 9's for a vehicle of this mass.
    pub fn size(self, rig: &Rig) -> f64 {
        let said = self.of_vehicle(&rig.vehicle).abs();
        if said > 0.0 {
            return said;
        }
        table9(self, &rig.vehicle) / 3f64.sqrt()
    }

    /// The sd that the rig's `[identified]` holds of its own value.
    pub fn identified_sd(self, rig: &Rig) -> Option<f64> {
        let known = rig.identified.as_ref()?;
        let i = known.coefficients.iter().position(|k| k == self.key())?;
        let (value, sd) = (known.values.get(i)?, known.sd.get(i)?);
        (*value == self.of_vehicle(&rig.vehicle) && *sd > 0.0).then_some(*sd)
    }
}

/// Width of Table 9's range for a vehicle of this mass (inertia).
fn table9(coefficient: Coefficient, vehicle: &Vehicle) -> f64 {
    rigid(coefficient.dof, vehicle) * TABLE9_PER_KG[coefficient.term as usize]
}

/// Mass or moment of inertia.
fn rigid(dof: Dof, vehicle: &Vehicle) -> f64 {
    match dof.index() {
        0..3 => vehicle.mass_kg,
        i => vehicle.inertia_kgm2[i - 3],
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use hydroline_rigs::Rig;

    #[test]
    fn a_zero_in_the_rig_gets_table_9_for_its_mass_and_an_identified_number_its_own_sd() {
        let mut rig = Rig::builtin("lshpi").unwrap();
        rig.vehicle.mass_kg = PAPER_MASS_KG;
        for (c, width) in Coefficient::of(Dof::Surge)
            .into_iter()
            .zip([500.0, 100.0, 500.0])
        {
            let said = c.of_vehicle(&rig.vehicle);
            assert_eq!(c.prior_sd(&rig), said.abs());
            rig.identified = Some(hydroline_rigs::Identified {
                coefficients: vec![c.key().to_owned()],
                values: vec![said],
                sd: vec![0.25],
                covariance: vec![vec![0.0625]],
                source: None,
            });
            assert_eq!(c.prior_sd(&rig), 0.25);
            // A spread of published sets is no measurement of this vehicle: it makes nothing surer.
            let published = rig.identified.as_mut().unwrap();
            published.source = Some("two published sets".to_owned());
            assert_eq!(c.prior_sd(&rig), said.abs());
            assert_eq!(c.identified_sd(&rig), Some(0.25));
            // The sd is that of another number now.
            c.put(&mut rig.vehicle, 0.0);
            assert!((c.prior_sd(&rig) - width / 3f64.sqrt()).abs() < 1e-9);
        }
    }

    #[test]
    fn all_eighteen_have_their_own_key_and_place() {
        let mut vehicle = Rig::builtin("lshpi").unwrap().vehicle;
        let all: Vec<Coefficient> = Dof::ALL.into_iter().flat_map(Coefficient::of).collect();
        assert_eq!(all.len(), 18);
        for (i, c) in all.iter().enumerate() {
            assert_eq!(Coefficient::find(c.key()), Some(*c));
            c.put(&mut vehicle, -(i as f64));
        }
        for (i, c) in all.iter().enumerate() {
            assert_eq!(c.of_vehicle(&vehicle), -(i as f64));
        }
    }
}
