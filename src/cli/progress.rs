//! Progress bars: on a terminal, never in a pipe.

use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use std::io::IsTerminal;

/// A bar over `length` steps of `what`, drawn on stderr when that is a terminal.
pub fn bar(length: u64, what: &'static str) -> ProgressBar {
    let target = if std::io::stderr().is_terminal() {
        ProgressDrawTarget::stderr()
    } else {
        ProgressDrawTarget::hidden()
    };
    let bar = ProgressBar::with_draw_target((length > 0).then_some(length), target);
    let template = if length > 0 {
        "{msg} {bar:20} {pos}/{len} {prefix}"
    } else {
        // Nobody knows how long: a count, no bar that would pretend to know.
        "{spinner} {msg} {pos} {prefix}"
    };
    if let Ok(style) = ProgressStyle::with_template(template) {
        bar.set_style(style);
    }
    bar.with_message(what)
}

/// One line of words on stderr that refreshes; nothing where that is no terminal.
pub fn line() -> ProgressBar {
    let line = bar(0, "");
    if let Ok(style) = ProgressStyle::with_template("{wide_msg}") {
        line.set_style(style);
    }
    line
}
