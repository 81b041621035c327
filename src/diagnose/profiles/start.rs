//! Poses to begin with: the joint pose fit under the map that a hypothesis makes.

use super::geometry::Geometry;
use super::observe::{ImageRun, Seen};
use super::prior::Motion;
use hydroline_calib::plane::{Fan, ImageSize, PlaneMap, PlanePoint};
use hydroline_calib::{Calibration, IdealMap, Pose};
use hydroline_pose::initial::{self, Guess};
use hydroline_pose::joint::{Hint, PoseFitter};
use hydroline_rigs::Rig;
use nalgebra::Matrix2;
use std::sync::Arc;

/// Share of frames that must give a pose.
const LEAST_SHARE: f64 = 0.5;
/// Frames tried before giving up on a hypothesis that finds nothing.
const TRIED: usize = 6;

/// The map from image to sheet under some optics: the sheet's points are given by ξ = −y_b and
/// η = h_centre − z_b, as if the sheet stood upright.
struct SheetMap {
    geometry: Geometry,
    h_centre_m: f64,
    image: ImageSize,
    fan: Fan,
    describes: Calibration,
}

impl SheetMap {
    fn plane(&self, column_px: f64, row_px: f64) -> Option<(f64, f64)> {
        let p = self
            .geometry
            .on_sheet(&self.geometry.ray(column_px, row_px))?;
        Some((-p.y, self.h_centre_m - p.z))
    }
}

impl PlaneMap for SheetMap {
    fn to_plane(&self, column_px: f64, row_px: f64) -> Option<PlanePoint> {
        if !self.image.contains(column_px, row_px) {
            return None;
        }
        let (xi_m, eta_m) = self.plane(column_px, row_px)?;
        self.fan.contains(xi_m, eta_m).then(|| PlanePoint {
            xi_m,
            eta_m,
            covariance_m2: Matrix2::zeros(),
        })
    }

    fn to_image(&self, xi_m: f64, eta_m: f64) -> Option<(f64, f64)> {
        // Newton from the image's middle: the map is nearly affine.
        let (mut c, mut r) = (
            0.5 * f64::from(self.image.width_px),
            0.5 * f64::from(self.image.height_px),
        );
        for _ in 0..20 {
            let (xi, eta) = self.plane(c, r)?;
            let back = self.slopes(c, r)?.try_inverse()?;
            let step = back * nalgebra::Vector2::new(xi_m - xi, eta_m - eta);
            (c, r) = (c + step.x, r + step.y);
            if step.amax() < 1e-9 {
                return self.image.contains(c, r).then_some((c, r));
            }
        }
        None
    }

    fn jacobian(&self, column_px: f64, row_px: f64) -> Option<Matrix2<f64>> {
        self.to_plane(column_px, row_px)?;
        self.slopes(column_px, row_px)
    }

    fn describe(&self) -> Calibration {
        self.describes.clone()
    }
}

impl SheetMap {
    fn slopes(&self, c: f64, r: f64) -> Option<Matrix2<f64>> {
        let at = |dc: f64, dr: f64| self.plane(c + dc, r + dr);
        let ((xl, el), (xr, er)) = (at(-0.5, 0.0)?, at(0.5, 0.0)?);
        let ((xu, eu), (xd, ed)) = (at(0.0, -0.5)?, at(0.0, 0.5)?);
        Some(Matrix2::new(xr - xl, xd - xu, er - el, ed - eu))
    }
}

/// Poses of all frames of all runs under a geometry; `None` where too few frames give one.
///
/// `coarse` = from the steps first, level: a hypothesis among many is not worth the grey levels'
/// fit. Frames without get what their neighbours are off the rig's motion.
pub fn poses(
    rig: &Rig,
    geometry: &Geometry,
    runs: &[ImageRun],
    motions: &[Motion],
    coarse: bool,
) -> Option<Vec<Vec<[f64; 6]>>> {
    let map = SheetMap {
        geometry: geometry.clone(),
        h_centre_m: rig.mounts.h_centre_m,
        image: ImageSize::of(&rig.camera),
        fan: Fan::of(&rig.laser, &rig.mounts),
        describes: IdealMap::of(rig).describe(),
    };
    let fitter = PoseFitter::new(rig, Arc::new(map));
    let (mut found, mut all) = (0usize, 0usize);
    let mut out = Vec::with_capacity(runs.len());
    for (run, motion) in runs.iter().zip(motions) {
        let mut off: Vec<Option<[f64; 6]>> = Vec::with_capacity(run.frames.len());
        let mut last = [0.0; 6];
        for (seen, mean) in run.frames.iter().zip(&motion.mean) {
            all += 1;
            if all > TRIED && found == 0 {
                return None;
            }
            let hint = Hint {
                x_m: Some(mean[0] + last[0]),
                ..Hint::default()
            };
            let grey = || {
                let fit = fitter.fit(&seen.image, &seen.profile, &hint).ok()?;
                Some((fit.pose, fit.measured))
            };
            // Where the grey levels do not fit, steps and lines may still say about where it is.
            let steps = || coarse_pose(&fitter, seen, mean[0] + last[0]).map(|p| (p, [true; 6]));
            let fit = if coarse {
                steps().or_else(grey)
            } else {
                grey().or_else(steps)
            };
            off.push(fit.map(|(pose, measured)| {
                found += 1;
                let pose = pose.to_array();
                last = std::array::from_fn(|d| {
                    if measured[d] {
                        pose[d] - mean[d]
                    } else {
                        last[d]
                    }
                });
                last
            }));
        }
        out.push(filled(&off, &motion.mean));
    }
    (found as f64 >= LEAST_SHARE * all as f64 && found > 0).then_some(out)
}

/// A place where the steps lie on the target, θ = 0: the nearest to `x_m`.
fn coarse_pose(fitter: &PoseFitter, seen: &Seen, x_m: f64) -> Option<Pose> {
    let levels = fitter.levels(&seen.image, &seen.profile).ok()?;
    if levels.steps.is_empty() {
        return Some(initial::level_pose(&levels, fitter.mounts(), 0.0)).map(|p| Pose { x_m, ..p });
    }
    let all = initial::guesses(&levels, fitter.surfaces(), fitter.mounts());
    let away = |g: &Guess| (g.pose.x_m - x_m).abs() + g.rms_m * 10.0;
    all.iter()
        .min_by(|a, b| away(a).total_cmp(&away(b)))
        .map(|g| g.pose)
}

/// `mean` moved by what is known of each frame, or else by what is of the nearest one.
pub(super) fn filled(off: &[Option<[f64; 6]>], mean: &[[f64; 6]]) -> Vec<[f64; 6]> {
    let near = |k: usize| {
        off.iter()
            .enumerate()
            .filter_map(|(i, o)| Some((i.abs_diff(k), (*o)?)))
            .min_by_key(|(away, _)| *away)
            .map_or([0.0; 6], |(_, o)| o)
    };
    mean.iter()
        .enumerate()
        .map(|(k, m)| {
            let o = near(k);
            std::array::from_fn(|d| m[d] + o[d])
        })
        .collect()
}
