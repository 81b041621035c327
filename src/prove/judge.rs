//! One case: diagnosed without the key, then compared with it.

use std::borrow::Cow;

use hydroline_rigs::Plan;

use super::case::{Case, Category, DELAYS, Truth, UNNAMED_ID};
use super::error::ProveError;
use super::observer::Ideal;
use super::{paper, plans};
use crate::diagnose::diagnose;
use crate::diagnose::verdict::{Law, Verdict, Word};

/// What is lighter is not scored effect by effect \[m\].
pub const SCORED_M: f64 = 0.5e-3;
/// Log evidence (a factor of 20) below which the data at their true noise cannot part two effects.
pub const SPLIT: f64 = 3.0;
/// The same where the diagnosis says that it cannot: its noise is estimated, and what it says must not excuse
/// everything.
pub const SAID: f64 = 6.0;
/// Normal quantile of a 95 % interval.
const Z95: f64 = 1.959_964;

/// An effect that was found.
#[derive(Debug, Clone, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Found {
    /// Id.
    pub effect: String,
    /// Weight \[m\].
    pub weight_m: f64,
    /// Above the tolerance.
    pub matters: bool,
    /// Its law is reported as not quite the vocabulary's.
    pub inexact: bool,
    /// What the diagnosis says it cannot tell it from.
    pub or: Vec<String>,
}

/// Effect by effect.
#[derive(Debug, Clone, Default, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Tally {
    /// (effect, weight \[m\], practical size, found or in a set, weight found \[m\]) of what is there.
    pub there: Vec<(String, f64, bool, bool, Option<f64>)>,
    /// (effect, weight \[m\], right) of what was found.
    pub found: Vec<(String, f64, bool)>,
    /// Whether the heaviest found is the heaviest there; `None` where nothing of practical size is.
    pub heaviest: Option<bool>,
}

/// A number with the truth.
#[derive(Debug, Clone, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Interval {
    /// `effect.parameter`, or a coefficient.
    pub name: String,
    /// Truth.
    pub truth: f64,
    /// Estimate.
    pub value: f64,
    /// Within 1.96 sd.
    pub covered: bool,
}

/// Protocol of the paper.
#[derive(Debug, Clone, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct PaperOutcome {
    /// `ambiguous`, the truth in a set, and so is whatever of the five the data cannot tell from it
    /// (by the ideal observer); where that is nothing, the truth may be named.
    pub right_set: bool,
    /// Those that no set holds.
    pub lacking: Vec<String>,
    /// Plan proposed.
    pub plan: Option<String>,
    /// After that plan was run: the truth named.
    pub split: bool,
    /// Sentence after that run.
    pub after: String,
}

/// A case with its score.
#[derive(Debug, Clone, serde::Serialize, serde::Deserialize)]
pub struct Judged {
    /// Id.
    pub id: String,
    /// Kind.
    pub category: Category,
    /// With a background.
    pub background: bool,
    /// Truth.
    pub truth: Vec<Truth>,
    /// Verdict's word.
    pub word: Word,
    /// Its sentence.
    pub sentence: String,
    /// Effects found.
    pub found: Vec<Found>,
    /// Sets that it says cannot be told apart.
    pub equivalent: Vec<Vec<String>>,
    /// Effect by effect; of cases whose laws are all the vocabulary's.
    pub tool: Option<Tally>,
    /// The same for the ideal observer.
    pub ideal: Option<Tally>,
    /// Intervals of parameters and coefficients.
    pub intervals: Vec<Interval>,
    /// rms of the run held out: before, after, its noise \[m\].
    pub held_out: Option<[f64; 3]>,
    /// rms of the run held out under the ideal observer's choice \[m\].
    pub held_ideal_m: Option<f64>,
    /// What the category asks for.
    pub passed: Vec<(Cow<'static, str>, bool)>,
    /// The same of the ideal observer, where it can be asked.
    pub passed_ideal: Vec<(Cow<'static, str>, bool)>,
    /// The paper's protocol.
    pub paper: Option<PaperOutcome>,
    /// Fault put in.
    pub fault: Option<super::faulty::Fault>,
    /// Time of the diagnosis \[s\]; not part of what is reproducible.
    #[serde(skip)]
    pub seconds: f64,
    /// The whole verdict.
    #[serde(skip)]
    pub verdict: Option<Verdict>,
}

impl Judged {
    /// All laws are the vocabulary's.
    pub fn exact(&self) -> bool {
        self.truth.iter().all(|t| t.exact)
    }

    /// The main effect whose law is near the vocabulary's.
    pub fn near(&self) -> Option<&Truth> {
        self.truth
            .iter()
            .find(|t| !t.exact && t.effect != UNNAMED_ID)
    }
}

/// Diagnoses a case blind and opens the key. `observe` = with the ideal observer.
///
/// # Errors
/// [`ProveError`].
pub fn judge(case: &Case, observe: bool) -> Result<Judged, ProveError> {
    let wrong = |source| ProveError::Diagnose {
        id: case.id.clone(),
        source,
    };
    let sealed = &case.sealed;
    let began = std::time::Instant::now();
    let verdict = diagnose(&sealed.sources, &sealed.held, &sealed.rig, &|_| {})
        .map_err(wrong)?
        .verdict;
    let seconds = began.elapsed().as_secs_f64();
    // From here on with the key.
    let truth = case.key.truth.clone();
    let found = effects(&verdict);
    let mut judged = Judged {
        id: case.id.clone(),
        category: case.category,
        background: case.background,
        word: verdict.verdict,
        sentence: verdict.sentence.clone(),
        equivalent: verdict.equivalent.clone(),
        tool: None,
        ideal: None,
        intervals: Vec::new(),
        held_out: held_out(&verdict, case.key.held_noise_m),
        held_ideal_m: None,
        passed: Vec::new(),
        passed_ideal: Vec::new(),
        paper: None,
        fault: case.key.fault,
        seconds,
        verdict: None,
        truth,
        found,
    };
    match case.category {
        Category::Fault => {
            if let Some(fault) = case.key.fault {
                judged.passed.push(("fault".into(), fault.right(&verdict)));
            }
        }
        Category::Paper => {
            let outcome = two_runs(case, &verdict, &judged)?;
            judged.passed.push(("paper_set".into(), outcome.right_set));
            judged.passed.push(("paper_split".into(), outcome.split));
            judged.paper = Some(outcome);
        }
        Category::Unnamed => {
            let all: Vec<&str> = judged.found.iter().map(|f| f.effect.as_str()).collect();
            let known = |f: &&Found| is_there(&judged.truth, &f.effect, &all);
            let no_wrong = judged.found.iter().filter(|f| f.matters).all(|f| known(&f));
            let unknown = verdict.verdict == Word::Unknown;
            judged.passed.push(("unknown".into(), unknown && no_wrong));
            judged.passed.push(("unknown_word".into(), unknown));
        }
        Category::Nothing => {
            let quiet = verdict.verdict == Word::None && judged.found.iter().all(|f| !f.matters);
            judged.passed.push(("nothing".into(), quiet));
            by_effect(case, &verdict, &mut judged, observe);
        }
        Category::Single | Category::Pair | Category::Triple => {
            if let Some(main) = judged.near().cloned() {
                near(case, &mut judged, &main, observe);
            } else {
                by_effect(case, &verdict, &mut judged, observe);
                let kept = judged
                    .found
                    .iter()
                    .filter(|f| f.matters && judged.truth.iter().any(|t| t.effect == f.effect))
                    .all(|f| !f.inexact);
                judged.passed.push(("exact_kept".into(), kept));
            }
            if let (Word::Named, Some([_, after, noise])) = (verdict.verdict, judged.held_out) {
                judged
                    .passed
                    .push(("held_out".into(), after <= 1.2 * noise));
            }
        }
    }
    judged.verdict = Some(verdict);
    Ok(judged)
}

fn effects(v: &Verdict) -> Vec<Found> {
    let mut found: Vec<Found> = v
        .effects
        .iter()
        .map(|e| Found {
            effect: e.effect.clone(),
            weight_m: e.weight.get("x_m").copied().unwrap_or(0.0),
            matters: e.matters,
            inexact: e.law == Law::Inexact,
            or: e.or.clone(),
        })
        .collect();
    found.sort_by(|a, b| b.weight_m.total_cmp(&a.weight_m));
    found
}

fn held_out(v: &Verdict, noise_m: Option<f64>) -> Option<[f64; 3]> {
    let table = &v.fit.held_out;
    Some([
        *table.before.get("x_m")?,
        *table.after.get("x_m")?,
        noise_m?,
    ])
}

/// Whether what was found is there; motion alone never tells one delay from the other, so that one of them, found
/// alone, stands for either.
fn is_there(truth: &[Truth], found: &str, all: &[&str]) -> bool {
    let twin = |t: &Truth| {
        DELAYS.contains(&found)
            && DELAYS.contains(&t.effect.as_str())
            && !all.contains(&t.effect.as_str())
    };
    truth.iter().any(|t| t.effect == found || twin(t))
}

/// A law near the vocabulary's: mechanism named, law said to be inexact, nothing invented. The observer that
/// sees another law takes that one; where the data do not show it, its best set of the vocabulary counts.
fn near(case: &Case, judged: &mut Judged, main: &Truth, observe: bool) {
    let own = judged.found.iter().find(|f| f.effect == main.effect);
    let in_set = judged.equivalent.iter().any(|s| s.contains(&main.effect));
    let truth = judged.truth.clone();
    let modest = |found: &mut dyn Iterator<Item = (&str, f64)>| {
        let found: Vec<(&str, f64)> = found.collect();
        let all: Vec<&str> = found.iter().map(|f| f.0).collect();
        let spurious = found
            .iter()
            .filter(|(id, _)| !is_there(&truth, id, &all))
            .map(|(_, weight_m)| *weight_m)
            .fold(0.0, f64::max);
        spurious <= 0.1 * main.weight_m
    };
    let mut found = judged.found.iter().map(|f| (f.effect.as_str(), f.weight_m));
    let passed = [
        ("mechanism".into(), own.is_some() || in_set),
        ("inexact".into(), own.is_some_and(|f| f.inexact)),
        ("no_spurious".into(), modest(&mut found)),
    ];
    judged.passed.extend(passed);
    let Some(mut ideal) = observe.then(|| Ideal::new(case)).flatten() else {
        return;
    };
    let choice = ideal.choice();
    let sees = ideal.sees_another_law(case);
    let named = sees || choice.iter().any(|(id, _)| *id == main.effect);
    let mut found = choice.iter().map(|(id, w)| (id.as_str(), *w));
    judged.held_ideal_m = if sees {
        case.key.held_noise_m
    } else {
        ideal.held_out(case)
    };
    judged.passed_ideal = vec![
        ("mechanism".into(), named),
        ("inexact".into(), sees),
        ("no_spurious".into(), sees || modest(&mut found)),
    ];
}

fn by_effect(case: &Case, verdict: &Verdict, judged: &mut Judged, observe: bool) {
    let mut ideal = if observe { Ideal::new(case) } else { None };
    let found: Vec<(String, f64)> = judged
        .found
        .iter()
        .map(|f| (f.effect.clone(), f.weight_m))
        .collect();
    let said: Vec<Found> = judged.found.clone();
    let mut same = |missing: &str, wrong: &str| {
        let or = |f: &Found| f.effect == wrong && f.or.iter().any(|o| o == missing);
        let apart = if said.iter().any(or) { SAID } else { SPLIT };
        ideal
            .as_ref()
            .is_some_and(|i| i.gap(missing, wrong).is_some_and(|g| g < apart))
    };
    judged.tool = Some(compare(
        &judged.truth,
        &found,
        &judged.equivalent,
        &mut same,
    ));
    if let Some(choice) = ideal.as_mut().map(Ideal::choice) {
        let mut same = |missing: &str, wrong: &str| {
            ideal
                .as_ref()
                .is_some_and(|i| i.gap(missing, wrong).is_some_and(|g| g < SPLIT))
        };
        judged.ideal = Some(compare(&judged.truth, &choice, &[], &mut same));
        judged.held_ideal_m = ideal.as_ref().and_then(|i| i.held_out(case));
    }
    judged.intervals = intervals(case, verdict, &judged.truth);
}

/// Effect by effect. `same(missing, wrong)`: the data cannot tell these two apart.
fn compare(
    truth: &[Truth],
    found: &[(String, f64)],
    sets: &[Vec<String>],
    same: &mut dyn FnMut(&str, &str) -> bool,
) -> Tally {
    let is_there = |id: &str| truth.iter().any(|t| t.effect == id);
    let in_sets = |id: &str| sets.iter().any(|s| s.iter().any(|e| e == id));
    let weight_of = |id: &str| found.iter().find(|f| f.0 == id).map(|f| f.1);
    let mut there = Vec::new();
    let mut excused: Vec<String> = Vec::new();
    for t in truth.iter().filter(|t| t.weight_m > SCORED_M) {
        let weight = weight_of(&t.effect);
        let mut hit = weight.is_some();
        if !hit {
            // A set that the data cannot split counts once: what stands for the other is right as well.
            for (f, _) in found.iter().filter(|f| !is_there(&f.0)) {
                let stands_for = (in_sets(&t.effect) && in_sets(f)) || same(&t.effect, f);
                if stands_for && !excused.contains(f) {
                    excused.push(f.clone());
                    hit = true;
                    break;
                }
            }
            hit |= in_sets(&t.effect);
        }
        there.push((t.effect.clone(), t.weight_m, t.main, hit, weight));
    }
    let scored: Vec<(String, f64, bool)> = found
        .iter()
        .filter(|f| f.1 > SCORED_M)
        .map(|(f, w)| (f.clone(), *w, is_there(f) || excused.contains(f)))
        .collect();
    let heaviest = truth.first().filter(|t| t.main).map(|t| {
        found.first().is_some_and(|(f, _)| {
            *f == t.effect
                || (excused.contains(f) && there.first().is_some_and(|h| h.3 && h.4.is_none()))
        })
    });
    Tally {
        there,
        found: scored,
        heaviest,
    }
}

fn intervals(case: &Case, verdict: &Verdict, truth: &[Truth]) -> Vec<Interval> {
    let mut made = Vec::new();
    let mut put = |name: String, truth: f64, value: f64, sd: Option<f64>| {
        if let Some(sd) = sd {
            made.push(Interval {
                name,
                truth,
                value,
                covered: (value - truth).abs() <= Z95 * sd,
            });
        }
    };
    for (name, true_value) in case.key.coefficients() {
        if let Some(v) = verdict.parameters.after.get(&name) {
            put(name, true_value, v.value, v.sd);
        }
    }
    for t in truth.iter().filter(|t| t.weight_m > SCORED_M) {
        let Some(e) = verdict.effects.iter().find(|e| e.effect == t.effect) else {
            continue;
        };
        for (name, true_value) in &t.parameters {
            if let Some(v) = e.parameters.get(name) {
                put(format!("{}.{name}", t.effect), *true_value, v.value, v.sd);
            }
        }
    }
    made
}

fn two_runs(case: &Case, verdict: &Verdict, judged: &Judged) -> Result<PaperOutcome, ProveError> {
    let wrong = |source| ProveError::Diagnose {
        id: case.id.clone(),
        source,
    };
    let in_sets = |id: &str| judged.equivalent.iter().any(|s| s.iter().any(|e| e == id));
    let truth = case
        .key
        .truth
        .first()
        .map_or_else(String::new, |t| t.effect.clone());
    // Which of the five these very data leave open is for the ideal observer to say: a limit and
    // friction bend the two runs in opposite directions, a strong one gives itself away.
    let ideal = Ideal::new(case);
    let rivals: Vec<&str> = paper::SET
        .into_iter()
        .filter(|id| *id != truth)
        .filter(|id| {
            // Told apart only where the rival was fitted and lost: no fit is no evidence.
            let gap = ideal.as_ref().and_then(|i| i.gap(&truth, id));
            gap.is_none_or(|g| g < SPLIT)
        })
        .collect();
    let lacking: Vec<String> = rivals
        .iter()
        .filter(|id| !in_sets(id))
        .map(|id| (*id).to_owned())
        .collect();
    let named = judged.found.iter().any(|f| f.effect == truth && f.matters);
    let word = if rivals.is_empty() {
        in_sets(&truth) || (verdict.verdict == Word::Named && named)
    } else {
        verdict.verdict == Word::Ambiguous && in_sets(&truth)
    };
    let mut outcome = PaperOutcome {
        right_set: word && lacking.is_empty(),
        lacking,
        plan: None,
        split: false,
        after: String::new(),
    };
    let Some(next) = &verdict.next_experiment else {
        return Ok(outcome);
    };
    let plan = Plan::from_toml(&next.plan_toml, &format!("{}.toml", next.plan))?;
    let third = case.key.tank.record(
        &plan,
        case.key.runs.len(),
        plan.duration_s().max(plans::RUN_S),
    )?;
    let mut sources = case.sealed.sources.clone();
    sources.push(third.source(&case.sealed.rig)?);
    let after = diagnose(&sources, &[], &case.sealed.rig, &|_| {})
        .map_err(wrong)?
        .verdict;
    let heavy: Vec<&str> = after
        .effects
        .iter()
        .filter(|e| e.matters)
        .map(|e| e.effect.as_str())
        .collect();
    outcome.split = after.verdict == Word::Named && heavy == [truth.as_str()];
    outcome.plan = Some(next.plan.clone());
    outcome.after = after.sentence;
    Ok(outcome)
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

    #[test]
    fn a_set_that_cannot_be_split_counts_once_and_a_wrong_name_does_not() {
        let there = [truth("lag", 10.0, true), truth("current", 1.0, false)];
        let seen = found(&[("delay", 9.0), ("current", 1.02), ("bias", 0.8)]);
        let none = compare(&there, &seen, &[], &mut |_, _| false);
        assert_eq!(
            none.there.iter().map(|t| t.3).collect::<Vec<_>>(),
            [false, true]
        );
        assert_eq!(
            none.found.iter().map(|f| f.2).collect::<Vec<_>>(),
            [false, true, false]
        );
        assert_eq!(none.heaviest, Some(false));
        let twins = compare(&there, &seen, &[], &mut |m, w| m == "lag" && w == "delay");
        assert!(twins.there.iter().all(|t| t.3));
        assert_eq!(
            twins.found.iter().map(|f| f.2).collect::<Vec<_>>(),
            [true, true, false]
        );
        assert_eq!(twins.heaviest, Some(true));
        let sets = [vec!["delay".to_owned()], vec!["lag".to_owned()]];
        let said = compare(&there, &seen, &sets, &mut |_, _| false);
        assert!(said.there[0].3 && said.found[0].2 && !said.found[2].2);
    }
}
