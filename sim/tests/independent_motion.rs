//! Our motion, with the concealed effects switched on, against an independent 6-DOF model (`cases/motion`).
//!
//! The key is read by this test only; nothing here fits anything.
#![allow(clippy::unwrap_used)] // a test

#[path = "../../tests/support/inputs.rs"]
mod inputs;

use fixture::lshpi_rig;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

#[path = "../../tests/support/lshpi_rig.rs"]
mod fixture;

use hydroline_rigs::{ParameterValue, PhysicsEntry, Wrench};
use hydroline_sim::World;
use hydroline_sim::effect::find;
use prost::Message;

#[derive(Clone, PartialEq, Message)]
struct Command {
    #[prost(string, tag = "3")]
    thruster: String,
    #[prost(double, tag = "4")]
    thrust: f64,
}

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

/// Stamps [ns] with commands and poses.
type Run = (Vec<(u64, Command)>, Vec<(u64, Motion)>);

fn read(path: &Path) -> Run {
    let bytes = std::fs::read(path).unwrap();
    let (mut commands, mut poses) = (Vec::new(), Vec::new());
    for message in mcap::MessageStream::new(&bytes).unwrap() {
        let m = message.unwrap();
        match m.channel.topic.as_str() {
            "/thruster/command" => {
                commands.push((m.publish_time, Command::decode(&m.data[..]).unwrap()))
            }
            "/vehicle/motion" => poses.push((m.publish_time, Motion::decode(&m.data[..]).unwrap())),
            _ => {}
        }
    }
    (commands, poses)
}

/// Their noise (0.15 mm) again: correlated, but its middle is that of the white one.
const TANK_NOISE_MM: f64 = 0.17;

fn median(mut v: Vec<f64>) -> f64 {
    v.sort_by(f64::total_cmp);
    v[v.len() / 2]
}

const NAMES: [[&str; 3]; 6] = [
    ["x_udot", "x_u", "x_uu"],
    ["y_vdot", "y_v", "y_vv"],
    ["z_wdot", "z_w", "z_ww"],
    ["k_pdot", "k_p", "k_pp"],
    ["m_qdot", "m_q", "m_qq"],
    ["n_rdot", "n_r", "n_rr"],
];

#[test]
fn cases_whose_effects_we_know_are_reproduced_to_their_noise() {
    let Some(dir) = inputs::input("cases/motion") else {
        return;
    };
    let key: serde_json::Value =
        serde_json::from_slice(&std::fs::read(dir.join("key.json")).unwrap()).unwrap();
    let mut used = 0;
    for case in key.as_array().unwrap() {
        let effects = case["effects"].as_object().unwrap();
        let background = case["background"].as_object().unwrap();
        if case["in_vocabulary"] != true {
            continue;
        }
        let name = case["case"].as_str().unwrap();
        for id in effects.keys().chain(background.keys()) {
            assert!(find(id).is_some(), "{name}: no effect {id}");
        }
        let mut rig = lshpi_rig();
        for (c, names) in rig.vehicle.coefficients.iter_mut().zip(NAMES) {
            let v = names.map(|n| case["vehicle"][n].as_f64().unwrap());
            (c.added, c.linear, c.quadratic) = (v[0], v[1], v[2]);
        }
        for (id, parameters) in effects.iter().chain(background) {
            let number = |(n, v): (&String, &serde_json::Value)| {
                (
                    n.clone(),
                    v.as_f64().map_or_else(
                        || ParameterValue::Word(v.as_str().unwrap().into()),
                        ParameterValue::Number,
                    ),
                )
            };
            rig.physics.push(PhysicsEntry {
                effect: id.clone(),
                parameters: parameters.as_object().unwrap().iter().map(number).collect(),
            });
        }
        let mut files: Vec<PathBuf> = std::fs::read_dir(dir.join(name))
            .unwrap()
            .map(|f| f.unwrap().path())
            .collect();
        files.sort();
        let mut all = Vec::new();
        for file in files {
            let (commands, poses) = read(&file);
            let t0 = commands
                .iter()
                .map(|c| c.0)
                .chain(poses.iter().map(|p| p.0))
                .min()
                .unwrap();
            let seconds = |t: u64| (t - t0) as f64 * 1e-9;
            // The start is not in the key: the first pose, as measured.
            let p = &poses[0].1;
            let or0 = |v: Option<f64>| v.unwrap_or(0.0);
            let start = [
                or0(p.x),
                or0(p.y),
                or0(p.z),
                or0(p.phi),
                or0(p.theta),
                or0(p.psi),
            ];
            let mut world = World::new(&rig, start).unwrap();
            let mut load: BTreeMap<String, f64> = BTreeMap::new();
            let mut next = commands.iter().peekable();
            let mut differences = Vec::new();
            for (t, pose) in &poses {
                while let Some((tc, c)) = next.next_if(|c| c.0 <= *t) {
                    load.insert(c.thruster.clone(), c.thrust);
                    let of = |n: &str| load.get(n).copied().unwrap_or(0.0);
                    let wrench = Wrench {
                        surge_n: of("surge"),
                        sway_n: of("sway"),
                        heave_n: of("heave"),
                        roll_nm: of("roll"),
                        pitch_nm: of("pitch"),
                        yaw_nm: of("yaw"),
                    };
                    world.command(seconds(*tc), &wrench).unwrap();
                }
                let seen = world.pose_reported(seconds(*t)).unwrap();
                if let Some(x) = pose.x {
                    differences.push(x - seen.x_m);
                }
            }
            let middle = median(differences.clone());
            all.extend(differences.iter().map(|d| (d - middle).abs() * 1e3));
        }
        let rms_mm = (all.iter().map(|d| d * d).sum::<f64>() / all.len() as f64).sqrt();
        // Outliers do not count here.
        let robust_mm = 1.4826 * median(all.clone());
        println!(
            "{name} {:?} over {:?}: x differs by {rms_mm:.4} mm rms, {robust_mm:.4} robust, over {} poses",
            effects.keys().collect::<Vec<_>>(),
            background.keys().collect::<Vec<_>>(),
            all.len()
        );
        if background.is_empty() {
            // Their noise is 0.15 mm; the start is known to it and to 0.01 deg.
            assert!(rms_mm < 0.17, "{name}: {rms_mm} mm rms");
        } else {
            assert!(robust_mm < TANK_NOISE_MM, "{name}: {robust_mm} mm");
        }
        used += 1;
    }
    assert_eq!(used, 11, "all but case106, whose effect has no name");
}
