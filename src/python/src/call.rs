//! A command on threads of its own, while the calling thread waits without the GIL and looks after signals.
//!
//! The threads (one that runs the command, in a pool for what is parallel in it) are bound to the call's listener and
//! to its token (`hydroline_numerics::cancel`): two calls at once know nothing of each other, and Ctrl-C ends the one
//! whose thread it interrupts.

use crate::{build, errors};
use hydroline_cli::Outcome;
use hydroline_cli::call::{self as command_line, CallError, Kind, Listener, Report};
use hydroline_numerics::cancel::{self, Cancelled, Token};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use std::ffi::OsString;
use std::sync::mpsc::{Receiver, RecvTimeoutError, Sender, channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

/// Time between looks for signals: Ctrl-C is felt at once, and looking costs microseconds.
const LOOK: Duration = Duration::from_millis(50);
/// Stack of the threads: what the main thread of a program has.
const STACK_BYTES: usize = 8 << 20;

/// Message of the command on its way to the calling thread.
enum Said {
    Result(Vec<u8>),
    Remark(String),
    Progress(String, u64, Option<u64>),
    Page(Report),
}

/// Sends everything on; `Sender` is not shared by threads of old compilers' libraries, hence the lock.
struct Ear(Mutex<Sender<Said>>);

impl Ear {
    fn say(&self, said: Said) {
        // Nobody listens any more once the call is given up.
        let _ = self
            .0
            .lock()
            .unwrap_or_else(PoisonError::into_inner)
            .send(said);
    }
}

impl Listener for Ear {
    fn result(&self, bytes: &[u8]) {
        self.say(Said::Result(bytes.to_vec()));
    }
    fn remark(&self, words: &str) {
        self.say(Said::Remark(words.to_owned()));
    }
    fn progress(&self, stage: &str, done: u64, of: Option<u64>) {
        self.say(Said::Progress(stage.to_owned(), done, of));
    }
    fn report(&self, page: Report) {
        self.say(Said::Page(page));
    }
}

/// Result of a command.
#[pyclass(frozen, module = "hydroline._hydroline")]
pub struct Called {
    /// Text that the command line would have printed on stdout.
    #[pyo3(get)]
    text: String,
    /// Remarks, which the command line prints on stderr.
    #[pyo3(get)]
    remarks: Vec<String>,
    /// Exit code 3: done, but something was lost.
    #[pyo3(get)]
    lossy: bool,
    page: Mutex<Page>,
}

enum Page {
    Open(Report),
    Made(Option<String>),
}

#[pymethods]
impl Called {
    /// The page of the command's report, made when it is first asked for; None = it has none.
    fn page(&self, py: Python<'_>) -> Option<String> {
        py.detach(|| {
            let mut page = self.page.lock().unwrap_or_else(PoisonError::into_inner);
            let made = match std::mem::replace(&mut *page, Page::Made(None)) {
                Page::Open(report) => Some(report()),
                Page::Made(made) => made,
            };
            *page = Page::Made(made.clone());
            made
        })
    }
}

type Ended = Result<Result<Outcome, CallError>, Cancelled>;

/// Runs the command in a pool of its own.
fn work(words: Vec<OsString>, ear: Arc<Ear>, token: Token) -> Result<Ended, String> {
    let pool = rayon::ThreadPoolBuilder::new()
        .stack_size(STACK_BYTES)
        .thread_name(|k| format!("hydroline-{k}"))
        .start_handler(move |_| {
            command_line::bind(ear.clone());
            // As long as the thread lives.
            std::mem::forget(token.bind());
        })
        .build()
        .map_err(|e| format!("no thread can be started: {e}"))?;
    let run = || cancel::catch(|| command_line::call(words, build()));
    Ok(pool.install(run))
}

/// Runs `words`, a command line after the program's name. `progress(stage, done, of)` is called on this thread.
#[pyfunction]
#[pyo3(signature = (words, progress=None))]
pub fn call(
    py: Python<'_>,
    words: Vec<OsString>,
    progress: Option<Bound<'_, PyAny>>,
) -> PyResult<Called> {
    let (sender, said) = channel();
    let token = Token::default();
    let (ear, given) = (Arc::new(Ear(Mutex::new(sender))), token.clone());
    let worker = std::thread::Builder::new()
        .name("hydroline".to_owned())
        .spawn(move || work(words, ear, given))
        .map_err(|e| errors::run(py, format_args!("no thread can be started: {e}")))?;
    let mut called = Called {
        text: String::new(),
        remarks: Vec::new(),
        lossy: false,
        page: Mutex::new(Page::Made(None)),
    };
    let heard = listen(py, said, progress.as_ref(), &mut called);
    if heard.is_err() {
        token.cancel();
    }
    let ended = py.detach(|| worker.join());
    heard?;
    let ended = match ended {
        Ok(ended) => ended.map_err(|words| errors::run(py, words))?,
        Err(panic) => return Err(bug(py, &*panic)),
    };
    match ended {
        Ok(Ok(outcome)) => {
            called.lossy = outcome == Outcome::Lossy;
            Ok(called)
        }
        Ok(Err(error)) => Err(errors::called(py, error)),
        Err(cancelled) => Err(errors::run(py, cancelled)),
    }
}

/// Takes what the command says until it ends, or until a signal or the progress function ends it.
fn listen(
    py: Python<'_>,
    said: Receiver<Said>,
    progress: Option<&Bound<'_, PyAny>>,
    called: &mut Called,
) -> PyResult<()> {
    let said = Mutex::new(said);
    let next = || {
        said.lock()
            .unwrap_or_else(PoisonError::into_inner)
            .recv_timeout(LOOK)
    };
    let mut text = Vec::new();
    loop {
        match py.detach(next) {
            Ok(Said::Result(bytes)) => text.extend(bytes),
            Ok(Said::Remark(words)) => called.remarks.push(words),
            Ok(Said::Page(page)) => called.page = Mutex::new(Page::Open(page)),
            Ok(Said::Progress(stage, done, of)) => {
                if let Some(progress) = progress {
                    progress.call1((stage, done, of))?;
                }
            }
            Err(RecvTimeoutError::Timeout) => {}
            Err(RecvTimeoutError::Disconnected) => break,
        }
        py.check_signals()?;
    }
    called.text = String::from_utf8_lossy(&text).into_owned();
    Ok(())
}

/// Runs `work` on a thread of its own, while this one waits without the GIL and looks after signals: one of them ends it
/// at its next question to the token.
pub fn interruptible<T: Send>(
    py: Python<'_>,
    work: impl FnOnce(&Token) -> T + Send,
) -> PyResult<T> {
    let token = Token::default();
    let (over, end) = channel::<()>();
    let end = Mutex::new(end);
    let ended = std::thread::scope(|scope| {
        let worker = std::thread::Builder::new().spawn_scoped(scope, || {
            // Dropped at the end, however it ends.
            let _over = over;
            cancel::catch(|| work(&token))
        });
        let worker =
            worker.map_err(|e| errors::run(py, format_args!("no thread can be started: {e}")))?;
        let wait = || {
            let end = end.lock().unwrap_or_else(PoisonError::into_inner);
            end.recv_timeout(LOOK) == Err(RecvTimeoutError::Timeout)
        };
        let mut heard = Ok(());
        while heard.is_ok() && py.detach(wait) {
            heard = py.check_signals();
        }
        if heard.is_err() {
            token.cancel();
        }
        let ended = py.detach(|| worker.join());
        heard.map(|()| ended)
    });
    match ended? {
        Ok(result) => result.map_err(|cancelled| errors::run(py, cancelled)),
        Err(panic) => Err(bug(py, &*panic)),
    }
}

/// Error that stands for a panic.
fn bug(py: Python<'_>, panic: &(dyn std::any::Any + Send)) -> PyErr {
    let words = panic
        .downcast_ref::<String>()
        .map(String::as_str)
        .or_else(|| panic.downcast_ref::<&str>().copied())
        .unwrap_or("no words");
    errors::run(
        py,
        format_args!("a bug in hydroline, please report it: {words}"),
    )
}

/// First line and arguments of a command, as its definition has them.
#[pyfunction]
pub fn definition<'py>(
    py: Python<'py>,
    command: &str,
) -> PyResult<(String, Vec<Bound<'py, PyDict>>)> {
    let (about, arguments) = command_line::definition(command)
        .map_err(|name| errors::input(py, format_args!("{name}: no such command")))?;
    let dict = |argument: command_line::Argument| {
        let dict = PyDict::new(py);
        let (kind, allowed) = match argument.kind {
            Kind::Flag => ("flag", Vec::new()),
            Kind::Integer => ("integer", Vec::new()),
            Kind::Number => ("number", Vec::new()),
            Kind::Path => ("path", Vec::new()),
            Kind::Word(words) => ("word", words),
            Kind::Text => ("text", Vec::new()),
        };
        dict.set_item("name", argument.name)?;
        dict.set_item("positional", argument.positional)?;
        dict.set_item("several", argument.several)?;
        dict.set_item("required", argument.required)?;
        dict.set_item("kind", kind)?;
        dict.set_item("allowed", allowed)?;
        dict.set_item("default", argument.default)?;
        dict.set_item("help", argument.help)?;
        dict.set_item("value_name", argument.value_name)?;
        Ok(dict)
    };
    let arguments = arguments.into_iter().map(dict).collect::<PyResult<_>>()?;
    Ok((about, arguments))
}
