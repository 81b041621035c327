//! A function for MATLAB and Octave in the form of the vessels of the MSS toolbox: [xdot, U] = vessel(x, ui).

use hydroline_rigs::Rig;

use super::start;
use crate::formula::{Syntax, formula, number};
use crate::model::{STATE, STATE_UNITS, Written};

struct Matlab;

impl Syntax for Matlab {
    fn chosen(&self, of: &str, negative: &str, otherwise: &str) -> String {
        format!("chosen({of}, {negative}, {otherwise})")
    }

    fn table(&self, values: &[String], (from, to): (f64, f64), at: &str) -> String {
        let ends = format!("{}, {}", number(from), number(to));
        format!("table_at([{}], {ends}, {at})", values.join(", "))
    }
}

/// Places of our states in the order of MSS: rates, then pose, then the effects' own.
fn order(model: &Written) -> Vec<usize> {
    let own = STATE.len()..model.states.len();
    (6..12).chain(0..6).chain(own).collect()
}

const HELPERS: &str = r"
function y = chosen(x, below, above)
if x < 0
    y = below;
else
    y = above;
end
end
";

const TABLE: &str = r"
function y = table_at(values, low, high, at)
% Cubic through four neighbours of equally spaced points (Catmull and Rom 1974); beyond the ends the value there.
last = numel(values) - 1;
place = (at - low) * (last / (high - low));
if ~(place > 0)
    y = values(1);
elseif place >= last
    y = values(last + 1);
else
    i = min(floor(place), last - 1);
    s = place - i;
    w = [0.5*s*(-1 + s*(2 - s)), 1 + 0.5*s*s*(-5 + 3*s), 0.5*s*(1 + s*(4 - 3*s)), 0.5*s*s*(s - 1)];
    if i > 0
        first = values(i);
    else
        first = 2*values(1) - values(2);
    end
    if i + 2 <= last
        fourth = values(i + 3);
    else
        fourth = 2*values(last + 1) - values(last);
    end
    y = first*w(1) + values(i + 1)*w(2) + values(i + 2)*w(3) + fourth*w(4);
end
end
";

pub(super) fn text(rig: &Rig, model: &Written, head: &[String], function: &str) -> String {
    let made = formula(&model.graph, &model.rates, &Matlab);
    let order = order(model);
    let start = start(rig, model);
    let mut text = format!("function [xdot, U, par] = {function}(state, ui, t, par)\n");
    text += &format!(
        "% [xdot, U, par] = {function}(state, ui, t, par) returns the rates of the state, the speed U [m/s] and the parameters.\n%\n"
    );
    text += "% state = [";
    text += &order
        .iter()
        .map(|k| model.states[*k].as_str())
        .collect::<Vec<_>>()
        .join(" ");
    text += "]'\n% ui    = thrusts [N] of ";
    text += &model
        .thrusters
        .iter()
        .map(|t| t.name.as_str())
        .collect::<Vec<_>>()
        .join(", ");
    text += "\n% t     = time [s], 0 when left out; par = parameters, the rig's when left out\n%\n";
    for line in head {
        text += format!("% {line}").trim_end();
        text.push('\n');
    }
    text += "%\n% The rig's start: state = [";
    text += &order
        .iter()
        .map(|k| number(start[*k]))
        .collect::<Vec<_>>()
        .join("; ");
    text += &format!(
        "]\n% A command acts {} s later; ui is the thrust that acts.\n%\n% Pulse [us] and thrust [N] of each thruster, linear between the points:\n",
        number(model.delay_s)
    );
    for t in &model.thrusters {
        let points = t
            .curve
            .iter()
            .map(|(p, n)| format!("{} {}", number(*p), number(*n)));
        text += &format!(
            "%   {}: [{}]\n",
            t.name,
            points.collect::<Vec<_>>().join("; ")
        );
    }
    text += "\nif nargin < 3, t = 0; end\nif nargin < 4\n";
    for p in &model.parameters {
        text += &format!("    par.{} = {};\n", p.name, number(p.value));
    }
    text += "end\nif nargin == 0, xdot = []; U = []; return; end\n\n";
    for (k, place) in order.iter().enumerate() {
        let name = &model.states[*place];
        let unit = STATE_UNITS
            .get(*place)
            .map_or(String::new(), |u| format!("  % [{u}]"));
        text += &format!("{name} = state({});{unit}\n", k + 1);
    }
    for k in 1..=model.thrusters.len() {
        text += &format!("thrust_{k} = ui({k});\n");
    }
    for p in &model.parameters {
        text += &format!("{0} = par.{0};\n", p.name);
    }
    text.push('\n');
    for (name, expression) in &made.statements {
        text += &format!("{name} = {expression};\n");
    }
    text += "xdot = [\n";
    for place in &order {
        text += &format!("    {};\n", made.outputs[*place]);
    }
    text += "];\nU = sqrt(u^2 + v^2 + w^2);\nend\n";
    if text.contains("chosen(") {
        text += HELPERS;
    }
    if text.contains("table_at(") {
        text += TABLE;
    }
    text
}
