//! Where a log file's bytes go. The writer sees only [`LogOutput`]; tests inject slow and full ones.

use std::fs::{File, OpenOptions};
use std::io::{self, Write};
use std::os::fd::AsRawFd;
use std::path::{Path, PathBuf};

/// A growing file.
pub trait LogOutput: Write + Send {
    /// Makes everything written so far durable.
    fn sync(&mut self) -> io::Result<()>;

    /// Claims room so that the file can grow to `end_bytes` without running out of space.
    /// Called often; a sink should claim ahead.
    ///
    /// # Errors
    /// `StorageFull` when there is no room.
    fn reserve(&mut self, end_bytes: u64) -> io::Result<()>;

    /// Cuts the file at `end_bytes` and gives back what was claimed beyond.
    fn truncate(&mut self, end_bytes: u64) -> io::Result<()>;

    /// Bytes left for us on the device, claimed ones included; `None` = not known.
    fn free_bytes(&self) -> Option<u64>;

    /// Reason why the file is no longer under the name with which it was created; `None` = it still is,
    /// or the sink has no name.
    fn name_lost(&self) -> Option<NameLost> {
        None
    }

    /// Saves what was written under a new name beside the one that was lost.
    fn save_beside(&mut self) -> io::Result<PathBuf> {
        Err(io::ErrorKind::Unsupported.into())
    }
}

/// Reason why a file is not found under its name any more.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[allow(missing_docs)] // Each message names its fields.
pub enum NameLost {
    #[error("the log's file {} was renamed while it was being written: it is {} now", from.display(), to.display())]
    Renamed { from: PathBuf, to: PathBuf },
    #[error("the log's file {} was removed, replaced or mounted over while it was being written", path.display())]
    Gone { path: PathBuf },
}

/// Blocks are claimed this far ahead, so that one system call serves several chunks.
const CLAIM_AHEAD_BYTES: u64 = 8 << 20;

/// A real file: fdatasync, fallocate beyond the end.
#[derive(Debug)]
pub struct FileOutput {
    file: File,
    path: PathBuf,
    claimed_bytes: u64,
    can_claim: bool,
}

impl FileOutput {
    /// Creates the file; refuses to touch an existing one unless `replace`.
    ///
    /// # Errors
    /// `AlreadyExists`, or whatever the file system says.
    pub fn create(path: &Path, replace: bool) -> io::Result<Self> {
        let mut options = OpenOptions::new();
        options.read(true).write(true);
        if replace {
            options.create(true).truncate(true);
        } else {
            options.create_new(true);
        }
        let file = options.open(path)?;
        // A file whose directory entry is not durable is lost with the power, synced or not.
        let parent = path
            .parent()
            .filter(|p| !p.as_os_str().is_empty())
            .unwrap_or(Path::new("."));
        if let Ok(directory) = File::open(parent) {
            directory.sync_all().ok();
        }
        Ok(Self {
            file,
            path: path.to_owned(),
            claimed_bytes: 0,
            can_claim: true,
        })
    }

    /// Path of the file.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// fallocate(FALLOC_FL_KEEP_SIZE): claims blocks, leaves the size (and so the reader's view) alone.
    fn claim(&self, end_bytes: u64) -> io::Result<()> {
        let from = self.claimed_bytes as libc::off_t;
        let length = (end_bytes - self.claimed_bytes) as libc::off_t;
        // SAFETY: the descriptor is open for as long as `self.file`; no memory is passed.
        let rc = unsafe {
            libc::fallocate(
                self.file.as_raw_fd(),
                libc::FALLOC_FL_KEEP_SIZE,
                from,
                length,
            )
        };
        if rc == 0 {
            Ok(())
        } else {
            Err(io::Error::last_os_error())
        }
    }
}

impl Write for FileOutput {
    fn write(&mut self, buf: &[u8]) -> io::Result<usize> {
        self.file.write(buf)
    }
    fn flush(&mut self) -> io::Result<()> {
        self.file.flush()
    }
}

impl LogOutput for FileOutput {
    fn sync(&mut self) -> io::Result<()> {
        self.file.sync_data()
    }

    fn reserve(&mut self, end_bytes: u64) -> io::Result<()> {
        if end_bytes <= self.claimed_bytes || !self.can_claim {
            return Ok(());
        }
        // Ahead if there is room for that, else exactly what is needed.
        for target in [end_bytes + CLAIM_AHEAD_BYTES, end_bytes] {
            match self.claim(target) {
                Ok(()) => {
                    self.claimed_bytes = target;
                    return Ok(());
                }
                Err(e) if e.kind() == io::ErrorKind::Interrupted => {}
                // File systems without fallocate (some network and FUSE ones) rely on the free
                // space guard and, in the end, on cutting back to the last good chunk.
                Err(e) if matches!(e.raw_os_error(), Some(libc::EOPNOTSUPP | libc::ENOSYS)) => {
                    self.can_claim = false;
                    return Ok(());
                }
                Err(e) if target == end_bytes => return Err(e),
                Err(_) => {}
            }
        }
        Ok(())
    }

    fn truncate(&mut self, end_bytes: u64) -> io::Result<()> {
        self.file.set_len(end_bytes)?;
        self.claimed_bytes = end_bytes;
        io::Seek::seek(&mut self.file, io::SeekFrom::Start(end_bytes)).map(|_| ())
    }

    fn free_bytes(&self) -> Option<u64> {
        free_bytes(&self.path)
    }

    fn name_lost(&self) -> Option<NameLost> {
        use std::os::unix::fs::MetadataExt;
        let ours = self.file.metadata().ok()?;
        let same = |path: &Path| {
            let found = path.metadata();
            found.is_ok_and(|m| (m.dev(), m.ino()) == (ours.dev(), ours.ino()))
        };
        if same(&self.path) {
            return None;
        }
        // The kernel knows the name an open file has now; of a removed file it is the old one with a remark.
        let link = format!("/proc/self/fd/{}", self.file.as_raw_fd());
        let now = std::fs::read_link(link).ok().filter(|to| same(to));
        Some(match now {
            Some(to) => NameLost::Renamed {
                from: self.path.clone(),
                to,
            },
            None => NameLost::Gone {
                path: self.path.clone(),
            },
        })
    }

    fn save_beside(&mut self) -> io::Result<PathBuf> {
        let stem = self.path.file_stem().unwrap_or_default().to_string_lossy();
        let extension = self
            .path
            .extension()
            .map_or("mcap".into(), |e| e.to_string_lossy());
        let mut taken = 0u32;
        loop {
            let number = if taken == 0 {
                String::new()
            } else {
                format!("-{taken}")
            };
            let path = self
                .path
                .with_file_name(format!("{stem}-saved{number}.{extension}"));
            let mut options = OpenOptions::new();
            match options.write(true).create_new(true).open(&path) {
                Ok(mut copy) => {
                    io::Seek::seek(&mut self.file, io::SeekFrom::Start(0))?;
                    io::copy(&mut self.file, &mut copy)?;
                    copy.sync_all()?;
                    return Ok(path);
                }
                Err(e) if e.kind() == io::ErrorKind::AlreadyExists && taken < 100 => taken += 1,
                Err(e) => return Err(e),
            }
        }
    }
}

/// Free bytes for an unprivileged writer on the file system that holds `path` (or its directory).
pub fn free_bytes(path: &Path) -> Option<u64> {
    use std::os::unix::ffi::OsStrExt;
    let existing = path.ancestors().map(|p| {
        if p.as_os_str().is_empty() {
            Path::new(".")
        } else {
            p
        }
    });
    let existing = existing.into_iter().find(|p| p.exists())?;
    let name = std::ffi::CString::new(existing.as_os_str().as_bytes()).ok()?;
    let mut stat = std::mem::MaybeUninit::<libc::statvfs>::uninit();
    // SAFETY: `name` is a terminated string, `stat` is large enough and only read on success.
    let stat = unsafe {
        if libc::statvfs(name.as_ptr(), stat.as_mut_ptr()) != 0 {
            return None;
        }
        stat.assume_init()
    };
    Some(stat.f_bavail.saturating_mul(stat.f_frsize))
}
