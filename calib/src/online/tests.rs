use super::*;
use crate::board::coplanarity::Gap;
use crate::calibration::compare::compare;
use crate::detect::{BoardNode, Orientation};
use crate::synthetic::truth::Rig;
use hydroline_rigs::BoardPattern;
use nalgebra::DMatrix;
use rand::{SeedableRng, rngs::StdRng};
use rand_distr::{Distribution, Normal};

fn board() -> Board {
    Board {
        name: "test".into(),
        pattern: BoardPattern::Dots { diameter_m: 0.015 },
        columns: 9,
        rows: 9,
        pitch_m: 0.05,
        margin_m: 0.025,
        thickness_m: 0.006,
        blocks: Vec::new(),
    }
}

/// Nodes as a detector would report them, 0.03 px noise, the board moved by `shift_m`.
fn detection(rig: &Rig, seed: u64, shift_m: f64, keep: impl Fn(u32, u32) -> bool) -> Detection {
    let mut rng = StdRng::seed_from_u64(seed);
    let noise = Normal::new(0.0, 0.03).unwrap();
    let board = board();
    let mut nodes = Vec::new();
    for j in 0..9 {
        for i in 0..9 {
            let [xi_m, eta_m] = crate::board::node_m(&board, i, j);
            let p = rig.project(xi_m + shift_m, eta_m, 0.0).unwrap();
            if keep(i, j) {
                nodes.push(BoardNode {
                    i,
                    j,
                    node: Node {
                        xi_m,
                        eta_m,
                        column_px: p[0] + noise.sample(&mut rng),
                        row_px: p[1] + noise.sample(&mut rng),
                        covariance_px2: Matrix2::identity() * 0.03 * 0.03,
                    },
                });
            }
        }
    }
    Detection {
        left_out: 81 - nodes.len(),
        nodes,
        orientation: Orientation::KeySeen,
        blur_px: 0.8,
        noise: 2.0,
        contrast: 150.0,
        gamma: None,
    }
}

fn gap(sd_m: f64) -> Coplanarity {
    Coplanarity::Measured(Gap {
        offset_m: 0.2e-3,
        tilt_xi_rad: 0.0,
        tilt_eta_rad: 0.0,
        sheet_sigma_m: 2e-3,
        blocks: 3,
        camera_m: [0.0, 0.46, 0.46],
        covariance: DMatrix::from_diagonal(&nalgebra::DVector::from_vec(vec![
            sd_m * sd_m,
            1e-8,
            1e-8,
        ])),
    })
}

fn provenance() -> Provenance {
    Provenance {
        image: None,
        missing: Vec::new(),
        medium: Medium::Fresh,
        date: Some("2026-11-21T10:00:00Z".to_owned()),
        board: "test".to_owned(),
        placement: Placement {
            xi_m: 0.01,
            eta_m: 0.02,
            turn_rad: 0.01,
            is_by_rig: false,
        },
        coplanarity: Coplanarity::unknown("not looked at", [0.0, 0.46, 0.46]),
    }
}

#[test]
fn says_what_is_missing_until_nothing_is() {
    let rig = Rig::behind_port();
    let mut online = OnlineCalibration::new(board(), OnlineOptions::default());
    // The lower left corner is hidden at first: left in the image is ξ positive.
    let first = online.push(&detection(&rig, 1, 0.0, |i, j| !(i > 5 && j < 3)), None);
    assert!(!first.accepted);
    let words = first.missing.join("; ");
    assert!(words.contains("lower left corner uncovered"), "{words}");
    assert!(words.contains("1 of 5 frames"), "{words}");
    assert!(words.contains("coplanarity unknown"), "{words}");
    for k in 2..5 {
        assert!(
            !online
                .push(&detection(&rig, k, 0.0, |_, _| true), Some(gap(5e-4)))
                .accepted
        );
    }
    let last = online.push(&detection(&rig, 9, 0.0, |_, _| true), Some(gap(5e-5)));
    assert!(last.accepted, "{last:?}");
    assert!(last.missing.is_empty() && last.worst_sd_m.unwrap() < 0.2e-3);
    assert_eq!(last.nodes, 81);
    let calibration = online.calibration(provenance()).unwrap();
    assert!(
        calibration.claim().contains("0.20"),
        "{}",
        calibration.claim()
    );
    let r = calibration.residuals.unwrap();
    assert!(r.rms_eta_m < 0.1e-3, "{r:?}");
}

#[test]
fn a_board_that_moves_starts_anew() {
    let rig = Rig::behind_port();
    let mut online = OnlineCalibration::new(board(), OnlineOptions::default());
    online.push(&detection(&rig, 1, 0.0, |_, _| true), None);
    let moved = online.push(&detection(&rig, 2, 0.004, |_, _| true), None);
    assert_eq!(moved.frames, 1);
    assert!(moved.missing[0].contains("moved"), "{:?}", moved.missing);
}

/// The same board with its nodes counted from the opposite corner, as a frame without its key may be read.
fn rotated_by_half(mut detection: Detection, orientation: Orientation) -> Detection {
    let board = board();
    for n in &mut detection.nodes {
        (n.i, n.j) = (8 - n.i, 8 - n.j);
        [n.node.xi_m, n.node.eta_m] = crate::board::node_m(&board, n.i, n.j);
    }
    detection.orientation = orientation;
    detection
}

#[test]
fn a_still_board_keeps_its_nodes_when_the_key_is_hidden() {
    let rig = Rig::behind_port();
    let mut online = OnlineCalibration::new(board(), OnlineOptions::default());
    online.push(&detection(&rig, 1, 0.0, |_, _| true), None);
    for orientation in [Orientation::KeyHidden, Orientation::UprightAssumed] {
        let seen = rotated_by_half(detection(&rig, 2, 0.0, |i, _| i != 3), orientation);
        let known = online.recognise(&seen).unwrap();
        assert_eq!(known.orientation, Orientation::KeySeen);
        let truth = detection(&rig, 2, 0.0, |i, _| i != 3);
        assert_eq!(known.nodes, truth.nodes);
        let frames = online.push(&seen, None).frames;
        assert!(frames > 1, "the average goes on: {frames}");
    }
    // Moved and hidden: ambiguous, and what is known stays as it was.
    let moved = rotated_by_half(
        detection(&rig, 3, 0.004, |_, _| true),
        Orientation::KeyHidden,
    );
    assert_eq!(online.recognise(&moved), None);
    let status = online.push(&moved, None);
    assert_eq!((status.frames, status.accepted), (3, false));
    assert!(status.missing[0].contains("key"), "{:?}", status.missing);
}

#[test]
fn a_hidden_key_alone_begins_nothing_and_the_key_corrects_what_was_assumed() {
    let rig = Rig::behind_port();
    let mut online = OnlineCalibration::new(board(), OnlineOptions::default());
    let hidden = rotated_by_half(detection(&rig, 1, 0.0, |_, _| true), Orientation::KeyHidden);
    let status = online.push(&hidden, None);
    assert_eq!((status.frames, status.nodes), (0, 0));
    let assumed = rotated_by_half(
        detection(&rig, 1, 0.0, |_, _| true),
        Orientation::UprightAssumed,
    );
    assert_eq!(online.push(&assumed, None).frames, 1);
    let truth = detection(&rig, 2, 0.0, |_, _| true);
    let status = online.push(&truth, None);
    assert_eq!(status.frames, 1);
    assert!(
        status.missing[0].contains("the key came into view"),
        "{:?}",
        status.missing
    );
    assert_eq!(online.nodes().len(), 81);
    assert!((online.nodes()[0].column_px - truth.nodes[0].node.column_px).abs() < 0.1);
}

fn calibration(method: Method, seed: u64, rig: &Rig, shift_m: f64) -> Calibration {
    let mut online = OnlineCalibration::new(
        board(),
        OnlineOptions {
            method,
            fit: FitOptions {
                image: None,
                refractive: Some(crate::synthetic::truth::prior(rig)),
            },
            ..OnlineOptions::default()
        },
    );
    online.push(&detection(rig, seed, shift_m, |_, _| true), Some(gap(5e-5)));
    online.calibration(provenance()).unwrap()
}

#[test]
fn files_read_back_to_the_same_map() {
    for &method in Method::ALL {
        let made = calibration(method, 4, &Rig::behind_port(), 0.0);
        let text = made.to_toml().unwrap();
        let again =
            Calibration::from_toml(&text, "c.toml").unwrap_or_else(|e| panic!("{method:?}: {e}"));
        assert_eq!(again.map.method(), method.name());
        let (a, b) = (made.to_map(), again.to_map());
        let p = a.to_plane(350.0, 280.0).unwrap();
        assert_eq!(Some(p), b.to_plane(350.0, 280.0), "{method:?}");
        assert_eq!(again.to_toml().unwrap(), text);
        // Through placement and gap and back.
        let (column, row) = a.to_image(p.xi_m, p.eta_m).unwrap();
        assert!(
            (column - 350.0).hypot(row - 280.0) < 1.0,
            "{method:?} {column} {row}"
        );
        assert!(Calibration::from_toml(&text.replace("xi_m", "xy_m"), "c.toml").is_err());
    }
}

#[test]
fn an_air_calibration_is_refused_in_water_unless_forced() {
    let mut made = calibration(Method::Homography, 4, &Rig::behind_port(), 0.0);
    assert_eq!(made.check_use(Medium::Fresh, false), Ok(None));
    made.medium = Medium::Air;
    let error = made
        .check_use(Medium::Fresh, false)
        .unwrap_err()
        .to_string();
    assert!(error.contains("air") && error.contains("fresh") && error.contains("force"));
    assert!(made.check_use(Medium::Fresh, true).unwrap().is_some());
}

#[test]
fn drift_and_agreement() {
    let rig = Rig::behind_port();
    let old = calibration(Method::Homography, 4, &rig, 0.0);
    let new = calibration(Method::Homography, 5, &rig, 0.0);
    let same = compare(&old, &new, false).unwrap();
    assert!(!same.drifted() && same.max_m < 0.2e-3, "{}", same.words());
    // The camera was knocked: principal point 3 px off.
    let knocked = Rig {
        centre_px: [362.5, 287.5],
        ..rig
    };
    let other = calibration(Method::Homography, 6, &knocked, 0.0);
    let drift = compare(&old, &other, false).unwrap();
    assert!(drift.drifted() && drift.max_m > 1e-3, "{}", drift.words());
    // Two poses of one board: apart as they hang, together once that is taken out.
    let pose = calibration(Method::Homography, 7, &rig, 0.02);
    assert!(compare(&old, &pose, false).unwrap().drifted());
    let aligned = compare(&old, &pose, true).unwrap();
    assert!(!aligned.drifted(), "{}", aligned.words());
    assert!((aligned.removed.unwrap()[0].abs() - 0.02).abs() < 1e-3);
}

#[test]
fn parameters_move_points_by_what_the_map_states_of_its_own_uncertainty() {
    // The homography states beside it what its model leaves of a port's refraction, which is no parameter.
    for (method, least) in [(Method::Homography, 0.5), (Method::Refractive, 0.99)] {
        let map = calibration(method, 4, &Rig::behind_port(), 0.0).to_map();
        let by = map.parameter_slopes(350.0, 280.0).unwrap();
        let found = &by * map.parameter_covariance() * by.transpose();
        let stated = map.to_plane(350.0, 280.0).unwrap().covariance_m2;
        for i in 0..2 {
            let ratio = found[(i, i)] / stated[(i, i)];
            assert!((least..1.01).contains(&ratio), "{method:?} {i}: {ratio}");
        }
        assert!(map.parameter_slopes(-500.0, 280.0).is_none());
    }
}

/// What the rig's mounts place lies where they see it, whatever the calibration errs in all nodes alike.
#[test]
fn a_board_that_the_rig_places_has_no_error_that_moves_all_nodes_alike() {
    let mut made = calibration(Method::Homography, 4, &Rig::behind_port(), 0.0);
    let free = made.to_map();
    let mut placement = made.placement.unwrap();
    placement.is_by_rig = true;
    made.placement = Some(placement);
    let held = made.to_map();
    let means = [&free, &held].map(|map| {
        let each = made.nodes.iter().filter_map(|n| {
            let pixel = free.to_image(
                placement.xi_m + n.xi_m - placement.turn_rad * n.eta_m,
                placement.eta_m + n.eta_m + placement.turn_rad * n.xi_m,
            )?;
            map.parameter_slopes(pixel.0, pixel.1)
        });
        let (count, sum) = each.fold(
            (
                0,
                nalgebra::Matrix2xX::zeros(free.parameter_covariance().nrows()),
            ),
            |(n, s), by| (n + 1, s + by),
        );
        assert!(count > 50);
        let mean = sum / f64::from(count);
        (&mean * map.parameter_covariance() * mean.transpose())
            .trace()
            .sqrt()
    });
    // Border nodes may fall out of the region by rounding.
    assert!(means[1] < 0.1 * means[0], "{means:?}");
}
