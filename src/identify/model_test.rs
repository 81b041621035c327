//! Test of whether a model explains its runs, and its sentence: one for `identify`, `diagnose`, `predict --measured` and `campaign`.
//!
//! What is left in a channel counts against a model where it is no noise at the stated level, and larger than the rig's tolerance:
//! less is real as well, and is in the intervals, but matters to nobody.

use hydroline_core::run::Channel;
use hydroline_rigs::Dof;
use serde::{Deserialize, Serialize};

/// Probability with which a model that explains its runs is called one that does not, of all channels together.
pub const LEVEL: f64 = 0.01;
/// Load of a DOF over the largest of all below which it is the rounding of pulses.
const ROUNDING: f64 = 0.01;

/// Residual of one channel.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LeftOver {
    /// The channel.
    pub channel: Channel,
    /// rms of measured minus modelled; NaN where the model gives no finite motion \[SI\].
    pub rms: f64,
    /// rms that noise alone would leave \[SI\].
    pub noise: f64,
    /// Largest rms beside the noise that is tolerated \[SI\].
    pub tolerance: f64,
    /// Probability of such a residual if it were noise.
    pub p_value: f64,
    /// A force that the model lacks is likely to be worth more than the tolerance in this DOF.
    pub lacks_force: bool,
}

impl LeftOver {
    /// rms beside the noise \[SI\]; NaN where there is none.
    pub fn beyond(&self) -> f64 {
        let square = self.rms.powi(2) - self.noise.powi(2);
        if square < 0.0 { 0.0 } else { square.sqrt() }
    }

    /// Whether it is larger than what is tolerated.
    pub fn matters(&self) -> bool {
        let beyond = self.beyond();
        self.lacks_force || beyond.is_nan() || beyond > self.tolerance
    }
}

/// Residual of one channel, as it is printed.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, schemars::JsonSchema)]
pub struct ChannelLeft {
    /// Channel, its unit in its name.
    pub channel: String,
    /// rms of measured minus modelled; absent where the model gives no finite motion \[SI\].
    pub rms: Option<f64>,
    /// rms that noise alone would leave \[SI\].
    pub noise: f64,
    /// Largest rms beside the noise that is tolerated \[SI\].
    pub tolerance: f64,
    /// Probability of such a residual if it were noise, by this channel alone.
    pub p_value: f64,
    /// No noise at the level of the test, and larger than what is tolerated.
    pub is_misfit: bool,
}

/// Commands that act later than their stamps say, by a row of the log or less.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, schemars::JsonSchema)]
pub struct Late {
    /// Time by which commands would have to be late \[s\].
    pub late_s: f64,
    /// Usual distance of the log's rows \[s\].
    pub row_s: f64,
    /// Largest rate of the channel that shows most of it.
    pub rate: f64,
    /// That channel.
    pub channel: String,
}

/// Whether a model explains its runs.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize, schemars::JsonSchema)]
pub struct ModelTest {
    /// Level: probability with which a model that explains its runs is called one that does not.
    pub level: f64,
    /// Probability of what is left if it were noise, over all channels that were asked (Bonferroni).
    pub p_value: f64,
    /// Whether nothing is left that is no noise at this level and larger than the tolerance; true as well where `late` explains it.
    pub explains: bool,
    /// The same in a sentence.
    pub sentence: String,
    /// Channel by channel.
    pub channels: Vec<ChannelLeft>,
    /// DOFs whose motion the model was asked to explain.
    pub explained: Vec<String>,
    /// DOFs that any command drove.
    pub driven: Vec<String>,
    /// Lateness of the commands that would leave the same; absent = none of a row or less does.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub late: Option<Late>,
}

/// DOFs that body wrenches drive: others have traces of them, since pulses are rounded.
pub fn driven(wrenches: impl Iterator<Item = [f64; 6]>) -> [bool; 6] {
    let largest = wrenches.fold([0.0_f64; 6], |m, w| {
        std::array::from_fn(|d| m[d].max(w[d].abs()))
    });
    let most = largest.iter().copied().fold(0.0, f64::max);
    largest.map(|l| l > ROUNDING * most)
}

/// Words as a sentence lists them.
pub fn listed(words: &[impl AsRef<str>]) -> String {
    let words: Vec<&str> = words.iter().map(AsRef::as_ref).collect();
    match words.as_slice() {
        [] => String::new(),
        [one] => (*one).to_owned(),
        [first @ .., last] => format!("{} and {last}", first.join(", ")),
    }
}

/// An amount of a channel in the unit that people use.
pub fn amount(channel: &str, value: f64) -> String {
    if channel.ends_with("_rad") {
        format!("{:.2} deg", value.to_degrees())
    } else if channel.ends_with("_radps") {
        format!("{:.2} deg/s", value.to_degrees())
    } else if channel.ends_with("_mps") {
        format!("{:.2} mm/s", value * 1e3)
    } else {
        format!("{:.2} mm", value * 1e3)
    }
}

/// DOFs that were explained: " in surge and yaw".
fn inside(explained: &[&str]) -> String {
    match explained {
        [] => String::new(),
        some => format!(" in {}", listed(some)),
    }
}

/// Of these DOFs what nothing ever drove: "; sway and yaw were never driven".
fn undriven(explained: &[&str], driven: &[bool; 6]) -> String {
    if driven.iter().all(|d| !d) {
        return "; nothing was driven".to_owned();
    }
    let never: Vec<&str> = Dof::ALL
        .iter()
        .filter(|d| !driven[d.index()] && !explained.contains(&d.name()))
        .map(|d| d.name())
        .collect();
    match never.as_slice() {
        [] => String::new(),
        [one] => format!("; {one} was never driven"),
        some => format!("; {} were never driven", listed(some)),
    }
}

fn probability(p: f64) -> String {
    if p < 1e-12 {
        "p < 1e-12".to_owned()
    } else {
        format!("p = {p:.1e}")
    }
}

impl ModelTest {
    /// The test of these residuals.
    ///
    /// `explained` = DOFs that the model was asked for, by name; `late` = lateness of the commands that explains what is left.
    pub fn of(
        left: &[LeftOver],
        explained: &[&str],
        driven: [bool; 6],
        late: Option<Late>,
    ) -> ModelTest {
        let asked = left.len().max(1) as f64;
        let misfit =
            |l: &LeftOver| (asked * l.p_value < LEVEL || l.p_value.is_nan()) && l.matters();
        let mut wrong: Vec<&LeftOver> = left.iter().filter(|l| misfit(l)).collect();
        wrong.sort_by(|a, b| (b.beyond() / b.tolerance).total_cmp(&(a.beyond() / a.tolerance)));
        let least = left.iter().map(|l| l.p_value).fold(1.0, f64::min);
        let p_value = (asked * least).min(1.0);
        let late = late.filter(|_| !wrong.is_empty());
        let never = undriven(explained, &driven);
        let sentence = match (&late, wrong.as_slice()) {
            (_, []) => format!(
                "Nothing that matters was left out{}{never}.",
                inside(explained)
            ),
            (Some(l), _) => format!(
                "Commands that act {:.0} ms after their stamps, a row of these logs ({:.0} ms) or less, would leave what is left ({:.0} ms x {} = {}): see which row a command belongs to{never}.",
                1e3 * l.late_s,
                1e3 * l.row_s,
                1e3 * l.late_s,
                per_second(&l.channel, l.rate),
                amount(&l.channel, l.late_s * l.rate)
            ),
            (None, all) => {
                let each: Vec<String> = all.iter().map(|l| said(l)).collect();
                format!(
                    "The model does not explain these runs: {} ({}, level {:.0} %){never}.",
                    listed(&each),
                    probability(p_value),
                    100.0 * LEVEL
                )
            }
        };
        let names = |of: &dyn Fn(&Dof) -> bool| -> Vec<String> {
            let each = Dof::ALL.iter().filter(|d| of(d));
            each.map(|d| d.name().to_owned()).collect()
        };
        ModelTest {
            level: LEVEL,
            p_value,
            explains: wrong.is_empty() || late.is_some(),
            sentence,
            channels: left
                .iter()
                .map(|l| ChannelLeft {
                    channel: l.channel.name().to_owned(),
                    rms: Some(l.rms).filter(|v| v.is_finite()),
                    noise: l.noise,
                    tolerance: l.tolerance,
                    p_value: l.p_value,
                    is_misfit: misfit(l),
                })
                .collect(),
            explained: explained.iter().map(|d| (*d).to_owned()).collect(),
            driven: names(&|d| driven[d.index()]),
            late,
        }
    }

    /// Sentences that say that the model does not explain the runs; empty where it does, and where nothing was asked.
    pub fn misfit(&self) -> Vec<String> {
        if self.explains || self.sentence.is_empty() {
            return Vec::new();
        }
        vec![self.sentence.clone()]
    }

    /// DOFs that were explained and those that nothing ever drove, in words: " in surge", "; sway and yaw were never driven"; empty where nothing was asked.
    pub fn scope(&self) -> [String; 2] {
        if self.sentence.is_empty() {
            return [String::new(), String::new()];
        }
        let explained: Vec<&str> = self.explained.iter().map(String::as_str).collect();
        let driven = Dof::ALL.map(|d| self.driven.iter().any(|n| n == d.name()));
        [inside(&explained), undriven(&explained, &driven)]
    }
}

fn said(l: &LeftOver) -> String {
    let name = l.channel.name();
    let dof = l.channel.dof().name();
    if l.rms.is_nan() {
        return format!("no finite motion in {name} ({dof})");
    }
    format!(
        "{} rms is left in {name} ({dof}), where noise leaves {}",
        amount(name, l.rms),
        amount(name, l.noise)
    )
}

/// A rate in the unit that its channel's amounts have.
fn per_second(channel: &str, rate: f64) -> String {
    match channel.contains("rad") {
        true => format!("{:.2} deg/s", rate.to_degrees()),
        false => format!("{rate:.3} m/s"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn x(rms: f64, p_value: f64) -> LeftOver {
        LeftOver {
            channel: Channel::X,
            rms,
            noise: 2e-4,
            tolerance: 2e-3,
            p_value,
            lacks_force: false,
        }
    }

    const SURGE: [bool; 6] = [true, false, false, false, false, false];

    #[test]
    fn what_is_small_or_noise_is_no_misfit_and_the_dofs_never_driven_are_named() {
        for small in [x(1e-3, 1e-30), x(0.05, 0.3)] {
            let test = ModelTest::of(&[small], &["surge"], SURGE, None);
            assert!(test.explains && test.misfit().is_empty());
            assert_eq!(
                test.sentence,
                "Nothing that matters was left out in surge; sway, heave, roll, pitch and yaw were never driven."
            );
        }
        let test = ModelTest::of(&[x(0.01, 1e-5)], &["surge"], SURGE, None);
        assert!(!test.explains);
        assert_eq!(
            test.misfit(),
            [
                "The model does not explain these runs: 10.00 mm rms is left in x_m (surge), where noise leaves 0.20 mm (p = 1.0e-5, level 1 %); sway, heave, roll, pitch and yaw were never driven."
            ]
        );
        // Two channels share the level.
        let test = ModelTest::of(&[x(0.01, 0.007), x(2e-4, 0.5)], &["surge"], SURGE, None);
        assert!(test.explains, "{test:?}");
        let free = ModelTest::of(&[], &["roll"], [false; 6], None);
        assert!(free.sentence.ends_with("in roll; nothing was driven."));
    }

    #[test]
    fn commands_a_row_late_are_said_in_place_of_a_misfit() {
        let late = Some(Late {
            late_s: 0.03,
            row_s: 0.04,
            rate: 0.2,
            channel: "x_m".to_owned(),
        });
        let test = ModelTest::of(&[x(6e-3, 1e-9)], &["surge"], SURGE, late.clone());
        assert!(test.explains && test.late.is_some());
        assert!(
            test.sentence
                .contains("30 ms x 0.200 m/s = 6.00 mm): see which row"),
            "{}",
            test.sentence
        );
        // Where nothing is left there is nothing to explain.
        assert_eq!(
            ModelTest::of(&[x(1e-4, 0.5)], &["surge"], SURGE, late).late,
            None
        );
    }

    #[test]
    fn traces_of_rounded_pulses_drive_nothing() {
        let wrenches = [
            [8.0, 0.0, 0.0, 0.0, 0.02, 0.0],
            [0.0, 0.0, 0.0, 0.0, 0.0, 0.5],
        ];
        let found = driven(wrenches.into_iter());
        assert_eq!(found, [true, false, false, false, false, true]);
        assert_eq!(driven(std::iter::empty()), [false; 6]);
    }
}
