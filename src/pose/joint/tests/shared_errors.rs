//! What a map's errors do to the pose, beside the pose that a displaced map gives.

use super::*;
use hydroline_calib::Calibration;
use hydroline_calib::plane::PlanePoint;
use nalgebra::{DMatrix, Matrix2, Matrix2xX};

/// A map that is exact but for some displacements of its points, which it takes as unknown.
struct Displaced {
    exact: IdealMap,
    by: [f64; 4],
}

/// Sds of offsets \[m\] of ξ and η, of a turn and of a stretch along the line.
const SDS: [f64; 4] = [5e-5, 5e-5, 1e-4, 2e-4];

impl Displaced {
    fn slopes(at: &PlanePoint) -> Matrix2xX<f64> {
        Matrix2xX::from_row_slice(&[
            1.0, 0.0, -at.eta_m, at.xi_m, //
            0.0, 1.0, at.xi_m, 0.0,
        ])
    }
}

impl PlaneMap for Displaced {
    fn to_plane(&self, column_px: f64, row_px: f64) -> Option<PlanePoint> {
        let mut at = self.exact.to_plane(column_px, row_px)?;
        let moved = Self::slopes(&at) * nalgebra::Vector4::from(self.by);
        (at.xi_m, at.eta_m) = (at.xi_m + moved[0], at.eta_m + moved[1]);
        Some(at)
    }
    fn to_image(&self, xi_m: f64, eta_m: f64) -> Option<(f64, f64)> {
        self.exact.to_image(xi_m, eta_m)
    }
    fn jacobian(&self, column_px: f64, row_px: f64) -> Option<Matrix2<f64>> {
        self.exact.jacobian(column_px, row_px)
    }
    fn describe(&self) -> Calibration {
        self.exact.describe()
    }
    fn parameter_slopes(&self, column_px: f64, row_px: f64) -> Option<Matrix2xX<f64>> {
        Some(Self::slopes(&self.exact.to_plane(column_px, row_px)?))
    }
    fn parameter_covariance(&self) -> DMatrix<f64> {
        DMatrix::from_diagonal(&nalgebra::DVector::from_iterator(4, SDS.map(|sd| sd * sd)))
    }
}

fn seen_by(rig: &Rig, image: &GreyImage, by: [f64; 4]) -> JointPose {
    let profile = Extractor::new(ExtractorConfig::default()).extract(image);
    let exact = IdealMap::of(rig);
    let fitter = PoseFitter::new(rig, Arc::new(Displaced { exact, by }));
    let hint = Hint {
        x_m: Some(0.2),
        ..Hint::default()
    };
    fitter.fit(image, &profile, &hint).unwrap()
}

/// A map whose true points are displaced by so much gives a pose that is off by as much as loadings state: over the independent
/// displacements their covariance is that of the parameters, each of which moves the pose by itself.
#[test]
fn loadings_are_what_displaced_maps_move_the_pose_by() {
    let rig = lshpi_rig();
    for pose in [
        POSE,
        Pose {
            x_m: 0.26,
            phi_rad: -0.03,
            theta_rad: 0.02,
            psi_rad: 0.08,
            ..POSE
        },
    ] {
        let image = frame(&rig, &pose);
        let fit = seen_by(&rig, &image, [0.0; 4]);
        let mut moved = nalgebra::Matrix6::zeros();
        for k in 0..4 {
            // Central, so that what is left is of the third order.
            let [on, back] = [1.0, -1.0].map(|sds| {
                let mut by = [0.0; 4];
                by[k] = sds * SDS[k];
                nalgebra::Vector6::from(seen_by(&rig, &image, by).pose.to_array())
            });
            println!("{k} {:?}", ((on - back) * 0.5).as_slice());
            moved += 0.25 * (on - back) * (on - back).transpose();
        }
        let by = fit.loadings.fixed_rows::<6>(0);
        let stated = by * by.transpose();
        println!(
            "own {:?}",
            (0..6)
                .map(|i| fit.covariance[(i, i)].sqrt())
                .collect::<Vec<_>>()
        );
        println!(
            "stated {:?}",
            (0..6).map(|i| stated[(i, i)].sqrt()).collect::<Vec<_>>()
        );
        println!(
            "moved {:?}",
            (0..6).map(|i| moved[(i, i)].sqrt()).collect::<Vec<_>>()
        );
        for i in 0..6 {
            let ratio = (stated[(i, i)] / moved[(i, i)]).sqrt();
            assert!((0.93..1.07).contains(&ratio), "{i}: {stated} {moved}");
            for k in 0..i {
                let alike =
                    |of: &nalgebra::Matrix6<f64>| of[(i, k)] / (of[(i, i)] * of[(k, k)]).sqrt();
                let off = alike(&stated) - alike(&moved);
                assert!(off.abs() < 0.05, "{i} {k}: {stated} {moved}");
            }
        }
    }
}

/// Loadings are errors of the pose where the true points lie where the displacement says: a map that has them there already moves it back.
#[test]
fn loadings_have_the_sign_of_the_poses_error() {
    let rig = lshpi_rig();
    let image = frame(&rig, &POSE);
    let fit = seen_by(&rig, &image, [0.0; 4]);
    let map = Displaced {
        exact: IdealMap::of(&rig),
        by: [0.0; 4],
    };
    let errors = MapErrors::of(&map, ImageSize::of(&rig.camera));
    let by = [0.0, 0.5 * SDS[1], 0.0, 0.0];
    let moved = seen_by(&rig, &image, by).pose.z_m - fit.pose.z_m;
    // All points higher by half an sd, in sds of each displacement.
    let at: Vec<f64> = errors.at(360.0, 300.0).map(|at| at[1] / SDS[1]).collect();
    let stated: f64 = at
        .iter()
        .enumerate()
        .map(|(k, u)| 0.5 * u * fit.loadings[(2, k)])
        .sum();
    assert!(
        (stated + moved).abs() < 0.2 * moved.abs(),
        "{stated} {moved}"
    );
}

#[test]
fn an_exact_map_has_no_loadings() {
    let rig = lshpi_rig();
    let fit = fitted(&rig, &frame(&rig, &POSE), Some(0.18)).unwrap();
    assert_eq!(fit.loadings, MapLoadings::zeros());
    assert_eq!(fit.total_covariance(), fit.covariance);
}

#[test]
fn zz_many() {
    let rig = lshpi_rig();
    let renderer = Renderer::new(&rig).unwrap();
    for seed in 0..12 {
        let f = seed as f64;
        let pose = Pose {
            x_m: 0.2 + 0.01 * f,
            phi_rad: 0.004 * f - 0.02,
            psi_rad: -0.08 + 0.012 * f,
            theta_rad: -0.008 + 0.002 * f,
            ..POSE
        };
        let image = GreyImage {
            width_px: 720,
            height_px: 576,
            pixels: renderer.render(&Pose6::from(pose.to_array()), seed).0,
        };
        let Some(fit) = Some(seen_by(&rig, &image, [0.0; 4])) else {
            continue;
        };
        let mut moved = nalgebra::Matrix6::zeros();
        for k in 0..4 {
            let [on, back] = [1.0, -1.0].map(|sds| {
                let mut by = [0.0; 4];
                by[k] = sds * SDS[k];
                nalgebra::Vector6::from(seen_by(&rig, &image, by).pose.to_array())
            });
            moved += 0.25 * (on - back) * (on - back).transpose();
        }
        let by = fit.loadings.fixed_rows::<6>(0);
        let stated = by * by.transpose();
        println!(
            "ratio {:?} theta {:.5} of own {:.5} edge {:.4}",
            (0..6)
                .map(|i| (100.0 * (stated[(i, i)] / moved[(i, i)]).sqrt()).round() / 100.0)
                .collect::<Vec<_>>(),
            stated[(4, 4)].sqrt(),
            fit.covariance[(4, 4)].sqrt(),
            fit.edge_model_error
        );
    }
}
