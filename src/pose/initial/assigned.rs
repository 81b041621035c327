//! Places on a target whose upper faces lie far apart in height, pitch among what is looked for.
//!
//! There a degree of pitch moves the steps of one upper face against those of the other by millimetres:
//! with θ = 0 the right place may fit worse than wrong ones. So every step is given to every
//! edge that it can lie on, and x, y, ψ and θ are solved for each such assignment; the image
//! decides which of them it is. An assignment's solution depends on nothing but itself.

use super::{GRID_PSI_RAD, GRID_X_M, Guess, agrees, level_pose};
use crate::outline::{Edge, Surfaces, UpperFace};
use crate::segments::{Levels, Step};
use hydroline_calib::Pose;
use hydroline_rigs::Mounts;
use nalgebra::{Matrix4, Vector3, Vector4};
use std::collections::BTreeSet;

/// Between two starts a step comes this near to every edge that it may lie on \[m\]: half the grid in
/// X, and half its angle at 0.15 m from the middle.
const REACH_M: f64 = 0.5 * GRID_X_M + 0.125 * 0.15;
/// A step this far beyond the end of its edge is not on it: corners shift steps by about a millimetre \[m\].
const BEYOND_M: f64 = 0.003;
/// Error of a step near a corner \[m\], and what pitch a vehicle has \[rad\] (2°): their ratio alone
/// matters, and only where fewer than four steps are seen.
const STEP_M: f64 = 3e-4;
const PITCH_RAD: f64 = 0.035;
/// Steps farther than this from their edges are no match, rms \[m\].
const MATCH_RMS_M: f64 = 0.0015;
/// Most steps and most assignments looked at: a frame of a target has four steps, and three edges
/// for each of them.
const STEPS_MOST: usize = 8;
const ASSIGNMENTS_MOST: usize = 20_000;

/// All places where the steps fit, with pitch; near `centre_m` where given (within `near_m`).
pub(crate) fn guesses(
    levels: &Levels,
    surfaces: &Surfaces,
    mounts: &Mounts,
    near: Option<(f64, f64)>,
) -> Vec<Guess> {
    let steps = super::steps_on_faces(levels, surfaces);
    if steps.len() < 3 || steps.len() > STEPS_MOST {
        return Vec::new();
    }
    let arms: Vec<Vector3<f64>> = steps
        .iter()
        .map(|(s, _)| hydroline_calib::frames::plane_to_body(mounts, s.xi_m, s.eta_m))
        .collect();
    let mut found: Vec<Guess> = Vec::new();
    for assignment in assignments(&steps, &arms, levels, surfaces, mounts, near) {
        let edges: Vec<&Edge> = assignment
            .iter()
            .zip(&steps)
            .map(|(k, (_, face))| &face.outline.edges[usize::from(*k)])
            .collect();
        let Some(guess) = solve(&edges, &arms, levels, mounts) else {
            continue;
        };
        let wanted = near.is_none_or(|(x_m, by_m)| (guess.pose.x_m - x_m).abs() < by_m);
        if wanted && agrees(&guess.pose, levels, surfaces, mounts) {
            found.push(guess);
        }
    }
    // Small pitch first: nothing else distinguishes places that fit the steps equally well.
    found.sort_by(|a, b| a.pose.theta_rad.abs().total_cmp(&b.pose.theta_rad.abs()));
    found
}

/// Which edges the steps can lie on, each such choice once.
fn assignments(
    steps: &[(&Step, &UpperFace)],
    arms: &[Vector3<f64>],
    levels: &Levels,
    surfaces: &Surfaces,
    mounts: &Mounts,
    near: Option<(f64, f64)>,
) -> BTreeSet<Vec<u16>> {
    let level = level_pose(levels, mounts, 0.0);
    let middle_xi_m = 0.5 * (steps[0].0.xi_m + steps[steps.len() - 1].0.xi_m);
    let [first_m, last_m] = surfaces.span_m;
    let count = ((last_m - first_m) / GRID_X_M).ceil().clamp(1.0, 400.0) as usize;
    let mut all = BTreeSet::new();
    for i in 0..=count {
        for psi_rad in GRID_PSI_RAD {
            let (sin, cos) = psi_rad.sin_cos();
            let pose = Pose {
                x_m: first_m + GRID_X_M * (i as f64 + 0.37) - cos * mounts.l_laser_m,
                y_m: -sin * mounts.l_laser_m + cos * middle_xi_m,
                psi_rad,
                ..level
            };
            if near.is_some_and(|(x_m, by_m)| (pose.x_m - x_m).abs() > by_m + GRID_X_M) {
                continue;
            }
            let rotation = pose.body_to_tank_rotation();
            let options: Vec<Vec<u16>> = steps
                .iter()
                .zip(arms)
                .map(|((step, face), arm)| {
                    let arm = rotation * arm;
                    edges_near(step, face, [pose.x_m + arm.x, pose.y_m + arm.y], psi_rad)
                })
                .collect();
            each_choice(&options, &mut Vec::new(), &mut all);
            if all.len() > ASSIGNMENTS_MOST {
                return all;
            }
        }
    }
    all
}

/// Edges of an upper face that look to where a step does, near its X.
fn edges_near(step: &Step, face: &UpperFace, p: [f64; 2], psi_rad: f64) -> Vec<u16> {
    let sign = if step.to_starboard { 1.0 } else { -1.0 };
    let side = [sign * psi_rad.sin(), -sign * psi_rad.cos()];
    (0u16..)
        .zip(&face.outline.edges)
        .filter(|(_, e)| {
            let [low, high] = e.x_range_m;
            (low - p[0]).max(p[0] - high) < REACH_M
                && side[0] * e.inward[0] + side[1] * e.inward[1] > 0.1
        })
        .map(|(k, _)| k)
        .collect()
}

fn each_choice(options: &[Vec<u16>], chosen: &mut Vec<u16>, all: &mut BTreeSet<Vec<u16>>) {
    let Some((first, rest)) = options.split_first() else {
        all.insert(chosen.clone());
        return;
    };
    for k in first {
        chosen.push(*k);
        each_choice(rest, chosen, all);
        chosen.pop();
    }
}

/// x, y, ψ, θ that put each step on its edge, by Gauss–Newton from the edges' own middle.
fn solve(
    edges: &[&Edge],
    arms: &[Vector3<f64>],
    levels: &Levels,
    mounts: &Mounts,
) -> Option<Guess> {
    let n = edges.len() as f64;
    let middle_m = edges.iter().map(|e| e.from_m[0] + e.to_m[0]).sum::<f64>() / (2.0 * n);
    let mut pose = Pose {
        x_m: middle_m - mounts.l_laser_m,
        ..level_pose(levels, mounts, 0.0)
    };
    let mut rms_m = f64::INFINITY;
    for _ in 0..6 {
        let rotation = pose.body_to_tank_rotation();
        let (sin, cos) = pose.psi_rad.sin_cos();
        let mut a = Matrix4::zeros();
        let mut b = Vector4::zeros();
        let mut sum = 0.0;
        for (edge, arm) in edges.iter().zip(arms) {
            let arm = rotation * arm;
            let d = edge.inside_m([pose.x_m + arm.x, pose.y_m + arm.y]);
            let [nx, ny] = edge.inward;
            // Rz Ry v: turning θ moves it along the heading by how far it lies below.
            let by_theta = arm.z * (nx * cos + ny * sin);
            let j = Vector4::new(nx, ny, ny * arm.x - nx * arm.y, by_theta);
            a += j * j.transpose();
            b -= j * d;
            sum += d * d;
        }
        rms_m = (sum / n).sqrt();
        let prior = (STEP_M / PITCH_RAD).powi(2);
        a[(3, 3)] += prior;
        b[3] -= prior * pose.theta_rad;
        let step = a.cholesky()?.solve(&b);
        pose = Pose {
            x_m: pose.x_m + step[0],
            y_m: pose.y_m + step[1],
            psi_rad: pose.psi_rad + step[2],
            ..level_pose(levels, mounts, pose.theta_rad + step[3])
        };
        let sound = pose.psi_rad.abs() < 1.2 && pose.theta_rad.abs() < 0.5;
        if !sound {
            return None;
        }
        if step.norm() < 1e-7 {
            break;
        }
    }
    let rotation = pose.body_to_tank_rotation();
    let on_edges = edges.iter().zip(arms).all(|(edge, arm)| {
        let arm = rotation * arm;
        let along = edge.along_m([pose.x_m + arm.x, pose.y_m + arm.y]);
        (-BEYOND_M..edge.length_m + BEYOND_M).contains(&along)
    });
    (on_edges && rms_m < MATCH_RMS_M && pose.psi_rad.abs() < 0.8).then_some(Guess { pose, rms_m })
}
