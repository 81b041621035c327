use super::layout::{NARROW_PX, WIDTH_PX, place};
use super::words::width_px;
use super::*;
use crate::markup::tests::any_text;
use proptest::prelude::*;
use roxmltree::{Document, Node};

/// The numbers of an attribute.
fn number(node: Node<'_, '_>, attribute: &str) -> f64 {
    let value = node.attribute(attribute).unwrap_or_default();
    value
        .parse()
        .unwrap_or_else(|_| panic!("{attribute}={value}: {node:?}"))
}

fn axes() -> (Axis, Axis) {
    (Axis::new("time [s]"), Axis::new("x [mm]"))
}

fn panel(title: &str) -> Panel {
    let (x, y) = axes();
    Panel::new(title, x, y)
}

fn ramp() -> Vec<[f64; 2]> {
    (0..=100)
        .map(|k| [0.1 * f64::from(k), f64::from(k)])
        .collect()
}

#[test]
fn a_panel_draws_each_kind_of_layer_and_names_it() {
    let figure = Figure::stack(
        "everything",
        vec![
            panel("a<b")
                .band("noise", Colour::GREY, [-2.0, 2.0])
                .windows(
                    "strong",
                    Colour::GREEN,
                    vec![[2.0, 3.0], [9.5, 99.0], [50.0, 60.0]],
                )
                .ribbon("sd", Colour::SKY, vec![[0.0, 0.0, 1.0], [10.0, 2.0, 9.0]])
                .marks("commands", vec![1.0, 7.0, 70.0])
                .line("model", Colour::BLUE, ramp())
                .dots("measured", Colour::GREY, vec![[1.0, 1.0], [2.0, 2.0]])
                .outliers("left out", Colour::PURPLE, vec![[3.0, 3.0], [4.0, 1e9]]),
        ],
    );
    let svg = figure.file();
    let document = Document::parse(&svg).unwrap();
    let texts: Vec<&str> = document.descendants().filter_map(|n| n.text()).collect();
    for words in [
        "a<b", "noise", "strong", "sd", "commands", "model", "measured", "left out", "time [s]",
        "x [mm]",
    ] {
        assert!(texts.contains(&words), "{words}: {texts:?}");
    }
    let count = |name: &str, attribute: &str, value: &str| {
        document
            .descendants()
            .filter(|n| n.has_tag_name(name) && n.attribute(attribute) == Some(value))
            .count()
    };
    // One of each is the legend's sample.
    let green = Colour::GREEN.to_string();
    assert_eq!(
        count("rect", "fill", &green),
        2 + 1,
        "windows off the axis are not drawn"
    );
    assert_eq!(count("line", "stroke-dasharray", "3 3"), 2 + 1);
    assert_eq!(
        count("path", "fill", &Colour::PURPLE.to_string()),
        1 + 1 + 1,
        "the dot inside, its sample, and the arrow to the one outside"
    );
    assert!(!svg.contains("NaN") && !svg.contains("inf"));
}

/// Every kind of layer in every colour.
fn of_all_kinds() -> Figure {
    let cell = |value: f64| Cell {
        from: [value, 0.0],
        to: [value + 1.0, 1.0],
        value,
        hint: String::new(),
    };
    let series = (0..6).fold(panel("series"), |p, k| {
        let colour = Colour::series(k);
        p.line("line", colour, ramp())
            .dots("dots", colour, vec![[1.0, 1.0]])
    });
    Figure::new("")
        .column(vec![
            series
                .line("measured", Colour::GREY, ramp())
                .marks("commands", vec![1.0])
                .band("noise", Colour::GREY, [-1.0, 1.0])
                .ribbon("sd", Colour::SKY, vec![[0.0, 0.0, 1.0], [9.0, 0.0, 1.0]]),
            panel("empty"),
        ])
        .column(vec![panel("cells").cells(
            vec![cell(-1.0), cell(0.0), cell(1.0)],
            1.0,
            "px",
        )])
}

#[test]
fn no_colour_of_a_figure_is_fixed() {
    let figure = of_all_kinds();
    let file = figure.file();
    for svg in [
        figure.element().to_string(),
        figure.narrow().to_string(),
        file.clone(),
    ] {
        let document = Document::parse(&svg).unwrap();
        for node in document.descendants().filter(Node::is_element) {
            for (attribute, kind) in [("fill", "f-"), ("stroke", "s-")] {
                let Some(colour) = node.attribute(attribute).filter(|c| *c != "none") else {
                    continue;
                };
                let class = node.attribute("class").unwrap_or_default();
                assert!(colour.starts_with('#'), "viewers without CSS: {colour}");
                assert!(class.starts_with(kind), "{attribute} {colour}: {node:?}");
                assert!(crate::colour::dark_rules().contains(&format!(".{class}{{")));
            }
        }
    }
    assert!(file.contains("prefers-color-scheme:dark"));
    assert!(!file.contains("var("), "viewers without variables");
}

#[test]
fn on_a_phone_columns_stand_one_below_the_other() {
    let figure = of_all_kinds();
    let (broad, narrow) = (place(&figure, WIDTH_PX).0, place(&figure, NARROW_PX).0);
    let titled = |placed: &[layout::Placed<'_>], title: &str| {
        let found = placed.iter().find(|p| p.panel.title == title).unwrap();
        (found.cell_left_px, found.top_px)
    };
    assert!(titled(&broad, "cells").0 > 0.5 * NARROW_PX);
    let (left, top) = titled(&narrow, "cells");
    assert!(left == 0.0 && top > titled(&narrow, "empty").1);
}

#[test]
fn a_name_wider_than_a_phone_takes_two_lines() {
    let name = "what a long vehicle alone, refitted to all runs, leaves of it";
    let figure = Figure::stack("", vec![panel("a").line(name, Colour::BLUE, ramp())]);
    assert!(figure.element().to_string().contains(name));
    let narrow = figure.narrow().to_string();
    assert!(!narrow.contains(name) && narrow.contains("what a long") && narrow.contains("of it"));
    for (at, words) in boxes(&narrow) {
        assert!(at[2] <= NARROW_PX, "{words}: {at:?}");
    }
}

#[test]
fn a_value_stands_where_its_axis_says() {
    let (x, y) = axes();
    let figure = Figure::stack(
        "",
        vec![
            Panel::new("", x.limits([0.0, 10.0]), y.limits([-1.0, 1.0])).line(
                "",
                Colour::BLACK,
                vec![[0.0, -1.0], [5.0, 0.0], [10.0, 1.0]],
            ),
        ],
    );
    let (placed, _) = place(&figure, WIDTH_PX);
    let [[left, top], [right, bottom]] = placed[0].area;
    let expected = format!(
        "M{:.1} {:.1}L{:.1} {:.1}L{:.1} {:.1}",
        left,
        bottom,
        0.5 * (left + right),
        0.5 * (top + bottom),
        right,
        top
    )
    .replace(".0", "");
    assert!(
        figure.file().contains(&expected),
        "{expected}: {}",
        figure.file()
    );
    for tick in &placed[0].y_ticks {
        let [_, y] = placed[0].scales.unwrap();
        let share = (tick.value + 1.0) / 2.0;
        assert!((y.px(tick.value) - (bottom + share * (top - bottom))).abs() < 1e-9);
    }
}

#[test]
fn one_abscissa_is_written_once_and_spans_all() {
    let figure = Figure::stack(
        "",
        vec![
            panel("upper").line("", Colour::BLUE, ramp()),
            panel("lower").line("", Colour::BLUE, vec![[-5.0, 0.0], [3.0, 1.0]]),
        ],
    )
    .shared_x();
    let svg = figure.file();
    assert_eq!(svg.matches("time [s]").count(), 1);
    assert_eq!(svg.matches("x [mm]").count(), 2);
    let (placed, _) = place(&figure, WIDTH_PX);
    let at = |k: usize, v: f64| placed[k].scales.unwrap()[0].px(v);
    assert_eq!(at(0, -5.0), placed[0].area[0][0]);
    assert_eq!(at(0, 3.0), at(1, 3.0));
    assert_eq!(at(1, 10.0), placed[1].area[1][0]);
}

#[test]
fn an_image_is_drawn_at_equal_scale_with_its_rows_downwards() {
    let cell = Cell {
        from: [0.0, 0.0],
        to: [64.0, 48.0],
        value: 0.5,
        hint: "+0.5 px".to_owned(),
    };
    let figure = Figure::new("").column(vec![
        Panel::new(
            "image",
            Axis::new("column [px]").limits([0.0, 640.0]),
            Axis::new("row [px]").limits([0.0, 480.0]).reversed(),
        )
        .equal_scale()
        .cells(vec![cell], 0.5, "px"),
    ]);
    let svg = figure.file();
    let (placed, _) = place(&figure, WIDTH_PX);
    let [[left, top], [right, bottom]] = placed[0].area;
    assert!(((right - left) / (bottom - top) - 640.0 / 480.0).abs() < 1e-9);
    let document = Document::parse(&svg).unwrap();
    let drawn = document
        .descendants()
        .find(|n| n.has_tag_name("rect") && n.children().any(|c| c.has_tag_name("title")))
        .unwrap();
    assert_eq!(
        drawn.attribute("fill"),
        Some(Colour::ABOVE.to_string().as_str())
    );
    assert_eq!(drawn.attribute("fill-opacity"), Some("1"));
    assert!((number(drawn, "x") - left).abs() < 1e-3 && (number(drawn, "y") - top).abs() < 1e-3);
    assert!((number(drawn, "width") - 0.1 * (right - left)).abs() < 1e-3);
    assert!((number(drawn, "height") - 0.1 * (bottom - top)).abs() < 1e-3);
    // The scale of colours says what its ends are.
    assert!(svg.contains(">-0.5<") && svg.contains(">+0.5 px<"));
}

#[test]
fn nothing_finite_is_said_and_not_left_blank() {
    for panel in [
        panel("none"),
        panel("nan").line("gone", Colour::BLUE, vec![[0.0, f64::NAN]]),
        panel("marks").marks("commands", vec![1.0]),
    ] {
        let svg = Figure::stack("", vec![panel]).file();
        assert!(svg.contains("no finite value to draw"));
        assert!(!svg.contains("gone"), "the legend names only what is drawn");
        Document::parse(&svg).unwrap();
    }
}

/// Boxes of all upright texts \[px\]: left, top, right, bottom.
fn boxes(svg: &str) -> Vec<([f64; 4], String)> {
    let document = Document::parse(svg).unwrap();
    document
        .descendants()
        .filter(|n| n.has_tag_name("text") && n.attribute("transform").is_none())
        .map(|n| {
            let words = n.text().unwrap_or_default();
            let size = number(n, "font-size");
            let bold = n.attribute("font-weight").map_or(1.0, |_| words::BOLD);
            let width = bold * width_px(words, size);
            let (x, y) = (number(n, "x"), number(n, "y"));
            let left = match n.attribute("text-anchor") {
                Some("middle") => x - 0.5 * width,
                Some("end") => x - width,
                _ => x,
            };
            (
                [left, y - 0.8 * size, left + width, y + 0.2 * size],
                words.to_owned(),
            )
        })
        .collect()
}

fn overlap(a: [f64; 4], b: [f64; 4]) -> bool {
    let slack = 0.5;
    a[0] + slack < b[2] && b[0] + slack < a[2] && a[1] + slack < b[3] && b[1] + slack < a[3]
}

fn layers(panel: Panel, names: &[String], points: &[[f64; 2]]) -> Panel {
    names
        .iter()
        .enumerate()
        .fold(panel, |p, (k, name)| match k % 3 {
            0 => p.line(name, Colour::series(k), points.to_vec()),
            1 => p.dots(name, Colour::series(k), points.to_vec()),
            _ => p.band(name, Colour::series(k), [-1.0, 1.0]),
        })
}

proptest! {
    #[test]
    fn no_two_words_overlap_and_none_is_off_the_drawing(
        title in "[a-z]{1,9}( [a-zA-Z0-9]{1,12}){0,14}",
        names in prop::collection::vec("[a-z]{1,8}( [a-z]{1,8}){0,4}", 0..7),
        low in -1e4..1e4f64,
        span in 1e-4..1e5f64,
        columns in 1usize..3,
        rows in 1usize..3,
    ) {
        let points = [[0.0, low], [0.37 * span, low + span]];
        let one = || layers(panel(&title), &names, &points);
        let mut figure = Figure::new("");
        for _ in 0..columns {
            figure = figure.column((0..rows).map(|_| one()).collect());
        }
        for svg in [figure.element().to_string(), figure.narrow().to_string()] {
            let document = Document::parse(&svg).map_err(|e| TestCaseError::fail(e.to_string()))?;
            let (width, height) = (number(document.root_element(), "width"), number(document.root_element(), "height"));
            let all = boxes(&svg);
            for (k, (a, words)) in all.iter().enumerate() {
                prop_assert!(a[0] >= 0.0 && a[2] <= width && a[1] >= 0.0 && a[3] <= height, "{words}: {a:?}");
                for (b, other) in &all[k + 1..] {
                    prop_assert!(!overlap(*a, *b), "{words:?} {a:?} and {other:?} {b:?}");
                }
            }
        }
    }

    #[test]
    fn any_numbers_and_any_text_make_a_well_formed_drawing(
        values in prop::collection::vec(prop::array::uniform2(proptest::num::f64::ANY), 0..30),
        limits in prop::array::uniform2(proptest::num::f64::ANY),
        text in any_text(),
    ) {
        let other: Vec<f64> = values.iter().map(|v| v[0]).collect();
        let cells = values.iter().map(|v| Cell {
            from: *v,
            to: [v[1], v[0]],
            value: v[0],
            hint: text.clone(),
        });
        let full = |axis: Axis| {
            Panel::new(text.as_str(), axis, Axis::new(text.as_str()))
                .line(&text, Colour::BLUE, values.clone())
                .dots(&text, Colour::BLUE, values.clone())
                .outliers(&text, Colour::BLUE, values.clone())
                .ribbon(&text, Colour::BLUE, values.iter().map(|v| [v[0], v[1], v[0]]).collect())
                .windows(&text, Colour::BLUE, values.clone())
                .marks(&text, other.clone())
        };
        let figure = Figure::new(text.as_str())
            .column(vec![
                full(Axis::new(text.as_str())),
                full(Axis::new(text.as_str()).limits(limits).reversed()).band(&text, Colour::GREY, limits),
            ])
            .column(vec![full(Axis::new("")).equal_scale().cells(cells.collect(), limits[0], &text)]);
        for figure in [figure.clone(), figure.shared_x()] {
            let svg = figure.file();
            let document = Document::parse(&svg).map_err(|e| TestCaseError::fail(format!("{e}: {svg}")))?;
            for node in document.descendants() {
                for attribute in node.attributes().filter(|a| a.name() != "aria-label") {
                    prop_assert!(
                        !attribute.value().contains("NaN") && !attribute.value().contains("inf"),
                        "{:?}", attribute
                    );
                }
            }
        }
    }
}
