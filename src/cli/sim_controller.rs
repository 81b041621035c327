//! `hydroline sim-controller` (hidden): a thruster controller for tests of real serial drivers.

use super::print::{errln, outln};
use super::{CliError, Outcome, inputs};
use hydroline_core::clock::{Clock, SystemClock};
use hydroline_rigs::LinkKind;
use hydroline_thruster::controller::{
    ControllerConfig, ControllerEvent, PtyController, ServeEnd, SimController, serve,
};
use std::os::unix::net::UnixStream;
use std::path::PathBuf;
use std::sync::Mutex;
use std::sync::atomic::AtomicBool;
use std::time::Duration;

#[derive(Debug, clap::Args)]
#[command(after_help = "\
Examples:
  hydroline sim-controller --kind stamped --pty /tmp/controller

Exit codes: 0 the socket was closed; 1 it failed; 2 bad arguments, or no such socket.")]
#[command(group(clap::ArgGroup::new("line").required(true)))]
pub struct Args {
    /// Connects to this UNIX socket (as QEMU's chardev offers it) and serves until it closes
    #[arg(long, value_name = "PATH", group = "line")]
    socket: Option<PathBuf>,
    /// Opens a pseudo-terminal, linked to from this path, and serves until killed
    #[arg(long, value_name = "PATH", group = "line")]
    pty: Option<PathBuf>,
    /// Protocol of the controller
    #[arg(long, value_enum)]
    kind: Kind,
    /// Comes back when the socket closes, for so long
    #[arg(long, value_parser = inputs::duration, default_value = "0s", value_name = "TIME")]
    reconnect: Duration,
}

#[derive(Debug, Clone, Copy, clap::ValueEnum)]
enum Kind {
    /// Our own framing, stamped by the controller
    Stamped,
    /// Pololu Maestro
    Maestro,
}

pub fn run(args: &Args) -> Result<Outcome, CliError> {
    let kind = match args.kind {
        Kind::Stamped => LinkKind::Stamped,
        Kind::Maestro => LinkKind::Maestro,
    };
    let controller = SimController::new(ControllerConfig::bench(kind));
    let mut print = |event: ControllerEvent| {
        outln!(
            "{} {} {:.2} {:?}",
            event.host_monotonic_ns,
            event.channel,
            event.pulse_us,
            event.cause
        );
    };
    if let Some(path) = &args.pty {
        let pty = PtyController::start(controller, Some(path.clone()), Box::new(print))?;
        errln!("serving on {}", pty.path().unwrap_or(path).display());
        loop {
            std::thread::sleep(Duration::from_secs(3600));
        }
    }
    let Some(socket) = &args.socket else {
        return Err(CliError::Config("--socket or --pty is needed".to_owned()));
    };
    let controller = Mutex::new(controller);
    let clock = SystemClock;
    let mut gone_since_ns = clock.monotonic_ns();
    loop {
        match UnixStream::connect(socket) {
            Ok(mut stream) => {
                let end = serve(
                    &controller,
                    &mut stream,
                    &clock,
                    &AtomicBool::new(false),
                    &mut print,
                )
                .map_err(|e| CliError::Run(format!("{}: {e}", socket.display())))?;
                if matches!(end, ServeEnd::Stopped) {
                    return Ok(Outcome::Done);
                }
                gone_since_ns = clock.monotonic_ns();
            }
            Err(error)
                if clock.monotonic_ns() - gone_since_ns > args.reconnect.as_nanos() as u64 =>
            {
                return Err(CliError::reading(
                    socket,
                    &error,
                    "start QEMU with that socket first",
                ));
            }
            Err(_) => {}
        }
        if args.reconnect.is_zero() {
            return Ok(Outcome::Done);
        }
        std::thread::sleep(Duration::from_millis(50));
    }
}
