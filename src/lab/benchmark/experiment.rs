//! One vehicle in one tank: plans in, messages as a log holds them out, and what only the key knows.

use hydroline_rigs::{Dof, PhysicsEntry, Plan, Rig, Vehicle};
use hydroline_sim::Allocation;
use nalgebra::{DMatrix, DVector};
use rand::{SeedableRng, rngs::StdRng};
use rand_distr::{Distribution, StandardNormal};

use super::disturbance::Disturbance;
use super::error::ProveError;
use super::external_law::ExternalLaw;
use super::motion::Mover;
use super::unsteady::Unsteady;
use hydroline_diagnose::Source;
use hydroline_diagnose::faults::{Records, faults};
use hydroline_identify::data::load_messages;
use hydroline_identify::parameter::Coefficient;
use hydroline_log::messages::{pb, timestamp, unix_ns};
use hydroline_numerics::span::{basis, outside, rms};
use hydroline_plan::setpoint::setpoint;

/// UNIX time of t = 0 \[ns\].
const START_NS: u64 = 1_700_000_000_000_000_000;
/// Frames per second.
const RATE_HZ: f64 = 25.0;
/// Mid-exposure of the first frame \[s\].
const EXPOSURE_S: f64 = 0.001;
/// sd of the attitudes \[rad\]: 0.01 deg.
const ATTITUDE_RAD: f64 = 1.745e-4;

/// The truth.
#[derive(Debug, Clone)]
pub struct Tank {
    /// The analyst's rig file.
    pub rig: Rig,
    /// The vehicle as it is.
    pub vehicle: Vehicle,
    /// Effects that are there.
    pub entries: Vec<PhysicsEntry>,
    /// A law outside of the library.
    pub external_law: Option<ExternalLaw>,
    /// Noise and losses of the measurement.
    pub disturbance: Disturbance,
    /// Of noise.
    pub seed: u64,
}

/// One run.
#[derive(Debug, Clone, Default)]
pub struct Recorded {
    /// Name of the log.
    pub name: String,
    /// (time, surge load \[N\]), only changes.
    pub edges: Vec<(f64, f64)>,
    /// Stamps that arrived \[s\].
    pub times_s: Vec<f64>,
    /// Noise without outliers \[m\].
    pub noise_m: Vec<f64>,
    /// Whether each sample is an outlier.
    pub outlier: Vec<bool>,
    /// As logged.
    pub commands: Vec<pb::ThrusterCommand>,
    /// As logged.
    pub motion: Vec<pb::VehicleMotion>,
}

/// Time of the log \[ns\].
pub fn at_ns(t_s: f64) -> u64 {
    START_NS + (t_s * 1e9).round() as u64
}

impl Tank {
    /// Largest surge command of some plans \[N\].
    ///
    /// # Errors
    /// As [`Tank::record`].
    pub fn top_n(rig: &Rig, plans: &[Plan], length_s: f64) -> Result<f64, ProveError> {
        let mut top: f64 = 0.0;
        for plan in plans {
            let (_, edges) = sent(rig, plan, length_s)?;
            top = edges.iter().fold(top, |m, e| m.max(e.1.abs()));
        }
        Ok(top)
    }

    fn mover<'a>(
        &'a self,
        entries: &'a [PhysicsEntry],
        external_law: Option<&'a ExternalLaw>,
    ) -> Mover<'a> {
        Mover {
            vehicle: &self.vehicle,
            entries,
            external_law,
            start: self.rig.tank.start_pose,
        }
    }

    /// Drives a plan and records it; `run` numbers the runs of the case.
    ///
    /// # Errors
    /// [`ProveError`] of plan, effects or motion.
    pub fn record(&self, plan: &Plan, run: usize, length_s: f64) -> Result<Recorded, ProveError> {
        let mut rng = StdRng::seed_from_u64(self.seed.wrapping_mul(31).wrapping_add(run as u64));
        let (commands, edges) = sent(&self.rig, plan, length_s)?;
        let all_s: Vec<f64> = (0..(length_s * RATE_HZ) as u32)
            .map(|k| EXPOSURE_S + f64::from(k) / RATE_HZ)
            .collect();
        let x = self
            .mover(&self.entries, self.external_law.as_ref())
            .positions(run, &edges, &all_s)?;
        let noise = self.disturbance.along(&all_s, &x, &mut rng);
        let far = self.disturbance.far_off(all_s.len(), &mut rng);
        let arrives = self.disturbance.arrives(&all_s, &mut rng);
        let mut made = Recorded {
            name: format!("run{run}-{}", plan.name),
            edges,
            commands,
            ..Recorded::default()
        };
        let rest = self.rig.tank.start_pose;
        for (k, t_s) in all_s.iter().enumerate() {
            let mut normal = || -> f64 { StandardNormal.sample(&mut rng) };
            let others: [f64; 5] = std::array::from_fn(|i| {
                let sd = if i < 2 {
                    self.disturbance.white_m
                } else {
                    ATTITUDE_RAD
                };
                rest[i + 1] + sd * normal()
            });
            if !arrives[k] {
                continue;
            }
            made.times_s.push(*t_s);
            made.noise_m.push(noise[k]);
            made.outlier.push(far[k] != 0.0);
            let [y, z, phi, theta, psi] = others;
            let pose = [x[k] + noise[k] + far[k], y, z, phi, theta, psi];
            let motion = pb::VehicleMotion::of_pose(at_ns(*t_s), pose.map(Some));
            made.motion.push(motion);
        }
        Ok(made)
    }

    /// Range of x without any effect over some runs \[m\].
    ///
    /// # Errors
    /// [`ProveError`].
    pub fn reach_m(&self, runs: &[Recorded]) -> Result<(f64, f64), ProveError> {
        let none = self.over(runs, &self.vehicle, &[], None)?;
        Ok((none.min(), none.max()))
    }

    /// x over all stamps of some runs, end to end.
    fn over(
        &self,
        runs: &[Recorded],
        vehicle: &Vehicle,
        entries: &[PhysicsEntry],
        external_law: Option<&ExternalLaw>,
    ) -> Result<DVector<f64>, ProveError> {
        let mut all = Vec::new();
        for (run, r) in runs.iter().enumerate() {
            let mover = Mover {
                vehicle,
                ..self.mover(entries, external_law)
            };
            all.extend(mover.positions(run, &r.edges, &r.times_s)?);
        }
        Ok(DVector::from_vec(all))
    }

    /// Weight as reference/interfaces.md defines it \[m\], of each effect alone (the external law last), at the
    /// true vehicle; derivatives by central differences.
    ///
    /// # Errors
    /// [`ProveError`].
    pub fn weights(&self, runs: &[Recorded]) -> Result<Vec<f64>, ProveError> {
        let scale = self.scale(runs)?;
        let mut weights = Vec::new();
        for entry in &self.entries {
            weights.push(rms(&scale.left_m(std::slice::from_ref(entry), None)?));
        }
        if let Some(s) = &self.external_law {
            weights.push(rms(&scale.left_m(&[], Some(s))?));
        }
        Ok(weights)
    }

    /// A disturbance of this weight over the runs, as if the motion were linear in it: a force along a short wave is weighed only
    /// roughly so (2 to 7 mm where 4 are asked).
    ///
    /// # Errors
    /// [`ProveError`].
    pub fn unsteady(
        &self,
        mut made: Unsteady,
        weight_m: f64,
        runs: &[Recorded],
    ) -> Result<ExternalLaw, ProveError> {
        let alone = ExternalLaw::Unsteady(made);
        let unit_m = rms(&self.scale(runs)?.left_m(&[], Some(&alone))?);
        made.size_n *= weight_m / unit_m.max(1e-12);
        Ok(ExternalLaw::Unsteady(made))
    }

    /// Scale on which effects of this tank are weighed.
    ///
    /// # Errors
    /// [`ProveError`].
    pub fn scale<'a>(&'a self, runs: &'a [Recorded]) -> Result<Scale<'a>, ProveError> {
        let bare_m = self.over(runs, &self.vehicle, &[], None)?;
        let mut columns = Vec::new();
        for c in Coefficient::of(Dof::Surge) {
            let value = c.of_vehicle(&self.vehicle);
            let step = 1e-4 * value.abs();
            let shifted = |v: f64| {
                let mut vehicle = self.vehicle.clone();
                c.put(&mut vehicle, v);
                self.over(runs, &vehicle, &[], None)
            };
            columns.push((shifted(value + step)? - shifted(value - step)?) / (2.0 * step));
        }
        Ok(Scale {
            tank: self,
            runs,
            bare_m,
            own: basis(&DMatrix::from_columns(&columns)),
        })
    }
}

/// The true vehicle without effects over some runs, and what its coefficients can take up.
pub struct Scale<'a> {
    tank: &'a Tank,
    runs: &'a [Recorded],
    bare_m: DVector<f64>,
    own: DMatrix<f64>,
}

impl Scale<'_> {
    /// Motion that effects leave and that the coefficients cannot take up \[m\].
    fn left_m(
        &self,
        entries: &[PhysicsEntry],
        external_law: Option<&ExternalLaw>,
    ) -> Result<DVector<f64>, ProveError> {
        let vehicle = &self.tank.vehicle;
        let with_m = self.tank.over(self.runs, vehicle, entries, external_law)?;
        Ok(outside(&self.own, &(with_m - &self.bare_m)))
    }

    /// The same of some of the tank's effects by their ids, together.
    ///
    /// # Errors
    /// [`ProveError`].
    pub fn left_of_m(&self, effects: &[&str]) -> Result<DVector<f64>, ProveError> {
        let wanted = |e: &&PhysicsEntry| effects.contains(&e.effect.as_str());
        let entries: Vec<PhysicsEntry> = self.tank.entries.iter().filter(wanted).cloned().collect();
        self.left_m(&entries, None)
    }
}

/// Messages as they go out, and (time, surge load \[N\]) where it changes.
type Sent = (Vec<pb::ThrusterCommand>, Vec<(f64, f64)>);

/// A plan as it goes out.
fn sent(rig: &Rig, plan: &Plan, length_s: f64) -> Result<Sent, ProveError> {
    let allocation = Allocation::new(&rig.thrusters)?;
    let period_s = 1.0 / rig.thrusters.link.rate_hz;
    let (mut commands, mut edges) = (Vec::new(), Vec::<(f64, f64)>::new());
    let mut last: Option<Vec<f64>> = None;
    for k in 0..(length_s / period_s) as u32 {
        let t_s = f64::from(k) * period_s;
        let set = setpoint(rig, &allocation, plan, t_s)?;
        let load = allocation.wrench(&set.thrust_n)?.surge_n;
        if edges.last().map_or(load != 0.0, |e| e.1 != load) {
            edges.push((t_s, load));
        }
        // Pulses that have not changed need not be in a log: a command holds until the next.
        if last.as_ref() == Some(&set.pulses_us) {
            continue;
        }
        for ((thruster, pulse_us), thrust_n) in rig
            .thrusters
            .thrusters
            .iter()
            .zip(&set.pulses_us)
            .zip(&set.thrust_n)
        {
            commands.push(pb::ThrusterCommand {
                timestamp: Some(timestamp(at_ns(t_s))),
                sequence: k,
                thruster: thruster.name.clone(),
                thrust_n: *thrust_n,
                pulse_us: *pulse_us,
                due_ns: at_ns(t_s),
                plan_step: set.plan_step,
                cause: "plan".to_owned(),
            });
        }
        last = Some(set.pulses_us);
    }
    Ok((commands, edges))
}

/// Source that `diagnose` would read from the log with these messages; `drift` = drift in its clock records
/// (ppm, sd).
///
/// # Errors
/// [`ProveError::Load`].
pub fn source(
    name: &str,
    commands: &[pb::ThrusterCommand],
    motion: &[pb::VehicleMotion],
    drift: Option<(f64, f64)>,
    rig: &Rig,
) -> Result<Source, ProveError> {
    let mut records = Records::default();
    for m in motion {
        records.motion(unix_ns(m.timestamp.as_ref().unwrap_or(&timestamp(0))), m);
    }
    records.drift_ppm.extend(drift);
    let run = load_messages(name, commands, motion, rig)?;
    let faults = faults(&run, &records, rig);
    Ok(Source {
        run,
        faults,
        ..Source::default()
    })
}

impl Recorded {
    /// As read from its log.
    ///
    /// # Errors
    /// [`ProveError::Load`].
    pub fn source(&self, rig: &Rig) -> Result<Source, ProveError> {
        source(&self.name, &self.commands, &self.motion, None, rig)
    }

    /// rms of the noise that is no outlier \[m\].
    pub fn noise_rms_m(&self) -> f64 {
        let kept: Vec<f64> = self
            .noise_m
            .iter()
            .zip(&self.outlier)
            .filter(|(_, o)| !**o)
            .map(|(v, _)| v * v)
            .collect();
        (kept.iter().sum::<f64>() / kept.len().max(1) as f64).sqrt()
    }
}
