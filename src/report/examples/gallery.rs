//! One page with every kind of block and of layer: `cargo run -p hydroline-report --example gallery -- DIR`
//! writes `DIR/gallery.html` and `DIR/gallery.svg`.

use hydroline_report::page::{Row, Value};
use hydroline_report::{
    Axis, Cell, Colour, Figure, Inline, Page, Panel, Table, points, significant,
};
use std::path::PathBuf;

fn main() -> std::io::Result<()> {
    let dir: PathBuf = std::env::args_os()
        .nth(1)
        .map_or_else(|| ".".into(), Into::into);
    std::fs::create_dir_all(&dir)?;
    let motion = motion();
    std::fs::write(dir.join("gallery.svg"), motion.file())?;

    let mut page = Page::new("hydroline-report: gallery", "Every kind of block");
    let b = &mut page.body;
    b.lead("The sentence that a reader must see first.");
    b.paragraph(
        Inline::from("Plain words, ")
            .strong("strong")
            .plain(", ")
            .emphasis("emphasis")
            .plain(", ")
            .code("a < b && c")
            .plain("."),
    );
    b.section("Lines, dots, bands, windows, marks");
    b.figure(
        &motion,
        "Damped motion, measured and modelled; below, what the model misses.",
    );
    b.section("Image and scatter");
    b.figure(&image(), "");
    b.section("Tables");
    let mut table = Table::new(["", "value", "sd", "unit"]);
    table.row([
        "X_u".to_owned(),
        significant(-12.3456),
        significant(0.0123),
        "kg/s".to_owned(),
    ]);
    table.push(Row::new(["X_u|u|", "-", "-", "kg/m"]).warning_if(true));
    b.table(table);
    let mut table = Table::new(["correlation", "a", "b", "c"]);
    for (name, row) in [
        ("a", [1.0, 0.4, -0.8]),
        ("b", [0.4, 1.0, 0.0]),
        ("c", [-0.8, 0.0, 1.0]),
    ] {
        let cells = row.map(|v: f64| Value::from(format!("{v:.2}")).shaded(v));
        table.push(cells.into_iter().fold(Row::new([name]), Row::cell));
    }
    b.table(table);
    b.section("Words");
    b.subsection("A list");
    b.list(["one", "two"]);
    b.warning("Something that must not be missed.");
    b.listing("[[physics]]\neffect = \"tether\"\n");
    std::fs::write(dir.join("gallery.html"), page.html())
}

/// A run of 30 s sampled at 25 Hz.
fn motion() -> Figure {
    let t: Vec<f64> = (0..750).map(|k| 0.04 * f64::from(k)).collect();
    let model: Vec<f64> = t
        .iter()
        .map(|t| 80.0 * (-0.05 * t).exp() * (0.9 * t).sin())
        .collect();
    // A residual that no random number generator is needed for.
    let noise = |k: usize| 0.4 * (12.9 * k as f64).sin() * (78.2 * k as f64).cos();
    let residual: Vec<f64> = (0..t.len())
        .map(|k| {
            if (300..340).contains(&k) {
                f64::NAN
            } else {
                noise(k)
            }
        })
        .collect();
    let measured: Vec<f64> = model.iter().zip(&residual).map(|(m, r)| m + r).collect();
    let missed: Vec<f64> = residual
        .iter()
        .zip(&t)
        .map(|(r, t)| r + 2.0 * (0.5 * t).sin())
        .collect();
    let time = || Axis::new("time [s]");
    Figure::stack(
        "motion and residuals of run a",
        vec![
            Panel::new("run a: x", time(), Axis::new("x [mm]"))
                .marks("command", vec![4.0, 16.0])
                .line("measured", Colour::GREY, points(&t, &measured))
                .line("model", Colour::BLUE, points(&t, &model)),
            Panel::new(
                "measured - model: rms 1.41 mm without, 0.20 mm with what was left out",
                time(),
                Axis::new("residual [mm]"),
            )
            .band("noise, 2 sd", Colour::GREY, [-0.5, 0.5])
            .windows(
                "more than noise",
                Colour::VERMILLION,
                vec![[2.0, 5.0], [8.0, 11.0]],
            )
            .marks("command", vec![4.0, 16.0])
            .line("without", Colour::VERMILLION, points(&t, &missed))
            .line("with", Colour::BLUE, points(&t, &residual))
            .outliers("outliers", Colour::PURPLE, vec![[7.0, -1.0], [12.0, 40.0]]),
        ],
    )
    .shared_x()
}

/// Two images side by side with their points below.
fn image() -> Figure {
    let column = |title: &str, size: f64| {
        let cells = (0..144u32)
            .map(|k| {
                let [i, j] = [f64::from(k % 12), f64::from(k / 12)];
                let value = size * (0.6 * i).sin() * (0.4 * j).cos();
                Cell {
                    from: [i * 53.0, j * 40.0],
                    to: [(i + 1.0) * 53.0, (j + 1.0) * 40.0],
                    value,
                    hint: format!("{value:+.3} px"),
                }
            })
            .filter(|c| c.value.abs() > 0.01)
            .collect();
        let dots = (0..600).map(|k| {
            let xi = f64::from(k) - 300.0;
            [xi, size * (0.02 * xi).sin() + 0.05 * (7.1 * xi).sin()]
        });
        vec![
            Panel::new(
                title,
                Axis::new("column [px]").limits([0.0, 640.0]),
                Axis::new("row [px]").limits([0.0, 480.0]).reversed(),
            )
            .equal_scale()
            .cells(cells, 0.3, "px"),
            Panel::new(
                "the same in the laser plane",
                Axis::new("\u{3be} [mm]").reversed(),
                Axis::new("\u{3b7} [mm]").limits([-0.3, 0.3]),
            )
            .height(100.0)
            .dots("measured - predicted", Colour::BLUE, dots.collect()),
        ]
    };
    Figure::new("mean residual over the image")
        .column(column("without effects", 0.3))
        .column(column(
            "with refraction at the window, entrained air and a scale of the map",
            0.1,
        ))
}
