use super::synthetic::{Scene, View, clutter, render};
use super::*;
use hydroline_rigs::GaugeBlock;

pub(crate) fn board(pattern: BoardPattern) -> Board {
    let chess = matches!(pattern, BoardPattern::Chessboard);
    let block = |x, y| GaugeBlock {
        centre_m: [x, y],
        size_m: [0.03, 0.03],
        height_m: 0.01,
    };
    Board {
        name: "test".into(),
        pattern,
        columns: if chess { 14 } else { 11 },
        rows: if chess { 10 } else { 11 },
        pitch_m: if chess { 0.025 } else { 0.05 },
        margin_m: 0.025,
        thickness_m: 0.006,
        blocks: if chess {
            Vec::new()
        } else {
            vec![
                block(-0.175, -0.175),
                block(0.175, -0.175),
                block(0.025, 0.175),
            ]
        },
    }
}

pub(crate) const PATTERNS: [BoardPattern; 3] = [
    BoardPattern::Lines { line_m: 0.002 },
    BoardPattern::Dots { diameter_m: 0.015 },
    BoardPattern::Chessboard,
];

/// A view that fits the board: focal length 740 px as in the paper's rig.
pub(crate) fn view(board: &Board, angle_deg: f64, azimuth_deg: f64, roll_deg: f64) -> View {
    let half = crate::board::half_size_m(board);
    View::pinhole(
        [720, 576],
        740.0,
        740.0 * half[1] / 250.0 + half[1] * angle_deg.to_radians().sin(),
        angle_deg.to_radians(),
        azimuth_deg.to_radians(),
        roll_deg.to_radians(),
    )
}

struct Errors {
    rms_px: f64,
    max_px: f64,
    /// Mean squared Mahalanobis length over 2: 1 when the covariances are honest.
    consistency: f64,
}

fn errors(detection: &Detection, view: &View) -> Errors {
    let (mut sum, mut max, mut chi2) = (0.0, 0.0f64, 0.0);
    for n in &detection.nodes {
        let p = view.project(n.node.xi_m, n.node.eta_m, 0.0).unwrap();
        let e = nalgebra::Vector2::new(n.node.column_px - p[0], n.node.row_px - p[1]);
        sum += e.norm_squared();
        max = max.max(e.norm());
        chi2 += (e.transpose() * n.node.covariance_px2.try_inverse().unwrap() * e)[0];
    }
    let count = 2.0 * detection.nodes.len() as f64;
    Errors {
        rms_px: (sum / count).sqrt(),
        max_px: max,
        consistency: chi2 / count,
    }
}

fn look(board: &Board, view: &View, scene: &Scene) -> Result<Detection, NotFound> {
    let pixels = render(board, view, scene);
    detect(
        &Grey::new(scene.size[0], scene.size[1], &pixels).unwrap(),
        board,
    )
}

#[test]
#[ignore = "prints figures"]
fn survey() {
    for pattern in PATTERNS {
        if std::env::var("P").is_ok_and(|v| !format!("{pattern:?}").starts_with(&v)) {
            continue;
        }
        let board = board(pattern);
        for (angle, azimuth) in [
            (0.0, 90.0),
            (20.0, 0.0),
            (30.0, 200.0),
            (45.0, 90.0),
            (60.0, 90.0),
            (60.0, 0.0),
            (60.0, 45.0),
        ] {
            let view = view(&board, angle, azimuth, 5.0);
            let scene = Scene::default();
            match look(&board, &view, &scene) {
                Ok(d) => {
                    let e = errors(&d, &view);
                    println!(
                        "{pattern:?} {angle} {azimuth}: {} nodes rms {:.4} max {:.3} chi2 {:.2} blur {:.2} noise {:.2} {:?}",
                        d.nodes.len(),
                        e.rms_px,
                        e.max_px,
                        e.consistency,
                        d.blur_px,
                        d.noise,
                        d.orientation
                    );
                }
                Err(e) => {
                    println!("{pattern:?} {angle} {azimuth}: {e}");
                    std::fs::write(
                        "/tmp/fail.pgm",
                        [b"P5 720 576 255\n".to_vec(), render(&board, &view, &scene)].concat(),
                    )
                    .unwrap();
                }
            }
        }
    }
}

/// Every third image at hand shows what can go wrong at once.
#[test]
#[ignore = "prints figures"]
fn survey_hard() {
    let mut found = [0; 3];
    let mut asked = 0;
    for k in 0..40u32 {
        let f = |a: f64, b: f64| {
            a + (b - a) * (f64::from(k) * 0.618_034 * (1.0 + a.abs().sqrt() + b)).fract()
        };
        let (angle, azimuth, roll) = (f(0.0, 60.0), f(0.0, 360.0), f(-20.0, 20.0));
        asked += 1;
        for (n, pattern) in PATTERNS.into_iter().enumerate() {
            let board = board(pattern);
            let view = view(&board, angle, azimuth, roll);
            let scene = Scene {
                light: [f(0.5, 1.1), f(0.5, 1.0), f(0.6, 1.0), f(0.6, 1.05)],
                stripe: Some([f(-150.0, 150.0), f(-0.3, 0.3), 2.0, 120.0]),
                occluders: vec![[f(0.0, 650.0), f(0.0, 500.0), 60.0, 60.0, 90.0]],
                blur_px: f(0.5, 1.2),
                seed: u64::from(k),
                ..Scene::default()
            };
            match look(&board, &view, &scene) {
                Ok(d) => {
                    found[n] += 1;
                    let e = errors(&d, &view);
                    println!(
                        "{k} {n} {angle:.0} {azimuth:.0} {roll:.0}: {} nodes rms {:.4} max {:.3} chi2 {:.2} blur {:.2}/{:.2} {:?}",
                        d.nodes.len(),
                        e.rms_px,
                        e.max_px,
                        e.consistency,
                        d.blur_px,
                        scene.blur_px,
                        d.orientation
                    );
                }
                Err(e) => {
                    println!("FAILED {k} {n} {angle:.0} {azimuth:.0} {roll:.0}: {e}");
                    std::fs::write(
                        format!("/tmp/fail{k}-{n}.pgm"),
                        [b"P5 720 576 255\n".to_vec(), render(&board, &view, &scene)].concat(),
                    )
                    .unwrap();
                }
            }
        }
    }
    println!("found {found:?} of {asked}");
}

#[test]
#[ignore = "prints figures"]
fn survey_clutter() {
    let mut wrong = 0;
    for seed in 0..200 {
        let pixels = clutter([720, 576], seed);
        let grey = Grey::new(720, 576, &pixels).unwrap();
        for pattern in PATTERNS {
            match detect(&grey, &board(pattern)) {
                Ok(d) => {
                    wrong += 1;
                    println!("{seed} {pattern:?}: {} nodes", d.nodes.len());
                }
                Err(e) => {
                    if seed < 8 {
                        println!("{seed}: {e}")
                    }
                }
            }
        }
    }
    println!("wrong {wrong}");
}
