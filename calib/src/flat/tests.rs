//! Series of simulated cameras: the curve within its sds, and every reason to refuse one.

use super::*;
use rand::rngs::StdRng;
use rand::{RngExt, SeedableRng};
use rand_distr::{Distribution, StandardNormal};

const WIDTH: usize = 240;
const HEIGHT: usize = 184;

/// A camera of its own kind: light with noise, curve, black level, ceiling, rounding.
#[derive(Debug, Clone, Copy)]
struct Camera {
    gamma: f64,
    black: f64,
    ceiling: f64,
    read_sd: f64,
    shot_gain: f64,
    /// Toe of sRGB: light below this share is a straight line.
    toe: f64,
    /// S-curve: grey levels by which the middle is shifted.
    s_curve: f64,
}

impl Camera {
    fn drawn(rng: &mut StdRng) -> Camera {
        Camera {
            gamma: rng.random_range(0.4f64.ln()..2.5f64.ln()).exp(),
            black: rng.random_range(-8.0..20.0),
            ceiling: [235.0, 240.0, 255.0][rng.random_range(0..3)],
            read_sd: rng.random_range(0.5..2.5),
            shot_gain: rng.random_range(0.0..0.05),
            toe: 0.0,
            s_curve: 0.0,
        }
    }

    /// The sensor's own end, or that of the levels.
    fn clip_level(&self) -> f64 {
        (self.black + 255.0).min(self.ceiling).round()
    }

    fn grey(&self, light: f64, rng: &mut StdRng) -> u8 {
        let sd = (self.read_sd * self.read_sd + self.shot_gain * light).sqrt();
        let noise: f64 = StandardNormal.sample(rng);
        let share = (light + sd * noise).clamp(0.0, 255.0) / 255.0;
        let power = |share: f64| share.powf(self.gamma);
        let curved = if share < self.toe {
            // Straight to no light, where the camera has level 0.
            let at = self.black + 255.0 * power(self.toe);
            at * share / self.toe - self.black
        } else {
            255.0 * power(share)
        };
        let nonlinear = curved + self.s_curve * (std::f64::consts::TAU * curved / 255.0).sin();
        (self.black + nonlinear)
            .min(self.ceiling)
            .round()
            .clamp(0.0, 255.0) as u8
    }
}

/// A still scene: light of each place under an exposure of 1.
fn scene(rng: &mut StdRng) -> Vec<f64> {
    let waves: Vec<[f64; 4]> = (0..6)
        .map(|_| {
            [
                rng.random_range(-0.08..0.08),
                rng.random_range(-0.08..0.08),
                rng.random_range(0.0..std::f64::consts::TAU),
                rng.random_range(0.2..0.7),
            ]
        })
        .collect();
    let at = |k: usize| {
        let (u, v) = ((k % WIDTH) as f64, (k / WIDTH) as f64);
        let ln: f64 = waves
            .iter()
            .map(|[a, b, c, d]| d * (a * u + b * v + c).sin())
            .sum();
        // Patches as of a grey card, with edges.
        let patch = 0.3 * (((k % WIDTH) / 40 + (k / WIDTH) / 40) % 4) as f64;
        (ln + patch).exp()
    };
    (0..WIDTH * HEIGHT).map(at).collect()
}

/// Disturbances while a series is recorded.
#[derive(Debug, Clone, Copy, Default)]
struct Trouble {
    /// Share by which the lamp scatters from exposure to exposure.
    lamp: f64,
    /// Share by which it scatters from frame to frame.
    flicker: f64,
    /// Share that frames gain from first to last of an exposure.
    drift: f64,
    /// Auto exposure: power of the time that is taken back.
    automatic: f64,
    /// Pixels that the scene moves between exposures.
    shift_px: usize,
    /// Share of the picture that something covers in one exposure.
    covered: f64,
}

const TIMES: [f64; 7] = [1.0, 2.0, 4.0, 8.0, 16.0, 32.0, 64.0];

fn series(
    camera: &Camera,
    trouble: &Trouble,
    times: &[f64],
    frames: usize,
    rng: &mut StdRng,
) -> Vec<Exposure> {
    let scene = scene(rng);
    let middle = {
        let mut sorted = scene.clone();
        sorted.sort_by(f64::total_cmp);
        sorted[scene.len() / 2]
    };
    // The middle of the scene is clipped under the longest but one.
    let gain = 255.0 / (middle * 32.0);
    times
        .iter()
        .enumerate()
        .map(|(k, time)| {
            let mut exposure = Exposure::new(format!("{time} ms"), time * 1e-3);
            let of_lamp: f64 = StandardNormal.sample(rng);
            for f in 0..frames {
                let of_frame: f64 = StandardNormal.sample(rng);
                let brightness = gain
                    * time.powf(1.0 - trouble.automatic)
                    * (1.0 + trouble.lamp * of_lamp)
                    * (1.0 + trouble.flicker * of_frame).max(0.1)
                    * (1.0 + trouble.drift * f as f64 / frames as f64);
                let pixels: Vec<u8> = (0..scene.len())
                    .map(|p| {
                        let from = (p + k * trouble.shift_px) % scene.len();
                        let hidden = k == 3 && (p as f64) < trouble.covered * scene.len() as f64;
                        let light = if hidden { 0.4 } else { 1.0 } * brightness * scene[from];
                        camera.grey(light, rng)
                    })
                    .collect();
                exposure.add(&pixels, WIDTH, HEIGHT).unwrap();
            }
            exposure
        })
        .collect()
}

fn found(camera: &Camera, trouble: &Trouble, seed: u64) -> Result<Flat, FlatError> {
    let mut rng = StdRng::seed_from_u64(seed);
    let exposures = series(camera, trouble, &TIMES, 8, &mut rng);
    response(&exposures, None, &Options::default())
}

const PLAIN: Camera = Camera {
    gamma: 0.45,
    black: 16.0,
    ceiling: 235.0,
    read_sd: 1.5,
    shot_gain: 0.01,
    toe: 0.0,
    s_curve: 0.0,
};

/// Errors of γ and b in sds, of so many cameras.
fn pulls(cameras: u64, trouble: &Trouble) -> (Vec<[f64; 2]>, Vec<String>) {
    let (mut all, mut wrong) = (Vec::new(), Vec::new());
    for k in 0..cameras {
        let mut rng = StdRng::seed_from_u64(0xf1a7 + k);
        let camera = Camera::drawn(&mut rng);
        match found(&camera, trouble, k) {
            Ok(flat) => {
                let pull = [
                    (flat.gamma[0] - camera.gamma) / flat.gamma[1],
                    (flat.black_levels[0] - camera.black) / flat.black_levels[1],
                ];
                println!(
                    "{k}: γ {:.3} b {:.1} c {}: {:.4} ± {:.4}, {:.2} ± {:.2}, r {:.2}; pulls {pull:.1?}; c {:?}, levels {:.0?}, dev {:.3}, scatter {:.4}, χ² {:.2}, {:?}",
                    camera.gamma,
                    camera.black,
                    camera.ceiling,
                    flat.gamma[0],
                    flat.gamma[1],
                    flat.black_levels[0],
                    flat.black_levels[1],
                    flat.correlation,
                    flat.ceiling_levels,
                    flat.levels,
                    flat.deviation.rms_levels,
                    flat.scatter,
                    flat.chi2,
                    flat.blocks
                );
                if flat
                    .ceiling_levels
                    .is_some_and(|c| f64::from(c) != camera.clip_level())
                {
                    wrong.push(format!(
                        "{k}: ceiling {:?}, {}",
                        flat.ceiling_levels,
                        camera.clip_level()
                    ));
                }
                all.push(pull);
            }
            Err(error) => wrong.push(format!("{k}: {camera:?}: {error}")),
        }
    }
    (all, wrong)
}

/// Mean square of each, and the largest.
fn summary(pulls: &[[f64; 2]]) -> [[f64; 2]; 2] {
    [0, 1].map(|i| {
        let square: f64 = pulls.iter().map(|p| p[i] * p[i]).sum();
        let most = pulls.iter().map(|p| p[i].abs()).fold(0.0, f64::max);
        [square / pulls.len() as f64, most]
    })
}

#[test]
fn gamma_and_black_level_are_within_their_sds() {
    let (pulls, wrong) = pulls(24, &Trouble::default());
    println!("{:.2?}", summary(&pulls));
    assert!(wrong.is_empty(), "{wrong:#?}");
    for [square, most] in summary(&pulls) {
        assert!(
            (0.2..1.8).contains(&square) && most < 4.0,
            "{square} {most}"
        );
    }
}

#[test]
#[ignore = "hundreds of cameras take minutes"]
fn gamma_and_black_level_of_200_cameras_are_within_their_sds() {
    for (name, trouble) in [
        ("steady", Trouble::default()),
        (
            "lamp 1 %",
            Trouble {
                lamp: 0.01,
                flicker: 0.02,
                ..Trouble::default()
            },
        ),
    ] {
        let (pulls, wrong) = pulls(200, &trouble);
        println!(
            "{name}: {:.2?}, {} refused {wrong:#?}",
            summary(&pulls),
            wrong.len()
        );
        assert!(wrong.len() <= 4, "{wrong:#?}");
        for [square, most] in summary(&pulls) {
            // The sds allow for a curve that is a rounded table, which these cameras do not have: .3 and .5 are expected of
            // them, not 1.
            assert!(
                (0.2..1.4).contains(&square) && most < 4.5,
                "{square} {most}"
            );
        }
    }
}

#[test]
fn a_lamp_that_scatters_widens_gamma() {
    let trouble = Trouble {
        lamp: 0.01,
        flicker: 0.02,
        ..Trouble::default()
    };
    let steady = found(&PLAIN, &Trouble::default(), 3).unwrap();
    let (pulls, wrong) = pulls(12, &trouble);
    assert!(wrong.is_empty(), "{wrong:#?}");
    for [square, most] in summary(&pulls) {
        assert!(square < 2.2 && most < 4.0, "{square} {most}");
    }
    let scattered = found(&PLAIN, &trouble, 3).unwrap();
    assert!(scattered.gamma[1] > 1.5 * steady.gamma[1], "{scattered:?}");
    assert!(
        scattered.remarks.iter().any(|r| r.contains("differ by")),
        "{:?}",
        scattered.remarks
    );
}

#[test]
fn a_toe_is_left_out_and_said_and_an_s_curve_is_refused() {
    // sRGB: 1.055 L^(1/2.4) − 0.055, straight below 0.0031.
    let srgb = Camera {
        gamma: 1.0 / 2.4,
        black: -14.0,
        ceiling: 255.0,
        toe: 0.0031308,
        ..PLAIN
    };
    let flat = found(&srgb, &Trouble::default(), 5).unwrap();
    println!("{flat:?}");
    let off = (flat.gamma[0] - srgb.gamma) / flat.gamma[1];
    assert!(off.abs() < 4.0, "{off}: {flat:?}");
    let nonlinear = Camera {
        s_curve: 6.0,
        ..PLAIN
    };
    let error = found(&nonlinear, &Trouble::default(), 5).unwrap_err();
    assert!(matches!(error, FlatError::NoPower { .. }), "{error}");
    assert!(error.to_string().contains("grey levels rms"), "{error}");
}

#[test]
fn a_curve_that_is_nearly_a_power_widens_what_is_known() {
    let steady = found(&PLAIN, &Trouble::default(), 5).unwrap();
    let nonlinear = Camera {
        s_curve: 0.3,
        ..PLAIN
    };
    let flat = found(&nonlinear, &Trouble::default(), 5).unwrap();
    println!("{steady:?}\n{flat:?}");
    assert!(flat.gamma[1] > 2.0 * steady.gamma[1], "{flat:?}");
    assert!(
        ((flat.gamma[0] - nonlinear.gamma) / flat.gamma[1]).abs() < 4.0,
        "{flat:?}"
    );
}

#[test]
fn what_is_not_a_series_of_a_still_scene_is_refused_with_the_next_step() {
    let cases = [
        (
            Trouble {
                automatic: 1.0,
                ..Trouble::default()
            },
            "manual",
        ),
        (
            Trouble {
                automatic: 0.9,
                ..Trouble::default()
            },
            "manual",
        ),
        (
            Trouble {
                lamp: 0.3,
                ..Trouble::default()
            },
            "auto exposure",
        ),
        (
            Trouble {
                drift: 0.2,
                ..Trouble::default()
            },
            "from first to last",
        ),
        (
            Trouble {
                flicker: 0.4,
                ..Trouble::default()
            },
            "flickers",
        ),
        (
            Trouble {
                shift_px: 9,
                ..Trouble::default()
            },
            "moved",
        ),
        (
            Trouble {
                covered: 0.5,
                ..Trouble::default()
            },
            "moved",
        ),
    ];
    for (trouble, words) in cases {
        let error = found(&PLAIN, &trouble, 7).expect_err(&format!("{trouble:?}"));
        println!("{trouble:?}: {error}");
        assert!(error.to_string().contains(words), "{trouble:?}: {error}");
    }
    // A fish before the lens of one exposure is discarded.
    let fish = Trouble {
        covered: 0.08,
        ..Trouble::default()
    };
    let flat = found(&PLAIN, &fish, 7).unwrap();
    println!("{flat:?}");
    assert!(
        ((flat.gamma[0] - PLAIN.gamma) / flat.gamma[1]).abs() < 4.0,
        "{flat:?}"
    );
}

#[test]
fn too_little_is_refused_with_numbers() {
    let mut rng = StdRng::seed_from_u64(11);
    let mut of = |times: &[f64], frames| {
        let exposures = series(&PLAIN, &Trouble::default(), times, frames, &mut rng);
        response(&exposures, None, &Options::default()).unwrap_err()
    };
    let error = of(&[4.0, 8.0], 4);
    assert!(
        matches!(error, FlatError::FewExposures { exposures: 2, .. }),
        "{error}"
    );
    let error = of(&[4.0, 8.0, 16.0], 2);
    assert!(
        matches!(error, FlatError::FewFrames { frames: 2, .. }),
        "{error}"
    );
    let error = of(&[0.001, 0.002, 0.004], 4);
    assert!(matches!(error, FlatError::Little { .. }), "{error}");
    let error = of(&[4.0, 8.0, 4000.0], 4);
    assert!(matches!(error, FlatError::Apart { .. }), "{error}");
    let mut exposure = Exposure::new("a".to_owned(), 1.0);
    exposure.add(&[0; 64 * 48], 64, 48).unwrap();
    let error = exposure.add(&[0; 64 * 49], 64, 49).unwrap_err();
    assert!(error.to_string().contains("(64, 49)"), "{error}");
}

#[test]
fn dark_frames_count_where_they_agree_and_are_said_where_not() {
    let mut rng = StdRng::seed_from_u64(13);
    let exposures = series(&PLAIN, &Trouble::default(), &TIMES, 6, &mut rng);
    let dark = |camera: &Camera, light: f64, rng: &mut StdRng| {
        let mut dark = Exposure::new("dark".to_owned(), 0.01);
        for _ in 0..4 {
            let pixels: Vec<u8> = (0..WIDTH * HEIGHT)
                .map(|_| camera.grey(light, rng))
                .collect();
            dark.add(&pixels, WIDTH, HEIGHT).unwrap();
        }
        dark
    };
    let options = Options::default();
    let without = response(&exposures, None, &options).unwrap();
    let with = response(&exposures, Some(&dark(&PLAIN, 0.0, &mut rng)), &options).unwrap();
    println!("{without:?}\n{with:?}");
    assert!(
        with.remarks.iter().any(|r| r.contains("counted in")),
        "{:?}",
        with.remarks
    );
    assert!(with.black_levels[1] <= without.black_levels[1] && with.gamma[1] <= without.gamma[1]);
    assert!(((with.black_levels[0] - 16.0) / with.black_levels[1]).abs() < 4.0);
    // Another camera's, or with the lens open.
    let off = Camera {
        black: 30.0,
        ..PLAIN
    };
    let against = response(&exposures, Some(&dark(&off, 0.0, &mut rng)), &options).unwrap();
    assert_eq!(against.gamma, without.gamma);
    assert!(
        against.remarks.iter().any(|r| r.contains("toe")),
        "{:?}",
        against.remarks
    );
}

#[test]
fn what_is_stated_is_a_table_that_a_rig_reads() {
    let flat = found(&PLAIN, &Trouble::default(), 17).unwrap();
    let stated = flat.stated("hydroline flat".to_owned());
    assert_eq!(stated.ceiling_levels, Some(235));
    assert!((stated.gamma - flat.gamma[0]).abs() < 0.02 * flat.gamma[1]);
    let mut rig = hydroline_rigs::Rig::builtin("lshpi").unwrap();
    rig.camera.response = Some(stated);
    let again = hydroline_rigs::Rig::from_toml(&rig.to_toml(), "again.toml", None).unwrap();
    assert_eq!(again.camera, rig.camera);
}

#[test]
fn a_linear_camera_that_cuts_off_dark_noise_is_not_biased_by_it() {
    // Seed 65 of the 200: the lowest levels are no pile, and their means are those of cut-off noise.
    let mut rng = StdRng::seed_from_u64(0xf1a7 + 65);
    let camera = Camera::drawn(&mut rng);
    assert!((camera.gamma - 1.0).abs() < 0.02, "{camera:?}");
    let flat = found(&camera, &Trouble::default(), 65).unwrap();
    let pull = (flat.gamma[0] - camera.gamma) / flat.gamma[1];
    assert!(pull.abs() < 4.0, "{pull}: {flat:?}");
}
