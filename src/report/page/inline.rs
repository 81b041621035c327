//! A run of words, some of them marked.

use crate::markup::Element;

/// Words of a paragraph, a list's entry or a cell of a table.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Inline {
    parts: Vec<Part>,
}

#[derive(Debug, Clone, PartialEq, Eq)]
struct Part {
    words: String,
    /// The element that marks it, and its class.
    mark: Option<(&'static str, &'static str)>,
}

impl Inline {
    /// No words yet.
    pub fn new() -> Self {
        Inline::default()
    }

    /// Plain words.
    #[must_use]
    pub fn plain(self, words: impl Into<String>) -> Self {
        self.part(words, None)
    }

    /// Subject of the sentence, in bold.
    #[must_use]
    pub fn strong(self, words: impl Into<String>) -> Self {
        self.part(words, Some(("strong", "")))
    }

    /// A source, a term that is introduced.
    #[must_use]
    pub fn emphasis(self, words: impl Into<String>) -> Self {
        self.part(words, Some(("em", "")))
    }

    /// A command, a key, a value as it is typed.
    #[must_use]
    pub fn code(self, words: impl Into<String>) -> Self {
        self.part(words, Some(("code", "")))
    }

    /// Words that warn.
    #[must_use]
    pub fn warning(self, words: impl Into<String>) -> Self {
        self.part(words, Some(("span", "warning")))
    }

    /// Begins a new line.
    #[must_use]
    pub fn new_line(self) -> Self {
        self.part("", Some(("br", "")))
    }

    /// Whether it shows nothing.
    pub fn is_empty(&self) -> bool {
        self.parts.is_empty()
    }

    fn part(
        mut self,
        words: impl Into<String>,
        mark: Option<(&'static str, &'static str)>,
    ) -> Self {
        let words = words.into();
        if !words.is_empty() || mark == Some(("br", "")) {
            self.parts.push(Part { words, mark });
        }
        self
    }

    /// Length of its longest line \[characters\].
    pub(super) fn longest(&self) -> usize {
        let lines = self.parts.split(|p| p.mark == Some(("br", "")));
        let length = |line: &[Part]| line.iter().map(|p| p.words.chars().count()).sum();
        lines.map(length).max().unwrap_or(0)
    }

    pub(super) fn within(self, name: &'static str) -> Element {
        self.parts
            .iter()
            .fold(Element::new(name), |outer, part| match part.mark {
                None => outer.text(&part.words),
                Some(("br", _)) => outer.child(Element::closed("br")),
                Some((mark, "")) => outer.child(Element::new(mark).text(&part.words)),
                Some((mark, class)) => {
                    outer.child(Element::new(mark).class(class).text(&part.words))
                }
            })
    }
}

impl From<&str> for Inline {
    fn from(words: &str) -> Self {
        Inline::new().plain(words)
    }
}

impl From<String> for Inline {
    fn from(words: String) -> Self {
        Inline::new().plain(words)
    }
}

impl From<&String> for Inline {
    fn from(words: &String) -> Self {
        Inline::new().plain(words.as_str())
    }
}
