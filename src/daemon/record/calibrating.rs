//! The daemon's side of a calibration in the making: what [`Live`] says goes to log, events and status.

use super::Shared;
use crate::calibrate::live::Live;
use hydroline_calib::Calibration;
use hydroline_core::frame::GreyImage;
use hydroline_core::lock::Lock;
use hydroline_core::shutdown::StopReason;
use hydroline_log::Entry;

/// Where the calibration of a recording stands.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Calibrating {
    /// One line for the status.
    pub line: String,
    /// Reason why there is none yet, in words; empty once accepted.
    pub missing: String,
    /// The accepted calibration.
    pub accepted: Option<Calibration>,
}

/// Shows one frame to the calibration; `ends` = the recording is for the calibration alone and ends with it.
pub(super) fn look(shared: &Shared, live: &mut Live, image: &GreyImage, stamp_ns: u64, ends: bool) {
    let look = live.look(image, stamp_ns);
    if let Some(progress) = &look.progress {
        shared.recorder.push(Entry::plane_calibration(progress));
    }
    for event in &look.events {
        shared.event(event);
    }
    *shared.calibrating.held() = Some(Calibrating {
        line: live.line().to_owned(),
        missing: match live.accepted() {
            Some(_) => String::new(),
            None => live.missing(),
        },
        accepted: live.accepted().cloned(),
    });
    if look.accepted && ends {
        shared.shutdown.raise(StopReason::Finished);
    }
}
