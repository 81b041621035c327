//! `record --next` and `--until-decided`: each run replayed and diagnosed on the spot, and the plan proposed that
//! says most beside those that are there.
//!
//! The state of a session is its logs: LOG-1.mcap, LOG-2.mcap, ... with LOG-1-poses.mcap, ... beside them. One that was cut
//! off goes on from what is there.

use super::super::limit::until_signal;
use super::super::{diagnose, plan, replay};
use super::*;
use hydroline_daemon::series::Event;
use hydroline_diagnose::body::next::Offer;
use hydroline_diagnose::profiles::observe::has_images;
use hydroline_diagnose::until::{Options, Proposal, Series, Step};
use hydroline_diagnose::verdict::Verdict;
use hydroline_diagnose::{Diagnosis, Limit, Source, Watch, read};
use hydroline_identify::data::check_vehicle;

/// A series of two and more has numbers in its names.
const NUMBERED: u32 = 2;

/// A recorded run of the series.
pub(in crate::record) struct Run {
    log: PathBuf,
    /// Its poses.
    source: Source,
}

/// Where a run's poses go.
fn poses_path(log: &Path) -> PathBuf {
    let stem = log.file_stem().unwrap_or_default().to_string_lossy();
    log.with_file_name(format!("{stem}-poses.mcap"))
}

/// Poses of every frame of a log: those that are there, else by a replay.
fn poses(log: &Path, rig: &Rig, build: BuildInfo) -> Result<Source, CliError> {
    let out = poses_path(log);
    if !out.exists() {
        replay::one(log, &out, build)?;
    }
    for words in check_vehicle(&out, rig)? {
        errln!("hydroline: {words}");
    }
    let source = read(&out, rig)?;
    Ok(match has_images(log)? {
        true => source.with_frames_of(log),
        false => source,
    })
}

/// Plans proposed by what the runs so far say.
pub(in crate::record) struct Proposing<'a> {
    series: Series<'a>,
    out: &'a Path,
    /// Usable runs of the series.
    pub runs: Vec<Run>,
    /// Number of the next run.
    pub next: u32,
    /// Number of the last run that may be made.
    pub last: u32,
    /// Plans for the next run, the best first.
    offers: Vec<Offer>,
}

impl<'a> Proposing<'a> {
    /// The series as far as it is there.
    pub fn begin(
        session: &Session<'a>,
        calibration: Option<Calibration>,
    ) -> Result<Self, CliError> {
        let args = session.args;
        let Some(out) = &args.out else {
            return Err(CliError::Config(
                "--out is missing: it names the series, LOG-1.mcap, LOG-2.mcap, ...".to_owned(),
            ));
        };
        let options = Options {
            dofs: args.dof.clone(),
            calibration,
            ..Options::default()
        };
        let mut proposing = Proposing {
            series: Series::new(session.rig, options),
            out,
            runs: Vec::new(),
            next: 1,
            last: args.max_runs,
            offers: Vec::new(),
        };
        loop {
            let log = proposing.log(proposing.next);
            if !log.exists() {
                break;
            }
            match poses(&log, session.rig, session.build) {
                Ok(source) => proposing.runs.push(Run { log, source }),
                Err(error) => errln!(
                    "hydroline: {}: {error}; the series goes on without it",
                    log.display()
                ),
            }
            proposing.next += 1;
        }
        if args.next {
            proposing.last = proposing.next;
        }
        Ok(proposing)
    }

    /// Where a run goes.
    pub fn log(&self, run: u32) -> PathBuf {
        run_path(self.out, run, NUMBERED)
    }

    /// The plan of an offer.
    pub fn plan(&self, offer: usize) -> Option<&Plan> {
        self.offers.get(offer).map(|o| &o.plan)
    }

    /// Diagnoses the runs and shows what may come next; prints the end where nothing does.
    pub fn propose(
        &mut self,
        session: &Session<'_>,
        left: usize,
        reports: &[Recorded],
    ) -> Result<Event, CliError> {
        let sources: Vec<Source> = self.runs.iter().map(|r| r.source.clone()).collect();
        let stages = progress::Stages::begin("choosing what to run next");
        let watch = Watch {
            progress: &|stage| stages.tell(stage),
            // Before any run there is nothing to diagnose, and Ctrl-C ends the program as ever.
            limit: match sources.is_empty() {
                true => Limit::NONE,
                false => until_signal(session.args.limit.begin())?,
            },
        };
        let step = self.series.step(&sources, left, watch);
        drop(stages);
        let end = |why: Option<&str>, found: Option<&Diagnosis>| {
            tell_end(session, &self.runs, reports, why, found)
        };
        match step.map_err(CliError::run)? {
            Step::Run(proposal) => {
                show(&proposal, self.next, self.last);
                self.offers = proposal.offers;
                return Ok(Event::Proposed);
            }
            Step::Decided(found) => end(None, Some(&found))?,
            Step::Undecided { why, diagnosis } => end(Some(&why), diagnosis.as_deref())?,
        }
        Ok(Event::Concluded)
    }

    /// Poses of the run that has ended.
    pub fn examine(&mut self, session: &Session<'_>) -> Result<Event, CliError> {
        let log = self.log(self.next);
        let source = poses(&log, session.rig, session.build)?;
        self.runs.push(Run { log, source });
        self.next += 1;
        Ok(Event::Examined {
            stop: session.stopped(),
        })
    }

    /// Choice of the person at the tank; `None` = no more runs.
    pub fn ask(&self, session: &Session<'_>) -> Result<Option<usize>, CliError> {
        ask(session, &self.offers)
    }
}

/// Name, length and loads of a plan, in a line.
fn line(offer: &Offer) -> String {
    let loads = hydroline_plan::size::largest(&offer.plan).map_or(String::new(), plan::loads);
    format!(
        "{}, {:.1} s, {loads}: {:.1} nats",
        offer.plan.name,
        offer.plan.duration_s(),
        offer.gain_nats
    )
}

fn show(proposal: &Proposal, k: u32, most: u32) {
    if let Some(found) = &proposal.diagnosis {
        errln!("hydroline: so far: {}", found.verdict.sentence);
    }
    errln!("hydroline: run {k} of at most {most}: {}", proposal.reason);
    for (i, offer) in proposal.offers.iter().enumerate() {
        errln!("  {} {}", i + 1, line(offer));
    }
}

/// Waits for what the person at the tank says: the place of an offer, or `None` = no more runs.
fn ask(session: &Session<'_>, offers: &[Offer]) -> Result<Option<usize>, CliError> {
    let [x, y, z, _, _, psi] = session.rig.tank.start_pose;
    let others = match offers.len() {
        0 | 1 => String::new(),
        n => format!(", 2 to {n} chooses another"),
    };
    if session.args.return_to_start {
        errln!("hydroline: Enter takes plan 1{others}, q ends; the way to the start is shown then");
    } else {
        errln!(
            "hydroline: bring the vehicle to x {x:.3} m, y {y:.3} m, z {z:.3} m, heading {:.1} deg; Enter starts plan 1{others}, q ends",
            psi.to_degrees()
        );
    }
    let signals = hydroline_daemon::signals::listen().map_err(CliError::run)?;
    let (sender, receiver) = std::sync::mpsc::channel();
    let count = offers.len();
    std::thread::spawn(move || {
        for line in std::io::stdin().lines() {
            let Ok(line) = line else { break };
            match answer(&line, count) {
                Some(chosen) => {
                    sender.send(chosen).ok();
                    return;
                }
                None => errln!("hydroline: Enter, a number from 1 to {count}, or q"),
            }
        }
        // End of input: nobody is there.
        sender.send(None).ok();
    });
    loop {
        match receiver.recv_timeout(Duration::from_millis(50)) {
            Ok(chosen) => return Ok(chosen),
            Err(_) if signals.heard().is_some() || session.stopped() => return Ok(None),
            Err(_) => {}
        }
    }
}

/// A line typed: the place of an offer or the end; `None` = not understood.
fn answer(line: &str, offers: usize) -> Option<Option<usize>> {
    match line.trim() {
        "" => Some(Some(0)),
        "q" | "Q" => Some(None),
        number => {
            let k: usize = number.parse().ok()?;
            (1..=offers).contains(&k).then(|| Some(k - 1))
        }
    }
}

/// A load below this is the rounding of thrusts that cancel each other \[N, N m\].
const ROUNDING: f64 = 1e-6;

/// Of which DOFs that is: what was never driven has shown nothing.
fn scope(rig: &Rig, runs: &[Run]) -> String {
    let mut driven = [false; 6];
    let commands = runs.iter().flat_map(|r| &r.source.run.commands);
    for command in commands {
        for (d, load) in driven.iter_mut().zip(command.wrench) {
            *d |= load.abs() > ROUNDING;
        }
    }
    let Ok(allocation) = hydroline_sim::Allocation::new(&rig.thrusters) else {
        return String::new();
    };
    let made = |d: usize| {
        let one = std::array::from_fn(|i| if i == d { 1.0 } else { 0.0 });
        let whole = hydroline_rigs::Wrench::from_array(one);
        allocation.allocate(&whole).is_ok()
    };
    let of = |wanted: bool| -> Vec<&str> {
        let dofs = (0..6).filter(|d| driven[*d] == wanted && made(*d));
        dofs.map(|d| hydroline_rigs::Dof::ALL[d].name()).collect()
    };
    let (said, open) = (of(true).join(", "), of(false));
    match open.is_empty() {
        true => format!(", for {said}"),
        false => format!(
            ", for {said}; {} never driven: another series with --dof {} says of them",
            open.join(", "),
            open.join(",")
        ),
    }
}

/// Of which logs the verdict is by the motion alone.
fn without_images(runs: &[Run]) -> String {
    let without = runs.iter().filter(|r| r.source.frames.is_none());
    let names: Vec<_> = without
        .filter_map(|r| Some(r.log.file_name()?.to_string_lossy()))
        .collect();
    match names.is_empty() {
        true => String::new(),
        false => format!("; without images, by motion alone: {}", names.join(", ")),
    }
}

/// Series as `--until-decided --json` prints it.
#[derive(Debug, Serialize, JsonSchema)]
pub(crate) struct Printed<'a> {
    /// The runs in turn.
    runs: &'a [Recorded],
    /// The logs that the verdict is of.
    logs: Vec<&'a Path>,
    /// Whether it is decided.
    decided: bool,
    /// Why not, in words; `None` = it is.
    why: Option<&'a str>,
    /// Probability of the model that the verdict is of; `None` = no verdict.
    probability: Option<f64>,
    /// The verdict, as `diagnose --json` prints it; `None` = none was reached.
    verdict: Option<&'a Verdict>,
}

/// Prints the series at its end; `why` = why it is not decided.
fn tell_end(
    session: &Session<'_>,
    runs: &[Run],
    reports: &[Recorded],
    why: Option<&str>,
    found: Option<&Diagnosis>,
) -> Result<(), CliError> {
    let Session { args, rig, .. } = *session;
    if args.json {
        let printed = Printed {
            runs: reports,
            logs: runs.iter().map(|r| r.log.as_path()).collect(),
            decided: why.is_none(),
            why,
            probability: found.map(|f| f.probability),
            verdict: found.map(|f| &f.verdict),
        };
        return print::json(&printed);
    }
    if let Some(found) = found {
        diagnose::print(&found.verdict);
    }
    match why {
        None => outln!(
            "decided after {} run(s){}{}",
            runs.len(),
            scope(rig, runs),
            without_images(runs)
        ),
        Some(why) => outln!(
            "not decided after {} run(s): {why}{}",
            runs.len(),
            without_images(runs)
        ),
    }
    let logs: Vec<String> = runs
        .iter()
        .map(|r| poses_path(&r.log).display().to_string())
        .collect();
    if !logs.is_empty() {
        outln!(
            "the whole report: hydroline diagnose {} --rig {} --report DIR",
            logs.join(" "),
            args.rig
        );
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use hydroline_core::frame::{Frame, FrameMeta, LossBefore, StampClock, StampSource};
    use hydroline_log::{Entry, FileRecorder, Head, SummaryInput};
    use hydroline_rigs::PixelFormat;

    const T0_NS: u64 = 1_760_000_000_000_000_000;

    /// A log of one black frame that is too small to show anything.
    fn recorded(path: &Path, rig: &Rig) {
        let frame = Frame {
            format: PixelFormat::Grey,
            width_px: 16,
            height_px: 16,
            stride_bytes: 16,
            data: vec![8; 256].into(),
            meta: FrameMeta {
                sequence: 0,
                driver_stamp_ns: 0,
                stamp_clock: StampClock::Monotonic,
                stamp_source: StampSource::StartOfExposure,
                flags: 0x2001,
                received_monotonic_ns: 3_000_000,
                mid_exposure_ns: T0_NS,
                exposure_s: 0.004,
                fault: None,
                lost_before: LossBefore::default(),
            },
        };
        let head = Head {
            rig_toml: rig.to_toml(),
            ..Head::default()
        };
        let settings = WriteSettings::offline(Some(frame.format));
        let mut log = FileRecorder::create(path, false, head, settings).unwrap();
        log.write(T0_NS, &Entry::frame(&frame, 0)).unwrap();
        log.finish(&SummaryInput::clean("done")).unwrap();
    }

    /// A kill left `.run-1-poses.mcap.part.part`, which no later command cleared.
    #[test]
    fn poses_that_a_killed_command_left_unfinished_are_made_in_their_place() {
        let dir = tempfile::tempdir().unwrap();
        let (log, part) = (
            dir.path().join("run-1.mcap"),
            dir.path().join("run-1-poses.mcap.part"),
        );
        let rig = Rig::builtin("lshpi").unwrap();
        recorded(&log, &rig);
        std::fs::write(&part, "half").unwrap();
        // Without a pose it is no run, and its replay is whole all the same.
        let _ = poses(&log, &rig, BuildInfo::default());
        assert!(poses_path(&log).exists() && !part.exists());
        assert_eq!(std::fs::read_dir(dir.path()).unwrap().count(), 2);
    }

    #[test]
    fn a_line_is_a_start_a_choice_or_an_end() {
        assert_eq!(answer("", 3), Some(Some(0)));
        assert_eq!(answer(" 3 ", 3), Some(Some(2)));
        assert_eq!(answer("q", 3), Some(None));
        for line in ["0", "4", "yes", "-1"] {
            assert!(answer(line, 3).is_none(), "{line}");
        }
    }

    #[test]
    fn poses_stand_beside_their_log() {
        assert_eq!(
            poses_path(Path::new("/a/run-2.mcap")),
            Path::new("/a/run-2-poses.mcap")
        );
    }
}
