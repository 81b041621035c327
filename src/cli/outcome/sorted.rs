//! Sorts the errors of the rooms into those of the input and those of the run.
//!
//! The rule: an error that could have been known from the arguments and files alone, before any work, is theirs.

use hydroline_calib::CalibError;
use hydroline_calib::calibration::usage::UseError;
use hydroline_calib::flat::FlatError;
use hydroline_capture::{CaptureError, FolderError};
use hydroline_coefficients::{FittedError, PrimeError};
use hydroline_core::descriptors::TooFew;
use hydroline_core::frame::FrameError;
use hydroline_daemon::record::RecordError;
use hydroline_daemon::replay::ReplayError;
use hydroline_daemon::simulate::SimulateError;
use hydroline_diagnose::DiagnoseError;
use hydroline_diagnose::profiles::ImageError;
use hydroline_estimate::EstimateError;
use hydroline_exchange::draws::DrawError;
use hydroline_exchange::edit::EditError;
use hydroline_exchange::foreign::ForeignError;
use hydroline_exchange::model::ModelError;
use hydroline_identify::bollard::BollardError;
use hydroline_identify::data::LoadError;
use hydroline_identify::predict::PredictError;
use hydroline_identify::predict::residuals::NotBeside;
use hydroline_import::join::JoinError;
use hydroline_import::{ImportError, MapError};
#[cfg(feature = "lab")]
use hydroline_lab::{benchmark::ProveError, reproduce::ReproduceError};
use hydroline_live::LiveError;
use hydroline_log::{ImageTopicError, LogError};
use hydroline_plan::preflight::PreflightError;
use hydroline_rigs::RigError;
use hydroline_sim::{EffectError, SceneError, SimError, ThrustError};
use hydroline_thruster::controller::PtyError;
use hydroline_thruster::service::ServiceError;
use std::fmt::Display;
use std::io::ErrorKind;

/// An error that can be sorted into an exit code.
pub(crate) trait Sorted: Display {
    /// Whether what was given (arguments, config, input files) is to blame; else the run is.
    fn is_input(&self) -> bool;

    /// Next step of the user, where the error's own words do not say it.
    fn next_step(&self) -> Option<&'static str> {
        None
    }
}

/// There is nothing of use under that name, as against a disk that fails while reading.
pub(super) fn is_no_file(kind: ErrorKind) -> bool {
    matches!(
        kind,
        ErrorKind::NotFound
            | ErrorKind::NotADirectory
            | ErrorKind::IsADirectory
            | ErrorKind::PermissionDenied
            | ErrorKind::InvalidFilename
            // Text was expected, and it is none.
            | ErrorKind::InvalidData
            | ErrorKind::FileTooLarge
            // A pipe, a terminal, a device.
            | ErrorKind::NotSeekable
    )
}

impl Sorted for LogError {
    fn is_input(&self) -> bool {
        match self {
            Self::NotMcap { .. }
            | Self::Foreign { .. }
            | Self::Empty { .. }
            | Self::Exists { .. }
            | Self::OutputExists { .. }
            | Self::NotEmpty { .. }
            | Self::BeingWritten { .. }
            | Self::TooLarge { .. }
            | Self::WontFit { .. } => true,
            Self::Read { source, .. } | Self::Create { source, .. } => is_no_file(source.kind()),
            _ => false,
        }
    }

    fn next_step(&self) -> Option<&'static str> {
        match self {
            Self::Read { source, .. } if is_no_file(source.kind()) => {
                Some("name a log (.mcap) that can be read")
            }
            Self::Empty { .. } => Some("name another log"),
            Self::NotMcap { .. } => Some(
                "name a log (.mcap) that record, simulate or replay wrote, or make one of a table with `hydroline import`",
            ),
            _ => None,
        }
    }
}

impl Sorted for LoadError {
    fn is_input(&self) -> bool {
        match self {
            Self::Log(error) => error.is_input(),
            Self::Thrust(_)
            | Self::NoMotion { .. }
            | Self::EmptyWindow { .. }
            | Self::UnknownThruster { .. }
            | Self::OtherVehicle { .. }
            | Self::CommandNotFinite { .. } => true,
        }
    }

    fn next_step(&self) -> Option<&'static str> {
        match self {
            Self::Log(error) => error.next_step(),
            Self::CommandNotFinite { .. } => {
                Some("record or import that run again, or leave the log out")
            }
            _ => None,
        }
    }
}

impl Sorted for ReplayError {
    fn is_input(&self) -> bool {
        match self {
            Self::Log(error) => error.is_input(),
            Self::Folder(error) => error.is_input(),
            Self::NoImages { .. } | Self::Dynamics { .. } => true,
            Self::Refine(_) | Self::Smooth(_) => false,
        }
    }

    fn next_step(&self) -> Option<&'static str> {
        match self {
            Self::Log(error) => error.next_step(),
            _ => None,
        }
    }
}

impl Sorted for ImageTopicError {
    fn is_input(&self) -> bool {
        match self {
            Self::Log(error) => error.is_input(),
            Self::Missing { .. } | Self::Several { .. } | Self::Unread { .. } => true,
        }
    }

    fn next_step(&self) -> Option<&'static str> {
        match self {
            Self::Log(error) => error.next_step(),
            _ => None,
        }
    }
}

impl Sorted for DiagnoseError {
    fn is_input(&self) -> bool {
        match self {
            Self::NothingMoves(_) | Self::Effect(_) | Self::Runs(_) => true,
            Self::Images(error) => error.is_input(),
            Self::NoFit { .. } => false,
        }
    }

    fn next_step(&self) -> Option<&'static str> {
        match self {
            Self::Images(error) => error.next_step(),
            _ => None,
        }
    }
}

impl Sorted for ImageError {
    fn is_input(&self) -> bool {
        match self {
            Self::Load(error) => error.is_input(),
            Self::Sim(error) => error.is_input(),
            Self::Effect(_) => true,
            Self::Few { .. } | Self::NoPose => false,
        }
    }

    fn next_step(&self) -> Option<&'static str> {
        match self {
            Self::Load(error) => error.next_step(),
            _ => None,
        }
    }
}

impl Sorted for JoinError {
    fn is_input(&self) -> bool {
        match self {
            Self::Log(error) => error.is_input(),
            Self::Load(error) => error.is_input(),
            _ => true,
        }
    }

    fn next_step(&self) -> Option<&'static str> {
        match self {
            Self::Log(error) => error.next_step(),
            Self::Load(error) => error.next_step(),
            _ => None,
        }
    }
}

/// Errors that a closure sorts.
macro_rules! sorted {
    ($($error:ty: $is_input:expr),* $(,)?) => {
        $(impl Sorted for $error {
            fn is_input(&self) -> bool {
                let is_input: fn(&Self) -> bool = $is_input;
                is_input(self)
            }
        })*
    };
}

sorted! {
    FolderError: |e| match e {
        FolderError::Read { source, .. } => is_no_file(source.kind()),
        FolderError::Empty { .. } | FolderError::NoTimes { .. } | FolderError::Order { .. } => true,
    },
    RecordError: |e| match e {
        RecordError::Service(error) => error.is_input(),
        RecordError::Thrust(_) => true,
        RecordError::Log(error) => error.is_input(),
        RecordError::Start { .. } => false,
    },
    LiveError: |e| match e {
        LiveError::Open { .. } | LiveError::Token { .. } | LiveError::Listen { .. } => true,
        LiveError::Start(_) => false,
    },
    SimulateError: |e| match e {
        SimulateError::Sim(error) => error.is_input(),
        SimulateError::Scene(_)
        | SimulateError::Plan(_)
        | SimulateError::Noise { .. }
        | SimulateError::Start { .. } => true,
        SimulateError::Log(error) => error.is_input(),
        SimulateError::Capture(_) => false,
    },
    SimError: |e| match e {
        SimError::Effect(_) | SimError::Thrust(_) => true,
        // Numbers that each are allowed and together run away: known only from the run.
        SimError::Trajectory(_) => false,
    },
    EstimateError: |e| match e {
        EstimateError::OnlyStill(_)
        | EstimateError::NoRun
        | EstimateError::NothingFree(_)
        | EstimateError::TooSparse(_)
        | EstimateError::Effect(_) => true,
        EstimateError::TooFew { .. } | EstimateError::NoFit(_) => false,
    },
    BollardError: |e| match e {
        BollardError::Table { .. } | BollardError::TooFew { .. } => true,
        BollardError::Falls { .. } => false,
    },
    PredictError: |e| match e {
        PredictError::Plan(_)
        | PredictError::Thrust(_)
        | PredictError::Effect(_)
        | PredictError::Identified { .. }
        | PredictError::OfRig { .. } => true,
        PredictError::Trajectory(_) => false,
    },
    ImportError: |e| match e {
        ImportError::Faults { .. } => true,
        ImportError::Table(_) => false,
        ImportError::Log(error) => error.is_input(),
    },
    RigError: |_| true,
    FittedError: |_| true,
    EditError: |_| true,
    ForeignError: |_| true,
    ModelError: |_| true,
    DrawError: |_| true,
    PrimeError: |_| true,
    UseError: |_| true,
    MapError: |_| true,
    EffectError: |_| true,
    SceneError: |_| true,
    ThrustError: |_| true,
    NotBeside: |_| true,
    // The plan is held against the rig: whatever is wrong is wrong with one of them.
    PreflightError: |_| true,
    // The rig was checked already: a camera that is not there or does not do as asked is found by the run.
    CaptureError: |_| false,
    FrameError: |_| false,
    hydroline_calib::map::MapError: |_| false,
    PtyError: |_| false,
    TooFew: |_| false,
    serde_json::Error: |_| false,
    CalibError: |e| !matches!(e, CalibError::Unwritable { .. }),
    ServiceError: |e| matches!(e, ServiceError::TooSlow { .. } | ServiceError::Channels { .. }),
    FlatError: |e| matches!(
        e,
        FlatError::FewExposures { .. } | FlatError::FewFrames { .. } | FlatError::Size { .. }
    ),
}

#[cfg(feature = "lab")]
sorted! {
    ProveError: |e| matches!(e, ProveError::UnknownCase { .. } | ProveError::Kept { .. }),
    // The rigs are built in; what can be misnamed is the target.
    ReproduceError: |e| matches!(e, ReproduceError::Rig(_)),
}
