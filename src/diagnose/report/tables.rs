//! The page's tables and lists.

use std::collections::BTreeMap;
use std::fmt::Write as _;

use hydroline_sim::effect::ALL;

use super::drawn;
use crate::verdict::{Law, Value, Verdict};
use hydroline_identify::parameter::Coefficient;
use hydroline_identify::report::{escape, significant};

fn amount(channel: &str, value: f64) -> String {
    let (unit, factor) = drawn(channel);
    format!("{:.3} {unit}", value * factor)
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
        |sd| format!("{} &plusmn; {}", significant(value.value), significant(sd)),
    )
}

pub(super) fn fit(page: &mut String, v: &Verdict) {
    page.push_str("<table><tr><th>rms</th><th>before</th><th>after</th><th>noise</th></tr>\n");
    let tables = [
        ("fitted", &v.fit.train),
        (v.fit.held_out_by.as_str(), &v.fit.held_out),
    ];
    for (name, table) in tables {
        for (channel, before) in &table.before {
            let of = |m: &BTreeMap<String, f64>| {
                m.get(channel)
                    .map_or("-".to_owned(), |x| amount(channel, *x))
            };
            let _ = writeln!(
                page,
                "<tr><td>{} ({})</td><td>{}</td><td>{}</td><td>{}</td></tr>",
                escape(channel),
                escape(name),
                amount(channel, *before),
                of(&table.after),
                of(&table.noise)
            );
        }
    }
    page.push_str("</table>\n");
    if !v.test.statistic.is_empty() {
        let white: Vec<String> = v
            .test
            .whiteness_p
            .iter()
            .map(|p| format!("{p:.2}"))
            .collect();
        let _ = writeln!(
            page,
            "<p>Is there a mismatch at all? {}: {:.1} with {} degrees of freedom, p = {:.1e}. Whiteness of what is left (Ljung-Box p per run): {}.</p>",
            escape(&v.test.statistic),
            v.test.value,
            v.test.freedom,
            v.test.p_value,
            white.join(", ")
        );
    }
}

pub(super) fn effects(page: &mut String, v: &Verdict) {
    if v.effects.is_empty() {
        page.push_str("<h2>What was left out</h2><p>No effect is established.</p>\n");
        return;
    }
    page.push_str("<h2>What was left out</h2><table><tr><th>effect</th><th>probability</th><th>weight (rms)</th><th>matters</th><th>law</th><th>parameters</th></tr>\n");
    for e in &v.effects {
        let info = ALL.iter().find(|i| i.id == e.effect);
        let unit = |name: &str| {
            info.and_then(|i| i.parameters.iter().find(|p| p.name == name))
                .map_or("", |p| p.unit)
        };
        let numbers: Vec<String> = e
            .parameters
            .iter()
            .map(|(n, p)| format!("{} = {} {}", escape(n), with_sd(p), escape(unit(n))))
            .chain(
                e.words
                    .iter()
                    .map(|(n, w)| format!("{} = {}", escape(n), escape(w))),
            )
            .collect();
        let _ = writeln!(
            page,
            "<tr><td title=\"{}\"><b>{}</b></td><td>{:.3}</td><td>{}</td><td>{}</td><td>{}</td><td>{}</td></tr>",
            escape(info.map_or("", |i| i.law)),
            escape(&e.effect),
            e.probability,
            escape(&amounts(&e.weight)),
            if e.matters { "yes" } else { "no" },
            if e.law == Law::Exact {
                "exact"
            } else {
                "inexact"
            },
            numbers.join("<br>")
        );
        for note in e.law_note.iter().chain(&e.notes) {
            let _ = writeln!(
                page,
                "<tr><td></td><td colspan=\"5\" class=\"warn\">{}</td></tr>",
                escape(note)
            );
        }
    }
    page.push_str("</table>\n<p>Weight: rms of what the effect does to the motion that the vehicle's own coefficients cannot do. It matters above the rig's [tolerance].</p>\n");
    page.push_str("<ul>");
    for info in v
        .effects
        .iter()
        .filter_map(|e| ALL.iter().find(|i| i.id == e.effect))
    {
        let _ = writeln!(
            page,
            "<li><b>{}</b> ({}): {}. <i>{}</i></li>",
            info.id,
            info.stage.name(),
            escape(info.law),
            escape(info.source)
        );
    }
    page.push_str("</ul>\n");
}

pub(super) fn unexplained(page: &mut String, v: &Verdict) {
    if v.unexplained.is_empty() {
        return;
    }
    page.push_str("<h2>What nothing in the vocabulary explains</h2><ul>");
    for u in &v.unexplained {
        let _ = writeln!(
            page,
            "<li>{}: {} (weight {}, log Bayes factor {:.1})</li>",
            escape(&u.channel),
            escape(&u.term),
            amount(&u.channel, u.weight),
            u.log_bayes_factor
        );
    }
    page.push_str("</ul>\n");
}

pub(super) fn alternatives(page: &mut String, v: &Verdict) {
    page.push_str("<h2>Alternatives, and why they lost</h2>\n");
    if v.equivalent.len() > 1 {
        let _ = writeln!(
            page,
            "<p>These data cannot tell apart: <b>{}</b>.</p>",
            escape(&super::together(v))
        );
    }
    let _ = writeln!(
        page,
        "<p>{} sets of effects looked at.</p>",
        v.sets_looked_at
    );
    if v.alternatives.is_empty() {
        return;
    }
    page.push_str("<table><tr><th>explanation</th><th>log evidence below the first</th><th>probability</th><th>fitted rms</th><th>held-out rms</th><th></th></tr>\n");
    let best = v.alternatives.first();
    for a in &v.alternatives {
        let name = if a.effects.is_empty() {
            "nothing: the vehicle alone".to_owned()
        } else {
            a.effects.join(" + ")
        };
        let _ = writeln!(
            page,
            "<tr><td>{}</td><td>{:.1}</td><td>{:.3}</td><td>{}</td><td>{}</td><td>{}</td></tr>",
            escape(&name),
            -a.log_evidence,
            a.probability,
            escape(&amounts(&a.train)),
            escape(&amounts(&a.held_out)),
            escape(&why(v, a, best))
        );
    }
    page.push_str("</table>\n");
}

/// The heavy effects in the order of what they gain.
pub(super) fn ladder(page: &mut String, v: &Verdict) {
    if v.ladder.len() < 2 {
        return;
    }
    page.push_str("<h2>What each effect gains</h2><p>One after the other, each time the one that improves the prediction most, all refitted together.</p><table><tr><th></th><th>fitted rms</th><th>held-out rms</th>");
    let windows = v.ladder.iter().any(|r| !r.held_out_in_windows.is_empty());
    if windows {
        page.push_str("<th>held-out rms in windows, a tenth of a run each</th>");
    }
    let others = v.ladder.iter().any(|r| !r.instead.is_empty());
    if others {
        page.push_str("<th>in its place</th>");
    }
    page.push_str("</tr>\n");
    for rung in &v.ladder {
        let name = if rung.effect.is_empty() {
            "the vehicle alone".to_owned()
        } else {
            format!("+ {}", rung.effect)
        };
        let last = if windows {
            format!("<td>{}</td>", escape(&amounts(&rung.held_out_in_windows)))
        } else {
            String::new()
        };
        let other = if others {
            let channel = rung.train.keys().next().map_or("", String::as_str);
            let told: Vec<String> = rung
                .instead
                .iter()
                .map(|(id, rms)| format!("{id} {}", amount(channel, *rms)))
                .collect();
            format!("<td>{}</td>", escape(&told.join(", ")))
        } else {
            String::new()
        };
        let _ = writeln!(
            page,
            "<tr><td>{}</td><td>{}</td><td>{}</td>{last}{other}</tr>",
            escape(&name),
            escape(&amounts(&rung.train)),
            escape(&amounts(&rung.held_out)),
        );
    }
    page.push_str("</table>\n");
}

/// What an alternative lacks, does without need, or does as well.
fn why(
    v: &Verdict,
    a: &crate::verdict::Alternative,
    best: Option<&crate::verdict::Alternative>,
) -> String {
    let Some(best) = best.filter(|b| *b != a) else {
        return "the first".to_owned();
    };
    let matters: Vec<&str> = v
        .effects
        .iter()
        .filter(|e| e.matters)
        .map(|e| e.effect.as_str())
        .collect();
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
    let worse = a
        .held_out
        .iter()
        .filter_map(|(c, r)| Some(r / best.held_out.get(c)?))
        .fold(0.0, f64::max);
    if worse > 0.0 {
        let _ = write!(words, "; predicts {worse:.2} times the first's rms");
    }
    if lacks.iter().any(|l| matters.contains(l)) && a.log_evidence > -4.0 {
        words.push_str("; not decided by these data");
    }
    words
}

pub(super) fn coefficients(page: &mut String, v: &Verdict) {
    page.push_str("<h2>The vehicle's own coefficients</h2><table><tr><th></th><th>without effects</th><th>with them</th><th>change</th><th>unit</th></tr>\n");
    for (key, before) in &v.parameters.before {
        let Some(after) = v.parameters.after.get(key) else {
            continue;
        };
        let known = Coefficient::find(key);
        let _ = writeln!(
            page,
            "<tr><td>{}</td><td>{}</td><td>{}</td><td>{:+.1} %</td><td>{}</td></tr>",
            escape(known.map_or(key.as_str(), |c| c.symbol())),
            with_sd(before),
            with_sd(after),
            100.0 * (after.value / before.value - 1.0),
            escape(known.map_or("", Coefficient::unit))
        );
    }
    page.push_str("</table>\n<p>A coefficient that changes by more than its sd was doing the work of what was left out.</p>\n");
    exponents(page, v);
}

/// What powers of the rate the data leave open.
fn exponents(page: &mut String, v: &Verdict) {
    for e in &v.parameters.exponents {
        let _ = writeln!(
            page,
            "<h2>Exponent of {}</h2><p>{}</p><table><tr><th>power of the rate</th><th>log-likelihood below the best</th><th>held-out rms</th></tr>",
            escape(&e.effect),
            escape(&e.told)
        );
        for ((power, below), held) in e.tried.iter().zip(&e.log_likelihood).zip(&e.held_out) {
            let _ = writeln!(
                page,
                "<tr><td>{power}</td><td>{below:.1}</td><td>{}</td></tr>",
                held.map_or("-".to_owned(), |h| amount(&e.channel, h))
            );
        }
        page.push_str("</table>\n");
    }
}

pub(super) fn noise(page: &mut String, v: &Verdict) {
    page.push_str("<h2>Noise of the measurement</h2><table><tr><th></th><th>sd</th><th>white</th><th>correlated</th><th>over</th><th>left out as outliers</th></tr>\n");
    for (channel, n) in &v.noise {
        let _ = writeln!(
            page,
            "<tr><td>{}</td><td>{}</td><td>{}</td><td>{}</td><td>{:.2} s</td><td>{:.2} %</td></tr>",
            escape(channel),
            amount(channel, n.sd),
            amount(channel, n.white_sd),
            amount(channel, n.coloured_sd),
            n.correlation_s,
            100.0 * n.outliers
        );
    }
    page.push_str("</table>\n");
}

pub(super) fn faults(page: &mut String, v: &Verdict) {
    page.push_str("<h2>Faults of the data</h2>\n");
    if v.data_faults.is_empty() {
        page.push_str("<p>Units, signs, swapped, dead and stuck channels, gaps, repeated stamps, outliers and clocks were checked: nothing to remark.</p>\n");
        return;
    }
    page.push_str("<table><tr><th>fault</th><th>channel</th><th>run</th><th>evidence</th><th>stops the diagnosis</th></tr>\n");
    for f in &v.data_faults {
        let _ = writeln!(
            page,
            "<tr><td>{}</td><td>{}</td><td>{}</td><td>{}</td><td>{}</td></tr>",
            escape(&f.fault),
            escape(&f.channel),
            escape(&f.run),
            escape(&f.evidence),
            if f.fatal { "yes" } else { "no" }
        );
    }
    page.push_str("</table>\n");
}

/// Blind spots, next run, remarks.
pub(super) fn rest(page: &mut String, v: &Verdict) {
    page.push_str("<h2>What these runs cannot show</h2><ul>");
    for spot in &v.blind_spots {
        let law = ALL.iter().find(|i| i.id == spot).map_or("", |i| i.law);
        let _ = writeln!(page, "<li><b>{}</b>: {}</li>", escape(spot), escape(law));
    }
    page.push_str("</ul><h2>Next run</h2>");
    match &v.next_experiment {
        None => page.push_str("<p>No plan of the library would add anything.</p>\n"),
        Some(next) => {
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
                .map(|(n, f)| format!("{} {f:.1}", escape(n)))
                .collect();
            let _ = writeln!(
                page,
                "<p><b>{}</b> separates {}: expected log Bayes factor {:.1}. All plans asked: {}.</p><p><code>hydroline record --plan next.toml</code> runs it:</p><pre>{}</pre>",
                escape(&next.plan),
                escape(&sets.join(" from ")),
                next.expected_log_bayes_factor,
                list.join(", "),
                escape(&next.plan_toml)
            );
        }
    }
    if !v.notes.is_empty() {
        page.push_str("<h2>Remarks</h2><ul>");
        for note in &v.notes {
            let _ = writeln!(page, "<li>{}</li>", escape(note));
        }
        page.push_str("</ul>\n");
    }
}
