//! The prior of one DOF's motion with the largest evidence.
//!
//! The same path is a quick disturbance about the rig's motion or a slow force on the vehicle: each is a
//! maximum of its own, which no change of one number leaves. So the search starts from each kind.

use super::evidence::Quadratic;
use super::prior::{Motion, MotionPrior};
use hydroline_numerics::cholesky::ln_determinant;
use nalgebra::{Cholesky, DMatrix, DVector};

/// Numbers of a motion prior move by this factor at a time, within these bounds.
const FACTOR: f64 = 3.0;
/// Standard deviation of a position \[m\] or an angle \[rad\].
const SD: [f64; 2] = [3e-6, 0.3];
/// Correlation time \[s\].
const TAU_S: [f64; 2] = [0.2, 10.0];
/// Intensity of acceleration \[m²/s³\], of angles \[rad²/s³\].
const DRIVE: [f64; 2] = [1e-12, 1e-2];
/// Gain of log evidence below which the search ends.
const SMALLEST_GAIN: f64 = 0.01;
/// Rounds through the numbers at most.
const ROUNDS: usize = 12;
/// Starts: nearly no disturbance and what a tank does to a vehicle; a small and a wide disturbance, no force.
const STARTS: [MotionPrior; 3] = [
    MotionPrior {
        sd: 1e-5,
        tau_s: 2.0,
        drive: 1e-7,
    },
    MotionPrior {
        sd: 3e-4,
        tau_s: 2.0,
        drive: 1e-11,
    },
    MotionPrior {
        sd: 1e-2,
        tau_s: 2.0,
        drive: 1e-11,
    },
];

/// One DOF's part of a quadratic log likelihood, all else integrated out.
pub struct Alone<'a> {
    motions: &'a [Motion],
    dof: usize,
    a: DMatrix<f64>,
    b: DVector<f64>,
}

impl<'a> Alone<'a> {
    /// Of a likelihood whose unknowns are the frames' poses, run by run, and then whatever else; `prior` = precision
    /// of all of them, that of the DOF itself not used.
    pub fn of(
        q: &Quadratic,
        prior: &DMatrix<f64>,
        motions: &'a [Motion],
        dof: usize,
    ) -> Option<Self> {
        let frames: usize = motions.iter().map(Motion::frames).sum();
        let own: Vec<usize> = (0..frames).map(|i| 6 * i + dof).collect();
        let rest: Vec<usize> = (0..q.b.len())
            .filter(|k| *k >= 6 * frames || k % 6 != dof)
            .collect();
        let of = |rows: &[usize], columns: &[usize], with: &DMatrix<f64>| {
            DMatrix::from_fn(rows.len(), columns.len(), |i, j| {
                with[(rows[i], columns[j])]
            })
        };
        // Schur's complement of the rest: A_dd - A_dr (A_rr + P_rr)^-1 A_rd.
        let l = Cholesky::new(of(&rest, &rest, &(&q.a + prior)))?;
        let l = l.l_dirty();
        let w = l.solve_lower_triangular(&of(&rest, &own, &q.a))?;
        let u = l.solve_lower_triangular(&q.b.select_rows(&rest))?;
        Some(Alone {
            motions,
            dof,
            a: of(&own, &own, &q.a) - w.tr_mul(&w),
            b: q.b.select_rows(&own) - w.tr_mul(&u),
        })
    }

    /// log evidence with this motion prior, up to what no motion prior of this DOF changes.
    pub fn value(&self, motion_prior: &MotionPrior) -> Option<f64> {
        let mut with = self.a.clone();
        let (mut half, mut first) = (0.0, 0);
        for motion in self.motions {
            let known = motion.precision(self.dof, motion_prior)?;
            let (own, own_half) = known.as_ref();
            let n = motion.frames();
            let mut block = with.view_mut((first, first), (n, n));
            block += own;
            half += own_half;
            first += n;
        }
        let l = Cholesky::new(with)?;
        let value = 0.5 * self.b.dot(&l.solve(&self.b)) - 0.5 * ln_determinant(&l) - half;
        value.is_finite().then_some(value)
    }
}

/// The best by `value` from the present one and from each kind; the present one where none is
/// better. `driven`: whether the DOF has a force at all.
pub fn chosen(
    present: MotionPrior,
    driven: bool,
    value: &dyn Fn(&MotionPrior) -> Option<f64>,
) -> MotionPrior {
    let mut best = optimised(present, driven, value);
    for start in STARTS {
        let drive = if driven { start.drive } else { present.drive };
        let found = optimised(MotionPrior { drive, ..start }, driven, value);
        if found.1 > best.1.map(|b| b + SMALLEST_GAIN) {
            best = found;
        }
    }
    best.0
}

/// Number by number, up and down by a factor, until nothing gains.
fn optimised(
    start: MotionPrior,
    driven: bool,
    value: &dyn Fn(&MotionPrior) -> Option<f64>,
) -> (MotionPrior, Option<f64>) {
    let (mut motion_prior, mut best) = (start, value(&start));
    for _ in 0..ROUNDS {
        let before = motion_prior;
        for part in 0..if driven { 3 } else { 2 } {
            for factor in [FACTOR, 1.0 / FACTOR] {
                let mut moved = false;
                loop {
                    let mut tried = motion_prior;
                    let (number, [low, high]) = match part {
                        0 => (&mut tried.sd, SD),
                        1 => (&mut tried.tau_s, TAU_S),
                        _ => (&mut tried.drive, DRIVE),
                    };
                    *number = (*number * factor).clamp(low, high);
                    if tried == motion_prior {
                        break;
                    }
                    let found = value(&tried);
                    if found <= best.map(|b| b + SMALLEST_GAIN) {
                        break;
                    }
                    (motion_prior, best, moved) = (tried, found, true);
                }
                if moved {
                    break;
                }
            }
        }
        if motion_prior == before {
            break;
        }
    }
    (motion_prior, best)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Two maxima, a wide disturbance and a force: whichever the present one is at, the higher is found.
    #[test]
    fn leaves_the_lower_of_two_maxima() {
        let value = |force_nats: f64| {
            move |w: &MotionPrior| {
                let near = |a: f64, b: f64| (a / b).ln().powi(2);
                let wide = 40.0 - near(w.sd, 1e-2) - 0.1 * near(w.tau_s, 1.0);
                let force = force_nats - near(w.drive, 1e-6) - near(w.sd.max(1e-5), 1e-5);
                Some(wide.max(force))
            }
        };
        let wide = MotionPrior {
            sd: 1e-2,
            tau_s: 1.0,
            drive: 1e-11,
        };
        let force = MotionPrior {
            sd: 1e-5,
            tau_s: 1.0,
            drive: 1e-6,
        };
        for present in [wide, force] {
            assert!(chosen(present, true, &value(100.0)).drive > 1e-7);
            assert!(chosen(present, true, &value(0.0)).sd > 1e-3);
            // A DOF without a force has only the disturbance.
            assert!(chosen(present, false, &value(0.0)).sd > 1e-3);
        }
        // A prior that nothing betters stays as it is.
        assert_eq!(chosen(wide, true, &|_| Some(1.0)), wide);
        assert_eq!(chosen(wide, true, &|_| None), wide);
    }
}
