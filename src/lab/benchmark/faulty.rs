//! Data that are wrong: what is done to a sound log, and what a diagnosis must say of it.

use hydroline_rigs::Rig;
use rand::{RngExt, SeedableRng, rngs::StdRng};

use super::error::ProveError;
use super::experiment::{Recorded, at_ns, source};
use hydroline_diagnose::Source;
use hydroline_diagnose::verdict::{Verdict, Word};
use hydroline_log::messages::{pb, timestamp, unix_ns};

/// A fault.
#[derive(
    Debug, Clone, Copy, PartialEq, Eq, serde::Serialize, schemars::JsonSchema, serde::Deserialize,
)]
#[serde(rename_all = "snake_case")]
pub enum Fault {
    /// x in millimetres.
    Units,
    /// x and y exchanged.
    Swapped,
    /// x stays where it was.
    Dead,
    /// Every third stamp is the one before.
    Repeated,
    /// One sample in eight is far off.
    Outliers,
    /// The measurement's clock runs 1500 ppm fast and the clock records say so.
    ClockInRecords,
    /// The clock drifts and only the motion shows it.
    ClockInMotion,
}

const DRIFT_PPM: f64 = 1500.0;

impl Fault {
    /// Every fault, in the order of the cases.
    pub const ALL: [Fault; 7] = [
        Fault::Units,
        Fault::Swapped,
        Fault::Dead,
        Fault::Repeated,
        Fault::Outliers,
        Fault::ClockInRecords,
        Fault::ClockInMotion,
    ];

    /// Of the n-th case.
    pub fn of(index: usize) -> Fault {
        Fault::ALL[index % Fault::ALL.len()]
    }

    /// The log with this fault in it.
    ///
    /// # Errors
    /// [`ProveError::Load`].
    pub fn source(self, r: &Recorded, rig: &Rig, seed: u64) -> Result<Source, ProveError> {
        let mut rng = StdRng::seed_from_u64(seed ^ r.motion.len() as u64);
        let mut motion: Vec<pb::VehicleMotion> = r.motion.clone();
        let rest = motion.first().and_then(|m| m.x_m);
        let mut last = None;
        for (k, m) in motion.iter_mut().enumerate() {
            match self {
                Fault::Units => m.x_m = m.x_m.map(|x| 1e3 * x),
                Fault::Swapped => std::mem::swap(&mut m.x_m, &mut m.y_m),
                Fault::Dead => m.x_m = rest,
                Fault::Repeated => {
                    if k % 3 == 2 {
                        m.timestamp = last;
                    }
                }
                Fault::Outliers => {
                    if rng.random::<f64>() < 0.125 {
                        m.x_m = m.x_m.map(|x| x + 0.4 * (rng.random::<f64>() - 0.5));
                    }
                }
                Fault::ClockInRecords => {
                    let ns = unix_ns(m.timestamp.as_ref().unwrap_or(&timestamp(0)));
                    let t_s = ns.saturating_sub(at_ns(0.0)) as f64 * 1e-9;
                    m.timestamp = Some(timestamp(at_ns(t_s * (1.0 + 1e-6 * DRIFT_PPM))));
                }
                Fault::ClockInMotion => {}
            }
            last = m.timestamp;
        }
        let drift = (self == Fault::ClockInRecords).then_some((DRIFT_PPM, 4.0));
        source(&r.name, &r.commands, &motion, drift, rig)
    }

    /// Whether a verdict says what is wrong.
    pub fn right(self, v: &Verdict) -> bool {
        let reported = |kinds: &[&str]| {
            v.data_faults
                .iter()
                .any(|f| kinds.contains(&f.fault.as_str()))
        };
        let stopped = v.verdict == Word::DataFault;
        match self {
            Fault::Units => stopped && reported(&["units"]),
            Fault::Swapped => stopped && reported(&["swapped_columns"]),
            Fault::Dead => stopped && reported(&["dead_channel", "stuck_channel"]),
            Fault::Repeated => stopped && reported(&["repeated_stamps"]),
            Fault::Outliers => stopped && reported(&["outliers"]),
            Fault::ClockInRecords => {
                reported(&["clock_drift"]) && !v.effects.iter().any(|e| e.effect == "clock_drift")
            }
            Fault::ClockInMotion => !stopped && v.effects.iter().any(|e| e.effect == "clock_drift"),
        }
    }
}
