//! Measured motion as an input: what of a run the model does not simulate but is driven by.
//!
//! A DOF that is given moves as a smoothing spline through its measurement says; one that is measured and does not move
//! keeps the steady rate that it has (a roll test under way). All series are smoothed in the tank frame, where a position
//! and its rate belong together, and rotated into the body by the smoothed attitude: the kinematics between both are exact.
//! Reference: Fossen 2011, eqs 2.18 and 2.28 (Euler ZYX).

use hydroline_core::run::Channel::{P, Phi, Psi, Q, R, Theta, U, V, W, X, Y, Z};
use hydroline_core::run::{Channel, PerChannel};
use hydroline_numerics::statistics::{median, robust_sd};
use hydroline_sim::Given;
use hydroline_sim::given::Curve;
use hydroline_sim::vehicle::kinematics::{eta_rate, rotation};

use super::recording::{MOVES, Recorded};
use super::smooth::{Smoothed, State, fast_sd, smooth};

/// Distances of stamps over their median from which the spline gets knots between them.
const GAP: f64 = 2.5;

/// Rounds in which angles are smoothed with their own turn.
const ROUNDS: usize = 2;

/// Given motion of a run: DOFs of `given` as they were measured, steady rates of those of neither `given` nor `simulated`,
/// companions. `rest` = pose where nothing is measured.
pub fn given(
    r: &Recorded,
    given: &[usize],
    simulated: &[usize],
    rest: &PerChannel<f64>,
    tolerance: &PerChannel<f64>,
) -> Given {
    let mut made = Given::default();
    for (c, curve) in made.companions.iter_mut().enumerate() {
        *curve = companion(r, c);
    }
    if !given.is_empty() {
        moving(r, given, rest, &mut made);
    }
    let others = (0..6).filter(|d| !given.contains(d) && !simulated.contains(d));
    for d in others {
        if let Some(rate) = steady(r, d, tolerance[Channel::RATES[d]]) {
            made.rates[d] = Some(Curve::constant(rate));
        }
    }
    carry_on(r, rest, given, simulated, &mut made);
    made
}

/// Where steady rates take positions that nobody measured.
fn carry_on(
    r: &Recorded,
    rest: &PerChannel<f64>,
    given: &[usize],
    simulated: &[usize],
    made: &mut Given,
) {
    let end_s = r.times_s.last().copied().unwrap_or(r.start_s);
    let mut tank = [0.0; 6];
    for (d, rate) in made.rates.iter().enumerate() {
        if !given.contains(&d) {
            tank[d] = rate.as_ref().map_or(0.0, |c| c.at(r.start_s));
        }
    }
    if tank == [0.0; 6] {
        return;
    }
    let m = rotation(rest[Phi], rest[Theta], rest[Psi]);
    let along: [f64; 3] = std::array::from_fn(|i| (0..3).map(|j| m[i][j] * tank[j]).sum());
    for (d, place) in Channel::POSES.into_iter().enumerate() {
        let rate = if d < 3 { along[d] } else { tank[d] };
        let free = made.places[d].is_none() && !simulated.contains(&d);
        if rate != 0.0 && free && !r.has(place) {
            let knots = [r.start_s, end_s].map(|t| (t, rest[place] + rate * (t - r.start_s), rate));
            made.places[d] = Some(Curve::new(&knots));
        }
    }
}

/// The steady rate of a DOF that does not move otherwise; `None` where it is none, by its noise or by what matters. Beside a
/// position that stands a steady rate is its instrument's.
pub fn steady(r: &Recorded, dof: usize, tolerance: f64) -> Option<f64> {
    let [place, rate] = Channel::of(dof);
    if r.has(place) {
        return None;
    }
    let seen = r.seen(rate);
    let middle = median(&mut seen.clone().collect::<Vec<_>>())?;
    let off: Vec<f64> = seen.map(|v| v - middle).collect();
    (middle.abs() > (MOVES * robust_sd(&off)).max(tolerance / 3.0)).then_some(middle)
}

/// A companion's curve; `None` where it was not measured.
fn companion(r: &Recorded, place: usize) -> Option<Curve> {
    let (times_s, values) = r.companions.measured(place);
    let samples: Vec<[f64; 2]> = values.iter().map(|v| [*v, f64::NAN]).collect();
    if fast_sd(values.iter().copied()).is_none() {
        // Too few, or all alike: as they are.
        let knots = times_s.iter().zip(&values).map(|(t, v)| (*t, *v, 0.0));
        return (!values.is_empty()).then(|| Curve::new(&knots.collect::<Vec<_>>()));
    }
    let made = smooth(&times_s, &samples, 0.0)?;
    Some(curve(&made, |s| (s[0], s[1])))
}

/// Times of knots: stamps, and between those that are far apart.
fn knots(times_s: &[f64]) -> Vec<f64> {
    let mut gaps: Vec<f64> = times_s.windows(2).map(|w| w[1] - w[0]).collect();
    let usual_s = median(&mut gaps).unwrap_or(1.0).max(1e-6);
    let mut all = Vec::with_capacity(times_s.len());
    for w in times_s.windows(2) {
        let parts = if w[1] - w[0] > GAP * usual_s {
            ((w[1] - w[0]) / usual_s).ceil() as usize
        } else {
            1
        };
        let step_s = (w[1] - w[0]) / parts as f64;
        all.extend((0..parts).map(|k| w[0] + step_s * k as f64));
    }
    all.extend(times_s.last());
    all
}

fn curve(of: &Smoothed, value: impl Fn(&State) -> (f64, f64)) -> Curve {
    let each = knots(&of.times_s).into_iter().map(|t| {
        let (v, slope) = value(&of.at(t));
        (t, v, slope)
    });
    Curve::new(&each.collect::<Vec<_>>())
}

/// Pose, its rate and its acceleration in the tank frame, per coordinate.
struct Track {
    coordinates: [Smoothed; 6],
    /// Whether x and y are known in the tank frame: from both positions, or both body rates.
    planar: bool,
}

/// Angles that nobody measured, from stamp to stamp by the measured body rates.
fn carried(r: &Recorded, angles: &mut [Smoothed; 3]) {
    let turns = [3, 4, 5].map(Channel::of);
    let free: Vec<usize> = (0..3).filter(|a| !r.has(turns[*a][0])).collect();
    if free.is_empty() || !turns.iter().any(|t| r.has(t[1])) {
        return;
    }
    let held = |old: f64, seen: f64| if seen.is_finite() { seen } else { old };
    let mut rates = Channel::RATES.map(|c| match c.is_angular() {
        false => 0.0,
        true => r.first(c).unwrap_or(0.0),
    });
    for k in 1..r.times_s.len() {
        let dt_s = r.times_s[k] - r.times_s[k - 1];
        let pose = |angles: &[Smoothed; 3], k: usize| -> [f64; 6] {
            std::array::from_fn(|d| d.checked_sub(3).map_or(0.0, |a| angles[a].states[k][0]))
        };
        let first = eta_rate(&pose(angles, k - 1), &rates);
        for (d, rate) in rates.iter_mut().enumerate().skip(3) {
            *rate = held(*rate, r.values[k][Channel::RATES[d]]);
        }
        // Heun: there by the first slope, and again by the mean of both ends'.
        let mut slope = first;
        for _ in 0..2 {
            for a in &free {
                angles[*a].states[k][0] = angles[*a].states[k - 1][0] + dt_s * slope[3 + a];
            }
            let last = eta_rate(&pose(angles, k), &rates);
            slope = std::array::from_fn(|d| 0.5 * (first[d] + last[d]));
        }
    }
}

impl Track {
    fn new(r: &Recorded, rest: &PerChannel<f64>) -> Track {
        let there = PerChannel::from_fn(|c| r.has(c));
        let zero = |v: &PerChannel<f64>, c: Channel| if there[c] { v[c] } else { 0.0 };
        let series = |samples: Vec<[f64; 2]>, origin: f64| {
            smooth(&r.times_s, &samples, origin)
                .unwrap_or_else(|| Smoothed::standing(&r.times_s, origin))
        };
        // The attitude as measured turns body rates; where it is not, it rests, or is what the rates make of it.
        let position = |d: usize, rate: &dyn Fn(&PerChannel<f64>, usize) -> f64| {
            let [place, speed] = Channel::of(d);
            let each = r.values.iter().enumerate();
            let samples =
                each.map(|(k, v)| [v[place], if there[speed] { rate(v, k) } else { f64::NAN }]);
            series(samples.collect(), r.first(place).unwrap_or(rest[place]))
        };
        // Rates of the angles need the angles: measured ones as they are, the others carried on by the body rates.
        let mut angles: [Smoothed; 3] = [3, 4, 5].map(|d| position(d, &|_, _| f64::NAN));
        carried(r, &mut angles);
        for _ in 0..ROUNDS {
            let tilt = |k: usize| [0, 1].map(|a: usize| angles[a].states[k][0].sin_cos());
            let turn = |v: &PerChannel<f64>, k: usize| {
                let [(sf, cf), (_, ct)] = tilt(k);
                (zero(v, Q) * sf + zero(v, R) * cf) / ct
            };
            angles = [
                position(3, &|v, k| v[P] + turn(v, k) * tilt(k)[1].0),
                position(4, &|v, k| v[Q] * tilt(k)[0].1 - zero(v, R) * tilt(k)[0].0),
                position(5, &turn),
            ];
        }
        let attitude = |k: usize| {
            let [phi, theta, psi] = [0, 1, 2].map(|a: usize| angles[a].states[k][0]);
            rotation(phi, theta, psi)
        };
        let along = |v: &PerChannel<f64>, k: usize, row: usize| {
            let m = attitude(k);
            let each = m[row].iter().zip([U, V, W]);
            each.map(|(m, c)| m * zero(v, c)).sum::<f64>()
        };
        let rates = there[U] && there[V];
        let planar = rates || (there[X] && there[Y]);
        let place = |c: Channel, known: bool| {
            let each = r.values.iter().enumerate();
            let along = |v, k| {
                if known {
                    along(v, k, c.index())
                } else {
                    f64::NAN
                }
            };
            let samples = each.map(|(k, v)| [v[c], along(v, k)]);
            series(samples.collect(), r.first(c).unwrap_or(rest[c]))
        };
        let [x, y, z] = [place(X, rates), place(Y, rates), place(Z, there[W])];
        let [phi, theta, psi] = angles;
        Track {
            coordinates: [x, y, z, phi, theta, psi],
            planar,
        }
    }

    /// Rates in the body frame at a time and their slopes.
    fn body(&self, t_s: f64) -> [(f64, f64); 6] {
        let s: [State; 6] = std::array::from_fn(|d| self.coordinates[d].at(t_s));
        let [(sf, cf), (st, ct)] = [s[3][0].sin_cos(), s[4][0].sin_cos()];
        let (df, dt, dp) = (s[3][1], s[4][1], s[5][1]);
        let (ddf, ddt, ddp) = (s[3][2], s[4][2], s[5][2]);
        let p = (df - dp * st, ddf - ddp * st - dp * dt * ct);
        let q = (
            dt * cf + dp * ct * sf,
            ddt * cf - dt * df * sf + ddp * ct * sf + dp * (df * ct * cf - dt * st * sf),
        );
        let r = (
            dp * ct * cf - dt * sf,
            ddp * ct * cf - dp * (dt * st * cf + df * ct * sf) - ddt * sf - dt * df * cf,
        );
        let m = rotation(s[3][0], s[4][0], s[5][0]);
        let back = |part: usize| -> [f64; 3] {
            std::array::from_fn(|j| (0..3).map(|i| m[i][j] * s[i][part]).sum())
        };
        let ([u, v, w], [du, dv, dw]) = (back(1), back(2));
        // d/dt (R' x') = R' x'' - omega x nu.
        [
            (u, du - (q.0 * w - r.0 * v)),
            (v, dv - (r.0 * u - p.0 * w)),
            (w, dw - (p.0 * v - q.0 * u)),
            p,
            q,
            r,
        ]
    }
}

/// Given DOFs of a run into curves.
fn moving(r: &Recorded, given: &[usize], rest: &PerChannel<f64>, made: &mut Given) {
    let track = Track::new(r, rest);
    let at = knots(&r.times_s);
    let bodies: Vec<[(f64, f64); 6]> = at.iter().map(|t| track.body(*t)).collect();
    for &d in given {
        made.places[d] = Some(curve(&track.coordinates[d], |s| (s[0], s[1])));
        let rotated = d > 1 || track.planar;
        made.rates[d] = if rotated {
            let each = at.iter().zip(&bodies).map(|(t, b)| (*t, b[d].0, b[d].1));
            Some(Curve::new(&each.collect::<Vec<_>>()))
        } else {
            // One of x and y alone cannot be rotated: it is the body's own.
            let both = Channel::of(d);
            let samples: Vec<[f64; 2]> = r.values.iter().map(|v| both.map(|c| v[c])).collect();
            let own = smooth(&r.times_s, &samples, rest[both[0]]);
            own.map(|s| curve(&s, |s| (s[1], s[2])))
        };
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use hydroline_core::run::{Companions, Run, Sample};
    use rand::{SeedableRng, rngs::StdRng};
    use rand_distr::{Distribution, StandardNormal};

    fn nu(t: f64) -> [f64; 6] {
        [
            0.3 + 0.1 * (0.5 * t).sin(),
            0.08 * (0.7 * t).cos(),
            0.03 * (0.4 * t).sin(),
            0.15 * (1.1 * t).cos(),
            0.08 * (0.9 * t).sin(),
            0.12 + 0.1 * (0.6 * t).cos(),
        ]
    }

    /// A body that moves in all DOFs, integrated finely; channels of `seen` are measured with noise.
    fn run(seen: &[Channel]) -> Run {
        let mut rng = StdRng::seed_from_u64(3);
        let mut eta = [0.2, -0.1, -0.8, 0.05, 0.02, 0.4];
        let (mut made, steps) = (Run::default(), 40);
        for k in 0..500 {
            let t = 0.04 * f64::from(k);
            let rates = nu(t);
            let truth = PerChannel::of_state(eta, rates);
            let values = PerChannel::from_fn(|c| {
                let normal: f64 = StandardNormal.sample(&mut rng);
                let sd = if c.is_rate() { 2e-3 } else { 5e-4 };
                if seen.contains(&c) {
                    truth[c] + sd * normal
                } else {
                    f64::NAN
                }
            });
            made.samples.push(Sample {
                t_s: t,
                values,
                covariance: None,
            });
            let h = 0.04 / f64::from(steps);
            for i in 0..steps {
                let middle = t + h * (f64::from(i) + 0.5);
                let rate = eta_rate(&eta, &nu(middle));
                let half: [f64; 6] = std::array::from_fn(|d| eta[d] + 0.5 * h * rate[d]);
                let rate = eta_rate(&half, &nu(middle));
                eta = std::array::from_fn(|d| eta[d] + h * rate[d]);
            }
        }
        made
    }

    fn worst(seen: &[Channel]) -> [f64; 6] {
        let run = run(seen);
        let r = Recorded::new(&run, 0.0, 60.0);
        let rest = PerChannel::from_fn(|c| r.first(c).unwrap_or(0.0));
        let made = given(
            &r,
            &[0, 1, 2, 3, 4, 5],
            &[],
            &rest,
            &PerChannel::splat(1e-3),
        );
        std::array::from_fn(|d| {
            let rate = made.rates[d].as_ref().unwrap();
            let each = (0..450).map(|k| 1.0 + 0.0399 * f64::from(k));
            let sum: f64 = each.map(|t| (rate.at(t) - nu(t)[d]).powi(2)).sum();
            (sum / 450.0).sqrt()
        })
    }

    #[test]
    fn body_rates_come_from_poses_from_rates_and_from_both() {
        let all = Channel::ALL;
        for (seen, limit) in [(&all[..6], 3e-3), (&all[6..], 1e-3), (&all[..], 1e-3)] {
            let off = worst(seen);
            assert!(off.iter().all(|v| *v < limit), "{seen:?}: {off:?}");
        }
    }

    #[test]
    fn a_steady_rate_carries_the_hull_and_noise_about_rest_does_not() {
        let mut run = run(&[Phi]);
        for (k, s) in run.samples.iter_mut().enumerate() {
            let shake = if k % 2 == 0 { 1e-3 } else { -1e-3 };
            s.values[U] = 0.5 + shake;
            s.values[V] = shake;
        }
        run.companions = Companions {
            times_s: vec![0.0, 1.0],
            values: vec![[0.1, f64::NAN, f64::NAN, f64::NAN]; 2],
        };
        let r = Recorded::new(&run, 0.0, 60.0);
        let mut rest = PerChannel::splat(0.0);
        rest[Psi] = std::f64::consts::FRAC_PI_2;
        let made = given(&r, &[], &[3], &rest, &PerChannel::splat(1e-3));
        let at = |c: &Option<Curve>, t: f64| c.as_ref().map(|c| c.at(t));
        assert!((at(&made.rates[0], 3.0).unwrap() - 0.5).abs() < 2e-3);
        assert!(made.rates[1].is_none() && made.rates[3].is_none());
        assert!((at(&made.places[1], 4.0).unwrap() - 2.0).abs() < 1e-2);
        assert_eq!(at(&made.companions[0], 9.0), Some(0.1));
        assert!(made.companions[1].is_none());
    }
}
