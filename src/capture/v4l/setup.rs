//! Brings a camera into the state the rig asks for, and reads everything back.

use std::path::Path;

use hydroline_rigs::{Camera, FRAME_BYTES_MAX, PixelFormat, YuvRange};

use super::controls;
use super::device::{Capability, Errno, OfferedSize, PixFormat, V4lDevice, V4lSystem};
use crate::{CaptureError, ControlReading, NegotiatedFormat};

/// Capability to capture video (V4L2_CAP_VIDEO_CAPTURE).
pub const CAP_CAPTURE: u32 = 0x1;
/// Capability to capture video in several planes (V4L2_CAP_VIDEO_CAPTURE_MPLANE).
pub const CAP_CAPTURE_MPLANE: u32 = 0x1000;
/// Capability to output video (V4L2_CAP_VIDEO_OUTPUT).
pub const CAP_OUTPUT: u32 = 0x2;
/// Capability to stream buffers (V4L2_CAP_STREAMING).
pub const CAP_STREAMING: u32 = 0x0400_0000;

/// Buffers in the queue: at 25 frames/s a third of a second of our own delays.
pub const BUFFERS: u32 = 8;
/// A rate read back within this share is the rate asked for (UVC counts in 100 ns).
const SAME_RATE: f64 = 1e-3;

/// A camera that is ready to stream.
#[derive(Debug, Clone, PartialEq)]
pub struct Setup {
    /// Answer to QUERYCAP.
    pub capability: Capability,
    /// As read back.
    pub format: PixFormat,
    /// As read back \[1/s\]; 0 = the driver does not state it.
    pub rate_fps: f64,
    /// The rig's controls, as read back.
    pub controls: Vec<ControlReading>,
    /// Number of buffers in the driver's queue.
    pub buffers: u32,
}

/// V4L2_FIELD_* in words.
pub fn field_name(field: u32) -> &'static str {
    const NAMES: [&str; 10] = [
        "any",
        "none",
        "top",
        "bottom",
        "interlaced",
        "seq_tb",
        "seq_bt",
        "alternate",
        "interlaced_tb",
        "interlaced_bt",
    ];
    NAMES.get(field as usize).copied().unwrap_or("unknown")
}

impl PixFormat {
    /// For people: `GREY 720x576`.
    pub fn words(&self) -> String {
        format!(
            "{} {}x{}",
            String::from_utf8_lossy(&self.fourcc).trim_end(),
            self.width_px,
            self.height_px
        )
    }

    /// For the log.
    pub fn negotiated(&self) -> NegotiatedFormat {
        NegotiatedFormat {
            fourcc: String::from_utf8_lossy(&self.fourcc).trim_end().to_owned(),
            width_px: self.width_px,
            height_px: self.height_px,
            stride_bytes: self.stride_bytes,
            size_bytes: self.size_bytes,
            field: field_name(self.field).into(),
            yuv_range: PixelFormat::of_fourcc(self.fourcc)
                .filter(|format| format.is_yuv())
                .map(|_| if self.full_range { "full" } else { "limited" }.into()),
        }
    }
}

fn offers_text(offers: &[OfferedSize]) -> String {
    const MOST: usize = 40;
    let mut text: Vec<String> = offers.iter().take(MOST).map(ToString::to_string).collect();
    if offers.len() > MOST {
        text.push(format!("and {} more", offers.len() - MOST));
    }
    if text.is_empty() {
        "nothing that it would list".into()
    } else {
        text.join(", ")
    }
}

/// A failed call as an error that a person can act on.
pub fn call_error(system: &dyn V4lSystem, node: &Path, call: &str, errno: Errno) -> CaptureError {
    let node_buf = node.to_path_buf();
    match errno.0 {
        libc::EBUSY => CaptureError::Busy {
            node: node_buf,
            holders: system.holders(node),
        },
        libc::EACCES | libc::EPERM => CaptureError::Access {
            node: node_buf,
            reason: system.access_problem(node),
        },
        _ => CaptureError::Call {
            node: node_buf,
            call: call.into(),
            errno: errno.0,
            reason: errno.to_string(),
        },
    }
}

/// STREAMON's ENOSPC, with the arithmetic.
pub fn bandwidth_error(node: &Path, setup: &Setup, asked_fps: f64) -> CaptureError {
    let rate_fps = if setup.rate_fps > 0.0 {
        setup.rate_fps
    } else {
        asked_fps
    };
    CaptureError::Bandwidth {
        node: node.to_path_buf(),
        format: setup.format.words(),
        rate_fps,
        mbit_s: f64::from(setup.format.size_bytes) * 8.0 * rate_fps / 1e6,
    }
}

/// Format, rate, controls, buffers: set, read back, compared.
///
/// # Errors
/// Whatever differs from the rig, and every failed call.
pub fn configure(
    device: &mut dyn V4lDevice,
    system: &dyn V4lSystem,
    node: &Path,
    camera: &Camera,
) -> Result<Setup, CaptureError> {
    let failed = |call: &str, errno: Errno| call_error(system, node, call, errno);
    let capability = device
        .capability()
        .map_err(|e| failed("VIDIOC_QUERYCAP", e))?;
    for (bits, missing) in [
        (CAP_CAPTURE | CAP_CAPTURE_MPLANE, "V4L2_CAP_VIDEO_CAPTURE"),
        (CAP_STREAMING, "V4L2_CAP_STREAMING"),
    ] {
        if capability.caps & bits == 0 {
            let (node, card, caps) = (node.to_path_buf(), capability.card, capability.caps);
            return Err(CaptureError::NotACamera {
                node,
                card,
                caps,
                missing,
            });
        }
    }
    let format = set_format(device, system, node, camera)?;
    let rate_fps = set_rate(device, system, node, camera)?;
    let controls = controls::apply(device, node, &camera.controls)?;
    let buffers = device
        .request_buffers(BUFFERS)
        .map_err(|e| failed("VIDIOC_REQBUFS", e))?;
    if buffers < 2 {
        return Err(failed("VIDIOC_REQBUFS", Errno(libc::ENOMEM)));
    }
    Ok(Setup {
        capability,
        format,
        rate_fps,
        controls,
        buffers,
    })
}

fn set_format(
    device: &mut dyn V4lDevice,
    system: &dyn V4lSystem,
    node: &Path,
    camera: &Camera,
) -> Result<PixFormat, CaptureError> {
    let wanted = PixFormat {
        fourcc: camera.pixel_format.fourcc(),
        width_px: camera.width_px,
        height_px: camera.height_px,
        // Zero: the driver computes them. A stride left from another format would be kept by some drivers.
        stride_bytes: 0,
        size_bytes: 0,
        field: 0,
        ..PixFormat::default()
    };
    let got = device
        .set_format(&wanted)
        .map_err(|e| call_error(system, node, "VIDIOC_S_FMT", e))?;
    let same = (got.fourcc, got.width_px, got.height_px)
        == (wanted.fourcc, wanted.width_px, wanted.height_px);
    let (format, stride) = (camera.pixel_format, u64::from(got.stride_bytes));
    let fits = format.is_compressed()
        || stride >= format.row_bytes(camera.width_px)
            && u64::from(got.size_bytes) >= stride * format.memory_rows(camera.height_px);
    if same && got.memory_planes > 1 {
        return Err(CaptureError::Planes {
            node: node.to_path_buf(),
            format: got.words(),
            planes: got.memory_planes,
            offers: offers_text(&device.offers()),
        });
    }
    let bytes = format.image_bytes(camera.width_px, camera.height_px, got.stride_bytes);
    if same && fits && bytes > FRAME_BYTES_MAX {
        return Err(CaptureError::Format {
            node: node.to_path_buf(),
            asked: wanted.words(),
            got: format!(
                "rows of {} bytes, {bytes} in all, more than the {FRAME_BYTES_MAX} of the largest frame that is recorded",
                got.stride_bytes
            ),
            offers: offers_text(&device.offers()),
        });
    }
    if !same || !fits {
        return Err(CaptureError::Format {
            node: node.to_path_buf(),
            asked: wanted.words(),
            got: format!(
                "{} (stride {}, {} bytes)",
                got.words(),
                got.stride_bytes,
                got.size_bytes
            ),
            offers: offers_text(&device.offers()),
        });
    }
    Ok(got)
}

/// A channel is computed over the levels that the rig names; where it names none, the driver must mean the standard ones.
pub fn check_range(node: &Path, camera: &Camera, format: &PixFormat) -> Result<(), CaptureError> {
    let said = match format.full_range {
        true => YuvRange::Full,
        false => YuvRange::Limited,
    };
    if camera.pixel_format.is_yuv() && camera.yuv_range.is_none() && said != YuvRange::default() {
        return Err(CaptureError::YuvRange {
            node: node.to_path_buf(),
            format: format.words(),
            said: said.name(),
        });
    }
    Ok(())
}

fn set_rate(
    device: &mut dyn V4lDevice,
    system: &dyn V4lSystem,
    node: &Path,
    camera: &Camera,
) -> Result<f64, CaptureError> {
    let asked_fps = camera.rate_fps;
    let whole = asked_fps.round();
    let interval = if (asked_fps - whole).abs() < 1e-9 {
        (1, whole as u32)
    } else {
        (1000, (asked_fps * 1000.0).round() as u32)
    };
    let got = match device.set_interval(interval) {
        Ok(got) => got,
        // The driver has no rate to set; the stamps will show it.
        Err(Errno(libc::ENOTTY | libc::EINVAL)) => None,
        Err(e) => return Err(call_error(system, node, "VIDIOC_S_PARM", e)),
    };
    let Some((numerator, denominator)) = got else {
        return Ok(0.0);
    };
    let got_fps = f64::from(denominator) / f64::from(numerator);
    if (got_fps / asked_fps - 1.0).abs() > SAME_RATE {
        return Err(CaptureError::Rate {
            node: node.to_path_buf(),
            asked_fps,
            got_fps,
            offers: offers_text(&device.offers()),
        });
    }
    Ok(got_fps)
}
