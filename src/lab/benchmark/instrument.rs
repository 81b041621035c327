//! Flaws of instruments in stamps and positions that no vehicle makes: jitter, stamps in pairs, slow drift with temperature, a
//! ruler that is not straight. One or two at once; sizes, times and lengths are drawn.

use hydroline_diagnose::Source;
use hydroline_diagnose::verdict::Verdict;
use hydroline_log::messages::{pb, timestamp, unix_ns};
use hydroline_rigs::Rig;
use hydroline_sim::effect::{Stage, find};
use rand::{RngExt, SeedableRng, rngs::StdRng};
use rand_distr::{Distribution, StandardNormal};

use super::case::Truth;
use super::error::ProveError;
use super::experiment::{Recorded, at_ns, source};

/// One of them.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, schemars::JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Flaw {
    /// Stamps scatter about when the samples were taken.
    Jitter {
        /// sd \[s\].
        sd_s: f64,
    },
    /// Every second sample is stamped late, as where two are sent one behind the other.
    Pairs {
        /// By so much \[s\].
        late_s: f64,
    },
    /// The zero of x moves as the instrument warms up, from run to run on.
    Thermal {
        /// In the end \[m\].
        size_m: f64,
        /// Time constant \[s\].
        time_s: f64,
    },
    /// x is read off by a wave along the tank.
    Ruler {
        /// Amplitude \[m\].
        size_m: f64,
        /// Length \[m\].
        length_m: f64,
        /// Phase \[rad\].
        phase_rad: f64,
    },
}

/// Time between two runs \[s\].
const BETWEEN_S: f64 = 120.0;

impl Flaw {
    /// Those of the n-th case: each kind in turn, every third time a second one beside it.
    pub fn draw(index: usize, rng: &mut StdRng) -> Vec<Flaw> {
        let mut one = |kind: usize| {
            let mut between = |low: f64, high: f64| low + (high - low) * rng.random::<f64>();
            let sign = if between(0.0, 1.0) < 0.5 { -1.0 } else { 1.0 };
            match kind % 4 {
                0 => Flaw::Jitter {
                    sd_s: between(2e-3, 10e-3),
                },
                1 => Flaw::Pairs {
                    late_s: between(5e-3, 20e-3),
                },
                2 => Flaw::Thermal {
                    size_m: sign * between(1e-3, 5e-3),
                    time_s: between(60.0, 600.0),
                },
                _ => Flaw::Ruler {
                    size_m: between(0.3e-3, 2e-3),
                    length_m: between(0.15, 0.8),
                    phase_rad: between(-3.1, 3.1),
                },
            }
        };
        let first = one(index);
        match index % 3 {
            2 => vec![first, one(index + 1 + index / 3 % 3)],
            _ => vec![first],
        }
    }
}

/// A run, the n-th, as such an instrument logs it.
///
/// # Errors
/// [`ProveError::Load`].
pub fn flawed(
    flaws: &[Flaw],
    run: usize,
    r: &Recorded,
    rig: &Rig,
    seed: u64,
) -> Result<Source, ProveError> {
    let mut rng = StdRng::seed_from_u64(seed ^ (run as u64 + 1).wrapping_mul(0x9e37_79b9));
    let mut motion: Vec<pb::VehicleMotion> = r.motion.clone();
    for (k, m) in motion.iter_mut().enumerate() {
        let ns = unix_ns(m.timestamp.as_ref().unwrap_or(&timestamp(0)));
        let t_s = ns.saturating_sub(at_ns(0.0)) as f64 * 1e-9;
        let mut stamp_s = t_s;
        for flaw in flaws {
            match *flaw {
                Flaw::Jitter { sd_s } => {
                    let normal: f64 = StandardNormal.sample(&mut rng);
                    stamp_s += sd_s * normal;
                }
                Flaw::Pairs { late_s } if k % 2 == 0 => stamp_s += late_s,
                Flaw::Pairs { .. } => {}
                Flaw::Thermal { size_m, time_s } => {
                    let since_s = BETWEEN_S * run as f64 + t_s;
                    let off_m = size_m * (1.0 - (-since_s / time_s).exp());
                    m.x_m = m.x_m.map(|x| x + off_m);
                }
                Flaw::Ruler {
                    size_m,
                    length_m,
                    phase_rad,
                } => {
                    let off =
                        |x: f64| size_m * (std::f64::consts::TAU * x / length_m + phase_rad).sin();
                    m.x_m = m.x_m.map(|x| x + off(x));
                }
            }
        }
        m.timestamp = Some(timestamp(at_ns(stamp_s.max(0.0))));
    }
    // A logger writes in the order of its stamps.
    motion.sort_by_key(|m| unix_ns(m.timestamp.as_ref().unwrap_or(&timestamp(0))));
    source(&r.name, &r.commands, &motion, None, rig)
}

/// Whether all physics that a verdict names as something that matters are there; what only the measurement does is
/// none of the vehicle's physics.
pub fn invents_nothing(verdict: &Verdict, truth: &[Truth]) -> bool {
    let mattering = verdict.effects.iter().filter(|e| e.matters);
    mattering.into_iter().all(|e| {
        let measures = find(&e.effect).is_some_and(|i| i.stage == Stage::Measurement);
        measures || truth.iter().any(|t| t.effect == e.effect)
    })
}
