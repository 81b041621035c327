//! A calibration board standing in (or beside) the laser sheet.
//!
//! The board is given in the laser plane (xi to port, eta up, zeta forward), so it does not
//! depend on the vehicle's pose. Its face looks at the camera (-zeta). It is lit by room
//! light and by the sheet, which grazes it: the Gaussian of each point's distance from the
//! sheet. Raised gauge blocks are boxes; their side towards the laser shows the line where
//! the sheet crosses it, and they shadow the face behind them.

use super::lens::Lens;
use super::renderer::{GreyPixels, gauss, is_edge, lattice};
use super::sheet::Code;
use super::{Renderer, SceneError, psf};
use crate::effect::Optics;
use hydroline_rigs::{Board, BoardPattern};
use nalgebra::{Matrix3, Rotation3, Vector3};
use rayon::prelude::*;

/// Reflectances of pattern and ground.
const WHITE: f64 = 1.0;
const BLACK: f64 = 0.1;
/// Reflectance of the plate's rim and the blocks.
const METAL: f64 = 0.7;

/// Where a board stands.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct BoardPlacement {
    /// Middle of its node grid: xi, eta \[m\].
    pub centre_m: [f64; 2],
    /// Face beyond the sheet (forward), at the middle \[m\].
    pub offset_m: f64,
    /// Turned in its own plane, xi towards eta \[rad\].
    pub rotation_rad: f64,
    /// Tilted about its xi axis: the top leans forward \[rad\].
    pub tilt_xi_rad: f64,
    /// Tilted about its eta axis: the port side leans forward \[rad\].
    pub tilt_eta_rad: f64,
}

/// Light on a board besides the sheet.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BoardLight {
    /// Grey level of white under the room's light, in the board's middle.
    pub room: f64,
    /// Relative change of the room's light per metre along the board's xi and eta \[1/m\].
    pub slope_per_m: [f64; 2],
    /// Whether the laser is on.
    pub laser: bool,
    /// Share of the sheet's light that the face sends to the camera, against a surface that faces the laser: the
    /// sheet grazes the face, so only its roughness is lit. 1 = as bright as the blocks' lit sides.
    pub grazing: f64,
}

/// The light of a board after the point spread, before noise; made by and for one renderer.
#[derive(Debug, Clone, PartialEq)]
pub struct BoardPicture {
    /// Grey levels, column after column.
    light: Vec<f32>,
    /// Values per column: image height and the point spread's surroundings.
    rows: usize,
    margin: usize,
}

/// Axis-aligned box in the board's own frame (xi, eta, up from the face).
#[derive(Debug, Clone, Copy)]
struct Cuboid {
    low: Vector3<f64>,
    high: Vector3<f64>,
}

impl Cuboid {
    /// Entry parameter and outward normal of a ray from outside.
    fn entry(
        &self,
        origin: &Vector3<f64>,
        direction: &Vector3<f64>,
    ) -> Option<(f64, Vector3<f64>)> {
        let (mut from, mut to) = (f64::NEG_INFINITY, f64::INFINITY);
        let mut normal = Vector3::zeros();
        for axis in 0..3 {
            let (a, b) = (
                (self.low[axis] - origin[axis]) / direction[axis],
                (self.high[axis] - origin[axis]) / direction[axis],
            );
            let (near, far) = (a.min(b), a.max(b));
            if near > from {
                from = near;
                normal = Vector3::zeros();
                normal[axis] = -direction[axis].signum();
            }
            to = to.min(far);
        }
        (from <= to && from > 0.0).then_some((from, normal))
    }
}

/// A board in front of one camera.
struct Stand<'a> {
    board: &'a Board,
    /// Middles of the key's discs and their radius \[m\].
    key: Option<([[f64; 2]; 3], f64)>,
    light: BoardLight,
    plate: Cuboid,
    blocks: Vec<Cuboid>,
    /// Camera and laser apex in the board's frame.
    eye: Vector3<f64>,
    apex: Vector3<f64>,
    /// Ray of pixel (u, v): a + u b + v c, board frame.
    a: Vector3<f64>,
    b: Vector3<f64>,
    c: Vector3<f64>,
    /// Rays that are not straight, and the way from the body to the board's frame: turn (p - origin).
    refracted: Option<(Lens, Matrix3<f64>, Vector3<f64>)>,
    optics: Optics,
    /// Sheet in the board's frame: normal and offset.
    sheet: (Vector3<f64>, f64),
    /// Length of the sheet's normal (1, -tan yaw, -tan pitch).
    sheet_normal: f64,
    /// Body axes y and z in the board's frame, for the fan.
    fan: (Vector3<f64>, Vector3<f64>),
    tan_half_fan: f64,
    peak: f64,
    exponent: f64,
}

impl Renderer {
    /// The light of a board that stands still: develop it into as many frames as wanted.
    ///
    /// # Errors
    /// [`SceneError::Board`] for a board without extent.
    pub fn board_picture(
        &self,
        board: &Board,
        placement: &BoardPlacement,
        light: &BoardLight,
    ) -> Result<BoardPicture, SceneError> {
        check(board)?;
        let stand = self.stand(board, placement, *light);
        let shade = |u: f64, v: f64| stand.shade(u, v);
        let margin = self.kernel.len() / 2;
        let (rows, columns) = (self.height_px + 2 * margin, self.width_px + 2 * margin);
        let at = |i: usize| {
            (
                (i / rows) as f64 - margin as f64,
                (i % rows) as f64 - margin as f64,
            )
        };
        let rays: Vec<(Code, f32)> = (0..rows * columns)
            .into_par_iter()
            .map(|i| {
                let (u, v) = at(i);
                gauss(&shade, u, v)
            })
            .collect();
        let codes: Vec<Code> = rays.iter().map(|r| r.0).collect();
        let picture: Vec<f32> = (0..rays.len())
            .into_par_iter()
            .map(|i| {
                let (u, v) = at(i);
                if is_edge(&codes, i, rows) {
                    lattice(&shade, u, v)
                } else {
                    rays[i].1
                }
            })
            .collect();
        Ok(BoardPicture {
            light: psf::blur(&picture, rows, &self.kernel),
            rows,
            margin,
        })
    }

    /// One frame of a board's light: ambient, noise, rounding.
    pub fn develop_board(&self, picture: &BoardPicture, frame_index: u64) -> GreyPixels {
        let mut pixels = vec![0; self.width_px * self.height_px];
        self.develop(frame_index, &mut pixels, |row, line| {
            for (column, pixel) in line.iter_mut().enumerate() {
                let light = picture.light[column * picture.rows + row + picture.margin];
                *pixel = self
                    .noise
                    .pixel(frame_index, row, column, self.width_px, light);
            }
        });
        GreyPixels(pixels)
    }

    /// (xi, eta, zeta) to the body frame (theory/geometry.md, frames): xi = -y_b, eta = h_centre - z_b, zeta = x_b - l_laser.
    fn body_of_plane(&self, p: Vector3<f64>) -> Vector3<f64> {
        Vector3::new(p.z + self.optics.l_laser_m, -p.x, self.h_centre_m - p.y)
    }

    /// Pinhole in the body frame, and the matrix whose columns b, c, a make the ray b u + c v + a.
    fn camera_axes(&self) -> (Vector3<f64>, Matrix3<f64>) {
        let (eye, [a, b, c]) = super::rays::camera(&self.optics);
        (eye, Matrix3::from_columns(&[b, c, a]))
    }

    fn stand<'a>(
        &self,
        board: &'a Board,
        placement: &BoardPlacement,
        light: BoardLight,
    ) -> Stand<'a> {
        let (to_plane, centre) = frame(placement);
        let (eye, axes) = self.camera_axes();
        // Body -> laser plane -> board; the plane's axes in the body are -y, -z, x.
        let body_to_plane = Matrix3::new(0.0, -1.0, 0.0, 0.0, 0.0, -1.0, 1.0, 0.0, 0.0);
        let turn = to_plane.transpose() * body_to_plane;
        let origin = self.body_of_plane(centre);
        let local = |p: Vector3<f64>| turn * (p - origin);
        let o = &self.optics;
        let normal = Vector3::new(1.0, -o.sheet_tan_yaw, -o.sheet_tan_pitch);
        let apex = Vector3::new(o.l_laser_m, 0.0, 0.0);
        let unit = turn * normal.normalize();
        let half = |n: u32| f64::from(n - 1) / 2.0 * board.pitch_m + board.margin_m;
        let (hx, hy) = (half(board.columns), half(board.rows));
        let blocks = board.blocks.iter().map(|b| Cuboid {
            low: Vector3::new(
                b.centre_m[0] - b.size_m[0] / 2.0,
                b.centre_m[1] - b.size_m[1] / 2.0,
                -1e-6,
            ),
            high: Vector3::new(
                b.centre_m[0] + b.size_m[0] / 2.0,
                b.centre_m[1] + b.size_m[1] / 2.0,
                b.height_m,
            ),
        });
        Stand {
            board,
            key: hydroline_calib::board::key(board).map(|key| {
                let middles = key.cells.map(|c| hydroline_calib::board::cell_m(board, c));
                (middles, 0.5 * key.diameter_m)
            }),
            light,
            plate: Cuboid {
                low: Vector3::new(-hx, -hy, -board.thickness_m),
                high: Vector3::new(hx, hy, 0.0),
            },
            blocks: blocks.collect(),
            eye: local(eye),
            apex: local(apex),
            b: turn * axes.column(0),
            c: turn * axes.column(1),
            a: turn * axes.column(2),
            refracted: (!Lens::is_pinhole(o)).then(|| (Lens::new(o), turn, origin)),
            optics: *o,
            sheet: (unit, -unit.dot(&local(apex))),
            sheet_normal: normal.norm(),
            fan: (turn * Vector3::y(), turn * Vector3::z()),
            tan_half_fan: o.half_fan_rad.tan(),
            peak: o.peak,
            exponent: -0.5 / (o.sheet_sigma_m * o.sheet_sigma_m),
        }
    }
}

/// Board frame -> laser plane (third axis: up from the face, towards the camera), and the board's middle there.
fn frame(p: &BoardPlacement) -> (Matrix3<f64>, Vector3<f64>) {
    let tilts = Rotation3::from_axis_angle(&Vector3::y_axis(), -p.tilt_eta_rad)
        * Rotation3::from_axis_angle(&Vector3::x_axis(), p.tilt_xi_rad)
        * Rotation3::from_axis_angle(&Vector3::z_axis(), p.rotation_rad);
    // Columns: xi, eta and -zeta.
    let axes = tilts.matrix() * Matrix3::from_diagonal(&Vector3::new(1.0, 1.0, -1.0));
    (axes, Vector3::new(p.centre_m[0], p.centre_m[1], p.offset_m))
}

fn check(board: &Board) -> Result<(), SceneError> {
    let numbers = [
        ("columns", f64::from(board.columns)),
        ("rows", f64::from(board.rows)),
        ("pitch_m", board.pitch_m),
        ("thickness_m", board.thickness_m),
    ];
    match numbers
        .into_iter()
        .find(|(_, v)| !(*v > 0.0 && v.is_finite()))
    {
        Some((what, value)) => Err(SceneError::Board {
            board: board.name.clone(),
            what,
            value,
        }),
        None => Ok(()),
    }
}

impl Stand<'_> {
    /// Kind of thing that pixel (u, v) shows, and its grey level without ambient.
    fn shade(&self, u: f64, v: f64) -> (Code, f64) {
        let (eye, direction) = match &self.refracted {
            None => (self.eye, self.a + self.b * u + self.c * v),
            Some((lens, turn, origin)) => {
                let (from, along) = lens.ray(u, v);
                (turn * (from - origin), turn * along)
            }
        };
        let mut best: Option<(f64, Vector3<f64>, usize)> = None;
        for (i, cuboid) in [&self.plate].into_iter().chain(&self.blocks).enumerate() {
            if let Some((t, normal)) = cuboid.entry(&eye, &direction)
                && best.is_none_or(|b| t < b.0)
            {
                best = Some((t, normal, i));
            }
        }
        let Some((t, normal, which)) = best else {
            return (Code::lit(0), 0.0);
        };
        let point = eye + direction * t;
        let face = which == 0 && normal.z > 0.5;
        let albedo = if face {
            self.pattern(point.x, point.y)
        } else {
            METAL
        };
        let [sx, sy] = self.light.slope_per_m;
        let room = self.light.room * (1.0 + sx * point.x + sy * point.y).max(0.0);
        let (laser, lit) = self.laser(&point, &normal, face);
        // Surfaces, pattern and shadow borders are edges; the laser's own falling off is not.
        let kind = 1 + 4 * which.min(10) + 2 * usize::from(albedo < 0.5) + usize::from(lit);
        (Code::lit(kind), albedo * (room + laser))
    }

    /// Laser light at a point, and whether it is reached at all.
    fn laser(&self, point: &Vector3<f64>, normal: &Vector3<f64>, face: bool) -> (f64, bool) {
        let from_apex = point - self.apex;
        let (fan_y, fan_z) = (self.fan.0.dot(&from_apex), self.fan.1.dot(&from_apex));
        let mut off_m = self.sheet.0.dot(point) + self.sheet.1;
        let o = &self.optics;
        if o.cone_sin != 0.0 {
            off_m -= o.cone_m(fan_y, fan_z) / self.sheet_normal;
        }
        let mut light =
            self.peak * (off_m * off_m * self.exponent).exp() * o.line_profile(fan_y / fan_z);
        if o.attenuation_pm > 0.0 {
            let way = from_apex.norm() + (point - self.eye).norm();
            light *= (-o.attenuation_pm * way).exp();
        }
        // NaN (a point beside the apex of a curved sheet) is dark, too.
        if !self.light.laser || light < 0.01 || light.is_nan() {
            return (0.0, false);
        }
        // Other sides than the face are lit only where they look at the laser.
        if fan_y.abs() > self.tan_half_fan * fan_z || (!face && normal.dot(&from_apex) >= 0.0) {
            return (0.0, false);
        }
        // The sheet's layers run side by side: this point's light starts as far off the sheet as it ends.
        let start = self.apex + self.sheet.0 * off_m;
        let path = point - start;
        let shadowed = self
            .blocks
            .iter()
            .any(|b| b.entry(&start, &path).is_some_and(|(t, _)| t < 1.0 - 1e-9));
        if shadowed {
            (0.0, false)
        } else if face {
            (self.light.grazing * light, true)
        } else {
            (light, true)
        }
    }

    /// Reflectance of the face at (xi, eta) from the middle of the node grid.
    fn pattern(&self, x: f64, y: f64) -> f64 {
        let board = self.board;
        let pitch = board.pitch_m;
        let half = |n: u32| f64::from(n - 1) / 2.0;
        // In pitches from the first node.
        let (i, j) = (
            x / pitch + half(board.columns),
            y / pitch + half(board.rows),
        );
        let last = |n: u32| f64::from(n - 1);
        let nearest = |v: f64, n: u32| v.round().clamp(0.0, last(n));
        let (di, dj) = (
            (i - nearest(i, board.columns)) * pitch,
            (j - nearest(j, board.rows)) * pitch,
        );
        let dark = match board.pattern {
            BoardPattern::Lines { line_m } => {
                let w = line_m / 2.0;
                let within = |v: f64, n: u32| v * pitch >= -w && (v - last(n)) * pitch <= w;
                (di.abs() <= w && within(j, board.rows))
                    || (dj.abs() <= w && within(i, board.columns))
            }
            BoardPattern::Dots { diameter_m } => di.hypot(dj) <= diameter_m / 2.0,
            // Nodes are the inner corners: one more square around them.
            BoardPattern::Chessboard | BoardPattern::Charuco { .. } => {
                hydroline_calib::charuco::is_dark(board, [x, y])
            }
        };
        // The key's discs are dark; on a chessboard they take the other colour of their square.
        let on_key = self.key.is_some_and(|(middles, radius)| {
            middles.iter().any(|m| (x - m[0]).hypot(y - m[1]) <= radius)
        });
        let dark = match board.pattern {
            BoardPattern::Chessboard => dark != on_key,
            _ => dark || on_key,
        };
        if dark { BLACK } else { WHITE }
    }
}

#[cfg(test)]
mod tests;
