//! What an identification found, as one self-contained HTML page.

use super::outcome::{Identification, Trace};
use hydroline_numerics::statistics::Whiteness;
use hydroline_report::page::{Row, Value};
use hydroline_report::{
    Axis, Body, Colour, Figure, Inline, Page, Panel, Quantity, Table, points, significant,
};

/// Heights of a run's panels \[px\].
const FIT_PX: f64 = 180.0;
const RESIDUAL_PX: f64 = 80.0;

/// The page; `command` is what made it.
pub fn html(result: &Identification, command: &str) -> String {
    let mut page = Page::new(
        format!("hydroline identify: {}", result.model),
        format!("Identification: {}", result.model),
    );
    let b = &mut page.body;
    let mut method = Inline::from(format!(
        "Method {}, {} evaluations",
        result.method, result.evaluations
    ));
    if !result.converged {
        method = method.plain(" ").warning("(not converged)");
    }
    b.paragraph(method.plain(". ").code(command));
    for words in &result.misfit {
        b.warning(words);
    }
    coefficients(b, result);
    correlations(b, result);
    noise(b, result);
    b.section("Runs");
    for trace in &result.traces {
        if trace.measured.iter().filter(|v| v.is_finite()).count() >= 2 {
            b.figure(&run(trace), "");
        }
    }
    validation(b, result);
    b.section("Blind spots");
    b.list(result.blind_spots.iter().map(|spot| {
        Inline::new()
            .strong(&spot.what)
            .plain(format!(": {}. To break it: {}", spot.why, spot.experiment))
    }));
    let of_runs = result.runs.iter().flat_map(|r| &r.notes);
    let remarks: Vec<&String> = result.notes.iter().chain(of_runs).collect();
    if !remarks.is_empty() {
        b.section("Remarks");
        b.list(remarks);
    }
    page.html()
}

fn coefficients(b: &mut Body, result: &Identification) {
    b.section("Coefficients");
    let mut table = Table::new(["", "value", "sd", "95 % interval", "rig", "unit"]);
    let number = |v: Option<f64>| v.map_or("-".to_owned(), significant);
    for p in result
        .order
        .iter()
        .filter_map(|key| result.parameters.get(key))
    {
        let how = if p.profile.is_some() {
            " (profile)"
        } else {
            ""
        };
        table.push(
            Row::new([
                p.symbol.clone(),
                significant(p.value),
                number(p.sd),
                format!("{} .. {}{how}", number(p.low), number(p.high)),
                significant(p.rig),
                p.unit.clone(),
            ])
            .warning_if(!p.excited),
        );
    }
    b.table(table);
}

fn correlations(b: &mut Body, result: &Identification) {
    b.section("Correlations");
    let mut table = Table::new(std::iter::once("").chain(result.order.iter().map(String::as_str)));
    for (key, row) in result.order.iter().zip(&result.correlation) {
        let cells = row
            .iter()
            .map(|v| Value::from(format!("{v:.2}")).shaded(*v));
        table.push(cells.fold(Row::new([key]), Row::cell));
    }
    b.table(table);
}

fn noise(b: &mut Body, result: &Identification) {
    b.section("Noise");
    let mut table = Table::new([
        "",
        "white sd",
        "coloured sd",
        "correlation [s]",
        "outliers",
        "from",
        "times the logged sd",
    ]);
    for (slot, n) in &result.noise {
        table.row([
            slot.clone(),
            format!("{:.3e}", n.noise.white_sd),
            format!("{:.3e}", n.noise.coloured_sd),
            format!("{:.3}", n.noise.correlation_s),
            format!("{:.2} %", 100.0 * n.outliers),
            n.source.clone(),
            n.logged.map_or("-".to_owned(), |l| {
                format!(
                    "{:.2} ({:.2e} .. {:.2e})",
                    l.scale, l.least_sd, l.greatest_sd
                )
            }),
        ]);
    }
    b.table(table);
    let mut table = Table::new([
        "residuals",
        "rms",
        "Ljung-Box p",
        "lag 1",
        "p after colour",
        "p beside rest",
    ]);
    let p = |w: Option<Whiteness>| w.map_or("-".to_owned(), |w| format!("{:.2e}", w.p_value));
    for r in &result.residuals {
        table.row([
            format!("{} {}", r.run, r.slot),
            format!("{:.3e}", r.rms),
            p(r.plain),
            r.plain.map_or("-".to_owned(), |w| format!("{:.2}", w.lag1)),
            p(r.filtered),
            p(r.at_rest),
        ]);
    }
    b.table(table);
}

fn validation(b: &mut Body, result: &Identification) {
    if result.cross_validation.is_empty() {
        return;
    }
    b.section("Each run predicted by the others");
    let mut table = Table::new(["run", "channel", "rms left out", "rms fitted"]);
    for cv in &result.cross_validation {
        for (channel, rms) in &cv.left_out {
            let fitted = cv.fitted.get(channel);
            table.row([
                cv.run.clone(),
                channel.clone(),
                format!("{rms:.3e}"),
                fitted.map_or("-".to_owned(), |rms| format!("{rms:.3e}")),
            ]);
        }
    }
    b.table(table);
}

/// A run's channel, measured and fitted, and below it what the fit leaves.
fn run(trace: &Trace) -> Figure {
    let quantity = Quantity::of(&trace.channel);
    let time = || Axis::new("time [s]");
    let title = format!("{}: {}", trace.run, trace.channel);
    let over_time = |values: &[f64]| points(&trace.times_s, &quantity.shown(values));
    let residual: Vec<f64> = trace
        .measured
        .iter()
        .zip(&trace.fitted)
        .map(|(m, f)| m - f)
        .collect();
    Figure::stack(
        format!("{title}, measured, fitted and their difference over time"),
        vec![
            Panel::new(&title, time(), Axis::new(quantity.axis()))
                .height(FIT_PX)
                .line("measured", Colour::GREY, over_time(&trace.measured))
                .line("fitted", Colour::BLUE, over_time(&trace.fitted)),
            Panel::new(
                "measured - fitted",
                time(),
                Axis::new(quantity.with_unit("residual")),
            )
            .height(RESIDUAL_PX)
            .line("", Colour::BLUE, over_time(&residual)),
        ],
    )
    .shared_x()
}
