//! Images of boards for tests and benches: an exact ray per subsample through lens, port
//! and water, blocks as solids, the laser sheet with its shadows. Knows nothing of the detector.

use hydroline_rigs::{Board, BoardPattern};
use nalgebra::{Rotation3, Vector3};
use rand::{RngExt, SeedableRng, rngs::StdRng};
use rand_distr::{Distribution, Normal};

use crate::board;
use crate::study::truth::Rig;

/// A camera looking at a board (ξ, η, ζ; the face at ζ = 0 is seen from ζ < 0).
#[derive(Debug, Clone)]
pub struct View {
    /// Camera \[m\].
    pub eye_m: Vector3<f64>,
    /// Image right, image down, optical axis in the board's frame.
    axes: [Vector3<f64>; 3],
    /// Focal length \[px\].
    pub focal_px: f64,
    /// Principal point \[px\].
    pub centre_px: [f64; 2],
    /// Port and lens; `None` = pinhole.
    port: Option<Rig>,
}

impl View {
    /// A pinhole `distance_m` from the board's middle, the board's normal `angle_rad` off the
    /// optical axis in direction `azimuth_rad` (0 = camera to port, π/2 = above), rolled.
    pub fn pinhole(
        size: [usize; 2],
        focal_px: f64,
        distance_m: f64,
        angle_rad: f64,
        azimuth_rad: f64,
        roll_rad: f64,
    ) -> Self {
        let (s, c) = angle_rad.sin_cos();
        let away = Vector3::new(s * azimuth_rad.cos(), s * azimuth_rad.sin(), -c);
        let forward = -away;
        let up = Vector3::new(0.0, 1.0, 0.0);
        let right = forward.cross(&up);
        // Right-handed ξ (port), η, ζ: looking along ζ, ξ is to the left.
        let right = if right.norm() > 1e-6 {
            right.normalize()
        } else {
            Vector3::new(-1.0, 0.0, 0.0)
        };
        let roll = Rotation3::from_axis_angle(&nalgebra::Unit::new_normalize(forward), roll_rad);
        let right = roll * right;
        View {
            eye_m: away * distance_m,
            axes: [right, forward.cross(&right), forward],
            focal_px,
            centre_px: [0.5 * (size[0] as f64 - 1.0), 0.5 * (size[1] as f64 - 1.0)],
            port: None,
        }
    }

    /// The study's rig, the board's origin at (0, `eta_m`) of its sheet.
    pub fn behind_port(rig: Rig, eta_m: f64) -> Self {
        let norm = rig.height_m.hypot(rig.distance_m);
        let (down, forward) = (rig.height_m / norm, rig.distance_m / norm);
        View {
            eye_m: Vector3::new(0.0, rig.height_m - eta_m, -rig.distance_m),
            axes: [
                Vector3::new(-1.0, 0.0, 0.0),
                Vector3::new(0.0, -forward, -down),
                Vector3::new(0.0, -down, forward),
            ],
            focal_px: rig.focal_px,
            centre_px: rig.centre_px,
            port: Some(rig),
        }
    }

    /// The true pixel of a board point (ξ, η, height towards the camera) \[m\].
    pub fn project(&self, xi_m: f64, eta_m: f64, height_m: f64) -> Option<[f64; 2]> {
        if let Some(rig) = &self.port {
            let eta_off = rig.height_m - self.eye_m[1];
            return rig.project(xi_m, eta_m + eta_off, -height_m);
        }
        let d = Vector3::new(xi_m, eta_m, -height_m) - self.eye_m;
        let z = d.dot(&self.axes[2]);
        (z > 0.0).then(|| {
            [
                self.centre_px[0] + self.focal_px * d.dot(&self.axes[0]) / z,
                self.centre_px[1] + self.focal_px * d.dot(&self.axes[1]) / z,
            ]
        })
    }

    /// Start and direction of a pixel's ray beyond the port, in the board's frame.
    fn ray(&self, column: f64, row: f64) -> (Vector3<f64>, Vector3<f64>) {
        let (x, y) = (
            (column - self.centre_px[0]) / self.focal_px,
            (row - self.centre_px[1]) / self.focal_px,
        );
        let to_board =
            |v: Vector3<f64>| self.axes[0] * v[0] + self.axes[1] * v[1] + self.axes[2] * v[2];
        let Some(rig) = &self.port else {
            return (self.eye_m, to_board(Vector3::new(x, y, 1.0)).normalize());
        };
        // The lens inverted by fixed point, then Snell in the ray's own plane.
        let seen = x.hypot(y);
        let mut r = seen;
        for _ in 0..30 {
            r = seen / (1.0 + r * r * (rig.k[0] + rig.k[1] * r * r));
        }
        let angle = r.atan();
        let sin = angle.sin();
        let (tan_g, tan_w) = (
            (sin / rig.n_glass).asin().tan(),
            (sin / rig.n_water).asin().tan(),
        );
        let radius = rig.port_m * angle.tan() + rig.glass_m * tan_g;
        let (ux, uy) = if seen > 0.0 {
            (x / seen, y / seen)
        } else {
            (0.0, 0.0)
        };
        (
            self.eye_m
                + to_board(Vector3::new(
                    radius * ux,
                    radius * uy,
                    rig.port_m + rig.glass_m,
                )),
            to_board(Vector3::new(tan_w * ux, tan_w * uy, 1.0)).normalize(),
        )
    }
}

/// A laser sheet: height over the board's face = offset + tilt_xi·ξ + tilt_eta·η.
#[derive(Debug, Clone, Copy)]
pub struct LaserSheet {
    /// Sheet over the face at the board's middle, towards the camera \[m\].
    pub offset_m: f64,
    /// d height / dξ.
    pub tilt_xi: f64,
    /// d height / dη.
    pub tilt_eta: f64,
    /// Gaussian thickness \[m\].
    pub sigma_m: f64,
    /// Grey levels on a white surface facing the laser.
    pub peak: f64,
    /// Apex above the board's middle \[m\].
    pub apex_m: f64,
}

/// Everything in front of the camera.
#[derive(Debug, Clone)]
pub struct Scene {
    /// Image width and height \[px\].
    pub size: [usize; 2],
    /// Whether the key is on the board.
    pub key: bool,
    /// Grey of the face, of the marks, of what is behind the board.
    pub greys: [f64; 3],
    /// Light at the image's left, right, top, bottom relative to 1: products.
    pub light: [f64; 4],
    /// A stripe across: pixel offset of its middle from the image's middle, slope, σ px, grey levels.
    pub stripe: Option<[f64; 4]>,
    /// Rectangles in front: column, row, width, height \[px\], grey.
    pub occluders: Vec<[f64; 5]>,
    /// The sheet.
    pub laser: Option<LaserSheet>,
    /// Lens blur, σ \[px\].
    pub blur_px: f64,
    /// Camera noise, σ \[grey levels\].
    pub noise: f64,
    /// Factor on the whole image before noise: over 1 saturates.
    pub exposure: f64,
    /// Noise seed.
    pub seed: u64,
}

impl Default for Scene {
    fn default() -> Self {
        Scene {
            size: [720, 576],
            key: true,
            greys: [190.0, 30.0, 70.0],
            light: [1.0; 4],
            stripe: None,
            occluders: Vec::new(),
            laser: None,
            blur_px: 0.7,
            noise: 2.0,
            exposure: 1.0,
            seed: 1,
        }
    }
}

/// One box of the scene: low and high corner in (ξ, η, height).
type Solid = ([f64; 3], [f64; 3]);

struct World<'a> {
    board: &'a Board,
    key: Option<board::Key>,
    half: [f64; 2],
    solids: Vec<Solid>,
    scene: &'a Scene,
}

/// What a ray hit: solid (0 = the board itself), face axis and side, point (ξ, η, height).
#[derive(Clone, Copy, PartialEq)]
struct Hit {
    solid: usize,
    axis: usize,
    positive: bool,
    at: [f64; 3],
}

impl World<'_> {
    fn hit(&self, from: [f64; 3], along: [f64; 3]) -> Option<Hit> {
        let mut best: Option<(f64, Hit)> = None;
        for (solid, (low, high)) in self.solids.iter().enumerate() {
            let (mut near, mut far, mut axis) = (0.0f64, f64::INFINITY, 0);
            let mut missed = false;
            for k in 0..3 {
                if along[k].abs() < 1e-15 {
                    missed |= from[k] < low[k] || from[k] > high[k];
                    continue;
                }
                let (a, b) = (
                    (low[k] - from[k]) / along[k],
                    (high[k] - from[k]) / along[k],
                );
                let (a, b) = if a < b { (a, b) } else { (b, a) };
                if a > near {
                    near = a;
                    axis = k;
                }
                far = far.min(b);
            }
            if missed || near > far || near <= 1e-9 {
                continue;
            }
            if best.is_none_or(|(t, _)| near < t) {
                best = Some((
                    near,
                    Hit {
                        solid,
                        axis,
                        positive: along[axis] < 0.0,
                        at: [0, 1, 2].map(|k| from[k] + near * along[k]),
                    },
                ));
            }
        }
        best.map(|(_, hit)| hit)
    }

    /// Signature of what is seen at a hit: equal signatures, equal grey over the pixel.
    fn mark(&self, hit: &Hit) -> (bool, [i32; 2]) {
        let b = self.board;
        let (u, v) = (
            hit.at[0] / b.pitch_m + 0.5 * (f64::from(b.columns) - 1.0),
            hit.at[1] / b.pitch_m + 0.5 * (f64::from(b.rows) - 1.0),
        );
        let cell = [u.floor() as i32, v.floor() as i32];
        if !(hit.solid == 0 && hit.axis == 2 && hit.positive) {
            return (false, [1000 + hit.solid as i32, hit.axis as i32]);
        }
        let (near_u, near_v) = (u.round(), v.round());
        let (cols, rows) = (f64::from(b.columns) - 1.0, f64::from(b.rows) - 1.0);
        let mut dark = match b.pattern {
            BoardPattern::Lines { line_m } => {
                let half = 0.5 * line_m / b.pitch_m;
                let along = |x: f64, n: f64| x >= -half && x <= n + half;
                ((u - near_u).abs() <= half && (0.0..=cols).contains(&near_u) && along(v, rows))
                    || ((v - near_v).abs() <= half
                        && (0.0..=rows).contains(&near_v)
                        && along(u, cols))
            }
            BoardPattern::Dots { diameter_m } => {
                (u - near_u).hypot(v - near_v) <= 0.5 * diameter_m / b.pitch_m
                    && (0.0..=cols).contains(&near_u)
                    && (0.0..=rows).contains(&near_v)
            }
            BoardPattern::Chessboard => {
                (-1..=cols as i32).contains(&cell[0])
                    && (-1..=rows as i32).contains(&cell[1])
                    && (cell[0] + cell[1]).rem_euclid(2) == 0
            }
        };
        if let Some(key) = &self.key {
            for c in key.cells {
                let [x, y] = board::cell_m(b, c);
                if (hit.at[0] - x).hypot(hit.at[1] - y) <= 0.5 * key.diameter_m {
                    dark = !matches!(b.pattern, BoardPattern::Chessboard) || !dark;
                    return (dark, [2000 + c[0] as i32, c[1] as i32]);
                }
            }
        }
        (dark, cell)
    }

    fn grey(&self, hit: Option<&Hit>) -> f64 {
        let Some(hit) = hit else {
            return self.scene.greys[2];
        };
        let dark = self.mark(hit).0;
        let mut albedo = if dark {
            self.scene.greys[1]
        } else {
            self.scene.greys[0]
        };
        // Sides of a solid get less of the ambient light.
        if hit.axis != 2 {
            albedo *= 0.55;
        }
        albedo + self.scene.laser.map_or(0.0, |l| self.lit(hit, &l, dark))
    }

    fn lit(&self, hit: &Hit, laser: &LaserSheet, dark: bool) -> f64 {
        let [xi, eta, height] = hit.at;
        let sheet = laser.offset_m + laser.tilt_xi * xi + laser.tilt_eta * eta;
        let off = (height - sheet) / laser.sigma_m;
        if off.abs() > 5.0 {
            return 0.0;
        }
        let (dx, dy) = (-xi, laser.apex_m - eta);
        let length = dx.hypot(dy);
        let facing = match (hit.axis, hit.positive) {
            (0, p) => dx / length * if p { 1.0 } else { -1.0 },
            (1, p) => dy / length * if p { 1.0 } else { -1.0 },
            // The face grazes the sheet: only its roughness is lit.
            _ => 0.02,
        };
        if facing <= 0.0 {
            return 0.0;
        }
        let start = [0, 1, 2].map(|k| hit.at[k] + 1e-6 * [dx / length, dy / length, 0.0][k]);
        // The sheet's light travels in the sheet: shadows fall along its tilt, too small to matter.
        if self.hit(start, [dx / length, dy / length, 0.0]).is_some() && hit.axis != 2 {
            return 0.0;
        }
        laser.peak * facing * if dark { 0.15 } else { 1.0 } * (-0.5 * off * off).exp()
    }
}

/// Renders the board as seen.
pub fn render(board: &Board, view: &View, scene: &Scene) -> Vec<u8> {
    let half = board::half_size_m(board);
    let mut solids = vec![(
        [-half[0], -half[1], -board.thickness_m],
        [half[0], half[1], 0.0],
    )];
    for b in &board.blocks {
        let (x, y) = (0.5 * b.size_m[0], 0.5 * b.size_m[1]);
        solids.push((
            [b.centre_m[0] - x, b.centre_m[1] - y, 0.0],
            [b.centre_m[0] + x, b.centre_m[1] + y, b.height_m],
        ));
    }
    let world = World {
        board,
        key: scene.key.then(|| board::key(board)).flatten(),
        half,
        solids,
        scene,
    };
    let [w, h] = scene.size;
    let seen = |column: f64, row: f64| {
        let (from, along) = view.ray(column, row);
        world.hit(
            [from[0], from[1], -from[2]],
            [along[0], along[1], -along[2]],
        )
    };
    // Pixels whose corners all see the same plain thing need one ray, others 64.
    let sign = |hit: &Option<Hit>| hit.as_ref().map(|h| (h.solid, h.axis, world.mark(h)));
    let corners: Vec<_> = (0..=h)
        .flat_map(|r| (0..=w).map(move |c| (c as f64 - 0.5, r as f64 - 0.5)))
        .map(|(c, r)| sign(&seen(c, r)))
        .collect();
    let _ = world.half;
    let mut image = vec![0.0f64; w * h];
    for r in 0..h {
        for c in 0..w {
            let k = r * (w + 1) + c;
            let middle = seen(c as f64, r as f64);
            let here = sign(&middle);
            let plain = [k, k + 1, k + w + 1, k + w + 2]
                .into_iter()
                .all(|n| corners[n] == here)
                // The laser's profile on a side bends within a pixel.
                && (scene.laser.is_none() || middle.is_none_or(|h| h.axis == 2));
            image[r * w + c] = if plain {
                world.grey(middle.as_ref())
            } else {
                let mut sum = 0.0;
                for y in 0..8 {
                    for x in 0..8 {
                        let at = (
                            c as f64 - 0.4375 + 0.125 * f64::from(x),
                            r as f64 - 0.4375 + 0.125 * f64::from(y),
                        );
                        sum += world.grey(seen(at.0, at.1).as_ref());
                    }
                }
                sum / 64.0
            };
        }
    }
    finish(image, scene)
}

/// Light, stripe, occluders, blur, noise and quantisation.
pub fn finish(mut image: Vec<f64>, scene: &Scene) -> Vec<u8> {
    let [w, h] = scene.size;
    for r in 0..h {
        let v = r as f64 / (h as f64 - 1.0);
        for c in 0..w {
            let u = c as f64 / (w as f64 - 1.0);
            let light = (scene.light[0] * (1.0 - u) + scene.light[1] * u)
                * (scene.light[2] * (1.0 - v) + scene.light[3] * v);
            let pixel = &mut image[r * w + c];
            *pixel *= light;
            if let Some([offset, slope, sigma, peak]) = scene.stripe {
                let d = r as f64 - 0.5 * h as f64 - offset - slope * (c as f64 - 0.5 * w as f64);
                *pixel += peak * (-0.5 * (d / sigma).powi(2)).exp();
            }
            for &[x, y, width, height, grey] in &scene.occluders {
                let (dx, dy) = (c as f64 - x, r as f64 - y);
                if (0.0..width).contains(&dx) && (0.0..height).contains(&dy) {
                    *pixel = grey;
                }
            }
        }
    }
    let image = gauss(image, w, h, scene.blur_px);
    let mut rng = StdRng::seed_from_u64(scene.seed);
    let noise = Normal::new(0.0, scene.noise.max(0.0)).ok();
    image
        .iter()
        .map(|v| {
            let n = noise.map_or(0.0, |n| n.sample(&mut rng));
            (v * scene.exposure + n).round().clamp(0.0, 255.0) as u8
        })
        .collect()
}

fn gauss(image: Vec<f64>, w: usize, h: usize, sigma: f64) -> Vec<f64> {
    if sigma < 0.05 {
        return image;
    }
    let reach = (4.0 * sigma).ceil() as i64;
    let mut taps: Vec<f64> = (-reach..=reach)
        .map(|k| (-0.5 * (k as f64 / sigma).powi(2)).exp())
        .collect();
    let sum: f64 = taps.iter().sum();
    taps.iter_mut().for_each(|t| *t /= sum);
    let pass =
        |from: &[f64], step: usize, count: usize, line: &dyn Fn(usize) -> usize, lines: usize| {
            let mut out = vec![0.0; from.len()];
            for l in 0..lines {
                let base = line(l);
                for k in 0..count {
                    out[base + k * step] = taps
                        .iter()
                        .enumerate()
                        .map(|(n, t)| {
                            let at =
                                (k as i64 + n as i64 - reach).clamp(0, count as i64 - 1) as usize;
                            t * from[base + at * step]
                        })
                        .sum();
                }
            }
            out
        };
    let across = pass(&image, 1, w, &|r| r * w, h);
    pass(&across, w, h, &|c| c, w)
}

/// An image without a board, of many kinds: noise, gradients, stripes, textures, blobs.
pub fn clutter(size: [usize; 2], seed: u64) -> Vec<u8> {
    let [w, h] = size;
    let mut rng = StdRng::seed_from_u64(seed ^ 0x5eed);
    let kind = seed % 8;
    let mut any = |low: f64, high: f64| rng.random_range(low..high);
    let (a, b, c, d) = (any(0.0, 6.3), any(6.0, 60.0), any(0.2, 1.0), any(0.0, 6.3));
    let spots: Vec<[f64; 4]> = (0..160)
        .map(|_| {
            [
                any(0.0, w as f64),
                any(0.0, h as f64),
                any(1.5, 12.0),
                any(-110.0, 110.0),
            ]
        })
        .collect();
    let mut image = vec![0.0; w * h];
    for r in 0..h {
        for q in 0..w {
            let (x, y) = (q as f64, r as f64);
            let along = x * a.cos() + y * a.sin();
            image[r * w + q] = match kind {
                0 => 120.0,
                1 => 20.0 + 200.0 * (along / (w + h) as f64 + 0.5).clamp(0.0, 1.0),
                // One family of stripes, smooth or sharp.
                2 => 120.0 + 90.0 * (std::f64::consts::TAU * along / b).sin(),
                3 => 120.0 + 90.0 * (std::f64::consts::TAU * along / b).sin().signum(),
                // Waves that meet: caustics on a tank's floor.
                4 => {
                    let other = x * d.cos() + y * d.sin();
                    120.0
                        + 50.0
                            * (std::f64::consts::TAU * along / b + 1.5 * (other / 47.0).sin()).sin()
                        + 40.0
                            * (std::f64::consts::TAU * other / (b * c + 9.0)
                                + 2.0 * (along / 61.0).cos())
                            .sin()
                }
                // A laser stripe over a dark floor.
                6 => 25.0 + 200.0 * (-0.5 * ((y - 250.0 - 0.1 * x) / 2.2f64).powi(2)).exp(),
                _ => 120.0,
            };
        }
    }
    if kind == 5 || kind == 7 {
        for [x, y, radius, grey] in spots {
            let reach = (3.0 * radius) as i64;
            for r in (y as i64 - reach).max(0)..(y as i64 + reach).min(h as i64) {
                for q in (x as i64 - reach).max(0)..(x as i64 + reach).min(w as i64) {
                    let d = (q as f64 - x).hypot(r as f64 - y);
                    let value = if kind == 5 {
                        grey * (-0.5 * (d / radius).powi(2)).exp()
                    } else if d < radius {
                        grey
                    } else {
                        0.0
                    };
                    image[r as usize * w + q as usize] += value;
                }
            }
        }
    }
    let noise = if kind == 0 {
        any(2.0, 60.0)
    } else {
        any(0.5, 8.0)
    };
    finish(
        image,
        &Scene {
            size,
            noise,
            blur_px: any(0.0, 1.5),
            seed,
            ..Scene::default()
        },
    )
}
