//! Runs of one plan, drawn over each other: what differs between them is seen at once.

use crate::evenly;
use crate::sheet::{Coefficients, Motion};
use crate::store::Store;
use crate::table::{Row, word};
use hydroline_core::run::Channel;
use hydroline_report::{Axis, Colour, Figure, Panel};
use std::collections::BTreeMap;

/// Runs drawn over each other at most: of more, evenly over time. Outliers are drawn beside them.
const RUNS: usize = 24;
/// Channels drawn at most: those that move most, in units of their noise.
const DRAWN: usize = 3;

/// A run as an overlay needs it.
#[derive(Debug, Clone)]
pub struct Drawn {
    key: String,
    log: String,
    date: String,
    is_outlier: bool,
}

impl Drawn {
    /// Of a run's row; `key` of its unit.
    pub fn of(row: &Row, key: &str) -> Self {
        Self {
            key: key.to_owned(),
            log: word(row, "log"),
            date: word(row, "date"),
            is_outlier: row.contains_key("outlier_ratio"),
        }
    }
}

/// A channel that goes no further than so many sd of its noise is one that stood still: noise alone spans some eight.
const STILL: f64 = 20.0;

/// The channels of a group that are drawn: poses, else rates, by how far they go over the noise that the fit to the group has
/// found. Channels that it does not model are drawn only where there is no fit.
pub fn channels(
    covered: &BTreeMap<&'static str, ([f64; 2], usize)>,
    fitted: Option<&Coefficients>,
) -> Vec<&'static str> {
    let far = |channel: &&'static str| -> Option<(f64, &'static str)> {
        let ([least, greatest], _) = covered.get(channel)?;
        let span = greatest - least;
        let over_noise = match fitted {
            Some(fitted) => span / fitted.noise_sd.get(*channel)?,
            None => f64::INFINITY,
        };
        (span > 0.0 && over_noise > STILL).then_some((over_noise, *channel))
    };
    let of = |all: [Channel; 6]| all.into_iter().filter_map(|c| far(&c.name())).collect();
    let mut found: Vec<(f64, &str)> = of(Channel::POSES);
    if found.is_empty() {
        found = of(Channel::RATES);
    }
    found.sort_by(|a, b| b.0.total_cmp(&a.0));
    found.into_iter().take(DRAWN).map(|(_, c)| c).collect()
}

/// A figure of a plan's runs, and its caption; `None` = fewer than two have motion.
pub fn overlay(
    plan: &str,
    runs: &[Drawn],
    channels: &[&str],
    store: &Store,
) -> Option<(Figure, String)> {
    let (odd, usual): (Vec<&Drawn>, Vec<&Drawn>) = runs.iter().partition(|r| r.is_outlier);
    let n = usual.len();
    let kept = evenly(usual, RUNS);
    let moved = |run: &&Drawn| Some(((*run).clone(), store.get::<Motion>(&motion_key(&run.key))?));
    let usual: Vec<(Drawn, Motion)> = kept.iter().filter_map(moved).collect();
    let odd: Vec<(Drawn, Motion)> = odd.iter().take(RUNS).filter_map(moved).collect();
    if usual.len() + odd.len() < 2 {
        return None;
    }
    let mut dates: Vec<&str> = usual.iter().map(|(run, _)| run.date.as_str()).collect();
    dates.dedup();
    let panels: Vec<Panel> = channels
        .iter()
        .map(|channel| {
            let mut panel = Panel::new(*channel, Axis::time(), Axis::new(*channel));
            for (k, date) in dates.iter().enumerate() {
                for (j, (_, motion)) in usual.iter().filter(|(r, _)| r.date == *date).enumerate() {
                    let name = if j == 0 { *date } else { "" };
                    panel = panel.line(name, Colour::series(k), motion.line(channel));
                }
            }
            for (run, motion) in &odd {
                let name = format!("outlier: {}", run.log);
                panel = panel.line(&name, Colour::BLACK, motion.line(channel));
            }
            panel
        })
        .collect();
    let shown = match n > RUNS {
        true => format!("{} of {n} runs, evenly over time", usual.len()),
        false => format!("{} runs", usual.len()),
    };
    let caption = format!("{plan}: {shown}, over each other; a colour is a day.");
    Some((Figure::stack(format!("Runs of {plan}"), panels), caption))
}

/// Key of a run's motion, beside its sheet.
pub fn motion_key(unit: &str) -> String {
    format!("{unit}-motion")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn channels_are_drawn_by_how_far_they_go_over_their_noise() {
        let covered = [
            ("x_m", ([0.0, 1.0], 2)),
            ("y_m", ([0.0, 3.0], 2)),
            ("z_m", ([0.0, 2.0], 2)),
            ("phi_rad", ([0.0, 0.01], 2)),
            ("psi_rad", ([0.0, 0.0], 2)),
            ("u_mps", ([0.0, 9.0], 2)),
        ]
        .into();
        let fitted = Coefficients {
            noise_sd: [("z_m", 0.05), ("x_m", 0.001), ("phi_rad", 0.001)]
                .map(|(channel, sd)| (channel.to_owned(), sd))
                .into(),
            ..Coefficients::default()
        };
        assert_eq!(channels(&covered, Some(&fitted)), ["x_m", "z_m"]);
        assert_eq!(channels(&covered, None), ["x_m", "y_m", "z_m"]);
        let rates = [("u_mps", ([0.0, 9.0], 2))].into();
        assert_eq!(channels(&rates, None), ["u_mps"]);
    }

    #[test]
    fn many_runs_are_thinned_and_an_outlier_is_always_drawn() {
        let dir = tempfile::tempdir().unwrap();
        let store = Store::open(dir.path()).unwrap();
        let motion = Motion {
            channels: [("x_m".to_owned(), vec![[0.0, 1.0], [1.0, 2.0]])].into(),
        };
        let runs: Vec<Drawn> = (0..100)
            .map(|k| Drawn {
                key: format!("k{k}"),
                log: format!("log-{k}"),
                date: format!("2026-05-{:02}", 1 + k / 50),
                is_outlier: k == 1,
            })
            .collect();
        let at = |runs: &[Drawn]| overlay("reversals", runs, &["x_m"], &store);
        assert!(at(&runs).is_none(), "no motion is kept");
        for run in &runs {
            store.put(&motion_key(&run.key), &motion).unwrap();
        }
        assert!(at(&runs[..1]).is_none());
        let (figure, caption) = at(&runs).unwrap();
        assert!(caption.contains("24 of 99 runs"), "{caption}");
        let svg = figure.file();
        for name in ["2026-05-01", "2026-05-02", "outlier: log-1"] {
            assert!(svg.contains(name), "{name}");
        }
    }
}
