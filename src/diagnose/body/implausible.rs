//! Effects of implausible sizes into the verdict.

use hydroline_inference::plausible::Implausible;
use hydroline_inference::term::Candidate;

use super::effects::{place, words};
use crate::verdict;

/// Effects that are not offered, as the verdict lists them.
pub fn listed(candidates: &[Candidate], all: &[Implausible]) -> Vec<verdict::Implausible> {
    let each = all.iter().filter_map(|i| {
        let c = &candidates[i.candidate];
        Some(verdict::Implausible {
            effect: c.info.id.to_owned(),
            words: words(c),
            dof: place(c),
            parameter: c.info.parameters.first()?.name.to_owned(),
            value: i.value,
            plausible: [i.plausible.0, i.plausible.1],
            probability: i.probability,
        })
    });
    each.collect()
}

/// The same as remarks.
pub fn notes(all: &[verdict::Implausible]) -> Vec<String> {
    let note = |i: &verdict::Implausible| {
        let words: Vec<&str> = i.words.values().map(String::as_str).collect();
        let place = match words.is_empty() {
            true => String::new(),
            false => format!(" in {}", words.join(" ")),
        };
        let [low, high] = i.plausible.map(rounded);
        format!(
            "{}{place} would have to have {} = {} (plausible {low} to {high}): not offered",
            i.effect,
            i.parameter,
            rounded(i.value)
        )
    };
    all.iter().map(note).collect()
}

/// Three digits of a number, as people write it.
fn rounded(value: f64) -> String {
    if value == 0.0 {
        return "0".to_owned();
    }
    let before = value.abs().log10().floor() as i32;
    let decimals = usize::try_from(2 - before).unwrap_or(0);
    let made = format!("{value:.decimals$}");
    if made.contains('.') {
        made.trim_end_matches('0').trim_end_matches('.').to_owned()
    } else {
        made
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_effect_that_is_not_offered_is_said_with_the_size_it_would_have() {
        let lag = verdict::Implausible {
            effect: "thruster_lag".to_owned(),
            words: [("dof".to_owned(), "yaw".to_owned())].into(),
            dof: Some("yaw".to_owned()),
            parameter: "lag_s".to_owned(),
            value: 13.02,
            plausible: [0.05, 0.5],
            probability: 0.9,
        };
        assert_eq!(
            notes(&[lag]),
            [
                "thruster_lag in yaw would have to have lag_s = 13 (plausible 0.05 to 0.5): not offered"
            ]
        );
        for (value, said) in [
            (-0.4886, "-0.489"),
            (1234.6, "1235"),
            (2e-4, "0.0002"),
            (100.0, "100"),
        ] {
            assert_eq!(rounded(value), said);
        }
    }
}
