//! A map as typed becomes a checked one.

mod time;

use std::fmt::Display;

use hydroline_core::run::Channel;

use super::raw::{
    RawCell, RawChannel, RawColumn, RawCommand, RawFile, RawMap, RawMissing, RawQuaternion,
};
use super::{
    Axes, Between, COMPANIONS, ChannelMap, Column, CommandMap, Encoding, FileMap, Map, MapError,
    Missing, MissingValues, Origin, PLACES, QuaternionMap, Separator, place_name,
};
use crate::unit::{self, Dimension};

/// Columns that a table has at most: more is another file.
const COLUMNS_MAX: u32 = 100_000;
/// Characters that a column of fixed width has at most: no number is longer.
const WIDTH_MAX: u32 = 1000;

pub(super) struct Checker<'a> {
    pub file: &'a str,
}

pub(crate) fn dimension(place: usize) -> Dimension {
    const OF_COMPANIONS: [Dimension; COMPANIONS.len()] = [
        Dimension::Angle,
        Dimension::Angle,
        Dimension::Rate,
        Dimension::Length,
    ];
    match place {
        0..3 => Dimension::Length,
        3..6 => Dimension::Angle,
        6..9 => Dimension::Speed,
        9..12 => Dimension::Rate,
        companion => OF_COMPANIONS[companion - 12],
    }
}

impl Checker<'_> {
    fn bad<T>(
        &self,
        key: impl Display,
        value: impl Display,
        allowed: impl Into<String>,
    ) -> Result<T, MapError> {
        Err(MapError::Value {
            file: self.file.to_owned(),
            key: key.to_string(),
            value: format!("'{value}'"),
            allowed: allowed.into(),
        })
    }

    pub fn map(&self, mut raw: RawMap) -> Result<Map, MapError> {
        // The rate belongs to the time; it may stand with the file, whose header often states it.
        match (raw.file.rate_hz, raw.time.rate_hz) {
            (Some(a), Some(b)) if a != b => {
                return self.bad("file.rate_hz", a, format!("time.rate_hz is {b}: give one"));
            }
            (Some(a), _) => raw.time.rate_hz = Some(a),
            _ => {}
        }
        if raw.motion.is_empty() && raw.commands.is_empty() && raw.quaternion.is_none() {
            return self.bad(
                "motion",
                "",
                format!(
                    "name at least one channel: [motion.x_m] .. of {}, or a [[command]]; hydroline import --help shows a map",
                    Channel::ALL.map(Channel::name).join(" ")
                ),
            );
        }
        let file = self.file(&raw.file)?;
        let time = self.time(raw.time)?;
        let mut channels = Vec::new();
        for (name, channel) in raw.motion {
            channels.push(self.channel(&name, channel)?);
        }
        channels.sort_by_key(|c| c.place);
        let quaternion = raw.quaternion.map(|q| self.quaternion(q)).transpose()?;
        if quaternion.is_some()
            && let Some(c) = channels.iter().find(|c| (3..6).contains(&c.place))
        {
            return self.bad(
                format!("motion.{}", place_name(c.place)),
                c.origin.words(),
                "[quaternion] gives all three angles: map one of the two",
            );
        }
        let speeds: Vec<bool> = channels
            .iter()
            .filter(|c| (6..9).contains(&c.place))
            .map(|c| c.in_tank)
            .collect();
        if speeds.iter().any(|t| *t) && speeds.iter().any(|t| !*t) {
            return self.bad(
                "motion.u_mps .. w_mps",
                "frame",
                "velocities are all in the body's frame or all in the tank's",
            );
        }
        let commands = raw
            .commands
            .into_iter()
            .enumerate()
            .map(|(i, c)| self.command(i + 1, c))
            .collect::<Result<_, _>>()?;
        Ok(Map {
            file,
            time,
            channels,
            quaternion,
            commands,
        })
    }

    fn file(&self, raw: &RawFile) -> Result<FileMap, MapError> {
        let decimal = raw.decimal.unwrap_or('.');
        let separator = match raw.separator.as_deref() {
            None => None,
            Some("blanks" | " ") => Some(Separator::Blanks),
            Some(text) => match text.as_bytes() {
                [b] if b.is_ascii() && *b != b'"' && !b.is_ascii_alphanumeric() => {
                    Some(Separator::Byte(*b))
                }
                _ => {
                    return self.bad(
                        "file.separator",
                        text.escape_default(),
                        "it must be one ASCII character (\",\" \";\" \"\\t\" ..) or \"blanks\" for runs of blanks and tabs",
                    );
                }
            },
        };
        if !matches!(decimal, '.' | ',')
            || separator == Some(Separator::Byte(decimal as u8))
            || (separator.is_none() && raw.widths.is_none() && decimal == ',')
        {
            let given = format!(
                "separator {} decimal {decimal}",
                separator.unwrap_or(Separator::Byte(b','))
            );
            return self.bad(
                "file",
                given,
                "the decimal sign is . or , and differs from the separator, an ASCII character",
            );
        }
        let widths = raw.widths.as_deref();
        if let Some(widths) = widths {
            let given = format!("{widths:?}");
            if separator.is_some() {
                return self.bad(
                    "file.widths",
                    given,
                    "file.separator is given too: columns have fixed widths or something between them",
                );
            }
            if widths.is_empty()
                || widths.len() > COLUMNS_MAX as usize
                || widths.iter().any(|w| !(1..=WIDTH_MAX).contains(w))
            {
                return self.bad(
                    "file.widths",
                    given,
                    format!(
                        "it lists the characters of each column from the left, 1 .. {WIDTH_MAX}: [9, 9, 12]"
                    ),
                );
            }
        }
        if let Some(mark) = raw.thousands
            && (!matches!(mark, ',' | '.' | '\'' | ' ')
                || mark == decimal
                || (mark == ' ' && separator == Some(Separator::Blanks)))
        {
            return self.bad(
                "file.thousands",
                mark.escape_default(),
                format!(
                    "it is one of \",\" \".\" \"'\" \" \", another than the decimal sign ('{decimal}'), and no blank where blanks separate columns"
                ),
            );
        }
        let encoding = match raw
            .encoding
            .as_deref()
            .map(str::to_ascii_lowercase)
            .as_deref()
        {
            None => None,
            Some("utf-8" | "utf8") => Some(Encoding::Utf8),
            Some("utf-16" | "utf16" | "utf-16le" | "utf-16-le" | "utf16le") => {
                Some(Encoding::Utf16Le)
            }
            Some("utf-16be" | "utf-16-be" | "utf16be") => Some(Encoding::Utf16Be),
            Some("latin1" | "latin-1" | "iso-8859-1" | "iso8859-1" | "windows-1252" | "cp1252") => {
                Some(Encoding::Latin1)
            }
            Some(other) => {
                return self.bad(
                    "file.encoding",
                    other,
                    "it must be utf-8, utf-16 (utf-16le, utf-16be) or latin1; a byte order mark needs none",
                );
            }
        };
        if raw.comment.as_deref().is_some_and(|c| c.trim().is_empty()) {
            return self.bad(
                "file.comment",
                "",
                "it is what comment lines begin with, such as \"#\"",
            );
        }
        let header = raw.header.unwrap_or(true);
        if !header && raw.header_line.is_some() {
            return self.bad(
                "file.header_line",
                raw.header_line.unwrap_or(0),
                "file.header = false says that there is none",
            );
        }
        for (key, line) in [
            ("header_line", raw.header_line),
            ("units_line", raw.units_line),
            ("first_line", raw.first_line),
            ("last_line", raw.last_line),
        ] {
            if line == Some(0) {
                return self.bad(
                    format!("file.{key}"),
                    0,
                    "lines count from 1, as an editor's",
                );
            }
        }
        let first = [raw.header_line, raw.units_line, raw.first_line];
        if let Some(last) = raw.last_line
            && let Some(after) = first.into_iter().flatten().find(|l| *l > last)
        {
            return self.bad(
                "file.last_line",
                last,
                format!("it comes after line {after}"),
            );
        }
        if let (Some(first), Some(before)) = (raw.first_line, raw.header_line.max(raw.units_line))
            && first <= before
        {
            return self.bad(
                "file.first_line",
                first,
                format!("data begin after the names and units on line {before}"),
            );
        }
        Ok(FileMap {
            separator,
            widths: widths.map_or_else(Vec::new, |w| w.iter().map(|w| *w as usize).collect()),
            decimal,
            thousands: raw.thousands,
            encoding,
            comment: raw.comment.as_ref().map(|c| c.trim().to_owned()),
            header,
            header_line: raw.header_line,
            units_line: raw.units_line,
            first_line: raw.first_line,
            last_line: raw.last_line,
        })
    }

    pub(super) fn column(
        &self,
        key: &str,
        raw: RawColumn,
        nth: Option<u32>,
    ) -> Result<Column, MapError> {
        match raw {
            RawColumn::Number(n) if (1..=COLUMNS_MAX).contains(&n) && nth.is_none() => {
                Ok(Column::Number(n as usize))
            }
            RawColumn::Number(n) if nth.is_none() => {
                self.bad(format!("{key}.column"), n, "columns count from 1")
            }
            _ if nth == Some(0) => self.bad(format!("{key}.nth"), 0, "it counts from 1"),
            RawColumn::Name(name) => Ok(Column::Name {
                name: name.trim().to_owned(),
                nth: nth.map(|n| n as usize),
            }),
            RawColumn::Number(n) => self.bad(
                format!("{key}.nth"),
                nth.unwrap_or(0),
                format!("column {n} is a number already; nth is for names that stand there twice"),
            ),
        }
    }

    fn origin(
        &self,
        key: &str,
        column: Option<RawColumn>,
        nth: Option<u32>,
        value: Option<f64>,
    ) -> Result<Origin, MapError> {
        match (column, value) {
            (Some(c), None) => Ok(Origin::Column(self.column(key, c, nth)?)),
            (None, Some(v)) if v.is_finite() => Ok(Origin::Value(v)),
            (None, Some(v)) => self.bad(format!("{key}.value"), v, "it must be finite"),
            (None, None) => self.bad(
                key,
                "without column",
                "give column = \"NAME\" (or its number), or value = .. for what the file does not hold",
            ),
            (Some(_), Some(v)) => self.bad(
                format!("{key}.value"),
                v,
                "a column is given too: one of the two",
            ),
        }
    }

    fn missing(&self, key: &str, raw: Option<&str>) -> Result<Missing, MapError> {
        match raw {
            None | Some("fault") => Ok(Missing::Fault),
            Some("skip") => Ok(Missing::Skip),
            Some("hold") => Ok(Missing::Hold),
            Some(other) => self.bad(
                format!("{key}.missing"),
                other,
                "an empty cell is a fault, or skip (not measured in this row), or hold (the value before)",
            ),
        }
    }

    fn missing_values(
        &self,
        key: &str,
        raw: Option<RawMissing>,
    ) -> Result<MissingValues, MapError> {
        let cells = match raw {
            None => Vec::new(),
            Some(RawMissing::One(one)) => vec![one],
            Some(RawMissing::Each(several)) => several,
        };
        let mut out = MissingValues::default();
        for cell in cells {
            match cell {
                RawCell::Number(v) if v.is_finite() => out.numbers.push(v),
                RawCell::Text(text) if !text.trim().is_empty() => {
                    out.texts.push(text.trim().to_owned());
                }
                RawCell::Number(v) => {
                    return self.bad(
                        format!("{key}.missing_value"),
                        v,
                        "cells with nan or inf are empty without it: missing = \"skip\" is enough",
                    );
                }
                RawCell::Text(text) => {
                    return self.bad(
                        format!("{key}.missing_value"),
                        text,
                        "it is a number or a text; empty cells are empty without it: missing = \"skip\" is enough",
                    );
                }
            }
        }
        Ok(out)
    }

    fn factor(&self, key: &str, sign: Option<f64>, scale: Option<f64>) -> Result<f64, MapError> {
        let (sign, scale) = (sign.unwrap_or(1.0), scale.unwrap_or(1.0));
        if sign.abs() != 1.0 {
            return self.bad(
                format!("{key}.sign"),
                sign,
                "it must be 1 or -1; scale is for other factors",
            );
        }
        if !(scale.is_finite() && scale != 0.0) {
            return self.bad(
                format!("{key}.scale"),
                scale,
                "scale must be finite and not 0",
            );
        }
        Ok(sign * scale)
    }

    fn channel(&self, name: &str, raw: RawChannel) -> Result<ChannelMap, MapError> {
        let key = format!("motion.{name}");
        let Some(place) = (0..PLACES).find(|p| place_name(*p) == name) else {
            let mut all = Channel::ALL.map(Channel::name).to_vec();
            all.extend(COMPANIONS);
            return self.bad(&key, name, format!("channels are {}", all.join(" ")));
        };
        let dimension = dimension(place);
        let text = raw.unit.clone().unwrap_or_default();
        let Some(unit) = unit::find(dimension, &text) else {
            return self.bad(
                format!("{key}.unit"),
                raw.unit.unwrap_or_else(|| "missing".to_owned()),
                format!("it must be one of {}", unit::names(dimension)),
            );
        };
        let in_tank = match raw.frame.as_deref() {
            None | Some("body") => false,
            Some("tank") if (6..9).contains(&place) => true,
            Some(other) => {
                return self.bad(
                    format!("{key}.frame"),
                    other,
                    "velocities u_mps v_mps w_mps are in the \"body\" frame or in the \"tank\" frame; nothing else has the choice",
                );
            }
        };
        let offset = raw.offset.unwrap_or(0.0);
        if raw.sd.is_some_and(|sd| !(sd > 0.0 && sd.is_finite())) || !offset.is_finite() {
            return self.bad(&key, "sd or offset", "sd must be > 0 and both finite");
        }
        Ok(ChannelMap {
            place,
            factor: unit.factor * self.factor(&key, raw.sign, raw.scale)?,
            unit: unit.name,
            origin: self.origin(&key, raw.column, raw.nth, raw.value)?,
            offset,
            sd: raw.sd,
            missing: self.missing(&key, raw.missing.as_deref())?,
            missing_values: self.missing_values(&key, raw.missing_value)?,
            in_tank,
        })
    }

    fn quaternion(&self, raw: RawQuaternion) -> Result<QuaternionMap, MapError> {
        let count = raw.columns.len();
        let columns = raw
            .columns
            .into_iter()
            .map(|c| self.column("quaternion", c, None))
            .collect::<Result<Vec<_>, _>>()?;
        let Ok([a, b, c, d]) = <[Column; 4]>::try_from(columns) else {
            return self.bad(
                "quaternion.columns",
                count,
                "it takes four, in the file's order",
            );
        };
        let wxyz = match raw.order.as_str() {
            "wxyz" => [a, b, c, d],
            "xyzw" => [d, a, b, c],
            other => {
                return self.bad(
                    "quaternion.order",
                    other,
                    "it must be wxyz (scalar first) or xyzw (scalar last)",
                );
            }
        };
        let axes = match raw.axes.as_deref() {
            None | Some("z_down") => Axes::ZDown,
            Some("z_up") => Axes::ZUp,
            Some("y_up") => Axes::YUp,
            Some(other) => {
                return self.bad(
                    "quaternion.axes",
                    other,
                    "it must be z_down (x forward, y to starboard), z_up (x forward, y to port) or y_up (x forward, z to starboard)",
                );
            }
        };
        Ok(QuaternionMap {
            wxyz,
            axes,
            missing: self.missing("quaternion", raw.missing.as_deref())?,
            missing_values: self.missing_values("quaternion", raw.missing_value)?,
        })
    }

    fn command(&self, number: usize, raw: RawCommand) -> Result<CommandMap, MapError> {
        let key = format!("command {number}");
        let moment = matches!(raw.thruster.as_str(), "roll" | "pitch" | "yaw");
        let load = if moment {
            Dimension::Moment
        } else {
            Dimension::Force
        };
        let (unit_factor, pulse) = match raw.unit.as_deref() {
            None => (1.0, false),
            Some(text) => match (unit::find(load, text), unit::find(Dimension::Pulse, text)) {
                (Some(u), _) => (u.factor, false),
                (None, Some(u)) => (u.factor, true),
                (None, None) => {
                    return self.bad(
                        format!("{key}.unit"),
                        text,
                        format!(
                            "it must be one of {}, or {} for a pulse width that the curve of --rig turns into thrust",
                            unit::names(load),
                            unit::names(Dimension::Pulse)
                        ),
                    );
                }
            },
        };
        let offset = raw.offset.unwrap_or(0.0);
        if !offset.is_finite() {
            return self.bad(format!("{key}.offset"), offset, "it must be finite");
        }
        let between = match raw.between.as_deref() {
            None | Some("hold") => Between::Hold,
            Some("linear") => Between::Linear,
            Some(other) => {
                return self.bad(format!("{key}.between"), other, "it must be hold or linear");
            }
        };
        Ok(CommandMap {
            thruster: raw.thruster,
            factor: unit_factor * self.factor(&key, raw.sign, raw.scale)?,
            origin: self.origin(&key, raw.column, raw.nth, raw.value)?,
            offset,
            pulse,
            between,
            missing: self.missing(&key, raw.missing.as_deref())?,
            missing_values: self.missing_values(&key, raw.missing_value)?,
        })
    }
}
