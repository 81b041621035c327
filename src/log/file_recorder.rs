//! Offline recording: in order, at the times the caller names.

use std::io;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex};

use hydroline_core::lock::Lock;

use super::LogError;
use super::atomic_file::AtomicFile;
use super::entry::Entry;
use super::loss_account::{Counts, LogOutcome, SummaryInput};
use super::output::{FileOutput, LogOutput};
use super::settings::{FileParts, Head, PartOpener, WriteSettings};
use super::writer::LogWriter;

/// Writes a log in order, at the times the caller names: `simulate` and `replay`.
/// The same entries at the same times give the same bytes.
pub struct FileRecorder {
    writer: LogWriter,
    counts: Counts,
    last_ns: u64,
    whole: Option<Whole>,
}

/// Files that get their names when all of them are whole, and go when they are dropped before.
struct Whole {
    first: PathBuf,
    files: Arc<Mutex<Vec<AtomicFile>>>,
}

impl FileRecorder {
    /// Creates the file.
    ///
    /// # Errors
    /// As [`LogWriter::create`].
    pub fn create(
        path: &Path,
        replace: bool,
        head: Head,
        settings: WriteSettings,
    ) -> Result<Self, LogError> {
        let parts = FileParts {
            path: path.to_owned(),
            replace,
        };
        Self::with_opener(Box::new(parts), head, settings)
    }

    /// The same for a file that appears under its name when it is whole: whatever breaks it off leaves nothing but
    /// `NAME.part`, which the next attempt replaces. With `over` it takes the place of one that is there.
    ///
    /// # Errors
    /// As [`AtomicFile::begin`] and [`LogWriter::create`].
    pub fn create_whole(
        path: &Path,
        over: bool,
        head: Head,
        settings: WriteSettings,
    ) -> Result<Self, LogError> {
        let begin = move |path: &Path| match over {
            true => AtomicFile::begin_over(path),
            false => AtomicFile::begin(path),
        };
        let parts = FileParts {
            path: path.to_owned(),
            replace: over,
        };
        let files = Arc::new(Mutex::new(Vec::new()));
        let begun = Arc::clone(&files);
        // Its own words, which an opener's error would not keep.
        let mut first = Some(begin(path)?);
        let opener = move |part: u32| {
            let whole = parts.part_path(part);
            let file = match first.take() {
                Some(first) => first,
                None => begin(&whole).map_err(io::Error::other)?,
            };
            let output = FileOutput::create(file.path(), true)?;
            begun.held().push(file);
            Ok((Box::new(output) as Box<dyn LogOutput>, whole))
        };
        let mut recorder = Self::with_opener(Box::new(opener), head, settings)?;
        let first = path.to_owned();
        recorder.whole = Some(Whole { first, files });
        Ok(recorder)
    }

    /// The same over any sink.
    ///
    /// # Errors
    /// As [`LogWriter::create`].
    pub fn with_opener(
        opener: Box<dyn PartOpener>,
        head: Head,
        settings: WriteSettings,
    ) -> Result<Self, LogError> {
        let writer = LogWriter::create(opener, head, settings, 0)?;
        Ok(Self {
            writer,
            counts: Counts::default(),
            last_ns: 0,
            whole: None,
        })
    }

    /// Writes one entry at `log_ns` (UNIX \[ns\]; an earlier one than the last is raised to it).
    ///
    /// # Errors
    /// [`LogError::Stopped`] once the disk has refused; the file so far is closed and readable. Of a file that was to be
    /// whole, [`LogError::Output`]. [`LogError::TooLarge`]: this entry is not written.
    pub fn write(&mut self, log_ns: u64, entry: &Entry) -> Result<(), LogError> {
        entry.check_size()?;
        self.last_ns = self.last_ns.max(log_ns);
        if let Entry::Frame { frame, .. } = entry {
            self.counts.frames.count(frame);
            self.counts.frames_faulty += u64::from(frame.meta.fault.is_some());
        }
        let counts = &self.counts;
        self.writer.tick(self.last_ns, &|| counts.clone());
        self.writer
            .write(self.last_ns, self.last_ns, entry, &|| counts.clone());
        match self.writer.stopped() {
            Some(reason) => Err(stopped(self.whole.as_ref(), reason)),
            None => Ok(()),
        }
    }

    /// Closes the file.
    ///
    /// # Errors
    /// [`LogError::Stopped`] when it could not be closed as it should. Of a file that was to be whole, [`LogError::Output`]
    /// and [`LogError::OutputExists`]: there is none then.
    pub fn finish(self, summary: &SummaryInput) -> Result<LogOutcome, LogError> {
        let counts = self.counts;
        let outcome = self
            .writer
            .finish(self.last_ns, summary, &|| counts.clone());
        if let Some(reason) = &outcome.stopped {
            return Err(stopped(self.whole.as_ref(), reason));
        }
        if let Some(whole) = self.whole {
            if let Some(misplaced) = outcome.misplaced.first() {
                return Err(LogError::output(&whole.first)(misplaced));
            }
            let files = std::mem::take(&mut *whole.files.held());
            files.into_iter().try_for_each(AtomicFile::finish)?;
        }
        Ok(outcome)
    }
}

fn stopped(whole: Option<&Whole>, reason: &str) -> LogError {
    match whole {
        Some(whole) => LogError::output(&whole.first)(format!(
            "{reason}; what was begun is removed: make room and repeat the command"
        )),
        None => LogError::Stopped {
            reason: reason.to_owned(),
        },
    }
}
