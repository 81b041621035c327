//! Cases of surge alone.

use hydroline_core::run::{Channel, PerChannel};
use hydroline_identify::parameter::Coefficient;
use hydroline_numerics::span::rms;
use hydroline_rigs::{Dof, ParameterValue, PhysicsEntry, Plan, Rig};
use nalgebra::{DMatrix, DVector};
use rand::{RngExt, rngs::StdRng};

use super::make::{Beyond, HIDDEN, Held, HeldOutCase, Kind, LOADS, Place, SHOWN, TRIES};
use crate::benchmark::case::{DELAYS, off};
use crate::benchmark::disturbance::Disturbance;
use crate::benchmark::error::ProveError;
use crate::benchmark::experiment::{Recorded, Tank};
use crate::benchmark::external_law::ExternalLaw;
use crate::benchmark::magnitudes::{self, between};
use crate::benchmark::motion::Mover;
use crate::benchmark::plans::{self, RUN_S};

/// Least weight of an effect of a vehicle that is to be found complete, over the tolerance: it surely matters.
const SURE: f64 = 1.15;
/// Greatest weight of one \[m\].
const MOST_M: f64 = 0.08;
/// Loads of a run inside, over the largest of those fitted.
const INSIDE: f64 = 0.9;
/// Plans that drive slowly, of which those of another frequency hold the fast tones out.
const SLOW: [&str; 2] = ["reversals", "coast-down"];

/// Mechanism that runs of small loads, or slow ones, do not show.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Mechanism {
    Limit,
    Slosh,
    Tether,
    SpeedBump,
    RoundLimit,
    Cubic,
}

impl Mechanism {
    /// In turn; the one that shows at other frequencies twice.
    const ALL: [Mechanism; 7] = [
        Mechanism::Limit,
        Mechanism::Slosh,
        Mechanism::Tether,
        Mechanism::SpeedBump,
        Mechanism::Slosh,
        Mechanism::RoundLimit,
        Mechanism::Cubic,
    ];

    fn beyond(self) -> Beyond {
        match self {
            Mechanism::Slosh => Beyond::Frequencies,
            _ => Beyond::Loads,
        }
    }

    /// Largest share of the tolerance that it may be worth over the runs fitted.
    fn hidden(self) -> f64 {
        match self {
            // What swings on is seen in the colour of what is left, long before it matters.
            Mechanism::Slosh => 0.2,
            _ => HIDDEN,
        }
    }

    /// Effects of the library by their ids, a law that it has not in words.
    fn names(self) -> Vec<String> {
        let all: &[&str] = match self {
            Mechanism::Limit => &["thruster_saturation"],
            Mechanism::Slosh => &["a payload that swings"],
            Mechanism::Tether => &["tether_spring"],
            Mechanism::SpeedBump => &["a drag at one speed"],
            Mechanism::RoundLimit => &["a thrust limit with a round shoulder"],
            Mechanism::Cubic => &["cubic_damping"],
        };
        all.iter().map(|n| (*n).to_owned()).collect()
    }

    /// Puts it into a tank, beyond what the runs fitted reach; `period_s` = where the run held out is fast.
    fn put(self, tank: &mut Tank, fitted: &Reached, period_s: f64, rng: &mut StdRng) {
        let mut one = |effect: &str, numbers: &[(&str, f64)]| {
            tank.entries.push(entry(effect, numbers));
        };
        match self {
            Mechanism::Limit => {
                let limit_n = fitted.top_n * between(rng, 1.1, 1.8);
                one("thruster_saturation", &[("limit_n", limit_n)]);
            }
            Mechanism::Tether => {
                let slack_m = fitted.reach_m.1 + between(rng, 0.02, 0.1);
                let stiffness_npm = between(rng, 1.0, 5.0);
                let numbers = [("stiffness_npm", stiffness_npm), ("slack_m", slack_m)];
                one("tether_spring", &numbers);
            }
            Mechanism::Cubic => {
                let share = 10f64.powf(between(rng, -2.0, -0.7));
                one("cubic_damping", &[("d3", 2000.0 * share)]);
            }
            Mechanism::SpeedBump => {
                tank.external_law = Some(ExternalLaw::SpeedBump {
                    f_n: between(rng, 1.0, 3.0),
                    speed_mps: fitted.top_mps * between(rng, 1.2, 1.5),
                    width_mps: 0.06 * fitted.top_mps,
                });
            }
            Mechanism::RoundLimit => {
                let limit_n = fitted.top_n * between(rng, 1.4, 2.0);
                tank.external_law = Some(ExternalLaw::SoftSaturation { limit_n });
            }
            // Added mass to slow loads.
            Mechanism::Slosh => {
                tank.external_law = Some(ExternalLaw::Slosh {
                    mass_kg: between(rng, 5.0, 30.0),
                    period_s,
                    damping_ratio: between(rng, 0.005, 0.02),
                });
            }
        }
    }
}

fn entry(effect: &str, numbers: &[(&str, f64)]) -> PhysicsEntry {
    let numbers = numbers.iter();
    PhysicsEntry {
        effect: effect.to_owned(),
        parameters: numbers
            .map(|(n, v)| ((*n).to_owned(), ParameterValue::Number(*v)))
            .collect(),
    }
}

/// How far the runs fitted go, of the vehicle alone.
struct Reached {
    top_n: f64,
    top_mps: f64,
    reach_m: (f64, f64),
}

impl Reached {
    fn of(tank: &Tank, runs: &[Recorded], top_n: f64) -> Result<Reached, ProveError> {
        let mut top_mps = 0.0_f64;
        for (k, run) in runs.iter().enumerate() {
            let x_m = positions(tank, k, run)?;
            let pairs = x_m.windows(2).zip(run.times_s.windows(2));
            let speeds = pairs.map(|(x, t)| ((x[1] - x[0]) / (t[1] - t[0])).abs());
            top_mps = speeds.fold(top_mps, f64::max);
        }
        Ok(Reached {
            top_n,
            top_mps,
            reach_m: tank.reach_m(runs)?,
        })
    }
}

/// True x at a run's stamps \[m\].
fn positions(tank: &Tank, run: usize, recorded: &Recorded) -> Result<Vec<f64>, ProveError> {
    let mover = Mover {
        vehicle: &tank.vehicle,
        entries: &tank.entries,
        external_law: tank.external_law.as_ref(),
        start: tank.rig.tank.start_pose,
    };
    mover.positions(run, &recorded.edges, &recorded.times_s)
}

/// What a mechanism changes of the motion and the vehicle's coefficients, fitted to the runs, do not take up: rms over these runs, and over the
/// one held out \[m\]. `without` = the same vehicle without it.
fn not_taken_up(
    (with, without): (&Tank, &Tank),
    (fitted, held): (&[Recorded], &Recorded),
) -> Result<[f64; 2], ProveError> {
    let moved = |tank: &Tank| -> Result<[DVector<f64>; 2], ProveError> {
        let mut over = Vec::new();
        for (k, run) in fitted.iter().enumerate() {
            over.extend(positions(tank, k, run)?);
        }
        let beyond = positions(tank, fitted.len(), held)?;
        Ok([over, beyond].map(DVector::from_vec))
    };
    let [mut fitted_m, mut held_m] = moved(without)?;
    let [with_fitted, with_held] = moved(with)?;
    (fitted_m, held_m) = (with_fitted - fitted_m, with_held - held_m);
    let mut columns = [Vec::new(), Vec::new()];
    for c in Coefficient::of(Dof::Surge) {
        let value = c.of_vehicle(&without.vehicle);
        let step = 1e-4 * value.abs();
        let shifted = |v: f64| {
            let mut tank = without.clone();
            c.put(&mut tank.vehicle, v);
            moved(&tank)
        };
        let (up, down) = (shifted(value + step)?, shifted(value - step)?);
        for ((columns, up), down) in columns.iter_mut().zip(up).zip(down) {
            columns.push((up - down) / (2.0 * step));
        }
    }
    let [over, beyond] = columns.map(|c| DMatrix::from_columns(&c));
    // Three columns that differ: they are never of a lower rank.
    if let Ok(change) = over.clone().svd(true, true).solve(&fitted_m, 0.0) {
        fitted_m -= over * &change;
        held_m -= beyond * change;
    }
    Ok([rms(&fitted_m), rms(&held_m)])
}

fn record(tank: &Tank, plans: &[Plan]) -> Result<Vec<Recorded>, ProveError> {
    let each = plans.iter().enumerate();
    each.map(|(k, p)| tank.record(p, k, RUN_S)).collect()
}

/// A vehicle up to 20 % off the rig file, with nothing else.
fn bare(place: &Place, rng: &mut StdRng) -> Result<Tank, ProveError> {
    let rig = Rig::builtin("lshpi")?;
    Ok(Tank {
        vehicle: off(&rig, rng),
        entries: Vec::new(),
        external_law: None,
        disturbance: Disturbance::draw(place.nth % 5 == 4, rng),
        seed: rng.random(),
        rig,
    })
}

/// The same plan with this largest load \[N\].
fn reaching(tank: &Tank, plan: Plan, top_n: f64) -> Result<Plan, ProveError> {
    let own_n = Tank::top_n(&tank.rig, std::slice::from_ref(&plan), RUN_S)?;
    Ok(plans::times(plan, top_n / own_n))
}

/// A drawn case of this tank, its run held out recorded last.
fn case(
    place: &Place,
    kind: (Kind, Option<Beyond>),
    there: Vec<String>,
    tank: Tank,
    (fitted, held): (&[Recorded], &Recorded),
) -> Result<HeldOutCase, ProveError> {
    let truth = positions(&tank, fitted.len(), held)?;
    let only_x = |x: f64| {
        let mut values = PerChannel::NAN;
        values[Channel::X] = x;
        values
    };
    let sources: Result<Vec<_>, ProveError> = fitted.iter().map(|r| r.source(&tank.rig)).collect();
    Ok(HeldOutCase {
        index: place.index,
        is_coupled: false,
        kind: kind.0,
        beyond: kind.1,
        there,
        sources: sources?,
        held: Held {
            source: held.source(&tank.rig)?,
            truth: truth.into_iter().map(only_x).collect(),
            noise: only_x(held.noise_rms_m()),
        },
        rig: tank.rig,
    })
}

/// A run beyond those fitted, of a vehicle with a mechanism that they do not show.
pub(super) fn missed(place: &Place, rng: &mut StdRng) -> Result<HeldOutCase, ProveError> {
    let mechanism = Mechanism::ALL[place.nth % Mechanism::ALL.len()];
    let beyond = mechanism.beyond();
    let mut last = String::new();
    for _ in 0..TRIES {
        let bare = bare(place, rng)?;
        let period_s = between(rng, 1.1, 1.5);
        let mut fitted = plans::good(rng);
        let held = match beyond {
            Beyond::Frequencies => {
                fitted.retain(|p| SLOW.contains(&p.name.as_str()));
                Some(plans::fast(period_s, rng))
            }
            _ => plans::another(rng),
        };
        let Some(held) = held else { continue };
        let top_n = Tank::top_n(&bare.rig, &fitted, RUN_S)?;
        let share = match beyond {
            Beyond::Frequencies => INSIDE,
            _ => LOADS,
        };
        let held = reaching(&bare, held, share * top_n)?;
        let mut tank = bare.clone();
        let reached = Reached::of(&bare, &record(&bare, &fitted)?, top_n)?;
        mechanism.put(&mut tank, &reached, period_s, rng);
        let runs = record(&tank, &fitted)?;
        let beyond_all = tank.record(&held, runs.len(), RUN_S)?;
        let [hidden_m, shown_m] = not_taken_up((&tank, &bare), (&runs, &beyond_all))?;
        let shown = shown_m / beyond_all.noise_rms_m();
        let hidden = hidden_m / tank.rig.tolerance.position_m;
        if shown < SHOWN || hidden > mechanism.hidden() {
            last = format!("{shown:.1} noises held out, {hidden:.2} tolerances fitted");
            continue;
        }
        let kind = (Kind::Missed, Some(beyond));
        return case(place, kind, mechanism.names(), tank, (&runs, &beyond_all));
    }
    Err(none(place, last))
}

/// A run within those fitted, of a vehicle with none, one or two effects of the library in turn.
pub(super) fn inside(place: &Place, rng: &mut StdRng) -> Result<HeldOutCase, ProveError> {
    let mut last = String::new();
    for attempt in 0..TRIES {
        let mut tank = bare(place, rng)?;
        let fitted = plans::good(rng);
        let top_n = Tank::top_n(&tank.rig, &fitted, RUN_S)?;
        let first = magnitudes::EFFECTS[(place.nth + attempt / 6) % magnitudes::EFFECTS.len()];
        let mut ids = vec![first];
        while ids.len() < 2 {
            let id = magnitudes::EFFECTS[rng.random_range(0..magnitudes::EFFECTS.len())];
            let is_twin = DELAYS.contains(&id) && DELAYS.contains(&first);
            if id != first && !is_twin {
                ids.push(id);
            }
        }
        for id in ids.iter().take(place.nth % 3) {
            let made = magnitudes::entry(id, between(rng, 0.3, 1.0), top_n, rng)?;
            tank.entries.push(made);
        }
        let runs = record(&tank, &fitted)?;
        let sure_m = SURE * tank.rig.tolerance.position_m;
        let weights = tank.weights(&runs)?;
        if let Some(w) = weights.iter().find(|w| !(sure_m..MOST_M).contains(*w)) {
            last = format!("an effect of {:.2} mm", 1e3 * w);
            continue;
        }
        let Some(held) = plans::another(rng) else {
            continue;
        };
        let held = reaching(&tank, held, INSIDE * top_n)?;
        let inside = tank.record(&held, runs.len(), RUN_S)?;
        let there = tank.entries.iter().map(|e| e.effect.clone()).collect();
        return case(place, (Kind::Inside, None), there, tank, (&runs, &inside));
    }
    Err(none(place, last))
}

pub(super) fn none(place: &Place, last: String) -> ProveError {
    ProveError::NoCase {
        id: format!("held_out-{}", place.index),
        tries: TRIES,
        last,
    }
}
