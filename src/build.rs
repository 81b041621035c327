//! Commit that the binary is built from, for `--version` and the head of every log.
//!
//! Sets `HYDROLINE_BUILD_COMMIT` (12 hexadecimal digits, or `unknown`) and `HYDROLINE_BUILD_DIRTY` (`true`, `false`,
//! `unknown`) for this package alone: the rooms get it by injection, and a commit makes none of them anew.
//!
//! **Dirty** = something that the binary is made of (the crates' sources, the manifests) differs from the commit, a
//! new file included. Exactly these paths are watched, so a flag that was right when it was set is set anew before it
//! could be wrong; a changed page of documentation or test makes the binary neither dirty nor old. Watched for the
//! commit are HEAD and its log, which grows with each commit, checkout and reset. The index is not: nothing that is
//! said here depends on what is staged, and every `git status` may touch it.
//!
//! A packager without a checkout sets `HYDROLINE_COMMIT` (`4042f4f1a2b3`, or `4042f4f1a2b3-dirty`), which wins.
//! Without it, without git or outside this project's own checkout: `unknown`.

use std::path::{Path, PathBuf};
use std::process::Command;

/// Environment variable in which a packager may name the commit.
const GIVEN: &str = "HYDROLINE_COMMIT";
const UNKNOWN: &str = "unknown";
/// Digits of a commit that are said: enough for a million commits.
const DIGITS: usize = 12;

fn main() {
    println!("cargo::rerun-if-env-changed={GIVEN}");
    let root = std::env::var_os("CARGO_MANIFEST_DIR").map_or_else(PathBuf::new, PathBuf::from);
    let given = std::env::var(GIVEN).ok();
    let state = given
        .as_deref()
        .and_then(given_by_packager)
        .or_else(|| of_checkout(&root));
    // A build script that names no file is run whenever any file of the package changes.
    println!("cargo::rerun-if-changed=src/build.rs");
    let (commit, dirty) = match &state {
        Some(state) => (state.commit.as_str(), state.dirty),
        None => (UNKNOWN, None),
    };
    for path in state.iter().flat_map(|s| &s.watched) {
        println!("cargo::rerun-if-changed={}", path.display());
    }
    println!("cargo::rustc-env=HYDROLINE_BUILD_COMMIT={commit}");
    let dirty = dirty.map_or(UNKNOWN.to_owned(), |d| d.to_string());
    println!("cargo::rustc-env=HYDROLINE_BUILD_DIRTY={dirty}");
}

/// A commit, whether the sources differ from it, and the files on which both depend.
#[derive(Debug, PartialEq, Eq)]
pub struct State {
    /// First digits of the commit.
    pub commit: String,
    /// `None` = git would not say.
    pub dirty: Option<bool>,
    /// Files and folders whose change makes this old.
    pub watched: Vec<PathBuf>,
}

/// Commit and dirty flag that the packager gives; `None` unless it is a commit.
pub fn given_by_packager(text: &str) -> Option<State> {
    let (commit, dirty) = match text.trim().strip_suffix("-dirty") {
        Some(commit) => (commit, true),
        None => (text.trim(), false),
    };
    let is_commit = commit.len() >= 7 && commit.chars().all(|c| c.is_ascii_hexdigit());
    is_commit.then(|| State {
        commit: commit.chars().take(DIGITS).collect(),
        dirty: Some(dirty),
        watched: Vec::new(),
    })
}

/// State of the checkout whose top is `root`, as git gives it.
pub fn of_checkout(root: &Path) -> Option<State> {
    // Sources unpacked inside somebody else's checkout are not of that one's commit.
    let top = PathBuf::from(git(root, &["rev-parse", "--show-toplevel"])?);
    if top.canonicalize().ok()? != root.canonicalize().ok()? {
        return None;
    }
    let commit: String = git(root, &["rev-parse", "HEAD"])?
        .chars()
        .take(DIGITS)
        .collect();
    let sources = sources(root);
    let mut question = vec!["status", "--porcelain", "--untracked-files=normal", "--"];
    question.extend(sources.iter().map(String::as_str));
    let dirty = git(root, &question).map(|changes| !changes.is_empty());
    let mut watched: Vec<PathBuf> = sources.iter().map(|s| root.join(s)).collect();
    let own = |name: &str| -> Option<PathBuf> {
        let path = root.join(git(root, &["rev-parse", "--git-path", name])?);
        // Cargo takes a file that is not there for one that has changed, at every build.
        path.exists().then_some(path)
    };
    watched.extend(own("HEAD"));
    match own("logs/HEAD") {
        Some(log) => watched.push(log),
        // No log is kept: the branch itself, the packed ones, and the index, which each commit writes.
        None => {
            let branch = git(root, &["symbolic-ref", "--quiet", "HEAD"]);
            watched.extend(branch.and_then(|branch| own(&branch)));
            watched.extend(["packed-refs", "index"].into_iter().filter_map(own));
        }
    }
    Some(State {
        commit,
        dirty,
        watched,
    })
}

/// Paths that the binary is made of, relative to `root`: the folders that are crates, the facade, manifests and toolchain.
fn sources(root: &Path) -> Vec<String> {
    let crates_in = |folder: &str| -> Vec<String> {
        let entries = std::fs::read_dir(root.join(folder)).into_iter().flatten();
        let names = entries.flatten().filter_map(|entry| {
            let is_crate = entry.path().join("Cargo.toml").is_file();
            is_crate.then(|| format!("{folder}{}", entry.file_name().to_string_lossy()))
        });
        names.collect()
    };
    let mut all = crates_in("");
    all.extend(crates_in("src/"));
    let files = [
        "Cargo.toml",
        "Cargo.lock",
        "rust-toolchain.toml",
        ".cargo",
        "src/build.rs",
        "src/lib.rs",
        "src/main.rs",
    ];
    all.extend(
        files
            .iter()
            .filter(|name| root.join(name).exists())
            .map(|name| (*name).to_owned()),
    );
    all.sort();
    all
}

/// One question to git, with its answer; `None` when it has none, or when there is no git.
fn git(root: &Path, question: &[&str]) -> Option<String> {
    let output = Command::new("git")
        // Asking writes nothing: not even what git has learnt of the files' times.
        .env("GIT_OPTIONAL_LOCKS", "0")
        .arg("-C")
        .arg(root)
        .args(question)
        .output()
        .ok()?;
    if !output.status.success() {
        return None;
    }
    Some(String::from_utf8(output.stdout).ok()?.trim().to_owned())
}
