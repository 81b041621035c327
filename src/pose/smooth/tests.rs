//! Runs of the simulated vehicle with the covariance that a frame really has.

use super::*;
use crate::fixture::lshpi_rig;
use hydroline_sim::World;
use nalgebra::{Cholesky, SMatrix};
use rand::{SeedableRng, rngs::StdRng};
use rand_distr::{Distribution, StandardNormal};

const FRAME_NS: u64 = 40_000_000;

/// Covariance of one frame: the geometry of the target in all directions but one (theory/geometry.md, one frame:
/// y 0.03 mm, φ 0.0003°, ψ 0.006°; δz = l δθ, δx = −H δθ weak, and tied to the thickness).
fn frame_covariance() -> SMatrix<f64, 7, 7> {
    let mut c = SMatrix::<f64, 7, 7>::zeros();
    for (i, sd) in [5e-5, 3e-5, 1e-5, 5e-6, 2e-5, 1e-4, 1e-7]
        .iter()
        .enumerate()
    {
        c[(i, i)] = sd * sd;
    }
    let theta = 0.037f64.to_radians();
    let mut weak = SMatrix::<f64, 7, 1>::zeros();
    (weak[0], weak[2], weak[4], weak[6]) = (-0.83 * theta, 0.27 * theta, theta, 4e-7);
    c + weak * weak.transpose()
}

/// True poses of a 4 N surge with a pitch disturbance of `pitch_rad`, and their measurements.
fn run(pitch_rad: f64, frames: u64, seed: u64) -> (Vec<[f64; 6]>, Vec<MeasuredFrame>) {
    let rig = lshpi_rig();
    let mut world = World::new(&rig, [-0.2, 0.0, -0.83, 0.0, 0.0, -0.07]).unwrap();
    world
        .command(
            0.0,
            &hydroline_rigs::Wrench {
                surge_n: 4.0,
                ..Default::default()
            },
        )
        .unwrap();
    let covariance = frame_covariance();
    let factor = Cholesky::new(covariance).unwrap().l();
    let mut random = StdRng::seed_from_u64(seed);
    let mut truth = Vec::new();
    let mut measured = Vec::new();
    for k in 0..frames {
        let t_s = k as f64 * 0.04;
        let mut eta = world.state_at(t_s).unwrap().eta;
        eta[4] += pitch_rad * (2.0 * std::f64::consts::PI * t_s / 6.0).sin();
        let noise = SMatrix::<f64, 7, 1>::from_fn(|_, _| StandardNormal.sample(&mut random));
        let noise = factor * noise;
        truth.push(eta);
        measured.push(MeasuredFrame {
            stamp_ns: 1_000_000_000 + k * FRAME_NS,
            measured: Some(Measured {
                loadings: crate::joint::MapLoadings::zeros(),
                values: std::array::from_fn(|i| eta.get(i).copied().unwrap_or(0.002) + noise[i]),
                covariance,
                measured: [true; 6],
                thickness: true,
            }),
        });
    }
    (truth, measured)
}

fn dynamics() -> Dynamics {
    let rig = lshpi_rig();
    let share = 4.0 / (4.0 * std::f64::consts::FRAC_1_SQRT_2);
    let names = ["h_fore_stbd", "h_fore_port", "h_aft_stbd", "h_aft_port"];
    Dynamics::with_commands(&rig, names.map(|n| (1_000_000_000, n, share))).unwrap()
}

/// Rms error of x \[m\], greatest error of x, and the share of all numbers within 1.96 sd.
fn judged(truth: &[[f64; 6]], run: &Run) -> (f64, f64, f64) {
    let (mut square, mut most, mut inside) = (0.0, 0.0f64, 0.0);
    for (t, s) in truth.iter().zip(&run.frames) {
        let error = s.eta[0] - t[0];
        square += error * error;
        most = most.max(error.abs());
        for (i, true_value) in t.iter().enumerate() {
            let sd = s.covariance[(i, i)].sqrt();
            inside += f64::from(u8::from((s.eta[i] - true_value).abs() < 1.96 * sd));
        }
    }
    let n = truth.len() as f64;
    ((square / n).sqrt(), most, inside / (6.0 * n))
}

#[test]
fn an_undisturbed_run_is_bound_tightly() {
    let (truth, frames) = run(0.0, 150, 3);
    let run = smooth(&frames, &dynamics()).unwrap();
    let (rms, most, inside) = judged(&truth, &run);
    println!(
        "rms {rms:.6} max {most:.6} inside {inside:.3} walk sd {:?} chi2 {:.3}",
        run.walk_sd_per_root_s, run.chi2
    );
    // One frame: 0.54 mm. 150 of them alone would come to 0.044 mm; the dynamics leave a little open.
    let sd = run.frames[75].covariance[(0, 0)].sqrt();
    assert!(sd < 0.54e-3 / 7.0 && rms < 1.5 * sd, "{rms} {sd}");
    assert!(inside > 0.85, "{inside}");
    assert!((0.8..1.2).contains(&run.chi2), "{}", run.chi2);
    let thickness = run.thickness_m.unwrap();
    assert!((thickness - 0.002).abs() < 4.0 * run.thickness_sd_m && run.thickness_sd_m < 1e-7);
}

#[test]
fn a_disturbed_run_is_followed() {
    let (truth, frames) = run(1f64.to_radians(), 150, 4);
    let run = smooth(&frames, &dynamics()).unwrap();
    let (rms, most, inside) = judged(&truth, &run);
    println!(
        "rms {rms:.6} max {most:.6} inside {inside:.3} walk sd {:?} chi2 {:.3}",
        run.walk_sd_per_root_s, run.chi2
    );
    assert!(rms < 0.54e-3 / 2.0, "{rms}");
    assert!(inside > 0.85, "{inside}");
}

#[test]
fn a_frame_without_a_pose_gets_one_with_a_larger_sd() {
    let (truth, mut frames) = run(0.0, 60, 5);
    for f in &mut frames[28..32] {
        f.measured = None;
    }
    let run = smooth(&frames, &dynamics()).unwrap();
    let sd = |k: usize| run.frames[k].covariance[(1, 1)].sqrt();
    assert!(!run.frames[30].own && sd(30) > sd(20));
    assert!((run.frames[30].eta[1] - truth[30][1]).abs() < 4.0 * sd(30));
}

#[test]
fn a_gross_error_does_not_distort_the_run() {
    let (truth, mut frames) = run(0.0, 60, 6);
    if let Some(m) = &mut frames[30].measured {
        m.values[0] += 0.2;
    }
    let run = smooth(&frames, &dynamics()).unwrap();
    assert!(run.downweighted >= 1);
    assert!((run.frames[30].eta[0] - truth[30][0]).abs() < 2e-3);
}

#[test]
fn what_cannot_be_smoothed_says_why() {
    let (_, mut frames) = run(0.0, 10, 7);
    assert!(matches!(
        smooth(&frames[..2], &dynamics()),
        Err(SmoothError::TooFew { .. })
    ));
    frames[5].stamp_ns = frames[4].stamp_ns;
    assert!(matches!(
        smooth(&frames, &dynamics()),
        Err(SmoothError::Order { frame: 5 })
    ));
    let (_, mut frames) = run(0.0, 10, 7);
    for f in &mut frames[5..] {
        f.stamp_ns += 9_000_000_000;
    }
    assert!(matches!(
        smooth(&frames, &dynamics()),
        Err(SmoothError::Gap { frame: 5, .. })
    ));
}

/// A frame without a pose behind a gap was reached by integrating over it, in steps of 20 ms.
#[test]
fn a_frame_a_century_later_is_refused_at_once() {
    let (_, mut frames) = run(0.0, 10, 7);
    frames[9].measured = None;
    frames[9].stamp_ns += 3_200_000_000_000_000_000;
    assert!(matches!(
        smooth(&frames, &dynamics()),
        Err(SmoothError::Gap { frame: 9, .. })
    ));
}
