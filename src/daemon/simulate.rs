//! `simulate`: a plan run through the forward model without waiting for the clock.
//!
//! The same rig, plan, seed and options give the same bytes: times start at a fixed UNIX second,
//! nothing reads a clock, and the renderer's noise is counted, not drawn.

use crate::analysis::Analyst;
use crate::live::Live;
use crate::live::unhurried::Unhurried;
use crate::simulated::{BoardInView, motion_message};
use bytes::Bytes;
use hydroline_calib::IdealMap;
use hydroline_calib::plane::PlaneMap;
use hydroline_capture::{CaptureError, NegotiatedFormat, SourceDescription};
use hydroline_core::build_info::BuildInfo;
use hydroline_core::clock::SIMULATION_START_UNIX_S;
use hydroline_core::frame::{Frame, FrameMeta, PixelFormat};
use hydroline_log::messages::{self, pb, timestamp};
use hydroline_log::{
    Entry, FileRecorder, Head, LogError, LogOutcome, MetadataMap, SummaryInput, WriteSettings,
};
use hydroline_plan::setpoint::{Setpoint, SetpointError, setpoint};
use hydroline_rigs::{Board, Plan, Rig};
use hydroline_sim::{Allocation, Pose6, Renderer, SceneError, SimError, World};
use hydroline_stripe::ExtractorConfig;
use rand::{SeedableRng, rngs::StdRng};
use rand_distr::{Distribution, Normal};
use std::collections::VecDeque;
use std::path::Path;
use std::sync::Arc;

/// Options of a simulation.
#[derive(Debug, Clone, PartialEq)]
pub struct Options {
    /// Seed of the images' and the measured motion's noise; `None` = the rig's.
    pub seed: Option<u64>,
    /// No images: measured motion (truth plus white noise) instead.
    pub motion_only: bool,
    /// White noise of the measured position, standard deviation \[m\] (motion only).
    pub position_noise_m: f64,
    /// White noise of the measured attitude, standard deviation \[rad\] (motion only).
    pub attitude_noise_rad: f64,
    /// Goes on for this long after the plan's last step \[s\] (coasting).
    pub tail_s: f64,
    /// Free text for the log.
    pub note: Option<String>,
    /// A calibration board in the sheet instead of the tank, and how far its face stands behind the sheet \[m\].
    pub board: Option<(Board, f64)>,
    /// The simulating program, for the log's head.
    pub build: BuildInfo,
    /// Where it shows itself; changes no byte of the log.
    pub live: Option<Live>,
    /// The log's first second, UNIX \[s\].
    pub start_unix_s: u64,
    /// Rig that is simulated where it is not the one that the log names: its vehicle, thrusters' curves and `[[physics]]`.
    pub tank: Option<Rig>,
}

impl Default for Options {
    fn default() -> Self {
        Self {
            seed: None,
            motion_only: false,
            position_noise_m: 1.5e-4,
            attitude_noise_rad: 0.01_f64.to_radians(),
            tail_s: 0.0,
            note: None,
            board: None,
            build: BuildInfo::default(),
            live: None,
            start_unix_s: SIMULATION_START_UNIX_S,
            tank: None,
        }
    }
}

/// Failure to simulate a plan.
#[derive(Debug, thiserror::Error)]
#[allow(missing_docs)] // Each message names its fields.
pub enum SimulateError {
    #[error(transparent)]
    Sim(#[from] SimError),
    #[error(transparent)]
    Scene(#[from] SceneError),
    /// A step asks for what the thrusters cannot do.
    #[error(transparent)]
    Plan(#[from] SetpointError),
    #[error(transparent)]
    Log(#[from] LogError),
    #[error("noise {value} is not a standard deviation: it must be finite and >= 0")]
    Noise { value: f64 },
    #[error(transparent)]
    Capture(#[from] CaptureError),
    #[error(
        "a run of {length_s} s from UNIX {start_s} s on ends beyond 2554, where stamps of 64 bits of nanoseconds end: start earlier"
    )]
    Start { start_s: u64, length_s: f64 },
}

/// Exposure and latency of the last frame after the run's end \[ns\].
const SPARE_NS: u64 = 3_600_000_000_000;

/// Runs a plan and writes its log; `progress` is called with (frames done, frames in all).
///
/// # Errors
/// [`SimulateError`]; there is no log then.
pub fn simulate(
    rig: &Rig,
    plan: &Plan,
    out: &Path,
    options: &Options,
    progress: &mut dyn FnMut(u64, u64),
) -> Result<LogOutcome, SimulateError> {
    let mut rig = rig.clone();
    if let Some(seed) = options.seed {
        rig.camera.seed = seed;
    }
    // The simulator renders grey frames whatever the rig's real camera delivers.
    rig.camera.pixel_format = PixelFormat::Grey;
    let truth_of = options.tank.as_ref().map_or_else(
        || rig.clone(),
        |tank| Rig {
            vehicle: tank.vehicle.clone(),
            thrusters: tank.thrusters.clone(),
            physics: tank.physics.clone(),
            ..rig.clone()
        },
    );
    let allocation = Allocation::new(&rig.thrusters).map_err(SimError::from)?;
    let mut world = World::new(&truth_of, rig.tank.start_pose)?;
    let renderer = if options.motion_only {
        None
    } else {
        Some(Renderer::new(&truth_of)?)
    };
    let length_s = plan.duration_s() + options.tail_s;
    let start_s = options.start_unix_s;
    let beyond = SimulateError::Start { start_s, length_s };
    let start_ns = start_s.checked_mul(1_000_000_000);
    let start_ns =
        start_ns.filter(|ns| ns.checked_add((length_s * 1e9) as u64 + SPARE_NS).is_some());
    let start_ns = start_ns.ok_or(beyond)?;
    let at_ns = |t_s: f64| start_ns + (t_s * 1e9).round() as u64;
    let board = match (&options.board, options.motion_only) {
        (Some((board, offset_m)), false) => Some(BoardInView::new(&rig, board, *offset_m)?),
        _ => None,
    };
    let camera_format = renderer.as_ref().map(|_| PixelFormat::Grey);
    let mut log = FileRecorder::create_whole(
        out,
        false,
        head(&rig, plan, options),
        WriteSettings::offline(camera_format),
    )?;
    let mut noise = Noise::new(rig.camera.seed, options)?;
    if renderer.is_some() {
        let calibration = messages::camera_calibration(&rig.camera, at_ns(0.0));
        log.write(at_ns(0.0), &Entry::camera_calibration(&calibration))?;
    }

    let frames = (length_s * rig.camera.rate_fps).floor() as u64;
    let commands = (length_s * rig.thrusters.link.rate_hz).floor() as u64;
    let rows = match renderer {
        Some(_) => rig.camera.height_px as usize,
        None => 1,
    };
    let mut screen = options
        .live
        .as_ref()
        .map(|live| Screen::new(live, &rig, plan, options.board.is_some()));
    let mut next_command = 0;
    // Commanded already because a row of the frame in hand looks beyond the frame's stamp, not logged yet.
    let mut ahead: VecDeque<(f64, Setpoint)> = VecDeque::new();
    let mut sequence = 0;
    for k in 0..frames {
        let t_s =
            (k as f64 + 0.5 * rig.camera.exposure_s * rig.camera.rate_fps) / rig.camera.rate_fps;
        let seen_s = world.latest_scene_time_s(t_s, rows).max(t_s);
        while next_command <= commands && next_command as f64 / rig.thrusters.link.rate_hz <= seen_s
        {
            let command_s = next_command as f64 / rig.thrusters.link.rate_hz;
            let set = setpoint(&rig, &allocation, plan, command_s)?;
            world.command_pulses(command_s, &set.pulses_us)?;
            ahead.push_back((command_s, set));
            next_command += 1;
        }
        while ahead
            .front()
            .is_some_and(|(command_s, _)| *command_s <= t_s)
        {
            let Some((command_s, set)) = ahead.pop_front() else {
                break;
            };
            for message in commands_of(&rig, &set, at_ns(command_s), sequence) {
                log.write(at_ns(command_s), &Entry::command(&message))?;
                if let Some(screen) = &mut screen {
                    screen.unhurried.command(&message);
                }
            }
            // As the thruster service: one sequence per set, shared by all thrusters.
            sequence = sequence.wrapping_add(1);
        }
        let stamp_ns = at_ns(t_s);
        let truth = motion_message(stamp_ns, &world.state_at(t_s)?);
        if let Some(screen) = &mut screen {
            screen.unhurried.motion("simulated", &truth);
        }
        match &renderer {
            Some(renderer) => {
                let pixels = match &board {
                    Some(board) => board.frame(k),
                    None => renderer.render_frame(&world.frame_poses(t_s, rows)?, k).0,
                };
                let frame = frame(&rig, pixels, k, stamp_ns);
                log.write(stamp_ns, &Entry::frame(&frame, k))?;
                if let Some(screen) = &mut screen {
                    screen.frame(&frame);
                }
            }
            None => {
                let reported = world.pose_reported(t_s)?;
                log.write(
                    stamp_ns,
                    &Entry::motion(&noise.measure(stamp_ns, &reported)),
                )?;
            }
        }
        log.write(stamp_ns, &Entry::truth(&truth))?;
        if let Some(screen) = &mut screen {
            screen.unhurried.done(k + 1, stamp_ns, Some(frames));
        }
        progress(k + 1, frames);
    }
    if let Some(screen) = screen {
        screen.unhurried.end("simulated to the plan's end");
    }
    Ok(log.finish(&SummaryInput::clean("simulated to the plan's end"))?)
}

fn head(rig: &Rig, plan: &Plan, options: &Options) -> Head {
    let source = SourceDescription {
        kind: "simulate".to_owned(),
        format: NegotiatedFormat {
            fourcc: "GREY".to_owned(),
            width_px: rig.camera.width_px,
            height_px: rig.camera.height_px,
            ..NegotiatedFormat::default()
        },
        rate_fps: rig.camera.rate_fps,
        ..SourceDescription::default()
    };
    let mut session = MetadataMap::new();
    let mut put = |key: &str, value: String| session.insert(key.to_owned(), value);
    put("kind", "simulate".to_owned());
    put("plan", plan.source_toml.clone());
    put("plan.name", plan.name.clone());
    put("planned_s", plan.duration_s().to_string());
    put("seed", rig.camera.seed.to_string());
    put("source", serde_json::to_string(&source).unwrap_or_default());
    if options.motion_only {
        put("noise.position_m", options.position_noise_m.to_string());
        put("noise.attitude_rad", options.attitude_noise_rad.to_string());
    }
    if let Some(note) = &options.note {
        put("note", note.clone());
    }
    Head {
        rig_toml: rig.effective_toml.clone(),
        calibration_toml: None,
        session,
        build: options.build,
    }
}

fn commands_of<'a>(
    rig: &'a Rig,
    set: &'a Setpoint,
    at_ns: u64,
    sequence: u32,
) -> impl Iterator<Item = pb::ThrusterCommand> + 'a {
    let values = set.thrust_n.iter().zip(&set.pulses_us);
    let thrusters = rig.thrusters.thrusters.iter().zip(values);
    thrusters.map(
        move |(thruster, (thrust_n, pulse_us))| pb::ThrusterCommand {
            timestamp: Some(timestamp(at_ns)),
            sequence,
            thruster: thruster.name.clone(),
            thrust_n: *thrust_n,
            pulse_us: *pulse_us,
            due_ns: at_ns,
            plan_step: set.plan_step,
            cause: "plan".to_owned(),
        },
    )
}

/// Live page of a simulation: stripes of the frames that somebody looks at.
struct Screen {
    unhurried: Unhurried,
    analyst: Analyst,
}

impl Screen {
    fn new(live: &Live, rig: &Rig, plan: &Plan, shows_board: bool) -> Self {
        let map: Arc<dyn PlaneMap> = Arc::new(IdealMap::of(rig));
        let outlined = (!shows_board).then(|| map.clone());
        let rule = rig.grey_rule();
        let mut unhurried = Unhurried::new(live, "simulate", rule, Some(rig), outlined);
        unhurried.plan(&plan.name, plan.steps.len() as u32);
        Self {
            unhurried,
            analyst: Analyst::new(ExtractorConfig::default(), Some(map), rule),
        }
    }

    fn frame(&mut self, frame: &Frame) {
        if self.unhurried.wants_picture() {
            let profile = self.analyst.analyse(frame);
            self.unhurried.frame(frame, &profile);
        }
    }
}

fn frame(rig: &Rig, pixels: Vec<u8>, index: u64, stamp_ns: u64) -> Frame {
    Frame {
        format: PixelFormat::Grey,
        width_px: rig.camera.width_px,
        height_px: rig.camera.height_px,
        stride_bytes: rig.camera.width_px,
        data: Bytes::from(pixels),
        meta: FrameMeta {
            received_monotonic_ns: stamp_ns,
            exposure_s: rig.camera.exposure_s,
            ..FrameMeta::at(index as u32, stamp_ns)
        },
    }
}

/// White noise on measured poses.
struct Noise {
    rng: StdRng,
    position: Normal<f64>,
    attitude: Normal<f64>,
}

impl Noise {
    fn new(seed: u64, options: &Options) -> Result<Self, SimulateError> {
        let normal = |sd: f64| {
            let sound = sd.is_finite() && sd >= 0.0;
            Normal::new(0.0, sd)
                .ok()
                .filter(|_| sound)
                .ok_or(SimulateError::Noise { value: sd })
        };
        Ok(Self {
            rng: StdRng::seed_from_u64(seed),
            position: normal(options.position_noise_m)?,
            attitude: normal(options.attitude_noise_rad)?,
        })
    }

    fn measure(&mut self, unix_ns: u64, pose: &Pose6) -> pb::VehicleMotion {
        let eta = pose.to_array();
        let measured = std::array::from_fn(|i| {
            let noise = if i < 3 { self.position } else { self.attitude };
            Some(eta[i] + noise.sample(&mut self.rng))
        });
        let (p, a) = (
            self.position.std_dev().powi(2),
            self.attitude.std_dev().powi(2),
        );
        let mut covariance = vec![0.0; 36];
        for (i, variance) in [p, p, p, a, a, a].into_iter().enumerate() {
            covariance[7 * i] = variance;
        }
        pb::VehicleMotion {
            covariance,
            ..pb::VehicleMotion::of_pose(unix_ns, measured)
        }
    }
}
