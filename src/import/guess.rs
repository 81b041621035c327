//! A map for a table that nobody described: what is surely known stands in it, what is not stands as a comment.
//!
//! `head` (the first lines) -> `shape` (cells, names, units, data) with what `kinds` knows of instruments and
//! programs -> `stats` (each column in numbers) -> `meaning` (each name) -> `time` and `motion` (the map);
//! `recorded` does the same for logs of other programs, whose messages say what they are.

mod file;
mod head;
mod kinds;
mod meaning;
mod motion;
mod recorded;
mod shape;
mod stats;
mod time;

use std::io;

use crate::check::{Finding, Severity};
use crate::layout::listed;
use crate::map::Map;
use crate::source::Source;
use crate::survey::survey;
pub use recorded::guess_recording;

/// A map, and what is to be said of it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Guess {
    /// The instrument or program that writes such files.
    pub kind: &'static str,
    /// The map.
    pub toml: String,
    /// For the person: what was assumed, and what the table looks like under it.
    pub remarks: Vec<String>,
}

/// Reason why there is no map.
#[derive(Debug, thiserror::Error)]
#[allow(missing_docs)] // Each message names its fields.
pub enum GuessError {
    #[error(
        "no table in its first {lines} lines: no two columns of numbers, whatever the separator; write the map by hand (`hydroline import --help` shows one)"
    )]
    NoTable { lines: usize },
    #[error(
        "no column of time, and no rate: {columns}{hint}; write the map by hand (`hydroline import --help` shows one), with [time] rate_hz = .. for rows at a rate"
    )]
    NoTime { columns: String, hint: String },
    #[error(
        "no column whose name says that it is motion or a command: {columns}{hint}; write the map by hand (`hydroline import --help` shows one)"
    )]
    NoMotion { columns: String, hint: String },
}

/// Lines of the map being drafted, and remarks about it.
#[derive(Debug, Default)]
struct Draft {
    toml: Vec<String>,
    remarks: Vec<String>,
}

impl Draft {
    fn line(&mut self, text: impl Into<String>) {
        self.toml.push(text.into());
    }

    fn finish(self, kind: &'static str) -> Guess {
        Guess {
            kind,
            toml: self.toml.join("\n") + "\n",
            remarks: self.remarks,
        }
    }

    /// A question: a comment in the map, and a remark.
    fn question(&mut self, text: impl Into<String>) {
        let text = text.into();
        self.toml.push(format!("# {text}"));
        self.remarks.push(text);
    }
}

/// Proposes a map for a table.
///
/// # Errors
/// Those of the file.
pub fn guess(source: &(impl Source + ?Sized)) -> io::Result<Result<Guess, GuessError>> {
    let head = head::Head::read(source)?;
    let Some(shape) = kinds::known(&head).or_else(|| shape::plain(&head)) else {
        return Ok(Err(GuessError::NoTable {
            lines: head.lines.len(),
        }));
    };
    let stats = stats::Stats::of(source, &shape.file)?;
    let mut shape = shape;
    shape.complete(&stats);
    let columns = || {
        let names: Vec<&str> = shape.columns.iter().map(|c| c.name.as_str()).collect();
        listed(&names)
    };
    let Some(time) = time::find(&shape, &stats) else {
        return Ok(Err(GuessError::NoTime {
            columns: columns(),
            hint: time::unread(&shape, &stats),
        }));
    };
    let motion = motion::find(&shape, &stats, &time);
    if motion.is_empty() && shape.open.is_empty() {
        return Ok(Err(GuessError::NoMotion {
            columns: columns(),
            hint: time::unread(&shape, &stats),
        }));
    }
    let mut draft = write(&shape, &stats, &time, &motion);
    if motion.is_empty() {
        return Ok(Ok(draft.finish(shape.kind)));
    }
    // The map is tried, and faults are said at once. What the file leaves open is what makes the fewest.
    let mut faults = faults(source, &draft)?;
    let angles = motion.other_angles();
    let open = [
        motion.other_frame(),
        angles.as_ref().and_then(motion::Motion::other_frame),
        angles,
    ];
    for other in open.into_iter().flatten() {
        if faults.1 == 0 {
            break;
        }
        let tried = write(&shape, &stats, &time, &other);
        let found = self::faults(source, &tried)?;
        if found.1 < faults.1 {
            (draft, faults) = (tried, found);
        }
    }
    for (kind, message) in faults.0 {
        draft
            .remarks
            .push(format!("with this map: {kind}: {message}"));
    }
    Ok(Ok(draft.finish(shape.kind)))
}

fn write(
    shape: &shape::Shape,
    stats: &stats::Stats,
    time: &time::Time,
    motion: &motion::Motion,
) -> Draft {
    let mut draft = Draft::default();
    draft.line(format!("# {}", shape.title()));
    draft.remarks.push(shape.title());
    for remark in &shape.remarks {
        draft.question(remark.clone());
    }
    file::write(&shape.file, &mut draft);
    time.write(&mut draft);
    motion.write(shape, stats, &mut draft);
    propose(shape, &mut draft);
    draft
}

/// Proposes, as comments, what unlabelled columns may be: the person knows which.
fn propose(shape: &shape::Shape, draft: &mut Draft) {
    for proposal in &shape.open {
        draft.question(format!(
            "if the message is a {}, without the #:",
            proposal.message
        ));
        for (table, unit, column) in &proposal.tables {
            let lines = table.lines().map(str::to_owned);
            let keys = [format!("column = {column}"), format!("unit = \"{unit}\"")];
            let lines = lines.chain(keys).map(|l| format!("# {l}"));
            draft.toml.extend(lines);
        }
    }
}

/// Faults of an import with the drafted map, (kind, words), and their score: 100 for each, 1 for a rate that may be wrong.
type Faults = (Vec<(&'static str, String)>, usize);

fn faults(source: &(impl Source + ?Sized), draft: &Draft) -> io::Result<Faults> {
    let map = match Map::from_toml(&draft.toml.join("\n"), "guessed map") {
        Ok(map) => map,
        Err(error) => return Ok((vec![("map", error.to_string())], usize::MAX)),
    };
    // A pulse needs a rig, which is not known here.
    let found = survey(source, &map, None)?;
    // Rates that hardly follow the pose are no fault, but not what one looks for either.
    let suspect = |f: &&Finding| f.severity == Severity::Warning && f.kind == "kinematics";
    let questions = found.findings.iter().filter(suspect).count();
    let serious = found
        .findings
        .into_iter()
        .filter(|f| f.severity == Severity::Fault);
    let faults: Vec<(&str, String)> = serious.map(|f| (f.kind, f.message)).collect();
    let bad = 100 * faults.len() + questions;
    Ok((faults, bad))
}
