//! Simulated measurements of a body, as instruments would have made them, and their derivatives.

use hydroline_core::run::{Channel, PerChannel};
use hydroline_identify::parameter::Term as CoefficientTerm;
use hydroline_numerics::cancel;
use hydroline_numerics::parallel;
use hydroline_sim::effect::Trend;
use hydroline_sim::model::{Model, ModelState};
use hydroline_sim::single::{Feed, Line, Single};
use hydroline_sim::vehicle::Hydrodynamics;
use hydroline_sim::whole::{Course, run};
use hydroline_sim::{Dual, EffectStack, Real};

use super::{Body, Own, Simulated, WIDTHS};
use crate::clock::by_step;
use crate::term::Kind;

/// Channels per sample, and derivatives of each number of a pass.
type Pass = (Vec<PerChannel<f64>>, Vec<Vec<PerChannel<f64>>>);

impl Body {
    fn model<T: Real>(&self, terms: &[usize], natural: &[T]) -> Option<Model<T>> {
        let mut h: Hydrodynamics<T> = Hydrodynamics::new(&self.vehicle);
        for (own, value) in self.own.iter().zip(natural) {
            match own {
                Own::Coefficient(c, _) | Own::Unsaid(c, _) => {
                    let place = match c.term {
                        CoefficientTerm::Added => &mut h.added,
                        CoefficientTerm::Linear => &mut h.linear,
                        CoefficientTerm::Quadratic => &mut h.quadratic,
                    };
                    place[c.dof.index()] = *value;
                }
                Own::Restoring(_) => h.restoring_nm = *value,
                // Either is one of the vehicle's numbers only where the rig says it, and then it has hydrostatics.
                Own::Stiffness(place, _) => {
                    if let Some(statics) = &mut h.hydrostatics {
                        statics.stiffness[*place] = *value;
                    }
                }
                Own::ClockOffset(_) | Own::ClockDrift(_) => {}
                Own::NetWeight(_) => {
                    if let Some(statics) = &mut h.hydrostatics {
                        statics.net_weight_n = *value;
                    }
                }
            }
        }
        let base = self.base.len();
        let mut on = self.base.clone();
        // Places of an effect's numbers among all: of those searched, and of the shares by which one of them varies.
        let mut members: Vec<(usize, usize, usize)> = Vec::with_capacity(terms.len());
        for (t, at) in terms.iter().zip(self.places(terms)) {
            let c = &self.candidates[*t];
            match (c.kind, c.along) {
                (Kind::Trend { of }, Some((along, range))) => {
                    let of = terms.iter().position(|t| *t == of);
                    // A trend of an effect that is not there is nothing.
                    let Some(member) = of.and_then(|m| members.get_mut(m)) else {
                        continue;
                    };
                    let effect = &mut on[base + of?];
                    effect.trend = Some(Trend {
                        parameter: 0,
                        nothing: self.candidates[terms[of?]].nothing,
                        along,
                        range,
                        shares: vec![0.0; c.scales.len()],
                    });
                    member.2 = at;
                }
                _ => {
                    on.push(c.checked(&vec![0.0; c.scales.len()]));
                    members.push((at, c.fixed.len(), 0));
                }
            }
        }
        let effects = EffectStack::assemble(&on, |e, p, value| {
            let Some((at, fixed, shares)) = e.checked_sub(base).and_then(|m| members.get(m)) else {
                return T::from_f64(value);
            };
            match p.checked_sub(on[e].info.parameters.len()) {
                Some(share) => natural[shares + share],
                None if p < *fixed => T::from_f64(value),
                None => natural[at + p - fixed],
            }
        });
        // More own states than the simulator holds: such a set is no model.
        Some(Model {
            hydrodynamics: h,
            effects: effects.ok()?,
        })
    }

    fn drive<T: Real>(
        &self,
        index: usize,
        terms: &[usize],
        (natural, starts): (&[T], &[T]),
        commands: &[(f64, [f64; 6])],
    ) -> Vec<PerChannel<T>> {
        cancel::check();
        let r = &self.recording.runs[index];
        let Some(model) = self.model(terms, natural) else {
            return vec![PerChannel::splat(T::from_f64(f64::NAN)); r.times_s.len()];
        };
        if let Some(line) = self.lines.get(index) {
            // What is not free begins at rest.
            let of = |c: Channel| {
                let place = self.starts[index].iter().position(|s| *s == c);
                place.map_or(T::from_f64(self.rest[index][c]), |i| starts[i])
            };
            let [position, rate] = Channel::of(line.dof).map(of);
            return self.along(index, (line, commands), model, (position, rate));
        }
        let mut state = ModelState::at_rest(self.rest[index].pose().map(T::from_f64));
        for (c, value) in self.starts[index].iter().zip(starts) {
            *state.vehicle.channel(*c) = *value;
        }
        let course = Course {
            start_s: r.start_s,
            commands,
            stamps_s: &r.times_s,
            step_max_s: self.step_max_s,
            given: self.inputs[index].as_ref(),
        };
        let mut out = Vec::with_capacity(r.times_s.len());
        run(&model, &course, state, |channels| {
            out.push(r.rotated(out.len(), channels));
        });
        out
    }

    /// One DOF alone, the others at rest: the same laws at a fifth of the cost.
    fn along<T: Real>(
        &self,
        index: usize,
        (line, commands): (&Line, &[(f64, [f64; 6])]),
        model: Model<T>,
        start: (T, T),
    ) -> Vec<PerChannel<T>> {
        let r = &self.recording.runs[index];
        let mut edges: Vec<(f64, f64)> = Vec::with_capacity(commands.len());
        for (t_s, wrench) in commands {
            let load = wrench[line.dof];
            if edges.last().is_none_or(|e| e.1 != load) {
                edges.push((*t_s, load));
            }
        }
        let feed = Feed {
            start_s: r.start_s,
            edges: &edges,
            stamps_s: &r.times_s,
            step_max_s: self.step_max_s,
            given: self.inputs[index].as_ref(),
        };
        let mut out = Vec::with_capacity(r.times_s.len());
        Single::new(model.hydrodynamics, *line).run(&model.effects, &feed, start, |x| {
            let mut state = PerChannel::splat(T::zero());
            state[Channel::POSES[line.dof]] = x;
            out.push(state);
        });
        out
    }

    /// Channels of one run at a point.
    pub fn values(&self, index: usize, terms: &[usize], point: &[f64]) -> Vec<PerChannel<f64>> {
        let natural: Vec<f64> = self.natural(terms, point).iter().map(|v| v.0).collect();
        let places = self.start_places(terms);
        let (globals, starts) = (
            &natural[..places[0]],
            &natural[places[index]..places[index + 1]],
        );
        let commands = self.commands(index, globals);
        self.drive(index, terms, (globals, starts), &commands)
    }

    /// Values and columns of each pass.
    fn passes<const N: usize>(
        &self,
        index: usize,
        terms: &[usize],
        numbers: &[f64],
        globals: usize,
    ) -> Vec<Pass> {
        parallel::map(numbers.len().div_ceil(N), |pass| {
            let first = pass * N;
            let duals = Dual::<N>::pass(numbers, first);
            let (own, starts) = duals.split_at(globals);
            let commands = self.commands(index, &numbers[..globals]);
            let out = self.drive(index, terms, (own, starts), &commands);
            let width = N.min(numbers.len() - first);
            let columns = (0..width).map(|i| out.iter().map(|s| s.map(|v| v.slope[i])).collect());
            (
                out.iter().map(|s| s.map(|v| v.value)).collect(),
                columns.collect(),
            )
        })
    }

    /// The same with derivatives.
    pub fn simulated(&self, index: usize, terms: &[usize], point: &[f64]) -> Simulated {
        let natural = self.natural(terms, point);
        let places = self.start_places(terms);
        let globals = places[0];
        let acting: Vec<usize> = (0..globals)
            .chain(places[index]..places[index + 1])
            .collect();
        let numbers: Vec<f64> = acting.iter().map(|i| natural[*i].0).collect();
        // The width that wastes least: a pass costs about as much as its directions and two more.
        let width = WIDTHS
            .into_iter()
            .min_by_key(|w| numbers.len().div_ceil(*w) * (w + 2));
        let passes = match width {
            Some(6) => self.passes::<6>(index, terms, &numbers, globals),
            Some(8) => self.passes::<8>(index, terms, &numbers, globals),
            Some(12) => self.passes::<12>(index, terms, &numbers, globals),
            _ => self.passes::<16>(index, terms, &numbers, globals),
        };
        let mut made = Simulated {
            values: Vec::new(),
            columns: Vec::new(),
        };
        for (values, columns) in passes {
            made.values = values;
            for mut column in columns {
                let i = acting[made.columns.len()];
                let by = natural[i].1;
                column.iter_mut().flatten().for_each(|v| *v *= by);
                made.columns.push((i, column));
            }
        }
        // Stamps are no duals: what moves them is asked by a step.
        for (i, step) in self.clock_steps(index) {
            let mut moved = numbers.clone();
            moved[i] += step;
            let (own, starts) = moved.split_at(globals);
            let commands = self.commands(index, own);
            let out = self.drive(index, terms, (own, starts), &commands);
            made.columns[i].1 = by_step(&out, &made.values, step / natural[i].1);
        }
        made
    }
}
