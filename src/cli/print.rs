//! Results on stdout. A reader that has seen enough (`| head`) is no error and no panic.

use std::fmt::Arguments;
use std::io::{ErrorKind, Write};

/// Writes to stdout; says on stderr what else than a closed pipe kept it from that.
pub fn write(text: Arguments<'_>) {
    if let Err(error) = std::io::stdout().lock().write_fmt(text)
        && error.kind() != ErrorKind::BrokenPipe
    {
        eprintln!("hydroline: stdout: {error}");
    }
}

/// A whole text to stdout, under the same rule.
pub fn bytes(text: &[u8]) -> Result<(), crate::CliError> {
    match std::io::stdout().lock().write_all(text) {
        Err(error) if error.kind() != ErrorKind::BrokenPipe => {
            Err(crate::CliError::Run(format!("stdout: {error}")))
        }
        _ => Ok(()),
    }
}

/// `println!` that survives a closed pipe.
macro_rules! outln {
    () => { $crate::print::write(format_args!("\n")) };
    ($($arg:tt)*) => { $crate::print::write(format_args!("{}\n", format_args!($($arg)*))) };
}

/// `print!` that survives a closed pipe.
macro_rules! out {
    ($($arg:tt)*) => { $crate::print::write(format_args!($($arg)*)) };
}

pub(crate) use {out, outln};
