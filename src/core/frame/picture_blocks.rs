//! Blocks of a camera's JPEGs that do not fit their neighbours because the picture is so.
//!
//! Text laid over a picture, and squares drawn sharp on the blocks' own grid, look like damage to `seams`, in every frame.
//! Damage is rare and wanders: a block that is flagged in many frames of one camera is the picture, and a frame in which no
//! other block is flagged is sound. Data that do not decode are never explained by it.

use std::collections::{BTreeMap, BTreeSet};

use super::JpegDamage;

/// First pixel of a block as the image is stored: column and row \[px\].
type Block = (usize, usize);

/// Thresholds of a [`BlockAccount`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BlockAccountOptions {
    /// Share of the frames seen from which a block that is flagged in them is the picture. Damage is spread over all blocks
    /// that hold data: even where every frame is damaged, and most data are those of a stripe, a block has a few percent.
    pub share_min: f64,
    /// Fewest frames in which a block of the picture is flagged: of fewer, a share says nothing, and a damaged buffer may be
    /// handed out twice.
    pub frames_min: u64,
    /// Different sets of flagged blocks that are kept of refused frames, in case that later frames explain them: a picture makes a
    /// few before it is known, and a broken camera must not fill the memory.
    pub sets_max: usize,
    /// Frames of a log, spread over it, that are looked at before it is read: enough for a tenth of them to be `frames_min`, and
    /// with room.
    pub sample_frames: usize,
}

impl Default for BlockAccountOptions {
    fn default() -> Self {
        Self {
            share_min: 0.1,
            frames_min: 5,
            sets_max: 1024,
            sample_frames: 100,
        }
    }
}

impl BlockAccountOptions {
    /// Whether the frame of this index, of so many, is one of those that are looked at before.
    pub fn is_sampled(&self, index: usize, frames: usize) -> bool {
        let taken = self.sample_frames.min(frames);
        // The middle of each of as many equal parts.
        frames > 0 && (index * taken) / frames != ((index + 1) * taken) / frames
    }
}

/// Blocks that are flagged in a camera's frames and are its picture. The default has none.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct PictureBlocks(BTreeSet<Block>);

impl PictureBlocks {
    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    /// Number of the blocks.
    pub fn len(&self) -> usize {
        self.0.len()
    }

    /// Whether the picture explains what looks like damage.
    pub fn explains(&self, damage: &JpegDamage) -> bool {
        damage
            .block_px()
            .is_some_and(|block| self.0.contains(&block))
    }

    /// Words for a person about these blocks and the use of the frames; `None` = there are none.
    pub fn words(&self) -> Option<String> {
        let (column_px, row_px) = self.0.first()?;
        Some(format!(
            "{} blocks of 8 x 8 pixels do not fit their neighbours in frame after frame, one of them at column {column_px}, row {row_px}: \
             taken for the picture (text over it? sharp edges on the JPEG's grid?), and the frames are used; damage in these blocks is not seen",
            self.0.len()
        ))
    }
}

/// Account of the blocks that are flagged in a camera's frames, frame by frame.
#[derive(Debug, Clone, Default)]
pub struct BlockAccount {
    options: BlockAccountOptions,
    frames: u64,
    flagged: BTreeMap<Block, u64>,
    /// Frames refused when they were seen, by their flagged blocks.
    refused: BTreeMap<Vec<Block>, u64>,
    /// Frames refused whose blocks are not kept.
    refused_for_good: u64,
    /// Frames used although blocks of them are flagged.
    used: u64,
}

impl BlockAccount {
    /// An account that has seen nothing.
    pub fn new(options: BlockAccountOptions) -> Self {
        Self {
            options,
            ..Self::default()
        }
    }

    /// Counts a frame whose data are whole, with what its seams show ([`super::InspectedImage::seams`]).
    pub fn see(&mut self, seams: &[JpegDamage]) {
        self.frames += 1;
        let blocks: BTreeSet<Block> = seams.iter().filter_map(JpegDamage::block_px).collect();
        if blocks.is_empty() {
            return;
        }
        for block in &blocks {
            *self.flagged.entry(*block).or_default() += 1;
        }
        let picture = self.picture();
        if blocks.is_subset(&picture.0) {
            self.used += 1;
            return;
        }
        let blocks: Vec<Block> = blocks.into_iter().collect();
        let has_room = self.refused.len() < self.options.sets_max;
        match self.refused.get_mut(&blocks) {
            Some(frames) => *frames += 1,
            None if has_room => {
                self.refused.insert(blocks, 1);
            }
            None => self.refused_for_good += 1,
        }
    }

    /// The picture's own blocks, as the frames so far show them.
    pub fn picture(&self) -> PictureBlocks {
        let share = self.options.share_min * self.frames as f64;
        let least = share.max(self.options.frames_min as f64);
        let often = self.flagged.iter().filter(|(_, n)| **n as f64 >= least);
        PictureBlocks(often.map(|(block, _)| *block).collect())
    }

    /// Frames that were refused when they were seen, and that the frames since then explain.
    pub fn explained_later(&self) -> u64 {
        let picture = self.picture();
        let explained = |blocks: &[Block]| blocks.iter().all(|block| picture.0.contains(block));
        let frames = self.refused.iter().filter(|(blocks, _)| explained(blocks));
        frames.map(|(_, n)| n).sum()
    }

    /// Frames with flagged blocks that are the picture's.
    pub fn explained(&self) -> u64 {
        self.used + self.explained_later()
    }

    /// Frames with flagged blocks that nothing explains.
    pub fn damaged(&self) -> u64 {
        let refused = self.refused.values().sum::<u64>() + self.refused_for_good;
        refused - self.explained_later()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(column_px: usize, row_px: usize) -> JpegDamage {
        JpegDamage::Foreign { column_px, row_px }
    }

    #[test]
    fn a_block_flagged_frame_after_frame_is_the_picture_and_the_first_frames_are_explained_by_it() {
        let mut account = BlockAccount::default();
        for _ in 0..4 {
            account.see(&[at(8, 16), at(16, 16)]);
        }
        assert!(account.picture().is_empty());
        assert_eq!((account.damaged(), account.explained()), (4, 0));
        account.see(&[at(8, 16), at(16, 16)]);
        let picture = account.picture();
        assert_eq!(picture.len(), 2);
        assert!(picture.explains(&at(8, 16)) && !picture.explains(&at(8, 8)));
        // However the block is called.
        assert!(picture.explains(&JpegDamage::Step {
            column_px: 8,
            row_px: 16,
            levels: 3
        }));
        assert!(!picture.explains(&JpegDamage::NoStart));
        assert_eq!((account.damaged(), account.explained()), (0, 5));
        assert_eq!(account.explained_later(), 4);
        let words = picture.words().unwrap();
        assert!(
            words.contains("2 blocks") && words.contains("column 8, row 16"),
            "{words}"
        );
        // A block beside it is damage still.
        account.see(&[at(8, 16), at(80, 16)]);
        assert_eq!((account.damaged(), account.explained()), (1, 5));
    }

    #[test]
    fn damage_wanders_and_is_explained_by_nothing() {
        let mut account = BlockAccount::default();
        for k in 0..200 {
            account.see(&[at(8 * (k % 40), 8)]);
        }
        assert!(account.picture().is_empty() && account.picture().words().is_none());
        assert_eq!((account.damaged(), account.explained()), (200, 0));
        // Nor is a block that was flagged in five of many.
        let mut account = BlockAccount::default();
        for k in 0..100 {
            let seams = if k < 5 { vec![at(8, 8)] } else { Vec::new() };
            account.see(&seams);
        }
        assert!(account.picture().is_empty());
    }

    #[test]
    fn a_broken_camera_does_not_fill_the_memory() {
        let options = BlockAccountOptions {
            sets_max: 10,
            ..BlockAccountOptions::default()
        };
        let mut account = BlockAccount::new(options);
        for k in 0..500 {
            account.see(&[at(8 * k, 8)]);
        }
        assert_eq!((account.refused.len(), account.damaged()), (10, 500));
    }

    #[test]
    fn the_frames_looked_at_before_are_spread_over_the_log() {
        let options = BlockAccountOptions::default();
        for frames in [0, 1, 7, 100, 101, 15_000] {
            let taken = (0..frames).filter(|k| options.is_sampled(*k, frames));
            assert_eq!(taken.count(), frames.min(100), "{frames}");
        }
    }
}
