//! The last look before a plan begins: simulated from where the vehicle is measured, a plan that would leave the tank or the
//! limits from there does not begin.
//!
//! [`Launch`] is a core without I/O and clock; [`Launcher`] simulates on a thread of its own, so that signals, keys and the
//! service manager's watchdog are answered meanwhile.
//!
//! From the rig's start the plan was checked before: what it does from there as well is no reason here. Over a target that
//! repeats itself poses are known up to a repetition: a vehicle that lies just one further on is not noticed.

use super::limits::CONFIRM;
use super::measured_pose::MeasuredPose;
use super::{Job, LEAD};
use crate::bring_back::{FRESH, StartTolerance};
use hydroline_calib::plane::PlaneMap;
use hydroline_core::event::Severity;
use hydroline_core::thread_class::{block_signals, step_back};
use hydroline_plan::preflight::{Repeats, Violation, preflight_runs};
use hydroline_rigs::{Plan, Rig};
use std::sync::Arc;
use std::thread::JoinHandle;
use std::time::Duration;

/// Time in which a pose comes by itself once the camera is ready, if one does: a fit takes some ms, and there are tens of
/// frames. Whoever watches waits no longer for one.
const PATIENCE: Duration = Duration::from_secs(1);

const NO_POSE: &str = "no pose shows where the vehicle is over its target";
const NO_TARGET: &str = "the rig has no target that would show where the vehicle is";
const NO_MAP: &str = "without a map to the laser plane no pose is measured";
const BOARD: &str = "while a board is searched for no pose is measured";
const TOO_LONG: &str =
    "the plan is too long to be simulated again from where the vehicle is measured";

/// Violations of a plan from a measured pose that it has not from the rig's start as well; in words why it cannot be simulated.
type Found = Result<Vec<Violation>, String>;

/// State of the recording at a look.
#[derive(Debug, Clone, Copy)]
pub(super) struct Look {
    /// Now, CLOCK_MONOTONIC \[ns\].
    pub now_ns: u64,
    /// Time since all but the place is ready.
    pub ready_for: Duration,
    /// Whether the time in which the recording has to be ready is over.
    pub is_late: bool,
    /// The newest measured pose.
    pub pose: Option<MeasuredPose>,
}

/// Next step before a plan begins.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum Next {
    /// Look again.
    Wait,
    /// Simulate the plan from this pose; what is found goes to [`Launch::simulated`].
    Simulate([f64; 6]),
    /// The plan begins.
    Begin {
        /// Where the vehicle is, as far as that is measured; else the rig's start.
        pose: [f64; 6],
        /// Severity of the words.
        severity: Severity,
        /// Knowledge of the place.
        words: String,
    },
    /// The plan does not begin, for this reason.
    Refuse(String),
}

/// How far the look has come.
#[derive(Debug, Clone)]
enum Stage {
    /// A pose is waited for.
    Looking,
    /// The plan is simulated from this pose, whose measured values are these in words.
    Simulating([f64; 6], String),
    /// All is known.
    Decided(Next),
}

/// The core.
#[derive(Debug)]
pub(super) struct Launch {
    /// Name of the plan.
    plan: String,
    /// The rig's start.
    start: [f64; 6],
    /// Nobody watches: where poses can show the place, no plan begins without one.
    unattended: bool,
    /// Reason why no pose can show the place; `None` = one may.
    unseen: Option<&'static str>,
    /// Stamp of the pose that was looked at last.
    pose_ns: Option<u64>,
    /// Number of poses, all so far, from which the plan would leave tank or limits.
    leaving: u32,
    /// Violation from the last of them, in words.
    refusal: Option<String>,
    stage: Stage,
}

impl Launch {
    fn new(job: &Job, plan: &Plan, is_mapped: bool) -> Self {
        let unseen = if job.calibrate.is_some() {
            Some(BOARD)
        } else if !is_mapped {
            Some(NO_MAP)
        } else if job.rig.target.is_none() {
            Some(NO_TARGET)
        } else {
            None
        };
        Self {
            plan: plan.name.clone(),
            start: job.rig.tank.start_pose,
            unattended: job.unattended,
            unseen,
            pose_ns: None,
            leaving: 0,
            refusal: None,
            stage: Stage::Looking,
        }
    }

    /// Looks at what is known now.
    fn look(&mut self, look: &Look) -> Next {
        let is_over = look.is_late && look.ready_for > PATIENCE;
        match &self.stage {
            Stage::Decided(next) => return next.clone(),
            Stage::Simulating(..) if is_over => return self.unmeasured(TOO_LONG),
            Stage::Simulating(..) => return Next::Wait,
            Stage::Looking => {}
        }
        if let Some(why) = self.unseen {
            return self.begun_at_the_rigs_start(why);
        }
        let new = look.pose.filter(|pose| {
            let age_ns = look.now_ns.saturating_sub(pose.received_ns);
            let is_fresh = u128::from(age_ns) <= FRESH.as_nanos();
            is_fresh && pose.is_placed() && self.pose_ns != Some(pose.received_ns)
        });
        if let Some(pose) = new {
            return self.seen(&pose);
        }
        // Whoever watches sees where the vehicle is; but a pose that speaks against the plan waits for others.
        let waits = self.unattended || self.refusal.is_some();
        let gives_up = if waits {
            is_over
        } else {
            look.ready_for > PATIENCE
        };
        match &self.refusal {
            _ if !gives_up => Next::Wait,
            Some(words) => Next::Refuse(words.clone()),
            None => self.unmeasured(NO_POSE),
        }
    }

    fn seen(&mut self, pose: &MeasuredPose) -> Next {
        self.pose_ns = Some(pose.received_ns);
        let (at, place) = (pose.start(self.start), pose.shown());
        // As near as hands bring a vehicle: the plan was checked from there.
        if pose.is_at(&self.start, &StartTolerance::default()) {
            return Next::Begin {
                pose: at,
                severity: Severity::Info,
                words: format!(
                    "the vehicle is measured at {place}: at the start of plan '{}'",
                    self.plan
                ),
            };
        }
        self.stage = Stage::Simulating(at, place);
        Next::Simulate(at)
    }

    /// Takes what a simulation found.
    fn simulated(&mut self, found: Found) {
        let Stage::Simulating(pose, place) = &self.stage else {
            return;
        };
        let (pose, place, plan) = (*pose, place.clone(), &self.plan);
        let found = match found {
            Ok(found) => found,
            Err(why) => {
                let why = format!(
                    "the vehicle is measured at {place}, from where the plan cannot be simulated ({why})"
                );
                self.stage = Stage::Decided(self.unmeasured(&why));
                return;
            }
        };
        let leaving: Vec<&Violation> = found.iter().filter(|v| v.is_leaving()).collect();
        if let [first, others @ ..] = &leaving[..] {
            let more = match others.len() {
                0 => String::new(),
                n => format!(" (and {n} more)"),
            };
            let words = format!(
                "plan '{plan}' does not begin: the vehicle is measured at {place}, and from there {first}{more}. {}",
                self.way_on()
            );
            self.leaving += 1;
            // One false pose is none, as for the limits in a run.
            if self.leaving >= CONFIRM {
                self.stage = Stage::Decided(Next::Refuse(words));
            } else {
                self.refusal = Some(words);
                self.stage = Stage::Looking;
            }
            return;
        }
        let (severity, words) = match found.first() {
            None => (
                Severity::Info,
                format!(
                    "the vehicle is measured at {place}: plan '{plan}' stays within tank and limits from there"
                ),
            ),
            Some(first) => (
                Severity::Warning,
                format!(
                    "the vehicle is measured at {place}: plan '{plan}' stays within tank and limits from there, but {first}"
                ),
            ),
        };
        self.stage = Stage::Decided(Next::Begin {
            pose,
            severity,
            words,
        });
    }

    /// Next step where the place is not known, or not what the plan does from there.
    fn unmeasured(&self, why: &str) -> Next {
        if self.unattended {
            return Next::Refuse(format!(
                "plan '{}' does not begin: {why}, and as a service nobody watches it. {}",
                self.plan,
                self.way_on()
            ));
        }
        self.begun_at_the_rigs_start(why)
    }

    /// Begins with a warning: where no pose can show the place, a service begins its plan too, once.
    fn begun_at_the_rigs_start(&self, why: &str) -> Next {
        let plan = &self.plan;
        Next::Begin {
            pose: self.start,
            severity: Severity::Warning,
            words: format!(
                "{why}: plan '{plan}' was checked from the rig's start alone, and begins as if the vehicle were there"
            ),
        }
    }

    /// Next step of whoever reads that a plan does not begin.
    fn way_on(&self) -> String {
        let [x, y, z, _, _, psi] = self.start;
        let way = format!(
            "Bring the vehicle to the rig's start, x {x:.3} m, y {y:.3} m, z {z:.3} m, heading {:.1} deg (--return-to-start shows the way), or take another plan",
            psi.to_degrees()
        );
        if self.unattended {
            format!("{way}; then `systemctl stop hydroline` and `systemctl start hydroline`")
        } else {
            way
        }
    }
}

/// Rig, plan and map that are simulated.
struct Subject {
    rig: Rig,
    plan: Plan,
    map: Option<Arc<dyn PlaneMap>>,
    repeats: Repeats,
}

impl Subject {
    fn violations(&self, start: [f64; 6]) -> Found {
        let from = |start_pose: [f64; 6]| {
            let mut rig = self.rig.clone();
            rig.tank.start_pose = start_pose;
            preflight_runs(&rig, &self.plan, self.repeats, self.map.as_deref())
                .map(|report| report.violations)
                .map_err(|error| error.to_string())
        };
        let found = from(start)?;
        if found.is_empty() {
            return Ok(found);
        }
        // What it does from the rig's start was found, or wanted, before.
        let known = from(self.rig.tank.start_pose)?;
        let is_new = |v: &Violation| known.iter().all(|k| k.kind() != v.kind());
        Ok(found.into_iter().filter(is_new).collect())
    }
}

/// The core with the simulations that it asks for.
pub(super) struct Launcher {
    launch: Launch,
    subject: Arc<Subject>,
    simulation: Option<JoinHandle<Found>>,
}

impl Launcher {
    /// For one run of the plan, as long as the job records it; poses come from `map`.
    pub fn new(job: &Job, plan: &Plan, map: Option<Arc<dyn PlaneMap>>) -> Self {
        let active = job.length.map(|length| length.saturating_sub(LEAD));
        Self {
            launch: Launch::new(job, plan, map.is_some()),
            subject: Arc::new(Subject {
                rig: job.rig.clone(),
                plan: plan.clone(),
                map,
                repeats: Repeats {
                    active_s: active.map_or(f64::INFINITY, |active| active.as_secs_f64()),
                    ..Repeats::ONCE
                },
            }),
            simulation: None,
        }
    }

    /// Looks, and simulates where that is asked for: waits for nothing, and never gives [`Next::Simulate`].
    pub fn look(&mut self, look: &Look) -> Next {
        if let Some(simulation) = self.simulation.take_if(|s| s.is_finished()) {
            let panicked = |_| Err("its thread panicked: this is a bug of hydroline".to_owned());
            let found = simulation.join().unwrap_or_else(panicked);
            self.launch.simulated(found);
        }
        match self.launch.look(look) {
            Next::Simulate(start) => {
                self.simulate(start);
                Next::Wait
            }
            next => next,
        }
    }

    fn simulate(&mut self, start: [f64; 6]) {
        let subject = self.subject.clone();
        let work = move || {
            block_signals();
            // Behind the thrusters, the camera and the log.
            step_back(10);
            subject.violations(start)
        };
        let spawned = std::thread::Builder::new()
            .name("preflight".to_owned())
            .spawn(work);
        match spawned {
            Ok(simulation) => self.simulation = Some(simulation),
            Err(error) => self.launch.simulated(Err(error.to_string())),
        }
    }
}

#[cfg(test)]
mod tests;
