//! The reference part of the book: chapters made of what the program itself uses, the command line's definition, the
//! readers of rig files, the registries of effects and events, and the types that --json prints.
//!
//! A test (`cargo test --test recording guide_reference`) holds the chapters in `src/guide/reference` against these.

mod command_line;
mod effects;
mod events;
mod json;
mod markdown;
mod rig;

use hydroline_core::build_info::BuildInfo;

/// Name (of the file, without its ending) and text of each chapter.
pub fn chapters() -> Vec<(&'static str, String)> {
    let command = whole_command();
    vec![
        ("command-line", command_line::chapter(&command)),
        ("rig", rig::chapter()),
        ("effects", effects::chapter()),
        ("events", events::chapter()),
        ("json", json::chapter()),
    ]
}

/// What stands in a chapter without a description: must be empty.
pub fn undescribed() -> Vec<String> {
    let command = whole_command();
    let mut all = command_line::undescribed(&command);
    all.extend(hydroline_rigs::reference::undescribed());
    all.extend(effects::undescribed());
    all.extend(json::undescribed(&command));
    all
}

/// Whether a field stands in the chapter on JSON; `path` = names and `[]` from the outside, as `runs[].log`.
pub fn json_paths(command: &str) -> Vec<String> {
    json::paths(command)
}

/// The command line with the full names of its commands.
fn whole_command() -> clap::Command {
    let mut command = super::command(BuildInfo::default()).disable_help_subcommand(true);
    command.build();
    command
}
