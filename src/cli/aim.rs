//! `hydroline aim`: focus, exposure and laser at a glance, twice a second, and by picture on the live page.

use super::live::{self, LiveArgs};
use super::output::Output;
use super::print::{self, errln, in_place, is_read, is_terminal, outln};
use super::{CliError, Outcome, inputs, rigging};
use hydroline_calib::Pose;
use hydroline_calib::analytic::IdealMap;
use hydroline_calib::plane::PlaneMap;
use hydroline_capture::{Captured, FrameSource};
use hydroline_core::clock::{Clock, SystemClock};
use hydroline_core::event::Event;
use hydroline_core::frame::{Frame, GreyRule};
use hydroline_core::thread_class::step_back;
use hydroline_daemon::analysis::Analyst;
use hydroline_daemon::live::outline::{Outline, Scene};
use hydroline_daemon::live::{Live, picture};
use hydroline_daemon::record::aim::{AimView, Gatherer};
use hydroline_daemon::record::floor::points;
use hydroline_daemon::record::mailbox::{Mailbox, Taken};
use hydroline_live::State;
use hydroline_live::state;
use hydroline_log::messages::pb::StripeProfile;
use hydroline_log::{bytes_per_s, free_bytes, writable_folder};
use hydroline_rigs::Rig;
use hydroline_stripe::{Extractor, ExtractorConfig, annotate};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Duration;

/// Between two lines.
const WINDOW: Duration = Duration::from_millis(500);

#[derive(Debug, clap::Args)]
#[command(after_help = "\
Says every half second whether focus, exposure and laser are right: on a terminal in one line that refreshes, in a pipe \
one line each with what to change. --live shows the picture with the stripe, and where the target should be.

Examples:
  hydroline aim --rig my.toml                    # until Ctrl-C
  hydroline aim --rig my.toml --live             # the picture at http://127.0.0.1:8080
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
    live: LiveArgs,
    #[command(flatten)]
    output: Output,
}

pub fn run(args: &Args) -> Result<Outcome, CliError> {
    let rig = inputs::rig(&args.rig)?;
    if let Some(png) = &args.png {
        args.output.file("--png", png)?;
    }
    writable_folder(&args.disk).map_err(|words| CliError::Config(format!("--disk {words}")))?;
    args.live.check()?;
    let shown = args.live.start(false)?;
    let title = live::title(&["aim", &rig.name]);
    let mut screen = Screen::new(&rig, shown.as_ref().map(|s| s.run(title, &args.disk)));
    let clock: Arc<dyn Clock> = Arc::new(SystemClock);
    let mut rigged = rigging::open(&rig, &clock, false)?;
    let stop = hydroline_daemon::signals::listen().map_err(CliError::run)?;
    let last = watch(
        args,
        &rig,
        rigged.source.as_mut(),
        clock.as_ref(),
        stop,
        &mut screen,
    );
    screen.end();
    let last = last?;
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
    screen: &mut Screen,
) -> Result<Option<Frame>, CliError> {
    let mut gatherer = Gatherer::new(rig.camera.rate_fps);
    let (start_ns, mut window_ns) = (clock.monotonic_ns(), clock.monotonic_ns());
    let mut newest: Option<Frame> = None;
    loop {
        match source.next(Duration::from_millis(50))? {
            Captured::Frame(frame) => {
                gatherer.frame(&frame.meta);
                screen.frame(&frame);
                newest = Some(frame);
            }
            Captured::Event(event) => {
                gatherer.event(&event);
                screen.event(&event);
                errln!("hydroline: {}", event.message);
            }
            Captured::Nothing => {}
            Captured::Finished => return Ok(newest),
        }
        let now_ns = clock.monotonic_ns();
        if now_ns - window_ns >= WINDOW.as_nanos() as u64 {
            if let Some(frame) = newest.as_ref().filter(|f| f.meta.fault.is_none()) {
                let (profile, on_target) = screen.analyse(frame);
                gatherer.profile(profile);
                gatherer.on_target(on_target);
            }
            if !show(
                args,
                rig,
                screen,
                &mut gatherer,
                (now_ns - window_ns) as f64 / 1e9,
            )? {
                return Ok(newest);
            }
            window_ns = now_ns;
        }
        let over = args
            .length
            .is_some_and(|l| now_ns - start_ns >= l.as_nanos() as u64);
        if over || stop.heard().is_some() {
            if is_terminal() && !args.json {
                outln!();
            }
            return Ok(newest);
        }
    }
}

/// False when nobody reads it any more.
fn show(
    args: &Args,
    rig: &Rig,
    screen: &mut Screen,
    gatherer: &mut Gatherer,
    window_s: f64,
) -> Result<bool, CliError> {
    let bytes_per_min = bytes_per_s(&rig.camera) * 60.0;
    let disk_min = free_bytes(&args.disk)
        .map(|free| free.saturating_sub(rig.log.min_free_bytes) as f64 / bytes_per_min);
    let view = gatherer.view(window_s, disk_min);
    screen.view(&view);
    if args.json {
        print::json(&view)?;
    } else if is_terminal() {
        in_place(format_args!("{}", view.line()));
    } else {
        let advice = view.advice().join("; ");
        let between = if advice.is_empty() { "" } else { " | " };
        in_place(format_args!("{view}{between}{advice}"));
    }
    Ok(is_read())
}

/// Analysis of the frames, and the live page that shows it: pictures as fast as they are looked at, words with each window.
struct Screen {
    analyst: Analyst,
    scene: Scene,
    start: Pose,
    live: Option<Live>,
    state: State,
    /// Frames on their way to the page; closed at the end.
    newest: Arc<Mailbox<Frame>>,
}

/// Between two pictures.
const PICTURE: Duration = Duration::from_millis(100);

impl Screen {
    fn new(rig: &Rig, live: Option<Live>) -> Self {
        let map: Arc<dyn PlaneMap> = Arc::new(IdealMap::of(rig));
        let analyst = || {
            Analyst::new(
                ExtractorConfig::default(),
                Some(map.clone()),
                rig.grey_rule(),
            )
            .learning()
        };
        let scene = Scene::new(rig, map.clone());
        let start = Pose::from_array(rig.tank.start_pose);
        let newest = Arc::new(Mailbox::default());
        if let Some(live) = &live {
            let expected = scene.outline(&start);
            let pictures = Pictures {
                analyst: analyst(),
                rule: rig.grey_rule(),
                expected,
                live: live.clone(),
            };
            pictures.start(newest.clone());
        }
        let state = State {
            mode: "aim",
            title: live.as_ref().map_or_else(String::new, |l| l.title.clone()),
            phase: "aiming: the blue line is where it should be".to_owned(),
            ..State::default()
        };
        Self {
            analyst: analyst(),
            scene,
            start,
            live,
            state,
            newest,
        }
    }

    /// A frame's stripe, and how much of it lies on the target.
    fn analyse(&mut self, frame: &Frame) -> (StripeProfile, Option<(f64, f64)>) {
        let profile = self.analyst.analyse(frame);
        let on_target = self.scene.on_target(&self.start, &points(&profile));
        (profile, on_target)
    }

    /// Leaves a frame for the page, if somebody looks.
    fn frame(&mut self, frame: &Frame) {
        self.state.frames.received += 1;
        if self.live.as_ref().is_some_and(|l| l.feed.is_watched()) {
            self.newest.put(frame.clone());
        }
    }

    fn event(&mut self, event: &Event) {
        state::keep(&mut self.state.events, event.into());
    }

    fn view(&mut self, view: &AimView) {
        self.state.aim = view.checks();
        self.state.frames.lost = view.lost;
        self.state.frames.rate_fps = view.steady_fps.or(Some(view.rate_fps));
        self.state.frames.points = view.columns.0 as u64;
        self.state.disk = Some(state::Disk {
            bytes: 0,
            left_min: view.disk_min,
        });
        if let Some(live) = &self.live {
            live.feed.publish(self.state.clone());
        }
    }

    fn end(&mut self) {
        self.newest.close();
        self.state.ended = true;
        self.state.phase = "aiming is over".to_owned();
        if let Some(live) = &self.live {
            live.feed.publish(self.state.clone());
        }
    }
}

/// Makes the page's pictures on a thread of its own: the camera's loop goes on meanwhile.
struct Pictures {
    analyst: Analyst,
    rule: GreyRule,
    expected: Outline,
    live: Live,
}

impl Pictures {
    fn start(mut self, frames: Arc<Mailbox<Frame>>) {
        let work = move || {
            step_back(10);
            loop {
                match frames.take(Duration::from_secs(1)) {
                    Taken::Item(frame) => {
                        let profile = self.analyst.analyse(&frame);
                        let expected = Some(self.expected.clone());
                        let shown = picture(&frame, &profile, self.rule, expected);
                        self.live.feed.show(shown);
                        std::thread::sleep(PICTURE);
                    }
                    Taken::Nothing => {}
                    Taken::Closed => return,
                }
            }
        };
        let spawned = std::thread::Builder::new()
            .name("pictures".to_owned())
            .spawn(work);
        if let Err(error) = spawned {
            errln!("hydroline: no pictures on the live page: {error}");
        }
    }
}

fn save(output: Output, path: &Path, frame: &Frame, rig: &Rig) -> Result<(), CliError> {
    let image = frame.to_grey(&rig.grey_rule())?;
    let profile = Extractor::new(ExtractorConfig::default()).extract(&image);
    output.image(path, annotate(&image, &profile))?;
    outln!("{}", path.display());
    Ok(())
}
