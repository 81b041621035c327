use super::*;
use proptest::prelude::*;

/// Text of any characters, those that no file may hold included.
pub(crate) fn any_text() -> impl Strategy<Value = String> {
    prop::collection::vec(any::<char>(), 0..40).prop_map(String::from_iter)
}

#[test]
fn the_five_characters_of_markup_are_replaced_and_nothing_else() {
    assert_eq!(
        escape("a < b && \"c\" > 'd' \u{b1} \u{3be}\n"),
        "a &lt; b &amp;&amp; &quot;c&quot; &gt; &#39;d&#39; \u{b1} \u{3be}\n"
    );
    assert!(matches!(escape("plain words"), Cow::Borrowed(_)));
    assert_eq!(escape("\0\u{8}\u{ffff}"), "\u{fffd}\u{fffd}\u{fffd}");
}

#[test]
fn an_element_that_is_no_shape_has_an_end_tag() {
    assert_eq!(Element::new("td").to_string(), "<td></td>");
    assert_eq!(Element::closed("br").to_string(), "<br/>");
    let nested = Element::closed("rect")
        .number("x", -0.0001)
        .class("a")
        .child(Element::new("title").text("<"));
    assert_eq!(
        nested.to_string(),
        "<rect class=\"a\" x=\"0\"><title>&lt;</title></rect>"
    );
}

#[test]
fn what_cannot_be_placed_is_left_out() {
    for bad in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
        let shape = Element::closed("circle").number("r", bad);
        assert!(!shape.drawable);
        let group = Element::new("g").child(shape.clone()).child_line(shape);
        assert_eq!(group.to_string(), "<g></g>");
    }
}

proptest! {
    #[test]
    fn no_raw_character_of_markup_is_left_of_any_text(text in any_text()) {
        let escaped = escape(&text);
        prop_assert!(!escaped.contains(['<', '>', '"', '\'']));
        // Every ampersand begins an entity.
        for (at, _) in escaped.match_indices('&') {
            let known = ["&amp;", "&lt;", "&gt;", "&quot;", "&#39;"];
            prop_assert!(known.iter().any(|e| escaped[at..].starts_with(e)));
        }
    }

    #[test]
    fn an_xml_reader_reads_back_what_was_put_in(text in any_text()) {
        let element = Element::new("g").with("a", &text).text(&text).to_string();
        let read = roxmltree::Document::parse(&element).map_err(|e| {
            TestCaseError::fail(format!("{element:?}: {e}"))
        })?;
        let allowed = |c: char| match c {
            '\0'..'\u{20}' if !"\t\n\r".contains(c) => '\u{fffd}',
            '\u{fffe}' | '\u{ffff}' => '\u{fffd}',
            c => c,
        };
        // Line ends and the white space of attributes are the reader's to change: XML 1.0, 2.11 and 3.3.3.
        let lines = |s: &str| s.replace("\r\n", "\n").replace('\r', "\n");
        let flat = |s: &str| lines(s).replace(['\t', '\n'], " ");
        let put_in: String = text.chars().map(allowed).collect();
        let root = read.root_element();
        prop_assert_eq!(lines(root.text().unwrap_or_default()), lines(&put_in));
        prop_assert_eq!(root.attribute("a").map(flat), Some(flat(&put_in)));
    }
}
