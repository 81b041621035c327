//! The score of runs held out, and what went wrong, in words.

use std::fmt::Write as _;

use super::{Beyond, HeldOutJudged, Kind};
use crate::benchmark::score::Rate;

/// Share of missed runs that has to be said with what they have beyond those fitted: 38 of 40.
const ASKED_SAID: f64 = 0.95;
/// Share of runs inside that may be said: 2 of 40.
const ASKED_FALSE: f64 = 0.05;

/// Score of runs held out.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, schemars::JsonSchema)]
pub struct HeldOutScore {
    /// Missed runs that are said with what they have beyond those fitted.
    pub hits: Rate,
    /// Missed runs that are said at all.
    pub said: Rate,
    /// Missed runs of which speeds beyond those fitted are named.
    pub speeds: Rate,
    /// Runs inside, of a complete model, that are said all the same: the level of the word, run by run; 0.01 is aimed at.
    pub false_alarms: Rate,
    /// Cases that are not what their kind asks for after all their draws: not counted above.
    pub left_out: usize,
}

/// Scores cases.
pub fn score(all: &[HeldOutJudged]) -> HeldOutScore {
    let of = |kind: Kind| all.iter().filter(move |j| j.kind == kind && j.counts());
    HeldOutScore {
        hits: Rate::of(of(Kind::Missed).map(HeldOutJudged::is_right)),
        said: Rate::of(of(Kind::Missed).map(|j| j.is_said)),
        speeds: Rate::of(of(Kind::Missed).map(|j| j.named.contains(&Beyond::Speeds))),
        false_alarms: Rate::of(of(Kind::Inside).map(|j| j.is_said)),
        left_out: all.iter().filter(|j| !j.counts()).count(),
    }
}

/// Complaint about a case that is not right, or not what its kind asks for, in a line.
pub fn complaint(j: &HeldOutJudged) -> Option<String> {
    let miss = j.miss_over_noise.map_or_else(
        || "without end".to_owned(),
        |m| {
            let open = j.open_over_noise;
            format!("{m:.1} x the noise in {} ({open:.1} left open)", j.channel)
        },
    );
    let there = match j.there.join(", ") {
        none if none.is_empty() => "nothing".to_owned(),
        names => names,
    };
    let what = match (j.kind, j.counts(), j.is_said) {
        (_, true, _) if j.is_right() => return None,
        (Kind::Missed, false, _) => "not missed after all draws",
        (Kind::Inside, false, _) => "not complete after all draws",
        (Kind::Missed, true, false) => "missed, and not said",
        (Kind::Missed, true, true) => "missed and said, without what it has beyond",
        (Kind::Inside, true, _) => "said, although the model is complete",
    };
    let outside = match j.outside.as_str() {
        "" => String::new(),
        words => format!(" | {words}"),
    };
    Some(format!(
        "held_out-{}: {what}: off by {miss}; there: {there}{outside} | {}",
        j.index, j.sentence
    ))
}

/// The score in words.
pub fn words(all: &[HeldOutJudged]) -> String {
    let s = score(all);
    let mut made = String::new();
    let mut line = |what: &str, rate: Rate, asked: &str| {
        if rate.count == 0 {
            return;
        }
        // Writing to a String cannot fail.
        let _ = writeln!(
            made,
            "{what:58} {:>5.1} % ({}/{}; {:.1}-{:.1}){asked}",
            100.0 * rate.share,
            rate.hits,
            rate.count,
            100.0 * rate.low,
            100.0 * rate.high
        );
    };
    let at_least = format!("   asked: at least {:.0} %", 100.0 * ASKED_SAID);
    let at_most = format!("   asked: at most {:.0} %", 100.0 * ASKED_FALSE);
    line(
        "missed by 5 x the noise: said, with what it has beyond",
        s.hits,
        &at_least,
    );
    line("missed by 5 x the noise: said", s.said, "");
    line(
        "missed by 5 x the noise: speeds beyond are named",
        s.speeds,
        "",
    );
    line("complete model, inside: said", s.false_alarms, &at_most);
    if s.left_out > 0 {
        let _ = writeln!(
            made,
            "{} case(s) are not what their kind asks for after all draws, and are not counted",
            s.left_out
        );
    }
    made
}

#[cfg(test)]
mod tests {
    use super::*;
    use hydroline_diagnose::verdict::Word;
    use std::collections::BTreeSet;

    fn judged(kind: Kind, miss: f64, named: &[Beyond]) -> HeldOutJudged {
        HeldOutJudged {
            index: 4,
            is_coupled: false,
            kind,
            beyond: (kind == Kind::Missed).then_some(Beyond::Loads),
            there: Vec::new(),
            word: Word::None,
            sentence: "Nothing that matters was left out.".to_owned(),
            is_complete: true,
            miss_over_noise: Some(miss),
            channel: "x_m".to_owned(),
            open_over_noise: 0.2,
            left_over_noise: Some(miss),
            is_said: !named.is_empty(),
            named: named.iter().copied().collect::<BTreeSet<_>>(),
            outside: String::new(),
            diagnoses: 1,
            seconds: 0.0,
        }
    }

    #[test]
    fn misses_hits_and_false_alarms_are_counted_apart() {
        let all = [
            judged(Kind::Missed, 9.0, &[Beyond::Loads, Beyond::Speeds]),
            judged(Kind::Missed, 9.0, &[Beyond::Speeds]),
            judged(Kind::Missed, 9.0, &[]),
            judged(Kind::Missed, 2.0, &[]),
            judged(Kind::Inside, 0.3, &[]),
            judged(Kind::Inside, 0.3, &[Beyond::Speeds]),
        ];
        let s = score(&all);
        let counts = |r: Rate| (r.hits, r.count);
        assert_eq!(counts(s.hits), (1, 3));
        assert_eq!(counts(s.said), (2, 3));
        assert_eq!(counts(s.false_alarms), (1, 2));
        assert_eq!(s.left_out, 1);
        let said: Vec<bool> = all.iter().map(|j| complaint(j).is_some()).collect();
        assert_eq!(said, [false, true, true, true, false, true]);
        assert!(complaint(&all[2]).unwrap().contains("missed, and not said"));
        let text = words(&all);
        assert!(
            text.contains("(1/3;") && text.contains("1 case(s)"),
            "{text}"
        );
    }
}
