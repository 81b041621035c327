//! Thrusters, their pulse-to-thrust curves and the link to the controller.

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
}

/// What a bollard pull left behind: how well the thrust curve is known.
#[derive(Debug, Clone, PartialEq)]
pub struct BollardPull {
    /// Supply that the curve holds at \[V\]; 0 = not measured.
    pub voltage_v: f64,
    /// Scatter of the readings about the curve \[N\].
    pub scatter_n: f64,
    /// Pulses of the curve's points \[us\], ascending.
    pub pulse_us: Vec<f64>,
    /// Covariance of the thrusts at these pulses \[N²\], one row per pulse.
    pub covariance_n2: Vec<Vec<f64>>,
}

/// One thruster.
#[derive(Debug, Clone, PartialEq)]
pub struct Thruster {
    /// Name used in plans and logs.
    pub name: String,
    /// Controller channel.
    pub channel: u8,
    /// Position in the body frame \[m\].
    pub position_m: [f64; 3],
    /// Unit vector of positive thrust in the body frame.
    pub direction: [f64; 3],
    /// Pulse to thrust.
    pub curve: ThrustCurve,
}

/// Protocol on the wire.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum LinkKind {
    /// Pololu Maestro compact protocol.
    Maestro,
    /// Our own framed protocol with controller time stamps.
    Stamped,
}

/// Where the controller is.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum LinkPort {
    /// A simulated controller on a pseudo-terminal, driving the simulated vehicle.
    Sim,
    /// `/dev/serial/by-id/<name>` (or matched by USB vendor/product/serial where udev is absent).
    ById(String),
    /// `/dev/serial/by-path/<name>`.
    ByPath(String),
    /// `/dev/ttyX`: not stable, accepted only with `allow_unstable_node = true`.
    Node(std::path::PathBuf),
}

/// The link to the controller.
#[derive(Debug, Clone, PartialEq)]
pub struct Link {
    /// Protocol.
    pub kind: LinkKind,
    /// Port.
    pub port: LinkPort,
    /// Baud rate \[bit/s\].
    pub baud: u32,
    /// Command rate \[1/s\].
    pub rate_hz: f64,
    /// A command later than this after its due time counts as a missed deadline: neutral \[s\].
    pub deadline_s: f64,
    /// No answer for this long = link lost: neutral \[s\].
    pub timeout_s: f64,
}

/// All thrusters of a rig.
#[derive(Debug, Clone, PartialEq)]
pub struct ThrusterSet {
    /// The link.
    pub link: Link,
    /// Thrusters; the order is the order of channels in logs.
    pub thrusters: Vec<Thruster>,
    /// Neutral pulse \[us\] (1500).
    pub neutral_us: f64,
    /// Smallest pulse allowed \[us\] (1100).
    pub min_us: f64,
    /// Largest pulse allowed \[us\] (1900).
    pub max_us: f64,
    /// Largest change of pulse allowed \[us/s\].
    pub max_slew_us_per_s: f64,
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
