//! Report of an identification as one self-contained HTML page: one sentence first, then the coefficients, the runs
//! measured and fitted, what the residuals hold, and what these runs cannot show.

mod figures;
mod sentence;

use std::collections::BTreeMap;

use super::outcome::{BudgetLine, Estimate, Identification, Trace};
use hydroline_numerics::statistics::Whiteness;
use hydroline_report::page::{Row, Value};
use hydroline_report::{Body, Inline, Page, Table, significant};

/// The page; `command` is what made it.
pub fn html(result: &Identification, command: &str) -> String {
    let mut page = Page::new(
        format!("hydroline identify: {}", result.model),
        format!("Identification: {}", result.model),
    );
    let b = &mut page.body;
    b.lead(sentence::sentence(result));
    let priors = match result.flat_priors {
        true => "maximum likelihood",
        false => "beside the rig's numbers as prior",
    };
    let method = Inline::from(format!("{} fits, {priors}", result.fits));
    b.paragraph(method.plain(". ").code(command));
    for words in &result.misfit {
        b.warning(words);
    }
    if let Some(words) = result.held() {
        b.paragraph(words);
    }
    coefficients(b, result);
    budget(b, result);
    runs(b, result);
    noise(b, result);
    correlations(b, result);
    validation(b, result);
    b.section("Not identifiable");
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

/// Runs with enough measured of them for a figure.
fn drawn(result: &Identification) -> Vec<&Trace> {
    let measured = |t: &&Trace| t.measured.iter().filter(|v| v.is_finite()).count() >= 2;
    result.traces.iter().filter(measured).collect()
}

/// Channels in the order of the traces, each with its runs.
fn channels<'a>(traces: &[&'a Trace]) -> Vec<(&'a str, Vec<&'a Trace>)> {
    let mut channels: Vec<(&str, Vec<&Trace>)> = Vec::new();
    for trace in traces {
        match channels.iter_mut().find(|(name, _)| *name == trace.channel) {
            Some((_, runs)) => runs.push(trace),
            None => channels.push((&trace.channel, vec![trace])),
        }
    }
    channels
}

fn runs(b: &mut Body, result: &Identification) {
    let traces = drawn(result);
    if traces.is_empty() {
        return;
    }
    b.section("Runs");
    b.paragraph("Each run measured and fitted, what the fit leaves of it, and the commanded load.");
    for trace in &traces {
        b.figure(&figures::run(trace), "");
    }
    let channels = channels(&traces);
    let several: Vec<_> = channels.iter().filter(|(_, runs)| runs.len() > 1).collect();
    if !several.is_empty() {
        b.section("All runs over each other");
        for (channel, runs) in several {
            b.figure(&figures::overlaid(channel, runs), "");
        }
    }
    b.section("Residual autocorrelation");
    b.paragraph("Of residuals that are white noise, 19 of 20 lags stay within the band. A slow decline is what the model lacks, or coloured noise; the tests below tell which.");
    for (channel, runs) in &channels {
        if let Some(figure) = figures::whiteness(channel, runs) {
            b.figure(&figure, "");
        }
    }
}

fn coefficients(b: &mut Body, result: &Identification) {
    b.section("Coefficients");
    let mut table = Table::new([
        "",
        "value",
        "sd (samples)",
        "95 % interval (samples)",
        "U95 (all)",
        "most of it",
        "rig",
        "unit",
    ]);
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
                number(p.u95),
                p.largest_share.clone().unwrap_or_else(|| "-".to_owned()),
                significant(p.rig),
                p.unit.clone(),
            ])
            .warning_if(!p.excited),
        );
    }
    b.table(table);
}

/// Sources of uncertainty, with what each does to each coefficient, and their sum.
fn budget(b: &mut Body, result: &Identification) {
    if result.budget.is_empty() {
        return;
    }
    b.section("Uncertainty budget");
    b.paragraph("Standard uncertainty of each coefficient by each source (JCGM 100:2008), in the coefficient's unit. A source of type B is a number that the fit takes as known; combined is the root of the sum of squares.");
    let keys = || result.order.iter().cloned();
    let head = ["source", "type", "sd", "basis"].map(str::to_owned);
    let last = ["reduced by".to_owned()];
    let mut table = Table::new(head.into_iter().chain(keys()).chain(last));
    for line in &result.budget {
        let head = [
            line.source.clone(),
            line.kind.clone(),
            sd_of(line),
            line.basis.clone(),
        ];
        let cells = head
            .into_iter()
            .chain(shares(result, &line.contributions))
            .chain([line.reduce.clone()]);
        table.row(cells);
    }
    let mut sum = |name: &str, of: fn(&Estimate) -> Option<f64>| {
        let all = keys().map(|key| result.parameters.get(&key).and_then(of));
        let each = all.map(|v| v.map_or("-".to_owned(), significant));
        let head = [name.to_owned(), String::new(), String::new(), String::new()];
        table.row(head.into_iter().chain(each).chain([String::new()]));
    };
    sum("combined", |p| p.combined_sd);
    sum("U95", |p| p.u95);
    if result.parameters.values().any(|p| p.repeat_sd.is_some()) {
        sum("beside it: samples, by repeats of a plan", |p| p.repeat_sd);
    }
    b.table(table);
    let with_unit = |l: &&BudgetLine| !l.sensitivities.is_empty();
    let lines: Vec<&BudgetLine> = result.budget.iter().filter(with_unit).collect();
    if lines.is_empty() {
        return;
    }
    b.paragraph("Sensitivities: change of each coefficient by one unit of the source.");
    let head = ["source", "unit"].map(str::to_owned);
    let mut table = Table::new(head.into_iter().chain(keys()));
    for line in lines {
        let head = [line.source.clone(), line.unit.clone()];
        table.row(head.into_iter().chain(shares(result, &line.sensitivities)));
    }
    b.table(table);
}

/// sd of a source with its unit; the unit alone where it has none.
fn sd_of(line: &BudgetLine) -> String {
    line.sd.map_or_else(
        || line.unit.clone(),
        |sd| format!("{} {}", significant(sd), line.unit),
    )
}

/// A number of each coefficient, in the result's order.
fn shares(result: &Identification, of: &BTreeMap<String, f64>) -> Vec<String> {
    let each = result.order.iter();
    each.map(|key| of.get(key).copied().map_or("-".to_owned(), significant))
        .collect()
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
        "times that at rest",
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
            n.over_rest.map_or("-".to_owned(), |r| format!("{r:.2}")),
            n.logged.map_or("-".to_owned(), |l| {
                format!(
                    "{:.2} ({:.2e} .. {:.2e})",
                    l.scale, l.least_sd, l.greatest_sd
                )
            }),
        ]);
    }
    b.table(table);
    let mut table = Table::new(["residuals", "rms", "Ljung-Box p", "lag 1", "p after colour"]);
    let p = |w: Option<Whiteness>| w.map_or("-".to_owned(), |w| format!("{:.2e}", w.p_value));
    for r in &result.residuals {
        table.row([
            format!("{} {}", r.run, r.slot),
            format!("{:.3e}", r.rms),
            p(r.plain),
            r.plain.map_or("-".to_owned(), |w| format!("{:.2}", w.lag1)),
            p(r.filtered),
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
