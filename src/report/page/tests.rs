use super::*;
use crate::Colour;
use crate::figure::{Axis, Panel};
use crate::markup::tests::any_text;
use proptest::prelude::*;
use roxmltree::{Document, ParsingOptions};

fn read(html: &str) -> Document<'_> {
    let options = ParsingOptions {
        allow_dtd: true,
        ..ParsingOptions::default()
    };
    Document::parse_with_options(html, options).unwrap_or_else(|e| panic!("{e}: {html}"))
}

/// A page in which every kind of block holds `text`.
fn page_of(text: &str) -> Page {
    let mut page = Page::new(text, text);
    let b = &mut page.body;
    b.lead(text);
    b.paragraph(
        Inline::from(text)
            .strong(text)
            .emphasis(text)
            .code(text)
            .new_line()
            .warning(text),
    );
    b.section(text);
    b.subsection(text);
    b.warning(text);
    b.listing(text);
    b.section(text);
    b.list([text, text]);
    let mut table = Table::new([text, text]);
    table.row([
        Value::from(text).hint(text),
        Value::from(text).shaded(-0.4).unbroken(),
    ]);
    table.push(Row::new([Value::from(text).across(2).prose()]).warning_if(true));
    b.table(table);
    b.section(text);
    let panel = Panel::new(text, Axis::new(text), Axis::new(text)).line(
        text,
        Colour::BLUE,
        vec![[0.0, 0.0], [1.0, 1.0]],
    );
    b.figure(&Figure::stack(text, vec![panel]), text);
    let mut more = Body::default();
    more.section(text);
    b.append(more);
    page
}

#[test]
fn a_page_has_its_parts_in_order_and_its_contents() {
    let html = page_of("a < b & \"c\"").html();
    assert!(html.starts_with("<!DOCTYPE html>\n<html lang=\"en\">"));
    let document = read(&html);
    let names: Vec<&str> = document
        .descendants()
        .find(|n| n.has_tag_name("body"))
        .unwrap()
        .children()
        .filter(|n| n.is_element())
        .map(|n| n.tag_name().name())
        .collect();
    assert_eq!(
        names,
        [
            "h1", "p", "p", "nav", "h2", "h3", "p", "pre", "h2", "ul", "div", "h2", "figure", "h2"
        ]
    );
    // Every link leads to a heading.
    let ids: Vec<&str> = document
        .descendants()
        .filter_map(|n| n.attribute("id"))
        .collect();
    let links: Vec<&str> = document
        .descendants()
        .filter_map(|n| n.attribute("href"))
        .collect();
    assert_eq!(ids.len(), 4);
    assert_eq!(
        links,
        ids.iter().map(|id| format!("#{id}")).collect::<Vec<_>>()
    );
}

#[test]
fn a_page_opens_offline_and_runs_nothing() {
    let html = page_of("text").html();
    for fetched in ["http", "<script", "src=", "@import", "url(", "<link"] {
        assert!(!html.contains(fetched), "{fetched}");
    }
}

#[test]
fn the_style_reaches_the_browser_as_it_is_written() {
    assert_eq!(crate::markup::escape(STYLE), STYLE);
}

#[test]
fn a_page_is_made_for_paper_phone_and_night() {
    for query in [
        "@media print{",
        "@media screen and (max-width:760px){",
        "@media screen and (prefers-color-scheme:dark){",
    ] {
        assert!(STYLE.contains(query), "{query}");
    }
    assert!(STYLE.contains(&format!("--paper:{}", Colour::DARK_PAPER)));
    // Colours stand in the variables and, for paper, in black, white and grey alone.
    let rules = STYLE.lines().skip(2);
    for colour in rules.flat_map(|l| l.split('#').skip(1)) {
        let digits: String = colour.chars().take(3).collect();
        assert!(
            ["000", "fff", "888"].contains(&digits.as_str()),
            "#{digits}"
        );
    }
    let html = page_of("text").html();
    assert!(html.contains(&crate::colour::dark_rules()));
    assert_eq!(html.matches("<svg").count(), 2, "one broad, one narrow");
}

#[test]
fn numbers_are_not_broken_and_sentences_are() {
    let mut page = Page::new("", "");
    let mut table = Table::new(["", ""]);
    let sentence = "one word after the other, far more than a cell of numbers ever holds";
    table.row(["-250.06 .. -249.97 (profile)", sentence]);
    page.body.table(table);
    let html = page.html();
    assert!(html.contains("<td>-250.06"));
    assert!(html.contains("<td class=\"long\">one word"));
    let mut page = Page::new("", "");
    let mut table = Table::new([""; 19]);
    table.row([""; 19]);
    page.body.table(table);
    assert!(page.html().contains("<table class=\"many\">"));
    assert!(!html.contains("<table class"));
}

#[test]
fn an_empty_list_and_an_empty_table_leave_nothing() {
    let mut body = Body::default();
    body.list(Vec::<String>::new());
    body.table(Table::new(["a", "b"]));
    assert!(body.is_empty());
}

#[test]
fn elements_that_hold_nothing_have_end_tags() {
    let mut page = Page::new("", "");
    page.body.paragraph("");
    let mut table = Table::new(["", ""]);
    table.row(["", ""]);
    page.body.table(table);
    let html = page.html();
    assert!(html.contains("<p></p>") && html.contains("<td></td><td></td>"));
}

proptest! {
    #[test]
    fn any_text_makes_a_well_formed_page_and_is_read_back(text in any_text()) {
        let html = page_of(&text).html();
        let document = read(&html);
        let escaped = crate::markup::escape(&text).into_owned();
        let plain = |name: &str| {
            let node = document.descendants().find(|n| n.has_tag_name(name));
            node.and_then(|n| n.text()).unwrap_or_default().to_owned()
        };
        for name in ["h1", "title", "pre", "li", "strong", "figcaption"] {
            let again = crate::markup::escape(&plain(name)).into_owned();
            // Line ends are the reader's to change.
            let lines = |s: &str| s.replace("\r\n", "\n").replace('\r', "\n");
            prop_assert_eq!(lines(&again), lines(&escaped), "{}", name);
        }
    }
}
