//! Focus, exposure and laser in words: one line for a terminal, one row each for the live page.

use super::aim::{AimView, PEAK_MIN, SATURATED_MAX, SIGMA_MAX_PX, SLOW, WIDE};
use hydroline_live::state::Check;

/// Columns of the narrowest terminal.
pub const TERMINAL_COLUMNS: usize = 80;
/// The share of the stripe on the target may differ by so much from what the rig's start would give.
const TARGET_WITHIN: f64 = 0.15;
/// Less of the stripe on the target is none.
const TARGET_LEAST: f64 = 0.02;

/// One thing to get right: is it, in few words for the line, in more for the page.
struct Judged {
    what: &'static str,
    good: Option<bool>,
    short: String,
    long: String,
}

fn judged(
    what: &'static str,
    good: impl Into<Option<bool>>,
    short: String,
    long: String,
) -> Judged {
    Judged {
        what,
        good: good.into(),
        short,
        long,
    }
}

impl AimView {
    fn focus(&self) -> Judged {
        match self.sigma_px {
            None => judged(
                "focus",
                None,
                "focus -".to_owned(),
                "nothing to judge by".to_owned(),
            ),
            Some(sigma) if sigma > SIGMA_MAX_PX => judged(
                "focus",
                false,
                format!("focus soft {sigma:.1} px"),
                format!(
                    "soft: the line is {sigma:.1} px wide (sd); focus the lens, then the laser"
                ),
            ),
            Some(sigma) => judged(
                "focus",
                true,
                format!("focus ok {sigma:.1} px"),
                format!("the line is {sigma:.1} px wide (sd)"),
            ),
        }
    }

    fn exposure(&self) -> Judged {
        let percent = 100.0 * self.saturated;
        match self.peak {
            None => judged(
                "exposure",
                None,
                "exposure -".to_owned(),
                "nothing to judge by".to_owned(),
            ),
            _ if self.saturated > SATURATED_MAX => judged(
                "exposure",
                false,
                format!("exposure bright {percent:.0} %"),
                format!(
                    "too bright: {percent:.0} % saturated; shorten the exposure or lower the gain"
                ),
            ),
            Some(peak) if peak < PEAK_MIN => judged(
                "exposure",
                false,
                format!("exposure dark {peak:.0}"),
                format!(
                    "too dark: peak {peak:.0} of 255; lengthen the exposure or darken the hall"
                ),
            ),
            Some(peak) => judged(
                "exposure",
                true,
                format!("exposure ok {peak:.0}"),
                format!("peak {peak:.0} of 255, {percent:.0} % saturated"),
            ),
        }
    }

    fn laser(&self) -> Judged {
        let (found, all) = self.columns;
        if found == 0 {
            let long = "no stripe: is the laser on, in view, and the lens cap off?";
            return judged("laser", false, "no laser line".to_owned(), long.to_owned());
        }
        if (found as f64) < WIDE * f64::from(all) {
            return judged(
                "laser",
                false,
                format!("laser narrow {found}/{all}"),
                format!(
                    "a stripe in only {found} of {all} columns: aim the fan at the image's middle"
                ),
            );
        }
        let Some((share, expected)) = self.on_target else {
            let long = format!("a stripe in {found} of {all} columns");
            return judged("laser", true, format!("laser ok {found}/{all}"), long);
        };
        let (share_pc, expected_pc) = (100.0 * share, 100.0 * expected);
        let long = format!(
            "{share_pc:.0} % of the line on the target, {expected_pc:.0} % at the rig's start"
        );
        if share < TARGET_LEAST && expected >= TARGET_LEAST {
            let long = format!(
                "beside the target: none of the line on it, {expected_pc:.0} % at the rig's start"
            );
            return judged("laser", false, "laser off target".to_owned(), long);
        }
        let good = (share - expected).abs() <= TARGET_WITHIN;
        let short = if good {
            "laser on target"
        } else {
            "laser part on target"
        };
        judged("laser", good, short.to_owned(), long)
    }

    fn camera(&self) -> Judged {
        if self.stands_still() {
            let silent_s = self.silent_s;
            let long = format!(
                "no frame for {silent_s:.0} s: is the cable in? `hydroline check` says more"
            );
            return judged("camera", false, format!("no frame {silent_s:.0} s"), long);
        }
        if let Some(fault) = self.newest_fault {
            let long = format!("the newest frame is faulty ({fault}): check cable, hub and power");
            return judged("camera", false, "faulty frame".to_owned(), long);
        }
        let rate = self.steady_fps.unwrap_or(self.rate_fps);
        let slow = self.steady_fps.is_some_and(|r| r < SLOW * self.wanted_fps);
        let word = if slow { "slow " } else { "" };
        judged(
            "camera",
            !slow,
            format!("{word}{rate:.1} fps"),
            format!(
                "{rate:.1} of {:.1} frames/s, {} lost, {} faulty",
                self.wanted_fps, self.lost, self.faulty
            ),
        )
    }

    /// One row each for the live page.
    pub fn checks(&self) -> Vec<Check> {
        [self.focus(), self.exposure(), self.laser(), self.camera()]
            .into_iter()
            .map(|j| Check {
                what: j.what,
                good: j.good,
                words: j.long,
            })
            .collect()
    }

    /// One line that a terminal of [`TERMINAL_COLUMNS`] shows whole. What has no room is omitted, last first.
    pub fn line(&self) -> String {
        let judged = [self.focus(), self.exposure(), self.laser(), self.camera()];
        let mut parts: Vec<String> = judged.into_iter().map(|j| j.short).collect();
        if self.lost > 0 {
            parts.push(format!("lost {}", self.lost));
        }
        if let Some(min) = self.disk_min {
            parts.push(format!("disk {min:.0} min"));
        }
        let mut line = String::new();
        for part in parts {
            let between = if line.is_empty() { "" } else { " | " };
            // The cursor stands behind it.
            if line.chars().count() + between.len() + part.chars().count() >= TERMINAL_COLUMNS {
                break;
            }
            line += between;
            line += &part;
        }
        line
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn good() -> AimView {
        AimView {
            rate_fps: 25.0,
            wanted_fps: 25.0,
            steady_fps: Some(25.0),
            silent_s: 0.0,
            newest_fault: None,
            lost: 0,
            faulty: 0,
            peak: Some(180.0),
            sigma_px: Some(2.0),
            saturated: 0.0,
            columns: (700, 720),
            noise_sd: 2.0,
            on_target: Some((0.61, 0.6)),
            disk_min: Some(42.0),
        }
    }

    #[test]
    fn all_is_well_in_one_line() {
        let line = good().line();
        assert_eq!(
            line,
            "focus ok 2.0 px | exposure ok 180 | laser on target | 25.0 fps | disk 42 min"
        );
        assert!(good().checks().iter().all(|c| c.good == Some(true)));
    }

    #[test]
    fn each_trouble_has_its_word() {
        let of = |change: fn(&mut AimView)| {
            let mut view = good();
            change(&mut view);
            let bad = view
                .checks()
                .iter()
                .filter(|c| c.good == Some(false))
                .count();
            assert_eq!(bad, 1, "{:?}", view.checks());
            view.line()
        };
        assert!(of(|g| g.sigma_px = Some(4.2)).contains("focus soft 4.2 px"));
        assert!(of(|g| g.peak = Some(40.0)).contains("exposure dark 40"));
        assert!(of(|g| g.saturated = 0.3).contains("exposure bright 30 %"));
        assert!(of(|g| g.on_target = Some((0.0, 0.6))).contains("laser off target"));
        assert!(of(|g| g.on_target = Some((0.3, 0.6))).contains("laser part on target"));
        assert!(of(|g| g.columns = (100, 720)).contains("laser narrow 100/720"));
        assert!(of(|g| g.columns = (0, 720)).contains("no laser line"));
        assert!(of(|g| g.silent_s = 3.0).contains("no frame 3 s"));
        assert!(of(|g| g.steady_fps = Some(12.0)).contains("slow 12.0 fps"));
    }

    proptest! {
        #[test]
        fn whatever_is_seen_the_line_fits_and_names_the_three(
            rate in 0.0..1e6f64, sigma in proptest::option::of(0.0..1e5f64), peak in proptest::option::of(0.0..65_535.0f64),
            saturated in 0.0..=1.0f64, found in 0usize..100_000, all in 1u32..100_000, lost in any::<u64>(),
            target in proptest::option::of((0.0..=1.0f64, 0.0..=1.0f64)), disk in proptest::option::of(0.0..1e9f64), silent in 0.0..1e7f64,
        ) {
            let view = AimView {
                rate_fps: rate, steady_fps: Some(rate), silent_s: silent, lost, peak, sigma_px: sigma, saturated,
                columns: (found, all), on_target: target, disk_min: disk, ..good()
            };
            let line = view.line();
            prop_assert!(line.chars().count() < TERMINAL_COLUMNS, "{} columns: {line}", line.chars().count());
            for word in ["focus", "exposure", "laser"] {
                prop_assert!(line.contains(word), "{word}: {line}");
            }
        }
    }
}
