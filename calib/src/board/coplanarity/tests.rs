use super::*;
use crate::detect::synthetic::{LaserSheet, Scene, View, render};
use crate::detect::{Detection, Grey, detect};
use crate::map::{FitOptions, Method, fit};
use crate::study::truth::Rig;
use hydroline_rigs::{BoardPattern, GaugeBlock};

fn board(blocks: bool) -> Board {
    let block = |x, y| GaugeBlock {
        centre_m: [x, y],
        size_m: [0.03, 0.03],
        height_m: 0.01,
    };
    Board {
        name: "test".into(),
        pattern: BoardPattern::Dots { diameter_m: 0.012 },
        columns: 9,
        rows: 9,
        pitch_m: 0.04,
        margin_m: 0.02,
        thickness_m: 0.006,
        blocks: if blocks {
            vec![block(-0.14, -0.06), block(0.14, -0.06), block(0.02, 0.14)]
        } else {
            Vec::new()
        },
    }
}

/// The board in the sheet of the rig behind a port of `study::truth`, seen at 45°.
fn see(board: &Board, sheet: LaserSheet, seed: u64) -> (Detection, Coplanarity) {
    let view = View::behind_port(Rig::behind_port(), 0.0);
    let scene = Scene {
        // The laser must show beside the room's light: that is turned down.
        greys: [110.0, 20.0, 40.0],
        light: [0.9, 1.0, 1.0, 0.85],
        laser: Some(sheet),
        seed,
        ..Scene::default()
    };
    let pixels = render(board, &view, &scene);
    let grey = Grey::new(720, 576, &pixels).unwrap();
    let detection = detect(&grey, board).unwrap();
    let map = fit(
        Method::Homography,
        &detection.nodes(),
        &FitOptions::default(),
    )
    .unwrap();
    let options = GaugeOptions {
        // As the rig file says, without the port: the entrance pupil in air.
        camera_m: [0.0, 0.46, 0.46],
        sheet_sigma_m: [0.002, 0.0002],
        blur_px: detection.blur_px,
    };
    let found = measure(&grey, board, &map, &options);
    (detection, found)
}

fn sheet(offset_m: f64) -> LaserSheet {
    LaserSheet {
        offset_m,
        tilt_xi: 0.0,
        tilt_eta: 0.0,
        sigma_m: 0.0021,
        peak: 130.0,
        apex_m: 0.68,
    }
}

#[test]
fn a_board_off_the_sheet_is_reported_or_not_claimed() {
    for (n, offset_m) in [-1e-3, 0.0, 1e-3, 3e-3].into_iter().enumerate() {
        let (_, found) = see(&board(true), sheet(offset_m), n as u64);
        println!("{:+.1} mm: {}", 1e3 * offset_m, found.words());
        match &found {
            Coplanarity::Measured(gap) => {
                let error = (gap.offset_m - offset_m).abs();
                assert!(error < 0.3e-3, "{offset_m}: {}", found.words());
                assert!(
                    error < 3.5 * gap.offset_sd_m(),
                    "{offset_m}: {}",
                    found.words()
                );
            }
            Coplanarity::Unknown(_) => assert!(found.words().contains("no accuracy")),
        }
        if offset_m > 0.0 {
            assert!(
                matches!(found, Coplanarity::Measured(_)),
                "{}",
                found.words()
            );
        }
    }
}

#[test]
fn tilt_is_seen() {
    let tilted = LaserSheet {
        tilt_xi: 0.006,
        tilt_eta: -0.008,
        ..sheet(2.5e-3)
    };
    let (_, found) = see(&board(true), tilted, 9);
    println!("{}", found.words());
    let Coplanarity::Measured(gap) = found else {
        panic!("{}", found.words());
    };
    assert!((gap.tilt_xi_rad - 0.006).abs() < 2e-3, "{gap:?}");
    assert!((gap.tilt_eta_rad + 0.008).abs() < 3e-3, "{gap:?}");
}

#[test]
fn dark_or_missing_blocks_are_unknown() {
    let (_, none) = see(&board(false), sheet(1e-3), 1);
    assert!(none.words().contains("fewer than 3 gauge blocks"));
    // 12 mm in front of the face the sheet passes over the blocks.
    let (_, over) = see(&board(true), sheet(25e-3), 2);
    assert!(matches!(over, Coplanarity::Unknown(_)), "{}", over.words());
    // An unknown gap costs what 1 mm costs: eta error 1 mm at eta_c - eta = d.
    let c = none.covariance_m2(0.0, 0.0);
    assert!((c[(1, 1)].sqrt() - 1e-3).abs() < 1e-9, "{c}");
}

#[test]
fn parallax_goes_both_ways() {
    let gap = Coplanarity::Measured(Gap {
        offset_m: 1.5e-3,
        tilt_xi_rad: 2e-3,
        tilt_eta_rad: -1e-3,
        sheet_sigma_m: 2e-3,
        blocks: 3,
        camera_m: [0.0, 0.46, 0.46],
        covariance: DMatrix::identity(3, 3) * 1e-8,
    });
    let sheet = gap.face_to_sheet(0.1, -0.2);
    // h = 1.9 mm, lever (0.46 + 0.2)/0.46: 1 mm of gap → (η_c − η)/ζ_c mm.
    assert!((sheet[1] + 0.2 - 1.9e-3 * 0.66 / 0.46).abs() < 1e-12);
    let back = gap.sheet_to_face(sheet[0], sheet[1]);
    assert!((back[0] - 0.1).abs() < 1e-12 && (back[1] + 0.2).abs() < 1e-12);
}
