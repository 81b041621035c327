//! The guessed map's channels, orientation and commands.

use super::Draft;
use super::meaning::{Meaning, Words, meaning};
use super::shape::Shape;
use super::stats::{Column, Stats};
use super::time::Time;
use crate::map::{COMPANIONS, PLACES, dimension, place_name};
use crate::unit::{self, Dimension};

/// Components of a load, in the order of the channels.
const LOADS: [&str; 6] = ["surge", "sway", "heave", "roll", "pitch", "yaw"];

/// One channel.
#[derive(Debug, Clone)]
struct Channel {
    place: usize,
    column: usize,
    sign: f64,
    unit: String,
    doubts: Vec<String>,
}

/// What moves, and what was commanded.
#[derive(Debug, Clone, Default)]
pub(super) struct Motion {
    channels: Vec<Channel>,
    /// Columns in the order of the file, and the order's name.
    quaternion: Option<([usize; 4], &'static str)>,
    loads: Vec<(usize, usize, String, Vec<String>)>,
    /// Whether velocities are along the tank's axes.
    pub in_tank: bool,
    /// Names do not say whose axes velocities are along.
    frame_open: bool,
    y_up: bool,
    /// A heading beyond a turn is in degrees, or goes on over several turns in radians.
    angle_open: bool,
    /// What is not mapped and why.
    left: Vec<String>,
}

impl Motion {
    pub fn is_empty(&self) -> bool {
        self.channels.is_empty() && self.quaternion.is_none() && self.loads.is_empty()
    }

    fn has(&self, place: usize) -> bool {
        self.channels.iter().any(|c| c.place == place)
    }

    fn has_velocity_and_heading(&self) -> bool {
        (6..9).any(|p| self.has(p)) && (self.has(5) || self.quaternion.is_some())
    }
}

/// Bodies, markers and topics of a file, with what each has.
fn best_group(shape: &Shape, meanings: &[Meaning]) -> Option<String> {
    let body = |group: &str| -> String {
        group
            .trim_end_matches(" Position")
            .trim_end_matches(" Rotation")
            .trim_end_matches(" rot")
            .to_owned()
    };
    let mut groups: Vec<(String, usize)> = Vec::new();
    for (column, m) in shape.columns.iter().zip(meanings) {
        let own = body(&column.group);
        let worth = match m {
            Meaning::Quaternion(_) => 3,
            Meaning::Channel(3..6) => 2,
            Meaning::Channel(_) | Meaning::Velocity(_) => 1,
            _ => 0,
        };
        match groups.iter_mut().find(|g| g.0 == own) {
            Some(g) => g.1 += worth,
            None => groups.push((own, worth)),
        }
    }
    let most = groups.iter().map(|g| g.1).max()?;
    groups
        .into_iter()
        .find(|g| g.1 == most && most > 0)
        .map(|g| g.0)
}

pub(super) fn find(shape: &Shape, stats: &Stats, time: &Time) -> Motion {
    let meanings: Vec<Meaning> = shape
        .columns
        .iter()
        .map(|c| meaning(&c.name, &c.group))
        .collect();
    let group = best_group(shape, &meanings);
    let mut out = Motion {
        y_up: shape.units.y_up && upright(shape, stats, &meanings),
        in_tank: shape.kind.starts_with("EuRoC"),
        ..Motion::default()
    };
    let mut quaternion: [Option<usize>; 4] = [None; 4];
    let mut others: Vec<String> = Vec::new();
    for (i, own) in meanings.iter().enumerate() {
        let Some(column) = stats.columns.get(i) else {
            continue;
        };
        if time.columns.contains(&i) || !column.is_numeric() {
            continue;
        }
        let named = &shape.columns[i];
        let foreign = group
            .as_ref()
            .is_some_and(|g| !named.group.is_empty() && !named.group.starts_with(g.as_str()));
        if foreign && !matches!(own, Meaning::Load(_) | Meaning::Companion(_)) {
            if !others.contains(&named.group)
                && matches!(own, Meaning::Channel(_) | Meaning::Quaternion(_))
            {
                others.push(named.group.clone());
            }
            continue;
        }
        match own {
            Meaning::Channel(place) | Meaning::Velocity(place) => {
                out.frame_open |= matches!(own, Meaning::Velocity(_));
                out.channel(*place, i, shape);
            }
            Meaning::Depth | Meaning::Height => out.vertical(*own, i, shape),
            Meaning::Along(place) if !out.has(*place) => {
                out.channel(*place, i, shape);
                if let Some(c) = out.channels.last_mut() {
                    c.doubts
                        .push("along which axis is not written: forward assumed".to_owned());
                }
            }
            Meaning::Quaternion(c) if quaternion[*c].is_none() => quaternion[*c] = Some(i),
            Meaning::Load(d) => out.load(*d, i, shape),
            Meaning::Companion(name) => {
                match COMPANIONS.iter().position(|n| *n == *name) {
                    Some(at) => out.channel(12 + at, i, shape),
                    None => out.left.push(format!("{}: not mapped", shape.words(i))),
                }
            }
            Meaning::Thruster => out.left.push(format!(
                "{} looks like one thruster's command: [[command]] with thruster = its name in the rig, {}, unit = \"us\" for a pulse (then import --rig) or \"N\"",
                shape.words(i),
                shape.key(i).replace('\n', ", ")
            )),
            Meaning::Unknown if !named.name.is_empty() || shape.columns.len() < 20 => {
                out.left.push(format!("{}: its name says nothing that is known here", shape.words(i)));
            }
            _ => {}
        }
    }
    if let [Some(w), Some(x), Some(y), Some(z)] = quaternion {
        out.quaternion = Some(if w < x {
            ([w, x, y, z], "wxyz")
        } else {
            ([x, y, z, w], "xyzw")
        });
        out.channels.retain(|c| !(3..6).contains(&c.place));
    }
    if !others.is_empty() {
        others.dedup();
        let own = group.unwrap_or_default();
        let what = if out.quaternion.is_some() || (3..6).any(|p| out.has(p)) {
            "body"
        } else {
            "point"
        };
        out.left.push(format!(
            "the {what} mapped is '{own}'; the file has others: {}",
            others.join(", ")
        ));
    }
    out.channels.sort_by_key(|c| c.place);
    out.infer_units(shape, stats, time);
    out
}

/// Whether the second axis of a file of Motive's is the one that stands up, as it is unless it was set otherwise.
fn upright(shape: &Shape, stats: &Stats, meanings: &[Meaning]) -> bool {
    let column = |p: usize| {
        let i = meanings.iter().position(|m| *m == Meaning::Channel(p))?;
        (!shape.columns.is_empty()).then(|| stats.columns.get(i))?
    };
    match (column(1), column(2)) {
        // Below the floor all the time and level with it across: z down.
        (Some(y), Some(z)) => !(z.high < 0.0 && y.largest() < 0.5 * z.largest()),
        _ => true,
    }
}

impl Motion {
    fn channel(&mut self, place: usize, column: usize, shape: &Shape) {
        // Motive: x forward, y up, z to starboard.
        let (place, sign) = match (self.y_up, place) {
            (true, 1) => (2, -1.0),
            (true, 2) => (1, 1.0),
            _ => (place, 1.0),
        };
        if self.has(place) {
            self.left.push(format!(
                "{}: {} is mapped already",
                shape.words(column),
                place_name(place)
            ));
            return;
        }
        self.channels.push(Channel {
            place,
            column,
            sign,
            unit: String::new(),
            doubts: Vec::new(),
        });
    }

    fn vertical(&mut self, own: Meaning, column: usize, shape: &Shape) {
        if self.has(2) {
            return;
        }
        self.channel(2, column, shape);
        if let Some(c) = self.channels.last_mut() {
            let words = if own == Meaning::Depth {
                "depth counts down from the surface, z_m from the floor: offset = .. (SI) is minus the water's depth"
            } else {
                c.sign = -1.0;
                "height counts up, z_m down: sign = -1; from what zero is not written"
            };
            c.doubts.push(words.to_owned());
        }
    }

    fn load(&mut self, dof: usize, column: usize, shape: &Shape) {
        let thruster = LOADS[dof];
        if self.loads.iter().any(|l| l.0 == dof) {
            self.left.push(format!(
                "{}: {thruster} is mapped already",
                shape.words(column)
            ));
            return;
        }
        let dimension = if dof < 3 {
            Dimension::Force
        } else {
            Dimension::Moment
        };
        let named = &shape.columns[column];
        let written = named.unit.as_deref().or(Words::of(&named.name).unit);
        let mut doubts = Vec::new();
        let unit = match written.and_then(|u| unit::find(dimension, u)) {
            Some(u) => u.name,
            None => {
                doubts.push(format!(
                    "the unit is not written: {} assumed",
                    if dof < 3 { "N" } else { "N m" }
                ));
                if dof < 3 { "N" } else { "N m" }
            }
        };
        if !named.name.to_lowercase().contains(thruster) {
            doubts.push(format!(
                "{}: taken as the load commanded in {thruster}; whether it was commanded or measured is not written",
                shape.words(column)
            ));
        }
        self.loads.push((dof, column, unit.to_owned(), doubts));
    }

    /// The other reading of what the file leaves open: units of angles.
    pub fn other_angles(&self) -> Option<Motion> {
        self.angle_open.then(|| {
            let mut other = self.clone();
            for c in &mut other.channels {
                let unit = match c.unit.as_str() {
                    "deg" => "rad",
                    "deg/s" => "rad/s",
                    _ => continue,
                };
                if c.doubts.iter().any(|d| d.starts_with("the unit is not written")) {
                    unit.clone_into(&mut c.unit);
                    c.doubts.retain(|d| !d.starts_with("the unit is not written"));
                    c.doubts.push(format!("the unit is not written: {unit} assumed, which agrees with the other channels; deg if not"));
                }
            }
            other
        })
    }

    /// Velocities along the other axes.
    pub fn other_frame(&self) -> Option<Motion> {
        let checked = self.has_velocity_and_heading();
        checked.then(|| Motion {
            in_tank: !self.in_tank,
            ..self.clone()
        })
    }

    /// Units as they are written, or as the kind has them, or by the size of the numbers.
    fn infer_units(&mut self, shape: &Shape, stats: &Stats, time: &Time) {
        let written = |c: &Channel| {
            let named = &shape.columns[c.column];
            named
                .unit
                .as_deref()
                .or(Words::of(&named.name).unit)
                .and_then(|u| unit::find(dimension(c.place), u))
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
                    format!("no angle is beyond {angles:.3}; deg if the vehicle hardly turned"),
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
                c.doubts.push(format!(
                    "the unit is not written: {unit} assumed ({because})"
                ));
            }
        }
    }

    pub fn write(&self, shape: &Shape, stats: &Stats, draft: &mut Draft) {
        self.axes(shape, draft);
        for c in &self.channels {
            draft.line(format!("[motion.{}]", place_name(c.place)));
            for doubt in &c.doubts {
                draft.toml.push(format!("# {doubt}"));
                draft
                    .remarks
                    .push(format!("{}: {doubt}", place_name(c.place)));
            }
            draft
                .toml
                .extend(shape.key(c.column).lines().map(str::to_owned));
            draft.line(format!("unit = \"{}\"", c.unit));
            if c.sign < 0.0 {
                draft.line("sign = -1");
            }
            if (6..9).contains(&c.place) && self.in_tank {
                draft.line("frame = \"tank\"");
            }
            missing(&stats.columns[c.column], draft);
        }
        if let Some((columns, order)) = self.quaternion {
            draft.line("[quaternion]");
            let list: Vec<String> = columns
                .iter()
                .map(|c| {
                    shape
                        .key(*c)
                        .lines()
                        .next()
                        .unwrap_or("")
                        .trim_start_matches("column = ")
                        .to_owned()
                })
                .collect();
            draft.line(format!("columns = [{}]", list.join(", ")));
            draft.line(format!("order = \"{order}\""));
            if self.y_up {
                draft.line("axes = \"y_up\"");
            }
            missing(&stats.columns[columns[0]], draft);
        }
        for (dof, column, unit, doubts) in &self.loads {
            draft.line("[[command]]");
            for doubt in doubts {
                draft.toml.push(format!("# {doubt}"));
                draft
                    .remarks
                    .push(format!("command {}: {doubt}", LOADS[*dof]));
            }
            draft.line(format!("thruster = \"{}\"", LOADS[*dof]));
            draft
                .toml
                .extend(shape.key(*column).lines().map(str::to_owned));
            draft.line(format!("unit = \"{unit}\""));
            missing(&stats.columns[*column], draft);
        }
        for left in &self.left {
            draft.doubt(left.clone());
        }
    }

    /// Whose axes these are is in no file.
    fn axes(&self, shape: &Shape, draft: &mut Draft) {
        let across = [1, 2, 3, 4, 5, 7, 8, 9, 10, 11]
            .iter()
            .any(|p| self.has(*p))
            || self.quaternion.is_some();
        if self.y_up {
            draft.doubt("axes: x forward, y up, z to starboard, as Motive has them unless set otherwise, so z_m = -Y and y_m = Z; whether the body points along x is not written");
        } else if across {
            let kind = shape.kind;
            draft.doubt(format!(
                "signs and axes are the file's, taken for x forward, y to starboard, z down, as {kind} need not have them: with z up, sign = -1 on y_m z_m theta_rad psi_rad v_mps w_mps q_radps r_radps, and axes = \"z_up\" of a quaternion"
            ));
        }
        if (6..9).any(|p| self.has(p)) && (self.frame_open || self.in_tank) {
            let frame = if self.in_tank { "tank" } else { "body" };
            let other = if self.in_tank { "body" } else { "tank" };
            let checked =
                if self.has(0) && self.has(1) && (self.has(5) || self.quaternion.is_some()) {
                    "; import holds this against the positions"
                } else {
                    ""
                };
            draft.doubt(format!("velocities are taken to be along the {frame}'s axes, which is not written: else frame = \"{other}\"{checked}"));
        }
    }
}

/// Cells that may be empty.
fn missing(column: &Column, draft: &mut Draft) {
    if column.empty == 0 {
        return;
    }
    let rows = column.rows();
    if column.empty * 20 > rows {
        draft.line("missing = \"skip\"");
        draft.remarks.push(format!(
            "{} of {rows} cells are empty: taken as not measured in that row",
            column.empty
        ));
    } else {
        draft.doubt(format!(
            "{} of {rows} cells are empty: a fault unless missing = \"skip\" (or \"hold\")",
            column.empty
        ));
    }
}

/// So that a table of places may be checked against the names above.
const _: () = assert!(PLACES >= 12);
