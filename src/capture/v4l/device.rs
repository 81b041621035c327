//! Calls to the kernel that the adapter needs: the real one is [`super::kernel`], the tests' one lives in memory.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::time::Duration;

use hydroline_rigs::DeviceIdentity;
use serde::{Deserialize, Serialize};

/// An errno of a failed call.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Errno(pub i32);

impl std::fmt::Display for Errno {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{}", std::io::Error::from_raw_os_error(self.0))
    }
}

/// Answer to QUERYCAP.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Capability {
    /// Driver name.
    pub driver: String,
    /// Card name.
    pub card: String,
    /// Bus info.
    pub bus_info: String,
    /// KERNEL_VERSION(a, b, c).
    pub version: u32,
    /// V4L2_CAP_* of this node (`device_caps` where the driver fills it).
    pub caps: u32,
}

/// A pixel format.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct PixFormat {
    /// Four characters.
    pub fourcc: [u8; 4],
    /// Width \[px\].
    pub width_px: u32,
    /// Height \[px\].
    pub height_px: u32,
    /// Bytes per row.
    pub stride_bytes: u32,
    /// Bytes per frame.
    pub size_bytes: u32,
    /// V4L2_FIELD_*.
    pub field: u32,
    /// Planes that lie in memory of their own; 0 and 1 = all in one.
    pub memory_planes: u32,
    /// Levels of Y'CbCr from 0 to 255 (V4L2_QUANTIZATION_FULL_RANGE); without meaning for other formats.
    pub full_range: bool,
}

/// A control's description.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct ControlInfo {
    /// V4L2_CID_*.
    pub id: u32,
    /// The driver's name for it.
    pub name: String,
    /// V4L2_CTRL_TYPE_*.
    pub kind: u32,
    /// Least value.
    pub min: i64,
    /// Largest value.
    pub max: i64,
    /// Step between values.
    pub step: u64,
    /// Default value.
    pub default: i64,
    /// V4L2_CTRL_FLAG_*.
    pub flags: u32,
}

/// A dequeued buffer.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct BufferInfo {
    /// Index of the buffer.
    pub index: u32,
    /// Bytes in it.
    pub bytes_used: u32,
    /// V4L2_BUF_FLAG_*.
    pub flags: u32,
    /// V4L2_FIELD_*.
    pub field: u32,
    /// The driver's stamp \[ns\] (resolution 1000).
    pub stamp_ns: u64,
    /// The driver's sequence.
    pub sequence: u32,
}

/// A frame size the device offers, with its rates.
#[derive(Debug, Clone, PartialEq, Default, Serialize, schemars::JsonSchema, Deserialize)]
pub struct OfferedSize {
    /// Four characters.
    pub fourcc: String,
    /// Smallest width, height \[px\].
    pub min_px: (u32, u32),
    /// Largest width, height \[px\]; equal to `min_px` for a single size.
    pub max_px: (u32, u32),
    /// Frame rates at the largest size \[1/s\]; for a range its two ends.
    pub rates_fps: Vec<f64>,
}

impl std::fmt::Display for OfferedSize {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{} {}x{}", self.fourcc, self.min_px.0, self.min_px.1)?;
        if self.max_px != self.min_px {
            write!(f, "..{}x{}", self.max_px.0, self.max_px.1)?;
        }
        let rates: Vec<_> = self
            .rates_fps
            .iter()
            .map(|r| {
                format!("{:.4}", r)
                    .trim_end_matches('0')
                    .trim_end_matches('.')
                    .to_owned()
            })
            .collect();
        if rates.is_empty() {
            Ok(())
        } else {
            write!(f, " @ {}", rates.join("/"))
        }
    }
}

/// An opened V4L2 capture node.
pub trait V4lDevice: Send {
    /// Capability of the node (VIDIOC_QUERYCAP).
    fn capability(&mut self) -> Result<Capability, Errno>;
    /// Current format (VIDIOC_G_FMT).
    fn format(&mut self) -> Result<PixFormat, Errno>;
    /// VIDIOC_S_FMT; returns what the driver made of it.
    fn set_format(&mut self, format: &PixFormat) -> Result<PixFormat, Errno>;
    /// VIDIOC_ENUM_FMT, _FRAMESIZES, _FRAMEINTERVALS; what cannot be queried is omitted.
    fn offers(&mut self) -> Vec<OfferedSize>;
    /// VIDIOC_S_PARM: seconds per frame as a fraction; returns what the driver made of it, `None` = it cannot say.
    fn set_interval(&mut self, interval: (u32, u32)) -> Result<Option<(u32, u32)>, Errno>;
    /// VIDIOC_QUERY_EXT_CTRL of one id.
    fn control_info(&mut self, id: u32) -> Result<ControlInfo, Errno>;
    /// VIDIOC_G_EXT_CTRLS of one id.
    fn control(&mut self, id: u32) -> Result<i64, Errno>;
    /// VIDIOC_S_EXT_CTRLS of one id (so that each call has one class).
    fn set_control(&mut self, id: u32, value: i64) -> Result<(), Errno>;
    /// VIDIOC_REQBUFS and mmap; returns how many there are. 0 gives all back.
    fn request_buffers(&mut self, count: u32) -> Result<u32, Errno>;
    /// Gives a buffer to the driver (VIDIOC_QBUF).
    fn enqueue(&mut self, index: u32) -> Result<(), Errno>;
    /// Takes a filled buffer from the driver (VIDIOC_DQBUF).
    fn dequeue(&mut self) -> Result<BufferInfo, Errno>;
    /// Starts the stream (VIDIOC_STREAMON).
    fn stream_on(&mut self) -> Result<(), Errno>;
    /// Stops the stream (VIDIOC_STREAMOFF).
    fn stream_off(&mut self) -> Result<(), Errno>;
    /// poll(2) for POLLIN; `true` = something (a frame, an error) waits.
    fn poll(&mut self, wait: Duration) -> Result<bool, Errno>;
    /// Appends the first `bytes` bytes of a buffer that is ours; returns how many the map holds at most.
    fn read(&mut self, index: u32, bytes: usize, into: &mut Vec<u8>) -> usize;
}

/// The machine the devices hang on.
pub trait V4lSystem: Send {
    /// The node that has this identity now.
    fn find(&mut self, identity: &DeviceIdentity) -> Result<PathBuf, NotFound>;
    /// open(2).
    fn open(&mut self, node: &Path) -> Result<Box<dyn V4lDevice>, Errno>;
    /// Who has the node open, for a person: "1234 (ffmpeg), ...".
    fn holders(&self, node: &Path) -> String;
    /// Why the node may not be opened and what mends it, for a person.
    fn access_problem(&self, node: &Path) -> String;
    /// `/sys/module/<driver>/parameters`: those that change the meaning of stamps and flags.
    fn module_parameters(&self, driver: &str) -> BTreeMap<String, String>;
}

/// No node has the identity.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct NotFound {
    /// Devices that are present, in words.
    pub present: String,
}
