//! Progress: bars on a terminal, never in a pipe; of long work a line now and then there.

use super::call::{self, Listener};
use super::print::errln;
use hydroline_core::lock::Lock;
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use std::io::IsTerminal;
use std::sync::{Arc, Condvar, Mutex, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

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

/// Where nothing refreshes: first line after so long, and between two of them.
const FIRST_LINE: Duration = Duration::from_secs(10);
const NEXT_LINE: Duration = Duration::from_secs(30);

/// Work of which nobody knows how long it takes, stage after stage: what it is at, how many stages are done, and for how
/// long. On a terminal one line that refreshes; elsewhere a line now and then, so that nobody takes it for dead.
pub struct Stages {
    bar: ProgressBar,
    listener: Option<Arc<dyn Listener>>,
    stage_now: Arc<Stage>,
    teller: Option<JoinHandle<()>>,
}

#[derive(Debug, Default)]
struct Stage {
    now: Mutex<Now>,
    changed: Condvar,
}

#[derive(Debug, Default)]
struct Now {
    stage: String,
    stages: u64,
    ended: bool,
}

impl Stage {
    /// Says where the work is until it ends.
    fn tell(&self, what: &str, began: Instant) {
        let mut wait = FIRST_LINE;
        let mut now = self.now.held();
        loop {
            let ended = |now: &mut Now| !now.ended;
            let (got, _) = self
                .changed
                .wait_timeout_while(now, wait, ended)
                .unwrap_or_else(PoisonError::into_inner);
            now = got;
            if now.ended {
                return;
            }
            let (elapsed_s, Now { stage, stages, .. }) = (began.elapsed().as_secs(), &*now);
            let count = match stages {
                0 => String::new(),
                n => format!("stage {n}, "),
            };
            errln!("hydroline: {what} for {elapsed_s} s: {count}{stage}");
            wait = NEXT_LINE;
        }
    }
}

impl Stages {
    /// Begins `what`, e.g. `diagnosing`.
    pub fn begin(what: &'static str) -> Self {
        let bar = bar(0, what);
        let stage_now = Arc::new(Stage::default());
        let listener = call::listener();
        let teller = if listener.is_some() {
            None
        } else if bar.is_hidden() {
            let (stage_now, began) = (stage_now.clone(), Instant::now());
            let tell = move || stage_now.tell(what, began);
            std::thread::Builder::new().spawn(tell).ok()
        } else {
            if let Ok(style) =
                ProgressStyle::with_template("{spinner} {msg} {elapsed} {pos} {prefix}")
            {
                bar.set_style(style);
            }
            bar.enable_steady_tick(Duration::from_millis(200));
            None
        };
        Self {
            bar,
            listener,
            stage_now,
            teller,
        }
    }

    fn hear(&self, stage: &str, stages: u64) {
        if let Some(listener) = &self.listener {
            listener.progress(stage, stages, None);
        }
    }

    /// The next stage.
    pub fn tell(&self, stage: &str) {
        let mut now = self.stage_now.now.held();
        now.stages += 1;
        stage.clone_into(&mut now.stage);
        self.hear(stage, now.stages);
        drop(now);
        self.bar.inc(1);
        self.bar.set_prefix(stage.to_owned());
    }
}

impl Drop for Stages {
    fn drop(&mut self) {
        self.stage_now.now.held().ended = true;
        self.stage_now.changed.notify_all();
        if let Some(teller) = self.teller.take() {
            let _ = teller.join();
        }
        self.bar.finish_and_clear();
    }
}
