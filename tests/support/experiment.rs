//! Simulated experiments with known truth, for the tests of identification.

use std::collections::BTreeMap;

use hydroline::estimate::Options;
use hydroline::identify::Identification;
use hydroline::identify::parameter::Coefficient;
use hydroline::run::{Channel, Command, PerChannel, Run, Sample};
use hydroline_rigs::{Dof, Rig, Vehicle};
use hydroline_sim::model::{Model, ModelState};
use hydroline_sim::vehicle::Hydrodynamics;
use hydroline_sim::{EffectStack, Trajectory};
use rand::{RngExt, SeedableRng, rngs::StdRng};
use rand_distr::{Distribution, StandardNormal};

/// White noise plus an Ornstein-Uhlenbeck process, and outliers.
#[derive(Clone, Copy)]
pub struct TestNoise {
    pub position_m: f64,
    pub attitude_rad: f64,
    /// sd of the coloured part over that of the white one.
    pub coloured: f64,
    pub correlation_s: f64,
    pub outliers: f64,
}

pub const WHITE: TestNoise = TestNoise {
    position_m: 1.5e-4,
    attitude_rad: 1.745e-4,
    coloured: 0.0,
    correlation_s: 0.6,
    outliers: 0.0,
};

/// A run of the rig's model under commands, every pose channel measured with noise.
pub fn simulated(
    vehicle: &Vehicle,
    name: &str,
    commands: &[(f64, [f64; 6])],
    length_s: f64,
    noise: TestNoise,
    seed: u64,
) -> Run {
    let model = Model {
        hydrodynamics: Hydrodynamics::new(vehicle),
        effects: EffectStack::empty(),
    };
    let mut path = Trajectory::new(
        model,
        ModelState::at_rest([0.0, 0.0, -0.83, 0.0, 0.0, 0.0]),
        0.005,
    )
    .unwrap();
    for (t_s, wrench) in commands {
        path.command(*t_s, *wrench).unwrap();
    }
    let mut rng = StdRng::seed_from_u64(seed);
    let mut normal = move || -> f64 { StandardNormal.sample(&mut rng) };
    let mut chance = StdRng::seed_from_u64(seed ^ 0xA5A5);
    let decay = (-0.04 / noise.correlation_s).exp();
    let mut colour: [f64; 6] = std::array::from_fn(|_| normal());
    let samples = (0..(length_s / 0.04) as usize)
        .map(|k| {
            let t_s = 0.006 + 0.04 * k as f64;
            let eta = path.state_at(t_s).unwrap().vehicle.eta;
            let mut values = PerChannel::NAN;
            let spoilt = chance.random::<f64>() < noise.outliers;
            for c in 0..6 {
                let sd = if c < 3 {
                    noise.position_m
                } else {
                    noise.attitude_rad
                };
                colour[c] = decay * colour[c] + (1.0 - decay * decay).sqrt() * normal();
                values[Channel::POSES[c]] = eta[c]
                    + sd * (normal() + noise.coloured * colour[c])
                    + if spoilt { 20.0 * sd * normal() } else { 0.0 };
            }
            Sample {
                t_s,
                values,
                covariance: None,
            }
        })
        .collect();
    let commands = commands
        .iter()
        .map(|(t_s, wrench)| Command {
            t_s: *t_s,
            wrench: *wrench,
        })
        .collect();
    Run {
        name: name.into(),
        start_ns: 0,
        commands,
        samples,
        ..Run::default()
    }
}

/// (time \[s\], wrench).
pub type Commands = Vec<(f64, [f64; 6])>;

/// A wrench of surge alone.
pub fn surge(x: f64) -> [f64; 6] {
    [x, 0.0, 0.0, 0.0, 0.0, 0.0]
}

/// Four runs of 24 s at 25 Hz: the paper's loads, reversals and a coast-down.
pub fn surge_runs(vehicle: &Vehicle, noise: TestNoise, seed: u64) -> Vec<Run> {
    let plans: [(&str, Commands); 4] = [
        ("4n", vec![(0.0, surge(4.0)), (14.0, surge(0.0))]),
        (
            "8n",
            vec![(0.0, surge(8.0)), (9.0, surge(-8.0)), (18.0, surge(8.0))],
        ),
        (
            "16n",
            vec![(0.0, surge(16.0)), (5.0, surge(-6.0)), (12.0, surge(3.0))],
        ),
        (
            "steps",
            (0..12)
                .map(|k| {
                    (
                        2.0 * f64::from(k),
                        surge(if k % 2 == 0 { 12.0 } else { -9.0 }),
                    )
                })
                .collect(),
        ),
    ];
    plans
        .into_iter()
        .enumerate()
        .map(|(i, (name, c))| simulated(vehicle, name, &c, 24.0, noise, seed * 10 + i as u64))
        .collect()
}

/// Without each run predicted by the others.
pub fn quick() -> Options<'static> {
    Options {
        cross_validate: false,
        budget: false,
        ..Options::default()
    }
}

/// The built-in rig with its six equations side by side.
pub fn decoupled() -> Rig {
    let mut rig = Rig::builtin("lshpi").unwrap();
    rig.vehicle.model = hydroline_rigs::VehicleModel::Decoupled;
    rig
}

/// Truth up to 20 % off the rig, as in a tank.
pub fn other_vehicle(rig: &Rig, seed: u64) -> Vehicle {
    let mut rng = StdRng::seed_from_u64(seed);
    let mut vehicle = rig.vehicle.clone();
    for c in Dof::ALL.into_iter().flat_map(Coefficient::of) {
        let value = c.of_vehicle(&rig.vehicle) * (0.8 + 0.4 * rng.random::<f64>());
        c.put(&mut vehicle, value);
    }
    vehicle
}

/// Whether each coefficient's 95 % interval holds the truth, by its key.
pub fn inside(found: &Identification, truth: &Vehicle) -> BTreeMap<String, bool> {
    found
        .parameters
        .iter()
        .map(|(key, p)| {
            let actual = Coefficient::find(key).unwrap().of_vehicle(truth);
            (
                key.clone(),
                p.low.is_some_and(|l| l <= actual) && p.high.is_some_and(|h| actual <= h),
            )
        })
        .collect()
}
