//! Our stripe and our images against frames of an independent renderer (`cases/images`).
//!
//! Truth (CG pose, z down from the floor) stands in the logs and is read by this test only.

#![allow(clippy::unwrap_used)] // a test

#[path = "../../tests/support/inputs.rs"]
mod inputs;

use fixture::lshpi_rig;
use std::collections::BTreeMap;
use std::path::Path;

#[path = "../../tests/support/lshpi_rig.rs"]
mod fixture;

use inputs::{logs_of, on_both_sets};

use hydroline_rigs::{ImageNoise, Rig};
use hydroline_sim::Renderer;
use hydroline_sim::scene::Pose6;
use prost::Message;

/// `foxglove.RawImage`, the fields needed here.
#[derive(Clone, PartialEq, Message)]
struct RawImage {
    #[prost(fixed32, tag = "2")]
    width: u32,
    #[prost(fixed32, tag = "3")]
    height: u32,
    #[prost(string, tag = "4")]
    encoding: String,
    #[prost(fixed32, tag = "5")]
    step: u32,
    #[prost(bytes = "vec", tag = "6")]
    data: Vec<u8>,
}

/// `hydroline.VehicleMotion`, the pose.
#[derive(Clone, PartialEq, Message)]
struct Motion {
    #[prost(double, optional, tag = "2")]
    x: Option<f64>,
    #[prost(double, optional, tag = "3")]
    y: Option<f64>,
    #[prost(double, optional, tag = "4")]
    z: Option<f64>,
    #[prost(double, optional, tag = "5")]
    phi: Option<f64>,
    #[prost(double, optional, tag = "6")]
    theta: Option<f64>,
    #[prost(double, optional, tag = "7")]
    psi: Option<f64>,
}

impl Motion {
    fn pose(&self) -> Pose6 {
        let or0 = |v: Option<f64>| v.unwrap_or(0.0);
        Pose6::from([
            or0(self.x),
            or0(self.y),
            or0(self.z),
            or0(self.phi),
            or0(self.theta),
            or0(self.psi),
        ])
    }
}

/// Frames with their true poses, by stamp.
fn read(path: &Path) -> Vec<(RawImage, Pose6)> {
    let bytes = std::fs::read(path).unwrap();
    let mut frames: BTreeMap<u64, RawImage> = BTreeMap::new();
    let mut poses: BTreeMap<u64, Pose6> = BTreeMap::new();
    for message in mcap::MessageStream::new(&bytes).unwrap() {
        let message = message.unwrap();
        match message.channel.topic.as_str() {
            "/camera/image" => {
                frames.insert(
                    message.publish_time,
                    RawImage::decode(&message.data[..]).unwrap(),
                );
            }
            "/sim/truth" => {
                poses.insert(
                    message.publish_time,
                    Motion::decode(&message.data[..]).unwrap().pose(),
                );
            }
            _ => {}
        }
    }
    frames
        .into_iter()
        .filter_map(|(t, f)| poses.get(&t).map(|p| (f, *p)))
        .collect()
}

/// Centre of the stripe in a column: zero of the matched derivative of a Gaussian, found from
/// the brightest smoothed row near `around`, with nothing of the prediction but that search range.
fn centre(frame: &RawImage, column: usize, around: f64) -> Option<f64> {
    let at = |row: i64| {
        (row >= 0 && row < i64::from(frame.height))
            .then(|| f64::from(frame.data[row as usize * frame.step as usize + column]))
    };
    let smooth = |row: i64| Some(at(row - 1)? + 2.0 * at(row)? + at(row + 1)?);
    let middle = around.round() as i64;
    let best = (middle - 6..=middle + 6)
        .filter_map(|r| Some((smooth(r)?, r)))
        .max_by(|a, b| a.0.total_cmp(&b.0))?;
    let mut c = best.1 as f64;
    let sigma = 2.0f64;
    for _ in 0..50 {
        let (mut moment, mut sum) = (0.0, 0.0);
        for row in (c - 8.0).ceil() as i64..=(c + 8.0).floor() as i64 {
            let d = row as f64 - c;
            let weight = (-0.5 * (d / sigma).powi(2)).exp();
            moment += weight * d * at(row)?;
            sum += weight * at(row)?;
        }
        let step = 2.0 * moment / sum;
        c += step;
        if step.abs() < 1e-6 {
            break;
        }
    }
    Some(c)
}

fn bare(mut rig: Rig) -> Rig {
    rig.target = None;
    rig
}

/// The rig as the cases were rendered: noise 1.5, blur 0.7 px, background 12.
fn case_rig() -> Rig {
    let mut rig = lshpi_rig();
    rig.camera.noise = ImageNoise {
        blur_px: 0.7,
        read_sd: 1.5,
        shot_gain: 0.0,
        ambient: 12.0,
    };
    // Not in their README: their stripe is 0.950 of 200 on every surface and in every log.
    rig.laser.peak = 190.1;
    rig
}

/// Sum, sum of squares, count.
#[derive(Default, Clone, Copy)]
struct Spread(f64, f64, usize);

impl Spread {
    fn add(&mut self, v: f64) {
        (self.0, self.1, self.2) = (self.0 + v, self.1 + v * v, self.2 + 1);
    }
    fn mean(self) -> f64 {
        self.0 / self.2 as f64
    }
    fn rms(self) -> f64 {
        (self.1 / self.2 as f64).sqrt()
    }
}

/// Every n-th frame: the whole set agrees alike, and the suite stays quick.
const FRAMES_PER_LOG: usize = 9;

fn stripe_and_image_match_an_independent_renderer(images: &Path) {
    for name in logs_of(
        images,
        &[
            "heave",
            "roll",
            "pitch",
            "yaw",
            "surge-4n",
            "surge-4n-disturbed",
        ],
    ) {
        let frames = read(&images.join(format!("{name}.mcap")));
        assert!(
            !frames.is_empty(),
            "{name}: no frame with a truth of the same stamp"
        );
        let rig = if ["heave", "roll", "pitch"].contains(&name) {
            bare(case_rig())
        } else {
            case_rig()
        };
        let renderer = Renderer::new(&rig).unwrap();
        let mut corners = Spread::default();
        let (mut line, mut lit, mut steps, mut dark) = (
            Spread::default(),
            Spread::default(),
            Spread::default(),
            Spread::default(),
        );
        let mut ours = Spread::default();
        for (frame, pose) in frames.iter().step_by(frames.len().div_ceil(FRAMES_PER_LOG)) {
            assert_eq!(
                (frame.width, frame.height, frame.encoding.as_str()),
                (720, 576, "mono8")
            );
            let clean = renderer.render_clean(pose);
            let scaled: Vec<u8> = clean.iter().map(|v| (v + 12.0).round() as u8).collect();
            let noiseless = RawImage {
                data: scaled,
                ..frame.clone()
            };
            let truth = renderer.profile_truth(&(*pose).into());
            let mut near = vec![true; 720]; // also where nothing is seen
            for far in [true, false] {
                for p in truth.iter().filter(|p| p.near_step != far) {
                    near[p.column_px as usize] = !far;
                }
            }
            for p in truth
                .iter()
                .filter(|p| !p.near_step && p.row_px > 12.0 && p.row_px < 563.0)
            {
                line.add(centre(frame, p.column_px as usize, p.row_px).unwrap() - p.row_px);
                ours.add(centre(&noiseless, p.column_px as usize, p.row_px).unwrap() - p.row_px);
            }
            for (i, (theirs, light)) in frame.data.iter().zip(&clean).enumerate() {
                let difference = f64::from(*theirs) - 12.0 - f64::from(*light);
                if *light <= 0.5 {
                    dark.add(difference);
                } else if near[i % 720] && rig.target.is_some() && at_corner(pose, i % 720) {
                    corners.add(difference);
                } else if near[i % 720] {
                    steps.add(difference);
                } else {
                    lit.add(difference);
                }
            }
        }
        println!(
            "{name}: stripe {:.4} px rms, mean {:+.4} (ours without noise {:+.4}), {} points; grey difference rms: lit {:.3}, near steps {:.3}, at corners {:.3} (mean {:+.3}), dark {:.3}",
            line.rms(),
            line.mean(),
            ours.mean(),
            line.2,
            lit.rms(),
            steps.rms(),
            corners.rms(),
            corners.mean(),
            dark.rms(),
        );
        assert!(line.2 > 2000, "{name}: {} points", line.2);
        assert!(
            line.rms() < 0.05,
            "{name}: stripe {} px rms from the prediction",
            line.rms()
        );
        // Perspective skews the stripe by a few thousandths of a pixel; both renderers must do so alike.
        assert!(
            (line.mean() - ours.mean()).abs() < 0.003,
            "{name}: {} against {}",
            line.mean(),
            ours.mean()
        );
        // Their noise is 1.5, rounding adds 1/12: 1.53 is what identical images would leave.
        assert!(
            (lit.rms() - 1.53).abs() < 0.1,
            "{name}: lit pixels differ by {} rms",
            lit.rms()
        );
        assert!(
            (dark.rms() - 1.53).abs() < 0.05,
            "{name}: dark pixels differ by {} rms",
            dark.rms()
        );
        // The edges are supersampled differently; that is all.
        assert!(
            steps.2 == 0 || steps.rms() < 2.0,
            "{name}: pixels near steps differ by {} rms",
            steps.rms()
        );
        // At a widest corner theirs can only be brighter (see `at_corner`).
        assert!(
            corners.2 == 0 || corners.mean() > -0.1,
            "{name}: corners differ by {} on average",
            corners.mean()
        );
    }
}

/// Whether the sheet crosses a widest corner of a hexagon on this side of the image.
///
/// A few millimetres beyond such a corner the board is hidden by the corner's vertical face: the line of sight
/// enters the hexagon below its top and leaves it again above the board. The frames show the board lit there
/// (their renderer compares heights where the ray meets each level, not between), ours does not; the marching
/// test in `scene/solid.rs` settles which is right.
fn at_corner(pose: &Pose6, column: usize) -> bool {
    let side_m = if column < 360 { -0.12 } else { 0.12 };
    let x_m = pose.x_m + 0.27 * pose.psi_rad.cos() - side_m * pose.psi_rad.sin()
        + 0.79 * pose.theta_rad.sin();
    let length_m = 3f64.sqrt() * 0.12;
    let beyond_m = (x_m - length_m / 2.0).rem_euclid(length_m);
    (0.0..6.0).contains(&(x_m / length_m)) && (beyond_m < 0.02 || beyond_m > length_m - 0.005)
}

on_both_sets!("cases/images":
    stripe_and_image_match_an_independent_renderer,
);
