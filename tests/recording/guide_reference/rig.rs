//! Every key of rig and plan files, from the tables as they are declared.

use super::markdown::{code, head, table};
use hydroline_rigs::reference::{Default, Key, Table, plan, rig};
use std::fmt::Write;

pub(super) fn chapter() -> String {
    let mut text = head(
        "Rig and plan files",
        "the tables of these files as they are declared (`table!` in rigs/src)",
        "Rig files are TOML. `hydroline rig new` writes one with comments to start from, `hydroline rig show` prints a rig as \
         the daemon reads it, with all defaults written out, and names every mistake with file, line and key. Unknown keys are \
         mistakes. A key's unit is its ending; an angle may be given in degrees or in radians. Frames: tank frame z down with \
         0 on the floor; body frame x forward, y to starboard, z down, origin at the centre of gravity.",
    );
    text.push_str("\n## Rig files\n");
    rig().iter().for_each(|t| describe(&mut text, t));
    text.push_str(
        "\n## Plan files\n\nA plan says what the thrusters do over time. `hydroline plan show PLAN --toml` prints one to edit.\n",
    );
    plan().iter().for_each(|t| describe(&mut text, t));
    text
}

fn describe(text: &mut String, of: &Table) {
    // Writing to a string does not fail.
    if !of.heads.is_empty() {
        let heads: Vec<String> = of.heads.iter().map(|h| code(h)).collect();
        let _ = writeln!(text, "\n### {}", heads.join(", "));
    }
    let _ = writeln!(text, "\n{}", of.meaning);
    if !of.keys.is_empty() {
        let rows: Vec<_> = of.keys.iter().map(row).collect();
        table(
            text,
            ["key", "type", "unit", "default", "allowed", "meaning"],
            &rows,
        );
    }
}

fn row(key: &Key) -> [String; 6] {
    let names: Vec<String> = key.names.iter().map(|n| code(n)).collect();
    let default = match &key.default {
        Default::Required => "required".to_owned(),
        Default::None => "none".to_owned(),
        Default::Value(value) => value.clone(),
    };
    [
        names.join(" or "),
        key.kind.clone(),
        key.unit.to_owned(),
        default,
        key.allowed.clone(),
        key.meaning.clone(),
    ]
}
