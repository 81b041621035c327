//! Links within the repository: the file is there, and the heading too.

use super::session;
use std::path::Path;

/// Links of a page that lead nowhere, one sentence each. `name` is the page's path in the repository.
pub fn broken(name: &str, markdown: &str) -> Vec<String> {
    let folder = Path::new(name).parent().unwrap_or(Path::new(""));
    targets(markdown)
        .into_iter()
        .filter(|(_, target)| !target.contains("://"))
        .filter_map(|(line, target)| {
            let (path, heading) = target.split_once('#').unwrap_or((target, ""));
            let file = session::root().join(folder).join(path);
            if !path.is_empty() && !file.exists() {
                return Some(format!("{name}:{line}: {target}: there is no such file"));
            }
            if heading.is_empty() {
                return None;
            }
            let text = if path.is_empty() {
                markdown.to_owned()
            } else {
                std::fs::read_to_string(&file).unwrap_or_default()
            };
            (!anchors(&text).iter().any(|a| a == heading))
                .then(|| format!("{name}:{line}: {target}: there is no such heading"))
        })
        .collect()
}

/// `(target)` of every `[words](target)`, with its line; blocks of code have none.
fn targets(markdown: &str) -> Vec<(usize, &str)> {
    let mut found = Vec::new();
    let mut code = false;
    for (k, line) in markdown.lines().enumerate() {
        code ^= line.starts_with("```");
        if !code {
            let behind = line.split("](").skip(1);
            found.extend(behind.filter_map(|r| Some((k + 1, r.split_once(')')?.0))));
        }
    }
    found
}

/// Headings as GitHub and mdBook link to them: lower case, words joined by `-`, signs left out.
fn anchors(markdown: &str) -> Vec<String> {
    let mut code = false;
    markdown
        .lines()
        .filter(|line| {
            code ^= line.starts_with("```");
            !code && line.starts_with('#')
        })
        .map(|line| {
            line.trim_start_matches('#')
                .trim()
                .to_lowercase()
                .chars()
                .filter_map(|c| match c {
                    ' ' => Some('-'),
                    c if c.is_alphanumeric() || c == '-' || c == '_' => Some(c),
                    _ => None,
                })
                .collect()
        })
        .collect()
}

#[test]
fn links_without_file_or_heading_are_reported() {
    let page = "[a](README.md) [b](nowhere.md)\n![c](README.md#no-such-heading) [d](https://x.y/z)\n```\n[e](no.md)\n```\n# It's `here`\n[f](#its-here)\n";
    assert_eq!(
        broken("T.md", page),
        [
            "T.md:1: nowhere.md: there is no such file",
            "T.md:2: README.md#no-such-heading: there is no such heading"
        ]
    );
    assert_eq!(anchors(page), ["its-here"]);
}
