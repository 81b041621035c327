//! Setup of a body: which numbers are free, what moves of itself, which effects are candidates.

use hydroline_core::run::{Channel, PerChannel};
use hydroline_identify::parameter::{Coefficient, Term as CoefficientTerm};
use hydroline_numerics::statistics::{extent, median};
use hydroline_rigs::{Dof, Rig, Vehicle, VehicleModel};
use hydroline_sim::Given;
use hydroline_sim::effect::{CheckedEffect, EffectError, check};
use hydroline_sim::single::Line;
use hydroline_sim::vehicle::Hydrodynamics;
use hydroline_sim::vehicle::equations::coriolis;

use super::{Body, Own};
use crate::clock::Clock;
use crate::filter::Response;
use crate::given::given;
use crate::prior::PriorTable;
use crate::recording::{Recorded, Recording};
use crate::size::Size;
use crate::term::{Candidate, Ground, Ranges, candidates, tables};

/// Longest RK4 step \[s\].
const STEP_MAX_S: f64 = 0.05;
/// Step over the time constant of the vehicle's fastest motion: RK4's error of a decay is then below 1e-6 per step.
const STEP_SHARE: f64 = 0.25;
/// Scale of a coefficient of which the rig says 0, over the spread of Table 9's range for a vehicle of that mass.
const UNSAID: f64 = 0.1;
/// Samples over which a rate is taken where none is measured: noise does not count then.
const SPAN: usize = 10;
/// Covariates that vary by less than this share of their size do not vary.
const VARIES: f64 = 1e-6;
/// Share of a covariate's range by which tables go on beyond it: rates over a span are less than the largest within.
const MARGIN: f64 = 0.08;

/// Least and greatest of some numbers; `None` where they do not vary.
fn range(values: impl Iterator<Item = f64>) -> Option<(f64, f64)> {
    let (low, high) = extent(values.filter(|v| v.is_finite()));
    let more = MARGIN * (high - low);
    (high - low > VARIES * high.abs().max(low.abs())).then_some((low - more, high + more))
}

/// Ranges of what a force may depend on, as measured: poses, rates (measured, or by the poses), time.
fn ranges(recording: &Recording) -> Ranges {
    let runs = &recording.runs;
    let mut made: Ranges = [None; hydroline_sim::effect::covariate_table::COVARIATES.len()];
    let measured = |c: Channel| range(runs.iter().flat_map(|r| r.seen(c)));
    for [place, speed] in (0..6).map(Channel::of) {
        made[place.index()] = measured(place);
        made[speed.index()] = if recording.channels[speed] {
            measured(speed)
        } else {
            let rates = runs.iter().flat_map(|r| {
                let first = 0..r.times_s.len().saturating_sub(SPAN);
                first.step_by(SPAN / 2).map(move |k| {
                    let (a, b) = (r.measured(k), r.measured(k + SPAN));
                    (b[place] - a[place]) / (r.times_s[k + SPAN] - r.times_s[k]).max(1e-3)
                })
            });
            range(rates)
        };
    }
    made[Channel::ALL.len()] = range(runs.iter().flat_map(|r| r.times_s.iter().copied()));
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

/// Largest load commanded and largest rate, per DOF.
struct Extents {
    load: [f64; 6],
    rate: [f64; 6],
}

impl Extents {
    fn of(recording: &Recording) -> Extents {
        let (mut load, mut rate) = ([0.0_f64; 6], [0.0_f64; 6]);
        for r in &recording.runs {
            for (_, wrench) in &r.commands {
                load = std::array::from_fn(|d| load[d].max(wrench[d].abs()));
            }
            for d in 0..6 {
                let [place, speed] = Channel::of(d);
                let step = |w: [&PerChannel<f64>; 2], t: [f64; 2]| {
                    let rate = (w[1][place] - w[0][place]) / (t[1] - t[0]).max(1e-3);
                    if rate.is_finite() { rate.abs() } else { 0.0 }
                };
                // A robust largest rate: over spans of ten samples noise does not count.
                let spans = r.values.chunks(SPAN).zip(r.times_s.chunks(SPAN));
                for (v, t) in spans.filter(|(v, _)| v.len() == SPAN) {
                    let last = SPAN - 1;
                    rate[d] = rate[d].max(step([&v[0], &v[last]], [t[0], t[last]]));
                    let own = v.iter().map(|v| v[speed].abs()).filter(|v| v.is_finite());
                    rate[d] = own.fold(rate[d], f64::max);
                }
            }
        }
        Extents { load, rate }
    }
}

/// Linearised response of each DOF, and the rate of the fastest motion \[1/s\].
fn responses(h: &Hydrodynamics<f64>, rate: &[f64; 6]) -> ([Response; 6], f64) {
    let mass = h.mass();
    let mut quickest = 0.0_f64;
    let responses = std::array::from_fn(|d| {
        let damping = |speed: f64| -(h.linear[d] + 2.0 * h.quadratic[d] * speed) / mass[d];
        let stiffness_ps2 = (h.stiffness(d) / mass[d]).max(0.0);
        quickest = quickest.max(damping(rate[d])).max(stiffness_ps2.sqrt());
        Response {
            damping_ps: damping(0.5 * rate[d]).max(1e-3),
            stiffness_ps2,
        }
    });
    (responses, quickest)
}

/// Free states at the runs' starts, the values of the others, and the motion that is given.
#[derive(Default)]
struct Beginnings {
    starts: Vec<Vec<Channel>>,
    rest: Vec<PerChannel<f64>>,
    lines: Vec<Line>,
    inputs: Vec<Option<Given>>,
}

impl Beginnings {
    fn of(recording: &Recording, rig: &Rig, dofs: &[usize], given_dofs: &[usize]) -> Beginnings {
        let mut made = Beginnings::default();
        let tolerance = rig.tolerance.channels();
        for r in &recording.runs {
            let mut at = states_at_start(r, rig, dofs);
            let input = given(r, given_dofs, dofs, &at, &tolerance);
            // One DOF moves along a line unless the line is rotated or shifted by others.
            let line_stays =
                dofs.first().is_some_and(|d| *d > 1) || input.rates.iter().all(Option::is_none);
            made.inputs.push(Some(input).filter(|i| !i.is_empty()));
            match dofs {
                [d] if !recording.channels[Channel::RATES[*d]] && line_stays => {
                    made.lines.push(line_of(r, *d, &at));
                    // The number that is free is the position along the line.
                    let place = Channel::POSES[*d];
                    let mut measured = (0..r.values.len()).map(|k| r.measured(k)[place]);
                    at[place] = measured.find(|v| v.is_finite()).unwrap_or(0.0);
                    made.starts.push(Channel::of(*d).to_vec());
                }
                _ => made.starts.push(free_at_start(recording, r, dofs)),
            }
            made.rest.push(at);
        }
        made
    }

    /// DOFs whose rate is given in any run.
    fn driving(&self) -> Vec<usize> {
        let moving = |d: &usize| {
            let rate = |i: &Option<Given>| i.as_ref().is_some_and(|g| g.rates[*d].is_some());
            self.inputs.iter().any(rate)
        };
        (0..6).filter(moving).collect()
    }

    /// Whether a given surge never goes astern.
    fn is_ahead(&self, recording: &Recording) -> bool {
        recording.runs.iter().zip(&self.inputs).all(|(r, input)| {
            let way = input.as_ref().and_then(|i| i.rates[0].as_ref());
            let mut at = r.times_s.iter();
            way.is_none_or(|way| at.all(|t| way.at(*t) >= 0.0))
        })
    }
}

/// States of a run at its start: as first measured, and a DOF that does not move at its median.
fn states_at_start(r: &Recorded, rig: &Rig, dofs: &[usize]) -> PerChannel<f64> {
    let mut at = PerChannel::splat(0.0);
    for (d, place) in Channel::POSES.into_iter().enumerate() {
        at[place] = r.first(place).unwrap_or(rig.tank.start_pose[d]);
        if !dofs.contains(&d) {
            let mut seen: Vec<f64> = r.seen(place).collect();
            at[place] = median(&mut seen).unwrap_or(at[place]);
        }
    }
    at
}

/// The line along which one DOF moves.
fn line_of(r: &Recorded, dof: usize, at: &PerChannel<f64>) -> Line {
    let mut rest = at.pose();
    if dof < 2 {
        rest[5] = r.heading.first().map_or(0.0, |(s, c)| s.atan2(*c));
    }
    Line { dof, rest }
}

/// States that are free at a run's start.
fn free_at_start(recording: &Recording, r: &Recorded, dofs: &[usize]) -> Vec<Channel> {
    let mut free: Vec<Channel> = dofs.iter().flat_map(|d| Channel::of(*d)).collect();
    // Tank coordinates are where x and y are integrated: both are free where either body axis moves.
    for c in [Channel::X, Channel::Y] {
        if dofs.iter().any(|d| *d < 2) && recording.channels[c] && !free.contains(&c) {
            free.push(c);
        }
    }
    free.retain(|c| c.is_rate() || r.has(*c) || matches!(c, Channel::Phi | Channel::Theta));
    free.sort_unstable();
    free
}

/// A coefficient as it is fitted.
fn coefficient(c: Coefficient, rig: &Rig) -> Own {
    let said = c.of_vehicle(&rig.vehicle);
    if said == 0.0 {
        Own::Unsaid(c, -UNSAID * c.size(rig))
    } else {
        Own::Coefficient(c, said)
    }
}

/// Stiffnesses of the water and net weight, where the rig says that there are any and the DOF moves freely.
fn of_floating(vehicle: &Vehicle, dofs: &[usize]) -> Vec<Own> {
    let heave = Dof::Heave.index();
    let each = vehicle.stiffness.into_iter().enumerate();
    let acting = each.filter(|(place, said)| *said != 0.0 && dofs.contains(&(heave + place)));
    let mut own: Vec<Own> = acting
        .map(|(place, said)| Own::Stiffness(place, said))
        .collect();
    if vehicle.net_weight_n != 0.0 && dofs.contains(&heave) {
        own.push(Own::NetWeight(vehicle.net_weight_n));
    }
    own
}

/// Added masses of given DOFs, where Eq. 1 lets them act on those simulated: all that is asked of a given DOF.
fn added_of_given(
    rig: &Rig,
    h: &Hydrodynamics<f64>,
    (dofs, given_dofs, driving): (&[usize], &[usize], &[usize]),
    base: &[CheckedEffect],
    candidates: &[Candidate],
) -> Vec<Own> {
    let mut on = base
        .iter()
        .map(|b| b.info)
        .chain(candidates.iter().map(|c| c.info));
    let coupled = rig.vehicle.model == VehicleModel::Eq1
        || on.any(|i| i.parameters.is_empty() && i.words.is_empty());
    given_dofs
        .iter()
        .filter(|d| coupled && acts_on(h, **d, dofs, driving))
        .flat_map(|d| Coefficient::of(Dof::ALL[*d]))
        .filter(|c| c.term == CoefficientTerm::Added)
        .map(|c| coefficient(c, rig))
        .collect()
}

#[derive(Debug, Clone, Copy)]
enum Asked<'a> {
    /// Everything that may have been left out.
    All,
    /// The same as another body was asked for.
    As(&'a Body),
    /// Nothing: the rig's own model.
    Nothing,
}

impl Body {
    /// The body of a rig under a recording; `given` DOFs move as they were measured.
    ///
    /// # Errors
    /// [`EffectError`] for a bad `[[physics]]` entry.
    pub fn new(
        recording: Recording,
        rig: &Rig,
        dofs: &[usize],
        given_dofs: &[usize],
        prior: PriorTable,
    ) -> Result<Body, EffectError> {
        Body::asked(recording, rig, dofs, given_dofs, prior, Asked::All)
    }

    /// The same body and candidates under another recording.
    ///
    /// # Errors
    /// [`EffectError`] for a bad `[[physics]]` entry.
    pub fn over(&self, recording: Recording, rig: &Rig) -> Result<Body, EffectError> {
        let Body { dofs, given, .. } = self;
        Body::asked(recording, rig, dofs, given, self.prior, Asked::As(self))
    }

    /// The rig's own model alone, without candidates.
    ///
    /// # Errors
    /// [`EffectError`] for a bad `[[physics]]` entry.
    pub fn plain(recording: Recording, rig: &Rig, dofs: &[usize]) -> Result<Body, EffectError> {
        let prior = PriorTable::default();
        Body::asked(recording, rig, dofs, &[], prior, Asked::Nothing)
    }

    fn asked(
        mut recording: Recording,
        rig: &Rig,
        dofs: &[usize],
        given_dofs: &[usize],
        prior: PriorTable,
        asked: Asked<'_>,
    ) -> Result<Body, EffectError> {
        let base = check(&rig.physics)?;
        if !dofs.contains(&5) && !given_dofs.contains(&5) {
            recording.hold_heading();
        }
        let h: Hydrodynamics<f64> = Hydrodynamics::new(&rig.vehicle);
        let mut own: Vec<Own> = dofs
            .iter()
            .flat_map(|d| Coefficient::of(Dof::ALL[*d]))
            .map(|c| coefficient(c, rig))
            .collect();
        if dofs.iter().any(|d| matches!(d, 3 | 4)) && h.restoring_nm != 0.0 {
            own.push(Own::Restoring(h.restoring_nm));
        }
        own.extend(of_floating(&rig.vehicle, dofs));
        let extents = Extents::of(&recording);
        let (responses, quickest) = responses(&h, &extents.rate);
        let begins = Beginnings::of(&recording, rig, dofs, given_dofs);
        let driving = begins.driving();
        let ground = Ground {
            dofs,
            given: &driving,
            companions: recording.companions_moving(),
            ahead: driving.contains(&0) && begins.is_ahead(&recording),
            largest: &extents.load,
            size: Size::of(&recording, &h, &extents.load, &extents.rate),
            vehicle: &rig.vehicle,
        };
        let bearable = Size::bearable(&recording, &h, &extents.load, &extents.rate);
        let candidates = match asked {
            Asked::All => {
                let mut all = candidates(&ground, &base);
                let (ranges, loads) = (ranges(&recording), loads(&recording));
                all.extend(tables(&all, &ground, &ranges, &loads));
                all
            }
            Asked::As(body) => body.candidates.clone(),
            Asked::Nothing => Vec::new(),
        };
        match asked {
            Asked::As(body) => own.clone_from(&body.own),
            _ => {
                let which = (dofs, given_dofs, &driving[..]);
                own.extend(added_of_given(rig, &h, which, &base, &candidates));
            }
        }
        if !matches!(asked, Asked::As(_)) {
            let mut known: Vec<Clock> = Vec::new();
            for clock in recording.runs.iter().filter_map(|r| r.clock) {
                if !known.contains(&clock) {
                    known.push(clock);
                    own.extend(clock.numbers());
                }
            }
        }
        Ok(Body {
            candidates,
            given: given_dofs.to_vec(),
            inputs: begins.inputs,
            recording,
            vehicle: rig.vehicle.clone(),
            base,
            dofs: dofs.to_vec(),
            own,
            starts: begins.starts,
            rest: begins.rest,
            lines: begins.lines,
            prior,
            responses,
            bearable,
            tolerance: rig.tolerance.channels(),
            step_max_s: STEP_MAX_S.min(STEP_SHARE / quickest.max(1e-9)).max(0.005),
        })
    }
}
