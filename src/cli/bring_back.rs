//! `record --return-to-start` between two runs: shows the way back, and asks.

mod asked;
mod page;

use super::print::errln;
use super::{CliError, progress, rigging};
use asked::Asked;
use hydroline_calib::plane::PlaneMap;
use hydroline_capture::{Captured, FrameSource};
use hydroline_core::clock::{Clock, SystemClock};
use hydroline_daemon::bring_back::finder::Finder;
use hydroline_daemon::bring_back::question::{Question, Reply};
use hydroline_daemon::bring_back::{Guide, HEADING_DEG, POSITION_M, Stage, StartTolerance};
use hydroline_daemon::live::Live;
use hydroline_daemon::signals;
use hydroline_rigs::Rig;
use indicatif::ProgressBar;
use page::Page;
use std::mem::Discriminant;
use std::sync::Arc;
use std::time::{Duration, Instant};

/// Between two looks at the keys while no frame comes.
const LOOK: Duration = Duration::from_millis(20);
/// Between two poses: often enough for a hand, and the processor keeps up.
const PERIOD: Duration = Duration::from_millis(100);

/// Tolerance within which the vehicle is back at the start.
#[derive(Debug, Clone, Copy, clap::Args)]
pub struct NearArgs {
    /// With --return-to-start: so near the start counts as there, up to 1 [m]
    #[arg(long, value_parser = metres, allow_negative_numbers = true, default_value_t = POSITION_M, value_name = "M")]
    start_within_m: f64,
    /// With --return-to-start: and turned by no more than this, up to 45 [deg]
    #[arg(long, value_parser = degrees, allow_negative_numbers = true, default_value_t = HEADING_DEG, value_name = "DEG")]
    start_within_deg: f64,
}

fn within(text: &str, most: f64, unit: &str) -> Result<f64, String> {
    let value = text.parse().ok().filter(|v: &f64| *v > 0.0 && *v <= most);
    value.ok_or_else(|| format!("'{text}' is not above 0 and up to {most} {unit}"))
}

fn metres(text: &str) -> Result<f64, String> {
    within(text, 1.0, "m")
}

fn degrees(text: &str) -> Result<f64, String> {
    within(text, 45.0, "deg")
}

impl NearArgs {
    fn tolerance(self) -> StartTolerance {
        StartTolerance {
            position_m: self.start_within_m,
            heading_rad: self.start_within_deg.to_radians(),
        }
    }
}

/// The way to the start of the next run.
pub struct Way<'a> {
    /// Its start is where the vehicle is brought.
    pub rig: &'a Rig,
    /// From image to laser plane.
    pub map: Arc<dyn PlaneMap>,
    /// When it is there.
    pub near: NearArgs,
    /// The run that begins then, of so many.
    pub run: (u32, u32),
    /// The live page.
    pub live: Option<Live>,
    /// Whether STOP was pressed there.
    pub stopped: &'a dyn Fn() -> bool,
}

/// Shows the way until someone at the tank says that the vehicle is back at the start; false when that will not be.
/// No thruster line is open meanwhile.
pub fn wait(way: &Way<'_>) -> Result<bool, CliError> {
    let signals = signals::listen().map_err(CliError::run)?;
    let [x, y, z, _, _, psi] = way.rig.tank.start_pose;
    errln!(
        "hydroline: bring the vehicle back to x {x:.3} m, y {y:.3} m, z {z:.3} m, heading {:.1} deg; Enter starts run {} of {}, Space, q or Ctrl-C ends",
        psi.to_degrees(),
        way.run.0,
        way.run.1
    );
    let mut eyes = match Eyes::open(way) {
        Ok(eyes) => Some(eyes),
        Err(error) => {
            errln!("hydroline: the way back is not shown, the camera does not open: {error}");
            None
        }
    };
    let asked = Asked::begin();
    let began = Instant::now();
    let mut question = Question::default();
    loop {
        if signals.heard().is_some() || (way.stopped)() {
            return Ok(false);
        }
        let back = eyes.as_mut().is_none_or(Eyes::is_back);
        let reply = asked
            .answer()
            .map(|answer| question.reply(began.elapsed(), answer, back || !asked.asks_again()));
        match reply {
            Some(Reply::End) => return Ok(false),
            Some(Reply::Start) => {
                drop(eyes);
                return Ok(!asked.ended());
            }
            Some(Reply::NotThere) => {
                if let Some(eyes) = &mut eyes {
                    eyes.not_there();
                }
            }
            None => {}
        }
        match &mut eyes {
            Some(open) => {
                if let Err(error) = open.look() {
                    errln!("hydroline: the way back is not shown any more: {error}");
                    eyes = None;
                }
            }
            None => std::thread::sleep(LOOK),
        }
    }
}

/// The camera between the runs, and what shows its poses.
struct Eyes {
    source: Box<dyn FrameSource>,
    clock: Arc<dyn Clock>,
    finder: Finder,
    guide: Guide,
    line: ProgressBar,
    looked: Option<Instant>,
    /// The stage of which a line was printed last, where none refreshes.
    said: Option<Discriminant<Stage>>,
    page: Option<Page>,
}

impl Eyes {
    fn open(way: &Way<'_>) -> Result<Self, CliError> {
        let clock: Arc<dyn Clock> = Arc::new(SystemClock);
        // Without thrusters: they stay at the neutral that the last run ended in.
        let source = rigging::open(way.rig, &clock, false)?.source;
        let finder = Finder::new(way.rig, way.map.clone());
        if let Some(repeats_m) = finder.repeats_m() {
            errln!(
                "hydroline: the target looks the same every {repeats_m:.3} m: bring it within {:.2} m by eye, the line shows the rest",
                0.5 * repeats_m
            );
        }
        Ok(Self {
            source,
            clock,
            finder,
            guide: Guide::new(way.rig.tank.start_pose, way.near.tolerance()),
            line: progress::line(),
            looked: None,
            said: None,
            page: way.live.clone().map(|live| Page::new(way, live)),
        })
    }

    fn is_back(&mut self) -> bool {
        matches!(self.guide.stage(self.clock.monotonic_ns()), Stage::Back(_))
    }

    fn not_there(&mut self) {
        let line = self.guide.line(self.clock.monotonic_ns());
        let words = format!("hydroline: not at the start: {line}; Enter again starts nevertheless");
        self.line.suspend(|| errln!("{words}"));
    }

    /// Takes the newest frame, if there is one, and shows the way that it gives.
    fn look(&mut self) -> Result<(), CliError> {
        let mut newest = None;
        let mut wait = LOOK;
        // Frames that piled up while the last one was fitted are passed over.
        loop {
            match self.source.next(wait)? {
                Captured::Frame(frame) => newest = Some(frame),
                Captured::Event(event) => tracing::info!("{}", event.message),
                Captured::Nothing => break,
                Captured::Finished => {
                    return Err(CliError::Run("the camera ended".to_owned()));
                }
            }
            wait = Duration::ZERO;
        }
        let due = self.looked.is_none_or(|at| at.elapsed() >= PERIOD);
        if let Some(frame) = newest.filter(|frame| due && frame.meta.fault.is_none()) {
            self.looked = Some(Instant::now());
            let look = self.finder.look(&frame);
            let now_ns = self.clock.monotonic_ns();
            self.guide.look(now_ns, look.seen);
            let line = self.guide.line(now_ns);
            if let Some(page) = &mut self.page {
                page.show(&frame, &look, &line);
            }
            self.say(now_ns, &line);
        }
        Ok(())
    }

    /// On a terminal the line refreshes; anywhere else a line is said when the matter has changed.
    fn say(&mut self, now_ns: u64, line: &str) {
        self.line.set_message(line.to_owned());
        let stage = std::mem::discriminant(&self.guide.stage(now_ns));
        if self.line.is_hidden() && self.said != Some(stage) {
            self.said = Some(stage);
            errln!("hydroline: {line}");
        }
    }
}

impl Drop for Eyes {
    fn drop(&mut self) {
        self.line.finish_and_clear();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_tolerance_is_above_nothing_and_no_arms_length() {
        assert_eq!(metres("0.05").unwrap(), 0.05);
        assert_eq!(degrees("3").unwrap(), 3.0);
        for bad in ["0", "-1", "nan", "wide", "1.1"] {
            assert!(metres(bad).unwrap_err().contains("up to 1 m"), "{bad}");
        }
        assert!(degrees("46").unwrap_err().contains("up to 45 deg"));
    }
}
