//! The verdict as one self-contained HTML page: one sentence first, then what it rests on.
//!
//! Order as a reader asks: what was left out; does it predict better on runs it has not seen; where
//! does it act; how sure, and what else was considered; what the vehicle's coefficients become; what
//! these runs cannot show, and which run would.

mod figures;
mod tables;
mod traces;

use std::fmt::Write as _;

use hydroline_report::{Body, Inline, Page};
use hydroline_rigs::{ParameterValue, PhysicsEntry};

use super::Diagnosis;
use super::verdict::{Verdict, Word};
pub use traces::{Runs, Shown, Trace};

/// Output of `diagnose --report`.
#[derive(Debug, Clone)]
pub struct Pages {
    /// The page.
    pub page: Page,
    /// Its before/after figure alone; empty where nothing was fitted.
    pub before_after_svg: String,
}

/// Page and figure; `command` is what made them.
pub fn pages(found: &Diagnosis, command: &str) -> Pages {
    let v = &found.verdict;
    let mut page = Page::new(
        format!("hydroline diagnose: {}", word(v.verdict)),
        format!("Diagnosis: {}", word(v.verdict)),
    );
    let shown = &found.shown[..];
    let b = &mut page.body;
    b.lead(&v.sentence);
    if let Some(truncated) = &v.truncated {
        b.warning(format!(
            "This is the verdict so far. {} The last work that was done: {}.",
            truncated.sentence(usize::MAX),
            truncated.after
        ));
    }
    for words in v.vehicle_alone.misfit() {
        b.paragraph(format!("The vehicle alone: {words}"));
    }
    b.paragraph(Inline::new().code(command));
    let mut before_after_svg = String::new();
    if v.verdict == Word::DataFault {
        tables::faults(b, v);
    } else {
        before_after_svg = before_after(b, shown);
        tables::fit(b, v);
        tables::contradictions(b, v);
        tables::effects(b, v);
        written(b, found);
        place(b, found, shown);
        tables::unexplained(b, v);
        tables::ablation(b, v);
        tables::alternatives(b, v);
        tables::coefficients(b, v);
        tables::noise(b, v);
        tables::faults(b, v);
        tables::rest(b, v);
    }
    if let Some(images) = &found.images {
        b.append(images.clone());
    }
    Pages {
        page,
        before_after_svg,
    }
}

/// Every run that can be predicted, without and with what was left out; the first figure as a file of its own.
fn before_after(b: &mut Body, shown: &[Shown]) -> String {
    b.section("Before and after");
    match shown.first().map(|s| &s.predicted) {
        Some(Runs::HeldOut(_)) => {
            b.paragraph(
                "Runs that were not used for fitting, predicted; only each run's start is fitted.",
            );
        }
        Some(Runs::ByTheOthers(_)) => {
            b.paragraph("Each run predicted by coefficients and effects fitted to the others; only its start is fitted.");
        }
        Some(Runs::None) | None => {}
    }
    let mut first = String::new();
    for channel in shown {
        let traces = match &channel.predicted {
            Runs::HeldOut(traces) | Runs::ByTheOthers(traces) => traces,
            Runs::None => {
                b.warning("One run and none held out: the figure shows the fit itself, which proves less than a prediction.");
                &channel.fitted
            }
        };
        for trace in traces {
            let figure = figures::before_after(channel, trace);
            b.figure(&figure, "");
            if first.is_empty() {
                first = figure.file();
            }
        }
        if let Some(figure) = figures::whiteness(channel, traces) {
            b.figure(
                &figure,
                "Of residuals that are white noise, 19 of 20 lags stay within the band.",
            );
        }
    }
    first
}

fn word(w: Word) -> &'static str {
    match w {
        Word::None => "nothing that matters",
        Word::DataFault => "data fault",
        other => other.name(),
    }
}

/// An entry as it stands in a rig file.
pub fn entry_toml(entry: &PhysicsEntry) -> String {
    let mut text = format!("[[physics]]\neffect = \"{}\"\n", entry.effect);
    for (name, value) in &entry.parameters {
        let _ = match value {
            ParameterValue::Number(n) => writeln!(text, "{name} = {n}"),
            ParameterValue::Word(w) => writeln!(text, "{name} = \"{w}\""),
        };
    }
    text
}

fn written(b: &mut Body, found: &Diagnosis) {
    let named = |e: &&PhysicsEntry| found.verdict.effects.iter().any(|f| f.effect == e.effect);
    let entries: Vec<String> = found
        .rig
        .physics
        .iter()
        .filter(named)
        .map(entry_toml)
        .collect();
    if !entries.is_empty() {
        b.section("In the rig file");
        b.paragraph(
            Inline::from("What ")
                .code("--write-rig")
                .plain(" writes beside the refitted coefficients:"),
        );
        b.listing(&entries.join("\n"));
    }
}

/// Where the model without effects misses, on the runs fitted.
fn place(b: &mut Body, found: &Diagnosis, shown: &[Shown]) {
    let place = &found.verdict.place;
    b.section("Where");
    let stage = place.stage.as_deref().unwrap_or("not known");
    let mut words = vec![format!("Stage {stage}")];
    words.extend(place.dof.iter().cloned());
    b.paragraph(format!("{}: {}.", words.join(", "), place.regime));
    if !shown.is_empty() {
        b.paragraph("What the vehicle alone, refitted, leaves of the runs fitted.");
    }
    for channel in shown {
        for trace in &channel.fitted {
            let more = place.windows.get(&trace.name).cloned();
            b.figure(
                &figures::misses(channel, trace, more.unwrap_or_default()),
                "",
            );
        }
    }
}

/// One line per group of tied explanations, for headings.
fn together(v: &Verdict) -> String {
    v.equivalent
        .iter()
        .map(|s| s.join(" + "))
        .collect::<Vec<_>>()
        .join(" or ")
}
