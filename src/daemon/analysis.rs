//! Analysis of one frame: the same code live (`record`, `aim`) and offline (`replay`), so that
//! the two agree bit for bit. A result depends on the frame and the calibration alone; whether a JPEG with blocks that look
//! like damage has one depends on what is known of the camera's picture, live on the frames so far.

use hydroline_calib::plane::PlaneMap;
use hydroline_core::frame::{BlockAccount, Frame, FrameError, GreyImage, GreyRule, PictureBlocks};
use hydroline_log::messages::{fault_name, pb::StripeProfile, timestamp};
use hydroline_stripe::{Extractor, ExtractorConfig, Profile};
use nalgebra::Matrix2;
use std::sync::Arc;

/// Blocks that look like damage and are the camera's picture.
enum Picture {
    Known(Arc<PictureBlocks>),
    /// Those that the frames so far show.
    Learnt(Box<BlockAccount>),
}

/// Reason why nothing was extracted from a frame.
#[derive(Debug)]
pub enum NotExtracted {
    /// The recording marks it as faulty.
    Excluded,
    /// It has no grey levels.
    Unreadable(FrameError),
}

/// Grey image of a frame and its profile in full precision.
pub type Extracted = Result<(GreyImage, Profile), NotExtracted>;

/// Turns frames into profiles. One per thread: it holds scratch memory and the account of the picture's blocks, never
/// results.
pub struct Analyst {
    extractor: Extractor,
    map: Option<Arc<dyn PlaneMap>>,
    rule: GreyRule,
    picture: Picture,
}

impl Analyst {
    /// `map` = the calibration from image to laser plane; without one, profiles carry no plane coordinates. `rule` =
    /// how grey levels come out of the frames: the rig's ([`hydroline_rigs::Rig::grey_rule`]).
    pub fn new(config: ExtractorConfig, map: Option<Arc<dyn PlaneMap>>, rule: GreyRule) -> Self {
        Self {
            extractor: Extractor::new(config),
            map,
            rule,
            picture: Picture::Known(Arc::default()),
        }
    }

    /// The same for frames of a log whose picture has these blocks.
    pub fn knowing(self, picture: Arc<PictureBlocks>) -> Self {
        Self {
            picture: Picture::Known(picture),
            ..self
        }
    }

    /// The same for the frames of one camera as they come: it learns from them which blocks are the picture's.
    pub fn learning(self) -> Self {
        Self {
            picture: Picture::Learnt(Box::default()),
            ..self
        }
    }

    /// Account of the frames' blocks, where they are learnt.
    pub fn blocks(&self) -> Option<&BlockAccount> {
        match &self.picture {
            Picture::Known(_) => None,
            Picture::Learnt(account) => Some(account),
        }
    }

    fn read(&mut self, frame: &Frame) -> Result<GreyImage, FrameError> {
        let account = match &mut self.picture {
            Picture::Known(picture) => return frame.to_grey_with(&self.rule, picture),
            Picture::Learnt(account) => account,
        };
        let inspected = frame.inspect(&self.rule)?;
        account.see(&inspected.seams);
        let sequence = frame.meta.sequence;
        let image = inspected.sound(&account.picture());
        image.map_err(|damage| FrameError::Damaged { sequence, damage })
    }

    /// The stripe of a frame. A frame that is excluded or does not decode gives a profile whose `fault` says why.
    pub fn analyse(&mut self, frame: &Frame) -> StripeProfile {
        self.analyse_whole(frame).0
    }

    /// The same, with what a pose is fitted to: the grey image and the profile in full precision.
    pub fn analyse_whole(&mut self, frame: &Frame) -> (StripeProfile, Extracted) {
        let mut message = StripeProfile {
            timestamp: Some(timestamp(frame.meta.mid_exposure_ns)),
            sequence: frame.meta.sequence,
            width_px: frame.width_px,
            height_px: frame.height_px,
            ..StripeProfile::default()
        };
        if let Some(fault) = frame.meta.fault {
            message.fault = format!("frame excluded: {}", fault_name(fault));
            return (message, Err(NotExtracted::Excluded));
        }
        match self.read(frame) {
            Ok(image) => {
                let profile = self.extractor.extract(&image);
                self.fill(&mut message, &profile);
                (message, Ok((image, profile)))
            }
            Err(error) => {
                message.fault = error.to_string();
                (message, Err(NotExtracted::Unreadable(error)))
            }
        }
    }

    fn fill(&self, message: &mut StripeProfile, profile: &Profile) {
        message.noise_sd = profile.noise_sd;
        message.haze_level = profile.haze_level;
        message.haze_length_px = profile.haze_length_px;
        message.fault = profile
            .fault
            .as_ref()
            .map(ToString::to_string)
            .unwrap_or_default();
        for point in &profile.points {
            message.column_px.push(point.column_px as f32);
            message.row_px.push(point.row_px as f32);
            message.peak.push(point.peak as f32);
            message.sd_px.push(point.sd_px as f32);
            message.sigma_px.push(point.sigma_px as f32);
            message.quality.push(point.quality);
            if let Some(map) = &self.map {
                // A point outside the calibrated region stays in the profile, without plane coordinates.
                let pixel = Matrix2::new(0.0, 0.0, 0.0, point.sd_px * point.sd_px);
                let (xi, eta, xi_sd, eta_sd) =
                    match map.measured(point.column_px, point.row_px, &pixel) {
                        Some(p) => (
                            p.xi_m,
                            p.eta_m,
                            p.covariance_m2[(0, 0)].sqrt(),
                            p.covariance_m2[(1, 1)].sqrt(),
                        ),
                        None => (f64::NAN, f64::NAN, f64::NAN, f64::NAN),
                    };
                message.xi_m.push(xi as f32);
                message.eta_m.push(eta as f32);
                message.xi_sd_m.push(xi_sd as f32);
                message.eta_sd_m.push(eta_sd as f32);
            }
        }
        for candidate in &profile.candidates {
            message.candidate_column_px.push(candidate.column_px as f32);
            message.candidate_row_px.push(candidate.row_px as f32);
            message.candidate_peak.push(candidate.peak as f32);
        }
    }
}
