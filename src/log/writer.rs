//! The log as a sequence of files: rotation, free-space guard, clean stop, closing summary.
//!
//! [`LogWriter`] does no waiting and reads no clock: the recorder's thread drives it with the
//! host's monotonic clock, `simulate` and `replay` with the log's own time.

use std::collections::BTreeMap;
use std::io;
use std::path::PathBuf;

use super::LogError;
use super::entry::Entry;
use super::loss_account::{Counts, LogOutcome, Misplaced, SummaryInput, summary_map};
use super::output::NameLost;
use super::part::{Fault, PartFile};
use super::settings::{Head, PartOpener, WriteSettings};
use super::topic::Topic;
use hydroline_core::event::{Event, Severity, kind};

/// Writes entries into one file after the other.
pub struct LogWriter {
    opener: Box<dyn PartOpener>,
    head: Head,
    settings: WriteSettings,
    part: Option<PartFile>,
    number: u32,
    files: Vec<PathBuf>,
    finished_bytes: u64,
    sequences: BTreeMap<Topic, u32>,
    last_log_ns: u64,
    written: BTreeMap<&'static str, u64>,
    unwritten: BTreeMap<&'static str, u64>,
    stopped: Option<String>,
    rotation_refused: bool,
    misplaced: Vec<Misplaced>,
    /// Whether it was said that the open part's name is lost.
    name_lost: bool,
    /// Whether it was said that an entry is too large.
    said_too_large: bool,
    /// The last calibrations: sent once, needed in every part.
    calibrations: BTreeMap<Topic, Entry>,
}

impl LogWriter {
    /// Opens the first part and makes its head durable.
    ///
    /// # Errors
    /// [`LogError::Exists`], [`LogError::Create`] or [`LogError::Write`].
    pub fn create(
        mut opener: Box<dyn PartOpener>,
        head: Head,
        settings: WriteSettings,
        now_ns: u64,
    ) -> Result<Self, LogError> {
        let (part, path) = open_part(opener.as_mut(), &head, &settings, 0, now_ns)?;
        Ok(Self {
            opener,
            head,
            settings,
            part: Some(part),
            number: 0,
            files: vec![path],
            finished_bytes: 0,
            sequences: BTreeMap::new(),
            last_log_ns: 0,
            written: BTreeMap::new(),
            unwritten: BTreeMap::new(),
            stopped: None,
            rotation_refused: false,
            misplaced: Vec::new(),
            name_lost: false,
            said_too_large: false,
            calibrations: BTreeMap::new(),
        })
    }

    /// Writes one entry, or counts it as unwritten once the disk has refused. `counts` supplies
    /// the running numbers for the summary of a part that has to be closed here.
    pub fn write(&mut self, now_ns: u64, log_ns: u64, entry: &Entry, counts: &dyn Fn() -> Counts) {
        self.last_log_ns = self.last_log_ns.max(log_ns);
        let log_ns = self.last_log_ns;
        if let Entry::Message { topic, .. } = entry
            && topic.is_calibration()
        {
            self.calibrations.insert(*topic, entry.clone());
        }
        if let Err(refused) = entry.check_size() {
            if !std::mem::replace(&mut self.said_too_large, true) {
                tracing::error!("not written: {refused}");
            }
            self.count_unwritten(entry);
            return;
        }
        let mut tried = self.try_write(now_ns, log_ns, entry);
        if let Err(Some(Fault::Full(e))) = &tried
            && e.raw_os_error() == Some(libc::EFBIG)
            && !self.rotation_refused
        {
            // The file, not the disk, is full: the file system's or the process's limit on a file's size.
            self.rotate(now_ns, counts);
            tried = self.try_write(now_ns, log_ns, entry);
        }
        let written = match tried {
            Ok(closed_a_chunk) => {
                if closed_a_chunk {
                    self.guard(now_ns, counts);
                }
                true
            }
            Err(Some(fault)) => {
                self.stop(now_ns, &fault, counts);
                false
            }
            Err(None) => false,
        };
        if !written {
            self.count_unwritten(entry);
        }
    }

    fn count_unwritten(&mut self, entry: &Entry) {
        for part in entry.parts() {
            *self.unwritten.entry(part.topic.name()).or_default() += 1;
        }
    }

    /// `Err(None)` = writing has stopped before.
    fn try_write(
        &mut self,
        now_ns: u64,
        log_ns: u64,
        entry: &Entry,
    ) -> Result<bool, Option<Fault>> {
        let part = self.part.as_mut().ok_or(None)?;
        let sequences = &mut self.sequences;
        part.write(now_ns, log_ns, entry, |topic| {
            let next = sequences.entry(topic).or_default();
            let sequence = *next;
            *next = next.wrapping_add(1);
            sequence
        })
        .map_err(Some)
    }

    /// Closes chunks and syncs as they fall due.
    pub fn tick(&mut self, now_ns: u64, counts: &dyn Fn() -> Counts) {
        let Some(part) = &mut self.part else { return };
        match part.tick(now_ns) {
            Ok(due) if due.close || due.sync => {
                if due.sync {
                    self.watch_name(now_ns);
                }
                self.guard(now_ns, counts);
            }
            Ok(_) => {}
            Err(fault) => self.stop(now_ns, &fault, counts),
        }
    }

    /// When [`LogWriter::tick`] next has something to do.
    pub fn next_deadline_ns(&self) -> Option<u64> {
        self.part.as_ref()?.policy().next_deadline_ns()
    }

    /// Bytes in closed chunks and finished parts.
    pub fn bytes(&self) -> u64 {
        self.finished_bytes + self.part.as_ref().map_or(0, PartFile::bytes)
    }

    /// Reason why writing stopped, if it did.
    pub fn stopped(&self) -> Option<&str> {
        self.stopped.as_deref()
    }

    /// Adds the writer's own numbers.
    pub fn count_into(&self, counts: &mut Counts) {
        counts.messages.clone_from(&self.written);
        if let Some(part) = &self.part {
            for messages in [part.closed_messages(), part.open_messages()] {
                for (topic, n) in messages {
                    *counts.messages.entry(topic.name()).or_default() += n;
                }
            }
        }
        counts.unwritten.clone_from(&self.unwritten);
        counts.bytes = self.bytes();
        counts.stopped.clone_from(&self.stopped);
    }

    /// After data went to the disk (not after every message: it asks the file system): is there
    /// room, is the file big enough?
    fn guard(&mut self, now_ns: u64, counts: &dyn Fn() -> Counts) {
        let Some(part) = &self.part else { return };
        if part.policy().limits().min_free_bytes > 0 && part.policy().must_stop(part.free_bytes()) {
            let low = io::Error::new(
                io::ErrorKind::StorageFull,
                format!(
                    "{:.0} MB free, the rig's min_free_bytes keeps {:.0} MB",
                    part.free_bytes().unwrap_or(0) as f64 / 1e6,
                    part.policy().limits().min_free_bytes as f64 / 1e6
                ),
            );
            self.stop(now_ns, &Fault::Full(low), counts);
        } else if part.policy().must_rotate(part.bytes()) && !self.rotation_refused {
            self.rotate(now_ns, counts);
        }
    }

    /// Says once when the file is no longer found under its name: the data goes on into it and is saved at its end.
    fn watch_name(&mut self, now_ns: u64) {
        if self.name_lost {
            return;
        }
        let Some(lost) = self.part.as_ref().and_then(PartFile::name_lost) else {
            return;
        };
        self.name_lost = true;
        tracing::error!("{lost}");
        let event = Event::new(
            self.last_log_ns,
            Severity::Error,
            &kind::LOG_NAME_LOST,
            lost.to_string(),
        );
        self.own_event(now_ns, &event);
    }

    /// Of a closed part: where its data is, should its name be lost.
    fn find_again(&mut self, part: &mut PartFile) {
        self.name_lost = false;
        let Some(lost) = part.name_lost() else {
            return;
        };
        let now = match &lost {
            NameLost::Renamed { to, .. } => Some(to.clone()),
            NameLost::Gone { .. } => match part.save_beside() {
                Ok(path) => Some(path),
                Err(e) => {
                    tracing::error!("{lost}; it cannot be saved under another name: {e}");
                    None
                }
            },
        };
        let what = lost.to_string();
        self.misplaced.push(Misplaced { what, now });
    }

    /// The next part is opened before this one is closed: if that fails, nothing is lost and the
    /// recording goes on in the file it has.
    fn rotate(&mut self, now_ns: u64, counts: &dyn Fn() -> Counts) {
        let number = self.number + 1;
        match open_part(
            self.opener.as_mut(),
            &self.head,
            &self.settings,
            number,
            now_ns,
        ) {
            Ok((next, path)) => {
                let input = SummaryInput::clean("rotated");
                if let Some(mut part) = self.part.replace(next) {
                    self.close_part(&mut part, now_ns, &input, false, counts);
                }
                self.number = number;
                self.files.push(path);
                for entry in self.calibrations.clone().values() {
                    self.own_entry(now_ns, entry);
                }
                let message = format!("the log goes on in part {number}");
                let event = Event::new(
                    self.last_log_ns,
                    Severity::Info,
                    &kind::LOG_ROTATED,
                    message,
                )
                .with("part", f64::from(number));
                self.own_event(now_ns, &event);
            }
            Err(error) => {
                self.rotation_refused = true;
                let message = format!(
                    "part {number} cannot be opened, staying in part {}: {error}",
                    self.number
                );
                tracing::error!("{message}");
                let event = Event::new(
                    self.last_log_ns,
                    Severity::Warning,
                    &kind::LOG_ROTATION_FAILED,
                    message,
                );
                self.own_event(now_ns, &event);
            }
        }
    }

    fn own_event(&mut self, now_ns: u64, event: &Event) {
        self.own_entry(now_ns, &Entry::event(event));
    }

    fn own_entry(&mut self, now_ns: u64, entry: &Entry) {
        // A failure here shows again at the next entry, which is then counted.
        if let Err(Some(fault)) = self.try_write(now_ns, self.last_log_ns, entry) {
            tracing::error!("the log's own entry was not written: {fault}");
        }
    }

    /// Closes the file while it still can be closed; later entries are counted as unwritten.
    fn stop(&mut self, now_ns: u64, fault: &Fault, counts: &dyn Fn() -> Counts) {
        let Some(mut part) = self.part.take() else {
            return;
        };
        let why = fault.to_string();
        tracing::error!("the log stops: {why}");
        self.stopped = Some(why.clone());
        let input = SummaryInput {
            clean: false,
            ..SummaryInput::clean(why.clone())
        };
        if matches!(fault, Fault::Full(_)) {
            let event = Event::new(self.last_log_ns, Severity::Error, &kind::DISK_LOW, why);
            // The tail's reserve has room for this one message.
            let sequence = self.sequences.get(&Topic::Event).copied().unwrap_or(0);
            part.write(now_ns, self.last_log_ns, &Entry::event(&event), |_| {
                sequence
            })
            .ok();
            self.close_part(&mut part, now_ns, &input, true, counts);
        } else {
            self.abandon_part(&mut part, &input, counts);
        }
    }

    fn close_part(
        &mut self,
        part: &mut PartFile,
        now_ns: u64,
        input: &SummaryInput,
        last: bool,
        counts: &dyn Fn() -> Counts,
    ) {
        let mut messages = part.closed_messages().clone();
        for (topic, n) in part.open_messages() {
            *messages.entry(*topic).or_default() += n;
        }
        let mut all = counts();
        self.count_into(&mut all);
        add(&mut all.messages, &messages);
        let summary = summary_map(&all, &messages, self.number, last, input);
        match part.finish(now_ns, &summary) {
            Ok(bytes) => {
                self.finished_bytes += bytes;
                add(&mut self.written, &messages);
                self.find_again(part);
            }
            Err(fault) => {
                tracing::error!("part {} cannot be closed: {fault}", self.number);
                self.stopped.get_or_insert_with(|| fault.to_string());
                self.abandon_part(part, input, counts);
            }
        }
    }

    fn abandon_part(
        &mut self,
        part: &mut PartFile,
        input: &SummaryInput,
        counts: &dyn Fn() -> Counts,
    ) {
        let closed = part.closed_messages().clone();
        add(&mut self.written, &closed);
        add(&mut self.unwritten, part.open_messages());
        let mut all = counts();
        self.count_into(&mut all);
        let input = SummaryInput {
            clean: false,
            ..input.clone()
        };
        let summary = summary_map(&all, &closed, self.number, true, &input);
        match part.abandon(&summary) {
            Ok(bytes) => self.finished_bytes += bytes,
            Err(e) => {
                tracing::error!("the file stays without an end, `hydroline recover` mends it: {e}");
                self.finished_bytes += part.bytes();
            }
        }
        self.find_again(part);
    }

    /// Closes the last part.
    pub fn finish(
        mut self,
        now_ns: u64,
        input: &SummaryInput,
        counts: &dyn Fn() -> Counts,
    ) -> LogOutcome {
        if let Some(mut part) = self.part.take() {
            self.close_part(&mut part, now_ns, input, true, counts);
        }
        let mut all = counts();
        self.count_into(&mut all);
        LogOutcome {
            files: std::mem::take(&mut self.files),
            lost: all.lost_anything() || self.stopped.is_some(),
            stopped: self.stopped.clone(),
            misplaced: std::mem::take(&mut self.misplaced),
            counts: all,
        }
    }
}

fn add(into: &mut BTreeMap<&'static str, u64>, messages: &BTreeMap<Topic, u64>) {
    for (topic, n) in messages {
        *into.entry(topic.name()).or_default() += n;
    }
}

fn open_part(
    opener: &mut dyn PartOpener,
    head: &Head,
    settings: &WriteSettings,
    number: u32,
    now_ns: u64,
) -> Result<(PartFile, PathBuf), LogError> {
    let (sink, path) = opener.open(number).map_err(|source| match source.kind() {
        io::ErrorKind::AlreadyExists => LogError::Exists {
            part: number,
            reason: source.to_string(),
        },
        _ => LogError::Create {
            part: number,
            source,
        },
    })?;
    let (encoding, limits) = (&settings.encoding, settings.limits);
    match PartFile::create(sink, encoding, limits, head, number, now_ns) {
        Ok(part) => Ok((part, path)),
        Err(fault) => Err(LogError::Write {
            path,
            reason: fault.to_string(),
        }),
    }
}
