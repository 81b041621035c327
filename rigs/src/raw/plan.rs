//! A plan file as typed.

use super::{Section, quantity};
use crate::{Plan, PlanStep, Shape, StepLoad, Wrench};

/// Reads a plan; `stem` names it when the file does not.
pub(crate) fn read_plan(root: &Section<'_>, stem: &str) -> Option<Plan> {
    let name = if root.has("name") {
        root.name("name")
    } else {
        root.item("name");
        Some(stem.to_owned())
    };
    root.default_is("name", "the file's name");
    let entries = root.tables("step", 10_000);
    if entries.is_empty() {
        root.missing(
            "step",
            "at least one [[step]] with `for_s` and `wrench` or `thrust_n`",
        );
    }
    let mut steps: Vec<PlanStep> = Vec::new();
    let mut sound = true;
    for entry in &entries {
        let step = read_step(entry);
        entry.finish();
        match step {
            Some(step) => {
                check_ramp(entry, &step, steps.last());
                steps.push(step);
            }
            None => sound = false,
        }
    }
    (sound && !steps.is_empty()).then_some(())?;
    Some(Plan {
        name: name?,
        steps,
        source_toml: String::new(),
    })
}

fn check_ramp(s: &Section<'_>, step: &PlanStep, previous: Option<&PlanStep>) {
    let Some(previous) = previous else { return };
    if step.shape == Shape::Ramp
        && std::mem::discriminant(&step.load) != std::mem::discriminant(&previous.load)
    {
        s.rule(
            "shape",
            "a ramp starts from the load of the step before, but one is a wrench and the other a thrust_n",
            "Use wrench or thrust_n in both steps",
        );
    }
}

fn read_step(s: &Section<'_>) -> Option<PlanStep> {
    let for_s = s.number("for_s", quantity(0.0, 86_400.0, "s").above());
    let shape = read_shape(s);
    let load = match (s.item("wrench"), s.item("thrust_n")) {
        (Some(_), Some(_)) => {
            s.rule(
                "thrust_n",
                "wrench and thrust_n are both given",
                "Keep one of the two",
            );
            None
        }
        (None, None) => {
            s.missing(
                "wrench",
                "`wrench = { surge_n = … }` or `thrust_n = { NAME = … }`; a pause is `wrench = {}`",
            );
            None
        }
        (Some(_), None) => read_wrench(&s.table("wrench")).map(StepLoad::Wrench),
        (None, Some(_)) => read_thrusts(&s.table("thrust_n")).map(StepLoad::ThrustN),
    };
    Some(PlanStep {
        for_s: for_s?,
        load: load?,
        shape: shape?,
    })
}

#[derive(Clone, Copy, PartialEq)]
enum Word {
    Hold,
    Ramp,
    Sine,
    Chirp,
}

fn read_shape(s: &Section<'_>) -> Option<Shape> {
    let typed = s.choice_opt(
        "shape",
        &[
            ("hold", Word::Hold),
            ("ramp", Word::Ramp),
            ("sine", Word::Sine),
            ("chirp", Word::Chirp),
        ],
    );
    if typed.is_none() && s.has("shape") {
        // Which parameters belong here is unknown until the shape is: blame none of them.
        for key in ["period_s", "phase_rad", "phase_deg", "f0_hz", "f1_hz"] {
            s.item(key);
        }
        return None;
    }
    s.default_is("shape", "hold");
    let word = typed.unwrap_or(Word::Hold);
    for (key, owner) in [
        ("period_s", Word::Sine),
        ("phase_rad", Word::Sine),
        ("phase_deg", Word::Sine),
        ("f0_hz", Word::Chirp),
        ("f1_hz", Word::Chirp),
    ] {
        if word != owner && s.has(key) {
            let shape = if owner == Word::Sine { "sine" } else { "chirp" };
            s.item(key);
            s.rule(
                key,
                format!("belongs to shape = \"{shape}\" only"),
                format!("Set shape = \"{shape}\" or remove {key}"),
            );
        }
    }
    let frequency = quantity(0.0, 250.0, "Hz");
    match word {
        Word::Hold => Some(Shape::Hold),
        Word::Ramp => Some(Shape::Ramp),
        Word::Sine => {
            let period_s = s.number("period_s", quantity(0.004, 86_400.0, "s"));
            let phase = s.angle_opt("phase", quantity(-360.0, 360.0, "deg"));
            let phase_typed = s.has("phase_rad") || s.has("phase_deg");
            if phase.is_none() && phase_typed {
                return None;
            }
            Some(Shape::Sine {
                period_s: period_s?,
                phase_rad: phase.unwrap_or(0.0),
            })
        }
        Word::Chirp => {
            let (f0_hz, f1_hz) = (s.number("f0_hz", frequency), s.number("f1_hz", frequency));
            Some(Shape::Chirp {
                f0_hz: f0_hz?,
                f1_hz: f1_hz?,
            })
        }
    }
}

fn read_wrench(s: &Section<'_>) -> Option<Wrench> {
    let keys = Wrench::KEYS;
    let mut components = [0.0; 6];
    let mut sound = true;
    for (component, key) in components.iter_mut().zip(keys) {
        let unit = if key.ends_with("_nm") { "N m" } else { "N" };
        let value = s.number_opt(key, quantity(-1e5, 1e5, unit));
        sound &= value.is_some() || !s.has(key);
        *component = value.unwrap_or(0.0);
    }
    s.finish();
    sound.then_some(Wrench::from_array(components))
}

fn read_thrusts(s: &Section<'_>) -> Option<Vec<(String, f64)>> {
    let mut thrusts = Vec::new();
    let mut sound = true;
    // Any name may stand here; a rig decides which exist (Plan::check_against).
    for (name, item) in s.entries() {
        if !super::is_name(&name) {
            s.wrong_type(
                &item,
                "under the name of a thruster: letters, digits, `_`, `-` or `.`",
            );
            sound = false;
        }
        match s.number_of(&item, &quantity(-1e4, 1e4, "N")) {
            Some(thrust_n) => thrusts.push((name, thrust_n)),
            None => sound = false,
        }
    }
    sound.then_some(thrusts)
}
