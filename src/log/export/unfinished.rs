//! The folder in which an export makes its files until all of them are whole: begun, gone on with after a kill, given their places.
//!
//! ```text
//! of.txt          log, options and version that it is of
//! NAME.png        an image that is whole
//! NAME.png.tmp    one that is not
//! moving.txt      the files, once all of them are whole and on the disk: from then on they get their places
//! ```

use super::{ExportOptions, Exported};
use crate::LogError;
use crate::atomic_file::rename_new;
use crate::held::{self, Holder};
use hydroline_core::build_info::VERSION;
use std::collections::BTreeSet;
use std::fmt::Write;
use std::fs::File;
use std::io::{self, ErrorKind};
use std::os::unix::fs::MetadataExt;
use std::path::{Path, PathBuf};

/// Name of the folder.
const UNFINISHED: &str = "unfinished.part";
/// List of the files that get their places. Its lines that begin with a slash are no names: what it is of, and the account.
const MOVING: &str = "moving.txt";
/// Log, options and version that the folder is of.
const OF: &str = "of.txt";
/// End of the name of a file that is not whole.
pub(super) const TMP: &str = ".tmp";
/// Number of the machine's start: what was written before a power cut may not be on the disk.
const BOOT_ID: &str = "/proc/sys/kernel/random/boot_id";

/// An export on its way, held by this process.
pub(super) struct Unfinished {
    /// Folder of the files until they get their places.
    pub part: PathBuf,
    into: PathBuf,
    identity: String,
    /// Names of images that an export of the same log left whole, as far as none of its frames came by yet.
    pub images: BTreeSet<String>,
    /// All files are whole: what is left is to give them their places.
    moving: Option<Moving>,
    /// Holds the lock for as long as it is open.
    _held: File,
}

/// Files that get their places.
struct Moving {
    names: Vec<String>,
    /// Account of the export, rows by name.
    account: Exported,
}

impl Unfinished {
    /// Goes on with the export that a kill broke off, where it is of the same log, options and version; else begins it.
    ///
    /// # Errors
    /// [`LogError::NotEmpty`]; [`LogError::BeingWritten`] when another process is at it; [`LogError::Output`].
    pub fn begin(log: &Path, into: &Path, options: ExportOptions) -> Result<Self, LogError> {
        let identity = identity(log, options)?;
        if let Some(resumed) = Self::resume(into, &identity)? {
            return Ok(resumed);
        }
        take_back(into)?;
        vacant(into, &[])?;
        let part = into.join(UNFINISHED);
        std::fs::create_dir(&part).map_err(LogError::output(&part))?;
        let (held, holder) = held::folder(&part).map_err(LogError::output(&part))?;
        if holder == Holder::Another {
            return Err(LogError::BeingWritten { path: part });
        }
        std::fs::write(part.join(OF), &identity).map_err(LogError::output(&part))?;
        Ok(Self::with_lock(into, identity, held))
    }

    fn with_lock(into: &Path, identity: String, held: File) -> Self {
        Self {
            part: into.join(UNFINISHED),
            into: into.to_owned(),
            identity,
            images: BTreeSet::new(),
            moving: None,
            _held: held,
        }
    }

    fn resume(into: &Path, identity: &str) -> Result<Option<Self>, LogError> {
        if !is_unfinished(into) {
            return Ok(None);
        }
        let part = into.join(UNFINISHED);
        let (held, holder) = held::folder(&part).map_err(LogError::output(&part))?;
        if holder == Holder::Another || !held::is_at(&held, &part) {
            return Err(LogError::BeingWritten { path: part });
        }
        if holder == Holder::Unknown {
            // Somebody may still be at it.
            return Ok(None);
        }
        let mut resumed = Self::with_lock(into, identity.to_owned(), held);
        if let Ok(text) = std::fs::read_to_string(part.join(MOVING)) {
            let moving = parsed(&text, identity);
            resumed.moving = moving.filter(|m| resumed.has_all(&m.names));
            if resumed.moving.is_none() {
                return Ok(None);
            }
            tracing::warn!(
                "{}: left by an export that was broken off: its files are whole and get their places",
                part.display()
            );
            return Ok(Some(resumed));
        }
        let of = std::fs::read_to_string(part.join(OF)).unwrap_or_default();
        if of != identity {
            return Ok(None);
        }
        vacant(into, &[UNFINISHED])?;
        resumed.images = left_images(&part).map_err(LogError::output(&part))?;
        tracing::warn!(
            "{}: left by an export that was broken off, and nobody writes it any more: it goes on, {} images are there",
            part.display(),
            resumed.images.len()
        );
        Ok(Some(resumed))
    }

    /// Whether each file is here or has its place.
    fn has_all(&self, names: &[String]) -> bool {
        let is_file = |path: PathBuf| path.symlink_metadata().is_ok_and(|m| m.is_file());
        let mut names = names.iter();
        names.all(|name| is_file(self.part.join(name)) || is_file(self.into.join(name)))
    }

    /// Whether all files are whole already; gives them their places then.
    ///
    /// # Errors
    /// [`LogError::Output`].
    pub fn placed(&self) -> Result<Option<Exported>, LogError> {
        let Some(moving) = &self.moving else {
            return Ok(None);
        };
        self.place(&moving.names)
            .map_err(LogError::output(&self.into))?;
        let account = self.with_places(&moving.account);
        Ok(Some(Exported {
            frames_resumed: account.frames,
            ..account
        }))
    }

    /// Gives the files their places, now that they are all made.
    ///
    /// # Errors
    /// [`LogError::Output`].
    pub fn settle(&self, account: &Exported) -> Result<Exported, LogError> {
        let settled = || -> io::Result<()> {
            let names = self.names()?;
            self.list(&names, account)?;
            self.place(&names)
        };
        settled().map_err(LogError::output(&self.into))?;
        Ok(self.with_places(account))
    }

    /// Names of the files; what an earlier attempt left beside them goes.
    ///
    /// # Errors
    /// The system's.
    pub fn names(&self) -> io::Result<Vec<String>> {
        let mut names = Vec::new();
        for name in names_in(&self.part)? {
            if name.ends_with(TMP) || self.images.contains(&name) {
                std::fs::remove_file(self.part.join(name))?;
            } else if name != OF {
                names.push(name);
            }
        }
        Ok(names)
    }

    /// Writes the list of the files: it is there when they are on the disk.
    ///
    /// # Errors
    /// The system's.
    pub fn list(&self, names: &[String], account: &Exported) -> io::Result<()> {
        let mut text = format!(
            "/of {}\n/frames {} {} {}\n",
            self.identity, account.frames, account.frames_skipped, account.frames_undecodable
        );
        for (path, rows) in &account.rows {
            let name = path.file_name().unwrap_or_default().to_string_lossy();
            let _ = writeln!(text, "/rows {rows} {name}");
        }
        for name in names {
            let _ = writeln!(text, "{name}");
        }
        let tmp = self.part.join(format!("{MOVING}{TMP}"));
        std::fs::write(&tmp, text)?;
        sync_file_system(&self.part)?;
        std::fs::rename(tmp, self.part.join(MOVING))?;
        sync_file_system(&self.part)
    }

    /// Gives the listed files their places, those that have not got them yet.
    fn place(&self, names: &[String]) -> io::Result<()> {
        for name in names {
            let from = self.part.join(name);
            if from.symlink_metadata().is_ok() {
                rename_new(&from, &self.into.join(name))?;
            }
        }
        // The list last: until then it says whose the files are.
        for own in [OF, MOVING] {
            match std::fs::remove_file(self.part.join(own)) {
                Err(e) if e.kind() == ErrorKind::NotFound => {}
                done => done?,
            }
        }
        std::fs::remove_dir(&self.part)
    }

    fn with_places(&self, account: &Exported) -> Exported {
        let place = |path: &PathBuf| self.into.join(path.file_name().unwrap_or_default());
        let rows = account.rows.iter();
        Exported {
            rows: rows.map(|(path, n)| (place(path), *n)).collect(),
            ..account.clone()
        }
    }

    /// Removes it, with the files that have their places already.
    ///
    /// # Errors
    /// The system's.
    pub fn clear(&self) -> io::Result<()> {
        clear(&self.part, &self.into)
    }
}

/// Log, options, version and start of the machine, in one line.
fn identity(log: &Path, options: ExportOptions) -> Result<String, LogError> {
    let meta = std::fs::metadata(log).map_err(LogError::read(log))?;
    let path = std::path::absolute(log).unwrap_or_else(|_| log.to_owned());
    let boot = std::fs::read_to_string(BOOT_ID).unwrap_or_default();
    Ok(format!(
        "{VERSION} {options:?} {} bytes of {}.{:09} s {path:?} boot {}",
        meta.len(),
        meta.mtime(),
        meta.mtime_nsec(),
        boot.trim()
    ))
}

/// List of the files that get their places, where it is of that identity.
fn parsed(text: &str, identity: &str) -> Option<Moving> {
    let mut lines = text.lines();
    if lines.next()?.strip_prefix("/of ")? != identity {
        return None;
    }
    let counts = lines.next()?.strip_prefix("/frames ")?.split(' ');
    let counts: Vec<u64> = counts.map(|n| n.parse().ok()).collect::<Option<_>>()?;
    let [frames, frames_skipped, frames_undecodable] = counts[..] else {
        return None;
    };
    let mut account = Exported {
        frames,
        frames_skipped,
        frames_undecodable,
        ..Exported::default()
    };
    let mut names = Vec::new();
    for line in lines {
        match line.strip_prefix("/rows ") {
            Some(rows) => {
                let (n, name) = rows.split_once(' ')?;
                account.rows.insert(name.into(), n.parse().ok()?);
            }
            None => names.push(line.to_owned()),
        }
    }
    Some(Moving { names, account })
}

/// Names in a folder. One that is no UTF-8 is none of ours.
fn names_in(folder: &Path) -> io::Result<Vec<String>> {
    let mut names = Vec::new();
    for entry in std::fs::read_dir(folder)? {
        names.extend(entry?.file_name().into_string());
    }
    Ok(names)
}

/// Images that are whole; all other files but [`OF`] are made again.
fn left_images(part: &Path) -> io::Result<BTreeSet<String>> {
    let mut images = BTreeSet::new();
    for name in names_in(part)? {
        let path = part.join(&name);
        if name.ends_with(".png") && path.symlink_metadata()?.is_file() {
            images.insert(name);
        } else if name != OF {
            std::fs::remove_file(path)?;
        }
    }
    Ok(images)
}

/// Refuses a folder that holds anything but these.
fn vacant(into: &Path, own: &[&str]) -> Result<(), LogError> {
    for entry in std::fs::read_dir(into).map_err(LogError::output(into))? {
        let name = entry.map_err(LogError::output(into))?.file_name();
        if !own.iter().any(|own| name == *own) {
            return Err(LogError::NotEmpty {
                path: into.to_owned(),
                found: name.to_string_lossy().into_owned(),
            });
        }
    }
    Ok(())
}

/// Whether an export into a folder was begun and did not come to its end.
pub fn is_unfinished(into: &Path) -> bool {
    into.join(UNFINISHED).is_dir()
}

/// Removes what an interrupted export of another log, option or version has left in a folder.
fn take_back(into: &Path) -> Result<(), LogError> {
    if !is_unfinished(into) {
        return Ok(());
    }
    let part = into.join(UNFINISHED);
    let (_held, holder) = held::folder(&part).map_err(LogError::output(&part))?;
    if holder == Holder::Another {
        return Err(LogError::BeingWritten { path: part });
    }
    tracing::warn!(
        "{}: left by an export that was broken off, of other data or options, and nobody writes it any more: it is made anew",
        part.display()
    );
    clear(&part, into).map_err(LogError::output(&part))
}

/// Removes an export that did not come to its end, with the files that had their places already.
fn clear(part: &Path, into: &Path) -> io::Result<()> {
    let moved = std::fs::read_to_string(part.join(MOVING)).unwrap_or_default();
    for name in moved.lines().filter(|name| !name.contains('/')) {
        let (here, there) = (part.join(name), into.join(name));
        if here.symlink_metadata().is_err() && there.symlink_metadata().is_ok_and(|m| m.is_file()) {
            std::fs::remove_file(there)?;
        }
    }
    std::fs::remove_dir_all(part)
}

/// Thousands of frames are synced with one call instead of one each.
fn sync_file_system(folder: &Path) -> io::Result<()> {
    use std::os::fd::AsRawFd;
    let folder = File::open(folder)?;
    // SAFETY: syncfs only reads the descriptor, which is open.
    match unsafe { libc::syncfs(folder.as_raw_fd()) } {
        0 => Ok(()),
        _ => Err(io::Error::last_os_error()),
    }
}
