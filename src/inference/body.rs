//! The body: Eq. 1 with effects, its free numbers, and what instruments would have measured of it.

use hydroline_identify::parameter::{Coefficient, Term as CoefficientTerm};
use hydroline_rigs::{Dof, Rig, Vehicle, VehicleModel};
use hydroline_sim::effect::{CheckedEffect, EffectError, Trend, check};
use hydroline_sim::model::{Model, ModelState};
use hydroline_sim::single::{AsTheyAre, Feed, Line, Single};
use hydroline_sim::vehicle::Hydrodynamics;
use hydroline_sim::vehicle::equations::coriolis;
use hydroline_sim::whole::{Course, run};
use hydroline_sim::{Dual, EffectStack, Given, Real};
use rayon::prelude::*;

use super::filter::Response;
use super::given::given;
use super::prior::{Density, PriorTable, Scale};
use super::recording::{Recorded, Recording};
use super::size::Size;
use super::term::{Candidate, Ground, Kind, Ranges, candidates, tables};

/// Directions per pass.
const WIDTHS: [usize; 4] = [6, 8, 12, 16];
/// Longest RK4 step \[s\].
const STEP_MAX_S: f64 = 0.04;
/// Step over the time constant of the vehicle's fastest motion: RK4's error of a decay is then below 1e-6 per step.
const STEP_SHARE: f64 = 0.25;
/// Scale of a coefficient of which the rig says 0, over that of Table 9's range.
const UNSAID: f64 = 0.1;

/// One of the vehicle's own numbers that are fitted.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Own {
    /// One of the eighteen, by its ratio to the rig's.
    Coefficient(Coefficient, f64),
    /// Restoring moment (GM), by its ratio to the rig's.
    Restoring(f64),
}

impl Own {
    /// Name in files.
    pub fn name(&self) -> &'static str {
        match self {
            Own::Coefficient(c, _) => c.key(),
            Own::Restoring(_) => "restoring_nm",
        }
    }
}

/// Channels per sample, and derivatives of each number of a pass.
type Pass = (Vec<[f64; 12]>, Vec<Vec<[f64; 12]>>);

/// What is fitted.
#[derive(Debug, Clone)]
pub struct Body {
    /// Measured.
    pub recording: Recording,
    /// The rig's vehicle.
    pub vehicle: Vehicle,
    /// Effects that the rig has switched on.
    pub base: Vec<CheckedEffect>,
    /// DOFs that are simulated: those that move and are not given.
    pub dofs: Vec<usize>,
    /// DOFs whose measured motion drives the others instead of being explained.
    pub given: Vec<usize>,
    /// Per run what of its motion is given, and companions; `None` = nothing.
    pub inputs: Vec<Option<Given>>,
    /// The vehicle's numbers.
    pub own: Vec<Own>,
    /// Per run the states that are free at its start: 0..6 pose, 6..12 rates.
    pub starts: Vec<Vec<usize>>,
    /// Values of the states that are not.
    pub rest: Vec<[f64; 12]>,
    /// Where one DOF alone moves and its position alone is measured: its line in every run.
    pub lines: Vec<Line>,
    /// Candidates.
    pub candidates: Vec<Candidate>,
    /// Prior table.
    pub prior: PriorTable,
    /// Linearised response per DOF to a force per unit of mass.
    pub responses: [Response; 6],
    /// Largest tolerable rms per channel.
    pub tolerance: [f64; 12],
    /// Longest step of the integration \[s\].
    pub step_max_s: f64,
}

/// Numbers of a model, scaled: the vehicle's own, each term's, each run's start.
pub type Point = Vec<f64>;

/// What simulations of one run give: residual's counterpart (12 channels per sample, turned) and, column by column, its
/// derivatives by the scaled numbers.
#[derive(Debug, Clone)]
pub struct Simulated {
    /// Channels per sample.
    pub values: Vec<[f64; 12]>,
    /// Per number that acts on this run: (its index in the point, derivative per sample).
    pub columns: Vec<(usize, Vec<[f64; 12]>)>,
}

/// Stretch at a run's start from which its rate there is taken \[s\], and the fewest samples of it.
const RATE_OVER_S: f64 = 0.6;
/// See there.
const RATE_SAMPLES: usize = 5;
/// A rate below this many of its own sd is none.
const RATE_SD: f64 = 4.0;

/// Rate of a DOF at a run's start as a straight line over its first samples says; 0 where it does not differ from rest.
/// A log that begins under way is told from one at rest by this: a fit that begins at rest never finds it.
fn under_way(r: &Recorded, dof: usize) -> f64 {
    if let Some(rate) = r.first(6 + dof) {
        return rate;
    }
    let begin_s = r.times_s.first().copied().unwrap_or(0.0);
    let all: Vec<(f64, f64)> = (0..r.times_s.len())
        .map(|k| (r.times_s[k] - begin_s, r.measured(k)[dof]))
        .filter(|(_, v)| v.is_finite())
        .collect();
    let within = all
        .partition_point(|(t, _)| *t <= RATE_OVER_S)
        .max(RATE_SAMPLES);
    let Some(first) = all.get(..within) else {
        return 0.0;
    };
    let n = first.len() as f64;
    let (t, v) = first
        .iter()
        .fold((0.0, 0.0), |s, x| (s.0 + x.0 / n, s.1 + x.1 / n));
    let (tt, tv) = first.iter().fold((0.0, 0.0), |s, x| {
        (s.0 + (x.0 - t).powi(2), s.1 + (x.0 - t) * (x.1 - v))
    });
    if tt <= 0.0 {
        return 0.0;
    }
    let slope = tv / tt;
    let left: f64 = first
        .iter()
        .map(|x| (x.1 - v - slope * (x.0 - t)).powi(2))
        .sum();
    let sd = (left / (n - 2.0) / tt).sqrt();
    if slope.abs() > RATE_SD * sd {
        slope
    } else {
        0.0
    }
}

/// Samples over which a rate is taken where none is measured: noise does not count then.
const SPAN: usize = 10;
/// Covariates that vary by less than this share of their size do not vary.
const VARIES: f64 = 1e-6;
/// Share of a covariate's range by which tables go on beyond it: rates over a span are less than the largest within.
const MARGIN: f64 = 0.08;

/// Least and greatest of some numbers; `None` where they do not vary.
fn range(values: impl Iterator<Item = f64>) -> Option<(f64, f64)> {
    let (low, high) = values
        .filter(|v| v.is_finite())
        .fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), v| {
            (low.min(v), high.max(v))
        });
    let more = MARGIN * (high - low);
    (high - low > VARIES * high.abs().max(low.abs())).then_some((low - more, high + more))
}

/// Ranges of what a force may depend on, as measured: poses, rates (measured, or by the poses), time.
fn ranges(recording: &Recording) -> Ranges {
    let runs = &recording.runs;
    let mut made: Ranges = [None; hydroline_sim::effect::along::COVARIATES.len()];
    for c in 0..6 {
        made[c] = range(runs.iter().flat_map(|r| r.values.iter().map(move |v| v[c])));
        made[6 + c] = if recording.channels[6 + c] {
            range(
                runs.iter()
                    .flat_map(|r| r.values.iter().map(move |v| v[6 + c])),
            )
        } else {
            let rates = runs.iter().flat_map(|r| {
                let first = 0..r.times_s.len().saturating_sub(SPAN);
                first.step_by(SPAN / 2).map(move |k| {
                    let (a, b) = (r.measured(k), r.measured(k + SPAN));
                    (b[c] - a[c]) / (r.times_s[k + SPAN] - r.times_s[k]).max(1e-3)
                })
            });
            range(rates)
        };
    }
    made[12] = range(runs.iter().flat_map(|r| r.times_s.iter().copied()));
    made
}

/// Range of the load commanded in each DOF.
fn loads(recording: &Recording) -> [Option<(f64, f64)>; 6] {
    let commands = || recording.runs.iter().flat_map(|r| &r.commands);
    std::array::from_fn(|d| range(commands().map(|c| c.1[d]).chain([0.0])))
}

/// Whether the added mass of a DOF is in the Coriolis terms of those simulated, as these DOFs move.
fn acts_on(h: &Hydrodynamics<f64>, dof: usize, simulated: &[usize], driving: &[usize]) -> bool {
    let mut nu = [0.0; 6];
    for d in simulated.iter().chain(driving) {
        nu[*d] = 0.1 + 0.07 * *d as f64;
    }
    let mut other = h.clone();
    other.added[dof] -= 1.0;
    let (with, without) = (coriolis(&other, &nu), coriolis(h, &nu));
    simulated.iter().any(|d| with[*d] != without[*d])
}

impl Body {
    /// The body of a rig under a recording; `given` DOFs move as they were measured.
    ///
    /// # Errors
    /// [`EffectError`] for a bad `[[physics]]` entry.
    pub fn new(
        mut recording: Recording,
        rig: &Rig,
        dofs: &[usize],
        given_dofs: &[usize],
        prior: PriorTable,
    ) -> Result<Body, EffectError> {
        let base = check(&rig.physics)?;
        if !dofs.contains(&5) && !given_dofs.contains(&5) {
            recording.hold_heading();
        }
        let coefficient = |c: Coefficient| {
            let said = c.of_vehicle(&rig.vehicle);
            let unit = if said == 0.0 {
                -UNSAID * c.doubt(rig)
            } else {
                said
            };
            Own::Coefficient(c, unit)
        };
        let mut own: Vec<Own> = dofs
            .iter()
            .flat_map(|d| Coefficient::of(Dof::ALL[*d]).map(coefficient))
            .collect();
        let h: Hydrodynamics<f64> = Hydrodynamics::new(&rig.vehicle);
        if dofs.iter().any(|d| matches!(d, 3 | 4)) && h.restoring_nm != 0.0 {
            own.push(Own::Restoring(h.restoring_nm));
        }
        let mut largest = [0.0_f64; 6];
        let mut fastest = [0.0_f64; 6];
        for r in &recording.runs {
            for (_, wrench) in &r.commands {
                largest = std::array::from_fn(|d| largest[d].max(wrench[d].abs()));
            }
            for d in 0..6 {
                let step = |w: &[[f64; 12]], t: &[f64]| {
                    let rate = (w[1][d] - w[0][d]) / (t[1] - t[0]).max(1e-3);
                    if rate.is_finite() { rate.abs() } else { 0.0 }
                };
                // A robust largest rate: over spans of ten samples noise does not count.
                let spans = r.values.chunks(10).zip(r.times_s.chunks(10));
                for (v, t) in spans.filter(|(v, _)| v.len() == 10) {
                    fastest[d] = fastest[d].max(step(&[v[0], v[9]], &[t[0], t[9]]));
                    let own = v.iter().map(|v| v[6 + d].abs()).filter(|v| v.is_finite());
                    fastest[d] = own.fold(fastest[d], f64::max);
                }
            }
        }
        let mass = h.mass();
        let mut quickest = 0.0_f64;
        let responses = std::array::from_fn(|d| {
            let damping = |speed: f64| -(h.linear[d] + 2.0 * h.quadratic[d] * speed) / mass[d];
            let stiffness_ps2 = if matches!(d, 3 | 4) {
                (-h.restoring_nm / mass[d]).max(0.0)
            } else {
                0.0
            };
            quickest = quickest.max(damping(fastest[d])).max(stiffness_ps2.sqrt());
            Response {
                damping_ps: damping(0.5 * fastest[d]).max(1e-3),
                stiffness_ps2,
            }
        });
        let mut starts = Vec::new();
        let mut rest = Vec::new();
        let mut lines = Vec::new();
        let mut inputs = Vec::new();
        let tolerance = rig.tolerance.channels();
        for r in &recording.runs {
            let mut free = Vec::new();
            let mut at = [0.0; 12];
            for d in 0..6 {
                at[d] = r.first(d).unwrap_or(rig.tank.start_pose[d]);
                if dofs.contains(&d) {
                    free.extend([d, 6 + d]);
                } else {
                    // A DOF that does not move stands at its median.
                    let mut seen: Vec<f64> = r
                        .values
                        .iter()
                        .map(|v| v[d])
                        .filter(|v| v.is_finite())
                        .collect();
                    at[d] = hydroline_numerics::statistics::median(&mut seen).unwrap_or(at[d]);
                }
            }
            let input = given(r, given_dofs, dofs, &at, &tolerance);
            // One DOF moves along a line unless the line is turned or shifted by others.
            let line_stays =
                dofs.first().is_some_and(|d| *d > 1) || input.rates.iter().all(Option::is_none);
            inputs.push(Some(input).filter(|i| !i.is_empty()));
            if let [d] = dofs
                && !recording.channels[6 + d]
                && line_stays
            {
                let mut line = Line {
                    dof: *d,
                    rest: std::array::from_fn(|c| at[c]),
                };
                line.rest[5] = match *d {
                    0 | 1 => r.heading.first().map_or(0.0, |(s, c)| s.atan2(*c)),
                    _ => at[5],
                };
                // The number that is free is the position along the line.
                let first = (0..r.values.len())
                    .map(|k| r.measured(k)[*d])
                    .find(|v| v.is_finite());
                at[*d] = first.unwrap_or(0.0);
                starts.push(vec![*d, 6 + d]);
                rest.push(at);
                lines.push(line);
                continue;
            }
            // Tank coordinates are where x and y are integrated: both are free where either body axis moves.
            for c in 0..2 {
                if dofs.iter().any(|d| *d < 2) && recording.channels[c] && !free.contains(&c) {
                    free.push(c);
                }
            }
            free.retain(|c| *c >= 6 || r.first(*c).is_some() || matches!(c, 3 | 4));
            free.sort_unstable();
            starts.push(free);
            rest.push(at);
        }
        let moving = |d: &usize| {
            let rate = |i: &Option<Given>| i.as_ref().is_some_and(|g| g.rates[*d].is_some());
            inputs.iter().any(rate)
        };
        let driving: Vec<usize> = (0..6).filter(moving).collect();
        let ahead = driving.contains(&0)
            && recording.runs.iter().zip(&inputs).all(|(r, input)| {
                let way = input.as_ref().and_then(|i| i.rates[0].as_ref());
                let mut at = r.times_s.iter();
                way.is_none_or(|way| at.all(|t| way.at(*t) >= 0.0))
            });
        let ground = Ground {
            dofs,
            given: &driving,
            companions: recording.companions_moving(),
            ahead,
            largest: &largest,
            size: Size::of(&recording, &h, &largest, &fastest),
            vehicle: &rig.vehicle,
        };
        let mut candidates = candidates(&ground, &base);
        let (ranges, loads) = (ranges(&recording), loads(&recording));
        candidates.extend(tables(&candidates, &ground, &ranges, &loads));
        // Of a given DOF only its added mass is asked for, where Eq. 1 lets it act on others.
        let on = base
            .iter()
            .map(|b| b.info)
            .chain(candidates.iter().map(|c| c.info));
        let coupled = rig.vehicle.model == VehicleModel::Eq1
            || on
                .into_iter()
                .any(|i| i.parameters.is_empty() && i.words.is_empty());
        let couples = given_dofs
            .iter()
            .filter(|d| coupled && acts_on(&h, **d, dofs, &driving));
        let added = |d: &usize| Coefficient::of(Dof::ALL[*d]).into_iter();
        let added = couples
            .flat_map(added)
            .filter(|c| c.term == CoefficientTerm::Added);
        own.extend(added.map(coefficient));
        Ok(Body {
            candidates,
            given: given_dofs.to_vec(),
            inputs,
            recording,
            vehicle: rig.vehicle.clone(),
            base,
            dofs: dofs.to_vec(),
            own,
            starts,
            rest,
            lines,
            prior,
            responses,
            tolerance,
            step_max_s: STEP_MAX_S.min(STEP_SHARE / quickest.max(1e-9)).max(0.005),
        })
    }

    /// Index of each term's first number, and the index behind the last.
    pub fn places(&self, terms: &[usize]) -> Vec<usize> {
        let mut at = self.own.len();
        let mut places = vec![at];
        for t in terms {
            at += self.candidates[*t].scales.len();
            places.push(at);
        }
        places
    }

    /// Index of each run's first start number, and the count of all.
    pub fn start_places(&self, terms: &[usize]) -> Vec<usize> {
        let mut at = self.places(terms).last().copied().unwrap_or(0);
        let mut places = vec![at];
        for s in &self.starts {
            at += s.len();
            places.push(at);
        }
        places
    }

    /// Where a fit of the vehicle alone begins: the rig's numbers, at rest at the first samples.
    pub fn begin(&self) -> Point {
        let mut point = vec![0.0; self.own.len()];
        for (run, free) in self.starts.iter().enumerate() {
            let r = &self.recording.runs[run];
            point.extend(free.iter().map(|c| match c {
                0..6 => self.rest[run][*c],
                _ => under_way(r, c - 6),
            }));
        }
        point
    }

    /// Prior density of every number.
    pub fn densities(&self, terms: &[usize]) -> Vec<Density> {
        let own = Density::Student {
            centre: 0.0,
            scale: self.prior.coefficient_ln,
            freedom: 2.0,
        };
        let mut all = vec![own; self.own.len()];
        for t in terms {
            all.extend(self.candidates[*t].scales.iter().map(|s| s.density));
        }
        for (run, free) in self.starts.iter().enumerate() {
            all.extend(free.iter().map(|c| match c {
                0..6 => Density::normal(self.rest[run][*c], self.prior.start_place),
                _ => Density::Student {
                    centre: 0.0,
                    scale: self.prior.start_rate,
                    freedom: 1.0,
                },
            }));
        }
        all
    }

    /// Limits of every scaled number.
    pub fn bounds(&self, terms: &[usize]) -> Vec<(f64, f64)> {
        // A coefficient a hundred times the rig's or a hundredth of it is none that this rig's model can be asked for.
        let reach = 100f64.ln();
        let mut all = vec![(-reach, reach); self.own.len()];
        for t in terms {
            all.extend(self.candidates[*t].scales.iter().map(Scale::bounds));
        }
        all.resize(
            self.start_places(terms).last().copied().unwrap_or(0),
            (f64::NEG_INFINITY, f64::INFINITY),
        );
        all
    }

    /// Natural numbers (coefficients, terms' parameters, starts) and their derivatives by the scaled ones.
    pub fn natural(&self, terms: &[usize], point: &[f64]) -> Vec<(f64, f64)> {
        let places = self.places(terms);
        let mut all = Vec::with_capacity(point.len());
        for (own, v) in self.own.iter().zip(point) {
            let (Own::Coefficient(_, unit) | Own::Restoring(unit)) = own;
            let value = unit * v.exp();
            all.push((value, value));
        }
        for (t, at) in terms.iter().zip(&places) {
            let scales = self.candidates[*t].scales.iter();
            all.extend(scales.zip(&point[*at..]).map(|(s, v)| s.natural(*v)));
        }
        let last = places.last().copied().unwrap_or(0);
        all.extend(point[last..].iter().map(|v| (*v, 1.0)));
        all
    }

    fn model<T: Real>(&self, terms: &[usize], natural: &[T]) -> Option<Model<T>> {
        let mut h: Hydrodynamics<T> = Hydrodynamics::new(&self.vehicle);
        for (own, value) in self.own.iter().zip(natural) {
            match own {
                Own::Coefficient(c, _) => {
                    let place = match c.term {
                        CoefficientTerm::Added => &mut h.added,
                        CoefficientTerm::Linear => &mut h.linear,
                        CoefficientTerm::Quadratic => &mut h.quadratic,
                    };
                    place[c.dof.index()] = *value;
                }
                Own::Restoring(_) => h.restoring_nm = *value,
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
        natural: &[T],
        starts: &[T],
    ) -> Vec<[T; 12]> {
        let r = &self.recording.runs[index];
        let Some(model) = self.model(terms, natural) else {
            return vec![[T::from_f64(f64::NAN); 12]; r.times_s.len()];
        };
        if let (Some(line), [position, rate]) = (self.lines.get(index), starts) {
            return self.along(index, line, model, (*position, *rate));
        }
        let mut state =
            ModelState::at_rest(std::array::from_fn(|c| T::from_f64(self.rest[index][c])));
        for (c, value) in self.starts[index].iter().zip(starts) {
            match c {
                0..6 => state.vehicle.eta[*c] = *value,
                _ => state.vehicle.nu[c - 6] = *value,
            }
        }
        let course = Course {
            start_s: r.start_s,
            commands: &r.commands,
            stamps_s: &r.times_s,
            step_max_s: self.step_max_s,
            given: self.inputs[index].as_ref(),
        };
        let mut out = Vec::with_capacity(r.times_s.len());
        run(&model, &course, state, |channels| {
            out.push(r.turned(out.len(), channels));
        });
        out
    }

    /// One DOF alone, the others at rest: the same laws at a fifth of the cost.
    fn along<T: Real>(
        &self,
        index: usize,
        line: &Line,
        model: Model<T>,
        start: (T, T),
    ) -> Vec<[T; 12]> {
        let r = &self.recording.runs[index];
        let mut edges: Vec<(f64, f64)> = Vec::with_capacity(r.commands.len());
        for (t_s, wrench) in &r.commands {
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
        let mut single = Single::new(model.hydrodynamics, *line);
        single.run(
            &model.effects,
            &feed,
            start,
            &mut AsTheyAre,
            |_| T::zero(),
            |x| {
                let mut state = [T::zero(); 12];
                state[line.dof] = x;
                out.push(state);
            },
        );
        out
    }

    /// Channels of one run at a point.
    pub fn values(&self, index: usize, terms: &[usize], point: &[f64]) -> Vec<[f64; 12]> {
        let natural: Vec<f64> = self.natural(terms, point).iter().map(|v| v.0).collect();
        let places = self.start_places(terms);
        let (globals, starts) = (
            &natural[..places[0]],
            &natural[places[index]..places[index + 1]],
        );
        self.drive(index, terms, globals, starts)
    }

    /// Values and columns of each pass.
    fn passes<const N: usize>(
        &self,
        index: usize,
        terms: &[usize],
        numbers: &[f64],
        globals: usize,
    ) -> Vec<Pass> {
        (0..numbers.len())
            .step_by(N)
            .collect::<Vec<_>>()
            .into_par_iter()
            .map(|first| {
                let duals = Dual::<N>::pass(numbers, first);
                let (own, starts) = duals.split_at(globals);
                let out = self.drive(index, terms, own, starts);
                let width = N.min(numbers.len() - first);
                let columns =
                    (0..width).map(|i| out.iter().map(|s| s.map(|v| v.slope[i])).collect());
                (
                    out.iter().map(|s| s.map(|v| v.value)).collect(),
                    columns.collect(),
                )
            })
            .collect()
    }

    /// Passes of sensitivities that a simulation of a model takes, in those of a model of the vehicle alone or a few effects.
    pub fn passes_of(&self, terms: &[usize]) -> usize {
        let numbers = self.places(terms).last().copied().unwrap_or(0);
        let most = self.starts.iter().map(Vec::len).max().unwrap_or(0);
        (numbers + most).div_ceil(WIDTHS[WIDTHS.len() - 1])
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
        made
    }
}
