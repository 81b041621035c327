//! The formulas against exact geometry: no image, no noise.

use super::*;
use crate::fixture::{hexagon_target, lshpi_rig};
use crate::outline::Surfaces;
use crate::segments::Step;
use hydroline_calib::Pose;
use proptest::prelude::*;
use proptest::test_runner::RngSeed;

fn levels(pose: &Pose) -> Levels {
    let line = pose.level_in_plane(&lshpi_rig().mounts, 0.0).unwrap();
    Levels {
        eta0_m: line.eta_at_zero_m,
        slope: line.slope,
        eta0_sd_m: 1e-5,
        slope_sd: 1e-5,
        rms_m: 0.0,
        points: 500,
        segments: Vec::new(),
        steps: Vec::new(),
        caveats: Vec::new(),
    }
}

/// Exact edge points at θ = φ = 0, by walking along the line.
fn crossing(pose: &Pose) -> Crossing {
    let mounts = lshpi_rig().mounts;
    let surfaces = Surfaces::new(Some(&hexagon_target()));
    let edge = |height: f64, sign: f64| {
        let face = surfaces
            .faces
            .iter()
            .find(|t| (t.height_m - height).abs() < 1e-9)
            .unwrap();
        let inside = |xi: f64| {
            let p = pose.body_to_tank(&hydroline_calib::frames::plane_to_body(&mounts, xi, 0.0));
            face.outline.contains([p.x, p.y])
        };
        let (mut a, mut b) = (0.0, sign * 0.3);
        assert!(inside(a) && !inside(b));
        for _ in 0..60 {
            let m = 0.5 * (a + b);
            if inside(m) { a = m } else { b = m }
        }
        Some(Step {
            upper_m: height,
            lower_m: 0.0,
            to_starboard: sign < 0.0,
            column_px: 0.0,
            xi_m: a,
            eta_m: 0.0,
            sd_m: 1e-5,
        })
    };
    Crossing {
        a: edge(0.02, 1.0),
        b: edge(0.04, 1.0),
        c: edge(0.04, -1.0),
        d: edge(0.02, -1.0),
    }
}

proptest! {
    #![proptest_config(ProptestConfig { rng_seed: RngSeed::Fixed(1), failure_persistence: None, cases: 64, ..ProptestConfig::default() })]

    #[test]
    fn roll_heave_and_pitch_invert_the_geometry(h in 0.5..0.95f64, roll in -0.35..0.35f64, pitch in -0.3..0.35f64) {
        let mounts = lshpi_rig().mounts;
        let rolled = levels(&Pose { z_m: -h, phi_rad: roll, ..Pose::default() });
        prop_assert!((roll_rad(&rolled).value - roll).abs() < 1e-12);
        let level = levels(&Pose { z_m: -h, ..Pose::default() });
        let lower = levels(&Pose { z_m: -h + 0.1, ..Pose::default() });
        prop_assert!((heave_m(&lower, &level).value - 0.1).abs() < 1e-12);
        let pitched = levels(&Pose { z_m: -h, theta_rad: pitch, ..Pose::default() });
        prop_assert!((pitch_rad(&pitched, level.eta0_m, &mounts).unwrap().value - pitch).abs() < 1e-9);
    }

    #[test]
    fn flanks_give_place_and_yaw(x in 0.1..0.7f64, y in -0.01..0.01f64, yaw in -0.3..0.3f64, off in -2e-4..2e-4f64) {
        let mounts = lshpi_rig().mounts;
        let pose = Pose { x_m: x, y_m: y - mounts.l_laser_m * yaw.sin(), z_m: -0.83, psi_rad: yaw, ..Pose::default() };
        let chain = Chain::new(&hexagon_target()).unwrap();
        // The line crosses the centre line at Y = 0. Near a corner two places fit exactly:
        // continuity has to be good to distinguish them.
        let sheet = pose.body_to_tank(&nalgebra::Vector3::new(mounts.l_laser_m, 0.0, 0.0));
        let x_s = sheet.x + sheet.y * yaw.tan();
        let fix = chain.fix(&crossing(&pose), (x_s + off, yaw + off)).unwrap();
        prop_assert!((fix.psi_s_rad - yaw).abs() < 1e-6, "{} {}", fix.psi_s_rad, yaw);
        prop_assert!((fix.x_s_m - x_s).abs() < 1e-6, "{} {}", fix.x_s_m, x_s);
    }
}

#[test]
fn a_missing_edge_is_named() {
    let pose = Pose {
        x_m: 0.3,
        z_m: -0.83,
        ..Pose::default()
    };
    let mut seen = crossing(&pose);
    seen.d = None;
    let chain = Chain::new(&hexagon_target()).unwrap();
    assert_eq!(
        chain.fix(&seen, (0.57, 0.0)).unwrap_err(),
        EstimatorFault::NoEdge {
            what: "the hexagon's flanks",
            point: 'D'
        }
    );
}

#[test]
fn a_rolled_stripe_is_flagged() {
    let rolled = levels(&Pose {
        z_m: -0.83,
        phi_rad: 0.02,
        ..Pose::default()
    });
    assert!(matches!(
        upright(&rolled, "sway"),
        Err(EstimatorFault::Rolled { .. })
    ));
}
