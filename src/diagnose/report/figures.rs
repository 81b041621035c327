//! The report's figures: runs without and with what was left out, where the model misses.

use super::{Shown, Trace};
use crate::verdict::Unexplained;
use hydroline_core::run::Channel;
use hydroline_identify::figures::{Left, autocorrelation, commands, interval_s, residuals};
use hydroline_report::{Axis, Colour, Figure, Panel, Quantity, points};

const BEFORE: Colour = Colour::VERMILLION;
const AFTER: Colour = Colour::BLUE;
const STRONG: Colour = Colour::GREEN;
/// Command edges are marks only where they can be distinguished.
const MARKS: usize = 40;

fn marks(trace: &Trace) -> Vec<f64> {
    let edges = &trace.edges;
    if edges.len() > MARKS {
        return Vec::new();
    }
    edges.iter().map(|e| e.0).collect()
}

/// Motion, below it what each model misses beside the noise floor, and the commanded load.
pub(super) fn before_after(shown: &Shown, trace: &Trace) -> Figure {
    let channel = shown.channel.as_str();
    let quantity = Quantity::of(channel);
    let noise_sd = shown.noise_sd;
    let over_time = |values: &[f64]| points(&trace.times_s, &quantity.shown(values));
    let (before, after) = trace.rms();
    let (unit, factor) = (quantity.unit, quantity.factor);
    let outliers = trace.outliers();
    let mut panels = vec![
        Panel::new(
            format!("{}: {channel}", trace.name),
            Axis::time(),
            Axis::new(quantity.axis()),
        )
        .marks("commands", marks(trace))
        .line("measured", Colour::GREY, over_time(&trace.measured))
        .line("without", BEFORE, over_time(&trace.before))
        .line("with what was left out", AFTER, over_time(&trace.after)),
        residuals(
            format!(
                "measured - model: rms {:.3} {unit} before, {:.3} after, noise {:.3}",
                before * factor,
                after * factor,
                noise_sd * factor
            ),
            &quantity,
            Some(noise_sd),
        )
        .marks("", marks(trace))
        .line("before", BEFORE, over_time(&trace.residual(&trace.before)))
        .line("after", AFTER, over_time(&trace.residual(&trace.after)))
        .outliers(
            "discarded as outliers",
            Colour::PURPLE,
            outliers.iter().map(|(t, v)| [*t, v * factor]).collect(),
        ),
    ];
    let own = Channel::named(channel);
    if let (Some(own), [first, .., last]) = (own, &trace.times_s[..]) {
        panels.extend(commands(&trace.edges, own.dof().index(), [*first, *last]));
    }
    Figure::stack(
        format!(
            "{}: {channel} measured and by both models, their residuals and the commanded load",
            trace.name
        ),
        panels,
    )
    .shared_x()
}

/// Autocorrelation of what the model with effects leaves of every run; `None` where all are too short.
pub(super) fn whiteness(shown: &Shown, traces: &[Trace]) -> Option<Figure> {
    let residuals: Vec<Vec<f64>> = traces.iter().map(|t| t.residual(&t.after)).collect();
    let runs: Vec<Left<'_>> = traces
        .iter()
        .zip(&residuals)
        .map(|(trace, residual)| Left {
            name: &trace.name,
            interval_s: interval_s(&trace.times_s),
            residual,
        })
        .collect();
    let title = format!("{}: residuals with what was left out", shown.channel);
    let panel = autocorrelation(title.clone(), &runs)?;
    Some(Figure::stack(
        format!("{title}, autocorrelation"),
        vec![panel],
    ))
}

/// Residual of a run by the model without effects; `more` = windows with more than noise \[s\].
pub(super) fn misses(shown: &Shown, trace: &Trace, more: Vec<[f64; 2]>) -> Figure {
    let channel = shown.channel.as_str();
    let quantity = Quantity::of(channel);
    let title = format!("{}: {channel}, measured - model", trace.name);
    let residual = quantity.shown(&trace.residual(&trace.before));
    let panel = residuals(title.clone(), &quantity, Some(shown.noise_sd))
        .height(120.0)
        .windows("more than noise", BEFORE, more)
        .marks("commands", marks(trace))
        .line("without effects", BEFORE, points(&trace.times_s, &residual));
    Figure::stack(title, vec![panel])
}

/// A force of no known effect over its variable: the table with its band, and the likeliest closed form.
pub(super) fn without_a_name(u: &Unexplained) -> Figure {
    let linear = ["x", "y", "z", "u", "v", "w"].iter();
    let mut linear = linear.filter(|c| u.channel.starts_with(&format!("{c}_")));
    let load = match linear.next() {
        Some(_) => "force [N]",
        None => "moment [N m]",
    };
    let within_sd = u.knots.iter().zip(u.force_at.iter().zip(&u.force_sd));
    let within_sd = within_sd.map(|(x, (a, sd))| [*x, a - sd, a + sd]).collect();
    let over = u.depends_on.as_deref().unwrap_or("time");
    let title = format!("force of no known effect over {over}");
    let mut panel = Panel::new(title.clone(), Axis::new(over), Axis::new(load))
        .height(160.0)
        .ribbon("table, one sd", Colour::GREY, within_sd)
        .line("table", BEFORE, points(&u.knots, &u.force_at));
    if let Some(f) = u.closed_form.as_ref().filter(|f| !f.force_at.is_empty()) {
        panel = panel.line("closed form", STRONG, points(&u.knots, &f.force_at));
    }
    Figure::stack(title, vec![panel])
}
