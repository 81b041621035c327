//! Every effect, from their registry.

use super::markdown::{code, head, sentence, table};
use hydroline_sim::effect::{ALL, EffectInfo, Stage};
use std::fmt::Write;

const STAGES: [(Stage, &str); 4] = [
    (Stage::Timing, "Clocks and delays."),
    (Stage::Thruster, "Between the commanded and the real load."),
    (
        Stage::Hydrodynamics,
        "Between the load and the acceleration.",
    ),
    (
        Stage::Measurement,
        "Between the motion and what is measured of it.",
    ),
];

pub(super) fn chapter() -> String {
    let mut text = head(
        "Effects",
        "the registry of effects (sim/src/effect)",
        "Physics beyond the vehicle's equations of motion: what a `[[physics]]` entry of a rig file switches on in the simulator \
         and in every fit, and the candidate library of `hydroline diagnose`. An entry has the id as `effect` and the parameters \
         as further keys. *Plausible* is the prior's range: what a tank run may show; values outside of it are allowed with a note. \
         *Allowed* are the limits of the law: values outside are refused. *Confusable with* are effects that leave nearly the \
         same traces in many runs. `hydroline rig effects` prints the same in short.",
    );
    for (stage, meaning) in STAGES {
        let _ = writeln!(text, "\n## Stage: {}\n\n{meaning}", stage.name());
        let of_stage = ALL.iter().filter(|info| info.stage == stage);
        of_stage.for_each(|info| describe(&mut text, info));
    }
    text
}

fn describe(text: &mut String, info: &EffectInfo) {
    // Writing to a string does not fail.
    let _ = writeln!(text, "\n### {}\n\nLaw: {}", info.id, code(info.law));
    let numbers = info.parameters.iter().map(|p| {
        let range = |(low, high): (f64, f64)| format!("{} to {}", short(low), short(high));
        [
            code(p.name),
            p.unit.to_owned(),
            range(p.plausible),
            range(p.limits),
            p.absent.map_or("required".to_owned(), short),
            p.meaning.to_owned(),
        ]
    });
    let words = info.words.iter().map(|w| {
        let allowed: Vec<String> = w.allowed.iter().map(|word| code(word)).collect();
        [
            code(w.name),
            "word".to_owned(),
            String::new(),
            allowed.join(", "),
            w.absent.map_or("required".to_owned(), code),
            w.meaning.to_owned(),
        ]
    });
    let rows: Vec<_> = numbers.chain(words).collect();
    if rows.is_empty() {
        text.push_str("\nNo parameters.\n");
    } else {
        let columns = [
            "parameter",
            "unit",
            "plausible",
            "allowed",
            "default",
            "meaning",
        ];
        table(text, columns, &rows);
    }
    let confusable: Vec<String> = info
        .confusable_with()
        .iter()
        .map(|id| format!("[{id}](#{id})"))
        .collect();
    let confusable = match confusable.is_empty() {
        true => "no other effect of the library".to_owned(),
        false => confusable.join(", "),
    };
    let _ = writeln!(
        text,
        "\nConfusable with: {confusable}. Source: {}",
        sentence(info.source)
    );
}

/// Parameters without a meaning.
pub(super) fn undescribed() -> Vec<String> {
    let mut missing = Vec::new();
    for info in ALL {
        let numbers = info.parameters.iter().map(|p| (p.name, p.meaning));
        let words = info.words.iter().map(|w| (w.name, w.meaning));
        for (name, _) in numbers
            .chain(words)
            .filter(|(_, meaning)| meaning.is_empty())
        {
            missing.push(format!("effect {}: {name} has no meaning", info.id));
        }
        if info.law.is_empty() || info.source.is_empty() {
            missing.push(format!("effect {}: no law or no source", info.id));
        }
    }
    missing
}

/// Large and small numbers as powers of ten.
fn short(number: f64) -> String {
    let size = number.abs();
    if size != 0.0 && !(1e-4..1e6).contains(&size) {
        format!("{number:e}")
    } else {
        number.to_string()
    }
}
