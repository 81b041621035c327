//! The map's columns found in the file, and its units held against those that the file states.

use hydroline_rigs::{Dof, Rig, ThrustCurve};

use crate::check::{Finding, FindingList};
use crate::layout::Layout;
use crate::map::{
    ChannelMap, Column, CommandMap, Map, Origin, QuaternionMap, TimeSource, dimension, place_name,
};
use crate::unit::{self, Dimension, UNITS};

/// Every column with its place in a row; `None` = not there, which has been said.
pub(crate) struct Columns<'a> {
    pub channels: Vec<(&'a ChannelMap, Option<usize>)>,
    pub quaternion: Option<(&'a QuaternionMap, [Option<usize>; 4])>,
    pub commands: Vec<Load<'a>>,
    pub compare: Option<(usize, f64)>,
    /// Velocities are along the tank's axes.
    pub in_tank: bool,
}

/// A command's column, and the curve where it is a pulse.
pub(crate) struct Load<'a> {
    pub map: &'a CommandMap,
    pub place: Option<usize>,
    pub curve: Option<&'a ThrustCurve>,
}

impl<'a> Columns<'a> {
    pub fn find(
        map: &'a Map,
        layout: &Layout,
        rig: Option<&'a Rig>,
        findings: &mut Vec<Finding>,
    ) -> Columns<'a> {
        let mut place = |column: &Column, key: &str| layout.place(column, key, findings);
        let mut of = |origin: &Origin, key: &str| match origin {
            Origin::Column(c) => place(c, key),
            Origin::Value(_) => None,
        };
        let channels: Vec<(&ChannelMap, Option<usize>)> = map
            .channels
            .iter()
            .map(|c| (c, of(&c.origin, &format!("motion.{}", place_name(c.place)))))
            .collect();
        let loads: Vec<(&CommandMap, Option<usize>)> = map
            .commands
            .iter()
            .map(|c| (c, of(&c.origin, &format!("command {}", c.thruster))))
            .collect();
        let quaternion = map
            .quaternion
            .as_ref()
            .map(|q| (q, q.wxyz.each_ref().map(|c| place(c, "quaternion"))));
        let compare =
            map.time.compare.as_ref().and_then(|(column, unit_s)| {
                Some((place(column, "time.compare_column")?, *unit_s))
            });
        let commands = loads
            .into_iter()
            .map(|(map, place)| Load {
                map,
                place,
                curve: map.pulse.then(|| curve(map, rig, findings)).flatten(),
            })
            .collect();
        let columns = Columns {
            in_tank: map.channels.iter().any(|c| c.in_tank),
            channels,
            quaternion,
            commands,
            compare,
        };
        columns.units(map, layout, findings);
        columns.frames(map, findings);
        columns
    }

    /// Compares the units that the file states, in a line of them or in its names, with the map's.
    fn units(&self, map: &Map, layout: &Layout, findings: &mut Vec<Finding>) {
        if let TimeSource::Numbers(columns) = &map.time.source {
            for (column, unit_ns) in columns.iter().filter(|_| map.time.epoch_ns == 0) {
                let place = layout.place(column, "time.column", &mut Vec::new());
                let Some((text, stated)) =
                    place.and_then(|p| stated_unit(layout, p, Dimension::Time))
                else {
                    continue;
                };
                if stated.is_some_and(|f| (f * 1e9 / *unit_ns as f64 - 1.0).abs() > 1e-9) {
                    findings.fault_at(
                        "units",
                        map.file.units_line,
                        format!("time: the file says '{text}', the map '{}'", map.time.unit),
                    );
                }
            }
        }
        for (channel, place) in &self.channels {
            let dimension = dimension(channel.place);
            let Some((text, stated)) = place.and_then(|p| stated_unit(layout, p, dimension)) else {
                continue;
            };
            let name = place_name(channel.place);
            let of_map = unit::find(dimension, channel.unit).map_or(1.0, |u| u.factor);
            match stated {
                Some(factor)
                    if !same(factor, of_map) && !same(factor, channel.factor.abs()) =>
                {
                    findings.fault_at(
                        "units",
                        map.file.units_line,
                        format!(
                            "{name}: the file says that {} is in '{text}', the map says '{}'",
                            channel.origin.words(),
                            channel.unit,
                        ),
                    );
                }
                None => findings.warning_at("units", map.file.units_line, format!(
                        "{name}: the file says that {} is in '{text}', which is no unit of this channel",
                        channel.origin.words()
                    )),
                Some(_) => {}
            }
        }
    }

    /// Adds the assumptions where velocities are rotated: unmapped channels are 0, and without an angle it is a fault.
    fn frames(&self, map: &Map, findings: &mut Vec<Finding>) {
        if !self.in_tank {
            return;
        }
        let missing: Vec<&str> = (3..9)
            .filter(|p| map.missing(*p).is_none())
            .map(place_name)
            .collect();
        let angles = (3..6).filter(|p| map.missing(*p).is_some()).count();
        if angles == 0 {
            findings.fault("velocity_frame", "velocities in the tank's frame need the heading to turn them into the body's: map psi_rad (and phi_rad, theta_rad), or a [quaternion]".to_owned());
        } else {
            let rest = if missing.is_empty() {
                String::new()
            } else {
                format!("; {} are not in the map and taken as 0", missing.join(", "))
            };
            findings.info(
                "velocity_frame",
                format!("velocities are rotated from the tank's frame into the body's{rest}"),
            );
        }
    }
}

fn same(a: f64, b: f64) -> bool {
    (a / b - 1.0).abs() < 1e-9
}

/// Unit that the file states for a column: its text, and its factor if it is one of the dimension. `None` = nothing that is a unit.
pub(crate) fn stated_unit(
    layout: &Layout,
    place: usize,
    dimension: Dimension,
) -> Option<(&str, Option<f64>)> {
    let row = layout.units.get(place).map(String::as_str);
    let row = row
        .map(|u| unit::written(u).unwrap_or(u))
        .filter(|u| !u.is_empty());
    let text = row.or_else(|| unit::written(layout.header.get(place)?))?;
    if let Some(unit) = unit::find(dimension, text) {
        return Some((text, Some(unit.factor)));
    }
    // A word in brackets that is no unit at all says nothing.
    UNITS
        .iter()
        .any(|u| unit::find(u.dimension, text).is_some())
        .then_some((text, None))
}

fn curve<'a>(
    command: &CommandMap,
    rig: Option<&'a Rig>,
    findings: &mut Vec<Finding>,
) -> Option<&'a ThrustCurve> {
    let name = &command.thruster;
    let Some(rig) = rig else {
        findings.fault(
            "pulse_without_rig",
            format!("command {name}: a pulse width becomes thrust by the rig's curve: give --rig"),
        );
        return None;
    };
    let found = rig.thrusters.thrusters.iter().find(|t| t.name == *name);
    if found.is_none() && Dof::ALL.iter().any(|d| d.name() == name) {
        findings.fault("pulse_of_component", format!("command {name}: a pulse width is one thruster's, not a component's: name the thruster"));
    }
    found.map(|t| &t.curve)
}
