//! Time per 720 x 576 frame on one core: `cargo bench -p hydroline-pose --bench pose`.
//! Required (issue 4, must show 6): joint pose <= 5 ms, the six formulas <= 0.1 ms.

#![allow(clippy::unwrap_used)]

use divan::{Bencher, black_box};
use hydroline_calib::IdealMap;
use hydroline_core::frame::GreyImage;
use hydroline_pose::Pose;
use hydroline_pose::estimators::{self, Chain, Crossing};
use hydroline_pose::joint::{CameraResponse, Hint, PoseFitter};
use hydroline_pose::segments::Levels;
use hydroline_rigs::Rig;
use hydroline_sim::{Pose6, Renderer};
use hydroline_stripe::{Extractor, ExtractorConfig, Profile};
use std::sync::Arc;

fn main() {
    divan::main();
}

/// On a flank, at a widest point, and at a joint, where four places have to be distinguished.
const PLACES_M: [f64; 3] = [-0.115, -0.17, -0.0622];

struct Case {
    rig: Rig,
    fitter: PoseFitter,
    image: GreyImage,
    profile: Profile,
    x_m: f64,
}

fn case(x_m: f64) -> Case {
    let rig = Rig::builtin("lshpi").unwrap();
    let pose = Pose {
        x_m,
        y_m: 0.004,
        z_m: -0.826,
        phi_rad: 0.01,
        theta_rad: -0.008,
        psi_rad: -0.05,
    };
    let renderer = Renderer::new(&rig).unwrap();
    let image = GreyImage {
        width_px: renderer.width_px(),
        height_px: renderer.height_px(),
        pixels: renderer.render(&Pose6::from(pose.to_array()), 3).0,
    };
    Case {
        fitter: PoseFitter::new(&rig, Arc::new(IdealMap::of(&rig))),
        profile: Extractor::new(ExtractorConfig::default()).extract(&image),
        image,
        rig,
        x_m,
    }
}

#[divan::bench(args = PLACES_M)]
fn joint_pose(bencher: Bencher<'_, '_>, x_m: f64) {
    let case = case(x_m);
    let hint = Hint {
        x_m: Some(case.x_m),
        ..Hint::default()
    };
    bencher.bench_local(|| {
        case.fitter
            .fit(black_box(&case.image), &case.profile, &hint)
            .unwrap()
    });
}

/// With a camera's response as a run's opening leaves it where it shows no curve: known to a few thousandths.
#[divan::bench(args = PLACES_M)]
fn joint_pose_of_a_run(bencher: Bencher<'_, '_>, x_m: f64) {
    let case = case(x_m);
    let hint = Hint {
        x_m: Some(case.x_m),
        ..Hint::default()
    };
    let sds = [0.003, 0.5, 3e-4, 1e-3, 1e-4, 2e-4, 2e-5, 2e-5, 2e-6, 2e-6];
    let mut response = CameraResponse::LINEAR;
    for (k, sd) in sds.into_iter().enumerate() {
        response.covariance[(k, k)] = sd * sd;
    }
    let fitter = case.fitter.with_response(response);
    bencher.bench_local(|| {
        fitter
            .fit(black_box(&case.image), &case.profile, &hint)
            .unwrap()
    });
}

/// Sorting the stripe into levels and edges.
#[divan::bench]
fn levels(bencher: Bencher<'_, '_>) {
    let case = case(PLACES_M[0]);
    bencher.bench_local(|| {
        case.fitter
            .levels(black_box(&case.image), &case.profile)
            .unwrap()
    });
}

/// All six formulas on a stripe that is sorted.
#[divan::bench]
fn six_formulas(bencher: Bencher<'_, '_>) {
    let case = case(PLACES_M[0]);
    let levels: Levels = case.fitter.levels(&case.image, &case.profile).unwrap();
    let heights_m = case.fitter.surfaces().heights_m();
    let chain = Chain::new(case.rig.target.as_ref().unwrap()).unwrap();
    let mounts = case.rig.mounts;
    let near = (case.x_m + mounts.l_laser_m, -0.05);
    bencher.bench_local(|| {
        let levels = black_box(&levels);
        let crossing = Crossing::new(levels, &heights_m);
        let fix = chain.fix(&crossing, near).unwrap();
        (
            chain.place_at_yaw(&crossing, fix.psi_s_rad, fix.x_s_m),
            estimators::sway_m(&crossing, &crossing),
            estimators::heave_m(levels, levels),
            estimators::roll_rad(levels),
            estimators::pitch_rad(levels, levels.eta0_m, &mounts),
            estimators::yaw_rad(&fix, &fix),
        )
    });
}
