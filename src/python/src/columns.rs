//! Messages of one kind as columns: names carry their units, times are UNIX [ns], NULL = not measured or not known.

use arrow_array::builder::{
    ArrayBuilder, FixedSizeListBuilder, Float32Builder, Float64Builder, ListBuilder, StringBuilder,
    StructBuilder, UInt32Builder, UInt64Builder,
};
use arrow_array::{ArrayRef, RecordBatch};
use arrow_schema::{ArrowError, DataType, Field, Schema};
use hydroline_core::event::Severity;
use hydroline_log::messages::{self, Stamped, pb};
use hydroline_log::{LogMessage, Record};
use std::sync::Arc;

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

/// Columns of a table, as they are made.
#[derive(Default)]
struct Columns {
    fields: Vec<Field>,
    arrays: Vec<ArrayRef>,
}

impl Columns {
    fn add(&mut self, name: &str, mut builder: impl ArrayBuilder) {
        let array = builder.finish();
        let field = Field::new(name, array.data_type().clone(), true);
        self.fields.push(field);
        self.arrays.push(array);
    }

    fn u64s(&mut self, name: &str, values: impl Iterator<Item = u64>) {
        let mut builder = UInt64Builder::new();
        values.for_each(|v| builder.append_value(v));
        self.add(name, builder);
    }

    fn u32s(&mut self, name: &str, values: impl Iterator<Item = u32>) {
        let mut builder = UInt32Builder::new();
        values.for_each(|v| builder.append_value(v));
        self.add(name, builder);
    }

    fn f64s(&mut self, name: &str, values: impl Iterator<Item = Option<f64>>) {
        let mut builder = Float64Builder::new();
        values.for_each(|v| builder.append_option(v));
        self.add(name, builder);
    }

    fn texts<T: AsRef<str>>(&mut self, name: &str, values: impl Iterator<Item = T>) {
        let mut builder = StringBuilder::new();
        values.for_each(|v| builder.append_value(v));
        self.add(name, builder);
    }

    fn f32_lists<'a>(&mut self, name: &str, rows: impl Iterator<Item = &'a Vec<f32>>) {
        let mut builder = ListBuilder::new(Float32Builder::new());
        for row in rows {
            builder.values().append_slice(row);
            builder.append(true);
        }
        self.add(name, builder);
    }

    fn table(self) -> Result<RecordBatch, ArrowError> {
        RecordBatch::try_new(Arc::new(Schema::new(self.fields)), self.arrays)
    }
}

/// A message's own time; the time of logging where it says none.
fn stamps<M: Stamped>(rows: &[(u64, M)]) -> impl Iterator<Item = u64> + '_ {
    rows.iter()
        .map(|(log_ns, m)| m.stamp_ns().unwrap_or(*log_ns))
}

/// What a kind of message is: its topic, and its table.
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
    /// Kinds whose messages are small: read together, since they lie in the same chunks, often beside an image.
    pub const SMALL: [Kind; 5] = [
        Kind::Motion,
        Kind::Truth,
        Kind::Commands,
        Kind::Echoes,
        Kind::Events,
    ];

    /// The kind of a message; `None` = of none of these.
    pub fn of(record: &Record) -> Option<Kind> {
        match record {
            Record::Motion(_) => Some(Kind::Motion),
            Record::Truth(_) => Some(Kind::Truth),
            Record::Command(_) => Some(Kind::Commands),
            Record::Echo(_) => Some(Kind::Echoes),
            Record::Profile(_) => Some(Kind::Stripes),
            Record::Event(_) => Some(Kind::Events),
            _ => None,
        }
    }

    /// Its topic.
    pub fn topic(self) -> &'static str {
        match self {
            Kind::Motion => "/vehicle/motion",
            Kind::Truth => "/sim/truth",
            Kind::Commands => "/thruster/command",
            Kind::Echoes => "/thruster/echo",
            Kind::Stripes => "/laser/profile",
            Kind::Events => "/daemon/event",
        }
    }

    /// The table of these messages; others among them are left out.
    pub fn table(self, messages: Vec<LogMessage>) -> Result<RecordBatch, ArrowError> {
        match self {
            Kind::Motion | Kind::Truth => motion(&rows(messages, |r| match r {
                Record::Motion(m) | Record::Truth(m) => Some(m),
                _ => None,
            })),
            Kind::Commands => commands(&rows(messages, |r| match r {
                Record::Command(m) => Some(m),
                _ => None,
            })),
            Kind::Echoes => echoes(&rows(messages, |r| match r {
                Record::Echo(m) => Some(m),
                _ => None,
            })),
            Kind::Stripes => stripes(&rows(messages, |r| match r {
                Record::Profile(m) => Some(m),
                _ => None,
            })),
            Kind::Events => events(&rows(messages, |r| match r {
                Record::Event(m) => Some(m),
                _ => None,
            })),
        }
    }
}

/// Messages of one kind with their times of logging.
fn rows<M>(messages: Vec<LogMessage>, of: fn(Record) -> Option<M>) -> Vec<(u64, M)> {
    let each = messages.into_iter();
    each.filter_map(|m| Some((m.log_ns, of(m.record)?)))
        .collect()
}

fn motion(rows: &[(u64, pb::VehicleMotion)]) -> Result<RecordBatch, ArrowError> {
    let mut columns = Columns::default();
    columns.u64s("timestamp_ns", stamps(rows));
    macro_rules! numbers {
        ($($name:ident)+) => { $(columns.f64s(stringify!($name), rows.iter().map(|(_, m)| m.$name));)+ };
    }
    numbers!(x_m y_m z_m phi_rad theta_rad psi_rad u_mps v_mps w_mps p_radps q_radps r_radps);
    let known = |m: &pb::VehicleMotion| m.covariance.len() == COVARIANCE;
    for (k, name) in POSE_SD.into_iter().enumerate() {
        let variance = rows
            .iter()
            .map(|(_, m)| known(m).then(|| m.covariance[7 * k]));
        columns.f64s(name, variance.map(|v| v.map(f64::sqrt)));
    }
    let mut covariance = FixedSizeListBuilder::new(Float64Builder::new(), COVARIANCE as i32);
    for (_, m) in rows {
        if known(m) {
            covariance.values().append_slice(&m.covariance);
        } else {
            covariance.values().append_nulls(COVARIANCE);
        }
        covariance.append(known(m));
    }
    columns.add("covariance", covariance);
    numbers!(rudder_rad elevator_rad shaft_radps wave_m);
    columns.table()
}

fn commands(rows: &[(u64, pb::ThrusterCommand)]) -> Result<RecordBatch, ArrowError> {
    let mut columns = Columns::default();
    columns.u64s("timestamp_ns", stamps(rows));
    columns.u32s("sequence", rows.iter().map(|(_, m)| m.sequence));
    columns.texts("thruster", rows.iter().map(|(_, m)| &m.thruster));
    columns.f64s("thrust_n", rows.iter().map(|(_, m)| Some(m.thrust_n)));
    columns.f64s("pulse_us", rows.iter().map(|(_, m)| Some(m.pulse_us)));
    columns.u64s("due_ns", rows.iter().map(|(_, m)| m.due_ns));
    columns.u32s("plan_step", rows.iter().map(|(_, m)| m.plan_step));
    columns.texts("cause", rows.iter().map(|(_, m)| &m.cause));
    columns.table()
}

fn echoes(rows: &[(u64, pb::ThrusterEcho)]) -> Result<RecordBatch, ArrowError> {
    let mut columns = Columns::default();
    columns.u64s("timestamp_ns", stamps(rows));
    columns.u32s("sequence", rows.iter().map(|(_, m)| m.sequence));
    columns.texts("thruster", rows.iter().map(|(_, m)| &m.thruster));
    columns.f64s("pulse_us", rows.iter().map(|(_, m)| Some(m.pulse_us)));
    let clock_us = rows.iter().map(|(_, m)| m.controller_time_us);
    columns.u64s("controller_time_us", clock_us);
    let round_trip_s = rows.iter().map(|(_, m)| Some(m.round_trip_s));
    columns.f64s("round_trip_s", round_trip_s);
    columns.u32s("errors", rows.iter().map(|(_, m)| m.errors));
    columns.table()
}

fn stripes(rows: &[(u64, pb::StripeProfile)]) -> Result<RecordBatch, ArrowError> {
    let mut columns = Columns::default();
    columns.u64s("timestamp_ns", stamps(rows));
    columns.u32s("sequence", rows.iter().map(|(_, m)| m.sequence));
    columns.u32s("width_px", rows.iter().map(|(_, m)| m.width_px));
    columns.u32s("height_px", rows.iter().map(|(_, m)| m.height_px));
    macro_rules! lists {
        ($($name:ident)+) => { $(columns.f32_lists(stringify!($name), rows.iter().map(|(_, m)| &m.$name));)+ };
    }
    lists!(column_px row_px peak sd_px sigma_px);
    let mut quality = ListBuilder::new(UInt32Builder::new());
    for (_, m) in rows {
        quality.values().append_slice(&m.quality);
        quality.append(true);
    }
    columns.add("quality", quality);
    lists!(xi_m eta_m xi_sd_m eta_sd_m);
    columns.f64s("haze_level", rows.iter().map(|(_, m)| Some(m.haze_level)));
    columns.f64s("noise_sd", rows.iter().map(|(_, m)| Some(m.noise_sd)));
    columns.texts("fault", rows.iter().map(|(_, m)| &m.fault));
    columns.table()
}

fn events(rows: &[(u64, pb::Event)]) -> Result<RecordBatch, ArrowError> {
    let mut columns = Columns::default();
    columns.u64s("timestamp_ns", stamps(rows));
    let severity = rows.iter().map(|(_, m)| match messages::event_severity(m) {
        Severity::Info => "info",
        Severity::Warning => "warning",
        Severity::Error => "error",
    });
    columns.texts("severity", severity);
    columns.texts("kind", rows.iter().map(|(_, m)| &m.kind));
    columns.texts("message", rows.iter().map(|(_, m)| &m.message));
    let fields = vec![
        Field::new("name", DataType::Utf8, true),
        Field::new("value", DataType::Float64, true),
    ];
    let pair = StructBuilder::from_fields(fields, 0);
    let mut values = ListBuilder::new(pair);
    for (_, m) in rows {
        // By name: a map's own order is another one in every program.
        let mut named: Vec<(&String, &f64)> = m.values.iter().collect();
        named.sort_by_key(|(name, _)| *name);
        for (name, value) in named {
            let pair = values.values();
            if let Some(names) = pair.field_builder::<StringBuilder>(0) {
                names.append_value(name);
            }
            if let Some(numbers) = pair.field_builder::<Float64Builder>(1) {
                numbers.append_value(*value);
            }
            pair.append(true);
        }
        values.append(true);
    }
    columns.add("values", values);
    columns.table()
}
