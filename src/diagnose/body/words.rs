//! The verdict in a sentence.

use crate::verdict::{Effect, Verdict, Word};

/// Share of a coefficient by which it has to move to be said.
const MOVED: f64 = 0.05;

/// A weight in the unit that people use.
fn amount(channel: &str, weight: f64) -> String {
    if channel.ends_with("_rad") {
        format!("{:.2} deg", weight.to_degrees())
    } else if channel.ends_with("_radps") {
        format!("{:.2} deg/s", weight.to_degrees())
    } else if channel.ends_with("_mps") {
        format!("{:.2} mm/s", weight * 1e3)
    } else {
        format!("{:.2} mm", weight * 1e3)
    }
}

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
        .rig_factors
        .iter()
        .map(|(name, f)| format!("; {name} is {:.2} times the rig's", f.value));
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
            (known && share > MOVED).then(|| format!("{name} by {:.0} %", 100.0 * share))
        })
        .collect();
    match each.is_empty() {
        true => String::new(),
        false => format!(" (a model without moves {})", each.join(", ")),
    }
}

/// `against` = what speaks against the likeliest model as a whole.
pub fn sentence(v: &Verdict, against: &[String]) -> String {
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
        Word::None => format!("Nothing that matters was left out{also}."),
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
