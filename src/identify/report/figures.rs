//! The figures: a run's channel with what the fit leaves of it, all runs over each other, and their autocorrelation.

use crate::data::CHANNELS;
use crate::figures::{BAND_SD, Left, autocorrelation, commands, interval_s, residuals};
use crate::outcome::Trace;
use hydroline_report::{Axis, Colour, Figure, Panel, Quantity, points};

/// Heights of a run's panels \[px\].
const FIT_PX: f64 = 180.0;
const RESIDUAL_PX: f64 = 80.0;

/// The body's DOF that a channel belongs to.
fn dof(channel: &str) -> Option<usize> {
    let index = CHANNELS.iter().position(|c| *c == channel)?;
    Some(index % 6)
}

/// A run's channel measured and fitted, what the fit leaves of it beside the noise, and the commanded load.
pub(super) fn run(trace: &Trace) -> Figure {
    let quantity = Quantity::of(&trace.channel);
    let title = format!("{}: {}", trace.run, quantity.name);
    let over_time = |values: &[f64]| points(&trace.times_s, &quantity.shown(values));
    let mut motion = Panel::new(&title, Axis::time(), Axis::new(quantity.axis())).height(FIT_PX);
    if let Some(sd) = trace.noise_sd {
        let half = BAND_SD * sd;
        let within = trace.times_s.iter().zip(&trace.fitted).map(|(t, v)| {
            let [low, high] = [v - half, v + half].map(|v| v * quantity.factor);
            [*t, low, high]
        });
        motion = motion.ribbon(
            &format!("noise, {BAND_SD} sd"),
            Colour::BLUE,
            within.collect(),
        );
    }
    let left = residuals("measured - fitted", &quantity, trace.noise_sd).height(RESIDUAL_PX);
    let mut panels = vec![
        motion
            .line("measured", Colour::GREY, over_time(&trace.measured))
            .line("fitted", Colour::BLUE, over_time(&trace.fitted)),
        left.line("", Colour::BLUE, over_time(&trace.residual())),
    ];
    if let (Some(dof), Some(span_s)) = (dof(&trace.channel), trace.span_s()) {
        panels.extend(commands(&trace.edges, dof, span_s));
    }
    Figure::stack(
        format!("{title}: measured and fitted, their difference and the commanded load over time"),
        panels,
    )
    .shared_x()
}

/// One channel of all runs over each other, from where each begins, and what the fit leaves of them.
pub(super) fn overlaid(channel: &str, traces: &[&Trace]) -> Figure {
    let quantity = Quantity::of(channel);
    let noises: Vec<f64> = traces.iter().filter_map(|t| t.noise_sd).collect();
    let loudest = noises.into_iter().reduce(f64::max);
    let mut motion = Panel::new(
        format!("{}, from where each run begins", quantity.name),
        Axis::time(),
        Axis::new(quantity.axis()),
    );
    let mut left = residuals("measured - fitted", &quantity, loudest);
    for (k, trace) in traces.iter().enumerate() {
        let begins = trace.times_s.first().copied().unwrap_or(0.0);
        let first = trace.measured.iter().copied().find(|v| v.is_finite());
        let times: Vec<f64> = trace.times_s.iter().map(|t| t - begins).collect();
        let moved: Vec<f64> = trace
            .measured
            .iter()
            .map(|v| v - first.unwrap_or(0.0))
            .collect();
        let colour = Colour::series(k);
        motion = motion.line(&trace.run, colour, points(&times, &quantity.shown(&moved)));
        left = left.line(
            "",
            colour,
            points(&times, &quantity.shown(&trace.residual())),
        );
    }
    Figure::stack(
        format!("{}: all runs over each other", quantity.name),
        vec![motion, left],
    )
    .shared_x()
}

/// Autocorrelation of what the fit leaves of one channel; `None` where every run is too short.
pub(super) fn whiteness(channel: &str, traces: &[&Trace]) -> Option<Figure> {
    let left: Vec<(Vec<f64>, f64)> = traces
        .iter()
        .map(|t| (t.residual(), interval_s(&t.times_s)))
        .collect();
    let runs: Vec<Left<'_>> = traces
        .iter()
        .zip(&left)
        .map(|(trace, (residual, interval_s))| Left {
            name: &trace.run,
            interval_s: *interval_s,
            residual,
        })
        .collect();
    let name = Quantity::of(channel).name;
    let panel = autocorrelation(format!("{name}: measured - fitted"), &runs)?;
    Some(Figure::stack(
        format!("{name}: autocorrelation of the residuals"),
        vec![panel],
    ))
}
