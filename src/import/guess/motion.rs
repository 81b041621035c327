//! The guessed map's channels, orientation and commands.

use super::meaning::Meaning;
use super::meaning::Words;
use super::meaning::written::{self, unit_text};
use super::shape::Shape;
use super::stats::Stats;
use super::time::Time;
use crate::map::{COMPANIONS, PLACES, place_name};
use crate::unit::{self, Dimension};

mod left;
mod units;
mod write;

use left::{Left, Why};

/// Components of a load, in the order of the channels.
const LOADS: [&str; 6] = ["surge", "sway", "heave", "roll", "pitch", "yaw"];

/// A body that turns so many times more about one axis than about another does so clearly.
const CLEARLY: f64 = 4.0;

#[derive(Debug, Clone)]
struct Channel {
    place: usize,
    column: usize,
    sign: f64,
    unit: String,
    questions: Vec<String>,
}

/// Measured channels and commanded loads of a table, as the map will name them.
#[derive(Debug, Clone, Default)]
pub(super) struct Motion {
    channels: Vec<Channel>,
    /// Columns in the order of the file, and the order's name.
    quaternion: Option<([usize; 4], &'static str)>,
    loads: Vec<(usize, usize, String, Vec<String>)>,
    /// Whether velocities are along the tank's axes.
    pub in_tank: bool,
    /// Columns of velocities to the north, to the east and downwards.
    ground: Vec<usize>,
    /// Names do not say whose axes velocities are along.
    frame_open: bool,
    y_up: bool,
    /// A heading beyond a turn is in degrees, or goes on over several turns in radians.
    angle_open: bool,
    /// Columns that are not mapped, and why.
    left: Left,
    notes: Vec<String>,
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
fn best_group(shape: &Shape, meanings: &[written::Column]) -> Option<String> {
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
        let worth = match m.is() {
            Some(Meaning::Quaternion(_)) => 3,
            Some(Meaning::Channel(3..6)) => 2,
            Some(Meaning::Channel(_) | Meaning::Velocity(_) | Meaning::Ground(_)) => 1,
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
    let meanings: Vec<written::Column> = shape.columns.iter().map(written::column).collect();
    let group = best_group(shape, &meanings);
    let mut out = Motion {
        y_up: shape.units.y_up,
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
        if foreign && !matches!(own.is(), Some(Meaning::Load(_) | Meaning::Companion(_))) {
            if !others.contains(&named.group)
                && matches!(own.is(), Some(Meaning::Channel(_) | Meaning::Quaternion(_)))
            {
                others.push(named.group.clone());
            }
            continue;
        }
        match *own {
            written::Column::Is(Meaning::Quaternion(c)) => {
                quaternion[c].get_or_insert(i);
            }
            written::Column::Is(own) => out.take(own, i, shape),
            written::Column::OtherUnit => {
                let unit = unit_text(named).unwrap_or_default().to_owned();
                out.left.add(Why::Unit(unit), shape.words(i));
            }
            written::Column::Wished => out.left.add(Why::Wished, shape.words(i)),
        }
    }
    if let [Some(w), Some(x), Some(y), Some(z)] = quaternion {
        out.quaternion = Some(if w < x {
            ([w, x, y, z], "wxyz")
        } else {
            ([x, y, z, w], "xyzw")
        });
        out.channels.retain(|c| !(3..6).contains(&c.place));
        out.turns_about_z(stats, [x, y, z]);
    }
    if !others.is_empty() {
        others.dedup();
        let own = group.unwrap_or_default();
        let what = if out.quaternion.is_some() || (3..6).any(|p| out.has(p)) {
            "body"
        } else {
            "point"
        };
        out.notes.push(format!(
            "the {what} mapped is '{own}'; the file has others: {}",
            others.join(", ")
        ));
    }
    out.drop_ground_without_heading(shape);
    out.channels.sort_by_key(|c| c.place);
    out.infer_units(shape, stats, time);
    out
}

impl Motion {
    /// One column, by what it is.
    fn take(&mut self, own: Meaning, i: usize, shape: &Shape) {
        match own {
            Meaning::Channel(place) => self.channel(place, i, shape),
            Meaning::Velocity(place) => {
                self.frame_open = true;
                self.channel(place, i, shape);
            }
            Meaning::Ground(place) => {
                if !self.has(place) {
                    self.ground.push(i);
                }
                self.channel(place, i, shape);
            }
            Meaning::Angle(_) => self.left.add(Why::Angle, shape.words(i)),
            Meaning::Depth | Meaning::Height => self.vertical(own, i, shape),
            Meaning::Along(place) if !self.has(place) => {
                self.channel(place, i, shape);
                if let Some(c) = self.channels.last_mut() {
                    c.questions
                        .push("along which axis is not written: forward assumed".to_owned());
                }
            }
            Meaning::Load(d) => self.load(d, i, shape),
            Meaning::Companion(name) => {
                if let Some(at) = COMPANIONS.iter().position(|n| *n == name) {
                    self.channel(12 + at, i, shape);
                }
            }
            Meaning::Thruster => self.notes.push(format!(
                "{} looks like one thruster's command: [[command]] with thruster = its name in the rig, {}, unit = \"us\" for a pulse (then import --rig) or \"N\"",
                shape.words(i),
                shape.key(i).replace('\n', ", ")
            )),
            Meaning::Unknown if !shape.columns[i].name.is_empty() || shape.columns.len() < 20 => {
                self.left.add(Why::Name, shape.words(i));
            }
            _ => {}
        }
    }

    /// Velocities to the north and east are rotated by the heading; without one they are no velocities of the body.
    fn drop_ground_without_heading(&mut self, shape: &Shape) {
        if self.ground.is_empty() {
            return;
        }
        if self.has(5) || self.quaternion.is_some() {
            self.in_tank = true;
            return;
        }
        for i in std::mem::take(&mut self.ground) {
            self.channels.retain(|c| c.column != i);
            self.left.add(Why::NoHeading, shape.words(i));
        }
    }

    /// A vehicle turns about what stands up more than about anything else.
    fn turns_about_z(&mut self, stats: &Stats, [x, y, z]: [usize; 3]) {
        let turns = |c: usize| stats.columns[c].high - stats.columns[c].low;
        if self.y_up && turns(z) > CLEARLY * turns(y).max(turns(x)) {
            self.notes.push(
                "the body turns about Z far more than about Y: was the file exported with Z up? Then z_m = -Z, y_m = -Y and axes = \"z_up\"".to_owned(),
            );
        }
    }

    fn channel(&mut self, place: usize, column: usize, shape: &Shape) {
        // Motive: x forward, y up, z to starboard.
        let (place, sign) = match (self.y_up, place) {
            (true, 1) => (2, -1.0),
            (true, 2) => (1, 1.0),
            _ => (place, 1.0),
        };
        if self.has(place) {
            self.left
                .add(Why::Mapped(place_name(place)), shape.words(column));
            return;
        }
        self.channels.push(Channel {
            place,
            column,
            sign,
            unit: String::new(),
            questions: Vec::new(),
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
            c.questions.push(words.to_owned());
        }
    }

    fn load(&mut self, dof: usize, column: usize, shape: &Shape) {
        let thruster = LOADS[dof];
        if self.loads.iter().any(|l| l.0 == dof) {
            self.left.add(Why::Mapped(thruster), shape.words(column));
            return;
        }
        let dimension = if dof < 3 {
            Dimension::Force
        } else {
            Dimension::Moment
        };
        let named = &shape.columns[column];
        let mut questions = Vec::new();
        let unit = match unit_text(named).and_then(|u| unit::find(dimension, u)) {
            Some(u) => u.name,
            None => {
                questions.push(format!(
                    "the unit is not written: {} assumed",
                    if dof < 3 { "N" } else { "N m" }
                ));
                if dof < 3 { "N" } else { "N m" }
            }
        };
        let words = Words::of(&named.name).words;
        let says = |list: &[&str]| words.iter().any(|w| list.contains(&w.as_str()));
        if !(says(&[thruster]) && says(&["cmd", "command", "commands", "commanded"])) {
            questions.push(format!(
                "{}: taken as the load commanded in {thruster}; whether it was commanded or measured is not written",
                shape.words(column)
            ));
        }
        self.loads.push((dof, column, unit.to_owned(), questions));
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
                if c.questions.iter().any(|d| d.starts_with("the unit is not written")) {
                    unit.clone_into(&mut c.unit);
                    c.questions.retain(|d| !d.starts_with("the unit is not written"));
                    c.questions.push(format!("the unit is not written: {unit} assumed, which agrees with the other channels; deg if not"));
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
}

/// So that a table of places may be checked against the names above.
const _: () = assert!(PLACES >= 12);
