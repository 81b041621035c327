//! Blocks of a log's JPEGs that look like damage and are its picture: found in frames spread over the log, before it is replayed.

use super::input::Input;
use super::{BATCH, Options, ReplayError};
use hydroline_core::frame::{
    BlockAccount, BlockAccountOptions, Frame, GreyRule, JpegDamage, PictureBlocks, PixelFormat,
};
use hydroline_log::Record;
use rayon::prelude::*;
use std::path::Path;

/// The picture's own blocks, and in how many of how many frames some of them are flagged.
pub(super) struct Found {
    pub blocks: PictureBlocks,
    flagged: u64,
    looked_at: usize,
}

impl Found {
    /// For a person; `None` = there are none.
    pub fn words(&self) -> Option<String> {
        let words = self.blocks.words()?;
        Some(format!(
            "in {} of {} frames looked at, {words}",
            self.flagged, self.looked_at
        ))
    }
}

/// Whether a frame's blocks say something: a JPEG that nothing marks as faulty.
fn counts(frame: &Frame) -> bool {
    frame.format == PixelFormat::Mjpg && frame.meta.fault.is_none()
}

/// The log's JPEGs that nothing marks as faulty.
fn jpegs(input: Input) -> impl Iterator<Item = Result<Frame, ReplayError>> {
    input.filter_map(|message| match message {
        Ok(message) => match message.record {
            Record::Frame(frame) => counts(&frame).then_some(Ok(frame)),
            _ => None,
        },
        Err(error) => Some(Err(error)),
    })
}

/// Looks at frames spread over a log.
pub(super) fn find(log: &Path, options: &Options) -> Result<Found, ReplayError> {
    let thresholds = BlockAccountOptions::default();
    let mut frames = 0;
    for frame in jpegs(options.open(log)?) {
        frame?;
        frames += 1;
    }
    let mut account = BlockAccount::new(thresholds);
    let mut pending = Vec::with_capacity(BATCH);
    for (index, frame) in jpegs(options.open(log)?).enumerate() {
        let frame = frame?;
        if thresholds.is_sampled(index, frames) {
            pending.push(frame);
        }
        if pending.len() == BATCH {
            look(&mut pending, &options.rule, &mut account);
        }
    }
    look(&mut pending, &options.rule, &mut account);
    Ok(Found {
        blocks: account.picture(),
        flagged: account.explained(),
        looked_at: frames.min(thresholds.sample_frames),
    })
}

/// Decodes in parallel and counts in the log's order. What does not decode is reported where it is replayed.
fn look(pending: &mut Vec<Frame>, rule: &GreyRule, account: &mut BlockAccount) {
    let seams: Vec<Option<Vec<JpegDamage>>> = pending
        .par_iter()
        .map(|frame| frame.inspect(rule).ok().map(|inspected| inspected.seams))
        .collect();
    for seams in seams.into_iter().flatten() {
        account.see(&seams);
    }
    pending.clear();
}
