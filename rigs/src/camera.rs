//! Camera: backend, identity, format, controls, intrinsics, image noise.

use crate::device::is_device;
use crate::raw::{
    Kind, Quantity, Section, angle, flag, name, number, table, table_or_defaults, tables, text,
    whole, words,
};
use crate::{DeviceIdentity, FRAME_BYTES_MAX, PixelFormat, StatedResponse, YuvRange};

/// Where frames come from.
#[derive(Debug, Clone, PartialEq)]
pub enum CameraBackend {
    /// Rendered by the `sim` crate.
    Sim,
    /// A V4L2 device.
    V4l(DeviceIdentity),
}

impl CameraBackend {
    fn identity(&self) -> Option<&DeviceIdentity> {
        match self {
            CameraBackend::Sim => None,
            CameraBackend::V4l(identity) => Some(identity),
        }
    }
}

table! {
    /// A V4L2 control to set and to lock; they are set in this order (a mode before its value). Omitted: none is set.
    pub struct CameraControl as ControlTyped {
        /// Name of the control, as `hydroline devices --long` prints it.
        pub name: String = name(),
        /// Value that it is set to.
        pub value: i64 = whole(-2_147_483_648, i64::MAX, "(the control's own unit)"),
    }
}

table! {
    /// Image formation of the simulated camera.
    pub struct ImageNoise: Copy as NoiseTyped {
        /// Point spread of the optics: standard deviation of a Gaussian.
        pub blur_px: f64 = number(0.0, 20.0, "px").or(0.7),
        /// Read noise, standard deviation.
        pub read_sd: f64 = number(0.0, 64.0, "grey levels").or(2.0),
        /// Shot noise: variance per grey level of signal.
        pub shot_gain: f64 = number(0.0, 10.0, "grey levels").or(0.0),
        /// Background light on the whole image.
        pub ambient: f64 = number(0.0, 254.0, "grey levels").or(0.0),
    }
}

/// Folder of the stable names of cameras.
const FOLDER: &str = "/dev/v4l/";
/// Expected form of a camera's name, for messages.
const DEVICE: &str = "a text: the camera's stable name, `/dev/v4l/by-id/…` or `/dev/v4l/by-path/…`";

const fn focal() -> Quantity {
    number(1.0, 1e6, "px")
}

const fn point() -> Quantity {
    number(-1e5, 1e5, "px")
}

table! {
    /// The camera that sees the laser line, and when its frames are true.
    ///
    /// Pixel coordinates: 0 = centre of the top left pixel. Pinhole: with unit ray
    /// (X right, Y down, Z along the axis) `column_px = cx_px + fx_px X/Z`, `row_px = cy_px + fy_px Y/Z`.
    pub struct Camera as CameraTyped, checked by check {
        /// Where frames come from: rendered by the simulator, or from a V4L2 device.
        key is_v4l as "backend": bool = words([("sim", false), ("v4l", true)])
            => |c| Some(c.backend.identity().is_some()),
        /// Stable name of the V4L2 device, as `hydroline devices` prints it. Needed with `backend = "v4l"`, not allowed
        /// with `"sim"`.
        key device: Option<String> = text(DEVICE, |text| is_device(text, FOLDER)).optional()
            => |c| Some(c.backend.identity().map(|id| id.typed(FOLDER))),
        /// Whether `device` may be a `/dev/videoN`, which can be another camera after a replug.
        key allow_unstable_node: bool = flag().or(false).quiet()
            => |c| Some(matches!(c.backend, CameraBackend::V4l(DeviceIdentity::Node(_)))),
        /// Where frames come from.
        made backend: CameraBackend,
        /// Pixel format that the camera is asked for; `hydroline devices --long` prints what it offers.
        pub pixel_format: PixelFormat = words(PixelFormat::of_cameras().map(|f| (f.name(), f))),
        /// Bits that samples of 16 bits really hold, right-aligned. Omitted: those of the pixel format.
        pub bits: Option<u8> = whole(8, 16, "bits").optional(),
        /// Levels of luma in YUYV, UYVY and NV12: 16 to 235 (limited) or 0 to 255 (full). Omitted: what the standard of
        /// the format says.
        ///
        /// `None` = limited, and the driver must agree where it matters.
        pub yuv_range: Option<YuvRange> = words(YuvRange::ALL).optional(),
        /// Width of the image.
        pub width_px: u32 = whole(16, 16384, "px"),
        /// Height of the image. A frame takes at most 67108864 bytes (64 MiB).
        pub height_px: u32 = whole(16, 16384, "px"),
        /// Frame rate that the camera is asked for.
        pub rate_fps: f64 = number(0.1, 1000.0, "frames per second"),
        /// Exposure time. A frame is stamped at mid-exposure. At most one frame period.
        pub exposure_s: f64 = number(0.0, 10.0, "s").above().hint("Typical: 0.002 to 0.010"),
        /// Vertical field of view, of a camera with square pixels and its axis through the image centre. Instead of
        /// `fx_px`, `fy_px`, `cx_px`, `cy_px`.
        key fov_vertical_rad: Option<f64> = angle(number(1.0, 170.0, "deg")).optional() => |_| None,
        /// Focal length along columns, of an intrinsic calibration; all four or none.
        pub fx_px: f64 = focal().later(None),
        /// Focal length along rows.
        pub fy_px: f64 = focal().later(None),
        /// Principal point, column; 0 is the centre of the top left pixel.
        pub cx_px: f64 = point().later(None),
        /// Principal point, row.
        pub cy_px: f64 = point().later(None),
        /// Seed of the simulated noise: the same seed gives the same frames.
        pub seed: u64 = whole(0, i64::MAX, "").or(1),
        /// Without a frame for this long the camera counts as frozen, and the stream is restarted. At least two frame
        /// periods.
        pub frozen_after_s: f64 = number(0.01, 600.0, "s").later("3 frame periods, at least 0.5"),
        /// Noise of the simulated image.
        pub noise: ImageNoise = table_or_defaults(),
        /// Response of the real camera, where it is known; `None` = a run's opening finds it. The simulated image does not
        /// go by it.
        pub response: Option<StatedResponse> = table().optional(),
        /// Controls to set and lock.
        key control: Vec<CameraControl> = tables(256) => |c| Some(c.controls.clone()),
        /// Controls to set and lock.
        made controls: Vec<CameraControl>,
    }
}

fn check(typed: &mut CameraTyped, s: &Section<'_>) {
    typed.backend = backend(typed, s);
    held_against_format(typed, s);
    intrinsics(typed, s);
    timing(typed, s);
    if let Some(controls) = &typed.control {
        for (i, control) in controls.iter().enumerate() {
            if controls[..i].iter().any(|c| c.name == control.name) {
                s.rule(
                    &format!("control[{i}].name"),
                    format!("the control {} is set twice", control.name),
                    "Keep one of the two entries",
                );
            }
        }
    }
    typed.controls = typed.control.take();
}

fn backend(typed: &CameraTyped, s: &Section<'_>) -> Option<CameraBackend> {
    match (typed.is_v4l?, typed.device.as_ref()?) {
        (false, None) => Some(CameraBackend::Sim),
        (false, Some(_)) => {
            s.rule(
                "device",
                "a device is named, but backend = \"sim\" renders its own frames",
                "Remove `device` or set backend = \"v4l\"",
            );
            None
        }
        (true, None) => {
            s.missing(
                "device",
                format!("`device = \"…\"`, {DEVICE}. `hydroline devices` lists them"),
            );
            None
        }
        (true, Some(text)) => {
            let allow_node = typed.allow_unstable_node?;
            DeviceIdentity::of(s, "device", text, FOLDER, allow_node).map(CameraBackend::V4l)
        }
    }
}

fn held_against_format(typed: &CameraTyped, s: &Section<'_>) {
    let Some(format) = typed.pixel_format else {
        return;
    };
    let name = format.name();
    let of_format = format.bits();
    if let Some(Some(bits)) = typed.bits
        && of_format != 16
        && of_format != bits
    {
        s.rule(
            "bits",
            format!("{bits}, but samples of {name} have {of_format} bits"),
            "Leave it out: only samples of 16 bits may hold fewer",
        );
    }
    if matches!(typed.yuv_range, Some(Some(_))) && !format.is_yuv() {
        s.rule(
            "yuv_range",
            format!("{name} holds no luma and chroma"),
            "Leave it out: only YUYV, UYVY and NV12 have one",
        );
    }
    for (key, size, paired, what) in [
        (
            "width_px",
            typed.width_px,
            format.pairs_columns(),
            "columns",
        ),
        ("height_px", typed.height_px, format.pairs_rows(), "rows"),
    ] {
        if let Some(size) = size.filter(|size| paired && size % 2 == 1) {
            s.rule(
                key,
                format!("{size} is odd, but {name} shares colour between pairs of {what}"),
                "Enter an even number or another pixel_format",
            );
        }
    }
    let (Some(width_px), Some(height_px)) = (typed.width_px, typed.height_px) else {
        return;
    };
    let bytes = format.counted_bytes(width_px, height_px);
    if bytes > FRAME_BYTES_MAX {
        s.rule(
            "height_px",
            format!(
                "a frame of {width_px} x {height_px} px in {name} has {bytes} bytes, and at most {FRAME_BYTES_MAX} are recorded"
            ),
            "Enter a smaller image, or a pixel_format with fewer bytes per pixel",
        );
    }
}

/// One way to describe the intrinsics: all four numbers, or the vertical field of view of a camera with square pixels
/// and its axis through the image centre.
fn intrinsics(typed: &mut CameraTyped, s: &Section<'_>) {
    let four = ["fx_px", "fy_px", "cx_px", "cy_px"];
    let fov_typed = s.has("fov_vertical_rad") || s.has("fov_vertical_deg");
    let first = four.into_iter().find(|key| s.has(key));
    match (fov_typed, first) {
        (true, Some(first)) => s.rule(
            first,
            "both fov_vertical and fx_px, fy_px, cx_px, cy_px are given",
            "Keep either the field of view or the four numbers of a calibration",
        ),
        (true, None) => {
            let size = typed.width_px.zip(typed.height_px);
            if let (Some((w, h)), Some(Some(fov_rad))) = (size, typed.fov_vertical_rad) {
                let (w, h) = (f64::from(w), f64::from(h));
                // Pinhole: the half height h/2 is seen under half the angle.
                let focal_px = 0.5 * h / (0.5 * fov_rad).tan();
                (typed.fx_px, typed.fy_px) = (Some(focal_px), Some(focal_px));
                (typed.cx_px, typed.cy_px) = (Some(0.5 * (w - 1.0)), Some(0.5 * (h - 1.0)));
            }
        }
        (false, None) => s.missing(
            "fov_vertical_deg",
            "`fov_vertical_deg = …` (1 to 170 deg), or fx_px, fy_px, cx_px and cy_px of a calibration",
        ),
        (false, Some(_)) => {
            for key in four.into_iter().filter(|key| !s.has(key)) {
                s.missing(
                    key,
                    format!("`{key} = …`: with fx_px, fy_px, cx_px, cy_px all four are needed"),
                );
            }
        }
    }
}

fn timing(typed: &mut CameraTyped, s: &Section<'_>) {
    if !s.has("frozen_after_s") {
        // Unplugging is to be noticed within 0.5 s, unless frames are rarer than that.
        typed.frozen_after_s = typed.rate_fps.map(|rate| (3.0 / rate).max(0.5));
    }
    let Some(rate_fps) = typed.rate_fps else {
        return;
    };
    let (frame_s, two_s) = (1.0 / rate_fps, 2.0 / rate_fps);
    if let Some(exposure_s) = typed.exposure_s.filter(|e| *e > frame_s) {
        s.rule(
            "exposure_s",
            format!("{exposure_s} s is longer than one frame period, 1/rate_fps = {frame_s} s"),
            "Shorten exposure_s or lower rate_fps",
        );
    }
    if let Some(frozen_s) = typed.frozen_after_s.filter(|f| *f < two_s) {
        s.rule(
            "frozen_after_s",
            format!(
                "{frozen_s} s is shorter than two frame periods, {two_s} s: every late frame would count as a frozen camera"
            ),
            "Enter at least two frame periods, or leave it out",
        );
    }
}
