//! Citations: every page that a comment, a string or a chapter names by its file is in this clone.

use std::path::{Path, PathBuf};

/// Pages that tests make themselves, and those that a reader's own command writes.
const MADE: [&str; 5] = [
    "T.md",
    "nowhere.md",
    "no.md",
    "src/guide/page.md",
    "effects.md",
];

/// Files with one of these endings, below a folder; what git and cargo keep there is not the repository's.
fn files(folder: &Path, endings: &[&str], found: &mut Vec<PathBuf>) {
    for entry in std::fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        let name = path.file_name().unwrap().to_string_lossy().into_owned();
        let ending = path.extension().and_then(|e| e.to_str()).unwrap_or("");
        if path.is_dir() && !path.is_symlink() && !name.starts_with('.') && name != "target" {
            files(&path, endings, found);
        } else if endings.contains(&ending) {
            found.push(path);
        }
    }
}

/// Paths of pages in a line, as they are written; none of the web's.
fn cited(line: &str) -> Vec<&str> {
    line.split(|c: char| !(c.is_alphanumeric() || "_-./:".contains(c)))
        .map(|word| word.trim_end_matches(['.', ':']))
        .filter(|word| word.ends_with(".md") && !word.contains("//"))
        .filter(|word| word.len() > ".md".len())
        .collect()
}

/// Whether a page is in the repository: from the folder of the file that cites it or one above, or from the guide's.
fn stands(page: &str, folder: &Path, root: &Path) -> bool {
    let above = folder.ancestors().take_while(|f| f.starts_with(root));
    let guide = root.join("src/guide");
    let mut folders = above.chain([guide.as_path()]);
    folders.any(|f| f.join(page).is_file()) || MADE.contains(&page)
}

#[test]
fn every_page_that_is_cited_stands_in_the_repository() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let mut sources = Vec::new();
    files(root, &["rs", "md", "toml", "proto"], &mut sources);
    // This file names pages that are not there.
    sources.retain(|source| !source.ends_with("recording/citations.rs"));
    let mut wrong = Vec::new();
    for source in &sources {
        let text = std::fs::read_to_string(source).unwrap();
        let name = source.strip_prefix(root).unwrap().display();
        let folder = source.parent().unwrap();
        for (k, line) in text.lines().enumerate() {
            let lost = cited(line).into_iter();
            let lost = lost.filter(|page| !stands(page, folder, root));
            wrong.extend(lost.map(|page| format!("{name}:{}: there is no {page}", k + 1)));
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

#[test]
fn pages_are_found_in_comments_strings_and_links() {
    let line = "// (theory/a.md, law), `a-b.md`; [c](../d.md#e) \"f.md: g\" https://x.y/z.md h.md.";
    assert_eq!(
        cited(line),
        ["theory/a.md", "a-b.md", "../d.md", "f.md", "h.md"]
    );
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let stands = |page, folder| stands(page, &root.join(folder), root);
    assert!(stands("theory/physics.md", "sim/src") && stands("physics.md", "src/guide/theory"));
    assert!(stands("stamped.md", "src/thruster/link") && stands("../../README.md", "src/guide"));
    assert!(!stands("physics.md", "sim/src") && !stands("theory/none.md", "sim/src"));
}
