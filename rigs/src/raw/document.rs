//! A TOML text with its name and the list of what is wrong with it.

use std::cell::RefCell;
use std::io::ErrorKind;
use std::ops::Range;
use std::path::Path;

use toml::de::DeTable;

use super::{Includes, Section};
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

/// Everything found wrong so far, and where included files are.
#[derive(Default)]
pub(crate) struct Problems {
    found: RefCell<Vec<Problem>>,
    pub(super) includes: Includes,
}

impl Problems {
    /// None yet, of a file that may include others.
    pub(crate) fn with_includes(includes: Includes) -> Problems {
        Problems {
            includes,
            ..Problems::default()
        }
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
            let what = "the file is incomplete".to_owned();
            problems.push(of_file(file, what, "Compare it with `hydroline rig new`"));
        }
        // The main file first, then what it includes; in each by line.
        problems.sort_by_key(|p| {
            let included = (p.file != file).then(|| p.file.clone());
            (included, p.line.unwrap_or(usize::MAX))
        });
        problems.dedup();
        if problems.len() > MOST_PROBLEMS {
            let more = problems.len() - MOST_PROBLEMS;
            problems.truncate(MOST_PROBLEMS);
            let next = "Put the first ones right, or check that this is the right file";
            let what = format!("{more} more problems are not listed");
            problems.push(of_file(file, what, next));
        }
        Err(RigError::Invalid { problems })
    }
}

fn of_file(file: &str, what: String, next: &str) -> Problem {
    let next = next.to_owned();
    Problem {
        file: file.to_owned(),
        line: None,
        key: String::new(),
        kind: ProblemKind::Rule { what, next },
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
        let bytes = text.len();
        let what =
            format!("{bytes} bytes are more than a configuration file has ({LARGEST_FILE_BYTES})");
        let problem = of_file(file, what, "Check that this is the right file");
        problems.found.borrow_mut().push(problem);
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
