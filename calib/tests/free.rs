//! Boards in the hand, rendered: the sheet, the map and its covariance against the truth.
//!
//! The proof of 200 sessions: `FREE_SESSIONS=200 cargo test -p hydroline-calib --release --test free -- --ignored --nocapture`

#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, missing_docs)]

mod synthetic;

use hydroline_calib::ImageSize;
use hydroline_calib::detect::{Grey, detect_in_hand, find_line};
use hydroline_calib::free::{
    CameraPrior, Fitted, FreeError, FreeOptions, Seen, calibrate, camera::Plate,
};
use hydroline_calib::map::refractive::Known;
use synthetic::hand::Session;

fn see(session: &Session) -> Vec<Seen> {
    let [w, h] = session.camera.size;
    (0..session.poses.len())
        .filter_map(|k| {
            let pixels = session.image(k);
            let grey = Grey::new(w, h, &pixels).unwrap();
            let found = detect_in_hand(&grey, &session.board).ok()?;
            let line = find_line(&grey, &session.board, &found);
            Some(Seen::new(
                format!("image {k}"),
                &session.board,
                &found,
                line,
            ))
        })
        .collect()
}

fn options(session: &Session) -> FreeOptions {
    let image = ImageSize {
        width_px: session.camera.size[0] as u32,
        height_px: session.camera.size[1] as u32,
    };
    let mut prior = CameraPrior::unknown(image, Known::new(session.camera.n_medium, 0.0005));
    if let Some([distance, glass_m, n_glass]) = session.camera.port {
        prior = prior.behind(
            Plate { glass_m, n_glass },
            Known::new(distance + 0.002, 0.003),
        );
    }
    FreeOptions::new(image, prior)
}

/// Over pixels that the map answers: distance of its points from the true sheet, worst \[m\]; error in the plane,
/// worst; share within the 95 % region; pixels.
fn against_truth(session: &Session, fitted: &Fitted) -> (f64, f64, f64, usize) {
    let (mut error, mut inside, mut count) = (0.0f64, 0, 0);
    let mut offs: Vec<f64> = Vec::new();
    for r in (4..576).step_by(24) {
        for c in (4..720).step_by(24) {
            let (c, r) = (f64::from(c), f64::from(r));
            let Some(plane) = fitted.map.to_plane(c, r) else {
                continue;
            };
            let (from, along) = session.camera.ray(c, r);
            let laser = &session.laser;
            let far = (laser.offset_m - laser.normal.dot(&from)) / laser.normal.dot(&along);
            let truth = from + along * far;
            let point = fitted.map.point(c, r).unwrap();
            offs.push(session.laser.distance_m(&point));
            let at = fitted.map.coordinates(&truth);
            let d = nalgebra::Vector2::new(plane.xi_m - at[0], plane.eta_m - at[1]);
            error = error.max(d.norm());
            let z = d.dot(&(plane.covariance_m2.try_inverse().unwrap() * d));
            inside += usize::from(z < 5.991);
            count += 1;
        }
    }
    // Behind a port the pupil's distance from it shifts camera and sheet together, which no measurement on the sheet
    // notices.
    let mean = offs.iter().sum::<f64>() / offs.len().max(1) as f64;
    let shift = if session.camera.port.is_some() {
        mean
    } else {
        0.0
    };
    let off = offs.iter().map(|o| (o - shift).abs()).fold(0.0, f64::max);
    (
        off,
        error,
        f64::from(inside as u32) / count.max(1) as f64,
        count,
    )
}

fn report(seed: u64, boards: usize, wet: bool) -> Option<(f64, f64, f64)> {
    let session = Session::random(seed, boards, wet);
    let seen = see(&session);
    let lines = seen.iter().filter(|s| !s.line.is_empty()).count();
    let name = if wet { "wet" } else { "dry" };
    match calibrate(&seen, &options(&session)) {
        Ok(fitted) => {
            let (off, error, inside, count) = against_truth(&session, &fitted);
            println!(
                "{name} {seed:3}: {}/{boards} boards, {lines} lines, node {:.3} px, line {:.3} px, scales {:.2} {:.2}, f {:.2} (true {:.2}), terms {:?}; sheet off {:.3} mm, map off {:.3} mm at worst, {:.0} % of {count} inside",
                seen.len(),
                fitted.rms_px,
                fitted.line_px,
                fitted.noise_scale[0],
                fitted.noise_scale[1],
                fitted.map.lens.numbers[0],
                session.camera.focal_px,
                fitted.terms,
                1e3 * off,
                1e3 * error,
                100.0 * inside
            );
            for v in fitted.views.iter().filter(|v| v.left_out.is_some()) {
                println!("   {} left out: {}", v.name, v.left_out.as_ref().unwrap());
            }
            for d in &fitted.reservations {
                println!("   {d}");
            }
            if let Some(h) = fitted.held {
                println!("   {h:?}");
            }
            Some((off, error, inside))
        }
        Err(error) => {
            println!(
                "{name} {seed:3}: {}/{boards} boards, {lines} lines: {error}",
                seen.len()
            );
            None
        }
    }
}

#[test]
#[ignore = "minutes; the command is in the book"]
fn two_hundred_sessions() {
    let sessions: u64 = std::env::var("FREE_SESSIONS").map_or(200, |v| v.parse().unwrap());
    let (mut good, mut inside, mut total) = (0, 0.0, 0u64);
    for seed in 0..sessions {
        let boards = 8 + (seed * 7 % 18) as usize;
        if let Some((off, _, share)) = report(seed, boards, seed % 2 == 1) {
            good += u64::from(off < 0.15e-3);
            inside += share;
            total += 1;
        }
    }
    println!(
        "{good} of {total} sheets within 0.15 mm, {:.1} % of the map inside its 95 % region",
        100.0 * inside / total as f64
    );
    assert!(good * 100 >= total * 95);
}

#[test]
fn a_session_in_air_gives_the_sheet_and_four_boards_are_refused() {
    let session = Session::random(2, 8, false);
    let seen = see(&session);
    let fitted = calibrate(&seen, &options(&session)).unwrap();
    let (off, error, _, pixels) = against_truth(&session, &fitted);
    assert!(
        pixels > 50 && off < 0.15e-3 && error < 0.5e-3,
        "{pixels} {off} {error}"
    );
    let error = calibrate(&seen[..4], &options(&session)).unwrap_err();
    assert!(
        matches!(
            error,
            FreeError::TooFewBoards {
                found: 4,
                needed: 5
            }
        ),
        "{error}"
    );
}

#[test]
fn boards_without_a_line_are_refused_with_their_reason() {
    let mut session = Session::random(2, 5, false);
    session.laser.peak = 0.0;
    let error = calibrate(&see(&session), &options(&session)).unwrap_err();
    assert!(
        matches!(error, FreeError::TooFewLines { found: 0, .. }),
        "{error}"
    );
}

/// Calibrated in air behind its port, used in water.
#[test]
#[ignore = "minutes; the command is in the book"]
fn air_to_water() {
    let (mut worst, mut worst_without) = (0.0f64, 0.0f64);
    let (mut inside, mut total) = (0usize, 0usize);
    for seed in 0..6 {
        let mut session = Session::random(seed, 14, true);
        session.camera.n_medium = 1.0003;
        // Rays are those of the camera in air.
        session = Session::new(
            session.camera,
            session.laser,
            session.board,
            session.poses,
            session.scene,
        );
        let fitted = calibrate(&see(&session), &options(&session)).unwrap();
        let wet = fitted.map.in_medium(Known::new(1.335, 0.0005)).unwrap();
        let mut camera = session.camera;
        camera.n_medium = 1.335;
        for r in (4..576).step_by(24) {
            for c in (4..720).step_by(24) {
                let (c, r) = (f64::from(c), f64::from(r));
                let (Some(plane), Some(dry)) = (wet.to_plane(c, r), fitted.map.point(c, r)) else {
                    continue;
                };
                let (from, along) = camera.ray(c, r);
                let laser = &session.laser;
                let truth = from
                    + along
                        * ((laser.offset_m - laser.normal.dot(&from)) / laser.normal.dot(&along));
                let at = wet.coordinates(&truth);
                let d = nalgebra::Vector2::new(plane.xi_m - at[0], plane.eta_m - at[1]);
                worst = worst.max(d.norm());
                worst_without = worst_without.max((fitted.map.coordinates(&dry) - at).norm());
                inside +=
                    usize::from(d.dot(&(plane.covariance_m2.try_inverse().unwrap() * d)) < 5.991);
                total += 1;
            }
        }
    }
    println!(
        "air to water: worst {:.3} mm, without the port's model {:.1} mm; {inside} of {total} inside",
        1e3 * worst,
        1e3 * worst_without
    );
    assert!(inside * 10 >= total * 9);
}

/// Images of a dry session as files, for `hydroline calibrate --free` itself: tests/free.
#[test]
#[ignore = "writes files: FREE_OUT=DIR, by tests/free"]
fn images_for_the_command() {
    let folder = std::path::PathBuf::from(std::env::var_os("FREE_OUT").unwrap());
    let session = Session::random(1, 15, false);
    let [w, h] = session.camera.size;
    for k in 0..session.poses.len() {
        let mut file = format!("P5\n{w} {h}\n255\n").into_bytes();
        file.extend(session.image(k));
        std::fs::write(folder.join(format!("{k:02}.pgm")), file).unwrap();
    }
    let board = &session.board;
    let toml = format!(
        "name = \"hand\"\npattern = \"chessboard\"\ncolumns = {}\nrows = {}\npitch_m = {}\nmargin_m = {}\nthickness_m = {}\n",
        board.columns, board.rows, board.pitch_m, board.margin_m, board.thickness_m
    );
    std::fs::write(folder.with_file_name("board.toml"), toml).unwrap();
}
