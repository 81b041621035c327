//! Image files and folders of them as arguments, and how their grey levels are read.

use super::CliError;
use super::print::errln;
use hydroline_capture::ImageFolder;
use hydroline_capture::folder::read_image;
use hydroline_core::frame::{
    BlockAccount, BlockAccountOptions, Channel, GreyImage, GreyRule, HiddenClipping, PictureBlocks,
    PixelFormat, StillError, hidden_in_still, inspect_still, still_format,
};
use hydroline_log::image_topic;
use hydroline_numerics::{cancel, parallel};
use std::path::{Path, PathBuf};

/// Conversion of images to grey levels.
#[derive(Debug, Clone, Copy, clap::Args)]
pub struct GreyArgs {
    /// Part of a colour image that is read: luma, or the laser's red, green or blue; default: the rig's laser.channel, else luma
    #[arg(long, value_parser = channel, value_name = "CHANNEL")]
    channel: Option<Channel>,
    /// Bits that samples of 16 really have, right-aligned (8 to 16); default: the rig's camera.bits, else 16
    #[arg(long, value_parser = clap::value_parser!(u8).range(8..=16), value_name = "N")]
    bits: Option<u8>,
}

impl GreyArgs {
    /// Rule of these arguments, where one is not given that of `rig`.
    pub fn over(&self, rig: GreyRule) -> GreyRule {
        GreyRule {
            channel: self.channel.unwrap_or(rig.channel),
            bits: self.bits.or(rig.bits),
            ..rig
        }
    }
}

fn channel(name: &str) -> Result<Channel, String> {
    let known = Channel::ALL.iter().find(|(word, _)| *word == name);
    known.map(|(_, channel)| *channel).ok_or_else(|| {
        let words = Channel::ALL.map(|(word, _)| word);
        format!("'{name}' is none of {}", words.join(", "))
    })
}

/// A number of frames in a second.
pub fn rate(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(rate) if (1e-3..=1e4).contains(&rate) => Ok(rate),
        _ => Err(format!(
            "'{text}' is not a number of frames in a second from 0.001 to 10000"
        )),
    }
}

/// The files named, with the images of a folder in its place, in the order of their names. What else is in a folder is
/// named on stderr.
pub fn files(paths: &[PathBuf]) -> Result<Vec<PathBuf>, CliError> {
    let mut files = Vec::new();
    for path in paths {
        if path.is_dir() {
            let folder = ImageFolder::open(path)?;
            if let Some(words) = folder.skipped() {
                errln!("hydroline: {words}");
            }
            files.extend(folder.images);
        } else {
            files.push(path.clone());
        }
    }
    Ok(files)
}

/// The topic of a log's images where it is not ours; says which, where nobody named it.
pub fn topic(log: &Path, named: Option<&str>) -> Result<Option<String>, CliError> {
    let found = image_topic(log, named)?;
    if let (Some(topic), None) = (&found, named) {
        errln!("hydroline: {}: images are read from {topic}", log.display());
    }
    Ok(found.map(|topic| topic.topic))
}

/// Why an image file gives no grey levels.
#[derive(Debug, thiserror::Error)]
pub enum ImageFileError {
    /// The system's reason.
    #[error(transparent)]
    Read(#[from] std::io::Error),
    /// The image's own.
    #[error(transparent)]
    Still(#[from] StillError),
}

impl ImageFileError {
    /// Whether it is an image, and damaged.
    pub fn is_damage(&self) -> bool {
        matches!(self, ImageFileError::Still(StillError::Damaged(_)))
    }
}

/// An image file's grey levels.
pub fn load(path: &Path, rule: &GreyRule) -> Result<GreyImage, ImageFileError> {
    load_with(path, rule, &PictureBlocks::default())
}

/// The same of one of several images of a camera whose picture has these blocks.
pub fn load_with(
    path: &Path,
    rule: &GreyRule,
    picture: &PictureBlocks,
) -> Result<GreyImage, ImageFileError> {
    let inspected = inspect_still(&read_image(path)?, rule)?;
    Ok(inspected.sound(picture).map_err(StillError::from)?)
}

/// Blocks that look like damage and are the picture of the camera that took several images; says so. Of an image or a few
/// nothing can be learnt.
pub fn picture(files: &[PathBuf], rule: &GreyRule) -> PictureBlocks {
    let options = BlockAccountOptions::default();
    if (files.len() as u64) < options.frames_min {
        return PictureBlocks::default();
    }
    let sampled = (0..files.len()).filter(|k| options.is_sampled(*k, files.len()));
    let sampled: Vec<&PathBuf> = sampled.map(|k| &files[k]).collect();
    let seams = parallel::map_slice(&sampled, |path| {
        cancel::check();
        // What cannot be read is said where it is used.
        let bytes = read_image(path).ok()?;
        let is_jpeg = still_format(&bytes) == Some(PixelFormat::Mjpg);
        let inspected = is_jpeg
            .then(|| inspect_still(&bytes, rule).ok())
            .flatten()?;
        Some(inspected.seams)
    });
    let mut account = BlockAccount::new(options);
    for seams in seams.into_iter().flatten() {
        account.see(&seams);
    }
    let picture = account.picture();
    if let Some(words) = picture.words() {
        let (n, of) = (account.explained(), sampled.len());
        errln!("hydroline: in {n} of {of} images looked at, {words}");
    }
    picture
}

/// Clipping that an image file's luma does not show.
pub fn hidden(path: &Path, rule: &GreyRule) -> Result<Option<HiddenClipping>, ImageFileError> {
    Ok(hidden_in_still(&read_image(path)?, rule)?)
}
