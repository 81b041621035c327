//! `record --next` and `--until-decided`: run after run, each replayed and diagnosed on the spot, the plan proposed that
//! says most beside those that are there.
//!
//! The state of a session is its logs: LOG-1.mcap, LOG-2.mcap, ... with LOG-1-poses.mcap, ... beside them. One that was cut
//! off goes on from what is there.

use super::super::{diagnose, plan, replay};
use super::*;
use hydroline_calib::analytic::IdealMap;
use hydroline_calib::plane::PlaneMap;
use hydroline_diagnose::body::next::Offer;
use hydroline_diagnose::until::{Options, Proposal, Series, Step};
use hydroline_diagnose::verdict::Verdict;
use hydroline_diagnose::{Diagnosis, Source, read};
use hydroline_identify::data::check_vehicle;
use std::sync::Arc;

/// A series of two and more has numbers in its names.
const NUMBERED: u32 = 2;

/// A recorded run of the series.
struct Run {
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
        // Whole or not at all: a replay that was cut off is none.
        let name = out.file_name().unwrap_or_default().to_string_lossy();
        let part = out.with_file_name(format!(".{name}.part"));
        if part.exists() {
            std::fs::remove_file(&part).map_err(|e| CliError::writing(&part, &e))?;
        }
        replay::one(log, &part, build)?;
        std::fs::rename(&part, &out).map_err(|e| CliError::writing(&out, &e))?;
    }
    for words in check_vehicle(&out, rig)? {
        errln!("hydroline: {words}");
    }
    Ok(read(&out, rig)?)
}

/// The series as far as it is there, and the number of the next run.
fn recorded(out: &Path, rig: &Rig, build: BuildInfo) -> Result<(Vec<Run>, u32), CliError> {
    let mut runs = Vec::new();
    let mut k = 1;
    loop {
        let log = run_path(out, k, NUMBERED);
        if !log.exists() {
            return Ok((runs, k));
        }
        match poses(&log, rig, build) {
            Ok(source) => runs.push(Run { log, source }),
            Err(error) => errln!(
                "hydroline: {}: {error}; the series goes on without it",
                log.display()
            ),
        }
        k += 1;
    }
}

/// What is done with a proposal.
enum Answer {
    Start(usize),
    End,
}

/// Run after run.
pub(super) fn run(
    rig: &Rig,
    session: &Session<'_>,
    args: &Args,
    calibration: Option<Calibration>,
) -> Result<Outcome, CliError> {
    let Some(out) = &args.out else {
        return Err(CliError::Config(
            "--out is missing: it names the series, LOG-1.mcap, LOG-2.mcap, ...".to_owned(),
        ));
    };
    let (mut runs, mut k) = recorded(out, rig, session.build)?;
    if !runs.is_empty() {
        errln!(
            "hydroline: goes on from {} run(s) of this series",
            runs.len()
        );
    }
    let most = if args.next { k } else { args.max_runs };
    let mut reports = Vec::new();
    let mut outcome = Outcome::Done;
    let options = Options {
        dofs: args.dof.clone(),
        calibration: calibration.clone(),
        ..Options::default()
    };
    let series = Series::new(rig, options);
    loop {
        let sources: Vec<Source> = runs.iter().map(|r| r.source.clone()).collect();
        let left = (most + 1).saturating_sub(k) as usize;
        let stages = progress::Stages::begin("choosing what to run next");
        let next = series.step(&sources, left, &|stage| stages.tell(stage));
        drop(stages);
        let proposal = match next.map_err(CliError::run)? {
            // Never behind the last run: none is left then.
            Step::Run(proposal) => proposal,
            Step::Decided(found) => {
                tell_end(args, rig, &runs, &reports, None, Some(&found))?;
                return Ok(outcome);
            }
            Step::Undecided { why, diagnosis } => {
                tell_end(args, rig, &runs, &reports, Some(&why), diagnosis.as_deref())?;
                return Ok(outcome);
            }
        };
        propose(&proposal, k, most);
        if args.dry_run {
            return Ok(outcome);
        }
        let chosen = if args.yes {
            0
        } else {
            match ask(rig, &proposal.offers, session, args.return_to_start)? {
                Answer::Start(chosen) => chosen,
                Answer::End => {
                    errln!(
                        "hydroline: ended by you; the same command goes on from {} run(s)",
                        runs.len()
                    );
                    return Ok(outcome);
                }
            }
        };
        let offer = &proposal.offers[chosen];
        let log = run_path(out, k, NUMBERED);
        inputs::new_file("--out", &log)?;
        if args.return_to_start && !args.yes {
            let map: Arc<dyn PlaneMap> = match &calibration {
                Some(calibration) => Arc::from(calibration.to_map()),
                None => Arc::new(IdealMap::of(rig)),
            };
            let there = bring_back::wait(&Way {
                rig,
                map,
                near: args.near,
                run: (k, most),
                live: session.live(rig, &log, (k, most)),
                stopped: &|| session.stopped(),
            })?;
            if !there {
                errln!(
                    "hydroline: ended by you; the same command goes on from {} run(s)",
                    runs.len()
                );
                return Ok(outcome);
            }
        }
        let with_plan = Session {
            plan: Some(&offer.plan),
            conditions: session.conditions,
            build: session.build,
            shown: session.shown,
            tank: session.tank,
            ended: Cell::new(false),
        };
        let calibrating = Calibrating {
            calibration: calibration.clone(),
            calibrate: None,
            out: None,
        };
        let rigs = [rig.clone()];
        let logs = [log.clone()];
        let made = record_all(&rigs, &with_plan, args, calibrating, &logs, &mut reports)?;
        if matches!(made, Outcome::Lossy) {
            outcome = Outcome::Lossy;
        }
        let source = poses(&log, rig, session.build)?;
        runs.push(Run { log, source });
        k += 1;
        if with_plan.ended.get() || session.stopped() {
            errln!("hydroline: ended by you; the same command goes on from here");
            return Ok(outcome);
        }
    }
}

/// What a plan is, in a line.
fn line(offer: &Offer) -> String {
    let loads = hydroline_plan::size::largest(&offer.plan).map_or(String::new(), plan::loads);
    format!(
        "{}, {:.1} s, {loads}: {:.1} nats",
        offer.plan.name,
        offer.plan.duration_s(),
        offer.gain_nats
    )
}

fn propose(proposal: &Proposal, k: u32, most: u32) {
    if let Some(found) = &proposal.diagnosis {
        errln!("hydroline: so far: {}", found.verdict.sentence);
    }
    errln!("hydroline: run {k} of at most {most}: {}", proposal.reason);
    for (i, offer) in proposal.offers.iter().enumerate() {
        errln!("  {} {}", i + 1, line(offer));
    }
}

/// Waits for what the person at the tank says.
fn ask(
    rig: &Rig,
    offers: &[Offer],
    session: &Session<'_>,
    shown: bool,
) -> Result<Answer, CliError> {
    let [x, y, z, _, _, psi] = rig.tank.start_pose;
    let others = match offers.len() {
        0 | 1 => String::new(),
        n => format!(", 2 to {n} chooses another"),
    };
    if shown {
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
                Some(answer) => {
                    sender.send(answer).ok();
                    return;
                }
                None => errln!("hydroline: Enter, a number from 1 to {count}, or q"),
            }
        }
        // End of input: nobody is there.
        sender.send(Answer::End).ok();
    });
    loop {
        match receiver.recv_timeout(Duration::from_millis(50)) {
            Ok(answer) => return Ok(answer),
            Err(_) if signals.heard().is_some() || session.stopped() => return Ok(Answer::End),
            Err(_) => {}
        }
    }
}

/// A line typed; `None` = not understood.
fn answer(line: &str, offers: usize) -> Option<Answer> {
    match line.trim() {
        "" => Some(Answer::Start(0)),
        "q" | "Q" => Some(Answer::End),
        number => {
            let k: usize = number.parse().ok()?;
            (1..=offers).contains(&k).then(|| Answer::Start(k - 1))
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

/// What `--until-decided --json` prints.
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

/// What the series says at its end; `why` = why it is not decided.
fn tell_end(
    args: &Args,
    rig: &Rig,
    runs: &[Run],
    reports: &[Recorded],
    why: Option<&str>,
    found: Option<&Diagnosis>,
) -> Result<(), CliError> {
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
        None => outln!("decided after {} run(s){}", runs.len(), scope(rig, runs)),
        Some(why) => outln!("not decided after {} run(s): {why}", runs.len()),
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

    #[test]
    fn a_line_is_a_start_a_choice_or_an_end() {
        assert!(matches!(answer("", 3), Some(Answer::Start(0))));
        assert!(matches!(answer(" 3 ", 3), Some(Answer::Start(2))));
        assert!(matches!(answer("q", 3), Some(Answer::End)));
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
