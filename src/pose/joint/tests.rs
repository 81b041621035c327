//! Rendered frames through extraction and fit.

use super::*;
use crate::fixture::lshpi_rig;
use hydroline_calib::{IdealMap, Pose};
use hydroline_sim::{Pose6, Renderer};
use hydroline_stripe::{Extractor, ExtractorConfig};

fn frame(rig: &Rig, pose: &Pose) -> GreyImage {
    let renderer = Renderer::new(rig).unwrap();
    GreyImage {
        width_px: 720,
        height_px: 576,
        pixels: renderer.render(&Pose6::from(pose.to_array()), 3).0,
    }
}

fn fitted(rig: &Rig, image: &GreyImage, x_m: Option<f64>) -> Result<JointPose, PoseFault> {
    let profile = Extractor::new(ExtractorConfig::default()).extract(image);
    let fitter = PoseFitter::new(rig, Arc::new(IdealMap::of(rig)));
    fitter.fit(
        image,
        &profile,
        &Hint {
            x_m,
            ..Hint::default()
        },
    )
}

const POSE: Pose = Pose {
    x_m: 0.21,
    y_m: 0.004,
    z_m: -0.826,
    phi_rad: 0.01,
    theta_rad: -0.008,
    psi_rad: -0.05,
};

#[test]
fn a_frame_gives_all_six() {
    let rig = lshpi_rig();
    let image = frame(&rig, &POSE);
    let fit = fitted(&rig, &image, Some(0.18)).unwrap();
    assert_eq!(fit.measured, [true; 6]);
    for i in 0..6 {
        let error = fit.pose.to_array()[i] - POSE.to_array()[i];
        assert!(
            error.abs() < 5.0 * fit.covariance[(i, i)].sqrt(),
            "{i}: {error}"
        );
    }
    // The hint decides between hexagons and nothing else: bit for bit.
    assert_eq!(fitted(&rig, &image, Some(0.24)).unwrap(), fit);
}

#[test]
fn without_a_hint_the_hexagon_is_said_to_be_open() {
    let rig = lshpi_rig();
    let fit = fitted(&rig, &frame(&rig, &POSE), None).unwrap();
    assert!(
        fit.caveats.contains(&PoseCaveat::WhichHexagon),
        "{:?}",
        fit.caveats
    );
}

#[test]
fn a_bare_floor_gives_z_and_roll_and_says_so() {
    let mut rig = lshpi_rig();
    rig.target = None;
    let truth = Pose {
        theta_rad: 0.0,
        ..POSE
    };
    let fit = fitted(&rig, &frame(&rig, &truth), None).unwrap();
    assert_eq!(fit.measured, [false, false, true, true, false, false]);
    assert!(fit.caveats.contains(&PoseCaveat::BareFloor));
    assert!(
        (fit.pose.z_m - truth.z_m).abs() < 5e-5 && (fit.pose.phi_rad - truth.phi_rad).abs() < 5e-5
    );
}

#[test]
fn darkness_and_another_size_are_errors() {
    let rig = lshpi_rig();
    let dark = GreyImage {
        width_px: 720,
        height_px: 576,
        pixels: vec![3; 720 * 576],
    };
    assert!(matches!(
        fitted(&rig, &dark, None),
        Err(PoseFault::NoStripe(_))
    ));
    let small = GreyImage {
        width_px: 64,
        height_px: 64,
        pixels: vec![0; 64 * 64],
    };
    assert!(matches!(
        fitted(&rig, &small, None),
        Err(PoseFault::Size { .. })
    ));
}

#[test]
fn the_two_level_target_shows_pitch_and_place_without_the_thickness() {
    let mut rig = lshpi_rig();
    rig.target = Some(hydroline_rigs::Target::load_or_builtin("two-level").unwrap());
    let fitter = PoseFitter::new(&rig, Arc::new(IdealMap::of(&rig)));
    // Upper and lower zigzag meet the same place only after 1.3 m: only a hint decides which.
    assert_eq!(fitter.surfaces().period_m, None);
    for (x_m, theta_rad) in [(0.11, 0.012), (0.43, -0.009), (0.62, 0.004)] {
        let truth = Pose {
            x_m,
            theta_rad,
            ..POSE
        };
        let fit = fitted(&rig, &frame(&rig, &truth), Some(x_m + 0.02)).unwrap();
        let error = |i: usize| (fit.pose.to_array()[i] - truth.to_array()[i]).abs();
        // Required, rms: x 0.15 mm, z 0.06 mm, theta 0.012 deg; here three frames at three times that.
        assert!(error(0) < 4.5e-4 && error(2) < 1.8e-4, "{fit:?}");
        assert!(error(4).to_degrees() < 0.036, "{fit:?}");
    }
}

#[test]
fn a_frame_fitted_ahead_is_what_it_would_be_in_its_turn() {
    let mut rig = lshpi_rig();
    for two_level in [false, true] {
        if two_level {
            rig.target = Some(hydroline_rigs::Target::load_or_builtin("two-level").unwrap());
        }
        let image = frame(&rig, &POSE);
        let profile = Extractor::new(ExtractorConfig::default()).extract(&image);
        let fitter = PoseFitter::new(&rig, Arc::new(IdealMap::of(&rig)));
        let hint = |x_m: Option<f64>| Hint {
            x_m,
            ..Hint::default()
        };
        // Its own hint, one of the same hexagon, another hexagon, none, nowhere.
        let hints = [Some(0.2), Some(0.24), Some(0.44), None, Some(3.0)].map(hint);
        for expected in &hints {
            let speculative = fitter.speculative(&image, &profile, expected);
            for now in &hints {
                assert_eq!(
                    fitter.fit_speculative(&image, &profile, speculative.clone(), now),
                    fitter.fit(&image, &profile, now),
                    "{expected:?} {now:?}"
                );
            }
        }
    }
}

/// Poses at which a place found with pitch taken for zero was wrong by centimetres.
#[test]
fn pitch_does_not_hide_the_right_place_on_the_two_level_target() {
    let mut rig = lshpi_rig();
    rig.target = Some(hydroline_rigs::Target::load_or_builtin("two-level").unwrap());
    for truth in [
        [
            0.1951024, 0.0001395, -0.8376701, -0.0159067, -0.0068046, 0.0748400,
        ],
        [
            0.5658584, -0.0085163, -0.8377487, -0.0094630, 0.0047497, 0.0802213,
        ],
    ] {
        let truth = Pose::from_array(truth);
        let image = frame(&rig, &truth);
        for hint in [Some(truth.x_m), Some(truth.x_m - 0.03), None] {
            let fit = fitted(&rig, &image, hint).unwrap();
            for i in 0..6 {
                let error = (fit.pose.to_array()[i] - truth.to_array()[i]).abs();
                let sd = fit.covariance[(i, i)].sqrt();
                assert!(error < 5.0 * sd, "{i} off by {error}, sd {sd}, {hint:?}");
            }
        }
    }
}

#[test]
fn the_bound_is_that_of_an_independent_study() {
    // theory/geometry.md, one frame: 0.54 mm, 0.18 mm, 0.037 deg with thickness and brightness fitted, 0.25, 0.08,
    // 0.017 with both known; y 0.03 mm, roll 0.0003 deg, yaw 0.006 deg. Places differ by a factor.
    let rig = lshpi_rig();
    let fitter = PoseFitter::new(&rig, Arc::new(IdealMap::of(&rig)));
    let light = Light {
        brightness: 200.0,
        thickness_m: 0.002,
        background: 0.0,
        noise_sd: 2.0,
    };
    let sd = |known: bool, i: usize| fitter.bound(&POSE, &light, known).unwrap()[(i, i)].sqrt();
    let asked = [(0, 0.54e-3), (2, 0.18e-3), (4, 0.037f64.to_radians())];
    for (i, bound) in asked {
        assert!(
            (0.5..2.0).contains(&(sd(false, i) / bound)),
            "{i}: {}",
            sd(false, i)
        );
        assert!(sd(true, i) < 0.75 * sd(false, i), "{i}");
    }
    assert!(sd(false, 3).to_degrees() < 6e-4 && sd(false, 5).to_degrees() < 0.012);
}

/// Where a fit ended.
fn state_of(fit: &JointPose) -> State {
    State {
        pose: fit.pose,
        brightness: fit.brightness,
        thickness_m: fit.thickness_m,
        background: fit.background,
        tone: fit.tone,
        black: fit.black,
        across: fit.across,
        uneven: fit.uneven,
    }
}

/// The last step of a fit is taken without a look at where it leads: what was left after it.
#[test]
fn the_last_step_leaves_little() {
    use super::super::photometric::{Choice, EdgeModelError, RunParameters, Weighting};
    let rig = lshpi_rig();
    let fitter = PoseFitter::new(&rig, Arc::new(IdealMap::of(&rig)));
    let mut left = Vec::new();
    for k in 0..12 {
        let s = f64::from(k);
        let truth = Pose {
            x_m: -0.15 + 0.07 * s,
            y_m: 0.008 * (2.3 * s).sin(),
            z_m: -0.83 + 0.008 * (1.1 * s).cos(),
            phi_rad: 0.015 * (0.7 * s).sin(),
            theta_rad: 0.015 * (1.9 * s).cos(),
            psi_rad: 0.04 + 0.04 * (0.5 * s).sin(),
        };
        let image = frame(&rig, &truth);
        let fit = fitted(&rig, &image, Some(truth.x_m)).unwrap();
        let state = state_of(&fit);
        let weighting = Weighting {
            noise_sd: fit.noise_sd,
            cut: finish::CUT,
            redescending: true,
            response: photometric::Response::new([fit.tone, fit.black], fitter.ceiling),
            run_parameters: RunParameters::Estimated,
            even: false,
        };
        let plan = fitter.model.plan(&state, Choice::ALL);
        let none = &mut EdgeModelError::default();
        let picture = Picture::plain(&image.pixels, fitter.ceiling);
        let seen = fitter
            .model
            .compare(&plan, &picture, &state, &weighting, none, false);
        let model_error = &mut EdgeModelError::found(&seen.edges, fit.noise_sd);
        let mut free = [true; PARAMETERS];
        free[photometric::TONE..photometric::LOCAL].fill(fit.tone != 0.0);
        let limits = (20, lm_loop::Convergence::All(1e-9));
        let (end, _) = fitter
            .converge(
                &fitter.model,
                &plan,
                &picture,
                state,
                &free,
                &weighting,
                model_error,
                limits,
            )
            .unwrap();
        left.push(squared_distance(&fit.pose, &fit.covariance, &end.pose, &rig.mounts).unwrap());
    }
    left.sort_by(f64::total_cmp);
    println!("squared ways left, in sds: {left:.4?}");
    // Of six that are 6 where the fit is as far off as its own sd.
    assert!(left[6] < 0.05 && left[11] < 0.6, "{left:?}");
}

mod known;
mod light;
mod shared_errors;

mod hard {
    //! Frames that something is wrong with: a pose with its sd, or a reason; never another hexagon.

    use super::*;
    use proptest::prelude::*;
    use proptest::test_runner::RngSeed;
    use rand::{RngExt, SeedableRng, rngs::StdRng};

    #[derive(Debug, Clone, Copy)]
    enum Fault {
        Particles,
        EdgeOutside,
        Saturated,
        Hazy,
        TargetHalfLeft,
    }

    fn spoilt(image: &mut GreyImage, fault: Fault, seed: u64) {
        let mut random = StdRng::seed_from_u64(seed);
        match fault {
            Fault::Particles => {
                // Dark ones break the stripe, bright ones stand beside it.
                for _ in 0..40 {
                    let column = random.random_range(0..image.width_px);
                    let row = random.random_range(330..480usize);
                    let size = random.random_range(2..9usize);
                    let level = if random.random::<bool>() { 0 } else { 220 };
                    for r in row..(row + size).min(image.height_px) {
                        for c in column..(column + size).min(image.width_px) {
                            image.pixels[r * image.width_px + c] = level;
                        }
                    }
                }
            }
            Fault::EdgeOutside => {
                // The right quarter of the image is covered.
                let from = 3 * image.width_px / 4;
                for line in image.pixels.chunks_exact_mut(image.width_px) {
                    line[from..].fill(1);
                }
            }
            Fault::Saturated => {
                for p in &mut image.pixels {
                    *p = (f64::from(*p) * 2.0).min(255.0) as u8;
                }
            }
            Fault::Hazy => {
                for p in &mut image.pixels {
                    *p = (25.0 + 0.5 * f64::from(*p)) as u8;
                }
            }
            Fault::TargetHalfLeft => {}
        }
    }

    fn faults() -> impl Strategy<Value = Fault> {
        prop_oneof![
            Just(Fault::Particles),
            Just(Fault::EdgeOutside),
            Just(Fault::Saturated),
            Just(Fault::Hazy),
            Just(Fault::TargetHalfLeft),
        ]
    }

    fn is_flagged(fit: &JointPose) -> bool {
        [
            PoseCaveat::Ambiguous,
            PoseCaveat::WhichHexagon,
            PoseCaveat::Misfit,
        ]
        .iter()
        .any(|c| fit.caveats.contains(c))
    }

    proptest! {
        #![proptest_config(ProptestConfig { rng_seed: RngSeed::Fixed(7), failure_persistence: None, cases: 24, ..ProptestConfig::default() })]

        #[test]
        fn never_a_silent_jump(
            fault in faults(),
            x in -0.2..0.7f64,
            y in -0.01..0.01f64,
            tilt in (-0.017..0.017f64, -0.017..0.017f64),
            yaw in -0.08..0.08f64,
            off in -0.03..0.03f64,
            seed in 0..1000u64,
        ) {
            let rig = lshpi_rig();
            let x = match fault {
                // The last hexagon ends at 1.247 m, the sheet is 0.27 m ahead.
                Fault::TargetHalfLeft => 0.94 + 0.05 * x,
                _ => x,
            };
            let truth = Pose { x_m: x, y_m: y, z_m: -0.83, phi_rad: tilt.0, theta_rad: tilt.1, psi_rad: yaw };
            let mut image = frame(&rig, &truth);
            spoilt(&mut image, fault, seed);
            let Ok(fit) = fitted(&rig, &image, Some(x + off)) else {
                // A reason was given.
                return Ok(());
            };
            let is_flagged = is_flagged(&fit);
            for i in (0..6).filter(|i| fit.measured[*i] && !is_flagged) {
                let error = (fit.pose.to_array()[i] - truth.to_array()[i]).abs();
                let sd = fit.covariance[(i, i)].sqrt();
                // 24 cases of six numbers: 6 sd is far beyond what honest ones show.
                prop_assert!(error < 6.0 * sd || error < [5e-3, 1e-3, 2e-3, 2e-4, 5e-3, 2e-3][i],
                    "{fault:?}: {i} off by {error}, sd {sd}, {:?}", fit.caveats);
            }
            if fit.measured[0] && !is_flagged {
                prop_assert!((fit.pose.x_m - truth.x_m).abs() < 0.02, "{fault:?}: a jump in x: {}", fit.pose.x_m - truth.x_m);
            }
        }

        #[test]
        fn never_a_silent_jump_on_two_levels(
            x in -0.2..0.7f64,
            y in -0.01..0.01f64,
            tilt in (-0.017..0.017f64, -0.017..0.017f64),
            yaw in -0.08..0.08f64,
            off in -0.03..0.03f64,
        ) {
            let mut rig = lshpi_rig();
            rig.target = Some(hydroline_rigs::Target::load_or_builtin("two-level").unwrap());
            let truth = Pose { x_m: x, y_m: y, z_m: -0.83, phi_rad: tilt.0, theta_rad: tilt.1, psi_rad: yaw };
            let image = frame(&rig, &truth);
            // With a hint, and on a target that is nowhere like elsewhere also without.
            for hint in [Some(x + off), None] {
                let fit = fitted(&rig, &image, hint);
                prop_assert!(fit.is_ok(), "{:?}", fit);
                let Ok(fit) = fit else { continue };
                if is_flagged(&fit) {
                    continue;
                }
                for i in 0..6 {
                    let error = (fit.pose.to_array()[i] - truth.to_array()[i]).abs();
                    let least = [3e-4, 1e-4, 1e-4, 5e-5, 5e-4, 5e-4][i];
                    prop_assert!(error < 6.0 * fit.covariance[(i, i)].sqrt() || error < least, "{i} off by {error}");
                }
            }
        }
    }
}
