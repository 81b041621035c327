//! Thrusters, their pulse-to-thrust curves and the link to the controller.

/// Pulse-to-thrust curve: monotonic, piecewise linear between measured points.
#[derive(Debug, Clone, PartialEq)]
pub struct ThrustCurve {
    /// (pulse \[us\], thrust \[N\]), pulse strictly ascending, thrust non-decreasing.
    pub points: Vec<(f64, f64)>,
}

impl ThrustCurve {
    /// Thrust at a pulse \[N\]: linear between points, held beyond the ends.
    pub fn thrust_n(&self, pulse_us: f64) -> f64 {
        self.points.windows(2).fold(
            self.points.first().map_or(0.0, |first| first.1),
            |thrust_n, pair| {
                let ((p0, t0), (p1, t1)) = (pair[0], pair[1]);
                if pulse_us <= p0 {
                    thrust_n
                } else {
                    t0 + (t1 - t0) * ((pulse_us - p0) / (p1 - p0)).min(1.0)
                }
            },
        )
    }

    /// The pulse nearest to `neutral_us` that gives `thrust_n` \[us\]; `None` when the
    /// curve does not reach it. Zero thrust is the neutral pulse itself, anywhere else
    /// the edge of a flat part (deadband) that lies on neutral's side.
    pub fn pulse_us(&self, thrust_n: f64, neutral_us: f64) -> Option<f64> {
        let at_neutral_n = self.thrust_n(neutral_us);
        if thrust_n == 0.0 || thrust_n == at_neutral_n {
            return Some(neutral_us);
        }
        let on_segment = |pair: &[(f64, f64)]| {
            let ((p0, t0), (p1, t1)) = (pair[0], pair[1]);
            ((t0..=t1).contains(&thrust_n) && t1 > t0)
                .then(|| p0 + (p1 - p0) * ((thrust_n - t0) / (t1 - t0)))
        };
        self.points
            .windows(2)
            .filter_map(on_segment)
            .min_by(|a, b| (a - neutral_us).abs().total_cmp(&(b - neutral_us).abs()))
    }

    /// Smallest and largest thrust over the pulses `min_us..=max_us` \[N\].
    pub fn thrust_range_n(&self, min_us: f64, max_us: f64) -> (f64, f64) {
        (self.thrust_n(min_us), self.thrust_n(max_us))
    }
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
