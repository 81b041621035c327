//! `hydroline check`: is everything a rig needs there and usable? What is not is said with its cure.

use super::print::{self, outln};
use super::{CliError, Outcome, inputs, rigging};
use hydroline_capture::Captured;
use hydroline_core::clock::{Clock, SystemClock};
use hydroline_log::{bytes_per_s, free_bytes, writable_folder};
use hydroline_rigs::{LinkPort, Rig};
use hydroline_thruster::ports::Roots;
use hydroline_thruster::probe::{Answered, probe};
use hydroline_thruster::service::check_set;
use hydroline_thruster::transport::{SerialTransport, UdpTransport};
use schemars::JsonSchema;
use serde::Serialize;
use std::path::PathBuf;
use std::sync::Arc;
use std::time::Duration;

/// A thruster further than this from neutral may turn: the deadband of an ESC is 25 us and more to either side.
const NEUTRAL_US: f64 = 10.0;
/// Longest wait for a camera's first good frame.
const FRAME_WITHIN: Duration = Duration::from_secs(3);

#[derive(Debug, clap::Args)]
#[command(after_help = "\
Looks at camera (ten good frames), thruster controller (it is asked who it is and what it \
puts out; nothing moves), clock and disk.

Examples:
  hydroline check --rig my.toml
  hydroline check --rig my.toml --disk /data --json

Exit codes: 0 ready to record; 1 something has to be fixed first, as printed; 2 bad arguments or rig.")]
pub struct Args {
    /// Rig file or built-in name
    #[arg(long, value_name = "RIG")]
    rig: String,
    /// Folder to be recorded to
    #[arg(long, value_name = "DIR", default_value = ".")]
    disk: PathBuf,
    /// Prints one JSON object
    #[arg(long)]
    json: bool,
}

/// One thing that was looked at.
#[derive(Debug, Clone, Serialize, JsonSchema)]
struct Finding {
    /// Part that was looked at, such as camera or disk.
    what: &'static str,
    /// Whether it is fit for a recording.
    ok: bool,
    /// Finding; when not ok, with what to do.
    words: String,
}

/// Output of `--json`.
#[derive(Debug, Serialize, JsonSchema)]
pub(super) struct Checked<'a> {
    /// Name of the rig.
    rig: &'a str,
    /// Whether everything is fit for a recording.
    ready: bool,
    /// All that was looked at.
    checks: &'a [Finding],
}

pub fn run(args: &Args) -> Result<Outcome, CliError> {
    let rig = inputs::rig(&args.rig)?;
    inputs::warn_of_flush(&rig);
    inputs::warn_of_implausible(&rig);
    let findings = [camera(&rig), line(&rig), clock(), disk(&rig, args)];
    let ready = findings.iter().all(|f| f.ok);
    if args.json {
        print::json(&Checked {
            rig: &rig.name,
            ready,
            checks: &findings,
        })?;
    } else {
        for finding in &findings {
            outln!(
                "{:<7} {}: {}",
                if finding.ok { "ok" } else { "FIX" },
                finding.what,
                finding.words
            );
        }
    }
    if ready {
        Ok(Outcome::Done)
    } else {
        let broken: Vec<&str> = findings.iter().filter(|f| !f.ok).map(|f| f.what).collect();
        Err(CliError::Run(format!(
            "{} is not ready to record: fix {} as said above, then check again",
            rig.name,
            broken.join(", ")
        )))
    }
}

fn finding(what: &'static str, result: Result<String, String>) -> Finding {
    let ok = result.is_ok();
    let words = result.unwrap_or_else(|why| why);
    Finding { what, ok, words }
}

/// Opens the camera as a recording would, and waits for a good frame.
fn camera(rig: &Rig) -> Finding {
    let clock: Arc<dyn Clock> = Arc::new(SystemClock);
    let look = || {
        let mut source = rigging::open(rig, &clock, false)
            .map_err(|e| e.to_string())?
            .source;
        let description = source.describe();
        let start_ns = clock.monotonic_ns();
        let (mut good, mut faulty, mut last_event) = (0u32, 0u32, String::new());
        while clock.monotonic_ns() - start_ns < FRAME_WITHIN.as_nanos() as u64 && good < 10 {
            match source
                .next(Duration::from_millis(100))
                .map_err(|e| e.to_string())?
            {
                Captured::Frame(frame) if frame.meta.fault.is_none() => good += 1,
                Captured::Frame(_) => faulty += 1,
                Captured::Event(event) => last_event = event.message,
                Captured::Nothing => {}
                Captured::Finished => break,
            }
        }
        if good == 0 {
            let more = if last_event.is_empty() {
                String::new()
            } else {
                format!("; {last_event}")
            };
            return Err(format!(
                "opened, but no good frame within {} s ({faulty} faulty ones){more}",
                FRAME_WITHIN.as_secs()
            ));
        }
        let format = &description.format;
        Ok(format!(
            "{} {} {}x{} at {:.1} fps, {good} good frames",
            if description.node.is_empty() {
                &description.card
            } else {
                &description.node
            },
            format.fourcc,
            format.width_px,
            format.height_px,
            description.rate_fps
        ))
    };
    finding("camera", look())
}

/// Finds the port, opens it and asks who is there; no command that moves anything is sent.
fn line(rig: &Rig) -> Finding {
    let link = &rig.thrusters.link;
    if let Err(error) = check_set(&rig.thrusters) {
        return finding("thruster controller", Err(error.to_string()));
    }
    let look = || match &link.port {
        LinkPort::Sim => Ok("simulated controller on a pseudo-terminal".to_owned()),
        LinkPort::Udp(address) => {
            let named = format!("udp:{address} ({:?})", link.kind);
            let clock = Arc::new(SystemClock);
            let mut line = UdpTransport::open(*address, clock).map_err(|e| e.to_string())?;
            let answered = probe(&rig.thrusters, &mut line).map_err(|e| format!("{named}: {e}"))?;
            outputs(rig, &answered)
                .map(|words| format!("{named}: {words}"))
                .map_err(|words| format!("{named}: {words}"))
        }
        port => {
            let roots = Roots::default();
            let path = roots.resolve(port).map_err(|e| e.to_string())?;
            let known = roots.ports().into_iter().find(|p| {
                p.node == path || Some(&p.node) == std::fs::canonicalize(&path).ok().as_ref()
            });
            if let Some(problem) = known.and_then(|p| p.problem) {
                return Err(problem);
            }
            let named = format!("{} ({:?}, {} baud)", path.display(), link.kind, link.baud);
            let mut line = SerialTransport::open(&path, link.baud, Arc::new(SystemClock))
                .map_err(|e| e.to_string())?;
            let answered = probe(&rig.thrusters, &mut line).map_err(|e| format!("{named}: {e}"))?;
            outputs(rig, &answered)
                .map(|words| format!("{named}: {words}"))
                .map_err(|words| format!("{named}: {words}"))
        }
    };
    finding("thruster controller", look())
}

/// Pulses of a controller at rest, or what is wrong with them.
fn outputs(rig: &Rig, answered: &Answered) -> Result<String, String> {
    let set = &rig.thrusters;
    let mut words = Vec::new();
    for thruster in &set.thrusters {
        let Some(pulse) = answered
            .pulses
            .iter()
            .find(|p| p.channel == thruster.channel)
        else {
            return Err(format!(
                "it has no channel {} ({}): mend thrusters.*.channel in the rig",
                thruster.channel, thruster.name
            ));
        };
        let us = pulse.pulse_us();
        // 0 = it sends no pulses: the thruster stands still as well.
        if !set.link.follows() && pulse.quarter_us != 0 && (us - set.neutral_us).abs() > NEUTRAL_US
        {
            return Err(format!(
                "{} is at {us:.2} us and not at neutral ({} us): another program drives it, or the controller's own home position differs; stop it first",
                thruster.name, set.neutral_us
            ));
        }
        words.push(format!("{} {us:.0} us", thruster.name));
    }
    if !answered.errors.is_empty() {
        return Err(format!(
            "it reports {} while it is only asked: check the cable and the baud rate, then check again",
            answered.errors.join(", ")
        ));
    }
    let watchdog = match answered.watchdog_ms {
        Some(ms) => format!("its watchdog {ms} ms"),
        None => "its own serial timeout cannot be asked for: set it in the Maestro Control Center, or a lost line leaves the thrusters running".to_owned(),
    };
    Ok(format!("answers; {}; {watchdog}", words.join(", ")))
}

/// Whether the realtime clock is disciplined (adjtimex): stamps of two computers compare only then.
fn clock() -> Finding {
    // SAFETY: timex is plain data; modes = 0 only reads.
    let (state, timex) = unsafe {
        let mut timex: libc::timex = std::mem::zeroed();
        (libc::adjtimex(&mut timex), timex)
    };
    let bracket_us = SystemClock.triple().bracket_ns as f64 / 1e3;
    let words = if state < 0 || timex.status & libc::STA_UNSYNC != 0 {
        format!(
            "not synchronised to a time server (matters only against other computers; `timedatectl set-ntp true`); read bracket {bracket_us:.1} us"
        )
    } else {
        format!(
            "synchronised, estimated error {} us; read bracket {bracket_us:.1} us",
            timex.esterror
        )
    };
    // Stamps within one log need no time server: worth saying, no reason not to record.
    finding("clock", Ok(words))
}

fn disk(rig: &Rig, args: &Args) -> Finding {
    let bytes_per_s = bytes_per_s(&rig.camera);
    let look = || {
        writable_folder(&args.disk)?;
        let free = free_bytes(&args.disk).ok_or_else(|| {
            format!(
                "{}: cannot be asked for its free space; does the folder exist?",
                args.disk.display()
            )
        })?;
        let usable = free.saturating_sub(rig.log.min_free_bytes) as f64;
        let minutes = usable / bytes_per_s / 60.0;
        let words = format!(
            "{}: {:.1} GB free less {:.1} GB reserve, at {:.1} MB/s room for {minutes:.0} min",
            args.disk.display(),
            free as f64 / 1e9,
            rig.log.min_free_bytes as f64 / 1e9,
            bytes_per_s / 1e6
        );
        if minutes < 1.0 {
            Err(format!("{words}: free some space or name another --disk"))
        } else {
            Ok(words)
        }
    };
    finding("disk", look())
}
