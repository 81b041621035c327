//! Runs of a camera whose response the rig states, as `hydroline flat` measures it, beside clean ones: same poses, same noise.

use super::light::{Light, anywhere};
use super::*;
use hydroline_rigs::StatedResponse;
use rand::SeedableRng;
use rand::rngs::StdRng;
use rand_distr::{Distribution, StandardNormal};

/// How well an exposure series knows γ and b.
const KNOWN_SD: [f64; 2] = [0.002, 0.1];
/// Frames of the opening, and after it.
const FRAMES: [usize; 2] = [8, 3];
const EFFECTS: [&str; 7] = [
    "shading", "line", "ambient", "tone", "banding", "lamp", "all",
];

/// Errors of the frames after the opening, and their sds; `None` where there is no pose.
type Errors = Vec<Option<[[f64; 2]; 6]>>;

struct Bench {
    rig: Rig,
    renderer: Renderer,
}

impl Bench {
    fn new() -> Bench {
        let mut rig = lshpi_rig();
        rig.camera.noise.read_sd = 0.0;
        rig.camera.noise.shot_gain = 0.0;
        rig.camera.noise.ambient = 0.0;
        Bench {
            renderer: Renderer::new(&rig).unwrap(),
            rig,
        }
    }

    /// A run under a light: the poses and the noise are the seed's.
    fn run(&self, light: &Light, stated: Option<StatedResponse>, seed: u64) -> Errors {
        let mut rig = self.rig.clone();
        rig.camera.response = stated;
        let map: Arc<dyn PlaneMap> = Arc::new(IdealMap::of(&rig));
        let mut rng = StdRng::seed_from_u64(seed);
        let seen = |truth: &Pose, rng: &mut StdRng| {
            let clean = self.renderer.render_clean(&Pose6::from(truth.to_array()));
            light.photograph(&clean, 12.0, rng)
        };
        let mut extractor = Extractor::new(ExtractorConfig::default());
        let fitter = PoseFitter::new(&rig, map);
        let open = fitter.with_response_open();
        let rest = anywhere(&mut rng);
        let hint = |truth: &Pose| Hint {
            x_m: Some(truth.x_m + 0.01),
            ..Hint::default()
        };
        let said: Vec<ResponseSeen> = (0..FRAMES[0])
            .filter_map(|_| {
                let image = seen(&rest, &mut rng);
                let fit = open.fit(&image, &extractor.extract(&image), &hint(&rest));
                fit.ok().filter(|fit| !fit.is_flagged())?.response
            })
            .collect();
        let (known, _) = fitter.response_prior();
        let response = CameraResponse::of_opening_with_prior(&said, known);
        let fitter = fitter.with_response(response.unwrap_or(known.response()));
        (0..FRAMES[1])
            .map(|_| {
                let truth = anywhere(&mut rng);
                let image = seen(&truth, &mut rng);
                let fit = fitter.fit(&image, &extractor.extract(&image), &hint(&truth));
                let fit = fit.ok().filter(|fit| !fit.is_flagged())?;
                Some(std::array::from_fn(|i| {
                    let off = fit.pose.to_array()[i] - truth.to_array()[i];
                    [off, fit.covariance[(i, i)].sqrt()]
                }))
            })
            .collect()
    }
}

/// Response that a rig states of a light's camera: right within its sds.
fn stated(light: &Light, rng: &mut StdRng) -> StatedResponse {
    let mut off = |sd: f64| {
        let of: f64 = StandardNormal.sample(rng);
        sd * of
    };
    let black = light.range.map_or(0.0, |[low, _]| low);
    StatedResponse {
        gamma: light.tone.exp() + off(KNOWN_SD[0]),
        gamma_sd: KNOWN_SD[0],
        black_levels: Some([black + off(KNOWN_SD[1]), KNOWN_SD[1]]),
        gamma_black_correlation: 0.0,
        ceiling_levels: light.range.map(|[_, high]| high as u8),
        source: "test".to_owned(),
    }
}

/// Of an effect: sums of squares by degree of freedom, of errors and of errors in sds, for known, open and clean runs.
#[derive(Debug, Clone, Copy, Default)]
struct Sums {
    frames: f64,
    square: [[f64; 6]; 3],
    in_sds: [[f64; 6]; 3],
    worst: f64,
}

/// Runs by turns under each effect: sums of each, frames without a pose.
fn judged(runs: usize, seed: u64) -> ([Sums; 7], usize) {
    let bench = Bench::new();
    let (mut sums, mut without) = ([Sums::default(); 7], 0);
    for k in 0..runs {
        let of_run = seed ^ (k as u64) << 32;
        let mut rng = StdRng::seed_from_u64(!of_run);
        let light = Light::drawn(&mut rng, k);
        let known = stated(&light, &mut rng);
        let of_known = bench.run(&light, Some(known), of_run);
        let of_open = bench.run(&light, None, of_run);
        let of_clean = bench.run(&Light::default(), None, of_run);
        let sum = &mut sums[k % 7];
        for ((known, open), clean) in of_known.iter().zip(&of_open).zip(&of_clean) {
            without += usize::from(known.is_none());
            let (Some(known), Some(open), Some(clean)) = (known, open, clean) else {
                continue;
            };
            sum.frames += 1.0;
            for (which, errors) in [known, open, clean].iter().enumerate() {
                for (i, [off, sd]) in errors.iter().enumerate() {
                    sum.square[which][i] += off * off;
                    sum.in_sds[which][i] += (off / sd).powi(2);
                    if which == 0 {
                        sum.worst = sum.worst.max((off / sd).abs());
                    }
                }
            }
        }
    }
    (sums, without)
}

/// One line of a table: rms over clean by degree of freedom, and mean squared error in sds.
fn line(name: &str, sums: &Sums, which: usize) -> String {
    let ratios: Vec<String> = (0..6)
        .map(|i| format!("{:.2}", (sums.square[which][i] / sums.square[2][i]).sqrt()))
        .collect();
    let mse = sums.in_sds[which].iter().sum::<f64>() / (6.0 * sums.frames);
    format!(
        "{name:>8}: rms / clean, x y z φ θ ψ: {}; mean squared error in sds {mse:.2}, worst {:.1}, {} frames",
        ratios.join(" "),
        sums.worst,
        sums.frames
    )
}

#[test]
fn a_camera_that_is_known_gives_poses_as_a_clean_one_does() {
    let (sums, without) = judged(7, 0x0f1a_0001);
    let mut all = Sums::default();
    for (name, of) in EFFECTS.iter().zip(&sums) {
        println!("{}", line(name, of, 0));
        all.frames += of.frames;
        all.worst = all.worst.max(of.worst);
        for i in 0..6 {
            all.square[0][i] += of.square[0][i];
            all.square[2][i] += of.square[2][i];
            all.in_sds[0][i] += of.in_sds[0][i];
        }
    }
    println!("{}", line("together", &all, 0));
    assert!(without <= 1, "{without} of 21 frames have no pose");
    assert!(all.worst < 4.5, "{}", all.worst);
    let mse = all.in_sds[0].iter().sum::<f64>() / (6.0 * all.frames);
    // 21 frames of six: the mean's own sd is about 0.2, frames of a run share their response.
    assert!((0.4..1.8).contains(&mse), "{mse}");
}

#[test]
#[ignore = "takes minutes"]
fn known_cameras_table() {
    let (sums, without) = judged(84, 0x0f1a_0002);
    let mut worst = 0.0f64;
    for (name, of) in EFFECTS.iter().zip(&sums) {
        println!("known {}", line(name, of, 0));
        println!(" open {}", line(name, of, 1));
        worst = worst.max(of.worst);
    }
    println!("{without} frames have no pose");
    assert!(worst < 4.5, "{worst}");
    assert!(without <= 8, "{without} of 252 frames have no pose");
}
