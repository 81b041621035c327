//! A disk that stands still now and then, and one that fills up.

use hydroline_log::{FileOutput, LogOutput, PartOpener};
use std::io::{self, Write};
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, Instant};

/// Opens files on a bad disk.
pub struct BadDisk {
    /// File to write.
    pub path: PathBuf,
    /// The disk stands still for `stall` once in every `every`.
    pub every: Duration,
    /// For so long.
    pub stall: Duration,
    /// Bytes the disk takes before it is full.
    pub room_bytes: u64,
    /// Counts the stalls.
    pub stalls: Arc<AtomicU64>,
}

impl PartOpener for BadDisk {
    fn open(&mut self, _part: u32) -> io::Result<(Box<dyn LogOutput>, PathBuf)> {
        let sink = BadOutput {
            file: FileOutput::create(&self.path, false)?,
            every: self.every,
            stall: self.stall,
            last: Instant::now(),
            room_bytes: self.room_bytes,
            written_bytes: 0,
            stalls: self.stalls.clone(),
        };
        Ok((Box::new(sink), self.path.clone()))
    }
}

struct BadOutput {
    file: FileOutput,
    every: Duration,
    stall: Duration,
    last: Instant,
    room_bytes: u64,
    written_bytes: u64,
    stalls: Arc<AtomicU64>,
}

impl BadOutput {
    fn stand_still(&mut self) {
        if self.last.elapsed() >= self.every {
            std::thread::sleep(self.stall);
            self.stalls.fetch_add(1, Ordering::Relaxed);
            self.last = Instant::now();
        }
    }
}

impl Write for BadOutput {
    fn write(&mut self, buf: &[u8]) -> io::Result<usize> {
        self.stand_still();
        if self.written_bytes + buf.len() as u64 > self.room_bytes {
            return Err(io::ErrorKind::StorageFull.into());
        }
        let n = self.file.write(buf)?;
        self.written_bytes += n as u64;
        Ok(n)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.file.flush()
    }
}

impl LogOutput for BadOutput {
    fn sync(&mut self) -> io::Result<()> {
        self.stand_still();
        self.file.sync()
    }

    fn reserve(&mut self, end_bytes: u64) -> io::Result<()> {
        if end_bytes > self.room_bytes {
            return Err(io::ErrorKind::StorageFull.into());
        }
        self.file.reserve(end_bytes)
    }

    fn truncate(&mut self, end_bytes: u64) -> io::Result<()> {
        self.written_bytes = self.written_bytes.min(end_bytes);
        self.file.truncate(end_bytes)
    }

    fn free_bytes(&self) -> Option<u64> {
        Some(self.room_bytes.saturating_sub(self.written_bytes))
    }
}
