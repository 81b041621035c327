//! The set of plans that says most: patterns drawn, sized to the rig, and improved one place at a time (coordinate exchange;
//! Meyer and Nachtsheim 1995), each beside those before it.

use hydroline_core::run::Command;
use hydroline_numerics::parallel;
use hydroline_rigs::{Dof, Plan, Rig};
use hydroline_sim::effect::EffectError;
use hydroline_sim::{Allocation, ThrustError};
use nalgebra::DMatrix;
use rand::{RngExt, SeedableRng, rngs::StdRng};

use super::judge::{Judge, Separation};
use super::options::Options;
use super::pattern::{Pattern, Place};
use super::sized::{Admission, Reach, reach};

/// Shares of the reach at which a drawn pattern is tried, all DOFs together; the first that the rig runs is its size.
const SHARES: [f64; 9] = [1.0, 0.8, 0.65, 0.5, 0.4, 0.3, 0.2, 0.1, 0.05];
/// Times that all loads of a pattern are tried a quarter larger.
const LARGER: usize = 6;
/// A change that says less more than this is none \[nats\].
const GAINED: f64 = 0.01;

/// Why no plan was made.
#[derive(Debug, thiserror::Error)]
#[allow(missing_docs)] // Each message names its fields.
pub enum DesignError {
    #[error(transparent)]
    Thrust(#[from] ThrustError),
    #[error(transparent)]
    Effect(#[from] EffectError),
    #[error(
        "no DOF{} can be driven within tank, [limits] and target: look at the start pose in [tank], at [limits] and at [[thruster]]",
        if asked.is_empty() { String::new() } else { format!(" of {}", asked.iter().map(|d| d.name()).collect::<Vec<_>>().join(", ")) }
    )]
    NothingDriven { asked: Vec<Dof> },
    #[error(
        "none of {drawn} patterns of {length_s} s fits into tank, [limits] and target at a twentieth of the vehicle's reach: a shorter --length leaves it less way to go"
    )]
    NothingFits { drawn: usize, length_s: f64 },
}

/// A plan of a set.
#[derive(Debug, Clone)]
pub struct Designed {
    /// The plan.
    pub plan: Plan,
    /// Information expected of it beside that of the plans before it \[nats\].
    pub gain_nats: f64,
    /// Largest load per DOF \[N, N m\].
    pub largest: [f64; 6],
    /// Relative sd of each number of the vehicle by this run alone, in the order of [`Set::own`].
    pub sd_alone: Vec<f64>,
    /// The same behind it and all before it.
    pub sd: Vec<f64>,
    /// Effects of which it tells a typical size from nothing, the coefficients unknown.
    pub shows: Vec<String>,
}

/// A set of plans.
#[derive(Debug, Clone)]
pub struct Set {
    /// Names of the vehicle's numbers.
    pub own: Vec<&'static str>,
    /// Largest load of each DOF by itself \[N, N m\].
    pub reach: Reach,
    /// Plans in the order in which they say most.
    pub plans: Vec<Designed>,
    /// Every two effects, by all runs together.
    pub separations: Vec<Separation>,
    /// Effects that are asked, one by one in each DOF that they act in.
    pub asked: usize,
    /// Effects that all runs together do not tell from nothing.
    pub unseen: Vec<String>,
}

/// A pattern with its plan and what it says.
#[derive(Clone)]
struct Rated {
    pattern: Pattern,
    information: DMatrix<f64>,
}

/// Plans for a rig.
///
/// # Errors
/// [`DesignError`].
pub fn design(
    rig: &Rig,
    options: &Options,
    progress: &(dyn Fn(&str) + Sync),
) -> Result<Set, DesignError> {
    let allocation = Allocation::new(&rig.thrusters)?;
    progress("how far each DOF reaches");
    let admission = Admission::new(rig, options.calibration.as_ref());
    let reach = reach(&admission, &allocation, &options.dofs);
    let dofs: Vec<usize> = (0..6).filter(|d| reach[*d] > 0.0).collect();
    if dofs.is_empty() {
        return Err(DesignError::NothingDriven {
            asked: options.dofs.clone(),
        });
    }
    let mut rng = StdRng::seed_from_u64(options.seed);
    let drawn: Vec<Pattern> = (0..options.drawn.max(1))
        .map(|_| Pattern::drawn(&mut rng, options.length_s, reach))
        .collect();
    progress("patterns that fit");
    let sized = parallel::map_slice(&drawn, |pattern| sized(&admission, pattern));
    let sized: Vec<Pattern> = sized.into_iter().flatten().collect();
    let Some(first) = sized.first() else {
        return Err(DesignError::NothingFits {
            drawn: options.drawn,
            length_s: options.length_s,
        });
    };
    let first = first.plan("first");
    let judge = Judge::new(rig, &allocation, &dofs, &first, options)?;
    let pool = parallel::map_owned(sized, |pattern| {
        let information = judge.information(&pattern.plan("drawn"))?;
        Some(Rated {
            pattern,
            information,
        })
    });
    let mut pool: Vec<Rated> = pool.into_iter().flatten().collect();
    let size = pool.first().map_or(0, |r| r.information.nrows());
    let mut sum = DMatrix::zeros(size, size);
    let mut chosen: Vec<Rated> = Vec::new();
    for k in 0..options.plans {
        progress(&format!("plan {} of {}", k + 1, options.plans));
        pool.sort_by(|a, b| {
            let of = |r: &Rated| judge.value(&(&sum + &r.information));
            of(b).total_cmp(&of(a))
        });
        let improved = pool
            .iter()
            .take(options.improved.max(1))
            .map(|r| improve(&judge, &admission, r, &sum, options, &mut rng));
        let best = improved.max_by(|a, b| {
            let of = |r: &Rated| judge.value(&(&sum + &r.information));
            of(a).total_cmp(&of(b))
        });
        let Some(best) = best else { break };
        sum += &best.information;
        pool.push(best.clone());
        chosen.push(best);
    }
    progress("what they distinguish");
    Ok(super::summary::set(
        &judge,
        reach,
        chosen.into_iter().map(|r| r.pattern).collect(),
    ))
}

/// Effects of typical size that runs would not have shown and the first plan of a set designed with these options does.
///
/// `runs` = what was sent in each, and its stamps \[s\].
///
/// # Errors
/// As [`design`].
pub fn not_shown_yet(
    rig: &Rig,
    options: &Options,
    set: &Set,
    runs: &[(&[Command], Vec<f64>)],
) -> Result<Vec<String>, DesignError> {
    let Some(first) = set.plans.first() else {
        return Ok(Vec::new());
    };
    let allocation = Allocation::new(&rig.thrusters)?;
    let dofs: Vec<usize> = (0..6).filter(|d| set.reach[*d] > 0.0).collect();
    let judge = Judge::new(rig, &allocation, &dofs, &first.plan, options)?;
    let each = parallel::map_slice(runs, |(commands, times_s)| {
        judge.whole_of_run(commands, times_s)
    });
    let Some(planned) = judge.whole(&first.plan) else {
        return Ok(Vec::new());
    };
    let nothing = DMatrix::zeros(planned.nrows(), planned.ncols());
    let made = each.into_iter().flatten().fold(nothing, |a, b| a + b);
    Ok(judge.missing(&planned, &made))
}

/// A pattern at the largest share of its size that the rig runs.
fn sized(admission: &Admission, pattern: &Pattern) -> Option<Pattern> {
    let at = |share: f64| Pattern {
        sizes: pattern.sizes.map(|v| share * v),
        ..pattern.clone()
    };
    let runs = |p: &Pattern| admission.admits(&p.plan("drawn"));
    SHARES.into_iter().map(at).find(runs)
}

/// Goes through the places of a pattern in any order and keeps what says more.
fn improve(
    judge: &Judge<'_>,
    admission: &Admission,
    from: &Rated,
    sum: &DMatrix<f64>,
    options: &Options,
    rng: &mut StdRng,
) -> Rated {
    let mut best = from.clone();
    let mut value = judge.value(&(sum + &best.information));
    for _ in 0..options.sweeps {
        let mut places = best.pattern.places();
        for i in (1..places.len()).rev() {
            places.swap(i, rng.random_range(0..=i));
        }
        let before = value;
        // As large as it goes first: sizes that are drawn are small, so that they fit.
        let larger = std::iter::repeat_n(Place::All, LARGER);
        for place in larger.chain(places) {
            let tried = parallel::map_owned(best.pattern.neighbours(place, rng), |pattern| {
                let plan = pattern.plan("tried");
                if !admission.admits(&plan) {
                    return None;
                }
                let information = judge.information(&plan)?;
                let value = judge.value(&(sum + &information));
                Some((
                    value,
                    Rated {
                        pattern,
                        information,
                    },
                ))
            });
            for (v, rated) in tried.into_iter().flatten() {
                if v > value + GAINED {
                    value = v;
                    best = rated;
                }
            }
        }
        if value - before < GAINED * 10.0 {
            break;
        }
    }
    best
}
