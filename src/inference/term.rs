//! Terms of a model: which effects of the registry may act where, with points to begin from.

use hydroline_core::run::{COMPANIONS, Channel};
use hydroline_rigs::{Dof, Vehicle};
use hydroline_sim::effect::covariate_table::{COVARIATES, POINTS};
use hydroline_sim::effect::{
    ALL, CheckedEffect, EffectInfo, EffectStack, ParameterInfo, Stage, WordInfo,
};
use hydroline_sim::given::{Curve, Given};
use hydroline_sim::model::{Model, ModelState};
use hydroline_sim::vehicle::Hydrodynamics;

use super::prior::{Scale, nothing};
use super::size::Size;

/// Motion, loads and vehicle that effects may act on: they decide where each may be asked.
#[derive(Debug, Clone, Copy)]
pub struct Ground<'a> {
    /// DOFs that are simulated.
    pub dofs: &'a [usize],
    /// DOFs that move without being simulated.
    pub given: &'a [usize],
    /// Companions that move.
    pub companions: [bool; COMPANIONS.len()],
    /// The way is given, and never astern.
    pub ahead: bool,
    /// Greatest load commanded per DOF \[N, N m\].
    pub largest: &'a [f64; 6],
    /// The vehicle's size beside the library's.
    pub size: Size,
    /// The rig's vehicle.
    pub vehicle: &'a Vehicle,
}

/// Kind of term that a candidate adds to a model.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Kind {
    /// An effect of the library.
    Effect,
    /// A force of no known effect along a covariate.
    Force {
        /// DOF in which it acts.
        dof: usize,
    },
    /// The same written down as an expression of that covariate.
    Form {
        /// DOF in which it acts.
        dof: usize,
        /// The table that it stands for.
        table: usize,
        /// Log prior odds of it over that table.
        ln_odds: f64,
    },
    /// The law of another candidate is only nearly the library's: its first number varies along a covariate.
    Trend {
        /// That candidate.
        of: usize,
    },
}

/// Something that may have been left out, at one place.
#[derive(Debug, Clone, PartialEq)]
pub struct Candidate {
    /// Kind of term.
    pub kind: Kind,
    /// The effect.
    pub info: &'static EffectInfo,
    /// Index per word.
    pub words: Vec<usize>,
    /// Its parameters, plausible for a vehicle of this size; none of a table.
    pub parameters: Vec<ParameterInfo>,
    /// The effect's first numbers that are not searched: the ends of a table.
    pub fixed: Vec<f64>,
    /// Of a table: its covariate ([`COVARIATES`]) and that at both ends.
    pub along: Option<(usize, (f64, f64))>,
    /// Scale and prior per number that is searched.
    pub scales: Vec<Scale>,
    /// Points to begin from, natural numbers.
    pub starts: Vec<Vec<f64>>,
    /// Value of the first parameter where the effect is not there.
    pub nothing: f64,
    /// Numbers in which its force is linear, the first among them; none where that one is not.
    pub linear: Vec<usize>,
    /// It is one of the vehicle's own coefficients by another name.
    pub own: bool,
}

impl Candidate {
    /// Name with its words, e.g. `thruster_lag yaw`.
    pub fn name(&self) -> String {
        let words = self.info.words.iter().zip(&self.words);
        let words: Vec<&str> = words
            .filter_map(|(w, i)| w.allowed.get(*i).copied())
            .collect();
        let mut name = [&[self.info.id], &words[..]].concat().join(" ");
        if let (Kind::Trend { .. }, Some(along)) = (self.kind, self.covariate()) {
            name.push_str(" varies with ");
            name.push_str(along);
        }
        name
    }

    /// Whether it is a table: its points have a prior together.
    pub fn is_table(&self) -> bool {
        self.along.is_some()
    }

    /// Name of a table's covariate.
    pub fn covariate(&self) -> Option<&'static str> {
        COVARIATES.get(self.along?.0).copied()
    }

    /// A word's value.
    pub fn word(&self, name: &str) -> Option<&'static str> {
        let at = self.info.words.iter().position(|w| w.name == name)?;
        self.info.words[at].allowed.get(self.words[at]).copied()
    }

    /// The DOF or axis that its words name.
    pub fn place(&self) -> Option<&'static str> {
        self.word("dof").or_else(|| self.word("axis"))
    }

    /// Index of the DOF that its words name.
    pub fn dof(&self) -> Option<usize> {
        let name = self.place()?;
        Dof::ALL.into_iter().position(|d| d.name() == name)
    }

    /// As the simulator takes it; numbers are filled in by whoever runs it.
    ///
    /// `numbers` = those that are searched; of a trend nothing is asked here.
    pub fn checked(&self, numbers: &[f64]) -> CheckedEffect {
        CheckedEffect {
            info: self.info,
            numbers: [&self.fixed, numbers].concat(),
            words: self.words.clone(),
            trend: None,
            notes: Vec::new(),
        }
    }
}

/// Whether an effect leaves every pose as it is: light, lens, sheet and target, which only images show. Its law is asked, at
/// typical values; a search over motion would simulate it at each of its starts to find nothing.
pub fn in_images_only(info: &'static EffectInfo) -> bool {
    if info.stage != Stage::Measurement {
        return false;
    }
    let typical = [CheckedEffect::typical(info)];
    let Ok(stack) = EffectStack::<f64>::assemble(&typical, |_, _, v| v) else {
        return false;
    };
    let pose = [0.3, -0.1, -0.8, 0.05, -0.04, 0.2];
    [0.4, 1.7, 5.3]
        .iter()
        .all(|t_s| stack.reported_pose(*t_s, stack.scene_pose(*t_s, pose)) == pose)
}

/// Every effect at every place where it may act, but those that are switched on already.
pub fn candidates(ground: &Ground<'_>, on: &[CheckedEffect]) -> Vec<Candidate> {
    let mut all = Vec::new();
    // Without a command there is one clock, and nothing to be late against.
    let commanded = ground.largest.iter().any(|load| *load > 0.0);
    let asked = |i: &&&EffectInfo| commanded || i.stage != Stage::Timing;
    let moves = ALL.iter().filter(|i| !i.is_written() && !in_images_only(i));
    for info in moves.filter(asked) {
        for words in choices(info.words, ground) {
            if is_own_square(info.words, &words) || is_lift(info, &words, ground) {
                continue;
            }
            if on.iter().any(|o| o.info.id == info.id && o.words == words) {
                continue;
            }
            let made = Candidate::new(info, words, ground);
            if made.changes(ground) {
                all.push(made);
            }
        }
    }
    all
}

/// Whether a product of rates is damping in proportion to the way: where the hull never goes astern it is `lift_damping`
/// by another name.
fn is_lift(info: &EffectInfo, words: &[usize], ground: &Ground<'_>) -> bool {
    let named = |word: &str| {
        let at = info.words.iter().position(|w| w.name == word)?;
        info.words[at].allowed.get(words[at]).copied()
    };
    let (Some(dof), Some(a), Some(b)) = (named("dof"), named("a"), named("b")) else {
        return false;
    };
    let dof = Dof::ALL.into_iter().position(|d| d.name() == dof);
    ground.ahead && a == RATES[0] && RATES.iter().position(|r| *r == b) == dof
}

/// Whether a product of rates is a DOF's own rate squared: damping of a hull that differs ahead and astern, which stands in
/// the library as such. As a product it would drive the vehicle on one side.
fn is_own_square(info: &[WordInfo], words: &[usize]) -> bool {
    let named = |word: &str| {
        let at = info.iter().position(|w| w.name == word)?;
        info[at].allowed.get(words[at]).copied()
    };
    let place = |rate: &str| RATES.iter().position(|r| *r == rate);
    let (Some(dof), Some(a), Some(b)) = (named("dof"), named("a"), named("b")) else {
        return false;
    };
    let dof = Dof::ALL.into_iter().position(|d| d.name() == dof);
    place(a) == dof && place(b) == dof
}

/// Rates in the order of the DOFs.
const RATES: [&str; 6] = ["u", "v", "w", "p", "q", "r"];

/// All combinations of words in which none names a DOF that is not simulated, a rate that is 0 or a companion that rests.
fn choices(words: &[WordInfo], ground: &Ground<'_>) -> Vec<Vec<usize>> {
    let moves = |word: &str| {
        let companion = |name: &&str| name.split('_').next() == Some(word);
        if let Some(d) = Dof::ALL.into_iter().position(|d| d.name() == word) {
            ground.dofs.contains(&d)
        } else if let Some(d) = RATES.iter().position(|r| *r == word) {
            ground.dofs.contains(&d) || ground.given.contains(&d)
        } else if let Some(c) = COMPANIONS.iter().position(companion) {
            ground.companions[c]
        } else {
            true
        }
    };
    let mut made = vec![Vec::new()];
    for w in words {
        let allowed = (0..w.allowed.len()).filter(|i| moves(w.allowed[*i]));
        let allowed: Vec<usize> = allowed.collect();
        made = made
            .into_iter()
            .flat_map(|chosen: Vec<usize>| {
                allowed.iter().map(move |i| {
                    let mut more = chosen.clone();
                    more.push(*i);
                    more
                })
            })
            .collect();
    }
    made
}

/// Ranges that covariates have in a recording; `None` where one does not vary or is not known.
pub type Ranges = [Option<(f64, f64)>; COVARIATES.len()];

/// Place of time among the covariates: behind the channels.
const TIME: usize = Channel::ALL.len();

/// Covariates that a table of this DOF may run along: what moves, time, and the DOF's own load.
fn covariates(dof: usize, ground: &Ground<'_>, ranges: &Ranges) -> Vec<(usize, (f64, f64))> {
    let moves = || ground.dofs.iter().chain(ground.given);
    let turns = moves().filter(|d| [0, 1, 5].contains(d)).count() > 1;
    let wide = |c: usize| ranges[c].map_or(0.0, |(low, high)| high - low);
    let asked = |c: usize| match c {
        // Where surge or sway moves, both tank coordinates do; on a straight way they are one.
        0 | 1 if dof > 1 => false,
        0 | 1 => turns || wide(c) >= wide(1 - c),
        2..6 => c == dof,
        6..TIME => moves().any(|d| *d == c - 6),
        _ => true,
    };
    let each = (0..COVARIATES.len()).filter(|c| asked(*c));
    each.filter_map(|c| Some((c, ranges[c]?))).collect()
}

/// Whether an effect's force in a DOF is a function of one covariate, whatever else moves; asked of its law.
pub(super) fn is_function_of(
    effect: &Candidate,
    dof: usize,
    (covariate, (from, to)): (usize, (f64, f64)),
    vehicle: &Vehicle,
) -> bool {
    let Some(numbers) = effect.starts.first() else {
        return false;
    };
    let on = [effect.checked(numbers)];
    let force = |value: f64, others: f64| -> Option<f64> {
        let rate = |on: &[CheckedEffect]| -> Option<f64> {
            let model = Model {
                hydrodynamics: Hydrodynamics::new(vehicle),
                effects: EffectStack::assemble(on, |_, _, v| v).ok()?,
            };
            let mut state = ModelState::at_rest([0.3, -0.2, -0.8, 0.1, -0.07, 0.4]);
            state.vehicle.eta[dof] += 0.05 * others;
            for (d, nu) in state.vehicle.nu.iter_mut().enumerate() {
                *nu = others * (0.02 + 0.005 * d as f64);
            }
            state.own.fill(0.1 * others);
            let (mut t_s, mut wrench) = (3.0 + others, [0.4 * others; 6]);
            match Channel::ALL.get(covariate) {
                Some(c) => *state.vehicle.channel(*c) = value,
                None if covariate == TIME => t_s = value,
                None => wrench[dof] = value,
            }
            Some(model.rate(t_s, t_s, &state, &wrench).vehicle.nu[dof])
        };
        Some(rate(&on)? - rate(&[])?)
    };
    let at = |share: f64| from + (to - from) * share;
    let asked = || -> Option<bool> {
        // Rounding of the whole motion leaves this much.
        let equal = |a: f64, b: f64| (a - b).abs() <= 1e-9 * (1.0 + a.abs());
        let (mut same, mut varies) = (true, false);
        let first = force(at(0.12), 1.0)?;
        for share in [0.12, 0.4, 0.88] {
            let (a, b) = (force(at(share), 1.0)?, force(at(share), -1.7)?);
            same &= equal(a, b);
            varies |= !equal(a, first);
        }
        // A constant that varies with it would be any function, and no known law.
        Some(same && varies)
    };
    asked().unwrap_or(false)
}

/// Additive discrepancies in these DOFs, and state-dependent parameters of effects: tables, whose shape is free.
///
/// `effects` = candidates of the library, whose places are kept; `loads` = range of the load per DOF.
pub fn tables(
    effects: &[Candidate],
    ground: &Ground<'_>,
    ranges: &Ranges,
    loads: &[Option<(f64, f64)>; 6],
) -> Vec<Candidate> {
    const LOAD: usize = COVARIATES.len() - 1;
    let mut made = Vec::new();
    let along = |dof: usize| {
        let mut ranges = *ranges;
        ranges[LOAD] = loads[dof];
        covariates(dof, ground, &ranges)
    };
    let table = |kind, info, words, fixed, along| Candidate {
        kind,
        info,
        words,
        parameters: Vec::new(),
        fixed,
        along: Some(along),
        scales: vec![Scale::of_table(); POINTS],
        linear: Vec::new(),
        own: false,
        starts: Vec::new(),
        nothing: 0.0,
    };
    if let Some(info) = ALL.iter().find(|i| i.is_a_table()) {
        for &dof in ground.dofs {
            for (c, range) in along(dof) {
                let ends = vec![range.0, range.1];
                let kind = Kind::Force { dof };
                made.push(table(kind, *info, vec![dof, c], ends, (c, range)));
            }
        }
    }
    for (of, c) in effects.iter().enumerate() {
        // Stamps and instruments have their own faults; a corner at a limit of the load moves none of what lies below.
        let in_motion = matches!(c.info.stage, Stage::Thruster | Stage::Hydrodynamics);
        if !in_motion || c.scales.is_empty() {
            continue;
        }
        let places: Vec<usize> = c.dof().map_or_else(|| ground.dofs.to_vec(), |d| vec![d]);
        let mut seen = Vec::new();
        for (covariate, range) in places.into_iter().flat_map(along) {
            if seen.contains(&covariate) {
                continue;
            }
            seen.push(covariate);
            let words = c.words.clone();
            let along = (covariate, range);
            made.push(table(Kind::Trend { of }, c.info, words, Vec::new(), along));
        }
    }
    made
}

/// Rates of all states under effects, where everything moves that may.
fn rates(on: &[CheckedEffect], ground: &Ground<'_>) -> Option<Vec<f64>> {
    rates_of(Hydrodynamics::new(ground.vehicle), on, ground, 1.0)
}

/// Values of moving companions at which laws are asked: two angles \[rad\], shaft speed \[rad/s\], height of the wave \[m\].
const BESIDE: [f64; COMPANIONS.len()] = [0.2, -0.15, 9.0, 0.03];

/// The same of another hull, under loads that are `loads` times as large.
fn rates_of(
    hydrodynamics: Hydrodynamics<f64>,
    on: &[CheckedEffect],
    ground: &Ground<'_>,
    loads: f64,
) -> Option<Vec<f64>> {
    let model = Model {
        hydrodynamics,
        effects: EffectStack::assemble(on, |_, _, v| v).ok()?,
    };
    // A companion that rests, or was not measured, drives nothing.
    let moving = |c: usize| ground.companions[c].then(|| Curve::constant(BESIDE[c]));
    let beside = Given {
        companions: std::array::from_fn(moving),
        ..Given::default()
    };
    let mut all = Vec::new();
    for (k, sign) in [1.0, -1.0, 1.0].into_iter().enumerate() {
        let mut state = ModelState::at_rest([0.3, -0.2, -0.8, 0.1, -0.07, 0.4]);
        state.own.fill(0.1);
        let some = [0.31, 0.12, -0.07, 0.13, -0.11, 0.17];
        for d in ground.dofs.iter().chain(ground.given) {
            state.vehicle.nu[*d] = sign * some[(*d + k) % 6];
        }
        let wrench = [3.0, -2.0, 1.0, 0.2, -0.3, 0.4].map(|w: f64| w * sign * loads);
        let t_s = 1.7 + k as f64;
        let rate = model.rate_beside(t_s, t_s, &state, &wrench, Some(&beside));
        all.extend(rate.vehicle.nu);
        all.extend(rate.own);
    }
    all.iter().all(|v| v.is_finite()).then_some(all)
}

/// Where a limit on the load begins, over the largest load: between loads a limit clips other steps of the command, and
/// no fit finds from one of these stretches into the next.
const LIMITS: [f64; 5] = [0.95, 0.85, 0.72, 0.58, 0.44];

impl Candidate {
    fn new(info: &'static EffectInfo, words: Vec<usize>, ground: &Ground<'_>) -> Candidate {
        let mut made = Candidate {
            kind: Kind::Effect,
            fixed: Vec::new(),
            along: None,
            parameters: Vec::new(),
            scales: Vec::new(),
            starts: Vec::new(),
            nothing: info.parameters.first().map_or(0.0, nothing),
            info,
            words,
            linear: Vec::new(),
            own: false,
        };
        // An effect that acts in no DOF of its own is as large as the first simulated DOF bears.
        let dof = made.dof().or(ground.dofs.first().copied()).unwrap_or(0);
        let sized = info.parameters.iter().map(|p| ground.size.sized(p, dof));
        made.parameters = sized.collect();
        let numbers = made.parameters.iter().enumerate();
        made.scales = numbers.map(|(i, p)| Scale::of(p, i)).collect();
        made.starts = starts(&made.parameters);
        made.linear = made.linear_numbers(ground);
        made.own = made.is_own(ground);
        if info.parameters.first().is_some_and(|p| p.bounds_load) {
            let top = ground.largest[made.dof().unwrap_or(0)];
            if top > 0.0 {
                made.nothing = top;
                made.starts = LIMITS
                    .iter()
                    .map(|share| {
                        let mut point = made.starts[0].clone();
                        point[0] = share * top;
                        point
                    })
                    .collect();
                // A thruster that limits at all is one that passed for sound: between a third of the largest load and it.
                made.scales[0].density = super::prior::Density::Student {
                    centre: (0.65 * top).ln(),
                    scale: 0.25,
                    freedom: 4.0,
                };
                made.scales[0].logarithmic = true;
                made.scales[0].sign = 1.0;
            }
        }
        made
    }

    /// The numbers that a response is stretched by: those in which it is linear, or the first, which says how large the
    /// effect is.
    pub fn stretched(&self) -> &[usize] {
        match self.linear.is_empty() && !self.scales.is_empty() {
            true => &[0],
            false => &self.linear,
        }
    }

    /// A point with the numbers of `of` at `share` of their way from nothing.
    pub fn at_share(&self, start: &[f64], of: &[usize], share: f64) -> Vec<f64> {
        let mut numbers = start.to_vec();
        for i in of {
            let from = if *i == 0 {
                self.nothing
            } else {
                nothing(&self.parameters[*i])
            };
            numbers[*i] = from + share * (start[*i] - from);
        }
        numbers
    }

    /// Whether it does anything in the simulated DOFs: its law is asked, at each of its points to begin from, where everything
    /// moves that may, under loads small and large (a limit on the load does nothing below itself). What acts on stamps and
    /// instruments is no part of that rate, and acts wherever something is measured.
    fn changes(&self, ground: &Ground<'_>) -> bool {
        if !matches!(self.info.stage, Stage::Thruster | Stage::Hydrodynamics) {
            return true;
        }
        let per_state = 6 + hydroline_sim::model::OWN_STATES_MAX;
        let differ = |a: &[f64], b: &[f64]| {
            let each = a.iter().zip(b).enumerate();
            each.filter(|(i, _)| ground.dofs.contains(&(i % per_state)))
                .any(|(_, (a, b))| a != b)
        };
        let hull = || Hydrodynamics::new(ground.vehicle);
        [1.0, 1e3].into_iter().any(|loads| {
            let rates = |on: &[CheckedEffect]| rates_of(hull(), on, ground, loads);
            let none = rates(&[]);
            let with = |start: &Vec<f64>| rates(&[self.checked(start)]).zip(none.as_ref());
            self.starts
                .iter()
                .any(|start| with(start).is_some_and(|(a, b)| differ(&a, b)))
        })
    }

    /// The law is asked: scaling these numbers together scales what they do.
    fn is_linear_in(&self, of: &[usize], ground: &Ground<'_>) -> bool {
        let Some(start) = self.starts.first() else {
            return false;
        };
        let by = |share: f64| rates(&[self.checked(&self.at_share(start, of, share))], ground);
        let (Some(none), Some(one)) = (by(0.0), by(1.0)) else {
            return false;
        };
        let does: Vec<f64> = one.iter().zip(&none).map(|(a, b)| a - b).collect();
        let largest = does.iter().fold(0.0_f64, |m, v| m.max(v.abs()));
        largest > 0.0
            && SHARES.iter().all(|share| {
                by(*share).is_some_and(|made| {
                    let each = made.iter().zip(&none).zip(&does);
                    let off = each.fold(0.0_f64, |m, ((a, b), d)| m.max((a - b - share * d).abs()));
                    off < 1e-9 * share.abs() * largest
                })
            })
    }

    /// Whether its force is always that of one of the vehicle's own coefficients: no recording distinguishes them.
    fn is_own(&self, ground: &Ground<'_>) -> bool {
        let Some((start, none)) = self.starts.first().zip(rates(&[], ground)) else {
            return false;
        };
        let does = |made: Option<Vec<f64>>| -> Option<Vec<f64>> {
            Some(made?.iter().zip(&none).map(|(a, b)| a - b).collect())
        };
        let Some(this) = does(rates(&[self.checked(start)], ground)) else {
            return false;
        };
        let dot = |a: &[f64], b: &[f64]| -> f64 { a.iter().zip(b).map(|(a, b)| a * b).sum() };
        let alike = |other: Vec<f64>| {
            let (both, size) = (dot(&this, &other), dot(&this, &this) * dot(&other, &other));
            size > 0.0 && both * both > (1.0 - 1e-9) * size
        };
        (0..6).any(|d| {
            [0, 1].into_iter().any(|power| {
                let mut hull = Hydrodynamics::new(ground.vehicle);
                let place = if power == 0 {
                    &mut hull.linear
                } else {
                    &mut hull.quadratic
                };
                place[d] -= 1.0;
                does(rates_of(hull, &[], ground, 1.0)).is_some_and(alike)
            })
        })
    }

    fn linear_numbers(&self, ground: &Ground<'_>) -> Vec<usize> {
        let numbers = self.info.parameters;
        if numbers.is_empty() || !self.is_linear_in(&[0], ground) {
            return Vec::new();
        }
        let mut of = vec![0];
        for i in (1..numbers.len()).filter(|i| !numbers[*i].held) {
            of.push(i);
            if !self.is_linear_in(&of, ground) {
                of.pop();
            }
        }
        of
    }
}

/// Shares of a number's way from nothing at which a law is asked whether it is linear.
const SHARES: [f64; 3] = [2.0, 30.0, -30.0];

/// Whether shares of the plausible range go by ratio: it has one sign and spans a factor of four.
pub fn by_ratio((low, high): (f64, f64)) -> bool {
    low > 0.0 && high >= 4.0 * low
}

/// A share of the plausible range.
pub fn point(p: &ParameterInfo, share: f64) -> f64 {
    let (low, high) = p.plausible;
    if by_ratio(p.plausible) {
        low * (high / low).powf(share)
    } else {
        low + (high - low) * share
    }
}

/// Radical inverse: evenly filling points without a seed (Halton 1960).
pub fn radical(mut k: usize, base: usize) -> f64 {
    let (mut value, mut digit) = (0.0, 1.0 / base as f64);
    while k > 0 {
        value += (k % base) as f64 * digit;
        k /= base;
        digit /= base as f64;
    }
    value
}

fn starts(parameters: &[ParameterInfo]) -> Vec<Vec<f64>> {
    const BASES: [usize; 5] = [2, 3, 5, 7, 11];
    let usual = |p: &ParameterInfo| p.absent.filter(|_| p.held).unwrap_or(p.typical);
    let typical: Vec<f64> = parameters.iter().map(usual).collect();
    let mut points = vec![typical];
    let free = parameters.iter().filter(|p| !p.held).count();
    let count = match free {
        0 => return points,
        1 => {
            points.extend([0.1, 0.9].map(|s| vec![point(&parameters[0], s)]));
            return points;
        }
        2 => 6,
        _ => 24,
    };
    for k in 1..=count {
        let numbers = parameters.iter().enumerate();
        points.push(
            numbers
                .map(|(i, p)| match p.held {
                    true => usual(p),
                    false => point(p, radical(k, BASES[i % BASES.len()])),
                })
                .collect(),
        );
    }
    points
}

#[cfg(test)]
mod tests {
    use super::*;
    use hydroline_rigs::{Rig, VehicleModel};

    fn plain(vehicle: &Vehicle) -> Ground<'_> {
        Ground {
            dofs: &[0],
            given: &[],
            companions: [false; 4],
            ahead: false,
            largest: &[8.0; 6],
            size: Size::USUAL,
            vehicle,
        }
    }

    /// A ship's rudder was not asked for, and a hull under way could be damped by its speed under two names.
    #[test]
    fn what_is_given_opens_what_it_can_drive() {
        let vehicle = Rig::builtin("lshpi").unwrap().vehicle;
        let names = |ground: &Ground<'_>| -> Vec<String> {
            candidates(ground, &[])
                .iter()
                .map(Candidate::name)
                .collect()
        };
        let has = |all: &[String], name: &str| all.iter().any(|n| n == name);
        let alone = names(&plain(&vehicle));
        assert!(!alone.iter().any(|n| n.starts_with("fin_force")));
        let ship = names(&Ground {
            given: &[1, 5],
            companions: [true, false, false, false],
            ..plain(&vehicle)
        });
        assert!(has(&ship, "fin_force surge rudder") && !has(&ship, "fin_force surge elevator"));
        assert!(has(&ship, "cross_flow_coupling surge v r"));
        assert!(!has(&ship, "cross_flow_coupling yaw v r") && !has(&ship, "added_mass_coupling"));
        let roll = |ahead| {
            names(&Ground {
                dofs: &[3],
                given: &[0],
                ahead,
                ..plain(&vehicle)
            })
        };
        assert!(has(&roll(true), "lift_damping roll"));
        assert!(!has(&roll(true), "cross_flow_coupling roll u p"));
        assert!(has(&roll(false), "cross_flow_coupling roll u p"));
        let mut decoupled = vehicle.clone();
        decoupled.model = VehicleModel::Decoupled;
        let ship = Ground {
            given: &[1, 5],
            ..plain(&decoupled)
        };
        assert!(has(&names(&ship), "added_mass_coupling"));
        assert!(!has(&names(&plain(&decoupled)), "added_mass_coupling"));
    }

    #[test]
    fn waves_and_a_shaft_are_asked_where_they_were_measured_and_move() {
        let vehicle = Rig::builtin("lshpi").unwrap().vehicle;
        let of = |companions: [bool; 4]| {
            let ground = Ground {
                dofs: &[0, 2],
                companions,
                ..plain(&vehicle)
            };
            let all = candidates(&ground, &[]);
            let driven = |c: &&Candidate| ["wave_force", "shaft_thrust"].contains(&c.info.id);
            let driven = all.iter().filter(driven);
            driven
                .map(|c| (c.name(), c.linear.clone()))
                .collect::<Vec<_>>()
        };
        let name = |name: &str, linear: &[usize]| (name.to_owned(), linear.to_vec());
        assert!(of([true, true, false, false]).is_empty());
        let of_shaft = [
            name("shaft_thrust surge", &[0]),
            name("shaft_thrust heave", &[0]),
        ];
        assert_eq!(of([false, false, true, false]), of_shaft);
        // All but the time constant, which only its own rate knows.
        let of_wave = [
            name("wave_force surge", &[0, 1, 2, 3]),
            name("wave_force heave", &[0, 1, 2, 3]),
        ];
        assert_eq!(of([false, false, false, true]), of_wave);
    }

    #[test]
    fn laws_say_themselves_of_what_they_are_a_function() {
        let vehicle = Rig::builtin("lshpi").unwrap().vehicle;
        let ground = Ground {
            dofs: &[0, 3],
            ..plain(&vehicle)
        };
        let all = candidates(&ground, &[]);
        let of = |name: &str, dof: usize, covariate: &str, range| {
            let effect = all.iter().find(|c| c.name() == name).unwrap();
            let covariate = COVARIATES.iter().position(|c| *c == covariate).unwrap();
            is_function_of(effect, dof, (covariate, range), &vehicle)
        };
        let (rate, angle, load) = ((-0.3, 0.3), (-0.2, 0.2), (-8.0, 8.0));
        assert!(of("nonlinear_restoring roll", 3, "phi", angle));
        assert!(of("coulomb_friction surge", 0, "u", rate));
        assert!(of("thruster_deadband surge", 0, "load", load));
        assert!(!of("cubic_damping surge", 0, "load", load));
        assert!(!of("thruster_lag surge", 0, "load", load));
        assert!(!of("constant_force surge", 0, "u", rate));
    }

    #[test]
    fn laws_say_themselves_in_what_they_are_linear() {
        let vehicle = Rig::builtin("lshpi").unwrap().vehicle;
        let ground = Ground {
            dofs: &[0, 3],
            given: &[1, 5],
            companions: [true, false, false, false],
            ..plain(&vehicle)
        };
        let all = candidates(&ground, &[]);
        let linear = |name: &str| {
            let found = all.iter().find(|c| c.name() == name);
            found
                .map(|c| c.linear.clone())
                .unwrap_or_else(|| panic!("no {name}"))
        };
        for one in [
            "constant_force surge",
            "cubic_damping surge",
            "lift_damping roll",
        ] {
            assert_eq!(linear(one), [0], "{one}");
        }
        assert_eq!(linear("fin_force surge rudder"), [0, 1]);
        let own = |name: &str| all.iter().any(|c| c.name() == name && c.own);
        assert!(own("linear_damping roll") && own("quadratic_damping surge"));
        assert!(!own("lift_damping roll") && !own("cubic_damping roll"));
        for none in [
            "thruster_lag surge",
            "thruster_deadband surge",
            "current",
            "clock_drift",
        ] {
            assert!(linear(none).is_empty(), "{none}: {:?}", linear(none));
        }
    }

    #[test]
    fn every_effect_is_asked_at_every_place_where_it_may_act() {
        let vehicle = Rig::builtin("lshpi").unwrap().vehicle;
        let ground = |dofs: &'static [usize]| Ground {
            dofs,
            ..plain(&vehicle)
        };
        let surge = candidates(&ground(&[0]), &[]);
        let planar = candidates(&ground(&[0, 1, 5]), &[]);
        let count = |all: &[Candidate], id: &str| all.iter().filter(|c| c.info.id == id).count();
        assert_eq!(count(&surge, "thruster_lag"), 1);
        assert_eq!(count(&planar, "thruster_lag"), 3);
        assert_eq!(count(&planar, "lift_damping"), 2);
        assert_eq!(count(&surge, "command_latency"), 1);
        let names: std::collections::BTreeSet<String> =
            planar.iter().map(Candidate::name).collect();
        assert_eq!(names.len(), planar.len());
    }

    /// A reader's effect that acted in sway alone stood among what surge runs cannot show.
    #[test]
    fn an_effect_is_asked_only_where_its_law_changes_the_motion() {
        let vehicle = Rig::builtin("lshpi").unwrap().vehicle;
        let asked = |dofs: &[usize], largest: &[f64; 6]| -> Vec<String> {
            let ground = Ground {
                dofs,
                largest,
                companions: [true; 4],
                ..plain(&vehicle)
            };
            candidates(&ground, &[])
                .iter()
                .map(Candidate::name)
                .collect()
        };
        let (surge, roll) = (asked(&[0], &[8.0; 6]), asked(&[3], &[8.0; 6]));
        for id in ["current", "seiche", "tether_spring", "wall_added_mass"] {
            assert!(surge.iter().any(|n| n == id), "{id}");
            assert!(!roll.iter().any(|n| n == id), "{id}");
        }
        // An effect that names its DOF is asked in it, driven or not, at loads however small.
        let in_dof = |info: &&&EffectInfo| {
            let dof = info.words.first().filter(|_| info.words.len() == 1);
            dof.is_some_and(|w| w.name == "dof" && w.allowed.contains(&"surge"))
                && !info.is_written()
        };
        for largest in [[8.0; 6], [0.01; 6], [0.0; 6]] {
            let names = asked(&[0], &largest);
            for info in ALL.iter().filter(in_dof) {
                let name = format!("{} surge", info.id);
                assert!(names.contains(&name), "{name} at {largest:?}");
            }
        }
    }
}
