//! Accepted calibrations, remembered for the runs that follow: files under $XDG_DATA_HOME/hydroline/calibrations.
//!
//! Each is a calibration file like any other, with one line more that names its camera. A run finds the latest for its
//! camera, image size and medium, of its board before any other, and says which it took.

use super::CliError;
use super::print::errln;
use hydroline_calib::{CalibError, Calibration, ImageSize, Medium};
use hydroline_core::clock::{Clock, SystemClock};
use hydroline_core::session::Conditions;
use hydroline_daemon::calibrate::medium;
use hydroline_daemon::remembered::{Remembered, Wanted, camera, file_name, latest};
use hydroline_log::held;
use hydroline_rigs::Rig;
use std::ffi::OsString;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::time::{Duration, SystemTime, UNIX_EPOCH};

/// The line of a file that names the camera.
const CAMERA_LINE: &str = "# camera: ";

/// By which calibration runs will be seen, for what is checked before them.
#[derive(Debug, clap::Args)]
pub struct SeenArgs {
    /// Calibration of the runs: the stripe has to stay where it holds
    #[arg(long, value_name = "CALIB.toml")]
    calibration: Option<PathBuf>,
    #[command(flatten)]
    remember: RememberArgs,
}

impl SeenArgs {
    /// The calibration for runs of this rig; `None` = the rig's ideal camera.
    pub fn load(&self, rig: &Rig) -> Result<Option<Calibration>, CliError> {
        match &self.calibration {
            Some(path) => {
                let calibration = Calibration::load(path)?;
                calibration.check_image(ImageSize::of(&rig.camera))?;
                Ok(Some(calibration))
            }
            None => {
                let medium = medium::of_run(rig, &Conditions::default());
                Memory::of_user().for_run(self.remember, rig, medium)
            }
        }
    }
}

/// Whether remembered calibrations are looked for.
#[derive(Debug, Clone, Copy, clap::Args)]
pub struct RememberArgs {
    /// Without --calibration: uses the rig's ideal camera, not the latest accepted calibration that is remembered for
    /// this camera and medium
    #[arg(long, conflicts_with = "calibration")]
    no_remembered: bool,
}

/// Reason that a calibration is not remembered.
#[derive(Debug, thiserror::Error)]
#[allow(missing_docs)] // Each message names its fields.
pub enum RememberError {
    #[error(
        "neither XDG_DATA_HOME nor HOME names a folder; set one, or give the file with --calibration"
    )]
    NoFolder,
    #[error("{path}: {reason}; give the calibration's own file with --calibration")]
    NotWritten { path: PathBuf, reason: String },
    #[error(transparent)]
    Unwritable(#[from] CalibError),
}

/// The folder of remembered calibrations.
#[derive(Debug, Clone)]
pub struct Memory {
    folder: Option<PathBuf>,
}

impl Memory {
    /// The user's, as the XDG base directories say.
    pub fn of_user() -> Self {
        Self::from_variables(std::env::var_os("XDG_DATA_HOME"), std::env::var_os("HOME"))
    }

    fn from_variables(data: Option<OsString>, home: Option<OsString>) -> Self {
        // A relative path is to be ignored, says the specification.
        let absolute =
            |value: Option<OsString>| value.map(PathBuf::from).filter(|p| p.is_absolute());
        let data = absolute(data).or_else(|| Some(absolute(home)?.join(".local/share")));
        Self {
            folder: data.map(|data| data.join("hydroline/calibrations")),
        }
    }

    /// Keeps an accepted calibration.
    ///
    /// # Errors
    /// [`RememberError`] without a folder that can be written.
    pub fn keep(&self, camera: &str, calibration: &Calibration) -> Result<PathBuf, RememberError> {
        let folder = self.folder.as_deref().ok_or(RememberError::NoFolder)?;
        let text = format!(
            "# accepted by hydroline; a calibration file like any other (--calibration)\n{CAMERA_LINE}{camera}\n{}",
            calibration.to_toml()?
        );
        let path = folder.join(file_name(camera, calibration));
        let write = || -> std::io::Result<()> {
            std::fs::create_dir_all(folder)?;
            let mut part = held::part_in(folder)?;
            part.write_all(text.as_bytes())?;
            part.as_file().sync_all()?;
            part.persist(&path)?;
            Ok(())
        };
        write().map_err(|e| RememberError::NotWritten {
            path: path.clone(),
            reason: e.to_string(),
        })?;
        Ok(path)
    }

    /// Keeps it and says so; that it cannot be kept is said, and is no failure.
    pub fn keep_and_say(&self, rig: Option<&Rig>, calibration: &Calibration) {
        let Some(rig) = rig else {
            errln!(
                "hydroline: the calibration is not remembered: nobody said which camera made it (--rig); give its file with --calibration"
            );
            return;
        };
        let Some(camera) = camera(rig) else {
            errln!(
                "hydroline: the calibration is not remembered: a /dev/videoN is another camera tomorrow; `hydroline devices` prints by-id names for the rig, or give the file with --calibration"
            );
            return;
        };
        match self.keep(&camera, calibration) {
            Ok(path) => errln!(
                "hydroline: remembered for this camera, {} and board {}: {}",
                calibration.medium.name(),
                calibration.board.as_deref().unwrap_or("none"),
                path.display()
            ),
            Err(error) => errln!("hydroline: the calibration is not remembered: {error}"),
        }
    }

    /// All that read, and what does not in words.
    fn all(&self) -> (Vec<Remembered>, Vec<String>) {
        let (mut found, mut unread) = (Vec::new(), Vec::new());
        let entries = self.folder.as_ref().and_then(|f| std::fs::read_dir(f).ok());
        for entry in entries.into_iter().flatten().flatten() {
            let path = entry.path();
            if path.extension().is_none_or(|e| e != "toml") {
                continue;
            }
            match read(&path) {
                Ok(remembered) => found.push(remembered),
                Err(words) => unread.push(words),
            }
        }
        (found, unread)
    }

    /// The latest for a run, and whatever must be said of it; nothing is taken without words.
    pub fn find(&self, wanted: &Wanted, now: SystemTime) -> (Option<Remembered>, Vec<String>) {
        let (all, mut words) = self.all();
        let (found, said) = latest(all, wanted, now);
        words.extend(said);
        (found, words)
    }

    /// The calibration that a run without one uses: the latest remembered; `None` = the rig's ideal camera.
    pub fn for_run(
        &self,
        args: RememberArgs,
        rig: &Rig,
        medium: Medium,
    ) -> Result<Option<Calibration>, CliError> {
        let Some(camera) = camera(rig).filter(|_| !args.no_remembered) else {
            return Ok(None);
        };
        let wanted = Wanted {
            camera,
            image: ImageSize::of(&rig.camera),
            medium,
            board: rig.board.as_ref().map(|board| board.name.clone()),
        };
        let now = UNIX_EPOCH + Duration::from_nanos(SystemClock.triple().realtime_ns);
        let (found, words) = self.find(&wanted, now);
        for words in words {
            errln!("hydroline: {words}");
        }
        Ok(found.map(|r| {
            if let Some(words) = r.calibration.caveat() {
                errln!("hydroline: {}: {words}", r.path.display());
            }
            r.calibration
        }))
    }
}

fn read(path: &Path) -> Result<Remembered, String> {
    let calibration = Calibration::load(path).map_err(|e| e.to_string())?;
    let text = std::fs::read_to_string(path).map_err(|e| format!("{}: {e}", path.display()))?;
    let camera = text.lines().find_map(|l| l.strip_prefix(CAMERA_LINE));
    let camera = camera.ok_or_else(|| {
        format!(
            "{}: no line '{CAMERA_LINE}...': it is not used; write it, or move the file away",
            path.display()
        )
    })?;
    Ok(Remembered {
        path: path.to_owned(),
        camera: camera.to_owned(),
        calibration,
    })
}

#[cfg(test)]
mod tests;
