//! Kinds of single keys: numbers, lists of them, words, texts and flags.

use std::fmt::{Debug, Display};

use super::section::{Item, as_i64};
use super::{Described, Kind, Quantity, Section, Writer};
use crate::error::{ProblemKind, nearest};

/// The reference's columns on a key.
#[derive(Clone)]
pub(crate) struct Columns {
    /// Type, in words.
    pub(crate) kind: String,
    pub(crate) unit: &'static str,
    /// Allowed values.
    pub(crate) allowed: String,
}

impl Columns {
    fn of_range(kind: impl Into<String>, range: &Quantity) -> Columns {
        Columns {
            kind: kind.into(),
            unit: range.unit(),
            allowed: range.interval(),
        }
    }
}

type Read<V> = Box<dyn for<'d> Fn(&Section<'d>, &Item<'d>) -> Option<V>>;
type Put<V> = Box<dyn Fn(&mut Writer, &str, &V)>;

/// A kind whose value is that of one key.
pub(crate) struct One<V> {
    /// The value as a person would begin to type it, `…` or `[…]`; empty = `expected` says it all.
    form: &'static str,
    expected: String,
    columns: Columns,
    read: Read<V>,
    put: Put<V>,
}

impl<V> Kind for One<V> {
    type Value = V;

    fn typed(&self, s: &Section<'_>, key: &str) -> Option<Option<V>> {
        match s.item(key) {
            Some(item) => (self.read)(s, &item).map(Some),
            None => Some(None),
        }
    }

    fn left_out(&self, s: &Section<'_>, key: &str) -> Option<V> {
        s.missing(key, self.to_add(key));
        None
    }

    fn write(&self, w: &mut Writer, key: &str, value: &V) {
        (self.put)(w, key, value);
    }

    fn describe(&self, to: &mut Described<'_>, key: &str, about: &'static str) {
        to.key(vec![key.to_owned()], self.columns.clone(), about);
    }
}

impl<V> One<V> {
    /// Advice for a missing key: a line to add, or the expected content.
    fn to_add(&self, key: &str) -> String {
        match self.form {
            "" => self.expected.clone(),
            form => format!("`{key} = {form}`, {}", self.expected),
        }
    }
}

/// A kind of its own: a text under `kind` and `allowed` in the reference.
pub(crate) fn one<V>(
    form: &'static str,
    expected: &str,
    [kind, allowed]: [&str; 2],
    read: impl for<'d> Fn(&Section<'d>, &Item<'d>) -> Option<V> + 'static,
    put: impl Fn(&mut Writer, &str, &V) + 'static,
) -> One<V> {
    One {
        form,
        expected: expected.to_owned(),
        columns: Columns {
            kind: kind.to_owned(),
            unit: "",
            allowed: allowed.to_owned(),
        },
        read: Box::new(read),
        put: Box::new(put),
    }
}

/// Numbers in some order, each in a range; `kind` is their name in the reference.
pub(crate) fn ordered<V: Debug>(
    each: Quantity,
    kind: impl Into<String>,
    form: &'static str,
    expected: impl Into<String>,
    read: impl for<'d> Fn(&Section<'d>, &Item<'d>) -> Option<V> + 'static,
) -> One<V> {
    One {
        form,
        expected: expected.into(),
        columns: Columns::of_range(kind, &each),
        read: Box::new(read),
        put: Box::new(|w, key, value| w.debug(key, value)),
    }
}

impl Quantity {
    fn one(self) -> One<f64> {
        ordered(self, "number", "…", self.to_string(), move |s, item| {
            s.number_of(item, &self)
        })
    }
}

impl Kind for Quantity {
    type Value = f64;

    fn typed(&self, s: &Section<'_>, key: &str) -> Option<Option<f64>> {
        self.one().typed(s, key)
    }

    fn left_out(&self, s: &Section<'_>, key: &str) -> Option<f64> {
        self.one().left_out(s, key)
    }

    fn write(&self, w: &mut Writer, key: &str, value: &f64) {
        w.debug(key, value);
    }

    fn describe(&self, to: &mut Described<'_>, key: &str, about: &'static str) {
        self.one().describe(to, key, about);
    }
}

pub(crate) fn numbers<const N: usize>(each: Quantity) -> One<[f64; N]> {
    let expected = format!("a list of {N} numbers, each {each}");
    ordered(
        each,
        format!("{N} numbers"),
        "[…]",
        expected,
        move |s, item| s.numbers_of(item, &each),
    )
}

/// `[low, high]` with low below high; `meaning` = what to add when it is missing.
pub(crate) fn interval(each: Quantity, meaning: &'static str) -> One<[f64; 2]> {
    ordered(each, "2 numbers", "[from, to]", meaning, move |s, item| {
        let [low, high] = s.numbers_of(item, &each)?;
        if low < high {
            return Some([low, high]);
        }
        s.rule_at(
            item,
            format!("[{low}, {high}] is not an interval"),
            "Enter [lowest, highest] with the lowest first",
        );
        None
    })
}

pub(crate) fn list(each: Quantity, expected: &'static str) -> One<Vec<f64>> {
    ordered(each, "numbers", "", expected, move |s, item| {
        let cells = s.elements(item, expected)?;
        cells.iter().map(|c| s.number_of(c, &each)).collect()
    })
}

pub(crate) fn rows(each: Quantity, expected: &'static str) -> One<Vec<Vec<f64>>> {
    let row = list(each, expected);
    ordered(each, "rows of numbers", "", expected, move |s, item| {
        let rows = s.elements(item, expected)?;
        rows.iter().map(|r| (row.read)(s, r)).collect()
    })
}

/// A whole number, `min <= value <= max`, in `unit` (empty for a pure number); `max` must fit into `T`.
pub(crate) fn whole<T: TryFrom<i64> + Display>(min: i64, max: i64, unit: &'static str) -> One<T> {
    let expected = format!("a whole number from {min} to {max} {unit}");
    let expected = expected.trim_end().to_owned();
    let range = match max {
        i64::MAX => format!("from {min}"),
        _ => format!("{min} to {max}"),
    };
    One {
        form: "…",
        columns: Columns {
            kind: "whole number".to_owned(),
            unit,
            allowed: range,
        },
        expected: expected.clone(),
        read: Box::new(move |s, item| {
            let Some(value) = as_i64(item.value) else {
                s.wrong_type(item, &*expected);
                return None;
            };
            let inside = (min..=max).contains(&value);
            let held = T::try_from(value).ok().filter(|_| inside);
            if held.is_none() {
                let kind = ProblemKind::OutOfRange {
                    typed: s.typed(item),
                    allowed: expected.clone(),
                    hint: String::new(),
                };
                s.report(item, kind);
            }
            held
        }),
        put: Box::new(|w, key, value| w.raw(key, value)),
    }
}

pub(crate) fn flag() -> One<bool> {
    const EXPECTED: &str = "true or false";
    let read = |s: &Section<'_>, item: &Item<'_>| {
        let value = item.value.as_bool();
        if value.is_none() {
            s.wrong_type(item, EXPECTED);
        }
        value
    };
    one("…", EXPECTED, [EXPECTED, ""], read, |w, key, value| {
        w.raw(key, value)
    })
}

/// One of a list of words.
pub(crate) fn words<T: Clone + PartialEq + 'static>(
    words: impl IntoIterator<Item = (&'static str, T)>,
) -> One<T> {
    let words: Vec<(&'static str, T)> = words.into_iter().collect();
    let written = words.clone();
    let quoted: Vec<String> = words.iter().map(|(w, _)| format!("\"{w}\"")).collect();
    let marked: Vec<String> = quoted.iter().map(|w| format!("`{w}`")).collect();
    let expected = format!("one of {}", quoted.join(", "));
    let read = move |s: &Section<'_>, item: &Item<'_>| {
        let typed = item.value.as_str();
        let found = words.iter().find(|(word, _)| Some(*word) == typed);
        if found.is_none() {
            let kind = ProblemKind::NotOneOf {
                typed: s.typed(item),
                allowed: quoted.clone(),
                suggestion: typed.and_then(|t| nearest(t, words.iter().map(|(word, _)| *word))),
            };
            s.report(item, kind);
        }
        found.map(|(_, value)| value.clone())
    };
    let put = move |w: &mut Writer, key: &str, value: &T| {
        if let Some((word, _)) = written.iter().find(|(_, known)| known == value) {
            w.text(key, word);
        }
    };
    one("…", &expected, ["text", &marked.join(", ")], read, put)
}

/// A text that is `sound`; `expected` says what that is.
pub(crate) fn text(expected: &'static str, sound: fn(&str) -> bool) -> One<String> {
    let read = move |s: &Section<'_>, item: &Item<'_>| {
        let text = item.value.as_str().filter(|text| sound(text));
        if text.is_none() {
            s.wrong_type(item, expected);
        }
        text.map(str::to_owned)
    };
    one(
        "\"…\"",
        expected,
        ["text", expected],
        read,
        |w, key, value| {
            w.text(key, value);
        },
    )
}

/// A name: it ends up in file names, topics and tables, so no blanks or slashes.
pub(crate) fn name() -> One<String> {
    text(
        "a name of 1 to 64 letters, digits, `_`, `-` or `.`, starting with a letter or digit",
        is_name,
    )
}

pub(crate) fn is_name(text: &str) -> bool {
    let plain = |c: char| c.is_ascii_alphanumeric() || matches!(c, '_' | '-' | '.');
    text.len() <= 64
        && text.chars().all(plain)
        && text.starts_with(|c: char| c.is_ascii_alphanumeric())
}

/// An angle or a list of them, under a key that ends in `_deg` or in `_rad`; the range in degrees, the value in radians.
pub(crate) struct Angle<V> {
    of_range: fn(Quantity) -> One<V>,
    to_radians: fn(V) -> V,
    range_deg: Quantity,
}

pub(crate) const fn angle(range_deg: Quantity) -> Angle<f64> {
    Angle {
        of_range: Quantity::one,
        to_radians: f64::to_radians,
        range_deg,
    }
}

pub(crate) const fn angles<const N: usize>(range_deg: Quantity) -> Angle<[f64; N]> {
    Angle {
        of_range: numbers,
        to_radians: |angles| angles.map(f64::to_radians),
        range_deg,
    }
}

impl Angle<f64> {
    /// Is this when it is left out.
    pub(crate) fn or_deg(self, default_deg: f64) -> super::table::Or<Self> {
        self.or_said(default_deg.to_radians(), &default_deg.to_string())
    }
}

/// `key`, which ends in `_rad`, in degrees.
fn in_degrees(key: &str) -> String {
    format!("{}_deg", key.strip_suffix("_rad").unwrap_or(key))
}

/// A key and, of an angle, the same in degrees.
pub(crate) fn spellings(key: &str) -> impl Iterator<Item = String> {
    let degrees = key.ends_with("_rad").then(|| in_degrees(key));
    [key.to_owned()].into_iter().chain(degrees)
}

impl<V> Kind for Angle<V> {
    type Value = V;

    fn typed(&self, s: &Section<'_>, rad_key: &str) -> Option<Option<V>> {
        let deg_key = in_degrees(rad_key);
        match (s.item(rad_key), s.item(&deg_key)) {
            (Some(_), Some(deg)) => {
                s.rule_at(
                    &deg,
                    format!("{rad_key} and {deg_key} are both given"),
                    "Keep one of the two",
                );
                None
            }
            (Some(_), None) => (self.of_range)(self.range_deg.deg_to_rad()).typed(s, rad_key),
            (None, _) => {
                let degrees = (self.of_range)(self.range_deg).typed(s, &deg_key)?;
                Some(degrees.map(self.to_radians))
            }
        }
    }

    fn left_out(&self, s: &Section<'_>, rad_key: &str) -> Option<V> {
        let deg_key = in_degrees(rad_key);
        let add = (self.of_range)(self.range_deg).to_add(&deg_key);
        s.missing(&deg_key, format!("{add} (or `{rad_key}`)"));
        None
    }

    fn write(&self, w: &mut Writer, rad_key: &str, value: &V) {
        (self.of_range)(self.range_deg).write(w, rad_key, value);
    }

    fn describe(&self, to: &mut Described<'_>, rad_key: &str, about: &'static str) {
        let names = vec![in_degrees(rad_key), rad_key.to_owned()];
        to.key(names, (self.of_range)(self.range_deg).columns, about);
    }
}
