//! Pictures of chessboards as people take them: partly covered, blurred, with glare, strongly tilted, in poor light, through
//! JPEG, with a laser line, before a room full of edges; with every node's true place and whether a person would see it.
//!
//! Shares nothing with the detector: places come from the camera's own lens, inverted by fixed point.

use hydroline_calib::charuco::Markers;
use hydroline_rigs::{Board, BoardPattern, Dictionary};
use nalgebra::{Matrix3, Rotation3, Unit, Vector3};
use rand::{RngExt, SeedableRng, rngs::StdRng};
use rand_distr::{Distribution, Normal};

use super::jpeg;

/// What makes a picture difficult; taken in turn by the seed.
pub const DIFFICULTIES: [&str; 15] = [
    "plain",
    "covered",
    "defocused",
    "moved",
    "glare",
    "tilted",
    "low contrast",
    "uneven light",
    "shadow",
    "line",
    "dark with line",
    "jpeg",
    "5 MP",
    "cut",
    "several",
];

/// Columns and rows of nodes, pitch \[m\].
const BOARDS: [(u32, u32, f64); 5] = [
    (7, 10, 0.025),
    (9, 6, 0.030),
    (8, 6, 0.030),
    (11, 8, 0.015),
    (6, 4, 0.040),
];

/// A picture with its truth.
pub struct Picture {
    pub difficulty: &'static str,
    pub size: [usize; 2],
    pub pixels: Vec<u8>,
    pub board: Board,
    /// Place of node (i, j) at j * columns + i, and whether a person sees it.
    pub nodes: Vec<([f64; 2], bool)>,
}

/// Share of a board's corners, and their number, from which a person would call it a picture of that board.
const SEEN_SHARE: f64 = 1.0 / 3.0;
const SEEN_CORNERS: usize = 12;

impl Picture {
    /// Corners that a person sees.
    pub fn seen(&self) -> usize {
        self.nodes.iter().filter(|n| n.1).count()
    }

    /// Whether a person would call it a picture of the board.
    pub fn is_of_board(&self) -> bool {
        let seen = self.seen();
        seen as f64 >= SEEN_SHARE * self.nodes.len() as f64 && seen >= SEEN_CORNERS
    }

    /// Beginning of a report's line: seed, difficulty, sizes, corners seen and time taken.
    pub fn head_line(&self, seed: u64, took: std::time::Duration) -> String {
        let [w, h] = self.size;
        let [columns, rows] = [self.board.columns, self.board.rows];
        format!(
            "{seed:4} {:14} {w}x{h} {columns}x{rows} {:3} seen, {:5.0} ms",
            self.difficulty,
            self.seen(),
            1e3 * took.as_secs_f64()
        )
    }
}

/// What is done to a picture.
#[derive(Default, Clone)]
struct Effects {
    /// Middle, half axes \[px\], turn \[rad\], grey: a hand or a cable over the board.
    covers: Vec<[f64; 6]>,
    /// Middle, half axes \[px\], turn \[rad\], light added in its middle.
    glare: Option<[f64; 6]>,
    /// Line in the board's plane: offset from the middle \[m\], direction \[rad\], σ \[m\], light added on white.
    line: Option<[f64; 4]>,
    /// Place, direction \[rad\], width of the edge \[px\], light behind it.
    shadow: Option<[f64; 5]>,
    /// Light grows by this factor along this direction \[rad\] over the picture.
    uneven: Option<[f64; 2]>,
    /// Length \[px\] and direction \[rad\].
    motion: Option<[f64; 2]>,
    blur_px: f64,
    noise: f64,
    exposure: f64,
    quality: Option<f64>,
}

#[derive(Clone)]
struct Shot {
    size: [usize; 2],
    focal_px: f64,
    centre_px: [f64; 2],
    k: [f64; 2],
    rotation: Matrix3<f64>,
    middle_m: Vector3<f64>,
    board: Board,
    /// Face, mark.
    greys: [f64; 2],
    /// White beyond the outer squares \[m\].
    white_m: f64,
}

impl Shot {
    fn undistort(&self, c: f64, r: f64) -> [f64; 2] {
        let x = (c - self.centre_px[0]) / self.focal_px;
        let y = (r - self.centre_px[1]) / self.focal_px;
        let seen = x.hypot(y);
        let mut rho = seen;
        for _ in 0..30 {
            rho = seen / (1.0 + rho * rho * (self.k[0] + self.k[1] * rho * rho));
        }
        let s = if seen > 0.0 { rho / seen } else { 1.0 };
        [x * s, y * s]
    }

    fn project(&self, at: [f64; 2]) -> [f64; 2] {
        let p = self.rotation * Vector3::new(at[0], at[1], 0.0) + self.middle_m;
        let (x, y) = (p[0] / p[2], p[1] / p[2]);
        let r2 = x * x + y * y;
        let s = 1.0 + r2 * (self.k[0] + self.k[1] * r2);
        [
            self.centre_px[0] + self.focal_px * x * s,
            self.centre_px[1] + self.focal_px * y * s,
        ]
    }

    /// Place of node (i, j) from the board's middle \[m\].
    fn node(&self, i: u32, j: u32) -> [f64; 2] {
        let b = &self.board;
        [
            (f64::from(i) - 0.5 * (f64::from(b.columns) - 1.0)) * b.pitch_m,
            (f64::from(j) - 0.5 * (f64::from(b.rows) - 1.0)) * b.pitch_m,
        ]
    }

    /// Place on the board's plane that a ray meets.
    fn meet(&self, x: f64, y: f64) -> Option<[f64; 2]> {
        let ray = Vector3::new(x, y, 1.0);
        let normal: Vector3<f64> = self.rotation.column(2).into();
        let far = normal.dot(&self.middle_m) / normal.dot(&ray);
        let at = self.rotation.tr_mul(&(ray * far - self.middle_m));
        (far > 0.0).then_some([at[0], at[1]])
    }

    /// Size of a pixel on the board along ξ and η \[m\], from three of its corners' rays.
    fn size_m(&self, corners: [[f64; 2]; 3]) -> [f64; 2] {
        let [a, b, c] = corners.map(|ray| self.meet(ray[0], ray[1]));
        match (a, b, c) {
            (Some(a), Some(b), Some(c)) => {
                [0, 1].map(|k| (b[k] - a[k]).abs() + (c[k] - a[k]).abs())
            }
            _ => [0.0; 2],
        }
    }

    /// Mean reflectance of a place so large \[m\]; `None` beside the board. Without its size an edge that runs along the
    /// pixels' rows would lie at the nearest quarter of a pixel.
    fn grey(&self, at: [f64; 2], size_m: [f64; 2]) -> Option<f64> {
        let b = &self.board;
        let half = [b.columns, b.rows].map(|n| 0.5 * (f64::from(n) + 1.0) * b.pitch_m);
        if (0..2).any(|a| at[a].abs() > half[a] + self.white_m) {
            return None;
        }
        if (0..2).any(|a| at[a].abs() > half[a]) {
            return Some(self.greys[0]);
        }
        // From −1 to 1 across every rim.
        let sides = [(0, b.columns), (1, b.rows)].map(|(k, n)| {
            let u = at[k] / b.pitch_m + 0.5 * (f64::from(n) - 1.0);
            let even = u.floor() as i64 % 2 == 0;
            let off_m = (u - u.round()) * b.pitch_m;
            let rises = if (u.round() as i64) % 2 == 0 {
                1.0
            } else {
                -1.0
            };
            match size_m[k] {
                0.0 => {
                    if even {
                        1.0
                    } else {
                        -1.0
                    }
                }
                size => (2.0 * off_m / size).clamp(-1.0, 1.0) * rises,
            }
        });
        let mut dark = 0.5 + 0.5 * sides[0] * sides[1];
        if let Some(markers) = Markers::of(b) {
            // The square at the upper left is dark.
            if !(b.columns + b.rows).is_multiple_of(2) {
                dark = 1.0 - dark;
            }
            let k = [(0, b.columns), (1, b.rows)]
                .map(|(k, n)| at[k] / b.pitch_m + 0.5 * (f64::from(n) - 1.0));
            let square = k.map(|v| v.floor() as i32);
            if markers.light(square, k.map(|v| v - v.floor())) == Some(false) {
                dark = 1.0;
            }
        }
        Some(self.greys[0] + dark * (self.greys[1] - self.greys[0]))
    }
}

/// Picture number `seed` of a chessboard.
pub fn picture(seed: u64) -> Picture {
    picture_of(seed, BoardPattern::Chessboard)
}

/// Picture number `seed` of a ChArUco board.
pub fn charuco_picture(seed: u64) -> Picture {
    const DICTIONARIES: [&str; 6] = [
        "DICT_4X4_50",
        "DICT_4X4_100",
        "DICT_4X4_250",
        "DICT_5X5_100",
        "DICT_6X6_250",
        "DICT_5X5_50",
    ];
    let name = DICTIONARIES[(seed / 15 % 6) as usize];
    let (_, dictionary) = *Dictionary::ALL.iter().find(|d| d.0 == name).unwrap();
    // A share of the pitch until the board is known.
    let marker_m = [0.6, 0.72, 0.75, 0.8][(seed / 7 % 4) as usize];
    picture_of(
        seed,
        BoardPattern::Charuco {
            dictionary,
            marker_m,
        },
    )
}

fn picture_of(seed: u64, pattern: BoardPattern) -> Picture {
    let difficulty = DIFFICULTIES[(seed % DIFFICULTIES.len() as u64) as usize];
    let mut rng = StdRng::seed_from_u64(seed ^ 0xb0a4d);
    let mut any = |low: f64, high: f64| rng.random_range(low..high);
    let size = match (difficulty, any(0.0, 1.0)) {
        ("5 MP", _) => [2448, 2048],
        (_, p) if p < 0.4 => [720, 576],
        (_, p) if p < 0.7 => [640, 480],
        _ => [1280, 960],
    };
    let (columns, rows, pitch_m) = BOARDS[any(0.0, BOARDS.len() as f64) as usize];
    let pattern = match pattern {
        BoardPattern::Charuco {
            dictionary,
            marker_m,
        } => BoardPattern::Charuco {
            dictionary,
            marker_m: marker_m * pitch_m,
        },
        other => other,
    };
    let board = Board {
        name: "hand".to_owned(),
        pattern,
        columns,
        rows,
        pitch_m,
        margin_m: pitch_m,
        thickness_m: 0.004,
        blocks: Vec::new(),
    };
    let width = size[0] as f64;
    let angle = match difficulty {
        "tilted" => any(0.87, 1.13),
        _ => any(0.0, 0.75),
    };
    let azimuth = any(0.0, std::f64::consts::TAU);
    let axis = Unit::new_normalize(Vector3::new(azimuth.cos(), azimuth.sin(), 0.0));
    let roll = Rotation3::from_axis_angle(&Vector3::z_axis(), any(-3.1, 3.1));
    let facing = Matrix3::from_diagonal(&Vector3::new(-1.0, -1.0, 1.0));
    let rotation = Rotation3::from_axis_angle(&axis, angle).matrix() * roll.matrix() * facing;
    let focal_px = any(0.9, 1.6) * width;
    // The longer side of the squares fills this share of the picture's height.
    let share = match difficulty {
        "cut" => any(0.9, 1.4),
        _ => any(0.45, 0.85),
    };
    let long_m = f64::from(columns.max(rows) + 1) * pitch_m;
    let z = focal_px * long_m / (share * size[1] as f64);
    let off = if difficulty == "cut" { 0.3 } else { 0.08 };
    let shift = [any(-off, off) * width, any(-off, off) * size[1] as f64];
    let shot = Shot {
        size,
        focal_px,
        centre_px: [0, 1].map(|a| 0.5 * (size[a] as f64 - 1.0)),
        k: [any(-0.25, 0.08), any(-0.02, 0.06)],
        rotation,
        middle_m: Vector3::new(shift[0] / focal_px * z, shift[1] / focal_px * z, z),
        board,
        greys: [any(150.0, 215.0), any(12.0, 45.0)],
        white_m: any(0.2, 1.2) * pitch_m,
    };
    let effects = effects(difficulty, &shot, &mut any);
    let image = render(&shot, &effects, seed);
    let pixels = expose(image, &shot, &effects, seed);
    // Whether a person sees a corner is asked of its squares, without what is printed in them.
    let squares = match shot.board.pattern {
        BoardPattern::Charuco { .. } => {
            let mut plain = shot.clone();
            plain.board.pattern = BoardPattern::Chessboard;
            expose(render(&plain, &effects, seed), &plain, &effects, seed)
        }
        _ => pixels.clone(),
    };
    let nodes = (0..rows)
        .flat_map(|j| (0..columns).map(move |i| (i, j)))
        .map(|(i, j)| {
            let p = shot.project(shot.node(i, j));
            (p, visible(&shot, &effects, shot.node(i, j), p, &squares))
        })
        .collect();
    Picture {
        difficulty,
        size,
        pixels,
        board: shot.board,
        nodes,
    }
}

fn effects(difficulty: &str, shot: &Shot, any: &mut impl FnMut(f64, f64) -> f64) -> Effects {
    let scale = shot.size[0] as f64 / 720.0;
    let mut e = Effects {
        blur_px: any(0.4, 0.8) * scale.sqrt(),
        noise: any(0.7, 2.5),
        exposure: any(0.8, 1.05),
        ..Effects::default()
    };
    let half = [shot.board.columns, shot.board.rows]
        .map(|n| 0.5 * (f64::from(n) - 1.0) * shot.board.pitch_m);
    let on = |a: f64, b: f64| shot.project([a * half[0], b * half[1]]);
    let pitch_px = {
        let (a, b) = (on(0.0, 0.0), shot.project([shot.board.pitch_m, 0.0]));
        (a[0] - b[0]).hypot(a[1] - b[1])
    };
    let list: Vec<&str> = if difficulty == "several" {
        let all = &super::hard::DIFFICULTIES[1..12];
        let n = all.len() as f64;
        let (a, b) = (any(0.0, n) as usize, any(0.0, n) as usize);
        vec![all[a], all[b]]
    } else {
        vec![difficulty]
    };
    for what in list {
        match what {
            "covered" => {
                // A thumb at an edge, or a hand over a corner.
                for _ in 0..any(1.0, 3.0) as usize {
                    let side = any(0.0, 4.0) as usize;
                    let t = any(-1.0, 1.0);
                    let [a, b] = [[t, -1.0], [t, 1.0], [-1.0, t], [1.0, t]][side];
                    let p = on(a, b);
                    let size = any(0.8, 2.2) * pitch_px;
                    let long = any(1.0, 1.8);
                    e.covers.push([
                        p[0],
                        p[1],
                        size * long,
                        size,
                        any(0.0, 3.1),
                        any(60.0, 170.0),
                    ]);
                }
            }
            // What a person still calls a usable picture: a square is six sds wide.
            "defocused" => e.blur_px = (any(1.2, 2.6) * scale).min(pitch_px / 6.0),
            "moved" => {
                e.motion = Some([(any(2.0, 6.0) * scale).min(pitch_px / 3.0), any(0.0, 3.1)]);
            }
            "glare" => {
                let p = on(any(-0.8, 0.8), any(-0.8, 0.8));
                let s = any(1.0, 2.2) * pitch_px;
                e.glare = Some([
                    p[0],
                    p[1],
                    s * any(0.6, 1.6),
                    s,
                    any(0.0, 3.1),
                    any(250.0, 600.0),
                ]);
            }
            "low contrast" => {}
            "uneven light" => e.uneven = Some([any(4.0, 9.0), any(0.0, std::f64::consts::TAU)]),
            "shadow" => {
                let p = on(any(-0.5, 0.5), any(-0.5, 0.5));
                e.shadow = Some([
                    p[0],
                    p[1],
                    any(0.0, std::f64::consts::TAU),
                    any(1.0, 12.0),
                    any(0.2, 0.5),
                ]);
            }
            "line" | "dark with line" => {
                let pitch = shot.board.pitch_m;
                e.line = Some([
                    any(-0.6, 0.6) * half[0].min(half[1]),
                    any(0.0, 3.1),
                    any(0.02, 0.07) * pitch,
                    any(100.0, 800.0),
                ]);
                if what == "dark with line" {
                    e.exposure = any(0.12, 0.25);
                    e.noise = any(0.7, 1.5);
                    e.line = e.line.map(|l| [l[0], l[1], l[2], any(600.0, 1500.0)]);
                }
            }
            "jpeg" => e.quality = Some(any(25.0, 75.0)),
            _ => {}
        }
        if what == "low contrast" {
            e.exposure = -any(0.12, 0.25);
        }
    }
    e
}

/// Distance from a turned ellipse's middle in its half axes.
fn within([x, y, a, b, turn, _]: [f64; 6], p: [f64; 2]) -> f64 {
    let (s, c) = turn.sin_cos();
    let (dx, dy) = (p[0] - x, p[1] - y);
    ((c * dx + s * dy) / a).hypot((c * dy - s * dx) / b)
}

/// Things of a room: rectangles with grey, turned alike.
fn room(seed: u64, size: [usize; 2]) -> impl Fn(f64, f64) -> f64 {
    let mut rng = StdRng::seed_from_u64(seed ^ 0x400e);
    let mut any = |low: f64, high: f64| rng.random_range(low..high);
    let (w, h) = (size[0] as f64, size[1] as f64);
    let turn = any(-0.4, 0.4);
    let base = any(40.0, 150.0);
    let count = any(5.0, 60.0) as usize;
    let things: Vec<[f64; 6]> = (0..count)
        .map(|_| {
            let s = any(0.01, 0.2) * w;
            [
                any(0.0, w),
                any(0.0, h),
                s,
                s * any(0.1, 1.5),
                turn,
                any(10.0, 220.0),
            ]
        })
        .collect();
    let (period, depth) = (any(5.0, 40.0), any(0.0, 25.0));
    move |x: f64, y: f64| {
        let (s, c) = turn.sin_cos();
        let grain = depth * ((c * x + s * y) / period + 2.0 * (y / 90.0).sin()).sin();
        things
            .iter()
            .rev()
            .find(|t| {
                let (dx, dy) = (x - t[0], y - t[1]);
                (c * dx + s * dy).abs() < t[2] && (c * dy - s * dx).abs() < t[3]
            })
            .map_or(base + grain, |t| t[5])
    }
}

/// Samples along a pixel's side.
const SUB: usize = 4;

fn render(shot: &Shot, e: &Effects, seed: u64) -> Vec<f64> {
    let [w, h] = shot.size;
    let behind = room(seed, shot.size);
    // Rays of the pixels' corners; between them they are straight to 1e-4 px.
    let rays: Vec<[f64; 2]> = (0..(w + 1) * (h + 1))
        .map(|n| shot.undistort((n % (w + 1)) as f64 - 0.5, (n / (w + 1)) as f64 - 0.5))
        .collect();
    let mut image = vec![0.0; w * h];
    for r in 0..h {
        for c in 0..w {
            let corner = |x: usize, y: usize| rays[(r + y) * (w + 1) + c + x];
            let [a, b, d, f] = [corner(0, 0), corner(1, 0), corner(0, 1), corner(1, 1)];
            let (mut sum, mut beside) = (0.0, None);
            let size_m = shot.size_m([a, b, d]);
            for k in 0..SUB * SUB {
                let [s, t] = [k % SUB, k / SUB].map(|k| (k as f64 + 0.5) / SUB as f64);
                let ray = [0, 1].map(|k| {
                    (a[k] * (1.0 - s) + b[k] * s) * (1.0 - t) + (d[k] * (1.0 - s) + f[k] * s) * t
                });
                let at = shot.meet(ray[0], ray[1]);
                let mut grey = at
                    .and_then(|at| shot.grey(at, size_m.map(|m| m / SUB as f64)))
                    .unwrap_or_else(|| *beside.get_or_insert_with(|| behind(c as f64, r as f64)));
                if let (Some([off, turn, sigma, peak]), Some(at)) = (e.line, at) {
                    let d = (turn.cos() * at[0] + turn.sin() * at[1] - off) / sigma;
                    if d.abs() < 6.0 {
                        grey += peak * grey / 200.0 * (-0.5 * d * d).exp();
                    }
                }
                sum += grey;
            }
            let p = [c as f64, r as f64];
            let mut light = sum / (SUB * SUB) as f64;
            if let Some([x, y, turn, wide, behind]) = e.shadow {
                let d = (turn.cos() * (p[0] - x) + turn.sin() * (p[1] - y)) / wide;
                light *= behind + (1.0 - behind) / (1.0 + (-d).exp());
            }
            if let Some([factor, turn]) = e.uneven {
                let t = (turn.cos() * (p[0] / w as f64 - 0.5)
                    + turn.sin() * (p[1] / h as f64 - 0.5))
                    / 1.2;
                light *= factor.powf(t - 0.4);
            }
            if let Some(g) = e.glare {
                light += g[5] * (-within(g, p).powi(2) * 2.0).exp();
            }
            for cover in &e.covers {
                let d = within(*cover, p);
                if d < 1.0 {
                    // Rounder where it curves away.
                    light = cover[5] * (0.5 + 0.5 * (1.0 - d * d).sqrt());
                }
            }
            image[r * w + c] = light;
        }
    }
    image
}

fn expose(mut image: Vec<f64>, shot: &Shot, e: &Effects, seed: u64) -> Vec<u8> {
    let [w, h] = shot.size;
    if let Some([length, turn]) = e.motion {
        let steps = (2.0 * length).ceil() as i64 + 1;
        let from = image.clone();
        let at = |x: f64, y: f64| {
            let (x, y) = (
                x.clamp(0.0, w as f64 - 1.001),
                y.clamp(0.0, h as f64 - 1.001),
            );
            let (c, r) = (x as usize, y as usize);
            let (s, t) = (x - c as f64, y - r as f64);
            (from[r * w + c] * (1.0 - s) + from[r * w + c + 1] * s) * (1.0 - t)
                + (from[(r + 1) * w + c] * (1.0 - s) + from[(r + 1) * w + c + 1] * s) * t
        };
        for (n, v) in image.iter_mut().enumerate() {
            *v = (0..steps)
                .map(|k| {
                    let d = (k as f64 / (steps - 1) as f64 - 0.5) * length;
                    at(
                        (n % w) as f64 + d * turn.cos(),
                        (n / w) as f64 + d * turn.sin(),
                    )
                })
                .sum::<f64>()
                / steps as f64;
        }
    }
    let image = super::gauss(image, w, h, e.blur_px);
    let mut rng = StdRng::seed_from_u64(seed ^ 0x4015e);
    let noise = Normal::new(0.0, e.noise).unwrap();
    let mut pixels: Vec<u8> = image
        .iter()
        .map(|v| {
            // Low contrast: light from everywhere over little of the board's own.
            let lit = if e.exposure < 0.0 {
                90.0 - e.exposure * v
            } else {
                e.exposure * v
            };
            (lit + noise.sample(&mut rng)).round().clamp(0.0, 255.0) as u8
        })
        .collect();
    if let Some(quality) = e.quality {
        jpeg::through(&mut pixels, w, h, quality);
    }
    pixels
}

/// Whether a person sees the node: inside, not covered, not washed out: of the four squares around it light and dark differ.
fn visible(shot: &Shot, e: &Effects, at: [f64; 2], p: [f64; 2], pixels: &[u8]) -> bool {
    let [w, h] = shot.size;
    let around: Vec<[f64; 2]> = [[1.0, 1.0], [-1.0, -1.0], [1.0, -1.0], [-1.0, 1.0]]
        .iter()
        .map(|d| {
            let q = 0.25 * shot.board.pitch_m;
            shot.project([at[0] + d[0] * q, at[1] + d[1] * q])
        })
        .collect();
    let inside =
        |p: &[f64; 2]| p[0] > 3.0 && p[1] > 3.0 && p[0] < w as f64 - 4.0 && p[1] < h as f64 - 4.0;
    if !inside(&p) || !around.iter().all(inside) {
        return false;
    }
    if e.covers
        .iter()
        .any(|c| around.iter().any(|q| within(*c, *q) < 1.05) || within(*c, p) < 1.1)
    {
        return false;
    }
    let level = |q: &[f64; 2]| {
        let (c, r) = (q[0].round() as usize, q[1].round() as usize);
        (r - 1..=r + 1)
            .flat_map(|r| (c - 1..=c + 1).map(move |c| (c, r)))
            .map(|(c, r)| f64::from(pixels[r * w + c]))
            .sum::<f64>()
            / 9.0
    };
    let levels: Vec<f64> = around.iter().map(level).collect();
    let (a, b) = ([levels[0], levels[1]], [levels[2], levels[3]]);
    let min = |v: [f64; 2]| v[0].min(v[1]);
    let max = |v: [f64; 2]| v[0].max(v[1]);
    let gap = (min(a) - max(b)).max(min(b) - max(a));
    gap > (3.0 * e.noise).max(5.0)
}
