//! Figures 12, 13 and 17.

use super::chain::{Bench, Reading};
use super::figure::{Figure, Series};
use super::surge::{self, Disturbance};
use super::{Motion, ReproduceError};
use hydroline_pose::Pose;

/// CG above the floor in the pitch animations \[m\] (Table 3).
const HEIGHT_M: f64 = 0.68;
/// Heave disturbance (Table 5) \[m\].
const HEAVE_M: f64 = 0.01;

fn pitches(every: usize) -> Vec<f64> {
    (-200..=200)
        .step_by(every.max(1))
        .map(|k| f64::from(k) * 0.1)
        .collect()
}

fn at(theta_deg: f64, lower_m: f64) -> Pose {
    Pose {
        x_m: 0.2,
        z_m: -HEIGHT_M + lower_m,
        theta_rad: theta_deg.to_radians(),
        ..Pose::default()
    }
}

/// Figure 12: pitch by Eq. 5 when the vehicle is 10 mm lower or higher than Eq. 5 takes it to be.
///
/// # Errors
/// [`ReproduceError`].
pub fn figure12(every: usize) -> Result<Figure, ReproduceError> {
    let bench = Bench::of(Motion::Pitch)?;
    let pitches = pitches(every);
    let level = at(0.0, 0.0);
    let reference = bench.see(&[level], Reading::SubPixel, None);
    let reference = reference.first().ok_or(ReproduceError::NoReference {
        motion: Motion::Pitch,
    })?;
    let mut series = vec![Series {
        name: "actual".to_owned(),
        points: pitches.iter().map(|p| [*p, *p]).collect(),
        dots: false,
    }];
    let mut notes = Vec::new();
    for (name, lower_m) in [("10 mm down", HEAVE_M), ("10 mm up", -HEAVE_M)] {
        let poses: Vec<Pose> = pitches.iter().map(|p| at(*p, lower_m)).collect();
        let seen = bench.see(&poses, Reading::SubPixel, None);
        let points: Vec<[f64; 2]> = seen
            .iter()
            .zip(&poses)
            .zip(&pitches)
            .filter_map(|((s, pose), p)| {
                let theta = bench.formula(Motion::Pitch, s, reference, pose, &level, 0.0)?;
                Some([*p, theta.to_degrees()])
            })
            .collect();
        for marked in [20.0, -15.0] {
            let near = points
                .iter()
                .min_by(|a, b| (a[0] - marked).abs().total_cmp(&(b[0] - marked).abs()));
            if let Some(p) = near {
                notes.push(format!(
                    "{name}: at {:.1} deg the formula is off by {:.2} deg",
                    p[0],
                    (p[1] - p[0]).abs()
                ));
            }
        }
        let lost = pitches.len() - points.len();
        if lost > 0 {
            notes.push(format!(
                "{name}: for {lost} of {} pitches Eq. 5 has no solution, the line lies nearer than any pitch brings it",
                pitches.len()
            ));
        }
        series.push(Series {
            name: name.to_owned(),
            points,
            dots: true,
        });
    }
    Ok(Figure {
        title: "Pitch by Eq. 5 under a heave of 10 mm (paper, Fig. 12)".to_owned(),
        axes: [
            "actual pitch [deg]".to_owned(),
            "calculated pitch [deg]".to_owned(),
        ],
        series,
        notes,
    })
}

/// Figure 13: where the line lies in the laser plane as the vehicle pitches.
///
/// # Errors
/// [`ReproduceError`].
pub fn figure13(every: usize) -> Result<Figure, ReproduceError> {
    let bench = Bench::of(Motion::Pitch)?;
    let pitches = pitches(every);
    let poses: Vec<Pose> = pitches.iter().map(|p| at(*p, 0.0)).collect();
    let measured = bench.see(&poses, Reading::SubPixel, None);
    let points = measured
        .iter()
        .zip(&pitches)
        .filter_map(|(s, p)| Some([*p, s.line?.0 * 1e3]))
        .collect();
    let exact = poses
        .iter()
        .zip(&pitches)
        .filter_map(|(pose, p)| {
            let line = pose.level_in_plane(&bench.rig.mounts, 0.0)?;
            Some([*p, line.eta_at_zero_m * 1e3])
        })
        .collect();
    Ok(Figure {
        title: "Pitch and the line's place in the laser plane (paper, Fig. 13)".to_owned(),
        axes: ["pitch [deg]".to_owned(), "eta [mm]".to_owned()],
        series: vec![
            Series {
                name: "Eq. 5".to_owned(),
                points: exact,
                dots: false,
            },
            Series {
                name: "measured".to_owned(),
                points,
                dots: true,
            },
        ],
        notes: Vec::new(),
    })
}

/// Figure 17: ψ_S,i of the surge run at 4 N, without and with disturbances.
///
/// # Errors
/// [`ReproduceError`].
pub fn figure17(every: usize) -> Result<Figure, ReproduceError> {
    let mut series = Vec::new();
    let mut notes = Vec::new();
    for (name, disturbance) in [
        ("no disturbance", Disturbance::None),
        ("pitch and yaw disturbances", Disturbance::PitchAndYaw),
    ] {
        let angles = surge::angles(disturbance, every)?;
        let points: Vec<[f64; 2]> = angles
            .t_s
            .iter()
            .zip(&angles.psi_deg)
            .filter_map(|(t, psi)| Some([*t, (*psi)?]))
            .collect();
        let mean = points.iter().map(|p| p[1]).sum::<f64>() / points.len().max(1) as f64;
        notes.push(format!("{name}: mean psi_S {mean:.2} deg"));
        series.push(Series {
            name: name.to_owned(),
            points,
            dots: true,
        });
    }
    Ok(Figure {
        title: "psi_S,i obtained from laser images at X = 4 N (paper, Fig. 17)".to_owned(),
        axes: ["time [s]".to_owned(), "psi_S,i [deg]".to_owned()],
        series,
        notes,
    })
}
