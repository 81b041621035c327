//! Offset and drift of simulated pairs: intervals cover, at an sd near the bound of Cramer and Rao.

use rand::rngs::StdRng;
use rand::{RngExt, SeedableRng};
use rand_distr::{Distribution, Normal};

use super::estimate::{Fit, fitted};
use super::problem::DRIFT_UNIT;
use super::{Problem, align};
use hydroline_core::run::{Channel, Command, PerChannel, Run, Sample};
use hydroline_numerics::least_squares::LeastSquares;
use nalgebra::DVector;

/// A vehicle of one degree of freedom, by small steps of another scheme than the estimate's.
struct Pair {
    motion: Run,
    commands: Run,
    /// Between the zeros, at the first command \[s\]; and the motion's clock against the other.
    offset_s: f64,
    drift: f64,
}

const SD_M: f64 = 1e-3;
const SD_MPS: f64 = 3e-3;

fn pair(seed: u64, has_velocity: bool) -> Pair {
    let mut rng = StdRng::seed_from_u64(seed);
    let offset_s = rng.random_range(-6.0..6.0);
    let drift = rng.random_range(-300e-6..300e-6);
    let (mass, linear, quadratic) = (
        rng.random_range(20.0..60.0),
        rng.random_range(4.0..12.0),
        rng.random_range(10.0..30.0),
    );
    let mut commands = Vec::new();
    let mut t_s = 0.0;
    while t_s < 80.0 {
        let load = rng.random_range(-9.0..9.0);
        commands.push(Command {
            t_s,
            wrench: [load, 0.0, 0.0, 0.0, 0.0, 0.0],
        });
        t_s += rng.random_range(2.0..7.0);
    }
    // Impulse up to a time: the mean load of a step in which it changes is exact.
    let impulse = |t_b: f64| -> f64 {
        let ends = commands
            .iter()
            .skip(1)
            .map(|c| c.t_s)
            .chain([f64::INFINITY]);
        let each = commands.iter().zip(ends);
        each.map(|(c, end)| c.wrench[0] * (t_b.min(end) - c.t_s).max(0.0))
            .sum()
    };
    let (mut samples, mut u, mut x) = (Vec::new(), 0.0, 0.0);
    let (place, speed) = (
        Normal::new(0.0, SD_M).unwrap(),
        Normal::new(0.0, SD_MPS).unwrap(),
    );
    // Midpoint rule at 1 ms, sampled at 20 Hz.
    for k in 0..90_000 {
        let t = f64::from(k) * 1e-3;
        if k % 50 == 0 {
            let mut values = PerChannel::NAN;
            values[Channel::X] = x + place.sample(&mut rng);
            values[Channel::Psi] = 0.0;
            if has_velocity {
                values[Channel::U] = u + speed.sample(&mut rng);
            }
            samples.push(Sample {
                t_s: t,
                values,
                covariance: None,
            });
        }
        let own = |t: f64| (t - offset_s) / (1.0 + drift);
        let (from, to) = (own(t), own(t + 1e-3));
        let load = (impulse(to) - impulse(from)) / (to - from);
        let rate = |u: f64| (load - linear * u - quadratic * u.abs() * u) / mass;
        let middle = u + 0.5e-3 * rate(u);
        x += 1e-3 * middle;
        u += 1e-3 * rate(middle);
    }
    Pair {
        motion: Run {
            samples,
            ..Run::default()
        },
        commands: Run {
            commands,
            ..Run::default()
        },
        offset_s,
        drift,
    }
}

/// The least sd of offset and drift that any estimate can have under white noise of these sds, all coefficients
/// unknown too (Cramer and Rao).
fn bound(problem: &Problem, at: &DVector<f64>, held: &[bool], sds: &[f64]) -> [f64; 2] {
    let mut own = problem.copy();
    for (s, sd) in own.series.iter_mut().zip(sds) {
        (s.sd, s.rho) = (*sd, 0.0);
    }
    let mut fit = Fit {
        problem: &own,
        held: held.to_vec(),
    };
    let mut residuals = Vec::new();
    fit.begin(at, &mut residuals).unwrap();
    let normal = fit.linearise(at, &residuals).unwrap();
    let (offset, drift) = own.variances(&normal.hessian, held);
    [offset.sqrt(), drift.sqrt() * DRIFT_UNIT]
}

/// Share of intervals of 95 % that hold the truth, and the mean sd against the bound, for offset and drift.
fn coverage(pairs: u64, has_velocity: bool) -> [(f64, f64); 2] {
    let (mut inside, mut ratio) = ([0.0; 2], [0.0; 2]);
    for seed in 0..pairs {
        let p = pair(seed, has_velocity);
        let problem = Problem::new(&p.motion, &p.commands);
        let (found, at, held) = fitted(&problem, None, (-10.0, 10.0)).unwrap();
        let sds = if has_velocity {
            vec![SD_M, SD_MPS]
        } else {
            vec![SD_M]
        };
        let bound = bound(&problem, &at, &held, &sds);
        let errors = [
            (found.offset_s - p.offset_s, found.offset_sd_s, bound[0]),
            (found.drift - p.drift, found.drift_sd, bound[1]),
        ];
        for (i, (error, sd, least)) in errors.into_iter().enumerate() {
            inside[i] += f64::from(u8::from(error.abs() <= 1.96 * sd));
            ratio[i] += sd / least;
        }
    }
    let n = pairs as f64;
    [0, 1].map(|i| (inside[i] / n, ratio[i] / n))
}

fn intervals_cover_at_the_bound(pairs: u64, has_velocity: bool) {
    let [offset, drift] = coverage(pairs, has_velocity);
    println!(
        "velocity {has_velocity}: offset covered {:.3} at {:.3} of the bound, drift {:.3} at {:.3}",
        offset.0, offset.1, drift.0, drift.1
    );
    for (covered, ratio) in [offset, drift] {
        // 95 % and 3 binomial sd; of 200 pairs what is asked, 90 to 98 %.
        let binomial = 3.0 * (0.95 * 0.05 / pairs as f64).sqrt();
        assert!(
            covered >= 0.95 - binomial.max(0.05) && covered <= 0.95 + binomial.max(0.03),
            "{covered}"
        );
        assert!(ratio <= 1.5, "{ratio}");
    }
}

#[test]
fn intervals_of_offset_and_drift_cover_at_the_bound() {
    intervals_cover_at_the_bound(40, false);
}

#[test]
fn intervals_of_offset_and_drift_cover_at_the_bound_with_velocity() {
    intervals_cover_at_the_bound(40, true);
}

#[test]
#[ignore = "200 pairs twice: tests/nightly import"]
fn intervals_of_offset_and_drift_cover_at_the_bound_in_200_pairs() {
    intervals_cover_at_the_bound(200, false);
    intervals_cover_at_the_bound(200, true);
}

#[test]
fn what_cannot_be_aligned_is_said() {
    let p = pair(1, true);
    let mut constant = p.commands.clone();
    constant.commands.truncate(1);
    // One step well before the motion: nothing changes within it.
    constant.commands[0].t_s = 0.0;
    let problem = Problem::new(&p.motion, &constant);
    assert!(align(&problem, None, (0.0, 0.0)).is_err());
    let none = Problem::new(&p.motion, &Run::default());
    assert!(align(&none, None, (-10.0, 10.0)).is_err());
}
