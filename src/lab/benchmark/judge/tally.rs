//! Effect by effect: what is there against what was found, a set that the data cannot split counted once.

use super::inseparable::Sum;
use super::thresholds::SCORED_M;
use crate::benchmark::case::{DELAYS, Truth};

/// Share of a sum's weight below which what was found is not the sum.
const HALF: f64 = 0.5;

/// Effect by effect.
#[derive(
    Debug, Clone, Default, PartialEq, serde::Serialize, schemars::JsonSchema, serde::Deserialize,
)]
pub struct Tally {
    /// (effect, weight \[m\], practical size, found or in a set, weight found \[m\]) of what is there.
    pub there: Vec<(String, f64, bool, bool, Option<f64>)>,
    /// (effect, weight \[m\], right) of what was found.
    pub found: Vec<(String, f64, bool)>,
    /// Whether the heaviest found is the heaviest there; `None` where nothing of practical size is.
    pub heaviest: Option<bool>,
    /// Sets of which the data show the sum.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub sums: Vec<SumFound>,
}

/// A set of which the data show the sum, and what was found of it.
#[derive(Debug, Clone, PartialEq, serde::Serialize, schemars::JsonSchema, serde::Deserialize)]
pub struct SumFound {
    /// There, all of them.
    pub effects: Vec<String>,
    /// Weight together \[m\].
    pub weight_m: f64,
    /// Weight of those found, together \[m\]; `None` where none was, or another name stands for them.
    pub found_m: Option<f64>,
    /// Found, half of it at least, or another name stands for it.
    pub hit: bool,
    /// One of them is of practical size.
    pub main: bool,
}

/// Unit that counts once: an effect, or a set that the data cannot split.
#[derive(Debug, Clone, PartialEq)]
pub struct Counted {
    /// Its name, `a + b` of a set.
    pub name: String,
    /// Weight there \[m\].
    pub weight_m: f64,
    /// Of practical size.
    pub main: bool,
    /// Whether it was found.
    pub hit: bool,
    /// Weight found \[m\]; `None` where another name stands for it.
    pub found_m: Option<f64>,
}

impl Counted {
    /// Whether the weight found is right; `None` where another name stands for it.
    pub fn weight_right(&self) -> Option<bool> {
        self.found_m.map(|w| weight_right(w, self.weight_m))
    }
}

/// Whether a weight is found to 10 %.
pub fn weight_right(found_m: f64, weight_m: f64) -> bool {
    (found_m / weight_m - 1.0).abs() <= 0.1
}

impl Tally {
    /// Effects there over [`SCORED_M`], each set that the data cannot split once.
    pub fn counted(&self) -> Vec<Counted> {
        let within = |id: &String| self.sums.iter().any(|s| s.effects.contains(id));
        let alone = self.there.iter().filter(|e| !within(&e.0));
        let alone = alone.map(|e| Counted {
            name: e.0.clone(),
            weight_m: e.1,
            main: e.2,
            hit: e.3,
            found_m: e.4,
        });
        let sums = self.sums.iter().map(|s| Counted {
            name: s.effects.join(" + "),
            weight_m: s.weight_m,
            main: s.main,
            hit: s.hit,
            found_m: s.found_m,
        });
        alone.chain(sums).collect()
    }
}

/// Names that the data cannot distinguish.
pub(super) trait Split {
    /// Whether `wrong`, which is not there, may stand for `missing`, which is.
    fn exchanged(&self, missing: &str, wrong: &str) -> bool;
}

fn in_key(truth: &[Truth], id: &str) -> bool {
    truth.iter().any(|t| t.effect == id)
}

/// The delay of `truth` for which one that is not there stands: motion alone never tells one from the other, so that
/// one of them, found alone, is either.
fn twin<'a>(truth: &'a [Truth], found: &str, all: &[&str]) -> Option<&'a str> {
    if !DELAYS.contains(&found) || in_key(truth, found) {
        return None;
    }
    truth
        .iter()
        .map(|t| t.effect.as_str())
        .find(|id| DELAYS.contains(id) && !all.contains(id))
}

/// Whether what was found is there, or stands for the other delay.
pub(super) fn is_there(truth: &[Truth], found: &str, all: &[&str]) -> bool {
    in_key(truth, found) || twin(truth, found, all).is_some()
}

/// Heaviest of what was found and is not there \[m\]: of what stands for an effect of the library's own law that was
/// not found, once for each, what it weighs beyond that one.
pub(super) fn invented(truth: &[Truth], found: &[(String, f64)], split: &dyn Split) -> f64 {
    let all: Vec<&str> = found.iter().map(|f| f.0.as_str()).collect();
    let stood_for: Vec<&str> = all.iter().filter_map(|f| twin(truth, f, &all)).collect();
    let mut missing: Vec<&Truth> = truth
        .iter()
        .filter(|t| t.exact && !all.contains(&t.effect.as_str()))
        .filter(|t| !stood_for.contains(&t.effect.as_str()))
        .collect();
    let mut heaviest = 0.0_f64;
    for (id, weight_m) in found {
        if is_there(truth, id, &all) {
            continue;
        }
        let stands_for = |m: &&Truth| split.exchanged(&m.effect, id);
        let other_m = missing
            .iter()
            .position(stands_for)
            .map_or(0.0, |at| missing.remove(at).weight_m);
        heaviest = heaviest.max(weight_m - other_m);
    }
    heaviest
}

/// Effect by effect. `equivalent`: sets that the answer says it cannot distinguish; `sums`: those that the data cannot
/// split, whoever is asked.
pub(super) fn compare(
    truth: &[Truth],
    found: &[(String, f64)],
    equivalent: &[Vec<String>],
    sums: &[Sum],
    split: &dyn Split,
) -> Tally {
    let all: Vec<&str> = found.iter().map(|f| f.0.as_str()).collect();
    let known = |id: &str| in_key(truth, id);
    let in_sets = |id: &str| equivalent.iter().any(|s| s.iter().any(|e| e == id));
    let weight_of = |id: &str| found.iter().find(|f| f.0 == id).map(|f| f.1);
    // An effect is of a sum by its own name or by the other delay's.
    let of_sum = |s: &Sum, f: &str| s.holds(f) || twin(truth, f, &all).is_some_and(|t| s.holds(t));
    let in_sum = |f: &str| sums.iter().any(|s| of_sum(s, f));
    let mut there = Vec::new();
    // (missing, what stands for it).
    let mut excused: Vec<(&str, &str)> = Vec::new();
    for t in truth.iter().filter(|t| t.weight_m > SCORED_M) {
        let weight = weight_of(&t.effect);
        let mut hit = weight.is_some();
        if !hit {
            // A set that the data cannot split counts once: what stands for the other is right as well.
            let stands_for = |f: &str| {
                !known(f)
                    && !excused.iter().any(|e| e.1 == f)
                    && ((in_sets(&t.effect) && in_sets(f)) || split.exchanged(&t.effect, f))
            };
            let other = all.iter().find(|f| stands_for(f)).copied();
            excused.extend(other.map(|f| (t.effect.as_str(), f)));
            hit = other.is_some() || in_sets(&t.effect);
        }
        there.push((t.effect.clone(), t.weight_m, t.main, hit, weight));
    }
    let declared = |s: &Sum| {
        let parts = found.iter().filter(|f| of_sum(s, &f.0));
        // They move alike: their weights add up.
        let found_m: f64 = parts.map(|f| f.1).sum();
        let by_another = there.iter().any(|e| s.holds(&e.0) && e.3 && e.4.is_none());
        SumFound {
            weight_m: s.weight_m,
            found_m: (found_m > 0.0).then_some(found_m),
            hit: found_m >= HALF * s.weight_m || (found_m == 0.0 && by_another),
            main: truth.iter().any(|t| t.main && s.holds(&t.effect)),
            effects: s.effects.clone(),
        }
    };
    let made = sums.iter().map(declared).collect();
    let right = |f: &str| known(f) || in_sum(f) || excused.iter().any(|e| e.1 == f);
    let scored: Vec<(String, f64, bool)> = found
        .iter()
        .filter(|f| f.1 > SCORED_M)
        .map(|(f, w)| (f.clone(), *w, right(f)))
        .collect();
    let heaviest = truth.first().filter(|t| t.main).map(|t| {
        let own = |s: &&Sum| s.weight_m > t.weight_m || s.holds(&t.effect);
        let sum = sums
            .iter()
            .filter(own)
            .max_by(|a, b| a.weight_m.total_cmp(&b.weight_m));
        all.first().is_some_and(|f| match sum {
            Some(s) => of_sum(s, f),
            None => *f == t.effect || excused.contains(&(t.effect.as_str(), *f)),
        })
    });
    Tally {
        there,
        found: scored,
        heaviest,
        sums: made,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn truth(effect: &str, mm: f64, main: bool) -> Truth {
        Truth {
            effect: effect.to_owned(),
            weight_m: mm * 1e-3,
            main,
            exact: true,
            parameters: Vec::new(),
        }
    }

    fn found(all: &[(&str, f64)]) -> Vec<(String, f64)> {
        all.iter()
            .map(|(e, mm)| ((*e).to_owned(), mm * 1e-3))
            .collect()
    }

    /// (missing, wrong) that may be exchanged.
    #[derive(Default)]
    struct Declared(Vec<(&'static str, &'static str)>);

    impl Split for Declared {
        fn exchanged(&self, missing: &str, wrong: &str) -> bool {
            self.0.contains(&(missing, wrong))
        }
    }

    fn sum(effects: &[&str], mm: f64) -> Sum {
        Sum {
            effects: effects.iter().map(|e| (*e).to_owned()).collect(),
            weight_m: mm * 1e-3,
        }
    }

    #[test]
    fn a_set_that_cannot_be_split_counts_once_and_a_wrong_name_does_not() {
        let there = [truth("lag", 10.0, true), truth("current", 1.0, false)];
        let seen = found(&[("delay", 9.0), ("current", 1.02), ("bias", 0.8)]);
        let none = compare(&there, &seen, &[], &[], &Declared::default());
        assert_eq!(
            none.there.iter().map(|t| t.3).collect::<Vec<_>>(),
            [false, true]
        );
        assert_eq!(
            none.found.iter().map(|f| f.2).collect::<Vec<_>>(),
            [false, true, false]
        );
        assert_eq!(none.heaviest, Some(false));
        let declared = Declared(vec![("lag", "delay")]);
        let twins = compare(&there, &seen, &[], &[], &declared);
        assert!(twins.there.iter().all(|t| t.3));
        assert_eq!(
            twins.found.iter().map(|f| f.2).collect::<Vec<_>>(),
            [true, true, false]
        );
        assert_eq!(twins.heaviest, Some(true));
        let sets = [vec!["delay".to_owned()], vec!["lag".to_owned()]];
        let said = compare(&there, &seen, &sets, &[], &Declared::default());
        assert!(said.there[0].3 && said.found[0].2 && !said.found[2].2);
    }

    #[test]
    fn a_sum_counts_once_with_the_weight_of_all_whatever_was_found_of_it() {
        let there = [
            truth("thruster_deadband", 3.0, true),
            truth("thruster_lag", 1.1, false),
            truth("command_latency", 0.7, false),
            truth("wall_added_mass", 0.6, false),
        ];
        let sums = [sum(&["thruster_lag", "command_latency"], 1.8)];
        let of = |lag: &[(&str, f64)]| {
            let seen = found(&[&[("thruster_deadband", 3.0)], lag].concat());
            compare(&there, &seen, &[], &sums, &Declared::default())
        };
        // The deadband, the wall that was missed, lag and delay together: (hits, weight found of the sum, invented).
        let declared = |t: &Tally| {
            let counted = t.counted();
            assert_eq!(counted.len(), 3);
            assert_eq!(counted[2].name, "thruster_lag + command_latency");
            assert!((counted[2].weight_m - 1.8e-3).abs() < 1e-12);
            let hits = counted.iter().filter(|c| c.hit).count();
            let wrong = t.found.iter().filter(|f| !f.2).count();
            (hits, counted[2].weight_right(), wrong)
        };
        assert_eq!(declared(&of(&[("thruster_lag", 1.82)])), (2, Some(true), 0));
        assert_eq!(
            declared(&of(&[("command_latency", 1.7)])),
            (2, Some(true), 0)
        );
        // The other delay is the same motion.
        assert_eq!(
            declared(&of(&[("camera_latency", 1.8)])),
            (2, Some(true), 0)
        );
        let both = of(&[("thruster_lag", 1.3), ("command_latency", 0.51)]);
        assert_eq!(declared(&both), (2, Some(true), 0));
        // One of them at its own weight is not the sum, a little of it is not found, and neither is nothing.
        assert_eq!(declared(&of(&[("thruster_lag", 1.1)])), (2, Some(false), 0));
        assert_eq!(
            declared(&of(&[("command_latency", 0.6)])),
            (1, Some(false), 0)
        );
        assert_eq!(declared(&of(&[])), (1, None, 0));
        // Each by itself it stays as it was.
        let plain = compare(
            &there,
            &found(&[("thruster_deadband", 3.0), ("thruster_lag", 1.82)]),
            &[],
            &[],
            &Declared::default(),
        );
        assert_eq!(of(&[("thruster_lag", 1.82)]).there, plain.there);
        assert_eq!(plain.counted().len(), 4);
    }

    #[test]
    fn the_heaviest_may_be_a_sum_and_another_name_must_stand_for_it_and_nothing_else() {
        let there = [
            truth("thruster_lag", 3.0, true),
            truth("command_latency", 2.9, true),
            truth("current", 2.0, false),
        ];
        let sums = [sum(&["thruster_lag", "command_latency"], 5.9)];
        let seen = found(&[("command_latency", 5.9), ("current", 2.0)]);
        let heaviest = |seen: &[(String, f64)], sums: &[Sum], declared: &Declared| {
            compare(&there, seen, &[], sums, declared).heaviest
        };
        assert_eq!(heaviest(&seen, &sums, &Declared::default()), Some(true));
        assert_eq!(heaviest(&seen, &[], &Declared::default()), Some(false));
        // The effect named for the current is not the heaviest for that.
        let instead = found(&[
            ("force", 2.5),
            ("thruster_lag", 2.4),
            ("command_latency", 2.3),
        ]);
        let declared = Declared(vec![("current", "force")]);
        assert_eq!(heaviest(&instead, &[], &declared), Some(false));
    }

    #[test]
    fn a_name_in_the_place_of_another_is_invented_only_beyond_it_and_once() {
        let mut there = vec![
            truth("coulomb_friction", 4.0, true),
            truth("thruster_lag", 1.3, false),
            truth("command_latency", 1.0, false),
        ];
        there[0].exact = false;
        let declared = Declared(vec![
            ("thruster_lag", "fluid_memory"),
            ("coulomb_friction", "constant_force"),
            ("thruster_lag", "seiche"),
            ("command_latency", "seiche"),
        ]);
        let main = ("coulomb_friction", 4.0);
        let mm = |seen: &[(&str, f64)], declared: &Declared| {
            1e3 * invented(&there, &found(seen), declared)
        };
        let near = |a: f64, b: f64| (a - b).abs() < 1e-9;
        assert!(near(
            mm(&[main, ("fluid_memory", 1.3)], &Declared::default()),
            1.3
        ));
        assert!(near(mm(&[main, ("fluid_memory", 1.3)], &declared), 0.0));
        // A light one that was missed does not excuse a heavy name.
        assert!(near(mm(&[main, ("fluid_memory", 3.3)], &declared), 2.0));
        let twice = [
            main,
            ("fluid_memory", 1.3),
            ("seiche", 1.2),
            ("camera_latency", 1.0),
        ];
        // The camera's delay stands for the command's, which then stands open for nothing else.
        assert!(near(mm(&twice, &declared), 1.2));
        // Nothing stands for the law that is near the library's.
        let instead = [("constant_force", 4.0), ("thruster_lag", 1.3)];
        assert!(near(mm(&instead, &declared), 4.0));
    }

    #[test]
    fn a_tally_of_before_there_were_sums_is_read() {
        let old =
            r#"{"there": [["current", 0.001, true, true, 0.001]], "found": [], "heaviest": true}"#;
        let tally: Tally = serde_json::from_str(old).unwrap();
        assert!(tally.sums.is_empty() && tally.counted().len() == 1);
    }
}
