//! What is wrong with a set of boards, each with its own sentence.

use nalgebra::Vector3;

use super::adjust;
use super::bundle::{State, ViewTerms};
use super::residuals::{Extra, Wish, wish};
use crate::map::lm::LmError;

/// Why there is no calibration.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[allow(missing_docs)] // Each message names its fields.
pub enum FreeError {
    #[error(
        "boards in {found} images are too few, {needed} are needed; hold the board at other places, distances and tilts (15 are good)"
    )]
    TooFewBoards { found: usize, needed: usize },
    #[error(
        "all {boards} boards are parallel to within {angle_deg:.0}°: focal length and distance cannot be separated; tilt the board by 20 to 40° to all four sides, or give --intrinsics"
    )]
    Parallel { boards: usize, angle_deg: f64 },
    #[error(
        "the laser line lies on {found} of {boards} boards, {needed} are needed; hold the board so that the line crosses it{}",
        first.as_ref().map(|f| format!(" (first: {f})")).unwrap_or_default()
    )]
    TooFewLines {
        found: usize,
        boards: usize,
        needed: usize,
        first: Option<String>,
    },
    #[error(
        "the line crosses all boards at one place of the sheet ({across_mm:.0} mm apart at {far_m:.2} m): a line fixes no plane; hold the board nearer and farther, over the whole range that is to be measured"
    )]
    OneDistance { across_mm: f64, far_m: f64 },
    #[error(
        "zoom or focus changed between {before} and {after}: the focal length is {:.2} ± {:.2} % longer afterwards; calibrate with the images of one setting, and fix the lens' rings",
        100.0 * share, 100.0 * sd
    )]
    ZoomChanged {
        before: String,
        after: String,
        share: f64,
        sd: f64,
    },
    #[error(
        "the boards fit no camera: {source}; is --board the one in the images, and do all images come from one camera?"
    )]
    NoCamera { source: LmError },
}

/// Why a view was left out.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[allow(missing_docs)] // Each message names its fields.
pub enum LeftOut {
    #[error(
        "it does not fit: its nodes are off by {rms_px:.2} px, those of the others by {usual_px:.2}; was the board moved, curved, or is it another one?"
    )]
    Misfit { rms_px: f64, usual_px: f64 },
    #[error(
        "it is sheared by {shear_px:.1} px from its upper to its lower rows, as a rolling shutter shears a board that moves; hold it still, or use a global shutter"
    )]
    Sheared { shear_px: f64 },
    #[error("its pose cannot be found from its nodes")]
    NoPose,
}

/// What does not stop a calibration, and must be known.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[allow(missing_docs)] // Each message names its fields.
pub enum Reservation {
    #[error(
        "the scale is that of the board: a pitch of {:.3} mm was entered, and no image can show a wrong one; measure over ten squares with a rule, or measure a known object (--check-object)",
        1e3 * pitch_m
    )]
    Scale { pitch_m: f64 },
    #[error(
        "the line of {name} is off the sheet of the others by {off_px:.1} px and was left out; is it a reflection, or did the laser move?"
    )]
    LineOff { name: String, off_px: f64 },
    #[error(
        "the tilts of the boards span {angle_deg:.0}° only: the focal length is known to {:.1} %; tilt the board by 20 to 40°",
        100.0 * focal_sd
    )]
    FewTilts { angle_deg: f64, focal_sd: f64 },
    #[error(
        "{sheared} of {boards} boards are sheared by up to {shear_px:.1} px, as a rolling shutter shears a board that moves: hold it still"
    )]
    RollingShutter {
        sheared: usize,
        boards: usize,
        shear_px: f64,
    },
}

/// Smaller angles between boards say nothing about the focal length \[rad\].
const PARALLEL_RAD: f64 = 0.12;
/// A change of the focal length below this share does no harm that a port or a curved board would not do.
const ZOOM_SHARE: f64 = 0.004;
/// Of so many standard deviations; the break's place is sought, so that chance has as many tries as there are images.
const ZOOM_SDS: f64 = 6.0;
/// A shear below this is within what a curved board does \[px\].
const SHEAR_PX: f64 = 0.5;
/// And of so many standard deviations, and times what the others show.
const SHEAR_SDS: f64 = 6.0;
const SHEAR_TIMES: f64 = 5.0;

/// Largest angle between the boards' normals \[rad\].
pub(super) fn widest_angle_rad(state: &State) -> f64 {
    let normals: Vec<Vector3<f64>> = state
        .poses
        .iter()
        .map(|p| p.rotation.column(2).into())
        .collect();
    let angles = normals
        .iter()
        .flat_map(|a| normals.iter().map(|b| a.angle(b)));
    angles.fold(0.0, f64::max)
}

/// Boards that are all parallel.
pub(super) fn parallel(state: &State) -> Result<(), FreeError> {
    let angle = widest_angle_rad(state);
    match angle < PARALLEL_RAD {
        true => Err(FreeError::Parallel {
            boards: state.poses.len(),
            angle_deg: angle.to_degrees().ceil(),
        }),
        false => Ok(()),
    }
}

/// The break in the images' order before which the focal length is another.
pub(super) fn zoom(state: &State, views: &[ViewTerms], names: &[&str]) -> Result<(), FreeError> {
    let wishes: Vec<(usize, Wish)> = (views.iter().zip(&state.poses).enumerate())
        .filter_map(|(k, (view, pose))| Some((k, wish(&state.lens, pose, view, Extra::Focal)?)))
        .collect();
    let mean = |part: &[(usize, Wish)]| {
        let (sum, weight) = part.iter().fold((0.0, 0.0), |(s, w), (_, x)| {
            (s + x.value / (x.sd * x.sd), w + 1.0 / (x.sd * x.sd))
        });
        (sum / weight, 1.0 / weight)
    };
    let mut worst: Option<(f64, FreeError)> = None;
    for cut in 2..wishes.len().saturating_sub(1) {
        let (first, second) = wishes.split_at(cut);
        let ((a, va), (b, vb)) = (mean(first), mean(second));
        // What views scatter about their own side's mean beyond their sds is no zoom.
        let scatter = |part: &[(usize, Wish)], mean: f64| -> f64 {
            part.iter()
                .map(|(_, x)| ((x.value - mean) / x.sd).powi(2))
                .sum()
        };
        let free = (wishes.len() - 2) as f64;
        let excess = ((scatter(first, a) + scatter(second, b)) / free).max(1.0);
        let sd = (excess * (va + vb)).sqrt();
        let sds = (b - a).abs() / sd;
        if (b - a).abs() > ZOOM_SHARE
            && sds > ZOOM_SDS
            && worst.as_ref().is_none_or(|(s, _)| sds > *s)
        {
            let name = |k: usize| names[wishes[k].0].to_owned();
            let error = FreeError::ZoomChanged {
                before: name(cut - 1),
                after: name(cut),
                share: b - a,
                sd,
            };
            worst = Some((sds, error));
        }
    }
    worst.map_or(Ok(()), |(_, error)| Err(error))
}

/// Views that are sheared: index and by how much \[px\].
pub(super) fn sheared(state: &State, views: &[ViewTerms]) -> Vec<(usize, f64)> {
    let shears: Vec<(usize, Wish)> = (views.iter().zip(&state.poses).enumerate())
        .flat_map(|(k, (view, pose))| {
            let along = |axis| wish(&state.lens, pose, view, Extra::Shear(axis));
            [0, 1]
                .into_iter()
                .filter_map(along)
                .map(move |w| (k, w))
                .collect::<Vec<_>>()
        })
        .collect();
    let usual = adjust::scale(shears.iter().map(|s| s.1.value.abs()).collect(), 0.6745);
    let mut found: Vec<(usize, f64)> = (shears.iter())
        .filter(|(_, w)| {
            let size = w.value.abs();
            size > SHEAR_PX && size > SHEAR_SDS * w.sd && size > SHEAR_TIMES * usual
        })
        .map(|(k, w)| (*k, w.value.abs()))
        .collect();
    found.dedup_by_key(|f| f.0);
    found
}
