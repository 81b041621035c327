//! Elements of SVG and HTML, and the one place that escapes.
//!
//! An [`Element`] is written out as it is built. Text and attribute values go in through
//! [`Element::text`] and [`Element::with`], which escape; there is no way to put in a raw string.

use std::borrow::Cow;
use std::fmt::{self, Display, Write as _};

/// Coordinates are written to this part of a unit: a micrometre on a drawing in mm.
const PARTS_PER_UNIT: f64 = 1e3;

/// Text that can stand between tags and inside a quoted attribute, of HTML and of XML 1.0.
///
/// Characters that XML 1.0 does not allow at all (section 2.2: most control characters, U+FFFE,
/// U+FFFF) become U+FFFD, the replacement character.
pub fn escape(text: &str) -> Cow<'_, str> {
    let replaced = |c: char| -> Option<&'static str> {
        Some(match c {
            '&' => "&amp;",
            '<' => "&lt;",
            '>' => "&gt;",
            '"' => "&quot;",
            '\'' => "&#39;",
            '\t' | '\n' | '\r' => return None,
            '\0'..'\u{20}' | '\u{fffe}' | '\u{ffff}' => "\u{fffd}",
            _ => return None,
        })
    };
    if text.chars().all(|c| replaced(c).is_none()) {
        return Cow::Borrowed(text);
    }
    let mut out = String::with_capacity(text.len() + 16);
    for c in text.chars() {
        match replaced(c) {
            Some(entity) => out.push_str(entity),
            None => out.push(c),
        }
    }
    Cow::Owned(out)
}

/// An element with its attributes and what is inside it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Element {
    name: &'static str,
    attributes: String,
    content: String,
    /// May be written `<name/>` while empty: SVG's shapes and HTML's void elements only.
    closes_itself: bool,
    /// No coordinate was NaN or infinite.
    drawable: bool,
}

impl Element {
    /// An element that always has an end tag, as HTML asks of all but the void ones.
    pub fn new(name: &'static str) -> Self {
        Element {
            name,
            attributes: String::new(),
            content: String::new(),
            closes_itself: false,
            drawable: true,
        }
    }

    /// An element that closes itself while it is empty: a shape of SVG, or `br`, `meta` of HTML.
    pub fn closed(name: &'static str) -> Self {
        Element {
            closes_itself: true,
            ..Element::new(name)
        }
    }

    /// Adds an attribute.
    #[must_use]
    pub fn with(mut self, attribute: &'static str, value: impl Display) -> Self {
        // Writing to a String cannot fail.
        let _ = write!(
            self.attributes,
            " {attribute}=\"{}\"",
            escape(&value.to_string())
        );
        self
    }

    /// Adds the attribute `class`, before all others.
    #[must_use]
    pub fn class(mut self, name: &str) -> Self {
        self.attributes = format!(" class=\"{}\"{}", escape(name), self.attributes);
        self
    }

    /// Adds a coordinate or length, rounded to a thousandth. An element that was given NaN or an
    /// infinity is left out by the element it is put into: no renderer could place it.
    #[must_use]
    pub fn number(mut self, attribute: &'static str, value: f64) -> Self {
        self.drawable &= value.is_finite();
        let rounded = rounded(value);
        self.with(attribute, rounded)
    }

    /// Adds text.
    #[must_use]
    pub fn text(mut self, words: &str) -> Self {
        self.content.push_str(&escape(words));
        self
    }

    /// Adds an element inside this one, unless it cannot be drawn.
    #[must_use]
    pub fn child(mut self, inner: Element) -> Self {
        self.push(inner);
        self
    }

    /// Adds an element on a line of its own.
    #[must_use]
    pub fn child_line(mut self, inner: Element) -> Self {
        self.push_line(inner);
        self
    }

    /// As [`Element::child`], in place.
    pub fn push(&mut self, inner: Element) {
        if inner.drawable {
            let _ = write!(self.content, "{inner}");
        }
    }

    /// As [`Element::child_line`], in place.
    pub fn push_line(&mut self, inner: Element) {
        if inner.drawable {
            if self.content.is_empty() {
                self.content.push('\n');
            }
            let _ = writeln!(self.content, "{inner}");
        }
    }
}

impl Display for Element {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Element {
            name,
            attributes,
            content,
            ..
        } = self;
        if self.closes_itself && content.is_empty() {
            write!(f, "<{name}{attributes}/>")
        } else {
            write!(f, "<{name}{attributes}>{content}</{name}>")
        }
    }
}

/// A coordinate as it is written: to a thousandth, without a negative zero.
pub(crate) fn rounded(value: f64) -> f64 {
    (value * PARTS_PER_UNIT).round() / PARTS_PER_UNIT + 0.0
}

#[cfg(test)]
pub(crate) mod tests;
