//! What each command's --json prints, from the types that it prints.

mod fields;

use super::markdown::{code, head, link, plain, table};
use crate::{
    calibrate, check, design, devices, export, extract, flat, import, log_tools, plan, predict,
    prove, record, replay, reproduce, simulate,
};
use clap::Command;
use fields::Field;
use hydroline_diagnose::verdict::Verdict;
use hydroline_identify::Identification;
use hydroline_identify::bollard::Bollard;
use hydroline_import::recorded::Contents;
use hydroline_log::doctor::Diagnosis;
use hydroline_log::export::Exported;
use hydroline_log::recover::Recovery;
use hydroline_plan::preflight::Preflight;
use hydroline_reproduce as paper;
use std::collections::BTreeSet;
use std::fmt::Write;

/// What a command prints.
struct Printed {
    /// The command without the program's name.
    command: &'static str,
    /// When it prints this, and how; "" = one object, whenever --json is given.
    when: &'static str,
    fields: Vec<Field>,
}

macro_rules! printed {
    ($($command:literal $when:literal $of:ty),+ $(,)?) => {
        vec![$(Printed { command: $command, when: $when, fields: fields::of::<$of>() }),+]
    };
}

fn all() -> Vec<Printed> {
    let mut all = listed();
    // A map by itself has no doc comment.
    let maps = all.iter_mut().flat_map(|p| p.fields.first_mut());
    for named in maps.filter(|f| f.path == "NAME" && f.meaning.is_empty()) {
        named.meaning = "The table or figure, by its name.".to_owned();
    }
    all
}

fn listed() -> Vec<Printed> {
    printed![
        "plan list" "A list." Vec<plan::Listed>,
        "plan design" "" design::Found<'static>,
        "devices" "" devices::Listed<'static>,
        "check" "" check::Checked<'static>,
        "aim" "One object per line, twice a second." hydroline_daemon::record::aim::AimView,
        "flat" "" flat::Printed<'static>,
        "calibrate" "" calibrate::json::Printed<'static>,
        "record" "" record::Printed<'static>,
        "record" "With --dry-run." Preflight,
        "record" "With --until-decided." record::until::Printed<'static>,
        "info" "" log_tools::LogInfo,
        "info" "Of a log of another program that is no MCAP file." Contents,
        "doctor" "" Diagnosis,
        "recover" "" Recovery,
        "export" "" Exported,
        "export" "With --merged." export::MergedRows,
        "replay" "" replay::Printed,
        "extract" "" extract::Printed,
        "import" "" import::Printed<'static>,
        "join" "" hydroline_import::join::Joined,
        "identify" "" Identification,
        "identify" "With --bollard and without logs." Bollard,
        "diagnose" "The same is in `diagnose.json` of --report." Verdict,
        "predict" "" predict::Printed<'static>,
        "simulate" "" simulate::Printed<'static>,
        "reproduce" "figure12, figure13, figure17; NAME = figure." reproduce::Printed<'static, paper::Figure>,
        "reproduce" "table3; NAME = table3." reproduce::Printed<'static, Vec<paper::Row>>,
        "reproduce" "table4, table5; NAME = table4 or table5." reproduce::Printed<'static, Vec<paper::Disturbed>>,
        "reproduce" "table7; NAME = table7." reproduce::Printed<'static, Vec<paper::SurgeRun>>,
        "reproduce" "table10; NAME = table10." reproduce::Printed<'static, Vec<paper::Table10Row>>,
        "reproduce" "table11; NAME = table11." reproduce::Printed<'static, Vec<paper::Table11Row>>,
        "reproduce" "all-dofs; NAME = all_dofs." reproduce::Printed<'static, Vec<paper::DofRow>>,
        "reproduce" "calibration; NAME = calibration." reproduce::Printed<'static, paper::CalibrationStudy>,
        "reproduce" "joint-pose; NAME = joint_pose." reproduce::Printed<'static, paper::JointAccuracy>,
        "prove" "" prove::Proved<'static>,
        "prove" "With --images." prove::ProvedImages<'static>,
        "prove" "With --coupled." prove::ProvedCoupled<'static>,
        "prove" "With --only ID." prove::One<'static>,
        "prove" "With --only image-N." prove::OneImage<'static>,
        "prove" "With --only coupled-N." prove::OneCoupled<'static>,
    ]
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
