//! Pulse to thrust and back: the rig's monotonic, piecewise-linear curve.

use hydroline_rigs::ThrustCurve;

/// Why a thrust has no pulse.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum CurveError {
    /// Beyond the measured ends.
    #[error(
        "thrust {thrust_n} N is outside the curve's {min_n}..{max_n} N: lower the plan or measure the curve further"
    )]
    OutOfRange {
        /// Asked \[N\].
        thrust_n: f64,
        /// Smallest thrust of the curve \[N\].
        min_n: f64,
        /// Largest thrust of the curve \[N\].
        max_n: f64,
    },
    /// No points, or NaN asked.
    #[error("thrust {thrust_n} N has no pulse: the curve has {points} points")]
    Unusable {
        /// Asked \[N\].
        thrust_n: f64,
        /// Points of the curve.
        points: usize,
    },
}

/// Pulse width \[us\] that gives `thrust_n` \[N\].
///
/// Where the curve is flat (dead band) several pulses give the same thrust; the one nearest to
/// `neutral_us` is returned, so that zero thrust is neutral itself wherever the curve allows it.
///
/// # Errors
/// [`CurveError`] when the thrust lies beyond the curve's ends.
pub fn pulse_for_thrust(
    curve: &ThrustCurve,
    neutral_us: f64,
    thrust_n: f64,
) -> Result<f64, CurveError> {
    let points = &curve.points;
    let (Some(first), Some(last)) = (points.first(), points.last()) else {
        return Err(CurveError::Unusable {
            thrust_n,
            points: 0,
        });
    };
    if thrust_n.is_nan() {
        return Err(CurveError::Unusable {
            thrust_n,
            points: points.len(),
        });
    }
    if thrust_n < first.1 || thrust_n > last.1 {
        return Err(CurveError::OutOfRange {
            thrust_n,
            min_n: first.1,
            max_n: last.1,
        });
    }
    // All pulses with this thrust form one interval [low, high], because the curve is non-decreasing.
    let below = points.partition_point(|p| p.1 < thrust_n);
    let above = points.partition_point(|p| p.1 <= thrust_n);
    let cross = |right: usize| -> f64 {
        let (p0, t0) = points[right - 1];
        let (p1, t1) = points[right];
        p0 + (p1 - p0) * (thrust_n - t0) / (t1 - t0)
    };
    if below == above {
        // Strictly between two points (below >= 1 because thrust >= first).
        return Ok(cross(below));
    }
    let (low_us, high_us) = (points[below].0, points[above - 1].0);
    Ok(neutral_us.clamp(low_us, high_us))
}

/// Thrust \[N\] at a pulse \[us\]; beyond the ends the end's thrust, 0 without points.
pub fn thrust_for_pulse(curve: &ThrustCurve, pulse_us: f64) -> f64 {
    let points = &curve.points;
    let (Some(first), Some(last)) = (points.first(), points.last()) else {
        return 0.0;
    };
    if pulse_us <= first.0 {
        return first.1;
    }
    if pulse_us >= last.0 || pulse_us.is_nan() {
        return last.1;
    }
    let right = points.partition_point(|p| p.0 <= pulse_us);
    let (p0, t0) = points[right - 1];
    let (p1, t1) = points[right];
    t0 + (t1 - t0) * (pulse_us - p0) / (p1 - p0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn t200() -> ThrustCurve {
        ThrustCurve {
            points: vec![
                (1100.0, -39.9),
                (1300.0, -15.0),
                (1470.0, 0.0),
                (1530.0, 0.0),
                (1700.0, 18.0),
                (1900.0, 51.5),
            ],
        }
    }

    #[test]
    fn zero_thrust_is_neutral_and_the_ends_are_reached() {
        assert_eq!(pulse_for_thrust(&t200(), 1500.0, 0.0), Ok(1500.0));
        assert_eq!(pulse_for_thrust(&t200(), 1400.0, 0.0), Ok(1470.0));
        assert_eq!(pulse_for_thrust(&t200(), 1500.0, 51.5), Ok(1900.0));
        assert_eq!(pulse_for_thrust(&t200(), 1500.0, -39.9), Ok(1100.0));
        assert_eq!(pulse_for_thrust(&t200(), 1500.0, 9.0), Ok(1615.0));
    }

    #[test]
    fn beyond_the_ends_is_an_error_with_the_range() {
        let error = pulse_for_thrust(&t200(), 1500.0, 60.0).unwrap_err();
        assert_eq!(
            error,
            CurveError::OutOfRange {
                thrust_n: 60.0,
                min_n: -39.9,
                max_n: 51.5
            }
        );
        assert!(pulse_for_thrust(&t200(), 1500.0, f64::NAN).is_err());
        assert!(pulse_for_thrust(&ThrustCurve { points: vec![] }, 1500.0, 0.0).is_err());
    }

    proptest! {
        #[test]
        fn inverse_then_curve_is_identity(
            steps in prop::collection::vec((1.0f64..100.0, 0.0f64..10.0), 1..12),
            at in 0.0f64..=1.0, neutral in 1000.0f64..2000.0,
        ) {
            let (mut pulse, mut thrust) = (1000.0, -20.0);
            let mut points = vec![(pulse, thrust)];
            for (dp, dt) in steps {
                pulse += dp;
                thrust += dt;
                points.push((pulse, thrust));
            }
            let wanted = -20.0 + at * (thrust + 20.0);
            let curve = ThrustCurve { points };
            let pulse = pulse_for_thrust(&curve, neutral, wanted).unwrap();
            prop_assert!((thrust_for_pulse(&curve, pulse) - wanted).abs() < 1e-9);
        }
    }
}
