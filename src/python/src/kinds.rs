//! Messages that become tables, and the columns of each kind.

use crate::columns::{Columns, Table};
use hydroline_core::event::Severity;
use hydroline_log::Topic;
use hydroline_log::messages::{self, pb};

/// Numbers of a pose's covariance: 6 x 6 of (x y z phi theta psi), row by row.
const COVARIANCE: usize = 36;
/// Columns of a pose's standard deviations, in the order of the covariance.
const POSE_SD: [&str; 6] = [
    "x_sd_m",
    "y_sd_m",
    "z_sd_m",
    "phi_sd_rad",
    "theta_sd_rad",
    "psi_sd_rad",
];

/// Columns of the standard deviations of its own error, without what all poses of a calibration share.
const POSE_OWN_SD: [&str; 6] = [
    "x_own_sd_m",
    "y_own_sd_m",
    "z_own_sd_m",
    "phi_own_sd_rad",
    "theta_own_sd_rad",
    "psi_own_sd_rad",
];

/// A kind of message that becomes a table.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Kind {
    Motion,
    Truth,
    Commands,
    Echoes,
    Stripes,
    Events,
}

impl Kind {
    /// Kinds that are read at once when one of them is asked for: whoever wants the motion wants the commands, and they
    /// lie in the same chunks.
    pub fn together(self) -> &'static [Kind] {
        match self {
            Kind::Motion | Kind::Commands => &[Kind::Motion, Kind::Commands],
            Kind::Truth => &[Kind::Truth],
            Kind::Echoes => &[Kind::Echoes],
            Kind::Stripes => &[Kind::Stripes],
            Kind::Events => &[Kind::Events],
        }
    }

    /// Its topic.
    pub fn topic(self) -> Topic {
        match self {
            Kind::Motion => Topic::Motion,
            Kind::Truth => Topic::Truth,
            Kind::Commands => Topic::Command,
            Kind::Echoes => Topic::Echo,
            Kind::Stripes => Topic::Profile,
            Kind::Events => Topic::Event,
        }
    }

    /// Its columns, still empty.
    pub fn table(self) -> Box<dyn Table> {
        match self {
            Kind::Motion | Kind::Truth => Box::new(motion()),
            Kind::Commands => Box::new(commands()),
            Kind::Echoes => Box::new(echoes()),
            Kind::Stripes => Box::new(stripes()),
            Kind::Events => Box::new(events()),
        }
    }
}

fn motion() -> Columns<pb::VehicleMotion> {
    let mut columns = Columns::stamped();
    macro_rules! numbers {
        ($($name:ident)+) => { $(columns.f64s(stringify!($name), |m: &pb::VehicleMotion| m.$name);)+ };
    }
    numbers!(x_m y_m z_m phi_rad theta_rad psi_rad u_mps v_mps w_mps p_radps q_radps r_radps);
    for (k, name) in POSE_SD.into_iter().enumerate() {
        columns.f64s(name, move |m| {
            let known = m.covariance.len() == COVARIANCE;
            known.then(|| m.covariance[7 * k].sqrt())
        });
    }
    for (k, name) in POSE_OWN_SD.into_iter().enumerate() {
        columns.f64s(name, move |m| {
            m.own_covariance().map(|own| own[7 * k].max(0.0).sqrt())
        });
    }
    columns.fixed_lists("covariance", COVARIANCE, |m| &m.covariance);
    numbers!(rudder_rad elevator_rad shaft_radps wave_m);
    columns
}

fn commands() -> Columns<pb::ThrusterCommand> {
    let mut columns = Columns::stamped();
    columns.u32s("sequence", |m: &pb::ThrusterCommand| m.sequence);
    columns.texts("thruster", |m| &m.thruster);
    columns.f64s("thrust_n", |m| Some(m.thrust_n));
    columns.f64s("pulse_us", |m| Some(m.pulse_us));
    columns.u64s("due_ns", |m| m.due_ns);
    columns.u32s("plan_step", |m| m.plan_step);
    columns.texts("cause", |m| &m.cause);
    columns
}

fn echoes() -> Columns<pb::ThrusterEcho> {
    let mut columns = Columns::stamped();
    columns.u32s("sequence", |m: &pb::ThrusterEcho| m.sequence);
    columns.texts("thruster", |m| &m.thruster);
    columns.f64s("pulse_us", |m| Some(m.pulse_us));
    columns.u64s("controller_time_us", |m| m.controller_time_us);
    columns.f64s("round_trip_s", |m| Some(m.round_trip_s));
    columns.u32s("errors", |m| m.errors);
    columns
}

fn stripes() -> Columns<pb::StripeProfile> {
    let mut columns = Columns::stamped();
    columns.u32s("sequence", |m: &pb::StripeProfile| m.sequence);
    columns.u32s("width_px", |m| m.width_px);
    columns.u32s("height_px", |m| m.height_px);
    macro_rules! lists {
        ($($name:ident)+) => { $(columns.f32_lists(stringify!($name), |m| &m.$name);)+ };
    }
    lists!(column_px row_px peak sd_px sigma_px);
    columns.u32_lists("quality", |m| &m.quality);
    lists!(xi_m eta_m xi_sd_m eta_sd_m);
    columns.f64s("haze_level", |m| Some(m.haze_level));
    columns.f64s("noise_sd", |m| Some(m.noise_sd));
    columns.texts("fault", |m| &m.fault);
    columns
}

fn events() -> Columns<pb::Event> {
    let mut columns = Columns::stamped();
    columns.texts("severity", |m| match messages::event_severity(m) {
        Severity::Info => "info",
        Severity::Warning => "warning",
        Severity::Error => "error",
    });
    columns.texts("kind", |m| &m.kind);
    columns.texts("message", |m| &m.message);
    columns.named_lists("values", |m| {
        // By name: a map's own order is another one in every program.
        let mut named: Vec<(&str, f64)> = m.values.iter().map(|(k, v)| (k.as_str(), *v)).collect();
        named.sort_by_key(|(name, _)| *name);
        named
    });
    columns
}
