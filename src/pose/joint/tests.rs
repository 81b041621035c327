//! Rendered frames through extraction and fit.

use super::*;
use crate::stripe::{Extractor, ExtractorConfig};
use hydroline_calib::IdealMap;
use hydroline_sim::fixture::lshpi_rig;
use hydroline_sim::{Pose6, Renderer};

fn frame(rig: &Rig, pose: &Pose) -> GreyImage {
    let renderer = Renderer::new(rig).unwrap();
    GreyImage {
        width_px: 720,
        height_px: 576,
        pixels: renderer.render(&Pose6::from(pose.to_array()), 3).0,
    }
}

fn fitted(rig: &Rig, image: &GreyImage, x_m: Option<f64>) -> Result<JointPose, PoseFault> {
    let profile = Extractor::new(ExtractorConfig::default()).extract(image);
    let fitter = PoseFitter::new(rig, Arc::new(IdealMap::of(rig)));
    fitter.fit(
        image,
        &profile,
        &Hint {
            x_m,
            ..Hint::default()
        },
    )
}

const POSE: Pose = Pose {
    x_m: 0.21,
    y_m: 0.004,
    z_m: -0.826,
    phi_rad: 0.01,
    theta_rad: -0.008,
    psi_rad: -0.05,
};

#[test]
fn a_frame_gives_all_six() {
    let rig = lshpi_rig();
    let image = frame(&rig, &POSE);
    let fit = fitted(&rig, &image, Some(0.18)).unwrap();
    assert_eq!(fit.measured, [true; 6]);
    for i in 0..6 {
        let error = fit.pose.to_array()[i] - POSE.to_array()[i];
        assert!(
            error.abs() < 5.0 * fit.covariance[(i, i)].sqrt(),
            "{i}: {error}"
        );
    }
    // The hint decides between hexagons and nothing else: bit for bit.
    assert_eq!(fitted(&rig, &image, Some(0.24)).unwrap(), fit);
}

#[test]
fn without_a_hint_the_hexagon_is_said_to_be_open() {
    let rig = lshpi_rig();
    let fit = fitted(&rig, &frame(&rig, &POSE), None).unwrap();
    assert!(
        fit.caveats.contains(&PoseCaveat::WhichHexagon),
        "{:?}",
        fit.caveats
    );
}

#[test]
fn a_bare_floor_gives_z_and_roll_and_says_so() {
    let mut rig = lshpi_rig();
    rig.target = None;
    let truth = Pose {
        theta_rad: 0.0,
        ..POSE
    };
    let fit = fitted(&rig, &frame(&rig, &truth), None).unwrap();
    assert_eq!(fit.measured, [false, false, true, true, false, false]);
    assert!(fit.caveats.contains(&PoseCaveat::BareFloor));
    assert!(
        (fit.pose.z_m - truth.z_m).abs() < 5e-5 && (fit.pose.phi_rad - truth.phi_rad).abs() < 5e-5
    );
}

#[test]
fn darkness_and_another_size_are_errors() {
    let rig = lshpi_rig();
    let dark = GreyImage {
        width_px: 720,
        height_px: 576,
        pixels: vec![3; 720 * 576],
    };
    assert!(matches!(
        fitted(&rig, &dark, None),
        Err(PoseFault::NoStripe(_))
    ));
    let small = GreyImage {
        width_px: 64,
        height_px: 64,
        pixels: vec![0; 64 * 64],
    };
    assert!(matches!(
        fitted(&rig, &small, None),
        Err(PoseFault::Size { .. })
    ));
}
