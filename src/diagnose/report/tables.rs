//! The page's tables and lists.

use std::collections::BTreeMap;

use hydroline_report::page::{Row, Value as Cell};
use hydroline_report::{Body, Inline, Quantity, Table, significant};
use hydroline_sim::effect::find;

use crate::verdict::{Law, Value, Verdict};
use hydroline_identify::parameter::Coefficient;

fn amount(channel: &str, value: f64) -> String {
    Quantity::of(channel).amount(value)
}

fn amounts(values: &BTreeMap<String, f64>) -> String {
    values
        .iter()
        .map(|(c, v)| format!("{c} {}", amount(c, *v)))
        .collect::<Vec<_>>()
        .join(", ")
}

fn with_sd(value: &Value) -> String {
    value.sd.map_or_else(
        || format!("{} (not determined)", significant(value.value)),
        |sd| format!("{} ± {}", significant(value.value), significant(sd)),
    )
}

pub(super) fn fit(b: &mut Body, v: &Verdict) {
    let mut rows = Table::new(["rms", "before", "after", "noise"]);
    let train = v.fit.train.rows("fitted");
    for p in train.chain(v.predicted()) {
        let of = |x: Option<f64>| x.map_or("-".to_owned(), |x| amount(p.channel, x));
        rows.row([
            format!("{} ({})", p.channel, p.by),
            amount(p.channel, p.before),
            of(p.after),
            of(p.noise),
        ]);
    }
    b.table(rows);
    if !v.test.statistic.is_empty() {
        let white: Vec<String> = v
            .test
            .whiteness_p
            .iter()
            .map(|p| format!("{p:.2}"))
            .collect();
        b.paragraph(format!(
            "Is there a mismatch at all? {}: {:.1} with {} degrees of freedom, p = {:.1e}. Whiteness of what is left (Ljung-Box p per run): {}.",
            v.test.statistic,
            v.test.value,
            v.test.freedom,
            v.test.p_value,
            white.join(", ")
        ));
    }
}

/// Runs held out that are beyond the band of the likeliest model; nothing where there is none.
pub(super) fn contradictions(b: &mut Body, v: &Verdict) {
    if v.contradicted_by.is_empty() {
        return;
    }
    b.section("Held out, and missed");
    b.warning("These runs miss their prediction by more than noise and what the model's numbers leave open: they contradict the verdict.");
    let mut table = Table::new([
        "run",
        "channel",
        "rms",
        "expected",
        "p",
        "beyond the runs fitted",
    ]);
    for c in &v.contradicted_by {
        table.push(
            Row::new([&c.log, &c.channel])
                .cell(amount(&c.channel, c.rms))
                .cell(amount(&c.channel, c.band))
                .cell(format!("{:.1e}", c.p_value))
                .cell(Cell::from(&c.outside).prose()),
        );
    }
    b.table(table);
    b.paragraph("What a run has beyond those fitted is where the model was not asked before. Fitted too, it counts (see the remarks).");
}

pub(super) fn effects(b: &mut Body, v: &Verdict) {
    b.section("What was left out");
    if v.effects.is_empty() {
        b.paragraph("No effect is established.");
        return;
    }
    let mut table = Table::new([
        "effect",
        "probability",
        "weight (rms)",
        "matters",
        "law",
        "parameters",
    ]);
    for e in &v.effects {
        let info = find(&e.effect);
        let unit = |name: &str| {
            info.and_then(|i| i.parameters.iter().find(|p| p.name == name))
                .map_or("", |p| p.unit)
        };
        let parameters = e
            .parameters
            .iter()
            .map(|(n, p)| format!("{n} = {} {}", with_sd(p), unit(n)))
            .chain(e.words.iter().map(|(n, w)| format!("{n} = {w}")))
            .fold(Inline::new(), |lines, line| {
                let lines = if lines.is_empty() {
                    lines
                } else {
                    lines.new_line()
                };
                lines.plain(line)
            });
        let law = if e.law == Law::Exact {
            "exact"
        } else {
            "inexact"
        };
        table.push(
            Row::new(
                [Cell::from(Inline::new().strong(&e.effect)).hint(info.map_or("", |i| i.law))],
            )
            .cell(format!("{:.3}", e.probability))
            .cell(amounts(&e.weight))
            .cell(if e.matters { "yes" } else { "no" })
            .cell(law)
            .cell(Cell::from(parameters).unbroken()),
        );
        for note in e.law_note.iter().chain(&e.notes) {
            table.push(
                Row::new([""])
                    .cell(Cell::from(note).across(5).prose())
                    .warning_if(true),
            );
        }
    }
    b.table(table);
    b.paragraph("Weight: rms of what the effect does to the motion that the vehicle's own coefficients cannot do. It matters above the rig's [tolerance].");
    b.list(v.effects.iter().filter_map(|e| find(&e.effect)).map(|i| {
        Inline::new()
            .strong(i.id)
            .plain(format!(" ({}): {}. ", i.stage.name(), i.law))
            .emphasis(i.source)
    }));
}

pub(super) fn unexplained(b: &mut Body, v: &Verdict) {
    if v.unexplained.is_empty() {
        return;
    }
    b.section("What nothing in the library explains");
    b.list(v.unexplained.iter().map(|u| {
        let weight = u
            .weight
            .map(|w| format!("weight {}", amount(&u.channel, w)));
        let odds = u.log_bayes_factor;
        let odds = odds.map(|f| format!("log Bayes factor {f:.1}"));
        let numbers: Vec<String> = weight.into_iter().chain(odds).collect();
        format!("{}: {} ({})", u.channel, u.term, numbers.join(", "))
    }));
    for u in v.unexplained.iter().filter(|u| !u.knots.is_empty()) {
        b.figure(&super::figures::without_a_name(u), "");
    }
}

pub(super) fn alternatives(b: &mut Body, v: &Verdict) {
    b.section("Alternatives, and why they lost");
    if v.equivalent.len() > 1 {
        b.paragraph(
            Inline::from("These data cannot distinguish: ")
                .strong(super::together(v))
                .plain("."),
        );
    }
    b.paragraph(format!("{} sets of effects looked at.", v.sets_looked_at));
    let mut table = Table::new([
        "explanation",
        "log evidence below the first",
        "probability",
        "fitted rms",
        "",
    ]);
    let best = v.alternatives.first();
    for a in &v.alternatives {
        let name = if a.effects.is_empty() {
            "nothing: the vehicle alone".to_owned()
        } else {
            a.effects.join(" + ")
        };
        table.push(
            Row::new([
                name,
                format!("{:.1}", -a.log_evidence),
                format!("{:.3}", a.probability),
                amounts(&a.train),
            ])
            .cell(Cell::from(why(v, a, best)).prose()),
        );
    }
    b.table(table);
}

/// The heavy effects in the order of what they gain.
pub(super) fn ablation(b: &mut Body, v: &Verdict) {
    if v.ablation.len() < 2 {
        return;
    }
    b.section("What each effect gains");
    b.paragraph("One after the other, each time the one that improves the prediction most, all refitted together.");
    let mut table = Table::new(["", "fitted rms", "predicted rms"]);
    for step in &v.ablation {
        let name = if step.effect.is_empty() {
            "the vehicle alone".to_owned()
        } else {
            format!("+ {}", step.effect)
        };
        table.row([name, amounts(&step.train), amounts(&step.predicted)]);
    }
    b.table(table);
}

/// Comparison of an alternative with the best, in words: effects it lacks, adds without need, or exchanges.
fn why(
    v: &Verdict,
    a: &crate::verdict::Alternative,
    best: Option<&crate::verdict::Alternative>,
) -> String {
    let Some(best) = best.filter(|b| *b != a) else {
        return "the first".to_owned();
    };
    let matters = v.mattering();
    let lacks: Vec<&str> = best
        .effects
        .iter()
        .map(String::as_str)
        .filter(|e| !a.effects.iter().any(|o| o == e))
        .collect();
    let more: Vec<&str> = a
        .effects
        .iter()
        .map(String::as_str)
        .filter(|e| !best.effects.iter().any(|o| o == e))
        .collect();
    let mut words = match (lacks.is_empty(), more.is_empty()) {
        (true, true) => "the same effects, other sizes".to_owned(),
        (false, true) => format!("lacks {}", lacks.join(", ")),
        (true, false) => format!("{} added without need", more.join(", ")),
        (false, false) => format!("{} in place of {}", more.join(", "), lacks.join(", ")),
    };
    if lacks.iter().any(|l| matters.contains(l)) && a.log_evidence > -4.0 {
        words.push_str("; not decided by these data");
    }
    words
}

pub(super) fn coefficients(b: &mut Body, v: &Verdict) {
    if v.parameters.before.is_empty() {
        return;
    }
    b.section("The vehicle's own coefficients");
    let mut table = Table::new(["", "without effects", "with them", "change", "unit"]);
    for (key, before) in &v.parameters.before {
        let Some(after) = v.parameters.after.get(key) else {
            continue;
        };
        let known = Coefficient::find(key);
        table.row([
            known.map_or(key.as_str(), |c| c.symbol()).to_owned(),
            with_sd(before),
            with_sd(after),
            format!("{:+.1} %", 100.0 * (after.value / before.value - 1.0)),
            known.map_or("", Coefficient::unit).to_owned(),
        ]);
    }
    b.table(table);
    b.paragraph(
        "A coefficient that changes by more than its sd was doing the work of what was left out.",
    );
}

pub(super) fn noise(b: &mut Body, v: &Verdict) {
    if v.noise.is_empty() {
        return;
    }
    b.section("Noise of the measurement");
    let mut table = Table::new([
        "",
        "sd",
        "white",
        "correlated",
        "over",
        "discarded as outliers",
    ]);
    for (channel, n) in &v.noise {
        table.row([
            channel.clone(),
            amount(channel, n.sd),
            amount(channel, n.white_sd),
            amount(channel, n.coloured_sd),
            format!("{:.2} s", n.correlation_s),
            format!("{:.2} %", 100.0 * n.outliers),
        ]);
    }
    b.table(table);
}

pub(super) fn faults(b: &mut Body, v: &Verdict) {
    b.section("Faults of the data");
    if v.data_faults.is_empty() {
        b.paragraph("Units, signs, swapped, dead and stuck channels, gaps, steps of the clock, repeated stamps, outliers and clocks were checked: nothing to remark.");
        return;
    }
    let mut table = Table::new(["fault", "channel", "run", "evidence", "stops the diagnosis"]);
    for f in &v.data_faults {
        table.push(
            Row::new([&f.fault, &f.channel, &f.run])
                .cell(Cell::from(&f.evidence).prose())
                .cell(if f.fatal { "yes" } else { "no" }),
        );
    }
    b.table(table);
}

/// Last sections: effects that are not identifiable, next run, notes.
pub(super) fn rest(b: &mut Body, v: &Verdict) {
    b.section("What these runs cannot show");
    b.list(v.blind_spots.iter().map(|spot| {
        let effect = spot.split(" in ").next().unwrap_or_default();
        let law = find(effect).map_or("", |i| i.law);
        Inline::new().strong(spot).plain(format!(": {law}"))
    }));
    next_run(b, v);
    if !v.notes.is_empty() {
        b.section("Remarks");
        b.list(&v.notes);
    }
}

fn next_run(b: &mut Body, v: &Verdict) {
    b.section("Next run");
    let Some(next) = &v.next_experiment else {
        b.paragraph(match &v.truncated {
            Some(_) => "The search ended before a plan was chosen, or no plan of the library would add anything.",
            None => "No plan of the library would add anything.",
        });
        return;
    };
    let sets: Vec<String> = next
        .separates
        .iter()
        .map(|s| {
            if s.is_empty() {
                "nothing".to_owned()
            } else {
                s.join(" + ")
            }
        })
        .collect();
    let mut considered: Vec<(&String, &f64)> = next.considered.iter().collect();
    considered.sort_by(|a, b| b.1.total_cmp(a.1));
    let list: Vec<String> = considered
        .iter()
        .map(|(n, f)| format!("{n} {f:.1}"))
        .collect();
    b.paragraph(Inline::new().strong(&next.plan).plain(format!(
        " separates {}: expected log Bayes factor {:.1}. All plans asked: {}.",
        sets.join(" from "),
        next.expected_log_bayes_factor,
        list.join(", ")
    )));
    b.paragraph(
        Inline::new()
            .code("hydroline record --plan next.toml")
            .plain(" runs it:"),
    );
    b.listing(&next.plan_toml);
}
