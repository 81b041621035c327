//! `hydroline view`: finished logs on a page in the browser, offline.

use super::print::{errln, outln};
use super::{CliError, Outcome, live, logs};
use hydroline_calib::{Calibration, IdealMap, PlaneMap};
use hydroline_core::frame::GreyRule;
use hydroline_daemon::analysis::Analyst;
use hydroline_daemon::live::prediction::Prediction;
use hydroline_daemon::replay::at_start;
use hydroline_daemon::signals;
use hydroline_diagnose::Part;
use hydroline_live::address::{VIEW_FLAGS, check_address_of};
use hydroline_live::server::Server;
use hydroline_log::IndexedLog;
use hydroline_rigs::Rig;
use hydroline_stripe::ExtractorConfig;
use hydroline_view::{Finder, Found, LogSite, Model, NamedLog, Viewed};
use std::net::SocketAddr;
use std::process::{Command, Stdio};
use std::sync::{Arc, Mutex};
use std::time::Duration;

/// Logs that are shown over each other: with more no line is distinguished any more.
const LOGS_MAX: usize = 4;
/// Between two looks at whether a signal came.
const LOOK_EVERY: Duration = Duration::from_millis(50);

#[derive(Debug, clap::Args)]
#[command(after_help = "\
Prints the page's address and serves it until Ctrl-C; it changes nothing. Two to four logs lie over each other by the time \
since their plans' starts. An MCAP log of another program is shown as far as its messages are read.

Examples:
  hydroline view run.mcap --open
  hydroline view run.mcap sim.mcap                     # a recording and its simulation
  hydroline view run.mcap@34..64                       # with a range chosen
  hydroline view run.mcap --listen 0.0.0.0:8080 --live-token the-tank-of-building-7

Exit codes: 0 ended by Ctrl-C; 1 a log is damaged and has no index; 2 bad arguments, or no log.")]
pub struct Args {
    /// Logs, one to four; LOG@FROM..TO chooses a range [s] to begin with
    #[arg(required = true, value_name = "LOG[@FROM..TO]")]
    logs: Vec<Part>,
    /// Address of the page; port 0 is any free one
    #[arg(long, value_parser = live::address, default_value = "127.0.0.1:0", value_name = "ADDR")]
    listen: SocketAddr,
    /// Opens the page to other computers; without it --listen stays on this one (also HYDROLINE_LIVE_TOKEN)
    #[arg(long, value_name = "WORD")]
    live_token: Option<String>,
    /// Opens the page in the browser
    #[arg(long)]
    open: bool,
}

pub fn run(args: &Args) -> Result<Outcome, CliError> {
    let token = live::token(args.live_token.as_deref())?;
    check_address_of(VIEW_FLAGS, args.listen, token.is_some())?;
    let parts = logs::opened(&args.logs)?;
    if parts.len() > LOGS_MAX {
        return Err(CliError::Config(format!(
            "{} logs: at most {LOGS_MAX} are shown over each other; name fewer",
            parts.len()
        )));
    }
    let signals = signals::listen().map_err(CliError::run)?;
    let mut named = Vec::new();
    for part in &parts {
        let log = opened(part)?;
        for words in log.viewed.notes() {
            errln!("hydroline: {words}");
        }
        if log.viewed.fields().is_empty() {
            errln!(
                "hydroline: {}: no number in it that could be plotted{}",
                log.path,
                if log.viewed.images().is_empty() {
                    ", and no image"
                } else {
                    ""
                }
            );
        }
        named.push(log);
    }
    let server = Server::showing(args.listen, token, Arc::new(LogSite::new(named)))?;
    let url = server.url();
    outln!("{url}");
    errln!("hydroline: the page is there until Ctrl-C");
    if args.open {
        open(&url);
    }
    while signals.heard().is_none() {
        std::thread::sleep(LOOK_EVERY);
    }
    Ok(Outcome::Done)
}

/// A log by its index, with what finds stripes in its frames.
fn opened(part: &Part) -> Result<NamedLog, CliError> {
    let viewed = Viewed::open(&part.path)?;
    let (finder, about) = known(viewed.log());
    if let Some(model) = model(viewed.log()) {
        viewed.follow(Box::new(model));
    }
    Ok(NamedLog {
        path: part.path.display().to_string(),
        window_s: part.window_s,
        about,
        viewed,
        finder: Mutex::new(finder),
    })
}

/// Stripes as the log's own rig and calibration have them, and words on rig and plan.
fn known(log: &IndexedLog) -> (Finder, String) {
    let toml = |name: &str| log.metadata().get(name).and_then(|m| m.get("toml"));
    let rig = toml("rig").and_then(|text| Rig::from_toml(text, "the log's rig", None).ok());
    let own =
        toml("calibration").and_then(|text| Calibration::from_toml(text, "its calibration").ok());
    let ideal = || -> Option<Arc<dyn PlaneMap>> { Some(Arc::new(IdealMap::of(rig.as_ref()?))) };
    let map = match own {
        Some(calibration) => Some(Arc::from(calibration.to_map())),
        None => ideal(),
    };
    let rule = rig.as_ref().map_or_else(GreyRule::default, Rig::grey_rule);
    let mut analyst = Analyst::new(ExtractorConfig::default(), map, rule);
    let finder: Finder = Box::new(move |frame| {
        let (profile, extracted) = analyst.analyse_whole(frame);
        let grey = extracted.ok().map(|(grey, _)| grey);
        Found { profile, grey }
    });
    let session = log.metadata().get("session");
    let plan = session.and_then(|s| s.get("plan.name"));
    let plan = plan.map(|name| format!("plan {name}"));
    let rig = rig.map(|rig| format!("rig {}", rig.name));
    let words: Vec<String> = rig.into_iter().chain(plan).collect();
    (finder, words.join(", "))
}

/// The rig's model, as the live page shows it beside a run.
struct RigModel {
    prediction: Prediction,
    thrusters: Vec<String>,
}

impl Model for RigModel {
    fn command(&mut self, thruster: &str, thrust_n: f64, at_ns: u64) {
        let place = self.thrusters.iter().position(|name| name == thruster);
        if let Some(place) = place {
            self.prediction.command(place, thrust_n, at_ns);
        }
    }

    fn pose(&mut self, at_ns: u64) -> Option<[f64; 6]> {
        Some(self.prediction.advance(at_ns)?.state.eta)
    }
}

/// The model of the log's rig, from where its run began; `None` = it carries no rig.
fn model(log: &IndexedLog) -> Option<RigModel> {
    let text = log.metadata().get("rig")?.get("toml")?;
    let rig = Rig::from_toml(text, "the log's rig", None).ok()?;
    let rig = match log.metadata().get("session") {
        Some(session) => at_start(&rig, session),
        None => rig,
    };
    let names = rig.thrusters.thrusters.iter().map(|t| t.name.clone());
    Some(RigModel {
        prediction: Prediction::new(&rig),
        thrusters: names.collect(),
    })
}

/// Opens the page in the browser of whoever sits here; says so where there is none.
fn open(url: &str) {
    let quiet = |program: &str| {
        let mut command = Command::new(program);
        command.arg(url);
        command
            .stdin(Stdio::null())
            .stdout(Stdio::null())
            .stderr(Stdio::null());
        command.spawn()
    };
    if let Err(error) = quiet("xdg-open") {
        errln!("hydroline: --open: no browser is found here (xdg-open: {error}); open {url}");
    }
}
