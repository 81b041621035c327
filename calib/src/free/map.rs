//! The map that boards in the hand give: a pixel's ray, and where it meets the sheet.
//!
//! Coordinates: ξ to the image's left, η up within the sheet; zero where the optical axis meets it.

use nalgebra::{DMatrix, Matrix2, Matrix2xX, Matrix3x2, SVector, Vector2, Vector3};
use serde::{Deserialize, Serialize};

use super::bundle::SHARED;
use super::camera::{CAMERA, Lens, MEDIUM, STEPS};
use super::sheet::{CONE, LaserSurface, SHEET};
use crate::map::geometry::rows;
use crate::map::refractive::Known;
use crate::map::{PointAndSlopes, Region};
use crate::plane::PlanePoint;

/// A camera and a laser sheet, fitted together.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SheetMap {
    /// Camera and port.
    pub lens: Lens,
    /// Laser sheet, in the camera's frame.
    pub sheet: LaserSurface,
    /// Zero of ξ and η, camera frame \[m\].
    pub origin_m: [f64; 3],
    /// Directions of ξ and η, camera frame.
    pub axes: [[f64; 3]; 2],
    /// Where the line was seen on boards.
    region: Region,
    #[serde(with = "rows")]
    covariance: DMatrix<f64>,
}

/// Half width of the differences of the pixel \[px\].
const STEP_PX: f64 = 1e-3;

impl SheetMap {
    /// A map in the sheet's own axes; `covariance` of the camera's numbers, then the sheet's; `met`: where the line was
    /// seen, camera frame \[m\].
    pub(super) fn new(
        lens: Lens,
        sheet: LaserSurface,
        covariance: DMatrix<f64>,
        met: &[Vector3<f64>],
    ) -> Self {
        let frame = sheet.frame();
        let axis = sheet.meet(&Vector3::zeros(), &Vector3::z());
        let mean = met.iter().sum::<Vector3<f64>>() / met.len().max(1) as f64;
        // An axis that runs nearly along the sheet meets it far from anything that was seen.
        let near = |p: &Vector3<f64>| (p - mean).norm() < 2.0 * mean.norm();
        let origin = axis.filter(near).unwrap_or(mean);
        let mut map = SheetMap {
            lens,
            sheet,
            origin_m: origin.into(),
            axes: [frame.column(0).into(), frame.column(1).into()],
            region: Region::default(),
            covariance,
        };
        map.region = Region::hull(met.iter().map(|p| map.coordinates(p).into()));
        map
    }

    fn frame(&self) -> Matrix3x2<f64> {
        let [xi, eta] = self.axes.map(Vector3::from);
        Matrix3x2::from_columns(&[xi, eta])
    }

    /// (ξ, η) of a point in the camera's frame \[m\].
    pub fn coordinates(&self, point: &Vector3<f64>) -> Vector2<f64> {
        self.frame().tr_mul(&(point - Vector3::from(self.origin_m)))
    }

    /// The sheet's point at a pixel, camera frame \[m\].
    pub fn point(&self, column_px: f64, row_px: f64) -> Option<Vector3<f64>> {
        let (from, along) = self.lens.ray(&Vector2::new(column_px, row_px))?;
        self.sheet.meet(&from, &along)
    }

    /// Covariance of the camera's numbers, then the sheet's.
    pub fn covariance(&self) -> &DMatrix<f64> {
        &self.covariance
    }

    /// The camera's pupil in the sheet's coordinates (ξ, η) \[m\].
    pub fn camera_m(&self) -> [f64; 2] {
        self.coordinates(&Vector3::zeros()).into()
    }

    /// The same camera, port and sheet in a medium of another index; `None` without a port: what the camera is like
    /// there was never seen.
    pub fn in_medium(&self, index: Known) -> Option<Self> {
        self.lens.plate?;
        let mut other = self.clone();
        other.lens.numbers[MEDIUM] = index.value;
        // The new index has nothing to do with the old one's.
        other.covariance.row_mut(MEDIUM).fill(0.0);
        other.covariance.column_mut(MEDIUM).fill(0.0);
        other.covariance[(MEDIUM, MEDIUM)] = index.sd * index.sd;
        Some(other)
    }

    /// See [`crate::map::FittedMap::to_plane`].
    pub fn to_plane(&self, column_px: f64, row_px: f64) -> Option<PlanePoint> {
        let pixel = Vector2::new(column_px, row_px);
        let (from, along) = self.lens.ray(&pixel)?;
        let point = self.sheet.meet(&from, &along)?;
        let at = self.coordinates(&point);
        if !self.region.contains(at[0], at[1]) {
            return None;
        }
        let by = self.moved(&pixel)?;
        let covariance = &by * &self.covariance * by.transpose();
        Some(PlanePoint {
            xi_m: at[0],
            eta_m: at[1],
            covariance_m2: Matrix2::from_fn(|i, k| covariance[(i, k)]),
        })
    }

    /// How the point seen at a pixel moves with the camera's numbers, then the sheet's.
    fn moved(&self, pixel: &Vector2<f64>) -> Option<Matrix2xX<f64>> {
        let (from, along) = self.lens.ray(pixel)?;
        let point = self.sheet.meet(&from, &along)?;
        let frame = self.frame();
        let mut by = Matrix2xX::zeros(SHARED);
        for k in (0..CAMERA).filter(|k| self.covariance[(*k, *k)] > 0.0) {
            let moved = |d: f64| {
                let (from, along) = self.lens.moved(k, d).ray(pixel)?;
                self.sheet.meet(&from, &along)
            };
            let slope = (moved(STEPS[k])? - moved(-STEPS[k])?) / (2.0 * STEPS[k]);
            by.set_column(k, &frame.tr_mul(&slope));
        }
        // The sheet moves along its normal, the point along its ray.
        let slope = self.sheet.gradient(&point).dot(&along);
        let moves: SVector<f64, SHEET> = self.sheet.by_numbers(&point) / -slope;
        let ray = frame.tr_mul(&along);
        for k in 0..SHEET {
            by.set_column(CAMERA + k, &(ray * moves[k]));
        }
        Some(by)
    }

    /// See [`crate::map::FittedMap::point_and_slopes`].
    pub fn point_and_slopes(&self, column_px: f64, row_px: f64) -> Option<PointAndSlopes> {
        let pixel = Vector2::new(column_px, row_px);
        let (from, along) = self.lens.ray(&pixel)?;
        let at = self.coordinates(&self.sheet.meet(&from, &along)?);
        self.region.contains(at[0], at[1]).then_some(())?;
        Some((at.into(), self.moved(&pixel)?))
    }

    /// See [`crate::map::FittedMap::to_image`].
    pub fn to_image(&self, xi_m: f64, eta_m: f64) -> Option<(f64, f64)> {
        let mut point = Vector3::from(self.origin_m) + self.frame() * Vector2::new(xi_m, eta_m);
        let normal = self.sheet.normal();
        point -= normal * self.sheet.distance_m(&point);
        let pixel = self.lens.project(&point)?;
        Some((pixel[0], pixel[1]))
    }

    /// See [`crate::map::FittedMap::jacobian`].
    pub fn jacobian(&self, column_px: f64, row_px: f64) -> Option<Matrix2<f64>> {
        let at = self.coordinates(&self.point(column_px, row_px)?);
        self.region.contains(at[0], at[1]).then_some(())?;
        let to = |c: f64, r: f64| Some(self.coordinates(&self.point(column_px + c, row_px + r)?));
        let across = to(STEP_PX, 0.0)? - to(-STEP_PX, 0.0)?;
        let down = to(0.0, STEP_PX)? - to(0.0, -STEP_PX)?;
        Some(Matrix2::from_columns(&[across, down]) / (2.0 * STEP_PX))
    }

    /// Where the map holds.
    pub fn region(&self) -> &Region {
        &self.region
    }

    /// Whether the sheet departs from a plane.
    pub fn is_cone(&self) -> bool {
        self.sheet.numbers[CONE..].iter().any(|k| *k != 0.0)
    }

    /// Numbers that a fit can have; for files.
    pub(crate) fn is_sound(&self) -> bool {
        let n = &self.lens.numbers;
        let finite = n
            .iter()
            .chain(&self.sheet.numbers)
            .chain(&self.origin_m)
            .chain(self.axes.iter().flatten());
        self.covariance.nrows() == SHARED
            && finite.into_iter().all(|v| v.is_finite())
            && n[0] > 1.0
            && n[1] > 0.1
            && (0.9..3.0).contains(&n[MEDIUM])
            && self
                .lens
                .plate
                .is_none_or(|p| (0.0..1.0).contains(&p.glass_m) && (0.9..3.0).contains(&p.n_glass))
    }
}
