//! Panels that the reports of identify, predict and diagnose share.

use hydroline_numerics::statistics::{Correlogram, median};
use hydroline_report::{Axis, Colour, Panel, Quantity};

/// Half width of the drawn noise band, in standard deviations.
pub const BAND_SD: f64 = 2.0;
/// Height of a panel that shows loads or correlations \[px\].
const LOW_PX: f64 = 80.0;
/// Body loads in the order of the DOFs: SNAME, with their units.
const LOADS: [&str; 6] = ["X [N]", "Y [N]", "Z [N]", "K [N m]", "M [N m]", "N [N m]"];
/// Most lags of a drawn autocorrelation: 4 s at 25 samples a second, longer than a thruster or a filter remembers.
const MOST_LAGS: usize = 100;
/// Samples per lag at least: the correlation at the greatest lag still has three quarters of them.
const SAMPLES_PER_LAG: usize = 4;
/// 95 % of a standard normal variable lie within so many sd.
const NORMAL_95: f64 = 1.96;

/// A residual's axis over time, with the noise as a band where it is known \[SI\], in the unit shown.
pub fn residuals(
    title: impl Into<String>,
    quantity: &Quantity<'_>,
    noise_sd: Option<f64>,
) -> Panel {
    let panel = Panel::new(
        title,
        Axis::time(),
        Axis::new(quantity.with_unit("residual")),
    );
    let Some(noise_sd) = noise_sd.filter(|sd| sd.is_finite()) else {
        return panel;
    };
    let half = BAND_SD * noise_sd * quantity.factor;
    panel.band(&format!("noise, {BAND_SD} sd"), Colour::GREY, [-half, half])
}

/// Where the load in one DOF changes, as (time, load) \[s; N, N m\], from body wrenches over time.
pub fn edges(commands: impl IntoIterator<Item = (f64, [f64; 6])>, dof: usize) -> Vec<(f64, f64)> {
    let mut edges: Vec<(f64, f64)> = Vec::new();
    for (t_s, wrench) in commands {
        let load = wrench[dof];
        if edges.last().map_or(load != 0.0, |e| e.1 != load) {
            edges.push((t_s, load));
        }
    }
    edges
}

/// The commanded load in a DOF over the time that is shown; `None` where nothing is commanded in it.
pub fn commands(edges: &[(f64, f64)], dof: usize, [from_s, to_s]: [f64; 2]) -> Option<Panel> {
    if edges.is_empty() {
        return None;
    }
    let mut points = vec![[from_s, 0.0]];
    for (t_s, load) in edges.iter().filter(|e| e.0 <= to_s) {
        let before = points.last().map_or(0.0, |p| p[1]);
        let at_s = t_s.max(from_s);
        points.extend([[at_s, before], [at_s, *load]]);
    }
    let last = points.last().map_or(0.0, |p| p[1]);
    points.push([to_s, last]);
    let panel = Panel::new("commanded load", Axis::time(), Axis::new(LOADS[dof]));
    let panel = panel.height(LOW_PX);
    Some(panel.line("", Colour::BLACK, points))
}

/// Residuals of one run, for their autocorrelation.
#[derive(Debug, Clone, Copy)]
pub struct Left<'a> {
    /// The run.
    pub name: &'a str,
    /// Time between two samples \[s\].
    pub interval_s: f64,
    /// Measured minus model; NaN = none.
    pub residual: &'a [f64],
}

/// Median distance of stamps \[s\].
pub fn interval_s(times_s: &[f64]) -> f64 {
    let mut gaps: Vec<f64> = times_s.windows(2).map(|w| w[1] - w[0]).collect();
    median(&mut gaps).unwrap_or(0.0)
}

/// Autocorrelation of residuals, all runs over each other, beside the band in which white noise stays in 95 % of
/// the lags (Bartlett: sd 1/sqrt(n)); `None` where every run is too short.
pub fn autocorrelation(title: impl Into<String>, runs: &[Left<'_>]) -> Option<Panel> {
    let mut panel = Panel::new(title, Axis::new("lag [s]"), Axis::new("autocorrelation"));
    let mut lines = Vec::new();
    let mut fewest = usize::MAX;
    for (k, run) in runs.iter().enumerate() {
        let count = run.residual.iter().filter(|v| v.is_finite()).count();
        let lags = (count / SAMPLES_PER_LAG).min(MOST_LAGS);
        let Some(found) = Correlogram::of(&[run.residual.to_vec()], lags).filter(|_| lags > 0)
        else {
            continue;
        };
        fewest = fewest.min(count);
        let correlations = std::iter::once(1.0).chain(found.correlations);
        let points = (0u32..)
            .zip(correlations)
            .map(|(lag, r)| [f64::from(lag) * run.interval_s, r]);
        lines.push((run.name, Colour::series(k), points.collect()));
    }
    if lines.is_empty() {
        return None;
    }
    let half = NORMAL_95 / (fewest as f64).sqrt();
    panel = panel.band("white noise, 95 %", Colour::GREY, [-half, half]);
    let drawn = lines
        .into_iter()
        .fold(panel, |panel, (name, colour, points)| {
            panel.line(name, colour, points)
        });
    Some(drawn)
}

#[cfg(test)]
mod tests {
    use super::*;
    use hydroline_report::Figure;

    fn drawn(panel: Panel) -> String {
        Figure::stack("", vec![panel]).file()
    }

    #[test]
    fn a_load_holds_until_the_next_command() {
        let wrench = |x: f64| [x, 0.0, 0.0, 0.0, 0.0, 0.0];
        let commands_of = [
            (0.0, wrench(0.0)),
            (2.0, wrench(4.0)),
            (3.0, wrench(4.0)),
            (8.0, wrench(0.0)),
        ];
        let edges = edges(commands_of, 0);
        assert_eq!(edges, [(2.0, 4.0), (8.0, 0.0)]);
        assert!(drawn(commands(&edges, 0, [0.0, 10.0]).unwrap()).contains(">X [N]<"));
        assert!(commands(&[], 0, [0.0, 10.0]).is_none());
    }

    #[test]
    fn residuals_without_a_known_noise_have_no_band() {
        let quantity = Quantity::of("x_m");
        assert!(drawn(residuals("", &quantity, Some(1e-3))).contains("noise, 2 sd"));
        for unknown in [None, Some(f64::NAN)] {
            assert!(!drawn(residuals("", &quantity, unknown)).contains("noise"));
        }
    }

    #[test]
    fn an_autocorrelation_has_its_band_and_short_runs_none() {
        let long: Vec<f64> = (0..400).map(|k| (12.9 * f64::from(k)).sin()).collect();
        let left = |name, residual| Left {
            name,
            interval_s: 0.04,
            residual,
        };
        let runs = [left("a", &long[..]), left("b", &long[..2])];
        let svg = drawn(autocorrelation("", &runs).unwrap());
        assert!(svg.contains("white noise, 95 %") && svg.contains(">a<") && !svg.contains(">b<"));
        assert!(autocorrelation("", &runs[1..]).is_none());
    }
}
