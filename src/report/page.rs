//! Pages: one self-contained HTML file with head, style, contents, sections, tables, lists and figures.
//!
//! A page follows its reader: on a phone figures are the narrow ones and tables scroll in their own box, on a dark
//! screen colours turn, on paper all is black on white.
//!
//! The file is also well-formed XML, so that any reader of either can take it in.

mod inline;
mod table;
#[cfg(test)]
mod tests;

pub use inline::Inline;
pub use table::{Row, Table, Value};

use crate::colour;
use crate::figure::Figure;
use crate::markup::Element;

const STYLE: &str = include_str!("page/page.css");
/// From so many sections on, a page begins with its contents.
const CONTENTS_FROM: usize = 4;

/// A page.
#[derive(Debug, Clone)]
pub struct Page {
    title: String,
    heading: Inline,
    /// Blocks of the page, in order.
    pub body: Body,
}

/// Blocks of a page, or of a part of it that another module wrote.
#[derive(Debug, Clone, Default)]
pub struct Body {
    blocks: Vec<Block>,
}

#[derive(Debug, Clone)]
enum Block {
    Section(Inline),
    Other(Element),
}

impl Page {
    /// A page with the title of its window and its heading.
    pub fn new(title: impl Into<String>, heading: impl Into<Inline>) -> Self {
        Page {
            title: title.into(),
            heading: heading.into(),
            body: Body::default(),
        }
    }

    /// The file.
    pub fn html(&self) -> String {
        let head = Element::new("head")
            .child(Element::closed("meta").with("charset", "utf-8"))
            .child(
                Element::closed("meta")
                    .with("name", "viewport")
                    .with("content", "width=device-width, initial-scale=1"),
            )
            .child(Element::new("title").text(&self.title))
            // Holds no character that is escaped, which its test holds it to.
            .child(Element::new("style").text(STYLE))
            .child(Element::new("style").text(&colour::dark_rules()));
        let mut body = Element::new("body").child_line(self.heading.clone().within("h1"));
        let blocks = &self.body.blocks;
        let first_section = blocks.iter().position(|b| matches!(b, Block::Section(_)));
        let mut section = 0;
        for (index, block) in blocks.iter().enumerate() {
            if Some(index) == first_section
                && let Some(contents) = self.body.contents()
            {
                body.push_line(contents);
            }
            match block {
                Block::Section(words) => {
                    section += 1;
                    body.push_line(words.clone().within("h2").with("id", anchor(section)));
                }
                Block::Other(element) => body.push_line(element.clone()),
            }
        }
        let html = Element::new("html")
            .with("lang", "en")
            .child_line(head)
            .child_line(body);
        format!("<!DOCTYPE html>\n{html}\n")
    }
}

/// Name of the `number`-th section, counted from 1, within its page.
fn anchor(number: usize) -> String {
    format!("section-{number}")
}

impl Body {
    /// Begins a section.
    pub fn section(&mut self, heading: impl Into<Inline>) {
        self.blocks.push(Block::Section(heading.into()));
    }

    /// Begins a part of a section.
    pub fn subsection(&mut self, heading: impl Into<Inline>) {
        self.put(heading.into().within("h3"));
    }

    /// The sentence that a reader must see first.
    pub fn lead(&mut self, words: impl Into<Inline>) {
        self.put(words.into().within("p").class("lead"));
    }

    /// A paragraph.
    pub fn paragraph(&mut self, words: impl Into<Inline>) {
        self.put(words.into().within("p"));
    }

    /// A paragraph that warns.
    pub fn warning(&mut self, words: impl Into<Inline>) {
        self.put(words.into().within("p").class("warning"));
    }

    /// Text as it stands in a file.
    pub fn listing(&mut self, text: &str) {
        self.put(Element::new("pre").text(text));
    }

    /// A list; nothing where it has no entry.
    pub fn list(&mut self, entries: impl IntoIterator<Item = impl Into<Inline>>) {
        let mut list = Element::new("ul");
        let mut any = false;
        for entry in entries {
            any = true;
            list.push_line(entry.into().within("li"));
        }
        if any {
            self.put(list);
        }
    }

    /// A table; nothing where it has no row.
    pub fn table(&mut self, table: Table) {
        if let Some(element) = table.element() {
            self.put(Element::new("div").class("wide").child_line(element));
        }
    }

    /// A figure, with words below it where there are any.
    pub fn figure(&mut self, figure: &Figure, caption: impl Into<Inline>) {
        let caption = caption.into();
        // One of the two is shown: letters that a phone shrinks to a third are not read.
        let drawn = |class, svg| Element::new("div").class(class).child_line(svg);
        let mut element = Element::new("figure")
            .child_line(drawn("broad", figure.element()))
            .child_line(drawn("narrow", figure.narrow()));
        if !caption.is_empty() {
            element.push_line(caption.within("figcaption"));
        }
        self.put(element);
    }

    /// Adds what another module wrote.
    pub fn append(&mut self, other: Body) {
        self.blocks.extend(other.blocks);
    }

    /// Nothing was said.
    pub fn is_empty(&self) -> bool {
        self.blocks.is_empty()
    }

    fn put(&mut self, element: Element) {
        self.blocks.push(Block::Other(element));
    }

    /// Links to the sections, where there are enough of them.
    fn contents(&self) -> Option<Element> {
        let headings: Vec<&Inline> = self
            .blocks
            .iter()
            .filter_map(|b| match b {
                Block::Section(words) => Some(words),
                Block::Other(_) => None,
            })
            .collect();
        if headings.len() < CONTENTS_FROM {
            return None;
        }
        let mut contents = Element::new("nav");
        for (number, words) in (1..).zip(headings) {
            let link = words.clone().within("a");
            contents.push_line(link.with("href", format_args!("#{}", anchor(number))));
        }
        Some(contents)
    }
}
