//! Stripes of `cases/images` (an independent renderer) against what the truth in each
//! log predicts. The predictor here is written from theory/geometry.md alone and shares no code with
//! the simulator.

#![allow(clippy::unwrap_used, clippy::expect_used)]

use crate::inputs::{logs_of, on_both_sets};
use hydroline::frame::GreyImage;
use hydroline::stripe::{Extractor, ExtractorConfig, Profile, quality};
use nalgebra::{Rotation3, Vector3};
use prost::Message;
use std::path::Path;

/// `foxglove.RawImage`, as far as it is read here.
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

/// `hydroline.VehicleMotion`, as far as it is read here.
#[derive(Clone, PartialEq, Message)]
struct Pose {
    #[prost(double, optional, tag = "2")]
    x_m: Option<f64>,
    #[prost(double, optional, tag = "3")]
    y_m: Option<f64>,
    #[prost(double, optional, tag = "4")]
    z_m: Option<f64>,
    #[prost(double, optional, tag = "5")]
    phi_rad: Option<f64>,
    #[prost(double, optional, tag = "6")]
    theta_rad: Option<f64>,
    #[prost(double, optional, tag = "7")]
    psi_rad: Option<f64>,
}

// The rig of theory/geometry.md.
const L_LASER_M: f64 = 0.27;
const L_CAMERA_M: f64 = 0.19;
const H_CAMERA_M: f64 = 0.22;
const HALF_FAN_DEG: f64 = 20.0;
const SIDE_M: f64 = 0.12;
const BOARD_HALF_WIDTH_M: f64 = 0.15;
const LAYER_M: f64 = 0.02;
/// The sheet is Gaussian with sigma 2 mm: what lies this far before or behind it lights up too.
const CLEAR_SHEET_M: f64 = 0.008;
/// Columns on either side that must lie on the same level: the stripe is some 8 px thick.
const CLEAR_COLUMNS: usize = 8;

/// Frames of a log with the pose at the same stamp, in order.
fn frames(path: &Path) -> Vec<(GreyImage, Pose)> {
    let bytes = std::fs::read(path).unwrap();
    let (mut images, mut poses) = (Vec::new(), Vec::new());
    for message in mcap::MessageStream::new(&bytes).unwrap() {
        let message = message.unwrap();
        match message.channel.topic.as_str() {
            "/camera/image" => {
                let raw = RawImage::decode(&*message.data).unwrap();
                assert_eq!((raw.encoding.as_str(), raw.step), ("mono8", raw.width));
                let (width_px, height_px) = (raw.width as usize, raw.height as usize);
                images.push((
                    message.publish_time,
                    GreyImage {
                        width_px,
                        height_px,
                        pixels: raw.data,
                    },
                ));
            }
            "/sim/truth" => {
                poses.push((message.publish_time, Pose::decode(&*message.data).unwrap()))
            }
            _ => {}
        }
    }
    assert!(!images.is_empty(), "{} holds no image", path.display());
    images
        .into_iter()
        .map(|(time, image)| {
            let (_, pose) = poses
                .iter()
                .min_by_key(|(t, _)| t.abs_diff(time))
                .expect("truth for every frame");
            (image, pose.clone())
        })
        .collect()
}

/// Level of the surface at a place: 0 floor, 1 board, 2 hexagons.
fn level_at(x_m: f64, y_m: f64, target: bool) -> usize {
    let pitch = 3.0f64.sqrt() * SIDE_M;
    if !target || !(0.0..=6.0 * pitch).contains(&x_m) {
        return 0;
    }
    // Half width: half a side at the joints, a whole side in the middle of each hexagon.
    let from_joint = (x_m / pitch).fract().min(1.0 - (x_m / pitch).fract()) * pitch;
    if y_m.abs() <= 0.5 * SIDE_M + from_joint / 3.0f64.sqrt() {
        2
    } else {
        usize::from(y_m.abs() <= BOARD_HALF_WIDTH_M)
    }
}

/// Where the stripe is in one column.
#[derive(Clone, Copy)]
struct Predicted {
    row_px: f64,
    level: usize,
    /// The whole thickness of the sheet lies on that level, in sight of the camera.
    whole: bool,
}

/// `None` off the fan or where not exactly one level answers.
fn predict(pose: &Pose, column_px: f64, target: bool) -> Option<Predicted> {
    let focal_px = 288.0 / 18f64.to_radians().tan();
    let attitude = Rotation3::from_euler_angles(pose.phi_rad?, pose.theta_rad?, pose.psi_rad?);
    let cg = Vector3::new(pose.x_m?, pose.y_m?, pose.z_m?);
    let camera = Vector3::new(-L_CAMERA_M, 0.0, H_CAMERA_M);
    let (s, c) = 45f64.to_radians().sin_cos();
    let (axis, right, down) = (
        Vector3::new(s, 0.0, c),
        Vector3::y(),
        Vector3::new(-c, 0.0, s),
    );
    // Body point where the ray of (column, row) meets the sheet x_b = l_laser.
    let on_sheet = |row_px: f64| {
        let ray =
            axis + right * ((column_px - 359.5) / focal_px) + down * ((row_px - 287.5) / focal_px);
        camera + ray * ((L_LASER_M + L_CAMERA_M) / ray.x)
    };
    let mut found = None;
    for level in 0..3 {
        // Height above this level's plane falls monotonically with the row: bisection.
        let height = |row: f64| -(attitude * on_sheet(row) + cg).z - level as f64 * LAYER_M;
        let (mut low, mut high) = (-200.0, 776.0);
        if height(low) < 0.0 || height(high) > 0.0 {
            continue;
        }
        for _ in 0..60 {
            let middle = 0.5 * (low + high);
            if height(middle) > 0.0 {
                low = middle
            } else {
                high = middle
            }
        }
        let body = on_sheet(low);
        let tank = attitude * body + cg;
        let lit = body.y.abs() <= body.z * HALF_FAN_DEG.to_radians().tan();
        let forward = attitude * Vector3::x();
        let to_camera = attitude * (camera - body);
        // On this level there, and no higher slab between there and the camera.
        let seen = |place: Vector3<f64>| {
            level_at(place.x, place.y, target) == level
                && (level + 1..3).all(|higher| {
                    let rise = (higher - level) as f64 * LAYER_M;
                    let over = place + to_camera * (-rise / to_camera.z);
                    level_at(over.x, over.y, target) < higher
                })
        };
        if lit && seen(tank) {
            if found.is_some() {
                return None;
            }
            let whole = [-1.0, -0.5, 0.5, 1.0]
                .iter()
                .all(|part| seen(tank + forward * (part * CLEAR_SHEET_M)));
            found = Some(Predicted {
                row_px: low,
                level,
                whole,
            });
        }
    }
    found
}

/// Predictions of the columns away from steps and ends.
fn clear_predictions(pose: &Pose, width: usize, target: bool) -> Vec<(usize, f64)> {
    let all: Vec<_> = (0..width)
        .map(|c| predict(pose, c as f64, target))
        .collect();
    (CLEAR_COLUMNS..width - CLEAR_COLUMNS)
        .filter_map(|c| {
            let here = all[c]?;
            let same = |p: &Option<Predicted>| p.is_some_and(|p| p.level == here.level && p.whole);
            all[c - CLEAR_COLUMNS..=c + CLEAR_COLUMNS]
                .iter()
                .all(same)
                .then_some((c, here.row_px))
        })
        .collect()
}

#[derive(Default)]
struct Tally {
    wanted: f64,
    found: f64,
    sum: f64,
    square: f64,
    over_sd: f64,
    worst: f64,
}

fn compare(profile: &Profile, wanted: &[(usize, f64)], tally: &mut Tally) {
    for &(column, row) in wanted {
        tally.wanted += 1.0;
        if let Some(p) = profile.points.iter().find(|p| p.column_px == column as f64) {
            let error = p.row_px - row;
            tally.found += 1.0;
            tally.sum += error;
            tally.square += error * error;
            tally.over_sd += (error / p.sd_px).powi(2);
            tally.worst = tally.worst.max(error.abs());
        }
    }
}

fn stripes_lie_where_the_truth_puts_them(images: &Path) {
    println!(
        "{:20} {:>6} {:>8} {:>8} {:>7} {:>7} {:>7} {:>9}",
        "", "cover", "bias px", "rms px", "worst", "err/sd", "columns", "whole-px"
    );
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
        let target = matches!(name, "yaw" | "surge-4n" | "surge-4n-disturbed");
        let mut extractor = Extractor::new(ExtractorConfig::default());
        let mut paper = Extractor::new(ExtractorConfig {
            whole_pixel: true,
            ..Default::default()
        });
        let (mut ours, mut whole) = (Tally::default(), Tally::default());
        let mut worst_sound = 0.0f64;
        for (index, (image, pose)) in frames(&images.join(name).with_extension("mcap"))
            .iter()
            .enumerate()
        {
            let profile = extractor.extract(image);
            assert_eq!(profile.fault, None, "{name} frame {index}");
            let wanted = clear_predictions(pose, image.width_px, target);
            assert!(
                wanted.len() > 200,
                "{name} frame {index}: only {} clear columns",
                wanted.len()
            );
            compare(&profile, &wanted, &mut ours);
            compare(&paper.extract(image), &wanted, &mut whole);
            // A fresh extractor: no state may matter.
            assert_eq!(
                Extractor::new(ExtractorConfig::default()).extract(image),
                profile
            );
            // Columns called sound must be sound wherever the truth has one level.
            for p in profile
                .points
                .iter()
                .filter(|p| p.quality & quality::NEAR_STEP == 0)
            {
                if let Some(row) = predict(pose, p.column_px, target).map(|p| p.row_px) {
                    worst_sound = worst_sound.max((p.row_px - row).abs());
                }
            }
        }
        let rms = (ours.square / ours.found).sqrt();
        let whole_rms = (whole.square / whole.found).sqrt();
        println!(
            "{name:20} {:6.4} {:8.4} {rms:8.4} {:7.3} {:7.3} {:7} {whole_rms:9.4}",
            ours.found / ours.wanted,
            ours.sum / ours.found,
            ours.worst,
            (ours.over_sd / ours.found).sqrt(),
            ours.found
        );
        assert!(
            ours.found >= 0.999 * ours.wanted,
            "{name}: {} of {} columns",
            ours.found,
            ours.wanted
        );
        println!(
            "{:20} worst of all points called sound: {worst_sound:.3} px",
            ""
        );
        assert!(
            worst_sound < 0.3,
            "{name}: a point {worst_sound} px off carries no NEAR_STEP"
        );
        assert!(rms <= 0.05, "{name}: rms {rms} px");
        // The paper's whole pixel: +-0.5 px uniform has rms 0.29.
        assert!(
            (0.2..0.45).contains(&whole_rms),
            "{name}: whole-pixel rms {whole_rms} px"
        );
    }
}

on_both_sets!("cases/images":
    stripes_lie_where_the_truth_puts_them,
);
