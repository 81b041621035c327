//! The verdict in a sentence.

use crate::verdict::{Contradiction, Effect, Verdict, Word};

/// Share of a coefficient by which it has to move to be said.
const MOVED: f64 = 0.05;
/// Runs held out that a sentence names of those that contradict it: the notes have all.
const CONTRADICTING: usize = 2;

pub use hydroline_identify::model_test::amount;

fn say(e: &Effect) -> String {
    let mut weight: Vec<(&String, &f64)> = e.weight.iter().collect();
    weight.sort_by(|a, b| b.1.total_cmp(a.1));
    let weight: Vec<String> = weight
        .iter()
        .map(|(c, w)| format!("{c} {}", amount(c, **w)))
        .take(2)
        .collect();
    let numbers: Vec<String> = e
        .parameters
        .iter()
        .map(|(n, p)| format!("{n} = {:.4}", p.value))
        .collect();
    let words: Vec<&str> = e.words.values().map(String::as_str).collect();
    let place = if words.is_empty() {
        String::new()
    } else {
        format!(" in {}", words.join(" "))
    };
    format!(
        "{}{place} ({}; {})",
        e.effect,
        weight.join(", "),
        numbers.join(", ")
    )
}

/// Coefficients far from the rig's.
fn factors(v: &Verdict) -> String {
    let each = v
        .at_limit
        .iter()
        .map(|c| format!("; {} is {:.2} times the rig's", c.key, c.factor));
    each.collect()
}

/// Coefficients that move when the effects are left out of the model, though the motion of these runs hardly does.
fn moved(v: &Verdict) -> String {
    let each: Vec<String> = v
        .parameters
        .after
        .iter()
        .filter_map(|(name, after)| {
            let before = v.parameters.before.get(name)?;
            let share = (before.value - after.value).abs() / after.value.abs();
            let known = (before.value - after.value).abs() > 2.0 * after.sd?;
            (known && share > MOVED && share.is_finite())
                .then(|| format!("{name} by {:.0} %", 100.0 * share))
        })
        .collect();
    match each.is_empty() {
        true => String::new(),
        false => format!(" (a model without moves {})", each.join(", ")),
    }
}

/// Furthest miss of each run held out that contradicts a verdict, the furthest off first.
pub fn worst_of_each(all: &[Contradiction]) -> Vec<&Contradiction> {
    let mut made: Vec<&Contradiction> = Vec::new();
    for c in all {
        if made.iter().all(|known| known.log != c.log) {
            made.push(c);
        }
    }
    made
}

/// Runs held out that are not predicted, as sentences behind the verdict's.
fn contradicted(v: &Verdict) -> String {
    let runs = worst_of_each(&v.contradicted_by);
    let each = runs.iter().take(CONTRADICTING).map(|c| {
        format!(
            " Held out, {} contradicts it: {} misses by {} rms where {} is expected; beyond the runs fitted it has {}.",
            c.log,
            c.channel,
            amount(&c.channel, c.rms),
            amount(&c.channel, c.band),
            c.outside
        )
    });
    let mut made: String = each.collect();
    if runs.len() > CONTRADICTING {
        made += &format!(
            " So do {} more of the runs held out.",
            runs.len() - CONTRADICTING
        );
    }
    made
}

/// The verdict in a sentence, and one for each run held out that contradicts it; `against` = what speaks against the likeliest
/// model as a whole.
pub fn sentence(v: &Verdict, against: &[String]) -> String {
    say_found(v, against) + &late(v) + &contradicted(v)
}

/// Commands that act a row of the logs later or less, where that would leave what the vehicle alone leaves.
fn late(v: &Verdict) -> String {
    let late = v.vehicle_alone.late.is_some() && v.verdict != Word::None;
    match late {
        true => format!(" {}", v.vehicle_alone.sentence),
        false => String::new(),
    }
}

fn say_found(v: &Verdict, against: &[String]) -> String {
    let heavy: Vec<String> = v.effects.iter().filter(|e| e.matters).map(say).collect();
    let small = || v.effects.iter().filter(|e| !e.matters);
    let there: Vec<String> = small().filter(|e| e.established).map(say).collect();
    let open = small().filter(|e| !e.established).count();
    let mut also = String::new();
    if !there.is_empty() {
        also += "; there, but below the tolerance in these runs: ";
        also += &there.join(" and ");
        also += &moved(v);
    }
    if open > 0 {
        also += &format!("; {open} small effect(s) that may be there");
    }
    also += &factors(v);
    match v.verdict {
        Word::None => {
            let [inside, never] = v.vehicle_alone.scope();
            format!("Nothing that matters was left out{inside}{also}{never}.")
        }
        Word::Named => format!("Left out: {}{also}.", heavy.join(" and ")),
        Word::Ambiguous => {
            let sets: Vec<String> = v
                .equivalent
                .iter()
                .map(|s| format!("[{}]", s.join(" + ")))
                .collect();
            format!(
                "These data cannot distinguish: {}{also}.",
                sets.join(" or ")
            )
        }
        Word::Unknown if v.unexplained.is_empty() => {
            let found = match heavy.is_empty() {
                true => "Nothing that was found stands".to_owned(),
                false => format!("{} does not stand", heavy.join(" and ")),
            };
            format!("{found}: {}{also}.", against.join("; "))
        }
        Word::Unknown => {
            let terms: Vec<&str> = v.unexplained.iter().map(|u| u.term.as_str()).collect();
            let beside = match heavy.is_empty() {
                true => String::new(),
                false => format!("; beside it {}", heavy.join(" and ")),
            };
            format!(
                "Something that no effect of the library explains: {}{beside}{also}.",
                terms.join("; ")
            )
        }
        Word::DataFault => v.sentence.clone(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Lag and deadband, the deadband missed: the run held out stood at eleven times its noise without a word.
    #[test]
    fn a_run_that_contradicts_the_verdict_is_in_its_sentence() {
        let missed = |log: &str, channel: &str, rms, band| Contradiction {
            log: log.to_owned(),
            channel: channel.to_owned(),
            rms,
            band,
            p_value: 1e-9,
            outside: "surge load up to 24.0 N, fitted up to 8.00 N".to_owned(),
        };
        let mut v = Verdict {
            contradicted_by: vec![missed("two-tone", "x_m", 1.7e-3, 1.5e-4)],
            ..Verdict::default()
        };
        assert_eq!(
            sentence(&v, &[]),
            "Nothing that matters was left out. Held out, two-tone contradicts it: x_m misses by 1.70 mm rms where 0.15 mm is expected; beyond the runs fitted it has surge load up to 24.0 N, fitted up to 8.00 N."
        );
        for log in ["two-tone", "b", "c", "d"] {
            v.contradicted_by.push(missed(log, "u_mps", 1e-3, 5e-4));
        }
        let said = sentence(&v, &[]);
        assert_eq!(said.matches("contradicts it").count(), 2, "{said}");
        assert!(
            said.ends_with("So do 2 more of the runs held out."),
            "{said}"
        );
        v.contradicted_by.clear();
        assert_eq!(sentence(&v, &[]), "Nothing that matters was left out.");
    }
}
