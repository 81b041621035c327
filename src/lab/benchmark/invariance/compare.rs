//! Two verdicts on the same motion.

use std::collections::{BTreeMap, BTreeSet};

use hydroline_diagnose::verdict::{Value, Verdict, Word};
use hydroline_sim::effect::ALL;

use crate::benchmark::coupled::named;

/// Unit of the coefficient of a product of two rates: a force over it, whatever the rates.
const COUPLING: &str = "SI";

/// A verdict beside another one.
#[derive(Debug, Clone, PartialEq)]
pub struct Compared {
    /// The same word, and the same effects that matter; of an ambiguous verdict the same sets.
    pub is_same: bool,
    /// Largest shift of a number in its sds.
    pub shift_sds: f64,
    /// That number; empty = there is none in both.
    pub shifted: String,
    /// Its sd in the other verdict over that in this one: above 1, less is known of it; `None` = it has none.
    pub sd_ratio: Option<f64>,
}

/// Power with which a number of an effect goes with the forces, by its unit.
fn power(effect: &str, parameter: &str) -> i32 {
    if (effect, parameter) == ("battery_sag", "sag") {
        // A pure number by its unit, and a share lost per 100 N s by its law.
        return -1;
    }
    let info = ALL.iter().find(|i| i.id == effect);
    let number = info.and_then(|i| i.parameters.iter().find(|p| p.name == parameter));
    let unit = number.map_or("", |p| p.unit);
    if unit == COUPLING {
        return 1;
    }
    // What stands in brackets is the same for a moment.
    let first = unit.split(" (").next().unwrap_or(unit);
    let (over, under) = first.split_once('/').unwrap_or((first, ""));
    let forces = |side: &str| {
        let words = side.split([' ', '(', ')']);
        words.filter(|w| ["N", "kg"].contains(w)).count() as i32
    };
    forces(over) - forces(under)
}

/// Effects of a verdict that matter, with their words.
pub fn mattering(v: &Verdict) -> BTreeSet<String> {
    let matter = v.effects.iter().filter(|e| e.matters);
    matter.map(|e| named(&e.effect, &e.words)).collect()
}

/// Coefficients and numbers of the effects that matter, by name, with the power with which each goes with the forces.
fn numbers(v: &Verdict) -> BTreeMap<String, (Value, i32)> {
    let own = v.parameters.after.iter();
    let mut made: BTreeMap<String, (Value, i32)> =
        own.map(|(key, value)| (key.clone(), (*value, 1))).collect();
    for e in v.effects.iter().filter(|e| e.matters) {
        for (parameter, value) in &e.parameters {
            let key = format!("{}.{parameter}", named(&e.effect, &e.words));
            made.insert(key, (*value, power(&e.effect, parameter)));
        }
    }
    made
}

fn sets(v: &Verdict) -> BTreeSet<BTreeSet<&str>> {
    let each = v.equivalent.iter();
    each.map(|set| set.iter().map(String::as_str).collect())
        .collect()
}

/// Compares a verdict with another one on the same motion under forces `scale` times as large.
pub fn compare(own: &Verdict, other: &Verdict, scale: f64) -> Compared {
    let is_alike = match own.verdict {
        Word::Ambiguous => sets(own) == sets(other),
        _ => mattering(own) == mattering(other),
    };
    let theirs = numbers(other);
    let shifts = numbers(own)
        .into_iter()
        .filter_map(|(key, (value, power))| {
            let sd = value.sd.filter(|sd| *sd > 0.0)?;
            let (there, back) = (theirs.get(&key)?.0, scale.powi(power));
            let shift = (there.value / back - value.value).abs() / sd;
            let ratio = there.sd.map(|there| there / back.abs() / sd);
            // JSON has neither NaN nor infinity.
            let shift = if shift.is_finite() { shift } else { f64::MAX };
            Some((key, shift, ratio.filter(|r| r.is_finite())))
        });
    let largest = shifts.max_by(|a, b| a.1.total_cmp(&b.1));
    let (shifted, shift_sds, sd_ratio) = largest.unwrap_or_default();
    Compared {
        is_same: own.verdict == other.verdict && is_alike,
        shift_sds,
        shifted,
        sd_ratio,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use hydroline_diagnose::verdict::{Effect, Law};

    #[test]
    fn numbers_go_with_the_forces_as_their_units_say() {
        for (effect, parameter, expected) in [
            ("coulomb_friction", "f_n", 1),
            ("thruster_lag", "lag_s", 0),
            ("cubic_damping", "d3", 1),
            ("fluid_memory", "gain_nspm", 1),
            ("fluid_memory", "tau_s", 0),
            ("tether_spring", "stiffness_npm", 1),
            ("cross_flow_coupling", "c", 1),
            ("thrust_asymmetry", "reverse_gain", 0),
            ("battery_sag", "sag", -1),
            ("advance_loss", "loss_spm", 0),
        ] {
            assert_eq!(power(effect, parameter), expected, "{effect} {parameter}");
        }
    }

    fn verdict(x_udot: f64, f_n: f64) -> Verdict {
        let value = |value: f64, sd: f64| Value {
            value,
            sd: Some(sd),
        };
        let mut v = Verdict {
            verdict: Word::Named,
            ..Verdict::default()
        };
        v.parameters
            .after
            .insert("x_udot".to_owned(), value(x_udot, 2.0));
        v.effects.push(Effect {
            effect: "coulomb_friction".to_owned(),
            words: BTreeMap::new(),
            dof: None,
            probability: 1.0,
            established: true,
            weight: BTreeMap::new(),
            matters: true,
            law: Law::Exact,
            law_exact_probability: None,
            law_note: None,
            parameters: [("f_n".to_owned(), value(f_n, 0.01))].into_iter().collect(),
            or: Vec::new(),
            notes: Vec::new(),
        });
        v
    }

    #[test]
    fn a_shift_is_in_sds_and_scaled_back() {
        let own = verdict(-250.0, 0.3);
        let same = compare(&own, &verdict(-250.0 * 60.0, 0.3 * 60.0), 60.0);
        assert!(same.is_same && same.shift_sds < 1e-9);
        let moved = compare(&own, &verdict(-250.0, 0.304), 1.0);
        assert!((moved.shift_sds - 0.4).abs() < 1e-9);
        assert_eq!(moved.shifted, "coulomb_friction.f_n");
        assert_eq!(moved.sd_ratio, Some(1.0));
        // As it is compared where nobody scales it back.
        assert!(compare(&own, &verdict(-250.0 * 60.0, 18.0), 1.0).shift_sds > 1000.0);
        let mut small = verdict(-250.0, 0.3);
        small.effects[0].matters = false;
        assert!(!compare(&own, &small, 1.0).is_same);
        small.verdict = Word::None;
        assert!(!compare(&own, &small, 1.0).is_same);
    }
}
