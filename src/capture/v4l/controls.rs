//! Controls by name: found, set in the rig's order, read back.
//!
//! Names are those of `v4l2-ctl`: the driver's words in lower case, everything else an underscore. The kernel renamed
//! some over time; both names find the control.

use std::path::Path;

use hydroline_rigs::CameraControl;

use super::device::{ControlInfo, Errno, V4lDevice};
use crate::{CaptureError, ControlReading};

/// Asks for the next control when added to an id (V4L2_CTRL_FLAG_NEXT_CTRL).
const NEXT: u32 = 0x8000_0000;
const DISABLED: u32 = 0x1;
const READ_ONLY: u32 = 0x4;
const INACTIVE: u32 = 0x10;
/// V4L2_CTRL_TYPE_CTRL_CLASS: a heading.
const HEADING: u32 = 6;
/// No camera has more; a driver whose enumeration never ends must not hang us.
const MOST: usize = 512;

/// Ids (v4l2-controls.h) and the names they have had.
const KNOWN: [(u32, &[&str]); 15] = [
    (0x0098_0900, &["brightness"]),
    (0x0098_0901, &["contrast"]),
    (0x0098_0902, &["saturation"]),
    (
        0x0098_090c,
        &["white_balance_automatic", "white_balance_temperature_auto"],
    ),
    (0x0098_0910, &["gamma"]),
    (0x0098_0912, &["gain_automatic", "autogain"]),
    (0x0098_0913, &["gain"]),
    (0x0098_0918, &["power_line_frequency"]),
    (0x0098_091a, &["white_balance_temperature"]),
    (0x0098_091b, &["sharpness"]),
    (0x009a_0901, &["auto_exposure", "exposure_auto"]),
    (
        EXPOSURE_ABSOLUTE,
        &["exposure_time_absolute", "exposure_absolute"],
    ),
    (
        0x009a_0903,
        &["exposure_dynamic_framerate", "exposure_auto_priority"],
    ),
    (0x009a_090a, &["focus_absolute"]),
    (0x009a_090c, &["focus_automatic_continuous", "focus_auto"]),
];

/// V4L2_CID_EXPOSURE_ABSOLUTE, in units of 100 us.
pub const EXPOSURE_ABSOLUTE: u32 = 0x009a_0902;

/// A driver's name for a control in `v4l2-ctl`'s spelling.
pub fn snake_case(name: &str) -> String {
    let mut out = String::new();
    for c in name.chars() {
        if c.is_ascii_alphanumeric() {
            out.push(c.to_ascii_lowercase());
        } else if !out.ends_with('_') && !out.is_empty() {
            out.push('_');
        }
    }
    out.trim_end_matches('_').to_owned()
}

/// All controls that can be named, the known ones first where enumeration is not supported.
pub fn list(device: &mut dyn V4lDevice) -> Vec<ControlInfo> {
    let mut found = Vec::new();
    let mut id = 0;
    while let Ok(info) = device.control_info(id | NEXT) {
        if info.id <= id || found.len() >= MOST {
            break;
        }
        id = info.id;
        if info.kind != HEADING && info.flags & DISABLED == 0 {
            found.push(info);
        }
    }
    if found.is_empty() {
        found.extend(
            KNOWN
                .iter()
                .filter_map(|(id, _)| device.control_info(*id).ok()),
        );
    }
    found
}

fn named<'a>(controls: &'a [ControlInfo], name: &str) -> Option<&'a ControlInfo> {
    let by_id = KNOWN
        .iter()
        .find(|(_, names)| names.contains(&name))
        .map(|(id, _)| *id);
    controls
        .iter()
        .find(|c| snake_case(&c.name) == name)
        .or_else(|| controls.iter().find(|c| Some(c.id) == by_id))
}

/// Sets the controls in order, each by a call of its own (a call may hold one class only), reading each back; then
/// reads all of them again, because a later one may have moved an earlier one.
///
/// # Errors
/// Naming the control, what was asked, what it has now, and its range.
pub fn apply(
    device: &mut dyn V4lDevice,
    node: &Path,
    wanted: &[CameraControl],
) -> Result<Vec<ControlReading>, CaptureError> {
    if wanted.is_empty() {
        return Ok(Vec::new());
    }
    let controls = list(device);
    let mut chosen = Vec::with_capacity(wanted.len());
    for want in wanted {
        let Some(info) = named(&controls, &want.name) else {
            let present: Vec<_> = controls.iter().map(|c| snake_case(&c.name)).collect();
            let present = if present.is_empty() {
                "none".into()
            } else {
                present.join(", ")
            };
            return Err(CaptureError::NoControl {
                node: node.to_path_buf(),
                name: want.name.clone(),
                present,
            });
        };
        // Flags change with the mode set before, so they are asked for again now.
        let info = device
            .control_info(info.id)
            .unwrap_or_else(|_| info.clone());
        let hint = hint(&info);
        set_one(device, node, want, &info, hint)?;
        chosen.push((want, info, hint));
    }
    let mut readings = Vec::with_capacity(chosen.len());
    for (want, info, hint) in chosen {
        let value = read_same(device, node, want, &info, hint)?;
        readings.push(ControlReading {
            name: want.name.clone(),
            id: info.id,
            asked: Some(want.value),
            value,
        });
    }
    Ok(readings)
}

fn hint(info: &ControlInfo) -> &'static str {
    if info.flags & INACTIVE != 0 {
        "; it is inactive now: the mode that frees it (e.g. auto_exposure = 1) must stand before it in the rig"
    } else if info.flags & READ_ONLY != 0 {
        "; it is read-only"
    } else {
        ""
    }
}

fn error(
    node: &Path,
    want: &CameraControl,
    info: &ControlInfo,
    got: String,
    hint: &'static str,
) -> CaptureError {
    CaptureError::Control {
        node: node.to_path_buf(),
        name: want.name.clone(),
        asked: want.value,
        got,
        min: info.min,
        max: info.max,
        step: info.step,
        hint,
    }
}

fn set_one(
    device: &mut dyn V4lDevice,
    node: &Path,
    want: &CameraControl,
    info: &ControlInfo,
    hint: &'static str,
) -> Result<(), CaptureError> {
    if let Err(errno) = device.set_control(info.id, want.value) {
        return Err(error(node, want, info, format!("refused ({errno})"), hint));
    }
    read_same(device, node, want, info, hint).map(|_| ())
}

fn read_same(
    device: &mut dyn V4lDevice,
    node: &Path,
    want: &CameraControl,
    info: &ControlInfo,
    hint: &'static str,
) -> Result<i64, CaptureError> {
    match device.control(info.id) {
        Ok(value) if value == want.value => Ok(value),
        Ok(value) => Err(error(node, want, info, format!("reads back {value}"), hint)),
        // Write-only controls cannot be read back; all others must be.
        Err(Errno(libc::EACCES)) => Ok(want.value),
        Err(errno) => Err(error(
            node,
            want,
            info,
            format!("cannot be read back ({errno})"),
            hint,
        )),
    }
}

#[cfg(test)]
mod tests {
    use super::snake_case;

    #[test]
    fn names_are_v4l2_ctls() {
        for (driver, ours) in [
            ("Exposure Time, Absolute", "exposure_time_absolute"),
            ("White Balance, Automatic", "white_balance_automatic"),
            ("Gain", "gain"),
            ("Timestamp Source", "timestamp_source"),
            (
                "Percentage of Dropped Buffers",
                "percentage_of_dropped_buffers",
            ),
            ("  (odd) ", "odd"),
        ] {
            assert_eq!(snake_case(driver), ours);
        }
    }
}
