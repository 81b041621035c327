//! Piecewise linear pulse-to-thrust curve and its inverse.

use hydroline_rigs::ThrustCurve;

/// Thrust \[N\] at a pulse \[us\]; beyond the measured ends the end's thrust (nothing is extrapolated).
pub fn thrust_n(curve: &ThrustCurve, pulse_us: f64) -> f64 {
    interpolate(&curve.points, pulse_us, |p| p.0, |p| p.1)
}

/// Pulse \[us\] for a thrust \[N\]; beyond the ends the end's pulse.
///
/// On a flat piece (the deadband around neutral) every pulse gives the same thrust: the one
/// closest to `neutral_us` is taken, so that "no thrust" means the neutral pulse.
pub fn pulse_us(curve: &ThrustCurve, thrust_n: f64, neutral_us: f64) -> f64 {
    let points = &curve.points;
    let low = points.partition_point(|p| p.1 < thrust_n);
    let high = points.partition_point(|p| p.1 <= thrust_n);
    if high > low {
        // points[low..high] all have exactly this thrust.
        return neutral_us.clamp(points[low].0, points[high - 1].0);
    }
    interpolate(points, thrust_n, |p| p.1, |p| p.0)
}

fn interpolate(
    points: &[(f64, f64)],
    at: f64,
    x: impl Fn(&(f64, f64)) -> f64,
    y: impl Fn(&(f64, f64)) -> f64,
) -> f64 {
    let above = points.partition_point(|p| x(p) < at);
    match (
        above.checked_sub(1).and_then(|i| points.get(i)),
        points.get(above),
    ) {
        (Some(a), Some(b)) => y(a) + (y(b) - y(a)) * (at - x(a)) / (x(b) - x(a)),
        (Some(end), None) | (None, Some(end)) => y(end),
        (None, None) => 0.0,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn t200() -> ThrustCurve {
        crate::fixture::t200_curve()
    }

    #[test]
    fn ends_are_held_and_the_flat_piece_maps_to_neutral() {
        let c = t200();
        assert_eq!(thrust_n(&c, 500.0), -39.9);
        assert_eq!(thrust_n(&c, 2500.0), 51.5);
        assert_eq!(thrust_n(&c, 1510.0), 0.0);
        assert_eq!(pulse_us(&c, 0.0, 1500.0), 1500.0);
        assert_eq!(pulse_us(&c, 99.0, 1500.0), 1900.0);
        assert_eq!(pulse_us(&c, -99.0, 1500.0), 1100.0);
    }

    proptest! {
        #[test]
        fn the_inverse_is_an_inverse(thrust in -39.9..51.5f64) {
            let c = t200();
            let pulse = pulse_us(&c, thrust, 1500.0);
            prop_assert!((1100.0..=1900.0).contains(&pulse));
            prop_assert!((thrust_n(&c, pulse) - thrust).abs() < 1e-9);
        }

        #[test]
        fn more_thrust_never_needs_a_smaller_pulse(a in -60.0..60.0f64, b in -60.0..60.0f64) {
            let c = t200();
            let (low, high) = (a.min(b), a.max(b));
            prop_assert!(pulse_us(&c, low, 1500.0) <= pulse_us(&c, high, 1500.0));
        }
    }
}
