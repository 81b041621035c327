//! README and guide hold what they state: their commands run as printed, outside a checkout, and print what the page says.
//!
//! A page marks its blocks ([`blocks`]); a chapter of the guide joins by marking its own and by a test of three lines here.

mod blocks;
mod links;
mod printed;
mod session;
mod spelling;

use crate::support::alone;
use session::{Substitution, page, play};
use std::fmt::Write as _;
use std::path::Path;

/// Longest README \[lines\].
const README_LINES: usize = 150;

/// A person looks, and ends it.
const NO_HANDS: Substitution = Substitution {
    from: "hydroline aim --rig my-vehicle.toml",
    to: "hydroline aim --rig my-vehicle.toml --for 1s",
    said: "Ctrl-C ends it",
};

/// A recording in real time becomes a rendering that does not wait, of fewer frames; `replay` is given the calibration that
/// the log would carry.
const NO_TIME: [Substitution; 4] = [
    NO_HANDS,
    Substitution {
        from: "hydroline rig new --out my-vehicle.toml",
        to: "hydroline rig new --out my-vehicle.toml && sed -i 's/^rate_fps = 25.0/rate_fps = 5.0/' my-vehicle.toml && grep -q '^rate_fps = 5.0' my-vehicle.toml",
        said: "a smaller `rate_fps` in the rig file has less to render",
    },
    Substitution {
        from: "hydroline record --rig my-vehicle.toml --calibration board.calibration.toml",
        to: "hydroline simulate --rig my-vehicle.toml",
        said: "`simulate` in place of `record` does not wait for the clock",
    },
    Substitution {
        from: "hydroline replay",
        to: "hydroline replay --calibration board.calibration.toml",
        said: "its log carries no calibration: give `--calibration` to `replay`",
    },
];

/// Load-cell readings of a bollard pull, as a person would bring them: two sweeps over the curve of the rig that `rig new`
/// writes, each reading off by up to 0.1 N.
fn bring_readings(folder: &Path) {
    let template = page("rigs/template.toml");
    let curve: Vec<(f64, f64)> = template
        .lines()
        .skip_while(|l| !l.starts_with("curve = ["))
        .filter_map(|l| l.trim().strip_prefix('[')?.strip_suffix("],"))
        .filter_map(|pair| pair.split_once(", "))
        .map_while(|(us, n)| Some((us.parse().ok()?, n.parse().ok()?)))
        .collect();
    assert!(curve.len() > 8, "rigs/template.toml: no curve found");
    let mut table = String::from("pulse_us,thrust_n\n");
    for (k, (pulse_us, thrust_n)) in curve.iter().chain(&curve).enumerate() {
        let off_n = 0.1 * ((k * 7 % 11) as f64 / 5.0 - 1.0);
        writeln!(table, "{pulse_us},{:.2}", thrust_n + off_n).unwrap();
    }
    std::fs::write(folder.join("pull.csv"), table).unwrap();
}

/// Every page: README and the chapters.
fn pages() -> Vec<String> {
    let mut pages: Vec<String> = ["src/guide", "src/guide/theory", "src/guide/reference"]
        .into_iter()
        .flat_map(|folder| {
            let all = std::fs::read_dir(session::root().join(folder)).unwrap();
            all.map(move |entry| (folder, entry.unwrap().file_name().into_string().unwrap()))
        })
        .filter(|(_, name)| name.ends_with(".md"))
        .map(|(folder, name)| format!("{folder}/{name}"))
        .collect();
    pages.push("README.md".to_owned());
    pages.sort();
    pages
}

#[test]
fn the_worked_example_prints_what_readme_says() {
    let _alone = alone();
    let folder = tempfile::tempdir().unwrap();
    play("README.md", "example", folder.path(), &[]);
}

#[test]
fn the_tank_session_runs_on_the_simulator_and_prints_what_readme_says() {
    let _alone = alone();
    let folder = tempfile::tempdir().unwrap();
    bring_readings(folder.path());
    play("README.md", "tank", folder.path(), &NO_TIME);
}

#[test]
#[ignore = "records in real time as README prints it: three minutes"]
fn the_tank_session_runs_as_printed() {
    let _alone = alone();
    let folder = tempfile::tempdir().unwrap();
    bring_readings(folder.path());
    play("README.md", "tank", folder.path(), &[NO_HANDS]);
}

#[test]
#[ignore = "records in real time: a minute and a half"]
fn the_demo_prints_what_the_guide_says() {
    let _alone = alone();
    let folder = tempfile::tempdir().unwrap();
    play("src/guide/introduction.md", "demo", folder.path(), &[]);
}

#[test]
fn readme_stays_short() {
    let lines = page("README.md").lines().count();
    assert!(
        lines <= README_LINES,
        "README.md has {lines} lines, allowed are {README_LINES}: long explanations and tables belong to src/guide"
    );
}

#[test]
fn every_command_on_the_pages_is_one_that_help_knows() {
    let mut wrong = Vec::new();
    for name in pages() {
        let calls = spelling::calls(&page(&name), &name).unwrap();
        wrong.extend(
            spelling::misspelt(&calls)
                .iter()
                .map(|w| format!("{name}: {w}")),
        );
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

#[test]
fn every_link_leads_somewhere() {
    let wrong: Vec<String> = pages()
        .iter()
        .flat_map(|name| links::broken(name, &page(name)))
        .collect();
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

#[test]
fn every_chapter_stands_in_the_summary() {
    let summary = page("src/guide/SUMMARY.md");
    for name in pages() {
        if let Some(chapter) = name.strip_prefix("src/guide/")
            && chapter != "SUMMARY.md"
        {
            assert!(
                summary.contains(&format!("({chapter})")),
                "{chapter} is in no line of src/guide/SUMMARY.md"
            );
        }
    }
}

#[test]
fn every_dependency_has_its_line_in_the_guide() {
    let table = page("src/guide/dependencies.md");
    let named: Vec<&str> = table
        .lines()
        .filter_map(|l| l.strip_prefix("| ")?.split(" | ").next())
        .flat_map(|names| names.trim_end_matches(" (tests)").split(", "))
        .collect();
    let manifest: toml::Table = toml::from_str(&page("Cargo.toml")).unwrap();
    let dependencies = manifest["workspace"]["dependencies"].as_table().unwrap();
    let missing: Vec<&String> = dependencies
        .keys()
        .filter(|d| !d.starts_with("hydroline-") && !named.contains(&d.as_str()))
        .collect();
    assert!(
        missing.is_empty(),
        "no line in src/guide/dependencies.md says what these are for: {missing:?}"
    );
}
