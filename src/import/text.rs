//! Lines of a table as an editor counts them, whatever their encoding.

mod decode;

use std::io::{self, BufRead, BufReader, Read};

use crate::map::Encoding;
pub(crate) use decode::Decoder;

/// No line of a table is longer: it is another file.
const LINE_BYTES_MAX: u64 = 4 << 20;

/// Encoding and line end of a file, by its first bytes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Format {
    pub encoding: Encoding,
    /// Bytes of the byte order mark.
    pub mark_bytes: usize,
    pub line_end: u8,
}

impl Format {
    /// From the first bytes; `stated` by the map is overruled by a byte order mark only.
    pub fn of(head: &[u8], stated: Option<Encoding>) -> Format {
        let marked = match head {
            [0xEF, 0xBB, 0xBF, ..] => Some((Encoding::Utf8, 3)),
            [0xFF, 0xFE, ..] => Some((Encoding::Utf16Le, 2)),
            [0xFE, 0xFF, ..] => Some((Encoding::Utf16Be, 2)),
            _ => None,
        };
        let (encoding, mark_bytes) = marked.unwrap_or_else(|| {
            // ASCII in UTF-16 has a zero in every other byte.
            let zeros = |from: usize| {
                let bytes = head.iter().skip(from).step_by(2).take(200);
                let (all, zero) = bytes.fold((0, 0), |(n, z), b| (n + 1, z + usize::from(*b == 0)));
                all >= 4 && 10 * zero > 9 * all
            };
            let guessed = match (zeros(0), zeros(1)) {
                (false, true) => Encoding::Utf16Le,
                (true, false) => Encoding::Utf16Be,
                _ => Encoding::Utf8,
            };
            (stated.unwrap_or(guessed), 0)
        });
        // Old Macintosh files end lines with CR alone.
        let line_end = if head.contains(&b'\r') && !head.contains(&b'\n') {
            b'\r'
        } else {
            b'\n'
        };
        Format {
            encoding,
            mark_bytes,
            line_end,
        }
    }
}

pub(crate) struct Lines<R> {
    reader: BufReader<Decoder<R>>,
    line_end: u8,
    buffer: Vec<u8>,
    replaced: String,
    number: u64,
    /// First line that is not of the encoding.
    pub wrong_encoding: Option<u64>,
    /// Whether the last line read had an end.
    pub complete: bool,
    /// A line longer than any: reading stopped there.
    pub endless: bool,
}

impl<R: Read> Lines<R> {
    pub fn new(mut source: R, format: Format) -> io::Result<Self> {
        let mut mark = [0; 3];
        source.read_exact(&mut mark[..format.mark_bytes])?;
        Ok(Lines {
            reader: BufReader::with_capacity(1 << 16, Decoder::new(source, format.encoding)),
            line_end: format.line_end,
            buffer: Vec::new(),
            replaced: String::new(),
            number: 0,
            wrong_encoding: None,
            complete: true,
            endless: false,
        })
    }

    /// The next line without its end, and its number from 1.
    pub fn next_line(&mut self) -> io::Result<Option<(u64, &str)>> {
        self.buffer.clear();
        let mut bounded = (&mut self.reader).take(LINE_BYTES_MAX);
        let read = bounded.read_until(self.line_end, &mut self.buffer)?;
        if read == 0 {
            return Ok(None);
        }
        self.number += 1;
        self.complete = self.buffer.last() == Some(&self.line_end);
        if !self.complete && read as u64 == LINE_BYTES_MAX {
            self.endless = true;
            return Ok(None);
        }
        while matches!(self.buffer.last(), Some(b'\n' | b'\r')) {
            self.buffer.pop();
        }
        match std::str::from_utf8(&self.buffer) {
            Ok(text) => Ok(Some((self.number, text))),
            Err(_) => {
                self.wrong_encoding.get_or_insert(self.number);
                self.replaced = String::from_utf8_lossy(&self.buffer).into_owned();
                Ok(Some((self.number, &self.replaced)))
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn lines(bytes: &[u8], stated: Option<Encoding>) -> Vec<(u64, String)> {
        let mut lines = Lines::new(bytes, Format::of(bytes, stated)).unwrap();
        let mut out = Vec::new();
        while let Some((n, text)) = lines.next_line().unwrap() {
            out.push((n, text.to_owned()));
        }
        out
    }

    fn utf16(text: &str, little: bool) -> Vec<u8> {
        text.encode_utf16()
            .flat_map(|u| {
                if little {
                    u.to_le_bytes()
                } else {
                    u.to_be_bytes()
                }
            })
            .collect()
    }

    #[test]
    fn lines_are_the_editors() {
        let found = lines(b"a\r\n\r\nb\n\nc", None);
        let expected = [(1, "a"), (2, ""), (3, "b"), (4, ""), (5, "c")];
        assert_eq!(found, expected.map(|(n, t)| (n, t.to_owned())));
        assert_eq!(lines(b"a\rb\r", None).len(), 2);
    }

    #[test]
    fn encodings_are_known_by_their_mark_or_by_the_map() {
        let text = "t;Winkel [°]\n1;2\n";
        let expected: Vec<(u64, String)> = vec![(1, "t;Winkel [°]".into()), (2, "1;2".into())];
        for little in [true, false] {
            let plain = utf16(text, little);
            let marked = utf16(&format!("\u{feff}{text}"), little);
            assert_eq!(lines(&plain, None), expected);
            assert_eq!(lines(&marked, None), expected);
        }
        let marked = format!("\u{feff}{text}");
        assert_eq!(lines(marked.as_bytes(), None), expected);
        let latin: Vec<u8> = text.chars().map(|c| c as u32 as u8).collect();
        assert_eq!(lines(&latin, Some(Encoding::Latin1)), expected);
        let mut wrong = Lines::new(&latin[..], Format::of(&latin, None)).unwrap();
        while wrong.next_line().unwrap().is_some() {}
        assert_eq!(wrong.wrong_encoding, Some(1));
    }

    proptest! {
        #[test]
        fn any_text_comes_back_from_any_encoding(text in "\\PC{0,60}(\n\\PC{0,60}){0,9}", little: bool) {
            // The mark tells the encoding; without one a text may look like another.
            let expected: Vec<String> = text.lines().map(str::to_owned).collect();
            let bytes = utf16(&format!("\u{feff}{text}"), little);
            let found: Vec<String> = lines(&bytes, None).into_iter().map(|l| l.1).collect();
            prop_assert_eq!(found, expected);
        }

        #[test]
        fn any_bytes_are_read_without_a_panic(bytes in proptest::collection::vec(any::<u8>(), 0..300)) {
            for stated in [None, Some(Encoding::Latin1), Some(Encoding::Utf16Be)] {
                lines(&bytes, stated);
            }
        }
    }
}
