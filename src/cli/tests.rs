//! Help, groups, manual pages and completions of the command line, from one definition.

use super::groups::GROUPS;
use super::{command, completions, man};
use clap::ValueEnum;
use clap::error::ErrorKind;
use clap_complete::Shell;
use hydroline_core::build_info::BuildInfo;
use std::collections::{BTreeMap, BTreeSet};
use std::process::{Command, Stdio};

/// Longest line of an example: a terminal of 80 columns has room for most, one of 100 for all.
const EXAMPLE_MAX: usize = 100;

fn whole() -> clap::Command {
    let mut command = command(BuildInfo::default());
    command.build();
    command
}

/// Every command of the tree by its words (`hydroline rig new`), clap's own `help` left out.
fn tree() -> BTreeMap<String, clap::Command> {
    fn walk(command: &clap::Command, path: &str, all: &mut BTreeMap<String, clap::Command>) {
        all.insert(path.to_owned(), command.clone());
        for sub in command.get_subcommands().filter(|c| c.get_name() != "help") {
            walk(sub, &format!("{path} {}", sub.get_name()), all);
        }
    }
    let mut all = BTreeMap::new();
    walk(&whole(), "hydroline", &mut all);
    all
}

/// Words as a shell takes them, up to a comment, pipe or redirection.
fn words(line: &str) -> Vec<String> {
    let mut words = Vec::new();
    let mut quoted = false;
    let mut word = String::new();
    for c in line.chars() {
        match c {
            '"' => quoted = !quoted,
            ' ' if !quoted => {
                if !word.is_empty() {
                    words.push(std::mem::take(&mut word));
                }
            }
            '#' | '|' | '>' if !quoted && word.is_empty() => return words,
            _ => word.push(c),
        }
    }
    words.extend(Some(word).filter(|w| !w.is_empty()));
    words
}

#[test]
fn the_definition_is_consistent() {
    command(BuildInfo::default()).debug_assert();
}

#[test]
fn every_argument_is_explained_and_no_help_shows_an_escape() {
    for (path, mut command) in tree() {
        for argument in command.get_arguments() {
            let id = argument.get_id();
            let help = argument.get_help().map(ToString::to_string);
            assert!(
                help.is_some_and(|h| h.len() > 5),
                "{path}: <{id}> has no help"
            );
            // The names of shells say what they are.
            for value in argument.get_possible_values() {
                let known = value.get_help().is_some() || path == "hydroline completions";
                assert!(
                    known,
                    "{path}: <{id}> {} is not explained",
                    value.get_name()
                );
            }
        }
        let help = command.render_long_help().to_string();
        for escape in ["\\[", "\\]", "\\_", "\\*", "[`", "`]"] {
            assert!(!help.contains(escape), "{path}: '{escape}' in\n{help}");
        }
    }
}

#[test]
fn every_command_teaches_with_an_example_that_is_accepted() {
    for (path, command) in tree() {
        assert!(
            command.get_about().is_some(),
            "{path} says nothing of itself"
        );
        let after = command.get_after_help().map(ToString::to_string);
        let after = after.unwrap_or_default();
        let examples: Vec<&str> = after
            .lines()
            .skip_while(|line| *line != "Examples:")
            .skip(1)
            .take_while(|line| !line.is_empty())
            .collect();
        assert!(!examples.is_empty(), "{path} has no example");
        for line in examples {
            assert!(
                line.starts_with(&format!("  {path} ")) || line.trim() == path,
                "{path}: an example of something else: {line}"
            );
            assert!(
                line.chars().count() <= EXAMPLE_MAX,
                "{path}: too long: {line}"
            );
            if let Err(error) = whole().try_get_matches_from(words(line)) {
                assert_eq!(error.kind(), ErrorKind::DisplayHelp, "{line}: {error}");
            }
        }
    }
}

#[test]
fn the_groups_hold_every_visible_command_once() {
    let listed: Vec<&str> = GROUPS.iter().flat_map(|g| g.1).copied().collect();
    let set: BTreeSet<&str> = listed.iter().copied().collect();
    assert_eq!(set.len(), listed.len(), "named twice: {listed:?}");
    let command = whole();
    let visible: BTreeSet<&str> = command
        .get_subcommands()
        .filter(|c| !c.is_hide_set())
        .map(clap::Command::get_name)
        .collect();
    assert_eq!(set, visible);
}

#[test]
fn the_help_shows_the_groups_on_a_narrow_terminal() {
    let help = whole().term_width(80).render_help().to_string();
    let mut rest = help.as_str();
    for (job, names) in GROUPS {
        let (_, after) = rest.split_once(&format!("{job}:\n")).expect(job);
        rest = after;
        for name in *names {
            let line = rest.lines().next().unwrap_or_default();
            assert!(line.starts_with(&format!("  {name} ")), "{name}: {line}");
            assert!(line.len() <= 80, "{line}");
            assert!(line.len() > 16, "{name} without a word: {line}");
            rest = rest.split_once('\n').expect("one line per command").1;
        }
    }
    assert!(
        rest.contains("--version") && rest.contains("Exit codes:"),
        "{rest}"
    );
    // Nothing is listed a second time.
    assert_eq!(help.matches("\n  identify ").count(), 1);
}

#[test]
fn each_shell_gets_its_completions() {
    for shell in Shell::value_variants() {
        let script = completions::script(*shell, BuildInfo::default());
        let script = String::from_utf8(script).expect("UTF-8");
        for word in ["identify", "fail-on", "water-temp"] {
            assert!(script.contains(word), "{shell}: no {word}");
        }
        // clap_complete knows an option's values in these.
        if matches!(shell, Shell::Bash | Shell::Zsh | Shell::Fish) {
            assert!(script.contains("misfit"), "{shell}: no values of --fail-on");
        }
        assert!(!script.contains("sim-controller"), "{shell}");
    }
}

#[test]
fn each_visible_command_has_its_page() {
    let pages: BTreeMap<String, String> = man::pages(BuildInfo::default())
        .expect("pages")
        .into_iter()
        .map(|(name, page)| (name, String::from_utf8(page).expect("UTF-8")))
        .collect();
    let expected: BTreeSet<String> = tree()
        .keys()
        .filter(|path| !path.contains("sim-controller"))
        .map(|path| format!("{}.1", path.replace(' ', "-")))
        .collect();
    assert_eq!(pages.keys().cloned().collect::<BTreeSet<_>>(), expected);
    for (name, page) in &pages {
        for part in [".TH", ".SH NAME", ".SH SYNOPSIS", ".SH NOTES", "Examples:"] {
            assert!(page.contains(part), "{name}: no {part}");
        }
        assert!(!page.contains("EXTRA"), "{name}");
        warns_of_nothing(name, page);
    }
    assert!(pages["hydroline-identify.1"].contains("misfit"));
    assert!(
        pages["hydroline.1"].contains("hydroline\\-record(1)"),
        "{}",
        pages["hydroline.1"]
    );
}

/// groff, where it is installed, has nothing to say of the page.
fn warns_of_nothing(name: &str, page: &str) {
    use std::io::Write;
    let groff = Command::new("groff")
        .args(["-man", "-ww", "-z", "-Tutf8"])
        .stdin(Stdio::piped())
        .stdout(Stdio::null())
        .stderr(Stdio::piped())
        .spawn();
    let Ok(mut groff) = groff else {
        return; // not installed: the sections above are what is checked
    };
    let mut stdin = groff.stdin.take().expect("a pipe");
    stdin.write_all(page.as_bytes()).expect("groff reads");
    drop(stdin);
    let said = groff.wait_with_output().expect("groff ends");
    let said = String::from_utf8_lossy(&said.stderr).into_owned();
    assert!(said.is_empty(), "{name}: {said}");
}

#[test]
fn the_version_is_that_of_the_build() {
    let build = BuildInfo::from_build_script("4042f4f1a2b3", "true");
    let version = command(build).render_version();
    assert_eq!(version.trim(), format!("hydroline {build}"));
    assert!(version.contains("(4042f4f1a2b3, dirty)"), "{version}");
}
