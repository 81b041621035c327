use super::*;
use crate::camera::{Pinhole, Sheet};
use crate::frames::body_to_plane;
use hydroline_rigs::Mounts;
use nalgebra::Vector3;
use proptest::prelude::*;
use proptest::test_runner::RngSeed;

fn lshpi() -> Rig {
    Rig::builtin("lshpi").unwrap()
}

/// Where a pixel's ray meets the sheet, body frame \[m\].
fn meet_sheet(
    camera: &Pinhole,
    mounts: &Mounts,
    [column_px, row_px]: [f64; 2],
) -> Option<Vector3<f64>> {
    Sheet::of(mounts).meet(&camera.position_m, &camera.ray(column_px, row_px))
}

/// A rig with its camera somewhere else.
fn moved(tilt_deg: f64, l_camera_m: f64, h_camera_m: f64, fy_over_fx: f64) -> Rig {
    let mut rig = lshpi();
    rig.mounts.camera_tilt_rad = tilt_deg.to_radians();
    rig.mounts.l_camera_m = l_camera_m;
    rig.mounts.h_camera_m = h_camera_m;
    rig.camera.fy_px *= fy_over_fx;
    rig
}

proptest! {
    #![proptest_config(ProptestConfig { rng_seed: RngSeed::Fixed(1), failure_persistence: None, ..ProptestConfig::default() })]

    /// Eqs. 11-12 are the intersection of a pixel's ray with the sheet.
    #[test]
    fn equations_agree_with_ray_and_plane(
        col in -0.5..719.5, row in -0.5..575.5,
        tilt in 25.0..75.0, l_camera in 0.05..0.5, h_camera in -0.1..0.5, ratio in 0.8..1.25,
    ) {
        let rig = moved(tilt, l_camera, h_camera, ratio);
        let camera = Pinhole::new(&rig.camera, &rig.mounts);
        let ours = IdealMap::of(&rig).unlimited(col, row);
        let met = meet_sheet(&camera, &rig.mounts, [col, row]);
        match (ours, met) {
            (Some((xi, eta)), Some(body)) => {
                let want = body_to_plane(&rig.mounts, &body);
                // 1e-12 m per metre: rays that graze the sheet meet it far away.
                let scale = 1.0 + want.eta_m.abs() + want.xi_m.abs();
                prop_assert!((xi - want.xi_m).abs() < 1e-12 * scale * scale, "{xi} {want:?}");
                prop_assert!((eta - want.eta_m).abs() < 1e-12 * scale * scale, "{eta} {want:?}");
            }
            (None, None) => {}
            other => prop_assert!(false, "{other:?}"),
        }
    }

    /// The same on the paper's own rig, to 1e-12 m without a scale.
    #[test]
    fn equations_agree_on_the_papers_rig(col in -0.5..719.5, row in -0.5..575.5) {
        let rig = lshpi();
        let (xi, eta) = IdealMap::of(&rig).unlimited(col, row).unwrap();
        let body = meet_sheet(&Pinhole::new(&rig.camera, &rig.mounts), &rig.mounts, [col, row]).unwrap();
        let want = body_to_plane(&rig.mounts, &body);
        prop_assert!((xi - want.xi_m).abs() < 1e-12 && (eta - want.eta_m).abs() < 1e-12);
    }

    #[test]
    fn image_and_plane_are_inverse(col in -0.5..719.5, row in -0.5..575.5) {
        let map = IdealMap::of(&lshpi());
        if let Some(p) = map.to_plane(col, row) {
            // The point may lie on the very edge of the image; there rounding decides.
            if let Some((c, r)) = map.to_image(p.xi_m, p.eta_m) {
                prop_assert!((c - col).abs() < 1e-9 && (r - row).abs() < 1e-9);
            } else {
                prop_assert!(!(0.0..=719.0).contains(&col) || !(0.0..=575.0).contains(&row)
                    || !map.parameters.fan.contains(p.xi_m * (1.0 + 1e-9), p.eta_m));
            }
        }
    }

    #[test]
    fn jacobian_is_the_derivative(col in 5.0..714.0, row in 5.0..570.0, tilt in 35.0..60.0, ratio in 0.8..1.25) {
        let map = IdealMap::of(&moved(tilt, 0.19, 0.22, ratio));
        let Some(exact) = map.jacobian(col, row) else { return Ok(()) };
        let h = 1e-4;
        let at = |c, r| map.unlimited(c, r).unwrap();
        let (right, left) = (at(col + h, row), at(col - h, row));
        let (below, above) = (at(col, row + h), at(col, row - h));
        let numeric = Matrix2::new(
            (right.0 - left.0) / (2.0 * h), (below.0 - above.0) / (2.0 * h),
            (right.1 - left.1) / (2.0 * h), (below.1 - above.1) / (2.0 * h),
        );
        prop_assert!((numeric - exact).norm() < 1e-9, "{numeric} {exact}");
    }
}

/// Sizes near eta = 0 on the paper's rig: f sin² α / |ζ_c| in eta, f sin α / |ζ_c| in xi,
/// so their ratio is sin α whatever the lens.
#[test]
fn pixels_per_millimetre() {
    let rig = lshpi();
    let at = |fov_deg: f64| {
        let mut rig = rig.clone();
        rig.camera.fx_px = 288.0 / (0.5 * fov_deg).to_radians().tan();
        rig.camera.fy_px = rig.camera.fx_px;
        let j = IdealMap::of(&rig).jacobian(359.5, 287.5).unwrap();
        assert_eq!((j[(1, 0)], j[(0, 1)]), (0.0, 0.0));
        (1e-3 / j[(0, 0)].abs(), 1e-3 / j[(1, 1)].abs())
    };
    // With the 36 deg that the built-in rig has (theory/geometry.md, camera) ...
    let (xi, eta) = at(36.0);
    assert!(
        (xi - 1.3626).abs() < 1e-4 && (eta - 0.9635).abs() < 1e-4,
        "{xi} {eta}"
    );
    // ... while 0.80 px/mm in eta and 1.14 in xi belong together, at about 42.5 deg.
    let (xi, eta) = at(42.5);
    assert!(
        (xi - 1.14).abs() < 0.005 && (eta - 0.80).abs() < 0.005,
        "{xi} {eta}"
    );
    // Port is left, up is up: both derivatives are negative.
    let j = IdealMap::of(&rig).jacobian(359.5, 287.5).unwrap();
    assert!(j[(0, 0)] < 0.0 && j[(1, 1)] < 0.0);
}

#[test]
fn the_optical_axis_meets_the_sheet_at_its_origin() {
    let p = IdealMap::of(&lshpi()).to_plane(359.5, 287.5).unwrap();
    assert!(p.xi_m.abs() < 1e-15 && p.eta_m.abs() < 1e-15, "{p:?}");
    assert_eq!(p.covariance_m2, Matrix2::zeros());
}

/// Paper: 420 mm of heave from 0.93 m. The line runs over ±13 deg of the image.
#[test]
fn heave_range_fits_the_image() {
    let map = IdealMap::of(&lshpi());
    for height_m in [0.93, 0.83, 0.68, 0.51] {
        let (col, row) = map.to_image(0.0, 0.68 - height_m).unwrap();
        assert!(
            (col - 359.5).abs() < 1e-9 && (0.0..=575.0).contains(&row),
            "{height_m}: {row}"
        );
    }
}

#[test]
fn outside_image_and_fan_there_is_no_answer() {
    let map = IdealMap::of(&lshpi());
    for (col, row) in [
        (-0.6, 100.0),
        (719.6, 100.0),
        (100.0, -0.6),
        (100.0, 575.6),
        (f64::NAN, 1.0),
    ] {
        assert_eq!(map.to_plane(col, row), None);
        assert_eq!(map.jacobian(col, row), None);
    }
    // At eta = 0 the fan of 40 deg reaches 0.68 tan 20 deg = 0.2475 m to either side.
    assert!(map.to_image(0.247, 0.0).is_some());
    assert_eq!(map.to_image(0.248, 0.0), None);
    assert_eq!(map.to_image(-0.248, 0.0), None);
    assert_eq!(map.to_image(0.0, 0.69), None);
    assert_eq!(map.to_image(f64::NAN, 0.0), None);
    // In the image, but beside the fan.
    let j = map.jacobian(359.5, 287.5).unwrap();
    let beside = 359.5 + 0.2480 / j[(0, 0)].abs();
    assert!(beside < 719.0 && map.to_plane(beside, 287.5).is_none());
    assert!(map.unlimited(beside, 287.5).is_some());
}

#[test]
fn pixel_noise_propagates() {
    let map = IdealMap::of(&lshpi());
    let sigma = Matrix2::new(0.0, 0.0, 0.0, 0.05 * 0.05);
    let p = map.measured(250.0, 400.0, &sigma).unwrap();
    let j = map.jacobian(250.0, 400.0).unwrap();
    assert!((p.covariance_m2[(1, 1)].sqrt() - 0.05 * j[(1, 1)].abs()).abs() < 1e-15);
    assert!((p.covariance_m2[(0, 1)] - 0.0025 * j[(0, 1)] * j[(1, 1)]).abs() < 1e-18);
}

/// A camera ahead of the sheet that looks back at it is the same picture rotated by half a turn.
#[test]
fn a_camera_ahead_of_the_sheet_works_too() {
    let rig = moved(-45.0, -0.73, 0.22, 1.0);
    let map = IdealMap::of(&rig);
    let (xi, eta) = map.unlimited(400.0, 200.0).unwrap();
    let body = meet_sheet(
        &Pinhole::new(&rig.camera, &rig.mounts),
        &rig.mounts,
        [400.0, 200.0],
    )
    .unwrap();
    let want = body_to_plane(&rig.mounts, &body);
    assert!(
        (xi - want.xi_m).abs() < 1e-12 && (eta - want.eta_m).abs() < 1e-12,
        "{xi} {eta} {want:?}"
    );
}
