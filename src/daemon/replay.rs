//! `replay`: every frame of a log, or of a folder of images, extracted again, offline and deterministic.
//!
//! Everything of ours but the images is carried over; messages of third-party topics cannot be written
//! by our writer and are counted by topic. Profiles are computed anew with the code that ran
//! live, so that a frame that was extracted live gives the same bytes again, which is counted.

use crate::analysis::{Analyst, NotExtracted};
use crate::calibrate::message;
use crate::live::Live;
use crate::live::unhurried::Unhurried;
use crate::response::{Found, ResponseReport};
use hydroline_calib::Calibration;
use hydroline_calib::plane::PlaneMap;
use hydroline_capture::FolderError;
use hydroline_core::build_info::BuildInfo;
use hydroline_core::frame::{
    ClippingWatch, Frame, FrameError, FrameFault, GreyImage, GreyRule, PictureBlocks, PixelFormat,
};
use hydroline_identify::data::StillWatch;
use hydroline_log::messages::{
    self, Stamped,
    pb::{FrameInfo, PlaneCalibration, StripeProfile, ThrusterCommand, VehicleMotion},
    unix_ns,
};
use hydroline_log::{
    DAMAGED_KEY, Entry, FRAME_BYTES_KEY, FileRecorder, Head, LogError, LogMessage, LogOutcome,
    MetadataMap, Record, SummaryInput, WriteSettings, bytes_per_frame,
};
use hydroline_pose::joint::Speculative;
use hydroline_pose::joint::refine::{RefineError, Wanted};
use hydroline_pose::run::{PoseRun, RunPose, motion_message};
use hydroline_rigs::Rig;
use hydroline_stripe::{ExtractorConfig, Profile};
use prost::Message;
use rayon::prelude::*;
use serde::Serialize;
use std::collections::hash_map::DefaultHasher;
use std::collections::{BTreeMap, HashMap, HashSet};
use std::hash::{Hash, Hasher};
use std::path::{Path, PathBuf};
use std::sync::Arc;

pub mod gaps;
mod input;
mod opening;
mod picture;
mod refined;
mod screen;
pub use screen::at_start;
mod smoothed;

use gaps::Gaps;
use input::Input;
pub use refined::RefineReport;
pub use smoothed::SmoothReport;

/// Frames extracted together: enough for all cores, little enough to hold in memory (64 x 0.4 MB).
const BATCH: usize = 64;
/// The same while a live page shows them: something new a few times a second.
const BATCH_SHOWN: usize = 8;
/// Frames that are named where frames cannot be read; of more the number is enough.
const NAMED_MAX: usize = 20;
/// Messages held at most, however few frames are among them: a flood of small ones must not fill the memory.
const PENDING_MAX: usize = 1 << 14;

/// Options of a replay. The default extracts stripes and computes no poses.
#[derive(Clone, Default)]
pub struct Options {
    /// Copies the images too, so that the new log can be viewed and replayed on its own.
    pub keep_images: bool,
    /// The extractor's settings.
    pub extractor: ExtractorConfig,
    /// Rule by which grey levels come out of the frames: the rig's.
    pub rule: GreyRule,
    /// Blocks of the log's JPEGs that look like damage and are its picture. Empty = [`replay`] looks for them.
    pub picture: Arc<PictureBlocks>,
    /// Topic of the images where it is not ours.
    pub image_topic: Option<String>,
    /// Frames in a second of a folder of images; `None` = their names say when they were true.
    pub rate_hz: Option<f64>,
    /// The calibration from image to laser plane.
    pub map: Option<Arc<dyn PlaneMap>>,
    /// Follows the vehicle over its target; without one no poses are computed and logged ones stay.
    pub poses: Option<PoseRun>,
    /// Refines what the frames share before they are fitted: one pass more over the log. Needs `poses`.
    pub refine: Option<Wanted>,
    /// Binds the poses of the run through this rig's dynamics ([`hydroline_pose::smooth`]): two passes over the log.
    pub smooth: Option<Box<Rig>>,
    /// The rig to state in the new log, when it is another than the recording's own.
    pub rig_toml: Option<String>,
    /// The calibration in force, for the new log's head.
    pub calibration_toml: Option<String>,
    /// The calibration in force where it is another than the recording's: stated on `/laser/calibration` in its place.
    pub calibration: Option<Calibration>,
    /// Whether the new log takes the place of one that is there, once it is whole.
    pub over: bool,
    /// The replaying program.
    pub build: BuildInfo,
    /// Where it shows itself, and the rig in force for loads and outline; changes no byte of the log.
    pub live: Option<(Live, Option<Box<Rig>>)>,
}

/// Account of a replay.
#[derive(Debug, Clone, PartialEq, Default, Serialize, schemars::JsonSchema)]
pub struct Report {
    /// Frames in the log.
    pub frames: u64,
    /// Frames that the names of a folder's images leave out.
    pub frames_missing: u64,
    /// Frames with a stripe.
    pub with_stripe: u64,
    /// Of these, frames that the camera delivered and that cannot be read: of the wrong size, or no image.
    pub undecodable: u64,
    /// Sequence numbers of the first 20 of these.
    pub undecodable_frames: Vec<u32>,
    /// Frames that the recording marks as damaged: by the driver, cut short, or no whole JPEG.
    pub marked_damaged: u64,
    /// Blocks of the frames that look like damage and were taken for the picture, in words; `None` = there are none.
    pub picture_blocks: Option<String>,
    /// Metadata of the log that is not as it was written, by name, in words.
    pub damaged_metadata: BTreeMap<String, String>,
    /// Frames excluded or without a stripe, by reason; the numbers in it are those of the first of its kind.
    pub without_stripe: BTreeMap<String, u64>,
    /// Stripe points found.
    pub points: u64,
    /// Frames that had been extracted live.
    pub live: u64,
    /// Of these, profiles that came out bit for bit the same.
    pub live_identical: u64,
    /// Of these, profiles that came out otherwise; the rest have no image in the log to compare with, or their frame was taken
    /// for damaged in one of the two.
    pub live_different: u64,
    /// Messages of topics or schemas that are not ours, by topic: not carried over.
    pub foreign: BTreeMap<String, u64>,
    /// Frames with a pose that is fit for use (`/vehicle/motion`).
    pub poses: u64,
    /// Frames whose pose was discarded, by reason; the numbers in it are those of the first of its kind.
    pub without_pose: BTreeMap<String, u64>,
    /// Stretches of half a second and more without one.
    pub gaps: Vec<gaps::Gap>,
    /// A calibration was made while it was recorded: a board stands where the target would.
    pub calibrates: bool,
    /// The camera's response that the poses were fitted with.
    pub response: Option<ResponseReport>,
    /// Geometry that the frames were found to share, where it was asked for.
    pub refined: Option<RefineReport>,
    /// Clipping that the frames' luma hides, in words.
    pub hidden_clipping: Option<String>,
    /// Account of binding the frames, where it was asked for.
    pub smoothed: Option<SmoothReport>,
    /// Commands carried over.
    pub commands: u64,
    /// First and last stamp of a frame, UNIX \[ns\].
    pub span_ns: Option<(u64, u64)>,
}

impl Options {
    fn analyst(&self) -> Analyst {
        Analyst::new(self.extractor.clone(), self.map.clone(), self.rule)
            .knowing(self.picture.clone())
    }

    fn open(&self, log: &Path) -> Result<Input, ReplayError> {
        Input::open(log, self)
    }

    /// Tolerance within which a vehicle counts as at rest: that of the rig in force, else the default one (2 mm, 0.1°).
    fn tolerance(&self) -> [f64; 2] {
        self.rig_toml
            .as_deref()
            .and_then(|t| hydroline_rigs::Rig::from_toml(t, "rig.toml", None).ok())
            .map_or([0.002, 0.1f64.to_radians()], |rig| {
                [rig.tolerance.position_m, rig.tolerance.attitude_rad]
            })
    }
}

/// A profile's bytes, to be compared with those of its frame's other one.
#[derive(Debug, Clone, Copy)]
struct Fingerprint {
    bytes: u64,
    /// Whether its frame was taken for damaged: while recording less is known of the picture's blocks than in a replay.
    refused: bool,
}

impl Fingerprint {
    fn of(profile: &StripeProfile) -> Self {
        Fingerprint {
            bytes: fingerprint(profile),
            refused: profile.fault.contains(": damaged JPEG: "),
        }
    }
}

impl Report {
    fn compared(&mut self, live: Fingerprint, ours: Fingerprint) {
        if live.bytes == ours.bytes {
            self.live_identical += 1;
        } else if !live.refused && !ours.refused {
            self.live_different += 1;
        }
    }
}

/// Failure of a replay.
#[derive(Debug, thiserror::Error)]
#[allow(missing_docs)] // Each message names its fields.
pub enum ReplayError {
    #[error(transparent)]
    Log(#[from] LogError),
    #[error(transparent)]
    Folder(#[from] FolderError),
    #[error("--refine: {0}")]
    Refine(#[from] RefineError),
    #[error(transparent)]
    Smooth(#[from] hydroline_pose::smooth::SmoothError),
    #[error("the rig's dynamics cannot be used to smooth: {reason}")]
    Dynamics { reason: String },
    #[error(
        "{path}: holds no image: there is nothing to replay; `hydroline info` shows what is in it"
    )]
    NoImages { path: PathBuf },
}

/// Replays one log into a new one; `progress` is called with how many frames are done.
///
/// # Errors
/// [`ReplayError`]. A damaged log stops with the place of the damage; `recover` it first.
pub fn replay(
    log: &Path,
    out: &Path,
    options: &Options,
    progress: &mut dyn FnMut(u64),
) -> Result<(Report, LogOutcome), ReplayError> {
    let mut reader = options.open(log)?;
    let mut head = head(&reader, log, options);
    // The camera's format decides the new file's channels; it is known at the first frame. Read twice up to there:
    // how much stands before it is not known.
    let first = loop {
        match reader.next().transpose()?.map(|message| message.record) {
            Some(Record::Frame(frame)) => break frame,
            Some(_) => {}
            None => {
                return Err(ReplayError::NoImages {
                    path: log.to_owned(),
                });
            }
        }
    };
    let found = match first.format == PixelFormat::Mjpg && options.picture.is_empty() {
        true => Some(picture::find(log, options)?),
        false => None,
    };
    let picture_blocks = match &found {
        Some(found) => found.words(),
        None => options.picture.words(),
    };
    let with_picture = found.map(|found| Options {
        picture: Arc::new(found.blocks),
        ..options.clone()
    });
    let options = with_picture.as_ref().unwrap_or(options);
    let camera = Some(first.format).filter(|_| options.keep_images);
    if camera.is_some() {
        state_frame_bytes(&mut head, first.data.len());
    }
    let reader = options.open(log)?;
    let damaged = reader.seal_findings().into_iter().filter(|f| f.damaged());
    let mut report = Report {
        frames_missing: reader.missing(),
        picture_blocks,
        damaged_metadata: damaged.map(|f| (f.name.clone(), f.to_string())).collect(),
        ..Report::default()
    };
    let mut poses = options.poses.clone();
    let mut response = None;
    if let Some(run) = &options.poses {
        let (run, found, account) = opening::responding(log, options, run)?;
        report.response = Some(account);
        response = Some(found);
        poses = Some(run);
    }
    if let Some((wanted, run)) = options.refine.zip(poses.as_ref()) {
        let (run, refined) = refined::refined(log, options, run, wanted)?;
        report.refined = Some(refined);
        let unknown = response.is_some_and(|found: Found| found.response.is_none());
        poses = Some(if unknown {
            // Frames that did not fit a sheet that is not the rig's fit the refined one.
            let (run, found, account) = opening::found_again(log, options, &run)?;
            (report.response, response) = (Some(account), Some(found));
            run
        } else {
            run
        });
    }
    let bound = match &options.smooth {
        Some(rig) => Some(smoothed::bound(log, options, poses.as_ref(), rig)?),
        None => None,
    };
    let settings = WriteSettings::offline(camera);
    let screen = screen::of(options, &head.session);
    let mut state = Replay {
        writer: FileRecorder::create_whole(out, options.over, head, settings)?,
        options,
        live: HashMap::new(),
        ours: HashMap::new(),
        pending: Vec::with_capacity(BATCH),
        frames_pending: 0,
        report,
        index: 0,
        info: None,
        run: poses.filter(|_| bound.is_none()),
        bound: HashMap::new(),
        posed: HashSet::new(),
        kinds: Kinds::default(),
        gaps: Gaps::default(),
        clipping: ClippingWatch::default(),
        still: StillWatch::default(),
        screen,
    };
    if let Some((motions, report)) = bound {
        state.bound = motions;
        state.report.smoothed = Some(report);
    }
    for message in reader {
        state.take(message?)?;
        progress(state.report.frames);
    }
    state.flush()?;
    state.release_info()?;
    state.report.hidden_clipping = state.clipping.words();
    progress(state.report.frames);
    let mut summary = SummaryInput::clean("replayed to the end");
    let (more, done) = (&mut summary.more, &state.report);
    for (key, n) in [
        ("live", done.live),
        ("live_identical", done.live_identical),
        ("live_different", done.live_different),
    ] {
        more.insert(format!("replay.{key}"), n.to_string());
    }
    more.extend(done.refined.iter().flat_map(RefineReport::metadata));
    more.extend(response.iter().flat_map(Found::metadata));
    for (topic, n) in &done.foreign {
        more.insert(format!("replay.not_copied.{topic}"), n.to_string());
    }
    more.extend(state.still.metadata(options.tolerance()));
    state.report.gaps = state.gaps.done();
    if let Some(screen) = state.screen.take() {
        screen.end("replayed to the end");
    }
    let outcome = state.writer.finish(&summary)?;
    Ok((state.report, outcome))
}

fn head(reader: &Input, log: &Path, options: &Options) -> Head {
    let metadata = reader.metadata();
    let toml = |name: &str| metadata.get(name).and_then(|m| m.get("toml")).cloned();
    let mut session: MetadataMap = metadata.get("session").cloned().unwrap_or_default();
    session.insert(
        "replay.of".to_owned(),
        log.file_name()
            .map(|n| n.to_string_lossy().into_owned())
            .unwrap_or_default(),
    );
    // A new log seals what it was given: what the old one could not vouch for stays said.
    let own_rig = toml("rig");
    let replaced = |name: &str| match name {
        "rig" => options.rig_toml.is_some() && options.rig_toml != own_rig,
        "calibration" => options.calibration.is_some(),
        _ => false,
    };
    for finding in reader.seal_findings() {
        tracing::warn!("{}: {finding}", log.display());
        if replaced(&finding.name) {
            continue;
        }
        let key = if finding.damaged() {
            DAMAGED_KEY
        } else {
            "replay.unverifiable."
        };
        session.insert(format!("{key}{}", finding.name), finding.to_string());
    }
    session.extend(options.build.session_keys("replay."));
    Head {
        rig_toml: options
            .rig_toml
            .clone()
            .or_else(|| toml("rig"))
            .unwrap_or_default(),
        calibration_toml: options
            .calibration_toml
            .clone()
            .or_else(|| toml("calibration")),
        session,
        build: options.build,
    }
}

/// States in the session what a frame takes where it is more than one of the rig's camera: a reader judges by it how far
/// black frames may unpack.
fn state_frame_bytes(head: &mut Head, bytes: usize) {
    let rig = Rig::from_toml(&head.rig_toml, "rig", None).ok();
    if rig.is_some_and(|rig| bytes as f64 > bytes_per_frame(&rig.camera)) {
        let session = &mut head.session;
        session.insert(FRAME_BYTES_KEY.to_owned(), bytes.to_string());
    }
}

/// 64-bit fingerprint of a profile's bytes; two different profiles share one by a chance of 1 in 10^19.
fn fingerprint(profile: &StripeProfile) -> u64 {
    let mut hasher = DefaultHasher::new();
    profile.encode_to_vec().hash(&mut hasher);
    hasher.finish()
}

struct Replay<'a> {
    writer: FileRecorder,
    options: &'a Options,
    /// Fingerprints of the recording's profiles by stamp and sequence (the bytes of an hour would fill the memory).
    live: HashMap<(u64, u32), Fingerprint>,
    /// Profiles computed here that have not met their live twin yet.
    ours: HashMap<(u64, u32), Fingerprint>,
    pending: Vec<LogMessage>,
    frames_pending: usize,
    report: Report,
    index: u64,
    /// With images kept: a frame's account waiting for the image that brings it along.
    info: Option<(u64, FrameInfo)>,
    run: Option<PoseRun>,
    /// Measures the noise of the poses, if the vehicle was at rest.
    still: StillWatch,
    /// The live page.
    screen: Option<Unhurried>,
    /// Smoothed motion by stamp, in place of the frames' own poses.
    bound: HashMap<u64, VehicleMotion>,
    /// Stamps of frames whose pose was computed here: the recording's own pose of them is replaced.
    posed: HashSet<u64>,
    kinds: Kinds,
    gaps: Gaps,
    clipping: ClippingWatch,
}

/// Reasons of the same kind: their numbers differ from frame to frame, and the first one's stand for all.
#[derive(Default)]
struct Kinds(HashMap<String, String>);

impl Kinds {
    fn count(&mut self, counts: &mut BTreeMap<String, u64>, words: &str) {
        let kind = words.chars().filter(|c| !c.is_ascii_digit()).collect();
        let first = self.0.entry(kind).or_insert_with(|| words.to_owned());
        *counts.entry(first.clone()).or_default() += 1;
    }
}

/// Lets a run know of a command.
fn commanded(run: &mut PoseRun, command: &ThrusterCommand) {
    let stamp_ns = command.timestamp.as_ref().map_or(0, unix_ns);
    run.command(stamp_ns, &command.thruster, command.thrust_n);
}

fn is_in_the_making(calibration: &PlaneCalibration) -> bool {
    !calibration.state.is_empty() && calibration.state != message::IN_FORCE
}

/// A frame's stripe, and its pose fitted ahead.
type Posed = (GreyImage, Profile, Speculative);
/// A frame's stripe.
struct Analysed {
    message: StripeProfile,
    /// Image, profile and fit of its pose; `None` also where no run is followed.
    posed: Option<Posed>,
    /// Why a frame that nothing marks as faulty cannot be read.
    unreadable: Option<FrameError>,
}

impl Analysed {
    /// The stripe of a frame and, where a run is followed, its pose, fitted ahead of its turn.
    fn of(analyst: &mut Analyst, run: Option<&PoseRun>, frame: &Frame) -> Self {
        let (message, whole) = analyst.analyse_whole(frame);
        let (posed, unreadable) = match whole {
            Ok((image, profile)) => {
                let posed = run.map(|run| {
                    let at_ns = frame.meta.mid_exposure_ns;
                    let speculative = run.speculative(at_ns, &image, &profile);
                    (image, profile, speculative)
                });
                (posed, None)
            }
            Err(NotExtracted::Unreadable(error)) => (None, Some(error)),
            Err(NotExtracted::Excluded) => (None, None),
        };
        Self {
            message,
            posed,
            unreadable,
        }
    }
}

impl Replay<'_> {
    fn take(&mut self, message: LogMessage) -> Result<(), ReplayError> {
        self.frames_pending += usize::from(matches!(message.record, Record::Frame(_)));
        if let (Some(run), Record::Command(command)) = (&mut self.run, &message.record) {
            // By their stamps: frames that still wait are carried by those before them alone.
            commanded(run, command);
        }
        self.pending.push(message);
        let batch = if self.screen.is_some() {
            BATCH_SHOWN
        } else {
            BATCH
        };
        if self.frames_pending >= batch || self.pending.len() >= PENDING_MAX {
            self.flush()
        } else {
            Ok(())
        }
    }

    /// Extracts the pending frames in parallel and writes everything pending in its order.
    fn flush(&mut self) -> Result<(), ReplayError> {
        let pending = std::mem::take(&mut self.pending);
        self.frames_pending = 0;
        let options = self.options;
        let run = self.run.as_ref();
        let profiles: Vec<Option<Analysed>> = pending
            .par_iter()
            .map_init(
                || options.analyst(),
                |analyst, message| match &message.record {
                    Record::Frame(frame) => Some(Analysed::of(analyst, run, frame)),
                    _ => None,
                },
            )
            .collect();
        for (message, profile) in pending.into_iter().zip(profiles) {
            self.write(message, profile)?;
        }
        Ok(())
    }

    fn write(
        &mut self,
        message: LogMessage,
        analysed: Option<Analysed>,
    ) -> Result<(), ReplayError> {
        let log_ns = message.log_ns;
        let entry = match message.record {
            Record::Frame(frame) => {
                if self.options.keep_images {
                    let unreadable = analysed.as_ref().and_then(|a| a.unreadable.as_ref());
                    let mut kept = frame.clone();
                    if matches!(unreadable, Some(FrameError::Damaged { .. })) {
                        // The new log says what the one it was made of did not.
                        kept.meta.fault = Some(FrameFault::BrokenJpeg);
                    }
                    // The frame writes its account itself; only the recording's index is taken over.
                    let own = self
                        .info
                        .take_if(|(_, info)| info.sequence == frame.meta.sequence);
                    self.release_info()?;
                    let index = own.map_or(self.index, |(_, info)| info.frame_index);
                    self.writer.write(log_ns, &Entry::frame(&kept, index))?;
                }
                self.index += 1;
                if let Some(Analysed {
                    message: profile,
                    posed,
                    unreadable,
                }) = analysed
                {
                    self.count(&frame, &profile, unreadable.is_some());
                    self.writer.write(log_ns, &Entry::profile(&profile))?;
                    if self.options.keep_images {
                        self.writer.write(
                            log_ns,
                            &Entry::annotations(&messages::stripe_annotations(&profile)),
                        )?;
                    }
                    self.write_pose(log_ns, frame.meta.mid_exposure_ns, posed)?;
                    if let Some(screen) = &mut self.screen {
                        screen.frame(&frame, &profile);
                        screen.done(self.report.frames, frame.meta.mid_exposure_ns, None);
                    }
                }
                return Ok(());
            }
            Record::Profile(live) => {
                let key = (live.timestamp.as_ref().map_or(0, unix_ns), live.sequence);
                self.report.live += 1;
                let live = Fingerprint::of(&live);
                match self.ours.remove(&key) {
                    Some(ours) => self.report.compared(live, ours),
                    None => {
                        self.live.insert(key, live);
                    }
                }
                return Ok(());
            }
            // Drawn again from the new profile.
            Record::Annotations(_) => return Ok(()),
            Record::Other { topic, .. } => {
                *self.report.foreign.entry(topic).or_default() += 1;
                return Ok(());
            }
            Record::FrameInfo(info) if self.options.keep_images => {
                self.release_info()?;
                self.info = Some((log_ns, info));
                return Ok(());
            }
            Record::FrameInfo(info) => Entry::frame_info(&info),
            Record::Log(line) => Entry::log_line(&line),
            Record::Command(command) => {
                self.report.commands += 1;
                self.still.command(&command);
                if let Some(screen) = &mut self.screen {
                    screen.command(&command);
                }
                Entry::command(&command)
            }
            Record::Echo(echo) => {
                if let Some(screen) = &mut self.screen {
                    screen.echo(&echo);
                }
                Entry::echo(&echo)
            }
            // Poses that the daemon measured live from this frame were computed again above.
            Record::Motion(motion) if self.is_posed(&motion) => return Ok(()),
            Record::Pose(pose) if self.is_posed(&pose) => return Ok(()),
            Record::Motion(motion) => {
                self.still.motion(&motion);
                if let Some(screen) = &mut self.screen {
                    screen.motion("from the log", &motion);
                }
                Entry::motion(&motion)
            }
            Record::AutopilotMotion(motion) => Entry::autopilot_motion(&motion),
            Record::AutopilotState(state) => Entry::autopilot_state(&state),
            Record::Truth(truth) => Entry::truth(&truth),
            Record::Clock(clock) => Entry::clock(&clock),
            Record::Event(event) => {
                if let Some(screen) = &mut self.screen {
                    screen.event(&event);
                }
                Entry::event_message(&event)
            }
            // The calibration in force while recording gives way to the one in force here; one in the making stays.
            Record::PlaneCalibration(old) if is_in_the_making(&old) => {
                self.report.calibrates = true;
                Entry::plane_calibration(&old)
            }
            Record::PlaneCalibration(old) => match &self.options.calibration {
                Some(new) => {
                    let stamp_ns = old.timestamp.as_ref().map_or(0, unix_ns);
                    Entry::plane_calibration(&message::in_force(new, stamp_ns))
                }
                None => Entry::plane_calibration(&old),
            },
            Record::CameraCalibration(calibration) => Entry::camera_calibration(&calibration),
            Record::Pose(pose) => Entry::pose(&pose),
        };
        Ok(self.writer.write(log_ns, &entry)?)
    }

    /// Whether a message is of a frame whose pose was computed here.
    fn is_posed(&self, message: &impl Stamped) -> bool {
        let stamp_ns = message.stamp_ns();
        stamp_ns.is_some_and(|ns| self.posed.contains(&ns))
    }

    /// Writes an account whose image did not follow.
    fn release_info(&mut self) -> Result<(), ReplayError> {
        if let Some((log_ns, info)) = self.info.take() {
            self.writer.write(log_ns, &Entry::frame_info(&info))?;
        }
        Ok(())
    }

    /// The pose of a frame, where a run is followed and the pose is fit for use.
    fn write_pose(
        &mut self,
        log_ns: u64,
        stamp_ns: u64,
        pixels: Option<Posed>,
    ) -> Result<(), ReplayError> {
        if let Some(motion) = self.bound.get(&stamp_ns).cloned() {
            self.posed.insert(stamp_ns);
            self.report.poses += 1;
            return self.write_motion(log_ns, &motion);
        }
        let (Some(run), Some((image, profile, speculative))) = (&mut self.run, pixels) else {
            return Ok(());
        };
        self.posed.insert(stamp_ns);
        let why = match run.pose_speculative(stamp_ns, &image, &profile, speculative) {
            RunPose::Good(fit) => {
                self.report.poses += 1;
                self.gaps.pose(stamp_ns);
                let motion = motion_message(stamp_ns, &fit);
                self.still.motion(&motion);
                return self.write_motion(log_ns, &motion);
            }
            RunPose::Flagged(fit) => fit.reasons(),
            RunPose::None(fault) => fault.to_string(),
        };
        self.gaps.none(stamp_ns, &why);
        self.kinds.count(&mut self.report.without_pose, &why);
        Ok(())
    }

    fn write_motion(&mut self, log_ns: u64, motion: &VehicleMotion) -> Result<(), ReplayError> {
        self.writer.write(log_ns, &Entry::motion(motion))?;
        if let Some(screen) = &mut self.screen {
            screen.motion("fitted", motion);
        }
        if let Some(pose) = messages::pose_message(motion) {
            self.writer.write(log_ns, &Entry::pose(&pose))?;
        }
        Ok(())
    }

    fn count(&mut self, frame: &Frame, profile: &StripeProfile, is_unreadable: bool) {
        let stamp_ns = frame.meta.mid_exposure_ns;
        if frame.meta.fault.is_none() {
            self.clipping.see(frame, &self.options.rule);
        }
        let report = &mut self.report;
        report.frames += 1;
        let is_marked = frame.meta.fault.is_some_and(FrameFault::is_damage);
        report.marked_damaged += u64::from(is_marked);
        report.points += profile.row_px.len() as u64;
        report.span_ns = Some(report.span_ns.map_or((stamp_ns, stamp_ns), |(a, b)| {
            (a.min(stamp_ns), b.max(stamp_ns))
        }));
        if profile.fault.is_empty() {
            report.with_stripe += 1;
        } else {
            if is_unreadable {
                report.undecodable += 1;
                if report.undecodable_frames.len() < NAMED_MAX {
                    report.undecodable_frames.push(frame.meta.sequence);
                }
            }
            self.kinds.count(&mut report.without_stripe, &profile.fault);
        }
        let key = (stamp_ns, profile.sequence);
        let ours = Fingerprint::of(profile);
        match self.live.remove(&key) {
            Some(live) => report.compared(live, ours),
            None => {
                self.ours.insert(key, ours);
            }
        }
    }
}
