//! Terms of a model: which effects of the registry may act where, with points to begin from.

use hydroline_rigs::Dof;
use hydroline_sim::effect::along::{COVARIATES, POINTS};
use hydroline_sim::effect::{
    ALL, CheckedEffect, EffectInfo, EffectStack, ParameterInfo, Stage, WordInfo,
};

use super::prior::{Scale, nothing};

/// What a candidate adds to a model.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Kind {
    /// An effect of the library.
    Effect,
    /// A force without a name along a covariate.
    Force {
        /// DOF in which it acts.
        dof: usize,
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
    /// What it is.
    pub kind: Kind,
    /// The effect.
    pub info: &'static EffectInfo,
    /// Index per word.
    pub words: Vec<usize>,
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

/// Every effect at every place where it may act in these DOFs, but those that are switched on already.
///
/// `largest` = greatest load commanded per DOF \[N, N m\].
pub fn candidates(dofs: &[usize], on: &[CheckedEffect], largest: &[f64; 6]) -> Vec<Candidate> {
    let mut all = Vec::new();
    for info in ALL
        .iter()
        .filter(|i| !i.parameters.is_empty() && !i.is_a_table() && !in_images_only(i))
    {
        for words in choices(info.words, dofs) {
            if is_own_square(info.words, &words) {
                continue;
            }
            if on.iter().any(|o| o.info.id == info.id && o.words == words) {
                continue;
            }
            all.push(Candidate::new(info, words, largest));
        }
    }
    all
}

/// Whether a product of rates is a DOF's own rate squared: damping of a hull that differs ahead and astern, which stands in
/// the vocabulary as such. As a product it would drive the vehicle on one side.
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

/// All combinations of words in which no word names a DOF that does not move.
fn choices(words: &[WordInfo], dofs: &[usize]) -> Vec<Vec<usize>> {
    let moves = |word: &str| {
        let dof = Dof::ALL.into_iter().position(|d| d.name() == word);
        let rate = RATES.iter().position(|r| *r == word);
        dof.or(rate).is_none_or(|d| dofs.contains(&d))
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

/// Covariates that a table of this DOF may run along: what moves, time, and the DOF's own load.
fn covariates(dof: usize, dofs: &[usize], ranges: &Ranges) -> Vec<(usize, (f64, f64))> {
    const TIME: usize = 12;
    let turns = dofs.iter().filter(|d| [0, 1, 5].contains(d)).count() > 1;
    let wide = |c: usize| ranges[c].map_or(0.0, |(low, high)| high - low);
    let asked = |c: usize| match c {
        // Where surge or sway moves, both tank coordinates do; on a straight way they are one.
        0 | 1 if dof > 1 => false,
        0 | 1 => turns || wide(c) >= wide(1 - c),
        2..6 => c == dof,
        6..TIME => dofs.contains(&(c - 6)),
        _ => true,
    };
    let each = (0..COVARIATES.len()).filter(|c| asked(*c));
    each.filter_map(|c| Some((c, ranges[c]?))).collect()
}

/// Forces without a name in these DOFs, and near laws of effects: tables, whose shape is free.
///
/// `effects` = candidates of the library, whose places are kept; `loads` = range of the load per DOF.
pub fn tables(
    effects: &[Candidate],
    dofs: &[usize],
    ranges: &Ranges,
    loads: &[Option<(f64, f64)>; 6],
) -> Vec<Candidate> {
    const LOAD: usize = COVARIATES.len() - 1;
    let mut made = Vec::new();
    let along = |dof: usize| {
        let mut ranges = *ranges;
        ranges[LOAD] = loads[dof];
        covariates(dof, dofs, &ranges)
    };
    let table = |kind, info, words, fixed, along| Candidate {
        kind,
        info,
        words,
        fixed,
        along: Some(along),
        scales: vec![Scale::of_table(); POINTS],
        starts: Vec::new(),
        nothing: 0.0,
    };
    if let Some(info) = ALL.iter().find(|i| i.is_a_table()) {
        for &dof in dofs {
            for (c, range) in along(dof) {
                let ends = vec![range.0, range.1];
                let kind = Kind::Force { dof };
                made.push(table(kind, *info, vec![dof, c], ends, (c, range)));
            }
        }
    }
    for (of, c) in effects.iter().enumerate() {
        // Stamps and instruments have their own faults; a corner at a limit of the load moves none of what lies below.
        if !matches!(c.info.stage, Stage::Thruster | Stage::Hydrodynamics) {
            continue;
        }
        let named = c.word("dof").or_else(|| c.word("axis"));
        let dof = named.and_then(|w| Dof::ALL.into_iter().position(|d| d.name() == w));
        let places: Vec<usize> = dof.map_or_else(|| dofs.to_vec(), |d| vec![d]);
        let mut seen = Vec::new();
        for (covariate, range) in places.into_iter().flat_map(along) {
            if seen.contains(&covariate) {
                continue;
            }
            seen.push(covariate);
            let words = c.words.clone();
            made.push(table(
                Kind::Trend { of },
                c.info,
                words,
                Vec::new(),
                (covariate, range),
            ));
        }
    }
    made
}

/// Where a limit on the load begins, over the largest load: between loads a limit clips other steps of the command, and
/// no fit finds from one of these stretches into the next.
const LIMITS: [f64; 5] = [0.95, 0.85, 0.72, 0.58, 0.44];

impl Candidate {
    fn new(info: &'static EffectInfo, words: Vec<usize>, largest: &[f64; 6]) -> Candidate {
        let mut made = Candidate {
            kind: Kind::Effect,
            fixed: Vec::new(),
            along: None,
            scales: info
                .parameters
                .iter()
                .enumerate()
                .map(|(i, p)| Scale::of(p, i))
                .collect(),
            starts: starts(info),
            nothing: info.parameters.first().map_or(0.0, nothing),
            info,
            words,
        };
        if info.parameters.first().is_some_and(|p| p.bounds_load) {
            let dof = made
                .word("dof")
                .and_then(|w| Dof::ALL.into_iter().find(|d| d.name() == w))
                .map_or(0, Dof::index);
            let top = largest[dof];
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
}

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

fn starts(info: &EffectInfo) -> Vec<Vec<f64>> {
    const BASES: [usize; 5] = [2, 3, 5, 7, 11];
    let typical: Vec<f64> = info.parameters.iter().map(|p| p.typical).collect();
    let mut points = vec![typical];
    let count = match info.parameters.len() {
        1 => {
            points.extend([0.1, 0.9].map(|s| vec![point(&info.parameters[0], s)]));
            return points;
        }
        2 => 6,
        _ => 24,
    };
    for k in 1..=count {
        let numbers = info.parameters.iter().enumerate();
        points.push(
            numbers
                .map(|(i, p)| point(p, radical(k, BASES[i % BASES.len()])))
                .collect(),
        );
    }
    points
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_effect_is_asked_at_every_place_where_it_may_act() {
        let surge = candidates(&[0], &[], &[8.0; 6]);
        let planar = candidates(&[0, 1, 5], &[], &[8.0; 6]);
        let count = |all: &[Candidate], id: &str| all.iter().filter(|c| c.info.id == id).count();
        assert_eq!(count(&surge, "thruster_lag"), 1);
        assert_eq!(count(&planar, "thruster_lag"), 3);
        assert_eq!(count(&planar, "lift_damping"), 2);
        assert_eq!(count(&surge, "command_latency"), 1);
        let names: std::collections::BTreeSet<String> =
            planar.iter().map(Candidate::name).collect();
        assert_eq!(names.len(), planar.len());
    }
}
