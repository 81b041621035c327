//! Runs the blocks of a page as a reader would, in a folder outside the checkout, and compares what comes out with the page.

use super::blocks::{Block, Mark, PICTURE, blocks};
use super::printed::compare;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

/// Shell code before every block. 3 means that frames were lost: a loaded machine may be too slow to render in real time,
/// and says so, and so does `doctor` of such a log. Every other code but 0 ends the block.
const PRELUDE: &str = r#"
exec 2>&1
set -euo pipefail
hydroline() {
  local code=0
  command hydroline "$@" || code=$?
  [ $code = 0 ] && return 0
  case "$1/$code" in record/3 | demo/3 | doctor/3) return 0 ;; esac
  printf 'exit code %s: hydroline %s\n' "$code" "$*"
  return $code
}
"#;

/// Longest time for a block \[s\]; a command that hangs ends the test.
const BLOCK_WITHIN_S: &str = "3600";

/// Replacement of a page's words in a test, because a test has neither hardware nor hands nor minutes.
#[derive(Debug, Clone, Copy)]
pub struct Substitution {
    /// Words of a block.
    pub from: &'static str,
    /// Words in their place.
    pub to: &'static str,
    /// The page's own words that tell the reader of this.
    pub said: &'static str,
}

/// The page `file` of the repository.
pub fn page(file: &str) -> String {
    std::fs::read_to_string(root().join(file)).unwrap_or_else(|e| panic!("{file}: {e}"))
}

/// The repository.
pub fn root() -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR"))
}

/// The commands of a session of a page, block by block.
pub fn commands(file: &str, session: &str) -> Vec<String> {
    let found = blocks(&page(file), file).unwrap_or_else(|e| panic!("{e}"));
    let is_run = |b: &Block| matches!(&b.mark, Some((s, Mark::Run)) if s == session);
    found.into_iter().filter(is_run).map(|b| b.text).collect()
}

/// Runs all blocks of a session of a page in turn and compares what the page says of them; `folder` begins empty or with
/// what a person would bring.
pub fn play(file: &str, session: &str, folder: &Path, substitutions: &[Substitution]) {
    let text = page(file);
    let found = blocks(&text, file).unwrap_or_else(|e| panic!("{e}"));
    let blocks: Vec<(&Block, &Mark)> = found
        .iter()
        .filter_map(|b| b.mark.as_ref().map(|(s, mark)| (b, s, mark)))
        .filter_map(|(b, s, mark)| (s == session).then_some((b, mark)))
        .collect();
    let commands = commands(file, session);
    assert!(!commands.is_empty(), "{file}: no `<!-- run: {session} -->`");
    for s in substitutions {
        assert!(
            commands.iter().any(|c| c.contains(s.from)),
            "{file}: no command of '{session}' has '{}' any more",
            s.from
        );
        assert!(
            one_line(&text).contains(s.said),
            "{file} does not say any more: '{}'",
            s.said
        );
    }
    let mut printed = String::new();
    for (block, mark) in blocks {
        let at = format!("{file}:{}", block.line);
        let (result, of) = match mark {
            Mark::Elsewhere => continue,
            Mark::Run => {
                printed = run(&substituted(&block.text, substitutions), folder, &at);
                continue;
            }
            Mark::Prints { tolerance } => (
                compare(&block.text, &printed, *tolerance, false),
                printed.clone(),
            ),
            Mark::File { name, tolerance } => {
                let made = folder.join(name);
                let text =
                    std::fs::read_to_string(&made).unwrap_or_else(|e| panic!("{at}: {name}: {e}"));
                if block.language == PICTURE {
                    same_picture(file, &block.text, &text, *tolerance)
                        .unwrap_or_else(|e| panic!("{at}: {name}: {e}"));
                    continue;
                }
                (compare(&block.text, &text, *tolerance, true), text)
            }
        };
        if let Err(words) = result {
            panic!("{at}: {words}\n--- all of it:\n{of}");
        }
    }
}

/// Checks that a page's picture is the one drawn; else the one drawn is left beside the target folder's other files.
fn same_picture(page: &str, picture: &str, drawn: &str, tolerance: f64) -> Result<(), String> {
    let path = root()
        .join(page)
        .parent()
        .unwrap_or(Path::new(""))
        .join(picture);
    let shown = std::fs::read_to_string(&path).map_err(|e| format!("{}: {e}", path.display()))?;
    // An element a line, so that the one that differs is named.
    let elements = |svg: &str| svg.replace("><", ">\n<");
    compare(&elements(&shown), &elements(drawn), tolerance, false).map_err(|words| {
        let short: String = words.chars().take(400).collect();
        let left = PathBuf::from(env!("CARGO_TARGET_TMPDIR")).join("picture-as-drawn.svg");
        match std::fs::write(&left, drawn) {
            Ok(()) => format!(
                "{short}\nif the new picture is right: cp {} {}",
                left.display(),
                path.display()
            ),
            Err(e) => format!("{short}\n({}: {e})", left.display()),
        }
    })
}

fn substituted(commands: &str, substitutions: &[Substitution]) -> String {
    substitutions
        .iter()
        .fold(commands.to_owned(), |text, s| text.replace(s.from, s.to))
}

/// A page's words without its line breaks.
fn one_line(text: &str) -> String {
    text.split_whitespace().collect::<Vec<_>>().join(" ")
}

/// Output of the commands in bash, with the built binary first in PATH.
pub fn run(commands: &str, folder: &Path, at: &str) -> String {
    let binary = PathBuf::from(env!("CARGO_BIN_EXE_hydroline"));
    let path = std::env::join_paths(binary.parent().map(Path::to_owned).into_iter().chain(
        std::env::split_paths(&std::env::var_os("PATH").unwrap_or_default()),
    ))
    .unwrap();
    let output = Command::new("timeout")
        .args([BLOCK_WITHIN_S, "bash", "-c"])
        .arg(format!("{PRELUDE}\n{commands}"))
        .current_dir(folder)
        .env("PATH", path)
        .env("XDG_DATA_HOME", folder.join("data-home"))
        .env("HYDROLINE_REPOSITORY", root())
        .env_remove("RUST_LOG")
        .stdin(Stdio::null())
        .output()
        .unwrap_or_else(|e| panic!("{at}: bash: {e}"));
    let printed = String::from_utf8_lossy(&output.stdout).into_owned();
    assert!(
        output.status.success(),
        "{at}: {}\n--- run:\n{commands}--- printed:\n{printed}{}",
        output.status,
        String::from_utf8_lossy(&output.stderr)
    );
    printed
}
