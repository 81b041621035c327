//! Runs made in memory.

use hydroline_core::run::{Channel, Command, PerChannel, Run, Sample};
use hydroline_rigs::{ParameterValue, PhysicsEntry, Rig};
use hydroline_sim::model::{Model, ModelState};
use hydroline_sim::trajectory::Trajectory;
use rand::{RngExt, SeedableRng, rngs::StdRng};
use rand_distr::{Distribution, StandardNormal};

/// Vehicle, effects and instruments of simulated runs.
pub struct Tank {
    pub rig: Rig,
    pub effects: Vec<PhysicsEntry>,
    /// DOFs that are commanded.
    pub driven: Vec<usize>,
    /// Factor on the largest command.
    pub load: f64,
    pub white: [f64; 2],
    pub coloured: f64,
    pub seconds: f64,
    pub hz: f64,
}

pub fn entry(effect: &str, numbers: &[(&str, f64)], words: &[(&str, &str)]) -> PhysicsEntry {
    let n = numbers
        .iter()
        .map(|(n, v)| ((*n).to_owned(), ParameterValue::Number(*v)));
    let w = words
        .iter()
        .map(|(n, v)| ((*n).to_owned(), ParameterValue::Word((*v).to_owned())));
    PhysicsEntry {
        effect: effect.to_owned(),
        parameters: n.chain(w).collect(),
    }
}

impl Tank {
    pub fn new(driven: &[usize], effects: Vec<PhysicsEntry>) -> Tank {
        Tank {
            rig: Rig::builtin("lshpi").unwrap(),
            effects,
            driven: driven.to_vec(),
            load: 1.0,
            white: [1.5e-4, 1.745e-4],
            coloured: 0.7,
            seconds: 24.0,
            hz: 25.0,
        }
    }

    /// Steps and reversals drawn by the seed; coefficients up to 20 % off the rig's.
    pub fn runs(&self, count: usize, seed: u64) -> Vec<Run> {
        let mut rng = StdRng::seed_from_u64(seed);
        let mut rig = self.rig.clone();
        for c in &mut rig.vehicle.coefficients {
            c.added *= 0.8 + 0.4 * rng.random::<f64>();
            c.linear *= 0.8 + 0.4 * rng.random::<f64>();
            c.quadratic *= 0.8 + 0.4 * rng.random::<f64>();
        }
        rig.physics.extend(self.effects.iter().cloned());
        let full = [8.0, 6.0, 5.0, 0.4, 0.5, 0.6];
        (0..count)
            .map(|run| {
                let start = [0.0, 0.0, 1.0, 0.0, 0.0, 0.1];
                let model = Model::from_rig(&rig).unwrap();
                let mut path = Trajectory::new(model, ModelState::at_rest(start), 0.005).unwrap();
                let mut made = Run {
                    name: format!("run{run}"),
                    ..Run::default()
                };
                let mut t_s = 0.0;
                while t_s < self.seconds {
                    let mut wrench = [0.0; 6];
                    for &d in &self.driven {
                        wrench[d] = self.load * full[d] * (2.0 * rng.random::<f64>() - 1.0);
                    }
                    if t_s > self.seconds - 4.0 {
                        wrench = [0.0; 6];
                    }
                    path.command(t_s, wrench).unwrap();
                    made.commands.push(Command { t_s, wrench });
                    t_s += 1.5 + 3.0 * rng.random::<f64>();
                }
                let mut colour = [0.0; 6];
                let decay = (-1.0 / self.hz / 0.6_f64).exp();
                for k in 0..(self.seconds * self.hz) as usize {
                    let t_s = 0.006 + k as f64 / self.hz;
                    let effects = &path.model().effects;
                    let seen = effects.scene_time_s(t_s, 0.0);
                    let state = path.state_at(seen).unwrap().vehicle;
                    let effects = &path.model().effects;
                    let pose = effects.reported_pose(seen, effects.scene_pose(seen, state.eta));
                    let mut values = PerChannel::NAN;
                    for (c, channel) in Channel::POSES.into_iter().enumerate() {
                        let mut normal = || -> f64 { StandardNormal.sample(&mut rng) };
                        let sd = self.white[usize::from(c > 2)];
                        colour[c] = decay * colour[c]
                            + self.coloured * sd * (1.0 - decay * decay).sqrt() * normal();
                        values[channel] = pose[c] + sd * normal() + colour[c];
                    }
                    made.samples.push(Sample {
                        t_s,
                        values,
                        covariance: None,
                    });
                }
                made
            })
            .collect()
    }
}
