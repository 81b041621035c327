//! Poses of `cases/images` (an independent renderer) against the truth in each log,
//! which this test alone reads.

#![allow(clippy::unwrap_used)]

use crate::inputs::{logs_of, on_both_sets};
use hydroline::frame::GreyImage;
use hydroline::log::{LogReader, Record};
use hydroline::pose::estimators::pitch_rad;
use hydroline::pose::joint::refine::{Refined, Wanted, refine};
use hydroline::pose::joint::{Held, Hint, JointPose, Light, PoseFitter, squared_distance};
use hydroline::stripe::{Extractor, ExtractorConfig, Profile};
use hydroline_calib::{IdealMap, Pose};
use hydroline_rigs::Rig;
use std::path::Path;
use std::sync::Arc;

/// Frames and true poses of a log, by stamp.
pub fn frames(path: &Path) -> Vec<(GreyImage, Pose)> {
    let (mut images, mut truths) = (Vec::new(), Vec::new());
    for message in LogReader::open(path).unwrap() {
        match message.unwrap().record {
            Record::Frame(frame) => images.push((
                frame.meta.mid_exposure_ns,
                frame.to_grey(&Default::default()).unwrap(),
            )),
            Record::Truth(t) => {
                let stamp = t
                    .timestamp
                    .as_ref()
                    .map_or(0, hydroline::log::messages::unix_ns);
                let pose = [t.x_m, t.y_m, t.z_m, t.phi_rad, t.theta_rad, t.psi_rad]
                    .map(Option::unwrap_or_default);
                truths.push((stamp, Pose::from_array(pose)));
            }
            _ => {}
        }
    }
    images
        .into_iter()
        .map(|(stamp, image)| {
            (
                image,
                truths
                    .iter()
                    .min_by_key(|(t, _)| t.abs_diff(stamp))
                    .unwrap()
                    .1,
            )
        })
        .collect()
}

/// Errors of joint poses in mm and degrees, in units of the reported sd, and failures.
#[derive(Default)]
struct Score {
    rms: [f64; 6],
    max: [f64; 6],
    worst_sds: f64,
    mean_sd: [f64; 6],
    /// Cramér–Rao bound at the frames' own poses, light and noise, rms.
    bound: [f64; 6],
    /// Error of the place across the vehicle's heading, rms \[mm\].
    across: f64,
    edge_model_error: f64,
    mean_chi2: f64,
    frames: usize,
    failed: usize,
}

const UNIT: [f64; 6] = [
    1e3,
    1e3,
    1e3,
    180.0 / std::f64::consts::PI,
    180.0 / std::f64::consts::PI,
    180.0 / std::f64::consts::PI,
];

/// Pixel noise of these frames, as their README says \[grey levels\].
const NOISE_SD: f64 = 1.5;

fn score(images: &Path, name: &str, rig: &Rig) -> Score {
    let fitter = PoseFitter::new(rig, Arc::new(IdealMap::of(rig)));
    score_of(images, name, rig, &fitter)
}

fn score_of(images: &Path, name: &str, rig: &Rig, fitter: &PoseFitter) -> Score {
    let path = images.join(format!("{name}.mcap"));
    let mut extractor = Extractor::new(ExtractorConfig::default());
    let mut score = Score::default();
    let mut spent = std::time::Duration::ZERO;
    let all = frames(&path);
    // Where the run starts is known from the rig of the case; after that the hint is our own pose.
    let mut x_m = all
        .first()
        .map(|(_, truth)| (truth.x_m * 20.0).round() / 20.0);
    for (k, (image, truth)) in all.into_iter().enumerate() {
        let profile = extractor.extract(&image);
        let from = std::time::Instant::now();
        let fit = fitter.fit(
            &image,
            &profile,
            &Hint {
                x_m,
                ..Hint::default()
            },
        );
        spent += from.elapsed();
        score.frames += 1;
        let JointPose {
            pose,
            covariance,
            measured,
            brightness,
            thickness_m,
            background,
            edge_model_error,
            ..
        } = match fit {
            Ok(fit) => fit,
            Err(error) => {
                println!("{name} frame {k}: {error}");
                score.failed += 1;
                continue;
            }
        };
        if measured[0] {
            x_m = Some(pose.x_m);
        }
        let errors: Vec<f64> = pose
            .to_array()
            .iter()
            .zip(truth.to_array())
            .map(|(a, b)| a - b)
            .collect();
        let mut line = String::new();
        for i in (0..6).filter(|i| measured[*i]) {
            let sd = covariance[(i, i)].sqrt();
            score.rms[i] += (errors[i] * UNIT[i]).powi(2);
            score.max[i] = score.max[i].max((errors[i] * UNIT[i]).abs());
            score.mean_sd[i] += (sd * UNIT[i]).powi(2);
            score.worst_sds = score.worst_sds.max((errors[i] / sd).abs());
            line += &format!(" {:.3}({:.1})", errors[i] * UNIT[i], errors[i] / sd);
        }
        if measured == [true; 6] {
            let light = Light {
                brightness,
                thickness_m,
                background,
                noise_sd: NOISE_SD,
            };
            let bound = fitter.bound(&truth, &light, false).unwrap();
            for i in 0..6 {
                score.bound[i] += bound[(i, i)] * UNIT[i] * UNIT[i];
            }
            let (sin, cos) = truth.psi_rad.sin_cos();
            score.across += ((cos * errors[1] - sin * errors[0]) * 1e3).powi(2);
            score.edge_model_error += edge_model_error * edge_model_error;
            score.mean_chi2 +=
                squared_distance(&pose, &covariance, &truth, &rig.mounts).unwrap() / 6.0;
        }
        if std::env::var_os("POSE_VERBOSE").is_some() {
            println!("  {name} {k}:{line}");
        }
    }
    let n = (score.frames - score.failed).max(1) as f64;
    let all = score.rms.iter_mut().chain(&mut score.mean_sd);
    let all = all.chain(&mut score.bound);
    for v in all.chain([&mut score.across, &mut score.edge_model_error]) {
        *v = (*v / n).sqrt();
    }
    score.mean_chi2 /= n;
    println!(
        "{name}: {} frames, {} failed; rms {:.4?}; max {:.3?}; reported sd {:.4?}; worst {:.1} sd; chi2/6 {:.2}; {:.2} ms/frame (unoptimised build, not asserted)",
        score.frames,
        score.failed,
        score.rms,
        score.max,
        score.mean_sd,
        score.worst_sds,
        score.mean_chi2,
        spent.as_secs_f64() * 1e3 / score.frames.max(1) as f64
    );
    if score.bound[0] > 0.0 {
        let of_bound: [f64; 6] = std::array::from_fn(|i| score.rms[i] / score.bound[i]);
        println!(
            "{name}: bound with the thickness free {:.4?}, rms / bound {of_bound:.2?}; across the heading {:.4} mm; edges' model error {:.3}",
            score.bound, score.across, score.edge_model_error
        );
    }
    score
}

fn target_rig() -> Rig {
    Rig::builtin("lshpi").unwrap()
}

/// Required, rms: x, y, z [mm], φ, θ, ψ [°] with thickness and brightness fitted.
const REQUIRED: [f64; 6] = [0.8, 0.06, 0.27, 0.001, 0.06, 0.012];

/// Prints the requirement beside what is reached by single frames with the thickness free. These frames are
/// sampled three times per pixel and then blurred from pixel to pixel: the blur on the grid is found and fitted (share
/// 1.0 of it), but what an edge leaves over against its distance is a sawtooth of period 1/3 px, ± 0.03 px for edges
/// aslant, ± 0.1 px for those along the columns, several rows alike. That is the model error of the edges (estimated from
/// the frames themselves). With the thickness free the weak direction is observable only by how edges slope within
/// the stripe and is sensitive to a fiftieth of a pixel: x, z and θ stay up to 1.4 times above what is required, 2.4 times the bound
/// of frames with perfect edges. The weak direction lies along the heading, so at yaw it shows in y too: across the heading
/// y is 0.04 mm. A run knows its sheet's thickness, and then the requirement is met: the next test.
fn near_the_requirement(images: &Path, name: &str, within: f64) -> Score {
    let score = score(images, name, &target_rig());
    assert_eq!(score.failed, 0, "{name}");
    for i in 0..6 {
        println!(
            "{name}: {} required {:.4}, reached {:.4}",
            ["x", "y", "z", "phi", "theta", "psi"][i],
            REQUIRED[i],
            score.rms[i]
        );
        assert!(
            score.rms[i] < within * REQUIRED[i],
            "{name}: {:?}",
            score.rms
        );
    }
    assert!(score.rms[3] <= REQUIRED[3], "{name}: roll");
    score
}

fn within_its_sd(name: &str, score: &Score) {
    let worst = score.worst_sds;
    assert!(worst < 4.5, "{name}: a frame {worst} sd off");
}

fn joint_pose_on_independent_frames(images: &Path) {
    for name in logs_of(images, &["surge-4n", "surge-4n-disturbed", "yaw"]) {
        let within = match name {
            // Nine frames (or every other of them), of which two lie within 2 mm of a joint or widest point of one side.
            "yaw" => 3.0,
            _ => 1.5,
        };
        within_its_sd(name, &near_the_requirement(images, name, within));
    }
}

/// With θ known, as the paper's decoupled motions have it: Table 3's limits for ours.
fn surge_and_yaw_with_pitch_known(images: &Path) {
    for name in logs_of(images, &["surge-4n", "surge-4n-disturbed", "yaw"]) {
        let rig = target_rig();
        let fitter = PoseFitter::new(&rig, Arc::new(IdealMap::of(&rig)));
        let mut extractor = Extractor::new(ExtractorConfig::default());
        let (mut x_mm, mut psi_deg) = (0.0f64, 0.0f64);
        for (image, truth) in frames(&images.join(format!("{name}.mcap"))) {
            let profile = extractor.extract(&image);
            let hint = Hint {
                x_m: Some(truth.x_m),
                held: Held {
                    theta_rad: Some(truth.theta_rad),
                    thickness: false,
                },
            };
            let fit = fitter.fit(&image, &profile, &hint).unwrap();
            x_mm = x_mm.max((fit.pose.x_m - truth.x_m).abs() * 1e3);
            psi_deg = psi_deg.max((fit.pose.psi_rad - truth.psi_rad).to_degrees().abs());
        }
        println!("{name}, pitch known: x within {x_mm:.3} mm, yaw within {psi_deg:.4} deg");
        assert!(x_mm <= 0.1 && psi_deg <= 0.1, "{name}: {x_mm} {psi_deg}");
    }
}

fn pitch_by_the_formula(images: &Path) {
    let mut rig = target_rig();
    rig.target = None;
    let fitter = PoseFitter::new(&rig, Arc::new(IdealMap::of(&rig)));
    let mut extractor = Extractor::new(ExtractorConfig::default());
    let mut worst_deg = 0.0f64;
    for (image, truth) in frames(&images.join("pitch.mcap")) {
        let profile = extractor.extract(&image);
        let levels = fitter.levels(&image, &profile).unwrap();
        let level = Pose {
            theta_rad: 0.0,
            ..truth
        };
        let line = level.level_in_plane(&rig.mounts, 0.0).unwrap();
        let theta = pitch_rad(&levels, line.eta_at_zero_m, &rig.mounts).unwrap();
        worst_deg = worst_deg.max((theta.value - truth.theta_rad).to_degrees().abs());
    }
    println!("pitch by Eq. 5: within {worst_deg:.4} deg, asked 0.05");
    assert!(worst_deg <= 0.05, "{worst_deg}");
}

fn bare_floor_on_independent_frames(images: &Path) {
    let mut rig = target_rig();
    rig.target = None;
    for name in ["heave", "roll"] {
        let score = score(images, name, &rig);
        assert_eq!(score.failed, 0, "{name}");
        // Asked for: heave 0.05 mm, roll 0.01°, maximum.
        assert!(
            score.max[2] < 0.05 && score.max[3] < 0.01,
            "{name}: {:?}",
            score.max
        );
    }
}

/// Frames of a log with their profiles, each with where the true pose says that it is.
fn seen(path: &Path) -> Vec<(GreyImage, Profile, Hint)> {
    let mut extractor = Extractor::new(ExtractorConfig::default());
    let frames = frames(path).into_iter();
    frames
        .map(|(image, truth)| {
            let profile = extractor.extract(&image);
            let hint = Hint {
                x_m: Some(truth.x_m),
                ..Hint::default()
            };
            (image, profile, hint)
        })
        .collect()
}

/// The sheet's thickness found over the run, as `replay --refine thickness` does, and then each frame by itself.
fn joint_pose_with_the_thickness_refined_over_the_run(images: &Path) {
    for name in logs_of(images, &["surge-4n", "surge-4n-disturbed", "yaw"]) {
        let rig = target_rig();
        let fitter = PoseFitter::new(&rig, Arc::new(IdealMap::of(&rig)));
        let wanted = Wanted {
            tilt: false,
            thickness: true,
        };
        let found: Refined =
            refine(&fitter, &seen(&images.join(format!("{name}.mcap"))), wanted).unwrap();
        println!(
            "{name}: thickness {:.5} mm, sd {:.5}",
            found.geometry.thickness_m * 1e3,
            found.covariance[(2, 2)].sqrt() * 1e3
        );
        let score = score_of(images, name, &rig, &fitter.refined(&found));
        assert_eq!(score.failed, 0, "{name}");
        within_its_sd(name, &score);
        // The requirement holds for yaw of 0 to 5 deg. At up to 17 deg the rest of the weak direction shows in y (even the
        // bound with the thickness free is 0.08 mm there); ψ of nine frames, two of them at corners.
        let within: [f64; 6] = match name {
            "yaw" => [1.0, 2.0, 1.0, 1.0, 1.0, 2.0],
            _ => [1.0; 6],
        };
        for i in 0..6 {
            assert!(
                score.rms[i] <= within[i] * REQUIRED[i],
                "{name}, {i}: {:?}",
                score.rms
            );
        }
    }
}

on_both_sets!("cases/images":
    joint_pose_on_independent_frames,
    surge_and_yaw_with_pitch_known,
    pitch_by_the_formula,
    bare_floor_on_independent_frames,
    joint_pose_with_the_thickness_refined_over_the_run,
);
