//! The real kernel: `v4l`'s ioctl layer, our own buffers. Nothing here decides anything.

use std::ffi::c_void;
use std::mem;
use std::path::Path;
use std::time::Duration;

use v4l::v4l_sys as sys;
use v4l::v4l2::{self, vidioc};

use super::device::{
    BufferInfo, Capability, ControlInfo, Errno, OfferedSize, PixFormat, V4lDevice,
};
use super::setup::{CAP_CAPTURE, CAP_CAPTURE_MPLANE};

const CAPTURE: u32 = sys::v4l2_buf_type_V4L2_BUF_TYPE_VIDEO_CAPTURE;
const CAPTURE_MPLANE: u32 = sys::v4l2_buf_type_V4L2_BUF_TYPE_VIDEO_CAPTURE_MPLANE;
/// Planes that a buffer of the multi-planar interface can have (VIDEO_MAX_PLANES).
const PLANES_MAX: usize = 8;
const MMAP: u32 = sys::v4l2_memory_V4L2_MEMORY_MMAP;
/// Entries asked for at most per enumeration: a broken driver that never ends must not hang us.
const MOST_ENTRIES: u32 = 256;

struct Map {
    start: *mut u8,
    length: usize,
    /// Where the frame begins that was dequeued last (multi-planar interface).
    data_offset: usize,
}

/// An opened node.
pub struct KernelDevice {
    fd: i32,
    maps: Vec<Map>,
    /// V4L2_BUF_TYPE_*: whether the node speaks the single-planar or the multi-planar interface.
    kind: u32,
}

/// A buffer as the kernel takes and gives it, with its planes where the interface has them.
struct Buffer {
    buffer: sys::v4l2_buffer,
    planes: Box<[sys::v4l2_plane; PLANES_MAX]>,
}

// SAFETY: the maps are owned by this object alone and only reached through `&mut self`.
unsafe impl Send for KernelDevice {}

fn errno(error: &std::io::Error) -> Errno {
    Errno(error.raw_os_error().unwrap_or(libc::EIO))
}

/// A C string in a fixed array.
fn text(bytes: &[u8]) -> String {
    let end = bytes.iter().position(|b| *b == 0).unwrap_or(bytes.len());
    String::from_utf8_lossy(&bytes[..end]).into_owned()
}

impl KernelDevice {
    /// Opens the node, non-blocking, closed on exec.
    ///
    /// # Errors
    /// open(2)'s.
    pub fn open(node: &Path) -> Result<Self, Errno> {
        // `v4l2::open` unwraps a NUL inside the path.
        if node.as_os_str().as_encoded_bytes().contains(&0) {
            return Err(Errno(libc::EINVAL));
        }
        let fd = v4l2::open(node, libc::O_RDWR | libc::O_NONBLOCK | libc::O_CLOEXEC)
            .map_err(|e| errno(&e))?;
        let mut device = Self {
            fd,
            maps: Vec::new(),
            kind: CAPTURE,
        };
        let caps = device.capability().map_or(0, |c| c.caps);
        if caps & CAP_CAPTURE == 0 && caps & CAP_CAPTURE_MPLANE != 0 {
            device.kind = CAPTURE_MPLANE;
        }
        Ok(device)
    }

    /// One ioctl on a plain C structure of the size its request number states.
    fn call<T>(&self, request: vidioc::_IOC_TYPE, argument: &mut T) -> Result<(), Errno> {
        loop {
            // SAFETY: `argument` is a live, initialised structure of the type the request is defined with.
            match unsafe {
                v4l2::ioctl(
                    self.fd,
                    request,
                    std::ptr::from_mut(argument).cast::<c_void>(),
                )
            } {
                Ok(()) => return Ok(()),
                Err(e) if e.raw_os_error() == Some(libc::EINTR) => {}
                Err(e) => return Err(errno(&e)),
            }
        }
    }

    fn multiplanar(&self) -> bool {
        self.kind == CAPTURE_MPLANE
    }

    fn buffer(&self, index: u32) -> Buffer {
        let mut b = Buffer {
            buffer: zeroed(),
            planes: Box::new([zeroed(); PLANES_MAX]),
        };
        (b.buffer.index, b.buffer.type_, b.buffer.memory) = (index, self.kind, MMAP);
        if self.multiplanar() {
            b.buffer.m.planes = b.planes.as_mut_ptr();
            b.buffer.length = PLANES_MAX as u32;
        }
        b
    }

    /// One ioctl on a buffer; what it says of its (first) plane is read from `planes`.
    fn buffer_call(&self, request: vidioc::_IOC_TYPE, b: &mut Buffer) -> Result<(), Errno> {
        // The kernel writes to `planes` through the pointer in `buffer`, which stays valid: the box does not move.
        self.call(request, &mut b.buffer)
    }

    /// Length and place of a buffer's memory.
    fn memory(&self, b: &Buffer) -> (usize, u32) {
        // SAFETY: memory is MMAP, so the offsets are the members in use.
        unsafe {
            if self.multiplanar() {
                (b.planes[0].length as usize, b.planes[0].m.mem_offset)
            } else {
                (b.buffer.length as usize, b.buffer.m.offset)
            }
        }
    }

    fn unmap(&mut self) {
        for map in self.maps.drain(..) {
            // SAFETY: mapped by us with this length, and nothing refers to it any more.
            // A failure cannot be mended and leaks one buffer's address range.
            let _ = unsafe { v4l2::munmap(map.start.cast(), map.length) };
        }
    }

    fn sizes(&self, pixelformat: u32) -> Vec<OfferedSize> {
        let mut sizes = Vec::new();
        for index in 0..MOST_ENTRIES {
            let mut entry: sys::v4l2_frmsizeenum = zeroed();
            (entry.index, entry.pixel_format) = (index, pixelformat);
            if self
                .call(vidioc::VIDIOC_ENUM_FRAMESIZES, &mut entry)
                .is_err()
            {
                break;
            }
            let single = entry.type_ == sys::v4l2_frmsizetypes_V4L2_FRMSIZE_TYPE_DISCRETE;
            // SAFETY: the kernel filled the member that `type_` names; all of them are plain integers.
            let (min_px, max_px) = unsafe {
                if single {
                    let d = entry.__bindgen_anon_1.discrete;
                    ((d.width, d.height), (d.width, d.height))
                } else {
                    let s = entry.__bindgen_anon_1.stepwise;
                    ((s.min_width, s.min_height), (s.max_width, s.max_height))
                }
            };
            let rates_fps = self.rates(pixelformat, max_px);
            sizes.push(OfferedSize {
                fourcc: text(&pixelformat.to_le_bytes()),
                min_px,
                max_px,
                rates_fps,
            });
            if !single {
                break;
            }
        }
        sizes
    }

    fn rates(&self, pixelformat: u32, size_px: (u32, u32)) -> Vec<f64> {
        let fps = |f: sys::v4l2_fract| f64::from(f.denominator) / f64::from(f.numerator.max(1));
        let mut rates = Vec::new();
        for index in 0..MOST_ENTRIES {
            let mut entry: sys::v4l2_frmivalenum = zeroed();
            (entry.index, entry.pixel_format, entry.width, entry.height) =
                (index, pixelformat, size_px.0, size_px.1);
            if self
                .call(vidioc::VIDIOC_ENUM_FRAMEINTERVALS, &mut entry)
                .is_err()
            {
                break;
            }
            // SAFETY: as in `sizes`.
            unsafe {
                if entry.type_ == sys::v4l2_frmivaltypes_V4L2_FRMIVAL_TYPE_DISCRETE {
                    rates.push(fps(entry.__bindgen_anon_1.discrete));
                } else {
                    let s = entry.__bindgen_anon_1.stepwise;
                    rates.extend([fps(s.max), fps(s.min)]);
                    break;
                }
            }
        }
        rates
    }

    fn control_call(
        &self,
        request: vidioc::_IOC_TYPE,
        id: u32,
        value: i64,
        wide: bool,
    ) -> Result<i64, Errno> {
        let mut control: sys::v4l2_ext_control = zeroed();
        control.id = id;
        if wide {
            control.__bindgen_anon_1.value64 = value;
        } else {
            control.__bindgen_anon_1.value =
                i32::try_from(value).map_err(|_| Errno(libc::ERANGE))?;
        }
        let mut controls: sys::v4l2_ext_controls = zeroed();
        controls.__bindgen_anon_1.ctrl_class = id & 0x0fff_0000;
        (controls.count, controls.controls) = (1, &mut control);
        self.call(request, &mut controls)?;
        // SAFETY: integer members of the union, filled by us and the kernel.
        Ok(unsafe {
            if wide {
                control.__bindgen_anon_1.value64
            } else {
                i64::from(control.__bindgen_anon_1.value)
            }
        })
    }

    fn is_wide(&mut self, id: u32) -> Result<bool, Errno> {
        let info = self.control_info(id)?;
        if info.flags & sys::V4L2_CTRL_FLAG_HAS_PAYLOAD != 0 {
            // Strings and arrays would need memory of their own; no rig can set one.
            return Err(Errno(libc::EINVAL));
        }
        Ok(info.kind == sys::v4l2_ctrl_type_V4L2_CTRL_TYPE_INTEGER64)
    }
}

/// An all-zero kernel structure.
fn zeroed<T: Copy>() -> T {
    // SAFETY: only used for v4l2_* structures: integers, arrays and nullable pointers, for which all zeros are valid.
    unsafe { mem::zeroed() }
}

impl V4lDevice for KernelDevice {
    fn capability(&mut self) -> Result<Capability, Errno> {
        let mut c: sys::v4l2_capability = zeroed();
        self.call(vidioc::VIDIOC_QUERYCAP, &mut c)?;
        let caps = if c.capabilities & sys::V4L2_CAP_DEVICE_CAPS != 0 {
            c.device_caps
        } else {
            c.capabilities
        };
        Ok(Capability {
            driver: text(&c.driver),
            card: text(&c.card),
            bus_info: text(&c.bus_info),
            version: c.version,
            caps,
        })
    }

    fn format(&mut self) -> Result<PixFormat, Errno> {
        let mut f: sys::v4l2_format = zeroed();
        f.type_ = self.kind;
        self.call(vidioc::VIDIOC_G_FMT, &mut f)?;
        Ok(from_sys(&f))
    }

    fn set_format(&mut self, format: &PixFormat) -> Result<PixFormat, Errno> {
        let mut f: sys::v4l2_format = zeroed();
        f.type_ = self.kind;
        let code = u32::from_le_bytes(format.fourcc);
        if self.multiplanar() {
            let mut pix: sys::v4l2_pix_format_mplane = zeroed();
            (pix.width, pix.height, pix.field) = (format.width_px, format.height_px, format.field);
            (pix.pixelformat, pix.num_planes) = (code, 1);
            pix.plane_fmt[0].bytesperline = format.stride_bytes;
            pix.plane_fmt[0].sizeimage = format.size_bytes;
            f.fmt.pix_mp = pix;
        } else {
            let mut pix: sys::v4l2_pix_format = zeroed();
            (pix.width, pix.height, pix.field) = (format.width_px, format.height_px, format.field);
            (pix.bytesperline, pix.sizeimage) = (format.stride_bytes, format.size_bytes);
            pix.pixelformat = code;
            f.fmt.pix = pix;
        }
        self.call(vidioc::VIDIOC_S_FMT, &mut f)?;
        Ok(from_sys(&f))
    }

    fn offers(&mut self) -> Vec<OfferedSize> {
        let mut offers = Vec::new();
        for index in 0..MOST_ENTRIES {
            let mut entry: sys::v4l2_fmtdesc = zeroed();
            (entry.index, entry.type_) = (index, self.kind);
            if self.call(vidioc::VIDIOC_ENUM_FMT, &mut entry).is_err() {
                break;
            }
            let sizes = self.sizes(entry.pixelformat);
            if sizes.is_empty() {
                offers.push(OfferedSize {
                    fourcc: text(&entry.pixelformat.to_le_bytes()),
                    ..OfferedSize::default()
                });
            }
            offers.extend(sizes);
        }
        offers
    }

    fn set_interval(&mut self, interval: (u32, u32)) -> Result<Option<(u32, u32)>, Errno> {
        let mut p: sys::v4l2_streamparm = zeroed();
        p.type_ = self.kind;
        let mut capture: sys::v4l2_captureparm = zeroed();
        capture.timeperframe = sys::v4l2_fract {
            numerator: interval.0,
            denominator: interval.1,
        };
        p.parm.capture = capture;
        self.call(vidioc::VIDIOC_S_PARM, &mut p)?;
        // SAFETY: `type_` is capture, so the kernel filled `capture`.
        let got = unsafe { p.parm.capture };
        let stated = got.capability & sys::V4L2_CAP_TIMEPERFRAME != 0
            && got.timeperframe.numerator > 0
            && got.timeperframe.denominator > 0;
        Ok(stated.then_some((got.timeperframe.numerator, got.timeperframe.denominator)))
    }

    fn control_info(&mut self, id: u32) -> Result<ControlInfo, Errno> {
        let mut q: sys::v4l2_query_ext_ctrl = zeroed();
        q.id = id;
        self.call(vidioc::VIDIOC_QUERY_EXT_CTRL, &mut q)?;
        let name: Vec<u8> = q.name.iter().map(|c| *c as u8).collect();
        Ok(ControlInfo {
            id: q.id,
            name: text(&name),
            kind: q.type_,
            min: q.minimum,
            max: q.maximum,
            step: q.step,
            default: q.default_value,
            flags: q.flags,
        })
    }

    fn control(&mut self, id: u32) -> Result<i64, Errno> {
        let wide = self.is_wide(id)?;
        self.control_call(vidioc::VIDIOC_G_EXT_CTRLS, id, 0, wide)
    }

    fn set_control(&mut self, id: u32, value: i64) -> Result<(), Errno> {
        let wide = self.is_wide(id)?;
        self.control_call(vidioc::VIDIOC_S_EXT_CTRLS, id, value, wide)
            .map(|_| ())
    }

    fn request_buffers(&mut self, count: u32) -> Result<u32, Errno> {
        self.unmap();
        let mut r: sys::v4l2_requestbuffers = zeroed();
        (r.count, r.type_, r.memory) = (count, self.kind, MMAP);
        self.call(vidioc::VIDIOC_REQBUFS, &mut r)?;
        for index in 0..r.count {
            let mut b = self.buffer(index);
            self.buffer_call(vidioc::VIDIOC_QUERYBUF, &mut b)?;
            let (length, offset) = self.memory(&b);
            let access = libc::PROT_READ | libc::PROT_WRITE;
            // SAFETY: a fresh shared mapping of a buffer the kernel has just described.
            let start = unsafe {
                v4l2::mmap(
                    std::ptr::null_mut(),
                    length,
                    access,
                    libc::MAP_SHARED,
                    self.fd,
                    libc::off_t::from(offset),
                )
            }
            .map_err(|e| errno(&e))?;
            self.maps.push(Map {
                start: start.cast(),
                length,
                data_offset: 0,
            });
        }
        Ok(r.count)
    }

    fn enqueue(&mut self, index: u32) -> Result<(), Errno> {
        self.buffer_call(vidioc::VIDIOC_QBUF, &mut self.buffer(index))
    }

    fn dequeue(&mut self) -> Result<BufferInfo, Errno> {
        let mut given = self.buffer(0);
        self.buffer_call(vidioc::VIDIOC_DQBUF, &mut given)?;
        let b = &given.buffer;
        let mut bytes_used = b.bytesused;
        if self.multiplanar() {
            // A plane counts what stands before its data.
            let (plane, before) = (given.planes[0], given.planes[0].data_offset);
            bytes_used = plane.bytesused.saturating_sub(before);
            if let Some(map) = self.maps.get_mut(b.index as usize) {
                map.data_offset = before as usize;
            }
        }
        let (seconds, micros) = (
            b.timestamp.tv_sec.max(0) as u64,
            b.timestamp.tv_usec.max(0) as u64,
        );
        Ok(BufferInfo {
            index: b.index,
            bytes_used,
            flags: b.flags,
            field: b.field,
            stamp_ns: seconds
                .saturating_mul(1_000_000_000)
                .saturating_add(micros * 1000),
            sequence: b.sequence,
        })
    }

    fn stream_on(&mut self) -> Result<(), Errno> {
        self.call(vidioc::VIDIOC_STREAMON, &mut self.kind.cast_signed())
    }

    fn stream_off(&mut self) -> Result<(), Errno> {
        self.call(vidioc::VIDIOC_STREAMOFF, &mut self.kind.cast_signed())
    }

    fn poll(&mut self, wait: Duration) -> Result<bool, Errno> {
        let mut p = libc::pollfd {
            fd: self.fd,
            events: libc::POLLIN,
            revents: 0,
        };
        // Rounded up: a rest of 0.4 ms must not become a busy loop.
        let ms = wait.as_micros().div_ceil(1000).min(i32::MAX as u128) as i32;
        // SAFETY: one valid pollfd.
        match unsafe { libc::poll(&mut p, 1, ms) } {
            n if n > 0 => Ok(true),
            0 => Ok(false),
            _ => Err(errno(&std::io::Error::last_os_error())),
        }
    }

    fn read(&mut self, index: u32, bytes: usize, into: &mut Vec<u8>) -> usize {
        let Some(map) = self.maps.get(index as usize) else {
            return 0;
        };
        // SAFETY: the map is `length` bytes long and lives as long as `self`; the queue hands out only buffers that the
        // kernel has given back, so nobody writes to it now.
        let memory = unsafe { std::slice::from_raw_parts(map.start, map.length) };
        let data = memory.get(map.data_offset..).unwrap_or_default();
        into.extend_from_slice(&data[..bytes.min(data.len())]);
        data.len()
    }
}

impl Drop for KernelDevice {
    fn drop(&mut self) {
        // STREAMOFF is implied by close; the maps must go first or the buffers stay allocated.
        self.unmap();
        let _ = v4l2::close(self.fd);
    }
}

fn from_sys(f: &sys::v4l2_format) -> PixFormat {
    if f.type_ == CAPTURE_MPLANE {
        // SAFETY: the type says that this is the member in use.
        let pix = unsafe { f.fmt.pix_mp };
        let first = pix.plane_fmt[0];
        return PixFormat {
            fourcc: pix.pixelformat.to_le_bytes(),
            width_px: pix.width,
            height_px: pix.height,
            stride_bytes: first.bytesperline,
            size_bytes: first.sizeimage,
            field: pix.field,
            memory_planes: u32::from(pix.num_planes),
            full_range: is_full_range(u32::from(pix.quantization), pix.colorspace),
        };
    }
    // SAFETY: `type_` is single-planar capture, so `pix` is the member in use.
    let pix = unsafe { f.fmt.pix };
    PixFormat {
        fourcc: pix.pixelformat.to_le_bytes(),
        width_px: pix.width,
        height_px: pix.height,
        stride_bytes: pix.bytesperline,
        size_bytes: pix.sizeimage,
        field: pix.field,
        memory_planes: 1,
        full_range: is_full_range(pix.quantization, pix.colorspace),
    }
}

/// V4L2_MAP_QUANTIZATION_DEFAULT for Y'CbCr: what the driver leaves open is limited, of JPEG's colour space full.
fn is_full_range(quantization: u32, colorspace: u32) -> bool {
    match quantization {
        sys::v4l2_quantization_V4L2_QUANTIZATION_FULL_RANGE => true,
        sys::v4l2_quantization_V4L2_QUANTIZATION_LIM_RANGE => false,
        _ => colorspace == sys::v4l2_colorspace_V4L2_COLORSPACE_JPEG,
    }
}
