//! The fenced blocks of a Markdown file, and the comment above a block that says what a test does with it.
//!
//! On the line before a fence (readers of the page do not see it):
//!
//! | comment | the block |
//! |---|---|
//! | `<!-- run: SESSION -->` | is run by bash in the session's folder, after the session's earlier blocks |
//! | `<!-- prints: SESSION; numbers within 1 % -->` | is what the session's last block printed (stdout and stderr, as on a terminal) |
//! | `<!-- file: SESSION/NAME; numbers within 1 % -->` | stands in that file of the session's folder |
//! | `<!-- elsewhere: SCRIPT, SCRIPT -->` | is run by these scripts of the repository: every program of it stands in one of them |
//!
//! `file` also stands above a picture, which then is that file. A line `...` in a `prints` or `file` block stands for
//! any lines, `...` at the end of a line for the rest of it.

/// The `language` of a marked picture.
pub const PICTURE: &str = "picture";

/// Role of a block in its session.
#[derive(Debug, Clone, PartialEq)]
pub enum Mark {
    /// Run it.
    Run,
    /// The last run block of the session printed it.
    Prints {
        /// Largest relative difference of a number.
        tolerance: f64,
    },
    /// A file of the session's folder holds it.
    File {
        /// Path within that folder.
        name: String,
        /// Largest relative difference of a number.
        tolerance: f64,
    },
    /// Other scripts run it; in place of a session their paths, with commas between.
    Elsewhere,
}

/// A fenced block.
#[derive(Debug, Clone, PartialEq)]
pub struct Block {
    /// Line of the file that is the block's first, from 1.
    pub line: usize,
    /// The word behind the fence (`sh`, `toml`, ...), or [`PICTURE`].
    pub language: String,
    /// Its lines; of a picture the path, from the page.
    pub text: String,
    /// Session and what to do, where a comment says so.
    pub mark: Option<(String, Mark)>,
}

impl Block {
    /// Whether it holds commands of a shell, whatever the word behind its fence.
    pub fn is_commands(&self) -> bool {
        matches!(self.language.as_str(), "sh" | "bash" | "shell" | "console")
            || (matches!(self.language.as_str(), "" | "text")
                && self.text.lines().any(|line| {
                    ["hydroline ", "$ ", "cargo ", "tests/"]
                        .iter()
                        .any(|begin| line.trim_start().starts_with(begin))
                }))
    }

    /// The programs that it calls, by their names: the first word of each command.
    pub fn programs(&self) -> Vec<&str> {
        self.text
            .lines()
            .map(|line| line.split(" #").next().unwrap_or(""))
            .flat_map(|line| line.split([';', '|', '&']))
            .filter_map(|command| command.split_whitespace().next())
            .collect()
    }
}

/// Lines of commands outside of a fence, from 1: a renderer shows them as code where they are indented by four.
pub fn indented_commands(markdown: &str) -> Vec<usize> {
    let mut inside = false;
    let mut found = Vec::new();
    for (k, line) in markdown.lines().enumerate() {
        inside ^= line.starts_with("```");
        if !inside && line.starts_with("    ") && line.trim_start().starts_with("hydroline ") {
            found.push(k + 1);
        }
    }
    found
}

/// All fenced blocks of a file and its marked pictures; `file` names it in errors.
///
/// # Errors
/// A fence that is not closed, or a comment above one that is none of those above, with its line.
pub fn blocks(markdown: &str, file: &str) -> Result<Vec<Block>, String> {
    let mut found: Vec<Block> = Vec::new();
    let mut open: Option<Block> = None;
    let mut before = "";
    for (k, line) in markdown.lines().enumerate() {
        match (&mut open, line.strip_prefix("```")) {
            (None, Some(language)) => {
                open = Some(Block {
                    line: k + 2,
                    language: language.trim().to_owned(),
                    text: String::new(),
                    mark: mark(before).map_err(|e| format!("{file}:{k}: {e}"))?,
                });
            }
            (Some(_), Some("")) => found.extend(open.take()),
            (Some(block), _) => {
                block.text.push_str(line);
                block.text.push('\n');
            }
            (None, None) => {
                let path = line
                    .strip_prefix("![")
                    .and_then(|l| l.split_once("](")?.1.strip_suffix(')'));
                let mark = mark(before).map_err(|e| format!("{file}:{k}: {e}"));
                if let (Some(path), Some(mark)) = (path, path.map_or(Ok(None), |_| mark)?) {
                    found.push(Block {
                        line: k + 1,
                        language: PICTURE.to_owned(),
                        text: path.to_owned(),
                        mark: Some(mark),
                    });
                }
            }
        }
        before = line;
    }
    match open {
        Some(block) => Err(format!(
            "{file}:{}: this block has no end (```)",
            block.line - 1
        )),
        None => Ok(found),
    }
}

/// Reads the line above a fence; `None` when it is no comment.
fn mark(line: &str) -> Result<Option<(String, Mark)>, String> {
    let Some(words) = line
        .trim()
        .strip_prefix("<!--")
        .and_then(|l| l.strip_suffix("-->"))
    else {
        return Ok(None);
    };
    let unknown = || {
        format!(
            "'{}' above a block: write `run: SESSION`, `prints: SESSION; numbers within 1 %`, `file: SESSION/NAME; numbers within 1 %` or `elsewhere: SCRIPT`",
            words.trim()
        )
    };
    let (what, rest) = words.trim().split_once(": ").ok_or_else(unknown)?;
    let (session, tolerance) = match rest.split_once("; ") {
        Some((session, allowed)) => {
            let percent = allowed
                .strip_prefix("numbers within ")
                .and_then(|a| a.strip_suffix(" %"))
                .and_then(|a| a.parse::<f64>().ok())
                .filter(|p| (0.0..100.0).contains(p))
                .ok_or_else(unknown)?;
            (session, Some(percent / 100.0))
        }
        None => (rest, None),
    };
    let mark = match (what, tolerance) {
        ("run", None) => (session.to_owned(), Mark::Run),
        ("elsewhere", None) => (session.to_owned(), Mark::Elsewhere),
        ("prints", Some(tolerance)) => (session.to_owned(), Mark::Prints { tolerance }),
        ("file", Some(tolerance)) => {
            let (session, name) = session.split_once('/').ok_or_else(unknown)?;
            let name = name.to_owned();
            (session.to_owned(), Mark::File { name, tolerance })
        }
        _ => return Err(unknown()),
    };
    Ok(Some(mark))
}

#[test]
fn blocks_come_with_their_marks_and_lines() {
    let text = "# T\n<!-- run: a -->\n```sh\nls\n```\n\n<!-- prints: a; numbers within 2 % -->\n```text\nx 1\n```\n<!-- file: a/b.toml; numbers within 0.5 % -->\n```toml\nk = 1\n```\n```sh\nnot run\n```\n![no mark](a.png)\n<!-- file: a/c.svg; numbers within 1 % -->\n![words](data/c.svg)\n";
    let found = blocks(text, "T.md").unwrap();
    let marks: Vec<_> = found.iter().map(|b| b.mark.clone()).collect();
    let a = || "a".to_owned();
    assert_eq!(
        marks,
        [
            Some((a(), Mark::Run)),
            Some((a(), Mark::Prints { tolerance: 0.02 })),
            Some((
                a(),
                Mark::File {
                    name: "b.toml".to_owned(),
                    tolerance: 0.005
                }
            )),
            None,
            Some((
                a(),
                Mark::File {
                    name: "c.svg".to_owned(),
                    tolerance: 0.01
                }
            )),
        ]
    );
    let picture = &found[4];
    assert_eq!(
        (picture.language.as_str(), picture.text.as_str()),
        (PICTURE, "data/c.svg")
    );
    assert_eq!((found[0].line, found[0].text.as_str()), (4, "ls\n"));
}

#[test]
fn commands_are_seen_behind_any_fence() {
    let text = "```\nhydroline info x\n```\n<!-- elsewhere: a/b, c -->\n```sh\nls x; cd y   # z; w\n```\n```text\nF = m a\n```\n\n    hydroline info y\n";
    let found = blocks(text, "T.md").unwrap();
    let commands: Vec<bool> = found.iter().map(Block::is_commands).collect();
    assert_eq!(commands, [true, true, false]);
    assert_eq!(found[1].mark, Some(("a/b, c".to_owned(), Mark::Elsewhere)));
    assert_eq!(found[1].programs(), ["ls", "cd"]);
    assert_eq!(indented_commands(text), [12]);
}

#[test]
fn a_mark_that_nobody_understands_is_an_error_with_its_line() {
    for bad in [
        "<!-- rnu: a -->",
        "<!-- prints: a -->",
        "<!-- prints: a; within 1 -->",
        "<!-- file: found.toml; numbers within 1 % -->",
    ] {
        let error = blocks(&format!("T\n{bad}\n```sh\nls\n```\n"), "T.md").unwrap_err();
        assert!(error.starts_with("T.md:2: "), "{error}");
    }
    assert!(
        blocks("```sh\nls\n", "T.md")
            .unwrap_err()
            .contains("no end")
    );
}
