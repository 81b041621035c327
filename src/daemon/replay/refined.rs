//! `replay --refine`: what the frames of a log share is refined first, then each is fitted under it.

use super::{Analysed, BATCH, Options, ReplayError, commanded};
use hydroline_core::frame::{Frame, GreyImage};
use hydroline_log::Record;
use hydroline_pose::joint::Hint;
use hydroline_pose::joint::refine::{Refined, Wanted, refine};
use hydroline_pose::run::PoseRun;
use hydroline_stripe::Profile;
use rayon::prelude::*;
use serde::Serialize;
use std::path::Path;

/// Frames that a refinement looks at, at most twice as many in memory (0.4 MB each): spread over the run.
const FRAMES: usize = 24;

/// Geometry that a log's frames were found to share.
#[derive(Debug, Clone, PartialEq, Serialize, schemars::JsonSchema)]
pub struct RefineReport {
    /// Frames looked at.
    pub frames: usize,
    /// Of these, frames that gave no pose and were discarded.
    pub failed: usize,
    /// Sheet's thickness and its sd \[m\], where asked for.
    pub thickness_m: Option<[f64; 2]>,
    /// Brightness of the line and its sd from frame to frame \[grey levels\].
    pub brightness: [f64; 2],
    /// Sheet's tilts a and b of x_b = l_laser + tan a z_b + tan b y_b, each with its sd \[rad\], where asked for.
    pub tilt_pitch_rad: Option<[f64; 2]>,
    /// Tilt b of that, with its sd \[rad\], where asked for.
    pub tilt_yaw_rad: Option<[f64; 2]>,
}

impl RefineReport {
    fn new(refined: &Refined) -> Self {
        let with_sd = |value: f64, i: usize| [value, refined.covariance[(i, i)].sqrt()];
        let g = &refined.geometry;
        let Wanted { tilt, thickness } = refined.wanted;
        RefineReport {
            frames: refined.poses.len(),
            failed: refined.poses.iter().filter(|p| p.is_none()).count(),
            thickness_m: thickness.then(|| with_sd(g.thickness_m, 2)),
            brightness: refined.brightness,
            tilt_pitch_rad: tilt.then(|| with_sd(g.tilt_pitch_rad, 0)),
            tilt_yaw_rad: tilt.then(|| with_sd(g.tilt_yaw_rad, 1)),
        }
    }

    /// For the new log's summary.
    pub(super) fn metadata(&self) -> Vec<(String, String)> {
        let mut out = Vec::new();
        let mut put = |name: &str, value: Option<[f64; 2]>| {
            if let Some([value, sd]) = value {
                out.push((format!("replay.refined.{name}"), value.to_string()));
                out.push((format!("replay.refined.{name}_sd"), sd.to_string()));
            }
        };
        put("thickness_m", self.thickness_m);
        put("tilt_pitch_rad", self.tilt_pitch_rad);
        put("tilt_yaw_rad", self.tilt_yaw_rad);
        out
    }
}

type Seen = (GreyImage, Profile, Hint);

/// Frames spread over a run whose length is not known yet: every so many, fewer as there are more.
struct Spread {
    kept: Vec<Seen>,
    every: usize,
    next: usize,
}

impl Spread {
    fn take(&mut self, seen: Seen) {
        if self.next == 0 {
            self.kept.push(seen);
            self.next = self.every;
        }
        self.next -= 1;
        if self.kept.len() == 2 * FRAMES {
            let mut second = false;
            self.kept.retain(|_| {
                second = !second;
                second
            });
            // The last one kept was the second last one taken: the next of twice the distance is as far
            // as the next one was anyway.
            self.every *= 2;
        }
    }
}

/// Reads the log once and refines over some of its frames: the run to fit them with, and the account.
pub(super) fn refined(
    log: &Path,
    options: &Options,
    run: &PoseRun,
    wanted: Wanted,
) -> Result<(PoseRun, RefineReport), ReplayError> {
    let mut follow = run.clone();
    let mut spread = Spread {
        kept: Vec::with_capacity(2 * FRAMES),
        every: 1,
        next: 0,
    };
    let mut pending: Vec<Frame> = Vec::with_capacity(BATCH);
    for message in options.open(log)? {
        match message?.record {
            Record::Frame(frame) => {
                pending.push(frame);
                if pending.len() == BATCH {
                    look(&mut pending, &mut follow, options, &mut spread);
                }
            }
            Record::Command(command) => commanded(&mut follow, &command),
            _ => {}
        }
    }
    look(&mut pending, &mut follow, options, &mut spread);
    let found = refine(run.fitter(), &spread.kept, wanted)?;
    let report = RefineReport::new(&found);
    Ok((run.with_fitter(run.fitter().refined(&found)), report))
}

/// Follows the vehicle over some frames and keeps those that are wanted, with what was known before of each.
fn look(pending: &mut Vec<Frame>, follow: &mut PoseRun, options: &Options, spread: &mut Spread) {
    let analysed: Vec<_> = pending
        .par_iter()
        .map_init(
            || options.analyst(),
            |analyst, frame| Analysed::of(analyst, Some(&*follow), frame).posed,
        )
        .collect();
    for (frame, pixels) in pending.drain(..).zip(analysed) {
        let Some((image, profile, speculative)) = pixels else {
            continue;
        };
        let stamp_ns = frame.meta.mid_exposure_ns;
        let hint = follow.hint(stamp_ns);
        follow.pose_speculative(stamp_ns, &image, &profile, speculative);
        spread.take((image, profile, hint));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use hydroline_stripe::{Extractor, ExtractorConfig};

    #[test]
    fn frames_are_spread_over_the_run() {
        let image = GreyImage {
            width_px: 64,
            height_px: 64,
            pixels: vec![0; 64 * 64],
        };
        let profile = Extractor::new(ExtractorConfig::default()).extract(&image);
        for count in [1, 23, 47, 48, 49, 100, 191, 192, 500] {
            let mut spread = Spread {
                kept: Vec::new(),
                every: 1,
                next: 0,
            };
            for k in 0..count {
                let hint = Hint {
                    x_m: Some(f64::from(k)),
                    ..Hint::default()
                };
                spread.take((image.clone(), profile.clone(), hint));
            }
            let kept: Vec<f64> = spread.kept.iter().filter_map(|s| s.2.x_m).collect();
            let every = spread.every as f64;
            for (i, k) in kept.iter().enumerate() {
                assert_eq!(*k, every * i as f64, "{count}: {kept:?}");
            }
            assert!(kept.len() < 2 * FRAMES && f64::from(count) - every * kept.len() as f64 <= 0.0);
        }
    }
}
