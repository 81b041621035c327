//! The joined log.

use std::path::Path;

use hydroline_core::build_info::BuildInfo;
use hydroline_identify::data::StillWatch;
use hydroline_log::messages::{Stamped, timestamp};
use hydroline_log::{
    Entry, FileRecorder, Head, LogError, LogReader, MetadataMap, Record, SummaryInput,
    WriteSettings,
};

use super::pair::Pair;
use super::{JoinError, Joined, Relation};

/// Metadata `session` of a joined log, as `diagnose` reads it.
fn session(relation: &Relation, motion: &Path, commands: &Path) -> MetadataMap {
    let name = |p: &Path| p.display().to_string();
    MetadataMap::from([
        ("kind".to_owned(), "join".to_owned()),
        ("join.motion".to_owned(), name(motion)),
        ("join.commands".to_owned(), name(commands)),
        (
            "join.offset_from".to_owned(),
            relation.from.word().to_owned(),
        ),
        ("join.offset_s".to_owned(), relation.offset_s.to_string()),
        (
            "join.offset_sd_s".to_owned(),
            relation.offset_sd_s.to_string(),
        ),
        ("join.drift_ppm".to_owned(), relation.drift_ppm.to_string()),
        (
            "join.drift_sd_ppm".to_owned(),
            relation.drift_sd_ppm.to_string(),
        ),
        (
            "join.reference_ns".to_owned(),
            relation.reference_ns.to_string(),
        ),
    ])
}

/// The next record of a log that is wanted, as an entry with its time; the others are counted.
fn next(
    reader: &mut LogReader,
    left_out: &mut usize,
    mut wanted: impl FnMut(u64, Record) -> Option<(u64, Entry)>,
) -> Result<Option<(u64, Entry)>, LogError> {
    for message in reader.by_ref() {
        let message = message?;
        match wanted(message.log_ns, message.record) {
            Some(entry) => return Ok(Some(entry)),
            None => *left_out += 1,
        }
    }
    Ok(None)
}

pub(super) fn write(
    pair: &Pair,
    motion: &Path,
    commands: &Path,
    relation: Relation,
    out: &Path,
    build: BuildInfo,
) -> Result<Joined, JoinError> {
    let (first, last) = (
        relation.moved(pair.commands_ns.0),
        relation.moved(pair.commands_ns.1),
    );
    if first > pair.motion_ns.1 || last < pair.motion_ns.0 {
        let span =
            |(a, b): (u64, u64)| format!("UNIX {:.3} .. {:.3} s", a as f64 * 1e-9, b as f64 * 1e-9);
        return Err(JoinError::Apart {
            offset_s: relation.offset_s,
            motion: span(pair.motion_ns),
            commands: span((first, last)),
        });
    }
    let rig = pair.rig_toml().unwrap_or("# joined: no rig was recorded\n");
    let mut session = session(&relation, motion, commands);
    session.extend(pair.instrument_sd.iter().cloned());
    let head = Head {
        rig_toml: rig.to_owned(),
        calibration_toml: None,
        session,
        build,
    };
    let mut log = FileRecorder::create_whole(out, false, head, WriteSettings::offline(None))?;
    let mut still = StillWatch::default();
    let mut joined = Joined {
        relation,
        samples: 0,
        commands: 0,
        outside: 0,
        left_out: 0,
    };
    let (mut a, mut b) = (LogReader::open(motion)?, LogReader::open(commands)?);
    let of_motion = |still: &mut StillWatch, log_ns, record| match record {
        Record::Motion(m) => {
            still.motion(&m);
            Some((log_ns, Entry::motion(&m)))
        }
        _ => None,
    };
    let relation = joined.relation.clone();
    let (mut inside, mut outside) = (0, 0);
    let mut of_commands = |still: &mut StillWatch, log_ns, record| match record {
        Record::Command(mut c) => {
            let ns = relation.moved(c.stamp_ns().unwrap_or(0));
            c.timestamp = Some(timestamp(ns));
            if (pair.motion_ns.0..=pair.motion_ns.1).contains(&ns) {
                inside += 1;
            } else {
                outside += 1;
            }
            still.command(&c);
            Some((relation.moved(log_ns), Entry::command(&c)))
        }
        _ => None,
    };
    let left_out = &mut joined.left_out;
    let mut next_a = next(&mut a, left_out, |ns, r| of_motion(&mut still, ns, r))?;
    let mut next_b = next(&mut b, left_out, |ns, r| of_commands(&mut still, ns, r))?;
    loop {
        let motion_first = match (&next_a, &next_b) {
            (Some(a), Some(b)) => a.0 < b.0,
            (Some(_), None) => true,
            (None, Some(_)) => false,
            (None, None) => break,
        };
        if motion_first {
            if let Some((ns, entry)) = next_a.take() {
                log.write(ns, &entry)?;
                joined.samples += 1;
            }
            next_a = next(&mut a, left_out, |ns, r| of_motion(&mut still, ns, r))?;
        } else {
            if let Some((ns, entry)) = next_b.take() {
                log.write(ns, &entry)?;
            }
            next_b = next(&mut b, left_out, |ns, r| of_commands(&mut still, ns, r))?;
        }
    }
    joined.commands = inside + outside;
    joined.outside = outside;
    let mut summary = SummaryInput::clean("joined to the end of both logs");
    // As of an import: the default tolerance of a rig.
    summary
        .more
        .extend(still.metadata([0.002, 0.1f64.to_radians()]));
    log.finish(&summary)?;
    Ok(joined)
}
