//! Coefficients of other programs' files: MSS vessels (.m), Gazebo and UUV models (SDF, URDF, xacro), tables (CSV).

mod sheet;
mod simulator;
mod vessel;

use hydroline_coefficients::{Dimension, Units};
use hydroline_identify::parameter::{Coefficient, Term};
use hydroline_rigs::Dof;

/// A number of a vehicle.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Number {
    /// One of the eighteen.
    Coefficient(Coefficient),
    /// Mass.
    Mass,
    /// Moment of inertia about an axis, 0..3.
    Inertia(usize),
    /// Centre of buoyancy from that of gravity, z down.
    Buoyancy,
}

/// What a file says of a vehicle.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Foreign {
    /// Numbers with their values, as written.
    pub numbers: Vec<(Number, f64)>,
    /// What was not taken, one sentence each.
    pub left: Vec<String>,
}

/// Why nothing can be taken.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[allow(missing_docs)] // Each message names its fields.
pub enum ForeignError {
    #[error(
        "{file}: {reason}; give an MSS vessel (.m), a model with Gazebo's or UUV Simulator's hydrodynamics (.sdf, .urdf, .xacro), or a table coefficient,value[,unit] (.csv)"
    )]
    Unreadable { file: String, reason: String },
    #[error("{file}: no coefficient was found in it; {next}")]
    Nothing { file: String, next: &'static str },
    #[error("{file}: {name} = {value}, but {why}")]
    Sign {
        file: String,
        name: &'static str,
        value: f64,
        why: &'static str,
    },
}

/// Letters of loads, speeds: which belong to one DOF.
const LOADS: &str = "xyzkmn";
const SPEEDS: &str = "uvwpqr";

/// The coefficient of a name as textbooks, MSS and Gazebo write it: `Xudot`, `X_u`, `xUabsU`, `X_u|u|`, `xDotU`, `x_uu`.
///
/// `Err` = a derivative of Eq. 1 of another kind (of a product of two motions, of another load).
pub(crate) fn named(name: &str) -> Option<Result<Coefficient, ()>> {
    let short: String = name
        .to_lowercase()
        .replace("abs", "")
        .chars()
        .filter(|c| c.is_ascii_alphabetic())
        .collect();
    let load = short.chars().next()?;
    let dof = LOADS.find(load)?;
    let rest = &short[1..];
    let (letters, is_added) = match (rest.strip_suffix("dot"), rest.strip_prefix("dot")) {
        (Some(letters), _) | (_, Some(letters)) => (letters, true),
        _ => (rest, false),
    };
    if letters.is_empty() || !letters.chars().all(|c| SPEEDS.contains(c)) {
        return None;
    }
    let own = SPEEDS.chars().nth(dof)?;
    let term = match (letters.len(), is_added) {
        (1, true) => Term::Added,
        (1, false) => Term::Linear,
        (2, false) => Term::Quadratic,
        _ => return Some(Err(())),
    };
    let is_own = letters.chars().all(|c| c == own);
    Some(if is_own {
        Ok(Coefficient {
            dof: Dof::ALL[dof],
            term,
        })
    } else {
        Err(())
    })
}

/// Mass or inertia by a name of such a file.
pub(crate) fn particular(name: &str) -> Option<Number> {
    let short: String = name
        .to_lowercase()
        .chars()
        .filter(char::is_ascii_alphanumeric)
        .collect();
    match short.as_str() {
        "m" | "mass" | "masskg" => Some(Number::Mass),
        "ix" | "ixx" | "ixkgm2" => Some(Number::Inertia(0)),
        "iy" | "iyy" | "iykgm2" => Some(Number::Inertia(1)),
        "iz" | "izz" | "izkgm2" => Some(Number::Inertia(2)),
        "rbzm" => Some(Number::Buoyancy),
        _ => None,
    }
}

/// Reads a file by its ending, and by its contents where that says nothing.
///
/// # Errors
/// [`ForeignError`].
pub fn read(text: &str, file: &str) -> Result<Foreign, ForeignError> {
    let bad = |reason: String| ForeignError::Unreadable {
        file: file.to_owned(),
        reason,
    };
    let ending = file.rsplit('.').next().unwrap_or_default().to_lowercase();
    let is_markup = text.trim_start().starts_with('<');
    let found = match ending.as_str() {
        "m" => vessel::read(text),
        "csv" | "tsv" | "txt" => sheet::read(text).map_err(bad)?,
        "sdf" | "urdf" | "xacro" | "xml" | "world" => simulator::read(text).map_err(bad)?,
        _ if is_markup => simulator::read(text).map_err(bad)?,
        _ => return Err(bad("its ending says no kind of file".to_owned())),
    };
    if !found
        .numbers
        .iter()
        .any(|(n, _)| matches!(n, Number::Coefficient(_)))
    {
        let next = match ending.as_str() {
            "m" => {
                "numbers are read from lines as Xudot = -7.6e-3; those that a program computes are not"
            }
            "csv" | "tsv" | "txt" => {
                "its first column names them, as X_udot, the second has values"
            }
            _ => {
                "it needs Gazebo's hydrodynamics plugin or UUV Simulator's hydrodynamic_model, with numbers (a macro's names have none)"
            }
        };
        return Err(ForeignError::Nothing {
            file: file.to_owned(),
            next,
        });
    }
    Ok(found)
}

impl Foreign {
    /// Adds a number once: the last one holds, as in a program.
    pub(crate) fn add(&mut self, number: Number, value: f64) {
        match self.numbers.iter_mut().find(|(n, _)| *n == number) {
            Some((_, old)) => *old = value,
            None => self.numbers.push((number, value)),
        }
    }

    /// Adds a number by the name that a file gives it; a derivative that has no place in Eq. 1 is left, and said where it is not 0.
    pub(crate) fn take(&mut self, name: &str, value: f64) {
        match named(name) {
            Some(Ok(coefficient)) => self.add(Number::Coefficient(coefficient), value),
            Some(Err(())) if value != 0.0 => self.left.push(format!(
                "{name} = {value}: Eq. 1 has no place for a derivative by another motion"
            )),
            _ => {
                if let Some(number) = particular(name) {
                    self.add(number, value);
                }
            }
        }
    }

    /// The same in SI, of numbers in a prime system.
    #[must_use]
    pub fn dimensional(mut self, units: &Units) -> Foreign {
        for (number, value) in &mut self.numbers {
            let dimension = match number {
                Number::Coefficient(c) => Dimension::of(*c),
                Number::Mass => Dimension::MASS,
                Number::Inertia(_) => Dimension::INERTIA,
                Number::Buoyancy => Dimension {
                    length: 1,
                    ..Dimension::NONE
                },
            };
            *value *= units.of(dimension);
        }
        self
    }

    /// Changes of a rig that put the numbers in, as KEY=VALUE.
    ///
    /// # Errors
    /// [`ForeignError::Sign`] for a number that no rig has.
    pub fn changes(&self, file: &str, inertia: [f64; 3]) -> Result<Vec<String>, ForeignError> {
        let mut inertia = inertia;
        let mut changes = Vec::new();
        let mut turned = false;
        for (number, value) in &self.numbers {
            match number {
                Number::Coefficient(c) => {
                    if *value > 0.0 {
                        return Err(ForeignError::Sign {
                            file: file.to_owned(),
                            name: c.key(),
                            value: *value,
                            why: "SNAME's signs have damping and added mass negative: is the file in another convention (--positive turns all of them)?",
                        });
                    }
                    changes.push(format!("vehicle.{}.{}={value:?}", c.dof.name(), key(*c)));
                }
                Number::Mass if *value > 0.0 => changes.push(format!("vehicle.mass_kg={value:?}")),
                Number::Inertia(k) if *value > 0.0 => {
                    inertia[*k] = *value;
                    turned = true;
                }
                Number::Buoyancy => changes.push(format!("vehicle.r_bz_m={value:?}")),
                Number::Mass | Number::Inertia(_) => {
                    return Err(ForeignError::Sign {
                        file: file.to_owned(),
                        name: "mass or inertia",
                        value: *value,
                        why: "it must be more than 0",
                    });
                }
            }
        }
        if turned {
            changes.push(format!("vehicle.inertia_kgm2={inertia:?}"));
        }
        Ok(changes)
    }

    /// The same with every coefficient's sign turned: of files that write damping and added mass as positive numbers.
    #[must_use]
    pub fn turned(mut self) -> Foreign {
        for (number, value) in &mut self.numbers {
            if matches!(number, Number::Coefficient(_)) {
                *value = -*value + 0.0;
            }
        }
        self
    }
}

/// Key of a coefficient in its table of a rig.
fn key(c: Coefficient) -> &'static str {
    match (c.dof.index() < 3, c.term) {
        (true, Term::Added) => "added_kg",
        (true, Term::Linear) => "linear_kgps",
        (true, Term::Quadratic) => "quadratic_kgpm",
        (false, Term::Added) => "added_kgm2",
        (false, Term::Linear) => "linear_kgm2ps",
        (false, Term::Quadratic) => "quadratic_kgm2",
    }
}

#[cfg(test)]
mod tests;
