//! Our measurement effects against frames of an independent renderer that has them
//! (`cases/images/effects`: a true flat port, a tilted sheet, a scaled target, nothing).
//!
//! These logs hold no truth, so the pose of a frame is fitted to it: first to the stripe's rows, then
//! to the grey levels. Where our effect is theirs, what is left is their noise. The key is read by this
//! test only.

#![allow(clippy::unwrap_used, clippy::panic)] // a test

#[path = "../../tests/support/inputs.rs"]
mod inputs;

use fixture::lshpi_rig;
use std::path::Path;

#[path = "../../tests/support/lshpi_rig.rs"]
mod fixture;

use inputs::on_both_sets;

use hydroline_rigs::{ImageNoise, ParameterValue, PhysicsEntry, Rig, Wrench};
use hydroline_sim::scene::Pose6;
use hydroline_sim::{Renderer, World};
use nalgebra::{Matrix6, Vector6};
use prost::Message;

/// `foxglove.RawImage`, the fields needed here.
#[derive(Clone, PartialEq, Message)]
struct RawImage {
    #[prost(fixed32, tag = "5")]
    step: u32,
    #[prost(bytes = "vec", tag = "6")]
    data: Vec<u8>,
}

const WIDTH: usize = 720;
const HEIGHT: usize = 576;
/// Background of the cases (their frames have it; noise and blur are the rig's).
const AMBIENT: f64 = 12.0;
/// Prior of a frame's pose about the plain 8 N run: wide, it only holds the direction that a frame hardly shows.
const PRIOR: [f64; 6] = [0.02, 0.02, 0.02, 0.02, 0.01, 0.03];
/// Steps of the numeric derivatives.
const STEP: [f64; 6] = [2e-4, 2e-4, 2e-4, 2e-4, 2e-4, 2e-4];

/// Frames with seconds since the log's first stamp.
fn frames(path: &Path) -> Vec<(f64, Vec<f64>)> {
    let bytes = std::fs::read(path).unwrap();
    let mut found = Vec::new();
    let mut first = u64::MAX;
    for message in mcap::MessageStream::new(&bytes).unwrap() {
        let m = message.unwrap();
        first = first.min(m.publish_time);
        if m.channel.topic == "/camera/image" {
            let image = RawImage::decode(&m.data[..]).unwrap();
            let grey = (0..HEIGHT).flat_map(|row| {
                let from = row * image.step as usize;
                image.data[from..from + WIDTH].iter().map(|v| f64::from(*v))
            });
            found.push((m.publish_time, grey.collect()));
        }
    }
    found
        .into_iter()
        .map(|(t, grey)| ((t - first) as f64 * 1e-9, grey))
        .collect()
}

fn rig(entries: Vec<PhysicsEntry>) -> Rig {
    let mut rig = lshpi_rig();
    rig.camera.noise = ImageNoise {
        blur_px: 0.7,
        read_sd: 1.5,
        shot_gain: 0.0,
        ambient: AMBIENT,
    };
    // As in independent_frames.rs.
    rig.laser.peak = 190.1;
    rig.physics = entries;
    rig
}

fn entry(effect: &str, parameters: &[(&str, f64)]) -> PhysicsEntry {
    PhysicsEntry {
        effect: effect.to_owned(),
        parameters: parameters
            .iter()
            .map(|(n, v)| ((*n).to_owned(), ParameterValue::Number(*v)))
            .collect(),
    }
}

/// The key's entries in the rig file's words.
fn entries(key: &serde_json::Value) -> Vec<PhysicsEntry> {
    let key = key.as_object().unwrap();
    let number = |v: &serde_json::Value, i: usize| v[i].as_f64().unwrap();
    key.iter()
        .map(|(id, v)| match id.as_str() {
            "refraction" => entry(id, &[("n_water", number(v, 0)), ("port_m", number(v, 1))]),
            "laser_plane_tilt" => entry(
                id,
                &[
                    ("pitch_rad", number(v, 0).atan()),
                    ("yaw_rad", number(v, 1).atan()),
                ],
            ),
            "target_scale" => entry(id, &[("gain", v.as_f64().unwrap())]),
            other => panic!("{other} in the key"),
        })
        .collect()
}

/// Centre of the brightest thing in each column, by a Gaussian window of 2 px.
fn stripe(frame: &[f64]) -> Vec<Option<f64>> {
    (0..WIDTH)
        .map(|column| {
            let at = |row: usize| frame[row * WIDTH + column] - AMBIENT;
            let smooth = |row: &usize| at(row - 1) + 2.0 * at(*row) + at(row + 1);
            let best = (8..HEIGHT - 8).max_by(|a, b| smooth(a).total_cmp(&smooth(b)))?;
            if smooth(&best) < 160.0 {
                return None;
            }
            let mut c = best as f64;
            for _ in 0..30 {
                let (mut moment, mut sum) = (0.0, 0.0);
                for row in (c - 6.0).ceil().max(0.0) as usize..=((c + 6.0) as usize).min(HEIGHT - 1)
                {
                    let d = row as f64 - c;
                    let weight = (-0.5 * (d / 2.0).powi(2)).exp() * at(row);
                    (moment, sum) = (moment + weight * d, sum + weight);
                }
                c += (2.0 * moment / sum).clamp(-1.0, 1.0);
            }
            Some(c)
        })
        .collect()
}

/// Normal equations of residuals with numeric derivatives and the prior; the new pose.
fn improved(
    pose: [f64; 6],
    about: [f64; 6],
    sd: f64,
    residuals: impl Fn(&[f64; 6]) -> Vec<Option<f64>>,
) -> [f64; 6] {
    let now = residuals(&pose);
    let shifted: Vec<Vec<Option<f64>>> = (0..6)
        .map(|i| {
            let mut p = pose;
            p[i] += STEP[i];
            residuals(&p)
        })
        .collect();
    let mut normal = Matrix6::zeros();
    let mut right = Vector6::zeros();
    for (k, r) in now.iter().enumerate() {
        let Some(r) = r else { continue };
        let slope: Option<Vec<f64>> = (0..6)
            .map(|i| shifted[i][k].map(|s| (s - r) / STEP[i]))
            .collect();
        let Some(slope) = slope else { continue };
        let j = Vector6::from_column_slice(&slope);
        normal += j * j.transpose();
        right -= j * *r;
    }
    for i in 0..6 {
        let weight = (sd / PRIOR[i]).powi(2);
        normal[(i, i)] += weight;
        right[i] += weight * (about[i] - pose[i]);
    }
    let step = normal.lu().solve(&right).unwrap_or_else(Vector6::zeros);
    std::array::from_fn(|i| pose[i] + step[i])
}

/// Pose of a frame under a rig, and the robust deviation of what is left of its grey levels where there is light.
fn fit(renderer: &Renderer, frame: &[f64], about: [f64; 6]) -> ([f64; 6], f64) {
    let measured = stripe(frame);
    let rows = |pose: &[f64; 6]| {
        let mut predicted = vec![None; WIDTH];
        for p in renderer.profile_truth(&Pose6::from(*pose).into()) {
            if let Some(row) = measured[p.column_px as usize].filter(|_| !p.near_step) {
                let off = p.row_px - row;
                // Of two points in one column the nearer one; a wrong one is left away.
                let best = &mut predicted[p.column_px as usize];
                if off.abs() < 12.0 && best.is_none_or(|b: f64| off.abs() < b.abs()) {
                    *best = Some(off);
                }
            }
        }
        predicted
    };
    let mut pose = about;
    for _ in 0..12 {
        pose = improved(pose, about, 0.3, rows);
    }
    let lit: Vec<usize> = {
        let light = renderer.render_clean(&Pose6::from(pose));
        (0..WIDTH * HEIGHT)
            .filter(|i| light[*i] > 0.5 || frame[*i] > AMBIENT + 8.0)
            .collect()
    };
    let grey = |pose: &[f64; 6], of: &[usize]| {
        let light = renderer.render_clean(&Pose6::from(*pose));
        let off = |i: &usize| Some(f64::from(light[*i]) + AMBIENT - frame[*i]);
        of.iter().map(off).collect::<Vec<Option<f64>>>()
    };
    for _ in 0..8 {
        // Where the renderers differ at widest corners (independent_frames.rs, `at_corner`) tens of grey levels
        // stand out of the noise: what lies beyond three robust deviations does not count.
        let left: Vec<f64> = grey(&pose, &lit).into_iter().flatten().collect();
        let limit = 3.0 * robust(&left);
        let near = lit.iter().zip(&left).filter(|(_, r)| r.abs() < limit);
        let of: Vec<usize> = near.map(|(i, _)| *i).collect();
        pose = improved(pose, about, 1.5, |p| grey(p, &of));
    }
    let left: Vec<f64> = grey(&pose, &lit).into_iter().flatten().collect();
    (pose, robust(&left))
}

/// Standard deviation by the median: a few outliers do not move it.
fn robust(v: &[f64]) -> f64 {
    let mut sizes: Vec<f64> = v.iter().map(|x| x.abs()).collect();
    sizes.sort_by(f64::total_cmp);
    1.4826 * sizes[sizes.len() / 2]
}

fn their_effects_are_ours(logs: &Path) {
    let key: serde_json::Value =
        serde_json::from_slice(&std::fs::read(logs.join("key.json")).unwrap()).unwrap();
    let mut worst: Vec<String> = Vec::new();
    for name in ["a", "b", "c", "d"] {
        let frames = frames(&logs.join(format!("{name}.mcap")));
        let (early, late) = (&frames[frames.len() / 4], frames.last().unwrap());
        let plain = rig(Vec::new());
        let with = Renderer::new(&rig(entries(&key[name]))).unwrap();
        let without = Renderer::new(&plain).unwrap();
        let mut sums = [0.0; 2];
        let mut used = 0.0;
        for (t_s, frame) in [early, late] {
            let mut world = World::new(&plain, plain.tank.start_pose).unwrap();
            let ahead = Wrench {
                surge_n: 8.0,
                ..Wrench::default()
            };
            world.command(0.0, &ahead).unwrap();
            let about = world.state_at(*t_s).unwrap().eta;
            for (sum, renderer) in sums.iter_mut().zip([&with, &without]) {
                let (pose, rms) = fit(renderer, frame, about);
                println!(
                    "{name} t = {t_s:.2}: grey levels left {rms:.3}; pose off the plain run by {:.4?}",
                    std::array::from_fn::<f64, 6, _>(|i| pose[i] - about[i])
                );
                *sum += rms;
            }
            used += 1.0;
        }
        let [with, without] = sums.map(|s| s / used);
        println!("{name}: {with:.3} grey levels left with the key's effect, {without:.3} without");
        // Their noise is 1.5, rounding adds 1/12; the edges are supersampled differently.
        if with > 1.8 {
            worst.push(format!("{name}: {with} grey levels left"));
        }
        // Port and tilt fit no pose. A target 1.5 % larger shows at its edges alone, few of all lit pixels.
        let gain = match name {
            "a" | "b" => 2.0,
            "c" => 1.01,
            _ => 0.0,
        };
        if without < gain * with {
            worst.push(format!("{name}: {without} without, {with} with"));
        }
    }
    assert!(worst.is_empty(), "{worst:?}");
}

on_both_sets!("cases/images/effects":
    their_effects_are_ours,
);
