//! Result in one sentence: the coefficients, and whether the model explains the runs.

use crate::outcome::{Estimate, Identification};
use hydroline_report::significant;

/// So many coefficients stand in the sentence itself; more are only counted.
const SAID: usize = 4;

pub(super) fn sentence(result: &Identification) -> String {
    let all: Vec<&Estimate> = result
        .order
        .iter()
        .filter_map(|key| result.parameters.get(key))
        .collect();
    let known: Vec<&Estimate> = all.iter().copied().filter(|p| p.excited).collect();
    let runs = match result.runs.len() {
        1 => "1 run determines".to_owned(),
        n => format!("{n} runs determine"),
    };
    let values = match known.len() {
        1..=SAID => {
            let each: Vec<String> = known.iter().map(|p| value(p)).collect();
            format!(": {}", each.join(", "))
        }
        _ => String::new(),
    };
    let counted = if known.is_empty() {
        format!("none of the {}", all.len())
    } else if known.len() == all.len() {
        format!("all {}", all.len())
    } else {
        format!("{} of the {}", known.len(), all.len())
    };
    format!(
        "{runs} {counted} coefficients of the model {}{values}. {}",
        result.model, result.test.sentence
    )
}

fn value(p: &Estimate) -> String {
    let interval = match (p.low, p.high) {
        (Some(low), Some(high)) => {
            format!(" (95 % {} .. {})", significant(low), significant(high))
        }
        _ => String::new(),
    };
    format!(
        "{} = {} {}{interval}",
        p.symbol,
        significant(p.value),
        p.unit
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model_test::ModelTest;
    use std::collections::BTreeMap;

    fn found(excited: &[bool], tested: &str) -> Identification {
        let keys: Vec<String> = (0..excited.len()).map(|k| format!("c{k}")).collect();
        let estimate = |excited: bool| Estimate {
            symbol: "X_u".to_owned(),
            unit: "kg/s".to_owned(),
            value: -12.5,
            sd: Some(0.5),
            repeat_sd: None,
            combined_sd: None,
            u95: None,
            largest_share: None,
            low: Some(-13.5),
            high: Some(-11.5),
            profile: None,
            rig: -10.0,
            excited,
            at_bound: false,
        };
        let parameters = keys
            .iter()
            .cloned()
            .zip(excited.iter().map(|e| estimate(*e)));
        Identification {
            model: "surge".to_owned(),
            flat_priors: false,
            ln_evidence: 0.0,
            fits: 1,
            parameters: parameters.collect(),
            order: keys,
            covariance: Vec::new(),
            covariance_combined: Vec::new(),
            budget: Vec::new(),
            correlation: Vec::new(),
            noise: BTreeMap::new(),
            variance_ratio: 1.0,
            residuals: Vec::new(),
            test: ModelTest {
                sentence: tested.to_owned(),
                ..ModelTest::default()
            },
            misfit: Vec::new(),
            cross_validation: Vec::new(),
            blind_spots: Vec::new(),
            held_effects: Vec::new(),
            runs: Vec::new(),
            notes: Vec::new(),
            traces: Vec::new(),
        }
    }

    #[test]
    fn the_sentence_counts_what_is_known_and_ends_with_the_test() {
        let words = sentence(&found(&[true, false], "Nothing was left out."));
        assert!(
            words.contains("1 of the 2 coefficients of the model surge: X_u = -12.500 kg/s"),
            "{words}"
        );
        assert!(words.contains("(95 % -13.500 .. -11.500)"), "{words}");
        assert!(words.ends_with("). Nothing was left out."), "{words}");
        let words = sentence(&found(&[true; 18], ""));
        assert!(
            words.contains("all 18") && !words.contains("X_u"),
            "{words}"
        );
        assert!(sentence(&found(&[false], "")).contains("none of the 1"));
    }
}
