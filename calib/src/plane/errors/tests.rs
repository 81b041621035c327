use super::*;
use crate::Calibration;
use crate::plane::PlanePoint;

/// A scale and an offset of ξ that are correlated, and a turn, in part of the image.
struct Known;

const SIZE: ImageSize = ImageSize {
    width_px: 720,
    height_px: 576,
};

impl PlaneMap for Known {
    fn to_plane(&self, _: f64, _: f64) -> Option<PlanePoint> {
        None
    }
    fn to_image(&self, _: f64, _: f64) -> Option<(f64, f64)> {
        None
    }
    fn jacobian(&self, _: f64, _: f64) -> Option<nalgebra::Matrix2<f64>> {
        None
    }
    fn describe(&self) -> Calibration {
        unreachable!("not asked for")
    }
    fn parameter_slopes(&self, column_px: f64, row_px: f64) -> Option<Matrix2xX<f64>> {
        let [x, y] = [1e-3 * (column_px - 360.0), 1e-3 * (row_px - 288.0)];
        (y.abs() < 0.2).then(|| Matrix2xX::from_row_slice(&[x, 1.0, y, 0.0, 0.0, -x]))
    }
    fn parameter_covariance(&self) -> DMatrix<f64> {
        DMatrix::from_row_slice(3, 3, &[4e-6, 1e-7, 0.0, 1e-7, 1e-8, 0.0, 0.0, 0.0, 1e-6])
    }
}

#[test]
fn the_displacements_have_the_covariance_of_the_parameters() {
    let errors = MapErrors::of(&Known, SIZE);
    assert_eq!(errors.len(), 3);
    let places = [[30.0, 120.0], [360.0, 288.0], [700.0, 400.0]];
    for a in places {
        for b in places {
            let found: nalgebra::Matrix2<f64> = errors
                .at(a[0], a[1])
                .zip(errors.at(b[0], b[1]))
                .map(|(a, b)| nalgebra::Vector2::from(a) * nalgebra::Vector2::from(b).transpose())
                .sum();
            let [at_a, at_b] = [a, b].map(|p| Known.parameter_slopes(p[0], p[1]).unwrap());
            let asked = at_a * Known.parameter_covariance() * at_b.transpose();
            let off = (asked - found).norm();
            assert!(
                off < 0.01 * asked.norm() + 1e-12,
                "{a:?} {b:?}: {found} {asked}"
            );
        }
    }
}

#[test]
fn beyond_the_region_the_displacements_go_on_as_at_its_border() {
    let errors = MapErrors::of(&Known, SIZE);
    for at in errors.at(360.0, 0.0) {
        assert!(at.iter().all(|v| v.is_finite()));
    }
    assert!(errors.at(360.0, 0.0).any(|at| at[0].abs() > 1e-5));
}

#[test]
fn an_exact_map_has_none() {
    let rig = hydroline_rigs::Rig::builtin("lshpi").unwrap();
    let map = crate::IdealMap::of(&rig);
    assert!(MapErrors::of(&map, ImageSize::of(&rig.camera)).is_empty());
}
