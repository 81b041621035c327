//! Detection, and detection with an update of the online calibration, per 720 × 576 frame.
//! Beside OpenCV: `benches/detect_vs_opencv.rs`.

// A bench may stop at the first surprise.
#![allow(clippy::expect_used)]

use divan::{Bencher, black_box};
use hydroline_calib::detect::synthetic::{Scene, View, render};
use hydroline_calib::detect::{Grey, detect, detect_quick};
use hydroline_calib::online::{OnlineCalibration, OnlineOptions};
use hydroline_rigs::{Board, BoardPattern};

fn main() {
    divan::main();
}

const KINDS: [&str; 3] = ["lines", "dots", "chessboard"];

fn board(kind: &str) -> Board {
    let chess = kind == "chessboard";
    Board {
        name: kind.into(),
        pattern: match kind {
            "lines" => BoardPattern::Lines { line_m: 0.002 },
            "dots" => BoardPattern::Dots { diameter_m: 0.015 },
            _ => BoardPattern::Chessboard,
        },
        columns: if chess { 14 } else { 11 },
        rows: if chess { 10 } else { 11 },
        pitch_m: if chess { 0.025 } else { 0.05 },
        margin_m: 0.025,
        thickness_m: 0.006,
        blocks: Vec::new(),
    }
}

fn image(board: &Board, angle_deg: f64) -> Vec<u8> {
    let half = 0.5 * f64::from(board.rows) * board.pitch_m;
    let view = View::pinhole(
        [720, 576],
        740.0,
        740.0 * half / 250.0 + half * angle_deg.to_radians().sin(),
        angle_deg.to_radians(),
        std::f64::consts::FRAC_PI_2,
        0.05,
    );
    let scene = Scene {
        key: board.pattern != BoardPattern::Chessboard,
        light: [0.7, 1.0, 1.0, 0.8],
        ..Scene::default()
    };
    render(board, &view, &scene)
}

#[divan::bench(args = KINDS)]
fn detection_45(bencher: Bencher, kind: &str) {
    let board = board(kind);
    let pixels = image(&board, 45.0);
    let grey = Grey::new(720, 576, &pixels).expect("size");
    bencher.bench(|| detect(black_box(&grey), &board).map(|d| d.nodes.len()));
}

#[divan::bench(args = KINDS)]
fn detection_0(bencher: Bencher, kind: &str) {
    let board = board(kind);
    let pixels = image(&board, 0.0);
    let grey = Grey::new(720, 576, &pixels).expect("size");
    bencher.bench(|| detect(black_box(&grey), &board).map(|d| d.nodes.len()));
}

#[divan::bench(args = KINDS)]
fn detection_and_update(bencher: Bencher, kind: &str) {
    let board = board(kind);
    let pixels = image(&board, 45.0);
    let grey = Grey::new(720, 576, &pixels).expect("size");
    let mut online = OnlineCalibration::new(board.clone(), OnlineOptions::default());
    bencher.bench_local(|| {
        let found = detect(black_box(&grey), &board).expect("found");
        online.push(&found, None).nodes
    });
}

/// The same frame without a board: what every frame costs before the board comes.
#[divan::bench]
fn no_board(bencher: Bencher) {
    let board = board("lines");
    let pixels = hydroline_calib::detect::synthetic::clutter([720, 576], 6);
    let grey = Grey::new(720, 576, &pixels).expect("size");
    bencher.bench(|| detect_quick(black_box(&grey), &board).is_err());
}
