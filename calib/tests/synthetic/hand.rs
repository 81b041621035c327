//! Sessions with a board in the hand and a laser line across it, rendered.
//!
//! Shares nothing with the fitter: the lens is inverted by fixed point, the port is Snell's law for angles, and every
//! subsample is a ray that is followed to the board and lit by a sheet of Gaussian thickness.

use hydroline_rigs::{Board, BoardPattern};
use nalgebra::{Matrix3, Rotation3, Vector3};
use rand::{RngExt, SeedableRng, rngs::StdRng};

use super::{Scene, Tone, finish};

/// A true camera.
#[derive(Debug, Clone, Copy)]
pub struct Camera {
    pub size: [usize; 2],
    pub focal_px: f64,
    pub centre_px: [f64; 2],
    pub k: [f64; 2],
    /// Pupil to glass, thickness \[m\], index; `None` = no port.
    pub port: Option<[f64; 3]>,
    pub n_medium: f64,
}

impl Camera {
    /// Start and unit direction beyond the port.
    pub fn ray(&self, column: f64, row: f64) -> (Vector3<f64>, Vector3<f64>) {
        let x = (column - self.centre_px[0]) / self.focal_px;
        let y = (row - self.centre_px[1]) / self.focal_px;
        let seen = x.hypot(y);
        let mut r = seen;
        for _ in 0..40 {
            r = seen / (1.0 + r * r * (self.k[0] + self.k[1] * r * r));
        }
        let (ux, uy) = if seen > 0.0 {
            (x / seen, y / seen)
        } else {
            (0.0, 0.0)
        };
        let Some([distance, glass, index]) = self.port else {
            return (
                Vector3::zeros(),
                Vector3::new(r * ux, r * uy, 1.0).normalize(),
            );
        };
        let sin = r.atan().sin();
        let (in_glass, beyond) = (
            (sin / index).asin().tan(),
            (sin / self.n_medium).asin().tan(),
        );
        let radius = distance * r + glass * in_glass;
        (
            Vector3::new(radius * ux, radius * uy, distance + glass),
            Vector3::new(beyond * ux, beyond * uy, 1.0).normalize(),
        )
    }
}

/// Laser sheet n·X = c in the camera's frame, its Gaussian thickness \[m\] and brightness on white \[grey levels\].
#[derive(Debug, Clone, Copy)]
pub struct Laser {
    pub normal: Vector3<f64>,
    pub offset_m: f64,
    pub sigma_m: f64,
    pub peak: f64,
}

impl Laser {
    pub fn distance_m(&self, p: &Vector3<f64>) -> f64 {
        self.normal.dot(p) - self.offset_m
    }
}

/// A board's pose: board (ξ, η from its middle) to camera.
#[derive(Debug, Clone, Copy)]
pub struct Held {
    pub rotation: Matrix3<f64>,
    pub middle_m: Vector3<f64>,
}

/// A session: camera, laser and boards.
#[derive(Debug, Clone)]
pub struct Session {
    pub camera: Camera,
    pub laser: Laser,
    pub board: Board,
    pub poses: Vec<Held>,
    pub scene: Scene,
    rays: Vec<(Vector3<f64>, Vector3<f64>)>,
}

const SUB: usize = 3;

impl Session {
    pub fn new(camera: Camera, laser: Laser, board: Board, poses: Vec<Held>, scene: Scene) -> Self {
        let [w, h] = camera.size;
        let mut rays = Vec::with_capacity(w * h * SUB * SUB);
        let sub = |k: usize| (k as f64 + 0.5) / SUB as f64 - 0.5;
        for r in 0..h {
            for c in 0..w {
                for y in 0..SUB {
                    for x in 0..SUB {
                        rays.push(camera.ray(c as f64 + sub(x), r as f64 + sub(y)));
                    }
                }
            }
        }
        Session {
            camera,
            laser,
            board,
            poses,
            scene,
            rays,
        }
    }

    /// A random session of `boards` chessboards, in air, or in water behind a port.
    pub fn random(seed: u64, boards: usize, wet: bool) -> Self {
        let mut rng = StdRng::seed_from_u64(seed ^ 0xf7ee);
        let mut any = |low: f64, high: f64| rng.random_range(low..high);
        let camera = Camera {
            size: [720, 576],
            focal_px: any(650.0, 900.0),
            centre_px: [359.5 + any(-8.0, 8.0), 287.5 + any(-8.0, 8.0)],
            k: [any(-0.25, 0.05), any(-0.03, 0.08)],
            port: wet.then(|| [any(0.02, 0.04), 0.010, 1.49]),
            n_medium: if wet { 1.335 } else { 1.0003 },
        };
        // The sheet cuts the axis at 0.5 to 0.7 m, 35 to 55° off it, as the paper's does.
        let far = any(0.5, 0.7);
        let tilt = any(0.6, 0.95);
        let normal = Rotation3::from_axis_angle(&Vector3::y_axis(), any(-0.1, 0.1))
            * Vector3::new(0.0, tilt.sin(), tilt.cos());
        let laser = Laser {
            normal,
            offset_m: normal[2] * far,
            sigma_m: any(0.5e-3, 1.0e-3),
            peak: any(90.0, 160.0),
        };
        let board = Board {
            name: "hand".to_owned(),
            pattern: BoardPattern::Chessboard,
            columns: 8,
            rows: 6,
            pitch_m: 0.030,
            margin_m: 0.030,
            thickness_m: 0.004,
            blocks: Vec::new(),
        };
        let n = if wet { 1.335 } else { 1.0 };
        let half = [360.0, 288.0].map(|px| px / (n * camera.focal_px));
        let mut poses = Vec::new();
        while poses.len() < boards {
            // The middle of the board on a place of the sheet that is well inside of the image.
            let (u, v) = (any(-0.55, 0.55) * half[0], any(-0.6, 0.6) * half[1]);
            let along = Vector3::new(u, v, 1.0);
            let z = laser.offset_m / laser.normal.dot(&along);
            if !(0.3..1.1).contains(&z) {
                continue;
            }
            let (angle, azimuth) = (any(0.1, 0.75), any(0.0, std::f64::consts::TAU));
            let axis =
                nalgebra::Unit::new_normalize(Vector3::new(azimuth.cos(), azimuth.sin(), 0.0));
            let roll = Rotation3::from_axis_angle(&Vector3::z_axis(), any(-0.5, 0.5));
            // ξ to the image's left, η up.
            let facing = Matrix3::from_diagonal(&Vector3::new(-1.0, -1.0, 1.0));
            let rotation =
                Rotation3::from_axis_angle(&axis, angle).matrix() * roll.matrix() * facing;
            let shift = rotation * Vector3::new(any(-0.05, 0.05), any(-0.04, 0.04), 0.0);
            poses.push(Held {
                rotation,
                middle_m: along * z + shift,
            });
        }
        let scene = Scene {
            size: camera.size,
            key: false,
            greys: [any(110.0, 170.0), any(12.0, 35.0), any(30.0, 90.0)],
            light: [any(0.7, 1.1), any(0.7, 1.1), any(0.8, 1.0), any(0.8, 1.0)],
            blur_px: any(0.5, 1.1),
            noise: any(1.0, 3.0),
            tone: Tone {
                gamma: any(0.8, 1.1),
                ..Tone::LINEAR
            },
            seed,
            ..Scene::default()
        };
        Session::new(camera, laser, board, poses, scene)
    }

    /// Image `k`.
    pub fn image(&self, k: usize) -> Vec<u8> {
        let [w, h] = self.camera.size;
        let pose = &self.poses[k];
        let normal: Vector3<f64> = pose.rotation.column(2).into();
        let half = hydroline_calib::board::half_size_m(&self.board);
        let b = &self.board;
        let grey = |(from, along): &(Vector3<f64>, Vector3<f64>)| {
            let far = normal.dot(&(pose.middle_m - from)) / normal.dot(along);
            let point = from + along * far;
            let at = pose.rotation.tr_mul(&(point - pose.middle_m));
            let on = far > 0.0 && at[0].abs() < half[0] && at[1].abs() < half[1];
            // Behind the board is a wall at 2 m, which the line crosses too.
            let (albedo, point) = if on {
                let u = at[0] / b.pitch_m + 0.5 * (f64::from(b.columns) - 1.0);
                let v = at[1] / b.pitch_m + 0.5 * (f64::from(b.rows) - 1.0);
                let dark = (u.floor() as i64 + v.floor() as i64).rem_euclid(2) == 0;
                (
                    if dark {
                        self.scene.greys[1]
                    } else {
                        self.scene.greys[0]
                    },
                    point,
                )
            } else {
                (self.scene.greys[2], from + along * (2.0 / along[2]))
            };
            let off = self.laser.distance_m(&point) / self.laser.sigma_m;
            let lit = if off.abs() < 5.0 {
                (-0.5 * off * off).exp()
            } else {
                0.0
            };
            albedo + self.laser.peak * albedo / self.scene.greys[0] * lit
        };
        let n = SUB * SUB;
        let image =
            (self.rays.chunks_exact(n)).map(|some| some.iter().map(grey).sum::<f64>() / n as f64);
        let scene = Scene {
            seed: self.scene.seed * 1000 + k as u64,
            size: [w, h],
            ..self.scene.clone()
        };
        finish(image.collect(), &scene)
    }
}
