//! The camera's response that a replay fits with: the recording's own, else that of the log's opening. Where the rig in force
//! says other things of the camera than the rig that it was recorded with, the recording's is no answer.

use super::{Options, ReplayError};
use crate::response::{Found, ResponseReport};
use hydroline_log::messages::unix_ns;
use hydroline_log::{Closing, Record, Topic};
use hydroline_pose::joint::ResponsePrior;
use hydroline_pose::opening::{self, Opening};
use hydroline_pose::run::PoseRun;
use hydroline_rigs::Rig;
use std::path::Path;

/// The run with the camera's response in force, what is kept of it in the new log, and the account.
pub(super) fn responding(
    log: &Path,
    options: &Options,
    run: &PoseRun,
) -> Result<(PoseRun, Found, ResponseReport), ReplayError> {
    let (found, found_by) = match stated(log, options, run)? {
        Some(found) => (found, "recording"),
        None => (of_opening(log, options, run)?, "replay"),
    };
    Ok(under(run, found, found_by))
}

/// The same where the recording did not find it, from frames that fit now.
pub(super) fn found_again(
    log: &Path,
    options: &Options,
    run: &PoseRun,
) -> Result<(PoseRun, Found, ResponseReport), ReplayError> {
    Ok(under(run, of_opening(log, options, run)?, "replay"))
}

fn under(run: &PoseRun, found: Found, found_by: &'static str) -> (PoseRun, Found, ResponseReport) {
    let run = run.with_fitter(run.fitter().with_response(found.in_force()));
    (run, found, found.report(found_by))
}

/// Response that the recording states: in its summary, or where it has no end, in an event. (Of a recording in several parts the
/// first has the event, the last the summary.)
/// Of a folder, of images on another topic and of levels read by another rule it says nothing.
fn stated(log: &Path, options: &Options, run: &PoseRun) -> Result<Option<Found>, ReplayError> {
    let input = options.open(log)?;
    if options.image_topic.is_some()
        || input.grey_rule() != Some(options.rule)
        || !same_statement(input.rig_toml(), run)
    {
        return Ok(None);
    }
    let closing = Closing::of(log);
    if let Some(found) = closing
        .as_ref()
        .and_then(|c| Found::of_metadata(&c.summary))
    {
        return Ok(Some(found));
    }
    if closing.is_some_and(|c| c.messages_of(Topic::Motion.name()) == 0) {
        // No pose was fitted live.
        return Ok(None);
    }
    for message in input {
        if let Record::Event(event) = message?.record
            && let Some(found) = Found::of_event(&event)
        {
            return Ok(Some(found));
        }
    }
    Ok(None)
}

/// Whether a log's own rig, if it has one that reads, says the same of the camera as the rig in force.
fn same_statement(logged: Option<&str>, run: &PoseRun) -> bool {
    let rig = logged.and_then(|text| Rig::from_toml(text, "rig", None).ok());
    let of_log = rig.and_then(|rig| rig.camera.response);
    ResponsePrior::of_rig(of_log.as_ref()) == *run.fitter().response_prior().0
}

/// Response from the log's first frames that show the target.
fn of_opening(log: &Path, options: &Options, run: &PoseRun) -> Result<Found, ReplayError> {
    let mut analyst = options.analyst();
    let mut opening = Opening::new(run, opening::Options::default());
    for message in options.open(log)? {
        let frame = match message?.record {
            Record::Frame(frame) => frame,
            Record::Command(command) => {
                let stamp_ns = command.timestamp.as_ref().map_or(0, unix_ns);
                opening.command(stamp_ns, &command.thruster, command.thrust_n);
                continue;
            }
            _ => continue,
        };
        if let (_, Ok((image, profile))) = analyst.analyse_whole(&frame) {
            opening.look(frame.meta.mid_exposure_ns, &image, &profile);
        }
        if opening.is_over() {
            break;
        }
    }
    Ok(Found::of(&opening))
}
