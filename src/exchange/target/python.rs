//! A Python module without dependencies.

use hydroline_rigs::Rig;

use super::start;
use crate::formula::{Syntax, formula, number};
use crate::model::{STATE_UNITS, Written};

struct Python;

impl Syntax for Python {
    fn chosen(&self, of: &str, negative: &str, otherwise: &str) -> String {
        format!("({negative} if {of} < 0.0 else {otherwise})")
    }

    fn table(&self, values: &[String], (from, to): (f64, f64), at: &str) -> String {
        let ends = format!("{}, {}", number(from), number(to));
        format!("_table(({}), {ends}, {at})", values.join(", "))
    }
}

/// A tuple of texts; one alone keeps its comma.
pub(super) fn tuple(items: impl IntoIterator<Item = String>) -> String {
    let items: Vec<String> = items.into_iter().collect();
    match items.as_slice() {
        [one] => format!("({one},)"),
        many => format!("({})", many.join(", ")),
    }
}

pub(super) fn quoted(text: &str) -> String {
    format!("\"{text}\"")
}

/// Names, units, parameters, thrusters: what both Python targets begin with.
pub(super) fn data(rig: &Rig, model: &Written) -> String {
    let units = STATE_UNITS.iter().map(|u| quoted(u));
    let own = model.states.iter().skip(STATE_UNITS.len());
    let units = units.chain(own.map(|_| quoted("")));
    let mut text = format!(
        "STATES = {}\nSTATE_UNITS = {}\n",
        tuple(model.states.iter().map(|s| quoted(s))),
        tuple(units)
    );
    text += &format!(
        "#: The rig's start: at rest.\nSTART = {}\n\n#: Numbers of the model; a changed copy may be given to `f`.\nPARAMETERS = {{\n",
        tuple(start(rig, model).into_iter().map(number))
    );
    for p in &model.parameters {
        text += &format!("    \"{}\": {},\n", p.name, number(p.value));
    }
    text += "}\n\n#: Thrusters, in the order of `thrust` [N].\n";
    text += &format!(
        "THRUSTERS = {}\n",
        tuple(model.thrusters.iter().map(|t| quoted(&t.name)))
    );
    let limits = model.thrusters.iter();
    let limits = limits.map(|t| tuple(t.limits_n.map(number)));
    text += &format!(
        "#: Least and largest thrust [N].\nTHRUST_LIMITS_N = {}\n",
        tuple(limits)
    );
    text += "#: Pulse [us] and thrust [N] of each, linear between the points: the deadband is where thrust is 0.\nCURVES = (\n";
    for t in &model.thrusters {
        let points = t.curve.iter().map(|(p, n)| tuple([number(*p), number(*n)]));
        text += &format!("    {},\n", tuple(points));
    }
    text += ")\n";
    text += &format!(
        "#: A command acts so much later [s]; `f` takes the thrust that acts.\nCOMMAND_DELAY_S = {}\n",
        number(model.delay_s)
    );
    text
}

pub(super) const THRUST_OF_PULSE: &str = r#"

def thrust_of_pulse(thruster, pulse_us):
    """Thrust [N] of a pulse [us] by the thruster's curve; `thruster` = its place in THRUSTERS."""
    points = CURVES[thruster]
    if pulse_us <= points[0][0]:
        return points[0][1]
    for (p0, n0), (p1, n1) in zip(points, points[1:]):
        if pulse_us <= p1:
            return n0 + (n1 - n0) * ((pulse_us - p0) / (p1 - p0))
    return points[-1][1]
"#;

const STEP: &str = r#"

def step(t, state, thrust, dt, parameters=PARAMETERS):
    """The state `dt` seconds later, the thrust held: one Runge-Kutta step of fourth order."""

    def moved(rate, by):
        return [s + r * by for s, r in zip(state, rate)]

    k1 = f(t, state, thrust, parameters)
    k2 = f(t + 0.5 * dt, moved(k1, 0.5 * dt), thrust, parameters)
    k3 = f(t + 0.5 * dt, moved(k2, 0.5 * dt), thrust, parameters)
    k4 = f(t + dt, moved(k3, dt), thrust, parameters)
    return [s + dt / 6.0 * (a + 2.0 * b + 2.0 * c + d) for s, a, b, c, d in zip(state, k1, k2, k3, k4)]
"#;

const TABLE: &str = r#"

def _table(values, low, high, at):
    """Cubic through four neighbours of equally spaced points (Catmull and Rom 1974); beyond the ends the value there."""
    last = len(values) - 1
    place = (at - low) * (last / (high - low))
    if not place > 0.0:
        return values[0]
    if place >= last:
        return values[last]
    i = min(int(place), last - 1)
    s = place - i
    a, b, c, d = (
        0.5 * s * (-1.0 + s * (2.0 - s)),
        1.0 + 0.5 * s * s * (-5.0 + 3.0 * s),
        0.5 * s * (1.0 + s * (4.0 - 3.0 * s)),
        0.5 * s * s * (s - 1.0),
    )
    first = values[i - 1] if i > 0 else 2.0 * values[0] - values[1]
    fourth = values[i + 2] if i + 2 <= last else 2.0 * values[last] - values[last - 1]
    return first * a + values[i] * b + values[i + 1] * c + fourth * d
"#;

pub(super) fn text(rig: &Rig, model: &Written, head: &[String]) -> String {
    let made = formula(&model.graph, &model.rates, &Python);
    let mut text = format!("\"\"\"{}\n\"\"\"\n\n", head.join("\n"));
    text += "from math import cos, exp, log, sin, sqrt, tanh  # noqa: F401\n\n";
    text += &data(rig, model);
    text += "\n\ndef f(t, state, thrust, parameters=PARAMETERS):\n    \"\"\"Rates of the state under the thrusts [N] that act at `t` [s], in the order of STATES and THRUSTERS.\"\"\"\n";
    text += &format!("    {} = state\n", model.states.join(", "));
    for k in 0..model.thrusters.len() {
        text += &format!("    thrust_{} = thrust[{k}]\n", k + 1);
    }
    for p in &model.parameters {
        text += &format!("    {0} = parameters[\"{0}\"]\n", p.name);
    }
    for (name, expression) in &made.statements {
        text += &format!("    {name} = {expression}\n");
    }
    text += "    return [\n";
    for output in &made.outputs {
        text += &format!("        {output},\n");
    }
    text += "    ]\n";
    text += STEP;
    text += THRUST_OF_PULSE;
    if text.contains("_table(") {
        text += TABLE;
    }
    text
}
