//! Offline recording: in order, at the times the caller names.

use std::path::Path;

use super::LogError;
use super::entry::Entry;
use super::loss_account::{Counts, LogOutcome, SummaryInput};
use super::settings::{FileParts, Head, PartOpener, WriteSettings};
use super::writer::LogWriter;

/// Writes a log in order, at the times the caller names: `simulate` and `replay`.
/// The same entries at the same times give the same bytes.
pub struct FileRecorder {
    writer: LogWriter,
    counts: Counts,
    last_ns: u64,
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
        })
    }

    /// Writes one entry at `log_ns` (UNIX \[ns\]; an earlier one than the last is raised to it).
    ///
    /// # Errors
    /// [`LogError::Stopped`] once the disk has refused; the file so far is closed and readable.
    pub fn write(&mut self, log_ns: u64, entry: &Entry) -> Result<(), LogError> {
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
            Some(reason) => Err(LogError::Stopped {
                reason: reason.to_owned(),
            }),
            None => Ok(()),
        }
    }

    /// Closes the file.
    ///
    /// # Errors
    /// [`LogError::Stopped`] when it could not be closed as it should.
    pub fn finish(self, summary: &SummaryInput) -> Result<LogOutcome, LogError> {
        let counts = self.counts;
        let outcome = self
            .writer
            .finish(self.last_ns, summary, &|| counts.clone());
        match &outcome.stopped {
            Some(reason) => Err(LogError::Stopped {
                reason: reason.clone(),
            }),
            None => Ok(outcome),
        }
    }
}
