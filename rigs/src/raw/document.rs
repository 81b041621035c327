//! A TOML text with its name and the list of what is wrong with it.

use std::cell::RefCell;
use std::io::ErrorKind;
use std::ops::Range;
use std::path::Path;

use toml::de::DeTable;

use super::Asked;
use super::Section;
use crate::bounded;
use crate::error::{Problem, ProblemKind, RigError};

/// Configuration files are a few kilobytes; anything much larger is the wrong file
/// (a log, a device node) and must not be read into memory.
const LARGEST_FILE_BYTES: u64 = bounded::CONFIG_BYTES;

/// Problems that are listed; whoever has more has the wrong file.
const MOST_PROBLEMS: usize = 200;

/// A text and the name it goes by in messages.
pub(crate) struct Document<'d> {
    pub(crate) file: &'d str,
    text: &'d str,
    /// Offsets of the line ends.
    line_ends: Vec<usize>,
}

impl<'d> Document<'d> {
    pub(crate) fn new(file: &'d str, text: &'d str) -> Self {
        let line_ends = text.match_indices('\n').map(|(i, _)| i).collect();
        Document {
            file,
            text,
            line_ends,
        }
    }

    /// Line of a byte offset, counted from 1.
    pub(crate) fn line(&self, offset: usize) -> usize {
        1 + self.line_ends.partition_point(|end| *end < offset)
    }

    /// The text of a span as a person typed it, cut to a readable length.
    pub(crate) fn typed(&self, span: Range<usize>) -> String {
        const LONGEST: usize = 60;
        let text = self.text.get(span).unwrap_or("").trim();
        let mut short: String = text
            .chars()
            .take(LONGEST)
            .map(|c| if c.is_control() { ' ' } else { c })
            .collect();
        if text.chars().count() > LONGEST {
            short.push('…');
        }
        if short.is_empty() {
            short.push_str("empty");
        }
        short
    }
}

/// Everything found wrong so far.
#[derive(Default)]
pub(crate) struct Problems {
    found: RefCell<Vec<Problem>>,
    /// Which keys were asked for, where somebody wants to know.
    asked: Option<RefCell<Vec<Asked>>>,
}

impl Problems {
    /// One that also notes which keys are asked for.
    pub(crate) fn listening() -> Problems {
        Problems {
            asked: Some(RefCell::default()),
            ..Problems::default()
        }
    }

    pub(super) fn asked(&self) -> Option<&RefCell<Vec<Asked>>> {
        self.asked.as_ref()
    }

    /// Which keys were asked for.
    pub(crate) fn into_asked(self) -> Vec<Asked> {
        self.asked.map(RefCell::into_inner).unwrap_or_default()
    }

    pub(crate) fn push(&self, file: &str, line: Option<usize>, key: String, kind: ProblemKind) {
        self.found.borrow_mut().push(Problem {
            file: file.to_owned(),
            line,
            key,
            kind,
        });
    }

    /// The value, if nothing at all was wrong; otherwise every problem, by line.
    pub(crate) fn finish<T>(self, file: &str, value: Option<T>) -> Result<T, RigError> {
        let mut problems = self.found.into_inner();
        if problems.is_empty() {
            if let Some(value) = value {
                return Ok(value);
            }
            // A reader gave up without a word: still an error with a name.
            problems.push(Problem {
                file: file.to_owned(),
                line: None,
                key: String::new(),
                kind: ProblemKind::Rule {
                    what: "the file is incomplete".to_owned(),
                    next: "Compare it with `hydroline rig new`".to_owned(),
                },
            });
        }
        // The main file first, then what it includes; in each by line.
        problems.sort_by_key(|p| {
            let included = p.file != file;
            (
                included,
                if included {
                    p.file.clone()
                } else {
                    String::new()
                },
                p.line.unwrap_or(usize::MAX),
            )
        });
        problems.dedup();
        if problems.len() > MOST_PROBLEMS {
            let more = problems.len() - MOST_PROBLEMS;
            problems.truncate(MOST_PROBLEMS);
            problems.push(Problem {
                file: file.to_owned(),
                line: None,
                key: String::new(),
                kind: ProblemKind::Rule {
                    what: format!("{more} more problems are not listed"),
                    next: "Put the first ones right, or check that this is the right file"
                        .to_owned(),
                },
            });
        }
        Err(RigError::Invalid { problems })
    }
}

/// Parses `text` and hands its root table to `read`. Syntax errors are all
/// reported, and end the matter: what recovery makes of broken text would only
/// produce misleading complaints.
pub(crate) fn read_document<T>(
    file: &str,
    text: &str,
    problems: &Problems,
    read: impl FnOnce(&Section<'_>) -> Option<T>,
) -> Option<T> {
    if text.len() as u64 > LARGEST_FILE_BYTES {
        problems.push(
            file,
            None,
            String::new(),
            ProblemKind::Rule {
                what: format!(
                    "{} bytes are more than a configuration file has ({LARGEST_FILE_BYTES})",
                    text.len()
                ),
                next: "Check that this is the right file".to_owned(),
            },
        );
        return None;
    }
    let document = Document::new(file, text);
    let (root, errors) = DeTable::parse_recoverable(text);
    for error in &errors {
        problems.push(
            file,
            error.span().map(|span| document.line(span.start)),
            String::new(),
            ProblemKind::Syntax {
                message: error.message().replace('\n', " "),
            },
        );
    }
    if !errors.is_empty() {
        return None;
    }
    let section = Section::root(&document, root.get_ref(), problems);
    let value = read(&section);
    section.finish();
    value
}

/// Reads a configuration file as text.
///
/// # Errors
/// [`RigError::Unreadable`] when it is missing, larger than 1 MiB or not UTF-8.
pub(crate) fn read_text(path: &Path) -> Result<String, RigError> {
    let unreadable = |reason: String, next: &str| RigError::Unreadable {
        file: path.display().to_string(),
        reason,
        next: next.to_owned(),
    };
    bounded::read_text(path, LARGEST_FILE_BYTES).map_err(|e| {
        let next = match e.kind() {
            ErrorKind::FileTooLarge | ErrorKind::InvalidData => {
                "Give a rig, target, board or plan file: a short TOML text in UTF-8"
            }
            _ => "Check the path and its permissions",
        };
        unreadable(e.to_string(), next)
    })
}
