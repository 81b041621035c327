//! Poses fitted before it is known where the vehicle was: frames of a run side by side.
//!
//! A hint decides where a fit starts and nothing after that. So frames are fitted in parallel with the
//! hint that the run's last known motion gives; when its turn comes, each is asked again where it
//! would have started with the hint that it has now. Where that is the same, so is the pose, bit for
//! bit; where not, it is fitted anew.

use super::{Hint, JointPose, PoseFault, PoseFitter, Starts};
use crate::initial::{self, Guess};
use crate::segments::Levels;
use hydroline_core::frame::GreyImage;
use hydroline_stripe::Profile;

/// A frame fitted ahead of its turn.
#[derive(Debug, Clone)]
pub struct Speculative {
    hint: Hint,
    levels: Result<(Levels, Vec<Guess>), PoseFault>,
    starts: Result<Starts, PoseFault>,
    pose: Result<JointPose, PoseFault>,
}

impl PoseFitter {
    /// Fits a frame with the hint that is at hand.
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

    /// The pose of that frame with the hint that it has when its turn comes: what [`Self::fit`] would say.
    ///
    /// # Errors
    /// [`PoseFault`] says why there is none.
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
