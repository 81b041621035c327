//! Plan files: the commands of the thrusters, step by step.

mod check;
mod evaluate;
mod load;

pub use load::{StepLoad, Wrench};

use std::path::Path;

use crate::raw::{Kind, Section, angle, is_name, keys_of, name, number, spellings, tables};
use load::Load;

shapes! {
    /// Course of the load over the step: constant, in a line from that of the step before, as a sine, or as a sine of
    /// rising or falling frequency.
    pub enum Shape: Copy by "shape" or "hold" {
        /// Constant load.
        Hold = "hold",
        /// Linear from the previous step's final load to this one.
        Ramp = "ramp",
        /// load * sin(2 pi t / period_s + phase_rad), t from the step's start.
        Sine = "sine" {
            /// Period; of `shape = "sine"`.
            period_s: f64 = number(0.004, 86_400.0, "s"),
            /// Phase at the step's begin; of `shape = "sine"`.
            phase_rad: f64 = angle(number(-360.0, 360.0, "deg")).or_deg(0.0),
        },
        /// load * sin of a linear sweep from f0_hz to f1_hz over the step.
        Chirp = "chirp" {
            /// Frequency at the step's begin; of `shape = "chirp"`.
            f0_hz: f64 = number(0.0, 250.0, "Hz"),
            /// Frequency at its end; of `shape = "chirp"`.
            f1_hz: f64 = number(0.0, 250.0, "Hz"),
        },
    }
}

table! {
    /// A step: a load that the thrusters make for a time. At least one; each has `wrench` or `thrust_n`.
    pub struct PlanStep as StepTyped, checked by foreign_keys {
        /// Duration of the step.
        pub for_s: f64 = number(0.0, 86_400.0, "s").above(),
        /// Shape over the step.
        pub shape: Shape = keys_of(),
        /// Load at full scale.
        pub load: StepLoad = Load,
    }
}

fn foreign_keys(_: &mut StepTyped, s: &Section<'_>) {
    let shape = s.item("shape");
    let chosen = shape
        .as_ref()
        .map_or(Some("hold"), |item| item.value.as_str());
    if !Shape::KEYS.iter().any(|(word, _)| Some(*word) == chosen) {
        return;
    }
    for (word, keys) in Shape::KEYS.iter().filter(|(word, _)| Some(*word) != chosen) {
        for key in keys
            .iter()
            .flat_map(|key| spellings(key))
            .filter(|key| s.has(key))
        {
            s.item(&key);
            s.rule(
                &key,
                format!("belongs to shape = \"{word}\" only"),
                format!("Set shape = \"{word}\" or remove {key}"),
            );
        }
    }
}

table! {
    /// A checked plan: its name stands before all tables.
    pub struct Plan as PlanTyped, checked by ramps {
        /// Name of the plan.
        pub name: String = name().later("the file's name"),
        /// Steps of the plan.
        key step: Vec<PlanStep> = tables(10_000) => |p| Some(p.steps.clone()),
        /// Steps in order; after the last the load is zero.
        made steps: Vec<PlanStep>,
        /// The plan as typed, for the log.
        made source_toml: String,
    }
}

fn ramps(typed: &mut PlanTyped, s: &Section<'_>) {
    typed.steps = typed.step.take();
    typed.source_toml = Some(String::new());
    if !s.has("name") {
        typed.name = Some(called_after(s.file()));
    }
    let Some(steps) = &typed.steps else { return };
    if steps.is_empty() {
        s.missing(
            "step",
            "at least one [[step]] with `for_s` and `wrench` or `thrust_n`",
        );
    }
    for (i, pair) in steps.windows(2).enumerate() {
        let kinds = [&pair[0].load, &pair[1].load].map(std::mem::discriminant);
        if pair[1].shape == Shape::Ramp && kinds[0] != kinds[1] {
            s.rule(
                &format!("step[{}].shape", i + 1),
                "a ramp starts from the load of the step before, but one is a wrench and the other a thrust_n",
                "Use wrench or thrust_n in both steps",
            );
        }
    }
}

/// Name of a plan without one: that of its file.
fn called_after(file: &str) -> String {
    let path = Path::new(file.strip_prefix("builtin:").unwrap_or(file));
    let stem = path.file_stem().and_then(|stem| stem.to_str());
    stem.filter(|stem| is_name(stem))
        .unwrap_or("plan")
        .to_owned()
}

impl Plan {
    /// Planned length \[s\].
    pub fn duration_s(&self) -> f64 {
        self.steps.iter().map(|s| s.for_s).sum()
    }
}
