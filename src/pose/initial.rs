//! First guesses of the pose: where on the target the measured steps can be.
//!
//! z and φ follow from the lines at θ = 0. x, y and ψ put every step on an edge of its own upper face;
//! from a grid of starts all such places are found, mirror images and repetitions included. The
//! grid lies fixed on the target, so a guess does not depend on the hint that picks it.

use super::outline::{Edge, Outline, Surfaces, UpperFace};
use super::segments::{Levels, Step};
use hydroline_calib::Pose;
use hydroline_rigs::Mounts;
use nalgebra::{Matrix3, Vector2, Vector3};

pub(crate) mod assigned;

/// Starts along X \[m\]: each flank of the hexagons (0.104 m) gets several.
const GRID_X_M: f64 = 0.026;
/// Starts in ψ \[rad\] (0, ±14°, ±28°).
const GRID_PSI_RAD: [f64; 5] = [0.0, -0.25, 0.25, -0.5, 0.5];
/// Steps farther than this from every edge are no match, rms \[m\].
const MATCH_RMS_M: f64 = 0.0025;
/// Guesses that agree to this are one \[m\], \[rad\].
const SAME_M: f64 = 0.003;
const SAME_RAD: f64 = 0.01;
/// Steps of a frame whose edges are remembered from one try to the next; more are only slower.
const STEPS_REMEMBERED: usize = 8;
/// A start this near to a place, as a share of that, has come to it.
const JOINED: f64 = 0.1;

/// A place where the steps fit.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Guess {
    /// Pose, with θ = 0 unless upper faces far apart in height show it.
    pub pose: Pose,
    /// Distance of the steps from the edges they were given to, rms \[m\].
    pub rms_m: f64,
}

/// z and φ from the lines, θ as given: η₀ = h_centre − (H + l_laser sin θ) / (cos θ cos φ), slope = −tan φ.
pub fn level_pose(levels: &Levels, mounts: &Mounts, theta_rad: f64) -> Pose {
    let phi_rad = -levels.slope.atan();
    let clearance_m = (mounts.h_centre_m - levels.eta0_m) * theta_rad.cos() * phi_rad.cos();
    Pose {
        z_m: mounts.l_laser_m * theta_rad.sin() - clearance_m,
        phi_rad,
        theta_rad,
        ..Pose::default()
    }
}

/// All places where the steps fit, best first; empty without steps or where fewer than three are seen.
pub fn guesses(levels: &Levels, surfaces: &Surfaces, mounts: &Mounts) -> Vec<Guess> {
    let steps = steps_on_faces(levels, surfaces);
    if steps.len() < 3 {
        return Vec::new();
    }
    let start = level_pose(levels, mounts, 0.0);
    let middle_xi_m = 0.5 * (steps[0].0.xi_m + steps[steps.len() - 1].0.xi_m);
    // ψ = 0 turns what is seen of each step once for all starts: ψ only turns it on about the vertical.
    let level = start.body_to_tank_rotation();
    let arm = |s: &Step| level * hydroline_calib::frames::plane_to_body(mounts, s.xi_m, s.eta_m);
    let steps: Vec<Seen<'_>> = steps
        .iter()
        .map(|(step, face)| Seen {
            arm: arm(step).xy(),
            to_starboard: step.to_starboard,
            outline: &face.outline,
        })
        .collect();
    let [first_m, last_m] = surfaces.span_m;
    let count = ((last_m - first_m) / GRID_X_M).ceil().clamp(1.0, 400.0) as usize;
    let (mut found, mut refused): (Vec<Guess>, Vec<Guess>) = (Vec::new(), Vec::new());
    for i in 0..=count {
        let sheet_x_m = first_m + GRID_X_M * (i as f64 + 0.37);
        for psi_rad in GRID_PSI_RAD {
            // The middle between the outer steps lies about on the centre line.
            let (sin, cos) = psi_rad.sin_cos();
            let pose = Pose {
                x_m: sheet_x_m - cos * mounts.l_laser_m,
                y_m: -sin * mounts.l_laser_m + cos * middle_xi_m,
                psi_rad,
                ..start
            };
            let known = |p: &Pose| {
                let mut both = found.iter().chain(&refused);
                both.any(|g| joined(&g.pose, p))
            };
            let Some(guess) = converge(pose, &steps, known) else {
                continue;
            };
            if guess.rms_m > MATCH_RMS_M {
                continue;
            }
            if !agrees(&guess.pose, levels, surfaces, mounts) {
                refused.push(guess);
                continue;
            }
            let one = |g: &&mut Guess| {
                (g.pose.x_m - guess.pose.x_m).abs() < SAME_M
                    && (g.pose.psi_rad - guess.pose.psi_rad).abs() < SAME_RAD
            };
            match found.iter_mut().find(one) {
                Some(old) if old.rms_m > guess.rms_m => *old = guess,
                Some(_) => {}
                None => found.push(guess),
            }
        }
    }
    found.sort_by(|a, b| a.rms_m.total_cmp(&b.rms_m));
    found
}

/// A step as a start with ψ = 0 sees it: the way to it from the CG over the ground, and the upper face that ends there.
struct Seen<'a> {
    arm: Vector2<f64>,
    to_starboard: bool,
    outline: &'a Outline,
}

/// The steps with the upper faces that end there.
fn steps_on_faces<'a>(
    levels: &'a Levels,
    surfaces: &'a Surfaces,
) -> Vec<(&'a Step, &'a UpperFace)> {
    let faces = &surfaces.faces;
    let of = |s: &Step| faces.iter().find(|t| (t.height_m - s.upper_m).abs() < 1e-6);
    levels
        .steps
        .iter()
        .filter_map(|s| of(s).map(|t| (s, t)))
        .collect()
}

/// Whether a start has come to where another has converged: it will converge there too.
fn joined(a: &Pose, b: &Pose) -> bool {
    (a.x_m - b.x_m).abs() < JOINED * SAME_M
        && (a.y_m - b.y_m).abs() < JOINED * SAME_M
        && (a.psi_rad - b.psi_rad).abs() < JOINED * SAME_RAD
}

/// Gauss–Newton on (x, y, ψ): every step to distance zero from the nearest edge of its upper face that
/// ends on the right side. `None` where there is no such place, or a `known` one.
fn converge(mut pose: Pose, steps: &[Seen<'_>], known: impl Fn(&Pose) -> bool) -> Option<Guess> {
    let mut rms_m = f64::INFINITY;
    // Of each step the edge that it was last given to.
    let mut given = [None; STEPS_REMEMBERED];
    for _ in 0..8 {
        // To starboard of a step the upper face ends: the inward normal looks to port, −Y rotated by ψ.
        let (sin, cos) = pose.psi_rad.sin_cos();
        let mut a = Matrix3::identity() * 1e-9;
        let mut b = Vector3::zeros();
        let mut sum = 0.0;
        for (i, step) in steps.iter().enumerate() {
            let arm = Vector2::new(
                cos * step.arm.x - sin * step.arm.y,
                sin * step.arm.x + cos * step.arm.y,
            );
            let p = [pose.x_m + arm.x, pose.y_m + arm.y];
            let sign = if step.to_starboard { 1.0 } else { -1.0 };
            let last = given.get(i).copied().flatten();
            let side = [sign * sin, -sign * cos];
            let (square, k) = nearest_facing(step.outline, p, side, last)?;
            if let Some(given) = given.get_mut(i) {
                *given = Some(k);
            }
            let edge = &step.outline.edges[k];
            let d = edge.inside_m(p);
            let [nx, ny] = edge.inward;
            let j = Vector3::new(nx, ny, -nx * arm.y + ny * arm.x);
            a += j * j.transpose();
            b -= j * d;
            sum += square;
        }
        rms_m = (sum / steps.len() as f64).sqrt();
        let move_by = a.cholesky()?.solve(&b);
        let size = (move_by.x.hypot(move_by.y) / 0.03)
            .max(move_by.z.abs() / 0.15)
            .max(1.0);
        pose.x_m += move_by.x / size;
        pose.y_m += move_by.y / size;
        pose.psi_rad += move_by.z / size;
        if move_by.norm() < 1e-7 {
            break;
        }
        if known(&pose) {
            return None;
        }
    }
    (pose.psi_rad.abs() < 0.8 && rms_m.is_finite()).then_some(Guess { pose, rms_m })
}

/// Of the edges that look to a side the nearest, the first where several are, with its distance
/// squared. The one that was it before is looked at first: most others are then known by their X alone
/// to be farther.
fn nearest_facing(
    outline: &Outline,
    p: [f64; 2],
    side: [f64; 2],
    before: Option<usize>,
) -> Option<(f64, usize)> {
    let faces = |e: &Edge| side[0] * e.inward[0] + side[1] * e.inward[1] > 0.1;
    let (mut least, mut first) = before
        .and_then(|k| outline.edges.get(k).map(|e| (k, e)))
        .filter(|(_, e)| faces(e))
        .map_or((f64::INFINITY, usize::MAX), |(k, e)| (e.distance2_m2(p), k));
    let mut reach_m = least.sqrt();
    for (k, e) in outline.edges.iter().enumerate() {
        let [low, high] = e.x_range_m;
        if low > p[0] + reach_m || high < p[0] - reach_m || !faces(e) {
            continue;
        }
        let square = e.distance2_m2(p);
        if square < least || (square == least && k < first) {
            (least, first) = (square, k);
            // A hair more, for what rounding takes.
            reach_m = square.sqrt() * (1.0 + 1e-12) + 1e-12;
        }
    }
    (first < outline.edges.len()).then_some((least, first))
}

/// Whether the middle of each segment lies on an upper face of that height.
fn agrees(pose: &Pose, levels: &Levels, surfaces: &Surfaces, mounts: &Mounts) -> bool {
    let (mut right, mut all) = (0.0, 0.0);
    let (rotation, position_m) = (pose.body_to_tank_rotation(), pose.position_m());
    for s in &levels.segments {
        for k in 1..8 {
            let xi = s.xi_m[0] + (s.xi_m[1] - s.xi_m[0]) * f64::from(k) / 8.0;
            let eta = levels.eta0_m + levels.slope * xi + s.height_m;
            let p = position_m + rotation * hydroline_calib::frames::plane_to_body(mounts, xi, eta);
            let weight = s.columns_px[1] - s.columns_px[0];
            all += weight;
            if (surfaces.height_at_m([p.x, p.y]) - s.height_m).abs() < 1e-6 {
                right += weight;
            }
        }
    }
    right > 0.93 * all
}
