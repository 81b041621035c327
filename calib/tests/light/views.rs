//! Random views of boards under real light, and what a detection of them is worth.

use crate::synthetic::{Scene, Tone, View, render};
use hydroline_calib::detect::{Detection, NotFound};
use hydroline_calib::map::{FitOptions, Method, fit};
use hydroline_calib::online::{OnlineCalibration, OnlineOptions};
use hydroline_rigs::{Board, BoardPattern};
use rand::{RngExt, SeedableRng, rngs::StdRng};
use std::fmt;

pub const KINDS: [&str; 5] = ["dots-50", "chess-25", "lines-50", "dots-30", "chess-40"];

/// Built-in boards, and two of other pitches.
pub fn board(kind: &str) -> Board {
    let smaller = |of: &str, columns, rows, pitch_m| {
        let board = Board::load_or_builtin(of).unwrap();
        Board {
            name: kind.to_owned(),
            pattern: match board.pattern {
                BoardPattern::Dots { .. } => BoardPattern::Dots {
                    diameter_m: 0.4 * pitch_m,
                },
                other => other,
            },
            columns,
            rows,
            pitch_m,
            margin_m: pitch_m,
            blocks: Vec::new(),
            ..board
        }
    };
    match kind {
        "dots-30" => smaller("dots-50", 13, 9, 0.030),
        "chess-40" => smaller("chess-25", 9, 7, 0.040),
        "lines-50" => Board::load_or_builtin("wc-lines-50").unwrap(),
        _ => Board::load_or_builtin(kind).unwrap(),
    }
}

/// A number from the environment.
pub fn number(name: &str, default: f64) -> f64 {
    std::env::var(name).map_or(default, |v| v.parse().unwrap())
}

pub struct Shot {
    pub board: Board,
    pub view: View,
    pub pixels: Vec<u8>,
}

/// View `seed` of a board through a camera of that γ: pose, blur, noise, light and levels by the seed.
pub fn view(kind: &str, seed: u64, gamma: f64) -> Shot {
    let (board, view, scene) = scene(kind, seed, gamma);
    Shot {
        pixels: render(&board, &view, &scene),
        board,
        view,
    }
}

pub fn scene(kind: &str, seed: u64, gamma: f64) -> (Board, View, Scene) {
    let board = board(kind);
    let mut rng = StdRng::seed_from_u64(seed ^ 0x11947);
    let mut any = |low: f64, high: f64| rng.random_range(low..high);
    let half = hydroline_calib::board::half_size_m(&board);
    let angle = any(0.0, 55.0f64).to_radians();
    let far =
        740.0 * (half[0] / 330.0).max(half[1] / 260.0) * any(1.0, 1.35) + half[1] * angle.sin();
    let view = View::pinhole(
        [720, 576],
        740.0,
        far,
        angle,
        any(0.0, std::f64::consts::TAU),
        any(-0.35, 0.35),
    );
    let scene = Scene {
        greys: [any(150.0, 240.0), any(8.0, 40.0), any(3.0, 120.0)],
        light: [any(0.7, 1.0), any(0.7, 1.0), any(0.84, 1.0), any(0.84, 1.0)],
        blur_px: any(0.4, 1.5),
        noise: any(1.0, 6.0),
        tone: Tone {
            gamma,
            black: any(0.0, 20.0),
            ceiling: if any(0.0, 1.0) < 0.5 { 235.0 } else { 255.0 },
            noise_before: any(0.0, 1.0) < 0.5,
        },
        seed,
        exposure: number("LIGHT_EXPOSURE", 1.0),
        ..Scene::default()
    };
    (board, view, scene)
}

/// A view with something in front of it.
pub struct Covered {
    pub shot: Shot,
    /// Side, as the camera sees it.
    pub side: &'static str,
    /// Nodes that are seen whole.
    pub visible: Vec<(u32, u32)>,
}

/// View `seed` with a plate, bright or dark, over 20–60 % of the board from one side.
pub fn covered(kind: &str, seed: u64, gamma: f64) -> Covered {
    let (board, view, mut scene) = scene(kind, seed, gamma);
    let mut rng = StdRng::seed_from_u64(seed ^ 0xc04e);
    let share = rng.random_range(0.2..0.6);
    let side = ["left", "right", "upper", "lower"][seed as usize % 4];
    let axis = if seed % 4 < 2 { 0 } else { 1 };
    let sign = if seed.is_multiple_of(2) { 1.0 } else { -1.0 };
    let mut places: Vec<(f64, (u32, u32))> = Vec::new();
    for j in 0..board.rows {
        for i in 0..board.columns {
            let [x, y] = hydroline_calib::board::node_m(&board, i, j);
            places.push((sign * view.project(x, y, 0.0).unwrap()[axis], (i, j)));
        }
    }
    places.sort_by(|a, b| a.0.total_cmp(&b.0));
    let cut = sign * (places[(share * places.len() as f64) as usize].0 - 2.0);
    let grey = if rng.random_range(0.0..1.0) < 0.5 {
        rng.random_range(0.0..40.0)
    } else {
        rng.random_range(160.0..250.0)
    };
    scene.occluders = vec![match side {
        "left" => [-1.0, -1.0, cut + 1.0, 999.0, grey],
        "right" => [cut, -1.0, 999.0, 999.0, grey],
        "upper" => [-1.0, -1.0, 999.0, cut + 1.0, grey],
        _ => [-1.0, cut, 999.0, 999.0, grey],
    }];
    let visible = places
        .iter()
        .filter(|p| p.0 > sign * cut)
        .map(|p| p.1)
        .collect();
    Covered {
        shot: Shot {
            pixels: render(&board, &view, &scene),
            board,
            view,
        },
        side,
        visible,
    }
}

/// Pixels with left and right in exchange, or above and below.
pub fn flipped(pixels: &[u8], upside_down: bool) -> Vec<u8> {
    let rows = pixels.chunks_exact(720);
    if upside_down {
        rows.rev().flatten().copied().collect()
    } else {
        rows.flat_map(|r| r.iter().rev()).copied().collect()
    }
}

/// Accuracy of a detection.
#[derive(Debug, Clone, Copy)]
pub struct Worth {
    pub nodes: usize,
    pub sum_px2: f64,
    /// Squared errors in units of their covariance, per coordinate.
    pub chi2: f64,
    /// Of lengths along ξ and η all over the board.
    pub object_rms_mm: f64,
    pub object_max_mm: f64,
    /// Residuals of the calibration against noise, and whether that is said to be unusual.
    pub ratio: f64,
    pub unusual: bool,
}

pub fn judge(shot: &Shot, found: &Detection) -> Worth {
    let (mut sum, mut chi2) = (0.0, 0.0);
    for n in &found.nodes {
        let p = shot.view.project(n.node.xi_m, n.node.eta_m, 0.0).unwrap();
        let e = nalgebra::Vector2::new(n.node.column_px - p[0], n.node.row_px - p[1]);
        sum += e.norm_squared();
        chi2 += (e.transpose() * n.node.covariance_px2.try_inverse().unwrap() * e)[0];
    }
    let (object_rms_mm, object_max_mm) = object(shot, found).unwrap_or((f64::NAN, f64::NAN));
    let mut online = OnlineCalibration::new(shot.board.clone(), OnlineOptions::default());
    let misfit = online.push(found, None).misfit;
    Worth {
        ratio: misfit.map_or(f64::NAN, |m| m.ratio),
        unusual: misfit.is_some_and(|m| m.unusual()),
        nodes: found.nodes.len(),
        sum_px2: sum,
        chi2,
        object_rms_mm,
        object_max_mm,
    }
}

/// Errors of widths and heights of an object anywhere on the board, rms and largest \[mm\].
fn object(shot: &Shot, found: &Detection) -> Option<(f64, f64)> {
    let map = fit(Method::Homography, &found.nodes(), &FitOptions::default()).ok()?;
    let half = hydroline_calib::board::half_size_m(&shot.board).map(|v| v - shot.board.margin_m);
    let mut rng = StdRng::seed_from_u64(99);
    let seen = |xi: f64, eta: f64| {
        let p = shot.view.project(xi, eta, 0.0)?;
        map.to_plane(p[0], p[1]).map(|q| [q.xi_m, q.eta_m])
    };
    let (mut most, mut sum, mut count) = (0.0f64, 0.0, 0.0);
    for _ in 0..400 {
        let at = [0, 1].map(|k| rng.random_range(-half[k]..half[k]));
        let to = [0, 1].map(|k| rng.random_range(-half[k]..half[k]));
        let (Some(a), Some(b), Some(c)) =
            (seen(at[0], at[1]), seen(to[0], at[1]), seen(at[0], to[1]))
        else {
            continue;
        };
        for error in [
            (b[0] - a[0]) - (to[0] - at[0]),
            (c[1] - a[1]) - (to[1] - at[1]),
        ] {
            let mm = 1e3 * error.abs();
            most = most.max(mm);
            sum += mm * mm;
            count += 1.0;
        }
    }
    (count > 0.0).then(|| ((sum / count).sqrt(), most))
}

#[derive(Default)]
pub struct Tally {
    pub asked: usize,
    pub worth: Vec<(u64, Worth)>,
    pub missed: Vec<(u64, NotFound)>,
}

impl Tally {
    pub fn take(&mut self, seed: u64, answer: Result<Worth, NotFound>) {
        self.asked += 1;
        match answer {
            Ok(worth) => self.worth.push((seed, worth)),
            Err(why) => self.missed.push((seed, why)),
        }
    }

    pub fn found(&self) -> f64 {
        self.worth.len() as f64 / self.asked as f64
    }

    fn rms_px(w: &Worth) -> f64 {
        (w.sum_px2 / (2.0 * w.nodes as f64)).sqrt()
    }

    pub fn sds(&self) -> f64 {
        let (sum, count) = (self.worth.iter()).fold((0.0, 0.0), |(s, n), (_, w)| {
            (s + w.chi2, n + 2.0 * w.nodes as f64)
        });
        (sum / count).sqrt()
    }

    pub fn within_mm(&self, limit: f64) -> f64 {
        let n = self
            .worth
            .iter()
            .filter(|(_, w)| w.object_max_mm <= limit)
            .count();
        n as f64 / self.worth.len() as f64
    }
}

impl fmt::Display for Tally {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let sorted = |of: fn(&Worth) -> f64| {
            let mut v: Vec<f64> = self.worth.iter().map(|w| of(&w.1)).collect();
            v.sort_by(f64::total_cmp);
            let at = |s: f64| {
                v.get((s * (v.len() as f64 - 1.0)) as usize)
                    .copied()
                    .unwrap_or(f64::NAN)
            };
            (at(0.5), at(1.0))
        };
        let (px, worst_px) = sorted(Tally::rms_px);
        let (mm, _) = sorted(|w| w.object_rms_mm);
        let (ratio, most) = sorted(|w| w.ratio);
        let unusual = self.worth.iter().filter(|w| w.1.unusual).count();
        let (_, worst_mm) = sorted(|w| w.object_max_mm);
        let nodes: usize = self.worth.iter().map(|w| w.1.nodes).sum();
        write!(
            f,
            "found {:3.0} %; {px:.4} {worst_px:.4} px, {:.2} sd; {mm:.4} {worst_mm:.3} mm, {:.0} %; {:.1} nodes; residuals {ratio:.2} {most:.2}, {unusual} unusual",
            100.0 * self.found(),
            self.sds(),
            100.0 * self.within_mm(0.1),
            nodes as f64 / self.worth.len().max(1) as f64,
        )?;
        if std::env::var("LIGHT_WORST").is_ok() {
            for (seed, w) in &self.worth {
                let sds = (w.chi2 / (2.0 * w.nodes as f64)).sqrt();
                if sds > 1.5 || w.object_max_mm > 0.1 {
                    write!(
                        f,
                        "\n    {seed}: {:.4} px {sds:.2} sd {:.3} mm {} nodes",
                        Tally::rms_px(w),
                        w.object_max_mm,
                        w.nodes
                    )?;
                }
            }
        }
        for (seed, why) in &self.missed {
            write!(
                f,
                "\n    {seed}: {}",
                why.to_string().chars().take(90).collect::<String>()
            )?;
        }
        Ok(())
    }
}
