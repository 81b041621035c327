//! The reference part of the guide: chapters made of what the program itself uses, the command line's definition, the
//! readers of rig files, the registries of effects and events, and the types that --json prints. Chapters made anew are those
//! in `src/guide/reference`, nothing in them lacks a description, and all that commands print with --json is in the chapter on it.

mod command_line;
mod effects;
mod events;
mod json;
mod markdown;
mod rig;

use std::collections::BTreeSet;
use std::path::Path;

use hydroline::build_info::BuildInfo;
use serde_json::Value;

use crate::support::hydroline;

/// Set: the chapters are written instead of compared.
const UPDATE: &str = "HYDROLINE_UPDATE_REFERENCE";

fn folder() -> std::path::PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("src/guide/reference")
}

/// Name (of the file, without its ending) and text of each chapter.
fn chapters() -> Vec<(&'static str, String)> {
    vec![
        ("command-line", command_line::chapter(&whole_command())),
        ("rig", rig::chapter()),
        ("effects", effects::chapter()),
        ("events", events::chapter()),
        ("json", json::chapter()),
    ]
}

/// The command line with the full names of its commands.
fn whole_command() -> clap::Command {
    let command = hydroline::cli::command(BuildInfo::default());
    let mut command = command.disable_help_subcommand(true);
    command.build();
    command
}

#[test]
fn chapters_made_anew_are_those_of_the_guide() {
    let summary = std::fs::read_to_string(folder().with_file_name("SUMMARY.md")).unwrap();
    let mut stale = Vec::new();
    for (name, text) in chapters() {
        let name = format!("{name}.md");
        let path = folder().join(&name);
        if std::env::var_os(UPDATE).is_some() {
            std::fs::write(&path, &text).unwrap();
        }
        let there = std::fs::read_to_string(&path).unwrap_or_default();
        if there != text {
            let mut lines = there.lines().zip(text.lines()).zip(1..);
            let first = lines.find(|((a, b), _)| a != b);
            let first = first.map_or("at its end".to_owned(), |((a, b), n)| {
                format!("line {n}\n   there: {a}\n   now:   {b}")
            });
            stale.push(format!("{name}: {first}"));
        }
        assert!(
            summary.contains(&format!("(reference/{name})")),
            "{name} is not in SUMMARY.md"
        );
    }
    assert!(
        stale.is_empty(),
        "not what the program says now; write them anew with\n  {UPDATE}=1 cargo test --test recording guide_reference\n{}",
        stale.join("\n")
    );
}

#[test]
fn nothing_in_the_reference_lacks_a_description() {
    let command = whole_command();
    let mut missing = command_line::undescribed(&command);
    missing.extend(effects::undescribed());
    missing.extend(json::undescribed(&command));
    assert!(missing.is_empty(), "{}", missing.join("\n"));
}

/// Kinds of events that readers of logs look for by their words are kinds that are written.
#[test]
fn kinds_that_are_looked_for_are_kinds_that_are_written() {
    let kinds = hydroline::event::EventKind::all();
    let kinds: BTreeSet<&str> = kinds.map(|k| k.name).collect();
    let mut seen = 0;
    for file in ["log/doctor/checks.rs", "log/recover/ledger.rs"] {
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("src").join(file);
        let text = std::fs::read_to_string(path).unwrap();
        for arm in text.lines().filter(|l| l.contains("=>")) {
            let words = arm
                .split("=>")
                .next()
                .unwrap()
                .split('"')
                .skip(1)
                .step_by(2);
            for word in words.filter(|w| w.contains('.')) {
                assert!(kinds.contains(word), "{file}: {word} is no kind of event");
                seen += 1;
            }
        }
    }
    assert!(seen >= 7, "{seen}");
}

/// Every field of a command's JSON stands in its chapter.
#[test]
fn what_is_printed_with_json_is_in_the_chapter() {
    let dir = tempfile::tempdir().unwrap();
    let path = |name: &str| dir.path().join(name).to_str().unwrap().to_owned();
    let [log, other, again] = ["a.mcap", "b.mcap", "c.mcap"].map(path);
    let commands: Vec<(&str, Vec<&str>)> = vec![
        ("plan list", vec!["plan", "list", "--rig", "lshpi"]),
        ("devices", vec!["devices"]),
        (
            "check",
            vec![
                "check",
                "--rig",
                "lshpi",
                "--disk",
                dir.path().to_str().unwrap(),
            ],
        ),
        (
            "simulate",
            vec![
                "simulate",
                "--rig",
                "lshpi",
                "--plan",
                "reversals",
                "--motion-only",
                "--out",
                &log,
            ],
        ),
        (
            "simulate",
            vec![
                "simulate",
                "--rig",
                "lshpi",
                "--plan",
                "coast-down",
                "--motion-only",
                "--seed",
                "2",
                "--out",
                &other,
            ],
        ),
        (
            "record",
            vec!["record", "--rig", "lshpi", "--plan", "still", "--dry-run"],
        ),
        ("info", vec!["info", &log]),
        ("doctor", vec!["doctor", &log]),
        ("recover", vec!["recover", &log, "--out", &again]),
        ("export", vec!["export", &log]),
        ("identify", vec!["identify", &log, &other, "--rig", "lshpi"]),
        (
            "diagnose",
            vec![
                "diagnose",
                &log,
                &other,
                "--rig",
                "lshpi",
                "--time-limit",
                "none",
            ],
        ),
        (
            "predict",
            vec!["predict", "--rig", "lshpi", "--plan", "still"],
        ),
        ("reproduce", vec!["reproduce", "table11"]),
    ];
    for (command, words) in commands {
        let out = hydroline().args(&words).arg("--json").output().unwrap();
        let text = String::from_utf8(out.stdout).unwrap();
        let printed: Value = serde_json::from_str(&text)
            .unwrap_or_else(|e| panic!("{words:?}: {e}: {}", String::from_utf8_lossy(&out.stderr)));
        let known: BTreeSet<String> = json::paths(command).into_iter().collect();
        assert!(!known.is_empty(), "{command}");
        look(command, "", &printed, &known);
    }
}

/// Every field below `path` is known; NAME stands for any name.
fn look(command: &str, path: &str, printed: &Value, known: &BTreeSet<String>) {
    match printed {
        Value::Object(fields) => {
            for (name, below) in fields {
                let under = |name: &str| match path {
                    "" => name.to_owned(),
                    _ => format!("{path}.{name}"),
                };
                let found = [under(name), under("NAME")]
                    .into_iter()
                    .find(|p| known.contains(p));
                let found = found.unwrap_or_else(|| {
                    panic!(
                        "{command} --json prints {}, which its chapter lacks",
                        under(name)
                    )
                });
                look(command, &found, below, known);
            }
        }
        Value::Array(elements) => {
            let path = format!("{path}[]");
            elements.iter().for_each(|e| look(command, &path, e, known));
        }
        _ => {}
    }
}
