//! Board, blocks and laser sheet as solids, seen ray by ray.

use hydroline_rigs::{Board, BoardPattern};

use super::{LaserSheet, Scene, View, finish};
use hydroline_calib::board;

/// One box of the scene: low and high corner in (ξ, η, height).
type Solid = ([f64; 3], [f64; 3]);

struct World<'a> {
    board: &'a Board,
    key: Option<board::Key>,
    solids: Vec<Solid>,
    scene: &'a Scene,
}

/// A ray's hit: solid (0 = the board itself), face axis and side, point (ξ, η, height).
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
            BoardPattern::Charuco { .. } => panic!("boards of this renderer have no markers"),
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
    let mut image = vec![0.0f64; w * h];
    for r in 0..h {
        for c in 0..w {
            let k = r * (w + 1) + c;
            let middle = seen(c as f64, r as f64);
            let here = sign(&middle);
            let plain = [k, k + 1, k + w + 1, k + w + 2]
                .into_iter()
                .all(|n| corners[n] == here)
                // The laser's profile on a side is curved within a pixel.
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
