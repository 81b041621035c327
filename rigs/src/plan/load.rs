//! The load of a step: a wrench, or thrust by thruster.

use crate::raw::{Described, Kind, Section, Table, Writer, is_name, number};

table! {
    /// Load on the body, in the body frame about the CG; what is omitted is 0, `wrench = {}` is a pause.
    ///
    /// A wrench at the CG, SNAME order.
    pub struct Wrench: Copy, Default as WrenchTyped {
        /// Force forward.
        pub surge_n: f64 = number(-1e5, 1e5, "N").or(0.0),
        /// Force to starboard.
        pub sway_n: f64 = number(-1e5, 1e5, "N").or(0.0),
        /// Force down.
        pub heave_n: f64 = number(-1e5, 1e5, "N").or(0.0),
        /// Moment about x, starboard side down.
        pub roll_nm: f64 = number(-1e5, 1e5, "N m").or(0.0),
        /// Moment about y, bow up.
        pub pitch_nm: f64 = number(-1e5, 1e5, "N m").or(0.0),
        /// Moment about z, bow to starboard.
        pub yaw_nm: f64 = number(-1e5, 1e5, "N m").or(0.0),
    }
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

/// Load that a step commands.
#[derive(Debug, Clone, PartialEq)]
pub enum StepLoad {
    /// A body wrench, allocated over the thrusters.
    Wrench(Wrench),
    /// Thrust per thruster name \[N\]; unnamed thrusters get 0.
    ThrustN(Vec<(String, f64)>),
}

/// `wrench` or `thrust_n`, one of the two.
pub(super) struct Load;

impl Kind for Load {
    type Value = StepLoad;

    fn typed(&self, s: &Section<'_>, _: &str) -> Option<Option<StepLoad>> {
        match (s.item("wrench"), s.item("thrust_n")) {
            (Some(_), Some(_)) => {
                s.rule(
                    "thrust_n",
                    "wrench and thrust_n are both given",
                    "Keep one of the two",
                );
                None
            }
            (None, None) => Some(None),
            (Some(_), None) => Some(Some(StepLoad::Wrench(Wrench::read(&s.table("wrench"))?))),
            (None, Some(_)) => Some(Some(StepLoad::ThrustN(thrusts(&s.table("thrust_n"))?))),
        }
    }

    fn left_out(&self, s: &Section<'_>, _: &str) -> Option<StepLoad> {
        s.missing(
            "wrench",
            "`wrench = { surge_n = … }` or `thrust_n = { NAME = … }`; a pause is `wrench = {}`",
        );
        None
    }

    fn write(&self, w: &mut Writer, _: &str, value: &StepLoad) {
        match value {
            StepLoad::Wrench(wrench) => {
                let named = Wrench::KEYS.into_iter().zip(wrench.to_array());
                w.inline("wrench", named.filter(|(_, value)| *value != 0.0));
            }
            StepLoad::ThrustN(thrusts) => {
                let named = thrusts.iter().map(|(name, value)| (name.as_str(), *value));
                w.inline("thrust_n", named);
            }
        }
    }

    fn describe(&self, to: &mut Described<'_>, _: &str, _: &'static str) {
        to.table::<Wrench>("wrench", Wrench::describe_keys);
        to.table::<Thrusts>("thrust_n", Thrusts::describe_keys);
    }
}

table! {
    /// Thrust in N of single thrusters, by their names in the rig; those omitted are at 0.
    struct Thrusts as ThrustsTyped {}
}

fn thrusts(s: &Section<'_>) -> Option<Vec<(String, f64)>> {
    let mut thrusts = Vec::new();
    let mut sound = true;
    // Any name may stand here; a rig decides which exist (Plan::check_against).
    for (name, item) in s.entries() {
        if !is_name(&name) {
            s.wrong_type(
                &item,
                "under the name of a thruster: letters, digits, `_`, `-` or `.`",
            );
            sound = false;
        }
        match s.number_of(&item, &number(-1e4, 1e4, "N")) {
            Some(thrust_n) => thrusts.push((name, thrust_n)),
            None => sound = false,
        }
    }
    sound.then_some(thrusts)
}
