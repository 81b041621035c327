//! Cases: what the diagnosis may see, and the key.

use hydroline_rigs::{Dof, PhysicsEntry, Plan, Rig};
use rand::{RngExt, SeedableRng, rngs::StdRng};

use super::disturbance::Disturbance;
use super::error::ProveError;
use super::experiment::{Recorded, Tank};
use super::external_law::{COMPOSED, ExternalLaw, NEAR, UNNAMED};
use super::instrument::{Flaw, flawed};
use super::modulated::{MODULATED, Modulated, Ranges};
use super::unsteady::Unsteady;
use super::{faulty, magnitudes, paper, plans};
use hydroline_diagnose::Source;
use hydroline_identify::parameter::Coefficient;

/// Kind of case.
#[derive(
    Debug,
    Clone,
    Copy,
    PartialEq,
    Eq,
    PartialOrd,
    Ord,
    Hash,
    clap::ValueEnum,
    serde::Serialize,
    schemars::JsonSchema,
    serde::Deserialize,
)]
#[serde(rename_all = "snake_case")]
#[value(rename_all = "snake_case")]
pub enum Category {
    /// Nothing matters: every second one with a background of four small effects.
    Nothing,
    /// One effect of practical size.
    Single,
    /// Two effects of practical size.
    Pair,
    /// Three effects of practical size.
    Triple,
    /// A law without a name.
    Unnamed,
    /// The paper's two constant-thrust runs.
    Paper,
    /// The data are wrong.
    Fault,
    /// A law without a name, drawn by composition; not in the full set.
    Composed,
    /// A known mechanism, one number of which goes with place, rate, time or load; not in the full set.
    Modulated,
    /// Stamps and positions as an instrument spoils them; not in the full set.
    Instrument,
    /// One effect under an instrument that is much better than the model, beside a disturbance without a law; not in the full set.
    Precise,
}

impl Category {
    /// All, in order.
    pub const ALL: [Category; 11] = [
        Category::Nothing,
        Category::Single,
        Category::Pair,
        Category::Triple,
        Category::Unnamed,
        Category::Paper,
        Category::Fault,
        Category::Composed,
        Category::Modulated,
        Category::Instrument,
        Category::Precise,
    ];

    /// Name in ids.
    pub fn name(self) -> &'static str {
        match self {
            Category::Nothing => "nothing",
            Category::Single => "single",
            Category::Pair => "pair",
            Category::Triple => "triple",
            Category::Unnamed => "unnamed",
            Category::Paper => "paper",
            Category::Fault => "fault",
            Category::Composed => "composed",
            Category::Modulated => "modulated",
            Category::Instrument => "instrument",
            Category::Precise => "precise",
        }
    }

    /// Cases of this kind in the full set of [`FULL`].
    fn full(self) -> usize {
        match self {
            Category::Nothing => 100,
            Category::Single => 200,
            Category::Pair => 60,
            Category::Triple => 20,
            Category::Unnamed => 50,
            Category::Paper => 16,
            Category::Fault => 14,
            Category::Composed | Category::Modulated | Category::Instrument | Category::Precise => {
                0
            }
        }
    }
}

/// Size of the full set.
pub const FULL: usize = 460;

/// The cases of a run of `count` in the proportions of the full set, at least one of each of its kinds.
pub fn catalogue(count: usize, only: Option<Category>) -> Vec<(Category, usize)> {
    if let Some(category) = only {
        return (0..count).map(|i| (category, i)).collect();
    }
    Category::ALL
        .into_iter()
        .filter(|c| c.full() > 0)
        .flat_map(|c| {
            let n = ((c.full() * count) as f64 / FULL as f64).round().max(1.0) as usize;
            (0..n).map(move |i| (c, i))
        })
        .collect()
}

/// An id back into its parts.
///
/// # Errors
/// [`ProveError::UnknownCase`].
pub fn parse(id: &str) -> Result<(Category, usize), ProveError> {
    id.rsplit_once('-')
        .and_then(|(name, index)| {
            let category = Category::ALL.into_iter().find(|c| c.name() == name)?;
            Some((category, index.parse().ok()?))
        })
        .ok_or_else(|| ProveError::UnknownCase {
            id: id.to_owned(),
            example: "single-7".to_owned(),
        })
}

/// Part of a case that the diagnosis may see.
#[derive(Debug, Clone)]
pub struct Sealed {
    /// Logs to fit.
    pub sources: Vec<Source>,
    /// Logs to predict.
    pub held: Vec<Source>,
    /// The rig file.
    pub rig: Rig,
}

/// An effect that is there.
#[derive(Debug, Clone, PartialEq, serde::Serialize, schemars::JsonSchema, serde::Deserialize)]
pub struct Truth {
    /// Id; for a law near the library's its mechanism, for an unnamed one `unnamed`.
    pub effect: String,
    /// Weight over the runs fitted \[m\].
    pub weight_m: f64,
    /// Of practical size (not background).
    pub main: bool,
    /// By the library's law.
    pub exact: bool,
    /// Its numbers.
    pub parameters: Vec<(String, f64)>,
}

/// Part of a case that only the judge may see.
#[derive(Debug, Clone)]
pub struct Key {
    /// The whole truth.
    pub tank: Tank,
    /// Effects, heaviest first.
    pub truth: Vec<Truth>,
    /// Runs with their noise, in the order of `sources`.
    pub runs: Vec<Recorded>,
    /// rms noise of the run held out that tells how well the choice predicts \[m\].
    pub held_noise_m: Option<f64>,
    /// Fault put into the data.
    pub fault: Option<faulty::Fault>,
    /// Flaws of the instrument.
    pub flaws: Vec<Flaw>,
}

impl Key {
    /// The true coefficients of surge by key.
    pub fn coefficients(&self) -> Vec<(String, f64)> {
        Coefficient::of(Dof::Surge)
            .iter()
            .map(|c| (c.key().to_owned(), c.of_vehicle(&self.tank.vehicle)))
            .collect()
    }
}

/// A case.
#[derive(Debug, Clone)]
pub struct Case {
    /// `category-index`.
    pub id: String,
    /// Category that it was drawn for.
    pub category: Category,
    /// With a background.
    pub background: bool,
    /// For the diagnosis.
    pub sealed: Sealed,
    /// For the judge.
    pub key: Key,
}

/// Draws before a case is given up.
const TRIES: usize = 60;
/// Draws after which the next effect of the list is taken: some never weigh enough on some plans.
const STAY: usize = 6;
/// To the next effect with the same kind of law and of background: 60 keeps an index modulo 3, 4 and 5.
const SHIFT: usize = 60;
/// Of the tolerance: least weight of a main effect, so that it surely matters.
const MAIN_LEAST: f64 = 1.15;
/// Greatest weight of a main effect \[m\].
const MAIN_MOST_M: f64 = 0.08;
/// Factor on the instruments' noise of a precise case.
const PRECISE: f64 = 1.0 / 30.0;
/// Of the tolerance: weight of the disturbance in it.
const DISTURBANCE: f64 = 2.0;
/// Of the disturbance's weight: least weight of the effect beside it.
const PRECISE_LEAST: f64 = 3.0;
/// Of the tolerance: greatest weight of anything in the background.
const BACKGROUND_MOST: f64 = 0.75;
/// One delay cannot be distinguished from the other by motion: a case holds one of them at most.
pub const DELAYS: [&str; 2] = ["camera_latency", "command_latency"];

/// Number of a case for the generator (splitmix of seed, kind and index).
fn seed_of(seed: u64, category: Category, index: usize) -> u64 {
    let mut z = seed
        .wrapping_add((category as u64 + 1).wrapping_mul(0x9e37_79b9_7f4a_7c15))
        .wrapping_add((index as u64).wrapping_mul(0xd1b5_4a32_d192_ed03));
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ (z >> 31)
}

/// Makes a case; the same seed, kind and index give the same bytes.
///
/// # Errors
/// [`ProveError`].
pub fn make(seed: u64, category: Category, index: usize) -> Result<Case, ProveError> {
    let id = format!("{}-{index}", category.name());
    let mut rng = StdRng::seed_from_u64(seed_of(seed, category, index));
    let rig = Rig::builtin("lshpi")?;
    let paper = category == Category::Paper;
    let plans = if paper {
        paper::plans()?
    } else {
        plans::good(&mut rng)
    };
    // Two more runs are held out: they show how well what was chosen predicts.
    let mut apart = StdRng::seed_from_u64(seed_of(!seed, category, index));
    let held_plans: Vec<Plan> = match paper {
        true => Vec::new(),
        false => (0..2).filter_map(|_| plans::another(&mut apart)).collect(),
    };
    // The paper's runs end with their thrust: what coasts down would tell more.
    let length_s = |p: &Plan| if paper { p.duration_s() } else { plans::RUN_S };
    let top_n = Tank::top_n(&rig, &plans, plans::RUN_S)?;
    let fitted = plans.len();
    let mut last = String::new();
    for attempt in 0..TRIES {
        let vehicle = off(&rig, &mut rng);
        let wanted = wanted(category, index + attempt / STAY * SHIFT, top_n, &mut rng)?;
        let clean = index % 5 == 4;
        let mut tank = Tank {
            rig: rig.clone(),
            vehicle,
            entries: wanted.entries.clone(),
            external_law: None,
            disturbance: match category {
                Category::Precise => Disturbance::draw(true, &mut rng).scaled(PRECISE),
                _ => Disturbance::draw(clean, &mut rng),
            },
            seed: rng.random(),
        };
        let mut runs = record(&tank, &plans, &length_s)?;
        tank.external_law = match wanted.external_law {
            Wanted::No => None,
            Wanted::Near(mechanism, share) => ExternalLaw::near(mechanism, share, top_n, &mut rng),
            Wanted::Modulated(mechanism, share) => {
                let ranges = Ranges {
                    reach_m: tank.reach_m(&runs)?,
                    top_n,
                    run_s: plans::RUN_S,
                };
                Modulated::draw(mechanism, share, &ranges, &mut rng).map(ExternalLaw::Modulated)
            }
            Wanted::Unsteady => {
                let weight_m = DISTURBANCE * rig.tolerance.position_m;
                Some(tank.unsteady(Unsteady::draw(index, &mut rng), weight_m, &runs)?)
            }
            Wanted::Unnamed(kind, share) => {
                ExternalLaw::unnamed(kind, share, tank.reach_m(&runs)?, &mut rng)
            }
        };
        let weights = tank.weights(&runs)?;
        let truth = truths(&tank, &wanted, &weights);
        let tolerance = rig.tolerance.position_m;
        let odd = truth.iter().find(|t| {
            if category == Category::Fault {
                false
            } else if category == Category::Precise {
                let least_m = match t.effect.as_str() {
                    UNNAMED_ID => 0.0,
                    _ => PRECISE_LEAST * DISTURBANCE * tolerance,
                };
                !(least_m..MAIN_MOST_M).contains(&t.weight_m)
            } else if t.main {
                !(MAIN_LEAST * tolerance..MAIN_MOST_M).contains(&t.weight_m)
            } else {
                t.weight_m > BACKGROUND_MOST * tolerance
            }
        });
        if let Some(t) = odd {
            last = format!("{} of {:.2} mm", t.effect, t.weight_m * 1e3);
            continue;
        }
        if tank.external_law.is_some() {
            runs = record(&tank, &plans, &length_s)?;
        }
        let held: Vec<Recorded> = held_plans
            .iter()
            .enumerate()
            .map(|(k, p)| tank.record(p, fitted + k, length_s(p)))
            .collect::<Result<_, _>>()?;
        let fault = (category == Category::Fault).then(|| faulty::Fault::of(index));
        let flaws = match category {
            Category::Instrument => Flaw::draw(index, &mut rng),
            _ => Vec::new(),
        };
        let read = |(k, r): (usize, &Recorded)| match &fault {
            Some(f) => f.source(r, &rig, seed_of(seed, category, index)),
            None if flaws.is_empty() => r.source(&rig),
            None => flawed(&flaws, k, r, &rig, seed_of(seed, category, index)),
        };
        let behind = held.iter().enumerate().map(|(k, r)| (runs.len() + k, r));
        let sealed = Sealed {
            sources: runs
                .iter()
                .enumerate()
                .map(read)
                .collect::<Result<_, _>>()?,
            held: behind.map(read).collect::<Result<_, _>>()?,
            rig,
        };
        return Ok(Case {
            id,
            category,
            background: truth.iter().any(|t| !t.main),
            sealed,
            key: Key {
                held_noise_m: held.last().map(Recorded::noise_rms_m),
                tank,
                truth,
                runs,
                fault,
                flaws,
            },
        });
    }
    Err(ProveError::NoCase {
        id,
        tries: TRIES,
        last,
    })
}

fn record(
    tank: &Tank,
    plans: &[Plan],
    length_s: &dyn Fn(&Plan) -> f64,
) -> Result<Vec<Recorded>, ProveError> {
    plans
        .iter()
        .enumerate()
        .map(|(k, p)| tank.record(p, k, length_s(p)))
        .collect()
}

/// Coefficients of surge up to 20 % off.
pub(super) fn off(rig: &Rig, rng: &mut StdRng) -> hydroline_rigs::Vehicle {
    let mut vehicle = rig.vehicle.clone();
    for c in Coefficient::of(Dof::Surge) {
        let value = c.of_vehicle(&vehicle) * (0.8 + 0.4 * rng.random::<f64>());
        c.put(&mut vehicle, value);
    }
    vehicle
}

enum Wanted {
    No,
    Near(&'static str, f64),
    Modulated(&'static str, f64),
    Unnamed(&'static str, f64),
    Unsteady,
}

struct Drawn {
    entries: Vec<PhysicsEntry>,
    /// Number of entries of practical size (they come first).
    mains: usize,
    external_law: Wanted,
}

fn wanted(
    category: Category,
    index: usize,
    top_n: f64,
    rng: &mut StdRng,
) -> Result<Drawn, ProveError> {
    // Every third case of one to three effects has a law that is not quite the library's.
    let near = index % 3 == 2;
    let nth = index / 3 * 2 + index % 3;
    let first = magnitudes::EFFECTS[nth % magnitudes::EFFECTS.len()];
    let share = 0.3 + 0.7 * rng.random::<f64>();
    let mechanism = NEAR[index / 3 % NEAR.len()];
    let (mains, external_law, background): (Vec<&str>, Wanted, bool) = match category {
        Category::Nothing => (Vec::new(), Wanted::No, index % 2 == 1),
        Category::Single | Category::Pair | Category::Triple => {
            let count = match category {
                Category::Single => 1,
                Category::Pair => 2,
                _ => 3,
            };
            let mut mains: Vec<&str> = if near { vec![mechanism] } else { vec![first] };
            while mains.len() < count {
                let other = others(&mains, rng);
                mains.push(other);
            }
            let external_law = if near {
                mains.remove(0);
                Wanted::Near(mechanism, share)
            } else {
                Wanted::No
            };
            (mains, external_law, index % 4 != 3)
        }
        Category::Unnamed | Category::Composed => {
            let kind = match category {
                Category::Composed => COMPOSED,
                _ => UNNAMED[index % UNNAMED.len()],
            };
            let mains = if index.is_multiple_of(3) {
                vec![others(&[], rng)]
            } else {
                Vec::new()
            };
            (mains, Wanted::Unnamed(kind, share), index % 4 != 3)
        }
        Category::Instrument => {
            let mains = if index % 3 == 1 {
                vec![first]
            } else {
                Vec::new()
            };
            (mains, Wanted::No, index % 4 != 3)
        }
        Category::Precise => (
            vec![magnitudes::EFFECTS[index % magnitudes::EFFECTS.len()]],
            Wanted::Unsteady,
            false,
        ),
        Category::Modulated => {
            let mechanism = MODULATED[index % MODULATED.len()];
            let mains = if index % 4 == 1 {
                vec![others(&[mechanism], rng)]
            } else {
                Vec::new()
            };
            (mains, Wanted::Modulated(mechanism, share), index % 4 != 3)
        }
        Category::Paper => (
            vec![paper::SET[(index + index / SHIFT) % paper::SET.len()]],
            Wanted::No,
            false,
        ),
        Category::Fault => {
            let mains = match faulty::Fault::of(index) {
                faulty::Fault::ClockInMotion => vec!["clock_drift"],
                _ => Vec::new(),
            };
            (mains, Wanted::No, false)
        }
    };
    let mut taken = mains.clone();
    if let Wanted::Near(m, _) | Wanted::Modulated(m, _) = external_law {
        taken.push(m);
    }
    let mut entries: Vec<PhysicsEntry> = mains
        .iter()
        .map(|id| {
            let share = 0.3 + 0.7 * rng.random::<f64>();
            let mut made = magnitudes::entry(id, share, top_n, rng)?;
            if category == Category::Paper {
                paper::against(&mut made);
            }
            Ok(made)
        })
        .collect::<Result<_, ProveError>>()?;
    if background {
        for _ in 0..4 {
            let mut id = others(&taken, rng);
            // The external laws' force is divided by the vehicle's own mass.
            while !matches!(external_law, Wanted::No) && id == "wall_added_mass" {
                id = others(&taken, rng);
            }
            taken.push(id);
            let share = 0.03 + 0.05 * rng.random::<f64>();
            entries.push(magnitudes::entry(id, share, top_n, rng)?);
        }
    }
    Ok(Drawn {
        entries,
        mains: mains.len(),
        external_law,
    })
}

/// An effect that is not taken, nor is its twin.
fn others(taken: &[&str], rng: &mut StdRng) -> &'static str {
    loop {
        let id = magnitudes::EFFECTS[rng.random_range(0..magnitudes::EFFECTS.len())];
        let twin = DELAYS.contains(&id) && taken.iter().any(|t| DELAYS.contains(t));
        if !taken.contains(&id) && !twin {
            return id;
        }
    }
}

fn truths(tank: &Tank, wanted: &Drawn, weights: &[f64]) -> Vec<Truth> {
    let mut truth: Vec<Truth> = tank
        .entries
        .iter()
        .zip(weights)
        .enumerate()
        .map(|(i, (e, w))| Truth {
            effect: e.effect.clone(),
            weight_m: *w,
            main: i < wanted.mains,
            exact: true,
            parameters: magnitudes::numbers(e),
        })
        .collect();
    if let (Some(_), Some(weight)) = (&tank.external_law, weights.get(tank.entries.len())) {
        truth.push(Truth {
            effect: match wanted.external_law {
                Wanted::Near(m, _) | Wanted::Modulated(m, _) => m.to_owned(),
                _ => UNNAMED_ID.to_owned(),
            },
            weight_m: *weight,
            main: true,
            exact: false,
            parameters: Vec::new(),
        });
    }
    truth.sort_by(|a, b| b.weight_m.total_cmp(&a.weight_m));
    truth
}

/// Effect's id in a key for a law without a name.
pub const UNNAMED_ID: &str = "unnamed";

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_case_is_what_its_category_says_and_the_same_every_time() {
        let a = make(1, Category::Single, 2).unwrap();
        let b = make(1, Category::Single, 2).unwrap();
        assert_eq!(a.key.truth, b.key.truth);
        assert_eq!(a.key.runs[0].motion, b.key.runs[0].motion);
        assert_eq!(a.sealed.sources.len(), 4);
        assert_eq!(a.sealed.held.len(), 2);
        let mains: Vec<&Truth> = a.key.truth.iter().filter(|t| t.main).collect();
        assert_eq!(mains.len(), 1);
        assert!(
            !mains[0].exact,
            "every third law is not quite the library's"
        );
        assert!(mains[0].weight_m > 0.0025);
        assert_eq!(a.key.truth.len(), 5);
        assert!(a.key.truth[1..].iter().all(|t| t.weight_m < 0.0015));
        let other = make(2, Category::Single, 2).unwrap();
        assert_ne!(other.key.coefficients(), a.key.coefficients());
        let none = make(1, Category::Nothing, 0).unwrap();
        assert!(none.key.truth.is_empty() && none.key.tank.entries.is_empty());
    }

    #[test]
    fn ids_go_both_ways_and_the_full_set_holds_what_the_proof_asks_for() {
        assert_eq!(parse("unnamed-12").unwrap(), (Category::Unnamed, 12));
        assert!(parse("nonsense").is_err());
        let full = catalogue(FULL, None);
        assert_eq!(full.len(), FULL);
        let count = |c| full.iter().filter(|f| f.0 == c).count();
        assert!(count(Category::Nothing) >= 100 && count(Category::Single) >= 200);
        assert!(count(Category::Pair) >= 60 && count(Category::Unnamed) >= 50);
    }
}
