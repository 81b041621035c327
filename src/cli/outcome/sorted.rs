//! Which errors of the rooms are the doing of what was given, and which of the run.
//!
//! The rule: an error that could have been known from the arguments and files alone, before any work, is theirs.

use hydroline_benchmark::ProveError;
use hydroline_calib::CalibError;
use hydroline_calib::calibration::usage::UseError;
use hydroline_calib::flat::FlatError;
use hydroline_capture::{CaptureError, FolderError};
use hydroline_core::frame::FrameError;
use hydroline_daemon::record::RecordError;
use hydroline_daemon::replay::ReplayError;
use hydroline_daemon::simulate::SimulateError;
use hydroline_diagnose::DiagnoseError;
use hydroline_diagnose::profiles::ImageError;
use hydroline_identify::IdentifyError;
use hydroline_identify::bollard::BollardError;
use hydroline_identify::data::LoadError;
use hydroline_identify::predict::PredictError;
use hydroline_identify::predict::residuals::NotBeside;
use hydroline_import::join::JoinError;
use hydroline_import::{ImportError, MapError};
use hydroline_live::LiveError;
use hydroline_log::{ImageTopicError, LogError};
use hydroline_plan::preflight::PreflightError;
use hydroline_reproduce::ReproduceError;
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

    /// What to do, where the error's own words do not say.
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
    )
}

impl Sorted for LogError {
    fn is_input(&self) -> bool {
        match self {
            Self::NotMcap { .. }
            | Self::Empty { .. }
            | Self::Exists { .. }
            | Self::OutputExists { .. }
            | Self::NotEmpty { .. }
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

impl Sorted for FolderError {
    fn is_input(&self) -> bool {
        match self {
            Self::Read { source, .. } => is_no_file(source.kind()),
            Self::Empty { .. } | Self::NoTimes { .. } | Self::Order { .. } => true,
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

impl Sorted for RecordError {
    fn is_input(&self) -> bool {
        match self {
            Self::Service(error) => error.is_input(),
            Self::Thrust(_) => true,
            Self::Log(error) => error.is_input(),
            Self::Start { .. } => false,
        }
    }
}

impl Sorted for LiveError {
    fn is_input(&self) -> bool {
        match self {
            LiveError::Open { .. } | LiveError::Token { .. } | LiveError::Listen { .. } => true,
            LiveError::Start(_) => false,
        }
    }
}

impl Sorted for ServiceError {
    fn is_input(&self) -> bool {
        matches!(self, Self::TooSlow { .. } | Self::Channels { .. })
    }
}

impl Sorted for SimulateError {
    fn is_input(&self) -> bool {
        match self {
            Self::Sim(error) => error.is_input(),
            Self::Scene(_) | Self::Plan(_) | Self::Noise { .. } => true,
            Self::Log(error) => error.is_input(),
            Self::Capture(_) => false,
        }
    }
}

impl Sorted for SimError {
    fn is_input(&self) -> bool {
        match self {
            Self::Effect(_) | Self::Thrust(_) => true,
            // Numbers that each are allowed and together run away: known only from the run.
            Self::Trajectory(_) => false,
        }
    }
}

impl Sorted for PreflightError {
    fn is_input(&self) -> bool {
        // The plan is held against the rig: whatever is wrong is wrong with one of them.
        true
    }
}

impl Sorted for IdentifyError {
    fn is_input(&self) -> bool {
        match self {
            Self::OnlyStill(_) | Self::NoRun | Self::Effect(_) => true,
            Self::TooFew { .. } | Self::Method(_) | Self::Forward(_) => false,
        }
    }
}

impl Sorted for BollardError {
    fn is_input(&self) -> bool {
        match self {
            Self::Table { .. } | Self::TooFew { .. } => true,
            Self::Falls { .. } | Self::Method(_) | Self::Forward(_) => false,
        }
    }
}

impl Sorted for PredictError {
    fn is_input(&self) -> bool {
        match self {
            Self::Plan(_)
            | Self::Thrust(_)
            | Self::Effect(_)
            | Self::Identified { .. }
            | Self::OfRig { .. } => true,
            Self::Trajectory(_) => false,
        }
    }
}

impl Sorted for NotBeside {
    fn is_input(&self) -> bool {
        true
    }
}

impl Sorted for DiagnoseError {
    fn is_input(&self) -> bool {
        match self {
            Self::NothingMoves(_) | Self::Effect(_) => true,
            Self::NoFit { .. } => false,
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

impl Sorted for ImportError {
    fn is_input(&self) -> bool {
        match self {
            Self::Faults { .. } => true,
            Self::Table(_) => false,
            Self::Log(error) => error.is_input(),
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

impl Sorted for ProveError {
    fn is_input(&self) -> bool {
        matches!(self, Self::UnknownCase { .. } | Self::Kept { .. })
    }
}

impl Sorted for CalibError {
    fn is_input(&self) -> bool {
        !matches!(self, Self::Unwritable { .. })
    }
}

impl Sorted for FlatError {
    fn is_input(&self) -> bool {
        matches!(
            self,
            Self::FewExposures { .. } | Self::FewFrames { .. } | Self::Size { .. }
        )
    }
}

impl Sorted for ReproduceError {
    fn is_input(&self) -> bool {
        // The rigs are built in; what can be misnamed is the target.
        matches!(self, Self::Rig(_))
    }
}

/// All of an error's variants are the doing of what was given, or none.
macro_rules! sorted {
    ($($error:ty: $is_input:literal),* $(,)?) => {
        $(impl Sorted for $error {
            fn is_input(&self) -> bool {
                $is_input
            }
        })*
    };
}

sorted! {
    RigError: true,
    UseError: true,
    MapError: true,
    EffectError: true,
    SceneError: true,
    ThrustError: true,
    // The rig was checked already: a camera that is not there or does not do as asked is found by the run.
    CaptureError: false,
    FrameError: false,
    hydroline_calib::map::MapError: false,
    PtyError: false,
    serde_json::Error: false,
}
