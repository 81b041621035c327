//! How one degree of freedom answers to its load: nu' = a tau(t) - d nu - q |nu| nu - k s + b, s' = nu (the diagonal of
//! the paper's Eq. 1, gain and damping per mass).

/// Longest step \[s\].
const STEP_S: f64 = 0.05;

/// Time under one load after which the answer to it is taken as settled \[s\]: fifteen of the longest time constants that
/// are looked at, so that what a gap of the stamps costs is bounded.
const SETTLED_S: f64 = 600.0;

/// a, d, q, b, nu_0, s_0, k.
pub(super) const COEFFICIENTS: usize = 7;

/// A load from its time on: (t \[s\], N or N m).
pub(super) type Loads = Vec<(f64, f64)>;

fn rates(c: &[f64], load: f64, nu: f64, s: f64) -> (f64, f64) {
    let [a, d, q, b, _, _, k] = c else {
        return (0.0, 0.0);
    };
    (a * load - d * nu - q * nu.abs() * nu - k * s + b, nu)
}

/// One step of Runge and Kutta's fourth order under a constant load.
fn step(c: &[f64], load: f64, (nu, s): (f64, f64), h: f64) -> (f64, f64) {
    let k1 = rates(c, load, nu, s);
    let k2 = rates(c, load, nu + 0.5 * h * k1.0, s + 0.5 * h * k1.1);
    let k3 = rates(c, load, nu + 0.5 * h * k2.0, s + 0.5 * h * k2.1);
    let k4 = rates(c, load, nu + h * k3.0, s + h * k3.1);
    (
        nu + h / 6.0 * (k1.0 + 2.0 * k2.0 + 2.0 * k3.0 + k4.0),
        s + h / 6.0 * (k1.1 + 2.0 * k2.1 + 2.0 * k3.1 + k4.1),
    )
}

/// Velocity and way at each time; loads change exactly where they do. `None` = it runs away.
pub(super) fn simulate(c: &[f64], loads: &Loads, times_s: &[f64]) -> Option<Vec<(f64, f64)>> {
    let mut out = Vec::with_capacity(times_s.len());
    let mut t = *times_s.first()?;
    let mut next = loads.partition_point(|l| l.0 <= t);
    let mut load = next.checked_sub(1).map_or(0.0, |i| loads[i].1);
    let mut state = (*c.get(4)?, *c.get(5)?);
    let has_spring = *c.get(6)? != 0.0;
    let mut held_s = 0.0;
    for &end in times_s {
        while t < end {
            let change = loads.get(next).map_or(f64::INFINITY, |l| l.0);
            let until = end.min(change);
            let to = if held_s < SETTLED_S {
                until.min(t + STEP_S)
            } else {
                until
            };
            if to > t && held_s < SETTLED_S {
                state = step(c, load, state, to - t);
            } else if to > t && !has_spring {
                // Steady: it goes on as fast as it goes. On a spring it stands.
                state.1 += state.0 * (to - t);
            }
            held_s += to - t;
            t = to;
            while loads.get(next).is_some_and(|l| l.0 <= t) {
                held_s = if loads[next].1 == load { held_s } else { 0.0 };
                load = loads[next].1;
                next += 1;
            }
        }
        if !(state.0.abs() < 1e6 && state.1.abs() < 1e9) {
            return None;
        }
        out.push(state);
    }
    Some(out)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The answer over a gap of a century was integrated in steps of 50 ms.
    #[test]
    fn a_gap_of_a_century_costs_what_one_of_minutes_does_and_the_steady_motion_goes_on() {
        let c = [2.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0];
        let found = simulate(&c, &vec![(0.0, 1.0)], &[0.0, 10.0, 3.2e8]).unwrap();
        assert!((found[2].0 - 2.0).abs() < 1e-9);
        assert!((found[2].1 / 6.4e8 - 1.0).abs() < 1e-6, "{found:?}");
    }

    #[test]
    fn linear_motion_is_exact() {
        // nu' = 2 - nu from rest, load on at 0.333 s.
        let times: Vec<f64> = (0..50).map(|k| f64::from(k) * 0.1).collect();
        let c = [2.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0];
        for (t, (nu, s)) in times
            .iter()
            .zip(simulate(&c, &vec![(0.333, 1.0)], &times).unwrap())
        {
            let on = (t - 0.333).max(0.0);
            assert!((nu - 2.0 * (1.0 - (-on).exp())).abs() < 1e-7, "{t}");
            assert!((s - 2.0 * (on - 1.0 + (-on).exp())).abs() < 1e-7, "{t}");
        }
    }
}
