//! Build that ran: `--version`, the head of every log that it writes, and what the build script finds.

use crate::support::hydroline;
use hydroline::build_info::{BuildInfo, VERSION};
use hydroline::log::{LogReader, MetadataMap};
use std::path::Path;
use std::process::Command;

/// The build script itself: its functions are tried on checkouts made for the purpose.
#[path = "../../src/build.rs"]
#[allow(dead_code)]
mod script;

fn build() -> BuildInfo {
    BuildInfo::from_build_script(
        env!("HYDROLINE_BUILD_COMMIT"),
        env!("HYDROLINE_BUILD_DIRTY"),
    )
}

fn session(log: &Path) -> (String, MetadataMap) {
    let reader = LogReader::open(log).unwrap();
    let session = reader.metadata().get("session").cloned().unwrap();
    (reader.library().to_owned(), session)
}

#[test]
fn version_and_every_log_name_the_same_build() {
    let build = build();
    let output = hydroline().arg("--version").output().unwrap();
    let said = String::from_utf8(output.stdout).unwrap();
    assert_eq!(said, format!("hydroline {build}\n"));

    let dir = tempfile::tempdir().unwrap();
    let path = |name: &str| dir.path().join(name);
    let ran = |words: &[&str]| {
        let output = hydroline()
            .current_dir(dir.path())
            .args(words)
            .output()
            .unwrap();
        let stderr = String::from_utf8_lossy(&output.stderr).into_owned();
        assert!(
            matches!(output.status.code(), Some(0 | 3)),
            "{words:?}: {stderr}"
        );
    };
    std::fs::write(
        path("plan.toml"),
        "[[step]]\nfor_s = 0.5\nwrench = { surge_n = 4 }\n",
    )
    .unwrap();
    std::fs::write(
        path("data.csv"),
        "t,x\n0,0\n1,0.1\n2,0.2\n3,0.3\n4,0.4\n5,0.5\n",
    )
    .unwrap();
    std::fs::write(
        path("map.toml"),
        "[time]\ncolumn = \"t\"\nunit = \"s\"\n[motion.x_m]\ncolumn = \"x\"\nunit = \"m\"\n",
    )
    .unwrap();
    let _alone = crate::support::alone();
    ran(&[
        "simulate",
        "--rig",
        "lshpi",
        "--plan",
        "plan.toml",
        "--out",
        "simulated.mcap",
    ]);
    ran(&[
        "import",
        "data.csv",
        "--map",
        "map.toml",
        "--out",
        "imported.mcap",
    ]);
    ran(&[
        "record",
        "--rig",
        "lshpi",
        "--for",
        "1s",
        "--no-thrusters",
        "--out",
        "recorded.mcap",
    ]);
    ran(&["replay", "simulated.mcap", "--out", "replayed.mcap"]);
    ran(&["recover", "simulated.mcap", "--out", "mended.mcap"]);
    let keys = |prefix: &str, session: &MetadataMap| {
        for (key, value) in build.session_keys(prefix) {
            assert_eq!(session.get(&key), Some(&value), "{key}");
        }
    };
    for name in ["simulated", "imported", "recorded", "replayed"] {
        let (library, session) = session(&path(&format!("{name}.mcap")));
        assert_eq!(library, format!("hydroline {build}"), "{name}");
        keys("", &session);
        if name == "replayed" {
            keys("replay.", &session);
        }
    }
    let (library, _) = session(&path("mended.mcap"));
    assert_eq!(library, format!("hydroline {build} recover"));
}

#[test]
fn a_replay_keeps_the_build_of_its_recording() {
    use hydroline::replay::{Options, replay};
    use hydroline::simulate::simulate;
    let dir = tempfile::tempdir().unwrap();
    let [first, second] = ["a.mcap", "b.mcap"].map(|name| dir.path().join(name));
    let rig = hydroline_rigs::Rig::builtin("lshpi").unwrap();
    let plan = hydroline_rigs::Plan::from_toml(
        "[[step]]\nfor_s = 0.2\nwrench = { surge_n = 4 }\n",
        "plan.toml",
    )
    .unwrap();
    let options = hydroline::simulate::Options {
        build: BuildInfo::from_build_script("aaaaaaaaaaaa", "false"),
        ..Default::default()
    };
    simulate(&rig, &plan, &first, &options, &mut |_, _| {}).unwrap();
    let options = Options {
        build: BuildInfo::from_build_script("bbbbbbbbbbbb", "true"),
        ..Options::default()
    };
    replay(&first, &second, &options, &mut |_| {}).unwrap();
    let (library, session) = session(&second);
    assert_eq!(
        library,
        format!("hydroline {VERSION} (bbbbbbbbbbbb, dirty)")
    );
    let value = |key: &str| session[key].as_str();
    assert_eq!((value("commit"), value("dirty")), ("aaaaaaaaaaaa", "false"));
    assert_eq!(
        (value("replay.commit"), value("replay.dirty")),
        ("bbbbbbbbbbbb", "true")
    );
}

/// A checkout with one crate, one page of documentation and one commit.
fn checkout(root: &Path) {
    let file = |name: &str, text: &str| {
        let path = root.join(name);
        std::fs::create_dir_all(path.parent().unwrap()).unwrap();
        std::fs::write(path, text).unwrap();
    };
    file("Cargo.toml", "[workspace]\n");
    file("src/main.rs", "fn main() {}\n");
    file("src/room/Cargo.toml", "[package]\n");
    file("src/room/lib.rs", "//! A room.\n");
    file("src/guide/page.md", "# A page\n");
    git(root, &["init", "--quiet"]);
    git(root, &["add", "."]);
    commit(root);
}

fn commit(root: &Path) {
    git(
        root,
        &["commit", "--quiet", "--all", "--message", "as it is"],
    );
}

fn git(root: &Path, words: &[&str]) -> String {
    let output = Command::new("git")
        .args(["-c", "user.name=t", "-c", "user.email=t@example.org"])
        .args(["-c", "commit.gpgsign=false"])
        .arg("-C")
        .arg(root)
        .args(words)
        .output()
        .unwrap();
    let stderr = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "git {words:?}: {stderr}");
    String::from_utf8(output.stdout).unwrap().trim().to_owned()
}

#[test]
fn the_build_script_says_the_commit_and_what_differs_from_it() {
    if Command::new("git").arg("--version").output().is_err() {
        println!("SKIPPED: git is not installed");
        return;
    }
    let dir = tempfile::tempdir().unwrap();
    let root = dir.path();
    assert_eq!(script::of_checkout(root), None, "no checkout, no commit");
    checkout(root);
    let state = || script::of_checkout(root).unwrap();
    let head = git(root, &["rev-parse", "HEAD"]);
    let clean = state();
    assert_eq!(clean.commit, head[..12]);
    assert_eq!(clean.dirty, Some(false));
    // Paths watched are those that the flag is about, and those that every commit touches.
    for name in [
        "src/main.rs",
        "src/room",
        "Cargo.toml",
        ".git/HEAD",
        ".git/logs/HEAD",
    ] {
        let path = root.join(name);
        assert!(
            clean.watched.contains(&path),
            "{name} is not watched: {:?}",
            clean.watched
        );
    }
    assert!(
        clean.watched.iter().all(|path| path.exists()),
        "cargo takes a missing file for a changed one"
    );

    // A page of documentation is no part of the binary.
    std::fs::write(root.join("src/guide/page.md"), "# Another page\n").unwrap();
    assert_eq!(state().dirty, Some(false));
    // An edit, a new file, and either of them staged.
    std::fs::write(root.join("src/room/lib.rs"), "//! Another room.\n").unwrap();
    assert_eq!(state().dirty, Some(true));
    git(root, &["add", "."]);
    assert_eq!(state().dirty, Some(true));
    commit(root);
    let next = state();
    assert_eq!(next.dirty, Some(false));
    assert_ne!(next.commit, clean.commit);
    std::fs::write(root.join("src/room/new.rs"), "\n").unwrap();
    assert_eq!(
        state().dirty,
        Some(true),
        "a file that git does not know yet"
    );
    // Asking leaves no trace that would make cargo ask again.
    let index = || {
        std::fs::metadata(root.join(".git/index"))
            .unwrap()
            .modified()
            .unwrap()
    };
    let before = index();
    state();
    assert_eq!(index(), before);

    // Sources unpacked inside another project's checkout are not of its commit.
    let inside = root.join("vendor/hydroline");
    std::fs::create_dir_all(&inside).unwrap();
    assert_eq!(script::of_checkout(&inside), None);
    // A further worktree has a HEAD and a log of its own.
    let other = dir.path().join("other");
    git(
        root,
        &["worktree", "add", "--quiet", other.to_str().unwrap()],
    );
    let there = script::of_checkout(&other).unwrap();
    assert_eq!((there.commit, there.dirty), (next.commit, Some(false)));
    assert!(
        there
            .watched
            .iter()
            .any(|p| p.ends_with("worktrees/other/logs/HEAD")),
        "{:?}",
        there.watched
    );
}

#[test]
fn a_packager_names_the_commit() {
    let given = |text| script::given_by_packager(text).map(|s| (s.commit, s.dirty));
    let clean = Some(("4042f4f1a2b3".to_owned(), Some(false)));
    assert_eq!(given("4042f4f1a2b3"), clean);
    assert_eq!(given("4042f4f1a2b3c4d5e6f708192a3b4c5d6e7f8091\n"), clean);
    assert_eq!(
        given("4042f4f1a2b3-dirty"),
        Some(("4042f4f1a2b3".to_owned(), Some(true)))
    );
    for no_commit in ["", "v0.1.0", "abc", "4042f4f1a2b3; rm"] {
        assert_eq!(given(no_commit), None, "{no_commit}");
    }
}
