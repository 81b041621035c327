//! Input of a replay: a log, or a folder of images in its place.

use std::collections::BTreeMap;
use std::path::Path;

use hydroline_capture::{FolderFrames, ImageFolder};
use hydroline_core::frame::GreyRule;
use hydroline_log::messages::frame_info;
use hydroline_log::{LogMessage, LogReader, MetadataMap, Record, SealFinding};

use super::{Options, ReplayError};

/// Messages in their order.
pub(super) enum Input {
    Log(Box<LogReader>),
    Folder(Box<Folder>),
}

/// A folder's frames, each behind its account.
pub(super) struct Folder {
    frames: FolderFrames,
    /// The frame whose account was handed out.
    next: Option<LogMessage>,
    index: u64,
    metadata: BTreeMap<String, MetadataMap>,
}

impl Input {
    /// Opens a log, with the frames of the topic that was chosen, or a folder.
    pub fn open(path: &Path, options: &Options) -> Result<Self, ReplayError> {
        if path.is_dir() {
            let frames = ImageFolder::open(path)?.frames(options.rate_hz)?;
            return Ok(Input::Folder(Box::new(Folder {
                frames,
                next: None,
                index: 0,
                metadata: BTreeMap::new(),
            })));
        }
        let reader = LogReader::open(path)?.with_images_of(options.image_topic.as_deref());
        Ok(Input::Log(Box::new(reader)))
    }

    /// The log's metadata; a folder has none.
    pub fn metadata(&self) -> &BTreeMap<String, MetadataMap> {
        match self {
            Input::Log(reader) => reader.metadata(),
            Input::Folder(folder) => &folder.metadata,
        }
    }

    fn log(&self) -> Option<&LogReader> {
        match self {
            Input::Log(reader) => Some(reader),
            Input::Folder(_) => None,
        }
    }

    /// Rule by which the recording read its frames; `None` = it read none.
    pub fn grey_rule(&self) -> Option<GreyRule> {
        self.log().map(LogReader::grey_rule)
    }

    /// The rig that it was recorded with.
    pub fn rig_toml(&self) -> Option<&str> {
        self.log()?.rig_toml()
    }

    /// Metadata that is not as it was written.
    pub fn seal_findings(&self) -> Vec<SealFinding> {
        self.log().map_or_else(Vec::new, LogReader::seal_findings)
    }

    /// Frames that are known to be missing.
    pub fn missing(&self) -> u64 {
        match self {
            Input::Log(_) => 0,
            Input::Folder(folder) => folder.frames.missing(),
        }
    }
}

impl Iterator for Input {
    type Item = Result<LogMessage, ReplayError>;

    fn next(&mut self) -> Option<Self::Item> {
        match self {
            Input::Log(reader) => reader.next().map(|item| item.map_err(Into::into)),
            Input::Folder(folder) => folder.next(),
        }
    }
}

impl Folder {
    fn next(&mut self) -> Option<Result<LogMessage, ReplayError>> {
        if let Some(frame) = self.next.take() {
            return Some(Ok(frame));
        }
        let frame = match self.frames.next()? {
            Ok(frame) => frame,
            Err(error) => return Some(Err(error.into())),
        };
        let message = |record| LogMessage {
            log_ns: frame.meta.mid_exposure_ns,
            publish_ns: frame.meta.mid_exposure_ns,
            sequence: frame.meta.sequence,
            offset: 0,
            record,
        };
        let account = message(Record::FrameInfo(frame_info(&frame, self.index)));
        self.index += 1;
        self.next = Some(message(Record::Frame(frame.clone())));
        Some(Ok(account))
    }
}
