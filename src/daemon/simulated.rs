//! The simulated vehicle in real time: what a simulated controller drives and a simulated camera sees.
//!
//! One [`World`] behind a lock, shared by the controller's thread (pulses in) and the capture thread
//! (images out). Its time is seconds since the camera's first exposure, on CLOCK_MONOTONIC.

use hydroline_calib::IdealMap;
use hydroline_capture::CaptureError;
use hydroline_capture::sim::Scene;
use hydroline_core::lock::Lock;
use hydroline_core::run::PerChannel;
use hydroline_log::messages::VehicleMotion;
use hydroline_log::{Entry, Recorder};
use hydroline_rigs::{Board, Rig};
use hydroline_sim::scene::{BoardLight, BoardPicture, BoardPlacement};
use hydroline_sim::{Renderer, SceneError, SimError, VehicleState, World};
use std::sync::{Arc, Mutex, OnceLock};

/// A vehicle that exists only here.
pub struct SimulatedVehicle {
    world: Mutex<State>,
    start_ns: OnceLock<u64>,
    recorder: OnceLock<(Recorder, u64)>,
    neutral_us: f64,
    channels: Vec<u8>,
}

struct State {
    world: World,
    pulses_us: Vec<f64>,
    last_t_s: f64,
}

impl SimulatedVehicle {
    /// At rest at the rig's start pose.
    ///
    /// # Errors
    /// [`SimError`] for a rig that cannot be simulated.
    pub fn new(rig: &Rig) -> Result<Arc<Self>, SimError> {
        let world = World::new(rig, rig.tank.start_pose)?;
        let neutral_us = rig.thrusters.neutral_us;
        Ok(Arc::new(Self {
            world: Mutex::new(State {
                world,
                pulses_us: vec![neutral_us; rig.thrusters.thrusters.len()],
                last_t_s: 0.0,
            }),
            start_ns: OnceLock::new(),
            recorder: OnceLock::new(),
            neutral_us,
            channels: rig.thrusters.thrusters.iter().map(|t| t.channel).collect(),
        }))
    }

    /// Starts the vehicle's time at this reading of CLOCK_MONOTONIC; only the first call counts.
    pub fn start(&self, monotonic_ns: u64) {
        // A second start would move a running vehicle through time; the first one holds.
        let _ = self.start_ns.set(monotonic_ns);
    }

    /// Logs the truth of every rendered frame from now on; `start_unix_ns` = UNIX time of the vehicle's t = 0.
    pub fn log_truth(&self, recorder: Recorder, start_unix_ns: u64) {
        let _ = self.recorder.set((recorder, start_unix_ns));
    }

    /// A pulse that the controller puts out since `at_ns` (CLOCK_MONOTONIC \[ns\]).
    ///
    /// # Errors
    /// [`SimError`] when the motion diverges.
    pub fn pulse(&self, at_ns: u64, channel: u8, pulse_us: f64) -> Result<(), SimError> {
        let Some(start_ns) = self.start_ns.get().copied() else {
            return Ok(());
        };
        let Some(place) = self.channels.iter().position(|c| *c == channel) else {
            return Ok(());
        };
        let mut state = self.world.held();
        // A pulse of 0 us (output off) drives a speed controller to neutral.
        state.pulses_us[place] = if pulse_us == 0.0 {
            self.neutral_us
        } else {
            pulse_us
        };
        // Motion that was already shown to the camera cannot be changed any more.
        let t_s = (at_ns.saturating_sub(start_ns) as f64 / 1e9).max(state.last_t_s);
        let pulses = state.pulses_us.clone();
        state.world.command_pulses(t_s, &pulses)
    }
}

/// A state as the message that `/sim/truth` and simulated `/vehicle/motion` carry.
pub fn motion_message(unix_ns: u64, state: &VehicleState) -> VehicleMotion {
    VehicleMotion::of(unix_ns, PerChannel::of_state(state.eta, state.nu).map(Some))
}

/// White of a board under the room's light \[grey levels\].
const BOARD_ROOM: f64 = 150.0;
/// The line where it faces the laser, on the sides of the gauge blocks: bright, but not saturated \[grey levels\].
const BOARD_LINE: f64 = 150.0;
/// Share of a sheet's light that the board's face sends back where the sheet grazes it.
const GRAZING: f64 = 0.1;

/// A calibration board standing in the sheet in front of a simulated camera: fixed to the vehicle, so
/// that its light is computed once and only the noise differs from frame to frame.
#[derive(Debug, Clone)]
pub struct BoardInView {
    renderer: Renderer,
    picture: BoardPicture,
    /// Where it stands.
    pub placement: BoardPlacement,
}

impl BoardInView {
    /// The board in the middle of the sheet that the rig's camera sees, its face `offset_m` behind the sheet.
    /// Exposure as a person would set it: white does not saturate.
    ///
    /// # Errors
    /// [`SceneError`] for a rig or board that cannot be rendered.
    pub fn new(rig: &Rig, board: &Board, offset_m: f64) -> Result<Self, SceneError> {
        let ideal = IdealMap::of(rig);
        let last_row = f64::from(rig.camera.height_px) - 1.0;
        let eta = |row: f64| ideal.unlimited(rig.camera.cx_px, row).map(|(_, eta)| eta);
        let eta_m = match (eta(0.0), eta(last_row)) {
            (Some(high), Some(low)) => 0.5 * (high + low),
            // A camera that looks over the horizon still looks at the sheet's origin.
            _ => 0.0,
        };
        let placement = BoardPlacement {
            centre_m: [0.0, eta_m],
            offset_m,
            ..BoardPlacement::default()
        };
        let mut exposed = rig.clone();
        exposed.laser.peak = rig.laser.peak.min(BOARD_LINE);
        let renderer = Renderer::new(&exposed)?;
        let light = BoardLight {
            room: BOARD_ROOM,
            slope_per_m: [0.3, 0.3],
            laser: true,
            grazing: GRAZING,
        };
        Ok(Self {
            picture: renderer.board_picture(board, &placement, &light)?,
            renderer,
            placement,
        })
    }

    /// Frame `index`, row-major grey levels.
    pub fn frame(&self, index: u64) -> Vec<u8> {
        self.renderer.develop_board(&self.picture, index).0
    }
}

enum Seen {
    Tank(Box<Renderer>),
    Board(Box<BoardInView>),
}

/// View of the simulated vehicle's camera.
pub struct CameraView {
    vehicle: Arc<SimulatedVehicle>,
    seen: Seen,
}

impl CameraView {
    /// Looks out of the vehicle with the given renderer.
    pub fn new(vehicle: Arc<SimulatedVehicle>, renderer: Renderer) -> Self {
        Self {
            vehicle,
            seen: Seen::Tank(Box::new(renderer)),
        }
    }

    /// Sees nothing but a board.
    pub fn of_board(vehicle: Arc<SimulatedVehicle>, board: BoardInView) -> Self {
        Self {
            vehicle,
            seen: Seen::Board(Box::new(board)),
        }
    }

    /// Rows that may show different times.
    fn rows(&self) -> usize {
        match &self.seen {
            Seen::Tank(renderer) => renderer.height_px(),
            Seen::Board(_) => 1,
        }
    }
}

fn failed(error: &SimError) -> CaptureError {
    CaptureError::Source {
        source_name: "simulated camera".to_owned(),
        reason: error.to_string(),
    }
}

impl Scene for CameraView {
    fn complete_s(&self, t_s: f64) -> f64 {
        let state = self.vehicle.world.held();
        state.world.latest_scene_time_s(t_s, self.rows()).max(t_s)
    }

    fn image_at(&mut self, t_s: f64, index: u64) -> Result<Vec<u8>, CaptureError> {
        let (poses, truth) = {
            let mut state = self.vehicle.world.held();
            let rows = self.rows();
            let poses = state.world.frame_poses(t_s, rows).map_err(|e| failed(&e))?;
            let truth = state.world.state_at(t_s).map_err(|e| failed(&e))?;
            state.last_t_s = state.world.latest_scene_time_s(t_s, rows).max(t_s);
            (poses, truth)
        };
        if let Some((recorder, start_unix_ns)) = self.vehicle.recorder.get() {
            recorder.push(Entry::truth(&motion_message(
                start_unix_ns + (t_s * 1e9) as u64,
                &truth,
            )));
        }
        Ok(match &self.seen {
            Seen::Tank(renderer) => renderer.render_frame(&poses, index).0,
            Seen::Board(board) => board.frame(index),
        })
    }
}
