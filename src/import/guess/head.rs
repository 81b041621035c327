//! The first lines of a file.

use std::io::{self, Read};

use crate::map::Encoding;
use crate::source::Source;
use crate::text::{Format, Lines};

const HEAD_BYTES: u64 = 1 << 19;
const LINES_MAX: usize = 3000;

/// The first lines.
#[derive(Debug)]
pub(super) struct Head {
    /// Encoding that the map must state; `None` = none.
    pub encoding: Option<Encoding>,
    /// (number, text)
    pub lines: Vec<(u64, String)>,
}

impl Head {
    pub fn read(source: &(impl Source + ?Sized)) -> io::Result<Head> {
        let mut bytes = Vec::new();
        source.open()?.take(HEAD_BYTES).read_to_end(&mut bytes)?;
        let format = Format::of(&bytes, None);
        let whole = (bytes.len() as u64) < HEAD_BYTES;
        let (mut lines, wrong) = read(&bytes, format)?;
        let mut encoding = match format.encoding {
            // A mark says it by itself.
            _ if format.mark_bytes > 0 => None,
            Encoding::Utf8 => None,
            other => Some(other),
        };
        if wrong && format.encoding == Encoding::Utf8 {
            encoding = Some(Encoding::Latin1);
            lines = read(&bytes, Format::of(&bytes, encoding))?.0;
        }
        // A line cut in the middle is no line.
        if !whole && lines.len() > 1 {
            lines.pop();
        }
        Ok(Head { encoding, lines })
    }

    pub fn line(&self, number: u64) -> &str {
        self.lines
            .iter()
            .find(|l| l.0 == number)
            .map_or("", |l| l.1.as_str())
    }

    /// Text behind a key at the beginning of a line, such as `FREQUENCY<tab>100`.
    pub fn value(&self, key: &str, separator: char) -> Option<&str> {
        self.lines.iter().find_map(|(_, line)| {
            let (own, rest) = line.split_once(separator)?;
            (own.trim() == key).then(|| rest.trim())
        })
    }
}

/// Lines, and whether some are not of the encoding (the last apart, which may be cut).
fn read(bytes: &[u8], format: Format) -> io::Result<(Vec<(u64, String)>, bool)> {
    let mut lines = Lines::new(bytes, format)?;
    let mut out: Vec<(u64, String)> = Vec::new();
    while out.len() < LINES_MAX {
        let Some((number, text)) = lines.next_line()? else {
            break;
        };
        out.push((number, text.to_owned()));
    }
    let last = out.last().map_or(0, |l| l.0);
    let wrong = lines
        .wrong_encoding
        .is_some_and(|l| l < last || lines.complete);
    Ok((out, wrong))
}
