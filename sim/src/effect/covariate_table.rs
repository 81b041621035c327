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

/// Value of a covariate at a moment; `dof` = whose load.
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
    T::looked_up(values, range, at)
}

/// The cubic of [`interpolated`], computed.
pub fn cubic<T: Real>(values: &[T], range: (f64, f64), at: T) -> T {
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
    let s = place.value() - i as f64;
    // Weights of the four neighbours and their derivatives by the place.
    let mut weights = [
        0.5 * s * (-1.0 + s * (2.0 - s)),
        1.0 + 0.5 * s * s * (-5.0 + 3.0 * s),
        0.5 * s * (1.0 + s * (4.0 - 3.0 * s)),
        0.5 * s * s * (s - 1.0),
    ];
    let mut slopes = [
        0.5 * (-1.0 + s * (4.0 - 3.0 * s)),
        0.5 * s * (-10.0 + 9.0 * s),
        0.5 * (1.0 + s * (8.0 - 9.0 * s)),
        0.5 * s * (3.0 * s - 2.0),
    ];
    // Beyond the ends the table goes on as a straight line: no point is asked for that is not there.
    for own in [&mut weights, &mut slopes] {
        if i == 0 {
            own[1] += 2.0 * own[0];
            own[2] -= own[0];
        }
        if i + 2 > last {
            own[2] += 2.0 * own[3];
            own[1] -= own[3];
        }
    }
    let (from, skip) = if i == 0 { (0, 1) } else { (i - 1, 0) };
    let near = &values[from..values.len().min(i + 3)];
    let slope: f64 = near
        .iter()
        .zip(&slopes[skip..])
        .map(|(v, w)| v.value() * w)
        .sum();
    T::weighted(near, &weights[skip..]) + (place - T::from_f64(place.value())) * slope
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dual::Dual;
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
        /// Derivatives by place and by values are those of the table's own numbers, the first and the last gap included.
        #[test]
        fn it_is_differentiated(v in prop::collection::vec(-3.0..3.0f64, 5), x in 0.01..3.99f64) {
            let duals: Vec<Dual<6>> = v.iter().enumerate().map(|(i, v)| Dual::variable(*v, i)).collect();
            let made = interpolated(&duals, (0.0, 4.0), Dual::variable(x, 5));
            prop_assert_eq!(made.value, interpolated(&v, (0.0, 4.0), x));
            let h = 1e-5;
            for (i, slope) in made.slope.iter().enumerate() {
                let at = |h: f64| {
                    let mut moved = v.clone();
                    if let Some(own) = moved.get_mut(i) {
                        *own += h;
                    }
                    interpolated(&moved, (0.0, 4.0), if i == 5 { x + h } else { x })
                };
                prop_assert!((slope - (at(h) - at(-h)) / (2.0 * h)).abs() < 1e-3, "{i} {slope}");
            }
        }

        /// Linear in the values, so that amplitudes can be integrated out exactly.
        #[test]
        fn it_is_linear_in_its_values(a in prop::collection::vec(-3.0..3.0f64, 8), b in prop::collection::vec(-3.0..3.0f64, 8), x in -1.0..9.0f64) {
            let sum: Vec<f64> = a.iter().zip(&b).map(|(a, b)| a + 2.0 * b).collect();
            let each = |v: &[f64]| interpolated(v, (0.0, 7.0), x);
            prop_assert!((each(&sum) - each(&a) - 2.0 * each(&b)).abs() < 1e-12);
        }
    }
}
