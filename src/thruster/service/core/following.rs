//! An autopilot drives: what it puts out and measures goes to the log, and nothing is commanded.

use super::Core;
use crate::mavlink::{Content, Heard};
use crate::record::{CommandRecord, HeardRecord, LinkRecord};
use crate::service::PlanState;
use hydroline_core::event::{Severity, kind};

impl Core {
    /// Logs what an autopilot says.
    pub(super) fn follow(&mut self, heard: Heard) {
        let triple = self.clock.triple();
        let timestamp_ns = triple.monotonic_to_unix_ns(heard.at_ns);
        let Content::Outputs(pulses) = &heard.what else {
            return (self.sink)(LinkRecord::Heard(HeardRecord {
                timestamp_ns,
                autopilot_us: heard.autopilot_us,
                what: heard.what,
            }));
        };
        let thrusters = &self.config.set.thrusters;
        let of = |channel| pulses.iter().find(|p| p.channel == channel);
        // A bank of outputs without any thruster: lights, a gripper.
        if thrusters.iter().all(|t| of(t.channel).is_none()) {
            return;
        }
        self.sequence = self.sequence.wrapping_add(1);
        for (thruster, name) in thrusters.iter().zip(&self.names) {
            let Some(pulse_us) = of(thruster.channel).map(|p| p.pulse_us()) else {
                continue;
            };
            (self.sink)(LinkRecord::Command(CommandRecord {
                timestamp_ns,
                sent_monotonic_ns: heard.at_ns,
                sequence: self.sequence,
                thruster: name.clone(),
                thrust_n: thruster.curve.thrust_n(pulse_us),
                pulse_us,
                due_ns: 0,
                plan_step: 0,
                cause: "autopilot",
            }));
        }
        let is_full = thrusters.iter().all(|t| of(t.channel).is_some());
        self.shared.stats(|s| {
            s.sets += 1;
            s.echoed += u64::from(is_full);
        });
    }

    pub(super) fn missed_messages(&mut self, messages: u64) {
        self.shared.stats(|s| s.missed += messages);
        let missed = self.shared.stats(|s| s.missed);
        self.noisy(Severity::Warning, &kind::AUTOPILOT_MISSED, |_| {
            (
                format!("{missed} messages of the autopilot did not arrive so far, by its counter"),
                vec![("messages", missed as f64)],
            )
        });
    }

    pub(super) fn refuse_to_drive(&mut self) {
        let why = "the plan is not started: the autopilot drives (thrusters.link.kind = \"mavlink\"), hydroline only listens";
        self.set_plan(PlanState::Refused(why.into()));
        self.event(Severity::Error, &kind::THRUSTER_REFUSED, why.into(), &[]);
    }
}
