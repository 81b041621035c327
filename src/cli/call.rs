//! The commands called as functions by another program, such as the Python package.
//!
//! A command that is called prints nothing: what it would print goes to the [`Listener`] of its thread, byte for byte.
//! So there is one definition of every argument (clap's), one way from arguments to a result, and one text of it, and
//! a caller's results are those of the command line by construction.

use super::outcome::{CliError, Outcome};
use super::{Cli, command};
use clap::error::{ContextKind, ContextValue};
use clap::{Arg, ArgAction, FromArgMatches};
use hydroline_core::build_info::BuildInfo;
use std::cell::RefCell;
use std::ffi::OsString;
use std::sync::Arc;

/// Makes a report's page when it is looked at.
pub type Report = Box<dyn FnOnce() -> String + Send>;

/// Takes what a command says.
pub trait Listener: Send + Sync {
    /// Of its result: what would go to stdout.
    fn result(&self, bytes: &[u8]);
    /// Words for a person: what would go to stderr.
    fn remark(&self, words: &str);
    /// Progress: the stage, how many are done, and of how many where that is known.
    fn progress(&self, stage: &str, done: u64, of: Option<u64>);
    /// The page that --report would write, where the command has one.
    fn report(&self, page: Report);
}

thread_local! {
    static BOUND: RefCell<Option<Arc<dyn Listener>>> = const { RefCell::new(None) };
}

/// Makes this the listener of the calling thread, as long as the thread lives: of those that are made for one call.
pub fn bind(listener: Arc<dyn Listener>) {
    BOUND.set(Some(listener));
}

/// The thread's listener.
pub(crate) fn listener() -> Option<Arc<dyn Listener>> {
    BOUND.with_borrow(Clone::clone)
}

/// Offers a report's page to whoever listens.
pub(crate) fn offer(page: impl FnOnce() -> String + Send + 'static) {
    if let Some(listener) = listener() {
        listener.report(Box::new(page));
    }
}

/// Why there is no result.
#[derive(Debug, thiserror::Error)]
#[allow(missing_docs)] // Each message names its fields.
pub enum CallError {
    /// An argument is missing, unknown, or not among its values.
    #[error("{words}")]
    Argument {
        /// The whole of it, for a person.
        words: String,
        /// Argument, as the command line writes it; "" where it is not about one.
        argument: String,
        /// Its value; "" where there is none.
        value: String,
        /// Values that it can have, where they are a list.
        allowed: Vec<String>,
    },
    #[error(transparent)]
    Command(#[from] CliError),
}

/// Runs a command on this thread, whose listener gets what it says. `words` are those of the command line after the
/// program's name.
pub fn call(words: Vec<OsString>, build: BuildInfo) -> Result<Outcome, CallError> {
    let name = std::iter::once(OsString::from("hydroline"));
    let mut program = command(build);
    let cli = program
        .try_get_matches_from_mut(name.chain(words))
        .and_then(|mut matches| Cli::from_arg_matches_mut(&mut matches))
        .map_err(|error| argument_error(&error))?;
    Ok(cli.run(build)?)
}

/// Error of an argument, in clap's words without the help of a command line.
fn argument_error(error: &clap::Error) -> CallError {
    let text = |kind| match error.get(kind) {
        Some(ContextValue::String(text)) => text.clone(),
        Some(ContextValue::Strings(texts)) => texts.join(", "),
        _ => String::new(),
    };
    let allowed = match error.get(ContextKind::ValidValue) {
        Some(ContextValue::Strings(values)) => values.clone(),
        _ => Vec::new(),
    };
    let shown = error.to_string();
    let said = shown
        .lines()
        .take_while(|line| !line.starts_with("Usage:") && !line.starts_with("For more information"))
        .map(str::trim)
        .filter(|line| !line.is_empty());
    let words = said.collect::<Vec<_>>().join(" ");
    let argument = text(ContextKind::InvalidArg);
    CallError::Argument {
        words: words.strip_prefix("error: ").unwrap_or(&words).to_owned(),
        argument: argument.split([' ', '=']).next().unwrap_or("").to_owned(),
        value: text(ContextKind::InvalidValue),
        allowed,
    }
}

/// Type of an argument's values.
#[derive(Debug, Clone, PartialEq)]
pub enum Kind {
    /// There or not.
    Flag,
    /// A whole number.
    Integer,
    /// A number.
    Number,
    /// A path.
    Path,
    /// One of these words.
    Word(Vec<String>),
    /// A text, or what a text describes (a rig by file or name, a length of time).
    Text,
}

/// An argument of a command as its definition has it.
#[derive(Debug, Clone, PartialEq)]
pub struct Argument {
    /// Long name without dashes; of a positional argument its own.
    pub name: String,
    /// Without a flag before it.
    pub positional: bool,
    /// Whether it may be given several times.
    pub several: bool,
    /// Whether it must be there whatever else is.
    pub required: bool,
    /// Type of its values.
    pub kind: Kind,
    /// Value where none is given.
    pub default: Option<String>,
    /// Help on it, as the command line prints it.
    pub help: String,
    /// Placeholder of its value in the help.
    pub value_name: String,
}

/// First line and arguments of a command, without those that only make sense on a command line.
///
/// # Errors
/// The name, where there is no such command.
pub fn definition(name: &str) -> Result<(String, Vec<Argument>), String> {
    let mut program = command(BuildInfo::default());
    program.build();
    let found = program.find_subcommand(name).ok_or(name)?;
    let about = found.get_about().map(ToString::to_string);
    let arguments = found.get_arguments().filter(|arg| {
        let id = arg.get_id().as_str();
        !["help", "version", "json", "live", "live_token"].contains(&id) && !arg.is_hide_set()
    });
    Ok((about.unwrap_or_default(), arguments.map(argument).collect()))
}

fn argument(arg: &Arg) -> Argument {
    let long = arg.get_long();
    let values = arg.get_possible_values();
    let parser = arg.get_value_parser().type_id();
    let is = |ids: &[std::any::TypeId]| ids.iter().any(|id| parser == *id);
    use std::any::TypeId;
    let kind = match arg.get_action() {
        ArgAction::SetTrue | ArgAction::SetFalse => Kind::Flag,
        _ if !values.is_empty() => {
            Kind::Word(values.iter().map(|v| v.get_name().to_owned()).collect())
        }
        _ if is(&[TypeId::of::<f64>()]) => Kind::Number,
        _ if is(&[
            TypeId::of::<u64>(),
            TypeId::of::<u32>(),
            TypeId::of::<u16>(),
            TypeId::of::<u8>(),
            TypeId::of::<usize>(),
            TypeId::of::<i64>(),
        ]) =>
        {
            Kind::Integer
        }
        // A log's window is named behind its path.
        _ if is(&[
            TypeId::of::<std::path::PathBuf>(),
            TypeId::of::<hydroline_diagnose::Part>(),
        ]) =>
        {
            Kind::Path
        }
        _ => Kind::Text,
    };
    let many = arg.get_num_args().is_some_and(|n| n.max_values() > 1);
    let defaults = arg.get_default_values();
    Argument {
        name: long.unwrap_or(arg.get_id().as_str()).to_owned(),
        positional: long.is_none(),
        several: many || matches!(arg.get_action(), ArgAction::Append),
        required: arg.is_required_set(),
        kind,
        // Of a flag that is there or not clap has one too.
        default: defaults
            .first()
            .filter(|_| arg.get_action().takes_values())
            .map(|d| d.to_string_lossy().into_owned()),
        help: arg.get_help().map(ToString::to_string).unwrap_or_default(),
        value_name: arg
            .get_value_names()
            .and_then(|names| names.first())
            .map(ToString::to_string)
            .unwrap_or_default(),
    }
}

/// stdout of a thread with a listener; false = it has none.
pub(crate) fn heard_result(bytes: &[u8]) -> bool {
    listener().map(|l| l.result(bytes)).is_some()
}

/// The same for stderr.
pub(crate) fn heard_remark(words: &str) -> bool {
    listener().map(|l| l.remark(words)).is_some()
}

/// Passes the progress of a command to the listener, if there is one.
pub(crate) fn progress(stage: &str, done: u64, of: Option<u64>) {
    if let Some(listener) = listener() {
        listener.progress(stage, done, of);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::Mutex;

    #[derive(Default)]
    struct Kept {
        result: Mutex<Vec<u8>>,
        remarks: Mutex<Vec<String>>,
    }

    impl Listener for Kept {
        fn result(&self, bytes: &[u8]) {
            self.result.lock().unwrap().extend_from_slice(bytes);
        }
        fn remark(&self, words: &str) {
            self.remarks.lock().unwrap().push(words.to_owned());
        }
        fn progress(&self, _: &str, _: u64, _: Option<u64>) {}
        fn report(&self, _: Report) {}
    }

    fn called(words: &[&str]) -> (Result<Outcome, CallError>, String, Vec<String>) {
        let kept = Arc::new(Kept::default());
        let (heard, words) = (kept.clone(), words.iter().map(OsString::from).collect());
        let result = std::thread::spawn(move || {
            bind(heard);
            call(words, BuildInfo::default())
        });
        let result = result.join().unwrap();
        let text = String::from_utf8(kept.result.lock().unwrap().clone()).unwrap();
        let remarks = kept.remarks.lock().unwrap().clone();
        (result, text, remarks)
    }

    #[test]
    fn a_called_command_says_everything_to_its_listener() {
        let (result, text, remarks) =
            called(&["predict", "--rig", "lshpi", "--plan", "still", "--json"]);
        assert_eq!(result.unwrap(), Outcome::Done);
        assert!(text.starts_with("{\"channels\""), "{text:.60}");
        assert!(remarks[0].starts_with("no band"), "{remarks:?}");
    }

    #[test]
    fn a_wrong_argument_comes_with_its_values() {
        let (result, ..) = called(&[
            "identify",
            "a.mcap",
            "--rig",
            "lshpi",
            "--fail-on",
            "misfits",
        ]);
        let Err(CallError::Argument {
            words,
            argument,
            value,
            allowed,
        }) = result
        else {
            panic!("{result:?}")
        };
        assert_eq!((&*argument, &*value), ("--fail-on", "misfits"));
        assert_eq!(allowed, ["misfit"]);
        assert!(words.starts_with("invalid value 'misfits'"), "{words}");
        let (result, ..) = called(&["predict", "--rig", "lshpi", "--plan", "still", "--rate=0"]);
        let words = result.unwrap_err().to_string();
        assert!(words.contains("--rate 0: give more than 0"), "{words}");
    }

    #[test]
    fn definitions_are_claps() {
        let (_, arguments) = definition("identify").unwrap();
        let of = |name: &str| arguments.iter().find(|a| a.name == name).unwrap();
        assert!(of("logs").positional && of("logs").several);
        assert_eq!(of("from").kind, Kind::Number);
        assert_eq!(of("from-rest").kind, Kind::Flag);
        assert!(!of("rig").required && !of("logs").required);
        assert_eq!(of("from").default.as_deref(), Some("0"));
        let (_, simulate) = definition("simulate").unwrap();
        let seed = simulate.iter().find(|a| a.name == "seed").unwrap();
        assert_eq!(seed.kind, Kind::Integer);
        assert!(definition("nothing").is_err());
    }
}
