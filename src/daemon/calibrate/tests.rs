use super::*;
use hydroline_core::event::Severity;
use live::Live;
use synthetic::truth::Rig as Truth;
use synthetic::{LaserSheet, Scene, View, render};

#[path = "../../../calib/tests/synthetic/mod.rs"]
mod synthetic;

/// The board of the dimension tests: 7 x 7 lines, three blocks, all in view.
fn board() -> Board {
    let block = |x: f64, y: f64| {
        format!("[[block]]\ncentre_m = [{x}, {y}]\nsize_m = [0.03, 0.03]\nheight_m = 0.01\n")
    };
    let text = format!(
        "name = \"seven\"\npattern = \"lines\"\nline_m = 0.002\ncolumns = 7\nrows = 7\npitch_m = 0.05\nmargin_m = 0.025\nthickness_m = 0.006\n{}{}{}",
        block(-0.125, -0.075),
        block(0.125, -0.075),
        block(0.025, 0.125)
    );
    Board::from_toml(&text, "seven").unwrap()
}

/// The built-in rig with the field of view of the study's camera in air.
fn rig() -> Rig {
    let mut rig = Rig::builtin("lshpi").unwrap();
    let truth = Truth::in_air();
    (rig.camera.fx_px, rig.camera.fy_px) = (truth.focal_px, truth.focal_px);
    (rig.camera.cx_px, rig.camera.cy_px) = (truth.centre_px[0], truth.centre_px[1]);
    // The images' sheet stands 1 mm before the face, and the face 0.46 m from the camera.
    rig.mounts.l_camera_m -= 1e-3;
    rig
}

fn image(eta_m: f64, seed: u64) -> GreyImage {
    let scene = Scene {
        greys: [120.0, 15.0, 40.0],
        laser: Some(LaserSheet {
            offset_m: 1e-3,
            tilt_xi: 0.0,
            tilt_eta: 0.0,
            sigma_m: 0.002,
            peak: 110.0,
            apex_m: 0.68 - eta_m,
        }),
        seed,
        ..Scene::default()
    };
    GreyImage {
        width_px: 720,
        height_px: 576,
        pixels: render(&board(), &View::behind_port(Truth::in_air(), eta_m), &scene),
    }
}

fn blank() -> GreyImage {
    GreyImage {
        width_px: 720,
        height_px: 576,
        pixels: vec![90; 720 * 576],
    }
}

fn setup() -> Setup {
    Setup {
        frames: 2,
        ..Setup::new(board(), Medium::Air, Some(rig()))
    }
}

#[test]
fn frames_of_two_poses_are_distinguished_and_the_board_is_placed_by_the_rig() {
    let setup = setup();
    let mut poses = Poses::default();
    for (k, eta_m) in [0.0, 0.0, -0.04].into_iter().enumerate() {
        let seen = see(&setup, &image(eta_m, k as u64), true).unwrap();
        poses.push(&setup, seen);
    }
    assert_eq!(poses.poses.len(), 2);
    assert_eq!(poses.best(), Some(0));
    for (pose, eta_m) in poses.poses.iter().zip([0.0, -0.04]) {
        let (calibration, by) = pose.calibration(&setup, rfc3339(0)).unwrap();
        let p = calibration.placement.unwrap();
        // The face stands 1 mm off the sheet, which shifts eta by about as much: where three blocks are in
        // view that is measured and taken out; where they are not, the uncertainty is stated and the shift stays within it.
        let bound_m = match calibration.gap() {
            Some(Coplanarity::Measured(gap)) if eta_m == 0.0 => {
                assert!((gap.offset_m - 1e-3).abs() < 3e-4, "{}", gap.offset_m);
                5e-4
            }
            Some(Coplanarity::Unknown(gap)) if eta_m != 0.0 => {
                assert!(gap.why.contains("fewer than 3"), "{}", gap.why);
                assert!(calibration.claim().contains("withdrawn"));
                1.5 * gap.offset_sd_m
            }
            other => panic!("{eta_m}: {other:?}"),
        };
        assert!(
            p.xi_m.abs() < 2e-4 && (p.eta_m - eta_m).abs() < bound_m,
            "{p:?}"
        );
        assert!(p.turn_rad.abs() < 1e-3);
        assert!(
            matches!(by, PlacedBy::Rig { rms_m, scale } if rms_m < 1e-3 && (scale - 1.0).abs() < 0.01),
            "{by:?}"
        );
        assert_eq!(calibration.date.as_deref(), Some("1970-01-01T00:00:00Z"));
    }
}

#[test]
fn what_a_person_measured_stands_and_without_a_rig_nothing_is_claimed() {
    let at = Placement {
        xi_m: 0.1,
        eta_m: -0.2,
        turn_rad: 0.0,
        is_by_rig: false,
    };
    let setup = Setup {
        at: Some(at),
        rig: None,
        ..setup()
    };
    let mut pose = Pose::new(&setup);
    let status = pose
        .push(&setup, see(&setup, &image(0.0, 1), true).unwrap())
        .clone();
    assert!(!status.accepted);
    let (calibration, by) = pose.calibration(&setup, rfc3339(0)).unwrap();
    assert_eq!((calibration.placement, by), (Some(at), PlacedBy::Given));
    assert!(
        calibration.claim().contains("withdrawn"),
        "{}",
        calibration.claim()
    );
}

/// The file of a board with squares a fifth larger fitted all nodes, and all lengths were a fifth too long.
#[test]
fn a_board_file_of_another_pitch_is_not_accepted() {
    let mut setup = setup();
    setup.board.pitch_m = 0.06;
    setup.board.blocks.clear();
    setup.accept_unknown_gap = true;
    let mut pose = Pose::new(&setup);
    for seed in 0..3 {
        pose.push(&setup, see(&setup, &image(0.0, seed), true).unwrap());
    }
    let status = pose.status().unwrap();
    assert!(!status.accepted);
    let words = &status.missing[0];
    let said: f64 = words
        .split_once("pitch is ")
        .and_then(|(_, rest)| rest.split_once(" mm"))
        .and_then(|(number, _)| number.parse().ok())
        .unwrap();
    assert!(
        (said - 50.0).abs() < 0.5 && words.contains("says 60.0"),
        "{words}"
    );
    let (calibration, _) = pose.calibration(&setup, rfc3339(0)).unwrap();
    assert!(calibration.caveat().unwrap().contains("not accepted"));
    // A person who says where it stands has measured it.
    setup.at = Some(Placement::default());
    let status = pose
        .push(&setup, see(&setup, &image(0.0, 9), true).unwrap())
        .clone();
    assert!(status.accepted, "{:?}", status.missing);
}

#[test]
fn a_calibration_of_another_image_size_is_refused_and_one_with_its_port_gets_the_water() {
    let setup = Setup {
        method: Method::Refractive,
        ..setup()
    };
    let mut pose = Pose::new(&setup);
    pose.push(&setup, see(&setup, &image(0.0, 1), true).unwrap());
    let (calibration, _) = pose.calibration(&setup, rfc3339(0)).unwrap();
    let size = |width_px, height_px| ImageSize {
        width_px,
        height_px,
    };
    calibration.check_image(size(720, 576)).unwrap();
    let words = calibration
        .check_image(size(640, 480))
        .unwrap_err()
        .to_string();
    assert!(
        words.contains("720 × 576") && words.contains("640 × 480"),
        "{words}"
    );
    let stated = calibration
        .in_medium(Medium::Salt, medium::index(Medium::Salt))
        .unwrap();
    assert_eq!(stated.medium, Medium::Salt);
    assert_eq!(stated.check_use(Medium::Salt, false), Ok(None));
    let plane = |c: &Calibration| c.to_map().to_plane(420.0, 288.0).unwrap();
    let (air, salt) = (plane(&calibration), plane(&stated));
    // Off the axis everything looks a third larger in water, and less is known of it.
    assert!(
        salt.xi_m.abs() < 0.85 * air.xi_m.abs(),
        "{} {}",
        air.xi_m,
        salt.xi_m
    );
    assert!(salt.covariance_m2.trace() > air.covariance_m2.trace());
    // No other map can take it.
    let setup = Setup {
        method: Method::Homography,
        ..setup
    };
    let mut pose = Pose::new(&setup);
    pose.push(&setup, see(&setup, &image(0.0, 1), true).unwrap());
    let (calibration, _) = pose.calibration(&setup, rfc3339(0)).unwrap();
    assert!(
        calibration
            .in_medium(Medium::Salt, medium::index(Medium::Salt))
            .is_none()
    );
}

#[test]
fn the_sheet_beyond_the_board_is_said_to_be_uncovered() {
    let setup = setup();
    let mut pose = Pose::new(&setup);
    pose.push(&setup, see(&setup, &image(0.0, 1), true).unwrap());
    let (calibration, _) = pose.calibration(&setup, rfc3339(0)).unwrap();
    let sheet = Sheet::of(&setup, &calibration).unwrap();
    assert!(sheet.share > 0.2 && sheet.share < 0.9, "{}", sheet.share);
    assert!(sheet.parts[1][1] > 0.95, "{:?}", sheet.parts);
    assert!(!sheet.missing().is_empty() && sheet.words().contains("uncovered"));
}

#[test]
fn live_says_why_there_is_no_board_then_what_is_missing_then_accepts_once() {
    let mut live = Live::new(setup());
    let second = 1_000_000_000;
    let look = live.look(&blank(), second);
    assert_eq!(look.events.len(), 1);
    assert_eq!(look.events[0].severity, Severity::Warning);
    assert!(
        look.events[0].message.contains("empty"),
        "{:?}",
        look.events
    );
    // The same reason is not reported with every frame.
    assert_eq!(live.look(&blank(), 2 * second).events, []);
    let first = live.look(&image(0.0, 1), 3 * second);
    let progress = first.progress.unwrap();
    assert_eq!(progress.state, message::MEASURING);
    assert!(progress.toml.is_empty() && !progress.missing.is_empty());
    assert_eq!(progress.covered.len(), 9);
    assert!(!first.accepted && live.accepted().is_none());
    assert!(
        live.missing().contains("1 of 2 frames"),
        "{}",
        live.missing()
    );
    let last = live.look(&image(0.0, 2), 4 * second);
    assert!(last.accepted, "{}", live.missing());
    let stated = last.progress.unwrap();
    assert_eq!(stated.state, message::ACCEPTED);
    let stored = Calibration::from_toml(&stated.toml, "log").unwrap();
    assert_eq!(Some(&stored), live.accepted());
    assert_eq!(live.look(&image(0.0, 3), 5 * second), live::Look::default());
}
