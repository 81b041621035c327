//! Description of a source: goes into the log's session metadata as JSON.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

/// A source as it is set up now, everything read back from the device.
#[derive(Debug, Clone, PartialEq, Default, Serialize, schemars::JsonSchema, Deserialize)]
pub struct SourceDescription {
    /// Kind of source: "v4l2" or "sim".
    pub kind: String,
    /// Driver name (QUERYCAP), e.g. `uvcvideo`; empty where there is none.
    pub driver: String,
    /// Driver version as the kernel prints it, e.g. `6.1.0`.
    pub driver_version: String,
    /// Card name (QUERYCAP).
    pub card: String,
    /// Bus info (QUERYCAP).
    pub bus_info: String,
    /// The stable identity the rig asked for, e.g. `by-id usb-...`.
    pub identity: String,
    /// The node it resolved to, e.g. `/dev/video0`.
    pub node: String,
    /// Size and pixel format that the driver accepted.
    pub format: NegotiatedFormat,
    /// Frame rate as read back \[1/s\]; 0 = the driver does not state it.
    pub rate_fps: f64,
    /// Controls as read back.
    pub controls: Vec<ControlReading>,
    /// `/sys/module/<driver>/parameters/*` that change the meaning of stamps and flags.
    pub module_parameters: BTreeMap<String, String>,
    /// Buffers in the driver's queue.
    pub buffers: u32,
}

/// The format as the device returned it.
#[derive(Debug, Clone, PartialEq, Default, Serialize, schemars::JsonSchema, Deserialize)]
pub struct NegotiatedFormat {
    /// Four characters, e.g. `GREY`.
    pub fourcc: String,
    /// Width \[px\].
    pub width_px: u32,
    /// Height \[px\].
    pub height_px: u32,
    /// Bytes per row; 0 for compressed formats.
    pub stride_bytes: u32,
    /// Largest frame \[bytes\].
    pub size_bytes: u32,
    /// V4L2 field order: `none` = progressive, `interlaced`, ...
    pub field: String,
    /// Levels of Y'CbCr as the driver says; `None` for other formats.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub yuv_range: Option<String>,
}

/// One control as read back.
#[derive(Debug, Clone, PartialEq, Default, Serialize, schemars::JsonSchema, Deserialize)]
pub struct ControlReading {
    /// Name as in the rig.
    pub name: String,
    /// V4L2 id.
    pub id: u32,
    /// Value asked by the rig; `None` = only read.
    pub asked: Option<i64>,
    /// Value read back.
    pub value: i64,
}
