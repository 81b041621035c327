//! Boards out of images and logs.

use crate::print::errln;
use crate::{CliError, images, progress};
use hydroline_core::frame::{Frame, GreyImage, GreyRule};
use hydroline_daemon::calibrate::{Poses, Setup, see};
use hydroline_log::{LogReader, Record};
use hydroline_numerics::{cancel, parallel};
use hydroline_rigs::bounded;
use std::collections::BTreeMap;
use std::io::Read;
use std::path::{Path, PathBuf};

/// Frames looked at together.
const BATCH: usize = 32;
/// In a log every so many frames a missing board is asked for its reason.
const REASON_EVERY: u64 = 25;
/// First bytes of an MCAP file.
const MCAP_MAGIC: &[u8] = b"\x89MCAP";

/// One argument.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Source {
    Log(PathBuf),
    Image(PathBuf),
}

/// Logs and images distinguished by how they begin.
pub fn sources(paths: &[PathBuf]) -> Result<Vec<Source>, CliError> {
    let kind = |path: &PathBuf| {
        let mut start = Vec::new();
        bounded::open(path)
            .and_then(|f| f.take(MCAP_MAGIC.len() as u64).read_to_end(&mut start))
            .map_err(|e| CliError::reading(path, &e, "name a log or an image (PNG, JPEG)"))?;
        Ok(if start == MCAP_MAGIC {
            Source::Log(path.clone())
        } else {
            Source::Image(path.clone())
        })
    };
    paths.iter().map(kind).collect()
}

/// Options for reading images and logs.
pub struct Reading<'a> {
    /// Every so many frames of a log are looked at.
    pub every: u32,
    /// Topic of the logs' images, as named.
    pub image_topic: Option<&'a str>,
    /// Conversion of an image to grey levels.
    pub rule: GreyRule,
}

/// All boards seen.
#[derive(Debug, Default)]
pub struct Collected {
    /// By pose of the board.
    pub poses: Poses,
    /// The first image of each pose.
    pub shown: Vec<GreyImage>,
    /// Images and frames looked at.
    pub looked: u64,
    /// With the board.
    pub found: u64,
    /// Image files (not frames of logs) and logs that were refused.
    pub refused_images: u64,
    /// Of these, files that are no image.
    pub unreadable_images: u64,
    /// Frames of logs that nothing marks as faulty and that cannot be read.
    pub lost_frames: u64,
    /// Number of refusals by kind of reason; of each kind the first reason in full.
    pub refused: BTreeMap<String, u64>,
    kinds: BTreeMap<String, String>,
    /// Stamp of the newest frame with a board, UNIX \[ns\]; `None` for image files.
    pub last_ns: Option<u64>,
    /// Width and height of the first image \[px\].
    size: Option<(usize, usize)>,
}

impl Collected {
    /// The reasons, most frequent first, to stand after a count.
    pub fn reasons(&self) -> String {
        let mut reasons: Vec<_> = self.refused.iter().collect();
        reasons.sort_by_key(|(words, n)| (std::cmp::Reverse(**n), (*words).clone()));
        let list: Vec<String> = reasons.iter().map(|(w, n)| format!("{n} x {w}")).collect();
        if list.is_empty() {
            String::new()
        } else {
            format!(": {}", list.join("; "))
        }
    }

    /// All images must come from one camera, the rig's where one is named.
    fn check_size(&mut self, setup: &Setup, image: &GreyImage) -> Result<(), String> {
        let size = (image.width_px, image.height_px);
        let (wanted, whose) = match &setup.rig {
            Some(rig) => (
                (rig.camera.width_px as usize, rig.camera.height_px as usize),
                "the rig's camera delivers",
            ),
            None => (*self.size.get_or_insert(size), "the first image has"),
        };
        if size == wanted {
            return Ok(());
        }
        Err(format!(
            "the image has {} x {} px, {whose} {} x {}",
            size.0, size.1, wanted.0, wanted.1
        ))
    }

    fn refuse(&mut self, words: &str) {
        let reason: String = words
            .split([';', ','])
            .next()
            .unwrap_or_default()
            .chars()
            .filter(|c| !c.is_ascii_digit())
            .collect();
        let first = self.kinds.entry(reason).or_insert_with(|| words.to_owned());
        *self.refused.entry(first.clone()).or_default() += 1;
    }

    fn take(&mut self, setup: &Setup, looked: Looked) -> Result<(), String> {
        self.looked += 1;
        let (image, sighting) = looked?;
        self.check_size(setup, &image)?;
        match self.poses.push(setup, sighting) {
            Some(pose) => {
                self.found += 1;
                if pose == self.shown.len() {
                    self.shown.push(image);
                }
                Ok(())
            }
            None => Err(KEY_HIDDEN.to_owned()),
        }
    }
}

type Looked = Result<(GreyImage, hydroline_daemon::calibrate::Sighting), String>;

fn look(setup: &Setup, image: Result<GreyImage, String>, reason: bool) -> Looked {
    let image = image?;
    match see(setup, &image, reason) {
        Ok(sighting) => Ok((image, sighting)),
        Err(why) => Err(why.to_string()),
    }
}

/// Why an image with a board is left out.
const KEY_HIDDEN: &str = "the board's key is hidden, and which node is which depends on it; show its three discs, here or in another image of the same pose given before";

/// Looks for the board everywhere. Refused image files are named on stderr.
pub fn collect(
    setup: &Setup,
    sources: &[Source],
    reading: &Reading<'_>,
) -> Result<Collected, CliError> {
    let mut collected = Collected::default();
    let logs = sources.iter().any(|s| matches!(s, Source::Log(_)));
    let length = if logs { 0 } else { sources.len() as u64 };
    let bar = progress::bar(length, "images");
    for batch in batches(sources) {
        match batch {
            Batch::Images(paths) => {
                let looked = parallel::map_slice(&paths, |path| {
                    cancel::check();
                    let image = images::load(path, &reading.rule);
                    let unreadable = image.as_ref().is_err_and(|e| !e.is_damage());
                    let image = image.map_err(|e| e.to_string());
                    (unreadable, look(setup, image, true))
                });
                for (path, (unreadable, looked)) in paths.iter().zip(looked) {
                    collected.unreadable_images += u64::from(unreadable);
                    if let Err(words) = collected.take(setup, looked) {
                        bar.suspend(|| errln!("hydroline: {}: {words}", path.display()));
                        collected.refuse(&words);
                        collected.refused_images += 1;
                    }
                }
                bar.set_position(collected.looked);
            }
            Batch::Log(path) => {
                let done = log(setup, path, reading, &mut collected, &bar);
                match done.map_err(|e| e.about(path)) {
                    Err(error) if sources.len() > 1 => {
                        bar.suspend(|| errln!("hydroline: {error}"));
                        collected.refuse(&error.to_string());
                        collected.refused_images += 1;
                    }
                    done => done?,
                }
            }
        }
    }
    bar.finish_and_clear();
    Ok(collected)
}

enum Batch<'a> {
    Images(Vec<&'a Path>),
    Log(&'a Path),
}

/// Images that follow each other together, logs one by one.
fn batches(sources: &[Source]) -> Vec<Batch<'_>> {
    let mut batches: Vec<Batch<'_>> = Vec::new();
    for source in sources {
        match (source, batches.last_mut()) {
            (Source::Image(path), Some(Batch::Images(paths))) if paths.len() < BATCH => {
                paths.push(path);
            }
            (Source::Image(path), _) => batches.push(Batch::Images(vec![path])),
            (Source::Log(path), _) => batches.push(Batch::Log(path)),
        }
    }
    batches
}

fn log(
    setup: &Setup,
    path: &Path,
    reading: &Reading<'_>,
    collected: &mut Collected,
    bar: &indicatif::ProgressBar,
) -> Result<(), CliError> {
    let mut frames: Vec<(u64, Frame)> = Vec::with_capacity(BATCH);
    let mut index = 0u64;
    let mut flush = |frames: &mut Vec<(u64, Frame)>| {
        let looked = parallel::map_slice(frames, |(k, frame)| {
            cancel::check();
            if let Some(fault) = frame.meta.fault {
                let name = hydroline_log::messages::fault_name(fault);
                return (false, Err(format!("frame excluded: {name}")));
            }
            let grey = frame.to_grey(&reading.rule).map_err(|e| e.to_string());
            (grey.is_err(), look(setup, grey, k % REASON_EVERY == 0))
        });
        for ((_, frame), (lost, looked)) in frames.drain(..).zip(looked) {
            if let (true, Err(words)) = (lost, &looked) {
                collected.lost_frames += 1;
                bar.suspend(|| errln!("hydroline: {}: {words}", path.display()));
            }
            match collected.take(setup, looked) {
                Ok(()) => {
                    collected.last_ns = collected.last_ns.max(Some(frame.meta.mid_exposure_ns))
                }
                Err(words) => collected.refuse(&words),
            }
        }
        bar.set_position(collected.looked);
    };
    let every = reading.every;
    let topic = images::topic(path, reading.image_topic)?;
    for message in LogReader::open(path)?.with_images_of(topic.as_deref()) {
        let message = message?;
        if let Record::Frame(frame) = message.record {
            if index.is_multiple_of(u64::from(every)) {
                frames.push((index / u64::from(every), frame));
            }
            index += 1;
            if frames.len() == BATCH {
                flush(&mut frames);
            }
        }
    }
    flush(&mut frames);
    if index == 0 {
        return Err(CliError::Config(format!(
            "{}: holds no image; `hydroline info` shows what is in it",
            path.display()
        )));
    }
    Ok(())
}
