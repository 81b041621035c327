//! Runs of rendered frames in which some fail.

use super::*;
use crate::fixture::lshpi_rig;
use hydroline_calib::{IdealMap, Pose};
use hydroline_rigs::StatedResponse;
use hydroline_sim::{Pose6, Renderer};
use hydroline_stripe::{Extractor, ExtractorConfig};

const START_NS: u64 = 1_000_000_000_000;

/// Pose half a second after half a second of a vehicle that speeds up.
fn truth(k: u32) -> Pose {
    let t_s = 0.5 * f64::from(k);
    Pose {
        x_m: -0.2 + 0.5 * 0.02 * t_s * t_s,
        y_m: 0.002,
        z_m: -0.83,
        phi_rad: 0.004,
        theta_rad: -0.003,
        psi_rad: -0.05,
    }
}

fn look(run: &mut PoseRun, rig: &Rig, k: u32, dark: bool) -> RunPose {
    let mut pixels = Renderer::new(rig)
        .unwrap()
        .render(&Pose6::from(truth(k).to_array()), u64::from(k))
        .0;
    if dark {
        pixels.fill(3);
    }
    let image = GreyImage {
        width_px: 720,
        height_px: 576,
        pixels,
    };
    let profile = Extractor::new(ExtractorConfig::default()).extract(&image);
    let stamp_ns = START_NS + u64::from(k) * 500_000_000;
    run.pose(stamp_ns, &image, &profile)
}

#[test]
fn frames_that_fail_at_two_a_second_do_not_lose_the_ones_after_them() {
    let mut rig = lshpi_rig();
    rig.tank.start_pose[0] = truth(0).x_m;
    let mut run = PoseRun::new(&rig, Arc::new(IdealMap::of(&rig)));
    for k in 0..9 {
        let dark = matches!(k, 4 | 6 | 7);
        let pose = look(&mut run, &rig, k, dark);
        if dark {
            assert!(matches!(pose, RunPose::None(_)), "{k}: {pose:?}");
            continue;
        }
        let RunPose::Good(fit) = pose else {
            panic!("{k}: {pose:?}");
        };
        let off_m = fit.pose.x_m - truth(k).x_m;
        assert!(
            off_m.abs() < 5.0 * fit.covariance[(0, 0)].sqrt(),
            "{k}: {off_m}"
        );
    }
}

#[test]
fn a_pose_fitted_ahead_of_its_turn_has_the_same_bits_after_a_gap() {
    let mut rig = lshpi_rig();
    rig.tank.start_pose[0] = truth(0).x_m;
    let mut live = PoseRun::new(&rig, Arc::new(IdealMap::of(&rig)));
    let mut replayed = live.clone();
    let at = |k: u32| START_NS + u64::from(k) * 500_000_000;
    let frame = |k: u32| {
        let image = GreyImage {
            width_px: 720,
            height_px: 576,
            pixels: Renderer::new(&rig)
                .unwrap()
                .render(&Pose6::from(truth(k).to_array()), u64::from(k))
                .0,
        };
        let profile = Extractor::new(ExtractorConfig::default()).extract(&image);
        (image, profile)
    };
    // All fitted from the start's place; replayed in turn.
    let frames: Vec<_> = [0, 1, 5].map(|k| (k, frame(k))).into();
    let ahead: Vec<_> = frames
        .iter()
        .map(|(k, (image, profile))| replayed.speculative(at(*k), image, profile))
        .collect();
    for ((k, (image, profile)), ahead) in frames.iter().zip(ahead) {
        let a = live.pose(at(*k), image, profile);
        let b = replayed.pose_speculative(at(*k), image, profile, ahead);
        assert!(a == b, "{k}: {a:?} {b:?}");
    }
}

/// Poses 11 sds off along the weak direction were accepted: x agreed with a place that came from poses off alike.
#[test]
fn a_wrong_curve_of_the_camera_is_not_settled_by_the_place_of_its_own_poses() {
    for gamma in [1.0, 0.8] {
        let mut rig = lshpi_rig();
        rig.tank.start_pose[0] = truth(0).x_m;
        rig.camera.response = Some(StatedResponse {
            gamma,
            gamma_sd: 0.001,
            black_levels: Some([0.0, 0.5]),
            gamma_black_correlation: 0.0,
            ceiling_levels: None,
            source: "another camera".to_owned(),
        });
        let mut run = PoseRun::new(&rig, Arc::new(IdealMap::of(&rig)));
        for k in 0..4 {
            match look(&mut run, &rig, k, false) {
                RunPose::Good(fit) => {
                    assert_eq!(gamma, 1.0, "{k}: {fit:?}");
                    let off_m = fit.pose.x_m - truth(k).x_m;
                    let sd_m = fit.covariance[(0, 0)].sqrt();
                    assert!(off_m.abs() < 4.0 * sd_m, "{k}: {off_m}, sd {sd_m}");
                }
                RunPose::Flagged(fit) => {
                    assert_eq!(gamma, 0.8, "{k}: {fit:?}");
                    assert!(fit.caveats.contains(&PoseCaveat::EdgesOff), "{k}: {fit:?}");
                }
                RunPose::None(fault) => panic!("{k}: {fault}"),
            }
        }
    }
}
