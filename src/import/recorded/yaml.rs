//! YAML of `metadata.yaml` of bags, by `saphyr-parser`: its events as a tree of texts, lists and mappings.
//!
//! Tags mean nothing here, and an alias is not followed; both would let a short file cost much.

use std::cell::Cell;

use saphyr_parser::{BufferedInput, Event, Parser};

/// Nesting beyond which a file is no account of a bag.
const DEPTH_MAX: usize = 32;
/// Most characters that are read for one event. What is all in brackets is read to its end first, at up to 200 B a character.
const AHEAD_MAX: usize = 1 << 20;

#[derive(Debug, Clone, PartialEq)]
pub(super) enum Yaml {
    Text(String),
    List(Vec<Yaml>),
    Map(Vec<(String, Yaml)>),
}

impl Yaml {
    pub fn get(&self, key: &str) -> Option<&Yaml> {
        match self {
            Yaml::Map(entries) => entries.iter().find(|e| e.0 == key).map(|e| &e.1),
            _ => None,
        }
    }

    pub fn text(&self) -> Option<&str> {
        match self {
            Yaml::Text(text) => Some(text),
            _ => None,
        }
    }

    /// Its elements; of what is no list none.
    pub fn list(&self) -> &[Yaml] {
        match self {
            Yaml::List(list) => list,
            _ => &[],
        }
    }

    pub fn count(&self) -> Option<u64> {
        self.text()?.parse().ok()
    }

    /// Reads a text.
    ///
    /// # Errors
    /// Fault, and the line in which it shows.
    pub fn parse(text: &str) -> Result<Yaml, String> {
        // Its prefix is copied for each tag that uses it.
        if text.contains("%TAG") {
            return Err("it has a '%TAG', which no account of a bag needs".to_owned());
        }
        let read = Cell::new(0);
        let chars = text.chars().take_while(|_| {
            read.set(read.get() + 1);
            read.get() <= AHEAD_MAX
        });
        let mut reader = Reader {
            parser: Parser::new_from_iter(chars),
            read: &read,
            line: 1,
        };
        let mut node = None;
        loop {
            match (reader.event()?, &node) {
                (Event::StreamEnd, _) => return Ok(node.unwrap_or(Yaml::Text(String::new()))),
                (Event::StreamStart | Event::DocumentStart(_) | Event::DocumentEnd, _) => {}
                (event, None) => node = Some(reader.node(event, 0)?),
                (_, Some(_)) => return Err(reader.wrong("a second document begins")),
            }
        }
    }
}

struct Reader<'a, I: Iterator<Item = char>> {
    parser: Parser<'a, BufferedInput<I>>,
    /// Characters that were read since the last event.
    read: &'a Cell<usize>,
    /// Line of the last event.
    line: usize,
}

impl<'a, I: Iterator<Item = char>> Reader<'a, I> {
    fn wrong(&self, what: &str) -> String {
        format!("line {}: {what}", self.line)
    }

    fn event(&mut self) -> Result<Event<'a>, String> {
        let event = self.parser.next_event();
        if self.read.replace(0) > AHEAD_MAX {
            return Err(self.wrong("what follows is too long"));
        }
        match event {
            Some(Ok((event, span))) => {
                self.line = span.start.line();
                Ok(event)
            }
            Some(Err(error)) => {
                self.line = error.marker().line();
                Err(self.wrong(error.info()))
            }
            None => Err(self.wrong("the text ends too soon")),
        }
    }

    /// The value that begins with this event.
    fn node(&mut self, event: Event<'a>, depth: usize) -> Result<Yaml, String> {
        if depth > DEPTH_MAX {
            return Err(self.wrong("is nested too deep"));
        }
        match event {
            Event::Scalar(text, ..) => Ok(Yaml::Text(text.into_owned())),
            Event::SequenceStart(..) => {
                let mut list = Vec::new();
                loop {
                    match self.event()? {
                        Event::SequenceEnd => return Ok(Yaml::List(list)),
                        event => list.push(self.node(event, depth + 1)?),
                    }
                }
            }
            Event::MappingStart(..) => {
                let mut entries = Vec::new();
                loop {
                    let key = match self.event()? {
                        Event::MappingEnd => return Ok(Yaml::Map(entries)),
                        event => self.node(event, depth + 1)?,
                    };
                    let event = self.event()?;
                    let value = self.node(event, depth + 1)?;
                    if let Yaml::Text(key) = key {
                        entries.push((key, value));
                    }
                }
            }
            // Writers use it for lists and mappings only.
            Event::Alias(_) => Ok(Yaml::List(Vec::new())),
            _ => Err(self.wrong("a value is missing")),
        }
    }
}

#[cfg(test)]
mod tests;
