//! Makes coupled cases.

use hydroline_core::run::{Channel, Command, PerChannel, Run, Sample};
use hydroline_diagnose::Source;
use hydroline_rigs::{ParameterValue, PhysicsEntry, Rig};
use hydroline_sim::VehicleState;
use hydroline_sim::model::{Model, ModelState};
use hydroline_sim::trajectory::{Trajectory, TrajectoryError};
use nalgebra::{DMatrix, DVector};
use rand::{SeedableRng, rngs::StdRng};
use rand_distr::{Distribution, StandardNormal};

use super::drawn::drawn;
use crate::benchmark::disturbance::Disturbance;
use crate::benchmark::error::ProveError;
use crate::benchmark::magnitudes::between;

/// Runs of a case, and their length \[s\].
const RUNS: usize = 4;
const RUN_S: f64 = 24.0;
/// Samples per second.
const RATE_HZ: f64 = 25.0;
/// The same of a slow log.
const SLOW_HZ: f64 = 5.0;
/// sd of velocities \[m/s\]: a Doppler log in a tank.
const SPEED_MPS: f64 = 1.5e-3;
/// sd of turning rates \[rad/s\]: a gyroscope.
const TURN_RADPS: f64 = 5e-4;
/// Integration step \[s\]: not the diagnosis' own.
const STEP_S: f64 = 0.005;
/// sd of the attitudes \[rad\]: 0.01 deg.
const ATTITUDE_RAD: f64 = 1.745e-4;
/// Largest loads \[N, N m\]: the vehicle stays in the tank and moves in all three.
pub(super) const LARGEST: [f64; 6] = [8.0, 6.0, 0.0, 0.0, 0.0, 0.6];
/// Smallest weight of a drawn effect, in tolerances: it surely matters.
const SMALLEST_WEIGHT: f64 = 1.3;
/// Greatest weight, likewise.
const MOST: f64 = 40.0;
/// Draws before a case is given up.
const TRIES: usize = 40;

/// An effect that is there.
#[derive(Debug, Clone, PartialEq, serde::Serialize, schemars::JsonSchema, serde::Deserialize)]
pub struct There {
    /// Effect and words.
    pub name: String,
    /// Weight in the channel where it is largest, over the rig's tolerance.
    pub weight_tolerances: f64,
    /// Its numbers.
    pub numbers: Vec<(String, f64)>,
}

impl There {
    /// Heavier than the tolerance.
    pub fn matters(&self) -> bool {
        self.weight_tolerances > 1.0
    }
}

/// Measurements that a case's log holds.
#[derive(
    Debug, Clone, Copy, PartialEq, Eq, serde::Serialize, schemars::JsonSchema, serde::Deserialize,
)]
#[serde(rename_all = "snake_case")]
pub enum Instruments {
    /// Poses at the full rate.
    Poses,
    /// Poses, a fifth as often.
    Slow,
    /// Velocities and turning rates in the body frame, and no pose.
    Velocities,
}

impl Instruments {
    /// Of a case: of ten, two are slow and two have no poses; one of each has nothing left out.
    fn of(index: usize) -> Instruments {
        match index % 10 {
            3 | 4 => Instruments::Slow,
            7 | 8 => Instruments::Velocities,
            _ => Instruments::Poses,
        }
    }

    fn rate_hz(self) -> f64 {
        match self {
            Instruments::Slow => SLOW_HZ,
            _ => RATE_HZ,
        }
    }

    fn measured(self) -> [Channel; 6] {
        match self {
            Instruments::Velocities => Channel::RATES,
            _ => Channel::POSES,
        }
    }

    /// Stamps of a run \[s\].
    fn stamps_s(self) -> Vec<f64> {
        let rate_hz = self.rate_hz();
        let count = (RUN_S * rate_hz) as u32;
        (0..count).map(|k| 0.001 + f64::from(k) / rate_hz).collect()
    }
}

/// A case.
#[derive(Debug, Clone)]
pub struct CoupledCase {
    /// Number of the case.
    pub index: usize,
    /// Measurements that the logs hold.
    pub instruments: Instruments,
    /// Logs that the diagnosis sees.
    pub sources: Vec<Source>,
    /// The rig file.
    pub rig: Rig,
    /// Factor on the rig's coefficients.
    pub rig_factor: f64,
    /// The key, heaviest first.
    pub truth: Vec<There>,
    /// The vehicle as it is, with its effects.
    pub water: Rig,
    /// Noise and losses of its measurement.
    pub disturbance: Disturbance,
}

/// A run as its log holds it, and what only the key knows of it.
#[derive(Debug, Clone)]
pub(in crate::benchmark) struct Measured {
    /// The log.
    pub source: Source,
    /// What instruments without noise would have reported at its stamps.
    pub motion: Vec<PerChannel<f64>>,
    /// Whether x of each sample is an outlier.
    pub is_outlier: Vec<bool>,
}

impl CoupledCase {
    /// One more run of these instruments, of this vehicle; `None` where its motion does not stay finite.
    ///
    /// # Errors
    /// [`ProveError`].
    pub(in crate::benchmark) fn record(
        &self,
        water: &Rig,
        name: &str,
        commands: Vec<Command>,
        rng: &mut StdRng,
    ) -> Result<Option<Measured>, ProveError> {
        let log = Log {
            water,
            instruments: self.instruments,
            stamps_s: &self.instruments.stamps_s(),
            disturbance: &self.disturbance,
        };
        log.measured(name, commands, rng)
    }
}

/// Steps, ramps of small steps and reversals in all three at their own times.
pub(in crate::benchmark) fn commands(rng: &mut StdRng) -> Vec<Command> {
    let mut edges: Vec<(f64, usize, f64)> = Vec::new();
    for d in [0, 1, 5] {
        let mut t_s = between(rng, 0.0, 1.0);
        while t_s < RUN_S - 4.0 {
            edges.push((t_s, d, LARGEST[d] * between(rng, -1.0, 1.0)));
            t_s += between(rng, 1.2, 5.0);
        }
        edges.push((RUN_S - between(rng, 2.0, 4.0), d, 0.0));
    }
    edges.sort_by(|a, b| a.0.total_cmp(&b.0));
    let mut wrench = [0.0; 6];
    let each = edges.into_iter().map(|(t_s, d, load)| {
        wrench[d] = load;
        Command { t_s, wrench }
    });
    each.collect()
}

/// Pose and rates at each stamp, as instruments without noise report them; `None` where the motion does not stay finite.
pub(in crate::benchmark) fn motion(
    rig: &Rig,
    commands: &[Command],
    stamps_s: &[f64],
) -> Result<Option<Vec<PerChannel<f64>>>, ProveError> {
    let model = Model::from_rig(rig)?;
    let start = ModelState::at_rest(rig.tank.start_pose);
    let mut path = Trajectory::new(model, start, STEP_S)?;
    for c in commands {
        path.command(c.t_s, c.wrench)?;
    }
    let mut seen = Vec::with_capacity(stamps_s.len());
    for stamp_s in stamps_s {
        let t_s = path.model().effects.scene_time_s(*stamp_s, 0.0);
        let VehicleState { eta, nu } = match path.state_at(t_s) {
            Ok(state) => state.vehicle,
            Err(TrajectoryError::Diverged { .. }) => return Ok(None),
            Err(e) => return Err(e.into()),
        };
        let effects = &path.model().effects;
        let pose = effects.reported_pose(t_s, effects.scene_pose(t_s, eta));
        seen.push(PerChannel::of_state(pose, nu));
    }
    let finite = seen.iter().flatten().all(|v| v.is_finite());
    Ok(finite.then_some(seen))
}

/// Runs, and what is measured of them when.
struct Runs<'a> {
    commands: &'a [Vec<Command>],
    stamps_s: &'a [f64],
    measured: [Channel; 6],
}

/// Measured channels of all runs in tolerances, end to end; `None` where a motion does not stay finite.
fn all(rig: &Rig, runs: &Runs<'_>) -> Result<Option<DVector<f64>>, ProveError> {
    let tolerance = rig.tolerance.channels();
    let mut made = Vec::new();
    for commands in runs.commands {
        let Some(seen) = motion(rig, commands, runs.stamps_s)? else {
            return Ok(None);
        };
        for seen in seen {
            made.extend(runs.measured.map(|c| seen[c] / tolerance[c]));
        }
    }
    Ok(Some(DVector::from_vec(made)))
}

/// Weight of each entry alone as reference/interfaces.md defines it, in the channel where it is largest, over the tolerance;
/// `None` where a motion does not stay finite.
fn weights(water: &Rig, runs: &Runs<'_>) -> Result<Option<Vec<f64>>, ProveError> {
    let bare = Rig {
        physics: Vec::new(),
        ..water.clone()
    };
    let Some(none) = all(&bare, runs)? else {
        return Ok(None);
    };
    let mut columns = Vec::new();
    for d in 0..6 {
        for k in 0..3 {
            let shifted = |by: f64| {
                let mut rig = bare.clone();
                let c = &mut rig.vehicle.coefficients[d];
                let place = [&mut c.added, &mut c.linear, &mut c.quadratic];
                place
                    .into_iter()
                    .nth(k)
                    .into_iter()
                    .for_each(|v| *v *= 1.0 + by);
                all(&rig, runs)
            };
            let Some((up, down)) = shifted(1e-4)?.zip(shifted(-1e-4)?) else {
                return Ok(None);
            };
            let column = up - down;
            let size = column.norm();
            if size > 1e-9 {
                columns.push(column / size);
            }
        }
    }
    let Some(own) = DMatrix::from_columns(&columns).svd(true, false).u else {
        return Ok(None);
    };
    let mut each = Vec::new();
    for entry in &water.physics {
        let mut with = bare.clone();
        with.physics.push(entry.clone());
        let Some(with) = all(&with, runs)? else {
            return Ok(None);
        };
        let moved = with - &none;
        let left = &moved - &own * own.tr_mul(&moved);
        let rms = |c: usize| {
            let values = left.iter().skip(c).step_by(6);
            let n = left.len() / 6;
            (values.map(|v| v * v).sum::<f64>() / n.max(1) as f64).sqrt()
        };
        each.push((0..6).map(rms).fold(0.0, f64::max));
    }
    Ok(Some(each))
}

/// Makes a case; the same seed and number give the same bytes.
///
/// # Errors
/// [`ProveError`].
pub fn make(seed: u64, index: usize) -> Result<CoupledCase, ProveError> {
    let mut rng = StdRng::seed_from_u64(seed.wrapping_mul(0x9e37_79b9_7f4a_7c15) ^ index as u64);
    let rig = Rig::builtin("lshpi")?;
    let instruments = Instruments::of(index);
    let stamps_s = instruments.stamps_s();
    let mut last = String::new();
    for _ in 0..TRIES {
        let mut water = rig.clone();
        for c in &mut water.vehicle.coefficients {
            for v in [&mut c.added, &mut c.linear, &mut c.quadratic] {
                *v *= between(&mut rng, 0.8, 1.2);
            }
        }
        // Every second case has nothing; of the others every third has two.
        let count = match index % 6 {
            0 | 2 | 4 => 0,
            5 => 2,
            _ => 1,
        };
        while water.physics.len() < count {
            let new = drawn(&mut rng)?;
            if water.physics.iter().all(|e| e.effect != new.effect) {
                water.physics.push(new);
            }
        }
        let plans: Vec<Vec<Command>> = (0..RUNS).map(|_| commands(&mut rng)).collect();
        let runs = Runs {
            commands: &plans,
            stamps_s: &stamps_s,
            measured: instruments.measured(),
        };
        let Some(weights) = weights(&water, &runs)? else {
            last = "no finite motion".to_owned();
            continue;
        };
        if let Some(w) = weights
            .iter()
            .find(|w| !(SMALLEST_WEIGHT..MOST).contains(*w))
        {
            last = format!("an effect of {w:.2} tolerances");
            continue;
        }
        let mut truth: Vec<There> = water
            .physics
            .iter()
            .zip(&weights)
            .map(|(e, w)| there(e, *w))
            .collect();
        truth.sort_by(|a, b| b.weight_tolerances.total_cmp(&a.weight_tolerances));
        // Every fourth of the analyst's rigs is off by up to five.
        let rig_factor = match index % 4 {
            3 => 5f64.powf(between(&mut rng, -1.0, 1.0)),
            _ => 1.0,
        };
        let mut given = rig.clone();
        for c in &mut given.vehicle.coefficients {
            for v in [&mut c.added, &mut c.linear, &mut c.quadratic] {
                *v *= rig_factor;
            }
        }
        let disturbance = Disturbance::draw(index % 5 == 4, &mut rng);
        let measured: Result<Option<Vec<Measured>>, ProveError> = plans
            .into_iter()
            .enumerate()
            .map(|(k, plan)| {
                let log = Log {
                    water: &water,
                    instruments,
                    stamps_s: &stamps_s,
                    disturbance: &disturbance,
                };
                log.measured(&format!("run{k}"), plan, &mut rng)
            })
            .collect();
        let Some(measured) = measured? else {
            last = "no finite motion".to_owned();
            continue;
        };
        return Ok(CoupledCase {
            index,
            instruments,
            sources: measured.into_iter().map(|m| m.source).collect(),
            rig: given,
            rig_factor,
            truth,
            water,
            disturbance,
        });
    }
    Err(ProveError::NoCase {
        id: format!("coupled-{index}"),
        tries: TRIES,
        last,
    })
}

fn there(entry: &PhysicsEntry, weight_tolerances: f64) -> There {
    let words = entry.parameters.iter().filter_map(|(name, v)| match v {
        ParameterValue::Word(w) => Some((name.as_str(), w.as_str())),
        ParameterValue::Number(_) => None,
    });
    // As the verdict has them: by the words' names.
    let mut words: Vec<(&str, &str)> = words.collect();
    words.sort_unstable();
    let all: Vec<&str> = std::iter::once(entry.effect.as_str())
        .chain(words.iter().map(|w| w.1))
        .collect();
    There {
        name: all.join(" "),
        weight_tolerances,
        numbers: crate::benchmark::magnitudes::numbers(entry),
    }
}

/// Truth and instruments that a log is made from.
struct Log<'a> {
    water: &'a Rig,
    instruments: Instruments,
    stamps_s: &'a [f64],
    disturbance: &'a Disturbance,
}

impl Log<'_> {
    /// A run as its log holds it; `None` where its motion does not stay finite.
    fn measured(
        &self,
        name: &str,
        commands: Vec<Command>,
        rng: &mut StdRng,
    ) -> Result<Option<Measured>, ProveError> {
        let Log {
            stamps_s,
            disturbance,
            ..
        } = *self;
        let Some(motion) = motion(self.water, &commands, stamps_s)? else {
            return Ok(None);
        };
        let x: Vec<f64> = motion.iter().map(|p| p[Channel::X]).collect();
        let noise: Vec<Vec<f64>> = (0..3)
            .map(|_| disturbance.along(stamps_s, &x, rng))
            .collect();
        let far = disturbance.far_off(stamps_s.len(), rng);
        let arrives = disturbance.arrives(stamps_s, rng);
        let (mut samples, mut seen, mut is_outlier) = (Vec::new(), Vec::new(), Vec::new());
        for (k, t_s) in stamps_s.iter().enumerate() {
            let mut values = PerChannel::NAN;
            for c in self.instruments.measured() {
                let any: f64 = StandardNormal.sample(rng);
                values[c] = motion[k][c]
                    + match (c.is_rate(), c.is_angular()) {
                        (false, false) if c == Channel::X => noise[0][k] + far[k],
                        (false, false) => noise[c.index()][k],
                        (false, true) => ATTITUDE_RAD * any,
                        (true, false) => SPEED_MPS * any,
                        (true, true) => TURN_RADPS * any,
                    };
            }
            if arrives[k] {
                samples.push(Sample {
                    t_s: *t_s,
                    values,
                    covariance: None,
                });
                seen.push(motion[k]);
                is_outlier.push(far[k] != 0.0);
            }
        }
        let run = Run {
            name: name.to_owned(),
            commands,
            samples,
            ..Run::default()
        };
        Ok(Some(Measured {
            source: Source {
                run,
                ..Source::default()
            },
            motion: seen,
            is_outlier,
        }))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::benchmark::coupled::drawn::{self, KINDS};
    use hydroline_rigs::Dof;

    /// `lift_damping` was drawn with a key that the rig refuses: the case was drawn again, and none ever held it.
    #[test]
    fn cases_hold_lift_damping() {
        let truth = make(1, 17).unwrap().truth;
        let is_lift = |t: &There| t.name.starts_with("lift_damping");
        assert!(truth.iter().any(is_lift), "{truth:?}");
    }

    #[test]
    #[ignore = "eleven seconds: tests/nightly proof"]
    fn every_kind_of_effect_is_heavy_enough_for_a_case() {
        let mut rng = StdRng::seed_from_u64(5);
        let mut water = Rig::builtin("lshpi").unwrap();
        for kind in KINDS {
            for dof in [Dof::Surge, Dof::Sway, Dof::Yaw] {
                for share in [0.4, 0.7, 1.0] {
                    let entry = drawn::entry(kind, dof, share, &mut rng).unwrap();
                    water.physics.push(entry);
                }
            }
        }
        let stamps_s: Vec<f64> = (0..600).map(|k| 0.001 + f64::from(k) / RATE_HZ).collect();
        let mut missing = KINDS.to_vec();
        for _ in 0..3 {
            let plans: Vec<Vec<Command>> = (0..RUNS).map(|_| commands(&mut rng)).collect();
            let runs = Runs {
                commands: &plans,
                stamps_s: &stamps_s,
                measured: Instruments::Poses.measured(),
            };
            let weights = weights(&water, &runs).unwrap().unwrap();
            for (entry, weight) in water.physics.iter().zip(weights) {
                let held = (SMALLEST_WEIGHT..MOST).contains(&weight);
                missing.retain(|kind| *kind != entry.effect || !held);
            }
        }
        assert!(missing.is_empty(), "always drawn again: {missing:?}");
    }

    #[test]
    fn what_a_model_refuses_is_an_error_and_what_runs_away_is_drawn_again() {
        let mut rig = Rig::builtin("lshpi").unwrap();
        let commands = [Command {
            t_s: 0.0,
            wrench: [8.0, 0.0, 0.0, 0.0, 0.0, 0.0],
        }];
        let seen = |rig: &Rig| motion(rig, &commands, &[0.5, 20.0]);
        assert!(seen(&rig).unwrap().is_some());
        let lift = |key: &str| PhysicsEntry {
            effect: "lift_damping".to_owned(),
            parameters: vec![(key.to_owned(), ParameterValue::Number(8.0))],
        };
        rig.physics = vec![lift("coefficient")];
        assert!(matches!(seen(&rig), Err(ProveError::Effect(_))));
        rig.physics.clear();
        rig.vehicle.coefficients[0].quadratic = 1e6;
        rig.vehicle.coefficients[0].linear = 1e6;
        assert!(seen(&rig).unwrap().is_none());
    }

    #[test]
    fn a_case_is_what_its_number_says_and_the_same_every_time() {
        let (a, b) = (make(1, 5).unwrap(), make(1, 5).unwrap());
        assert_eq!(a.truth, b.truth);
        assert!(a.sources[0].run.same_recording(&b.sources[0].run));
        assert_eq!(a.truth.len(), 2);
        assert!(a.truth.iter().all(There::matters));
        assert!(make(1, 2).unwrap().truth.is_empty());
        assert!((make(1, 3).unwrap().rig_factor - 1.0).abs() > 1e-6);
        let seen = |index: usize, c: Channel| {
            let samples = make(1, index).unwrap().sources[0].run.samples.clone();
            (samples.len(), samples[3].values[c].is_finite())
        };
        let (poses, slow, rates) = (
            seen(2, Channel::X),
            seen(4, Channel::X),
            seen(8, Channel::X),
        );
        assert!(poses.1 && slow.1 && !rates.1 && seen(8, Channel::U).1);
        assert!(slow.0 * 4 < poses.0, "{slow:?} {poses:?}");
    }
}
