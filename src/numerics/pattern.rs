//! Pattern search: along one move after the other, the step halved when none gains.
//!
//! For costs of few unknowns without derivatives, or with kinks. Convergence to a stationary point of a smooth cost holds for
//! any moves that span the space both ways (Torczon, SIAM J. Optim. 7, 1997); how sharp it is the last step says.

/// Options of [`minimise`]. None has a default: the step is in the unknowns' own unit.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Options {
    /// First step.
    pub step: f64,
    /// The search ends when the step is no longer than this.
    pub finest: f64,
    /// A move counts when it lowers the cost by more than this. 0 = by anything: for costs without noise of their own.
    pub gain: f64,
}

/// The place of the least cost found from `at`, and its cost.
///
/// `moved(at, k, by)` is the place `by` along move `k` of `moves`; ahead is tried before astern, and the first that gains is
/// taken. `cost` = the cost at `at`.
pub fn minimise<P>(
    mut at: P,
    mut cost: f64,
    moves: usize,
    options: &Options,
    moved: impl Fn(&P, usize, f64) -> P,
    of: impl Fn(&P) -> f64,
) -> (P, f64) {
    let mut step = options.step;
    while step > options.finest {
        let mut gained = false;
        for k in 0..moves {
            for by in [step, -step] {
                let tried = moved(&at, k, by);
                let there = of(&tried);
                if there < cost - options.gain {
                    (at, cost, gained) = (tried, there, true);
                    break;
                }
            }
        }
        if !gained {
            step *= 0.5;
        }
    }
    (at, cost)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_cost_with_a_kink_falls_to_the_last_step() {
        let cost_of = |x: &[f64; 2]| (x[0] - 3.0).abs() + 2.0 * (x[1] + 1.0 - 0.1 * x[0]).powi(2);
        let along = |x: &[f64; 2], k: usize, by: f64| {
            let mut moved = *x;
            moved[k] += by;
            moved
        };
        let options = Options {
            step: 1.0,
            finest: 1e-4,
            gain: 0.0,
        };
        let start = [-7.3, 5.1];
        let (at, cost) = minimise(start, cost_of(&start), 2, &options, along, cost_of);
        assert!(
            (at[0] - 3.0).abs() < 1e-3 && (at[1] + 0.7).abs() < 1e-2,
            "{at:?}"
        );
        assert_eq!(cost, cost_of(&at));
    }

    #[test]
    fn a_gain_below_what_counts_leaves_it_where_it_was() {
        let options = Options {
            step: 1.0,
            finest: 0.1,
            gain: 1e-3,
        };
        let flat = |x: &f64| 1e-4 * (x - 2.0).powi(2);
        let (at, _) = minimise(0.0, flat(&0.0), 1, &options, |x, _, by| x + by, flat);
        assert_eq!(at, 0.0);
    }
}
