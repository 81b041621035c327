//! Commands on the pages, held against `--help`, whether a test runs them or not.

use super::blocks::blocks;
use std::collections::{BTreeMap, BTreeSet};
use std::process::Command;

/// `hydroline COMMAND` with the flags given to it.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord)]
pub struct Call {
    /// `record`, `rig new`, ...
    pub command: String,
    /// `--out`, ...
    pub flags: Vec<String>,
}

/// Calls in the blocks and in the `code` of the sentences.
pub fn calls(markdown: &str, file: &str) -> Result<Vec<Call>, String> {
    let mut found = Vec::new();
    let mut prose = markdown.to_owned();
    for block in blocks(markdown, file)? {
        prose = prose.replace(&block.text, "");
        if matches!(block.language.as_str(), "sh" | "ini") {
            let lines = block.text.replace("\\\n", " ");
            found.extend(lines.lines().flat_map(of_line));
        }
    }
    // Every second part stands between backticks.
    let code = prose.split('`').skip(1).step_by(2);
    found.extend(
        code.filter(|c| c.starts_with("hydroline "))
            .flat_map(of_line),
    );
    Ok(found)
}

/// Calls in one line of a shell; what stands behind `#` is a remark.
fn of_line(line: &str) -> Vec<Call> {
    let line = line.split(" #").next().unwrap_or("");
    line.split([';', '|', '&', '{', '}', '(', ')', '\n'])
        .filter_map(|command| {
            let mut words = command
                .split_whitespace()
                .skip_while(|w| matches!(*w, "do" | "exec" | "then"));
            if words.next() != Some("hydroline") {
                return None;
            }
            let words: Vec<&str> = words.collect();
            let mut name = (*words.first()?).to_owned();
            // `hydroline COMMAND --help` stands for all of them.
            if !name.starts_with(|c: char| c.is_ascii_lowercase()) {
                return None;
            }
            if ["rig", "plan"].contains(&name.as_str()) {
                name = format!("{name} {}", words.get(1)?);
            }
            let flags = words
                .iter()
                .filter(|w| w.starts_with("--") && w.len() > 2)
                .map(|w| w.split('=').next().unwrap_or(w).to_owned())
                .collect();
            Some(Call {
                command: name,
                flags,
            })
        })
        .collect()
}

/// Commands and flags that `--help` does not know, one sentence each.
pub fn misspelt(calls: &[Call]) -> Vec<String> {
    let mut helps: BTreeMap<&str, Option<BTreeSet<String>>> = BTreeMap::new();
    let mut wrong = BTreeSet::new();
    for call in calls {
        let known = helps
            .entry(&call.command)
            .or_insert_with(|| flags_of(&call.command));
        match known {
            None => {
                wrong.insert(format!("there is no `hydroline {}`", call.command));
            }
            Some(known) => wrong.extend(
                call.flags
                    .iter()
                    .filter(|f| !known.contains(*f))
                    .map(|f| format!("`hydroline {} --help` has no {f}", call.command)),
            ),
        }
    }
    wrong.into_iter().collect()
}

/// The flags that a command's help names; `None` when there is no such command.
fn flags_of(command: &str) -> Option<BTreeSet<String>> {
    let output = Command::new(env!("CARGO_BIN_EXE_hydroline"))
        .args(command.split(' '))
        .arg("--help")
        .output()
        .ok()?;
    let help = String::from_utf8_lossy(&output.stdout).into_owned();
    output.status.success().then(|| {
        help.split(|c: char| !(c.is_ascii_alphanumeric() || c == '-'))
            .filter(|w| w.starts_with("--"))
            .map(str::to_owned)
            .collect()
    })
}

#[test]
fn calls_are_found_in_blocks_and_sentences() {
    let text = "Use `hydroline rig new --out x.toml`, `hydroline COMMAND --help`, `record --runs`.\n```sh\nfor n in 1 2; do hydroline replay $n \\\n  --out y; done   # --not a flag\n{ hydroline rig show lshpi; printf x; } > z\n```\n";
    let found = calls(text, "T.md").unwrap();
    let call = |command: &str, flags: &[&str]| Call {
        command: command.to_owned(),
        flags: flags.iter().map(|f| (*f).to_owned()).collect(),
    };
    assert_eq!(
        found,
        [
            call("replay", &["--out"]),
            call("rig show", &[]),
            call("rig new", &["--out"])
        ]
    );
}

#[test]
fn what_help_does_not_know_is_reported() {
    let text = "```sh\nhydroline replay x --smoooth\nhydroline replya x\n```\n";
    assert_eq!(
        misspelt(&calls(text, "T.md").unwrap()),
        [
            "`hydroline replay --help` has no --smoooth",
            "there is no `hydroline replya`"
        ]
    );
}
