//! Meaning of a column by its name and by the unit that is written beside it.
//!
//! A name may mean several things: x is a place, a speed or a load. The written unit's dimension decides between them;
//! where nothing that the name can mean has that dimension, the column is no channel.

use super::words::{Words, split};
use super::{Meaning, WISHED, listed, meaning};
use crate::guess::shape::Named;
use crate::map::{COMPANIONS, dimension};
use crate::unit::{self, Dimension};

use Meaning::{
    Along, Angle, Channel, Companion, Depth, Ground, Height, Load, Quaternion, Thruster, Velocity,
};

/// Unit texts that mean no unit.
const NO_UNIT: [&str; 4] = ["", "-", "[]", "1"];
/// A column's meaning.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(in crate::guess) enum Column {
    Is(Meaning),
    /// The written unit is not of the quantity that the name says.
    OtherUnit,
    /// A wished-for value beside the measured one.
    Wished,
}

impl Column {
    pub fn is(self) -> Option<Meaning> {
        match self {
            Column::Is(m) => Some(m),
            Column::OtherUnit | Column::Wished => None,
        }
    }
}

/// The unit that a column is written in, in its own cell, in brackets or as the end of its name.
pub(in crate::guess) fn unit_text(named: &Named) -> Option<&str> {
    let own = named.unit.as_deref().or(Words::of(&named.name).unit);
    own.filter(|u| !NO_UNIT.contains(u))
}

pub(in crate::guess) fn column(named: &Named) -> Column {
    let by_name = meaning(&named.name, &named.group);
    let Some(unit) = unit_text(named) else {
        // A share or a count is no newton.
        let bare = named.unit.is_some() && matches!(by_name, Load(_));
        return if bare {
            Column::OtherUnit
        } else {
            wished(by_name, named)
        };
    };
    let own = Words::of(&named.name).words;
    let fits = |d: &Dimension| unit::find(*d, unit).is_some();
    let found = DIMENSIONS
        .iter()
        .filter(|d| fits(d))
        .find_map(|d| of_dimension(by_name, *d, &own));
    match found {
        Some(m) => wished(m, named),
        None if is_measured(by_name) => Column::OtherUnit,
        None => Column::Is(by_name),
    }
}

/// Dimensions that a channel or a load may have, in the order in which they are tried.
const DIMENSIONS: [Dimension; 7] = [
    Dimension::Length,
    Dimension::Angle,
    Dimension::Speed,
    Dimension::Rate,
    Dimension::Force,
    Dimension::Moment,
    Dimension::Pulse,
];

/// Whether a meaning is a value in a unit at all.
fn is_measured(m: Meaning) -> bool {
    matches!(
        m,
        Channel(_)
            | Velocity(_)
            | Ground(_)
            | Along(_)
            | Depth
            | Height
            | Quaternion(_)
            | Load(_)
            | Companion(_)
    )
}

/// Meaning of the name in a unit of that dimension.
fn of_dimension(by_name: Meaning, d: Dimension, own: &[String]) -> Option<Meaning> {
    let last = own.last().map_or("", String::as_str);
    let along_axis = matches!(last, "x" | "y" | "z" | "tx" | "ty" | "tz");
    let along_ground = matches!(last, "north" | "east" | "down" | "n" | "e" | "d");
    match (by_name, d) {
        (Channel(p), _) if dimension(p) == d => Some(by_name),
        (Velocity(_) | Ground(_), Dimension::Speed) => Some(by_name),
        (Channel(p @ 0..3), Dimension::Speed) if along_axis => Some(Velocity(6 + p)),
        (Channel(p @ 0..3), Dimension::Speed) if along_ground => Some(Ground(6 + p)),
        (Channel(p @ 0..6), Dimension::Speed | Dimension::Rate) if dimension(6 + p) == d => {
            Some(Channel(6 + p))
        }
        (Channel(p @ 0..3), Dimension::Rate) if along_axis => Some(Channel(9 + p)),
        (Channel(p @ 0..3) | Quaternion(p @ 1..4), Dimension::Angle) if along_axis => {
            Some(Angle(p % 3))
        }
        (Channel(p @ 0..3), Dimension::Force) if !along_ground => Some(Load(p)),
        (Channel(p @ 0..3), Dimension::Moment) if along_axis => Some(Load(3 + p)),
        (Channel(p @ 3..6), Dimension::Moment) => Some(Load(p)),
        (Along(_), Dimension::Length) => Some(Along(0)),
        (Along(_), Dimension::Speed) => Some(Along(6)),
        (Depth | Height, Dimension::Length) => Some(by_name),
        (Load(dof @ 0..3), Dimension::Force) | (Load(dof @ 3..6), Dimension::Moment) => {
            Some(Load(dof))
        }
        (Load(dof @ 0..3), Dimension::Moment) if along_axis => Some(Load(3 + dof)),
        (Load(_), Dimension::Pulse) => Some(Thruster),
        (Companion(name), _) => {
            let at = COMPANIONS.iter().position(|n| *n == name)?;
            (dimension(12 + at) == d).then_some(by_name)
        }
        _ => None,
    }
}

/// A wished-for value is none of the motion; a wished-for load is the command.
fn wished(m: Meaning, named: &Named) -> Column {
    let words = split(&named.name);
    let above = split(&named.group);
    let is_wish = words.iter().chain(&above).any(|w| {
        let bare = w.trim_end_matches(|c: char| c.is_ascii_digit());
        listed(WISHED, bare)
    });
    if is_wish && is_measured(m) && !matches!(m, Load(_)) {
        Column::Wished
    } else {
        Column::Is(m)
    }
}

#[cfg(test)]
mod tests {
    use super::super::super::shape;
    use super::*;

    #[test]
    fn the_written_unit_decides_what_a_name_means() {
        for (name, expected) in [
            ("x (m)", Column::Is(Channel(0))),
            ("X (m/s)", Column::Is(Velocity(6))),
            ("V_North [m/s]", Column::Is(Ground(6))),
            ("East [m/s]", Column::Is(Ground(7))),
            ("x [m/s^2]", Column::OtherUnit),
            ("z [N]", Column::Is(Load(2))),
            ("z [Nm]", Column::Is(Load(5))),
            ("x (deg/s)", Column::Is(Channel(9))),
            ("Roll (deg/s)", Column::Is(Channel(9))),
            ("Roll (deg)", Column::Is(Channel(3))),
            ("Surge [N]", Column::Is(Load(0))),
            ("Surge [m/s]", Column::Is(Channel(6))),
            ("Yaw [Nm]", Column::Is(Load(5))),
            ("yaw [N]", Column::OtherUnit),
            ("Angle X (deg)", Column::Is(Angle(0))),
            ("Rotation Z (deg)", Column::Is(Angle(0))),
            ("F_surge", Column::Is(Load(0))),
            ("F_x", Column::Is(Load(0))),
            ("yaw_cmd [deg]", Column::OtherUnit),
            ("surge_cmd [%]", Column::OtherUnit),
            ("rudder [N]", Column::OtherUnit),
            ("desired_yaw", Column::Wished),
            ("yaw_des [deg]", Column::Wished),
            ("ref_x", Column::Wished),
            ("thrust_ref [N]", Column::Is(Load(0))),
            ("x_ref [N]", Column::Is(Load(0))),
            ("x_mps", Column::Is(Velocity(6))),
            ("vel_n_m_s", Column::Is(Ground(6))),
        ] {
            let found = column(&shape::named(name));
            let same = found == expected
                || matches!(
                    (found, expected),
                    (Column::Is(Angle(_)), Column::Is(Angle(_)))
                );
            assert!(same, "{name}: {found:?}");
        }
    }
}
