//! Feeds the live page from `record`, `aim`, `simulate` and `replay`.
//!
//! Nothing here knows of sockets: it fills a [`Feed`], which keeps the newest and waits for nobody.

pub mod excited;
pub mod outline;
pub mod prediction;
pub mod unhurried;

use hydroline_core::frame::{Frame, GreyRule};
use hydroline_live::picture::{self, Overlay};
use hydroline_live::state::Thruster;
use hydroline_live::{Feed, Picture};
use hydroline_log::messages::pb::StripeProfile;
use hydroline_rigs::Rig;
use outline::Outline;
use std::path::PathBuf;
use std::sync::Arc;

/// Live page of a run.
#[derive(Debug, Clone)]
pub struct Live {
    /// Feed that viewers and run share.
    pub feed: Arc<Feed>,
    /// The rig, and the log.
    pub title: String,
    /// Where the log goes, for what its disk still takes.
    pub log: PathBuf,
}

impl PartialEq for Live {
    fn eq(&self, other: &Self) -> bool {
        Arc::ptr_eq(&self.feed, &other.feed)
    }
}

/// A frame with its stripe, and with floor and target where they should be.
pub fn picture(
    frame: &Frame,
    profile: &StripeProfile,
    rule: GreyRule,
    expected: Option<Outline>,
) -> Picture {
    let Outline {
        image_px: outline_px,
        plane_m: expected_m,
    } = expected.unwrap_or_default();
    Picture {
        frame: frame.clone(),
        rule,
        overlay: Overlay {
            sequence: frame.meta.sequence,
            width_px: frame.width_px,
            height_px: frame.height_px,
            stripe_px: picture::points(&profile.column_px, &profile.row_px, 0.01),
            outline_px,
            profile_m: picture::points(&profile.xi_m, &profile.eta_m, 1e-5),
            expected_m,
            fault: profile.fault.clone(),
        },
    }
}

/// The rig's thrusters before anything was sent.
pub fn thrusters(rig: &Rig) -> Vec<Thruster> {
    let curves = rig.thrusters.thrusters.iter();
    curves
        .map(|t| Thruster {
            name: t.name.clone(),
            range_n: [
                t.curve.thrust_n(rig.thrusters.min_us),
                t.curve.thrust_n(rig.thrusters.max_us),
            ],
            ..Thruster::default()
        })
        .collect()
}
