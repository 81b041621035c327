//! Files and head of a recording, settings for writing it, and a check of the room for it.

use std::io;
use std::path::{Path, PathBuf};

use hydroline_core::build_info::BuildInfo;
use hydroline_rigs::{LogSettings, PixelFormat};

use super::LogError;
use super::output::{FileOutput, LogOutput, free_bytes};
use super::part::{Encoding, MetadataMap};
use super::policy::Limits;
use super::topic::Topic;

/// Opens the files of a recording, part by part from 0.
pub trait PartOpener: Send {
    /// A new, empty file and its path.
    fn open(&mut self, part: u32) -> io::Result<(Box<dyn LogOutput>, PathBuf)>;
}

impl<F: FnMut(u32) -> io::Result<(Box<dyn LogOutput>, PathBuf)> + Send> PartOpener for F {
    fn open(&mut self, part: u32) -> io::Result<(Box<dyn LogOutput>, PathBuf)> {
        self(part)
    }
}

/// Real files: `name.mcap`, then `name_0001.mcap` ...
#[derive(Debug, Clone)]
pub struct FileParts {
    /// Path of the first part.
    pub path: PathBuf,
    /// Whether existing files may be replaced.
    pub replace: bool,
}

impl FileParts {
    /// Path of a part.
    pub fn part_path(&self, part: u32) -> PathBuf {
        if part == 0 {
            return self.path.clone();
        }
        let stem = self.path.file_stem().unwrap_or_default().to_string_lossy();
        let extension = self
            .path
            .extension()
            .map_or("mcap".into(), |e| e.to_string_lossy());
        self.path
            .with_file_name(format!("{stem}_{part:04}.{extension}"))
    }
}

impl PartOpener for FileParts {
    fn open(&mut self, part: u32) -> io::Result<(Box<dyn LogOutput>, PathBuf)> {
        let path = self.part_path(part);
        let named = |e: io::Error| io::Error::new(e.kind(), format!("{}: {e}", path.display()));
        let sink = FileOutput::create(&path, self.replace).map_err(named)?;
        Ok((Box::new(sink), path))
    }
}

/// Metadata at the head of every part.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Head {
    /// The whole effective rig.
    pub rig_toml: String,
    /// The calibration in force; `None` = none.
    pub calibration_toml: Option<String>,
    /// Version, host, kernel, driver, module parameters, planned length, notes ...
    pub session: MetadataMap,
    /// Who writes: into the file's header, and into the session unless that says already who recorded it.
    pub build: BuildInfo,
}

impl Head {
    /// The `library` of the file's header.
    pub(super) fn library(&self) -> String {
        format!("hydroline {}", self.build)
    }

    pub(super) fn metadata(&self, part: u32) -> Vec<(&'static str, MetadataMap)> {
        let toml = |text: &str| MetadataMap::from([("toml".to_owned(), text.to_owned())]);
        let calibration = match &self.calibration_toml {
            Some(text) => toml(text),
            None => MetadataMap::from([("status".to_owned(), "none".to_owned())]),
        };
        let mut session = self.session.clone();
        session.insert("part".to_owned(), part.to_string());
        // All three or none: the commit of a replay beside the version of its recording would be neither's.
        if !session.contains_key("version") {
            session.extend(self.build.session_keys(""));
        }
        vec![
            ("rig", toml(&self.rig_toml)),
            ("calibration", calibration),
            ("session", session),
        ]
    }
}

/// Settings for writing a log.
#[derive(Debug, Clone, PartialEq)]
pub struct WriteSettings {
    /// Chunk, sync, rotation and space limits.
    pub limits: Limits,
    /// Compression and head channels.
    pub encoding: Encoding,
    /// Bytes the queue may hold (live recording only).
    pub queue_bytes: u64,
}

impl WriteSettings {
    /// Live recording of a camera of that format (`None` = no camera).
    pub fn live(settings: &LogSettings, camera: Option<PixelFormat>) -> Self {
        Self {
            limits: Limits::live(settings),
            encoding: encoding(settings.zstd_level, camera),
            queue_bytes: settings.queue_bytes,
        }
    }

    /// Offline writing (`simulate`, `replay`).
    pub fn offline(camera: Option<PixelFormat>) -> Self {
        Self {
            limits: Limits::offline(),
            encoding: encoding(1, camera),
            queue_bytes: 256 << 20,
        }
    }
}

fn encoding(zstd_level: u32, camera: Option<PixelFormat>) -> Encoding {
    let image = match camera {
        Some(format) if format.is_compressed() => Some(Topic::CompressedImage),
        Some(_) => Some(Topic::RawImage),
        None => None,
    };
    let is_image = |t: &Topic| matches!(t, Topic::RawImage | Topic::CompressedImage);
    let topics = Topic::ALL
        .into_iter()
        .filter(|t| !is_image(t) || Some(*t) == image)
        .collect();
    // JPEG bytes do not shrink; compressing them again only costs time.
    let zstd_level = if camera.is_some_and(PixelFormat::is_compressed) {
        0
    } else {
        zstd_level
    };
    Encoding { zstd_level, topics }
}

/// Refuses a recording that will not fit.
///
/// # Errors
/// [`LogError::WontFit`] with the whole arithmetic.
pub fn check_space(
    path: &Path,
    planned_s: f64,
    bytes_per_s: f64,
    min_free_bytes: u64,
) -> Result<(), LogError> {
    let Some(free) = free_bytes(path) else {
        return Ok(());
    };
    check_space_in(path, free, planned_s, bytes_per_s, min_free_bytes)
}

fn check_space_in(
    path: &Path,
    free_bytes: u64,
    planned_s: f64,
    bytes_per_s: f64,
    min_free_bytes: u64,
) -> Result<(), LogError> {
    let needed_bytes = (planned_s * bytes_per_s).max(0.0).ceil() as u64;
    if needed_bytes.saturating_add(min_free_bytes) <= free_bytes {
        return Ok(());
    }
    let fits_s = free_bytes.saturating_sub(min_free_bytes) as f64 / bytes_per_s.max(1.0);
    Err(LogError::WontFit {
        path: path.to_owned(),
        planned_s,
        megabytes_per_s: bytes_per_s / 1e6,
        needed_megabytes: needed_bytes as f64 / 1e6,
        min_free_megabytes: min_free_bytes as f64 / 1e6,
        free_megabytes: free_bytes as f64 / 1e6,
        fits_s,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parts_are_named_after_the_first() {
        let parts = FileParts {
            path: "/logs/run.7.mcap".into(),
            replace: false,
        };
        assert_eq!(parts.part_path(0), Path::new("/logs/run.7.mcap"));
        assert_eq!(parts.part_path(12), Path::new("/logs/run.7_0012.mcap"));
    }

    #[test]
    fn what_will_not_fit_is_refused_with_the_arithmetic() {
        let path = Path::new("/logs/a.mcap");
        // 720 x 576 mono8 at 25/s for an hour: 37 GB.
        let rate = 720.0 * 576.0 * 25.0;
        assert!(check_space_in(path, 40_000_000_000, 3600.0, rate, 256 << 20).is_ok());
        let text = check_space_in(path, 37_000_000_000, 3600.0, rate, 256 << 20)
            .unwrap_err()
            .to_string();
        for number in [
            "/logs/a.mcap",
            "3600 s",
            "10.4 MB/s",
            "37325 MB",
            "268 MB",
            "37000 MB",
            "3543 s",
        ] {
            assert!(text.contains(number), "{number} is not in: {text}");
        }
    }

    #[test]
    fn an_existing_file_is_not_replaced() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("a.mcap");
        std::fs::write(&path, "precious").unwrap();
        let settings = WriteSettings::offline(None);
        let error = super::super::FileRecorder::create(&path, false, Head::default(), settings)
            .err()
            .unwrap();
        assert!(matches!(error, LogError::Exists { .. }));
        assert!(error.to_string().contains("a.mcap"), "{error}");
        assert_eq!(std::fs::read(&path).unwrap(), b"precious");
    }
}
