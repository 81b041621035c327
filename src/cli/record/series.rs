//! A series at the tank: does what [`hydroline_daemon::series`] asks for, and prints what it says.

use super::until::Proposing;
use super::*;
use hydroline_daemon::series::{Action, End, Event, Made, Plans, Rules, Series, Starts};
use hydroline_rigs::RecordOn;
use hydroline_thruster::service::wait_for_recording;

/// Session that all runs share.
pub(super) struct Session<'a> {
    pub args: &'a Args,
    pub rig: &'a Rig,
    pub conditions: &'a Conditions,
    pub build: BuildInfo,
    pub shown: Option<&'a Shown>,
    pub tank: Option<&'a Rig>,
}

impl Session<'_> {
    /// Whether STOP was pressed on the live page: no run follows, as after Space.
    pub fn stopped(&self) -> bool {
        self.shown.is_some_and(Shown::stopped)
    }

    /// The live page's view of one run.
    fn live(&self, rig: &Rig, out: &Path, run: (u32, u32)) -> Option<hydroline_daemon::live::Live> {
        let file = out.file_name().unwrap_or_default().to_string_lossy();
        let mut parts = vec![rig.name.clone(), file.into_owned()];
        if run.1 > 1 {
            parts.push(format!("run {} of {}", run.0, run.1));
        }
        let parts: Vec<&str> = parts.iter().map(String::as_str).collect();
        Some(self.shown?.run(live::title(&parts), out))
    }
}

/// Runs that are made alike, each from where the one before left the vehicle.
pub(super) struct Alike<'a> {
    pub plan: Option<&'a Plan>,
    /// Length of each run; `None` = the plan's, or until stopped.
    pub length: Option<Duration>,
    /// Why the plan that was asked for is not run; `None` = it is.
    pub withheld: Option<String>,
    /// The rig of each run: its start is where the vehicle will be then.
    pub rigs: Vec<Rig>,
    pub outs: Vec<PathBuf>,
}

/// Runs alike, or each proposed by those before it.
pub(super) enum Work<'a> {
    Alike(Alike<'a>),
    Proposed(Box<Proposing<'a>>),
}

impl Work<'_> {
    /// Where a run goes, and the rig that it is made with.
    fn out<'b>(&'b self, run: u32, rig: &'b Rig) -> Result<(PathBuf, &'b Rig), CliError> {
        match self {
            Work::Alike(alike) => {
                let k = run as usize - 1;
                Ok((alike.outs[k].clone(), &alike.rigs[k]))
            }
            Work::Proposed(proposing) => {
                let out = proposing.log(run);
                inputs::new_file("--out", &out)?;
                Ok((out, rig))
            }
        }
    }
}

/// A series with everything that its runs need.
pub(super) struct AtTank<'a> {
    session: &'a Session<'a>,
    work: Work<'a>,
    calibrating: Calibrating,
    /// By which the way to the start is seen: that of the last run.
    map: Arc<dyn PlaneMap>,
    pub reports: Vec<Recorded>,
}

impl<'a> AtTank<'a> {
    pub fn new(
        session: &'a Session<'a>,
        work: Work<'a>,
        calibrating: Calibrating,
    ) -> Result<Self, CliError> {
        let map: Arc<dyn PlaneMap> = match &calibrating.calibration {
            Some(calibration) => {
                let calibration = calibration.clone();
                let fitted = checked(session.args, session.rig, session.conditions, calibration)?;
                Arc::from(fitted.0.to_map())
            }
            None => Arc::new(IdealMap::of(session.rig)),
        };
        Ok(Self {
            session,
            work,
            calibrating,
            map,
            reports: Vec::new(),
        })
    }

    fn rules(&self) -> Rules {
        let args = self.session.args;
        let rules = Rules {
            plans: Plans::Given,
            next: 1,
            last: args.runs,
            usable: 0,
            settle: args.settle,
            return_to_start: args.return_to_start,
        };
        match &self.work {
            Work::Alike(_) => rules,
            Work::Proposed(proposing) => Rules {
                plans: Plans::Proposed(match (args.dry_run, args.yes) {
                    (true, _) => Starts::Never,
                    (false, true) => Starts::Unasked,
                    (false, false) => Starts::Asked,
                }),
                next: proposing.next,
                last: proposing.last,
                usable: proposing.runs.len(),
                ..rules
            },
        }
    }

    /// Run after run.
    pub fn run(&mut self) -> Result<Outcome, CliError> {
        let (mut series, mut step) = Series::begin(self.rules());
        loop {
            if let Some(line) = &step.say {
                errln!("hydroline: {line}");
            }
            let event = match step.action {
                Action::Settle(pause) => Event::Ready(settle(pause, self.session)?),
                Action::Return { run } => Event::Ready(self.way_back(run)?),
                Action::Record { .. } if !awaited(self.session)? => Event::Ready(false),
                Action::Record { run, offer } => Event::Recorded(self.record(run, offer)?),
                Action::End(End::Failed(words)) => return Err(CliError::Run(words)),
                Action::End(End::Done { lossy }) => return Ok(Outcome::of(lossy)),
                Action::Propose { .. } | Action::Choose | Action::Examine { .. } => {
                    let Work::Proposed(proposing) = &mut self.work else {
                        return Ok(Outcome::Done);
                    };
                    match step.action {
                        Action::Propose { left, .. } => {
                            proposing.propose(self.session, left, &self.reports)?
                        }
                        Action::Choose => Event::Chosen(proposing.ask(self.session)?),
                        _ => proposing.examine(self.session)?,
                    }
                }
            };
            step = series.next(event);
        }
    }

    fn way_back(&self, run: u32) -> Result<bool, CliError> {
        let (out, _) = self.work.out(run, self.session.rig)?;
        let (rig, last) = match &self.work {
            // Shown from where the last run began.
            Work::Alike(alike) => (&alike.rigs[run as usize - 2], self.session.args.runs),
            Work::Proposed(proposing) => (self.session.rig, proposing.last),
        };
        bring_back::wait(&Way {
            rig,
            map: self.map.clone(),
            near: self.session.args.near,
            run: (run, last),
            live: self.session.live(rig, &out, (run, last)),
            stopped: &|| self.session.stopped(),
        })
    }

    fn record(&mut self, run: u32, offer: usize) -> Result<Made, CliError> {
        let Session {
            args, conditions, ..
        } = *self.session;
        let (out, rig) = self.work.out(run, self.session.rig)?;
        let (plan, run) = match &self.work {
            Work::Alike(alike) => (alike.plan, (run, args.runs)),
            Work::Proposed(proposing) => (proposing.plan(offer), (1, 1)),
        };
        let (length, withheld) = match &self.work {
            Work::Alike(alike) => (alike.length, alike.withheld.as_deref()),
            Work::Proposed(_) => (args.length, None),
        };
        let calibration = self.calibrating.calibration.clone();
        let recording = Recording {
            rig,
            plan,
            conditions,
            run,
            withheld,
            length,
            ready_within: args.ready_within,
            with_thrusters: !args.no_thrusters,
            calibration: calibration
                .map(|c| checked_aloud(args, rig, conditions, c))
                .transpose()?,
            calibrate: self.calibrating.calibrate.clone(),
            build: self.session.build,
            live: self.session.live(rig, &out, run),
            tank: self.session.tank,
            unattended: plan_once::PlanOnce::of_service().is_asked(),
        };
        let report = recording.record(&out)?;
        self.map = Arc::from(recording.in_force().0.to_map());
        if let Some(accepted) = report.calibration.as_ref().and_then(|c| c.accepted.clone()) {
            if let Some(file) = self.calibrating.out.take() {
                store(&file, &accepted)?;
            }
            Memory::of_user().keep_and_say(Some(rig), &accepted);
            // In force from the next run on; in this log the coordinates keep to one map.
            self.calibrating.calibrate = None;
            self.calibrating.calibration = Some(accepted);
        }
        if args.json {
            self.reports.push(json_report(&out, &report));
        } else {
            print_report(&out, &report);
        }
        let not_calibrated = self.calibrating.calibrate.is_some().then(|| {
            let missing = report.calibration.as_ref().map(|c| c.missing.as_str());
            format!(
                "no calibration was accepted: {}. The log is whole: `hydroline calibrate {} --board ...` makes the best of it",
                missing.unwrap_or("no frame was analysed"),
                out.display()
            )
        });
        for misplaced in &report.log.misplaced {
            errln!("hydroline: {misplaced}");
        }
        Ok(Made {
            stop: report.stop.clone(),
            lost: report.lost_anything(),
            few_poses: few_poses(&report),
            misplaced: !report.log.misplaced.is_empty(),
            not_calibrated,
            neutral_open: report.neutral_open(),
        })
    }
}

/// Waits until the autopilot's side begins a recording, where the rig says so; whether it is to be made.
fn awaited(session: &Session<'_>) -> Result<bool, CliError> {
    let set = &session.rig.thrusters;
    if session.args.no_thrusters
        || !set.link.follows()
        || set.link.autopilot().record_on == RecordOn::Start
    {
        return Ok(true);
    }
    let signals = hydroline_daemon::signals::listen().map_err(CliError::run)?;
    let keys = Keys::watch(None);
    let clock: Arc<dyn Clock> = Arc::new(SystemClock);
    let mut opener = rigging::opener(session.rig, &clock, None)?;
    errln!(
        "hydroline: waits for the autopilot's side to begin the recording (thrusters.link.mavlink.record_on); Ctrl-C ends"
    );
    let stops = || signals.heard().is_some() || stopped(keys.as_ref()) || session.stopped();
    let begins = wait_for_recording(set, &mut opener, &stops, &mut |why| {
        errln!("hydroline: {why}")
    });
    Ok(begins && !keys.is_some_and(Keys::finish))
}

/// Frames without a pose, in words, where they are most.
fn few_poses(report: &Report) -> Option<String> {
    // While it searches for a board, the board stands where the target would.
    let searched = report.calibration.is_some();
    let poses = report.poses.as_ref().filter(|p| !searched && p.few())?;
    let most = poses.none.iter().max_by_key(|(_, n)| **n);
    let why = most.filter(|(_, n)| **n >= poses.flagged);
    Some(format!(
        "only {} of {} frames looked at have a pose; most often: {}",
        poses.fitted + poses.opening,
        poses.looked_at(),
        why.map_or("a pose that is not to be relied on", |(reason, _)| reason)
    ))
}
