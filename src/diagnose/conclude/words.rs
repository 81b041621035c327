//! The verdict in words.

use crate::explain::Explanation;
use crate::family::Variable;
use crate::fit::Fit;
use crate::locate::{Stretch, elsewhere, of_one_run, stretches, told};
use crate::setting::Setting;
use crate::verdict::{Effect, Unexplained, Verdict, Word};

/// Share of a force's strongest stretch below which it is next to nothing.
const QUIET: f64 = 0.25;

/// How a mechanism that acts twice is told.
pub fn twice_note(setting: &Setting, candidate: usize, two: &Fit) -> String {
    let info = setting.vocabulary[candidate].info;
    let copies: Vec<String> = (0..two.set.len())
        .filter(|m| two.set[*m] == candidate)
        .map(|m| {
            info.parameters
                .iter()
                .zip(two.member(setting, m))
                .map(|(p, v)| format!("{} = {v:.4}", p.name))
                .collect::<Vec<_>>()
                .join(", ")
        })
        .collect();
    if info.parameters[0].corner {
        return format!(
            "acts as many side by side would, from {}",
            copies.join(" to ")
        );
    }
    format!("acts as two in a row would: {}", copies.join(" and "))
}

pub fn unexplained(setting: &Setting, found: &Explanation) -> Option<Unexplained> {
    let f = found.family.as_ref()?;
    let all = stretches(setting, f);
    let [Stretch { range, mean, .. }, others @ ..] = &all[..] else {
        return None;
    };
    let force = *mean;
    let (length, rate, load) = match setting.dof.index() {
        0..3 => ("m", "m/s", "N"),
        _ => ("rad", "rad/s", "N m"),
    };
    let unit = match f.family.variable.quantity() {
        Variable::Place => length,
        Variable::Rate => rate,
        Variable::Load => load,
        _ => "s",
    };
    let (of, range) = told(setting, f.family.variable, *range);
    let more: String = others
        .iter()
        .map(|s| {
            let (run, [from, to]) = of_one_run(setting, f.family.variable, s.range)
                .map_or((String::new(), s.range), |(run, range)| {
                    (format!(" in run {run}"), range)
                });
            format!(
                ", of {:.3}{run} between {from:.3} and {to:.3} {unit}",
                s.mean
            )
        })
        .collect();
    let strongest = all.iter().map(|s| s.mean.abs()).fold(0.0, f64::max);
    let rest = match elsewhere(f, &all) {
        rest if rest < QUIET * strongest => "near 0 elsewhere".to_owned(),
        rest => format!("up to {rest:.3} elsewhere, as far as that is known"),
    };
    Some(Unexplained {
        channel: setting.channel().to_owned(),
        weight: found.family_weight,
        depends_on: of.clone(),
        range,
        force,
        term: format!(
            "a force of about {force:.3} {load} for {of} between {:.3} and {:.3} {unit}{more}, {rest}",
            range[0], range[1]
        ),
        knots: f.family.knots.iter().map(|k| f.family.shown(*k)).collect(),
        force_at: f.amplitudes.clone(),
        force_sd: f.sds.clone(),
        log_bayes_factor: f.gain,
        closed_form: None,
    })
}

pub fn sentence(v: &Verdict) -> String {
    let say = |e: &Effect| {
        let weight: Vec<String> = e
            .weight
            .iter()
            .map(|(c, w)| {
                if c.ends_with("_rad") {
                    format!("{:.2} deg", w.to_degrees())
                } else {
                    format!("{:.2} mm", w * 1e3)
                }
            })
            .collect();
        let numbers: Vec<String> = e
            .parameters
            .iter()
            .map(|(n, p)| format!("{n} = {:.4}", p.value))
            .collect();
        format!(
            "{} ({}; {})",
            e.effect,
            weight.join(", "),
            numbers.join(", ")
        )
    };
    let heavy: Vec<String> = v.effects.iter().filter(|e| e.matters).map(say).collect();
    let small = v.effects.iter().filter(|e| !e.matters).count();
    let also = if small > 0 {
        format!("; {small} small effect(s) established that do not matter")
    } else {
        String::new()
    };
    match v.verdict {
        Word::None => format!("Nothing that matters was left out{also}."),
        Word::Named => format!("Left out: {}{also}.", heavy.join(" and ")),
        Word::Ambiguous => format!(
            "These data cannot tell apart: {}{also}.",
            v.equivalent
                .iter()
                .map(|s| format!("[{}]", s.join(" + ")))
                .collect::<Vec<_>>()
                .join(" or ")
        ),
        Word::Unknown => format!(
            "Something that no effect of the vocabulary explains: {}{}{also}.",
            v.unexplained
                .iter()
                .map(|u| u.term.clone())
                .collect::<Vec<_>>()
                .join("; "),
            if heavy.is_empty() {
                String::new()
            } else {
                format!("; beside it {}", heavy.join(" and "))
            }
        ),
        Word::DataFault => v.sentence.clone(),
    }
}
