//! The log on a thread of its own: framing and compressing go on while the next rows are made.

use std::sync::mpsc::{SyncSender, sync_channel};
use std::thread::JoinHandle;

use hydroline_log::{Entry, FileRecorder, LogError, SummaryInput};

/// Entries handed over at once.
const BATCH: usize = 2048;
/// Batches that wait at most: memory stays bounded.
const WAITING: usize = 8;

type Batch = Vec<(u64, Entry)>;

/// Writes entries in the order in which they are given.
pub(super) struct Behind {
    batch: Batch,
    to: Option<SyncSender<Batch>>,
    thread: Option<JoinHandle<Result<FileRecorder, LogError>>>,
}

fn lost() -> LogError {
    LogError::Stopped {
        reason: "the thread that writes it ended early".to_owned(),
    }
}

impl Behind {
    pub fn new(mut log: FileRecorder) -> Behind {
        let (to, from) = sync_channel::<Batch>(WAITING);
        let thread = std::thread::spawn(move || {
            for (log_ns, entry) in from.iter().flatten() {
                log.write(log_ns, &entry)?;
            }
            Ok(log)
        });
        Behind {
            batch: Vec::with_capacity(BATCH),
            to: Some(to),
            thread: Some(thread),
        }
    }

    /// The writer's error comes with one of the entries after the one that was refused.
    pub fn write(&mut self, log_ns: u64, entry: Entry) -> Result<(), LogError> {
        self.batch.push((log_ns, entry));
        if self.batch.len() == BATCH {
            let batch = std::mem::replace(&mut self.batch, Vec::with_capacity(BATCH));
            self.send(batch)?;
        }
        Ok(())
    }

    fn send(&mut self, batch: Batch) -> Result<(), LogError> {
        match &self.to {
            Some(to) if to.send(batch).is_ok() => Ok(()),
            // It no longer takes any: it has ended, with the reason.
            _ => self.join().and(Err(lost())),
        }
    }

    fn join(&mut self) -> Result<FileRecorder, LogError> {
        self.to = None;
        let ended = self.thread.take().and_then(|t| t.join().ok());
        ended.unwrap_or_else(|| Err(lost()))
    }

    pub fn finish(mut self, summary: &SummaryInput) -> Result<(), LogError> {
        let batch = std::mem::take(&mut self.batch);
        self.send(batch)?;
        self.join()?.finish(summary).map(|_| ())
    }
}

impl Drop for Behind {
    /// Of an import that failed otherwise: the file is closed before the caller looks at it.
    fn drop(&mut self) {
        self.join().ok();
    }
}
