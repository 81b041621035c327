//! A prediction as one self-contained HTML page and a figure: motion with its band, a measured run beside it, residuals
//! and the commanded load on one time axis.

use super::Prediction;
use super::residuals::Measured;
use crate::figures::{BAND_SD, commands, edges};
use hydroline_core::run::{Channel, PerChannel};
use hydroline_numerics::statistics::extent;
use hydroline_report::{Axis, Body, Colour, Figure, Inline, Page, Panel, Quantity, Table, points};
use hydroline_rigs::{Dof, Rig, Tolerance};

/// Height of a panel of rates or residuals \[px\].
const LOW_PX: f64 = 90.0;

/// Output of `predict --report`.
#[derive(Debug, Clone)]
pub struct Pages {
    /// The page.
    pub page: Page,
    /// All its figures as one.
    pub svg: String,
}

/// Page and figure of a plan's prediction; `command` is what made them.
pub fn pages(
    rig: &Rig,
    plan: &str,
    made: &Prediction,
    measured: Option<&Measured>,
    command: &str,
) -> Pages {
    let shown = shown(&rig.tolerance, made, measured);
    let mut page = Page::new(
        format!("hydroline predict: {plan}"),
        format!("Prediction: {plan} by {}", rig.name),
    );
    let b = &mut page.body;
    b.lead(sentence(made, measured, &shown));
    if let Some(m) = measured.filter(|m| !m.test.sentence.is_empty()) {
        b.paragraph(&m.test.sentence);
    }
    b.paragraph(Inline::new().code(command));
    if made.sd.is_empty() {
        b.warning("No band: the rig's coefficients carry no uncertainty.");
    }
    if !made.without_uncertainty.is_empty() {
        b.warning(format!(
            "The band is too narrow: {} carry no uncertainty, and this plan moves their degrees of freedom.",
            made.without_uncertainty.join(", ")
        ));
    }
    for words in measured.iter().flat_map(|m| &m.notes) {
        b.warning(words);
    }
    if let Some(measured) = measured {
        residuals(b, measured);
    }
    b.section("Motion");
    let mut all = Vec::new();
    for dof in shown {
        let panels = panels(made, measured, dof);
        all.extend(panels.iter().cloned());
        let label = format!(
            "{}: predicted motion and commanded load over time",
            Dof::ALL[dof].name()
        );
        b.figure(&Figure::stack(label, panels).shared_x(), "");
    }
    let svg = Figure::stack(format!("{plan} predicted"), all)
        .shared_x()
        .file();
    Pages { page, svg }
}

/// DOFs whose pose moves farther than the rig's tolerance, predicted or measured; all where none does.
fn shown(tolerance: &Tolerance, made: &Prediction, measured: Option<&Measured>) -> Vec<usize> {
    let least = tolerance.channels();
    let moves = |rows: &[PerChannel<f64>], dof: usize| {
        let place = Channel::POSES[dof];
        let (low, high) = extent(rows.iter().map(|r| r[place]).filter(|v| v.is_finite()));
        high - low > least[place]
    };
    let of_run = measured.map_or(&[][..], |m| &m.motion[..]);
    let moving: Vec<usize> = (0..6)
        .filter(|dof| moves(&made.motion, *dof) || moves(of_run, *dof))
        .collect();
    if moving.is_empty() {
        (0..6).collect()
    } else {
        moving
    }
}

/// Where the plan ends, or how well it fits what was measured.
fn sentence(made: &Prediction, measured: Option<&Measured>, shown: &[usize]) -> String {
    let amount = |channel: Channel, value: f64| {
        let quantity = Quantity::of(channel.name());
        format!("{} {}", quantity.name, quantity.amount(value))
    };
    if let Some(measured) = measured {
        let channels = measured.channels.iter();
        let each: Vec<String> = channels
            .filter_map(|b| {
                let c = Channel::named(b.channel).filter(|c| !c.is_rate())?;
                shown.contains(&c.dof().index()).then(|| amount(c, b.rms))
            })
            .collect();
        return format!(
            "Measured run {} beside the prediction: rms residual {}.",
            measured.log,
            each.join(", ")
        );
    }
    let end_s = made.t_s.last().copied().unwrap_or(0.0);
    let each: Vec<String> = shown
        .iter()
        .filter_map(|dof| {
            let c = Channel::POSES[*dof];
            let way = made.motion.last()?[c] - made.motion.first()?[c];
            let band = made.sd.last().map_or(String::new(), |sd| {
                let quantity = Quantity::of(c.name());
                format!(
                    " \u{b1} {} ({BAND_SD} sd)",
                    quantity.amount(BAND_SD * sd[c])
                )
            });
            Some(format!("{}{band}", amount(c, way)))
        })
        .collect();
    format!(
        "After {end_s:.1} s the vehicle has moved by {}.",
        each.join(", ")
    )
}

fn residuals(b: &mut Body, measured: &Measured) {
    b.section("Residuals");
    b.paragraph(format!(
        "Measured minus predicted, run {}; the prediction begins at {:.2} s of the log, at rest and where the run begins. The sd is that of the prediction and, where the log says it, of the sample.",
        measured.log, measured.start_s
    ));
    let mut table = Table::new(["", "rms", "largest", "at", "samples", "within 2 sd"]);
    for row in &measured.channels {
        let quantity = Quantity::of(row.channel);
        table.row([
            quantity.name.to_owned(),
            quantity.amount(row.rms),
            quantity.amount(row.largest),
            format!("{:.2} s", row.largest_at_s),
            row.samples.to_string(),
            row.within_two_sd
                .map_or("-".to_owned(), |share| format!("{:.0} %", 100.0 * share)),
        ]);
    }
    b.table(table);
}

/// Pose, rate, residual and load of a DOF.
fn panels(made: &Prediction, measured: Option<&Measured>, dof: usize) -> Vec<Panel> {
    let [place, rate] = Channel::of(dof);
    let mut panels = vec![
        motion(made, measured, place),
        motion(made, measured, rate).height(LOW_PX),
    ];
    if let Some(m) = measured.filter(|m| m.residual.iter().any(|r| r[place].is_finite())) {
        let quantity = Quantity::of(place.name());
        let left: Vec<f64> = m
            .residual
            .iter()
            .map(|r| r[place] * quantity.factor)
            .collect();
        let panel = Panel::new(
            "measured - predicted",
            Axis::time(),
            Axis::new(quantity.with_unit("residual")),
        );
        let within = m.t_s.iter().zip(&m.sd).map(|(t, sd)| {
            let half = BAND_SD * sd[place] * quantity.factor;
            [*t, -half, half]
        });
        let panel = panel.height(LOW_PX).ribbon(
            &format!("prediction and measurement, {BAND_SD} sd"),
            Colour::GREY,
            within.collect(),
        );
        panels.push(panel.line("", Colour::BLUE, points(&m.t_s, &left)));
    }
    if let [first, .., last] = made.t_s[..] {
        let edges = edges(made.commands.iter().copied(), dof);
        panels.extend(commands(&edges, dof, [first, last]));
    }
    panels
}

/// A channel predicted, with its band, and measured.
fn motion(made: &Prediction, measured: Option<&Measured>, channel: Channel) -> Panel {
    let quantity = Quantity::of(channel.name());
    let column = |rows: &[PerChannel<f64>]| -> Vec<f64> {
        rows.iter().map(|r| r[channel] * quantity.factor).collect()
    };
    let title = match channel.is_rate() {
        false => format!("{}: {}", channel.dof().name(), quantity.name),
        true => quantity.name.to_owned(),
    };
    let panel = Panel::new(title, Axis::time(), Axis::new(quantity.axis()));
    let mut panel = band(panel, made, channel, |k| made.motion[k][channel]);
    if let Some(m) = measured.filter(|m| m.motion.iter().any(|r| r[channel].is_finite())) {
        panel = panel.line("measured", Colour::GREY, points(&m.t_s, &column(&m.motion)));
    }
    panel.line(
        "predicted",
        Colour::BLUE,
        points(&made.t_s, &column(&made.motion)),
    )
}

/// Two sd of the prediction about `middle`, where there is a band.
fn band(panel: Panel, made: &Prediction, channel: Channel, middle: impl Fn(usize) -> f64) -> Panel {
    if made.sd.is_empty() {
        return panel;
    }
    let factor = Quantity::of(channel.name()).factor;
    let within = made
        .t_s
        .iter()
        .zip(&made.sd)
        .enumerate()
        .map(|(k, (t, sd))| {
            let half = BAND_SD * sd[channel];
            [*t, (middle(k) - half) * factor, (middle(k) + half) * factor]
        });
    panel.ribbon(
        &format!("predicted, {BAND_SD} sd"),
        Colour::BLUE,
        within.collect(),
    )
}

#[cfg(test)]
mod tests {
    use super::super::predict;
    use super::*;
    use crate::predict::residuals::beside;
    use hydroline_core::run::{Command, Run, Sample};
    use hydroline_rigs::Plan;

    #[test]
    fn what_moves_is_drawn_and_a_measured_run_stands_beside_it() {
        let rig = Rig::builtin("lshpi").unwrap();
        let plan = Plan::builtin("surge-8n").unwrap();
        let made = predict(&rig, &plan, None, 5.0, 0.0).unwrap();
        let alone = pages(&rig, &plan.name, &made, None, "hydroline predict");
        let html = alone.page.html();
        assert!(
            html.contains("the vehicle has moved by x "),
            "{}",
            &html[..3000]
        );
        for words in ["surge: x", "u [mm/s]", "X [N]", "No band"] {
            assert!(html.contains(words), "{words}");
        }
        assert!(!html.contains("sway") && !html.contains("measured"));

        let samples = made.t_s.iter().zip(&made.motion).map(|(t_s, row)| Sample {
            t_s: *t_s,
            values: PerChannel::from_fn(|c| {
                if c < Channel::Z {
                    row[c] + 0.002
                } else {
                    f64::NAN
                }
            }),
            covariance: None,
        });
        let commands = made.commands.iter().map(|(t_s, wrench)| Command {
            t_s: *t_s,
            wrench: *wrench,
        });
        let run = Run {
            name: "tank".to_owned(),
            samples: samples.collect(),
            commands: commands.collect(),
            ..Run::default()
        };
        let mut measured = beside(&made, &run, 0.0).unwrap();
        measured.compare_loads(&made, &run);
        assert!(measured.notes.is_empty(), "{:?}", measured.notes);
        let both = pages(
            &rig,
            &plan.name,
            &made,
            Some(&measured),
            "hydroline predict",
        );
        let html = both.page.html();
        assert!(
            html.contains("rms residual x 2.000\u{a0}mm."),
            "{}",
            &html[..3000]
        );
        for words in ["measured - predicted", "run tank", "Residuals"] {
            assert!(html.contains(words), "{words}");
        }
        assert!(both.svg.contains("measured") && both.svg.starts_with("<?xml"));
    }
}
