//! A number that depends on where the motion is: a table over one covariate, as data gave it.
//!
//! Values stand at equally spaced points; between them the cubic through four neighbours (Catmull and Rom 1974), beyond
//! the ends the value there. A change of one value is felt within two points of it.

use super::Moment;
use crate::real::Real;

/// Covariates by their names in rig files: pose in the tank frame, rates over ground in the body frame, time since the
/// log's first stamp, load commanded in the DOF.
pub const COVARIATES: &[&str] = &[
    "x", "y", "z", "phi", "theta", "psi", "u", "v", "w", "p", "q", "r", "t", "load",
];

/// Points of a table.
pub const POINTS: usize = 40;

/// What a covariate is at a moment; `dof` = whose load.
pub(super) fn covariate<T: Real>(m: &Moment<'_, T>, covariate: usize, dof: usize) -> T {
    match covariate {
        0..6 => m.eta[covariate],
        6..12 => m.nu[covariate - 6],
        12 => m.t_s,
        _ => m.load[dof],
    }
}

/// The table's value at a place.
///
/// `range` = covariate at the first and the last point.
pub fn interpolated<T: Real>(values: &[T], range: (f64, f64), at: T) -> T {
    let last = values.len().saturating_sub(1);
    let span = range.1 - range.0;
    if last == 0 || span.is_nan() || span <= 0.0 {
        return values.first().copied().unwrap_or(T::zero());
    }
    let place = (at - T::from_f64(range.0)) * (last as f64 / span);
    if place.value().is_nan() || place.value() <= 0.0 {
        return values[0];
    }
    if place.value() >= last as f64 {
        return values[last];
    }
    let i = (place.value() as usize).min(last - 1);
    let s = place - T::from_f64(i as f64);
    let (p1, p2) = (values[i], values[i + 1]);
    // Beyond the ends the table goes on as a straight line: no point is asked for that is not there.
    let p0 = if i > 0 { values[i - 1] } else { p1 * 2.0 - p2 };
    let p3 = if i + 2 <= last {
        values[i + 2]
    } else {
        p2 * 2.0 - p1
    };
    let a = (p1 - p2) * 3.0 + p3 - p0;
    let b = p0 * 2.0 - p1 * 5.0 + p2 * 4.0 - p3;
    p1 + s * (p2 - p0 + s * (b + s * a)) * 0.5
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn a_table_gives_its_values_at_its_points_and_follows_a_smooth_law() {
        let law = |x: f64| (2.0 * x).sin();
        let values: Vec<f64> = (0..POINTS)
            .map(|k| law(-1.0 + 3.0 * k as f64 / (POINTS - 1) as f64))
            .collect();
        for k in 0..200 {
            let x = -1.0 + 0.015 * f64::from(k);
            let off = interpolated(&values, (-1.0, 2.0), x) - law(x);
            // The first and the last gap have a neighbour less.
            let within = (10..190).contains(&k);
            assert!(off.abs() < if within { 1e-4 } else { 2e-3 }, "{x} {off}");
        }
        assert_eq!(interpolated(&values, (-1.0, 2.0), -5.0), values[0]);
        assert_eq!(interpolated(&values, (-1.0, 2.0), 5.0), values[POINTS - 1]);
        assert_eq!(interpolated(&values, (1.0, 1.0), 5.0), values[0]);
    }

    proptest! {
        /// Linear in the values, so that amplitudes can be integrated out exactly.
        #[test]
        fn it_is_linear_in_its_values(a in prop::collection::vec(-3.0..3.0f64, 8), b in prop::collection::vec(-3.0..3.0f64, 8), x in -1.0..9.0f64) {
            let sum: Vec<f64> = a.iter().zip(&b).map(|(a, b)| a + 2.0 * b).collect();
            let each = |v: &[f64]| interpolated(v, (0.0, 7.0), x);
            prop_assert!((each(&sum) - each(&a) - 2.0 * each(&b)).abs() < 1e-12);
        }
    }
}
