//! Counts over cases, with Wilson's intervals.

use std::collections::BTreeMap;

use super::case::{Category, UNNAMED_ID};
use super::judge::{Counted, Judged, SCORED_M, Tally, weight_right};
use hydroline_diagnose::verdict::Word;

/// Normal quantile of a 95 % interval.
pub(super) const Z95: f64 = 1.959_964;

/// Hits out of a number, with Wilson's 95 % interval (JASA 22, 1927).
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, schemars::JsonSchema)]
pub struct Rate {
    /// Number of hits.
    pub hits: usize,
    /// Number counted, hits and misses.
    pub count: usize,
    /// Share; NaN without any.
    pub share: f64,
    /// Lower end.
    pub low: f64,
    /// Upper end.
    pub high: f64,
}

impl Rate {
    /// Of hits.
    pub fn of(hits: impl IntoIterator<Item = bool>) -> Rate {
        let (mut n, mut k) = (0usize, 0usize);
        for hit in hits {
            n += 1;
            k += usize::from(hit);
        }
        let (nf, z) = (n as f64, Z95);
        let p = k as f64 / nf;
        let wide = 1.0 + z * z / nf;
        let centre = (p + z * z / (2.0 * nf)) / wide;
        let half = z * (p * (1.0 - p) / nf + z * z / (4.0 * nf * nf)).sqrt() / wide;
        Rate {
            hits: k,
            count: n,
            share: p,
            low: (centre - half).max(0.0),
            high: (centre + half).min(1.0),
        }
    }
}

/// One line of the table.
#[derive(Debug, Clone, PartialEq, serde::Serialize, schemars::JsonSchema)]
pub struct Line {
    /// Quantity that is counted.
    pub what: &'static str,
    /// Bound to meet; empty = none.
    pub asked: &'static str,
    /// The diagnosis.
    pub tool: Rate,
    /// The ideal observer, where it can be asked.
    pub ideal: Option<Rate>,
}

/// Error of one number over all cases that hold it.
#[derive(Debug, Clone, PartialEq, serde::Serialize, schemars::JsonSchema)]
pub struct Error {
    /// `effect.parameter`, or a coefficient.
    pub name: String,
    /// Median of |error| / |truth|.
    pub median_relative: f64,
    /// 95 % intervals that hold the truth.
    pub covered: Rate,
}

/// Scores of all cases together.
#[derive(Debug, Clone, PartialEq, serde::Serialize, schemars::JsonSchema)]
pub struct Score {
    /// Cases per category.
    pub cases: BTreeMap<&'static str, usize>,
    /// Lines of the table.
    pub lines: Vec<Line>,
    /// Heaviest there -> heaviest named -> cases.
    pub confusion: BTreeMap<String, BTreeMap<String, usize>>,
    /// Errors of the parameters.
    pub errors: Vec<Error>,
    /// Median rms of the run held out over its noise: before, after.
    pub held_out: [f64; 2],
}

fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    values.get(values.len() / 2).copied().unwrap_or(f64::NAN)
}

/// Scores cases.
pub fn score(all: &[Judged]) -> Score {
    let tools: Vec<&Tally> = all.iter().filter_map(|j| j.tool.as_ref()).collect();
    let ideals: Vec<&Tally> = all.iter().filter_map(|j| j.ideal.as_ref()).collect();
    let two = |what, asked, of: &dyn Fn(&[&Tally]) -> Rate| Line {
        what,
        asked,
        tool: of(&tools),
        ideal: (!ideals.is_empty()).then(|| of(&ideals)),
    };
    // A set that the data cannot split counts once; below that, each effect by itself.
    let once =
        |tallies: &[&Tally]| -> Vec<Counted> { tallies.iter().flat_map(|t| t.counted()).collect() };
    let recall = |tallies: &[&Tally], main: Option<bool>| {
        let asked = |c: &Counted| main.is_none_or(|m| c.main == m);
        Rate::of(once(tallies).into_iter().filter(asked).map(|c| c.hit))
    };
    let mut lines = vec![
        two("recall, effects over 0.5 mm", ">= 95 %", &|t| {
            recall(t, None)
        }),
        two("  of practical size", "", &|t| recall(t, Some(true))),
        two("  of the background", "", &|t| recall(t, Some(false))),
        two("  each effect by itself", "", &|t| {
            Rate::of(t.iter().flat_map(|t| &t.there).map(|e| e.3))
        }),
        two("precision, effects over 0.5 mm", ">= 95 %", &|t| {
            Rate::of(t.iter().flat_map(|t| &t.found).map(|f| f.2))
        }),
        two("weights within 10 %", ">= 95 %", &|t| {
            Rate::of(once(t).iter().filter_map(Counted::weight_right))
        }),
        two("  each weight by itself", "", &|t| {
            let all = t.iter().flat_map(|t| &t.there);
            Rate::of(all.filter_map(|e| Some(weight_right(e.4?, e.1))))
        }),
        two("heaviest right", ">= 98 %", &|t| {
            Rate::of(t.iter().filter_map(|t| t.heaviest))
        }),
    ];
    let passed = |key: &'static str| {
        Rate::of(
            all.iter()
                .flat_map(|j| &j.passed)
                .filter(|p| p.0 == key)
                .map(|p| p.1),
        )
    };
    let beside = |what, asked, key: &'static str| {
        let asked_of = || {
            all.iter()
                .flat_map(|j| &j.passed_ideal)
                .filter(|p| p.0 == key)
        };
        Line {
            what,
            asked,
            tool: passed(key),
            ideal: (asked_of().count() > 0).then(|| Rate::of(asked_of().map(|p| p.1))),
        }
    };
    let alone = |what, asked, tool| Line {
        what,
        asked,
        tool,
        ideal: None,
    };
    lines.push(alone(
        "nothing that matters -> none",
        ">= 98 %",
        passed("nothing"),
    ));
    lines.push(alone(
        "unnamed -> unknown, no wrong name",
        ">= 80 %",
        passed("unknown"),
    ));
    lines.push(alone("  the word alone", "", passed("unknown_word")));
    lines.push(alone(
        "  its covariate right",
        ">= 80 %",
        passed("covariate"),
    ));
    lines.push(beside(
        "  written down, twice the load to 1.5 noise",
        ">= 60 %",
        "closed_form",
    ));
    lines.push(alone(
        "  no wrong form called sure",
        ">= 98 %",
        passed("closed_form_true"),
    ));
    lines.push(alone(
        "instrument's flaws: no physics invented",
        ">= 95 %",
        passed("no_physics"),
    ));
    lines.push(beside(
        "misspecified law: mechanism named",
        ">= 90 %",
        "mechanism",
    ));
    lines.push(beside(
        "misspecified law: said to be inexact",
        ">= 90 %",
        "inexact",
    ));
    lines.push(beside(
        "misspecified law: nothing spurious over a tenth",
        ">= 90 %",
        "no_spurious",
    ));
    lines.push(alone(
        "  where the observer sees another law",
        "",
        Rate::of(
            all.iter()
                .filter(|j| j.passed_ideal.iter().any(|p| p.0 == "inexact" && p.1))
                .filter_map(|j| j.passed.iter().find(|p| p.0 == "inexact"))
                .map(|p| p.1),
        ),
    ));
    lines.push(alone(
        "the library's laws not said to be inexact",
        "",
        passed("exact_kept"),
    ));
    lines.push(alone(
        "95 % intervals hold the truth",
        "90-98 %",
        Rate::of(all.iter().flat_map(|j| &j.intervals).map(|i| i.covered)),
    ));
    let held_ideal = (!ideals.is_empty()).then(|| {
        Rate::of(
            all.iter()
                .filter(|j| j.word == Word::Named)
                .filter_map(|j| Some(j.held_ideal_m? <= 1.2 * j.held_out?[2])),
        )
    });
    lines.push(Line {
        ideal: held_ideal,
        ..alone(
            "held-out rms <= 1.2 noise where named",
            "all",
            passed("held_out"),
        )
    });
    lines.push(alone(
        "  or <= 1.2 of the observer's own",
        "",
        Rate::of(
            all.iter()
                .filter(|j| j.passed.iter().any(|p| p.0 == "held_out"))
                .filter_map(|j| {
                    let [_, after, noise] = j.held_out?;
                    Some(after <= 1.2 * noise.max(j.held_ideal_m.unwrap_or(noise)))
                }),
        ),
    ));
    lines.push(alone(
        "paper's two runs: the right set",
        "all",
        passed("paper_set"),
    ));
    lines.push(alone(
        "  and the next run splits it",
        "all",
        passed("paper_split"),
    ));
    lines.push(alone("data faults said", "all", passed("fault")));
    let mut confusion: BTreeMap<String, BTreeMap<String, usize>> = BTreeMap::new();
    for j in all {
        if matches!(j.category, Category::Fault | Category::Paper) {
            continue;
        }
        let row = j
            .truth
            .first()
            .filter(|t| t.main)
            .map_or("nothing".to_owned(), |t| t.effect.clone());
        *confusion
            .entry(row)
            .or_default()
            .entry(answer(j))
            .or_default() += 1;
    }
    let mut numbers: BTreeMap<&str, Vec<(f64, bool)>> = BTreeMap::new();
    for i in all.iter().flat_map(|j| &j.intervals) {
        let error = ((i.value - i.truth) / i.truth).abs();
        numbers.entry(&i.name).or_default().push((error, i.covered));
    }
    let errors = numbers
        .into_iter()
        .map(|(name, of)| Error {
            name: name.to_owned(),
            median_relative: median(of.iter().map(|e| e.0).collect()),
            covered: Rate::of(of.iter().map(|e| e.1)),
        })
        .collect();
    let named: Vec<[f64; 3]> = all
        .iter()
        .filter(|j| j.word == Word::Named)
        .filter_map(|j| j.held_out)
        .collect();
    let mut cases = BTreeMap::new();
    for j in all {
        *cases.entry(j.category.name()).or_default() += 1;
    }
    Score {
        cases,
        lines,
        confusion,
        errors,
        held_out: [0, 1].map(|i| median(named.iter().map(|h| h[i] / h[2]).collect())),
    }
}

/// The heaviest that was named, or the word.
fn answer(j: &Judged) -> String {
    let heaviest = j.found.first().filter(|f| f.matters);
    match j.word {
        Word::None => "none".to_owned(),
        Word::DataFault => "data_fault".to_owned(),
        Word::Unknown => {
            let named =
                heaviest.filter(|_| j.truth.first().is_some_and(|t| t.effect != UNNAMED_ID));
            named.map_or("unknown".to_owned(), |f| f.effect.clone())
        }
        // In a set with the truth first it stands for it.
        Word::Ambiguous => {
            let truth = j.truth.first().map(|t| &t.effect);
            match truth.filter(|t| j.equivalent.iter().any(|s| s.contains(t))) {
                Some(t) => t.clone(),
                None => heaviest.map_or("none".to_owned(), |f| f.effect.clone()),
            }
        }
        Word::Named => heaviest.map_or("none".to_owned(), |f| f.effect.clone()),
    }
}

/// Complaint about a case, in a line; `None` where nothing went wrong.
pub fn complaint(j: &Judged) -> Option<String> {
    let mut wrong: Vec<String> = j
        .passed
        .iter()
        .filter(|p| !p.1)
        .map(|p| p.0.to_string())
        .collect();
    if let Some(t) = &j.tool {
        let counted = t.counted();
        for c in counted.iter().filter(|c| !c.hit) {
            wrong.push(format!("missed {} {:.2} mm", c.name, c.weight_m * 1e3));
        }
        for c in counted.iter().filter(|c| c.weight_right() == Some(false)) {
            let found_mm = c.found_m.map_or(f64::NAN, |w| w * 1e3);
            let (name, there_mm) = (&c.name, c.weight_m * 1e3);
            wrong.push(format!("{name} {found_mm:.2} mm for {there_mm:.2}"));
        }
        wrong.extend(
            t.found
                .iter()
                .filter(|f| !f.2)
                .map(|f| format!("invented {} {:.2} mm", f.0, f.1 * 1e3)),
        );
        if t.heaviest == Some(false) {
            wrong.push("heaviest wrong".to_owned());
        }
    }
    let heavy: Vec<String> = j
        .found
        .iter()
        .filter(|f| f.weight_m > SCORED_M)
        .map(|f| {
            let mark = if f.inexact { "~" } else { "" };
            format!("{}{mark} {:.2}", f.effect, f.weight_m * 1e3)
        })
        .collect();
    let there: Vec<String> = j
        .truth
        .iter()
        .filter(|t| t.weight_m > SCORED_M)
        .map(|t| format!("{} {:.2}", t.effect, t.weight_m * 1e3))
        .collect();
    (!wrong.is_empty()).then(|| {
        let fault = j.fault.map_or(String::new(), |f| format!(" {f:?}"));
        let paper = j.paper.as_ref().map_or(String::new(), |p| {
            format!(
                "; sets {:?}; without {:?}; then {}",
                j.equivalent, p.lacking, p.after
            )
        });
        format!(
            "{}{fault}: {} | there: {} | {:?}: {}{paper}",
            j.id,
            wrong.join(", "),
            there.join(", "),
            j.word,
            heavy.join(", ")
        )
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn wilson_is_wilson() {
        // 95 of 100: 0.8882 .. 0.9785 (Newcombe 1998, method 3).
        let r = Rate::of((0..100).map(|i| i < 95));
        assert!((r.low - 0.8882).abs() < 1e-4 && (r.high - 0.9785).abs() < 1e-4);
        let all = Rate::of((0..20).map(|_| true));
        assert!((all.low - 0.8389).abs() < 1e-4 && all.high == 1.0);
    }
}
