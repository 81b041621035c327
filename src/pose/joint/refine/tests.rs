//! A run seen by a rig whose sheet differs from its file.

use super::*;
use crate::fixture::lshpi_rig;
use hydroline_calib::IdealMap;
use hydroline_rigs::{ParameterValue, PhysicsEntry};
use hydroline_sim::{Pose6, Renderer};
use hydroline_stripe::{Extractor, ExtractorConfig};

const TILT_RAD: [f64; 2] = [0.0015, -0.001];
const THICKNESS_M: f64 = 0.0021;

fn frames(tilt_rad: [f64; 2], poses: &[Pose]) -> Vec<(GreyImage, Profile, Hint)> {
    let mut rig = lshpi_rig();
    let number = |name: &str, value| (name.to_owned(), ParameterValue::Number(value));
    rig.physics.push(PhysicsEntry {
        effect: "laser_plane_tilt".to_owned(),
        parameters: vec![
            number("pitch_rad", tilt_rad[0]),
            number("yaw_rad", tilt_rad[1]),
        ],
    });
    rig.laser.sigma_m = THICKNESS_M;
    let renderer = Renderer::new(&rig).unwrap();
    let mut extractor = Extractor::new(ExtractorConfig::default());
    let seen = poses.iter().zip(0u64..).map(|(pose, k)| {
        let image = GreyImage {
            width_px: renderer.width_px(),
            height_px: renderer.height_px(),
            pixels: renderer.render(&Pose6::from(pose.to_array()), k).0,
        };
        let hint = Hint {
            x_m: Some(pose.x_m),
            ..Hint::default()
        };
        let profile = extractor.extract(&image);
        (image, profile, hint)
    });
    seen.collect()
}

fn run(count: u32) -> Vec<Pose> {
    let pose = |k: f64| Pose {
        x_m: -0.15 + 0.83 / f64::from(count) * k,
        y_m: 0.004 * (1.3 * k).sin(),
        z_m: -0.83 + 0.008 * (0.9 * k).cos(),
        phi_rad: 0.01 * (2.1 * k).sin(),
        theta_rad: 0.01 * (1.7 * k).cos(),
        psi_rad: -0.03 + 0.03 * (0.7 * k).sin(),
    };
    (0..count).map(|k| pose(f64::from(k))).collect()
}

#[test]
fn a_tilted_and_thicker_sheet_is_found_and_the_poses_with_it() {
    let rig = lshpi_rig();
    let fitter = PoseFitter::new(&rig, Arc::new(IdealMap::of(&rig)));
    let poses = run(6);
    let frames = frames(TILT_RAD, &poses);
    let found = refine(&fitter, &frames, Wanted::ALL).unwrap();
    let off = [
        found.geometry.tilt_pitch_rad - TILT_RAD[0],
        found.geometry.tilt_yaw_rad - TILT_RAD[1],
        found.geometry.thickness_m - THICKNESS_M,
    ];
    for (i, off) in off.iter().enumerate() {
        let sd = found.covariance[(i, i)].sqrt();
        assert!(off.abs() < 4.5 * sd, "{i}: off by {off}, sd {sd}");
    }
    // A tenth of what was wrong, at most.
    assert!(found.covariance[(0, 0)].sqrt() < 0.1 * TILT_RAD[0].abs());
    let mut worst_m = [0.0f64; 2];
    for (k, ((image, profile, hint), truth)) in frames.iter().zip(&poses).enumerate() {
        let plain = fitter.fit(image, profile, hint).unwrap();
        let refined = found.poses[k].unwrap();
        for (worst, pose) in worst_m.iter_mut().zip([plain.pose, refined]) {
            *worst = worst.max((pose.x_m - truth.x_m).abs());
        }
    }
    assert!(
        worst_m[1] < 0.3 * worst_m[0] && worst_m[1] < 3e-3,
        "{worst_m:?}"
    );
}

#[test]
fn an_upright_sheet_is_left_upright() {
    let rig = lshpi_rig();
    let fitter = PoseFitter::new(&rig, Arc::new(IdealMap::of(&rig)));
    let found = refine(&fitter, &frames([0.0; 2], &run(4)), Wanted::ALL).unwrap();
    let sd = |i: usize| found.covariance[(i, i)].sqrt();
    assert!(
        found.geometry.tilt_pitch_rad.abs() < 4.5 * sd(0),
        "{found:?}"
    );
    assert!(found.geometry.tilt_yaw_rad.abs() < 4.5 * sd(1), "{found:?}");
}

#[test]
fn too_few_frames_are_an_error() {
    let rig = lshpi_rig();
    let fitter = PoseFitter::new(&rig, Arc::new(IdealMap::of(&rig)));
    let two = frames([0.0; 2], &run(2));
    assert_eq!(
        refine(&fitter, &two, Wanted::ALL),
        Err(RefineError::TooFew { frames: 2 })
    );
}

#[test]
fn a_frame_that_fails_is_discarded_and_a_pitch_that_is_held_stays() {
    let rig = lshpi_rig();
    let fitter = PoseFitter::new(&rig, Arc::new(IdealMap::of(&rig)));
    let poses: Vec<Pose> = run(5)
        .into_iter()
        .map(|pose| Pose {
            theta_rad: 0.0,
            ..pose
        })
        .collect();
    let mut frames = frames([0.0; 2], &poses);
    for (_, _, hint) in &mut frames {
        hint.held.theta_rad = Some(0.0);
    }
    // Its stripe was seen, but its image is dark: a start without a fit.
    frames[2].0.pixels.fill(0);
    let wanted = Wanted {
        tilt: false,
        thickness: true,
    };
    let found = refine(&fitter, &frames, wanted).unwrap();
    assert_eq!(found.poses[2], None);
    for (k, pose) in found.poses.iter().enumerate().filter(|(k, _)| *k != 2) {
        assert_eq!(pose.unwrap().theta_rad, 0.0, "{k}");
    }
    let sd_m = found.covariance[(2, 2)].sqrt();
    let off_m = found.geometry.thickness_m - THICKNESS_M;
    assert!(off_m.abs() < 4.5 * sd_m, "off by {off_m}, sd {sd_m}");
    // With pitch known the stripe's width alone determines it: to a thousandth.
    assert!(sd_m < 1e-3 * THICKNESS_M, "{sd_m}");
    assert_eq!(found.geometry.tilt_pitch_rad, 0.0);
}

#[test]
fn poses_under_what_was_refined_are_those_of_the_true_sheet() {
    let rig = lshpi_rig();
    let fitter = PoseFitter::new(&rig, Arc::new(IdealMap::of(&rig)));
    let poses = run(8);
    let frames = frames(TILT_RAD, &poses);
    let found = refine(&fitter, &frames, Wanted::ALL).unwrap();
    let refined = fitter.refined(&found);
    for ((image, profile, hint), truth) in frames.iter().zip(&poses) {
        let fit = refined.fit(image, profile, hint).unwrap();
        let open = refined
            .with_thickness_open()
            .fit(image, profile, hint)
            .unwrap();
        for i in 0..6 {
            let off = fit.pose.to_array()[i] - truth.to_array()[i];
            let sd = fit.covariance[(i, i)].sqrt();
            // The covariance lacks the tilts' own sds: a sheet rotated about the vertical by ε shows as a
            // roll of about 1.4 ε and a place beside of 1.2 m ε.
            let pitch = [1.0, 0.3, 0.3, 1.0, 1.0, 1.0][i] * found.covariance[(0, 0)].sqrt();
            let yaw = [0.0, 1.2, 0.0, 1.4, 0.0, 1.0][i] * found.covariance[(1, 1)].sqrt();
            let tilt = pitch.hypot(yaw);
            assert!(
                off.abs() < 4.5 * sd.hypot(tilt),
                "{i}: off by {off}, sd {sd}"
            );
        }
        // The weak direction is the thickness' own.
        assert!(fit.covariance[(4, 4)].sqrt() < 0.8 * open.covariance[(4, 4)].sqrt());
    }
}
