//! Table 3: accuracy of each formula in its own motion.

use super::chain::{Bench, Reading, Seen};
use super::{Motion, ReproduceError};
use hydroline_pose::Pose;
use hydroline_pose::joint::Held;
use serde::Serialize;

/// Places this close to a joint or widest point are counted apart \[m\] (issue: 8 mm).
const CORNER_M: f64 = 0.008;

/// One row of the table, errors in mm or degrees.
#[derive(Debug, Clone, PartialEq, Serialize, schemars::JsonSchema)]
pub struct Row {
    /// Motion that the formula measures.
    pub motion: Motion,
    /// Unit of the errors.
    pub unit: &'static str,
    /// Frames rendered.
    pub frames: usize,
    /// Least and greatest error in the paper.
    pub paper: [f64; 2],
    /// Whole-pixel stripe and single points.
    pub whole_pixel: [f64; 2],
    /// The same formula on our sub-pixel stripe.
    pub formula: [f64; 2],
    /// Ours: the formula where it is enough (heave, roll, pitch, sway), for surge and yaw the photometric
    /// fit under the formula's own assumption (θ held at 0).
    pub ours: [f64; 2],
    /// Ours within 8 mm of a joint or widest point (surge only).
    pub ours_at_corners: Option<[f64; 2]>,
    /// Frames without an answer: whole-pixel, formula, ours.
    pub missing: [usize; 3],
}

/// Motion, the range of its animation in mm or degrees, and the errors that the paper prints.
const ROWS: [(Motion, [f64; 2], [f64; 2]); 6] = [
    (Motion::Surge, [0.0, 200.0], [-0.8, 0.7]),
    (Motion::Sway, [0.0, 280.0], [-0.2, 0.6]),
    (Motion::Heave, [0.0, 420.0], [-0.6, 0.7]),
    (Motion::Roll, [-20.0, 20.0], [-0.2, 0.2]),
    (Motion::Pitch, [-20.0, 20.0], [-0.2, 0.7]),
    (Motion::Yaw, [0.0, 34.0], [-0.6, 0.8]),
];

/// Computes the table from every `every`-th frame of the paper's animations (1 = all).
///
/// # Errors
/// [`ReproduceError`].
pub fn table3(every: usize) -> Result<Vec<Row>, ReproduceError> {
    let one = |(motion, range, paper)| one(motion, range, paper, every.max(1));
    ROWS.into_iter().map(one).collect()
}

fn one(
    motion: Motion,
    [low, high]: [f64; 2],
    paper: [f64; 2],
    every: usize,
) -> Result<Row, ReproduceError> {
    let increment = if motion.index() < 3 { 1.0 } else { 0.1 };
    let bench = Bench::of(motion)?;
    let per_si = motion.per_si();
    let start = start(motion);
    let count = ((high - low) / increment).round() as usize;
    // Thinned about the level frame, which roll and pitch are measured from.
    let level = (-low / increment).round().max(0.0) as usize;
    let values: Vec<f64> = (level % every..=count)
        .step_by(every)
        .map(|k| (low + increment * k as f64) / per_si)
        .collect();
    let poses: Vec<Pose> = values.iter().map(|v| moved(&start, motion, *v)).collect();
    let held = Held {
        theta_rad: Some(0.0),
        thickness: false,
    };
    let whole = bench.see(&poses, Reading::WholePixel, None);
    let fine = bench.see(
        &poses,
        Reading::SubPixel,
        matches!(motion, Motion::Surge | Motion::Yaw).then_some(held),
    );
    let formula = |seen: &[Seen]| -> Vec<Option<f64>> {
        // The paper's start: the first frame (roll and pitch: the level one).
        let reference = values.iter().position(|v| v.abs() < 1e-9).unwrap_or(0);
        let Some(mut first) = seen.get(reference).cloned() else {
            return Vec::new();
        };
        // Heave starts at a stated distance from the floor (Table 3): were the first whole pixel
        // its own reference, half a pixel of it would lie in every frame after it, and the paper's
        // errors lie evenly about zero.
        if motion == Motion::Heave
            && let (Some(line), Some(level)) = (
                &mut first.line,
                start.level_in_plane(&bench.rig.mounts, 0.0),
            )
        {
            line.0 = level.eta_at_zero_m;
        }
        let errors = seen.iter().zip(&poses).zip(&values).map(|((s, pose), v)| {
            let value = bench.formula(motion, s, &first, pose, &poses[reference], 0.0)?;
            Some((value - v) * per_si)
        });
        errors.collect()
    };
    let (by_pixel, by_formula) = (formula(&whole), formula(&fine));
    let first = fine
        .first()
        .and_then(|s| s.joint.as_ref())
        .map(|j| j.pose.to_array()[motion.index()]);
    let ours: Vec<Option<f64>> = match motion {
        Motion::Surge | Motion::Yaw => {
            let errors = fine.iter().zip(&values).map(|(s, v)| {
                Some((s.joint.as_ref()?.pose.to_array()[motion.index()] - first? - v) * per_si)
            });
            errors.collect()
        }
        _ => by_formula.clone(),
    };
    let at_corner: Vec<bool> = poses
        .iter()
        .map(|p| motion == Motion::Surge && from_corner_m(p, &bench) < CORNER_M)
        .collect();
    let away = ours.iter().zip(&at_corner).map(|(e, c)| e.filter(|_| !c));
    let near: Vec<Option<f64>> = ours
        .iter()
        .zip(&at_corner)
        .map(|(e, c)| e.filter(|_| *c))
        .collect();
    let missing = |errors: &[Option<f64>]| errors.iter().filter(|e| e.is_none()).count();
    Ok(Row {
        motion,
        unit: motion.unit(),
        frames: poses.len(),
        paper,
        whole_pixel: range(by_pixel.iter().copied()),
        formula: range(by_formula.iter().copied()),
        ours: range(away),
        ours_at_corners: (motion == Motion::Surge).then(|| range(near.into_iter())),
        missing: [missing(&by_pixel), missing(&by_formula), missing(&ours)],
    })
}

/// Where a motion starts: the sheet well inside the target, its ψ_S 0 but in yaw.
fn start(motion: Motion) -> Pose {
    let (x_m, height_m, psi_deg) = match motion {
        Motion::Surge => (-0.20, 0.83, 0.0),
        Motion::Sway => (0.2, 0.83, 0.0),
        Motion::Heave => (0.2, 0.93, 0.0),
        Motion::Roll | Motion::Pitch => (0.2, 0.68, 0.0),
        Motion::Yaw => (0.35, 0.83, -17.0),
    };
    Pose {
        x_m,
        z_m: -height_m,
        psi_rad: f64::to_radians(psi_deg),
        ..Pose::default()
    }
}

fn moved(start: &Pose, motion: Motion, by: f64) -> Pose {
    let mut pose = start.to_array();
    pose[motion.index()] += by;
    Pose::from_array(pose)
}

/// Distance of the sheet from the next joint or widest point, ψ = 0 \[m\].
fn from_corner_m(pose: &Pose, bench: &Bench) -> f64 {
    let half = bench.chain.as_ref().map_or(1.0, |c| 0.5 * c.pitch_m());
    let x = (pose.x_m + bench.rig.mounts.l_laser_m).rem_euclid(half);
    x.min(half - x)
}

/// Least and greatest; 0, 0 of nothing.
fn range(errors: impl Iterator<Item = Option<f64>>) -> [f64; 2] {
    let all: Vec<f64> = errors.flatten().collect();
    if all.is_empty() {
        return [0.0; 2];
    }
    [
        all.iter().copied().fold(f64::INFINITY, f64::min),
        all.iter().copied().fold(f64::NEG_INFINITY, f64::max),
    ]
}
