//! Steps of a plan with a level per DOF, on a grid that a person can read.

use hydroline_rigs::{Plan, PlanStep, Shape, StepLoad, Wrench};
use rand::RngExt;
use rand::rngs::StdRng;

/// Levels, as shares of a DOF's reach.
pub const LEVELS: [f64; 9] = [-1.0, -0.75, -0.5, -0.25, 0.0, 0.25, 0.5, 0.75, 1.0];
/// Grid of a step's length \[s\].
pub const GRID_S: f64 = 0.5;
/// Fewest grid points that a step takes: 1 s, a few of the time constants of thrusters.
pub const SHORTEST: u32 = 2;
/// Steps of a pattern.
pub const STEPS: [usize; 3] = [5, 8, 11];
/// Levels of the eight others that are tried at a visit: a second visit draws others.
const TRIED: usize = 3;
/// Digits of a load.
const DIGITS: i32 = 3;

/// Steps that hold their load.
#[derive(Debug, Clone, PartialEq)]
pub struct Pattern {
    /// Length of each step, in grid points.
    pub lengths: Vec<u32>,
    /// Level per step and DOF.
    pub levels: Vec<[f64; 6]>,
    /// Load of level 1 per DOF \[N, N m\].
    pub sizes: [f64; 6],
}

/// A number with as many digits as a person would write.
fn rounded(v: f64) -> f64 {
    if v == 0.0 {
        return 0.0;
    }
    let places = (DIGITS - 1 - v.abs().log10().floor() as i32).max(0) as usize;
    // Through the text, so that it is the number that stands in the file.
    format!("{v:.places$}").parse().unwrap_or(v)
}

impl Pattern {
    /// One drawn at random: lengths and levels even over their grids; every other one there and back, its second half
    /// undoing the first, which has farther to go before the tank ends.
    pub fn drawn(rng: &mut StdRng, length_s: f64, sizes: [f64; 6]) -> Pattern {
        let most = ((length_s / GRID_S).round() as u32).max(2 * SHORTEST);
        let back: bool = rng.random();
        let over = if back { most / 2 } else { most };
        let steps = STEPS[rng.random_range(0..STEPS.len())];
        let steps = if back { steps.div_ceil(2) } else { steps };
        let steps = steps.min((over / SHORTEST) as usize);
        let mut lengths = vec![SHORTEST; steps];
        for _ in 0..over.saturating_sub(SHORTEST * steps as u32) {
            lengths[rng.random_range(0..steps)] += 1;
        }
        let level = |rng: &mut StdRng, d: usize| {
            let drawn = LEVELS[rng.random_range(0..LEVELS.len())];
            if sizes[d] > 0.0 { drawn } else { 0.0 }
        };
        let mut levels: Vec<[f64; 6]> = (0..steps)
            .map(|_| std::array::from_fn(|d| level(rng, d)))
            .collect();
        if back {
            for k in (0..steps).rev() {
                lengths.push(lengths[k]);
                levels.push(levels[k].map(|v| 0.0 - v));
            }
            lengths[0] += most % 2;
        }
        Pattern {
            lengths,
            levels,
            sizes,
        }
    }

    pub fn plan(&self, name: &str) -> Plan {
        let steps = self.lengths.iter().zip(&self.levels).map(|(n, levels)| {
            let load = std::array::from_fn(|d| rounded(levels[d] * self.sizes[d]));
            PlanStep {
                for_s: f64::from(*n) * GRID_S,
                load: StepLoad::Wrench(Wrench::from_array(load)),
                shape: Shape::Hold,
            }
        });
        let mut plan = Plan {
            name: name.to_owned(),
            steps: steps.collect(),
            source_toml: String::new(),
        };
        plan.source_toml = plan.to_toml();
        plan
    }

    /// Some of what differs from it at one place: a level, the border between two steps, the size of a DOF.
    pub fn neighbours(&self, place: Place, rng: &mut StdRng) -> Vec<Pattern> {
        let changed = |change: &dyn Fn(&mut Pattern)| {
            let mut p = self.clone();
            change(&mut p);
            p
        };
        match place {
            Place::Level { step, dof } => {
                let mut others: Vec<f64> = LEVELS.to_vec();
                others.retain(|l| *l != self.levels[step][dof]);
                for k in 0..TRIED {
                    let other = rng.random_range(k..others.len());
                    others.swap(k, other);
                }
                let tried = others.into_iter().take(TRIED);
                tried
                    .map(|l| changed(&|p| p.levels[step][dof] = l))
                    .collect()
            }
            Place::Border { step } => {
                let both = self.lengths[step] + self.lengths[step + 1];
                [-2i64, 2]
                    .into_iter()
                    .map(|by| i64::from(self.lengths[step]) + by)
                    .filter(|n| {
                        (i64::from(SHORTEST)..=i64::from(both) - i64::from(SHORTEST)).contains(n)
                    })
                    .map(|n| {
                        changed(&|p| {
                            p.lengths[step] = n as u32;
                            p.lengths[step + 1] = both - n as u32;
                        })
                    })
                    .collect()
            }
            Place::All => [0.8, 1.25]
                .into_iter()
                .map(|by| changed(&|p| p.sizes = p.sizes.map(|v| by * v)))
                .collect(),
            Place::Size { dof } => [0.8, 1.25]
                .into_iter()
                .map(|by| changed(&|p| p.sizes[dof] *= by))
                .collect(),
        }
    }

    /// All places at which it may be changed.
    pub fn places(&self) -> Vec<Place> {
        let dofs = (0..6).filter(|d| self.sizes[*d] > 0.0);
        let steps = self.lengths.len();
        let mut all: Vec<Place> = dofs.clone().map(|dof| Place::Size { dof }).collect();
        for step in 0..steps {
            all.extend(dofs.clone().map(|dof| Place::Level { step, dof }));
            if step + 1 < steps {
                all.push(Place::Border { step });
            }
        }
        all
    }
}

/// Where a pattern may be changed.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Place {
    /// Level of a DOF in a step.
    Level { step: usize, dof: usize },
    /// Border between a step and the next.
    Border { step: usize },
    /// Load of level 1 of all DOFs.
    All,
    /// Load of level 1.
    Size { dof: usize },
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::SeedableRng;

    #[test]
    fn neighbours_are_as_long_and_read_back_as_plans() {
        let mut rng = StdRng::seed_from_u64(3);
        for _ in 0..20 {
            let pattern = Pattern::drawn(&mut rng, 30.0, [8.0, 0.0, 4.0, 0.0, 0.0, 0.6]);
            for place in pattern.places() {
                for n in pattern.neighbours(place, &mut rng) {
                    let plan = n.plan("p");
                    assert_eq!(plan.duration_s(), 30.0);
                    let back = Plan::from_toml(&plan.source_toml, "p.toml").unwrap();
                    assert_eq!(back.steps, plan.steps);
                }
            }
        }
    }

    #[test]
    fn loads_are_written_with_three_digits() {
        assert_eq!(rounded(0.123_45), 0.123);
        assert_eq!(rounded(-45.678), -45.7);
        assert_eq!(rounded(-0.000_456_78), -0.000_457);
    }
}
