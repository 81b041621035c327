//! `MAP.toml`: which column is what, in which unit. As typed ([`raw`]) and checked ([`Map`]).

mod check;
mod error;
mod raw;

use std::fmt;
use std::path::Path;

pub use hydroline_core::run::COMPANIONS;
use hydroline_core::run::Channel;

pub(crate) use check::dimension;
pub use error::MapError;

/// A column of the file.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Column {
    /// From 1.
    Number(usize),
    /// By its header; the `nth` (from 1) of those that have the same one.
    Name {
        /// As the header has it.
        name: String,
        /// `None` = it is there once.
        nth: Option<usize>,
    },
}

impl fmt::Display for Column {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Column::Number(n) => write!(f, "{n}"),
            Column::Name { name, nth: None } => write!(f, "{name}"),
            Column::Name { name, nth: Some(n) } => write!(f, "{name} (no. {n})"),
        }
    }
}

/// Source of the values of a channel or command.
#[derive(Debug, Clone, PartialEq)]
pub enum Origin {
    Column(Column),
    /// One value for all rows, in the unit of the map: the file does not hold it.
    Value(f64),
}

impl Origin {
    /// The column's name for messages.
    pub(crate) fn words(&self) -> String {
        match self {
            Origin::Column(c) => format!("column '{c}'"),
            Origin::Value(v) => format!("value {v} of the map"),
        }
    }
}

/// Meaning of an empty or NaN cell. Default: a fault.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Missing {
    /// Something was lost.
    #[default]
    Fault,
    /// Nothing was measured in this row.
    Skip,
    /// The value before still holds.
    Hold,
}

/// Cells that stand for nothing measured, besides those that say so by themselves.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct MissingValues {
    /// Compared as numbers.
    pub numbers: Vec<f64>,
    /// Compared as texts, without regard to case.
    pub texts: Vec<String>,
}

impl MissingValues {
    /// Whether a cell is one of them; `number` is what it holds, if one.
    pub(crate) fn has(&self, cell: &str, number: Option<f64>) -> bool {
        number.is_some_and(|v| self.numbers.contains(&v))
            || self.texts.iter().any(|t| t.eq_ignore_ascii_case(cell))
    }
}

/// Between samples of a command.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Between {
    /// The last value holds.
    #[default]
    Hold,
    /// Straight lines: written as steps of at most 10 ms.
    Linear,
}

/// One measured channel or companion.
#[derive(Debug, Clone, PartialEq)]
pub struct ChannelMap {
    /// Place in [`PLACES`].
    pub place: usize,
    /// Column or constant.
    pub origin: Origin,
    pub unit: &'static str,
    /// SI per unit of the column: unit, sign and scale.
    pub factor: f64,
    /// Added after the factor, SI.
    pub offset: f64,
    /// Standard deviation of the instrument, SI; `None` = not known.
    pub sd: Option<f64>,
    /// Meaning of an empty cell.
    pub missing: Missing,
    /// What else means an empty cell.
    pub missing_values: MissingValues,
    /// A velocity along the tank's axes, to be rotated into the body's.
    pub in_tank: bool,
}

/// One commanded load.
#[derive(Debug, Clone, PartialEq)]
pub struct CommandMap {
    /// Thruster of the rig, or `surge` .. `yaw`.
    pub thruster: String,
    /// Column or constant.
    pub origin: Origin,
    /// Newtons (newton metres, or microseconds of pulse) per unit of the column.
    pub factor: f64,
    /// Added after the factor \[N, N m, us\].
    pub offset: f64,
    /// The column is a pulse width: the rig's curve says what thrust it makes.
    pub pulse: bool,
    /// Between samples.
    pub between: Between,
    /// Meaning of an empty cell.
    pub missing: Missing,
    /// What else means an empty cell.
    pub missing_values: MissingValues,
}

/// How a file's axes lie; the body's as the tank's.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Axes {
    /// x forward, y to starboard, z down: ours.
    #[default]
    ZDown,
    /// x forward, y to port, z up: ROS, most motion capture.
    ZUp,
    /// x forward, y up, z to starboard: Motive, computer graphics.
    YUp,
}

/// Orientation as a unit quaternion, body to tank.
#[derive(Debug, Clone, PartialEq)]
pub struct QuaternionMap {
    /// Columns of w, x, y, z in this order, whatever the file's.
    pub wxyz: [Column; 4],
    /// The file's axes.
    pub axes: Axes,
    /// Meaning of an empty cell.
    pub missing: Missing,
    /// What else means an empty cell.
    pub missing_values: MissingValues,
}

/// How a row's time is written.
#[derive(Debug, Clone, PartialEq)]
pub enum TimeSource {
    /// Not at all: rows come at a rate.
    Rows,
    /// A counter of frames at a rate.
    Frames(Column),
    /// Numbers, to be added: (column, nanoseconds per unit).
    Numbers(Vec<(Column, i128)>),
    /// ISO 8601, in one column or in date and time.
    Iso(Vec<Column>),
    /// A pattern as of `strftime`, over one column or several joined by a blank.
    Pattern(Vec<Column>, String),
}

/// The time of a row.
#[derive(Debug, Clone, PartialEq)]
pub struct TimeMap {
    /// Columns, and the form in which they hold the time.
    pub source: TimeSource,
    /// `time.unit` of the map, for messages.
    pub unit: String,
    /// Rows per second: what makes the time, or puts rounded stamps back.
    pub rate_hz: Option<f64>,
    /// The counter starts again from 0 after so many bits.
    pub unwrap_bits: Option<u32>,
    /// Stamps are UNIX time, after this is added \[ns\].
    pub unix: bool,
    /// From the file's zero to 1970 \[ns\]: spreadsheets and MATLAB count days from elsewhere.
    pub epoch_ns: i128,
    /// UNIX time of zero for a relative clock \[s\].
    pub start_unix_s: Option<f64>,
    /// Which run, from 1, of a clock that was started anew in the file; `None` = it never was.
    pub boot: Option<u32>,
    /// Offset from UTC of stamps that state none \[min\].
    pub utc_offset_min: Option<i32>,
    /// Only rows from here on \[s after the first row\].
    pub from_s: Option<f64>,
    /// Only rows up to here \[s after the first row\].
    pub to_s: Option<f64>,
    /// A second clock in the same rows, to measure drift, and its seconds per unit.
    pub compare: Option<(Column, f64)>,
}

/// Between cells.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Separator {
    /// One character.
    Byte(u8),
    /// Runs of blanks and tabs.
    Blanks,
}

impl fmt::Display for Separator {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            // As a map writes it.
            Separator::Byte(b'\t') => write!(f, "\\t"),
            Separator::Byte(b) if b.is_ascii_control() => write!(f, "\\u{b:04x}"),
            Separator::Byte(b) => write!(f, "{}", char::from(*b)),
            Separator::Blanks => write!(f, "blanks"),
        }
    }
}

/// Encoding of a file's characters.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Encoding {
    Utf8,
    /// UTF-16, least byte first.
    Utf16Le,
    /// UTF-16, most significant byte first.
    Utf16Be,
    /// ISO 8859-1, with Windows' own characters in the controls' place.
    Latin1,
}

/// Form of a file: separators, encoding, and the lines of names, units and data.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct FileMap {
    /// Between cells; `None` = a comma, or what a first line `sep=` says.
    pub separator: Option<Separator>,
    /// Characters of each column where columns have fixed widths; empty = a separator stands between them.
    pub widths: Vec<usize>,
    /// `.` or `,`.
    pub decimal: char,
    /// Sets the thousands apart; `None` = nothing does.
    pub thousands: Option<char>,
    /// `None` = as the byte order mark says, else UTF-8.
    pub encoding: Option<Encoding>,
    /// Lines that begin so are none of the table.
    pub comment: Option<String>,
    /// Whether a line names the columns.
    pub header: bool,
    /// Line of the names; `None` = the first of the table.
    pub header_line: Option<u64>,
    /// Line of the units.
    pub units_line: Option<u64>,
    /// First line of data; `None` = after names and units.
    pub first_line: Option<u64>,
    /// Last line of data; `None` = to the end.
    pub last_line: Option<u64>,
}

impl FileMap {
    /// A table whose first line is its header, of numbers with a point.
    pub(crate) fn plain() -> FileMap {
        FileMap {
            separator: None,
            widths: Vec::new(),
            decimal: '.',
            thousands: None,
            encoding: None,
            comment: None,
            header: true,
            header_line: None,
            units_line: None,
            first_line: None,
            last_line: None,
        }
    }
}

/// A checked map.
#[derive(Debug, Clone, PartialEq)]
pub struct Map {
    /// Form of the file.
    pub file: FileMap,
    /// Place of a row's time.
    pub time: TimeMap,
    /// Measured channels and companions, by place.
    pub channels: Vec<ChannelMap>,
    /// Orientation, where it is a quaternion.
    pub quaternion: Option<QuaternionMap>,
    /// Commanded loads, in the order of the map.
    pub commands: Vec<CommandMap>,
}

/// Number of channels and companions.
pub const PLACES: usize = Channel::ALL.len() + COMPANIONS.len();

pub fn place_name(place: usize) -> &'static str {
    let channels = Channel::ALL.into_iter().map(Channel::name);
    channels.chain(COMPANIONS).nth(place).unwrap_or("?")
}

impl Map {
    /// Reads a map file.
    ///
    /// # Errors
    /// [`MapError`].
    pub fn load(path: &Path) -> Result<Map, MapError> {
        Self::load_with_text(path).map(|(map, _)| map)
    }

    /// The same with its text: what is read once (standard input, a pipe) has both.
    ///
    /// # Errors
    /// [`MapError`].
    pub fn load_with_text(path: &Path) -> Result<(Map, String), MapError> {
        let file = path.display().to_string();
        let text = hydroline_rigs::bounded::read_text(path, hydroline_rigs::bounded::CONFIG_BYTES)
            .map_err(|source| MapError::Unreadable {
                path: file.clone(),
                source,
            })?;
        Ok((Map::from_toml(&text, &file)?, text))
    }

    /// Reads a map from a text.
    ///
    /// # Errors
    /// [`MapError`].
    pub fn from_toml(text: &str, file: &str) -> Result<Map, MapError> {
        let raw: raw::RawMap = toml::from_str(text).map_err(|e| MapError::Toml {
            file: file.to_owned(),
            source: Box::new(e),
        })?;
        check::Checker { file }.map(raw)
    }

    /// Whether anything measured is mapped.
    pub(crate) fn has_motion(&self) -> bool {
        !self.channels.is_empty() || self.quaternion.is_some()
    }

    /// Meaning of an empty cell of a place; `None` = not mapped.
    pub(crate) fn missing(&self, place: usize) -> Option<Missing> {
        self.channels
            .iter()
            .find(|c| c.place == place)
            .map(|c| c.missing)
            .or_else(|| {
                let q = self.quaternion.as_ref()?;
                (3..6).contains(&place).then_some(q.missing)
            })
    }

    /// Whether rows may leave cells empty.
    pub(crate) fn sparse(&self) -> bool {
        (0..PLACES).any(|p| self.missing(p).is_some_and(|m| m != Missing::Fault))
    }
}
