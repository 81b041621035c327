//! Frames, commands and sinks for the log's tests, in memory.

use std::io::{self, Write};
use std::path::PathBuf;
use std::sync::{Arc, Mutex};
use std::time::Duration;

use super::messages::{pb, timestamp};
use super::output::LogOutput;
use super::settings::PartOpener;

pub use hydroline_core::synthetic::{T0_NS, grey_frame};

pub fn command(sequence: u32) -> pb::ThrusterCommand {
    pb::ThrusterCommand {
        timestamp: Some(timestamp(T0_NS + u64::from(sequence) * 40_000_000)),
        sequence,
        thruster: "port".into(),
        thrust_n: f64::from(sequence) * 0.5,
        pulse_us: 1500.0,
        cause: "plan".into(),
        ..Default::default()
    }
}

#[derive(Default)]
pub struct Disk {
    pub files: Vec<Vec<u8>>,
    pub syncs: usize,
    /// Room for all files together.
    pub room: Option<u64>,
    /// Writes fail outright after that many bytes although `reserve` agreed.
    pub fails_after: Option<u64>,
    /// Writes panic beyond that many bytes.
    pub panics_after: Option<u64>,
    pub claimed: Vec<u64>,
}

/// A disk in memory: counts, fills up, stalls.
#[derive(Clone, Default)]
pub struct MemoryDisk {
    pub state: Arc<Mutex<Disk>>,
    pub stall: Arc<Mutex<Option<Duration>>>,
}

pub struct MemoryOutput {
    disk: MemoryDisk,
    index: usize,
}

impl MemoryDisk {
    pub fn opener(&self) -> Box<dyn PartOpener> {
        let disk = self.clone();
        Box::new(
            move |part: u32| -> io::Result<(Box<dyn LogOutput>, PathBuf)> {
                let mut state = disk.state.lock().unwrap();
                state.files.push(Vec::new());
                state.claimed.push(0);
                let sink = MemoryOutput {
                    disk: disk.clone(),
                    index: part as usize,
                };
                Ok((
                    Box::new(sink),
                    PathBuf::from(format!("memory_{part:04}.mcap")),
                ))
            },
        )
    }

    pub fn file(&self, part: usize) -> Vec<u8> {
        self.state.lock().unwrap().files[part].clone()
    }
}

impl Write for MemoryOutput {
    fn write(&mut self, buf: &[u8]) -> io::Result<usize> {
        let stall = self.disk.stall.lock().unwrap().take();
        if let Some(stall) = stall {
            std::thread::sleep(stall);
        }
        let mut state = self.disk.state.lock().unwrap();
        let used: u64 = state.files.iter().map(|f| f.len() as u64).sum();
        assert!(used <= state.panics_after.unwrap_or(u64::MAX), "bad sink");
        let limit = [state.room, state.fails_after]
            .into_iter()
            .flatten()
            .min()
            .unwrap_or(u64::MAX);
        let n = (limit.saturating_sub(used)).min(buf.len() as u64) as usize;
        if n == 0 && !buf.is_empty() {
            return Err(io::ErrorKind::StorageFull.into());
        }
        state.files[self.index].extend_from_slice(&buf[..n]);
        Ok(n)
    }
    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

impl LogOutput for MemoryOutput {
    fn sync(&mut self) -> io::Result<()> {
        self.disk.state.lock().unwrap().syncs += 1;
        Ok(())
    }
    fn reserve(&mut self, end_bytes: u64) -> io::Result<()> {
        let mut state = self.disk.state.lock().unwrap();
        let others: u64 = (0..state.files.len())
            .filter(|i| *i != self.index)
            .map(|i| (state.files[i].len() as u64).max(state.claimed[i]))
            .sum();
        if others + end_bytes > state.room.unwrap_or(u64::MAX) {
            return Err(io::ErrorKind::StorageFull.into());
        }
        let claimed = state.claimed[self.index].max(end_bytes);
        state.claimed[self.index] = claimed;
        Ok(())
    }
    fn truncate(&mut self, end_bytes: u64) -> io::Result<()> {
        let mut state = self.disk.state.lock().unwrap();
        state.files[self.index].truncate(end_bytes as usize);
        state.claimed[self.index] = 0;
        state.fails_after = None;
        Ok(())
    }
    fn free_bytes(&self) -> Option<u64> {
        let state = self.disk.state.lock().unwrap();
        let used: u64 = state.files.iter().map(|f| f.len() as u64).sum();
        state.room.map(|room| room.saturating_sub(used))
    }
}
