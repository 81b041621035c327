//! What a map's errors do to the pose, beside the pose that a displaced map gives.

use super::*;
use crate::photometric::{Choice, EdgeModelError, RunParameters, Weighting};
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

fn at_sds(k: usize, sds: f64) -> [f64; 4] {
    let mut by = [0.0; 4];
    by[k] = sds * SDS[k];
    by
}

/// Poses all over a hexagon.
fn poses() -> impl Iterator<Item = Pose> {
    (0..6).map(|k| {
        let k = f64::from(k);
        Pose {
            x_m: 0.2 + 0.02 * k,
            phi_rad: 0.008 * k - 0.02,
            theta_rad: 0.004 * k - 0.008,
            psi_rad: 0.024 * k - 0.08,
            ..POSE
        }
    })
}

/// The same pixels pull at the pose, under a displaced map, as much more as the sums say.
#[test]
fn a_displaced_map_pulls_as_its_shift_of_the_vehicle_does() {
    let rig = lshpi_rig();
    for pose in poses() {
        let image = frame(&rig, &pose);
        let fit = seen_by(&rig, &image, [0.0; 4]);
        let exact = IdealMap::of(&rig);
        let fitter = PoseFitter::new(
            &rig,
            Arc::new(Displaced {
                exact,
                by: [0.0; 4],
            }),
        );
        let state = state_of(&fit);
        let weighting = Weighting {
            noise_sd: fit.noise_sd,
            cut: 1e6,
            redescending: false,
            response: photometric::Response::new([fit.tone, fit.black], fitter.ceiling),
            run_parameters: RunParameters::Known,
            even: false,
        };
        let plan = fitter.model.plan(&state, Choice::ALL);
        let picture = Picture::plain(&image.pixels, fitter.ceiling);
        let stating = fitter.model.with_map_errors(fitter.map_errors.clone());
        let sums = |by: [f64; 4]| {
            let exact = IdealMap::of(&rig);
            let map = Displaced { exact, by };
            let table = SheetTable::new(&map, &rig.camera, &rig.mounts);
            let model = stating.seen_by(Arc::new(table));
            let none = &mut EdgeModelError::default();
            model.compare(&plan, &picture, &state, &weighting, none, true)
        };
        let mut pulled = nalgebra::Matrix6::zeros();
        for k in 0..4 {
            let [on, back] = [0.2, -0.2].map(|sds| sums(at_sds(k, sds)).gradient);
            let by = (on - back).fixed_rows::<6>(0) / 0.4;
            pulled += by * by.transpose();
        }
        let by_map = sums([0.0; 4]).by_map;
        let by = by_map.fixed_rows::<6>(0);
        let stated = by * by.transpose();
        for i in 0..6 {
            for k in 0..=i {
                let size = (pulled[(i, i)] * pulled[(k, k)]).sqrt();
                let off = (stated[(i, k)] - pulled[(i, k)]) / size;
                assert!(off.abs() < 0.05, "{i} {k}: {off} of {stated} {pulled}");
            }
        }
    }
}

/// What the fit makes of it. Edges that a displaced map brings out of their places weigh less, so that the fit gives way by less than
/// its weights say: along the weak direction by a quarter; across it, where the whole line tells, it does not.
#[test]
fn loadings_are_what_displaced_maps_move_the_pose_by() {
    let rig = lshpi_rig();
    let mut ratios = Vec::new();
    for pose in poses() {
        let image = frame(&rig, &pose);
        let fit = seen_by(&rig, &image, [0.0; 4]);
        let mut moved = [0.0; 6];
        for k in 0..4 {
            let of = |sds| seen_by(&rig, &image, at_sds(k, sds)).pose.to_array();
            let [on, back] = [of(1.0), of(-1.0)];
            for i in 0..6 {
                moved[i] += (0.5 * (on[i] - back[i])).powi(2);
            }
        }
        let by = fit.loadings.fixed_rows::<6>(0);
        let stated = by * by.transpose();
        ratios.push([0, 1, 2, 3, 4].map(|i| (stated[(i, i)] / moved[i]).sqrt()));
    }
    println!("{ratios:.2?}");
    for (i, [least, most]) in [[0.9, 1.5], [0.9, 1.3], [0.9, 1.5], [0.97, 1.03], [0.9, 1.5]]
        .into_iter()
        .enumerate()
    {
        let mean = ratios.iter().map(|r| r[i]).sum::<f64>() / ratios.len() as f64;
        assert!((least..most).contains(&mean), "{i}: {mean}");
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
