//! Every kind of event, from their registry.

use super::markdown::{code, head, table};
use hydroline::event::{EventKind, Severity};
use std::fmt::Write;

pub(super) fn chapter() -> String {
    let mut text = head(
        "Events",
        "the registry of event kinds (src/core/event/kind)",
        "What the daemon writes on the topic `/daemon/event`. Events are never dropped. Each has a time stamp, a severity, a kind \
         (a stable word for programs), a message (one sentence for a person) and numbers by name. *Info* is worth knowing; at \
         *warning* something is degraded and nothing lost; at *error* something was lost or a part stopped working. \
         `hydroline doctor` counts warnings and errors.",
    );
    let mut part = "";
    for kind in EventKind::all() {
        let of = kind.name.split('.').next().unwrap_or_default();
        if of != part {
            part = of;
            let _ = writeln!(text, "\n## {part}");
        }
        describe(&mut text, kind);
    }
    text
}

fn describe(text: &mut String, kind: &EventKind) {
    let severities: Vec<&str> = kind.severities.iter().map(|s| word(*s)).collect();
    let _ = writeln!(
        text,
        "\n### {}\n\n*{}.* {}",
        code(kind.name),
        severities.join(" or "),
        kind.meaning
    );
    if !kind.values.is_empty() {
        let rows: Vec<_> = kind
            .values
            .iter()
            .map(|v| [code(v.name), v.unit.to_owned(), v.meaning.to_owned()])
            .collect();
        table(text, ["value", "unit", "meaning"], &rows);
    }
}

fn word(severity: Severity) -> &'static str {
    match severity {
        Severity::Info => "Info",
        Severity::Warning => "Warning",
        Severity::Error => "Error",
    }
}
