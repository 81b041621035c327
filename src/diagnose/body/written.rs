//! A force of no known effect in closed form: the expression in words, with what its numbers are known to.

use std::collections::BTreeMap;

use hydroline_inference::closed::{Closed, Form};
use hydroline_inference::fit::Fit;
use hydroline_inference::term::Candidate;
use hydroline_sim::effect::form::{FORMS, NUMBERS, Parity, Shape, form, piece};
use hydroline_sim::effect::written_force::{PIECES, TIMES, is_a_rate};

use super::found::Judged;
use crate::verdict::{ClosedForm, ESTABLISHED, Piece, Value, WrittenForm};

/// A number with its sd to two digits of that.
fn written(v: &Value) -> String {
    match v.sd.filter(|s| *s > 0.0) {
        Some(sd) => {
            let digits = (1.0 - sd.log10().floor()).clamp(0.0, 9.0) as usize;
            format!("{:.digits$}±{sd:.digits$}", v.value)
        }
        None => format!("{}", (v.value * 1e6).round() / 1e6),
    }
}

/// A piece as an expression of a covariate.
fn expression(place: usize, [force, at, width]: &[Value; NUMBERS], c: &str) -> String {
    let (parity, shape) = form(place);
    let s = match parity {
        Parity::Plain => c.to_owned(),
        _ => format!("|{c}|"),
    };
    let per = |by: f64| {
        let sd = force.sd.map(|sd| sd / by);
        written(&Value {
            value: force.value / by,
            sd,
        })
    };
    let (a, b, w) = (written(force), written(at), written(width));
    let from = format!("{s} - {b}");
    let made = match shape {
        Shape::None => String::new(),
        Shape::Constant => a,
        // The rate or angle itself needs no sign.
        Shape::Power if at.sd.is_none() && at.value == 1.0 && parity == Parity::Odd => {
            return format!("({}) {c}", per(width.value));
        }
        Shape::Power if at.sd.is_none() => {
            format!("({}) {s}^{b}", per(width.value.powf(at.value)))
        }
        Shape::Power => format!("({a}) ({s} / {w})^({b})"),
        Shape::Beyond => format!("({}) max(0, {from})", per(width.value)),
        Shape::Below => format!("({}) max(0, {b} - {s})", per(width.value)),
        Shape::Wave => format!("({a}) sin(2 pi {s} / ({w}) + ({b}))"),
        Shape::Bump => format!("({a}) exp(-(({from}) / ({w}))^2 / 2)"),
        Shape::Step => format!("({a}) (1 + tanh(({from}) / ({w}))) / 2"),
        Shape::Saturation => format!("({a}) tanh({s} / ({w}))"),
        Shape::Decay => format!("({a}) exp(-{s} / ({w}))"),
    };
    match parity {
        Parity::Odd => format!("{made} sign({c})"),
        _ => made,
    }
}

/// Names of a piece's numbers as a reader knows them.
fn names(shape: Shape) -> [&'static str; NUMBERS] {
    match shape {
        Shape::Power => ["force", "exponent", "reached_at"],
        Shape::Wave => ["force", "phase_rad", "length"],
        _ => ["force", "at", "width"],
    }
}

impl Judged<'_> {
    /// Closed forms found for a table; `None` where there are none.
    fn closed(&self, table: usize) -> Option<&Closed> {
        self.closed.iter().find(|c| c.table == table)
    }

    fn numbers_of(&self, fit: &Fit, candidate: usize) -> Option<Vec<Value>> {
        let member = fit.terms.iter().position(|t| *t == candidate)?;
        let at = self.found.problem.body.places(&fit.terms)[member];
        let scales = &self.found.problem.body.candidates[candidate].scales;
        let each = scales.iter().enumerate().map(|(i, s)| {
            let v = self.value(fit, at + i);
            // A number that the form holds is no estimate.
            let free = s.limits.0 < s.limits.1;
            Value {
                sd: v.sd.filter(|_| free),
                ..v
            }
        });
        Some(each.collect())
    }

    fn written(&self, form: &Form, probability: f64) -> Option<WrittenForm> {
        let c: &Candidate = &self.found.problem.body.candidates[form.candidate];
        let along = c.runs_along()?;
        let numbers = self.numbers_of(&form.fit, form.candidate)?;
        let each = || (0..PIECES).map(|k| (c.words[2 + k], &numbers[k * NUMBERS..]));
        let there = || each().filter(|(place, _)| shape_of(*place) != Shape::None);
        let texts: Vec<String> = there()
            .map(|(place, n)| expression(place, &[n[0], n[1], n[2]], along))
            .collect();
        let sum = texts.join(" + ");
        let factor = TIMES.get(c.words[2 + PIECES]).copied().unwrap_or("one");
        let at = numbers.last()?.value;
        let expression = match factor.split_once('_') {
            _ if factor == "one" => sum,
            Some(("abs", rate)) => format!("({sum}) |{rate}| / {at:.3}"),
            Some((_, rate)) => format!("({sum}) sign({rate})"),
            None => format!("({sum}) {factor} / {at:.3}"),
        };
        let pieces = there().map(|(place, n)| {
            let named = names(shape_of(place)).into_iter().zip(n);
            Piece {
                form: FORMS[place].to_owned(),
                numbers: named.map(|(name, v)| (name.to_owned(), *v)).collect(),
            }
        });
        Some(WrittenForm {
            expression,
            probability,
            pieces: pieces.collect(),
        })
    }

    /// Force of the likeliest form at some values of its covariate.
    fn forces_of(&self, form: &Form, at: &[f64]) -> Option<Vec<f64>> {
        let c = &self.found.problem.body.candidates[form.candidate];
        let n = self.numbers_of(&form.fit, form.candidate)?;
        let of_a_rate = is_a_rate(c.words[1]);
        let force = |x: &f64| {
            let each = (0..PIECES).map(|k| {
                let i = k * NUMBERS;
                let numbers = [n[i].value, n[i + 1].value, n[i + 2].value];
                piece(c.words[2 + k], numbers, *x, of_a_rate)
            });
            each.sum()
        };
        Some(at.iter().map(force).collect())
    }

    /// The closed form of a table's force; `knots` = where the table has its points.
    pub fn closed_form(&self, table: usize, knots: &[f64]) -> Option<ClosedForm> {
        let closed = self.closed(table)?;
        let dof = self.found.problem.body.candidates[table].unnamed_in()?;
        // Where forms stand they are terms like any other: the force may also run along another covariate.
        let share = |term: usize| self.probability(term) / self.force_in(dof, None).max(1e-300);
        let (mut ranked, none): (Vec<(Form, f64)>, f64) = if closed.replaces_table {
            let each = closed.forms.iter().map(|f| (f.clone(), share(f.candidate)));
            let all: Vec<(Form, f64)> = each.collect();
            let rest = 1.0 - all.iter().map(|f| f.1).sum::<f64>();
            (all, rest.max(0.0))
        } else {
            let each = closed.forms.iter().map(|f| (f.clone(), f.probability));
            (each.collect(), closed.none)
        };
        // The search went on after the forms joined: what their numbers are the likeliest model of each says now.
        for (form, _) in ranked.iter_mut().filter(|_| closed.replaces_table) {
            let holds = |f: &&Fit| f.terms.contains(&form.candidate);
            let of = self.found.models.values().filter(holds);
            if let Some(fit) = of.max_by(|a, b| a.ln_score.total_cmp(&b.ln_score)) {
                form.fit = fit.clone();
            }
        }
        ranked.sort_by(|a, b| b.1.total_cmp(&a.1));
        let forms: Vec<WrittenForm> = ranked
            .iter()
            .filter_map(|(f, p)| self.written(f, *p))
            .collect();
        let first = forms.first().map_or(0.0, |f| f.probability);
        let sure = closed.replaces_table && first >= ESTABLISHED;
        let several: Vec<String> = forms
            .iter()
            .map(|f| format!("{} (probability {:.3})", f.expression, f.probability))
            .collect();
        let sentence = match (sure, closed.replaces_table, &closed.one_run_out) {
            (true, ..) => format!("in closed form {}", several[0]),
            (_, true, _) => format!(
                "its closed form is not decided: {}; or none (probability {none:.3})",
                several.join("; or ")
            ),
            (_, _, Some(_)) => {
                "no closed form: with the likeliest each run is predicted worse by the others than with the table"
                    .to_owned()
            }
            _ => {
                format!("no closed form (probability {none:.3} that it has none of the grammar's)")
            }
        };
        let one_run_out = closed.one_run_out.as_ref();
        let likeliest = ranked.first().map(|r| &r.0);
        let at = likeliest.and_then(|f| self.forces_of(f, knots));
        // The rig is written from the likeliest model, what is established and said of it.
        let in_the_rig = likeliest.is_some_and(|f| {
            self.best.terms.contains(&f.candidate) && self.is_written(f.candidate)
        });
        Some(ClosedForm {
            sure,
            written: in_the_rig,
            none_probability: none,
            forms,
            force_at: at.unwrap_or_default(),
            leave_one_run_out: one_run_out.map_or_else(BTreeMap::new, |l| l.0.by_name()),
            leave_one_run_out_table: one_run_out.map_or_else(BTreeMap::new, |l| l.1.by_name()),
            sentence,
        })
    }
}

fn shape_of(place: usize) -> Shape {
    form(place).1
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of(name: &str, numbers: [(f64, Option<f64>); NUMBERS]) -> String {
        let place = FORMS.iter().position(|f| *f == name).unwrap();
        expression(place, &numbers.map(|(value, sd)| Value { value, sd }), "u")
    }

    #[test]
    fn an_expression_reads_as_one_writes_it() {
        let a = (-1.234, Some(0.034));
        assert_eq!(
            of("odd_power", [a, (3.0, None), (0.5, None)]),
            "(-9.87±0.27) |u|^3 sign(u)"
        );
        assert_eq!(
            of("odd_power", [a, (1.0, None), (0.5, None)]),
            "(-2.468±0.068) u"
        );
        assert_eq!(
            of("odd_power", [a, (1.62, Some(0.05)), (0.5, None)]),
            "(-1.234±0.034) (|u| / 0.5)^(1.620±0.050) sign(u)"
        );
        assert_eq!(
            of("beyond", [a, (0.12, Some(0.003)), (0.5, None)]),
            "(-2.468±0.068) max(0, u - 0.1200±0.0030)"
        );
    }
}
