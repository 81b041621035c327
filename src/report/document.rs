//! A report that is written once: sentences and tables, to a terminal and to a page.

use crate::page::{Body, Inline, Page, Table};

/// Spaces between two columns of a table on a terminal.
const BETWEEN: usize = 2;

/// Part of a document.
#[derive(Debug, Clone, PartialEq, Eq)]
enum Part {
    Section(String),
    Words(String),
    Warning(String),
    Table {
        head: Vec<String>,
        rows: Vec<Vec<String>>,
    },
}

/// Sentences and tables, in order.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Document {
    title: String,
    lead: String,
    parts: Vec<Part>,
}

impl Document {
    /// A document by its title, and the sentence that a reader must see first.
    pub fn new(title: impl Into<String>, lead: impl Into<String>) -> Self {
        Self {
            title: title.into(),
            lead: lead.into(),
            parts: Vec::new(),
        }
    }

    /// Begins a section.
    pub fn section(&mut self, heading: impl Into<String>) {
        self.parts.push(Part::Section(heading.into()));
    }

    /// A sentence or more.
    pub fn words(&mut self, words: impl Into<String>) {
        self.parts.push(Part::Words(words.into()));
    }

    /// Words that warn.
    pub fn warning(&mut self, words: impl Into<String>) {
        self.parts.push(Part::Warning(words.into()));
    }

    /// A table; nothing where it has no row. A row that is too short ends in empty cells.
    pub fn table<H: Into<String>>(
        &mut self,
        head: impl IntoIterator<Item = H>,
        rows: Vec<Vec<String>>,
    ) {
        if rows.is_empty() {
            return;
        }
        let head: Vec<String> = head.into_iter().map(Into::into).collect();
        let whole = rows.into_iter().map(|mut row| {
            row.resize(head.len(), String::new());
            row
        });
        let rows = whole.collect();
        self.parts.push(Part::Table { head, rows });
    }

    /// As a terminal shows it. The first column begins at the left, the others end at the right.
    pub fn text(&self) -> String {
        let mut text = format!("{}\n{}\n", self.title, self.lead);
        for part in &self.parts {
            match part {
                Part::Section(heading) => text.push_str(&format!("\n{heading}\n")),
                Part::Words(words) => text.push_str(&format!("{words}\n")),
                Part::Warning(words) => text.push_str(&format!("WARNING: {words}\n")),
                Part::Table { head, rows } => text.push_str(&columns(head, rows)),
            }
        }
        text
    }

    /// As a page shows it.
    pub fn page(&self) -> Page {
        let mut page = Page::new(&*self.title, &*self.title);
        page.body.lead(&*self.lead);
        for part in &self.parts {
            put(&mut page.body, part);
        }
        page
    }
}

fn put(body: &mut Body, part: &Part) {
    match part {
        Part::Section(heading) => body.section(heading),
        Part::Words(words) => body.paragraph(words),
        Part::Warning(words) => body.warning(words),
        Part::Table { head, rows } => {
            let mut table = Table::new(head.iter().map(Inline::from));
            for row in rows {
                table.row(row.iter().map(Inline::from));
            }
            body.table(table);
        }
    }
}

fn columns(head: &[String], rows: &[Vec<String>]) -> String {
    let length = |cell: &String| cell.chars().count();
    let widths: Vec<usize> = (0..head.len())
        .map(|k| {
            let cells = rows.iter().map(|row| length(&row[k]));
            cells.chain([length(&head[k])]).max().unwrap_or(0)
        })
        .collect();
    let mut text = String::new();
    for row in std::iter::once(head).chain(rows.iter().map(Vec::as_slice)) {
        let mut line = String::new();
        for (k, cell) in row.iter().enumerate() {
            let air = " ".repeat(widths[k] - length(cell));
            match k {
                0 => line.push_str(&format!("{cell}{air}")),
                _ => line.push_str(&format!("{}{air}{cell}", " ".repeat(BETWEEN))),
            }
        }
        text.push_str(line.trim_end());
        text.push('\n');
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_terminal_and_a_page_say_the_same() {
        let mut document = Document::new("A and B", "Two of three differ.");
        document.section("Coefficients");
        let rows = vec![
            vec!["X_u".to_owned(), "−20".to_owned(), "1 < 2".to_owned()],
            vec!["Y_v".to_owned(), "−3.25".to_owned()],
        ];
        document.table(["", "A", "B"], rows);
        document.table(["nothing"], Vec::new());
        document.warning("not independent");
        assert_eq!(
            document.text(),
            "A and B\nTwo of three differ.\n\nCoefficients\n         A      B\nX_u    −20  1 < 2\nY_v  −3.25\nWARNING: not independent\n"
        );
        let html = document.page().html();
        for words in [
            "<h2",
            "Coefficients",
            "1 &lt; 2",
            "−3.25",
            "not independent",
        ] {
            assert!(html.contains(words), "{words}");
        }
    }
}
