//! From a checked rig to the real or simulated parts that a recording is made of.

use super::CliError;
use hydroline_capture::sim::SimCamera;
use hydroline_capture::v4l::system::KernelSystem;
use hydroline_capture::{FrameSource, OpenOptions, V4lSource};
use hydroline_core::clock::Clock;
use hydroline_daemon::simulated::{BoardInView, CameraView, SimulatedVehicle};
use hydroline_rigs::{Board, CameraBackend, Channel, LinkPort, Rig};
use hydroline_sim::Renderer;
use hydroline_thruster::controller::{ControllerConfig, PtyController, SimController};
use hydroline_thruster::ports::Roots;
use hydroline_thruster::service::{Opener, serial_opener};
use std::sync::Arc;

/// The parts, opened.
pub struct Rigged {
    /// The camera.
    pub source: Box<dyn FrameSource>,
    /// Opens the thruster line; `None` when the rig has no thrusters or they were left out.
    pub line: Option<Opener>,
    /// The simulated vehicle behind simulated parts, and CLOCK_MONOTONIC of its t = 0 \[ns\].
    pub vehicle: Option<(Arc<SimulatedVehicle>, u64)>,
    /// Keeps the simulated controller's pseudo-terminal open.
    pub controller: Option<PtyController>,
}

/// Opens what the rig names. `with_thrusters = false` leaves the line closed.
pub fn open(rig: &Rig, clock: &Arc<dyn Clock>, with_thrusters: bool) -> Result<Rigged, CliError> {
    open_with_board(rig, clock, with_thrusters, None, None)
}

/// The same with a calibration board in the sheet of a simulated camera (a real camera sees what is there), and with
/// the vehicle and `[[physics]]` of another rig behind simulated parts.
pub fn open_with_board(
    rig: &Rig,
    clock: &Arc<dyn Clock>,
    with_thrusters: bool,
    board: Option<&Board>,
    tank: Option<&Rig>,
) -> Result<Rigged, CliError> {
    let simulated_line = with_thrusters && rig.thrusters.link.port == LinkPort::Sim;
    let simulated_camera = matches!(rig.camera.backend, CameraBackend::Sim);
    let simulated = match tank {
        Some(tank) => Rig {
            vehicle: tank.vehicle.clone(),
            physics: tank.physics.clone(),
            ..rig.clone()
        },
        None => rig.clone(),
    };
    let vehicle = if simulated_camera || simulated_line {
        Some(SimulatedVehicle::new(&simulated)?)
    } else {
        None
    };
    let controller = match &vehicle {
        Some(vehicle) if simulated_line => Some(start_controller(rig, vehicle)?),
        _ => None,
    };
    let line = with_thrusters
        .then(|| opener(rig, clock, controller.as_ref()))
        .transpose()?;
    let (source, start_ns) = match (&rig.camera.backend, &vehicle) {
        (CameraBackend::Sim, Some(vehicle)) => {
            let view = match board {
                Some(board) => {
                    let shown = BoardInView::new(rig, board, 0.0)?;
                    CameraView::of_board(vehicle.clone(), shown)
                }
                None => {
                    let renderer = Renderer::new(&simulated)?;
                    CameraView::new(vehicle.clone(), renderer)
                }
            };
            let camera = SimCamera::new(view, &rig.camera, clock.clone());
            let start_ns = camera.start_ns();
            (Box::new(camera) as Box<dyn FrameSource>, start_ns)
        }
        _ => {
            // The rig's check has already refused a bare /dev/videoN unless the rig says so itself.
            let options = OpenOptions {
                allow_unstable_node: true,
                colour: rig.laser.channel != Channel::Luma,
                ..OpenOptions::default()
            };
            let system = Box::new(KernelSystem::default());
            let camera = V4lSource::open(&rig.camera, options, system, clock.clone())?;
            (
                Box::new(camera) as Box<dyn FrameSource>,
                clock.monotonic_ns(),
            )
        }
    };
    if let Some(vehicle) = &vehicle {
        vehicle.start(start_ns);
    }
    Ok(Rigged {
        source,
        line,
        vehicle: vehicle.map(|v| (v, start_ns)),
        controller,
    })
}

fn start_controller(rig: &Rig, vehicle: &Arc<SimulatedVehicle>) -> Result<PtyController, CliError> {
    let controller = SimController::new(ControllerConfig::for_rig(&rig.thrusters));
    let vehicle = vehicle.clone();
    let on_pulses = Box::new(
        move |event: hydroline_thruster::controller::ControllerEvent| {
            if let Err(error) =
                vehicle.pulse(event.host_monotonic_ns, event.channel, event.pulse_us)
            {
                tracing::error!("simulated vehicle: {error}");
            }
        },
    );
    Ok(PtyController::start(controller, None, on_pulses)?)
}

/// The way to open a rig's line.
pub fn opener(
    rig: &Rig,
    clock: &Arc<dyn Clock>,
    controller: Option<&PtyController>,
) -> Result<Opener, CliError> {
    let mut set = rig.thrusters.clone();
    if let Some(controller) = controller {
        let path = controller.path().ok_or_else(|| {
            CliError::Run("the simulated controller has no pseudo-terminal".to_owned())
        })?;
        set.link.port = LinkPort::Node(path.to_owned());
    }
    Ok(serial_opener(&set, Roots::default(), clock.clone()))
}
