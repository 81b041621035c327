//! Camera: backend, identity, format, controls, intrinsics, image noise.

use crate::{PixelFormat, StatedResponse, YuvRange};

/// Where frames come from.
#[derive(Debug, Clone, PartialEq)]
pub enum CameraBackend {
    /// Rendered by the `sim` crate.
    Sim,
    /// A V4L2 device.
    V4l(DeviceIdentity),
}

/// How a V4L2 device is found again after an unplug.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum DeviceIdentity {
    /// `/dev/v4l/by-id/<name>` (or, without udev, matched against sysfs vendor/product/serial).
    ById(String),
    /// `/dev/v4l/by-path/<name>` (or, without udev, matched against the bus info that QUERYCAP reports).
    ByPath(String),
    /// `/dev/videoN`: not stable, accepted only with `allow_unstable_node = true`.
    Node(std::path::PathBuf),
}

/// One V4L2 control to set, read back and lock, in this order (mode before value).
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct CameraControl {
    /// Control name in V4L2's snake_case form, e.g. `exposure_time_absolute`.
    pub name: String,
    /// Value in the control's own unit.
    pub value: i64,
}

/// Image formation noise of the simulated camera.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ImageNoise {
    /// Gaussian point-spread, standard deviation \[px\].
    pub blur_px: f64,
    /// Read noise, standard deviation \[grey levels\].
    pub read_sd: f64,
    /// Shot noise: variance per grey level of signal \[grey levels\]; 0 = none.
    pub shot_gain: f64,
    /// Constant background \[grey levels\].
    pub ambient: f64,
}

/// A checked camera.
///
/// Pixel coordinates: 0 = centre of the top left pixel. Pinhole: with unit ray
/// (X right, Y down, Z along the axis) `column_px = cx_px + fx_px X/Z`, `row_px = cy_px + fy_px Y/Z`.
#[derive(Debug, Clone, PartialEq)]
pub struct Camera {
    /// Where frames come from.
    pub backend: CameraBackend,
    /// Pixel format on the wire.
    pub pixel_format: PixelFormat,
    /// Bits that samples of 16 really have; `None` = what the format says.
    pub bits: Option<u8>,
    /// Levels of Y'CbCr; `None` = limited, and the driver must agree where it matters.
    pub yuv_range: Option<YuvRange>,
    /// Image width \[px\].
    pub width_px: u32,
    /// Image height \[px\].
    pub height_px: u32,
    /// Frame rate \[1/s\].
    pub rate_fps: f64,
    /// Exposure time \[s\]: mid-exposure = start of exposure + half of it.
    pub exposure_s: f64,
    /// Focal length along columns \[px\].
    pub fx_px: f64,
    /// Focal length along rows \[px\].
    pub fy_px: f64,
    /// Principal point, column \[px\].
    pub cx_px: f64,
    /// Principal point, row \[px\].
    pub cy_px: f64,
    /// Controls to set and lock.
    pub controls: Vec<CameraControl>,
    /// Noise of the simulated image.
    pub noise: ImageNoise,
    /// What is known of the real camera's response; `None` = a run's opening finds it. The simulated image does not go by it.
    pub response: Option<StatedResponse>,
    /// Seed of the simulated image's noise.
    pub seed: u64,
    /// Silence after which a camera counts as frozen \[s\].
    pub frozen_after_s: f64,
}
