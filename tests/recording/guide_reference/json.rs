//! The fields that each command's --json prints, from the schemas of the types that it prints.

mod fields;

use super::markdown::{code, head, link, plain, table};
use clap::Command;
use fields::Field;
use hydroline::cli::printed::printed;
use std::collections::BTreeSet;
use std::fmt::Write;

/// The fields of what a command prints.
struct Printed {
    /// The command without the program's name.
    command: &'static str,
    /// When it prints this, and how; "" = one object, whenever --json is given.
    when: &'static str,
    fields: Vec<Field>,
}

/// Each command's forms, with the fields of each.
fn all() -> Vec<Printed> {
    let listed = printed().into_iter().map(|p| Printed {
        command: p.command,
        when: p.when,
        fields: fields::of(p.schema.as_value()),
    });
    let mut all: Vec<Printed> = listed.collect();
    // A map by itself has no doc comment.
    let maps = all.iter_mut().flat_map(|p| p.fields.first_mut());
    for named in maps.filter(|f| f.path == "NAME" && f.meaning.is_empty()) {
        named.meaning = "The table or figure, by its name.".to_owned();
    }
    all
}

/// Commands whose JSON is described elsewhere: which, and where.
const ELSEWHERE: [(&str, &str); 2] = [
    (
        "rig show",
        "The rig with all defaults, by the tables and keys of RIG.",
    ),
    (
        "campaign",
        "`rows`: a list of the rows of `runs.csv`, each an object on a line of its own with that table's columns (the chapter Campaigns lists them); what is not known is absent.",
    ),
];

pub(super) fn chapter() -> String {
    let mut text = head(
        "JSON",
        "the types that --json prints",
        &format!(
            "What `--json` prints on stdout: one JSON object on one line where nothing else is said. `a.b` is the field `b` of the \
         object `a`, `a[]` an element of the list `a`, and NAME stands for any name. A field that is *not always there* is \
         omitted where it says nothing. A number that is none (not a number, infinite) is `null`. Fields are never renamed; new ones \
         may come. Programs look at the {} first.",
            link("exit code", "command-line", "#exit-codes")
        ),
    );
    for (command, words) in ELSEWHERE {
        let words = words.replace("RIG", &link("Rig and plan files", "rig", ""));
        let _ = write!(text, "\n## hydroline {command}\n\n{words}\n");
    }
    let mut last = "";
    for printed in all() {
        if printed.command != last {
            last = printed.command;
            let _ = writeln!(text, "\n## hydroline {last}");
        }
        if !printed.when.is_empty() {
            let _ = write!(text, "\n{}\n", printed.when);
        }
        let rows: Vec<_> = printed.fields.iter().filter(|f| f.shown).map(row).collect();
        table(&mut text, ["field", "type", "unit", "meaning"], &rows);
    }
    text
}

fn row(field: &Field) -> [String; 4] {
    let mut kind = field.kind.clone();
    if field.optional {
        kind.push_str("; not always there");
    }
    [
        code(&field.path),
        kind,
        field.unit.clone(),
        plain(&field.meaning),
    ]
}

/// Paths of all fields of a command.
pub(super) fn paths(command: &str) -> Vec<String> {
    let of = all().into_iter().filter(|p| p.command == command);
    of.flat_map(|p| p.fields).map(|f| f.path).collect()
}

/// Fields without a meaning, and commands with --json that are not here.
pub(super) fn undescribed(root: &Command) -> Vec<String> {
    let all = all();
    let missing = all.iter().flat_map(|p| {
        let bare = p.fields.iter().filter(|f| f.meaning.is_empty());
        bare.map(|f| format!("{} --json: {} has no meaning", p.command, f.path))
    });
    let mut missing: Vec<String> = missing.collect();
    let elsewhere = ELSEWHERE.iter().map(|(command, _)| *command);
    let here: BTreeSet<String> = all
        .iter()
        .map(|p| p.command)
        .chain(elsewhere)
        .map(str::to_owned)
        .collect();
    let mut there = BTreeSet::new();
    with_json(root, "", &mut there);
    let differ = here.symmetric_difference(&there);
    missing.extend(differ.map(|c| format!("{c}: --json and the list of what it prints differ")));
    missing
}

/// Commands that have --json, by their names without the program's.
fn with_json(command: &Command, name: &str, found: &mut BTreeSet<String>) {
    if command.get_arguments().any(|a| a.get_id() == "json") {
        found.insert(name.to_owned());
    }
    for sub in command.get_subcommands() {
        let name = format!("{name} {}", sub.get_name());
        with_json(sub, name.trim_start(), found);
    }
}
