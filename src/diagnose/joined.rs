//! Logs of two clocks: what the likelihood says of them, and what it cannot show beside them.
//!
//! A command that acts later and a clock that is off by as much make the same motion. The clock is one of the numbers of every model
//! (`hydroline_inference::clock`), so that a latency is named only where it is more than the clock may be off.

use hydroline_core::run::Run;
use hydroline_inference::body::{Body, Own};
use hydroline_inference::fit::Fit;

use crate::verdict::Verdict;

/// Effects that are a fixed difference of time.
const LATENCIES: [&str; 2] = ["command_latency", "camera_latency"];
/// Share of its own sd to which the motion has to narrow an offset for a latency to be distinguished from it.
const NARROWED: f64 = 0.5;

/// Says what a fit makes of the clocks of joined logs, and which effects it cannot show beside them.
pub(crate) fn tell(verdict: &mut Verdict, runs: &[Run], body: &Body, fit: &Fit) {
    for (i, own) in body.own.iter().enumerate() {
        let Own::ClockOffset(clock) = own else {
            continue;
        };
        let value = own.natural(fit.point[i]).0;
        let sd = own.unit() * fit.covariance[(i, i)].sqrt();
        let of = body.recording.runs.iter().find(|r| r.clock == Some(*clock));
        let name = of.map_or("", |r| r.name.as_str());
        verdict.notes.push(format!(
            "{name}: commands act {value:.4} s (sd {sd:.4}) later than the joined log says (its own sd {:.4}): the clock is one of the numbers of every model, and a latency of that size is not named",
            own.unit()
        ));
        // One run of one clock tells a latency from the others' offsets.
        let one_clock = body.recording.runs.iter().any(|r| r.clock.is_none());
        if !one_clock && sd > NARROWED * own.unit() {
            LATENCIES.iter().for_each(|id| verdict.cannot_show(id));
        }
    }
    let commanded = || runs.iter().filter(|r| !r.commands.is_empty());
    let is_estimated = |r: &Run| r.joined.is_some_and(|j| j.is_estimated);
    if commanded().next().is_some() && commanded().all(is_estimated) {
        LATENCIES.iter().for_each(|id| verdict.cannot_show(id));
        verdict.notes.push("the offset of the joined logs was estimated from this motion and holds every latency: measure it (join --offset-s, --offset-sd-s) to know one".to_owned());
    }
}
