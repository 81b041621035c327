//! Types of the fields in ArduPilot's binary logs.

/// Type of a field, as a format names it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Letter {
    /// Its name.
    pub letter: u8,
    /// Number that it holds (`u8`, `i16`, `f32` ..), or `text`.
    pub value: &'static str,
    /// Elements of an array, or bytes of a text; `None` = one number.
    pub elements: Option<usize>,
    /// Worth of one count.
    pub scale: f64,
}

const fn number(letter: u8, value: &'static str, scale: f64) -> Letter {
    Letter {
        letter,
        value,
        elements: None,
        scale,
    }
}

const fn several(letter: u8, value: &'static str, elements: usize) -> Letter {
    Letter {
        letter,
        value,
        elements: Some(elements),
        scale: 1.0,
    }
}

/// All letters, as ArduPilot's `LogStructure.h` has them.
static LETTERS: [Letter; 21] = [
    several(b'a', "i16", 32),
    number(b'b', "i8", 1.0),
    number(b'B', "u8", 1.0),
    number(b'M', "u8", 1.0),
    number(b'g', "f16", 1.0),
    number(b'h', "i16", 1.0),
    number(b'H', "u16", 1.0),
    number(b'i', "i32", 1.0),
    number(b'I', "u32", 1.0),
    number(b'f', "f32", 1.0),
    number(b'd', "f64", 1.0),
    several(b'n', "text", 4),
    several(b'N', "text", 16),
    several(b'Z', "text", 64),
    number(b'c', "i16", 0.01),
    number(b'C', "u16", 0.01),
    number(b'e', "i32", 0.01),
    number(b'E', "u32", 0.01),
    number(b'L', "i32", 1.0e-7),
    number(b'q', "i64", 1.0),
    number(b'Q', "u64", 1.0),
];

/// The type of a letter; `None` = there is none.
pub fn letter(letter: u8) -> Option<&'static Letter> {
    LETTERS.iter().find(|own| own.letter == letter)
}

/// The letters of all types.
pub fn letters() -> impl Iterator<Item = u8> {
    LETTERS.iter().map(|own| own.letter)
}
