//! No private language: the words of `tests/words.toml` stand in no name, comment, help text, report or chapter.

use regex_lite::{Regex, RegexBuilder};
use std::path::{Path, PathBuf};

struct Word {
    pattern: String,
    instead: String,
}

/// Names that stay, and the words.
fn list(root: &Path) -> (Vec<String>, Vec<Word>) {
    let text = std::fs::read_to_string(root.join("tests/words.toml")).unwrap();
    let table: toml::Table = toml::from_str(&text).unwrap();
    let text = |v: &toml::Value| v.as_str().unwrap().to_owned();
    let words = table["word"].as_array().unwrap().iter().map(|w| Word {
        pattern: text(&w["pattern"]),
        instead: text(&w["use"]),
    });
    let keep = table["keep"].as_array().unwrap();
    (keep.iter().map(text).collect(), words.collect())
}

/// Where the words do not count: what was generated, the list's own test, and third parties' texts.
const LEFT: [&str; 3] = ["v4l2-sys", "generated", "words.rs"];

fn files(folder: &Path, found: &mut Vec<PathBuf>) {
    let Ok(entries) = std::fs::read_dir(folder) else {
        return;
    };
    for path in entries.map(|e| e.unwrap().path()) {
        let name = path.file_name().unwrap_or_default().to_string_lossy();
        if name.starts_with('.') || name == "target" || LEFT.contains(&&*name) {
            continue;
        }
        if path.is_dir() {
            files(&path, found);
        } else if matches!(path.extension(), Some(e) if e == "rs" || e == "md") {
            found.push(path);
        }
    }
}

/// A text without the names that stay, its names parted into their words; its lines are as many.
fn parted(keep: &[String], text: &str) -> String {
    let kept = keep.iter().fold(text.to_owned(), |t, k| t.replace(k, ""));
    // An underscore parts the words of a name, and the case of a letter those of a type's.
    let (mut words, mut before) = (String::with_capacity(kept.len()), ' ');
    for c in kept.chars() {
        if c.is_uppercase() && before.is_lowercase() {
            words.push(' ');
        }
        words.push(if c == '_' { ' ' } else { c });
        before = c;
    }
    words
}

/// Hits of a pattern in a text that was parted: lines from 1.
fn hits(pattern: &Regex, parted: &str) -> Vec<usize> {
    if !pattern.is_match(parted) {
        return Vec::new();
    }
    let lines = parted.lines().enumerate();
    let found = lines.filter(|(_, line)| pattern.is_match(line));
    found.map(|(k, _)| k + 1).collect()
}

fn compiled(word: &Word) -> Regex {
    let pattern = word.pattern.replace("[ _]", " ");
    RegexBuilder::new(&format!(r"\b(?:{pattern})\b"))
        .case_insensitive(true)
        .build()
        .unwrap_or_else(|e| panic!("tests/words.toml: {}: {e}", word.pattern))
}

#[test]
fn only_the_fields_words_are_used() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let (keep, list) = list(root);
    let mut all = Vec::new();
    files(root, &mut all);
    assert!(
        all.len() > 500,
        "only {} files: is this the clone?",
        all.len()
    );
    let texts = all.iter().map(|f| {
        let text = std::fs::read_to_string(f).unwrap();
        (f, parted(&keep, &text), text)
    });
    let texts: Vec<(&PathBuf, String, String)> = texts.collect();
    let mut wrong = Vec::new();
    for word in &list {
        let pattern = compiled(word);
        for (file, parted, text) in &texts {
            for line in hits(&pattern, parted) {
                let words = text.lines().nth(line - 1).unwrap_or_default().trim();
                let file = file.strip_prefix(root).unwrap_or(file).display();
                wrong.push(format!(
                    "{file}:{line}: {words}\n    write: {}",
                    word.instead
                ));
            }
        }
    }
    println!(
        "{} patterns, {} files, {} hits",
        list.len(),
        all.len(),
        wrong.len()
    );
    assert!(
        wrong.is_empty(),
        "{}\n{} hits",
        wrong.join("\n"),
        wrong.len()
    );
}

#[test]
fn a_word_is_found_in_names_and_sentences_and_a_kept_name_is_not() {
    let word = Word {
        pattern: "blind[ _]spots?".to_owned(),
        instead: String::new(),
    };
    let keep = ["blind_spots".to_owned()];
    let found = |text: &str| !hits(&compiled(&word), &parted(&keep, text)).is_empty();
    assert!(found("a Blind spot of it"));
    assert!(found("fn the_blind_spot_is_named() {"));
    assert!(found("struct BlindSpot {"));
    assert!(!found("`blind_spots` in the JSON"));
    assert!(!found("blindness"));
}
