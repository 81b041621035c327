//! Simulated experiments in surge whose truth is known, for the coverage of intervals.

use hydroline_core::run::{Channel, Command, Joined, PerChannel, Run, Sample};
use hydroline_identify::parameter::Coefficient;
use hydroline_rigs::{Dof, ParameterValue, PhysicsEntry, Rig, Vehicle};
use hydroline_sim::model::{Model, ModelState};
use hydroline_sim::{EffectStack, Trajectory, vehicle::Hydrodynamics};
use rand::{RngExt, rngs::StdRng};
use rand_distr::{Distribution, StandardNormal};

/// sd of the white noise of every case \[m\].
pub const WHITE_M: f64 = 1.5e-4;

/// What the noise of the poses is like.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Noise {
    White,
    /// White, and as much of a correlation time of 0.6 s.
    Coloured,
    /// White, and two of a hundred samples off by 20 times as much.
    Outliers,
    /// Every other sample of ten times the sd, as the log says.
    Uneven,
    /// White; commands and motion by two clocks, their offset known to 20 ms.
    Joined,
}

impl Noise {
    pub const ALL: [Noise; 5] = [
        Noise::White,
        Noise::Coloured,
        Noise::Outliers,
        Noise::Uneven,
        Noise::Joined,
    ];
}

/// What differs from what the rig file says.
#[derive(Debug, Clone)]
pub struct Truth {
    pub vehicle: Vehicle,
    pub effects: Vec<PhysicsEntry>,
    /// What arrives of a load.
    pub thrust_share: f64,
    /// What is measured of a length.
    pub length_share: f64,
    /// What is added to every pose, by run \[m\].
    pub shared_m: Vec<f64>,
}

impl Truth {
    /// A rig's vehicle.
    pub fn of(rig: &Rig) -> Truth {
        Truth {
            vehicle: rig.vehicle.clone(),
            effects: Vec::new(),
            thrust_share: 1.0,
            length_share: 1.0,
            shared_m: Vec::new(),
        }
    }

    /// Coefficients of surge up to 20 % off the rig's, as in a tank.
    pub fn drawn(rig: &Rig, rng: &mut StdRng) -> Truth {
        let mut truth = Truth::of(rig);
        for c in Coefficient::of(Dof::Surge) {
            let value = c.of_vehicle(&rig.vehicle) * (0.8 + 0.4 * rng.random::<f64>());
            c.put(&mut truth.vehicle, value);
        }
        truth
    }
}

/// Loads in surge: time \[s\], load \[N\].
pub type Plan = &'static [(f64, f64)];

/// Reversals, and three loads.
pub const PLANS: [Plan; 2] = [
    &[(0.0, 8.0), (9.0, -8.0), (18.0, 8.0)],
    &[(0.0, 16.0), (5.0, -6.0), (12.0, 3.0)],
];

/// Runs of 24 s at 25 Hz.
pub fn runs(truth: &Truth, plans: &[Plan], noise: Noise, rng: &mut StdRng) -> Vec<Run> {
    let each = plans.iter().enumerate();
    each.map(|(i, plan)| run(truth, i, plan, noise, rng))
        .collect()
}

fn run(truth: &Truth, index: usize, plan: Plan, noise: Noise, rng: &mut StdRng) -> Run {
    let model = Model {
        hydrodynamics: Hydrodynamics::new(&truth.vehicle),
        effects: EffectStack::build(&truth.effects).unwrap(),
    };
    let mut path = Trajectory::new(model, ModelState::at_rest([0.0; 6]), 0.005).unwrap();
    for (t_s, load_n) in plan {
        let load_n = truth.thrust_share * load_n;
        path.command(*t_s, [load_n, 0.0, 0.0, 0.0, 0.0, 0.0])
            .unwrap();
    }
    let normal = |rng: &mut StdRng| -> f64 { StandardNormal.sample(rng) };
    let off_s = match noise {
        Noise::Joined => 0.02 * normal(rng),
        _ => 0.0,
    };
    let decay = (-0.04_f64 / 0.6).exp();
    let mut colour = normal(rng);
    let mut run = Run {
        name: format!("run{index}"),
        commands: plan
            .iter()
            .map(|(t_s, load_n)| Command {
                // The clock of the commands is behind by as much.
                t_s: t_s - off_s + 0.1,
                wrench: [*load_n, 0.0, 0.0, 0.0, 0.0, 0.0],
            })
            .collect(),
        joined: (noise == Noise::Joined).then_some(Joined {
            is_estimated: false,
            offset_sd_s: 0.02,
            drift_sd_ppm: 0.0,
        }),
        ..Run::default()
    };
    for k in 0..600_u32 {
        let t_s = 0.006 + 0.04 * f64::from(k);
        let x_m = path.state_at(t_s).unwrap().vehicle.eta[0];
        let x_m = truth.length_share * x_m + truth.shared_m.get(index).copied().unwrap_or(0.0);
        colour = decay * colour + (1.0 - decay * decay).sqrt() * normal(rng);
        let is_worse = noise == Noise::Uneven && k % 2 == 0;
        let white_m = if is_worse { 10.0 * WHITE_M } else { WHITE_M };
        let mut off_m = white_m * normal(rng);
        off_m += match noise {
            Noise::Coloured => WHITE_M * colour,
            Noise::Outliers if rng.random::<f64>() < 0.02 => 20.0 * WHITE_M * normal(rng),
            _ => 0.0,
        };
        let mut values = PerChannel::NAN;
        values[Channel::X] = x_m + off_m;
        let covariance = (noise == Noise::Uneven).then(|| {
            let mut covariance = Box::new([0.0; 36]);
            (0..6).for_each(|c| covariance[7 * c] = white_m * white_m);
            covariance
        });
        run.samples.push(Sample {
            t_s: t_s + 0.1,
            values,
            covariance,
        });
    }
    run
}

/// An effect in surge with one number.
pub fn surge_effect(effect: &str, name: &str, value: f64) -> PhysicsEntry {
    PhysicsEntry {
        effect: effect.to_owned(),
        parameters: vec![
            ("dof".to_owned(), ParameterValue::Word("surge".to_owned())),
            (name.to_owned(), ParameterValue::Number(value)),
        ],
    }
}
