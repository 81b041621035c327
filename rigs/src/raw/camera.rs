//! `[camera]` as typed.

use std::path::PathBuf;

use super::response::read_response;
use super::{Section, quantity};
use crate::{
    Camera, CameraBackend, CameraControl, DeviceIdentity, ImageNoise, PixelFormat, YuvRange,
};

/// What to do about a `/dev/videoN` or `/dev/ttyX`: the number is handed out in the
/// order of plugging in, so after a replug it may be another device.
pub(super) const UNSTABLE_NEXT: &str = "Run `hydroline devices` and enter the stable name it prints, \
     or set `allow_unstable_node = true` beside it to accept whatever device has that number";

/// Focal length, principal point: explicit, or from the vertical field of view.
struct Intrinsics {
    fx_px: f64,
    fy_px: f64,
    cx_px: f64,
    cy_px: f64,
}

pub(super) fn read_camera(s: &Section<'_>) -> Option<Camera> {
    let backend = s.choice("backend", &[("sim", false), ("v4l", true)]);
    let identity = read_identity(s, backend);
    let formats: Vec<_> = PixelFormat::of_cameras().map(|f| (f.name(), f)).collect();
    let pixel_format = s.choice("pixel_format", &formats);
    let bits = read_bits(s, pixel_format);
    let yuv_range = read_yuv_range(s, pixel_format);
    let width_px = s.integer("width_px", 16, 16384, "px").map(|v| v as u32);
    let height_px = s.integer("height_px", 16, 16384, "px").map(|v| v as u32);
    let rate_fps = s.number("rate_fps", quantity(0.1, 1000.0, "frames per second"));
    let exposure_s = s.number(
        "exposure_s",
        quantity(0.0, 10.0, "s")
            .above()
            .hint("Typical: 0.002 to 0.010"),
    );
    let intrinsics = read_intrinsics(s, width_px, height_px);
    let controls = read_controls(s);
    let noise = read_noise(&s.table_or_default("noise"));
    let response = read_response(s);
    let seed = s.integer_or("seed", [0, i64::MAX], "", 1) as u64;
    // Unplugging is to be noticed within 0.5 s, unless frames are rarer than that.
    let default_frozen_s = (3.0 / rate_fps.unwrap_or(25.0)).max(0.5);
    let frozen_after_s = s.number_or(
        "frozen_after_s",
        quantity(0.01, 600.0, "s"),
        default_frozen_s,
    );
    s.default_is("frozen_after_s", "3 frame periods, at least 0.5");

    if let (Some(rate), Some(exposure)) = (rate_fps, exposure_s) {
        if exposure > 1.0 / rate {
            s.rule(
                "exposure_s",
                format!(
                    "{exposure} s is longer than one frame period, 1/rate_fps = {} s",
                    1.0 / rate
                ),
                "Shorten exposure_s or lower rate_fps",
            );
        }
        if frozen_after_s < 2.0 / rate {
            s.rule(
                "frozen_after_s",
                format!(
                    "{frozen_after_s} s is shorter than two frame periods, {} s: every late frame would count as a frozen camera",
                    2.0 / rate
                ),
                "Enter at least two frame periods, or leave it out",
            );
        }
    }
    if let Some(format) = pixel_format {
        for (key, size, paired, what) in [
            ("width_px", width_px, format.pairs_columns(), "columns"),
            ("height_px", height_px, format.pairs_rows(), "rows"),
        ] {
            if let Some(size) = size.filter(|size| paired && size % 2 == 1) {
                s.rule(
                    key,
                    format!(
                        "{size} is odd, but {} shares colour between pairs of {what}",
                        format.name()
                    ),
                    "Enter an even number or another pixel_format",
                );
            }
        }
    }
    let Intrinsics {
        fx_px,
        fy_px,
        cx_px,
        cy_px,
    } = intrinsics?;
    Some(Camera {
        backend: match (backend?, identity?) {
            (true, Some(identity)) => CameraBackend::V4l(identity),
            _ => CameraBackend::Sim,
        },
        pixel_format: pixel_format?,
        bits: bits?,
        yuv_range: yuv_range?,
        width_px: width_px?,
        height_px: height_px?,
        rate_fps: rate_fps?,
        exposure_s: exposure_s?,
        fx_px,
        fy_px,
        cx_px,
        cy_px,
        controls: controls?,
        noise: noise?,
        response: response?,
        seed,
        frozen_after_s,
    })
}

/// Bits of samples that stand in 16. `Some(None)`: what the format says. `None`: reported.
fn read_bits(s: &Section<'_>, format: Option<PixelFormat>) -> Option<Option<u8>> {
    if !s.has("bits") {
        s.item("bits");
        return Some(None);
    }
    let bits = s.integer_opt("bits", 8, 16, "bits")? as u8;
    match format {
        Some(format) if format.bits() != 16 && format.bits() != bits => {
            s.rule(
                "bits",
                format!(
                    "{bits}, but samples of {} have {} bits",
                    format.name(),
                    format.bits()
                ),
                "Leave it out: only samples of 16 bits may hold fewer",
            );
            None
        }
        _ => Some(Some(bits)),
    }
}

/// `Some(None)`: the standard one. `None`: reported.
fn read_yuv_range(s: &Section<'_>, format: Option<PixelFormat>) -> Option<Option<YuvRange>> {
    if !s.has("yuv_range") {
        s.item("yuv_range");
        return Some(None);
    }
    let range = s.choice_opt("yuv_range", &YuvRange::ALL)?;
    match format {
        Some(format) if !format.is_yuv() => {
            s.rule(
                "yuv_range",
                format!("{} holds no luma and chroma", format.name()),
                "Leave it out: only YUYV, UYVY and NV12 have one",
            );
            None
        }
        _ => Some(Some(range)),
    }
}

/// `Some(None)`: no device needed. `None`: reported.
fn read_identity(s: &Section<'_>, is_v4l: Option<bool>) -> Option<Option<DeviceIdentity>> {
    let expected = "a text: the camera's stable name, `/dev/v4l/by-id/…` or `/dev/v4l/by-path/…`";
    let allow_node = s.flag_or("allow_unstable_node", false);
    if !s.has("device") {
        s.item("device");
        if is_v4l == Some(true) {
            s.missing(
                "device",
                format!("`device = \"…\"`, {expected}. `hydroline devices` lists them"),
            );
            return None;
        }
        return Some(None);
    }
    let (text, item) = s.text_opt("device", expected)?;
    if is_v4l == Some(false) {
        s.rule(
            "device",
            "a device is named, but backend = \"sim\" renders its own frames",
            "Remove `device` or set backend = \"v4l\"",
        );
        return None;
    }
    match stable_name(&text, "/dev/v4l/") {
        Some(StableName::ById(name)) => Some(Some(DeviceIdentity::ById(name))),
        Some(StableName::ByPath(name)) => Some(Some(DeviceIdentity::ByPath(name))),
        None if is_node(&text) => {
            if allow_node {
                return Some(Some(DeviceIdentity::Node(PathBuf::from(text))));
            }
            s.rule(
                "device",
                format!("{text} is not a stable name: after a replug it may be another camera"),
                UNSTABLE_NEXT,
            );
            None
        }
        None => {
            s.wrong_type(&item, expected);
            None
        }
    }
}

pub(super) enum StableName {
    ById(String),
    ByPath(String),
}

/// Splits `/dev/v4l/by-id/NAME` and its likes.
pub(super) fn stable_name(text: &str, folder: &str) -> Option<StableName> {
    let rest = text.strip_prefix(folder)?;
    let (kind, name) = rest.split_once('/')?;
    if !is_device_name(name) {
        return None;
    }
    match kind {
        "by-id" => Some(StableName::ById(name.to_owned())),
        "by-path" => Some(StableName::ByPath(name.to_owned())),
        _ => None,
    }
}

fn is_device_name(name: &str) -> bool {
    !name.is_empty()
        && name.len() <= 255
        && name != "."
        && name != ".."
        && !name.chars().any(|c| c == '/' || c.is_control())
}

/// `/dev/NAME` or `/dev/FOLDER/NAME`, nothing that leads out again, and not a misspelt
/// stable name.
pub(super) fn is_node(text: &str) -> bool {
    text.strip_prefix("/dev/").is_some_and(|rest| {
        !rest.starts_with("v4l/")
            && !rest.starts_with("serial/")
            && rest.split('/').all(is_device_name)
    })
}

/// One way to describe the intrinsics: all four numbers, or the vertical field of
/// view of a camera with square pixels and its axis through the image centre.
fn read_intrinsics(
    s: &Section<'_>,
    width_px: Option<u32>,
    height_px: Option<u32>,
) -> Option<Intrinsics> {
    let explicit = ["fx_px", "fy_px", "cx_px", "cy_px"];
    let typed: Vec<&str> = explicit.into_iter().filter(|key| s.has(key)).collect();
    let fov_typed = s.has("fov_vertical_rad") || s.has("fov_vertical_deg");
    // Asked for in any case, so that these keys are known when another is misspelt.
    let fov = s.angle_opt("fov_vertical", quantity(1.0, 170.0, "deg"));
    let focal = quantity(1.0, 1e6, "px");
    let point = quantity(-1e5, 1e5, "px");
    let values = [
        s.number_opt("fx_px", focal),
        s.number_opt("fy_px", focal),
        s.number_opt("cx_px", point),
        s.number_opt("cy_px", point),
    ];
    match (fov_typed, typed.is_empty()) {
        (true, false) => {
            s.rule(
                typed[0],
                "both fov_vertical and fx_px, fy_px, cx_px, cy_px are given",
                "Keep either the field of view or the four numbers of a calibration",
            );
            None
        }
        (true, true) => {
            let (w, h) = (f64::from(width_px?), f64::from(height_px?));
            // Pinhole: the half height h/2 is seen under half the angle.
            let focal_px = 0.5 * h / (0.5 * fov?).tan();
            Some(Intrinsics {
                fx_px: focal_px,
                fy_px: focal_px,
                cx_px: 0.5 * (w - 1.0),
                cy_px: 0.5 * (h - 1.0),
            })
        }
        (false, true) => {
            s.missing(
                "fov_vertical_deg",
                "`fov_vertical_deg = …` (1 to 170 deg), or fx_px, fy_px, cx_px and cy_px of a calibration",
            );
            None
        }
        (false, false) => {
            for key in explicit.into_iter().filter(|key| !typed.contains(key)) {
                s.missing(
                    key,
                    format!("`{key} = …`: with fx_px, fy_px, cx_px, cy_px all four are needed"),
                );
            }
            let [fx_px, fy_px, cx_px, cy_px] = values;
            Some(Intrinsics {
                fx_px: fx_px?,
                fy_px: fy_px?,
                cx_px: cx_px?,
                cy_px: cy_px?,
            })
        }
    }
}

fn read_controls(s: &Section<'_>) -> Option<Vec<CameraControl>> {
    let mut controls: Vec<CameraControl> = Vec::new();
    let mut sound = true;
    for entry in s.tables("control", 256) {
        let name = entry.name("name");
        let value = entry.integer(
            "value",
            i64::from(i32::MIN),
            i64::MAX,
            "(the control's own unit)",
        );
        entry.finish();
        match (name, value) {
            (Some(name), Some(value)) => {
                if controls.iter().any(|c| c.name == name) {
                    entry.rule(
                        "name",
                        format!("the control {name} is set twice"),
                        "Keep one of the two entries",
                    );
                }
                controls.push(CameraControl { name, value });
            }
            _ => sound = false,
        }
    }
    sound.then_some(controls)
}

fn read_noise(s: &Section<'_>) -> Option<ImageNoise> {
    let noise = ImageNoise {
        blur_px: s.number_or("blur_px", quantity(0.0, 20.0, "px"), 0.7),
        read_sd: s.number_or("read_sd", quantity(0.0, 64.0, "grey levels"), 2.0),
        shot_gain: s.number_or("shot_gain", quantity(0.0, 10.0, "grey levels"), 0.0),
        ambient: s.number_or("ambient", quantity(0.0, 254.0, "grey levels"), 0.0),
    };
    s.finish();
    Some(noise)
}
