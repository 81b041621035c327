//! Makes cases with a run held out.

use std::collections::{BTreeMap, BTreeSet};

use hydroline_core::run::{Channel, PerChannel};
use hydroline_diagnose::Source;
use hydroline_diagnose::verdict::Value;
use hydroline_identify::parameter::Coefficient;
use hydroline_rigs::{Rig, VehicleModel};
use rand::{SeedableRng, rngs::StdRng};

use super::{coupled, surge};
use crate::benchmark::coupled::motion;
use crate::benchmark::error::ProveError;

/// Draws before a case is given up.
pub(super) const TRIES: usize = 200;
/// Factor of the loads of a run that goes beyond those fitted.
pub(super) const LOADS: f64 = 3.0;
/// Largest share of the tolerance that a mechanism of large loads may be worth over the runs fitted: they do not show that it matters.
pub(super) const HIDDEN: f64 = 0.5;
/// Least change of the run held out by the mechanism, over its noise. A diagnosis is not made for less than what has to be missed, and
/// coefficients take up a part of it.
pub(super) const SHOWN: f64 = 8.0;

/// Whether a run held out is to be missed.
#[derive(
    Debug, Clone, Copy, PartialEq, Eq, serde::Serialize, schemars::JsonSchema, serde::Deserialize,
)]
#[serde(rename_all = "snake_case")]
pub enum Kind {
    /// Beyond the runs fitted, of a vehicle of which they show too little.
    Missed,
    /// Within the runs fitted, of a vehicle of the library.
    Inside,
}

/// Quantity in which a run goes beyond others.
#[derive(
    Debug,
    Clone,
    Copy,
    PartialEq,
    Eq,
    PartialOrd,
    Ord,
    serde::Serialize,
    schemars::JsonSchema,
    serde::Deserialize,
)]
#[serde(rename_all = "snake_case")]
pub enum Beyond {
    /// Loads.
    Loads,
    /// Speeds or turning rates.
    Speeds,
    /// Frequencies of a load.
    Frequencies,
}

impl Beyond {
    /// Quantities that a verdict's words name (`contradicted_by`, `outside`).
    pub fn named_in(outside: &str) -> BTreeSet<Beyond> {
        let of = |phrase: &str| {
            let begins = |what: &str| {
                let ranges = ["up to", "from"].map(|range| format!(" {what} {range} "));
                ranges.iter().any(|r| phrase.contains(r))
            };
            if phrase.contains(" load that changes at ") {
                Some(Beyond::Frequencies)
            } else if begins("load") {
                Some(Beyond::Loads)
            } else if begins("speed") || begins("rate") {
                Some(Beyond::Speeds)
            } else {
                None
            }
        };
        outside.split("; ").filter_map(of).collect()
    }
}

/// A run held out, and what only the key knows of it.
#[derive(Debug, Clone)]
pub struct Held {
    /// The log.
    pub source: Source,
    /// True motion at its stamps, as instruments without noise report it; NaN = not measured.
    pub truth: Vec<PerChannel<f64>>,
    /// rms of its noise without outliers \[SI\]; NaN = not measured.
    pub noise: PerChannel<f64>,
}

/// Miss of the true motion of a run held out.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Miss {
    /// Channel in which it is largest for what is to be expected there.
    pub channel: Channel,
    /// Over the noise; `None` = no finite motion.
    pub over_noise: Option<f64>,
    /// sd of the motion that the numbers leave open, over the noise.
    pub open_over_noise: f64,
}

impl Held {
    /// Miss of the true motion by a rig, and what the sds of its coefficients leave open: each by itself, from the same start.
    ///
    /// # Errors
    /// [`ProveError`] of a rig that the simulator refuses.
    pub fn missed_by(
        &self,
        rig: &Rig,
        numbers: &BTreeMap<String, Value>,
        is_coupled: bool,
    ) -> Result<Miss, ProveError> {
        let mut rig = rig.clone();
        if !is_coupled {
            // As the truth of one DOF: what the pulses' grid leaks into others turns nothing.
            rig.vehicle.model = VehicleModel::Decoupled;
        }
        let run = &self.source.run;
        let stamps_s: Vec<f64> = run.samples.iter().map(|s| s.t_s).collect();
        let endless = Miss {
            channel: Channel::X,
            over_noise: None,
            open_over_noise: 0.0,
        };
        let Some(predicted) = motion(&rig, &run.commands, &stamps_s)? else {
            return Ok(endless);
        };
        let mut open = PerChannel::splat(0.0);
        for (key, value) in numbers {
            let Some((c, sd)) = Coefficient::find(key).zip(value.sd) else {
                continue;
            };
            let mut other = rig.clone();
            c.put(&mut other.vehicle, c.of_vehicle(&rig.vehicle) + sd);
            if let Some(moved) = motion(&other, &run.commands, &stamps_s)? {
                let by = rms_between(&predicted, &moved);
                open = PerChannel::from_fn(|c| by[c].hypot(open[c]));
            }
        }
        let off = rms_between(&self.truth, &predicted);
        let misses = off.each().map(|(channel, off)| {
            let miss = Miss {
                channel,
                over_noise: Some(off / self.noise[channel]),
                open_over_noise: open[channel] / self.noise[channel],
            };
            (miss, off / self.noise[channel].hypot(open[channel]))
        });
        let largest = misses.filter(|m| m.1.is_finite());
        let largest = largest.max_by(|a, b| a.1.total_cmp(&b.1));
        Ok(largest.map_or(endless, |m| m.0))
    }
}

/// rms of the difference between two motions, channel by channel; NaN = not measured.
pub(super) fn rms_between(a: &[PerChannel<f64>], b: &[PerChannel<f64>]) -> PerChannel<f64> {
    PerChannel::from_fn(|c| {
        let squares = a.iter().zip(b).map(|(a, b)| (a[c] - b[c]).powi(2));
        (squares.sum::<f64>() / a.len() as f64).sqrt()
    })
}

/// A case.
#[derive(Debug, Clone)]
pub struct HeldOutCase {
    /// Number of the case.
    pub index: usize,
    /// Surge, sway and yaw driven at once; else surge alone.
    pub is_coupled: bool,
    /// Whether the run held out is to be missed.
    pub kind: Kind,
    /// Quantity in which the run held out goes beyond those fitted; `None` = in none.
    pub beyond: Option<Beyond>,
    /// Effects and laws that are there.
    pub there: Vec<String>,
    /// Logs to fit.
    pub sources: Vec<Source>,
    /// The run held out.
    pub held: Held,
    /// The rig file.
    pub rig: Rig,
}

/// A case to be drawn.
pub(super) struct Place {
    /// Of this case and this draw alone.
    pub seed: u64,
    pub index: usize,
    /// Place among the cases of its kind and body, from 0 on.
    pub nth: usize,
}

/// Whether a case is coupled: of six numbers 2 and 5.
fn is_coupled(index: usize) -> bool {
    index % 3 == 2
}

fn kind_of(index: usize) -> Kind {
    match index % 2 {
        0 => Kind::Missed,
        _ => Kind::Inside,
    }
}

/// Place of a case among those of its kind and body: from 0 on, without gaps.
fn nth(index: usize) -> usize {
    let alike = |i: &usize| is_coupled(*i) == is_coupled(index) && kind_of(*i) == kind_of(index);
    (0..index).filter(alike).count()
}

/// Makes a case; the same seed, number and draw give the same bytes. Even numbers are to be missed, odd ones lie inside; every third
/// is coupled.
///
/// # Errors
/// [`ProveError`].
pub fn make(seed: u64, index: usize, draw: usize) -> Result<HeldOutCase, ProveError> {
    let mixed = seed
        .wrapping_mul(0x9e37_79b9_7f4a_7c15)
        .wrapping_add((index as u64).wrapping_mul(0xd1b5_4a32_d192_ed03))
        .wrapping_add((draw as u64).wrapping_mul(0x94d0_49bb_1331_11eb));
    let mut rng = StdRng::seed_from_u64(mixed ^ (mixed >> 29));
    let place = Place {
        seed: mixed,
        index,
        nth: nth(index),
    };
    match (is_coupled(index), kind_of(index)) {
        (false, Kind::Missed) => surge::missed(&place, &mut rng),
        (false, Kind::Inside) => surge::inside(&place, &mut rng),
        (true, Kind::Missed) => coupled::missed(&place, &mut rng),
        (true, Kind::Inside) => coupled::inside(&place, &mut rng),
    }
}

#[cfg(test)]
mod tests {
    use super::super::MISSED;
    use super::*;

    #[test]
    fn a_case_is_what_its_number_says_and_the_same_every_time() {
        let (a, b) = (make(1, 0, 0).unwrap(), make(1, 0, 0).unwrap());
        assert!(a.held.source.run.same_recording(&b.held.source.run));
        let other = make(1, 0, 1).unwrap();
        assert!(!a.held.source.run.same_recording(&other.held.source.run));
        let largest = |s: &Source| s.run.largest_wrench()[0];
        let top = a.sources.iter().map(largest).fold(0.0, f64::max);
        assert!((largest(&a.held.source) / top - 3.0).abs() < 0.1);
        // Of the rig file the vehicle is up to 20 % off.
        let by_the_file = a.held.missed_by(&a.rig, &BTreeMap::new(), false).unwrap();
        assert!(by_the_file.over_noise.unwrap() > MISSED);
        // A tenth of its added mass leaves open what a tenth of it is worth.
        let sd = Value {
            value: a.rig.vehicle.coefficients[0].added,
            sd: Some(0.1 * a.rig.vehicle.coefficients[0].added.abs()),
        };
        let numbers = [("x_udot".to_owned(), sd)].into_iter().collect();
        let open = a.held.missed_by(&a.rig, &numbers, false).unwrap();
        assert!(open.open_over_noise > 10.0, "{open:?}");
        let inside = make(1, 1, 0).unwrap();
        let top = inside.sources.iter().map(largest).fold(0.0, f64::max);
        assert!(largest(&inside.held.source) < top);
        let coupled = make(1, 2, 0).unwrap();
        assert!(coupled.is_coupled && coupled.kind == Kind::Missed);
        assert!(make(1, 5, 0).unwrap().is_coupled);
    }

    #[test]
    fn half_are_missed_and_a_third_of_each_kind_is_coupled() {
        let coupled: Vec<usize> = (0..60).filter(|i| is_coupled(*i)).collect();
        let missed = |i: &&usize| kind_of(**i) == Kind::Missed;
        assert_eq!(coupled.len(), 20);
        assert_eq!(coupled.iter().filter(missed).count(), 10);
        assert_eq!([0, 4, 6, 10].map(nth), [0, 1, 2, 3]);
    }

    #[test]
    fn what_is_outside_is_read_from_a_verdicts_words() {
        let of = |text: &str| Beyond::named_in(text).into_iter().collect::<Vec<_>>();
        assert_eq!(
            of(
                "surge load up to 24.0 N, fitted up to 8.00 N; surge speed up to 0.3 m/s, fitted up to 0.2 m/s; x from 0 to 3.0 m, fitted from 0 to 1.0 m"
            ),
            [Beyond::Loads, Beyond::Speeds]
        );
        assert_eq!(
            of("surge load that changes at 1.00 to 1.10 Hz, fitted at 0.05 to 0.2 Hz"),
            [Beyond::Frequencies]
        );
        assert_eq!(
            of("yaw rate from -8.0 to 0 deg/s, fitted from 0 to 8.0 deg/s"),
            [Beyond::Speeds]
        );
        assert!(
            of("nothing: those fitted reach as far, and do not show what is missing").is_empty()
        );
    }
}
