//! Pulse to thrust and back: the rig's monotonic, piecewise-linear curve.

use hydroline_rigs::ThrustCurve;

/// Reason why a thrust has no pulse.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[allow(missing_docs)] // Each message names its fields.
pub enum CurveError {
    #[error(
        "thrust {thrust_n} N is outside the curve's {min_n}..{max_n} N: lower the plan or measure the curve further"
    )]
    OutOfRange {
        thrust_n: f64,
        min_n: f64,
        max_n: f64,
    },
    /// No points, or NaN asked.
    #[error("thrust {thrust_n} N has no pulse: the curve has {points} points")]
    Unusable { thrust_n: f64, points: usize },
}

/// Pulse width \[us\] that gives `thrust_n` \[N\], as [`ThrustCurve::pulse_us`], with words where there is none.
///
/// # Errors
/// [`CurveError`] when the thrust lies beyond the curve's ends.
pub fn pulse_for_thrust(
    curve: &ThrustCurve,
    neutral_us: f64,
    thrust_n: f64,
) -> Result<f64, CurveError> {
    curve.pulse_us(thrust_n, neutral_us).ok_or_else(|| {
        match (curve.points.first(), curve.points.last()) {
            (Some(first), Some(last)) if !thrust_n.is_nan() => CurveError::OutOfRange {
                thrust_n,
                min_n: first.1,
                max_n: last.1,
            },
            _ => CurveError::Unusable {
                thrust_n,
                points: curve.points.len(),
            },
        }
    })
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
        // Zero thrust is neutral whatever the curve says: a checked rig's curve holds ~0 N there.
        assert_eq!(pulse_for_thrust(&t200(), 1400.0, 0.0), Ok(1400.0));
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
            prop_assert!((curve.thrust_n(pulse) - wanted).abs() < 1e-9);
        }
    }
}
