//! Detection and update per 720 × 576 frame, one core, and OpenCV's
//! `findChessboardCornersSB` on the same chessboard images:
//!
//! `HYDROLINE_PYTHON=V/bin/python cargo bench -p hydroline-calib --bench detect_vs_opencv`
//!
//! Python is `$HYDROLINE_PYTHON` or `python3`, with `opencv-python-headless` (`python3 -m
//! venv V && V/bin/pip install opencv-python-headless`); without it ours alone.

use std::collections::BTreeMap;
use std::error::Error;
use std::fmt::Write as _;
use std::path::Path;
use std::time::Instant;

use hydroline_calib::board::coplanarity::{Coplanarity, GaugeOptions, measure};
use hydroline_calib::detect::{Grey, detect, detect_quick};
use hydroline_calib::map::{FitOptions, Method, fit};
use hydroline_calib::online::{OnlineCalibration, OnlineOptions};
use hydroline_rigs::{Board, BoardPattern, GaugeBlock};
use synthetic::{CLUTTER_KINDS, LaserSheet, Scene, View, clutter, render};

#[path = "../tests/synthetic/mod.rs"]
mod synthetic;

const REPEATS: u32 = 20;
/// The budget of the frame that the detector shares the core with \[ms\].
const BUDGET_MS: f64 = 20.0;

struct Shot {
    name: String,
    board: Board,
    view: View,
    pixels: Vec<u8>,
}

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

fn shots(part: &str) -> Vec<Shot> {
    let mut shots = Vec::new();
    for kind in ["lines", "dots", "chessboard"] {
        for (angle_deg, conditions) in [(0, ""), (30, ""), (45, ""), (60, ""), (45, " hard")] {
            let name = format!("{kind} {angle_deg}{conditions}");
            if !name.contains(part) {
                continue;
            }
            let board = board(kind);
            let half = 0.5 * f64::from(board.rows) * board.pitch_m;
            let angle = f64::from(angle_deg).to_radians();
            let view = View::pinhole(
                [720, 576],
                740.0,
                740.0 * half / 250.0 + half * angle.sin(),
                angle,
                std::f64::consts::FRAC_PI_2,
                0.05,
            );
            let hard = !conditions.is_empty();
            let scene = Scene {
                // OpenCV's boards carry no key.
                key: kind != "chessboard",
                light: if hard { [0.6, 1.0, 1.0, 0.7] } else { [1.0; 4] },
                stripe: hard.then_some([30.0, 0.1, 2.0, 120.0]),
                ..Scene::default()
            };
            shots.push(Shot {
                name,
                pixels: render(&board, &view, &scene),
                board,
                view,
            });
        }
    }
    shots
}

/// CPU time of this thread \[ms\]: another program on the core must not count.
fn cpu_ms() -> Option<f64> {
    let text = std::fs::read_to_string("/proc/thread-self/schedstat").ok()?;
    Some(1e-6 * text.split_whitespace().next()?.parse::<f64>().ok()?)
}

/// Mean CPU time (wall time where there is none) and least wall time \[ms\].
fn timed(mut run: impl FnMut()) -> (f64, f64) {
    run();
    let (wall, cpu) = (Instant::now(), cpu_ms());
    let mut least = f64::INFINITY;
    for _ in 0..REPEATS {
        let start = Instant::now();
        run();
        least = least.min(1e3 * start.elapsed().as_secs_f64());
    }
    let total = match (cpu, cpu_ms()) {
        (Some(before), Some(after)) => after - before,
        _ => 1e3 * wall.elapsed().as_secs_f64(),
    };
    (total / f64::from(REPEATS), least)
}

fn truth(shot: &Shot) -> Vec<[f64; 2]> {
    let b = &shot.board;
    (0..b.rows)
        .flat_map(|j| (0..b.columns).map(move |i| (i, j)))
        .filter_map(|(i, j)| {
            let [xi_m, eta_m] = hydroline_calib::board::node_m(b, i, j);
            shot.view.project(xi_m, eta_m, 0.0)
        })
        .collect()
}

fn rms_px(shot: &Shot, grey: &Grey<'_>) -> (usize, f64) {
    let Ok(found) = detect(grey, &shot.board) else {
        return (0, f64::NAN);
    };
    let squares: Vec<f64> = found
        .nodes
        .iter()
        .filter_map(|n| {
            let p = shot.view.project(n.node.xi_m, n.node.eta_m, 0.0)?;
            Some((n.node.column_px - p[0]).powi(2) + (n.node.row_px - p[1]).powi(2))
        })
        .collect();
    let count = squares.len();
    (
        count,
        (squares.iter().sum::<f64>() / (2.0 * count as f64)).sqrt(),
    )
}

/// OpenCV's lines by image name.
fn theirs(folder: &Path, shots: &[Shot]) -> Result<BTreeMap<String, String>, Box<dyn Error>> {
    for shot in shots {
        let stem = shot.name.replace(' ', "-");
        let data = [b"P5 720 576 255\n".as_slice(), &shot.pixels].concat();
        std::fs::write(folder.join(format!("{stem}.pgm")), data)?;
        let mut corners = String::new();
        for [column, row] in truth(shot) {
            writeln!(corners, "{column} {row}")?;
        }
        std::fs::write(folder.join(format!("{stem}.txt")), corners)?;
    }
    let python = std::env::var("HYDROLINE_PYTHON").unwrap_or_else(|_| "python3".to_owned());
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("benches/chessboard_opencv.py");
    let output = std::process::Command::new(&python)
        .arg(script)
        .arg(folder)
        .output()?;
    if !output.status.success() {
        return Err(format!("{python}: {}", String::from_utf8_lossy(&output.stderr)).into());
    }
    Ok(String::from_utf8(output.stdout)?
        .lines()
        .filter_map(|line| line.split_once(' '))
        .map(|(name, rest)| (name.to_owned(), rest.to_owned()))
        .collect())
}

/// A whole frame of a live calibration: board with gauge blocks in a laser sheet, 1 mm off.
fn in_the_sheet(kind: &str) -> Result<(f64, String), Box<dyn Error>> {
    let block = |x, y| GaugeBlock {
        centre_m: [x, y],
        size_m: [0.03, 0.03],
        height_m: 0.01,
    };
    let board = Board {
        blocks: vec![
            block(-0.175, -0.175),
            block(0.175, -0.175),
            block(0.025, 0.175),
        ],
        ..board(kind)
    };
    let half = 0.5 * f64::from(board.rows) * board.pitch_m;
    let angle = 45f64.to_radians();
    let away_m = 740.0 * half / 250.0 + half * angle.sin();
    let view = View::pinhole(
        [720, 576],
        740.0,
        away_m,
        angle,
        std::f64::consts::FRAC_PI_2,
        0.05,
    );
    let scene = Scene {
        greys: [120.0, 15.0, 40.0],
        laser: Some(LaserSheet {
            offset_m: 1e-3,
            tilt_xi: 0.0,
            tilt_eta: 0.0,
            sigma_m: 0.002,
            peak: 110.0,
            apex_m: 0.68,
        }),
        ..Scene::default()
    };
    let pixels = render(&board, &view, &scene);
    let grey = Grey::new(720, 576, &pixels).ok_or("size")?;
    let mut online = OnlineCalibration::new(board.clone(), OnlineOptions::default());
    let mut words = String::new();
    let (ms, _) = timed(|| {
        let Ok(found) = detect_quick(std::hint::black_box(&grey), &board) else {
            return;
        };
        let gap = fit(Method::Homography, &found.nodes(), &FitOptions::default())
            .ok()
            .map(|map| {
                let options = GaugeOptions {
                    camera_m: [0.0, away_m * angle.sin(), away_m * angle.cos()],
                    sheet_sigma_m: [0.002, 0.0002],
                    blur_px: found.blur_px,
                };
                measure(&grey, &board, &map, &options)
            });
        words = gap.as_ref().map_or_else(String::new, Coplanarity::words);
        std::hint::black_box(online.push(&found, gap));
    });
    Ok((ms, words))
}

fn main() -> Result<(), Box<dyn Error>> {
    // `-- PART` looks at images whose name holds PART only: for a profiler.
    let part = std::env::args()
        .skip(1)
        .find(|a| !a.starts_with('-'))
        .unwrap_or_default();
    let shots = shots(&part);
    let folder = std::env::temp_dir().join(format!("hydroline-opencv-{}", std::process::id()));
    std::fs::create_dir_all(&folder)?;
    let other = theirs(&folder, &shots);
    std::fs::remove_dir_all(&folder)?;
    match &other {
        Ok(o) => println!(
            "OpenCV {}: findChessboardCornersSB, one thread",
            o.get("version").map_or("?", String::as_str)
        ),
        Err(e) => eprintln!("OpenCV not measured: {e}"),
    }
    println!(
        "ms: mean CPU time of {REPEATS} (as many in Python) / least; rms in px per coordinate"
    );
    let mut worst = 0.0f64;
    for shot in &shots {
        let grey = Grey::new(720, 576, &shot.pixels).ok_or("size")?;
        let (nodes, rms) = rms_px(shot, &grey);
        let (alone, least) = timed(|| {
            let _ = std::hint::black_box(detect_quick(std::hint::black_box(&grey), &shot.board));
        });
        let mut online = OnlineCalibration::new(shot.board.clone(), OnlineOptions::default());
        let (both, _) = timed(|| {
            if let Ok(found) = detect_quick(std::hint::black_box(&grey), &shot.board) {
                std::hint::black_box(online.push(&found, None));
            }
        });
        worst = worst.max(both);
        print!(
            "{:20} {nodes:3} nodes  rms {rms:.4}  detection {alone:5.2} / {least:5.2}  with update {both:5.2}",
            shot.name
        );
        match other
            .as_ref()
            .ok()
            .and_then(|o| o.get(&shot.name.replace(' ', "-")))
        {
            Some(line) => {
                let n: Vec<f64> = line.split(' ').filter_map(|v| v.parse().ok()).collect();
                if let [found, mean, least, rms] = n[..] {
                    println!(
                        "   OpenCV {} rms {rms:.4}  {mean:5.2} / {least:5.2}",
                        if found > 0.0 { "found" } else { "not found" }
                    );
                }
            }
            None => println!(),
        }
    }
    for kind in ["lines", "dots"] {
        let name = format!("{kind} 45 in the sheet");
        if !name.contains(&part) {
            continue;
        }
        let (ms, gap) = in_the_sheet(kind)?;
        worst = worst.max(ms);
        println!("{name:20} detection, gauge blocks and update {ms:5.2}   ({gap})");
    }
    // Every frame costs this before the board comes, over all kinds of floors and clutter.
    for kind in ["lines", "dots", "chessboard"] {
        let board = board(kind);
        let mut slowest = (0.0, 0.0, "");
        let mut sum = 0.0;
        for (seed, name) in (0u64..).zip(CLUTTER_KINDS) {
            if !format!("{kind} in {name}").contains(&part) {
                continue;
            }
            let pixels = clutter([720, 576], seed);
            let grey = Grey::new(720, 576, &pixels).ok_or("size")?;
            let (mean, least) = timed(|| {
                let _ = std::hint::black_box(detect_quick(std::hint::black_box(&grey), &board));
            });
            sum += mean / CLUTTER_KINDS.len() as f64;
            if mean > slowest.0 {
                slowest = (mean, least, name);
            }
        }
        if slowest.0 == 0.0 {
            continue;
        }
        println!(
            "no board ({kind} sought): mean {sum:5.2}, slowest {:5.2} / {:5.2} ({})",
            slowest.0, slowest.1, slowest.2
        );
        worst = worst.max(slowest.0);
    }
    println!("worst frame, with update or without a board: {worst:.2} ms of {BUDGET_MS} ms");
    Ok(())
}
