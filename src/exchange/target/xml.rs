//! XML, written with indentation; text and attributes are numbers and names that need no escape.

use crate::formula::number;

/// Elements, one a line.
#[derive(Debug, Default)]
pub struct Xml {
    text: String,
    open: Vec<String>,
}

impl Xml {
    /// A text that begins with XML's declaration and a comment.
    pub fn new(comment: &[String]) -> Xml {
        // Two hyphens end a comment.
        let lines: Vec<String> = comment.iter().map(|l| l.replace("--", "- -")).collect();
        Xml {
            text: format!("<?xml version=\"1.0\"?>\n<!--\n{}\n-->\n", lines.join("\n")),
            open: Vec::new(),
        }
    }

    fn line(&mut self, text: &str) {
        self.text += &"  ".repeat(self.open.len());
        self.text += text;
        self.text.push('\n');
    }

    /// Begins an element; `head` = its name with its attributes.
    pub fn begin(&mut self, head: &str) {
        self.line(&format!("<{head}>"));
        let name = head.split(' ').next().unwrap_or(head);
        self.open.push(name.to_owned());
    }

    /// Ends the innermost element.
    pub fn end(&mut self) {
        if let Some(name) = self.open.pop() {
            self.line(&format!("</{name}>"));
        }
    }

    /// An element with a text.
    pub fn text(&mut self, name: &str, text: &str) {
        self.line(&format!("<{name}>{text}</{name}>"));
    }

    /// An element with numbers, a space between them.
    pub fn numbers(&mut self, name: &str, values: &[f64]) {
        self.text(name, &spaced(values));
    }

    /// An element without a content; `head` = its name with its attributes.
    pub fn empty(&mut self, head: &str) {
        self.line(&format!("<{head}/>"));
    }

    /// A comment.
    pub fn comment(&mut self, words: &str) {
        self.line(&format!("<!-- {} -->", words.replace("--", "- -")));
    }

    /// The whole text, every element ended.
    pub fn finish(mut self) -> String {
        while !self.open.is_empty() {
            self.end();
        }
        self.text
    }
}

/// Numbers with a space between them; a zero has no sign.
pub fn spaced(values: &[f64]) -> String {
    let each = values.iter().map(|v| number(v + 0.0));
    each.collect::<Vec<_>>().join(" ")
}
