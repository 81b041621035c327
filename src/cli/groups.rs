//! Subcommands by job, for `hydroline --help`: what one needs first stands first.

use std::fmt::Write;

/// Each visible subcommand once, under the job it is for.
pub const GROUPS: &[(&str, &[&str])] = &[
    ("First steps", &["demo", "rig", "plan", "devices", "check"]),
    (
        "At the tank",
        &["aim", "flat", "board", "target", "calibrate", "record"],
    ),
    (
        "Logs",
        &["info", "doctor", "recover", "export", "replay", "view"],
    ),
    (
        "Analysis",
        &[
            "extract",
            "import",
            "join",
            "identify",
            "coefficients",
            "compare",
            "diagnose",
            "predict",
            "model",
            "campaign",
            "publish",
        ],
    ),
    ("Simulation and proof", &["simulate", "reproduce", "prove"]),
    ("Shell and manual", &["completions", "man", "help"]),
];

/// The command with a help that lists its subcommands by job; clap itself knows one list only.
pub(crate) fn grouped(command: clap::Command) -> clap::Command {
    let template = format!(
        "{{about-with-newline}}\n{{usage-heading}} {{usage}}\n\n{}{{after-help}}",
        lists(&command)
    );
    command.help_template(template)
}

/// The lists, and the flags after them.
fn lists(command: &clap::Command) -> String {
    let styles = command.get_styles();
    let (header, literal) = (*styles.get_header(), *styles.get_literal());
    let about = |name: &str| {
        let known = command.find_subcommand(name).and_then(|c| c.get_about());
        // clap adds `help` itself, later.
        known.map_or_else(
            || "The same as COMMAND --help".to_owned(),
            ToString::to_string,
        )
    };
    let width = GROUPS.iter().flat_map(|g| g.1).map(|n| n.len()).max();
    let width = width.unwrap_or(0) + 2;
    let mut text = String::new();
    for (job, names) in GROUPS {
        // Writing to a string does not fail.
        let _ = writeln!(text, "{header}{job}:{header:#}");
        // A build without the lab has no `prove`.
        let there = |name: &&&str| **name == "help" || command.find_subcommand(name).is_some();
        for name in names.iter().filter(there) {
            let gap = " ".repeat(width - name.len());
            let _ = writeln!(text, "  {literal}{name}{literal:#}{gap}{}", about(name));
        }
        text.push('\n');
    }
    let _ = write!(text, "{header}Options:{header:#}\n{{options}}");
    text
}
