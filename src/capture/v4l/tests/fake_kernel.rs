//! A kernel in memory with one camera on it: videobuf2's rules, a clock of its own, faults by time.

use std::collections::{BTreeMap, VecDeque};
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, MutexGuard};
use std::time::Duration;

use hydroline_rigs::{DeviceIdentity, PixelFormat};

use crate::v4l::device::*;
use crate::v4l::setup::{CAP_CAPTURE, CAP_STREAMING};
use crate::v4l::stamp::flags;
use hydroline_core::clock::{Clock, ManualClock};

pub const MS: u64 = 1_000_000;
pub const AUTO_EXPOSURE: u32 = 0x009a_0901;
pub const EXPOSURE: u32 = crate::v4l::controls::EXPOSURE_ABSOLUTE;
pub const GAIN: u32 = 0x0098_0913;

/// A small image as a camera's JPEG encoder makes it.
pub fn jpeg() -> Vec<u8> {
    let image = image::GrayImage::from_fn(64, 48, |x, y| {
        let z = (f64::from(y) - 21.3 - 0.05 * f64::from(x)) / 2.0;
        image::Luma([12 + (180.0 * (-0.5 * z * z).exp()) as u8 + ((x * 7 + y * 13) % 5) as u8])
    });
    let mut bytes = Vec::new();
    image::codecs::jpeg::JpegEncoder::new_with_quality(&mut bytes, 95)
        .encode_image(&image)
        .unwrap();
    bytes
}

#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Fault {
    Unplug,
    Plug,
    Freeze,
    Thaw,
    /// EIO until STREAMOFF.
    Fatal,
    /// EIO again at once after each of the next n STREAMONs.
    FatalAfterStart(u32),
    /// ERROR flag on the next frame.
    Damage,
    /// The next frame is half as long.
    Halve,
    /// Bytes in the middle of the next frame are gone.
    Hole,
    /// The device drops n frames: no trace in the sequence.
    DeviceDrop(u32),
    /// The driver drops n frames: a gap in the sequence.
    DriverDrop(u32),
    /// All queued buffers come back empty, then silence until STREAMOFF.
    Void,
    /// The next poll and dequeue are interrupted.
    Interrupt,
    /// Something else sets a control.
    Control(u32, i64),
    /// The frame period from now on.
    Period(u64),
}

pub struct World {
    pub clock: Arc<ManualClock>,
    pub faults: VecDeque<(u64, Fault)>,
    pub period_ns: u64,
    pub present: bool,
    pub capability: Capability,
    /// Format that S_FMT makes of any request; `None` = takes it.
    pub format_override: Option<PixFormat>,
    pub memory_planes: u32,
    pub full_range: bool,
    pub rate_override: Option<(u32, u32)>,
    pub stream_on_errno: Option<i32>,
    pub open_errno: Option<i32>,
    pub refused_control: Option<u32>,
    pub controls: BTreeMap<u32, i64>,
    pub flags: u32,
    pub jpeg: bool,
    pub stamp_offset_ns: i64,
    pub handles: u32,
    pub calls: u64,
    format: PixFormat,
    queued: VecDeque<u32>,
    done: VecDeque<(BufferInfo, Vec<u8>)>,
    contents: Vec<Vec<u8>>,
    streaming: bool,
    error: bool,
    frozen: bool,
    silent: bool,
    fatal_starts: u32,
    damage: bool,
    halve: bool,
    hole: bool,
    device_drop: u32,
    interrupts: u32,
    sequence: u32,
    next_frame_ns: u64,
}

impl World {
    pub fn new(clock: Arc<ManualClock>) -> Self {
        let now = clock.monotonic_ns();
        Self {
            clock,
            faults: VecDeque::new(),
            period_ns: 40 * MS,
            present: true,
            capability: Capability {
                driver: "fakevideo".into(),
                card: "Fake".into(),
                bus_info: "fake:0".into(),
                version: 0x06_0100,
                caps: CAP_CAPTURE | CAP_STREAMING,
            },
            format_override: None,
            memory_planes: 1,
            full_range: false,
            rate_override: None,
            stream_on_errno: None,
            open_errno: None,
            refused_control: None,
            controls: [(AUTO_EXPOSURE, 3), (EXPOSURE, 157), (GAIN, 0)].into(),
            flags: flags::MONOTONIC | flags::SOE,
            jpeg: false,
            stamp_offset_ns: 0,
            handles: 0,
            calls: 0,
            format: PixFormat::default(),
            queued: VecDeque::new(),
            done: VecDeque::new(),
            contents: Vec::new(),
            streaming: false,
            error: false,
            frozen: false,
            silent: false,
            fatal_starts: 0,
            damage: false,
            halve: false,
            hole: false,
            device_drop: 0,
            interrupts: 0,
            sequence: 0,
            next_frame_ns: now,
        }
    }

    fn stop(&mut self) {
        (self.streaming, self.error, self.silent) = (false, false, false);
        self.queued.clear();
        self.done.clear();
    }

    fn strike(&mut self, fault: Fault) {
        match fault {
            Fault::Unplug => {
                self.present = false;
                self.controls = [(AUTO_EXPOSURE, 3), (EXPOSURE, 157), (GAIN, 0)].into();
            }
            Fault::Plug => self.present = true,
            Fault::Freeze => self.frozen = true,
            Fault::Thaw => self.frozen = false,
            Fault::Fatal => self.error |= self.streaming,
            Fault::FatalAfterStart(n) => {
                self.error |= self.streaming;
                self.fatal_starts = n;
            }
            Fault::Damage => self.damage = true,
            Fault::Halve => self.halve = true,
            Fault::Hole => self.hole = true,
            Fault::DeviceDrop(n) => self.device_drop += n,
            Fault::DriverDrop(n) => {
                self.sequence = self.sequence.wrapping_add(n).wrapping_add(self.lose(n))
            }
            Fault::Void => {
                while let Some(index) = self.queued.pop_front() {
                    self.done.push_back((
                        BufferInfo {
                            index,
                            flags: flags::ERROR,
                            ..BufferInfo::default()
                        },
                        Vec::new(),
                    ));
                }
                self.silent = true;
            }
            Fault::Interrupt => self.interrupts += 2,
            Fault::Control(id, value) => {
                self.controls.insert(id, value);
            }
            Fault::Period(ns) => self.period_ns = ns,
        }
    }

    /// Skips n frame times.
    fn lose(&mut self, n: u32) -> u32 {
        self.next_frame_ns += u64::from(n) * self.period_ns;
        0
    }

    /// Lets everything happen that is due.
    fn pass(&mut self) {
        let now = self.clock.monotonic_ns();
        loop {
            let fault_at = self.faults.front().map_or(u64::MAX, |(at, _)| *at);
            let frame_at = self.next_frame_ns;
            if fault_at.min(frame_at) > now {
                return;
            }
            if fault_at <= frame_at {
                if let Some((_, fault)) = self.faults.pop_front() {
                    self.strike(fault);
                }
            } else {
                self.next_frame_ns += self.period_ns;
                self.expose(frame_at);
            }
        }
    }

    fn expose(&mut self, at: u64) {
        if !self.streaming || self.error || self.frozen || self.silent || !self.present {
            return;
        }
        if self.device_drop > 0 {
            self.device_drop -= 1;
            return;
        }
        let sequence = self.sequence;
        self.sequence = sequence.wrapping_add(1);
        let Some(index) = self.queued.pop_front() else {
            return;
        };
        let mut data = if self.jpeg {
            jpeg()
        } else {
            vec![sequence as u8; self.format.size_bytes as usize]
        };
        if std::mem::take(&mut self.halve) {
            data.truncate(data.len() / 2);
        }
        if std::mem::take(&mut self.hole) {
            let middle = data.len() / 2;
            data.drain(middle..middle + data.len() / 8);
        }
        let error = if std::mem::take(&mut self.damage) {
            flags::ERROR
        } else {
            0
        };
        let info = BufferInfo {
            index,
            bytes_used: data.len() as u32,
            flags: self.flags | error,
            field: 1,
            stamp_ns: at.saturating_add_signed(self.stamp_offset_ns),
            sequence,
        };
        self.done.push_back((info, data));
    }

    fn check(&mut self) -> Result<(), Errno> {
        self.calls += 1;
        self.pass();
        if self.present {
            Ok(())
        } else {
            Err(Errno(libc::ENODEV))
        }
    }
}

#[derive(Clone)]
pub struct FakeSystem(pub Arc<Mutex<World>>);

impl FakeSystem {
    pub fn world(&self) -> MutexGuard<'_, World> {
        self.0.lock().unwrap()
    }
}

impl V4lSystem for FakeSystem {
    fn find(&mut self, _: &DeviceIdentity) -> Result<PathBuf, NotFound> {
        let mut world = self.world();
        world.pass();
        if world.present {
            Ok("/dev/video9".into())
        } else {
            Err(NotFound {
                present: "nothing".into(),
            })
        }
    }

    fn open(&mut self, _: &Path) -> Result<Box<dyn V4lDevice>, Errno> {
        let mut world = self.world();
        world.check()?;
        if let Some(errno) = world.open_errno {
            return Err(Errno(errno));
        }
        assert_eq!(
            world.handles, 0,
            "the old node must be closed before the new one is opened"
        );
        world.handles += 1;
        Ok(Box::new(FakeDevice {
            world: Arc::clone(&self.0),
            dead: false,
        }))
    }

    fn holders(&self, _: &Path) -> String {
        "77 (ffmpeg)".into()
    }

    fn access_problem(&self, _: &Path) -> String {
        "it belongs to root:video".into()
    }

    fn module_parameters(&self, _: &str) -> BTreeMap<String, String> {
        [("nodrop".to_owned(), "1".to_owned())].into()
    }
}

struct FakeDevice {
    world: Arc<Mutex<World>>,
    /// Opened before an unplug: of no use even when the device is back.
    dead: bool,
}

impl FakeDevice {
    fn enter(&mut self) -> Result<MutexGuard<'_, World>, Errno> {
        let mut world = self.world.lock().unwrap();
        let here = world.check();
        self.dead |= here.is_err();
        if self.dead {
            Err(Errno(libc::ENODEV))
        } else {
            Ok(world)
        }
    }
}

impl Drop for FakeDevice {
    fn drop(&mut self) {
        let mut world = self.world.lock().unwrap();
        world.handles -= 1;
        world.stop();
    }
}

impl V4lDevice for FakeDevice {
    fn capability(&mut self) -> Result<Capability, Errno> {
        Ok(self.enter()?.capability.clone())
    }

    fn format(&mut self) -> Result<PixFormat, Errno> {
        Ok(self.enter()?.format)
    }

    fn set_format(&mut self, format: &PixFormat) -> Result<PixFormat, Errno> {
        let mut world = self.enter()?;
        assert_eq!(
            (format.stride_bytes, format.size_bytes),
            (0, 0),
            "the driver must be free to compute these"
        );
        let kind = PixelFormat::of_fourcc(format.fourcc).unwrap_or(PixelFormat::Grey);
        let row = kind.row_bytes(format.width_px) as u32;
        let computed = PixFormat {
            stride_bytes: row,
            size_bytes: kind.image_bytes(format.width_px, format.height_px, 0) as u32,
            field: 1,
            memory_planes: world.memory_planes,
            full_range: world.full_range,
            ..*format
        };
        world.format = world.format_override.unwrap_or(computed);
        Ok(world.format)
    }

    fn offers(&mut self) -> Vec<OfferedSize> {
        vec![OfferedSize {
            fourcc: "YUYV".into(),
            min_px: (320, 240),
            max_px: (320, 240),
            rates_fps: vec![30.0, 15.0],
        }]
    }

    fn set_interval(&mut self, interval: (u32, u32)) -> Result<Option<(u32, u32)>, Errno> {
        let world = self.enter()?;
        Ok(Some(world.rate_override.unwrap_or(interval)))
    }

    fn control_info(&mut self, id: u32) -> Result<ControlInfo, Errno> {
        let world = self.enter()?;
        let wanted = id & 0x7fff_ffff;
        let found = if id & 0x8000_0000 != 0 {
            world.controls.keys().find(|k| **k > wanted)
        } else {
            world.controls.keys().find(|k| **k == wanted)
        };
        let id = *found.ok_or(Errno(libc::EINVAL))?;
        let (name, max) = match id {
            AUTO_EXPOSURE => ("Auto Exposure", 3),
            EXPOSURE => ("Exposure Time, Absolute", 5000),
            _ => ("Gain", 100),
        };
        let inactive = if id == EXPOSURE && world.controls[&AUTO_EXPOSURE] != 1 {
            0x10
        } else {
            0
        };
        Ok(ControlInfo {
            id,
            name: name.into(),
            kind: 1,
            min: 0,
            max,
            step: 1,
            default: 0,
            flags: inactive,
        })
    }

    fn control(&mut self, id: u32) -> Result<i64, Errno> {
        self.enter()?
            .controls
            .get(&id)
            .copied()
            .ok_or(Errno(libc::EINVAL))
    }

    fn set_control(&mut self, id: u32, value: i64) -> Result<(), Errno> {
        let mut world = self.enter()?;
        if world.refused_control == Some(id) {
            return Err(Errno(libc::ERANGE));
        }
        // An inactive control takes nothing, silently.
        if id != EXPOSURE || world.controls[&AUTO_EXPOSURE] == 1 {
            world.controls.insert(id, value);
        }
        Ok(())
    }

    fn request_buffers(&mut self, count: u32) -> Result<u32, Errno> {
        let mut world = self.enter()?;
        world.contents = vec![Vec::new(); count as usize];
        Ok(count)
    }

    fn enqueue(&mut self, index: u32) -> Result<(), Errno> {
        let mut world = self.enter()?;
        if world.error {
            return Err(Errno(libc::EIO));
        }
        assert!(!world.queued.contains(&index), "queued twice");
        assert!(
            !world.done.iter().any(|(b, _)| b.index == index),
            "queued while the kernel has it"
        );
        world.queued.push_back(index);
        Ok(())
    }

    fn dequeue(&mut self) -> Result<BufferInfo, Errno> {
        let mut world = self.enter()?;
        if world.interrupts > 0 {
            world.interrupts -= 1;
            return Err(Errno(libc::EINTR));
        }
        if world.error {
            return Err(Errno(libc::EIO));
        }
        let (info, data) = world.done.pop_front().ok_or(Errno(libc::EAGAIN))?;
        world.contents[info.index as usize] = data;
        Ok(info)
    }

    fn stream_on(&mut self) -> Result<(), Errno> {
        let mut world = self.enter()?;
        if let Some(errno) = world.stream_on_errno {
            return Err(Errno(errno));
        }
        (world.streaming, world.sequence) = (true, 0);
        if world.fatal_starts > 0 {
            world.fatal_starts -= 1;
            world.error = true;
        }
        Ok(())
    }

    fn stream_off(&mut self) -> Result<(), Errno> {
        self.enter()?.stop();
        Ok(())
    }

    fn poll(&mut self, wait: Duration) -> Result<bool, Errno> {
        let clock = Arc::clone(&self.world.lock().unwrap().clock);
        let end = clock.monotonic_ns() + wait.as_nanos() as u64;
        loop {
            let next = {
                let mut world = self.world.lock().unwrap();
                world.calls += 1;
                world.pass();
                if !world.present || world.error || !world.done.is_empty() {
                    return Ok(true);
                }
                if world.interrupts > 0 {
                    world.interrupts -= 1;
                    return Err(Errno(libc::EINTR));
                }
                world
                    .next_frame_ns
                    .min(world.faults.front().map_or(u64::MAX, |(at, _)| *at))
                    .min(end)
            };
            let now = clock.monotonic_ns();
            if now >= end {
                return Ok(false);
            }
            clock.advance(Duration::from_nanos(next.saturating_sub(now).max(1)));
        }
    }

    fn read(&mut self, index: u32, bytes: usize, into: &mut Vec<u8>) -> usize {
        let world = self.world.lock().unwrap();
        let data = &world.contents[index as usize];
        into.extend_from_slice(&data[..bytes.min(data.len())]);
        world.format.size_bytes.max(4096) as usize
    }
}
