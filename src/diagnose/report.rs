//! The verdict as one self-contained HTML page: one sentence first, then what it rests on.
//!
//! Order as a reader asks: what was left out; does it predict better on runs it has not seen; where
//! does it act; how sure, and what else was considered; what the vehicle's coefficients become; what
//! these runs cannot show, and which run would. Inline SVG, no script, nothing fetched.

mod plot;
mod tables;
mod traces;

use std::fmt::Write as _;

use hydroline_rigs::{ParameterValue, PhysicsEntry};

use super::Diagnosis;
use super::verdict::{Verdict, Word};
use hydroline_identify::report::{STYLE, escape};
use plot::{Line, Plot, stack};
pub use traces::{Explained, Regime, Trace};

const BEFORE: &str = "#c30";
const AFTER: &str = "#06a";
const MEASURED: &str = "#555";
/// Half width of the drawn noise floor, in standard deviations.
const FLOOR_SD: f64 = 2.0;

/// What `diagnose --report` writes.
#[derive(Debug, Clone)]
pub struct Pages {
    /// The page.
    pub html: String,
    /// Its before/after figure alone; empty where nothing was fitted.
    pub before_after_svg: String,
}

/// Unit and factor that a channel is drawn in.
fn drawn(channel: &str) -> (&'static str, f64) {
    if channel.ends_with("_rad") {
        ("deg", 180.0 / std::f64::consts::PI)
    } else {
        ("mm", 1e3)
    }
}

fn scaled(values: &[f64], factor: f64) -> Vec<f64> {
    values.iter().map(|v| v * factor).collect()
}

fn edges(trace: &Trace) -> Vec<f64> {
    trace.track.edges.iter().map(|e| e.0).collect()
}

/// Command edges are marks only where they can be told apart.
fn marks(trace: &Trace) -> Vec<f64> {
    Some(edges(trace))
        .filter(|e| e.len() <= 40)
        .unwrap_or_default()
}

/// Motion, and below it what each model misses beside the noise floor.
fn before_after<'a>(trace: &'a Trace, channel: &str, noise_sd: f64) -> Vec<Plot<'a>> {
    let (unit, factor) = drawn(channel);
    let (before, after) = trace.rms();
    vec![
        Plot {
            height: 190.0,
            title: format!("{}: {channel}", trace.track.name),
            x: &trace.track.times_s,
            x_label: "s",
            y_label: unit,
            lines: vec![
                Line {
                    colour: BEFORE,
                    name: "without",
                    values: scaled(&trace.before, factor),
                },
                Line {
                    colour: AFTER,
                    name: "with what was left out",
                    values: scaled(&trace.after, factor),
                },
                Line {
                    colour: MEASURED,
                    name: "measured",
                    values: scaled(&trace.track.measured, factor),
                },
            ],
            marks: marks(trace),
            ..Plot::default()
        },
        Plot {
            height: 190.0,
            title: format!(
                "measured - model: rms {:.3} {unit} before, {:.3} after, noise {:.3} (band: {FLOOR_SD} sd)",
                before * factor,
                after * factor,
                noise_sd * factor
            ),
            x: &trace.track.times_s,
            x_label: "s",
            y_label: unit,
            lines: vec![
                Line {
                    colour: BEFORE,
                    name: "before",
                    values: scaled(&trace.residual(&trace.before), factor),
                },
                Line {
                    colour: AFTER,
                    name: "after",
                    values: scaled(&trace.residual(&trace.after), factor),
                },
            ],
            band: Some(FLOOR_SD * noise_sd * factor),
            dots: trace
                .outliers()
                .into_iter()
                .map(|(t, v)| (t, v * factor))
                .collect(),
            marks: marks(trace),
            ..Plot::default()
        },
    ]
}

/// Page and figure; `command` is what made them.
pub fn pages(found: &Diagnosis, command: &str) -> Pages {
    let v = &found.verdict;
    let mut page = format!(
        "<!DOCTYPE html>\n<html lang=\"en\"><head><meta charset=\"utf-8\"><title>hydroline diagnose: {0}</title><style>{STYLE}.s{{font-size:1.2em;border-left:.3em solid #06a;padding-left:.7em}}code,pre{{background:#f4f4f4}}pre{{padding:.6em}}</style></head><body>\n<h1>Diagnosis: {0}</h1>\n<p class=\"s\">{1}</p>\n<p><code>{2}</code></p>\n",
        word(v.verdict),
        escape(&v.sentence),
        escape(command)
    );
    if v.verdict == Word::DataFault {
        tables::faults(&mut page, v);
        page += "</body></html>\n";
        return Pages {
            html: page,
            before_after_svg: String::new(),
        };
    }
    let mut figure = String::new();
    let _ = writeln!(
        page,
        "<h2>Before and after</h2><p>{}. Grey: the noise of the measurement; dotted: commands; dots: samples left out as outliers.</p>",
        escape(
            if v.fit.held_out_by.starts_with(super::conclude::HELD_OUT) {
                "Runs that were not used for fitting, predicted; only each run's start is fitted"
            } else {
                "Each run predicted by coefficients and effects fitted to the others; only its start is fitted"
            }
        )
    );
    for explained in &found.explained {
        let channel = explained.setting.channel();
        let sd = explained.weights.noise.total_sd();
        let mut traces = explained.predicted();
        if traces.is_empty() {
            page += "<p class=\"warn\">One run and none held out: the figure shows the fit itself, which proves less than a prediction.</p>";
            traces = explained.fitted();
        }
        for trace in &traces {
            let svg = stack(&before_after(trace, channel, sd));
            let _ = writeln!(page, "{svg}");
            if figure.is_empty() {
                figure = svg;
            }
        }
    }
    tables::fit(&mut page, v);
    tables::effects(&mut page, v);
    written(&mut page, found);
    place(&mut page, found);
    tables::unexplained(&mut page, v);
    tables::ladder(&mut page, v);
    tables::alternatives(&mut page, v);
    tables::coefficients(&mut page, v);
    tables::noise(&mut page, v);
    tables::faults(&mut page, v);
    tables::rest(&mut page, v);
    page += "</body></html>\n";
    Pages {
        html: page,
        before_after_svg: figure,
    }
}

fn word(w: Word) -> &'static str {
    match w {
        Word::None => "nothing that matters",
        Word::Named => "named",
        Word::Ambiguous => "ambiguous",
        Word::Unknown => "unknown",
        Word::DataFault => "data fault",
    }
}

/// An entry as it stands in a rig file.
pub fn entry_toml(entry: &PhysicsEntry) -> String {
    let mut text = format!("[[physics]]\neffect = \"{}\"\n", entry.effect);
    for (name, value) in &entry.parameters {
        let _ = match value {
            ParameterValue::Number(n) => writeln!(text, "{name} = {n}"),
            ParameterValue::Word(w) => writeln!(text, "{name} = \"{w}\""),
        };
    }
    text
}

fn written(page: &mut String, found: &Diagnosis) {
    let named = |e: &&PhysicsEntry| found.verdict.effects.iter().any(|f| f.effect == e.effect);
    let entries: Vec<String> = found
        .rig
        .physics
        .iter()
        .filter(named)
        .map(entry_toml)
        .collect();
    if !entries.is_empty() {
        let _ = writeln!(
            page,
            "<h2>In the rig file</h2><p>What <code>--write-rig</code> writes beside the refitted coefficients:</p><pre>{}</pre>",
            escape(&entries.join("\n"))
        );
    }
}

/// Where the model without effects misses, on the runs fitted.
fn place(page: &mut String, found: &Diagnosis) {
    let v = &found.verdict;
    let _ = writeln!(
        page,
        "<h2>Where</h2><p>Stage {}, {}. {}.</p><p>What the vehicle alone, refitted, leaves of the runs fitted. Red: more than noise; green: where the free force is strong; dotted: commands.</p>",
        escape(v.place.stage.as_deref().unwrap_or("not known")),
        escape(&v.place.dof.join(", ")),
        escape(&v.place.regime)
    );
    for explained in &found.explained {
        let channel = explained.setting.channel();
        let (unit, factor) = drawn(channel);
        let sd = explained.weights.noise.total_sd();
        let regime = explained.regime();
        for (run, trace) in explained.fitted().iter().enumerate() {
            let mut shaded: Vec<([f64; 2], &str)> = v
                .place
                .windows
                .get(&trace.track.name)
                .into_iter()
                .flatten()
                .map(|w| (*w, "#c00"))
                .collect();
            if let Some(r) = &regime {
                shaded.extend(r.windows(run, trace).into_iter().map(|w| (w, "#090")));
            }
            let plot = Plot {
                height: 170.0,
                title: format!("{}: {channel}, measured - model", trace.track.name),
                x: &trace.track.times_s,
                x_label: "s",
                y_label: unit,
                lines: vec![Line {
                    colour: BEFORE,
                    name: "without effects",
                    values: scaled(&trace.residual(&trace.before), factor),
                }],
                shaded,
                marks: marks(trace),
                band: Some(FLOOR_SD * sd * factor),
                ..Plot::default()
            };
            let _ = writeln!(page, "{}", stack(&[plot]));
        }
        if let Some(r) = &regime {
            let family = &r.found.family;
            let knots: Vec<f64> = family.knots.iter().map(|k| family.shown(*k)).collect();
            let _ = writeln!(page, "{}", stack(&[free_force(r, &knots, explained)]));
        }
    }
}

fn free_force<'a>(r: &'a Regime, knots: &'a [f64], explained: &Explained) -> Plot<'a> {
    let f = &r.found;
    let load = if explained.setting.dof.index() < 3 {
        "N"
    } else {
        "N m"
    };
    let shifted = |k: f64| -> Vec<f64> {
        f.amplitudes
            .iter()
            .zip(&f.sds)
            .map(|(a, sd)| a + k * sd)
            .collect()
    };
    Plot {
        height: 170.0,
        title: format!(
            "free force over {} (log Bayes factor {:.1})",
            f.family.variable.name(),
            f.gain
        ),
        x: knots,
        x_label: "SI",
        y_label: load,
        lines: vec![
            Line {
                colour: "#bbb",
                name: "+- sd",
                values: shifted(1.0),
            },
            Line {
                colour: "#bbb",
                name: "",
                values: shifted(-1.0),
            },
            Line {
                colour: "#090",
                name: "force",
                values: f.amplitudes.clone(),
            },
        ],
        shaded: vec![(r.range.map(|v| f.family.shown(v)), "#090")],
        ..Plot::default()
    }
}

/// One line per group of tied explanations, for headings.
fn together(v: &Verdict) -> String {
    v.equivalent
        .iter()
        .map(|s| s.join(" + "))
        .collect::<Vec<_>>()
        .join(" or ")
}
