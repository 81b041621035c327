//! The one writer per stream: results on stdout, diagnostics on stderr. Neither panics; what stdout does not take is
//! a failed run.
//!
//! A reader that has seen enough (`| head`) ends the output and nothing else. Any other failure, a full disk above
//! all, is said once on stderr, and [`finish`] makes the command fail: a result that is cut off is none. When stderr
//! itself cannot be written there is nobody left to tell, and the work goes on. What would act on a terminal is
//! written visibly ([`plain`]).

use super::{CliError, call};
use hydroline_core::lock::Lock;
use hydroline_core::plain;
use std::fmt::Arguments;
use std::io::{self, ErrorKind, IsTerminal, Write};
use std::sync::Mutex;

/// State of a stream of results.
#[derive(Debug, Default, Clone, PartialEq, Eq)]
enum State {
    #[default]
    Open,
    /// Its reader has gone.
    Unread,
    /// It takes no more: why.
    Failed(String),
}

/// Results to one stream, with its first failure.
#[derive(Debug)]
struct Results<W> {
    to: W,
    state: State,
}

impl<W: Write> Results<W> {
    /// Writes unless the stream has failed before; the words to say of it when it fails now.
    fn write(&mut self, bytes: &[u8]) -> Option<String> {
        if self.state != State::Open {
            return None;
        }
        let error = self
            .to
            .write_all(bytes)
            .and_then(|()| self.to.flush())
            .err()?;
        if error.kind() == ErrorKind::BrokenPipe {
            self.state = State::Unread;
            return None;
        }
        let words = format!("stdout: {error}; what is printed is not complete");
        self.state = State::Failed(words.clone());
        Some(words)
    }
}

static STDOUT: Mutex<State> = Mutex::new(State::Open);

/// Bytes to stdout as they are.
fn raw(bytes: &[u8]) {
    if call::heard_result(bytes) {
        return;
    }
    let mut state = STDOUT.held();
    let mut results = Results {
        to: io::stdout().lock(),
        state: std::mem::take(&mut *state),
    };
    let failure = results.write(bytes);
    *state = results.state;
    drop(state);
    if let Some(words) = failure {
        errln!("hydroline: {words}");
    }
}

/// Writes to stdout, for the macros below.
pub fn write(text: Arguments<'_>) {
    raw(plain::text(&text.to_string()).as_bytes());
}

/// A text that another program reads (a manual page, a script), byte for byte.
pub fn bytes(text: &[u8]) {
    raw(text);
}

/// A result as one JSON text on a line. Of what describes itself only: the book's reference lists its fields.
pub fn json(value: &(impl serde::Serialize + schemars::JsonSchema)) -> Result<(), CliError> {
    write(format_args!("{}\n", serde_json::to_string(value)?));
    Ok(())
}

/// The same over several lines.
pub fn pretty_json(value: &(impl serde::Serialize + schemars::JsonSchema)) -> Result<(), CliError> {
    write(format_args!("{}\n", serde_json::to_string_pretty(value)?));
    Ok(())
}

/// A line that takes the place of the one before it on a terminal, and a line of its own anywhere else.
pub fn in_place(line: Arguments<'_>) {
    let line = line.to_string();
    let line = plain::word(&line);
    if io::stdout().is_terminal() {
        // Carriage return, erase the line (ECMA-48 EL 2).
        raw(format!("\r\x1b[2K{line}").as_bytes());
    } else {
        raw(format!("{line}\n").as_bytes());
    }
}

/// Whether stdout is a terminal, where a line can take the place of the one before it.
pub fn is_terminal() -> bool {
    io::stdout().is_terminal()
}

/// Whether anything written to stdout can still get anywhere.
pub fn is_read() -> bool {
    *STDOUT.held() == State::Open
}

/// The end of all output: the run failed when stdout did not take all of it.
///
/// # Errors
/// [`crate::CliError::Run`] with what stdout said.
pub fn finish() -> Result<(), crate::CliError> {
    match &*STDOUT.held() {
        State::Failed(words) => Err(crate::CliError::Run(words.clone())),
        State::Open | State::Unread => Ok(()),
    }
}

/// Writes to stderr, for [`errln`]; what it does not take is gone.
pub fn diagnostic(text: Arguments<'_>) {
    let line = format!("{text}\n");
    if call::heard_remark(line.trim()) {
        return;
    }
    let _ = io::stderr().lock().write_all(plain::text(&line).as_bytes());
}

/// `println!` that survives whatever stdout is.
macro_rules! outln {
    () => { $crate::print::write(format_args!("\n")) };
    ($($arg:tt)*) => { $crate::print::write(format_args!("{}\n", format_args!($($arg)*))) };
}

/// `print!` that survives whatever stdout is.
macro_rules! out {
    ($($arg:tt)*) => { $crate::print::write(format_args!($($arg)*)) };
}

/// `eprintln!` that survives whatever stderr is.
macro_rules! errln {
    ($($arg:tt)*) => { $crate::print::diagnostic(format_args!($($arg)*)) };
}

pub(crate) use {errln, out, outln};

#[cfg(test)]
mod tests {
    use super::*;

    /// Takes so many bytes, then fails.
    struct Disk {
        room: usize,
        kind: ErrorKind,
    }

    impl Write for Disk {
        fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
            if self.room == 0 {
                return Err(self.kind.into());
            }
            let taken = bytes.len().min(self.room);
            self.room -= taken;
            Ok(taken)
        }
        fn flush(&mut self) -> io::Result<()> {
            Ok(())
        }
    }

    fn results(room: usize, kind: ErrorKind) -> Results<Disk> {
        Results {
            to: Disk { room, kind },
            state: State::Open,
        }
    }

    #[test]
    fn a_full_disk_is_said_once_and_remembered() {
        let mut full = results(4, ErrorKind::StorageFull);
        assert_eq!(full.write(b"ab"), None);
        assert!(full.write(b"cdef").unwrap().contains("not complete"));
        assert_eq!(full.write(b"gh"), None);
        assert!(matches!(full.state, State::Failed(_)));
    }

    #[test]
    fn a_reader_that_has_gone_is_no_failure() {
        let mut gone = results(1, ErrorKind::BrokenPipe);
        assert_eq!(gone.write(b"ab"), None);
        assert_eq!(gone.state, State::Unread);
    }
}
