//! Shift of a frame's pose by an effect, in that pose's own standard deviations.

use hydroline_calib::IdealMap;
use hydroline_core::frame::GreyImage;
use hydroline_pose::joint::{Hint, JointPose, PoseFitter};
use hydroline_rigs::{PhysicsEntry, Rig};
use hydroline_sim::{Pose6, Renderer};
use hydroline_stripe::{Extractor, ExtractorConfig};
use std::sync::Arc;

/// Poses that are looked at: two flanks and a corner.
const POSES: [[f64; 6]; 2] = [
    [-0.17, 0.003, -0.83, 0.004, 0.003, -0.04],
    [0.06, -0.002, -0.828, -0.005, -0.002, 0.05],
];
/// Shift in sds that stands for "no pose any more".
const LOST: f64 = 1e3;

/// Shift of the pose.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Moved {
    /// Largest of the six, rms over the poses, in sds.
    pub any_sds: f64,
    /// Largest of x, y and z.
    pub position_sds: f64,
}

/// The pose fit of frames with and without an effect; noise is the same in both.
pub fn moved(rig: &Rig, entry: &PhysicsEntry) -> Moved {
    let fitter = PoseFitter::new(rig, Arc::new(IdealMap::of(rig)));
    let mut other = rig.clone();
    other.physics.push(entry.clone());
    let (Ok(plain), Ok(with)) = (Renderer::new(rig), Renderer::new(&other)) else {
        return Moved::default();
    };
    let mut extractor = Extractor::new(ExtractorConfig::default());
    let mut fit = |renderer: &Renderer, pose: &[f64; 6], index: u64| -> Option<JointPose> {
        let image = GreyImage {
            width_px: renderer.width_px(),
            height_px: renderer.height_px(),
            pixels: renderer.render(&Pose6::from(*pose), index).0,
        };
        let profile = extractor.extract(&image);
        if !super::shows(&profile) {
            return None;
        }
        let hint = Hint {
            x_m: Some(pose[0]),
            ..Hint::default()
        };
        fitter.fit(&image, &profile, &hint).ok()
    };
    let mut squares = [0.0; 6];
    for (k, pose) in POSES.iter().enumerate() {
        match (fit(&plain, pose, k as u64), fit(&with, pose, k as u64)) {
            (Some(a), Some(b)) => {
                for (d, square) in squares.iter_mut().enumerate() {
                    let moved = b.pose.to_array()[d] - a.pose.to_array()[d];
                    *square += moved * moved / a.covariance[(d, d)].max(1e-30);
                }
            }
            (Some(_), None) => squares = squares.map(|s| s + LOST * LOST),
            _ => {}
        }
    }
    let sds = squares.map(|s| (s / POSES.len() as f64).sqrt());
    let most = |some: &[f64]| some.iter().copied().fold(0.0, f64::max);
    Moved {
        any_sds: most(&sds),
        position_sds: most(&sds[..3]),
    }
}
