use super::*;
use nalgebra::Rotation3;
use proptest::prelude::*;
use proptest::test_runner::RngSeed;
use std::f64::consts::PI;

/// Table 2 of the paper.
fn table_2() -> Mounts {
    Mounts {
        l_laser_m: 0.27,
        l_camera_m: 0.19,
        h_camera_m: 0.22,
        h_centre_m: 0.68,
        camera_tilt_rad: 45_f64.to_radians(),
    }
}

fn pose() -> impl Strategy<Value = Pose> {
    (
        -5.0..5.0,
        -2.0..2.0,
        -2.0..0.0,
        -1.4..1.4,
        -1.4..1.4,
        -3.1..3.1,
    )
        .prop_map(|(x, y, z, f, t, p)| Pose::from_array([x, y, z, f, t, p]))
}

fn point() -> impl Strategy<Value = Vector3<f64>> {
    [-3.0..3.0, -3.0..3.0, -3.0..3.0].prop_map(|[x, y, z]| Vector3::new(x, y, z))
}

proptest! {
    #![proptest_config(ProptestConfig { rng_seed: RngSeed::Fixed(1), failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn rotation_is_the_product_of_the_three(p in pose()) {
        // nalgebra's from_euler_angles(roll, pitch, yaw) is Rz Ry Rx.
        let want = Rotation3::from_euler_angles(p.phi_rad, p.theta_rad, p.psi_rad);
        prop_assert!((p.body_to_tank_rotation() - want.matrix()).norm() < 1e-14);
    }

    #[test]
    fn points_come_back(b in point()) {
        let mounts = table_2();
        let c = body_to_plane(&mounts, &b);
        let sheet = plane_to_body(&mounts, c.xi_m, c.eta_m);
        prop_assert!((sheet - b + Vector3::new(c.zeta_m, 0.0, 0.0)).norm() < 1e-14);
    }

    /// The closed form of the level line against the frames themselves.
    #[test]
    fn level_line_lies_at_its_height(p in pose(), xi in -0.5..0.5, height in 0.0..0.3) {
        let mounts = table_2();
        let line = p.level_in_plane(&mounts, height).unwrap();
        let eta = line.eta_at_zero_m + line.slope * xi;
        let tank = p.body_to_tank(&plane_to_body(&mounts, xi, eta));
        prop_assert!((tank.z + height).abs() < 1e-12 * (1.0 + eta.abs()));
    }

    /// Paper Eq. 4: tan phi = (eta_B - eta_A) / (xi_A - xi_B), and the level of theory/geometry.md, laser plane.
    #[test]
    fn equation_4(phi in -0.6..0.6, height in 0.3f64..1.2) {
        let mounts = table_2();
        let p = Pose { z_m: -height, phi_rad: phi, ..Pose::default() };
        let line = p.level_in_plane(&mounts, 0.0).unwrap();
        let eta = |xi: f64| line.eta_at_zero_m + line.slope * xi;
        let (a, b) = (0.1, -0.15);
        prop_assert!(((eta(b) - eta(a)) / (a - b) - phi.tan()).abs() < 1e-12);
        prop_assert!((line.eta_at_zero_m - (0.68 - height / phi.cos())).abs() < 1e-12);
    }

    /// Paper Eq. 5: (h_centre - eta) cos theta = l_laser sin theta + h_centre - eta_level.
    #[test]
    fn equation_5(theta in -0.6..0.6, height in 0.3f64..1.2) {
        let mounts = table_2();
        let level = Pose { z_m: -height, ..Pose::default() };
        let eta_level = level.level_in_plane(&mounts, 0.0).unwrap().eta_at_zero_m;
        prop_assert!((mounts.h_centre_m - eta_level - height).abs() < 1e-13);
        let pitched = Pose { theta_rad: theta, ..level };
        let eta = pitched.level_in_plane(&mounts, 0.0).unwrap().eta_at_zero_m;
        let left = (mounts.h_centre_m - eta) * theta.cos();
        let right = mounts.l_laser_m * theta.sin() + mounts.h_centre_m - eta_level;
        prop_assert!((left - right).abs() < 1e-12);
    }
}

#[test]
fn nose_up_lowers_the_line_and_going_down_raises_it() {
    let mounts = table_2();
    let eta = |z_m: f64, theta_rad: f64| {
        let p = Pose {
            z_m,
            theta_rad,
            ..Pose::default()
        };
        p.level_in_plane(&mounts, 0.0).unwrap().eta_at_zero_m
    };
    assert!(eta(-0.68, 0.1) < eta(-0.68, 0.0));
    // Eq. 3: z_i = eta_i - eta_1.
    assert!((eta(-0.63, 0.0) - eta(-0.68, 0.0) - 0.05).abs() < 1e-15);
}

#[test]
fn no_level_line_when_the_sheet_points_away() {
    let mounts = table_2();
    for (phi_rad, theta_rad) in [
        (PI, 0.0),
        (0.0, PI),
        (PI, PI),
        (0.5 * PI, 0.0),
        (f64::NAN, 0.0),
    ] {
        let p = Pose {
            z_m: -0.7,
            phi_rad,
            theta_rad,
            ..Pose::default()
        };
        assert_eq!(
            p.level_in_plane(&mounts, 0.0),
            None,
            "{phi_rad} {theta_rad}"
        );
    }
}

/// theory/geometry.md, camera: the optical axis meets the laser plane exactly at eta = 0.
#[test]
fn optical_axis_meets_the_sheet_at_eta_zero() {
    let mounts = table_2();
    let camera = body_to_plane(&mounts, &camera_position_m(&mounts));
    assert!((camera.eta_m - 0.46).abs() < 1e-15 && (camera.zeta_m + 0.46).abs() < 1e-15);
    let along = camera_position_m(&mounts)
        + camera_to_body_rotation(mounts.camera_tilt_rad)
            * Vector3::new(0.0, 0.0, 0.46 * 2_f64.sqrt());
    let met = body_to_plane(&mounts, &along);
    assert!(met.eta_m.abs() < 1e-15 && met.zeta_m.abs() < 1e-15 && met.xi_m == 0.0);
}

#[test]
fn camera_axes_are_right_handed_and_look_forward_and_down() {
    let r = camera_to_body_rotation(0.7);
    assert!((r.determinant() - 1.0).abs() < 1e-15);
    let axis = r * Vector3::z();
    assert!(axis.x > 0.0 && axis.z > 0.0 && axis.y == 0.0);
    assert!((axis.dot(&Vector3::z()) - 0.7_f64.cos()).abs() < 1e-15);
    // X right = starboard; Y down in the image = towards the vehicle.
    assert_eq!(r * Vector3::x(), Vector3::y());
    assert!((r * Vector3::y()).x < 0.0);
}
