//! Every command with its arguments, from the definition that parses them.

use super::markdown::{block, code, head, plain, sentence, table};
use clap::{Arg, ArgAction, Command};
use hydroline::cli::{EXIT_CODES, GROUPS};
use std::fmt::Write;

/// The chapter; `root` = the whole command line, built.
pub(super) fn chapter(root: &Command) -> String {
    let about = root.get_about().map(ToString::to_string);
    let mut text = head(
        "Command line",
        "the command line's definition (src/cli)",
        &sentence(&about.unwrap_or_default()),
    );
    block(&mut text, &usage(root));
    notes(&mut text, root);
    text.push_str("\n## Exit codes\n");
    let rows = EXIT_CODES
        .map(|(code, name, meaning)| [code.to_string(), name.to_owned(), sentence(meaning)]);
    table(&mut text, ["code", "", "meaning"], &rows);
    for (job, names) in GROUPS {
        let _ = writeln!(text, "\n## {job}");
        let commands = names.iter().filter_map(|name| root.find_subcommand(name));
        commands.for_each(|command| describe(&mut text, command));
    }
    text
}

/// Commands and arguments without a description.
pub(super) fn undescribed(root: &Command) -> Vec<String> {
    let mut missing = Vec::new();
    for command in root.get_subcommands().filter(|c| !c.is_hide_set()) {
        let name = full_name(command);
        if command.get_about().is_none() {
            missing.push(format!("{name}: no description"));
        }
        for arg in arguments(command).filter(|a| help(a).is_empty()) {
            missing.push(format!("{name}: {} has no description", arg.get_id()));
        }
        missing.extend(undescribed(command));
    }
    missing
}

fn describe(text: &mut String, command: &Command) {
    let about = command.get_long_about().or(command.get_about());
    let about = about.map(ToString::to_string).unwrap_or_default();
    let _ = writeln!(
        text,
        "\n### {}\n\n{}",
        full_name(command),
        plain(&sentence(&about))
    );
    block(text, &usage(command));
    let rows: Vec<_> = arguments(command).map(row).collect();
    if !rows.is_empty() {
        table(text, ["argument", "default", "meaning"], &rows);
    }
    notes(text, command);
    let subcommands = command.get_subcommands().filter(|c| !c.is_hide_set());
    subcommands.for_each(|c| describe(text, c));
}

/// Notes after a command's flags: sentences as sentences, examples as they are.
fn notes(text: &mut String, command: &Command) {
    let after = command.get_after_long_help().or(command.get_after_help());
    let after = after.map(ToString::to_string).unwrap_or_default();
    for paragraph in after.split("\n\n").map(str::trim_end) {
        match paragraph.strip_prefix("Examples:\n") {
            Some(examples) => {
                text.push_str("\nExamples:\n");
                block(text, &unindented(examples));
            }
            None if paragraph.lines().any(|line| line.starts_with("  ")) => block(text, paragraph),
            None => {
                let _ = writeln!(text, "\n{}", plain(paragraph));
            }
        }
    }
}

fn unindented(lines: &str) -> String {
    let lines: Vec<&str> = lines
        .lines()
        .map(|l| l.strip_prefix("  ").unwrap_or(l))
        .collect();
    lines.join("\n")
}

/// Arguments first, then flags, each in the order of the definition.
fn arguments(command: &Command) -> impl Iterator<Item = &Arg> {
    let shown = |a: &&Arg| !a.is_hide_set() && !matches!(a.get_id().as_str(), "help" | "version");
    let of = move |positional: bool| {
        let kind = move |a: &&Arg| a.is_positional() == positional;
        command.get_arguments().filter(shown).filter(kind)
    };
    of(true).chain(of(false))
}

fn row(arg: &Arg) -> [String; 3] {
    let mut meaning = plain(&sentence(&help(arg)));
    let values: Vec<String> = arg
        .get_possible_values()
        .iter()
        .filter(|v| !v.is_hide_set())
        .map(|v| match v.get_help() {
            Some(help) => format!("{}: {}", code(v.get_name()), plain(&help.to_string())),
            None => code(v.get_name()),
        })
        .collect();
    if takes_value(arg) && !values.is_empty() {
        let _ = write!(meaning, " One of {}.", values.join("; "));
    }
    if matches!(arg.get_action(), ArgAction::Append) && !arg.is_positional() {
        meaning.push_str(" May be given more than once.");
    }
    let defaults: Vec<String> = arg
        .get_default_values()
        .iter()
        .map(|v| code(&v.to_string_lossy()))
        .collect();
    let default = match (takes_value(arg), arg.is_required_set()) {
        (_, true) => "required".to_owned(),
        (true, false) => defaults.join(" "),
        (false, false) => String::new(),
    };
    [code(&name(arg)), default, meaning]
}

fn takes_value(arg: &Arg) -> bool {
    arg.get_action().takes_values()
}

/// As typed: `--out LOG.mcap`, `-v`, `LOG...`.
fn name(arg: &Arg) -> String {
    let values: Vec<&str> = match arg.get_value_names() {
        Some(names) if takes_value(arg) => names.iter().map(|n| n.as_str()).collect(),
        _ => Vec::new(),
    };
    let several = arg
        .get_num_args()
        .is_some_and(|n| n.max_values() > 1 && values.len() == 1);
    let more = if several { "..." } else { "" };
    let flag = arg.get_long().map(|long| format!("--{long}"));
    let flag = flag.or(arg.get_short().map(|short| format!("-{short}")));
    let words: Vec<String> = flag
        .into_iter()
        .chain(values.iter().map(|v| (*v).to_owned()))
        .collect();
    format!("{}{more}", words.join(" "))
}

fn help(arg: &Arg) -> String {
    let help = arg.get_long_help().or(arg.get_help());
    help.map(ToString::to_string).unwrap_or_default()
}

fn full_name(command: &Command) -> String {
    command
        .get_bin_name()
        .unwrap_or(command.get_name())
        .to_owned()
}

fn usage(command: &Command) -> String {
    let usage = command.clone().render_usage().to_string();
    usage.trim_start_matches("Usage:").trim().to_owned()
}
