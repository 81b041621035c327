//! Motion that the rig's model makes of the commands that were sent, and what the measured motion is beyond it.
//!
//! Both are computed as far as somebody looks: first the commands are read in the order of the log, then the measured motion.

use crate::column::{Column, Sample};
use crate::series::Stretch;
use crate::viewed::{Viewed, places_of};
use hydroline_core::lock::Lock;
use hydroline_log::Topic;
use hydroline_log::messages::pb::{ThrusterCommand, VehicleMotion};
use prost::Message;
use std::f64::consts::PI;

/// Longest step between two looks at the model \[ns\]: a line between them is straight.
const STEP_NS: i64 = 50_000_000;
/// Steps to the next command at the most: behind a longer pause the model goes there at once.
const STEPS_MAX: i64 = 2_000;

/// Channels of pose, as motion has them; the last three are angles.
pub(crate) const POSE: [&str; 6] = ["x_m", "y_m", "z_m", "phi_rad", "theta_rad", "psi_rad"];
/// Channel of the model's motion, and of what is beyond it: no log has as many.
pub(crate) const PREDICTED: u16 = u16::MAX;
pub(crate) const RESIDUAL: u16 = u16::MAX - 1;
/// Their topics' names.
const NAMES: [(u16, &str); 2] = [(PREDICTED, "predicted"), (RESIDUAL, "measured − predicted")];

/// A model of the vehicle that follows commands in the order of time.
pub trait Model: Send {
    /// A command that was sent.
    fn command(&mut self, thruster: &str, thrust_n: f64, at_ns: u64);

    /// Pose at a moment, no earlier than what came before; `None` = it has run away.
    fn pose(&mut self, at_ns: u64) -> Option<[f64; 6]>;
}

/// The model's motion and the residuals, as far as they were computed.
pub(crate) struct Derived {
    model: Box<dyn Model>,
    /// Places with commands and with motion, and how many were read.
    commands: (Vec<usize>, usize),
    motion: (Vec<usize>, usize),
    last_ns: Option<i64>,
    is_over: bool,
    predicted: [Column; 6],
    residual: [Column; 6],
}

impl std::fmt::Debug for Derived {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Derived")
            .field("commands", &self.commands.1)
            .field("motion", &self.motion.1)
            .finish_non_exhaustive()
    }
}

/// Name of a computed topic.
pub(crate) fn name(channel: u16) -> Option<&'static str> {
    let found = NAMES.iter().find(|(own, _)| *own == channel);
    found.map(|(_, name)| *name)
}

impl Viewed {
    /// Lets a model follow the log's commands. Without commands there is nothing to follow.
    pub fn follow(&self, model: Box<dyn Model>) {
        let places = |topic| places_of(self.log(), &self.channels_of(topic));
        let commands = places(Topic::Command);
        if commands.is_empty() {
            return;
        }
        let motion = places(Topic::Motion);
        let mut fields = self.fields.held();
        for path in POSE {
            fields.number(PREDICTED, "", path);
            if !motion.is_empty() {
                fields.number(RESIDUAL, "", path);
            }
        }
        drop(fields);
        *self.derived.held() = Some(Derived {
            model,
            commands: (commands, 0),
            motion: (motion, 0),
            last_ns: None,
            is_over: false,
            predicted: Default::default(),
            residual: Default::default(),
        });
    }

    /// Whether a field is computed.
    pub(crate) fn is_derived(&self, number: usize) -> bool {
        let fields = self.fields.held();
        let field = fields.all().get(number);
        field.is_some_and(|f| name(f.channel).is_some())
    }

    /// Computes on while `more` says so; share that is done, and a copy of the samples of these fields in a stretch, with a neighbour
    /// on either side.
    pub(crate) fn derive(
        &self,
        of: &[usize],
        stretch: Stretch,
        more: impl Fn() -> bool,
    ) -> (f64, Vec<(usize, Vec<Sample>)>) {
        let mut held = self.derived.held();
        let Some(derived) = held.as_mut() else {
            return (1.0, Vec::new());
        };
        let wanted: Vec<(usize, u16, usize)> = {
            let fields = self.fields.held();
            let place = |path: &str| POSE.iter().position(|p| *p == path);
            let each = of.iter().filter_map(|n| {
                let field = fields.all().get(*n)?;
                Some((*n, field.channel, place(&field.path)?))
            });
            each.collect()
        };
        let residuals = wanted.iter().any(|w| w.1 == RESIDUAL);
        let share = self.compute(derived, residuals, more);
        let of = |(number, channel, k): (usize, u16, usize)| {
            let columns = match channel {
                PREDICTED => &mut derived.predicted,
                _ => &mut derived.residual,
            };
            let shown = crate::column::decimated(
                columns[k].samples(),
                stretch.from_ns,
                stretch.to_ns,
                stretch.pixels,
            );
            (number, shown)
        };
        (share, wanted.into_iter().map(of).collect())
    }

    fn compute(&self, derived: &mut Derived, residuals: bool, more: impl Fn() -> bool) -> f64 {
        let command_channels = self.channels_of(Topic::Command);
        while let Some(place) = derived.commands.0.get(derived.commands.1).copied() {
            let mut sent: Vec<(i64, ThrusterCommand)> =
                (self.messages(place, &command_channels).iter())
                    .filter_map(|m| {
                        let command = ThrusterCommand::decode(m.data.clone()).ok()?;
                        Some((self.since_zero(self.stamp_ns(m)), command))
                    })
                    .collect();
            sent.sort_by_key(|(at_ns, _)| *at_ns);
            for (at_ns, command) in sent {
                self.advance(derived, at_ns);
                let unix_ns = self.unix_ns(at_ns);
                (derived.model).command(&command.thruster, command.thrust_n, unix_ns);
            }
            derived.commands.1 += 1;
            if !more() {
                return derived.share(residuals);
            }
        }
        if !derived.is_over {
            derived.is_over = true;
            let (_, end_ns) = self.span();
            self.advance(derived, end_ns);
        }
        let motion_channels = self.channels_of(Topic::Motion);
        while residuals && let Some(place) = derived.motion.0.get(derived.motion.1).copied() {
            for message in self.messages(place, &motion_channels) {
                let at_ns = self.since_zero(self.stamp_ns(&message));
                if let Ok(motion) = VehicleMotion::decode(message.data) {
                    derived.compare(at_ns, &motion);
                }
            }
            derived.motion.1 += 1;
            if !more() {
                break;
            }
        }
        derived.share(residuals)
    }

    /// Lets the model go on to a moment, in steps.
    fn advance(&self, derived: &mut Derived, at_ns: i64) {
        let from_ns = derived.last_ns.unwrap_or(at_ns);
        if derived.last_ns == Some(at_ns) {
            return;
        }
        let steps = ((at_ns - from_ns) / STEP_NS).clamp(0, STEPS_MAX);
        let moments = (1..=steps).map(|k| from_ns + (at_ns - from_ns) / (steps + 1) * k);
        for moment in moments.chain([at_ns]) {
            let Some(pose) = derived.model.pose(self.unix_ns(moment)) else {
                self.note(
                    "the rig's model runs away under these commands: what is predicted ends there"
                        .to_owned(),
                );
                break;
            };
            for (column, value) in derived.predicted.iter_mut().zip(pose) {
                column.push(moment, value);
            }
        }
        derived.last_ns = Some(at_ns);
    }
}

impl Derived {
    fn share(&self, residuals: bool) -> f64 {
        let all = self.commands.0.len() + if residuals { self.motion.0.len() } else { 0 };
        let done = self.commands.1 + if residuals { self.motion.1 } else { 0 };
        done as f64 / all.max(1) as f64
    }

    /// What is measured beyond the model.
    fn compare(&mut self, at_ns: i64, motion: &VehicleMotion) {
        let measured = [
            motion.x_m,
            motion.y_m,
            motion.z_m,
            motion.phi_rad,
            motion.theta_rad,
            motion.psi_rad,
        ];
        for (k, value) in measured.into_iter().enumerate() {
            let predicted = between(self.predicted[k].samples(), at_ns);
            if let Some((value, predicted)) = value.zip(predicted) {
                let beyond = value - predicted;
                // An angle goes round.
                let beyond = if k < 3 {
                    beyond
                } else {
                    (beyond + PI).rem_euclid(2.0 * PI) - PI
                };
                self.residual[k].push(at_ns, beyond);
            }
        }
    }
}

/// Value at a moment, linear between two samples; at rest before the first, nothing after the last.
fn between(samples: &[Sample], at_ns: i64) -> Option<f64> {
    let behind = samples.partition_point(|s| s.at_ns < at_ns);
    let after = samples.get(behind)?;
    let Some(before) = behind.checked_sub(1).map(|k| samples[k]) else {
        return Some(after.value);
    };
    let part = (at_ns - before.at_ns) as f64 / (after.at_ns - before.at_ns).max(1) as f64;
    Some(before.value + part * (after.value - before.value))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn between_two_samples_the_line_is_straight() {
        let of = |at_ns, value| Sample { at_ns, value };
        let samples = [of(10, 1.0), of(20, 3.0), of(30, 3.0)];
        let at = |ns| between(&samples, ns);
        assert_eq!(
            (at(0), at(10), at(15), at(20)),
            (Some(1.0), Some(1.0), Some(2.0), Some(3.0))
        );
        assert_eq!((at(30), at(31)), (Some(3.0), None));
        assert_eq!(between(&[], 0), None);
    }
}
