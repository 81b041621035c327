//! Columns that are not mapped, and why.

/// Names that are listed for one reason.
const NAMES_LISTED: usize = 8;

/// Reason why a column is not mapped.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) enum Why {
    /// Its unit is not of the quantity that its name may mean; empty = no unit.
    Unit(String),
    Wished,
    /// Angles about x, y and z.
    Angle,
    /// North and east without a heading.
    NoHeading,
    Mapped(&'static str),
    Name,
}

/// Columns by reason, in the order of the file.
#[derive(Debug, Clone, Default)]
pub(super) struct Left(Vec<(Why, Vec<String>)>);

impl Left {
    pub fn add(&mut self, why: Why, column: String) {
        match self.0.iter_mut().find(|l| l.0 == why) {
            Some(l) => l.1.push(column),
            None => self.0.push((why, vec![column])),
        }
    }

    /// One line for each reason.
    pub fn words(&self) -> impl Iterator<Item = String> + '_ {
        self.0.iter().map(|(why, columns)| {
            let mut names = columns[..columns.len().min(NAMES_LISTED)].join(", ");
            if columns.len() > NAMES_LISTED {
                names += &format!(" and {} more", columns.len() - NAMES_LISTED);
            }
            let one = columns.len() == 1;
            match why {
                Why::Unit(unit) if unit.is_empty() => format!(
                    "{names}: a load without a unit of force: not mapped; scale = newtons (newton metres) per unit makes a [[command]] of it"
                ),
                Why::Unit(unit) => format!(
                    "{names}: '{unit}' is no unit of what that name can mean here: not mapped"
                ),
                Why::Wished => {
                    format!("{names}: by the name what was wished for, not what was: not mapped")
                }
                Why::Angle => format!(
                    "{names}: angles about x, y and z, which are phi_rad, theta_rad and psi_rad only if they turn about z, then y, then x: not mapped"
                ),
                Why::NoHeading => format!(
                    "{names}: velocities to the north and east need a heading to become those of the body: not mapped"
                ),
                Why::Mapped(channel) => format!("{names}: {channel} is mapped already"),
                Why::Name if one => {
                    format!("{names}: its name says nothing that is known here")
                }
                Why::Name => format!("{names}: their names say nothing that is known here"),
            }
        })
    }
}
