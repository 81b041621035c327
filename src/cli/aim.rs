//! `hydroline aim`: focus, exposure and laser at a glance, twice a second.

use super::output::Output;
use super::print::{errln, in_place, is_read, outln};
use super::{CliError, Outcome, inputs, rigging};
use hydroline_capture::{Captured, FrameSource};
use hydroline_core::clock::{Clock, SystemClock};
use hydroline_core::frame::Frame;
use hydroline_daemon::analysis::Analyst;
use hydroline_daemon::record::glance::Gatherer;
use hydroline_log::{bytes_per_s, free_bytes, writable_folder};
use hydroline_rigs::Rig;
use hydroline_stripe::{Extractor, ExtractorConfig, annotate};
use std::io::IsTerminal;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Duration;

/// Between two lines.
const WINDOW: Duration = Duration::from_millis(500);

#[derive(Debug, clap::Args)]
#[command(after_help = "\
Prints every half second what the camera sees: frames per second, stripe, peak level, floor, and what to change.

Examples:
  hydroline aim --rig my.toml                    # until Ctrl-C
  hydroline aim --rig lshpi --for 5s --png aim.png

Exit codes: 0 done; 1 the camera fails or no frame came; 2 bad arguments or rig.")]
pub struct Args {
    /// Rig file or built-in name
    #[arg(long, value_name = "RIG")]
    rig: String,
    /// Ends after this time; default: until Ctrl-C
    #[arg(long = "for", value_parser = inputs::some_duration, allow_hyphen_values = true, value_name = "TIME")]
    length: Option<Duration>,
    /// Writes the last frame with its stripe drawn in (green; yellow near steps, red saturated, blue other candidates) here, at the end
    #[arg(long, value_name = "PNG")]
    png: Option<PathBuf>,
    /// One JSON object per half second
    #[arg(long)]
    json: bool,
    /// Folder whose disk is to be recorded to
    #[arg(long, value_name = "DIR", default_value = ".")]
    disk: PathBuf,
    #[command(flatten)]
    output: Output,
}

pub fn run(args: &Args) -> Result<Outcome, CliError> {
    let rig = inputs::rig(&args.rig)?;
    if let Some(png) = &args.png {
        args.output.file("--png", png)?;
    }
    writable_folder(&args.disk).map_err(|words| CliError::Config(format!("--disk {words}")))?;
    let clock: Arc<dyn Clock> = Arc::new(SystemClock);
    let mut rigged = rigging::open(&rig, &clock, false)?;
    let stop = hydroline_daemon::signals::listen().map_err(CliError::run)?;
    let last = watch(args, &rig, rigged.source.as_mut(), clock.as_ref(), stop)?;
    match (&args.png, last) {
        (Some(path), Some(frame)) => save(args.output, path, &frame, &rig)?,
        (Some(path), None) => {
            return Err(CliError::Run(format!(
                "no frame came: {} was not written; `hydroline check --rig {}`",
                path.display(),
                args.rig
            )));
        }
        (None, _) => {}
    }
    Ok(Outcome::Done)
}

fn watch(
    args: &Args,
    rig: &Rig,
    source: &mut dyn FrameSource,
    clock: &dyn Clock,
    stop: &hydroline_daemon::signals::Signals,
) -> Result<Option<Frame>, CliError> {
    let mut analyst = Analyst::new(ExtractorConfig::default(), None, rig.grey_rule());
    let mut gatherer = Gatherer::new(rig.camera.rate_fps);
    let (start_ns, mut window_ns) = (clock.monotonic_ns(), clock.monotonic_ns());
    let mut newest: Option<Frame> = None;
    loop {
        match source.next(Duration::from_millis(50))? {
            Captured::Frame(frame) => {
                gatherer.frame(&frame.meta);
                newest = Some(frame);
            }
            Captured::Event(event) => {
                gatherer.event(&event);
                errln!("hydroline: {}", event.message);
            }
            Captured::Nothing => {}
            Captured::Finished => return Ok(newest),
        }
        let now_ns = clock.monotonic_ns();
        if now_ns - window_ns >= WINDOW.as_nanos() as u64 {
            if let Some(frame) = newest.as_ref().filter(|f| f.meta.fault.is_none()) {
                gatherer.profile(analyst.analyse(frame));
            }
            if !show(args, rig, &mut gatherer, (now_ns - window_ns) as f64 / 1e9) {
                return Ok(newest);
            }
            window_ns = now_ns;
        }
        let over = args
            .length
            .is_some_and(|l| now_ns - start_ns >= l.as_nanos() as u64);
        if over || stop.heard().is_some() {
            if std::io::stdout().is_terminal() && !args.json {
                outln!();
            }
            return Ok(newest);
        }
    }
}

/// False when nobody reads it any more.
fn show(args: &Args, rig: &Rig, gatherer: &mut Gatherer, window_s: f64) -> bool {
    let bytes_per_min = bytes_per_s(&rig.camera) * 60.0;
    let disk_min = free_bytes(&args.disk)
        .map(|free| free.saturating_sub(rig.log.min_free_bytes) as f64 / bytes_per_min);
    let glance = gatherer.glance(window_s, disk_min);
    if args.json {
        outln!("{}", serde_json::json!(glance));
    } else {
        let advice = glance.advice().join("; ");
        let between = if advice.is_empty() { "" } else { " | " };
        in_place(format_args!("{glance}{between}{advice}"));
    }
    is_read()
}

fn save(output: Output, path: &Path, frame: &Frame, rig: &Rig) -> Result<(), CliError> {
    let image = frame.to_grey(&rig.grey_rule())?;
    let profile = Extractor::new(ExtractorConfig::default()).extract(&image);
    output.image(path, annotate(&image, &profile))?;
    outln!("{}", path.display());
    Ok(())
}
