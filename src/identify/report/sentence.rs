//! Result in one sentence: the coefficients, and whether anything is left in the residuals.

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
        result.model,
        left(result)
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

/// Sentence on the residuals.
fn left(result: &Identification) -> String {
    let at_rest = |n: &crate::outcome::SlotNoise| n.source == "measured at rest";
    let ratio = result.variance_ratio.sqrt();
    if !result.misfit.is_empty() {
        "The residuals are not noise alone: the model lacks something.".to_owned()
    } else if result.noise.values().any(at_rest) {
        format!("The residuals are noise alone: {ratio:.2} times what was measured at rest.")
    } else {
        "The residuals are white; their size is not checked, for no run at rest measured the noise."
            .to_owned()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::problem::Objective;
    use std::collections::BTreeMap;

    fn found(excited: &[bool], misfit: &[&str]) -> Identification {
        let keys: Vec<String> = (0..excited.len()).map(|k| format!("c{k}")).collect();
        let estimate = |excited: bool| Estimate {
            symbol: "X_u".to_owned(),
            unit: "kg/s".to_owned(),
            value: -12.5,
            sd: Some(0.5),
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
            method: "lm".to_owned(),
            objective: Objective::LeastSquares,
            objective_value: 0.0,
            evaluations: 1,
            converged: true,
            parameters: parameters.collect(),
            order: keys,
            covariance: Vec::new(),
            correlation: Vec::new(),
            noise: BTreeMap::new(),
            variance_ratio: 1.0,
            residuals: Vec::new(),
            misfit: misfit.iter().map(|w| (*w).to_owned()).collect(),
            cross_validation: Vec::new(),
            blind_spots: Vec::new(),
            held_effects: Vec::new(),
            runs: Vec::new(),
            notes: Vec::new(),
            traces: Vec::new(),
        }
    }

    #[test]
    fn the_sentence_counts_what_is_known_and_says_what_is_left() {
        let words = sentence(&found(&[true, false], &[]));
        assert!(
            words.contains("1 of the 2 coefficients of the model surge: X_u = -12.500 kg/s"),
            "{words}"
        );
        assert!(words.contains("(95 % -13.500 .. -11.500)"), "{words}");
        assert!(words.contains("no run at rest"), "{words}");
        let words = sentence(&found(&[true; 18], &["x_m: louder"]));
        assert!(
            words.contains("all 18") && !words.contains("X_u"),
            "{words}"
        );
        assert!(words.contains("lacks something"), "{words}");
        assert!(sentence(&found(&[false], &[])).contains("none of the 1"));
    }
}
