//! A Python module that builds CasADi functions: for optimal control, sensitivities and code generation.

use hydroline_rigs::Rig;

use super::python::{THRUST_OF_PULSE, data};
use crate::formula::{Syntax, formula, number};
use crate::model::Written;
use crate::traced::Function;

struct Casadi;

impl Syntax for Casadi {
    fn call(&self, function: Function, of: &str) -> String {
        let name = match function {
            Function::Abs => "fabs",
            other => other.name(),
        };
        format!("ca.{name}({of})")
    }

    fn larger(&self, a: &str, b: &str) -> String {
        format!("ca.fmax({a}, {b})")
    }

    fn smaller(&self, a: &str, b: &str) -> String {
        format!("ca.fmin({a}, {b})")
    }

    fn chosen(&self, of: &str, negative: &str, otherwise: &str) -> String {
        format!("ca.if_else({of} < 0.0, {negative}, {otherwise})")
    }

    fn table(&self, values: &[String], (from, to): (f64, f64), at: &str) -> String {
        let ends = format!("{}, {}", number(from), number(to));
        format!("_table(({}), {ends}, {at})", values.join(", "))
    }
}

const TABLE: &str = r#"

def _table(values, low, high, at):
    """Cubic through four neighbours of equally spaced points (Catmull and Rom 1974); beyond the ends the value there."""
    last = len(values) - 1
    place = (at - low) * (last / (high - low))
    made = values[last]
    for i in reversed(range(last)):
        s = place - i
        first = values[i - 1] if i > 0 else 2.0 * values[0] - values[1]
        fourth = values[i + 2] if i + 2 <= last else 2.0 * values[last] - values[last - 1]
        cubic = (
            first * (0.5 * s * (-1.0 + s * (2.0 - s)))
            + values[i] * (1.0 + 0.5 * s * s * (-5.0 + 3.0 * s))
            + values[i + 1] * (0.5 * s * (1.0 + s * (4.0 - 3.0 * s)))
            + fourth * (0.5 * s * s * (s - 1.0))
        )
        made = ca.if_else(place < i + 1.0, cubic, made)
    return ca.if_else(place > 0.0, made, values[0])
"#;

const BUILD_END: &str = r#"    return ca.Function(
        "f",
        [t, state, thrust, parameters],
        [rate],
        ["t", "state", "thrust", "parameters"],
        ["rate"],
    )


def step(dt):
    """CasADi function (t, state, thrust, parameters) to the state `dt` seconds later, the thrust held: one Runge-Kutta step."""
    rates = f()
    t = ca.SX.sym("t")
    state = ca.SX.sym("state", len(STATES))
    thrust = ca.SX.sym("thrust", len(THRUSTERS))
    parameters = ca.SX.sym("parameters", len(PARAMETERS))
    k1 = rates(t, state, thrust, parameters)
    k2 = rates(t + 0.5 * dt, state + 0.5 * dt * k1, thrust, parameters)
    k3 = rates(t + 0.5 * dt, state + 0.5 * dt * k2, thrust, parameters)
    k4 = rates(t + dt, state + dt * k3, thrust, parameters)
    after = state + dt / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)
    return ca.Function(
        "step",
        [t, state, thrust, parameters],
        [after],
        ["t", "state", "thrust", "parameters"],
        ["after"],
    )
"#;

pub(super) fn text(rig: &Rig, model: &Written, head: &[String]) -> String {
    let made = formula(&model.graph, &model.rates, &Casadi);
    let mut text = format!(
        "\"\"\"{}\n\"\"\"\n\nimport casadi as ca\n\n",
        head.join("\n")
    );
    text += &data(rig, model);
    text += "\n\ndef f():\n    \"\"\"CasADi function (t, state, thrust, parameters) to the rates of the state; `ca.DM(list(PARAMETERS.values()))` are its parameters.\"\"\"\n";
    text += "    t = ca.SX.sym(\"t\")\n";
    for (name, count) in [
        ("state", "STATES"),
        ("thrust", "THRUSTERS"),
        ("parameters", "PARAMETERS"),
    ] {
        text += &format!("    {name} = ca.SX.sym(\"{name}\", len({count}))\n");
    }
    for (k, name) in model.states.iter().enumerate() {
        text += &format!("    {name} = state[{k}]\n");
    }
    for k in 0..model.thrusters.len() {
        text += &format!("    thrust_{} = thrust[{k}]\n", k + 1);
    }
    for (k, p) in model.parameters.iter().enumerate() {
        text += &format!("    {} = parameters[{k}]\n", p.name);
    }
    for (name, expression) in &made.statements {
        text += &format!("    {name} = {expression}\n");
    }
    text += "    rate = ca.vertcat(\n";
    for output in &made.outputs {
        text += &format!("        {output},\n");
    }
    text += "    )\n";
    text += BUILD_END;
    text += THRUST_OF_PULSE;
    if text.contains("_table(") {
        text += TABLE;
    }
    text
}
