//! Units of the guessed channels.

use super::super::meaning::written::unit_text;
use super::super::shape::Shape;
use super::super::stats::Stats;
use super::super::time::Time;
use super::{Channel, Motion};
use crate::map::dimension;
use crate::unit::{self, Dimension};

impl Motion {
    /// Units as they are written, or as the kind has them, or by the size of the numbers.
    pub(super) fn infer_units(&mut self, shape: &Shape, stats: &Stats, time: &Time) {
        // Of this dimension, or it would be another channel or none.
        let written = |c: &Channel| {
            unit_text(&shape.columns[c.column]).and_then(|u| unit::find(dimension(c.place), u))
        };
        let column = |c: &Channel| &stats.columns[c.column];
        // Angles of one file are in one unit: the largest tells.
        let open = |c: &&Channel, d: Dimension| written(c).is_none() && dimension(c.place) == d;
        let largest = |d: Dimension| {
            let all = self.channels.iter().filter(|c| open(c, d));
            all.map(|c| column(c).largest()).fold(0.0, f64::max)
        };
        let (angles, rates) = (largest(Dimension::Angle), largest(Dimension::Rate));
        let lengths = self.channels.iter().filter(|c| open(c, Dimension::Length));
        let fastest = lengths
            .map(|c| column(c).usual / time.interval_s.max(1e-9))
            .fold(0.0, f64::max);
        let length_is_mm = fastest > 15.0;
        // Roll and pitch tell; a heading may go on over several turns.
        let tilt = self
            .channels
            .iter()
            .filter(|c| open(c, Dimension::Angle) && c.place != 5);
        let tilt = tilt.map(|c| column(c).largest()).fold(0.0, f64::max);
        self.angle_open =
            shape.units.angle.is_none() && tilt < 1.9 && (6.3..60.0).contains(&angles);
        for c in &mut self.channels {
            let dimension = dimension(c.place);
            if let Some(u) = written(c) {
                u.name.clone_into(&mut c.unit);
                continue;
            }
            let known = match dimension {
                Dimension::Length => shape.units.length,
                Dimension::Angle => shape.units.angle,
                Dimension::Speed => shape.units.length.and_then(|u| match u {
                    "m" => Some("m/s"),
                    "mm" => Some("mm/s"),
                    "cm" => Some("cm/s"),
                    _ => None,
                }),
                _ => shape
                    .units
                    .angle
                    .map(|u| if u == "deg" { "deg/s" } else { "rad/s" }),
            };
            let (unit, because) = match (known, dimension) {
                (Some(u), _) => (u, format!("as {} has it", shape.kind)),
                (None, Dimension::Length) if length_is_mm => {
                    ("mm", format!("{fastest:.0} m/s if it were m"))
                }
                (None, Dimension::Length) => (
                    "m",
                    format!("{:.3} .. {:.3}", column(c).low, column(c).high),
                ),
                (None, Dimension::Angle) if angles > 6.3 => {
                    ("deg", format!("the angles reach {angles:.1}"))
                }
                (None, Dimension::Angle) => (
                    "rad",
                    format!("no angle is beyond {angles:.3}; deg if the vehicle hardly rotated"),
                ),
                (None, Dimension::Speed) => (
                    "m/s",
                    format!("{:.3} .. {:.3}", column(c).low, column(c).high),
                ),
                // Rates go with the angles where those tell.
                (None, _) if rates > 12.0 || angles > 6.3 => (
                    "deg/s",
                    format!("the rates reach {rates:.1}, the angles {angles:.1}"),
                ),
                (None, _) => ("rad/s", format!("the rates reach {rates:.3}")),
            };
            unit.clone_into(&mut c.unit);
            if !(shape.units.stated && dimension == Dimension::Length) {
                c.questions.push(format!(
                    "the unit is not written: {unit} assumed ({because})"
                ));
            }
        }
    }
}
