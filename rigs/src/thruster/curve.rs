//! The pulse-to-thrust curve.

use crate::raw::{Item, One, Section, number, one};

/// Pulse-to-thrust curve: monotonic, piecewise linear between measured points.
#[derive(Debug, Clone, PartialEq)]
pub struct ThrustCurve {
    /// (pulse \[us\], thrust \[N\]), pulse strictly ascending, thrust non-decreasing.
    pub points: Vec<(f64, f64)>,
}

impl ThrustCurve {
    /// Thrust at a pulse \[N\]: linear between points, held beyond the ends, 0 without points.
    pub fn thrust_n(&self, pulse_us: f64) -> f64 {
        let points = &self.points;
        let above = points.partition_point(|p| p.0 < pulse_us);
        match (above.checked_sub(1).map(|i| points[i]), points.get(above)) {
            (Some((p0, t0)), Some((p1, t1))) => t0 + (t1 - t0) * ((pulse_us - p0) / (p1 - p0)),
            (Some((_, end_n)), None) => end_n,
            (None, Some((_, end_n))) => *end_n,
            (None, None) => 0.0,
        }
    }

    /// The pulse nearest to `neutral_us` that gives `thrust_n` \[us\]; `None` when the curve does not
    /// reach it. Zero thrust is the neutral pulse itself; where the curve is flat elsewhere it is the
    /// edge on neutral's side.
    pub fn pulse_us(&self, thrust_n: f64, neutral_us: f64) -> Option<f64> {
        let points = &self.points;
        if thrust_n == 0.0 && !points.is_empty() {
            return Some(neutral_us);
        }
        // All pulses with this thrust form one interval, because the curve never falls.
        let below = points.partition_point(|p| p.1 < thrust_n);
        let upto = points.partition_point(|p| p.1 <= thrust_n);
        if upto > below {
            return Some(neutral_us.clamp(points[below].0, points[upto - 1].0));
        }
        let (&(p0, t0), &(p1, t1)) = (points.get(below.checked_sub(1)?)?, points.get(below)?);
        (!thrust_n.is_nan()).then(|| p0 + (p1 - p0) * ((thrust_n - t0) / (t1 - t0)))
    }

    /// Smallest and largest thrust over the pulses `min_us..=max_us` \[N\].
    pub fn thrust_range_n(&self, min_us: f64, max_us: f64) -> (f64, f64) {
        (self.thrust_n(min_us), self.thrust_n(max_us))
    }

    /// Its first and last pulse \[us\]; 0 without points.
    pub(super) fn ends_us(&self) -> [f64; 2] {
        [self.points.first(), self.points.last()].map(|point| point.map_or(0.0, |p| p.0))
    }
}

/// Expected form of the list of points, for messages.
const POINTS: &str = "a list of at least two points [pulse_us, thrust_n]";

/// The points of a curve, as a list of pairs.
pub(super) fn points() -> One<ThrustCurve> {
    let columns = [
        "points [us, N]",
        "at least two, pulses 500 to 2500 rising, thrusts -10000 to 10000 never falling; from `min_us` to `max_us`, no thrust at `neutral_us`",
    ];
    one(
        "[[pulse_us, thrust_n], …]",
        POINTS,
        columns,
        read,
        |w, key, curve| {
            let points: Vec<[f64; 2]> = curve.points.iter().map(|&(p, t)| [p, t]).collect();
            w.debug(key, points);
        },
    )
}

fn read<'d>(s: &Section<'d>, item: &Item<'d>) -> Option<ThrustCurve> {
    let mut points: Vec<(f64, f64)> = Vec::new();
    let mut sound = true;
    for element in &s.elements(item, POINTS)? {
        let Some((p, t)) = point(s, element) else {
            sound = false;
            continue;
        };
        let wrong = points.last().and_then(|&(p0, t0)| falls([p0, t0], [p, t]));
        if let Some((what, next)) = wrong {
            s.rule_at(element, what, next);
            sound = false;
        }
        points.push((p, t));
    }
    if sound && points.len() < 2 {
        s.wrong_type(item, POINTS);
        sound = false;
    }
    sound.then_some(ThrustCurve { points })
}

fn point<'d>(s: &Section<'d>, element: &Item<'d>) -> Option<(f64, f64)> {
    let expected = "a point [pulse_us, thrust_n]";
    let pair = s.elements(element, expected)?;
    let [pulse, thrust] = pair.as_slice() else {
        s.wrong_type(element, expected);
        return None;
    };
    let pulse_us = s.number_of(pulse, &number(500.0, 2500.0, "us"));
    pulse_us.zip(s.number_of(thrust, &number(-1e4, 1e4, "N")))
}

/// Fault between a point and the next, with its cure; `None` = sound.
fn falls([p0, t0]: [f64; 2], [p, t]: [f64; 2]) -> Option<(String, &'static str)> {
    if p <= p0 {
        Some((
            format!("pulse {p} us does not exceed the one before, {p0} us"),
            "List the points by strictly ascending pulse",
        ))
    } else if t < t0 {
        Some((
            format!("thrust {t} N falls below the one before, {t0} N"),
            "Thrust must not fall with rising pulse; for a propeller mounted the other way turn `direction` round",
        ))
    } else {
        None
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Rig;
    use proptest::prelude::*;
    use proptest::test_runner::RngSeed;

    fn curve() -> ThrustCurve {
        let rig = Rig::builtin("lshpi").unwrap();
        rig.thrusters.thrusters[0].curve.clone()
    }

    proptest! {
    #![proptest_config(ProptestConfig { rng_seed: RngSeed::Fixed(1), failure_persistence: None, ..ProptestConfig::default() })]

        /// Thrust to pulse and back, over the whole curve; the pulse lies on neutral's
        /// side of the deadband that the thrust asks for.
        #[test]
        fn pulse_and_thrust_are_inverse(thrust_n in -39.9..51.5_f64) {
            let pulse_us = curve().pulse_us(thrust_n, 1500.0).unwrap();
            prop_assert!((curve().thrust_n(pulse_us) - thrust_n).abs() < 1e-9);
            prop_assert!((pulse_us - 1500.0) * thrust_n >= 0.0);
            prop_assert!(pulse_us <= 1468.0 || pulse_us >= 1532.0);
        }

        #[test]
        fn thrust_never_falls_with_the_pulse(a in 1000.0..2000.0_f64, b in 1000.0..2000.0_f64) {
            prop_assert!((curve().thrust_n(b) - curve().thrust_n(a)) * (b - a) >= 0.0);
        }
    }

    #[test]
    fn points_are_met_and_ends_are_held() {
        for (pulse_us, thrust_n) in curve().points {
            assert!((curve().thrust_n(pulse_us) - thrust_n).abs() < 1e-12);
        }
        assert_eq!(
            (curve().thrust_n(0.0), curve().thrust_n(9e9)),
            (-39.9, 51.5)
        );
        assert_eq!(curve().thrust_range_n(1100.0, 1500.0), (-39.9, 0.0));
        // Half way between two points.
        assert!((curve().thrust_n(1850.0) - 0.5 * (33.12 + 51.5)).abs() < 1e-12);
    }

    #[test]
    fn zero_is_neutral_and_nothing_reaches_beyond_the_curve() {
        assert_eq!(curve().pulse_us(0.0, 1500.0), Some(1500.0));
        assert_eq!(curve().pulse_us(51.6, 1500.0), None);
        assert_eq!(curve().pulse_us(-40.0, 1500.0), None);
        assert_eq!(curve().pulse_us(f64::NAN, 1500.0), None);
    }
}
