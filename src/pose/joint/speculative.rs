//! Speculative fits: frames of a run in parallel, before the hint of each is known.
//!
//! A hint decides where a fit starts and nothing after that. So frames are fitted in parallel with the
//! hint predicted from the run's last known motion; in its turn, each frame's start is computed again
//! with the actual hint. Where the start is the same, so is the pose, bit for bit; where not, the frame
//! is fitted anew.

use super::{Hint, JointPose, PoseFault, PoseFitter, Starts};
use crate::initial::{self, Guess};
use crate::segments::Levels;
use hydroline_core::frame::GreyImage;
use hydroline_stripe::Profile;

/// A frame fitted with a predicted hint.
#[derive(Debug, Clone)]
pub struct Speculative {
    hint: Hint,
    levels: Result<(Levels, Vec<Guess>), PoseFault>,
    starts: Result<Starts, PoseFault>,
    pose: Result<JointPose, PoseFault>,
}

impl PoseFitter {
    /// Fits a frame with a predicted hint.
    pub fn speculative(&self, image: &GreyImage, profile: &Profile, hint: &Hint) -> Speculative {
        let levels = self.levels(image, profile).map(|levels| {
            let all = initial::guesses(&levels, &self.model.surfaces, &self.mounts);
            (levels, all)
        });
        let starts = match &levels {
            Ok((levels, all)) => self.starts(image, profile, levels, all, hint),
            Err(fault) => Err(fault.clone()),
        };
        let pose = starts
            .clone()
            .and_then(|starts| self.fit_from(image, profile, starts, hint));
        Speculative {
            hint: *hint,
            levels,
            starts,
            pose,
        }
    }

    /// The pose of that frame under its actual hint: the result of [`Self::fit`].
    ///
    /// # Errors
    /// [`PoseFault`]: why there is none.
    pub fn fit_speculative(
        &self,
        image: &GreyImage,
        profile: &Profile,
        speculative: Speculative,
        hint: &Hint,
    ) -> Result<JointPose, PoseFault> {
        let (levels, all) = speculative.levels?;
        let starts = self.starts(image, profile, &levels, &all, hint)?;
        if speculative.hint.held == hint.held && speculative.starts.as_ref() == Ok(&starts) {
            return speculative.pose;
        }
        self.fit_from(image, profile, starts, hint)
    }
}
