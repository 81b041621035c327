//! Plan files: the commands of the thrusters, step by step.

mod check;
mod evaluate;

/// A wrench in the body frame at the CG \[N, N m\], SNAME order.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Wrench {
    /// X \[N\].
    pub surge_n: f64,
    /// Y \[N\].
    pub sway_n: f64,
    /// Z \[N\].
    pub heave_n: f64,
    /// K \[N m\].
    pub roll_nm: f64,
    /// M \[N m\].
    pub pitch_nm: f64,
    /// N \[N m\].
    pub yaw_nm: f64,
}

impl Wrench {
    /// Names of the components in files, SNAME order.
    pub const KEYS: [&'static str; 6] = [
        "surge_n", "sway_n", "heave_n", "roll_nm", "pitch_nm", "yaw_nm",
    ];

    /// The components in SNAME order \[N, N m\].
    pub fn to_array(self) -> [f64; 6] {
        [
            self.surge_n,
            self.sway_n,
            self.heave_n,
            self.roll_nm,
            self.pitch_nm,
            self.yaw_nm,
        ]
    }

    /// From components in SNAME order \[N, N m\].
    pub fn from_array([surge_n, sway_n, heave_n, roll_nm, pitch_nm, yaw_nm]: [f64; 6]) -> Self {
        Wrench {
            surge_n,
            sway_n,
            heave_n,
            roll_nm,
            pitch_nm,
            yaw_nm,
        }
    }
}

/// How a step's load evolves over its duration.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Shape {
    /// Constant.
    Hold,
    /// Linear from the previous step's final load to this one.
    Ramp,
    /// load * sin(2 pi t / period_s + phase_rad), t from the step's start.
    Sine {
        /// Period \[s\].
        period_s: f64,
        /// Phase \[rad\].
        phase_rad: f64,
    },
    /// load * sin of a linear sweep from f0_hz to f1_hz over the step.
    Chirp {
        /// Start frequency \[Hz\].
        f0_hz: f64,
        /// End frequency \[Hz\].
        f1_hz: f64,
    },
}

/// What a step commands.
#[derive(Debug, Clone, PartialEq)]
pub enum StepLoad {
    /// A body wrench, allocated over the thrusters.
    Wrench(Wrench),
    /// Thrust per thruster name \[N\]; unnamed thrusters get 0.
    ThrustN(Vec<(String, f64)>),
}

/// One `[[step]]`.
#[derive(Debug, Clone, PartialEq)]
pub struct PlanStep {
    /// Duration \[s\].
    pub for_s: f64,
    /// Load at full scale.
    pub load: StepLoad,
    /// Shape over the step.
    pub shape: Shape,
}

/// A checked plan.
#[derive(Debug, Clone, PartialEq)]
pub struct Plan {
    /// Short name.
    pub name: String,
    /// Steps in order; after the last the load is zero.
    pub steps: Vec<PlanStep>,
    /// The plan as typed, for the log.
    pub source_toml: String,
}

impl Plan {
    /// Planned length \[s\].
    pub fn duration_s(&self) -> f64 {
        self.steps.iter().map(|s| s.for_s).sum()
    }
}
