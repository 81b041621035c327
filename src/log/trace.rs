//! `tracing` events as `/daemon/log` lines.

use std::cell::Cell;
use std::fmt::Write as _;
use std::sync::{Arc, PoisonError, RwLock};

use tracing::field::{Field, Visit};
use tracing::{Event, Level, Subscriber};
use tracing_subscriber::layer::{Context, Layer};

use super::entry::Entry;
use super::messages::{Log, foxglove_time};
use super::recorder::{Recorder, WeakRecorder};

/// A layer that copies events into whatever recording is attached, and into none otherwise.
/// It holds the recording weakly: it never keeps a file open.
#[derive(Clone, Default)]
pub struct LogLayer {
    target: Arc<RwLock<Option<WeakRecorder>>>,
}

thread_local! {
    static INSIDE: Cell<bool> = const { Cell::new(false) };
}

impl LogLayer {
    /// Not attached yet: the subscriber is set up long before a recording starts.
    pub fn new() -> Self {
        Self::default()
    }

    /// From now on events go into this recording.
    pub fn attach(&self, recorder: &Recorder) {
        *self.target.write().unwrap_or_else(PoisonError::into_inner) = Some(recorder.downgrade());
    }

    /// No longer.
    pub fn detach(&self) {
        *self.target.write().unwrap_or_else(PoisonError::into_inner) = None;
    }

    fn recorder(&self) -> Option<Recorder> {
        self.target
            .read()
            .unwrap_or_else(PoisonError::into_inner)
            .as_ref()?
            .upgrade()
    }
}

impl<S: Subscriber> Layer<S> for LogLayer {
    fn on_event(&self, event: &Event<'_>, _: Context<'_, S>) {
        let meta = event.metadata();
        // A line of the log about itself would be written by the log, and so on; it is in
        // `/daemon/event` and the summary anyway.
        if meta.target().starts_with("hydroline::log") || INSIDE.get() {
            return;
        }
        let Some(recorder) = self.recorder() else {
            return;
        };
        INSIDE.set(true);
        let mut text = Text::default();
        event.record(&mut text);
        let level = match *meta.level() {
            Level::ERROR => foxglove::messages::log::Level::Error,
            Level::WARN => foxglove::messages::log::Level::Warning,
            Level::INFO => foxglove::messages::log::Level::Info,
            _ => foxglove::messages::log::Level::Debug,
        };
        recorder.push(Entry::log_line(&Log {
            timestamp: Some(foxglove_time(recorder.now_unix_ns())),
            level: level.into(),
            message: text.message + &text.fields,
            name: meta.target().to_owned(),
            file: meta.file().unwrap_or_default().to_owned(),
            line: meta.line().unwrap_or(0),
        }));
        INSIDE.set(false);
    }
}

#[derive(Default)]
struct Text {
    message: String,
    fields: String,
}

impl Visit for Text {
    fn record_debug(&mut self, field: &Field, value: &dyn std::fmt::Debug) {
        // Writing to a String does not fail.
        let _ = if field.name() == "message" {
            write!(self.message, "{value:?}")
        } else {
            write!(self.fields, " {}={value:?}", field.name())
        };
    }
}

#[cfg(test)]
mod tests {
    use super::super::*;
    use super::*;
    use crate::tests::fixtures::MemoryDisk;
    use hydroline_core::clock::SystemClock;
    use std::path::Path;
    use tracing_subscriber::prelude::*;

    #[test]
    fn lines_reach_the_file_once_and_the_logs_own_do_not() {
        let disk = MemoryDisk::default();
        let settings = WriteSettings {
            limits: Limits {
                min_free_bytes: 0,
                ..Limits::default()
            },
            ..WriteSettings::offline(None)
        };
        let recorder = Recorder::start(
            disk.opener(),
            Head::default(),
            settings,
            Arc::new(SystemClock),
        )
        .unwrap();
        let layer = LogLayer::new();
        let subscriber = tracing_subscriber::registry().with(layer.clone());
        tracing::subscriber::with_default(subscriber, || {
            tracing::info!("before");
            layer.attach(&recorder);
            tracing::warn!(target: "hydroline::capture", lost = 3, "gap");
            tracing::error!(target: "hydroline::log::writer", "of the log itself");
            layer.detach();
            tracing::info!("after");
        });
        recorder.finish(&SummaryInput::clean("done")).unwrap();
        let reader =
            LogReader::from_source(Path::new("m"), std::io::Cursor::new(disk.file(0))).unwrap();
        let lines: Vec<Log> = reader
            .map(|m| match m.unwrap().record {
                Record::Log(line) => line,
                other => panic!("{other:?}"),
            })
            .collect();
        assert_eq!(lines.len(), 1);
        assert_eq!(
            (lines[0].message.as_str(), lines[0].level),
            ("gap lost=3", 3)
        );
        assert_eq!(lines[0].name, "hydroline::capture");
    }

    #[test]
    fn the_layer_does_not_keep_a_recording_open() {
        let disk = MemoryDisk::default();
        let settings = WriteSettings::offline(None);
        let recorder = Recorder::start(
            disk.opener(),
            Head::default(),
            settings,
            Arc::new(SystemClock),
        )
        .unwrap();
        let layer = LogLayer::new();
        layer.attach(&recorder);
        drop(recorder);
        assert!(layer.recorder().is_none());
    }
}
