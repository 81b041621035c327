//! One case: diagnosed without the key, then compared with it.

mod composed;
mod inseparable;
mod tally;
mod thresholds;
mod undecided;

use std::borrow::Cow;

use hydroline_rigs::Plan;

pub use self::tally::{Counted, SumFound, Tally, weight_right};
use self::tally::{compare, invented, is_there};
pub use self::thresholds::{SAID, SCORED_M, SPLIT};
use self::undecided::Undecided;
use super::case::{Case, Category, Truth, UNNAMED_ID};
use super::error::ProveError;
use super::observer::Ideal;
use super::score::Z95;
use super::{instrument, paper, plans};
use hydroline_diagnose::diagnose;
use hydroline_diagnose::verdict::{Law, Verdict, Word};

/// An effect that was found.
#[derive(Debug, Clone, PartialEq, serde::Serialize, schemars::JsonSchema, serde::Deserialize)]
pub struct Found {
    /// Id of the effect.
    pub effect: String,
    /// Weight \[m\].
    pub weight_m: f64,
    /// Above the tolerance.
    pub matters: bool,
    /// Its law is reported as not quite the library's.
    pub inexact: bool,
    /// Effects from which the diagnosis says it cannot distinguish it.
    pub or: Vec<String>,
}

/// A number with the truth.
#[derive(Debug, Clone, PartialEq, serde::Serialize, schemars::JsonSchema, serde::Deserialize)]
pub struct Interval {
    /// `effect.parameter`, or a coefficient.
    pub name: String,
    /// True value.
    pub truth: f64,
    /// Estimated value.
    pub value: f64,
    /// Within 1.96 sd.
    pub covered: bool,
}

/// Protocol of the paper.
#[derive(Debug, Clone, PartialEq, serde::Serialize, schemars::JsonSchema, serde::Deserialize)]
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
#[derive(Debug, Clone, serde::Serialize, schemars::JsonSchema, serde::Deserialize)]
pub struct Judged {
    /// Id of the case.
    pub id: String,
    /// Category of the case.
    pub category: Category,
    /// With a background.
    pub background: bool,
    /// Effects that are there.
    pub truth: Vec<Truth>,
    /// Verdict's word.
    pub word: Word,
    /// Its sentence.
    pub sentence: String,
    /// Effects found.
    pub found: Vec<Found>,
    /// Sets that it says cannot be distinguished.
    pub equivalent: Vec<Vec<String>>,
    /// Effect by effect; of cases whose laws are all the library's.
    pub tool: Option<Tally>,
    /// The same for the ideal observer.
    pub ideal: Option<Tally>,
    /// Intervals of parameters and coefficients.
    pub intervals: Vec<Interval>,
    /// rms of the run held out: before, after, its noise \[m\].
    pub held_out: Option<[f64; 3]>,
    /// rms of the run held out under the ideal observer's choice \[m\].
    pub held_ideal_m: Option<f64>,
    /// Requirements of the category, each with whether it is met.
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
    /// All laws are the library's.
    pub fn exact(&self) -> bool {
        self.truth.iter().all(|t| t.exact)
    }

    /// The main effect whose law is near the library's.
    pub fn near(&self) -> Option<&Truth> {
        self.truth
            .iter()
            .find(|t| !t.exact && t.effect != UNNAMED_ID)
    }
}

/// Options of the judge.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct How {
    /// With the ideal observer.
    pub observe: bool,
}

/// Diagnoses a case blind and opens the key.
///
/// # Errors
/// [`ProveError`].
pub fn judge(case: &Case, how: How) -> Result<Judged, ProveError> {
    let wrong = |source| ProveError::Diagnose {
        id: case.id.clone(),
        source,
    };
    let sealed = &case.sealed;
    let began = std::time::Instant::now();
    let made = diagnose(&sealed.sources, &sealed.held, &sealed.rig, &|_| {}).map_err(wrong)?;
    let verdict = made.verdict.clone();
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
        Category::Unnamed | Category::Composed => {
            let all: Vec<&str> = judged.found.iter().map(|f| f.effect.as_str()).collect();
            let known = |f: &&Found| is_there(&judged.truth, &f.effect, &all);
            let no_wrong = judged.found.iter().filter(|f| f.matters).all(|f| known(&f));
            let unknown = verdict.verdict == Word::Unknown;
            judged.passed.push(("unknown".into(), unknown && no_wrong));
            judged.passed.push(("unknown_word".into(), unknown));
            composed::ask(case, &made, &mut judged)?;
        }
        Category::Instrument => {
            let invented = !instrument::invents_nothing(&verdict, &judged.truth);
            judged.passed.push(("no_physics".into(), !invented));
        }
        Category::Precise => {
            let main = judged.truth.iter().find(|t| t.exact).map(|t| &t.effect);
            let is_main = |f: &Found| main.is_some_and(|m| f.effect == *m || f.or.contains(m));
            let sets = &judged.equivalent;
            let in_all = |id| !sets.is_empty() && sets.iter().all(|s| s.contains(id));
            let mattering = || judged.found.iter().filter(|f| f.matters);
            let named = mattering().any(is_main) || main.is_some_and(in_all);
            let spurious = !mattering().all(is_main);
            judged.passed.push(("mechanism".into(), named));
            judged.passed.push(("no_spurious".into(), !spurious));
            judged
                .passed
                .push(("unknown_word".into(), verdict.verdict == Word::Unknown));
        }
        Category::Nothing => {
            let quiet = verdict.verdict == Word::None && judged.found.iter().all(|f| !f.matters);
            judged.passed.push(("nothing".into(), quiet));
            by_effect(case, &verdict, &mut judged, how.observe)?;
        }
        Category::Single | Category::Pair | Category::Triple | Category::Modulated => {
            if let Some(main) = judged.near().cloned() {
                near(case, &mut judged, &main, how.observe);
            } else {
                by_effect(case, &verdict, &mut judged, how.observe)?;
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
    let x = v.predicted().find(|p| p.channel == "x_m")?;
    Some([x.before, x.after?, noise_m?])
}

/// A law near the library's: mechanism named, law said to be inexact, nothing invented (by the observer: a name that
/// stands for another one that is there is not, up to that one's weight). The observer that
/// sees another law takes that one; where the data do not show it, its best set of the library counts.
fn near(case: &Case, judged: &mut Judged, main: &Truth, observe: bool) {
    let own = judged.found.iter().find(|f| f.effect == main.effect);
    let in_set = judged.equivalent.iter().any(|s| s.contains(&main.effect));
    let ideal = observe.then(|| asked(case)).flatten();
    let modest = |found: &[(String, f64)], said: &[Found]| {
        let split = Undecided::new(ideal.as_ref().map(|i| &i.0), case, said);
        invented(&judged.truth, found, &split) <= 0.1 * main.weight_m
    };
    let passed = [
        ("mechanism".into(), own.is_some() || in_set),
        ("inexact".into(), own.is_some_and(|f| f.inexact)),
        (
            "no_spurious".into(),
            modest(&names(&judged.found), &judged.found),
        ),
    ];
    if let Some((observer, choice)) = &ideal {
        let sees = observer.sees_another_law(case);
        let named = sees || choice.iter().any(|(id, _)| *id == main.effect);
        judged.passed_ideal = vec![
            ("mechanism".into(), named),
            ("inexact".into(), sees),
            ("no_spurious".into(), sees || modest(choice, &[])),
        ];
        judged.held_ideal_m = if sees {
            case.key.held_noise_m
        } else {
            observer.held_out(case)
        };
    }
    judged.passed.extend(passed);
}

/// The observer of a case and its choice.
fn asked(case: &Case) -> Option<(Ideal, Vec<(String, f64)>)> {
    let ideal = Ideal::new(case)?;
    let choice = ideal.choice();
    Some((ideal, choice))
}

fn by_effect(
    case: &Case,
    verdict: &Verdict,
    judged: &mut Judged,
    observe: bool,
) -> Result<(), ProveError> {
    let ideal = observe.then(|| asked(case)).flatten();
    let observer = ideal.as_ref().map(|i| &i.0);
    let sums = observer.map_or(Ok(Vec::new()), |o| inseparable::sums(case, o))?;
    let of = |found: &[(String, f64)], equivalent: &[Vec<String>], said: &[Found]| {
        let split = Undecided::new(observer, case, said);
        compare(&judged.truth, found, equivalent, &sums, &split)
    };
    let tool = of(&names(&judged.found), &judged.equivalent, &judged.found);
    if let Some((observer, choice)) = &ideal {
        judged.ideal = Some(of(choice, &[], &[]));
        judged.held_ideal_m = observer.held_out(case);
    }
    judged.tool = Some(tool);
    judged.intervals = intervals(case, verdict, &judged.truth);
    Ok(())
}

fn names(found: &[Found]) -> Vec<(String, f64)> {
    found
        .iter()
        .map(|f| (f.effect.clone(), f.weight_m))
        .collect()
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
    // The ideal observer says which of the five these very data leave open: a limit and
    // friction change the two runs in opposite directions, a strong one gives itself away.
    let ideal = Ideal::new(case);
    let rivals: Vec<&str> = paper::SET
        .into_iter()
        .filter(|id| *id != truth)
        .filter(|id| {
            // Distinguished only where the rival was fitted and lost: no fit is no evidence.
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
    outcome.split = after.verdict == Word::Named && after.mattering() == [truth.as_str()];
    outcome.plan = Some(next.plan.clone());
    outcome.after = after.sentence;
    Ok(outcome)
}
