//! The library as a table, from the registry alone.

use std::fmt::Write;

use super::{ALL, EffectInfo};

/// All effects as a Markdown table: id, stage, law, parameters (unit; plausible range), confusable.
pub fn markdown_table() -> String {
    let mut text = String::from(
        "| effect | stage | law | parameters | mistaken for |\n|---|---|---|---|---|\n",
    );
    for info in ALL {
        let confusable = info.confusable_with();
        let confusable: Vec<String> = confusable.iter().map(|k| format!("`{k}`")).collect();
        let _ = writeln!(
            text,
            "| `{}` | {} | {} | {} | {} |",
            info.id,
            info.stage.name(),
            // A bar would end the cell.
            info.law.replace('|', "\\|"),
            parameters(info),
            confusable.join(", ")
        );
    }
    text
}

fn parameters(info: &EffectInfo) -> String {
    let numbers = info.parameters.iter().map(|p| {
        let (low, high) = p.plausible;
        format!("`{}` [{}] {low} .. {high}", p.name, p.unit)
    });
    let words = info.words.iter().map(|w| {
        format!(
            "`{}` = {}{}",
            w.name,
            w.allowed.join(", "),
            w.absent
                .map_or(String::new(), |word| format!(" (left out: {word})"))
        )
    });
    let all: Vec<String> = numbers.chain(words).collect();
    if all.is_empty() {
        "none".to_owned()
    } else {
        all.join("; ")
    }
}
