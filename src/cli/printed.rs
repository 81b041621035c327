//! The types that --json prints, as JSON Schemas: the guide's chapter on them is made from these.

use crate::{
    calibrate, check, design, devices, export, extract, flat, import, log_tools, model, plan,
    predict, prove, publish, record, replay, reproduce, simulate,
};
use hydroline_diagnose::verdict::Verdict;
use hydroline_identify::Identification;
use hydroline_identify::bollard::Bollard;
use hydroline_import::recorded::Contents;
use hydroline_lab::reproduce as paper;
use hydroline_log::doctor::Diagnosis;
use hydroline_log::export::Exported;
use hydroline_log::recover::Recovery;
use hydroline_plan::preflight::Preflight;
use schemars::generate::SchemaSettings;
use schemars::{JsonSchema, Schema};

/// The form of what a command prints.
pub struct Printed {
    /// Command without the program's name.
    pub command: &'static str,
    /// Condition under which it prints this, and how; "" = one object, whenever --json is given.
    pub when: &'static str,
    /// Schema of the object, nothing referred to.
    pub schema: Schema,
}

macro_rules! printed {
    ($($command:literal $when:literal $of:ty),+ $(,)?) => {
        vec![$(Printed { command: $command, when: $when, schema: schema::<$of>() }),+]
    };
}

/// Every form of every command with --json, in the order of the help.
pub fn printed() -> Vec<Printed> {
    printed![
        "rig diff" "" crate::rig::change::Compared<'static>,
        "plan list" "A list." Vec<plan::Listed>,
        "plan design" "" design::Found<'static>,
        "devices" "" devices::Listed<'static>,
        "check" "" check::Checked<'static>,
        "aim" "One object per line, twice a second." hydroline_daemon::record::aim::AimView,
        "flat" "" flat::Printed<'static>,
        "calibrate" "" calibrate::json::Printed<'static>,
        "record" "" record::Printed<'static>,
        "record" "With --dry-run." Preflight,
        "record" "With --until-decided." record::until::Printed<'static>,
        "info" "" log_tools::LogInfo,
        "info" "Of a log of another program that is no MCAP file." Contents,
        "doctor" "" Diagnosis,
        "recover" "" Recovery,
        "export" "" Exported,
        "export" "With --merged." export::MergedRows,
        "replay" "" replay::Printed,
        "extract" "" extract::Printed,
        "import" "" import::Printed<'static>,
        "join" "" hydroline_import::join::Joined,
        "identify" "" Identification,
        "identify" "With --bollard and without logs." Bollard,
        "coefficients" "" hydroline_coefficients::Table,
        "compare" "" crate::compare::Printed,
        "diagnose" "The same is in `diagnose.json` of --report." Verdict,
        "predict" "" predict::Printed<'static>,
        "model" "" model::Printed<'static>,
        "publish" "" publish::Printed<'static>,
        "simulate" "" simulate::Printed<'static>,
        "reproduce" "figure12, figure13, figure17; NAME = figure." reproduce::Printed<'static, paper::Figure>,
        "reproduce" "table3; NAME = table3." reproduce::Printed<'static, Vec<paper::Row>>,
        "reproduce" "table4, table5; NAME = table4 or table5." reproduce::Printed<'static, Vec<paper::Disturbed>>,
        "reproduce" "table7; NAME = table7." reproduce::Printed<'static, Vec<paper::SurgeRun>>,
        "reproduce" "table10; NAME = table10." reproduce::Printed<'static, Vec<paper::Table10Row>>,
        "reproduce" "table11; NAME = table11." reproduce::Printed<'static, Vec<paper::Table11Row>>,
        "reproduce" "all-dofs; NAME = all_dofs." reproduce::Printed<'static, Vec<paper::DofRow>>,
        "reproduce" "calibration; NAME = calibration." reproduce::Printed<'static, paper::CalibrationStudy>,
        "reproduce" "joint-pose; NAME = joint_pose." reproduce::Printed<'static, paper::JointAccuracy>,
        "prove" "" prove::Proved<'static>,
        "prove" "With --images." prove::ProvedImages<'static>,
        "prove" "With --coupled." prove::ProvedCoupled<'static>,
        "prove" "With --held-out." prove::ProvedHeldOut<'static>,
        "prove" "With --invariance." prove::ProvedInvariance<'static>,
        "prove" "With --only ID." prove::One<'static>,
        "prove" "With --only image-N." prove::OneImage<'static>,
        "prove" "With --only coupled-N." prove::OneCoupled<'static>,
        "prove" "With --only held_out-N." prove::OneHeldOut<'static>,
        "prove" "With --only invariance-N." prove::OneInvariance<'static>,
    ]
}

fn schema<T: JsonSchema>() -> Schema {
    let settings = SchemaSettings::draft2020_12().for_serialize();
    let settings = settings.with(|s| s.inline_subschemas = true);
    settings.into_generator().into_root_schema_for::<T>()
}
