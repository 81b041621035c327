//! Which of the accepted calibrations that are remembered a run uses, and the words that say so.

mod words;

use hydroline_calib::analytic::IdealMap;
use hydroline_calib::calibration::MapParameters;
use hydroline_calib::plane::PlaneMap;
use hydroline_calib::{Calibration, ImageSize, Medium};
use hydroline_rigs::{CameraBackend, DeviceIdentity, Rig};
use std::path::{Path, PathBuf};
use std::time::SystemTime;
use words::{age, circumstances, fit, made};

/// Characters of a camera or board in a file's name: three parts and a time fit the 255 bytes of a name.
const NAME_CHARACTERS: usize = 60;

/// Circumstances of a run that needs a calibration.
#[derive(Debug, Clone, PartialEq)]
pub struct Wanted {
    /// As [`camera`] names it.
    pub camera: String,
    /// Size and crop are part of a map.
    pub image: ImageSize,
    /// Medium that the light goes through.
    pub medium: Medium,
    /// The rig's board, whose calibrations come first.
    pub board: Option<String>,
}

/// A remembered calibration.
#[derive(Debug, Clone, PartialEq)]
pub struct Remembered {
    /// File that it lies in.
    pub path: PathBuf,
    /// Its camera, as [`camera`] names it.
    pub camera: String,
    /// The calibration itself.
    pub calibration: Calibration,
}

/// Name of a camera that is this one and no other: its identity on the bus; of a simulated one the rig's numbers, which are its truth.
/// `None` for a bare /dev/videoN: tomorrow another camera may have that number.
pub fn camera(rig: &Rig) -> Option<String> {
    match &rig.camera.backend {
        CameraBackend::V4l(DeviceIdentity::ById(name)) => Some(format!("by-id {name}")),
        // A socket, not a camera: at least the rig that it belongs to is the same.
        CameraBackend::V4l(DeviceIdentity::ByPath(name)) => {
            Some(format!("by-path {name} of rig {}", rig.name))
        }
        CameraBackend::V4l(DeviceIdentity::Node(_)) => None,
        CameraBackend::Sim => match IdealMap::of(rig).describe().map {
            MapParameters::Ideal(p) => Some(format!(
                "sim {} f {:.2} {:.2} c {:.2} {:.2} at {:.4} {:.4} tilt {:.5}",
                rig.name,
                p.fx_px,
                p.fy_px,
                p.cx_px,
                p.cy_px,
                p.eta_c_m,
                p.zeta_c_m,
                p.camera_tilt_rad
            )),
            _ => None,
        },
    }
}

/// The latest for a run, of the rig's board before any other: a map holds for a camera and what is before it, whichever
/// board has made it. With what must be said of the choice.
pub fn latest(
    all: Vec<Remembered>,
    wanted: &Wanted,
    now: SystemTime,
) -> (Option<Remembered>, Option<String>) {
    let same_camera: Vec<String> = all
        .iter()
        .filter(|r| r.camera == wanted.camera)
        .map(|r| circumstances(&r.calibration))
        .collect();
    let fits = |r: &Remembered| {
        let c = &r.calibration;
        r.camera == wanted.camera
            && c.medium == wanted.medium
            && c.image.is_none_or(|image| image == wanted.image)
    };
    let of_board = |r: &Remembered| wanted.board.is_some() && r.calibration.board == wanted.board;
    let found = all
        .into_iter()
        .filter(fits)
        .max_by(|a, b| (of_board(a), key(a)).cmp(&(of_board(b), key(b))));
    let words = match &found {
        Some(r) => Some(format!(
            "no --calibration: the remembered one of {} is used: {}, {}: {} (--calibration FILE takes another, --no-remembered none)",
            age(&r.calibration, now),
            circumstances(&r.calibration),
            fit(&r.calibration),
            r.path.display()
        )),
        None if !same_camera.is_empty() => Some(format!(
            "no --calibration, and none of the {} remembered for this camera is for {} and {} x {} px; there is: {}",
            same_camera.len(),
            wanted.medium.name(),
            wanted.image.width_px,
            wanted.image.height_px,
            same_camera.join("; ")
        )),
        None => None,
    };
    (found, words)
}

/// By time, then by name.
fn key(r: &Remembered) -> (Option<SystemTime>, &Path) {
    (made(&r.calibration), &r.path)
}

/// File name of a calibration: time, camera, medium and board.
pub fn file_name(camera: &str, calibration: &Calibration) -> String {
    let plain = |text: &str| -> String {
        let kept = |c: char| if c.is_ascii_alphanumeric() { c } else { '-' };
        text.chars().take(NAME_CHARACTERS).map(kept).collect()
    };
    let date: String = calibration
        .date
        .as_deref()
        .unwrap_or("undated")
        .chars()
        .filter(char::is_ascii_alphanumeric)
        .collect();
    format!(
        "{date}_{}_{}_{}.toml",
        plain(camera),
        calibration.medium.name(),
        plain(calibration.board.as_deref().unwrap_or("none"))
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_simulated_camera_of_other_numbers_is_another() {
        let rig = Rig::builtin("lshpi").unwrap();
        let mut moved = rig.clone();
        moved.camera.cx_px += 3.0;
        assert_ne!(camera(&rig), camera(&moved));
        assert_eq!(camera(&rig), camera(&rig.clone()));
        // A number of the system's is no camera; a socket is one of its rig.
        let backend = |identity| {
            let mut rig = rig.clone();
            rig.camera.backend = CameraBackend::V4l(identity);
            camera(&rig)
        };
        assert_eq!(backend(DeviceIdentity::Node("/dev/video0".into())), None);
        let socket = backend(DeviceIdentity::ByPath("usb-1".into())).unwrap();
        assert!(socket.contains("usb-1") && socket.contains(&rig.name));
        let serial = backend(DeviceIdentity::ById("usb-X_123".into()));
        assert_eq!(serial.as_deref(), Some("by-id usb-X_123"));
    }
}
