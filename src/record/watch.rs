//! The rig's limits while running, on a thread of its own: the stripe's floor line where there is a
//! fresh one, the model's prediction for the rest, and neutral when there is nothing to watch with.

use super::floor::Floor;
use super::limits::{Estimate, LimitMonitor};
use super::{Job, RecordError, Shared, worker};
use crate::event::Severity;
use crate::shutdown::StopReason;
use crate::thruster::NeutralHandle;
use crate::thruster::safety::NeutralReason;
use std::sync::{Arc, PoisonError};
use std::thread::JoinHandle;
use std::time::Duration;

/// How often the limits are looked at: three looks beyond make an abort (0.15 s).
const LOOK: Duration = Duration::from_millis(50);
/// A floor line older than this says nothing about now \[ns\].
const FRESH_NS: u64 = 500_000_000;
/// Without a good frame for so long a moving vehicle is unwatched: neutral \[ns\]. Longer than a camera
/// takes to come back from an unplugged cable (2-3 s), shorter than a metre at full ahead.
const BLIND_NS: u64 = 5_000_000_000;

/// A floor line and when it was measured, CLOCK_MONOTONIC \[ns\].
pub(super) type Measured = (u64, Floor);

/// Watches until the shutdown is raised.
pub(super) fn start(
    shared: Arc<Shared>,
    job: &Job,
    neutral: Option<NeutralHandle>,
) -> Result<JoinHandle<Option<()>>, RecordError> {
    let mut monitor = LimitMonitor::new(job.rig.limits);
    if !shared.tracker.is_tracking() {
        let words = "the rig's model cannot be simulated: x, y and pitch are not watched";
        shared.say(Severity::Warning, "limit.unwatched", words);
    }
    worker::spawn("limits", shared, move |shared| {
        let mut blind = false;
        while !shared.shutdown.wait(LOOK) {
            let now_ns = shared.clock.monotonic_ns();
            let estimate = estimate(shared, now_ns);
            if let Some(words) = monitor.update(&estimate) {
                if let Some(neutral) = &neutral {
                    neutral.request(NeutralReason::Limit);
                }
                shared.say(Severity::Error, "limit.passed", words.clone());
                shared.shutdown.raise(StopReason::Limit(words));
            }
            let last_good_ns = shared.progress(|p| p.last_good_ns);
            let silent = last_good_ns.is_some_and(|last| now_ns.saturating_sub(last) > BLIND_NS);
            if silent && !blind {
                if let Some(neutral) = &neutral {
                    neutral.request(NeutralReason::Limit);
                }
                let seconds = BLIND_NS / 1_000_000_000;
                let words = format!(
                    "no good frame for {seconds} s: nobody watches the vehicle, thrusters to neutral; recording goes on"
                );
                shared.say(Severity::Error, "limit.blind", words);
            }
            blind = silent;
        }
    })
}

fn estimate(shared: &Shared, now_ns: u64) -> Estimate {
    let unix_ns = shared.clock.triple().monotonic_to_unix_ns(now_ns);
    let mut estimate = shared.tracker.estimate(unix_ns);
    let measured = *shared.floor.lock().unwrap_or_else(PoisonError::into_inner);
    if let Some((at_ns, floor)) = measured
        && now_ns.saturating_sub(at_ns) <= FRESH_NS
    {
        estimate.z_m = Some(-floor.height_m);
        estimate.phi_rad = Some(floor.phi_rad);
    }
    estimate
}
