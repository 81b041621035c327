//! V4L2 cameras: a [`FrameSource`] that keeps going.
//!
//! The queue decides ([`super::queue`]), the account counts ([`super::gaps`]); this adapter performs, stamps, copies,
//! and mends: a frozen stream is restarted, a pulled camera is looked for by its identity every 200 ms, set up as
//! before, and goes on in the same recording with the gap counted.

use std::collections::VecDeque;
use std::path::PathBuf;
use std::sync::Arc;
use std::time::Duration;

use hydroline_rigs::{Camera, CameraBackend, DeviceIdentity};

use super::gaps::{Account, Note, Pause};
use super::queue::{Action, BufferQueue, Call, Notice, Outcome, Patience};
use super::{CaptureCounts, CaptureError, Captured, FrameSource, SourceDescription};
use hydroline_core::clock::{Clock, ClockTriple};
use hydroline_core::event::Event;
use hydroline_core::frame::{Frame, FrameFault, FrameMeta};

pub mod check;
pub mod controls;
pub mod device;
#[cfg(feature = "v4l2")]
pub mod kernel;
pub mod pool;
pub mod setup;
pub mod stamp;
pub mod system;
mod words;

use device::{BufferInfo, Errno, V4lDevice, V4lSystem};
use pool::Pool;
use setup::Setup;

/// A pulled camera is looked for this often.
const LOOK_EVERY: Duration = Duration::from_millis(200);
/// The clocks' offset and the controls are read this often \[ns\].
const REFRESH_NS: u64 = 1_000_000_000;
/// Buffers after STREAMON that may hold old content.
const STALE_BUFFERS: u32 = 2;
/// Attempts to start a stream that has never delivered, before giving up.
const START_ATTEMPTS: u32 = 5;
/// V4L2_FIELD_NONE: progressive; V4L2_FIELD_ANY: the driver does not say.
const PROGRESSIVE: [u32; 2] = [0, 1];

/// Options for opening a camera.
#[derive(Debug, Clone, Copy)]
pub struct OpenOptions {
    /// `/dev/videoN` is accepted as a name.
    pub allow_unstable_node: bool,
    /// How long to wait for a device that exists but is not a camera yet (v4l2loopback before its feeder), or that
    /// does not exist yet.
    pub patience: Duration,
    /// A colour channel is computed from the frames: the levels of Y'CbCr must be known.
    pub colour: bool,
}

impl Default for OpenOptions {
    fn default() -> Self {
        Self {
            allow_unstable_node: false,
            patience: Duration::from_secs(5),
            colour: false,
        }
    }
}

/// A frame as it was copied out of its buffer, not looked into.
struct Fresh {
    frame: Frame,
    info: BufferInfo,
    /// Whether it was handed out twice: it was counted when it came first.
    repeated: bool,
    /// Largest frame \[bytes\].
    full_bytes: u32,
}

/// A V4L2 camera.
pub struct V4lSource {
    system: Box<dyn V4lSystem>,
    clock: Arc<dyn Clock>,
    camera: Camera,
    identity: DeviceIdentity,
    node: PathBuf,
    device: Option<Box<dyn V4lDevice>>,
    setup: Setup,
    queue: BufferQueue,
    account: Account,
    events: VecDeque<Event>,
    pool: Pool,
    triple: ClockTriple,
    exposure_s: f64,
    stale_left: u32,
    ever_delivered: bool,
    said: words::Said,
    checked_ns: u64,
    seen_controls: Vec<i64>,
    gone_since_ns: Option<u64>,
    next_look_ns: u64,
    reopen_trouble: String,
    restarts_since_frame: u32,
}

fn identity_words(identity: &DeviceIdentity) -> String {
    match identity {
        DeviceIdentity::ById(name) => format!("by-id {name}"),
        DeviceIdentity::ByPath(name) => format!("by-path {name}"),
        DeviceIdentity::Node(node) => format!("node {}", node.display()),
    }
}

impl V4lSource {
    /// Opens the rig's camera and brings it into the rig's state. The stream starts with the first call of `next`.
    ///
    /// # Errors
    /// When the camera is not there, not allowed, busy, or not what the rig says, after `options.patience` where
    /// waiting can help.
    pub fn open(
        camera: &Camera,
        options: OpenOptions,
        mut system: Box<dyn V4lSystem>,
        clock: Arc<dyn Clock>,
    ) -> Result<Self, CaptureError> {
        let CameraBackend::V4l(identity) = &camera.backend else {
            return Err(CaptureError::NotV4l);
        };
        if let (DeviceIdentity::Node(node), false) = (identity, options.allow_unstable_node) {
            return Err(CaptureError::UnstableNode { node: node.clone() });
        }
        let deadline_ns = clock
            .monotonic_ns()
            .saturating_add(options.patience.as_nanos() as u64);
        let (node, device, setup) = loop {
            match open_once(system.as_mut(), identity, camera) {
                Ok(opened) => break opened,
                Err(error) if may_pass(&error) && clock.monotonic_ns() < deadline_ns => {
                    clock.sleep(LOOK_EVERY)
                }
                Err(error) => return Err(error),
            }
        };
        if options.colour {
            setup::check_range(&node, camera, &setup.format)?;
        }
        let triple = clock.triple();
        let now_ns = triple.monotonic_ns;
        let patience = Patience {
            frozen_after: frozen_after(camera),
            ..Patience::default()
        };
        let mut source = Self {
            queue: BufferQueue::new(setup.buffers, patience, now_ns),
            account: Account::new(nominal_period_s(&setup, camera)),
            exposure_s: exposure_s(&setup, camera),
            seen_controls: setup.controls.iter().map(|c| c.value).collect(),
            system,
            clock,
            camera: camera.clone(),
            identity: identity.clone(),
            node,
            device: Some(device),
            setup,
            events: VecDeque::new(),
            pool: Pool::default(),
            triple,
            stale_left: STALE_BUFFERS,
            ever_delivered: false,
            said: words::Said::default(),
            checked_ns: now_ns,
            gone_since_ns: None,
            next_look_ns: 0,
            reopen_trouble: String::new(),
            restarts_since_frame: 0,
        };
        if !PROGRESSIVE.contains(&source.setup.format.field) {
            let field = setup::field_name(source.setup.format.field);
            source.say(words::interlaced(field));
        }
        Ok(source)
    }

    fn say(&mut self, mut event: Event) {
        if event.timestamp_ns == 0 {
            event.timestamp_ns = self.clock.triple().realtime_ns;
        }
        self.events.push_back(event);
    }

    /// One step of the queue; `Some` = a frame came out.
    fn step(&mut self, deadline_ns: u64) -> Result<Option<Fresh>, CaptureError> {
        let now_ns = self.clock.monotonic_ns();
        let action = self.queue.action(now_ns);
        let Some(device) = self.device.as_mut() else {
            return Ok(None);
        };
        let wait =
            |until_ns: u64| Duration::from_nanos(until_ns.min(deadline_ns).saturating_sub(now_ns));
        let done =
            |r: Result<(), Errno>| r.map_or_else(|e| Outcome::Failed(e.0), |()| Outcome::Done);
        let mut frame = None;
        let outcome = match action {
            Action::Enqueue(index) => done(device.enqueue(index)),
            Action::StreamOn => done(device.stream_on()),
            Action::StreamOff => done(device.stream_off()),
            Action::Rest { until_ns } => {
                self.clock.sleep(wait(until_ns));
                Outcome::Done
            }
            Action::Poll { until_ns } => match device.poll(wait(until_ns)) {
                Ok(true) => Outcome::Ready,
                Ok(false) => Outcome::Silence,
                Err(e) => Outcome::Failed(e.0),
            },
            Action::Dequeue => match device.dequeue() {
                Ok(info) => {
                    let void = check::is_void(&info);
                    let received_ns = self.clock.monotonic_ns();
                    if void {
                        self.account.void();
                    } else {
                        frame = Some(self.frame(&info, received_ns));
                    }
                    Outcome::Dequeued {
                        index: info.index,
                        void,
                    }
                }
                Err(e) => Outcome::Failed(e.0),
            },
            // The copy was made while dequeuing: the buffer goes straight back.
            Action::Deliver(_) => Outcome::Done,
            Action::Reopen => {
                self.unplugged(libc::ENODEV);
                return Ok(None);
            }
        };
        let now_ns = self.clock.monotonic_ns();
        if let Some(notice) = self.queue.outcome(action, outcome, now_ns) {
            self.heed(notice)?;
        }
        Ok(frame)
    }

    fn frame(&mut self, info: &BufferInfo, received_ns: u64) -> Fresh {
        if received_ns.saturating_sub(self.triple.monotonic_ns) >= REFRESH_NS {
            self.triple = self.clock.triple();
        }
        let format = self.setup.format;
        let mut capacity = 0;
        let data = match self.device.as_mut() {
            Some(device) => self
                .pool
                .bytes(|block| capacity = device.read(info.index, info.bytes_used as usize, block)),
            None => bytes::Bytes::new(),
        };
        let stale = self.stale_left > 0;
        self.stale_left = self.stale_left.saturating_sub(1);
        let mut fault = check::fault(self.camera.pixel_format, &format, info, data.len(), stale);
        if info.bytes_used as usize > capacity {
            fault = fault.or(Some(FrameFault::Truncated));
        }
        let period_s = self.account.period_ns() / 1e9;
        let placed = stamp::place(
            info.stamp_ns,
            info.flags,
            received_ns,
            self.exposure_s,
            period_s,
            &self.triple,
        );
        if let Some(event) = self
            .said
            .stamp_trouble(&placed, info, &self.triple, received_ns)
        {
            self.say(event);
        }
        let (lost_before, notes) = self.account.frame(info.sequence, placed.monotonic_ns);
        let at_ns = placed.mid_exposure_ns;
        let repeated = notes.iter().any(|n| matches!(n, Note::Repeated { .. }));
        let mut resumed = false;
        for note in notes {
            resumed |= matches!(note, Note::Resumed { .. });
            if let Some(event) = words::note(at_ns, &note) {
                self.say(event);
            }
        }
        if !resumed && (lost_before.sequence_gap > 0 || lost_before.time_gap > 0) {
            self.say(words::gap(at_ns, info.sequence, lost_before, period_s));
        }
        (self.ever_delivered, self.restarts_since_frame) = (true, 0);
        let frame = Frame {
            format: self.camera.pixel_format,
            width_px: format.width_px,
            height_px: format.height_px,
            stride_bytes: if self.camera.pixel_format.is_compressed() {
                0
            } else {
                format.stride_bytes
            },
            data,
            meta: FrameMeta {
                sequence: info.sequence,
                driver_stamp_ns: info.stamp_ns,
                stamp_clock: placed.clock,
                stamp_source: placed.source,
                flags: info.flags,
                received_monotonic_ns: received_ns,
                mid_exposure_ns: placed.mid_exposure_ns,
                exposure_s: self.exposure_s,
                fault,
                lost_before,
            },
        };
        Fresh {
            frame,
            info: *info,
            repeated,
            full_bytes: format.size_bytes,
        }
    }

    /// Looks into a frame, counts its fault and says it. Its buffer is back with the driver: this is not the queue's time.
    fn judged(&mut self, fresh: Fresh) -> Frame {
        let mut frame = fresh.frame;
        let damage = match frame.meta.fault {
            Some(FrameFault::DriverError) => None,
            _ => check::jpeg_damage(frame.format, &frame.data),
        };
        if damage.is_some() {
            frame.meta.fault = Some(FrameFault::BrokenJpeg);
        }
        if fresh.repeated {
            frame.meta.fault = frame.meta.fault.or(Some(FrameFault::Stale));
        } else if let Some(fault) = frame.meta.fault {
            self.account.mark(fault);
            if fault != FrameFault::Stale {
                let at_ns = frame.meta.mid_exposure_ns;
                let (damage, info) = (damage.as_ref(), &fresh.info);
                self.say(words::damaged(at_ns, fault, damage, info, fresh.full_bytes));
            }
        }
        frame
    }

    /// Turns the queue's notices into events, causes of loss, and, before the first frame, errors.
    fn heed(&mut self, notice: Notice) -> Result<(), CaptureError> {
        match notice {
            Notice::Started => self.stale_left = STALE_BUFFERS,
            Notice::Gone { errno } => self.unplugged(errno),
            Notice::Refused { .. } => {}
            Notice::Frozen { .. } => self.account.pause(Pause::Frozen),
            Notice::Voided | Notice::Nonsense { .. } => self.account.pause(Pause::Restarted),
            Notice::Failed { call, errno, .. } => {
                self.account.pause(Pause::Restarted);
                self.restarts_since_frame += 1;
                if !self.ever_delivered {
                    self.refuse_to_start(call, errno)?;
                }
            }
        }
        if let Some(event) = words::notice(&notice, &self.node) {
            self.say(event);
        }
        Ok(())
    }

    fn refuse_to_start(&self, call: Call, errno: i32) -> Result<(), CaptureError> {
        if call == Call::StreamOn && errno == libc::ENOSPC {
            return Err(setup::bandwidth_error(
                &self.node,
                &self.setup,
                self.camera.rate_fps,
            ));
        }
        if errno == libc::EBUSY {
            return Err(setup::call_error(
                self.system.as_ref(),
                &self.node,
                &call.to_string(),
                Errno(errno),
            ));
        }
        if self.restarts_since_frame >= START_ATTEMPTS {
            let last = format!("{call}: {}", Errno(errno));
            return Err(CaptureError::NeverStarted {
                node: self.node.clone(),
                attempts: self.restarts_since_frame,
                last,
            });
        }
        Ok(())
    }

    fn unplugged(&mut self, errno: i32) {
        // Closed before the search: an open descriptor would keep the old node's number taken.
        if self.device.take().is_none() {
            return;
        }
        let now_ns = self.clock.monotonic_ns();
        self.account.pause(Pause::Unplugged);
        self.gone_since_ns = Some(now_ns);
        self.next_look_ns = now_ns;
        self.reopen_trouble.clear();
        self.say(words::unplugged(&self.node, errno));
    }

    /// Looks for the pulled camera, at most every 200 ms and until the deadline.
    fn look(&mut self, deadline_ns: u64) {
        let now_ns = self.clock.monotonic_ns();
        if now_ns < self.next_look_ns {
            self.clock.sleep(Duration::from_nanos(
                self.next_look_ns.min(deadline_ns).saturating_sub(now_ns),
            ));
            if self.clock.monotonic_ns() < self.next_look_ns {
                return;
            }
        }
        match open_once(self.system.as_mut(), &self.identity, &self.camera) {
            Ok((node, device, setup)) => {
                let now_ns = self.clock.monotonic_ns();
                let gone_ns = now_ns.saturating_sub(self.gone_since_ns.take().unwrap_or(now_ns));
                self.say(words::replugged(&node, gone_ns as f64 / 1e9));
                let patience = Patience {
                    frozen_after: frozen_after(&self.camera),
                    ..Patience::default()
                };
                self.queue = BufferQueue::new(setup.buffers, patience, now_ns);
                self.seen_controls = setup.controls.iter().map(|c| c.value).collect();
                self.exposure_s = exposure_s(&setup, &self.camera);
                (self.node, self.device, self.setup) = (node, Some(device), setup);
            }
            Err(error) => {
                // Absence is what is being waited for; any other trouble is said once.
                let text = error.to_string();
                if !matches!(error, CaptureError::NotFound { .. }) && text != self.reopen_trouble {
                    self.say(words::reopen_failed(&text));
                    self.reopen_trouble = text;
                }
                self.next_look_ns = self.clock.monotonic_ns() + LOOK_EVERY.as_nanos() as u64;
            }
        }
    }

    /// Reads the rig's controls once a second: something else may have changed them.
    fn check_controls(&mut self, now_ns: u64) {
        if now_ns.saturating_sub(self.checked_ns) < REFRESH_NS || self.setup.controls.is_empty() {
            return;
        }
        self.checked_ns = now_ns;
        let Some(device) = self.device.as_mut() else {
            return;
        };
        let mut changed = Vec::new();
        for (control, seen) in self.setup.controls.iter_mut().zip(&mut self.seen_controls) {
            let Ok(value) = device.control(control.id) else {
                continue;
            };
            if value != *seen {
                changed.push(words::control_changed(control, *seen, value));
                (*seen, control.value) = (value, value);
            }
        }
        if !changed.is_empty() {
            self.exposure_s = exposure_s(&self.setup, &self.camera);
        }
        changed.into_iter().for_each(|event| self.say(event));
    }
}

impl FrameSource for V4lSource {
    fn describe(&self) -> SourceDescription {
        let capability = &self.setup.capability;
        let v = capability.version;
        SourceDescription {
            kind: "v4l2".into(),
            driver: capability.driver.clone(),
            driver_version: format!("{}.{}.{}", v >> 16, (v >> 8) & 0xff, v & 0xff),
            card: capability.card.clone(),
            bus_info: capability.bus_info.clone(),
            identity: identity_words(&self.identity),
            node: self.node.display().to_string(),
            format: self.setup.format.negotiated(),
            rate_fps: self.setup.rate_fps,
            controls: self.setup.controls.clone(),
            module_parameters: self.system.module_parameters(&capability.driver),
            buffers: self.setup.buffers,
        }
    }

    fn next(&mut self, wait: Duration) -> Result<Captured, CaptureError> {
        let deadline_ns = self
            .clock
            .monotonic_ns()
            .saturating_add(wait.as_nanos() as u64);
        loop {
            if let Some(event) = self.events.pop_front() {
                return Ok(Captured::Event(event));
            }
            if self.device.is_none() {
                self.look(deadline_ns);
            } else if let Some(fresh) = self.step(deadline_ns)? {
                // The buffer goes back to the driver before the frame is looked into and goes on: neither is the queue's time.
                while matches!(
                    self.queue.action(self.clock.monotonic_ns()),
                    Action::Deliver(_) | Action::Enqueue(_)
                ) && self.device.is_some()
                {
                    self.step(deadline_ns)?;
                }
                return Ok(Captured::Frame(self.judged(fresh)));
            } else {
                self.check_controls(self.clock.monotonic_ns());
            }
            if self.events.is_empty() && self.clock.monotonic_ns() >= deadline_ns {
                return Ok(Captured::Nothing);
            }
        }
    }

    fn finish(&mut self) {
        self.account.finish(self.clock.monotonic_ns());
    }

    fn counts(&self) -> CaptureCounts {
        self.account.counts()
    }
}

impl Drop for V4lSource {
    fn drop(&mut self) {
        if let Some(device) = self.device.as_mut() {
            // Best effort: closing the node stops the stream as well.
            let _ = device.stream_off();
        }
    }
}

fn open_once(
    system: &mut dyn V4lSystem,
    identity: &DeviceIdentity,
    camera: &Camera,
) -> Result<(PathBuf, Box<dyn V4lDevice>, Setup), CaptureError> {
    let node = system.find(identity).map_err(|e| CaptureError::NotFound {
        identity: identity_words(identity),
        present: e.present,
    })?;
    let mut device = system
        .open(&node)
        .map_err(|e| setup::call_error(system, &node, "open", e))?;
    let setup = setup::configure(device.as_mut(), system, &node, camera)?;
    Ok((node, device, setup))
}

/// Failures that time may mend: not plugged in yet, or a loopback device whose feeder has not opened it.
fn may_pass(error: &CaptureError) -> bool {
    match error {
        CaptureError::NotFound { .. } => true,
        CaptureError::NotACamera { caps, .. } => caps & setup::CAP_OUTPUT != 0,
        CaptureError::Call { call, errno, .. } => {
            *errno == libc::EINVAL && call.contains("FMT") || *errno == libc::ENODEV
        }
        _ => false,
    }
}

fn frozen_after(camera: &Camera) -> Duration {
    // Slower than three periods is not frozen, only slow.
    let least_s = 3.0 / camera.rate_fps.max(0.1);
    Duration::try_from_secs_f64(camera.frozen_after_s.max(least_s))
        .unwrap_or(Duration::from_secs(1))
}

fn nominal_period_s(setup: &Setup, camera: &Camera) -> f64 {
    if setup.rate_fps > 0.0 {
        1.0 / setup.rate_fps
    } else {
        1.0 / camera.rate_fps
    }
}

/// The exposure the camera itself states (UVC: units of 100 us), else the rig's.
fn exposure_s(setup: &Setup, camera: &Camera) -> f64 {
    let own = setup
        .controls
        .iter()
        .find(|c| c.id == controls::EXPOSURE_ABSOLUTE);
    own.map_or(camera.exposure_s, |c| c.value as f64 * 1e-4)
}

#[cfg(test)]
mod tests;
